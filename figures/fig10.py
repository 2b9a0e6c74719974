"""Contact of the parabolic punch."""

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

SECTION = "7.3"
ELEMENTS = ("galerkin-Q8", "pw-Q8", "pw-Q9", "pw-T6")
FINE, VARIED, CUT = "7.3/pw-T6-114x24", "7.3/pw-Q9", "7.3/pw-T6"
DRAWN = [f"7.3/{element}" for element in ELEMENTS]
NEEDS = [
    *DRAWN,
    FINE,
    *list_case_family(VARIED, UNPRINTED_DATA)[1:],
    *list_case_family(CUT, OTHER_DIAGONALS)[1:],
]
PANELS = {
    "force_n": "normal nodal force",
    "pressure": "normal pressure",
    "shear": "shear stress, body on punch",
}


def draw(results: Results) -> Figure:
    """Normal nodal forces, and normal and shear stress, over x."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 3.2))
    fine = results.curves(FINE)
    for ax, (quantity, label) in zip(axes, PANELS.items(), strict=True):
        if quantity != "force_n":  # forces of other meshes do not compare
            band(ax, family(results, VARIED, UNPRINTED_DATA), quantity, 1.0, DATA_BAND)
            ax.plot(fine["x"], fine[quantity], color="black", lw=0.9, label="new T6, 114 × 24")
        band(ax, family(results, CUT, OTHER_DIAGONALS), quantity, 1.0, diagonal_band("pw-T6"))
        compare(ax, results, DRAWN, quantity, hollow="pw-T6")
        zone_strip(ax, results.curves("7.3/pw-Q8"))
        ax.set(xlabel="$x$", ylabel=label, xlim=(-2.3, 2.3))
    handles, _ = axes[1].get_legend_handles_labels()
    zones = zone_legend(results.curves("7.3/pw-Q8"))
    fig.legend(handles=[*handles, *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    least, most = (
        bound(
            results.scalar(key, "force_indentation")
            for key in list_case_family(VARIED, UNPRINTED_DATA)
        )
        for bound in (min, max)
    )
    return (
        "Nodal forces and stresses below the punch after the tangential force, in the paper's "
        f"units (E = 1000). Stresses are {OWN_FUNCTION_READING.name} ones: {OWN_FUNCTION_READING.meaning}. Grey band: bodies and "
        f"punches for which the normal force is {least:.0f} to {most:.0f} (printed: about 215), "
        "and the normal force held instead of the depth, new Q9. Blue band: the new T6 with all "
        "diagonals. The curves of Oden and Pires are lost in our copy of the paper. Strips: "
        "contact zones of the new Q8."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Three panels over x. The standard quadrilateral's nodal forces form a sawtooth, the "
        "others' a bell. Pressures of all elements follow the fine mesh's bell; shear is "
        "antisymmetric and zigzags about the fine mesh's with all elements but the new Q9."
    )
