"""Draw coloured strips that show where a contact is open, sticks or slips, and create a legend."""

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
"""Name and colour of zones that are closed and have the friction coefficient zero."""
STRIP_OFFSET, STRIP_HEIGHT = 8.5, 3.5
"""Distance from the axes to the lower edge of the strip, and height of the strip, in points."""

Curves: TypeAlias = Mapping[str, np.ndarray]


def draw_contact_zone_strip(ax: Axes, curves: Curves) -> None:
    """Draw the contact zones as a coloured strip between the horizontal axis and the tick labels.

    Each node colours the axis up to the midpoints between it and its neighbours; open nodes remain
    blank. Vertical distances are in points, so the strip never overlaps the labels.

    Args:
        ax: Axes of curves over the position x along the contact surface.
        curves: Arrays (n,) for the n contact nodes: positions `x` in ascending order, contact
            status `status` and friction coefficients `friction`.
    """
    x = curves["x"]
    borders = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
    colours = [
        FRICTIONLESS_ZONE[1] if frictionless else ZONE_NAMES_AND_COLOURS[int(status)][1]
        for status, frictionless in zip(
            curves["status"], _mask_nodes_slipping_without_friction(curves), strict=True
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


def contact_zone_legend_handles(curves: Curves) -> list[Patch]:
    """Return one legend handle for each type of contact zone that occurs in `curves`."""
    frictionless = _mask_nodes_slipping_without_friction(curves)
    entries = [
        ZONE_NAMES_AND_COLOURS[int(status)] for status in np.unique(curves["status"][~frictionless])
    ]
    entries += [FRICTIONLESS_ZONE] if frictionless.any() else []
    return [
        Patch(facecolor=colour, edgecolor="#777777", lw=0.5, label=name) for name, colour in entries
    ]


def _mask_nodes_slipping_without_friction(curves: Curves) -> np.ndarray:
    is_frictionless_slip: np.ndarray = (curves["friction"] == 0) & (curves["status"] == SLIP)
    return is_frictionless_slip
