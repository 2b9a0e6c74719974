"""Profile and mesh of the section of the stepped column."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from figures.column import MM, SURFACES, SYNTHETIC, section_outline, select_surface_curves
from figures.style import FULL, mesh_plot
from study.publish.plots.symbols import INK, arrow, roller
from study.run.store import Results

SECTION = "7.5"
CASE = "7.5/galerkin-Q8"
NEEDS = [CASE]
PLATE = 16.0  # drawn thickness of the rigid surfaces in mm
OPENING = 40.0  # gaps are drawn so many times as wide


def draw(results: Results) -> Figure:
    """Panels: the column in contact, and the mesh with the supports of Table 1."""
    curves = results.curves(CASE)
    fig, (contact, vibration) = plt.subplots(1, 2, figsize=(FULL, 4.4), width_ratios=(1.6, 1))
    corners = MM * section_outline(curves)
    _draw_contact(
        contact, curves, corners, [results.scalar(CASE, f"initial_gap_{k}") for k in (2, 3)]
    )
    contact.set_title("(a) contact: Figs 16–23", loc="left")

    mesh_plot(vibration, MM * curves["nodes"], curves["cells"], linewidth=0.5)
    for line in vibration.lines:
        line.set_markersize(0.7)
    top = corners[:, 1].max()
    for z in np.linspace(0.04, 0.96, 9) * top:
        roller(vibration, (0.0, z), "left", 9.0)
    base = select_surface_curves(curves, 1)
    for r in MM * base["x"][1::5]:
        roller(vibration, (r, 0.0), "down", 9.0)
    vibration.set(xlim=(-30, corners[:, 0].max() + 12), ylim=(-45, top + 45), xlabel="$r$ / mm")
    vibration.set_title("(b) vibration: Table 1", loc="left")
    for ax in (contact, vibration):
        ax.set_aspect("equal")
        ax.grid(visible=False)
    contact.set(xlabel="$r$ / mm", ylabel="$z$ / mm")
    return fig


def _draw_contact(
    ax: Axes, curves: dict[str, np.ndarray], corners: np.ndarray, gaps: list[float]
) -> None:
    """The column with its mirror image, the rigid surfaces and their numbers."""
    for side in (1, -1):
        ax.fill(side * corners[:, 0], corners[:, 1], facecolor="#DCE6EE", edgecolor="none")
        ax.plot(side * corners[:-1, 0], corners[:-1, 1], color=INK, lw=1.0)
        ax.plot(side * corners[-2:, 0], corners[-2:, 1], color=INK, lw=1.0)
    low, high = corners[:, 1].min() - 50, corners[:, 1].max() + 50
    ax.plot([0, 0], [low, high], color=INK, lw=0.7, ls=(0, (9, 3, 2, 3)))
    ax.annotate("$a$", (-4, high), va="top", ha="right")
    ax.annotate("$b$", (-4, low), va="bottom", ha="right")
    widest = corners[:, 0].max()
    opened = [0.0, *(OPENING * MM * gap for gap in gaps), 0.0]
    for k, gap in zip(SURFACES, opened, strict=True):
        face = select_surface_curves(curves, k)
        inner, outer, level = (MM * v for v in (face["x"][0], face["x"][-1], face["y"][0]))
        down = -1.0 if k < 4 else 1.0
        reach = outer + 12 if k != 2 else outer + 6
        for side in (1, -1):
            left = min(side * inner, side * reach)
            bottom = level - gap - PLATE if k < 4 else level
            plate = Rectangle((left, bottom), reach - inner, PLATE, facecolor="white")
            plate.set(edgecolor=INK, hatch="/////", linewidth=0.6)
            ax.add_patch(plate)
        ax.annotate(
            f"{k}",
            (-outer - 22, level + down * (PLATE / 2 + gap)),
            ha="right",
            va="center",
            bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": INK, "lw": 0.7},
        )
        if k in (2, 3):
            text = f"gap {MM * gaps[k - 2]:g} mm"
            ax.annotate(text, (reach + 5, level - gap - PLATE / 2), va="center", fontsize=8)
    top = corners[:, 1].max() + PLATE
    arrow(ax, (0, top + 45), (0, top + 2), width=1.4)
    ax.annotate("1 mm", (8, top + 26), fontsize=8)
    ax.set(xlim=(-widest - 45, widest + 75), ylim=(low - 5, high + 30))


def caption(results: Results) -> str:
    """Return the caption."""
    cells = len(results.curves(CASE)["cells"])
    return (
        f"(a) Section of the column, its axis ab, the rigid surfaces 1 to 4 and their gaps (drawn "
        f"{OPENING:g} times as wide). (b) Mesh of {cells} quadrilaterals and the supports behind "
        f"Table 1. {SYNTHETIC}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "A column of four cylinders, a slender one on the base, two wider ones above it and a "
        "short slender one on top, with hatched rigid surfaces below the base and both shoulders "
        "and on the top; beside it the mesh with rollers along axis and base."
    )
