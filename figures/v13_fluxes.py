"""Nodal fluxes at prescribed nodes: a square, a graded wall, and their errors."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V13"
WAYS = {
    "standard": LOOK["galerkin-T6"] | {"label": "standard T6"},
    "own": {"color": "#B87A00", "marker": "s", "label": "standard T6, own-function"},
    "transferred": LOOK["transferred-T10"] | {"label": "standard T6, times T"},
    "pw": LOOK["pw-T6"] | {"label": "new T6"},
}
SIZES = (16, 32, 64)
SQUARE, WALL, TREFFTZ = "V13/square-{}-8", "V13/graded-{}-16", "V13/graded-trefftz-10"
NEEDS = [name.format(way) for name in (SQUARE, WALL) for way in WAYS]
NEEDS += [f"V13/graded-{way}-{n}" for way in WAYS for n in SIZES[1:]] + [TREFFTZ]


def draw(results: Results) -> Figure:
    """Panels: fluxes along a side of the square, through the wall, largest errors there."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.3))
    for ax, name, axis in ((axes[0], SQUARE, 0), (axes[1], WALL, 1)):
        for way, look in WAYS.items():
            curves = results.curves(name.format(way))
            size = np.abs(curves["exact_flux"]).max()
            x, style = curves["x"][:, axis], "-" if way == "standard" else "none"
            small = {"markersize": 2.5, "linewidth": 0.6, "linestyle": style}
            ax.plot(x, curves["flux"] / size, **look | small)
        exact = LOOK["exact"] | {"linewidth": 0.8, "zorder": 3}
        ax.plot(x, curves["exact_flux"] / size, **exact)
    trefftz = results.curves(TREFFTZ)
    scale = np.abs(trefftz["exact_flux"]).max()
    look = {"color": "#6A4C93", "marker": "x", "linestyle": "none", "markersize": 4, "zorder": 4}
    axes[1].plot(trefftz["x"][::4], trefftz["flux"][::4] / scale, label="Trefftz", **look)
    axes[0].set(title="(a) square", xlabel="$x$", ylabel="flux / largest exact one")
    axes[1].set(title="(b) graded wall", xlabel="$y$")
    axes[1].legend(
        handles=[h for h in axes[1].lines if h.get_label() == "Trefftz"], loc="upper right"
    )
    for way, look in WAYS.items():
        errors = [results.scalar(f"V13/graded-{way}-{n}", "flux_error_max") for n in SIZES]
        axes[2].loglog(SIZES, errors, **look)
    axes[2].set(title="(c) graded wall", xlabel="elements along a side", ylabel="largest error")
    axes[2].set_xticks(SIZES, [str(n) for n in SIZES])
    axes[2].minorticks_off()
    axes[2].legend(handles=axes[0].lines, loc="center", bbox_to_anchor=(0.55, 0.72), fontsize=6)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Fluxes from nodal reactions (over tributary areas, unless marked own-function) against "
        "the exact flux (line): (a) on the upper side of the square, 8 elements along it; (b) "
        "where heat enters the graded wall, 16 elements (crosses: Trefftz method, degree 10). "
        "(c) Largest error at any inner node, over the largest flux."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two plots of flux along a side: the standard element's zigzags by a third about the exact "
        "curve, all others lie on it. A third plot of errors over elements: the standard one's "
        "stays at a third, the others fall fourfold with each halving."
    )
