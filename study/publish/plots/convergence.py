"""Functions shared by the convergence figures of contact problems."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.publish.plots.style import ELEMENT_LOOK, LABEL_BOX
from study.run.store import Results

# pw-Q8 is omitted because its nodal forces equal those of its pairs of pw-T6
ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q9")


def set_log_axes_with_element_ticks(ax: Axes, results: Results, key: str) -> None:
    """Make both axes logarithmic, with ticks at the numbers of elements of a mesh series.

    Args:
        ax: Axes to be changed.
        results: Stored results.
        key: Key of a result with a curve `elements`, the number of elements of each mesh.
    """
    ax.set(xscale="log", yscale="log")
    ticks = [int(n) for n in results.curves(key)["elements"]]
    ax.set_xticks(ticks, [str(n) for n in ticks])
    ax.set_xticks([], minor=True)
    ax.set_xlim(0.85 * ticks[0], 1.9 * ticks[-1])


def plot_error_over_number_of_elements(
    ax: Axes,
    results: Results,
    case_key_by_element: dict[str, str],
    error_name: str,
    **line_style: str,
) -> None:
    """Plot an error against the number of elements, with one line per finite element.

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        case_key_by_element: Key of the result for each finite element. The result has the curve
            `elements` (numbers of elements of the meshes) and the curve of errors, both with one
            value per mesh.
        error_name: Name of the curve of errors.
        line_style: Matplotlib line properties that replace those of the finite elements.
    """
    for element, key in case_key_by_element.items():
        curves = results.curves(key)
        element_look: dict[str, Any] = ELEMENT_LOOK[element] | line_style
        if element == "galerkin-T6":  # may coincide with the standard Q8
            element_look |= {"markersize": 6, "linewidth": 2.2}
        if element == "composite-T6":  # coincides with the new element below flat punches
            element_look |= {"markerfacecolor": "none", "markersize": 7, "linewidth": 0.7}
        ax.plot(curves["elements"], curves[error_name], **element_look)


def draw_line_of_convergence_order(
    ax: Axes, results: Results, key: str, order: float, height_at_coarsest_mesh: float
) -> None:
    """Draw a dotted line that shows an order of convergence with the number of elements.

    Args:
        ax: Logarithmic axes in which to draw.
        results: Stored results.
        key: Key of a result whose curve `elements` determines both ends of the line.
        order: Order of convergence: errors decrease as the number of elements to the power -order.
        height_at_coarsest_mesh: Error at the left end of the line, i.e. on the coarsest mesh.
    """
    elements = results.curves(key)["elements"][[0, -1]]
    heights = height_at_coarsest_mesh * (elements / elements[0]) ** -order
    ax.plot(elements, heights, color="#777777", linewidth=0.9, linestyle=":")
    last_point = (float(elements[1]), float(heights[1]))
    label_offset = (5, 0)  # relative to the last marker, in points
    label = f"order {order:g}"
    text_options: dict[str, Any] = {"textcoords": "offset points", "va": "center"}
    ax.annotate(label, last_point, label_offset, fontsize=7, bbox=LABEL_BOX, **text_options)


def add_element_legend_below_axes(fig: Figure, ax: Axes) -> None:
    """Add one legend, with the lines of `ax`, below all axes of the figure."""
    handles, labels = ax.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
