"""Section C: orders of convergence."""
