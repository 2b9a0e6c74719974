"""Contact of the parabolic punch."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import (
    DEVIATION_NOTE,
    READING_NAMES,
    annotate_stress_deviations_of_elements,
    plot_quantity_of_each_element,
    shade_bands_of_unprinted_data_and_diagonals,
    title_panel_with_stress_definition,
)
from figures.style import PAGE_WIDTH
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA, list_keys_of_case_and_variants
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.store import Results

SECTION = "7.3"
ELEMENTS = ("galerkin-Q8", "pw-Q8", "pw-Q9", "pw-T6")
FINE_CASE, VARIED_CASE, DIAGONALS_CASE = "7.3/pw-T6-114x24", "7.3/pw-Q9", "7.3/pw-T6"
DRAWN_CASES = [f"7.3/{element}" for element in ELEMENTS]
NEEDS = [
    *DRAWN_CASES,
    FINE_CASE,
    *list_keys_of_case_and_variants(VARIED_CASE, UNPRINTED_DATA)[1:],
    *list_keys_of_case_and_variants(DIAGONALS_CASE, OTHER_DIAGONALS)[1:],
]
STRESS_LABELS = {"pressure": "normal pressure", "shear": "shear stress, body on punch"}


def draw(results: Results) -> Figure:
    """Plot pressure and shear along x, each as tributary and as own-function stress.

    For both definitions of the stress, see `figures.contact`.
    """
    fig, axes = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 3.2))
    fine = results.curves(FINE_CASE)
    columns = [(stress, reading) for stress in STRESS_LABELS for reading in READING_NAMES]
    for ax, (stress, reading) in zip(axes, columns, strict=True):
        curve_name = stress + reading
        if not reading:
            shade_bands_of_unprinted_data_and_diagonals(
                ax, results, VARIED_CASE, DIAGONALS_CASE, curve_name
            )
        ax.plot(fine["x"], fine[stress], color="black", lw=0.9, label="new T6, 114 × 24")
        plot_quantity_of_each_element(
            ax, results, DRAWN_CASES, curve_name, hollow_marker_elements="pw-T6"
        )
        curves_by_element = {element: results.curves(f"7.3/{element}") for element in ELEMENTS}
        low, high = ax.get_ylim()
        ax.set_ylim(0 if stress == "pressure" else low, high + 0.45 * (high - low))
        annotate_stress_deviations_of_elements(ax, curves_by_element, fine, stress, reading, 6.0)
        draw_contact_zone_strip(ax, results.curves("7.3/pw-Q8"))
        ax.set(xlabel="$x$", xlim=(-2.3, 2.3))
        ax.set_ylabel(STRESS_LABELS[stress] if reading else "", fontsize=8)
        title_panel_with_stress_definition(ax, "Paper Fig. 10", reading)
        ax.tick_params(labelsize=7)
    handles, _ = axes[1].get_legend_handles_labels()
    zones = contact_zone_legend_handles(results.curves("7.3/pw-Q8"))
    fig.legend(handles=[*handles, *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    least_force, largest_force = (
        extreme(
            results.scalar(key, "force_indentation")
            for key in list_keys_of_case_and_variants(VARIED_CASE, UNPRINTED_DATA)
        )
        for extreme in (min, max)
    )
    return (
        "Stresses below the punch after the tangential force, in the paper's units (E = 1000). "
        f"They are {TRIBUTARY_READING.name} and {OWN_FUNCTION_READING.name}, "
        f"{OWN_FUNCTION_READING.meaning}. {DEVIATION_NOTE}. Grey band: bodies and punches "
        f"for which the normal force is {least_force:.0f} to {largest_force:.0f} (printed: "
        "about 215), and the "
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
