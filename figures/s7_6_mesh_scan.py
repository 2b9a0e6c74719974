"""How close the scanned meshes come to Table 2."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.judge import measures
from study.run.store import Results

SECTION = "7.6"
NEEDS = [f"7.6/scan-{p}" for p in ("right", "right_left", "left_right", "crossed")]
READINGS = {"pwsym-T6": "symmetrised", "pw-T6": "as it is"}
WINDOW = 12.0  # per cent


def draw(results: Results) -> Figure:
    """Deviations of mode 2 over those of mode 1, CPS6 and user element."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 3.5), sharex=True, sharey=True)
    deviations = {reading: measures.scan(results, reading) for reading in READINGS}
    look = LOOK["galerkin-T6"]
    cps6 = deviations["pw-T6"][:, :2]
    axes[0].plot(*cps6.T, ".", color=look["color"], markersize=3)
    for reading, label in READINGS.items():
        look = LOOK[reading]
        user = deviations[reading][:, 2:]
        axes[1].plot(*user.T, ".", color=look["color"], markersize=3, label=f"new T6, {label}")
        best = deviations[reading][measures.scan_best_model(results, reading)]
        for ax, (x, y) in zip(axes, best.reshape(2, 2), strict=True):
            name = f"best model, {label}" if ax is axes[0] else None
            big = {"marker": look["marker"], "color": look["color"], "markersize": 8}
            ax.plot(x, y, ls="none", mec="black", label=name, **big)
    axes[0].set(title="CPS6 by the standard T6, form J", ylabel="mode 2: deviation / %")
    axes[1].set(title="user element by the new T6, form G")
    for ax in axes:
        ax.axhline(0, color="black", linewidth=0.8)
        ax.axvline(0, color="black", linewidth=0.8)
        ax.set(xlabel="mode 1: deviation / %", xlim=(-WINDOW, WINDOW), ylim=(-WINDOW, WINDOW))
        ax.legend(loc="upper left", bbox_to_anchor=(0, -0.16), fontsize=7, ncols=2)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    outside = int((np.abs(measures.scan(results, "pwsym-T6")) > WINDOW).any(axis=1).sum())
    return (
        f"Deviations from the printed Table 2 of {measures.scan_count(results):.0f} half-beam "
        "models (divisions, diagonal patterns, supports) under the point load. Large markers: the "
        "model whose largest of all four deviations is smallest, "
        f"{measures.scan_best(results, 'pwsym-T6'):.2f} % if the new element is symmetrised and "
        f"{measures.scan_best(results, 'pw-T6'):.2f} % if not. {outside} models lie outside."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Two scatter plots of the deviation of mode 2 over that of mode 1 with the printed values "
        "at the origin; the clouds spread over several per cent around it, none hits it."
    )
