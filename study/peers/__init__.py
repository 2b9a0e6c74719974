"""The study's problems in an independent code, and how far its answers are from ours."""
