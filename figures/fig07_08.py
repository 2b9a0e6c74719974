"""Stresses along the contact area of the block: 6-node triangles, 8-node quadrilaterals."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import compare, zone_legend, zone_strip
from figures.style import FULL
from study.core.store import Results
from study.judge import measures
from study.vocabulary import ELEMENTS

SECTION = "7.2"
FAMILIES = (("galerkin-T6", "pw-T6", "composite-T6"), ("galerkin-Q8", "pw-Q8", "pw-Q9"))
FINE = "7.2/pw-T6-80x40"
NEEDS = [*(f"7.2/{element}" for family in FAMILIES for element in family), FINE]


def draw(results: Results) -> Figure:
    """Rows: triangles and quadrilaterals; the strips below are the new elements' zones."""
    fig, axes = plt.subplots(2, 2, figsize=(FULL, 4.9), sharex=True, sharey="col")
    fine = results.curves(FINE)
    titles = ["Fig. 7: triangles", "Fig. 8: quadrilaterals"]
    for row, family in zip(axes, FAMILIES, strict=True):
        zones = results.curves(f"7.2/{family[1]}")
        for ax, quantity in zip(row, ("pressure", "shear"), strict=True):
            exact = fine[quantity] / measures.BLOCK_PRESSURE
            ax.plot(fine["x"], exact, color="black", lw=0.9, label="new T6, 80 × 40")
            keys = [f"7.2/{element}" for element in family]
            compare(ax, results, keys, quantity, 1 / measures.BLOCK_PRESSURE)
            zone_strip(ax, zones)
        row[0].set_title(titles.pop(0), loc="left", fontsize=8)
        row[0].set(ylabel="normal pressure / $p$", ylim=(0, 2.5), xlim=(-0.05, 4.05))
        row[1].set(ylabel="shear stress / $p$", ylim=(-0.4, 0.6))
        row[1].legend(fontsize=7, loc="lower right")
    for ax in axes[1]:
        ax.set_xlabel("$x$")
    fig.legend(handles=zone_legend(zones), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    saw = "; ".join(
        f"{ELEMENTS[element].name} {results.scalar(f'7.2/{element}', 'sawtooth'):.3f}"
        for family in FAMILIES
        for element in family
    )
    return (
        "Stresses along the contact area over the applied pressure p (nodal force over tributary "
        "length): triangles (the paper's Fig. 7) and quadrilaterals (Fig. 8). Ratio of the normal "
        f"force of a mid-side node to that of its corners: {saw}. Strips: contact zones of the new "
        "elements. Proportions and loads are reconstructed."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    stick = results.scalar("7.2/pw-T6", "stick_to")
    return (
        "Four panels of normal and shear stress over the contact line. The standard elements' "
        "curves form a sawtooth around the fine mesh's, which the others follow; sticking up to "
        f"x = {stick:.3f}, slip on the right."
    )
