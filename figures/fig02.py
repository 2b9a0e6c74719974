"""Weight functions of nodes 1 and 4, over the shape functions they replace."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.store import Results

SECTION = "3"
NEEDS = ["3/weights"]


def draw(results: Results) -> Figure:
    """Draw the weight functions w1 and w4, and the shape functions N1 and N4, as surfaces."""
    curves = results.curves("3/weights")
    (x, y), cells = curves["grid"].T, curves["grid_cells"]
    fig = plt.figure(figsize=(PAGE_WIDTH, 2.1))
    rows = (("weights", "w", ELEMENT_LOOK["pw-T6"]), ("shapes", "N", ELEMENT_LOOK["galerkin-T6"]))
    for row, (name, letter, element_look) in enumerate(rows):
        for column, node in enumerate((1, 4)):
            ax: Axes3D = fig.add_subplot(1, 4, 2 * row + column + 1, projection="3d")
            z = curves[name][:, node - 1]
            surface = {
                "color": element_look["color"],
                "edgecolor": "white",
                "linewidth": 0.3,
                "rasterized": True,
            }
            ax.plot_trisurf(x, y, z, triangles=cells, shade=False, alpha=0.85, **surface)
            ax.plot([0, 1, 0, 0], [0, 0, 1, 0], 0, color="black", linewidth=0.9)
            ax.set(xlabel="$x$", ylabel="$y$", zlim=(-0.13, 1.05), xticks=(0, 0.5, 1))
            ax.set(yticks=(0, 0.5, 1), zticks=(0, 0.5, 1))
            ax.set_title(f"${letter}_{node}$", y=0.9)
            ax.view_init(elev=24, azim=-118)
            ax.set_box_aspect((1, 1, 0.75), zoom=0.95)
            ax.tick_params(labelsize=6, pad=-3)
            ax.xaxis.labelpad = ax.yaxis.labelpad = -8
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Weight functions w of a corner and a mid-side node (nodes 1 and 4), drawn from the Basix "
        "element, and the quadratic shape functions N of the same nodes, which the standard "
        "element also uses as weights."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    low = results.curves("3/weights")["shapes"][:, 0].min()
    return (
        "Four surfaces over the unit triangle. w1 is a pyramid over the sub-element at node 1, "
        "w4 a pyramid over the three sub-elements that meet at node 4. N1 and N4 are smooth; N1 "
        f"falls to {low:.3f} between the nodes."
    )
