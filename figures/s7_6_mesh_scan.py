"""How close the family of models comes to Table 2, and how close it comes to random rows."""

import matplotlib.pyplot as plt
import numpy as np
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
GROUP_LOOK = {
    "A a mid-side node": {"color": "#E69F00"},
    "A a corner": {"color": "#0072B2"},
}
WINDOW, ZOOM = 15.0, 0.6
"""Half widths of the plots and of the insets, in per cent."""
ODDS_SHARE = 1 / 21
"""Share of random rows at odds of 20 to 1 against chance."""


def draw(results: Results) -> Figure:
    """Deviations of all models from the print; share of random rows that are met as closely."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.9))
    for ax, (row, title) in zip(axes, ROW_TITLES.items(), strict=False):
        _draw_deviations(ax, results, row, size=1.2)
        _draw_random_rows(ax, results, row)
        ax.set(title=title, xlabel="mode 1: deviation / %")
        ax.set(xlim=(-WINDOW, WINDOW), ylim=(-WINDOW, WINDOW))
        _draw_zoom(ax, results, row)
    axes[0].set_ylabel("mode 2: deviation / %")
    _draw_chance(axes[2], results)
    handles, labels = axes[0].get_legend_handles_labels()
    legend = fig.legend(handles, labels, loc="outside lower left", ncols=3, fontsize=7)
    for handle in legend.legend_handles[:2]:
        handle.set_markersize(6)
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


def _draw_zoom(ax: Axes, results: Results, row: str) -> None:
    """Draw the surroundings of the print with the region in which a model would be evidence."""
    inset = ax.inset_axes((0.6, 0.06, 0.38, 0.38))
    _draw_deviations(inset, results, row, size=4)
    for name, style in (
        ("distance", {"fill": False, "linestyle": "--", "color": "black"}),
        ("critical_distance", {"facecolor": "#CC79A7", "edgecolor": "#CC79A7"}),
    ):
        half = results.scalar(CASE, f"{row}_all_{name}")
        inset.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, zorder=1, **style))
    inset.plot(0, 0, "+", color="black", ms=5, zorder=3)
    inset.set(xlim=(-ZOOM, ZOOM), ylim=(-ZOOM, ZOOM), facecolor="white")
    inset.set_xticks([-0.5, 0.5])
    inset.set_yticks([-0.5, 0.5])
    inset.tick_params(labelsize=6, pad=1, length=2)
    inset.grid(visible=False)
    inset.spines[:].set_visible(True)
    ax.indicate_inset_zoom(inset, edgecolor="black")


def _draw_chance(ax: Axes, results: Results) -> None:
    """Draw the share of random rows with a model within a distance, and the best models."""
    curves = results.curves(CASE)
    for row, look in ROW_LOOK.items():
        ax.semilogx(curves[f"{row}_nearest"], curves["share"], **look)
        best = results.scalar(CASE, f"{row}_all_distance")
        share = np.interp(best, curves[f"{row}_nearest"], curves["share"])
        ax.plot(best, share, "o", color=look["color"], ms=5)
    ax.axhline(ODDS_SHARE, color="#CC79A7", linewidth=1.2)
    ax.annotate(
        "20 to 1 against chance",
        (0.98, ODDS_SHARE),
        xycoords=("axes fraction", "data"),
        xytext=(0, 2),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7,
        bbox=CLEAR,
    )
    ax.set(title="random rows around the print", xlabel="distance of nearest model / %")
    ax.set(ylabel="share of random rows", xlim=(3e-3, 5), ylim=(0, 1))
    ax.legend(loc="upper left", fontsize=7)


def caption(results: Results) -> str:
    """What the figure shows."""
    distances = [results.scalar(CASE, f"{row}_all_distance") for row in ROW_LOOK]
    chances = [100 * results.scalar(CASE, f"{row}_all_chance") for row in ROW_LOOK]
    models = sum(results.scalar(CASE, f"{row}_all_models") for row in ROW_TITLES)
    return (
        f"Left, middle: deviations of {models:,.0f} distinct models from the printed rows of Table "
        "2; insets: around the print, with the distance of the best model (dashed) and the region "
        "in which a model would be evidence at 20 to 1 (filled). Right: share of 10 000 random "
        "rows whose nearest model is within a distance; circles are the best models of the print: "
        f"{distances[0]:.3f}, {distances[1]:.3f} and {distances[2]:.2f} % off, met by chance in "
        f"{chances[0]:.0f}, {chances[1]:.0f} and {chances[2]:.0f} % (the larger of two draws)."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two scatter plots of the deviation of mode 2 over that of mode 1: clouds of models over "
        "several per cent, with insets around the print. A third plot has three rising curves of "
        "the share of random rows over distance; the best models' circles lie high above the line "
        "of 20 to 1."
    )
