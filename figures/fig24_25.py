"""Mesh and boundary conditions of the half beam: symmetric and antisymmetric buckling."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.beam import MESH_CASE, RECONSTRUCTION_NOTE, draw_half_beam
from figures.style import PAGE_WIDTH
from study.publish.plots.symbols import draw_roller
from study.run.store import Results

SECTION = "7.6"
NEEDS = [MESH_CASE]


def draw(results: Results) -> Figure:
    """Draw the half beam for symmetric (left) and antisymmetric (right) buckling modes.

    At mid-section, it is held horizontally over the height, or pinned at the centre.
    """
    fig, (symmetric_ax, antisymmetric_ax) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 1.7))
    length, height = draw_half_beam(symmetric_ax, results)
    for y in np.linspace(-height / 2, height / 2, 9):
        draw_roller(symmetric_ax, (length, y), "right", 0.1)
    symmetric_ax.set_title("mode 1: symmetric")
    draw_half_beam(antisymmetric_ax, results)
    draw_roller(antisymmetric_ax, (length, 0.0), "down", 0.16)
    draw_roller(antisymmetric_ax, (length, 0.0), "right", 0.16)
    antisymmetric_ax.set_title("mode 2: antisymmetric")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Half beam with v = 0 at the centre A of the end face, where P acts. Mode 1 (the paper's "
        "Fig. 24): u = 0 on the whole mid-section, the plane of symmetry. Mode 2 (Fig. 25): "
        f"u = v = 0 at the centre of the mid-section, the inflection point. {RECONSTRUCTION_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Twice a rectangle of five by two squares, each cut into four triangles; an arrow P at A, "
        "the centre of its left side, which stands on a roller. The first has rollers along all "
        "of its right side, the second is held both ways at the centre of it."
    )
