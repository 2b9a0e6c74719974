"""Reaction forces along the contact area of the rigid plate, user element."""

from figures.contact import PlateReactions

SECTION = "7.4"
_FIGURE = PlateReactions("pw-Q8")
NEEDS = _FIGURE.needs
draw, caption, alt = _FIGURE.draw, _FIGURE.caption, _FIGURE.alt
