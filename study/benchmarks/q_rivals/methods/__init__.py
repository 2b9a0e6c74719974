"""Contact methods for one problem, one file each, so that a single file can be copied."""
