"""Engineering symbols for supports and loads."""

from collections.abc import Iterable
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

LINE_COLOUR = "#333333"
Direction = Literal["down", "left", "right"]

_ROTATION_DEGREES = {"down": 0.0, "left": -90.0, "right": 90.0}


def draw_roller(
    ax: Axes, point: tuple[float, float], towards: Direction, size: float = 0.06
) -> None:
    """Draw a roller support at a point, on the side to which `towards` points."""
    angle = np.deg2rad(_ROTATION_DEGREES[towards])
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def to_data_coordinates(points: list[tuple[float, float]]) -> np.ndarray:
        return np.asarray(point) + size * np.array(points) @ rotation.T

    wedge = to_data_coordinates([(0, 0), (-0.6, -1), (0.6, -1)])
    ax.add_patch(Polygon(wedge, facecolor="white", edgecolor=LINE_COLOUR, linewidth=0.8, zorder=1))
    for centre in to_data_coordinates([(-0.32, -1.25), (0.32, -1.25)]):
        ax.add_patch(
            Circle(tuple(centre), 0.22 * size, fill=False, edgecolor=LINE_COLOUR, linewidth=0.8)
        )
    ax.plot(*to_data_coordinates([(-0.9, -1.5), (0.9, -1.5)]).T, color=LINE_COLOUR, linewidth=0.8)


def draw_load_arrows(ax: Axes, x: Iterable[float], y: float, length: float) -> None:
    """Draw arrows of a uniform load that presses down on a line at height y."""
    x = list(x)
    for arrow_x in x:
        draw_arrow(ax, (arrow_x, y + length), (arrow_x, y))
    ax.plot([x[0], x[-1]], [y + length] * 2, color=LINE_COLOUR, linewidth=0.9)


def draw_arrow(
    ax: Axes,
    tail: tuple[float, float],
    tip: tuple[float, float],
    color: str = LINE_COLOUR,
    width: float = 0.9,
) -> None:
    """Draw an arrow from `tail` to `tip`, which are given in data coordinates."""
    style = {"arrowstyle": "-|>", "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tip, tail, arrowprops=style)
