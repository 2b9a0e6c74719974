"""Rubber ironed by a cylinder: the deformed block, nodal forces, pressures."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V16"
SHOWN = ("galerkin-T6", "pw-T6")
COARSE, FINE = "V16/cylinder-{}-8", "V16/cylinder-pw-T6-16"
NEEDS = [*(COARSE.format(element) for element in SHOWN), FINE]
TOOL, NOMINAL, LINES = "#8A8A8A", "#B87A00", "#333333"


def draw(results: Results) -> Figure:
    """Panels: deformed mesh, normal forces at the nodes, true and nominal pressure."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.5), width_ratios=(1.25, 1, 1))
    curves = results.curves(COARSE.format("pw-T6"))
    axes[0].add_patch(Circle((0.6, 0.5), 1.0, color=TOOL, alpha=0.35, lw=0))
    x, y = curves["nodes"].T
    axes[0].triplot(x, y, curves["cells"][:, :3], color=LINES, lw=0.35)
    axes[0].set(title="(a) deformed block", xlabel="$x/R$", ylabel="$y/R$")
    axes[0].set(
        xlim=(-2.0, 2.6),
        ylim=(-2.05, 0.9),
        aspect="equal",
        xticks=(-1, 0, 1, 2),
        yticks=(-2, -1, 0),
    )
    for element in SHOWN:
        curves = results.curves(COARSE.format(element))
        touching = _touching(curves["status"])
        look = LOOK[element] | {"linewidth": 0.8, "markersize": 3}
        axes[1].plot(curves["place"][touching, 0], curves["force_n"][touching], **look)
    axes[1].set(title="(b) forces of nodes", xlabel="$x/R$", ylim=(0, None))
    axes[1].set_ylabel("normal force / $GR$")
    axes[1].legend(loc="lower center", fontsize=6.5)
    curves = results.curves(FINE)
    touching = _touching(curves["status"])
    place, true = curves["place"][touching, 0], {"label": "true", "markersize": 2.5}
    axes[2].plot(place, curves["true_pressure"][touching], **LOOK["pw-T6"] | true)
    nominal = curves["nominal_pressure"][touching]
    axes[2].plot(place, nominal, color=NOMINAL, marker="s", ms=2.5, lw=1, label="nominal")
    axes[2].set(title="(c) pressure", xlabel="$x/R$", ylim=(0, None))
    axes[2].set_ylabel("normal force / area / $G$")
    axes[2].legend(loc="lower center", fontsize=6.5)
    return fig


def _touching(status: np.ndarray) -> slice:
    """Nodes in contact, and an open one on either side."""
    closed = np.flatnonzero(status > 0)
    return slice(closed[0] - 1, closed[-1] + 2)


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "A neo-Hookean block (shear modulus G) is pressed by a rough rigid cylinder of radius R to "
        "a depth of R/2, which is then moved to the right by 0.6 R. (a) Deformed mesh of the new "
        "element, 8 elements along R. (b) Normal nodal forces at the end, 8 elements. (c) The new "
        "element's forces over deformed (true) and undeformed (nominal) areas of the weights, 16 "
        "elements."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "A block with a deep round groove below a cylinder. Nodal forces over the groove: the "
        "standard element's jump between two levels, one twice the other; the new one's lie on a "
        "smooth arch. True and nominal pressure are smooth arches, close to each other."
    )
