"""Mesh and boundary conditions of the half beam: symmetric and antisymmetric buckling."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.beam import MESH, NOTE, draw_half_beam
from figures.style import FULL
from study.publish.plots.symbols import roller
from study.run.store import Results

SECTION = "7.6"
NEEDS = [MESH]


def draw(results: Results) -> Figure:
    """Mid-section held horizontally on the left, pinned at its centre on the right."""
    fig, (symmetric, antisymmetric) = plt.subplots(1, 2, figsize=(FULL, 1.7))
    length, height = draw_half_beam(symmetric, results)
    for y in np.linspace(-height / 2, height / 2, 9):
        roller(symmetric, (length, y), "right", 0.1)
    symmetric.set_title("mode 1: symmetric")
    draw_half_beam(antisymmetric, results)
    roller(antisymmetric, (length, 0.0), "down", 0.16)
    roller(antisymmetric, (length, 0.0), "right", 0.16)
    antisymmetric.set_title("mode 2: antisymmetric")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Half beam with v = 0 at the centre A of the end face, where P acts. Mode 1 (the paper's "
        "Fig. 24): u = 0 on the whole mid-section, the plane of symmetry. Mode 2 (Fig. 25): "
        f"u = v = 0 at the centre of the mid-section, the inflection point. {NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Twice a rectangle of five by two squares, each cut into four triangles; an arrow P at A, "
        "the centre of its left side, which stands on a roller. The first has rollers along all "
        "of its right side, the second is held both ways at the centre of it."
    )
