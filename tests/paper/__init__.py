"""What the paper prints, section by section, against the oracle and the study."""
