"""Buckling shapes of modes 1 and 2."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.store import Results

SECTION = "7.6"
ELEMENT = "pw-T6"
CASE = f"7.6/{ELEMENT}-uniform-16x4"
NEEDS = [CASE]
DISPLACEMENT_SCALE = 0.6  # largest displacement in the drawing, divided by the height
OUTLINE_ORDER = [0, 5, 1, 3, 2, 4]  # Basix nodes of a triangle along its outline


def draw(results: Results) -> Figure:
    """Draw the buckling modes 1 and 2 of the half beam, completed by its mirror image."""
    curves = results.curves(CASE)
    nodes, cells = curves["nodes"], curves["cells"][:, OUTLINE_ORDER]
    mirror_x = nodes[:, 0].max()
    fig, axes = plt.subplots(2, 1, figsize=(PAGE_WIDTH, 3.2), sharex=True)
    for mode, ax in enumerate(axes, start=1):
        shape = curves[f"shape_{mode}"]
        if shape[np.abs(shape[:, 1]).argmax(), 1] < 0:
            shape = -shape
        mirror_signs = np.array([-1.0, 1.0]) if mode == 1 else np.array([1.0, -1.0])
        halves = [(nodes, shape), (nodes * [-1, 1] + [2 * mirror_x, 0], shape * mirror_signs)]
        for x, u in halves:
            outline = np.array([[x[:, 0].min(), -0.5], [x[:, 0].max(), 0.5]])
            ax.plot(
                outline[[0, 1, 1, 0, 0], 0], outline[[0, 0, 1, 1, 0], 1], color="#BBBBBB", lw=0.6
            )
            deformed = x + DISPLACEMENT_SCALE * u
            ax.add_collection(
                PolyCollection(
                    deformed[cells],
                    facecolor="#D8E8F4",
                    edgecolor=ELEMENT_LOOK[ELEMENT]["color"],
                    lw=0.4,
                    rasterized=True,
                )
            )
        stress = results.scalar(CASE, f"sigma_cr_{mode}")
        ax.set_title(f"mode {mode}: {stress / 1e9:.4f} GPa", loc="left")
        ax.set(aspect="equal", ylabel="$y/h$", xlim=(-0.3, 2 * mirror_x + 0.3), ylim=(-1.25, 1.25))
        ax.grid(visible=False)
    axes[-1].set_xlabel("$x/h$")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Buckling shapes under uniform load by the new element with form G, half models of 16 x 4 "
        "squares and their mirror images; the largest displacement is drawn as "
        f"{DISPLACEMENT_SCALE:g} h."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return "The beam bent into one half wave in mode 1 and into a full sine wave in mode 2."
