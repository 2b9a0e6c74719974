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
    ax: Axes, point: tuple[float, float], support_side: Direction, size: float = 0.06
) -> None:
    """Draw the symbol of a roller support that carries a point.

    Args:
        ax: Axes in which to draw.
        point: Coordinates of the supported point.
        support_side: Side of the point on which the support is drawn.
        size: Size of the symbol in data coordinates.
    """
    angle = np.deg2rad(_ROTATION_DEGREES[support_side])
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def rotate_scale_and_move(points: list[tuple[float, float]]) -> np.ndarray:
        return np.asarray(point) + size * np.array(points) @ rotation.T

    wedge = rotate_scale_and_move([(0, 0), (-0.6, -1), (0.6, -1)])
    ax.add_patch(Polygon(wedge, facecolor="white", edgecolor=LINE_COLOUR, linewidth=0.8, zorder=1))
    for centre in rotate_scale_and_move([(-0.32, -1.25), (0.32, -1.25)]):
        ax.add_patch(
            Circle(tuple(centre), 0.22 * size, fill=False, edgecolor=LINE_COLOUR, linewidth=0.8)
        )
    ax.plot(*rotate_scale_and_move([(-0.9, -1.5), (0.9, -1.5)]).T, color=LINE_COLOUR, linewidth=0.8)


def draw_uniform_load_pressing_down(
    ax: Axes, arrow_positions: Iterable[float], loaded_line_height: float, arrow_length: float
) -> None:
    """Draw a uniform load as arrows that press down on a horizontal line.

    Args:
        ax: Axes in which to draw.
        arrow_positions: Horizontal positions of the arrows, in ascending order.
        loaded_line_height: Height of the loaded line, where the arrows end.
        arrow_length: Length of the arrows.
    """
    arrow_positions = list(arrow_positions)
    for arrow_x in arrow_positions:
        draw_arrow(ax, (arrow_x, loaded_line_height + arrow_length), (arrow_x, loaded_line_height))
    ax.plot(
        [arrow_positions[0], arrow_positions[-1]],
        [loaded_line_height + arrow_length] * 2,
        color=LINE_COLOUR,
        linewidth=0.9,
    )


def draw_arrow(
    ax: Axes,
    tail: tuple[float, float],
    tip: tuple[float, float],
    color: str = LINE_COLOUR,
    width: float = 0.9,
) -> None:
    """Draw an arrow between two points, which are given in data coordinates.

    Args:
        ax: Axes in which to draw.
        tail: Start of the arrow.
        tip: End of the arrow, with the arrowhead.
        color: Colour of the arrow.
        width: Line width in points.
    """
    style = {"arrowstyle": "-|>", "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tip, tail, arrowprops=style)
