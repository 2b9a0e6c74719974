"""Section W: problems in which nodal forces or pressures enter a law."""
