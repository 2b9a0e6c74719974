"""What the results say to the paper's statements and to this study's findings."""
