"""Stress distribution along the contact area of the rigid plate."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import (
    DATA_BAND,
    band,
    compare,
    diagonal_band,
    family,
)
from figures.style import FULL
from study.model.vocabulary import OWN_FUNCTION_READING
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA, list_case_family
from study.publish.plots.zones import zone_legend, zone_strip
from study.run.store import Results

SECTION = "7.4"
ELEMENTS = ("galerkin-Q8", "pw-Q8")
FINE = "7.4/pw-T6-fine"
VARIED, CUT = "7.4/pw-Q8", "7.4/pw-T6"
DRAWN = [f"7.4/{element}" for element in ELEMENTS]
NEEDS = [
    *DRAWN,
    FINE,
    *list_case_family(VARIED, UNPRINTED_DATA)[1:],
    *list_case_family(CUT, OTHER_DIAGONALS),
]


def draw(results: Results) -> Figure:
    """Normal and shear stress over x, with a fine mesh's for comparison."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 2.9))
    fine = results.curves(FINE)
    for ax, quantity in zip(axes, ("pressure", "shear"), strict=True):
        band(ax, family(results, VARIED, UNPRINTED_DATA), quantity, 1.0, DATA_BAND)
        band(ax, family(results, CUT, OTHER_DIAGONALS), quantity, 1.0, diagonal_band("pw-T6"))
        ax.plot(fine["x"], fine[quantity], color="black", lw=0.9, label="new T6, fine")
        compare(ax, results, DRAWN, quantity)
        zone_strip(ax, results.curves("7.4/pw-Q8"))
        ax.set(xlabel="$x/b$", xlim=(-1.03, 1.03))
    axes[0].set(ylabel="normal pressure / (kN/m²)", ylim=(0, 50))
    axes[1].set(ylabel="shear stress / (kN/m²)", ylim=(-26, 26))
    handles, _ = axes[1].get_legend_handles_labels()
    zones = zone_legend(results.curves("7.4/pw-Q8"))
    fig.legend(handles=[*handles, *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    angle = "friction angle 20 degrees, plane stress"
    return (
        f"{OWN_FUNCTION_READING.name.capitalize()} stresses below the plate ({angle}): {OWN_FUNCTION_READING.meaning}. The singular "
        "values at both edges are cut off; unit length and thickness are taken as 1 m. Grey band: "
        "bodies half and twice as wide and deep, and plane strain, new Q8. Blue band: the new T6, "
        "which has the new Q8's forces, with all diagonals. Strips: contact zones of the new Q8."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Pressure rises towards both edges, shear is antisymmetric. The curves of both elements "
        "follow the fine mesh's, but for the nodes next to the edges."
    )
