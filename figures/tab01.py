"""Shifts of the eigenvalues by the new elements, printed and computed."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.column import SYNTHETIC
from figures.style import FULL, LOOK
from study.judge import measures
from study.run.store import Results

SECTION = "7.5"
MODES = range(1, 7)
SIX = {
    "pw-T6": "as derived",
    "pwsym-T6": "symmetrised",
    "pw-T6-lumped": "lumped mass",
    "pwsym-T6-lumped": "symmetrised and lumped",
    "pw-T6-onepoint": "one point per sub-triangle",
}
EIGHT = {
    "pw-Q8": "as derived ($\\mathbf{L} \\neq \\mathbf{R}$)",
    "pw-Q8-same": "reduced with $\\mathbf{L} = \\mathbf{R}$",
    "pwsym-Q8": "symmetrised",
    "pw-Q8-lumped": "lumped mass",
    "pwsym-Q8-lumped": "symmetrised and lumped",
}
# colour and marker of the treatments, in the order of both lists
# new elements in their colours, other treatments in colours that no element has
NEW, SYMMETRISED = (LOOK[element]["color"] for element in ("pw-T6", "pwsym-T6"))
LINES = ((NEW, "o"), (SYMMETRISED, "d"), ("#8A8A8A", "v"), ("#B3003C", "<"), ("#7FA800", ">"))
EIGHT_LINES = (LINES[0], LINES[4], LINES[1], LINES[2], LINES[3])
REFERENCE = {"galerkin-T6": "CAX6", "galerkin-Q8": "CAX8"}
NEEDS = [f"7.5/{case}" for case in (*SIX, *EIGHT, *REFERENCE)]


def draw(results: Results) -> Figure:
    """One panel an element, difference over the standard one by mode."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 3.5), sharey=True)
    panels = (("6", SIX, LINES, "galerkin-T6"), ("8", EIGHT, EIGHT_LINES, "galerkin-Q8"))
    for ax, (nodes, cases, lines, over) in zip(axes, panels, strict=True):
        printed = [
            measures.printed_shift(results, f"{nodes}-node user element", REFERENCE[over], mode)
            for mode in MODES
        ]
        ax.plot(MODES, printed, "*-", color="black", ms=9, label="printed")
        for (case, label), (color, marker) in zip(cases.items(), lines, strict=True):
            _line(ax, results, case, over, color=color, marker=marker, label=label)
        if nodes == "8":
            _line(ax, results, "galerkin-T6", over, color="#999999", ls=":", label="standard T6")
        ax.axhline(0, color="#444444", lw=0.6)
        ax.set(xlabel="mode", xticks=MODES)
        letter = "a" if nodes == "6" else "b"
        ax.set_title(f"({letter}) {nodes}-node element against the standard one", fontsize=8)
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.17), "ncols": 2}
        ax.legend(fontsize=7, **below)  # there is no place that lines leave free
    axes[0].set_ylabel("shift of $\\lambda$ / %")
    return fig


def _line(ax: Axes, results: Results, case: str, over: str, **look: object) -> None:
    shifts = [measures.eigenvalue_shift(results, case, over, mode) for mode in MODES]
    ax.plot(MODES, shifts, lw=1.0, **look)  # type: ignore[arg-type]


def caption(results: Results) -> str:
    """Return the caption."""
    misfit = measures.shift_misfit(
        results, "pwsym-T6", "galerkin-T6", "6-node user element", "CAX6"
    )
    return (
        "Relative differences of eigenvalues: user elements from CAX6 and CAX8 as printed (stars), "
        "and new elements from the standard ones on the synthetic column, with the matrices "
        "treated in several ways; L and R are the two matrices of Guyan's reduction. The "
        "symmetrised triangle comes nearest to the printed one (root mean square of the "
        f"difference {misfit:.3f} %). {SYNTHETIC}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    last = measures.printed_shift(results, "8-node user element", "CAX8", 6)
    return (
        "Lines of the relative shift over the mode. The printed ones fall to "
        f"{last:.2f} % for the 8-node element; the unsymmetric triangle's stays at zero, the "
        "symmetrised one's lies below in all modes, lumped masses lower modes 4 and 6 most."
    )
