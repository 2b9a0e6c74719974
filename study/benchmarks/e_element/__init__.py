"""Section E: solvability and uniqueness of the element, and its family."""
