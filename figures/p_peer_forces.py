"""Nodal forces of an independent code beside ours."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "P"
KEY = "P/block-friction-0.30"
NEEDS = [KEY]
COMPONENTS = (("normal", "normal nodal force"), ("tangential", "tangential nodal force"))
PAIRS = (("peer", "galerkin-T6", "CalculiX"), ("peer_T", "pw-T6", "T × CalculiX"))


def draw(results: Results) -> Figure:
    """Forces above, their differences below."""
    curves, mean = results.curves(KEY), results.scalar(KEY, "mean_force")
    heights = {"height_ratios": (3, 2)}
    fig, axes = plt.subplots(2, 2, figsize=(FULL, 3.1), sharex=True, gridspec_kw=heights)
    for (above, below), (name, words) in zip(axes.T, COMPONENTS, strict=True):
        for theirs, ours, label in PAIRS:
            look, peer = LOOK[ours], curves[f"{theirs}_{name}"] / mean
            mine = curves[f"{ours}_{name}"] / mean
            line = {"color": look["color"], "label": look["label"]}
            above.plot(curves["x"], mine, lw=1.0, **line)
            dots = {"marker": look["marker"], "ls": "none", "mfc": "none", "mew": 0.8}
            above.plot(curves["x"], peer, color=look["color"], label=label, **dots)
            apart = 100 * np.abs(peer - mine)
            difference = f"{label}, {look['label']}"
            below.semilogy(
                curves["x"], apart, **{**look, "label": difference, "lw": 0.8, "ms": 2.5}
            )
        below.axhline(0.5, color="black", lw=0.8, ls=":", label="0.5 %")
        above.set(title=words)
        below.set(xlabel="$x$", ylim=(1e-5, 10))
    axes[0, 0].set(ylabel="force / mean")
    axes[0, 0].set_ylim(bottom=0)
    axes[1, 0].set(ylabel="difference, %")
    handles = [ax.get_legend_handles_labels() for ax in (axes[0, 0], axes[1, 0])]
    fig.legend(*handles[0], loc="outside upper center", ncols=4)
    fig.legend(*handles[1], loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    raw, transferred = (
        max(100 * results.scalar(KEY, f"{kind}_{name}") for name, _ in COMPONENTS)
        for kind in ("raw", "transferred")
    )
    return (
        "Nodal forces on the block (traction over pressure 0.3, friction 0.3 everywhere): lines "
        "are ours, open markers CalculiX's as computed and multiplied by T. The last two panels "
        f"show their differences, at most {raw:.2g} % of the mean nodal force between the standard "
        f"elements and {transferred:.2g} % between T times CalculiX's and the new element's, at "
        "the edges of slip zones; 0.5 % is the bound set for nodes away from them."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    curves, mean = results.curves(KEY), results.scalar(KEY, "mean_force")
    values = "; ".join(
        f"{LOOK[ours]['label']}: {corner:.2f} at a corner and {middle:.2f} at a mid-side node"
        for _, ours, _ in PAIRS
        for corner, middle in [curves[f"{ours}_normal"][18:20] / mean]
    )
    return (
        "Four panels over x: normal and tangential nodal forces, and their differences on a "
        f"logarithmic scale. In the middle of the block, {values}. CalculiX's markers lie on the "
        "lines."
    )
