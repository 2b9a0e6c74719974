"""Test that printed values, the study and an independent oracle agree, by sections of the paper."""
