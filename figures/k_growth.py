"""Growth of contact's cost with the unknowns: rigid surface, two bodies, rubber, loose pieces."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, plain_ticks
from study.run.store import Results

SECTION = "K"
# Task, element and sizes, by what they are called; markers and colours are those of no element
KINDS = {
    "rigid surface": ("contact-pw-T10", (8, 11, 16, 27), "#0072B2", "o"),
    "two bodies": ("bodies-pw-T10", (7, 10, 14, 20), "#D55E00", "s"),
    "with a pressure, ν = 1/2": ("contact-pw-hybrid-T10", (8, 11, 16, 22), "#009E73", "^"),
    "loose pieces": ("pieces-pw-T10", (10, 25, 50, 100), "#444444", "D"),
}
KEYS = {
    label: [f"K/{task}-{size}-Iterative" for size in sizes]
    for label, (task, sizes, *_) in KINDS.items()
}
NEEDS = [key for keys in KEYS.values() for key in keys]


def draw(results: Results) -> Figure:
    """Panels: CPU time per unknown, memory per unknown; flat is proportional."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 2.5))
    panels = (
        ("seconds", 1e6, "CPU time per unknown / µs"),
        ("megabytes", 1e3, "memory per unknown / kB"),
    )
    for ax, (name, unit, words) in zip(axes, panels, strict=True):
        for label, (*_, colour, marker) in KINDS.items():
            rows = [results[key].scalars for key in KEYS[label]]
            dofs = [row["dofs"] for row in rows]
            each = [unit * row[name] / row["dofs"] for row in rows]
            ax.plot(dofs, each, color=colour, marker=marker, label=label)
        ax.set(xscale="log", yscale="log", xlabel="unknowns", ylabel=words)
        plain_ticks(ax)
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    machine = results["K/bodies-pw-T10-20-Iterative"].parameters["machine"]
    return (
        "Contact with friction in space by the Krylov solver on one process, new T10: CPU time of "
        "the solution and largest resident memory, both over the number of unknowns, of a block on "
        "a rigid plane, of two blocks, of the block at ν = 1/2 with an independent pressure, and "
        "of 10 to 100 loose cubes on a plane. A level line is growth in proportion; memory "
        f"includes some 130 MB for the imports. Machine: {machine}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two plots with logarithmic axes; lines of CPU time per unknown are nearly level, a little "
        "rising, and those of memory per unknown fall towards a level."
    )
