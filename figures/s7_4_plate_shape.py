"""Body below the rigid plate with its contact forces."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED_NOTE, draw_deformed_mesh, draw_nodal_force_arrows
from figures.style import PAGE_WIDTH
from study.run.store import Results

SECTION = "7.4"
ELEMENTS = ("galerkin-Q8", "pw-Q8")
NEEDS = [f"7.4/{element}" for element in ELEMENTS]
DISPLACEMENT_SCALE = 4e5


def draw(results: Results) -> Figure:
    """Draw the deformed mesh near the plate and the nodal contact forces, for both elements."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.0), sharey=True)
    for ax, element in zip(axes, ELEMENTS, strict=True):
        curves = results.curves(f"7.4/{element}")
        deformed_nodes = draw_deformed_mesh(ax, curves, DISPLACEMENT_SCALE, element)
        draw_nodal_force_arrows(ax, curves, deformed_nodes, 1.0, 1.2, element)
        ax.set(xlabel="$x/b$", xlim=(-2.1, 2.1), ylim=(-2.4, 1.3))
    axes[0].set_ylabel("$y/b$")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        f"The body around the plate, displacements times {DISPLACEMENT_SCALE:g}, and the nodal "
        "forces of the "
        f"plate on it, to one scale. {RECONSTRUCTED_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Two meshes with a flat dent. The arrows on the standard element's alternate between long "
        "and short; those on the condensed pair's rise evenly to the edges."
    )
