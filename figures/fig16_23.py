"""Normal pressures and shear stresses along the four contact surfaces of the column."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.column import MM, NAMES, SURFACES, SYNTHETIC, select_surface_curves
from figures.contact import (
    DATA_BAND,
    DEVIATION,
    READINGS,
    Curves,
    diagonal_band_look,
    load_case_family,
    print_deviations,
    shade_band,
)
from figures.style import FULL, LOOK
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA, Variants, list_case_family
from study.publish.plots.zones import zone_legend, zone_strip
from study.run.store import Results

SECTION = "7.5"
ELEMENTS = ("galerkin-T6", "galerkin-Q8", "pw-T6", "pw-Q8")
FINE, VARIED = "7.5/pw-T6-fine", "7.5/pw-T6"
CUT = ("7.5/galerkin-T6", "7.5/pw-T6")
NEEDS = [
    *(f"7.5/{element}" for element in ELEMENTS),
    FINE,
    *list_case_family(VARIED, UNPRINTED_DATA)[1:],
    *(member for key in CUT for member in list_case_family(key, OTHER_DIAGONALS)[1:]),
]
STRESSES = {"pressure": "normal pressure", "shear": "shear stress"}
HOLLOW = {"markerfacecolor": "none", "markersize": 4.5, "linewidth": 0.5}
OFF_SCALE = {2, 3}
"""Surfaces without a grey band: it would run from zero (gaps of 0.2 mm) off the scale (no gaps)."""
HEADROOM = 2.4  # of the axes over the new element's largest stress, but at an edge


def draw(results: Results) -> Figure:
    """Rows: surfaces from the base upwards; columns: both readings of both stresses."""
    fig, axes = plt.subplots(4, 4, figsize=(FULL, 7.9))
    columns = [(stress, reading) for stress in STRESSES for reading in READINGS]
    for row, number in zip(axes, SURFACES, strict=True):
        zones = select_surface_curves(results.curves(VARIED), number)
        for ax, (stress, reading) in zip(row, columns, strict=True):
            _draw_panel(ax, results, number, stress, reading)
            zone_strip(ax, {**zones, "x": MM * zones["x"]})
            paper = 14 + 2 * number + (stress == "shear")
            title = f"Paper Fig. {paper}: surface {number}" if reading else READINGS[reading]
            ax.set_title(title, loc="left", fontsize=7)
            ax.set_ylabel(f"{STRESSES[stress]} / MPa" if reading else "", fontsize=7.5)
            ax.tick_params(labelsize=6.5)
    for ax in axes[-1]:
        ax.set_xlabel("$r$ / mm", fontsize=8)
    handles, _ = axes[0, 1].get_legend_handles_labels()
    handles += zone_legend(select_surface_curves(results.curves(VARIED), 1))
    fig.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=7.5)
    return fig


def _draw_panel(ax: Axes, results: Results, number: int, stress: str, reading: str) -> None:
    def family_curves(key: str, families: Mapping[str, Variants]) -> list[Curves]:
        """Return curves of a family, with radii of the second column mapped to the first one's."""
        base, *others = (
            select_surface_curves(curves, number)
            for curves in load_case_family(results, key, families)
        )
        ends = base["x"][[0, -1]]
        mapped = [{**c, "x": np.interp(c["x"], c["x"][[0, -1]], ends)} for c in others]
        return [{**c, "x": MM * c["x"]} for c in (base, *mapped)]

    curve = stress + reading
    if not reading:
        if number not in OFF_SCALE:
            shade_band(ax, family_curves(VARIED, UNPRINTED_DATA), curve, 1e-3, DATA_BAND)
        for key, element in zip(CUT, ("galerkin-T6", "pw-T6"), strict=True):
            look = diagonal_band_look(element)
            shade_band(ax, family_curves(key, OTHER_DIAGONALS), curve, 1e-3, look)
    fine = select_surface_curves(results.curves(FINE), number)
    label = "new T6, mesh halved"
    ax.plot(MM * fine["x"], fine[stress] / 1e3, color="black", lw=0.9, label=label)
    curves_by_element = {
        element: select_surface_curves(results.curves(f"7.5/{element}"), number)
        for element in ELEMENTS
    }
    for element, curves in curves_by_element.items():
        look = {**LOOK[element], "markersize": 2.5, "linewidth": 0.8}
        look |= HOLLOW if element == "pw-Q8" else {}  # it lies on the new T6's
        ax.plot(MM * curves["x"], curves[curve] / 1e3, **look)
    inner = select_surface_curves(results.curves(VARIED), number)[stress][:-1] / 1e3
    low, high = ax.get_ylim()
    high = min(high, HEADROOM * float(inner.max()))
    ax.set_ylim(min(low, 0) if stress == "shear" else 0, 1.5 * high)
    print_deviations(ax, curves_by_element, fine, stress, reading, 5.5)


def caption(results: Results) -> str:
    """Return the caption."""
    saws = {
        element: [results.scalar(f"7.5/{element}", f"sawtooth_{k}") for k in SURFACES]
        for element in ELEMENTS
    }
    places = ", ".join(f"{number} {name}" for number, name in NAMES.items())
    standard, new = (
        [value for element, values in saws.items() if element.startswith(kind) for value in values]
        for kind in ("galerkin", "pw")
    )
    return (
        f"Stresses along the contact surfaces ({places}), {TRIBUTARY_READING.name} and "
        f"{OWN_FUNCTION_READING.name}, {OWN_FUNCTION_READING.meaning}, of which standard "
        f"elements have none on the axis. {DEVIATION}. Ratio of the normal force of a mid-side "
        "node to that of its corners, over "
        f"all surfaces: standard elements {min(standard):.3f} to {max(standard):.3f}, new elements "
        f"{min(new):.3f} to {max(new):.3f}. Grey band on surfaces 1 and 4: gaps of 0 and 0.2 mm "
        "and the second column, drawn over the radii of the first, new T6. Coloured "
        f"bands: all diagonals. Strips: contact zones of the new T6. {SYNTHETIC}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    forces = ", ".join(f"{results.scalar('7.5/pw-T6', f'force_normal_{k}'):.0f}" for k in SURFACES)
    return (
        "Sixteen panels of stress over the radius. Tributary stresses of the standard elements "
        "zigzag, own-function stresses of all elements follow the finer mesh's and rise to the "
        "edge; the grey band of gaps and columns is far wider than their "
        f"differences. Normal forces on the four surfaces: {forces} kN."
    )
