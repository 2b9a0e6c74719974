"""Normal pressures and shear stresses along the four contact surfaces of the column."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.column import MM_PER_M, SURFACE_NAMES, SURFACES, SYNTHETIC_NOTE, select_surface_curves
from figures.contact import (
    DATA_BAND_LOOK,
    DEVIATION_NOTE,
    READING_NAMES,
    Curves,
    annotate_stress_deviations_of_elements,
    load_curves_of_case_and_variants,
    shade_range_of_curves,
    style_of_band_over_mesh_diagonals,
)
from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
from study.paper.bands import (
    OTHER_DIAGONALS,
    UNPRINTED_DATA,
    Variants,
    list_keys_of_case_and_variants,
)
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.store import Results

SECTION = "7.5"
ELEMENTS = ("galerkin-T6", "galerkin-Q8", "pw-T6", "pw-Q8")
FINE_CASE, VARIED_CASE = "7.5/pw-T6-fine", "7.5/pw-T6"
DIAGONALS_CASES = ("7.5/galerkin-T6", "7.5/pw-T6")
NEEDS = [
    *(f"7.5/{element}" for element in ELEMENTS),
    FINE_CASE,
    *list_keys_of_case_and_variants(VARIED_CASE, UNPRINTED_DATA)[1:],
    *(
        member
        for key in DIAGONALS_CASES
        for member in list_keys_of_case_and_variants(key, OTHER_DIAGONALS)[1:]
    ),
]
STRESS_LABELS = {"pressure": "normal pressure", "shear": "shear stress"}
HOLLOW_MARKERS = {"markerfacecolor": "none", "markersize": 4.5, "linewidth": 0.5}
SURFACES_WITHOUT_BAND = {2, 3}
"""Surfaces for which the band of unstated data is not drawn.

It would extend from zero (gaps of 0.2 mm) to beyond the panel (no gaps).
"""
MAX_AXIS_OVER_LARGEST = 2.4  # axis limit over largest stress of the new element, without edges


def draw(results: Results) -> Figure:
    """Plot pressure and shear over the radius, with one row per contact surface, from the base up.

    Each stress has two columns: tributary and own-function stresses, see `figures.contact`.
    """
    fig, axes = plt.subplots(4, 4, figsize=(PAGE_WIDTH, 7.9))
    columns = [(stress, reading) for stress in STRESS_LABELS for reading in READING_NAMES]
    for row, number in zip(axes, SURFACES, strict=True):
        zones = select_surface_curves(results.curves(VARIED_CASE), number)
        for ax, (stress, reading) in zip(row, columns, strict=True):
            _plot_stress_panel_of_surface(ax, results, number, stress, reading)
            draw_contact_zone_strip(ax, {**zones, "x": MM_PER_M * zones["x"]})
            paper_figure = 14 + 2 * number + (stress == "shear")
            title = (
                f"Paper Fig. {paper_figure}: surface {number}"
                if reading
                else READING_NAMES[reading]
            )
            ax.set_title(title, loc="left", fontsize=7)
            ax.set_ylabel(f"{STRESS_LABELS[stress]} / MPa" if reading else "", fontsize=7.5)
            ax.tick_params(labelsize=6.5)
    for ax in axes[-1]:
        ax.set_xlabel("$r$ / mm", fontsize=8)
    handles, _ = axes[0, 1].get_legend_handles_labels()
    handles += contact_zone_legend_handles(select_surface_curves(results.curves(VARIED_CASE), 1))
    fig.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=7.5)
    return fig


def _plot_stress_panel_of_surface(
    ax: Axes, results: Results, surface_number: int, stress_name: str, curve_suffix: str
) -> None:
    def load_curves_over_first_column_radii(
        key: str, variants_by_section: Mapping[str, Variants]
    ) -> list[Curves]:
        """Return the curves of a case and its variants, with radii in mm.

        The radii of other columns are mapped linearly to those of the first column.
        """
        base, *other_columns = (
            select_surface_curves(curves, surface_number)
            for curves in load_curves_of_case_and_variants(results, key, variants_by_section)
        )
        end_radii = base["x"][[0, -1]]
        mapped_columns = [
            {
                **curves_of_case,
                "x": np.interp(curves_of_case["x"], curves_of_case["x"][[0, -1]], end_radii),
            }
            for curves_of_case in other_columns
        ]
        return [{**c, "x": MM_PER_M * c["x"]} for c in (base, *mapped_columns)]

    curve_name = stress_name + curve_suffix
    if not curve_suffix:
        if surface_number not in SURFACES_WITHOUT_BAND:
            shade_range_of_curves(
                ax,
                load_curves_over_first_column_radii(VARIED_CASE, UNPRINTED_DATA),
                curve_name,
                1e-3,
                DATA_BAND_LOOK,
            )
        for key, element in zip(DIAGONALS_CASES, ("galerkin-T6", "pw-T6"), strict=True):
            look = style_of_band_over_mesh_diagonals(element)
            shade_range_of_curves(
                ax,
                load_curves_over_first_column_radii(key, OTHER_DIAGONALS),
                curve_name,
                1e-3,
                look,
            )
    fine = select_surface_curves(results.curves(FINE_CASE), surface_number)
    label = "new T6, mesh halved"
    ax.plot(MM_PER_M * fine["x"], fine[stress_name] / 1e3, color="black", lw=0.9, label=label)
    curves_by_element = {
        element: select_surface_curves(results.curves(f"7.5/{element}"), surface_number)
        for element in ELEMENTS
    }
    for element, curves in curves_by_element.items():
        look = {**ELEMENT_LOOK[element], "markersize": 2.5, "linewidth": 0.8}
        look |= HOLLOW_MARKERS if element == "pw-Q8" else {}  # coincides with the new T6
        ax.plot(MM_PER_M * curves["x"], curves[curve_name] / 1e3, **look)
    inner_stress = (
        select_surface_curves(results.curves(VARIED_CASE), surface_number)[stress_name][:-1] / 1e3
    )
    low, high = ax.get_ylim()
    high = min(high, MAX_AXIS_OVER_LARGEST * float(inner_stress.max()))
    ax.set_ylim(min(low, 0) if stress_name == "shear" else 0, 1.5 * high)
    annotate_stress_deviations_of_elements(
        ax, curves_by_element, fine, stress_name, curve_suffix, 5.5
    )


def caption(results: Results) -> str:
    """Return the caption."""
    ratios_by_element = {
        element: [results.scalar(f"7.5/{element}", f"sawtooth_{surface}") for surface in SURFACES]
        for element in ELEMENTS
    }
    surface_list = ", ".join(f"{number} {name}" for number, name in SURFACE_NAMES.items())
    standard_ratios, new_ratios = (
        [
            ratio
            for element, ratios in ratios_by_element.items()
            if element.startswith(prefix)
            for ratio in ratios
        ]
        for prefix in ("galerkin", "pw")
    )
    return (
        f"Stresses along the contact surfaces ({surface_list}), {TRIBUTARY_READING.name} and "
        f"{OWN_FUNCTION_READING.name}, {OWN_FUNCTION_READING.meaning}, of which standard "
        f"elements have none on the axis. {DEVIATION_NOTE}. Ratio of the normal force of a "
        "mid-side "
        "node to that of its corners, over "
        f"all surfaces: standard elements {min(standard_ratios):.3f} to "
        f"{max(standard_ratios):.3f}, new elements "
        f"{min(new_ratios):.3f} to {max(new_ratios):.3f}. Grey band on surfaces 1 and 4: gaps "
        "of 0 and 0.2 mm "
        "and the second column, drawn over the radii of the first, new T6. Coloured "
        f"bands: all diagonals. Strips: contact zones of the new T6. {SYNTHETIC_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    forces = ", ".join(
        f"{results.scalar('7.5/pw-T6', f'force_normal_{surface}'):.0f}" for surface in SURFACES
    )
    return (
        "Sixteen panels of stress over the radius. Tributary stresses of the standard elements "
        "zigzag, own-function stresses of all elements follow the finer mesh's and rise to the "
        "edge; the grey band of gaps and columns is far wider than their "
        f"differences. Normal forces on the four surfaces: {forces} kN."
    )
