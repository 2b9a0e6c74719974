"""Exact and numerical solutions that several sections use."""
