"""Shifts of the eigenvalues by the new elements, printed and computed."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.column import SYNTHETIC_NOTE
from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.judge import measures
from study.run.store import Results

SECTION = "7.5"
MODES = range(1, 7)
SIX_NODE_CASES = {
    "pw-T6": "as derived",
    "pwsym-T6": "symmetrised",
    "pw-T6-lumped": "lumped mass",
    "pwsym-T6-lumped": "symmetrised and lumped",
    "pw-T6-onepoint": "one point per sub-triangle",
}
EIGHT_NODE_CASES = {
    "pw-Q8": "as derived ($\\mathbf{L} \\neq \\mathbf{R}$)",
    "pw-Q8-same": "reduced with $\\mathbf{L} = \\mathbf{R}$",
    "pwsym-Q8": "symmetrised",
    "pw-Q8-lumped": "lumped mass",
    "pwsym-Q8-lumped": "symmetrised and lumped",
}
# colour and marker of the treatments, in the order of both lists
# new elements in their colours, other treatments in colours that no element has
NEW_COLOUR, SYMMETRISED_COLOUR = (
    ELEMENT_LOOK[element]["color"] for element in ("pw-T6", "pwsym-T6")
)
LINE_LOOKS = (
    (NEW_COLOUR, "o"),
    (SYMMETRISED_COLOUR, "d"),
    ("#8A8A8A", "v"),
    ("#B3003C", "<"),
    ("#7FA800", ">"),
)
EIGHT_NODE_LINE_LOOKS = (LINE_LOOKS[0], LINE_LOOKS[4], LINE_LOOKS[1], LINE_LOOKS[2], LINE_LOOKS[3])
PRINTED_REFERENCE = {"galerkin-T6": "CAX6", "galerkin-Q8": "CAX8"}
NEEDS = [f"7.5/{case}" for case in (*SIX_NODE_CASES, *EIGHT_NODE_CASES, *PRINTED_REFERENCE)]


def draw(results: Results) -> Figure:
    """One panel an element, difference over the standard one by mode."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.5), sharey=True)
    panels = (
        ("6", SIX_NODE_CASES, LINE_LOOKS, "galerkin-T6"),
        ("8", EIGHT_NODE_CASES, EIGHT_NODE_LINE_LOOKS, "galerkin-Q8"),
    )
    for ax, (nodes, cases, line_looks, reference) in zip(axes, panels, strict=True):
        printed = [
            measures.printed_shift(
                results, f"{nodes}-node user element", PRINTED_REFERENCE[reference], mode
            )
            for mode in MODES
        ]
        ax.plot(MODES, printed, "*-", color="black", ms=9, label="printed")
        for (case, label), (color, marker) in zip(cases.items(), line_looks, strict=True):
            _plot_shifts(ax, results, case, reference, color=color, marker=marker, label=label)
        if nodes == "8":
            _plot_shifts(
                ax, results, "galerkin-T6", reference, color="#999999", ls=":", label="standard T6"
            )
        ax.axhline(0, color="#444444", lw=0.6)
        ax.set(xlabel="mode", xticks=MODES)
        letter = "a" if nodes == "6" else "b"
        ax.set_title(f"({letter}) {nodes}-node element against the standard one", fontsize=8)
        legend_place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.17), "ncols": 2}
        ax.legend(fontsize=7, **legend_place)  # there is no place that lines leave free
    axes[0].set_ylabel("shift of $\\lambda$ / %")
    return fig


def _plot_shifts(ax: Axes, results: Results, case: str, reference: str, **look: object) -> None:
    shifts = [measures.eigenvalue_shift(results, case, reference, mode) for mode in MODES]
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
        f"difference {misfit:.3f} %). {SYNTHETIC_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    last_shift = measures.printed_shift(results, "8-node user element", "CAX8", 6)
    return (
        "Lines of the relative shift over the mode. The printed ones fall to "
        f"{last_shift:.2f} % for the 8-node element; the unsymmetric triangle's stays at zero, the "
        "symmetrised one's lies below in all modes, lumped masses lower modes 4 and 6 most."
    )
