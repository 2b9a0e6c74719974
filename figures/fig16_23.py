"""Normal pressures and shear stresses along the four contact surfaces of the column."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.column import MM, NAMES, SURFACES, SYNTHETIC, surface
from figures.contact import (
    DATA_BAND,
    Curves,
    band,
    diagonal_band,
    family,
)
from figures.style import FULL, LOOK
from study.model.vocabulary import OWN_FUNCTION_READING
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
HEADROOM = 2.4  # of the axes over the new element's largest stress, but at an edge


def draw(results: Results) -> Figure:
    """Rows: surfaces from the base upwards; columns: normal and shear stress."""
    fig, axes = plt.subplots(4, 2, figsize=(FULL, 7.9))
    for row, number in zip(axes, SURFACES, strict=True):
        zones = surface(results.curves(VARIED), number)
        for column, (ax, quantity) in enumerate(zip(row, STRESSES, strict=True)):
            _panel(ax, results, number, quantity)
            zone_strip(ax, {**zones, "x": MM * zones["x"]})
            paper = f"Fig. {14 + 2 * number + column}"
            title = f"{paper}: surface {number}, {NAMES[number]}"
            ax.set_title(title, loc="left", fontsize=8)
            ax.set_ylabel(f"{STRESSES[quantity]} / MPa", fontsize=8)
            ax.tick_params(labelsize=7)
    for ax in axes[-1]:
        ax.set_xlabel("$r$ / mm")
    handles, _ = axes[0, 0].get_legend_handles_labels()
    handles += zone_legend(surface(results.curves(VARIED), 1))
    fig.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=7.5)
    return fig


def _panel(ax: Axes, results: Results, number: int, quantity: str) -> None:
    def lines(key: str, families: Mapping[str, Variants]) -> list[Curves]:
        """Of a family, the second column's radii moved to those of the first one."""
        base, *others = (surface(curves, number) for curves in family(results, key, families))
        ends = base["x"][[0, -1]]
        moved = [{**c, "x": np.interp(c["x"], c["x"][[0, -1]], ends)} for c in others]
        return [{**c, "x": MM * c["x"]} for c in (base, *moved)]

    band(ax, lines(VARIED, UNPRINTED_DATA), quantity, 1e-3, DATA_BAND)
    for key, element in zip(CUT, ("galerkin-T6", "pw-T6"), strict=True):
        band(ax, lines(key, OTHER_DIAGONALS), quantity, 1e-3, diagonal_band(element))
    fine = surface(results.curves(FINE), number)
    label = "new T6, mesh halved"
    ax.plot(MM * fine["x"], fine[quantity] / 1e3, color="black", lw=0.9, label=label)
    for element in ELEMENTS:
        curves = surface(results.curves(f"7.5/{element}"), number)
        look = {**LOOK[element], "markersize": 3.0, "linewidth": 0.8}
        look |= HOLLOW if element == "pw-Q8" else {}  # it lies on the new T6's
        ax.plot(MM * curves["x"], curves[quantity] / 1e3, **look)
    inner = surface(results.curves(VARIED), number)[quantity][:-1] / 1e3
    _, high = ax.get_ylim()
    ax.set_ylim(None, min(high, HEADROOM * float(inner.max())))


def caption(results: Results) -> str:
    """What the figure shows."""
    saws = {
        element: [results.scalar(f"7.5/{element}", f"sawtooth_{k}") for k in SURFACES]
        for element in ELEMENTS
    }
    standard, new = (
        [value for element, values in saws.items() if element.startswith(kind) for value in values]
        for kind in ("galerkin", "pw")
    )
    return (
        f"{OWN_FUNCTION_READING.name.capitalize()} stresses along the four contact surfaces: {OWN_FUNCTION_READING.meaning}; on the "
        "axis standard elements have none. Ratio of the normal force of a mid-side node to that "
        f"of its corners, over all surfaces: standard elements {min(standard):.3f} to "
        f"{max(standard):.3f}, new elements {min(new):.3f} to {max(new):.3f}. Grey band: gaps of "
        "0 and 0.2 mm and the second column, drawn over the radii of the first, new T6. Coloured "
        f"bands: all diagonals. Strips: contact zones of the new T6. {SYNTHETIC}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    forces = ", ".join(f"{results.scalar('7.5/pw-T6', f'force_normal_{k}'):.0f}" for k in SURFACES)
    return (
        "Eight panels of stress over the radius. The stresses of all elements follow the finer "
        "mesh's and rise to the edge; the grey band of gaps and columns is far wider than their "
        f"differences. Normal forces on the four surfaces: {forces} kN."
    )
