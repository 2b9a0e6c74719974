"""What the elements cost: a benchmark, its record, and the section that reads it."""
