"""Body below the parabolic punch with its contact forces."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED_NOTE, draw_deformed_mesh, draw_nodal_force_arrows
from figures.style import PAGE_WIDTH
from study.run.store import Results

SECTION = "7.3"
ELEMENTS = ("galerkin-Q8", "pw-Q8")
NEEDS = [f"7.3/{element}" for element in ELEMENTS]


def draw(results: Results) -> Figure:
    """Draw the deformed mesh to scale and the nodal forces of the punch, for both elements."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.3), sharey=True)
    for ax, element in zip(axes, ELEMENTS, strict=True):
        curves = results.curves(f"7.3/{element}")
        deformed_nodes = draw_deformed_mesh(ax, curves, 1.0, element)
        draw_nodal_force_arrows(ax, curves, deformed_nodes, 1.0, 1.3, element)
        ax.set(xlabel="$x$", xlim=(-4.2, 4.2), ylim=(-0.2, 5.4))
    axes[0].set_ylabel("$y$")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "The deformed body, true to scale, and the nodal forces of the punch on it, to one scale. "
        f"{RECONSTRUCTED_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Two deformed bodies with a dent. The arrows on the standard element's alternate between "
        "long and short; those on the new element's form an even bell."
    )
