"""Section Q: methods that a user would pick instead of the new element, on Hertz' problem."""
