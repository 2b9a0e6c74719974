"""Stresses along the contact area of the parabolic punch."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED, compare, zone_legend, zone_strip
from figures.style import FULL
from study.core.store import Results

SECTION = "7.3"
ELEMENTS = ("galerkin-Q8", "pw-Q8", "pw-Q9", "pw-T6")
FINE = "7.3/pw-T6-114x24"
NEEDS = [*(f"7.3/{element}" for element in ELEMENTS), FINE]


def draw(results: Results) -> Figure:
    """Normal and shear stress over x, with a fine mesh's for comparison."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 3.0))
    fine = results.curves(FINE)
    for ax, quantity in zip(axes, ("pressure", "shear"), strict=True):
        ax.plot(fine["x"], fine[quantity], color="black", lw=0.9, label="new T6, 114 × 24")
        compare(ax, results, NEEDS[:-1], quantity, hollow="pw-T6")
        zone_strip(ax, results.curves("7.3/pw-Q8"))
        ax.set(xlabel="$x$", xlim=(-2.3, 2.3))
    axes[0].set_ylabel("normal pressure")
    axes[1].set_ylabel("shear stress, body on punch")
    handles = [*axes[0].lines, *zone_legend(results.curves("7.3/pw-Q8"))]
    fig.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Normal and shear stress below the punch after the tangential force (nodal force over "
        "tributary length, in the paper's units: E = 1000). The curves of Oden and Pires are "
        f"lost in our copy of the paper. Strips: contact zones of the new Q8. {RECONSTRUCTED}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Bell-shaped pressure and antisymmetric shear over x. The standard quadrilateral's curves "
        "form a sawtooth around the fine mesh's. The piecewise-linear ones follow it in "
        "pressure; in shear those of triangles and condensed pairs zigzag, too, the new Q9's less."
    )
