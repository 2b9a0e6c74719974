"""Reaction forces along the contact area of the rigid plate: standard and new element."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.contact import (
    DATA_BAND_LOOK,
    load_curves_of_case_and_variants,
    style_of_band_over_mesh_diagonals,
)
from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.model.vocabulary import ELEMENTS
from study.paper.bands import (
    OTHER_DIAGONALS,
    UNPRINTED_DATA,
    Variants,
    envelope_of_lines,
    list_keys_of_case_and_variants,
)
from study.run.store import Results

SECTION = "7.4"
PANELS = ("galerkin-Q8", "pw-Q8")
FINE_CASE = "7.4/pw-T6-fine"
DIAGONALS_CASE = "7.4/pw-T6"
NEEDS = [
    FINE_CASE,
    *(
        member
        for element in PANELS
        for member in list_keys_of_case_and_variants(f"7.4/{element}", UNPRINTED_DATA)
    ),
]
NEEDS += list_keys_of_case_and_variants(DIAGONALS_CASE, OTHER_DIAGONALS)
REFINEMENT_FACTOR = 4
"""Ratio of the element sizes of both meshes, by which nodal forces on the fine mesh are scaled."""


def draw(results: Results) -> Figure:
    """Plot the normal nodal forces of both elements as bars, and scaled ones of a fine mesh."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.5), sharey=True)
    fine = results.curves(FINE_CASE)
    for ax, element, number in zip(axes, PANELS, (13, 14), strict=True):
        curves = results.curves(f"7.4/{element}")
        ax.bar(curves["x"], curves["force_n"], 0.04, color=ELEMENT_LOOK[element]["color"])
        _shade_force_ranges(
            ax,
            results,
            f"7.4/{element}",
            UNPRINTED_DATA,
            0.07,
            DATA_BAND_LOOK | {"edgecolor": "black"},
        )
        label = f"new T6, {REFINEMENT_FACTOR} times finer: force × {REFINEMENT_FACTOR}"
        ax.plot(fine["x"], REFINEMENT_FACTOR * fine["force_n"], color="black", lw=0.9, label=label)
        ax.set(xlabel="$x/b$", xlim=(-1.08, 1.08), ylim=(0, 6))
        ratio = results.scalar(f"7.4/{element}", "sawtooth")
        title = f"Paper Fig. {number}: {ELEMENT_LOOK[element]['label']}"
        ax.set_title(title, loc="left")
        ax.text(0.5, 0.58, f"mid-side / corner: {ratio:.2f}", ha="center", transform=ax.transAxes)
        ax.set_xticks((-1, -0.5, 0, 0.5, 1))
        ax.grid(visible=False, axis="x")
    _shade_force_ranges(
        axes[1],
        results,
        DIAGONALS_CASE,
        OTHER_DIAGONALS,
        0.1,
        style_of_band_over_mesh_diagonals("pw-T6"),
    )
    axes[0].set_ylabel("normal nodal force / kN")
    axes[1].legend(loc="upper center", fontsize=7)
    return fig


def _shade_force_ranges(
    ax: Axes,
    results: Results,
    key: str,
    variants_by_section: Mapping[str, Variants],
    bar_width: float,
    look: Mapping[str, Any],
) -> None:
    """Draw the range of each nodal force over a case and its variants as a bar.

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        key: Key of the case.
        variants_by_section: Variants of each section, such as `UNPRINTED_DATA`.
        bar_width: Width of the bars.
        look: Matplotlib properties of the bars.
    """
    force_lines = [
        (curves["x"], curves["force_n"])
        for curves in load_curves_of_case_and_variants(results, key, variants_by_section)
    ]
    x, low, high = envelope_of_lines(force_lines)
    ax.bar(x, high - low, bar_width, bottom=low, linewidth=0.4, zorder=2.5, **look)


def caption(results: Results) -> str:
    """Return the caption."""
    (standard_ratio, new_ratio) = (
        results.scalar(f"7.4/{element}", "sawtooth") for element in PANELS
    )
    total = results.scalar("7.4/pw-Q8", "force_normal")
    return (
        f"Normal nodal forces below the plate: {ELEMENTS[PANELS[0]].name} (the paper's Fig. 13) "
        f"and {ELEMENTS[PANELS[1]].name} (Fig. 14). Both sum to {total:.3g} kN; the median ratio "
        f"of mid-side to corner force is {standard_ratio:.2f} and {new_ratio:.2f}. Bands as in "
        "Fig. 12, grey "
        "for each of the two elements."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    forces = (
        ", ".join(f"{force:.2f}" for force in results.curves(f"7.4/{element}")["force_n"])
        for element in PANELS
    )
    return "Bars over x, from edge to edge in kN: {}; {}.".format(*forces)
