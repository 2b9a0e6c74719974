"""Select curves of contact surfaces and find the outline, for figures of the stepped column."""

import numpy as np

from figures.contact import Curves

SURFACES = (1, 2, 3, 4)
SURFACE_NAMES = {1: "the base", 2: "the lower shoulder", 3: "the upper shoulder", 4: "the top"}
MM_PER_M = 1e3
SYNTHETIC_NOTE = "Synthetic column and supports."


def select_surface_curves(curves: Curves, number: int) -> Curves:
    """Return the curves along one of the four contact surfaces, without the number in their names.

    Args:
        curves: Curves of a result of section 7.5, such as "pressure_2" on surface 2.
        number: Number of the surface, one of `SURFACES`.

    Returns:
        Curves such as "pressure" on this surface, and the nodes, cells and displacements of the
        body.
    """
    suffix = f"_{number}"
    surface_curves = {
        name.removesuffix(suffix): curve for name, curve in curves.items() if name.endswith(suffix)
    }
    return surface_curves | {name: curves[name] for name in ("nodes", "cells", "displacement")}


def corners_of_column_section(curves: Curves) -> np.ndarray:
    """Return the corners of the column's meridional section, from the base to the top.

    Args:
        curves: Curves of a result of section 7.5.

    Returns:
        Radius and height in m of each corner, from the axis at the base to the axis at the top,
        shape (m, 2).
    """
    (base, lower, upper, top) = (select_surface_curves(curves, number) for number in SURFACES)
    corners = [(0.0, base["y"][0])]
    for surface_curves in (base, lower, upper):
        corners += [
            (surface_curves["x"][0], surface_curves["y"][0]),
            (surface_curves["x"][-1], surface_curves["y"][0]),
        ]
    nodes = curves["nodes"]
    is_widest = np.isclose(nodes[:, 0], nodes[:, 0].max())
    shoulder_height = nodes[is_widest, 1].max()
    corners += [(nodes[:, 0].max(), shoulder_height), (top["x"][-1], shoulder_height)]
    corners += [(top["x"][-1], top["y"][0]), (0.0, top["y"][0])]
    return np.array(corners)
