"""How close the family of models comes to Table 2, and how close it comes to random rows."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from figures.style import CLEAR, FULL
from study.run.store import Results

SECTION = "7.6"
CASE = "7.6/inverse"
NEEDS = [CASE]
ROW_TITLES = {"cps6": "CPS6 by the standard T6", "user": "user element by the new T6"}
ROW_LOOK = {
    "cps6": {"color": "#D55E00", "linestyle": "-", "label": "CPS6"},
    "user": {"color": "#009E73", "linestyle": "--", "label": "user element"},
    "both": {"color": "black", "linestyle": "-.", "label": "all four"},
}
GROUP_LOOK: dict[str, dict[str, Any]] = {
    "A a mid-side node": {"color": "#E69F00"},
    "A a corner": {"color": "#0072B2"},
}
EVIDENCE = "#CC79A7"
WINDOW, ZOOMS = 15.0, {"cps6": 0.6, "user": 0.1}
"""Half widths of the plots and of their enlarged middles, in per cent."""
ODDS_SHARE = 1 / 21
"""Share of random rows at odds of 20 to 1 against chance."""


def draw(results: Results) -> Figure:
    """Deviations of all models from the print; share of random rows that are met as closely."""
    fig, axes = plt.subplots(2, 3, figsize=(FULL, 4.9))
    for (whole, middle), (row, title) in zip(axes.T, ROW_TITLES.items(), strict=False):
        for ax, window, size in ((whole, WINDOW, 1.2), (middle, ZOOMS[row], 5)):
            _draw_deviations(ax, results, row, size)
            ax.plot(0, 0, "+", color="black", ms=8, zorder=4, label="print")
            ax.set(xlabel="mode 1: deviation / %", xlim=(-window, window), ylim=(-window, window))
            ax.locator_params(axis="x", nbins=3)
            ax.locator_params(axis="y", nbins=5)
        whole.set_title(title)
        middle.set_title(f"the middle, {WINDOW / ZOOMS[row]:.0f} times larger")
        _draw_random_rows(whole, results, row)
        _draw_distances(middle, results, row)
    for ax in axes[:, 0]:
        ax.set_ylabel("mode 2: deviation / %")
    _draw_chance(axes[0, 2], results)
    _draw_legend(axes[1, 2], *axes[:, 0])
    return fig


def _draw_deviations(ax: Axes, results: Results, row: str, size: float) -> None:
    curves = results.curves(CASE)
    is_corner = curves[f"{row}_corner"]
    for (label, look), chosen in zip(GROUP_LOOK.items(), (~is_corner, is_corner), strict=True):
        points = curves[f"{row}_deviation"][chosen]
        points = points[np.abs(points).max(axis=1) < WINDOW]
        ax.plot(*points.T, ".", ms=size, mew=0, rasterized=True, label=label, **look)


def _draw_random_rows(ax: Axes, results: Results, row: str) -> None:
    """Draw the ellipse of one standard deviation of the random rows around the print."""
    squares, directions = np.linalg.eigh(results.curves(CASE)[f"{row}_covariance"])
    angle = np.degrees(np.arctan2(*directions[::-1, 1]))
    width, height = 2 * np.sqrt(squares[::-1])
    label = "random rows: one standard deviation"
    style = {"fill": False, "color": "black", "linewidth": 1, "label": label}
    ax.add_patch(Ellipse((0, 0), width, height, angle=angle, **style))


def _draw_distances(ax: Axes, results: Results, row: str) -> None:
    """Draw the best model's distance and the one that would be evidence, as squares."""
    squares: dict[str, dict[str, Any]] = {
        "distance": {
            "fill": False,
            "linestyle": "--",
            "edgecolor": "black",
            "label": "as near as the best model",
        },
        "critical_distance": {
            "facecolor": EVIDENCE,
            "edgecolor": EVIDENCE,
            "alpha": 0.5,
            "label": "as near as evidence would be\n(20 to 1 against chance)",
        },
    }
    for name, style in squares.items():
        half = results.scalar(CASE, f"{row}_all_{name}")
        ax.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, zorder=1, **style))


def _draw_legend(ax: Axes, *plots: Axes) -> None:
    labelled: dict[str, Artist] = {}
    for plot in plots:
        handles, labels = plot.get_legend_handles_labels()
        labelled |= dict(zip(labels, handles, strict=True))
    ax.set_axis_off()
    ax.legend(labelled.values(), labelled.keys(), loc="center left", fontsize=7)


def _draw_chance(ax: Axes, results: Results) -> None:
    """Draw the share of random rows with a model within a distance, and the best models."""
    curves = results.curves(CASE)
    for row, look in ROW_LOOK.items():
        ax.semilogx(curves[f"{row}_nearest"], curves["share"], **look)
        best = results.scalar(CASE, f"{row}_all_distance")
        share = np.interp(best, curves[f"{row}_nearest"], curves["share"])
        ax.plot(best, share, "o", color=look["color"], ms=5)
    ax.axhline(ODDS_SHARE, color=EVIDENCE, linewidth=1.2)
    ax.annotate(
        "20 to 1",
        (0.98, ODDS_SHARE),
        xycoords=("axes fraction", "data"),
        xytext=(0, 2),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7,
        bbox=CLEAR,
    )
    ax.set(title="random rows", xlabel="distance of nearest model / %")
    ax.set(ylabel="share that is met", xlim=(1e-3, 5), ylim=(0, 1))
    ax.legend(loc="upper left", fontsize=7)


def caption(results: Results) -> str:
    """What the figure shows."""
    distances = [results.scalar(CASE, f"{row}_all_distance") for row in ROW_LOOK]
    chances = [100 * results.scalar(CASE, f"{row}_all_chance") for row in ROW_LOOK]
    models = sum(results.scalar(CASE, f"{row}_all_models") for row in ROW_TITLES)
    return (
        f"Deviations of {models / 1000:.0f} 000 distinct models from the printed rows of Table 2, "
        "and the same around the print. Curves: share of 10 000 random rows, drawn around the "
        "print with the models' scatter, that have a model within a distance; circles: distances "
        f"of the best models of the print, {distances[0]:.2f}, {distances[1]:.2f} and "
        f"{distances[2]:.2f} %. By chance a row is met as closely in {chances[0]:.0f}, "
        f"{chances[1]:.0f} and {chances[2]:.0f} % (the larger of two ways of drawing); evidence "
        "would be below 5 %."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Scatter plots of the deviation of mode 2 over that of mode 1: clouds of models over "
        "several per cent. Enlarged, the square of CPS6's best model is many times as wide as "
        "that of evidence, the user element's about twice. Another plot has three rising curves of "
        "the share of random rows over distance; the best models' circles lie above the line of 20 "
        "to 1."
    )
