"""Error of the pressure over the parameter of those methods that have one."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.rivals import LOOK
from study.publish.plots.style import SIDE, plain_ticks
from study.run.store import Results

SECTION = "Q"
SWEPT = ("nitsche-symmetric", "nitsche-skew", "penalty", "augmented-p1")
PLACES = (0.375, 0.875)
NEEDS = [f"Q/{method}-16-{place}" for method in ("pw-T6", *SWEPT) for place in PLACES]
MOST = 2.0  # errors above are those of no solution


def draw(results: Results) -> Figure:
    """Means of two places; a gap where there is no solution at one of them."""
    fig, ax = plt.subplots(figsize=(SIDE, 1.7))
    for method in SWEPT:
        curves = [results.curves(f"Q/{method}-16-{place}") for place in PLACES]
        swept = np.array([one["sweep_l2"] for one in curves])
        mean = np.where((swept < MOST).all(axis=0), swept.mean(axis=0), np.nan)
        ax.loglog(curves[0]["sweep"], 100 * mean, **LOOK[method])
    errors = [results.scalar(f"Q/pw-T6-16-{place}", "pressure_l2") for place in PLACES]
    look = {key: LOOK["pw-T6"][key] for key in ("color", "label")}
    ax.axhline(100 * sum(errors) / len(errors), linestyle="--", **look)
    ax.set(xlabel="parameter", ylabel="L2 error / %")
    plain_ticks(ax)
    fig.legend(
        *ax.get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        fontsize=5.5,
        columnspacing=0.8,
        handlelength=1.2,
    )
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Error of the pressure, 16 edges over a, over the parameter (times h/E); means of two "
        "places. Gap: no convergence."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Symmetric Nitsche and penalty have a narrow minimum at 10 and errors of several per cent "
        "ten times above and below, the skew form a wide one at 3; the augmented Lagrangian's "
        "error does not depend on the parameter."
    )
