"""Verification and comparison study of the piecewise-linear weight functions."""
