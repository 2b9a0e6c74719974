"""Orders of convergence: displacements, nodal forces, eigenvalues."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.publish.plots.style import CLEAR, FULL, LOOK
from study.run.store import Results

SECTION = "C"
ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
# Title, end of the case names, curve, orders whose slopes are drawn and where at the fine end
PANELS = (
    ("H1 seminorm of the displacements", "plane-stress", "H1", ((1, 5e-3), (2, 6e-5))),
    ("L2 norm of the displacements", "plane-stress", "L2", ((2, 1e-4), (3, 4e-7))),
    ("nodal forces on the held side", "plane-stress", "force", ((1, 4e-3), (2, 1.3e-5))),
    ("lowest four eigenvalues", "modes-square", "eigenvalue", ((2, 3e-4), (4, 5e-7))),
)
FINE, COARSE = 0.014, 0.03
NEEDS = [f"C/{element}-{end}" for end in ("plane-stress", "modes-square") for element in ELEMENTS]


def draw(results: Results) -> Figure:
    """Relative error over the size of the elements, one panel a norm."""
    fig, axes = plt.subplots(2, 2, figsize=(FULL, 3.1), sharex=True, layout="constrained")
    for ax, (title, ending, name, slopes) in zip(axes.flat, PANELS, strict=True):
        for element in ELEMENTS:
            look = dict(LOOK[element])
            if element == "pw-T6":  # on top of the standard element's
                look |= {"linestyle": ":", "markerfacecolor": "none", "markersize": 8}
            elif element == "pw-Q9":
                look |= {"linestyle": ":", "markerfacecolor": "none", "markersize": 7}
            curves = results.curves(f"C/{element}-{ending}")
            ax.loglog(curves["dofs"] ** -0.5, curves[f"error_{name}"], **look)
        for slope, start in slopes:
            coarse = start * (COARSE / FINE) ** slope
            ax.loglog([FINE, COARSE], [start, coarse], color="#777777", linewidth=0.8)
            ax.annotate(
                f"order {slope}",
                (COARSE, coarse),
                (3, 0),
                textcoords="offset points",
                fontsize=7,
                va="center",
                color="#555555",
                bbox=CLEAR,
            )
        ax.set(title=title)
        ax.margins(y=0.12)  # the lowest slope's name stays clear of the axis
        ax.set_xticks([0.01, 0.02, 0.05, 0.1], ["0.01", "0.02", "0.05", "0.1"])
        ax.set_xticks([], minor=True)
    for ax in axes[1]:
        ax.set_xlabel("(degrees of freedom)$^{-1/2}$")
    for ax in axes[:, 0]:
        ax.set_ylabel("relative error")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    pw, galerkin, pairs, standard = (
        results.scalar(f"C/{element}-modes-square", "error_eigenvalue")
        for element in ("pw-T6", "galerkin-T6", "pw-Q8", "galerkin-Q8")
    )
    return (
        "Relative errors on the unit square in plane stress (triangles by Gmsh; quadrilaterals and "
        "pairs of triangles smoothly distorted). New and standard triangle coincide in the "
        "displacements. Eigenvalues: the largest error of the lowest four; on the finest mesh the "
        f"new triangle's is {pw / galerkin:.2f} times the standard one's, and that of the new "
        f"8-node quadrilateral with Guyan's reduction {pairs / standard:.0f} times the standard "
        "one's."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Four log-log plots of errors over the elements' size. Displacements: all quadratic "
        "elements fall with slopes two and three, the composite triangle with one and two. Nodal "
        "forces: slope two, the composite triangle one. Eigenvalues: slope four, but two for both "
        "new quadrilaterals."
    )
