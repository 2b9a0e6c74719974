"""Time and memory of assembly, solvers and contact: section K."""
