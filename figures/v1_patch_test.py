"""Contact patch test on a distorted mesh, pressures by two measures."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.model.vocabulary import OWN, TRIBUTARY
from study.publish.plots.style import FULL, LOOK, mesh_plot
from study.publish.plots.symbols import load_arrows
from study.run.store import Results

SECTION = "V1"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"V1/{element}-distorted" for element in ELEMENTS]
MEASURES = {
    "pressure": f"(b) {OWN.name}",
    "pressure_tributary": f"(c) {TRIBUTARY.name}",
}


def draw(results: Results) -> Figure:
    """The mesh, and nodal forces over two lengths."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.3), width_ratios=(1.3, 1, 1))
    curves = results.curves(NEEDS[0])
    mesh_plot(axes[0], curves["nodes"], curves["cells"])
    length, height = curves["nodes"].max(axis=0)
    load_arrows(axes[0], [length * i / 8 for i in range(9)], height + 0.04, 0.16)
    axes[0].axhspan(-0.12, 0, color="#CCCCCC", lw=0)
    axes[0].set(title="(a) mesh and load", xlabel="$x$", ylabel="$y$")
    axes[0].grid(visible=False)
    for ax, (name, label) in zip(axes[1:], MEASURES.items(), strict=True):
        for key, element in zip(NEEDS, ELEMENTS, strict=True):
            curves = results.curves(key)
            look = dict(LOOK[element])
            if element == "pw-T6":
                look |= {"markerfacecolor": "none", "markersize": 7}
            applied = results.scalar(key, "applied_pressure")
            ax.plot(curves["x"], curves[name] / applied, **look)
        ax.set(title=label, xlabel="$x$", ylim=(0, 1.6))
    axes[1].set_ylabel("pressure / applied one")
    axes[1].legend(fontsize=7, loc="lower center")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        f"Contact patch test on a distorted mesh (a). The {OWN.name} pressure (b) of both "
        f"elements is the applied one; the {TRIBUTARY.name} pressure (c), {TRIBUTARY.meaning} it, "
        "is off by a third with the standard element."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "A distorted mesh of triangles on a rigid plane and two plots of pressure along it: "
        "constant for both elements by the own test function, a sawtooth between two thirds and "
        "four thirds for the standard element by the tributary length."
    )
