"""Partial slip: pressure and shear by two measures, and the zone that sticks."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.contact import zone_legend, zone_strip
from figures.style import FULL, LOOK
from study.core.store import Results

SECTION = "V5"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"V5/{element}-20" for element in ELEMENTS]
MEASURES = {"": "(a) own-function", "_tributary": "(b) tributary"}


def draw(results: Results) -> Figure:
    """Columns: measures."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 3.2), sharey=True)
    for ax, (suffix, title) in zip(axes, MEASURES.items(), strict=True):
        for key, element in zip(NEEDS, ELEMENTS, strict=True):
            curves, peak = results.curves(key), results.scalar(key, "peak_known")
            for quantity, line in (("pressure", "-"), ("shear", ":")):
                look = {**LOOK[element], "linestyle": line, "markersize": 3}
                look["label"] = f"{look['label']}: {quantity}"
                scale = peak if quantity == "pressure" else results.scalar(key, "friction") * peak
                ax.plot(curves["x"], curves[quantity + suffix] / scale, **look)
        x = np.linspace(-1, 1, 801)
        stick = results.scalar(key, "stick_known")
        pressure = np.sqrt(1 - x**2)
        shear = pressure - stick * np.sqrt(np.maximum(0, 1 - (x / stick) ** 2))
        for exact in (pressure, shear):
            label = "exact" if exact is shear else None
            ax.plot(x, exact, color="black", linewidth=0.8, label=label, zorder=3)
        ax.set(title=title, xlabel="$x/a$", xlim=(-1.25, 1.25))
        zone_strip(ax, curves)
    axes[0].set(ylabel="$p/p_0$ and $q/(\\mu p_0)$", ylim=(0, 1.45))
    handles, labels = axes[0].get_legend_handles_labels()
    zones = zone_legend(curves)
    fig.legend(
        handles + zones,
        labels + [str(zone.get_label()) for zone in zones],
        loc="outside lower center",
        ncols=4,
    )
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    scalars = results[NEEDS[1]].scalars
    return (
        "Pressure p and shear q between two equal cylinders, pressed together and then pulled by "
        "half of what friction can hold, 16 elements over the half width a: (a) own-function "
        "stresses, (b) tributary stresses. Strips: contact zones of the new triangle; it sticks "
        f"for |x| < {scalars['stick']:.3f} a, by Cattaneo and Mindlin for |x| < "
        f"{scalars['stick_known']:.4f} a."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two plots of pressure and shear over x: a semi-ellipse, and below it the shear with "
        "peaks at both ends of the sticking zone. In the first both elements lie on the exact "
        "curves, in the second the standard element alternates around them."
    )
