"""Large strains: a rubber block below a punch that sticks (section V14)."""
