"""Reaction forces along the contact area of the rigid plate: standard and new element."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED
from figures.style import FULL, LOOK
from study.core.store import Results
from study.vocabulary import ELEMENTS

SECTION = "7.4"
PANELS = ("galerkin-Q8", "pw-Q8")
FINE = "7.4/pw-T6-fine"
NEEDS = [*(f"7.4/{element}" for element in PANELS), FINE]
COARSER = 4  # times as many elements in the fine mesh: its forces are as many times smaller


def draw(results: Results) -> Figure:
    """Normal nodal forces as bars, and what the fine mesh's add up to."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 2.5), sharey=True)
    fine = results.curves(FINE)
    for ax, element in zip(axes, PANELS, strict=True):
        curves = results.curves(f"7.4/{element}")
        ax.bar(curves["x"], curves["force_n"], 0.06, color=LOOK[element]["color"])
        label = f"new T6, {COARSER} times finer: force × {COARSER}"
        ax.plot(fine["x"], COARSER * fine["force_n"], color="black", lw=0.9, label=label)
        ax.set(xlabel="$x/b$", xlim=(-1.08, 1.08), ylim=(0, 6), title=LOOK[element]["label"])
        ax.set_xticks((-1, -0.5, 0, 0.5, 1))
        ax.grid(visible=False, axis="x")
    axes[0].set_ylabel("normal nodal force / kN")
    axes[1].legend(loc="upper center", fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    (standard, new) = (results.scalar(f"7.4/{element}", "sawtooth") for element in PANELS)
    total = results.scalar("7.4/pw-Q8", "force_normal")
    return (
        f"Normal nodal forces below the plate: {ELEMENTS[PANELS[0]].name} (the paper's Fig. 13) "
        f"and {ELEMENTS[PANELS[1]].name} (Fig. 14). Both sum to {total:.3g} kN; the median ratio "
        f"of mid-side to corner force is {standard:.2f} and {new:.2f}. {RECONSTRUCTED}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    forces = (
        ", ".join(f"{force:.2f}" for force in results.curves(f"7.4/{element}")["force_n"])
        for element in PANELS
    )
    return "Bars over x, from edge to edge in kN: {}; {}.".format(*forces)
