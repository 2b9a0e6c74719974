"""Normal pressures along contact surface 3."""

from figures.column import NEEDS, Along

__all__ = ["NEEDS", "SECTION", "alt", "caption", "draw"]

SECTION = "7.5"
_FIGURE = Along(surface=3, quantity="pressure")
draw, caption, alt = _FIGURE.draw, _FIGURE.caption, _FIGURE.alt
