"""Section V8, vibration with known answers: the page, and exact eigenvalues."""
