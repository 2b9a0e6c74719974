"""The simple structure with two triangular elements."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import PAIR_NARROW_WIDTH, draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import draw_roller, draw_uniform_load_pressing_down
from study.run.store import Results

SECTION = "7.1"
NEEDS = ["7.1/pw-T6"]


def draw(results: Results) -> Figure:
    """Draw the mesh of two triangles with its uniform load and supports."""
    curves = results.curves("7.1/pw-T6")
    fig, ax = plt.subplots(figsize=(PAIR_NARROW_WIDTH, 2.3))
    draw_quadratic_mesh_with_nodes(ax, curves["nodes"], curves["cells"])
    draw_uniform_load_pressing_down(ax, np.linspace(0, 1, 9), 1.0, 0.16)
    ax.annotate("$q = 1$", (0.5, 1.19), ha="center", va="bottom")
    for x in curves["x"]:
        draw_roller(ax, (x, 0.0), "down")
    draw_roller(ax, (0.0, 0.0), "left")
    ax.set(xlim=(-0.2, 1.12), ylim=(-0.2, 1.32))
    ax.set_axis_off()
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Unit square of unit thickness, two 6-node triangles, unit load on the upper side; the "
        "three lower nodes are held vertically, one of them horizontally too."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A square cut along its diagonal into two triangles with nine nodes. Arrows press on its "
        "upper side; rollers carry the three nodes of its lower side."
    )
