"""Vibration with known answers: its page, and exact eigenvalues."""
