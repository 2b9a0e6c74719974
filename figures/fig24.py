"""Mesh and boundary conditions for symmetric buckling of the simply supported beam."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.beam import MESH, NOTE, half_beam
from figures.style import FULL
from figures.symbols import roller
from study.core.store import Results

SECTION = "7.6"
NEEDS = [MESH]


def draw(results: Results) -> Figure:
    """Half beam held horizontally on its whole mid-section."""
    fig, ax = plt.subplots(figsize=(FULL, 2.5))
    length, height = half_beam(ax, results)
    for y in np.linspace(-height / 2, height / 2, 9):
        roller(ax, (length, y), "right", 0.1)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Half beam for mode 1: v = 0 at the centre A of the end face, where P acts; u = 0 on the "
        f"whole mid-section, the plane of symmetry. {NOTE}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Rectangle of five by two squares, each cut into four triangles; an arrow P at A, the "
        "centre of its left side, which stands on a roller; rollers along all of its right side."
    )
