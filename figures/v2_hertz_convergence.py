"""Convergence of the contact pressure to Hertz'."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures import convergence
from figures.style import FULL
from study.model.vocabulary import OWN, TRIBUTARY
from study.run.store import Results

SECTION = "V2"
KINDS = {"line": "cylinder", "sphere": "sphere"}
NEEDS = [f"V2/{kind}-{element}" for kind in KINDS for element in convergence.ELEMENTS]
ERRORS = {
    "error_pressure_tributary": f"{TRIBUTARY.name}, all nodes",
    "error_pressure_own": f"{OWN.name}, all nodes",
    "error_pressure_own_inner": f"{OWN.name}, inner 80 %",
}
# orders and heights of lines to compare with
SLOPES = {
    "error_pressure_own": [(1, 7e-2)],
    "error_pressure_own_inner": [(1, 3e-2), (2, 1.4e-3)],
}


def draw(results: Results) -> Figure:
    """Rows: kinds of contact; columns: measures."""
    fig, axes = plt.subplots(2, 3, figsize=(FULL, 3.9), sharex=True, sharey=True)
    for row, (kind, title) in zip(axes, KINDS.items(), strict=True):
        keys = {element: f"V2/{kind}-{element}" for element in convergence.ELEMENTS}
        for ax, name in zip(row, ERRORS, strict=True):
            convergence.prepare(ax, results, NEEDS[0])
            convergence.errors(ax, results, keys, name)
            for order, start in SLOPES.get(name, []):
                convergence.slope(ax, results, NEEDS[0], order, start)
        row[0].set_ylabel(f"{title}: error")
    for top, bottom, title in zip(*axes, ERRORS.values(), strict=True):
        top.set_title(title, fontsize=8)
        bottom.set_xlabel("elements over half width")
    convergence.legend(fig, axes[0, 0])
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Relative root mean square error of the contact pressure against Hertz's (over four "
        "positions of the edge of contact within an element). The condensed pair of new triangles "
        "has the errors of the new triangle. In tributary pressure, as node-to-surface codes print "
        "it, both standard elements stay off by a third."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Six log-log plots of error over the number of elements. By the tributary area the "
        "standard elements stay at one third; by the own test function all elements fall with "
        "slope one, and away from the contact's edge with slopes near two, but for the composite "
        "triangle, which keeps slope one."
    )
