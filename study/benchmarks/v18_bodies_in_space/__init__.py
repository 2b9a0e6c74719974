"""Two deformable bodies that slide on each other at large strains in space (section V18)."""
