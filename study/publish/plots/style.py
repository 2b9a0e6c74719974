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
"""Largest number of cells or points that are drawn as vector graphics.

If there are more, they are drawn as pixels, which browsers display faster.
"""

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
"""Colour, marker and label of each method for contact between two bodies.

Figures that compare these methods show no elements of `ELEMENT_LOOK`.
"""

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
    """Context manager that applies the style of the study to Matplotlib figures drawn within it."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC_PARAMETERS)
        yield


def label_log_y_axis_with_plain_numbers(ax: Axes) -> None:
    """Place ticks at 1, 2 and 5 of each decade of a logarithmic y axis, without powers of ten."""
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())


def draw_quadratic_mesh_with_nodes(
    ax: Axes,
    node_coordinates: np.ndarray,
    cells: np.ndarray,
    linewidth: float = 0.6,
) -> None:
    """Draw a mesh of quadratic cells with curved sides, corner nodes and mid-side nodes, to scale.

    The corners must come first in each cell, and otherwise the order of the nodes is arbitrary:
    corners are sorted by angle around their centre, and each side takes the mid-side node nearest
    to it.

    Args:
        ax: Axes in which to draw.
        node_coordinates: Coordinates of the nodes, shape (nodes, 2 or 3); only the first two are
            used.
        cells: Node indices of each cell, shape (cells, 3 or 6) for triangles and (cells, 4, 8 or 9)
            for quadrilaterals. Without mid-side nodes, the middles of straight sides are drawn.
        linewidth: Width of the lines in points.
    """
    node_coordinates = np.asarray(node_coordinates)[:, :2]
    cells = np.asarray(cells)
    n_corners = 3 if cells.shape[1] in (3, 6) else 4
    sides, corner_points, middle_points = [], [], []
    for cell in cells:
        ordered_corners, ordered_middles = _order_corners_and_middles(
            node_coordinates[cell[:n_corners]], node_coordinates[cell[n_corners:]]
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
    """Sort the corners of a cell counter-clockwise, and the mid-side nodes accordingly.

    Args:
        corners: Coordinates of the corners, shape (n, 2).
        midside_nodes: Coordinates of the mid-side nodes, shape (n, 2), or (n + 1, 2) with a centre
            node; for cells without them, shape (0, 2).

    Returns:
        Sorted corners (n, 2), and mid-side nodes (n, 2), of which entry i lies between corners i
        and i + 1.
    """
    offsets = corners - corners.mean(axis=0)
    corners = corners[np.argsort(np.arctan2(offsets[:, 1], offsets[:, 0]))]
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    if len(midside_nodes):
        distance = np.linalg.norm(middles[:, None] - midside_nodes, axis=2)
        middles = midside_nodes[distance.argmin(axis=1)]
    return corners, middles
