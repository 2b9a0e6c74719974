"""Stresses along the contact area calculated with 6-node triangular elements."""

from figures.contact import BlockStresses

SECTION = "7.2"
_FIGURE = BlockStresses("6-node triangles", ("galerkin-T6", "pw-T6", "composite-T6"))
NEEDS = _FIGURE.needs
draw, caption, alt = _FIGURE.draw, _FIGURE.caption, _FIGURE.alt
