"""Partial slip: pressure and shear, and the zone that sticks."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.model.vocabulary import OWN
from study.publish.plots.style import BESIDE, LOOK
from study.publish.plots.zones import zone_legend, zone_strip
from study.run.store import Results

SECTION = "V5"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"V5/{element}-20" for element in ELEMENTS]
HOLLOW = {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.6}  # the new one on the other


def draw(results: Results) -> Figure:
    """Both stresses of both elements, over the exact ones."""
    fig, ax = plt.subplots(figsize=(BESIDE, 3.2))
    for key, element in zip(NEEDS, ELEMENTS, strict=True):
        curves, peak = results.curves(key), results.scalar(key, "peak_known")
        for quantity, line in (("pressure", "-"), ("shear", ":")):
            look = {**LOOK[element], "linestyle": line, "markersize": 3}
            look["label"] = f"{look['label']}: {quantity}"
            look |= HOLLOW if element == "pw-T6" else {}
            scale = peak if quantity == "pressure" else results.scalar(key, "friction") * peak
            ax.plot(curves["x"], curves[quantity] / scale, **look)
    x = np.linspace(-1, 1, 801)
    stick = results.scalar(key, "stick_known")
    pressure = np.sqrt(1 - x**2)
    shear = pressure - stick * np.sqrt(np.maximum(0, 1 - (x / stick) ** 2))
    for exact in (pressure, shear):
        label = "exact" if exact is shear else None
        ax.plot(x, exact, color="black", linewidth=0.8, label=label, zorder=3)
    ax.set(xlabel="$x/a$", ylabel="$p/p_0$ and $q/(\\mu p_0)$", xlim=(-1.25, 1.25), ylim=(0, 1.1))
    zone_strip(ax, curves)
    handles = [*ax.get_legend_handles_labels()[0], *zone_legend(curves)]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    scalars = results[NEEDS[1]].scalars
    return (
        f"{OWN.name.capitalize()} pressure p and shear q between two equal cylinders, pressed "
        "together and then pulled by half of what friction can hold, 16 elements over the half "
        f"width a. Strip: contact zones of the new triangle; it sticks for |x| < "
        f"{scalars['stick']:.3f} a, by Cattaneo and Mindlin for |x| < "
        f"{scalars['stick_known']:.4f} a."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Pressure and shear over x: a semi-ellipse, and below it the shear with peaks at both "
        "ends of the sticking zone. Both elements lie on the exact curves."
    )
