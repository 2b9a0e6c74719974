"""Stress distribution along the contact area of the rigid plate."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED, compare, zone_legend, zone_strip
from figures.style import FULL
from study.core.store import Results

SECTION = "7.4"
ELEMENTS = ("galerkin-Q8", "pw-Q8")
FINE = "7.4/pw-T6-fine"
NEEDS = [*(f"7.4/{element}" for element in ELEMENTS), FINE]


def draw(results: Results) -> Figure:
    """Normal and shear stress over x, with a fine mesh's for comparison."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 2.9))
    fine = results.curves(FINE)
    for ax, quantity in zip(axes, ("pressure", "shear"), strict=True):
        ax.plot(fine["x"], fine[quantity], color="black", lw=0.9, label="new T6, fine")
        compare(ax, results, NEEDS[:-1], quantity)
        zone_strip(ax, results.curves("7.4/pw-Q8"))
        ax.set(xlabel="$x/b$", xlim=(-1.03, 1.03))
    axes[0].set(ylabel="normal pressure / (kN/m²)", ylim=(0, 90))
    axes[1].set(ylabel="shear stress / (kN/m²)", ylim=(-26, 26))
    axes[1].legend(fontsize=7)
    fig.legend(
        handles=zone_legend(results.curves("7.4/pw-Q8")), loc="outside lower center", ncols=3
    )
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    angle = "friction angle 20 degrees, plane stress"
    return (
        f"Stresses below the plate ({angle}): nodal force over tributary length. The singular "
        "values at both edges are cut off; unit length and thickness are taken as 1 m. Strips: "
        f"contact zones of the new Q8. {RECONSTRUCTED}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Pressure rises towards both edges, shear is antisymmetric. The standard element's curves "
        "form a sawtooth, the piecewise-linear element's follow the fine mesh's."
    )
