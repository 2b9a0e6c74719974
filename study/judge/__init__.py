"""Judge the paper's statements and this study's findings by the stored results."""
