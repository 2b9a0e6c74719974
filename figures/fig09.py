"""Indentation of an elastic body by a parabolic rigid punch."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import PAGE_WIDTH, draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import LINE_COLOUR, draw_arrow
from study.run.store import Results

SECTION = "7.3"
CASE = "7.3/galerkin-Q8"
NEEDS = [CASE]
RADIUS = 8.0


def draw(results: Results) -> Figure:
    """Draw the mesh of the body with its fixed base, the punch, and the forces on it."""
    curves = results.curves(CASE)
    low, high = curves["nodes"].min(axis=0), curves["nodes"].max(axis=0)
    fig, ax = plt.subplots(figsize=(0.7 * PAGE_WIDTH, 2.75))
    draw_quadratic_mesh_with_nodes(ax, curves["nodes"], curves["cells"], linewidth=0.5)
    for line in ax.lines:
        line.set_markersize(2.0)
    x = np.linspace(-3.2, 3.2, 81)
    y = high[1] + x**2 / (2 * RADIUS)
    top = y.max() + 0.1
    ax.fill(
        np.append(x, [x[-1], x[0]]),
        np.append(y, [top, top]),
        color="#D4D4D4",
        ec=LINE_COLOUR,
        lw=1.0,
    )
    draw_arrow(ax, (0.0, top + 0.7), (0.0, top + 0.05), width=1.4)
    ax.annotate("$d$", (0.12, top + 0.4), va="center")
    draw_arrow(ax, (x[-1] + 0.05, top - 0.15), (x[-1] + 0.8, top - 0.15), width=1.4)
    ax.annotate("tangential force", (x[-1] + 0.9, top - 0.15), va="center", fontsize=8)
    ax.plot([low[0], high[0]], [low[1] - 0.06] * 2, color=LINE_COLOUR, linewidth=3)
    ax.annotate("fixed", (0.0, low[1] - 0.15), va="top", ha="center")
    ax.set(xlim=(low[0] - 0.3, high[0] + 2.2), ylim=(low[1] - 0.6, top + 0.9))
    ax.set_axis_off()
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Body and punch y = x²/16 with the mesh of 76 quadrilaterals, drawn before the indentation "
        "d. Width, height, base, radius and grading are reconstructed so that the printed force "
        "follows, which does not determine them uniquely."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A rectangle of nineteen by four quadrilaterals, finer in its middle, fixed below; a flat "
        "parabola presses on its upper side and is pushed to the right."
    )
