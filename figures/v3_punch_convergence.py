"""Convergence of the contact pressure below flat punches."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study.publish.plots import convergence
from study.publish.plots.style import FULL
from study.run.store import Results

SECTION = "V3"
KINDS = {"smooth": "smooth", "bonded": "bonded", "round": "round, smooth"}
MESHES = {"": "-", "-graded": "--"}
NEEDS = [
    f"V3/{kind}-{element}{mesh}"
    for kind in KINDS
    for element in convergence.ELEMENTS
    for mesh in MESHES
]
ERROR = "error_pressure_own_inner"


def draw(results: Results) -> Figure:
    """One panel a kind of punch; even meshes and graded ones."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 3.2), sharex=True, sharey=True)
    for ax, (kind, title) in zip(axes, KINDS.items(), strict=True):
        convergence.prepare(ax, results, NEEDS[0])
        for mesh, line in MESHES.items():
            keys = {element: f"V3/{kind}-{element}{mesh}" for element in convergence.ELEMENTS}
            convergence.errors(ax, results, keys, ERROR, linestyle=line)
        convergence.slope(ax, results, NEEDS[0], 1, 0.15)
        convergence.slope(ax, results, NEEDS[0], 1.5, 0.011)
        ax.set(title=title, xlabel="elements over half width")
    axes[0].set_ylabel("error of pressure, inner part")
    handles, _ = axes[0].get_legend_handles_labels()
    handles = handles[: len(convergence.ELEMENTS)]
    handles += [
        Line2D([], [], color="#333333", linestyle=line, label=label)
        for line, label in (("-", "equal elements"), ("--", "finer towards the edge"))
    ]
    for handle in handles[: len(convergence.ELEMENTS)]:
        handle.set_linestyle("-")
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    even, graded = (
        results.scalar(f"V3/smooth-pw-T6{mesh}", "order_pressure_own_inner") for mesh in MESHES
    )
    return (
        "Root mean square error of the contact pressure (own-function) below the "
        "inner 80 % of flat punches. Observed orders of the new triangle, smooth punch: "
        f"{even:.2f} on uniform meshes, {graded:.2f} on graded ones, as the singularity allows. "
        "The composite triangle has the nodal forces of the new one here."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Three log-log plots of error over the number of elements. Solid lines of even meshes fall "
        "with slope one, dashed ones of graded meshes with slope one and a half; the native "
        "quadrilateral lies lowest."
    )
