"""The elastic block on a rigid foundation."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from figures.style import PAGE_WIDTH, draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import LINE_COLOUR, draw_arrow, draw_uniform_load_pressing_down
from study.run.store import Results

SECTION = "7.2"
CASE = "7.2/pw-T6"
NEEDS = [CASE]


def draw(results: Results) -> Figure:
    """Draw the mesh of the block, the loads, and the foundation with its frictionless ends."""
    curves = results.curves(CASE)
    length, height = curves["nodes"].max(axis=0)
    smooth_length = curves["x"][curves["friction"] > 0].min()
    fig, ax = plt.subplots(figsize=(0.65 * PAGE_WIDTH, 2.5))
    draw_quadratic_mesh_with_nodes(ax, curves["nodes"], curves["cells"], linewidth=0.4)
    for line in ax.lines:
        line.set_markersize(1.4)
    draw_uniform_load_pressing_down(ax, np.linspace(0, length, 21), height, 0.25)
    ax.annotate("$p$", (length / 2, height + 0.28), ha="center", va="bottom")
    for y in np.linspace(0.06, height - 0.06, 9):
        draw_arrow(ax, (length + 0.05, y), (length + 0.32, y))
    ax.annotate("$t$", (length + 0.38, height / 2), va="center")
    ground = Rectangle((-0.4, -0.14), length + 0.8, 0.14, facecolor="#DDDDDD", edgecolor="none")
    ax.add_patch(ground)
    ax.plot([-0.4, length + 0.4], [0, 0], color=LINE_COLOUR, linewidth=1.2, zorder=0)
    for x in (0.0, length - smooth_length):
        ax.plot(
            [x, x + smooth_length],
            [-0.05, -0.05],
            color="#D55E00",
            linewidth=3,
            solid_capstyle="butt",
        )
    ax.annotate("smooth", (0.0, -0.2), va="top", color="#D55E00", fontsize=8)
    ax.annotate("smooth", (length, -0.2), va="top", ha="right", color="#D55E00", fontsize=8)
    ax.annotate("rigid foundation, Coulomb friction", (length / 2, -0.42), va="top", ha="center")
    ax.set(xlim=(-0.5, length + 0.6), ylim=(-0.7, height + 0.5))
    ax.set_axis_off()
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    cells = len(results.curves(CASE)["cells"])
    return (
        f"The block with its mesh of {cells} triangles, pressed by p and pulled by t; the first "
        "and the last contact element are smooth. Proportions and loads are reconstructed."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A block twice as long as high on a rigid foundation. Arrows press on its upper side and "
        "pull its right side; the two ends of the contact line are marked as smooth."
    )
