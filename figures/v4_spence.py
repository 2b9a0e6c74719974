"""Flat punch with friction: stresses, and how much of the friction is used."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.model.vocabulary import OWN
from study.publish.plots.style import FULL, LOOK
from study.publish.plots.zones import zone_legend, zone_strip
from study.run.store import Results

SECTION = "V4"
ELEMENTS = ("galerkin-T6", "pw-T6")
LEFT = [f"V4/{element}-nu0.25-20.0deg-32" for element in ELEMENTS]
RIGHT = [
    "V4/pw-T6-nu0.25-20.0deg-64",
    "V4/pw-T6-nu0.20-20.0deg-64",
    "V4/pw-T6-nu0.30-16.7deg-64",
    "V4/pw-T6-nu0.00-31.0deg-64",
]
NEEDS = LEFT + RIGHT
HOLLOW = {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.6}  # the new one on the other
STYLES = ("-", "--", "-.", ":")


def draw(results: Results) -> Figure:
    """Panels: stresses, used friction of four materials."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(FULL, 3.3))
    for key, element in zip(LEFT, ELEMENTS, strict=True):
        curves = results.curves(key)
        mean = results.scalar(key, "peak_pressure") / results.scalar(key, "peak_over_mean")
        for quantity, line in (("pressure", "-"), ("shear", ":")):
            look = {**LOOK[element], "linestyle": line, "markersize": 2.5}
            look["label"] = f"{look['label']}: {quantity}"
            look |= HOLLOW if element == "pw-T6" else {}
            left.plot(curves["x"], np.abs(curves[quantity]) / mean, **look)
    left.set(title=f"(a) {OWN.name} stresses", xlabel="$x/b$", xlim=(0, 1.0), ylim=(0, 3.4))
    left.set_ylabel("stress / mean pressure")
    left.legend(loc="upper left", fontsize=7)
    zone_strip(left, curves)
    color = LOOK["pw-T6"]["color"]
    for key, line in zip(RIGHT, STYLES, strict=True):
        stored = results[key]
        curves, parameters = stored.curves, stored.parameters
        used = np.abs(curves["force_t"]) / (curves["friction"] * curves["force_n"])
        angle = np.rad2deg(np.arctan(parameters["friction"]))
        label = f"ν = {parameters['poissons_ratio']:.2f}, friction angle {angle:.1f}°"
        right.plot(curves["x"], used, color=color, lw=1.2, ls=line, label=label)
        right.plot([stored.scalars["stick_known"]] * 2, [0.9, 1.1], color="black", lw=1.0)
    right.set(title="(b) friction used, new T6", xlabel="$x/b$", xlim=(0, 1.0), ylim=(0, 1.75))
    right.set_ylabel("shear / ($\\mu$ pressure)")
    right.set_yticks([0, 0.25, 0.5, 0.75, 1.0])
    right.legend(loc="upper left", fontsize=7)
    fig.legend(handles=zone_legend(results.curves(LEFT[1])), loc="outside lower left", ncols=2)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    radii = "; ".join(
        f"{results.scalar(key, 'stick'):.3f} ({results.scalar(key, 'stick_known'):.3f})"
        for key in RIGHT
    )
    return (
        f"One half of a flat punch of half width b. (a) {OWN.name.capitalize()} stresses, "
        "ν = 0.25, friction angle 20°, 32 elements below the half; strip: contact zones of the new "
        "triangle; the singularity at the edge is cut off. (b) Shear over the largest possible "
        "one, new triangle, 64 elements; black ticks: stick radii by a boundary-element program "
        "of this study, to ± 0.003. Computed stick radii (by that program) in "
        f"the order of the legend: {radii}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Pressure and shear grow towards the punch's edge, alike for both elements. Four curves "
        "of used friction rise from zero to one, which each reaches at its black tick, and stay "
        "there."
    )
