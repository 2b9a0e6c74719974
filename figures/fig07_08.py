"""Contact of the block: 6-node triangles, 8-node quadrilaterals."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.contact import (
    DATA_BAND_LOOK,
    DEVIATION_NOTE,
    READING_NAMES,
    annotate_stress_deviations_of_elements,
    load_curves_of_case_and_variants,
    shade_range_of_curves,
    style_of_band_over_mesh_diagonals,
    title_panel_with_stress_definition,
)
from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.judge.measures.contact import BLOCK_PRESSURE
from study.model.vocabulary import ELEMENTS, OWN_FUNCTION_READING, TRIBUTARY_READING
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA, list_keys_of_case_and_variants
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.store import Results

SECTION = "7.2"
FAMILIES = (("galerkin-T6", "pw-T6", "composite-T6"), ("galerkin-Q8", "pw-Q8", "pw-Q9"))
FINE_CASE = "7.2/pw-T6-80x40"
TRIANGLE_CASES = ("7.2/galerkin-T6", "7.2/pw-T6")
NEEDS = [
    *(f"7.2/{element}" for family in FAMILIES for element in family),
    FINE_CASE,
    *(
        member
        for key in TRIANGLE_CASES
        for member in list_keys_of_case_and_variants(key, OTHER_DIAGONALS)[1:]
    ),
    *list_keys_of_case_and_variants(TRIANGLE_CASES[1], UNPRINTED_DATA)[1:],
]
STRESS_LABELS = {"pressure": "normal pressure / $p$", "shear": "shear stress / $p$"}
STRESS_LIMITS = {"pressure": (0, 2.9), "shear": (-0.5, 1.1)}


def draw(results: Results) -> Figure:
    """Plot pressure and shear along x, for triangles (top) and quadrilaterals (bottom).

    Each stress has two columns: tributary and own-function stresses, see `figures.contact`.
    """
    fig, axes = plt.subplots(2, 4, figsize=(PAGE_WIDTH, 4.9), sharex=True)
    paper_figures = ("Paper Fig. 7", "Paper Fig. 8")
    columns = [(stress, reading) for stress in STRESS_LABELS for reading in READING_NAMES]
    for row, elements, paper_figure in zip(axes, FAMILIES, paper_figures, strict=True):
        for ax, (stress, reading) in zip(row, columns, strict=True):
            _plot_stress_panel(ax, results, elements, stress, reading)
            ax.set(xlim=(-0.05, 4.05), xticks=range(5), ylim=STRESS_LIMITS[stress])
            title_panel_with_stress_definition(ax, paper_figure, reading)
            ax.set_ylabel(STRESS_LABELS[stress] if reading else "", fontsize=8)
            ax.tick_params(labelsize=7)
    for ax in axes[1]:
        ax.set_xlabel("$x$")
    handles = {
        handle.get_label(): handle
        for ax in axes[:, 1]
        for handle in ax.get_legend_handles_labels()[0]
    }
    zones = contact_zone_legend_handles(results.curves("7.2/pw-T6"))
    fig.legend(handles=[*handles.values(), *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def _plot_stress_panel(
    ax: Axes, results: Results, elements: tuple[str, ...], stress_name: str, curve_suffix: str
) -> None:
    scale = 1 / BLOCK_PRESSURE
    curve_name = stress_name + curve_suffix
    if not curve_suffix:
        shade_range_of_curves(
            ax,
            load_curves_of_case_and_variants(results, TRIANGLE_CASES[1], UNPRINTED_DATA),
            curve_name,
            scale,
            DATA_BAND_LOOK,
        )
        for key in TRIANGLE_CASES if elements is FAMILIES[0] else ():
            look = style_of_band_over_mesh_diagonals(key.partition("/")[2])
            shade_range_of_curves(
                ax,
                load_curves_of_case_and_variants(results, key, OTHER_DIAGONALS),
                curve_name,
                scale,
                look,
            )
    fine = results.curves(FINE_CASE)
    ax.plot(fine["x"], scale * fine[stress_name], color="black", lw=0.9, label="new T6, 80 × 40")
    curves_by_element = {element: results.curves(f"7.2/{element}") for element in elements}
    for element, curves in curves_by_element.items():
        look = {**ELEMENT_LOOK[element], "linewidth": 0.8, "markersize": 2}
        if "composite" in element:  # coincides with the new element
            look |= {"markerfacecolor": "none", "markersize": 4.5, "markeredgewidth": 0.6}
        ax.plot(curves["x"], scale * curves[curve_name], **look)
    annotate_stress_deviations_of_elements(
        ax, curves_by_element, fine, stress_name, curve_suffix, 6.0
    )
    draw_contact_zone_strip(ax, results.curves(f"7.2/{elements[1]}"))


def caption(results: Results) -> str:
    """Return the caption."""
    sawtooth_ratios = "; ".join(
        f"{ELEMENTS[element].name} {results.scalar(f'7.2/{element}', 'sawtooth'):.3f}"
        for family in FAMILIES
        for element in family
    )
    return (
        "Stresses along the contact area: triangles (the paper's Fig. 7) and quadrilaterals "
        f"(Fig. 8), {TRIBUTARY_READING.name} and {OWN_FUNCTION_READING.name}, "
        f"{OWN_FUNCTION_READING.meaning}. {DEVIATION_NOTE}. Ratio "
        f"of the normal force of a mid-side node to that of its corners: {sawtooth_ratios}. "
        "Grey band: data "
        "that are not printed, new T6. Coloured bands: all diagonals. Strips: contact zones of the "
        "new elements."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    stick = results.scalar("7.2/pw-T6", "stick_to")
    return (
        "Eight panels over the contact line. The standard elements' tributary stresses form a "
        "sawtooth, the others' do not; own-function stresses of all elements lie on the fine "
        f"mesh's curve; sticking up to x = {stick:.3f}, slip on the right."
    )
