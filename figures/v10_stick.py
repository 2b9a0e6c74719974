"""Which nodes of two spheres in partial slip stick."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.model.vocabulary import ELEMENTS, NO_WEIGHT, OPEN, OWN, SLIP, STATUS, STICK
from study.publish.plots.style import FULL
from study.run.store import Results

SECTION = "V10"
SHOWN = ("galerkin-T10", "sibling-T10", "pw-T10")
CASE = "V10/mindlin-{}-3"
NEEDS = [CASE.format(element) for element in SHOWN]
COLOURS = {STICK: "#0072B2", SLIP: "#E8A33D", OPEN: "#777777"}


def draw(results: Results) -> Figure:
    """One panel for each element, half of the contact each."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.2), sharex=True, sharey=True)
    angle = np.linspace(0, np.pi, 201)
    for ax, element in zip(axes, SHOWN, strict=True):
        curves = results.curves(CASE.format(element))
        x, y, _ = curves["x"].T
        known = np.isfinite(curves["pressure"])
        for status, colour in COLOURS.items():
            of = (curves["status"] == status) & (np.hypot(x, y) < 1)
            ax.plot(x[of & known], y[of & known], "o", ms=3.4, color=colour, label=STATUS[status])
            ax.plot(x[of & ~known], y[of & ~known], "x", ms=3.0, color=colour)
        for radius, line in ((1.0, ":"), (np.cbrt(0.5), "-")):
            ax.plot(radius * np.cos(angle), radius * np.sin(angle), line, color="black", lw=0.8)
        radius = results.scalar(CASE.format(element), "stick_radius")
        ax.set_title(f"{ELEMENTS[element].name}: {radius:.3f}", fontsize=8)
        ax.set(aspect="equal", xlim=(-1.1, 1.1), ylim=(-0.06, 1.1), xlabel="$x/a$")
        ax.grid(visible=False)
    axes[0].set_ylabel("$y/a$")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "What the nodes do in one half of the contact of two equal spheres in partial slip, three "
        "elements over the radius a (dotted), ν = 0; the solid line is the border of Mindlin's "
        f"stick zone. A traction is the {OWN.meaning}, with {NO_WEIGHT} (crosses). Above, the "
        "stick radius over the exact one. It is where the friction that is left, (μ p − |t|)², "
        "vanishes along a line fitted over r² through the sticking nodes; in Mindlin's "
        "solution it is such a line."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Three half discs of nodes. In each, the nodes that stick fill the exact half circle to "
        "within half an element; those around them slip. In the standard element's some of the "
        "corners inside the half circle slip or are open."
    )
