"""Normal pressures along contact surface 2."""

from figures.column import NEEDS, Along

__all__ = ["NEEDS", "SECTION", "alt", "caption", "draw"]

SECTION = "7.5"
_FIGURE = Along(surface=2, quantity="pressure")
draw, caption, alt = _FIGURE.draw, _FIGURE.caption, _FIGURE.alt
