"""Texts, report and site, and the command line that produces them."""
