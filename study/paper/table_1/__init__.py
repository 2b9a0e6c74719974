"""Table 1 as a blind test: columns fitted to the standard elements alone judge the user rows."""
