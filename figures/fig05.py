"""Reaction forces of the simple structure by both methods."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, PAIR_WIDE_WIDTH
from study.run.store import Results

SECTION = "7.1"
NEEDS = ["7.1/pw-T6", "7.1/galerkin-T6"]
PANELS = ("pw-T6", "galerkin-T6")


def draw(results: Results) -> Figure:
    """Plot the reactions at the three lower nodes as bars, for the new and the standard T6."""
    fig, axes = plt.subplots(1, 2, figsize=(PAIR_WIDE_WIDTH, 2.3), sharey=True)
    for ax, element in zip(axes, PANELS, strict=True):
        curves = results.curves(f"7.1/{element}")
        bars = ax.bar(curves["x"], curves["reaction"], 0.06, color=ELEMENT_LOOK[element]["color"])
        ax.bar_label(bars, fmt="%.4f", padding=2, fontsize=8)
        ax.set(
            title=ELEMENT_LOOK[element]["label"],
            xlabel="$x$",
            xticks=(0, 0.5, 1),
            ylim=(0, 0.8),
            xlim=(-0.2, 1.2),
        )
        ax.grid(visible=False, axis="x")
    axes[0].set_ylabel("reaction over load")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    ratio = results.scalar("7.1/galerkin-T6", "reaction_1") / results.scalar(
        "7.1/galerkin-T6", "reaction_0"
    )
    return (
        "Computed vertical reactions at the three lower nodes. With the standard element the "
        f"middle one is {ratio:.3g} times the others."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    values = {
        element: ", ".join(f"{r:.4f}" for r in results.curves(f"7.1/{element}")["reaction"])
        for element in PANELS
    }
    return (
        f"Bars at x = 0, 0.5 and 1: new T6 {values['pw-T6']}; standard T6 {values['galerkin-T6']}."
    )
