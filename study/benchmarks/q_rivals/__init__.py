"""Section Q: alternatives to the new element, on Hertz' problem."""
