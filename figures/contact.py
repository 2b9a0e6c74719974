"""What the figures of contact examples share: stress curves, zones, deformed shapes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from figures.style import FULL, LOOK, MANY
from study.core.store import Results
from study.judge import measures
from study.vocabulary import ELEMENTS, SLIP

# Contact status as the library numbers it
ZONES = {0: ("open", "#FFFFFF"), 1: ("stick", "#4C78A8"), 2: ("slip", "#F2B447")}
SMOOTH = ("frictionless", "#C9C9C9")

RECONSTRUCTED = "Dimensions and loads that the paper does not print are reconstructed."

Curves = dict[str, np.ndarray]


def reported(curves: Curves, quantity: str) -> np.ndarray:
    """Pressure or shear as a node-to-surface code reports it: force over tributary length."""
    return curves[f"{quantity}_tributary"]


def compare(
    ax: Axes,
    results: Results,
    keys: Sequence[str],
    quantity: str,
    scale: float = 1.0,
    hollow: str = "composite",
) -> None:
    """Draws a reported stress of several elements, times a scale, over x.

    One whose element has `hollow` in it nearly coincides with another and gets hollow markers.
    """
    for key in keys:
        curves = results.curves(key)
        element = results[key].parameters["element"]
        look = LOOK[element]
        if hollow in element:
            look = {**look, "markerfacecolor": "none", "markersize": 7, "linewidth": 0.6}
        ax.plot(curves["x"], scale * reported(curves, quantity), **look)


def zone_strip(ax: Axes, curves: Curves, bottom: float = -0.16, height: float = 0.035) -> None:
    """Contact zones as a coloured strip below the axes; bottom and height are axes fractions."""
    x = curves["x"]
    borders = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
    smooth = (curves["friction"] == 0) & (curves["status"] == SLIP)
    colours = [
        SMOOTH[1] if free else ZONES[int(status)][1]
        for status, free in zip(curves["status"], smooth, strict=True)
    ]
    place = 0
    for colour, run in groupby(colours):
        first, place = place, place + len(list(run))
        left, right = borders[first], borders[place]
        ax.axvspan(left, right, bottom, bottom + height, color=colour, clip_on=False, lw=0)


def zone_legend(curves: Curves) -> list[Patch]:
    """Handles of the zones that occur."""
    smooth = (curves["friction"] == 0) & (curves["status"] == SLIP)
    entries = [ZONES[int(s)] for s in np.unique(curves["status"][~smooth])]
    entries += [SMOOTH] if smooth.any() else []
    return [Patch(facecolor=c, edgecolor="#777777", lw=0.5, label=name) for name, c in entries]


def outline(cells: np.ndarray) -> np.ndarray:
    """Nodes of each cell (m, 6, 8 or 9), going round (m, 6 or 8)."""
    around = [0, 5, 1, 3, 2, 4] if cells.shape[1] == 6 else [0, 4, 1, 6, 3, 7, 2, 5]
    return cells[:, around]


def deformed(ax: Axes, curves: Curves, scale: float, element: str) -> np.ndarray:
    """Draws the deformed mesh; returns its nodes."""
    moved = curves["nodes"] + scale * curves["displacement"]
    cells = PolyCollection(
        moved[outline(curves["cells"])],
        facecolor="#EEF3F7",
        edgecolor="#8A97A3",
        lw=0.4,
        rasterized=len(curves["cells"]) > MANY,
    )
    ax.add_collection(cells)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.grid(visible=False)
    ax.set_title(LOOK[element]["label"], loc="left")
    return moved


def force_arrows(
    ax: Axes, curves: Curves, moved: np.ndarray, side: float, length: float, element: str
) -> None:
    """Draws nodal contact forces on the body; `side` is -1 for a surface below, 1 above.

    The largest normal force is drawn with the given length.
    """
    line = np.column_stack([curves["x"], curves["y"]])
    distance = np.linalg.norm(curves["nodes"][:, None] - line, axis=2)
    nodes = distance.argmin(axis=0)
    scale = length / curves["force_n"].max()
    for node, r_n, r_t in zip(nodes, curves["force_n"], curves["force_t"], strict=True):
        if r_n < 1e-9 * curves["force_n"].max():
            continue  # open
        force = scale * np.array([-r_t, -side * r_n])
        style = {"arrowstyle": "-|>", "lw": 0.8, "color": LOOK[element]["color"]}
        style |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
        ax.annotate("", moved[node], moved[node] - force, arrowprops=style)


@dataclass(frozen=True)
class BlockStresses:
    """A figure of the paper: stresses below the block of section 7.2.

    Args:
        cells: what the elements are, in a word.
        elements: the standard one, the new one, and another.
    """

    cells: str
    elements: tuple[str, str, str]

    @property
    def needs(self) -> list[str]:
        """Keys of the results."""
        return [f"7.2/{element}" for element in self.elements]

    def draw(self, results: Results) -> Figure:
        """Normal and shear stress over x; the strips below are the new element's zones."""
        fig, axes = plt.subplots(1, 2, figsize=(FULL, 3.2))
        zones = results.curves(self.needs[1])
        for ax, quantity in zip(axes, ("pressure", "shear"), strict=True):
            compare(ax, results, self.needs, quantity, 1 / measures.BLOCK_PRESSURE)
            zone_strip(ax, zones, bottom=-0.3)
            ax.set(xlabel="$x$", xlim=(0, 4))
        axes[0].set(ylabel="normal pressure / applied pressure", ylim=(0, None))
        axes[1].set_ylabel("shear stress / applied pressure")
        axes[1].legend(fontsize=7)
        fig.legend(handles=zone_legend(zones), loc="outside lower center", ncols=3)
        return fig

    def caption(self, results: Results) -> str:
        """What the figure shows."""
        saw = ", ".join(
            f"{ELEMENTS[element].name} {results.scalar(key, 'sawtooth'):.3f}"
            for element, key in zip(self.elements, self.needs, strict=True)
        )
        return (
            f"Stresses along the contact area, {self.cells}: nodal force over tributary length, as "
            "a node-to-surface code reports it. Mid-side over corner force of the normal forces: "
            f"{saw}. Strips: zones of the {ELEMENTS[self.elements[1]].name}. {RECONSTRUCTED}"
        )

    def alt(self, results: Results) -> str:
        """The figure in words."""
        stick = results.scalar(self.needs[1], "stick_to")
        return (
            "Curves of normal and shear stress over the contact line. Those of the standard "
            "element form a sawtooth around the smooth curves of the others; sticking up to "
            f"x = {stick:.3f}, slip on the right."
        )


@dataclass(frozen=True)
class PlateReactions:
    """A figure of the paper: nodal forces below the plate of section 7.4.

    Args:
        element: whose.
    """

    element: str

    @property
    def needs(self) -> list[str]:
        """Keys of the results."""
        return [f"7.4/{self.element}"]

    def draw(self, results: Results) -> Figure:
        """Normal nodal forces as bars."""
        curves = results.curves(self.needs[0])
        fig, ax = plt.subplots(figsize=(FULL, 2.4))
        ax.bar(curves["x"], curves["force_n"], 0.05, color=LOOK[self.element]["color"])
        ax.set(xlabel="$x/b$", ylabel="normal reaction / kN", ylim=(0, 6))
        ax.grid(visible=False, axis="x")
        return fig

    def caption(self, results: Results) -> str:
        """What the figure shows."""
        ratio = results.scalar(self.needs[0], "sawtooth")
        total = results.scalar(self.needs[0], "force_normal")
        return (
            f"Normal nodal forces below the plate with {self.element}; their sum is {total:.6g} "
            f"kN, the median of a mid-side force over its corner neighbours' mean {ratio:.3f}. "
            f"{RECONSTRUCTED}"
        )

    def alt(self, results: Results) -> str:
        """The figure in words."""
        forces = ", ".join(f"{f:.2f}" for f in results.curves(self.needs[0])["force_n"])
        return f"Bars over x, from edge to edge in kN: {forces}."
