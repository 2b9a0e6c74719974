"""Benchmarks of the study: each page has text, exact solution, cases, checks and figures."""
