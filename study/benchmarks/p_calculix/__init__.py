"""Section P: the study's problems in CalculiX, an independent code."""
