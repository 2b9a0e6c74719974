"""Contact in space, pressure and shear over the distance from the axis."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V10"
SHOWN = ("galerkin-T10", "sibling-T10", "pw-T10")
SPHERE, PUNCH, MINDLIN = "sphere-{}-5", "punch-{}-4", "mindlin-{}-3"
OF = {SPHERE: (*SHOWN, "pw-H27"), PUNCH: SHOWN, MINDLIN: SHOWN}
NEEDS = [f"V10/{name.format(element)}" for name in OF for element in OF[name]]


def draw(results: Results) -> Figure:
    """Panels: sphere, flat punch, shear of partial slip; a marker for each node with weight."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.5))
    panels = ((SPHERE, "pressure", "(a) rigid sphere"), (PUNCH, "pressure", "(b) rigid flat punch"))
    for ax, (name, quantity, title) in zip(
        axes, (*panels, (MINDLIN, "shear", "(c) partial slip, shear")), strict=True
    ):
        for element in OF[name]:
            curves = results.curves("V10/" + name.format(element))
            r = np.hypot(*curves["x"][:, :2].T)
            look = LOOK[element] | {"linestyle": "none", "markersize": 2.5, "zorder": 2}
            ax.plot(r, curves[quantity], **look)
        ax.set(title=title, xlabel="$r/a$", xlim=(0, 1.15))
    s = np.linspace(0, 1, 401)[:-1]
    stick = np.cbrt(0.5)
    slip = np.sqrt(1 - s**2) - stick * np.sqrt(np.maximum(0, 1 - (s / stick) ** 2))
    for ax, exact in zip(
        axes, (np.sqrt(1 - s**2), 1 / np.sqrt(1 - s**2) / 3, 0.4 * slip), strict=True
    ):
        ax.plot(s, exact, **(LOOK["exact"] | {"linewidth": 0.9, "zorder": 3}))
    axes[0].set(ylabel="traction / $p_0$ of the sphere", ylim=(0, 1.1))
    axes[1].set(ylim=(0, 1.4))
    axes[2].set(ylim=(0, 0.3))
    axes[0].legend(loc="lower left", fontsize=6.5)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Own-function tractions over the distance from the axis, at all nodes whose integral is "
        "not zero: (a) below a rigid sphere, five elements over the radius a; (b) below a rigid "
        "flat punch, four elements, smaller towards its edge; (c) shear between two equal spheres "
        "in partial slip, three elements, ν = 0. Lines are exact; the kink in (c) is the border of "
        "the sticking disc."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Three plots of traction over radius; the nodes of all elements lie along the exact "
        "curves: half an ellipse, a curve that rises to infinity, and one that rises, has a "
        "corner and falls to zero."
    )
