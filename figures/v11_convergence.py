"""Two deformable bodies: errors over the mesh, least master forces over the ratio of edges."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.model.vocabulary import WAYS
from study.publish.plots.style import FULL, WAY_LOOK
from study.run.store import Results

SECTION = "V11"
LEVELS = (4, 8, 16)
RATIOS = (0.5, 1.0, 2.0)
NEEDS = [f"V11/hertz-2d-{way}-{n}" for way in WAYS for n in LEVELS]
NEEDS += [f"V11/hertz-2d-{way}-16-ratio{ratio}" for way in WAYS for ratio in RATIOS]


def draw(results: Results) -> Figure:
    """Panels: L2 error, largest inner error, least force."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.9))
    names = {
        "pressure_l2": "(a) pressure, L2 error",
        "pressure_error": "(b) largest error, $x < 0.8\\,a$",
    }
    for ax, (name, title) in zip(axes, names.items(), strict=False):
        for way in WAYS:
            errors = [results.scalar(f"V11/hertz-2d-{way}-{n}", name) for n in LEVELS]
            ax.plot(LEVELS, errors, **WAY_LOOK[way])
        ax.set(xscale="log", yscale="log", xlabel="edges over half width")
        ax.set_title(title, fontsize=8)
        ax.set_xticks(LEVELS, [str(n) for n in LEVELS], minor=False)
        ax.minorticks_off()
    axes[0].set_ylabel("relative error")
    for way in WAYS:
        least = [
            results.scalar(f"V11/hertz-2d-{way}-16-ratio{ratio}", "master_force_least")
            for ratio in RATIOS
        ]
        axes[2].plot(RATIOS, least, **WAY_LOOK[way])
    axes[2].set(xscale="log", xlabel="slave's edge over master's")
    axes[2].set_xticks(RATIOS, ["1/2", "1", "2"], minor=False)
    axes[2].minorticks_off()
    axes[2].set_title("(c) ratio of the meshes", fontsize=8)
    axes[2].set_ylabel("least master force / mean")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Two cylinders, E₂/E₁ = 3. (a), (b) Errors of the pressure over the slave's mesh. (c) The "
        "least of the master's nodal forces, over their mean where x < 0.8 a, for three ratios of "
        "edges (16 to the half width on the slave). Forces below zero are tensile, next to the "
        "edge of contact, where neighbouring pressures differ by more than a factor of two."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two log-log plots of errors that fall, those of both new ways lowest in the first; and a "
        "plot of least forces, all between zero and a few percent below."
    )
