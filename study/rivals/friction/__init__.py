"""The same with Coulomb friction, pressed in one increment: one method a file."""

COEFFICIENT = 0.3
