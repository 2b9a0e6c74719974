"""Profile and mesh of the elastic body below the rigid plate."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from figures.style import PAGE_WIDTH, draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import LINE_COLOUR, draw_arrow
from study.run.store import Results

SECTION = "7.4"
CASE = "7.4/galerkin-Q8"
NEEDS = [CASE]


def draw(results: Results) -> Figure:
    """Draw the whole body with its supports (left), and the mesh around the plate (right)."""
    curves = results.curves(CASE)
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.3))
    half_width = curves["x"].max()
    for ax, (width, depth) in zip(axes, ((20.0, 10.0), (3.2, 1.9)), strict=True):
        draw_quadratic_mesh_with_nodes(ax, curves["nodes"], curves["cells"], linewidth=0.5)
        for line in ax.lines:
            line.set_markersize(0.8 if width > 10 else 2.6)
        ax.add_patch(
            Rectangle(
                (-half_width, 0),
                2 * half_width,
                0.04 * depth,
                facecolor="#BBBBBB",
                edgecolor=LINE_COLOUR,
            )
        )
        draw_arrow(ax, (0, 0.3 * depth), (0, 0.05 * depth), width=1.4)
        ax.annotate("$P$", (0.02 * width, 0.18 * depth))
        ax.set(xlim=(-width * 1.02, width * 1.02), ylim=(-depth * 1.04, 0.36 * depth))
        ax.grid(visible=False)
        ax.set(xlabel="$x/b$", ylabel="$y/b$")
    for x in (-20, 20):
        axes[0].plot([x, x], [-10, 0], color=LINE_COLOUR, linewidth=2.5)
    axes[0].plot([-20, 20], [-10, -10], color=LINE_COLOUR, linewidth=2.5)
    axes[0].set_title("(a) the body: sides and base held", loc="left")
    axes[1].set_title("(b) around the plate", loc="left")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Profile and mesh of the body: the smallest elements lie exactly under the plate and grow "
        "away from it. Dimensions are reconstructed."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A wide rectangle held on both sides and below with a narrow plate on the middle of its "
        "upper side; beside it, the mesh around the plate with eight elements under it."
    )
