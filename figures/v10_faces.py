"""Pressures on the face below a rigid sphere, nodal forces over areas."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from figures.style import FULL
from study.core.store import Results
from study.vocabulary import ELEMENTS

SECTION = "V10"
SHOWN = ("galerkin-T10", "transferred-T10", "sibling-T10", "pw-T10", "galerkin-H27", "pw-H27")
NEEDS = [f"V10/sphere-{element}-5" for element in SHOWN]
LARGEST = 1.4  # of the colours, over p0


def draw(results: Results) -> Figure:
    """One panel for each element, a quarter of the contact each."""
    fig, axes = plt.subplots(2, 3, figsize=(FULL, 4.0), sharex=True, sharey=True)
    for ax, element in zip(axes.flat, SHOWN, strict=True):
        curves = results.curves(f"V10/sphere-{element}-5")
        _face(ax, curves["x"], curves["pressure_tributary"])
        ax.set_title(ELEMENTS[element].name)
    for ax in axes[1]:
        ax.set_xlabel("$x/a$")
    for ax in axes[:, 0]:
        ax.set_ylabel("$y/a$")
    colours = ScalarMappable(plt.Normalize(0, LARGEST))
    fig.colorbar(colours, ax=axes, label="nodal force / tributary area / $p_0$", shrink=0.8)
    return fig


def _face(ax: Axes, x: np.ndarray, pressure: np.ndarray) -> None:
    """Colours between the nodes, and the nodes themselves."""
    face, colours = Triangulation(x[:, 0], x[:, 1]), plt.Normalize(0, LARGEST)
    ax.tripcolor(face, pressure, shading="gouraud", rasterized=True, norm=colours)
    nodes = ax.scatter(x[:, 0], x[:, 1], s=7, c=pressure, ec="white", lw=0.3, norm=colours)
    nodes.set_rasterized(True)
    angle = np.linspace(0, np.pi / 2, 101)
    ax.plot(np.cos(angle), np.sin(angle), color="white", linestyle="--", linewidth=0.8)
    ax.set(aspect="equal", xlim=(-0.03, x[:, 0].max() + 0.03), ylim=(-0.03, x[:, 1].max() + 0.03))
    ax.grid(visible=False)


def caption(results: Results) -> str:
    """What the figure shows."""
    weightless = results.scalar("V10/sphere-galerkin-T10-5", "weightless_nodes")
    nodes = results.scalar("V10/sphere-galerkin-T10-5", "nodes")
    return (
        "Tributary pressures, as node-to-surface codes report them, in a quarter of the contact "
        "of a rigid sphere with a half space, five elements over the radius a (dashed). On faces "
        "of standard tetrahedra corners carry next to nothing (at "
        f"{weightless:.0f} of the {nodes:.0f} nodes with r < 0.8 a the integral of the shape "
        "function is zero) and mid-side nodes four thirds of the pressure; standard hexahedra are "
        "uneven, too; the other four show Hertz's pressure."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Six colour maps of a quarter disc. The standard tetrahedron's is a dotted pattern of "
        "dark and bright nodes; the standard hexahedron's is chequered; the other four fall "
        "smoothly from the middle to the edge."
    )
