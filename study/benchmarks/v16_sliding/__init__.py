"""Large strains and large sliding of rubber below a cylinder and a sphere (section V16)."""
