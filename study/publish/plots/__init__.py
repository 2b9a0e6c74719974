"""Common style and types of plots of the figures."""
