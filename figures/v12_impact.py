"""Impact of a bar of tetrahedra: nodal pressures, total force, and frequencies."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.model.vocabulary import NO_WEIGHT, OWN
from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V12"
SERIES = {
    "hrz": ("standard, HRZ mass", "galerkin-T10", "-"),
    "standard-pwmass": ("standard, new mass", "transferred-T10", "--"),
    "sibling": ("symmetric sibling", "sibling-T10", "-"),
    "pw": ("new, unsymmetric (unstable)", "pw-T10", "-"),
}
BAR, CUBE = "V12/bar-3d-{}-5", "V12/frequency-cube-{}"
FINER = "V12/bar-3d-pw-7"
NEEDS = [*(name.format(scheme) for name in (BAR, CUBE) for scheme in SERIES), FINER]
WINDOW = 0.1  # of time, over which total forces are averaged


def draw(results: Results) -> Figure:
    """Panels: mean pressures of inner nodes in order; total force; error of the frequency."""
    fig, (pressures, total, order) = plt.subplots(1, 3, figsize=(FULL, 2.5))
    for scheme, (label, element, dashes) in SERIES.items():
        look = {"color": LOOK[element]["color"], "linestyle": dashes, "lw": 1.1}
        bar = results.curves(BAR.format(scheme))
        p = np.sort(bar["pressure"])
        pressures.plot((np.arange(len(p)) + 0.5) / len(p), p, label=label, **look)
        count = max(1, round(WINDOW / bar["time"][1]))
        mean = np.convolve(bar["total"], np.full(count, 1 / count), "same")
        total.plot(bar["time"], mean, **look)
        cube = results.curves(CUBE.format(scheme))
        marker = LOOK[element]["marker"]
        order.loglog(cube["size"], 100 * np.abs(cube["error"]), marker=marker, ms=3, **look)
    exact = LOOK["exact"]["color"]
    pressures.axhline(1, color=exact, lw=0.7, zorder=0)
    total.plot([0, 0, 8, 8, 9], [0, 1, 1, 0, 0], color=exact, lw=0.7, zorder=0)
    pressures.set(
        xlabel="share of inner nodes",
        ylabel="mean own-function pressure / exact",
        ylim=(0.93, 1.02),
    )
    pressures.legend(loc="lower right", fontsize=6.5)
    total.set(xlabel="time", ylabel="total force / exact", ylim=(-0.1, 1.3))
    order.set(xlabel="cell size / width", ylabel="error of $\\omega_1^2$ / %")
    for ax, title in zip(fig.axes, ("(a) nodes", "(b) whole face", "(c) frequency"), strict=True):
        ax.set_title(title)
    for axis, ticks in ((order.xaxis, (0.07, 0.1)), (order.yaxis, (0.5, 1, 2, 3))):
        axis.set_ticks([], minor=True)
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    worst = results.scalar(FINER, "pressure_max")
    return (
        "A bar of unstructured tetrahedra, five over its width, hits a rigid wall; the wave "
        "returns at time 8. (a) Pressures at the inner nodes of its face, means over 1 < t < 7, in "
        f"ascending order: {OWN.meaning}, with {NO_WEIGHT}, so that the standard element's curves "
        "end early. The unstable one's motion has hardly grown by then; with seven tetrahedra over "
        f"the width its pressures reach {worst:.2f} times the exact one. (b) Total force, averaged "
        "over intervals of 0.1. (c) Error of the lowest ω² of a cube between smooth walls with "
        "the same lumped masses. Thin black lines are exact."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    ends = {
        scheme: " to ".join(
            f"{results.scalar(BAR.format(scheme), f'pressure_{end}'):.3f}" for end in ("min", "max")
        )
        for scheme in SERIES
    }
    return (
        f"Pressures of nodes range from {ends['hrz']} on the standard element, {ends['sibling']} "
        f"on the sibling, {ends['pw']} on the new one. Total forces are near 1 until the time 8. "
        "Errors of the frequency fall with the square of the cells' size; the sibling's are "
        "twice the others'."
    )
