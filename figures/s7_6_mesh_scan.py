"""How close the family of models comes to Table 2, and how close it comes to random rows."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from figures.style import LABEL_BOX, PAGE_WIDTH
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
EVIDENCE_COLOUR = "#CC79A7"
PLOT_HALF_WIDTH, ZOOM_HALF_WIDTHS = 15.0, {"cps6": 0.6, "user": 0.1}
"""Half widths in per cent of the plots, and of the enlarged plots by row of Table 2."""
ODDS_20_TO_1_SHARE = 1 / 21
"""Fraction of random rows, if met as closely, that gives odds of 20 to 1 against chance."""


def draw(results: Results) -> Figure:
    """Compare computed critical stresses of many models with Table 2 and with random numbers.

    Left and middle, for one row of Table 2 each: deviations of modes 1 and 2 of all models from the
    printed values, with an enlargement below. Right: fraction of random rows that have a model
    within a given distance.
    """
    fig, axes = plt.subplots(2, 3, figsize=(PAGE_WIDTH, 4.9))
    for (whole_ax, zoom_ax), (row, title) in zip(axes.T, ROW_TITLES.items(), strict=False):
        for ax, half_width, marker_size in (
            (whole_ax, PLOT_HALF_WIDTH, 1.2),
            (zoom_ax, ZOOM_HALF_WIDTHS[row], 5),
        ):
            _plot_model_deviations_from_print(ax, results, row, marker_size)
            ax.plot(0, 0, "+", color="black", ms=8, zorder=4, label="print")
            ax.set(
                xlabel="mode 1: deviation / %",
                xlim=(-half_width, half_width),
                ylim=(-half_width, half_width),
            )
            ax.locator_params(axis="x", nbins=3)
            ax.locator_params(axis="y", nbins=5)
        whole_ax.set_title(title)
        zoom_ax.set_title(f"the middle, {PLOT_HALF_WIDTH / ZOOM_HALF_WIDTHS[row]:.0f} times larger")
        _draw_ellipse_of_random_rows(whole_ax, results, row)
        _draw_squares_of_best_and_evidence_distance(zoom_ax, results, row)
    for ax in axes[:, 0]:
        ax.set_ylabel("mode 2: deviation / %")
    _plot_share_of_random_rows_met(axes[0, 2], results)
    _draw_common_legend_of_plots(axes[1, 2], *axes[:, 0])
    return fig


def _plot_model_deviations_from_print(
    ax: Axes, results: Results, table_row: str, marker_size: float
) -> None:
    curves = results.curves(CASE)
    is_corner = curves[f"{table_row}_corner"]
    for (label, look), is_in_group in zip(GROUP_LOOK.items(), (~is_corner, is_corner), strict=True):
        points = curves[f"{table_row}_deviation"][is_in_group]
        points = points[np.abs(points).max(axis=1) < PLOT_HALF_WIDTH]
        ax.plot(*points.T, ".", ms=marker_size, mew=0, rasterized=True, label=label, **look)


def _draw_ellipse_of_random_rows(ax: Axes, results: Results, table_row: str) -> None:
    """Draw the standard-deviation ellipse of random rows around the printed values.

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        table_row: Row of Table 2, a key of `ROW_TITLES`.
    """
    variances, directions = np.linalg.eigh(results.curves(CASE)[f"{table_row}_covariance"])
    angle = np.degrees(np.arctan2(*directions[::-1, 1]))
    width, height = 2 * np.sqrt(variances[::-1])
    label = "random rows: one standard deviation"
    style = {"fill": False, "color": "black", "linewidth": 1, "label": label}
    ax.add_patch(Ellipse((0, 0), width, height, angle=angle, **style))


def _draw_squares_of_best_and_evidence_distance(ax: Axes, results: Results, table_row: str) -> None:
    """Draw two squares around the printed values of a row of Table 2.

    Their half sides are the distance of the best model, and the distance below which agreement
    would be evidence (odds of 20 to 1 against chance).

    Args:
        ax: Axes in which to draw.
        results: Stored results.
        table_row: Row of Table 2, a key of `ROW_TITLES`.
    """
    squares: dict[str, dict[str, Any]] = {
        "distance": {
            "fill": False,
            "linestyle": "--",
            "edgecolor": "black",
            "label": "as near as the best model",
        },
        "critical_distance": {
            "facecolor": EVIDENCE_COLOUR,
            "edgecolor": EVIDENCE_COLOUR,
            "alpha": 0.5,
            "label": "as near as evidence would be\n(20 to 1 against chance)",
        },
    }
    for name, style in squares.items():
        half_side = results.scalar(CASE, f"{table_row}_all_{name}")
        ax.add_patch(
            Rectangle((-half_side, -half_side), 2 * half_side, 2 * half_side, zorder=1, **style)
        )


def _draw_common_legend_of_plots(ax: Axes, *plots: Axes) -> None:
    labelled: dict[str, Artist] = {}
    for plot in plots:
        handles, labels = plot.get_legend_handles_labels()
        labelled |= dict(zip(labels, handles, strict=True))
    ax.set_axis_off()
    ax.legend(labelled.values(), labelled.keys(), loc="center left", fontsize=7)


def _plot_share_of_random_rows_met(ax: Axes, results: Results) -> None:
    """Plot the fraction of random rows that have a model within a distance, against the distance.

    Circles mark the distances of the best models from the printed rows.
    """
    curves = results.curves(CASE)
    for row, look in ROW_LOOK.items():
        ax.semilogx(curves[f"{row}_nearest"], curves["share"], **look)
        best_distance = results.scalar(CASE, f"{row}_all_distance")
        share = np.interp(best_distance, curves[f"{row}_nearest"], curves["share"])
        ax.plot(best_distance, share, "o", color=look["color"], ms=5)
    ax.axhline(ODDS_20_TO_1_SHARE, color=EVIDENCE_COLOUR, linewidth=1.2)
    ax.annotate(
        "20 to 1",
        (0.98, ODDS_20_TO_1_SHARE),
        xycoords=("axes fraction", "data"),
        xytext=(0, 2),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7,
        bbox=LABEL_BOX,
    )
    ax.set(title="random rows", xlabel="distance of nearest model / %")
    ax.set(ylabel="share that is met", xlim=(1e-3, 5), ylim=(0, 1))
    ax.legend(loc="upper left", fontsize=7)


def caption(results: Results) -> str:
    """Return the caption."""
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
    """Return a description for readers who do not see the figure."""
    return (
        "Scatter plots of the deviation of mode 2 over that of mode 1: clouds of models over "
        "several per cent. Enlarged, the square of CPS6's best model is many times as wide as "
        "that of evidence, the user element's about twice. Another plot has three rising curves of "
        "the share of random rows over distance; the best models' circles lie above the line of 20 "
        "to 1."
    )
