"""Two deformable bodies that slide on each other at large strains (section V17)."""
