"""Exact and independent solutions that several sections use."""
