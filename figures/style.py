"""The study's look, as figure scripts import it.

Importing it also imports the package `figures`, which lets a script be started by itself.
"""

from study.publish.plots.style import (
    BESIDE,
    CLEAR,
    COLUMN,
    FULL,
    LOOK,
    MANY,
    SIDE,
    WAY_LOOK,
    mesh_plot,
    plain_ticks,
    style,
)

__all__ = [
    "BESIDE",
    "CLEAR",
    "COLUMN",
    "FULL",
    "LOOK",
    "MANY",
    "SIDE",
    "WAY_LOOK",
    "mesh_plot",
    "plain_ticks",
    "style",
]
