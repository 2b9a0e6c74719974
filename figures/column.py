"""What the figures of the stepped column share: stresses along its four surfaces, its outline."""

from dataclasses import dataclass
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.contact import Curves, reported, zone_legend, zone_strip
from figures.style import FULL, LOOK
from study.core.store import Results

FAMILIES = (("galerkin-T6", "pw-T6", "composite-T6"), ("galerkin-Q8", "pw-Q8", "pw-Q9"))
FINE = "7.5/pw-T6-fine"
NEEDS = [*(f"7.5/{element}" for family in FAMILIES for element in family), FINE]
SURFACES = (1, 2, 3, 4)
NAMES = {1: "the base", 2: "the lower shoulder", 3: "the upper shoulder", 4: "the top"}
MM = 1e3
SYNTHETIC = (
    "Synthetic column and supports: the paper's section is lost, its curves with it. E in kN/m² "
    "as printed."
)


def surface(curves: Curves, number: int) -> Curves:
    """Curves along one contact surface, and those of the whole body."""
    end = f"_{number}"
    own = {name.removesuffix(end): curve for name, curve in curves.items() if name.endswith(end)}
    return own | {name: curves[name] for name in ("nodes", "cells", "displacement")}


def outline(curves: Curves) -> np.ndarray:
    """Corners (m, 2) of the section, from the axis at the base round to the axis at the top."""
    (base, lower, upper, top) = (surface(curves, k) for k in SURFACES)
    corners = [(0.0, base["y"][0])]
    for face in (base, lower, upper):
        corners += [(face["x"][0], face["y"][0]), (face["x"][-1], face["y"][0])]
    nodes = curves["nodes"]
    widest = np.isclose(nodes[:, 0], nodes[:, 0].max())
    shoulder = nodes[widest, 1].max()
    corners += [(nodes[:, 0].max(), shoulder), (top["x"][-1], shoulder)]
    corners += [(top["x"][-1], top["y"][0]), (0.0, top["y"][0])]
    return np.array(corners)


@dataclass(frozen=True)
class Along:
    """A figure of the paper: one stress along one contact surface, all elements.

    Above the raw nodal forces, below the stress as a node-to-surface code reports it.

    Args:
        surface: its number.
        quantity: "pressure" or "shear".
    """

    surface: int
    quantity: Literal["pressure", "shear"]

    def draw(self, results: Results) -> Figure:
        """Triangles left, quadrilaterals right."""
        fig, axes = plt.subplots(2, 2, figsize=(FULL, 4.1), sharex=True, sharey="row")
        fine = surface(results.curves(FINE), self.surface)
        for (force, stress), family in zip(axes.T, FAMILIES, strict=True):
            fine_stress = fine[self.quantity] / 1e3
            label = "new T6, mesh halved"
            stress.plot(MM * fine["x"], fine_stress, color="black", lw=0.9, label=label)
            for element in family:
                curves = surface(results.curves(f"7.5/{element}"), self.surface)
                look = LOOK[element]
                if element == family[-1]:  # nearly coincides with the new element
                    look = {**look, "markerfacecolor": "none", "markersize": 7, "linewidth": 0.6}
                x = MM * curves["x"]
                force.plot(x, curves[self._component], **look)
                stress.plot(x, reported(curves, self.quantity) / 1e3, **look)
            force.legend(fontsize=7)
            stress.set_xlabel("$r$ / mm")
            zone_strip_mm(stress, surface(results.curves(f"7.5/{family[1]}"), self.surface))
        low, high = axes[0, 0].get_ylim()
        axes[0, 0].set_ylim(low, high + 0.3 * (high - low))  # room for the legends
        axes[1, 0].legend(handles=axes[1, 0].lines[:1], fontsize=7)
        words = {"pressure": "normal", "shear": "tangential"}[self.quantity]
        axes[0, 0].set_ylabel(f"{words} force / kN")
        stress_words = {"pressure": "normal pressure", "shear": "shear stress"}[self.quantity]
        axes[1, 0].set_ylabel(f"{stress_words} / (MN/m²)")
        zones = surface(results.curves("7.5/pw-T6"), self.surface)
        fig.legend(handles=zone_legend(zones), loc="outside lower center", ncols=3)
        return fig

    @property
    def _component(self) -> str:
        return {"pressure": "force_n", "shear": "force_t"}[self.quantity]

    def caption(self, results: Results) -> str:
        """What the figure shows."""
        words = {"pressure": "Normal", "shear": "Tangential"}[self.quantity]
        text = (
            f"{words} nodal forces (of the whole circumference) and stresses along contact "
            f"surface {self.surface}, {NAMES[self.surface]}; stress is force over tributary area."
        )
        if self.quantity == "pressure":
            saw = ", ".join(
                f"{e} {results.scalar(f'7.5/{e}', f'sawtooth_{self.surface}'):.3f}"
                for family in FAMILIES
                for e in family
            )
            text += f" Mid-side over corner force: {saw}."
        return f"{text} Strips: contact zones of the new T6 and the new Q8. {SYNTHETIC}"

    def alt(self, results: Results) -> str:
        """The figure in words."""
        words = {"pressure": "normal", "shear": "tangential"}[self.quantity]
        total = {"pressure": "force_normal", "shear": "force_tangential"}[self.quantity]
        force = results.scalar("7.5/pw-T6", f"{total}_{self.surface}")
        return (
            f"Curves of {words} nodal force and stress over the radius. Those of the standard "
            "elements form a sawtooth around the smooth curves of the piecewise-linear ones, which "
            f"follow the finer mesh's and rise to the edge; the forces' sum is {force:.0f} kN."
        )


def zone_strip_mm(ax: Axes, curves: Curves) -> None:
    """Contact zones of curves over a radius in mm."""
    zone_strip(ax, {**curves, "x": MM * curves["x"]}, bottom=-0.42)
