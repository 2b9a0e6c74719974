"""Profile and mesh of the section of the stepped column."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from figures.column import (
    MM_PER_M,
    SURFACES,
    SYNTHETIC_NOTE,
    corners_of_column_section,
    select_surface_curves,
)
from figures.style import PAGE_WIDTH, draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import LINE_COLOUR, draw_arrow, draw_roller
from study.run.store import Results

SECTION = "7.5"
CASE = "7.5/galerkin-Q8"
NEEDS = [CASE]
PLATE_THICKNESS = 16.0  # thickness of the rigid surfaces in the drawing, in mm
GAP_SCALE = 40.0  # factor by which gaps are magnified


def draw(results: Results) -> Figure:
    """Draw the column with rigid contact surfaces, and the mesh with the supports for Table 1."""
    curves = results.curves(CASE)
    fig, (contact_ax, vibration_ax) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 4.4), width_ratios=(1.6, 1)
    )
    corners = MM_PER_M * corners_of_column_section(curves)
    _draw_column_and_rigid_surfaces(
        contact_ax,
        curves,
        corners,
        [results.scalar(CASE, f"initial_gap_{surface}") for surface in (2, 3)],
    )
    contact_ax.set_title("(a) contact: Figs 16–23", loc="left")

    draw_quadratic_mesh_with_nodes(
        vibration_ax, MM_PER_M * curves["nodes"], curves["cells"], linewidth=0.5
    )
    for line in vibration_ax.lines:
        line.set_markersize(0.7)
    top = corners[:, 1].max()
    for z in np.linspace(0.04, 0.96, 9) * top:
        draw_roller(vibration_ax, (0.0, z), "left", 9.0)
    base = select_surface_curves(curves, 1)
    for r in MM_PER_M * base["x"][1::5]:
        draw_roller(vibration_ax, (r, 0.0), "down", 9.0)
    vibration_ax.set(xlim=(-30, corners[:, 0].max() + 12), ylim=(-45, top + 45), xlabel="$r$ / mm")
    vibration_ax.set_title("(b) vibration: Table 1", loc="left")
    for ax in (contact_ax, vibration_ax):
        ax.set_aspect("equal")
        ax.grid(visible=False)
    contact_ax.set(xlabel="$r$ / mm", ylabel="$z$ / mm")
    return fig


def _draw_column_and_rigid_surfaces(
    ax: Axes, curves: dict[str, np.ndarray], outline_corners: np.ndarray, gaps: list[float]
) -> None:
    """Draw the section of the column with its mirror image, and the numbered rigid surfaces.

    Args:
        ax: Axes in which to draw.
        curves: Curves of a result of section 7.5.
        outline_corners: Radius and height of the corners of the outline in mm, shape (m, 2).
        gaps: Initial gaps of surfaces 2 and 3 in m.
    """
    for side in (1, -1):
        ax.fill(
            side * outline_corners[:, 0],
            outline_corners[:, 1],
            facecolor="#DCE6EE",
            edgecolor="none",
        )
        ax.plot(side * outline_corners[:-1, 0], outline_corners[:-1, 1], color=LINE_COLOUR, lw=1.0)
        ax.plot(side * outline_corners[-2:, 0], outline_corners[-2:, 1], color=LINE_COLOUR, lw=1.0)
    low, high = outline_corners[:, 1].min() - 50, outline_corners[:, 1].max() + 50
    ax.plot([0, 0], [low, high], color=LINE_COLOUR, lw=0.7, ls=(0, (9, 3, 2, 3)))
    ax.annotate("$a$", (-4, high), va="top", ha="right")
    ax.annotate("$b$", (-4, low), va="bottom", ha="right")
    max_radius = outline_corners[:, 0].max()
    drawn_gaps = [0.0, *(GAP_SCALE * MM_PER_M * gap for gap in gaps), 0.0]
    for surface, gap in zip(SURFACES, drawn_gaps, strict=True):
        surface_curves = select_surface_curves(curves, surface)
        inner_radius, outer_radius, level = (
            MM_PER_M * length
            for length in (surface_curves["x"][0], surface_curves["x"][-1], surface_curves["y"][0])
        )
        vertical_sign = -1.0 if surface < 4 else 1.0
        plate_end = outer_radius + 12 if surface != 2 else outer_radius + 6
        for side in (1, -1):
            left = min(side * inner_radius, side * plate_end)
            bottom = level - gap - PLATE_THICKNESS if surface < 4 else level
            plate = Rectangle(
                (left, bottom), plate_end - inner_radius, PLATE_THICKNESS, facecolor="white"
            )
            plate.set(edgecolor=LINE_COLOUR, hatch="/////", linewidth=0.6)
            ax.add_patch(plate)
        ax.annotate(
            f"{surface}",
            (-outer_radius - 22, level + vertical_sign * (PLATE_THICKNESS / 2 + gap)),
            ha="right",
            va="center",
            bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": LINE_COLOUR, "lw": 0.7},
        )
        if surface in (2, 3):
            text = f"gap {MM_PER_M * gaps[surface - 2]:g} mm"
            ax.annotate(
                text, (plate_end + 5, level - gap - PLATE_THICKNESS / 2), va="center", fontsize=8
            )
    top = outline_corners[:, 1].max() + PLATE_THICKNESS
    draw_arrow(ax, (0, top + 45), (0, top + 2), width=1.4)
    ax.annotate("1 mm", (8, top + 26), fontsize=8)
    ax.set(xlim=(-max_radius - 45, max_radius + 75), ylim=(low - 5, high + 30))


def caption(results: Results) -> str:
    """Return the caption."""
    cells = len(results.curves(CASE)["cells"])
    return (
        f"(a) Section of the column, its axis ab, the rigid surfaces 1 to 4 and their gaps (drawn "
        f"{GAP_SCALE:g} times as wide). (b) Mesh of {cells} quadrilaterals and the supports behind "
        f"Table 1. {SYNTHETIC_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A column of four cylinders, a slender one on the base, two wider ones above it and a "
        "short slender one on top, with hatched rigid surfaces below the base and both shoulders "
        "and on the top; beside it the mesh with rollers along axis and base."
    )
