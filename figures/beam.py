"""Draw the half beam with supports and load for the figures of section 7.6 (buckling)."""

import numpy as np
from matplotlib.axes import Axes

from figures.style import draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import draw_arrow, draw_roller
from study.run.store import Results

MESH_CASE = "7.6/galerkin-T6-J"
LOAD_COLOUR = "#D55E00"
RECONSTRUCTION_NOTE = "Mesh and supports are reconstructed."


def draw_half_beam(ax: Axes, results: Results) -> tuple[float, float]:
    """Draw the mesh of the half beam, the load P at point A, the end support and dimensions.

    Returns:
        Length and height of the half beam, in units of the height.
    """
    nodes = results.curves(MESH_CASE)["nodes"]
    length, height = np.ptp(nodes, axis=0)
    draw_quadratic_mesh_with_nodes(ax, nodes, results.curves(MESH_CASE)["cells"])
    draw_arrow(ax, (-0.75, 0.0), (-0.06, 0.0), LOAD_COLOUR, 1.6)
    ax.annotate("$P$", (-0.8, 0.0), ha="right", va="center", color=LOAD_COLOUR)
    ax.annotate("$A$", (-0.08, 0.1), ha="right", va="bottom")
    draw_roller(ax, (0.0, 0.0), "down", 0.16)
    for x in (0.0, length):
        ax.plot([x, x], [-0.62 * height, -1.02 * height], color="#333333", linewidth=0.6)
    dimension_line = {
        "arrowstyle": "<|-|>",
        "lw": 0.7,
        "color": "#333333",
        "shrinkA": 0,
        "shrinkB": 0,
    }
    ax.annotate("", (0.0, -0.9 * height), (length, -0.9 * height), arrowprops=dimension_line)
    ax.annotate(f"$L/2 = {length:g}\\,h$", (length / 2, -1.0 * height), ha="center", va="top")
    for y in (-height / 2, height / 2):
        ax.plot([length + 0.4, length + 0.75], [y, y], color="#333333", linewidth=0.6)
    ax.annotate(
        "", (length + 0.6, -height / 2), (length + 0.6, height / 2), arrowprops=dimension_line
    )
    ax.annotate("$h$", (length + 0.68, 0.0), ha="left", va="center")
    ax.set(xlim=(-1.2, length + 1.1), ylim=(-1.35 * height, 0.8 * height))
    ax.set_axis_off()
    return length, height
