"""What the figures of methods on one problem share."""

from typing import Any

LOOK: dict[str, dict[str, Any]] = {
    "pw-T6": {"color": "#0072B2", "marker": "o", "label": "new element"},
    "snes-vi": {"color": "#D55E00", "marker": "^", "label": "standard, own weights"},
    "nitsche-symmetric": {"color": "#007A5A", "marker": "D", "label": "Nitsche, symmetric"},
    "nitsche-skew": {"color": "#56B4E9", "marker": "d", "label": "Nitsche, skew"},
    "penalty": {"color": "#B87A00", "marker": "s", "label": "penalty"},
    "augmented-p1": {"color": "#6A4C93", "marker": "P", "label": "augm. Lagr. P2/P1"},
    "mortar-p1": {"color": "#B0568C", "marker": "v", "label": "mortar P2/P1"},
    "linear": {"color": "#777777", "marker": "x", "label": "linear elements"},
}
"""Colour, marker and label of the methods that are drawn."""
