"""Two deformable bodies: nodal forces on both of them."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.model.vocabulary import WAYS
from study.publish.plots.style import FULL, WAY_LOOK
from study.run.store import Results

SECTION = "V11"
SHOWN = ("pw-dual", "p2-dual", "p2-p1", "node-to-segment")
NEEDS = [f"V11/hertz-2d-{way}-8" for way in SHOWN]


def draw(results: Results) -> Figure:
    """A panel for each way: the slave's forces upwards, the master's downwards."""
    fig, axes = plt.subplots(1, 4, figsize=(FULL, 2.6), sharex=True, sharey=True)
    for ax, way in zip(axes, SHOWN, strict=True):
        curves = results.curves(f"V11/hertz-2d-{way}-8")
        scale = np.abs(curves["opposite_force"]).max()
        for x, force, filled in (
            (curves["x"], -curves["force"], True),
            (curves["opposite_x"], -curves["opposite_force"], False),
        ):
            order = np.argsort(x[:, 0])
            near = order[x[order, 0] < 1.4]
            look = WAY_LOOK[way] | {"markersize": 3, "linewidth": 0.7, "label": None}
            face = look["color"] if filled else "white"
            ax.plot(x[near, 0], force[near] / scale, **look, markerfacecolor=face)
        ax.axhline(0, color="black", linewidth=0.6)
        ax.set(xlabel="$x/a$", xlim=(-0.04, 1.3))
        ax.set_title(WAYS[way].name.replace(", ", ",\n"), fontsize=8)
    axes[0].set_ylabel("nodal force / the master's largest")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Two cylinders, eight edges over the half width a: nodal contact forces on the slave "
        "(filled, upwards) and on the master (open, downwards). The node at x = 0 has only half of "
        "its edges in the model. With standard test functions mid-side nodes of both bodies carry "
        "twice the force of vertices; with the new weights the forces follow the pressure on both."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Four plots of nodal forces over x. In the first the filled points above and the open "
        "points below zero lie on smooth curves; in the other three both zigzag by a factor of two."
    )
