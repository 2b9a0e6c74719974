"""Stress curves and deformed shapes, which the figures of contact examples share."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from figures.style import LOOK, MANY
from study.model.vocabulary import ELEMENTS
from study.paper.bands import (
    DIAGONALS_LABEL,
    UNPRINTED_DATA_LABEL,
    Variants,
    envelope,
    list_case_family,
)
from study.run.store import Results

DATA_BAND = {"color": "#BFBFBF", "label": UNPRINTED_DATA_LABEL}
"""Look of the band of data that are not printed."""

RECONSTRUCTED = "Dimensions and loads are reconstructed."

Curves = dict[str, np.ndarray]


def family(results: Results, key: str, families: Mapping[str, Variants]) -> list[Curves]:
    """Curves of a case and of the others of its family."""
    return [results.curves(member) for member in list_case_family(key, families)]


def diagonal_band(element: str) -> dict[str, Any]:
    """Look of the band of an element whose squares can be cut in several ways."""
    stated = ELEMENTS[element]
    return {"color": stated.colour, "alpha": 0.45, "label": f"{stated.name}, {DIAGONALS_LABEL}"}


def band(
    ax: Axes, lines: Sequence[Curves], quantity: str, scale: float, look: Mapping[str, Any]
) -> None:
    """Shades what lies between the least and the largest of several cases, times a scale."""
    x, low, high = envelope([(curves["x"], curves[quantity]) for curves in lines])
    ax.fill_between(x, scale * low, scale * high, linewidth=0, zorder=0.5, **look)


def compare(
    ax: Axes,
    results: Results,
    keys: Sequence[str],
    quantity: str,
    scale: float = 1.0,
    hollow: str = "composite",
) -> None:
    """Draws a stress or force of several elements, times a scale, over x.

    One whose element has `hollow` in it nearly coincides with another and gets hollow markers.
    """
    for key in keys:
        curves = results.curves(key)
        element = results[key].parameters["element"]
        look = {**LOOK[element], "linewidth": 0.9, "markersize": 3}
        if hollow in element:
            look |= {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.5}
        ax.plot(curves["x"], scale * curves[quantity], **look)


def outline(cells: np.ndarray) -> np.ndarray:
    """Nodes of each cell (m, 6, 8 or 9), going round (m, 6 or 8)."""
    around = [0, 5, 1, 3, 2, 4] if cells.shape[1] == 6 else [0, 4, 1, 6, 3, 7, 2, 5]
    return cells[:, around]


def deformed(ax: Axes, curves: Curves, scale: float, element: str) -> np.ndarray:
    """Draws the deformed mesh; returns its nodes."""
    moved = curves["nodes"] + scale * curves["displacement"]
    cells = PolyCollection(
        moved[outline(curves["cells"])],
        facecolor="#EEF3F7",
        edgecolor="#8A97A3",
        lw=0.4,
        rasterized=len(curves["cells"]) > MANY,
    )
    ax.add_collection(cells)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.grid(visible=False)
    ax.set_title(LOOK[element]["label"], loc="left")
    return moved


def force_arrows(
    ax: Axes, curves: Curves, moved: np.ndarray, side: float, length: float, element: str
) -> None:
    """Draws nodal contact forces on the body; `side` is -1 for a surface below, 1 above.

    The largest normal force is drawn with the given length.
    """
    line = np.column_stack([curves["x"], curves["y"]])
    distance = np.linalg.norm(curves["nodes"][:, None] - line, axis=2)
    nodes = distance.argmin(axis=0)
    scale = length / curves["force_n"].max()
    for node, r_n, r_t in zip(nodes, curves["force_n"], curves["force_t"], strict=True):
        if r_n < 1e-9 * curves["force_n"].max():
            continue  # open
        force = scale * np.array([-r_t, -side * r_n])
        style = {"arrowstyle": "-|>", "lw": 0.8, "color": LOOK[element]["color"]}
        style |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
        ax.annotate("", moved[node], moved[node] - force, arrowprops=style)
