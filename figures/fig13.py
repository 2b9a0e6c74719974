"""Reaction forces along the contact area of the rigid plate, CPS8."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.store import Results

SECTION = "7.4"
ELEMENT = "galerkin-Q8"
NEEDS = [f"7.4/{ELEMENT}"]


def draw(results: Results) -> Figure:
    """Nodal forces as bars."""
    curves = results.curves(NEEDS[0])
    fig, ax = plt.subplots(figsize=(FULL, 2.4))
    ax.bar(curves["x"], curves["force_n"], 0.05, color=LOOK[ELEMENT]["color"])
    ax.set(xlabel="$x/b$", ylabel="normal reaction / kN", ylim=(0, 6))
    ax.grid(visible=False, axis="x")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    ratio = results.scalar(NEEDS[0], "sawtooth")
    total = results.scalar(NEEDS[0], "force_normal")
    return (
        f"Normal nodal forces below the plate with {ELEMENT}; their sum is {total:.6g} kN, the "
        f"median of a mid-side force over its corner neighbours' mean {ratio:.3f}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    forces = ", ".join(f"{f:.2f}" for f in results.curves(NEEDS[0])["force_n"])
    return f"Bars over x, from edge to edge in kN: {forces}."
