"""Error of the pressure of several methods over the place where contact ends."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.publish.plots.rivals import LOOK
from study.publish.plots.style import BESIDE, plain_ticks
from study.run.store import Results

SECTION = "Q"
SHOWN = ("pw-T6", "snes-vi", "nitsche-symmetric", "nitsche-skew", "mortar-p1", "linear")
NEEDS = [f"Q/offsets-{method}" for method in SHOWN]


def draw(results: Results) -> Figure:
    """One line a method."""
    fig, ax = plt.subplots(figsize=(BESIDE, 1.7))
    for method in SHOWN:
        curves = results.curves(f"Q/offsets-{method}")
        ax.semilogy(curves["offset"], 100 * curves["pressure_l2"], **LOOK[method])
    ax.set(xlabel="place of the contact's edge in an element", ylabel="L2 error / %")
    ax.set(xlim=(0, 1), ylim=(0.45, 6))
    plain_ticks(ax)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Error of the pressure below a parabola with 8 edges over the half width, over the place "
        "where contact ends within an element of the surface (0 and 1: corners, 1/2: mid-side "
        "node). Tables and the outside reference have the places 0.375 and 0.875."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    new = 100 * results.curves("Q/offsets-pw-T6")["pressure_l2"]
    return (
        f"Lines that rise and fall by a factor of two and more: the new element's between "
        f"{new.min():.2g} and {new.max():.2g} %, lowest near 0.4 and 0.9. No line is lowest "
        "everywhere."
    )
