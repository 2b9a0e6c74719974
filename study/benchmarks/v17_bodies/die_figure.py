"""Figure of the forces of a sliding die."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results


def draw_die(results: Results) -> Figure:
    """Nodal forces on both sides of a sliding die, and its force over the increments."""
    fig, (die_axis, block_axis, force_axis) = plt.subplots(1, 3, figsize=(FULL, 2.4))
    block_axis.sharey(die_axis)
    for element in ("galerkin-T6", "pw-T6"):
        curves = results.curves(f"V17/die-{element}-equal")
        total = curves["force_n"].sum()
        die_axis.plot(curves["x"], 100 * curves["force_n"] / total, **LOOK[element])
        order = np.argsort(curves["master_x"])
        x, force = curves["master_x"][order], curves["master_force"][order]
        block_axis.plot(x, 100 * force / total, **LOOK[element])
        for component, line in (("N", "-"), ("T", "--")):
            look = LOOK[element] | {"linestyle": line, "label": None}
            increments = np.arange(1, len(curves[component]) + 1)
            force_axis.plot(increments, np.abs(curves[component]), **look)
    die_axis.set(title="die (slave)", xlabel="$x$", ylabel="normal nodal force / sum, %")
    block_axis.set(title="block (master)", xlabel="$x$", xlim=(0.2, 1.4))
    force_axis.set(title="N (solid), |T| (dashed)", xlabel="increment", ylim=(0, 0.2))
    force_axis.set_xticks((0, 5, 10, 15, 20))
    force_axis.set_ylabel("force of the die / $(G \\times 1)$")
    fig.legend(*die_axis.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return fig
