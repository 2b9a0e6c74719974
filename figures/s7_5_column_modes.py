"""Mode shapes of the stepped column."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from figures import contact
from figures.column import MM_PER_M, SYNTHETIC_NOTE, corners_of_column_section
from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.store import Results

SECTION = "7.5"
ELEMENT = "pw-T6"
CASE = f"7.5/{ELEMENT}"
NEEDS = [CASE]
LARGEST_DISPLACEMENT = 40.0  # largest displacement in the drawing, in mm


def draw(results: Results) -> Figure:
    """Draw six vibration modes of the column as deformed sections with their mirror images."""
    curves = results.curves(CASE)
    nodes, cells = (
        MM_PER_M * curves["nodes"],
        contact.order_cell_nodes_along_outline(curves["cells"]),
    )
    corners = MM_PER_M * corners_of_column_section(curves)
    boundary_nodes = _find_nodes_on_boundary(curves["cells"])
    fig, axes = plt.subplots(1, 6, figsize=(PAGE_WIDTH, 2.45), sharey=True)
    for mode, ax in enumerate(axes, start=1):
        shape = curves[f"shape_{mode}"]
        deformed_nodes = nodes + LARGEST_DISPLACEMENT * shape / np.linalg.norm(shape, axis=1).max()
        for side in (1, -1):
            mirror = np.array([side, 1])
            ax.add_collection(
                PolyCollection(
                    (deformed_nodes * mirror)[cells],
                    facecolor="#D8E8F4",
                    edgecolor="#D8E8F4",
                    lw=0.3,
                    rasterized=True,  # thousands of cells
                )
            )
            ax.plot(
                *(deformed_nodes[boundary_nodes] * mirror).T,
                ".",
                ms=0.7,
                color=ELEMENT_LOOK[ELEMENT]["color"],
            )
            ax.plot(*(corners * mirror).T, color="#777777", lw=0.6)
        eigenvalue = results.scalar(CASE, f"omega2_{mode}")
        ax.set_title(rf"$\lambda_{mode} = {eigenvalue / 1e6:.4f}$", fontsize=8)
        ax.set(aspect="equal", xlim=(-192, 192), ylim=(-15, 645), xticks=(-100, 0, 100))
        ax.set_xlabel("$r$ / mm", fontsize=8)
        ax.tick_params(labelsize=7)
        ax.grid(visible=False)
    axes[0].set_ylabel("$z$ / mm")
    return fig


def _find_nodes_on_boundary(cells: np.ndarray) -> np.ndarray:
    """Return the sorted nodes on sides that belong to one cell only.

    Args:
        cells: Node indices of quadratic cells, shape (m, 6, 8 or 9).
    """
    outlines = contact.order_cell_nodes_along_outline(cells)
    sides = np.stack([outlines[:, 0::2], outlines[:, 1::2], np.roll(outlines[:, 0::2], -1, 1)], -1)
    sides = sides.reshape(-1, 3)
    _, first_index, count = np.unique(sides[:, 1], return_index=True, return_counts=True)
    return np.unique(sides[first_index[count == 1]])


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Mode shapes 1 to 6 computed with the new triangle, and their eigenvalues λ = ω² in "
        "millions of the paper's unit (1000/s² if E and ρ are taken as printed); outlines at rest "
        f"in grey, largest displacement drawn as {LARGEST_DISPLACEMENT:g} mm. {SYNTHETIC_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Six sections of the column: in mode 1 the heavy part moves up and down on the slender "
        "foot, in the higher modes the cylinders stretch against each other and bulge."
    )
