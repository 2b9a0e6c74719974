"""Common style of all figures."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from study.model.vocabulary import ELEMENTS, TWO_BODY_METHODS

matplotlib.use("Agg")

COLUMN_WIDTH = 3.5
"""Width in inches of a figure that spans one column."""
PAIR_NARROW_WIDTH = 2.4
"""Width in inches of the narrower of two figures side by side."""
PAIR_WIDE_WIDTH = 4.5
"""Width in inches of the wider of two figures side by side."""
PAGE_WIDTH = 7.0
"""Width in inches of a figure that spans the page."""

MAX_VECTOR_ITEMS = 50
"""Largest number of cells or points drawn as vectors; more are rasterised to keep pages fast."""

LABEL_BOX: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
"""Box behind labels of lines, which prevents the grid from crossing the letters."""

ELEMENT_LOOK: dict[str, dict[str, Any]] = {
    key: {"color": element.colour, "marker": element.marker, "label": element.name}
    for key, element in ELEMENTS.items()
}
"""Colour, marker and label of each element, as in `ax.plot(x, y, **ELEMENT_LOOK["pw-T6"])`."""

METHOD_LOOK: dict[str, dict[str, Any]] = {
    key: {"color": way.colour, "marker": way.marker, "label": way.name}
    for key, way in TWO_BODY_METHODS.items()
}
"""Colour, marker and label of each method for two bodies; these figures show no other elements."""

RC_PARAMETERS = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "figure.figsize": (COLUMN_WIDTH, 2.6),
    "figure.constrained_layout.use": True,
    "savefig.dpi": 200,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.0,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "pw-elements",
}


@contextmanager
def study_style() -> Iterator[None]:
    """Apply the study's style to everything that is drawn within the context."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC_PARAMETERS)
        yield


def set_plain_ticks(ax: Axes) -> None:
    """Label a logarithmic vertical axis at 1, 2 and 5 of each decade with plain numbers."""
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())


def plot_mesh(
    ax: Axes,
    x: np.ndarray,
    cells: np.ndarray,
    linewidth: float = 0.6,
) -> None:
    """Draw a mesh of quadratic cells with its corner and mid-side nodes, to scale.

    Nodes of cells may be in any order in which the corners come first. The corners are sorted
    around the centre, and each side is assigned the node closest to its middle.

    Args:
        ax: Axes in which to draw.
        x: Coordinates of the nodes, shape (nodes, 2 or 3).
        cells: Nodes of each cell, shape (cells, 3 or 6) for triangles, (cells, 4, 8 or 9) for
            quadrilaterals. Without mid-side nodes, the middles of the sides are drawn instead.
        linewidth: Width of the lines in points.
    """
    x = np.asarray(x)[:, :2]
    cells = np.asarray(cells)
    n_corners = 3 if cells.shape[1] in (3, 6) else 4
    sides, corner_points, middle_points = [], [], []
    for cell in cells:
        ordered_corners, ordered_middles = _order_corners_and_middles(
            x[cell[:n_corners]], x[cell[n_corners:]]
        )
        next_corners = np.roll(ordered_corners, -1, axis=0)
        t = np.linspace(0, 1, 9)[:, None]
        for start, middle, end in zip(ordered_corners, ordered_middles, next_corners, strict=True):
            sides.append(
                (1 - t) * (1 - 2 * t) * start + 4 * t * (1 - t) * middle + t * (2 * t - 1) * end
            )
        corner_points.append(ordered_corners)
        middle_points.append(ordered_middles)
    line_collection = LineCollection(sides, colors="#555555", linewidths=linewidth)
    ax.add_collection(line_collection).set_rasterized(len(cells) > MAX_VECTOR_ITEMS)
    for points, size, facecolor in ((corner_points, 3.0, "#333333"), (middle_points, 2.6, "white")):
        unique_points = np.unique(np.round(np.concatenate(points), 12), axis=0)
        look: dict[str, Any] = {
            "ms": size,
            "mfc": facecolor,
            "mec": "#333333",
            "mew": 0.6,
            "ls": "none",
        }
        ax.plot(*unique_points.T, "o", rasterized=len(cells) > MAX_VECTOR_ITEMS, **look)
    ax.set_aspect("equal")
    ax.autoscale_view()


def _order_corners_and_middles(
    corners: np.ndarray, midside_nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners in cyclic order, and the mid-side node after each corner."""
    offsets = corners - corners.mean(axis=0)
    corners = corners[np.argsort(np.arctan2(offsets[:, 1], offsets[:, 0]))]
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    if len(midside_nodes):
        distance = np.linalg.norm(middles[:, None] - midside_nodes, axis=2)
        middles = midside_nodes[distance.argmin(axis=1)]
    return corners, middles
