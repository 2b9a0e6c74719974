"""Scripts that measure computing times and print a table; they do not assert anything."""
