"""Stress distribution along the contact area of the rigid plate."""

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

SECTION = "7.4"
ELEMENTS = ("galerkin-Q8", "pw-Q8")
FINE_CASE = "7.4/pw-T6-fine"
VARIED_CASE, DIAGONALS_CASE = "7.4/pw-Q8", "7.4/pw-T6"
DRAWN_CASES = [f"7.4/{element}" for element in ELEMENTS]
NEEDS = [
    *DRAWN_CASES,
    FINE_CASE,
    *list_keys_of_case_and_variants(VARIED_CASE, UNPRINTED_DATA)[1:],
    *list_keys_of_case_and_variants(DIAGONALS_CASE, OTHER_DIAGONALS),
]


STRESS_LABELS = {"pressure": "normal pressure / (kN/m²)", "shear": "shear stress / (kN/m²)"}
STRESS_LIMITS = {"pressure": (0, 60), "shear": (-26, 40)}


def draw(results: Results) -> Figure:
    """Plot pressure and shear along x on a coarse and a fine mesh, each in two definitions.

    For both definitions of the stress, see `figures.contact`.
    """
    fig, axes = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 2.9))
    fine = results.curves(FINE_CASE)
    columns = [(stress, reading) for stress in STRESS_LABELS for reading in READING_NAMES]
    for ax, (stress, reading) in zip(axes, columns, strict=True):
        curve_name = stress + reading
        if not reading:
            shade_bands_of_unprinted_data_and_diagonals(
                ax, results, VARIED_CASE, DIAGONALS_CASE, curve_name
            )
        ax.plot(fine["x"], fine[stress], color="black", lw=0.9, label="new T6, fine")
        plot_quantity_of_each_element(ax, results, DRAWN_CASES, curve_name)
        curves_by_element = {element: results.curves(f"7.4/{element}") for element in ELEMENTS}
        annotate_stress_deviations_of_elements(ax, curves_by_element, fine, stress, reading, 6.5)
        draw_contact_zone_strip(ax, results.curves("7.4/pw-Q8"))
        ax.set(xlabel="$x/b$", xlim=(-1.03, 1.03), ylim=STRESS_LIMITS[stress])
        ax.set_ylabel(STRESS_LABELS[stress] if reading else "", fontsize=8)
        title_panel_with_stress_definition(ax, "Paper Fig. 12", reading)
        ax.tick_params(labelsize=7)
    handles, _ = axes[1].get_legend_handles_labels()
    zones = contact_zone_legend_handles(results.curves("7.4/pw-Q8"))
    fig.legend(handles=[*handles, *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    angle = "friction angle 20 degrees, plane stress"
    return (
        f"Stresses below the plate ({angle}), {TRIBUTARY_READING.name} and "
        f"{OWN_FUNCTION_READING.name}, {OWN_FUNCTION_READING.meaning}. {DEVIATION_NOTE}. "
        "The singular values at both edges are cut off; unit length and thickness are taken as "
        "1 m. Grey band: bodies half and twice as wide and deep, and plane strain, new Q8. Blue "
        "band: the new T6, "
        "which has the new Q8's forces, with all diagonals. Strips: contact zones of the new Q8."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Pressure rises towards both edges, shear is antisymmetric. Tributary stresses of the "
        "standard element alternate about the fine mesh's curve; own-function stresses of both "
        "elements follow it, but for the nodes next to the edges."
    )
