"""Deformed block with its contact forces."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED_NOTE, draw_deformed_mesh, draw_nodal_force_arrows
from figures.style import PAGE_WIDTH
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.store import Results

SECTION = "7.2"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"7.2/{element}" for element in ELEMENTS]
DISPLACEMENT_SCALE = 0.5


def draw(results: Results) -> Figure:
    """Draw deformed mesh, nodal contact forces and contact zones of both elements."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.8), sharey=True)
    for ax, element in zip(axes, ELEMENTS, strict=True):
        curves = results.curves(f"7.2/{element}")
        deformed_nodes = draw_deformed_mesh(ax, curves, DISPLACEMENT_SCALE, element)
        draw_nodal_force_arrows(ax, curves, deformed_nodes, -1.0, 0.7, element)
        draw_contact_zone_strip(ax, curves)
        ax.set(xlabel="$x$", ylim=(-0.95, 2.15), xlim=(-0.25, 4.6))
    axes[0].set_ylabel("$y$")
    fig.legend(handles=contact_zone_legend_handles(curves), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        f"The deformed block (displacements times {DISPLACEMENT_SCALE:g}) and the nodal forces "
        "that the "
        f"foundation exerts on it, at the same scale for both elements. {RECONSTRUCTED_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Two deformed meshes leaning to the right. Arrows below the standard element's alternate "
        "between long and short; those below the new element's are even."
    )
