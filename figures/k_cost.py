"""Cost over the number of unknowns: factors, frequencies, contact."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study.publish.plots.style import FULL, LOOK, plain_ticks
from study.run.store import Results

SECTION = "K"
NEEDS = ["K/factors-pw-T10-8-Direct", "K/contact-pw-T10-8-Direct", "K/contact-pw-T10-8-Iterative"]
PANELS = {
    "factors": "(a) factorisation",
    "frequencies": "(b) six frequencies",
    "contact": "(c) contact with friction",
}
ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-T10", "pw-T10")
# As CalculiX calls them
PEERS = {"galerkin-T10": "C3D10"}
LINES = {"Direct": "-", "Iterative": "--", "CalculiX": "-."}


def draw(results: Results) -> Figure:
    """Upper row: CPU time of three tasks; below: memory of the same."""
    fig, axes = plt.subplots(2, 3, figsize=(FULL, 3.6), sharex="col")
    for column, (task, title) in zip(axes.T, PANELS.items(), strict=True):
        for element in ELEMENTS:
            for method, line in LINES.items():
                drawn = PEERS.get(element, element) if method == "CalculiX" else element
                rows = series(results, task, drawn, method)
                seconds = "whole_seconds" if task == "contact" else "seconds"
                for ax, name in zip(column, (seconds, "megabytes"), strict=True):
                    _curve(ax, rows, name, element, line)
        column[0].set_title(title)
        column[1].set_xlabel("unknowns")
    axes[0, 0].set_ylabel("CPU time / s")
    axes[1, 0].set_ylabel("memory / MB")
    for ax in axes.flat:
        ax.set(xscale="log", yscale="log")
    for ax in axes[1]:
        plain_ticks(ax)
    words = {"Direct": "direct", "Iterative": "Krylov", "CalculiX": "CalculiX"}
    shown = [Line2D([], [], **LOOK[element]) for element in ELEMENTS]
    shown += [
        Line2D([], [], color="#555555", linestyle=line, label=words[method])
        for method, line in LINES.items()
    ]
    fig.legend(handles=shown, loc="outside lower center", ncols=4, fontsize=7)
    return fig


def series(results: Results, task: str, element: str, method: str) -> list[dict[str, float]]:
    """Scalars of a series on one process, by the number of unknowns."""
    keys = [
        f"K/{name}"
        for name in results.cases("K")
        if name.startswith(f"{task}-{element}-") and name.endswith(method)
    ]
    return sorted((results[key].scalars for key in keys), key=lambda row: row["dofs"])


def _curve(ax: Axes, rows: list[dict[str, float]], name: str, element: str, line: str) -> None:
    if rows:
        look = LOOK[element] | {"linestyle": line}
        ax.plot([row["dofs"] for row in rows], [row[name] for row in rows], **look)


def caption(results: Results) -> str:
    """What the figure shows."""
    machine = results["K/factors-pw-T10-8-Direct"].parameters["machine"]
    return (
        "CPU time and largest resident memory of the process for a block 2 × 1 (× 1): "
        "(a) factorisation of the stiffness (LDLᵀ for the standard elements, LU for the new ones); "
        "(b) the six lowest frequencies; (c) contact on a rough plane, the whole run, by a direct "
        "and by a Krylov solver with multigrid, and by CalculiX with its C3D10 and "
        f"surface-to-surface contact. Medians of three runs, or a single long run, on {machine}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Six plots with logarithmic axes; time and memory grow with the number of unknowns, by "
        "factors in space much faster than by Krylov's method, whose time is nearly proportional."
    )
