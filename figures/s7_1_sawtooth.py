"""Even forces against the sawtooth along a row of squares."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.store import Results

SECTION = "7.1"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"7.1/{element}-row" for element in ELEMENTS]


def draw(results: Results) -> Figure:
    """Plot nodal reactions below a row of squares under uniform pressure, for both elements."""
    fig, ax = plt.subplots(figsize=(PAGE_WIDTH, 2.6))
    for element in ELEMENTS:
        curves = results.curves(f"7.1/{element}-row")
        ax.plot(curves["x"], curves["reaction"], **ELEMENT_LOOK[element])
    ax.axhline(0.5, color="black", linewidth=0.8, linestyle=":", label="pressure × node distance")
    ax.set(xlabel="$x$ / side of a square", ylabel="force / load on a square", ylim=(0, 0.8))
    fig.legend(loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    squares = (len(results.curves(NEEDS[0])["x"]) - 1) // 2
    return (
        f"Reactions below a row of {squares} squares of two triangles each under uniform pressure. "
        "The standard element's form a sawtooth; the new element's are even but for the two ends, "
        "which carry half a share."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    galerkin, pw = (results.curves(key)["reaction"] for key in NEEDS)
    return (
        f"Nodal forces over x. The standard element alternates between {galerkin[2]:.3f} at corner "
        f"and {galerkin[1]:.3f} at mid-side nodes; the new element stays at {pw[2]:.3f}."
    )
