"""Stresses along the contact area calculated with 6-node triangular elements."""

from matplotlib.figure import Figure

from figures.contact import block_stresses
from study.store import Results

SECTION = "7.2"
ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6")
ZONES_OF = "pw-T6"
NEEDS = [f"7.2/{element}" for element in ELEMENTS]


def draw(results: Results) -> Figure:
    """Normal and shear stress over x; the strips below are the contact zones."""
    return block_stresses(results, ELEMENTS, ZONES_OF)


def caption(results: Results) -> str:
    """What the figure shows."""
    saw = ", ".join(
        f"{element} {results.scalar(f'7.2/{element}', 'sawtooth'):.3f}" for element in ELEMENTS
    )
    return (
        "Stresses along the contact area, 6-node triangles: nodal force over tributary "
        "length, as a node-to-surface code reports it. Mid-side over corner force of the normal "
        f"forces: {saw}. Strips: zones of {ZONES_OF}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Curves of normal and shear stress over the contact line. Those of the standard "
        "triangle form a sawtooth around the smooth curves of the others; sticking on the "
        "left, slip on the right."
    )
