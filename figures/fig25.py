"""Mesh and boundary conditions for antisymmetric buckling of the simply supported beam."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.beam import MESH, NOTE, half_beam
from figures.style import FULL
from figures.symbols import roller
from study.core.store import Results

SECTION = "7.6"
NEEDS = [MESH]


def draw(results: Results) -> Figure:
    """Half beam pinned at the centre of its mid-section."""
    fig, ax = plt.subplots(figsize=(FULL, 2.5))
    length, _ = half_beam(ax, results)
    roller(ax, (length, 0.0), "down", 0.16)
    roller(ax, (length, 0.0), "right", 0.16)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Half beam for mode 2: v = 0 at the centre A of the end face, where P acts; u = v = 0 at "
        f"the centre of the mid-section, the inflection point. {NOTE}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "The same rectangle; its right side is free but for its centre, held both ways. The left "
        "side carries the arrow P at A on a roller."
    )
