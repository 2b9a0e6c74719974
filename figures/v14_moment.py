"""Moments of nodal forces about deformed nodes: where they come from, and their orders."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V14"
SIZES = (4, 8, 16, 32, 64)
PUNCH_SIZES = (*SIZES, 96)
SPACE_SIZES = (2, 4, 8)
PUNCH, SMOOTH, SPACE = "V14/punch-pw-T6-{}", "V14/smooth-pw-T6-{}", "V14/smooth-pw-T10-{}"
NEEDS = [PUNCH.format(n) for n in PUNCH_SIZES] + [SMOOTH.format(n) for n in SIZES]
NEEDS += [SPACE.format(n) for n in SPACE_SIZES]
LEFT, RIGHT, SUM, FAR, NODES = "#0B6E8A", "#B87A00", "#222222", "#6A4C93", "#8A8A8A"


def draw(results: Results) -> Figure:
    """Panels: what triangles add around the ends of the punch; orders elsewhere."""
    fig, (ends, orders) = plt.subplots(1, 2, figsize=(FULL, 2.8), width_ratios=(1, 1.15))

    def series(name: str, case: str = PUNCH, sizes: tuple[int, ...] = PUNCH_SIZES) -> np.ndarray:
        return np.array([results.scalar(case.format(n), f"moment_defect{name}") for n in sizes])

    left, right = series("_left"), series("_right")
    for label, values, color, marker in (
        ("left end", left, LEFT, "v"),
        ("right end", right, RIGHT, "^"),
        ("both", left + right, SUM, "o"),
    ):
        ends.semilogx(PUNCH_SIZES, 1e6 * values, color=color, marker=marker, label=label)
    ends.axhline(0, color=SUM, lw=0.7, zorder=0)
    ends.set(title="(a) ends of the punch", xlabel="elements over the height")
    ends.set_ylabel("moment / magnitudes, $10^{-6}$")
    ends.legend()
    for label, sizes, values, color, marker in (
        ("punch, far from supports' ends", PUNCH_SIZES, series("_far"), FAR, "s"),
        ("smooth", SIZES, series("", SMOOTH, SIZES), *_look("pw-T6")),
        ("smooth, loads at nodes", SIZES, series("_at_nodes", SMOOTH, SIZES), NODES, "x"),
        ("smooth, in space", SPACE_SIZES, series("", SPACE, SPACE_SIZES), *_look("pw-T10")),
    ):
        orders.loglog(sizes, np.abs(values), color=color, marker=marker, label=label)
    for order, at in ((2, 1.2e-4), (4, 4e-8)):
        n = np.array([20.0, 50.0])
        line = at * (n / n[0]) ** -order
        orders.loglog(n, line, color=SUM, lw=0.7)
        beside = {"textcoords": "offset points", "va": "bottom"}
        orders.annotate(f"order {order}", (n[0], line[0]), (7, 0), fontsize=7, **beside)
    orders.set(title="(b) elsewhere", xlabel="elements over the height, along a side")
    orders.set_ylabel("moment / magnitudes")
    orders.legend(loc="lower left", fontsize=6.5)
    for axes in (ends, orders):
        axes.minorticks_off()
        axes.set_xticks((2, *SIZES) if axes is orders else SIZES)
        axes.set_xticklabels([str(n) for n in ((2, *SIZES) if axes is orders else SIZES)])
    return fig


def _look(element: str) -> tuple[str, str]:
    return LOOK[element]["color"], LOOK[element]["marker"]


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Moments of the new element's nodal forces about deformed nodes, over the sum of their "
        "magnitudes. (a) What triangles within a quarter of the height from either end of the "
        "punch add. (b) What all triangles add that are farther from where supports end; and "
        "the same body deformed smoothly inside a held square and cube, with the load's own "
        "moment and, in the square, with that of nodal loads at the deformed nodes. Lines: "
        "second and fourth order."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Moments from both ends of the punch over the number of elements: each falls from "
        "some 20 millionths, changes sign or turns, and neither settles. In logarithmic "
        "scales: curves for triangles far from the ends and for smooth deformations fall with "
        "about the fourth order, that with loads at nodes with the second."
    )
