"""Convergence of natural frequencies to exact ones."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import CLEAR, FULL, LOOK
from study.run.store import Results

SECTION = "V8"
PROBLEMS = {
    "rod": ("round rod, axisymmetric", "squares over the radius"),
    "square": ("square, plane stress", "squares over a side"),
    "strip": ("strip, vibration", "squares over the height"),
}
# In the order of the legend; dotted and hollow ones lie on another line
VARIANTS: dict[str, dict[str, Any]] = {
    "galerkin-T6": LOOK["galerkin-T6"],
    "pw-T6": LOOK["pw-T6"] | {"linestyle": ":", "markerfacecolor": "none", "markersize": 8},
    "galerkin-Q8": LOOK["galerkin-Q8"],
    "pw-Q9-nine": LOOK["pw-Q9"]
    | {
        "linestyle": ":",
        "markerfacecolor": "none",
        "markersize": 8,
        "label": "new Q9, all nodes",
    },
    "pwsym-T6": LOOK["pwsym-T6"],
    "pw-T6-lumped": LOOK["pw-T6"] | {"linestyle": "--", "label": "new T6, lumped mass"},
    "pw-Q8": LOOK["pw-Q8"] | {"label": "new Q8 (Guyan)"},
    "pw-Q8-same": LOOK["pw-Q8"]
    | {
        "linestyle": "--",
        "markerfacecolor": "none",
        "label": "new Q8 (Guyan, L = R)",
    },
}
NEEDS = [f"V8/{problem}-{variant}" for problem in PROBLEMS for variant in VARIANTS]


def draw(results: Results) -> Figure:
    """Largest relative error of the modes over the mesh density, a panel a problem."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 3.3), sharey=True)
    for ax, (problem, (title, density)) in zip(axes, PROBLEMS.items(), strict=True):
        for variant, look in VARIANTS.items():
            curves = results.curves(f"V8/{problem}-{variant}")
            squares, errors = curves["squares"], np.abs(_vibration(problem, curves["errors"]))
            ax.loglog(squares, errors.max(axis=1), **look)
        ends = squares[[0, -1]].astype(float)
        for order, start, side in ((4, 2e-3, "top"), (2, 0.25, "bottom")):
            line = start * (ends / ends[0]) ** -order
            ax.loglog(ends, line, color="#777777", linewidth=0.8)
            middle = np.sqrt(ends.prod()), np.sqrt(line.prod())
            align = {"ha": "right" if side == "top" else "left", "va": side}
            ax.annotate(f"order {order}", middle, fontsize=7, bbox=CLEAR, **align)
        ax.set(title=title, xlabel=density, ylim=(3e-7, 0.6))
        ax.set_xticks(squares, [f"{n}" for n in squares])
        ax.set_xticks([], minor=True)
    axes[0].set_ylabel("largest relative error of $\\omega^2$")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def _vibration(problem: str, errors: np.ndarray) -> np.ndarray:
    """Errors of the natural frequencies; the strip's second half is its buckling."""
    return errors[:, : errors.shape[1] // 2] if problem == "strip" else errors


def caption(results: Results) -> str:
    """What the figure shows."""
    orders = {
        variant: results.scalar(f"V8/rod-{variant}", "order")
        for variant in ("galerkin-T6", "pw-T6", "pwsym-T6", "pw-T6-lumped", "pw-Q8")
    }
    return (
        "Largest relative error of the eigenvalues (six of the rod and of the square, three of the "
        f"strip). Lowest observed orders for the rod: standard triangle "
        f"{orders['galerkin-T6']:.2f}, new triangle {orders['pw-T6']:.2f}; symmetrised "
        f"{orders['pwsym-T6']:.2f}; with lumped mass {orders['pw-T6-lumped']:.2f}; 8-node element "
        f"by Guyan's reduction {orders['pw-Q8']:.2f}. New elements that keep all their nodes "
        "(hollow circles and crosses) lie on the lines of the standard ones."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Three log-log plots of the largest error over mesh density. Standard and new triangles "
        "fall together with slope four, below them the standard 8-node and the new 9-node "
        "quadrilateral; the symmetrised, lumped and Guyan-reduced elements fall with slope two, "
        "the last one in the strip at first with slope four."
    )
