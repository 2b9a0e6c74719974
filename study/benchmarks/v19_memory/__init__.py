"""Materials with memory in contact (section V19)."""
