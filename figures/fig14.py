"""Reaction forces along the contact area of the rigid plate, user element."""

from matplotlib.figure import Figure

from figures.contact import plate_reactions
from study.store import Results

SECTION = "7.4"
ELEMENT = "pw-Q8"
NEEDS = [f"7.4/{ELEMENT}"]


def draw(results: Results) -> Figure:
    """Nodal forces as bars."""
    return plate_reactions(results, ELEMENT)


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
