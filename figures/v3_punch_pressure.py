"""Tractions below flat punches."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V3"
ELEMENTS = ("galerkin-T6", "pw-T6")
KINDS = ("smooth", "bonded", "round")
# Kind, traction, its sign in the figure
PANELS = {
    "smooth: pressure": ("smooth", "pressure", 1),
    "bonded: pressure": ("bonded", "pressure", 1),
    "bonded: shear": ("bonded", "shear", -1),
    "round, smooth: pressure": ("round", "pressure", 1),
}
NEEDS = [f"V3/{kind}-{element}" for kind in KINDS for element in (*ELEMENTS, "exact")]


def draw(results: Results) -> Figure:
    """One panel a traction."""
    fig, axes = plt.subplots(1, 4, figsize=(FULL, 2.7), sharex=True)
    for ax, (title, panel) in zip(axes, PANELS.items(), strict=True):
        _traction(ax, results, *panel)
        ax.set_title(title, fontsize=8)
        ax.set(xlabel="$x / b$", xlim=(-0.03, 1.03))
    axes[0].set_ylabel("traction / mean pressure")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def _traction(ax: Axes, results: Results, kind: str, quantity: str, sign: int) -> None:
    exact = results.curves(f"V3/{kind}-exact")
    mean = sign * results.scalar(f"V3/{kind}-exact", "mean_pressure")
    for element in ELEMENTS:
        curves = results.curves(f"V3/{kind}-{element}")
        ax.plot(curves["x"], curves[quantity] / mean, **LOOK[element])
    b = curves["x"].max()
    ax.plot(exact["x"] / b, exact[quantity] / mean, **LOOK["exact"], linestyle="--", zorder=3)
    drawn = exact["x"] < 0.97 * b
    ax.set_ylim(0, exact[quantity][drawn][-1] / mean)


def caption(results: Results) -> str:
    """What the figure shows."""
    elements = results.curves(NEEDS[0])["elements"][1]
    return (
        f"Own-function tractions below flat punches of half width b with {elements:.0f} equal "
        "elements over it, and the exact ones, which are unbounded at the edge. The shear is that "
        "of the body on the punch, towards the middle. At the standard element's node on the axis "
        "of the round punch the integral of the shape function is zero."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Four plots of tractions over x, even in the middle and rising steeply to the punch's "
        "edge, the shear from zero. Markers of both elements lie on the exact curves but for the "
        "last element."
    )
