"""A seal at large strains: the squeezed cord, pressures along the plate, the force."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V15"
SHOWN = ("galerkin-hybrid-T6", "pw-hybrid-T6")
CASE = "V15/seal-{}-8"
NEEDS = [CASE.format(element) for element in SHOWN]
# A 6-node triangle's four
_PARTS = [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]]


def draw(results: Results) -> Figure:
    """Panels: the deformed cord and its pressure, nodal forces, force over squeeze."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.7), width_ratios=(1.25, 1, 1))
    curves = results.curves(NEEDS[1])
    x, y = curves["deformed"].T
    parts = curves["cells"][:, _PARTS].reshape(-1, 3)
    colours = axes[0].tripcolor(
        Triangulation(x, y, parts),
        curves["body_pressure"],
        shading="gouraud",
        cmap="viridis",
        rasterized=True,
    )
    fig.colorbar(colours, ax=axes[0], shrink=0.7, label="pressure / $\\mu$")
    for side in (-1, 1):
        axes[0].axhline(side * np.abs(y).max(), color="black", linewidth=1.2)
    axes[0].set(title="(a) squeezed cord", aspect="equal", xlabel="$r$", yticks=(-0.75, 0, 0.75))
    axes[0].grid(visible=False)
    for element in SHOWN:
        curves = results.curves(CASE.format(element))
        look = LOOK[element] | {"linewidth": 0.7, "markersize": 4}
        axes[1].plot(curves["x"], curves["nodal_force"], **look)
        axes[2].plot(curves["squeeze"], curves["force"], **(look | {"linestyle": "none"}))
    axes[1].set(title="(b) nodal force / mean", xlabel="$r$", ylim=(0, None))
    axes[1].legend(loc="lower center", fontsize=6.5)
    C = np.linspace(0, curves["squeeze"][-1], 101)
    lindley = 1.25 * C**1.5 + 50 * C**6
    axes[2].plot(C, lindley, color="black", linewidth=0.9, label="Lindley")
    axes[2].set(title="(c) force / ($E d$ length)", xlabel="squeeze / $d$", ylim=(0, None))
    axes[2].legend(loc="upper left", fontsize=6.5, handles=axes[2].lines[-1:])
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "An O-ring of incompressible neo-Hookean rubber (mean radius 8 times the cord's) squeezed "
        "by a quarter of its cord between two smooth plates, at large strains. (a) The deformed "
        "cord and the pressure in it over the shear modulus μ (new hybrid T6, cells of 1/8 of the "
        "cord's radius). (b) Nodal forces of the upper plate. (c) The force over E, the cord's "
        "diameter d and its length, and Lindley's formula for long cords."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "A circle flattened above and below, its pressure highest in the middle and at both "
        "plates. Nodal forces of the standard weights jump between two levels, those of the new "
        "ones lie on a smooth arch. The force grows with the squeeze and meets Lindley's curve "
        "from 15 per cent on."
    )
