"""Scripts that measure and print a table; nothing in them is asserted."""
