"""Contact and friction in space, on tetrahedra and hexahedra: section V10."""
