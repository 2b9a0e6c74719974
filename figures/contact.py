"""Draw stresses, nodal forces and deformed meshes for the figures of the contact examples.

The curves in the paper's figures are missing from our copy. The table lists the sentences of the
paper about them, and where this study draws the same quantities:

| paper | sentence | drawn |
|---|---|---|
| Fig. 5 | Galerkin: uneven reactions; new: even | bars of both elements |
| Figs 7, 8 | CPS6, CPS8: normal and shear stress look like a sawtooth; new as CPS6M | left panels |
| Fig. 10 | stresses of Oden and Pires, CPS8 and the user element are given | left panels |
| Fig. 12 | stresses of CPS8 and the user element are presented; "satisfactory" | left panels |
| Figs 13, 14 | reaction forces of CPS8 (erroneous after [5]), of the user element | bars |
| Figs 16 to 23 | contact stresses along every contact surface are given | left panels |

Stresses are computed from nodal forces in two ways. Left panels show tributary stresses (force over
the part of the surface nearest to the node), which node-to-surface codes print. Right panels show
own-function stresses (force over the integral of the node's own test function). Both state the
deviation from the own-function stress on a fine mesh.
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
    envelope_of_lines,
    list_keys_of_case_and_variants,
)
from study.run.store import Results

DATA_BAND_LOOK = {"color": "#BFBFBF", "label": UNPRINTED_DATA_LABEL}
"""Style of the band that shows the influence of data that the paper does not state."""

RECONSTRUCTED_NOTE = "Dimensions and loads are reconstructed."

READING_NAMES = {"_tributary": TRIBUTARY_READING.name, "": OWN_FUNCTION_READING.name}
"""Names of the tributary and the own-function stress, by suffix of the name of the curve.

The tributary stress, which the paper shows, comes first.
"""
DEVIATION_NOTE = (
    "Percentages: root mean square deviation from the fine mesh's own-function stress, relative to "
    "that stress, without the end nodes"
)

Curves = dict[str, np.ndarray]


def relative_stress_deviation_from_fine_mesh(
    curves: Curves, reference: Curves, stress_name: str, curve_suffix: str
) -> float:
    """Return the deviation of a stress curve from the own-function stress on a fine mesh.

    It is the root mean square of the difference, divided by that of the stress on the fine mesh.
    Both end nodes are excluded, because stresses may be singular there.

    Args:
        curves: Arrays (n,) for the n contact nodes: positions `x`, and stresses.
        reference: Arrays (m,) for the m contact nodes of the fine mesh.
        stress_name: "pressure" or "shear".
        curve_suffix: Suffix of the name of the curve: "_tributary" or, for own-function stresses,
            "".
    """
    inner_nodes = slice(1, -1)
    reference_stress = np.interp(curves["x"][inner_nodes], reference["x"], reference[stress_name])
    difference = curves[stress_name + curve_suffix][inner_nodes] - reference_stress
    return float(np.linalg.norm(difference) / np.linalg.norm(reference_stress))


def annotate_stress_deviations_of_elements(
    ax: Axes,
    curves_by_element: Mapping[str, Curves],
    reference: Curves,
    stress_name: str,
    curve_suffix: str,
    fontsize: float = 7.0,
) -> None:
    """Write how much each element's stress deviates from that on a fine mesh, in per cent.

    Args:
        ax: Axes of the panel.
        curves_by_element: Curves of each element, by key of the element.
        reference: Curves on the fine mesh.
        stress_name: "pressure" or "shear".
        curve_suffix: Suffix of the name of the curve, see
            `relative_stress_deviation_from_fine_mesh`.
        fontsize: Size of the text in points.
    """
    lines = []
    for element, curves in curves_by_element.items():
        name = ELEMENTS[element].name.partition(",")[0]
        deviation = 100 * relative_stress_deviation_from_fine_mesh(
            curves, reference, stress_name, curve_suffix
        )
        lines.append(f"{name}: {deviation:.2g} %")
    text_options: dict[str, Any] = {
        "fontsize": fontsize,
        "va": "top",
        "bbox": LABEL_BOX,
        "transform": ax.transAxes,
    }
    ax.text(0.03, 1.0, "\n".join(lines), **text_options)


def title_panel_with_stress_definition(ax: Axes, paper_figure: str, curve_suffix: str) -> None:
    """Write above a panel whether it shows tributary or own-function stresses.

    Args:
        ax: Axes of the panel.
        paper_figure: Number of the paper's figure, which is added for tributary stresses.
        curve_suffix: Suffix of the name of the curve, see
            `relative_stress_deviation_from_fine_mesh`.
    """
    name = READING_NAMES[curve_suffix]
    title = f"{paper_figure}: {name}" if curve_suffix else name
    ax.set_title(title, loc="left", fontsize=7.5)


def load_curves_of_case_and_variants(
    results: Results, key: str, variants_by_section: Mapping[str, Variants]
) -> list[Curves]:
    """Return the curves of a case and of all its variants, with the case itself first.

    Args:
        results: Stored results.
        key: Key of the case.
        variants_by_section: Variants of each section, such as `UNPRINTED_DATA`.
    """
    return [
        results.curves(member)
        for member in list_keys_of_case_and_variants(key, variants_by_section)
    ]


def style_of_band_over_mesh_diagonals(element: str) -> dict[str, Any]:
    """Return the style of the band of an element's curves on meshes with different diagonals.

    The meshes differ in how quadrilaterals are cut into triangles.
    """
    element_entry = ELEMENTS[element]
    return {
        "color": element_entry.colour,
        "alpha": 0.45,
        "label": f"{element_entry.name}, {DIAGONALS_LABEL}",
    }


def shade_range_of_curves(
    ax: Axes,
    family_curves: Sequence[Curves],
    quantity: str,
    scale: float,
    band_style: Mapping[str, Any],
) -> None:
    """Shade the range between the smallest and the largest of several curves.

    Args:
        ax: Axes in which to draw.
        family_curves: Curves of a case and its variants, with positions `x`.
        quantity: Name of the shaded curve.
        scale: Factor by which the values are multiplied.
        band_style: Matplotlib properties of the band.
    """
    x, low, high = envelope_of_lines([(curves["x"], curves[quantity]) for curves in family_curves])
    ax.fill_between(x, scale * low, scale * high, linewidth=0, zorder=0.5, **band_style)


def shade_bands_of_unprinted_data_and_diagonals(
    ax: Axes, results: Results, unprinted_data_case: str, diagonals_case: str, quantity: str
) -> None:
    """Shade the ranges of curves for data that the paper does not state and other diagonals.

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        unprinted_data_case: Key of the case whose unstated data (dimensions, loads) are varied.
        diagonals_case: Key of the case of the new T6 whose quadrilaterals are cut into triangles
            differently.
        quantity: Name of the shaded curve.
    """
    unprinted_data = load_curves_of_case_and_variants(results, unprinted_data_case, UNPRINTED_DATA)
    shade_range_of_curves(ax, unprinted_data, quantity, 1.0, DATA_BAND_LOOK)
    diagonals = load_curves_of_case_and_variants(results, diagonals_case, OTHER_DIAGONALS)
    shade_range_of_curves(ax, diagonals, quantity, 1.0, style_of_band_over_mesh_diagonals("pw-T6"))


def plot_quantity_of_each_element(
    ax: Axes,
    results: Results,
    keys: Sequence[str],
    quantity: str,
    scale: float = 1.0,
    hollow_marker_elements: str = "composite",
) -> None:
    """Plot a stress or force along the contact surface, with one line per case.

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        keys: Keys of the cases, which differ in the element.
        quantity: Name of the curve.
        scale: Factor by which the values are multiplied.
        hollow_marker_elements: Part of the keys of elements that get hollow markers, because their
            curves nearly coincide with others.
    """
    for key in keys:
        curves = results.curves(key)
        element = results[key].parameters["element"]
        look = {**ELEMENT_LOOK[element], "linewidth": 0.9, "markersize": 3}
        if hollow_marker_elements in element:
            look |= {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.5}
        ax.plot(curves["x"], scale * curves[quantity], **look)


def order_cell_nodes_along_outline(cells: np.ndarray) -> np.ndarray:
    """Return the nodes of quadratic cells in cyclic order along the outline of each cell.

    Args:
        cells: Node indices in the order of Basix, shape (m, 6) for triangles, (m, 8 or 9) for
            quadrilaterals.

    Returns:
        Node indices, shape (m, 6 or 8); the node in the middle of a quadrilateral is omitted.
    """
    outline_order = [0, 5, 1, 3, 2, 4] if cells.shape[1] == 6 else [0, 4, 1, 6, 3, 7, 2, 5]
    return cells[:, outline_order]


def draw_deformed_mesh(ax: Axes, curves: Curves, scale: float, element: str) -> np.ndarray:
    """Draw the deformed mesh of a body.

    Args:
        ax: Axes in which to draw.
        curves: Arrays `nodes` (n, 2), `displacement` (n, 2) and `cells` (m, 6, 8 or 9).
        scale: Factor by which displacements are magnified.
        element: Key of the element, whose name becomes the title.

    Returns:
        Magnified positions of the nodes, shape (n, 2).
    """
    deformed_nodes = curves["nodes"] + scale * curves["displacement"]
    cell_collection = PolyCollection(
        deformed_nodes[order_cell_nodes_along_outline(curves["cells"])],
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


def draw_nodal_force_arrows(
    ax: Axes,
    curves: Curves,
    deformed_nodes: np.ndarray,
    surface_side: float,
    longest_arrow: float,
    element: str,
) -> None:
    """Draw the nodal contact forces on a deformed body as arrows that end at the nodes.

    Args:
        ax: Axes in which to draw.
        curves: Nodes of the body `nodes` (n, 2), and arrays (m,) for the m contact nodes: positions
            `x` and `y`, normal forces `force_n` and tangential forces `force_t`.
        deformed_nodes: Positions of the nodes in the drawing, shape (n, 2).
        surface_side: -1.0 if the rigid surface is below the body, 1.0 if it is above.
        longest_arrow: Length of the arrow of the largest normal force.
        element: Key of the element, which determines the colour.
    """
    contact_points = np.column_stack([curves["x"], curves["y"]])
    distance = np.linalg.norm(curves["nodes"][:, None] - contact_points, axis=2)
    nodes = distance.argmin(axis=0)
    scale = longest_arrow / curves["force_n"].max()
    for node, r_n, r_t in zip(nodes, curves["force_n"], curves["force_t"], strict=True):
        if r_n < 1e-9 * curves["force_n"].max():
            continue  # open node
        force = scale * np.array([-r_t, -surface_side * r_n])
        arrow_style = {"arrowstyle": "-|>", "lw": 0.8, "color": ELEMENT_LOOK[element]["color"]}
        arrow_style |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
        ax.annotate("", deformed_nodes[node], deformed_nodes[node] - force, arrowprops=arrow_style)
