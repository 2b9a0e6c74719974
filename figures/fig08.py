"""Stresses along the contact area calculated with 8-node quadrilateral elements."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import compare, zone_legend, zone_strip
from figures.style import FULL
from study import measures
from study.store import Results

SECTION = "7.2"
ELEMENTS = ("galerkin-Q8", "pw-Q8", "pw-Q9")
ZONES_OF = "pw-Q8"
NEEDS = [f"7.2/{element}" for element in ELEMENTS]


def draw(results: Results) -> Figure:
    """Normal and shear stress over x; the strips below are the contact zones."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 3.2))
    for ax, quantity in zip(axes, ("pressure", "shear"), strict=True):
        compare(ax, results, NEEDS, quantity, 1 / measures.BLOCK_PRESSURE)
        zone_strip(ax, results.curves(f"7.2/{ZONES_OF}"), bottom=-0.3)
        ax.set(xlabel="$x$", xlim=(0, 4))
    axes[0].set(ylabel="normal pressure / applied pressure", ylim=(0, None))
    axes[1].set_ylabel("shear stress / applied pressure")
    axes[1].legend(fontsize=7)
    zones = zone_legend(results.curves(f"7.2/{ZONES_OF}"))
    fig.legend(handles=zones, loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    saw = ", ".join(
        f"{element} {results.scalar(f'7.2/{element}', 'sawtooth'):.3f}" for element in ELEMENTS
    )
    return (
        "Stresses along the contact area, 8-node quadrilaterals: nodal force over tributary "
        "length, as a node-to-surface code reports it. Mid-side over corner force of the normal "
        f"forces: {saw}. Strips: zones of {ZONES_OF}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Curves of normal and shear stress over the contact line. Those of the standard "
        "quadrilateral form a sawtooth around the smooth curves of the others; sticking on the "
        "left, slip on the right."
    )
