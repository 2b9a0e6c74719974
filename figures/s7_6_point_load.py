"""Under the point load the critical stresses have no limit."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, LABEL_BOX, PAGE_WIDTH
from study.run.store import Results

SECTION = "7.6"
CASE_LOOKS = {
    "galerkin-T6-J": {
        **ELEMENT_LOOK["galerkin-T6"],
        "linestyle": "--",
        "label": "standard T6, form J",
    },
    "galerkin-T6": {**ELEMENT_LOOK["galerkin-T6"], "label": "standard T6, form G"},
    "pw-T6": {**ELEMENT_LOOK["pw-T6"], "label": "new T6, form G"},
}
HEIGHT_DIVISIONS = (4, 8, 16, 32)
NEEDS = [
    "7.6/exact",
    *(f"7.6/{case}" for case in CASE_LOOKS),
    *(f"7.6/{case}-point-{5 * ny // 2}x{ny}" for case in CASE_LOOKS for ny in HEIGHT_DIVISIONS),
]


def draw(results: Results) -> Figure:
    """Plot the critical stresses of two modes under a point load against the mesh density."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.7))
    for mode, ax in enumerate(axes, start=1):
        for case, look in CASE_LOOKS.items():
            keys = [
                f"7.6/{case}",
                *(f"7.6/{case}-point-{5 * n // 2}x{n}" for n in HEIGHT_DIVISIONS),
            ]
            values = [results.scalar(key, f"sigma_cr_{mode}") / 1e9 for key in keys]
            ax.semilogx((2, *HEIGHT_DIVISIONS), values, **look)
        for form, style in (("G", "-"), ("J", "--")):
            exact = results.scalar("7.6/exact", f"{form}_{mode}") / 1e9
            ax.axhline(exact, color="black", linewidth=0.8, linestyle=style)
            x, alignment = (
                (2, "left") if mode == 1 else (HEIGHT_DIVISIONS[-1], "right")
            )  # does not overlap the curves
            text_options = {"xytext": (0, 2), "textcoords": "offset points", "va": "bottom"}
            ax.annotate(
                f"uniform load, {form}",
                (x, exact),
                fontsize=7,
                ha=alignment,
                bbox=LABEL_BOX,
                **text_options,
            )
        ax.margins(y=0.08)
        ax.set(title=f"mode {mode}", xlabel="squares over the height")
        ax.set_xticks([2, *HEIGHT_DIVISIONS], [str(n) for n in (2, *HEIGHT_DIVISIONS)])
        ax.set_xticks([], minor=True)
    axes[0].set_ylabel("critical stress / GPa")
    axes[0].legend(loc="lower left")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    finest_stress = results.scalar("7.6/galerkin-T6-point-80x32", "sigma_cr_2") / 1e9
    return (
        "Critical stresses under a point load as in the paper, on reconstructed crossed meshes. "
        "They do not converge: the stress below A grows under refinement until a mode of the few "
        "elements there is the "
        f"lowest (standard element, form G, mode 2 on the finest mesh: {finest_stress:.3f} GPa)."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Curves of the critical stress over mesh density fall without a limit, those of mode 2 "
        "steeply beyond eight squares over the height; horizontal lines mark the exact values."
    )
