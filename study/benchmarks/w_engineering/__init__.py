"""Section W: five applications in which nodal forces or pressures enter a law."""
