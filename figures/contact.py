"""Stress curves and deformed shapes, which the figures of contact examples share.

The curves in the paper's figures are missing from our copy. The table lists the paper's sentences
about them, and the panels that show the same quantities:

| paper | sentence | drawn |
|---|---|---|
| Fig. 5 | Galerkin: uneven reactions; new: even | bars of both elements |
| Figs 7, 8 | CPS6, CPS8: normal and shear stress look like a sawtooth; new as CPS6M | left panels |
| Fig. 10 | stresses of Oden and Pires, CPS8 and the user element are given | left panels |
| Fig. 12 | stresses of CPS8 and the user element are presented; "satisfactory" | left panels |
| Figs 13, 14 | reaction forces of CPS8 (erroneous after [5]), of the user element | bars |
| Figs 16 to 23 | contact stresses along every contact surface are given | left panels |

Left panels show tributary stresses, which node-to-surface codes print, and right panels show
own-function stresses. Both state the deviation from a fine mesh.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from figures.style import ELEMENT_LOOK, LABEL_BOX, MAX_VECTOR_ITEMS
from study.model.vocabulary import ELEMENTS, OWN_FUNCTION_READING, TRIBUTARY_READING
from study.paper.bands import (
    DIAGONALS_LABEL,
    OTHER_DIAGONALS,
    UNPRINTED_DATA,
    UNPRINTED_DATA_LABEL,
    Variants,
    envelope,
    list_case_family,
)
from study.run.store import Results

DATA_BAND_LOOK = {"color": "#BFBFBF", "label": UNPRINTED_DATA_LABEL}
"""Style of the band for data that the paper does not state."""

RECONSTRUCTED_NOTE = "Dimensions and loads are reconstructed."

READING_NAMES = {"_tributary": TRIBUTARY_READING.name, "": OWN_FUNCTION_READING.name}
"""Names of the two stress readings, by suffix of the curves; the paper's reading comes first."""
DEVIATION_NOTE = (
    "Percentages: root mean square deviation from the fine mesh's own-function stress, relative to "
    "that stress, without the end nodes"
)

Curves = dict[str, np.ndarray]


def stress_deviation(curves: Curves, reference: Curves, stress: str, reading: str) -> float:
    """Return the relative deviation of a stress curve from that on a fine mesh.

    It is the ratio of root mean squares of the difference and of the fine mesh's stress. The nodes
    at both ends are excluded, because stresses may be singular there.

    Args:
        curves: Curves with abscissa `x`.
        reference: Curves on the fine mesh, whose own-function stress is the reference.
        stress: "pressure" or "shear".
        reading: Suffix of the name of the curve, a key of `READING_NAMES`.
    """
    inner_nodes = slice(1, -1)
    reference_stress = np.interp(curves["x"][inner_nodes], reference["x"], reference[stress])
    difference = curves[stress + reading][inner_nodes] - reference_stress
    return float(np.linalg.norm(difference) / np.linalg.norm(reference_stress))


def annotate_deviations(
    ax: Axes,
    curves_by_element: Mapping[str, Curves],
    reference: Curves,
    stress: str,
    reading: str,
    fontsize: float = 7.0,
) -> None:
    """Write the deviations of several elements from a fine mesh into a panel, in per cent."""
    lines = []
    for element, curves in curves_by_element.items():
        name = ELEMENTS[element].name.partition(",")[0]
        deviation = 100 * stress_deviation(curves, reference, stress, reading)
        lines.append(f"{name}: {deviation:.2g} %")
    text_options: dict[str, Any] = {
        "fontsize": fontsize,
        "va": "top",
        "bbox": LABEL_BOX,
        "transform": ax.transAxes,
    }
    ax.text(0.03, 1.0, "\n".join(lines), **text_options)


def title_panel(ax: Axes, paper_figure: str, reading: str) -> None:
    """Write the reading above a panel, with the number of the paper's figure for its reading."""
    name = READING_NAMES[reading]
    title = f"{paper_figure}: {name}" if reading else name
    ax.set_title(title, loc="left", fontsize=7.5)


def load_case_family(results: Results, key: str, families: Mapping[str, Variants]) -> list[Curves]:
    """Return the curves of a case and of its variants."""
    return [results.curves(member) for member in list_case_family(key, families)]


def diagonal_band_look(element: str) -> dict[str, Any]:
    """Return the style of the band that covers all patterns of diagonals for an element."""
    element_entry = ELEMENTS[element]
    return {
        "color": element_entry.colour,
        "alpha": 0.45,
        "label": f"{element_entry.name}, {DIAGONALS_LABEL}",
    }


def shade_band(
    ax: Axes, family_curves: Sequence[Curves], quantity: str, scale: float, look: Mapping[str, Any]
) -> None:
    """Shade the range between the smallest and largest values of several curves, times a scale."""
    x, low, high = envelope([(curves["x"], curves[quantity]) for curves in family_curves])
    ax.fill_between(x, scale * low, scale * high, linewidth=0, zorder=0.5, **look)


def shade_families(ax: Axes, results: Results, varied: str, cut: str, quantity: str) -> None:
    """Shade the bands for varied unprinted data and for varied diagonals.

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        varied: Key of the case for which data that the paper does not state are varied.
        cut: Key of the case of the new T6 for which the diagonals are varied.
        quantity: Name of the curves.
    """
    unprinted_data = load_case_family(results, varied, UNPRINTED_DATA)
    shade_band(ax, unprinted_data, quantity, 1.0, DATA_BAND_LOOK)
    diagonals = load_case_family(results, cut, OTHER_DIAGONALS)
    shade_band(ax, diagonals, quantity, 1.0, diagonal_band_look("pw-T6"))


def plot_elements(
    ax: Axes,
    results: Results,
    keys: Sequence[str],
    quantity: str,
    scale: float = 1.0,
    hollow: str = "composite",
) -> None:
    """Plot a stress or force of several elements, multiplied by `scale`, against x.

    Elements whose names contain `hollow` have hollow markers, because their curves nearly coincide
    with those of others.
    """
    for key in keys:
        curves = results.curves(key)
        element = results[key].parameters["element"]
        look = {**ELEMENT_LOOK[element], "linewidth": 0.9, "markersize": 3}
        if hollow in element:
            look |= {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.5}
        ax.plot(curves["x"], scale * curves[quantity], **look)


def cell_outlines(cells: np.ndarray) -> np.ndarray:
    """Return the nodes (m, 6 or 8) of cells (m, 6, 8 or 9) in order along their outlines."""
    outline_order = [0, 5, 1, 3, 2, 4] if cells.shape[1] == 6 else [0, 4, 1, 6, 3, 7, 2, 5]
    return cells[:, outline_order]


def draw_deformed_mesh(ax: Axes, curves: Curves, scale: float, element: str) -> np.ndarray:
    """Draw the deformed mesh; return the positions of its nodes."""
    deformed_nodes = curves["nodes"] + scale * curves["displacement"]
    cell_collection = PolyCollection(
        deformed_nodes[cell_outlines(curves["cells"])],
        facecolor="#EEF3F7",
        edgecolor="#8A97A3",
        lw=0.4,
        rasterized=len(curves["cells"]) > MAX_VECTOR_ITEMS,
    )
    ax.add_collection(cell_collection)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.grid(visible=False)
    ax.set_title(ELEMENT_LOOK[element]["label"], loc="left")
    return deformed_nodes


def draw_force_arrows(
    ax: Axes, curves: Curves, deformed_nodes: np.ndarray, side: float, length: float, element: str
) -> None:
    """Draw nodal contact forces on the body.

    `side` is -1 if the surface is below the body and 1 if it is above. The largest normal force is
    drawn with the given length.
    """
    contact_points = np.column_stack([curves["x"], curves["y"]])
    distance = np.linalg.norm(curves["nodes"][:, None] - contact_points, axis=2)
    nodes = distance.argmin(axis=0)
    scale = length / curves["force_n"].max()
    for node, r_n, r_t in zip(nodes, curves["force_n"], curves["force_t"], strict=True):
        if r_n < 1e-9 * curves["force_n"].max():
            continue  # open node
        force = scale * np.array([-r_t, -side * r_n])
        arrow_style = {"arrowstyle": "-|>", "lw": 0.8, "color": ELEMENT_LOOK[element]["color"]}
        arrow_style |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
        ax.annotate("", deformed_nodes[node], deformed_nodes[node] - force, arrowprops=arrow_style)
