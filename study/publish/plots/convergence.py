"""Functions shared by the convergence figures of contact problems."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.publish.plots.style import ELEMENT_LOOK, LABEL_BOX
from study.run.store import Results

# pw-Q8 is omitted because its nodal forces equal those of its pairs of pw-T6
ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q9")


def prepare_axes(ax: Axes, results: Results, key: str) -> None:
    """Make both axes logarithmic, with the numbers of elements as horizontal ticks."""
    ax.set(xscale="log", yscale="log")
    ticks = [int(n) for n in results.curves(key)["elements"]]
    ax.set_xticks(ticks, [str(n) for n in ticks])
    ax.set_xticks([], minor=True)
    ax.set_xlim(0.85 * ticks[0], 1.9 * ticks[-1])


def plot_errors(ax: Axes, results: Results, keys: dict[str, str], name: str, **look: str) -> None:
    """Plot an error against the number of elements; `keys` contains the key for each element."""
    for element, key in keys.items():
        curves = results.curves(key)
        element_look: dict[str, Any] = ELEMENT_LOOK[element] | look
        if element == "galerkin-T6":  # may coincide with the standard Q8
            element_look |= {"markersize": 6, "linewidth": 2.2}
        if element == "composite-T6":  # coincides with the new element below flat punches
            element_look |= {"markerfacecolor": "none", "markersize": 7, "linewidth": 0.7}
        ax.plot(curves["elements"], curves[name], **element_look)


def plot_order_slope(ax: Axes, results: Results, key: str, order: float, start: float) -> None:
    """Draw a line with a given order of convergence; `start` is its height at the coarsest mesh."""
    elements = results.curves(key)["elements"][[0, -1]]
    heights = start * (elements / elements[0]) ** -order
    ax.plot(elements, heights, color="#777777", linewidth=0.9, linestyle=":")
    last_point = (float(elements[1]), float(heights[1]))
    label_offset = (5, 0)  # relative to the last marker, in points
    label = f"order {order:g}"
    text_options: dict[str, Any] = {"textcoords": "offset points", "va": "center"}
    ax.annotate(label, last_point, label_offset, fontsize=7, bbox=LABEL_BOX, **text_options)


def add_element_legend(fig: Figure, ax: Axes) -> None:
    """Add a single legend of the elements below all axes."""
    handles, labels = ax.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
