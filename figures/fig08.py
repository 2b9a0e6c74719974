"""Stresses along the contact area calculated with 8-node quadrilateral elements."""

from figures.contact import BlockStresses

SECTION = "7.2"
_FIGURE = BlockStresses("8-node quadrilaterals", ("galerkin-Q8", "pw-Q8", "pw-Q9"))
NEEDS = _FIGURE.needs
draw, caption, alt = _FIGURE.draw, _FIGURE.caption, _FIGURE.alt
