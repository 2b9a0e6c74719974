"""Coloured strips that show where a contact is open, sticks or slips, with their legend."""

from collections.abc import Mapping
from itertools import groupby
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle
from matplotlib.transforms import Affine2D, ScaledTranslation, blended_transform_factory

from study.model.vocabulary import OPEN, SLIP, STICK

ZONE_NAMES_AND_COLOURS = {
    OPEN: ("open", "#FFFFFF"),
    STICK: ("stick", "#4C78A8"),
    SLIP: ("slip", "#F2B447"),
}
"""Name and colour of each contact status."""
FRICTIONLESS_ZONE = ("frictionless", "#C9C9C9")
"""Name and colour of nodes that slip without friction."""
STRIP_OFFSET, STRIP_HEIGHT = 8.5, 3.5
"""Distance of the lower edge of a strip of zones from its axes, and its height, in points."""

Curves: TypeAlias = Mapping[str, np.ndarray]


def draw_zone_strip(ax: Axes, curves: Curves) -> None:
    """Draw contact zones as a coloured strip between the axes and the tick labels.

    The vertical position is in points; the strip therefore never overlaps the labels, regardless
    of the height of the axes.

    Args:
        ax: axes of curves with abscissa `x`.
        curves: positions `x`, `status` and friction coefficients `friction` of the contact nodes.
    """
    x = curves["x"]
    borders = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
    colours = [
        FRICTIONLESS_ZONE[1] if frictionless else ZONE_NAMES_AND_COLOURS[int(status)][1]
        for status, frictionless in zip(
            curves["status"], _slips_without_friction(curves), strict=True
        )
    ]
    points = Affine2D().scale(1 / 72) + ax.figure.dpi_scale_trans
    from_corner = points + ScaledTranslation(0, 0, ax.transAxes)  # type: ignore[arg-type]
    below_axes = blended_transform_factory(ax.transData, from_corner)
    end = 0
    for colour, same_colour_nodes in groupby(colours):
        start, end = end, end + len(list(same_colour_nodes))
        if colour == ZONE_NAMES_AND_COLOURS[OPEN][1]:
            continue
        left, right = borders[start], borders[end]
        strip = Rectangle(
            (left, -STRIP_OFFSET), right - left, STRIP_HEIGHT, transform=below_axes, clip_on=False
        )
        strip.set(color=colour, lw=0)
        ax.add_patch(strip)
    ax.tick_params(axis="x", pad=STRIP_OFFSET)


def zone_legend_handles(curves: Curves) -> list[Patch]:
    """Return legend handles for the types of zones that occur."""
    frictionless = _slips_without_friction(curves)
    entries = [
        ZONE_NAMES_AND_COLOURS[int(status)] for status in np.unique(curves["status"][~frictionless])
    ]
    entries += [FRICTIONLESS_ZONE] if frictionless.any() else []
    return [
        Patch(facecolor=colour, edgecolor="#777777", lw=0.5, label=name) for name, colour in entries
    ]


def _slips_without_friction(curves: Curves) -> np.ndarray:
    is_frictionless_slip: np.ndarray = (curves["friction"] == 0) & (curves["status"] == SLIP)
    return is_frictionless_slip
