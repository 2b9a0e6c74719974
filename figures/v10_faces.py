"""Errors of pressures on the face below a rigid sphere."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from study.model.vocabulary import ELEMENTS, NO_WEIGHT, OWN
from study.publish.plots.style import FULL
from study.run.store import Results

SECTION = "V10"
SHOWN = ("galerkin-T10", "transferred-T10", "sibling-T10", "pw-T10", "galerkin-H27", "pw-H27")
NEEDS = [f"V10/sphere-{element}-5" for element in SHOWN]
INNER = 0.8  # within which errors are stated
LARGEST = 2.0  # of the colours, in % of p0
COLOURS: dict[str, Any] = {"norm": plt.Normalize(-LARGEST, LARGEST), "cmap": "RdBu_r"}


def draw(results: Results) -> Figure:
    """One panel for each element, a quarter of the contact each."""
    fig, axes = plt.subplots(2, 3, figsize=(FULL, 4.0), sharex=True, sharey=True)
    for ax, element in zip(axes.flat, SHOWN, strict=True):
        curves = results.curves(f"V10/sphere-{element}-5")
        error = 100 * (curves["pressure"] - curves["exact_pressure"])
        _face(ax, curves["x"], error)
        ax.set_title(ELEMENTS[element].name)
    for ax in axes[1]:
        ax.set_xlabel("$x/a$")
    for ax in axes[:, 0]:
        ax.set_ylabel("$y/a$")
    label = f"error of the {OWN.name} pressure, % of $p_0$"
    fig.colorbar(ScalarMappable(**COLOURS), ax=axes, label=label, shrink=0.8, extend="both")
    return fig


def _face(ax: Axes, x: np.ndarray, error: np.ndarray) -> None:
    """The nodes of the contact, those without a pressure as crosses."""
    near = np.hypot(*x[:, :2].T) < 1
    known = near & np.isfinite(error)
    ax.scatter(x[known, 0], x[known, 1], s=22, c=error[known], ec="#777777", lw=0.4, **COLOURS)
    none = x[near & ~known]
    ax.scatter(none[:, 0], none[:, 1], s=12, marker="x", color="black", lw=0.8)
    angle = np.linspace(0, np.pi / 2, 101)
    for radius, line in ((1.0, ":"), (INNER, "--")):
        ax.plot(radius * np.cos(angle), radius * np.sin(angle), line, color="black", lw=0.7)
    ax.set(aspect="equal", xlim=(-0.05, 1.05), ylim=(-0.05, 1.05))
    ax.grid(visible=False)


def caption(results: Results) -> str:
    """What the figure shows."""
    weightless = results.scalar("V10/sphere-galerkin-T10-5", "weightless_nodes")
    nodes = results.scalar("V10/sphere-galerkin-T10-5", "nodes")
    return (
        "Errors of the pressure at the nodes in a quarter of the contact of a rigid sphere with a "
        f"half space, five elements over the radius a (dotted). The pressure is the {OWN.meaning}, "
        f"with {NO_WEIGHT}. Crosses are such nodes: {weightless:.0f} of the {nodes:.0f} with "
        "r < 0.8 a (dashed)."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Six quarter discs of nodes, pale inside and coloured towards the edge of the contact, "
        "where errors are largest. The standard tetrahedron's has crosses at all corners of its "
        "elements; the new hexahedron's is the palest."
    )
