"""Rubber below a sticking punch: the deformed block, nodal forces, Newton's corrections."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK, mesh_plot
from study.run.store import Results

SECTION = "V14"
SHOWN = ("galerkin-T6", "pw-T6")
MESH = "V14/punch-pw-T6-4"
NEEDS = [*(f"V14/punch-{element}-8" for element in SHOWN), MESH]


def draw(results: Results) -> Figure:
    """Panels: deformed mesh, forces over their mean along the punch, corrections."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.5), width_ratios=(1.3, 1, 1))
    curves = results.curves(MESH)
    mesh_plot(axes[0], curves["deformed"], curves["cells"], linewidth=0.4)
    axes[0].set(title="(a) deformed block", xlabel="$x$", ylabel="$y$", yticks=(0, 1))
    axes[0].set(xticks=(-1, 0, 1), xlim=(-1.15, 1.25))
    for element in SHOWN:
        curves = results.curves(f"V14/punch-{element}-8")
        axes[1].plot(curves["x"], curves["force"], **LOOK[element] | {"linewidth": 0.8})
        corrections = curves["corrections"]
        axes[2].semilogy(np.arange(1, len(corrections) + 1), corrections, **LOOK[element])
    axes[1].set(title="(b) below the punch", xlabel="$x$", ylim=(0, None))
    axes[1].set_ylabel("nodal force / mean")
    axes[1].legend(loc="lower center", fontsize=6.5)
    axes[2].set(title="(c) Newton's method", xlabel="iteration")
    axes[2].set_ylabel("correction / displacement")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "A neo-Hookean block below a rigid punch that sticks to its upper side where |x| ≤ 0.5 and "
        "moves down by a fifth and sideways by a tenth of its height. (a) Deformed mesh of the new "
        "element, 4 elements over the height. (b) Vertical nodal forces below the punch, 8 "
        "elements. (c) Largest correction of a nodal displacement in each Newton iteration, over "
        "the largest displacement, 8 elements; the two curves coincide."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "A block dented and sheared by a punch. Nodal forces along the punch: the standard "
        "element's jump between two levels, the new one's lie on a smooth curve that rises to both "
        "edges. Corrections fall from 1 to below 1e-10 in six iterations, alike for both."
    )
