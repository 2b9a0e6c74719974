"""Contact of the parabolic punch."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import (
    DEVIATION,
    READINGS,
    plot_elements,
    print_deviations,
    shade_families,
    title_panel,
)
from figures.style import FULL
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
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
STRESSES = {"pressure": "normal pressure", "shear": "shear stress, body on punch"}


def draw(results: Results) -> Figure:
    """Both readings of normal and shear stress over x."""
    fig, axes = plt.subplots(1, 4, figsize=(FULL, 3.2))
    fine = results.curves(FINE)
    columns = [(stress, reading) for stress in STRESSES for reading in READINGS]
    for ax, (stress, reading) in zip(axes, columns, strict=True):
        curve = stress + reading
        if not reading:
            shade_families(ax, results, VARIED, CUT, curve)
        ax.plot(fine["x"], fine[stress], color="black", lw=0.9, label="new T6, 114 × 24")
        plot_elements(ax, results, DRAWN, curve, hollow="pw-T6")
        curves_by_element = {element: results.curves(f"7.3/{element}") for element in ELEMENTS}
        low, high = ax.get_ylim()
        ax.set_ylim(0 if stress == "pressure" else low, high + 0.45 * (high - low))
        print_deviations(ax, curves_by_element, fine, stress, reading, 6.0)
        zone_strip(ax, results.curves("7.3/pw-Q8"))
        ax.set(xlabel="$x$", xlim=(-2.3, 2.3))
        ax.set_ylabel(STRESSES[stress] if reading else "", fontsize=8)
        title_panel(ax, "Paper Fig. 10", reading)
        ax.tick_params(labelsize=7)
    handles, _ = axes[1].get_legend_handles_labels()
    zones = zone_legend(results.curves("7.3/pw-Q8"))
    fig.legend(handles=[*handles, *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    least, most = (
        bound(
            results.scalar(key, "force_indentation")
            for key in list_case_family(VARIED, UNPRINTED_DATA)
        )
        for bound in (min, max)
    )
    return (
        "Stresses below the punch after the tangential force, in the paper's units (E = 1000). "
        f"They are {TRIBUTARY_READING.name} and {OWN_FUNCTION_READING.name}, "
        f"{OWN_FUNCTION_READING.meaning}. {DEVIATION}. Grey band: bodies and punches "
        f"for which the normal force is {least:.0f} to {most:.0f} (printed: about 215), and the "
        "normal force held instead of the depth, new Q9. Blue "
        "band: the new T6 with all diagonals. The curves of Oden and Pires are lost in our copy "
        "of the paper. Strips: contact zones of the new Q8."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Four panels over x. The standard quadrilateral's tributary pressures form a sawtooth, the "
        "others' a bell. Own-function pressures of all elements follow the fine mesh's bell; shear "
        "is antisymmetric and zigzags about the fine mesh's with all elements but the new Q9."
    )
