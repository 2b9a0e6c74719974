"""Convergence of the critical stresses to the exact ones under uniform load."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, LABEL_BOX, PAGE_WIDTH
from study.judge import measures
from study.run.store import Results

SECTION = "7.6"
# Cases under the paper's load; the same elements and forms are shown under uniform load
CASES_BY_FORM = {
    "G": ("galerkin-T6", "pw-T6", "galerkin-Q8", "pwsym-T6-static-unsymmetric", "pwsym-T6"),
    "J": ("galerkin-T6-J", "pw-T6-J", "galerkin-Q8-J", "pwsym-T6-J"),
}
MODE = 2
NEEDS = [
    "7.6/exact",
    "7.6/galerkin-T6-uniform-64x16",
    "7.6/pwsym-T6-uniform-128x32",
    *(f"7.6/{case}" for cases in CASES_BY_FORM.values() for case in cases),
]


def draw(results: Results) -> Figure:
    """Plot relative errors of the critical stress against the number of elements over the height.

    Each panel shows one form of the geometric stiffness, G or J.
    """
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.0), sharey=True)
    for ax, (form, cases) in zip(axes, CASES_BY_FORM.items(), strict=True):
        for case in cases:
            parameters = results[f"7.6/{case}"].parameters
            look = dict(ELEMENT_LOOK[parameters["element"]])
            if not parameters["prestress_symmetrised"]:
                look |= {"linestyle": "--", "label": "symmetrised, eigenvalue step only"}
            elif parameters["element"] == "pw-T6":  # coincides with the standard one
                look |= {"linestyle": ":", "markerfacecolor": "none", "markersize": 8}
            height_divisions = [
                ny for _, ny in measures.mesh_divisions_of_uniform_load_cases(results, case)
            ]
            errors = np.abs(measures.stress_errors_of_uniform_load_cases(results, case, MODE))
            ax.loglog(height_divisions, errors, **look)
        slope_divisions = np.array([2.0, 16.0])
        for order, start in ((4, 3e-4), (2, 4e-2)):
            ax.loglog(
                slope_divisions,
                start * (slope_divisions / 2) ** -order,
                color="#777777",
                linewidth=0.8,
            )
            last_point, text_options = (
                (16, start * 8.0**-order),
                {"textcoords": "offset points", "va": "center"},
            )
            ax.annotate(
                f"order {order}", last_point, (4, 0), fontsize=7, bbox=LABEL_BOX, **text_options
            )
        letter = "a" if form == "G" else "b"
        ax.set(title=f"({letter}) geometric stiffness, form {form}")
        ax.set_xlabel("squares over the height")
        ax.set_xticks([1, 2, 4, 8, 16, 32], ["1", "2", "4", "8", "16", "32"])
        ax.set_xticks([], minor=True)
    axes[0].set_ylabel(f"relative error of mode {MODE}")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    orders = ", ".join(
        f"{ELEMENT_LOOK[case]['label']} {measures.convergence_order(results, case, MODE):.2f}"
        for case in ("galerkin-T6", "pw-T6", "galerkin-Q8")
    )
    return (
        f"Relative error of the second critical stress against the exact value of the same form, "
        f"uniform end load. Observed orders with form G on the two finest meshes: {orders}. "
        "Standard and new triangle coincide under a uniform initial stress. Symmetrisation costs "
        "two orders; if the static step is symmetrised too, the error even changes its sign."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Two log-log plots of error over mesh density. Standard and new triangle fall together "
        "with slope four, the 8-node quadrilateral below them; the symmetrised element falls with "
        "slope two."
    )
