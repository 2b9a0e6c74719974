"""Creation of the 8-node quadrilateral from two 6-node triangles."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, PAIR_WIDE_WIDTH
from study.run.store import Results

SECTION = "5"
NEEDS = ["5/element-pw-Q8"]
CELL_COLOURS = ("#DCE9F5", "#E8F3E1")


def draw(results: Results) -> Figure:
    """Draw two triangles with nine nodes, and the eight-node quadrilateral that they form."""
    curves = results.curves("5/element-pw-Q8")
    nodes, cells, inner_node = curves["nodes"], curves["cells"], int(curves["inner"])
    order = _order_quadrilateral_nodes(nodes, cells, inner_node)
    outline = nodes[order[:4]]
    fig, axes = plt.subplots(1, 2, figsize=(PAIR_WIDE_WIDTH, 2.3), sharex=True, sharey=True)
    for cell, colour in zip(cells, CELL_COLOURS, strict=True):
        axes[0].fill(*nodes[cell[:3]].T, facecolor=colour, edgecolor="#777777", linewidth=0.8)
    axes[1].fill(*outline.T, facecolor=CELL_COLOURS[0])
    titles = ("two 6-node triangles, 9 nodes", "8-node quadrilateral")
    for ax, title, count in zip(axes, titles, (9, 8), strict=True):
        ax.fill(*outline.T, facecolor="none", edgecolor="black", linewidth=1.4)
        ax.plot(*nodes[order[:8]].T, "o", color="black", clip_on=False)
        _label_nodes(ax, nodes[order[:count]], outline.mean(axis=0))
        ax.set(title=title, aspect="equal")
        ax.margins(0.1)
        ax.set_axis_off()
    look = ELEMENT_LOOK["galerkin-T6"]
    axes[0].plot(*nodes[inner_node], "o", color=look["color"], markersize=6)
    axes[0].annotate(
        "inner node,\nto be condensed",
        nodes[inner_node],
        (26, -30),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=7.5,
        color=look["color"],
        arrowprops={"arrowstyle": "-", "color": look["color"], "lw": 0.7, "shrinkB": 4},
    )
    arrow_style = {"arrowstyle": "-|>", "color": "black", "lw": 1.2}
    axes[1].annotate("", (-0.02, 0.5), (-0.12, 0.5), "axes fraction", arrowprops=arrow_style)
    return fig


def _order_quadrilateral_nodes(nodes: np.ndarray, cells: np.ndarray, inner_node: int) -> np.ndarray:
    """Return the nodes in the usual order: corners counter-clockwise, mid-side nodes, inner node.

    Args:
        nodes: Coordinates, shape (9, 2).
        cells: Node indices of both triangles, shape (2, 6), with the corners first.
        inner_node: Index of the node in the middle of the diagonal.

    Returns:
        Indices of the nodes, shape (9,).
    """
    corners = np.unique(cells[:, :3])
    middles = np.setdiff1d(np.unique(cells), [*corners, inner_node])
    centre = nodes[corners].mean(axis=0)

    def sort_counterclockwise(nodes_on_circle: np.ndarray) -> np.ndarray:
        x, y = (nodes[nodes_on_circle] - centre).T
        # begin slightly below the middle of the left side, such that this node comes last
        return nodes_on_circle[np.argsort((np.arctan2(y, x) + 0.95 * np.pi) % (2 * np.pi))]

    return np.array([*sort_counterclockwise(corners), *sort_counterclockwise(middles), inner_node])


def _label_nodes(ax: Axes, points: np.ndarray, centre: np.ndarray) -> None:
    for number, point in enumerate(points, start=1):
        direction = point - centre
        length = np.linalg.norm(direction)
        # the number of the inner node is placed beside the diagonal
        x, y = 11 * direction / length if number <= 8 else (-4.0, 11.0)
        ax.annotate(
            str(number), point, (x, y), textcoords="offset points", ha="center", va="center"
        )


def caption(results: Results) -> str:
    """Return the caption."""
    unknowns = int(results.scalar("5/element-pw-Q8", "unknowns"))
    return (
        "Two 6-node triangles make a structure of nine nodes; static condensation eliminates the "
        f"inner node, and an 8-node quadrilateral with {unknowns} unknowns remains. Its shape and "
        "the node numbers are this study's."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A quadrilateral cut along a diagonal into two triangles, with nodes 1 to 4 at its "
        "corners, 5 to 8 at the middles of its sides and 9 in the middle of the diagonal. An arrow "
        "leads to the same quadrilateral without diagonal and node 9."
    )
