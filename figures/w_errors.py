"""Errors of an engineer's answers with both elements, on two meshes."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from study.engineering.problems import MESHES, names
from study.judge.measures.engineering import WORTH, answers
from study.publish.plots.style import FULL
from study.run.store import Results

SECTION = "W"
ANSWERS = (
    ("wear", "", "worn depth"),
    ("friction", "", "tangential force"),
    ("friction", "stick_", "width that sticks"),
    ("conductance", "", "heat through a joint"),
    ("conductance", "jump_", "temperature jump"),
    ("impact", "", "rebound"),
    ("impact", "slip_", "friction's impulse"),
    ("impact", "energy_", "energy lost to friction"),
    ("submodel", "", "stress below the surface"),
)
RULES = {
    "wear": {"skip": "no wear", "neighbours": "mean of neighbours", "tributary": "tributary"},
    "friction": {"tributary": "tributary"},
    "submodel": {"forces": "forces as they are"},
}
MARKS = {"no wear": "s", "mean of neighbours": "d", "tributary": "x", "forces as they are": "+"}
NEEDS = [
    f"W/{problem}-{element}-{mesh}-{reading}"
    for of in MESHES
    for cell in ("T6", "T10")
    for problem, element, mesh, reading in names(of, cell)
]
LOOKS = (("#D55E00", "^"), ("#0072B2", "o"))  # of the standard element, and of the new one


def draw(results: Results) -> Figure:
    """Left the plane, right space: a row an answer, a pair of marks an element."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 2.5), sharey=True)
    for ax, cell, title in zip(
        axes, ("T6", "T10"), ("(a) triangles", "(b) tetrahedra"), strict=True
    ):
        for row, (problem, name, _) in enumerate(ANSWERS):
            _row(ax, results, row, problem, cell, name)
        ax.axvline(100 * WORTH, color="#999999", linewidth=0.8, linestyle=":")
        ax.set(xscale="log", xlim=(3e-3, 200), xlabel="error / %", title=title)
        ax.set_xticks([0.01, 0.1, 1, 10, 100], ["0.01", "0.1", "1", "10", "100"])
        ax.grid(axis="y", color="#dddddd", linewidth=0.5)
    axes[0].set_yticks(range(len(ANSWERS)), [words for _, _, words in ANSWERS])
    axes[0].invert_yaxis()
    shown = [
        Line2D([], [], color="#D55E00", marker="^", label="standard, its best reading"),
        Line2D(
            [], [], color="#0072B2", marker="o", label="new (impact: sibling), its best reading"
        ),
    ]
    shown += [
        Line2D([], [], color="#777777", marker=mark, linestyle="", label=f"standard: {words}")
        for words, mark in MARKS.items()
    ]
    fig.legend(handles=shown, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def _row(ax: Axes, results: Results, row: int, problem: str, cell: str, name: str) -> None:
    """Errors of one answer; an open mark is the coarser mesh."""
    meshes = MESHES[problem][cell]
    both = [answers(results, problem, cell, mesh, name) for mesh in meshes]
    for element, (colour, marker) in enumerate(LOOKS):
        errors = [100 * pair[element].scalars[f"{name}error"] for pair in both]
        place = row + (element - 0.5) * 0.3
        ax.plot(errors, [place, place], color=colour, linewidth=0.8)
        for error, face in zip(errors, ("white", colour), strict=True):
            ax.plot(error, place, marker, color=colour, markerfacecolor=face)
    for reading, words in RULES.get(problem, {}).items():
        keys = [f"W/{problem}-galerkin-{cell}-{mesh}-{reading}" for mesh in meshes]
        errors = [100 * results.scalar(key, f"{name}error") for key in keys if key in results]
        ax.plot(errors, [row - 0.15] * len(errors), MARKS[words], color="#777777", ms=3.5)


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Errors of nine answers at equal unknowns, each element by its best reading on that mesh: "
        "open marks on the coarser mesh, full ones on the finer; grey, other rules with the "
        "standard element. Dotted: 1 %, below which nobody's answer changes."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two panels with a logarithmic axis of errors. The marks of both elements lie below or "
        "near one per cent in all rows; grey marks of other rules reach a hundred per cent."
    )
