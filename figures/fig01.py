"""6-node isoparametric triangular element in the parent domain."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import PAIR_NARROW_WIDTH
from study.run.store import Results

SECTION = "3"
NEEDS = ["3/weights"]
CELL_COLOURS = ("#DCE9F5", "#E8F3E1", "#FBE9D9", "#F2F2F2")


def draw(results: Results) -> Figure:
    """Draw the nodes with the paper's numbers, and the four sub-elements."""
    curves = results.curves("3/weights")
    nodes, subelements = curves["nodes"], curves["subelements"]
    fig, ax = plt.subplots(figsize=(PAIR_NARROW_WIDTH, 2.3))
    for number, (cell, colour) in enumerate(zip(subelements, CELL_COLOURS, strict=True), start=1):
        ax.fill(*nodes[cell].T, facecolor=colour, edgecolor="#777777", linewidth=0.8)
        ax.annotate(f"$A_{number}$", nodes[cell].mean(axis=0), ha="center", va="center")
    ax.fill(*nodes[:3].T, facecolor="none", edgecolor="black", linewidth=1.4)
    ax.plot(*nodes.T, "o", color="black", clip_on=False)
    centre = nodes.mean(axis=0)
    for number, node in enumerate(nodes, start=1):
        outward = (node - centre) / np.linalg.norm(node - centre)
        ax.annotate(
            str(number), node, outward * 11, textcoords="offset points", ha="center", va="center"
        )
    ax.set(xlabel="$x$", ylabel="$y$", aspect="equal", xticks=(0, 0.5, 1), yticks=(0, 0.5, 1))
    ax.margins(0.12)
    ax.grid(visible=False)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "The triangle in the parent domain: nodes in the paper's numbering and the four "
        "sub-elements, drawn from the points of the Basix element."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Right-angled unit triangle with nodes 1 to 3 at its corners and 4 to 6 at the middles of "
        "its sides, cut by the lines between the mid-side nodes into four triangles A1 to A4."
    )
