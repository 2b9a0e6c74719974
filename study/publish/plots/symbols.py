"""Supports and loads as engineers draw them."""

from collections.abc import Iterable
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

INK = "#333333"
Direction = Literal["down", "left", "right"]

_TURN = {"down": 0.0, "left": -90.0, "right": 90.0}


def roller(ax: Axes, point: tuple[float, float], towards: Direction, size: float = 0.06) -> None:
    """Draw a roller support at a point, on the side that it holds against."""
    angle = np.deg2rad(_TURN[towards])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def place(shape: list[tuple[float, float]]) -> np.ndarray:
        return np.asarray(point) + size * np.array(shape) @ turn.T

    wedge = place([(0, 0), (-0.6, -1), (0.6, -1)])
    ax.add_patch(Polygon(wedge, facecolor="white", edgecolor=INK, linewidth=0.8, zorder=1))
    for centre in place([(-0.32, -1.25), (0.32, -1.25)]):
        ax.add_patch(Circle(tuple(centre), 0.22 * size, fill=False, edgecolor=INK, linewidth=0.8))
    ax.plot(*place([(-0.9, -1.5), (0.9, -1.5)]).T, color=INK, linewidth=0.8)


def load_arrows(ax: Axes, x: Iterable[float], y: float, length: float) -> None:
    """Draw a uniform load pressing down on a line at height y."""
    x = list(x)
    for foot in x:
        arrow(ax, (foot, y + length), (foot, y))
    ax.plot([x[0], x[-1]], [y + length] * 2, color=INK, linewidth=0.9)


def arrow(
    ax: Axes,
    tail: tuple[float, float],
    tip: tuple[float, float],
    color: str = INK,
    width: float = 0.9,
) -> None:
    """Draw an arrow from tail to tip in data coordinates."""
    style = {"arrowstyle": "-|>", "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tip, tail, arrowprops=style)
