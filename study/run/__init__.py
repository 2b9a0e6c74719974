"""Cases, their results on disk, and what runs and compares them: knows no mechanics."""
