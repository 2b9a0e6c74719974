"""Nearly incompressible bodies on hybrid elements (section V15)."""
