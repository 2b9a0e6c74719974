"""Interface laws, heat across interfaces and nodes in several pairs (section V21)."""
