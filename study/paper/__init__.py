"""The paper, section by section, and the list of its items."""
