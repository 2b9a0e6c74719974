"""Figures and tables of the study, drawn from stored results."""
