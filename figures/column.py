"""What the figures of the stepped column share: its four surfaces, its outline."""

import numpy as np

from figures.contact import Curves

SURFACES = (1, 2, 3, 4)
NAMES = {1: "the base", 2: "the lower shoulder", 3: "the upper shoulder", 4: "the top"}
MM = 1e3
SYNTHETIC = "Synthetic column and supports."


def select_surface_curves(curves: Curves, number: int) -> Curves:
    """Curves along one contact surface, and those of the whole body."""
    end = f"_{number}"
    own = {name.removesuffix(end): curve for name, curve in curves.items() if name.endswith(end)}
    return own | {name: curves[name] for name in ("nodes", "cells", "displacement")}


def section_outline(curves: Curves) -> np.ndarray:
    """Corners (m, 2) of the section, from the axis at the base round to the axis at the top."""
    (base, lower, upper, top) = (select_surface_curves(curves, k) for k in SURFACES)
    corners = [(0.0, base["y"][0])]
    for face in (base, lower, upper):
        corners += [(face["x"][0], face["y"][0]), (face["x"][-1], face["y"][0])]
    nodes = curves["nodes"]
    widest = np.isclose(nodes[:, 0], nodes[:, 0].max())
    shoulder = nodes[widest, 1].max()
    corners += [(nodes[:, 0].max(), shoulder), (top["x"][-1], shoulder)]
    corners += [(top["x"][-1], top["y"][0]), (0.0, top["y"][0])]
    return np.array(corners)
