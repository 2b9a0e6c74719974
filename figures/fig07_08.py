"""Contact of the block: 6-node triangles, 8-node quadrilaterals."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.contact import (
    DATA_BAND,
    Curves,
    band,
    diagonal_band,
    family,
)
from figures.style import FULL, LOOK
from study.judge.measures.contact import BLOCK_PRESSURE
from study.model.vocabulary import ELEMENTS, OWN_FUNCTION_READING
from study.paper.bands import OTHER_DIAGONALS, UNPRINTED_DATA, list_case_family
from study.publish.plots.zones import zone_legend, zone_strip
from study.run.store import Results

SECTION = "7.2"
FAMILIES = (("galerkin-T6", "pw-T6", "composite-T6"), ("galerkin-Q8", "pw-Q8", "pw-Q9"))
FINE = "7.2/pw-T6-80x40"
TRIANGLES = ("7.2/galerkin-T6", "7.2/pw-T6")
NEEDS = [
    *(f"7.2/{element}" for family in FAMILIES for element in family),
    FINE,
    *(member for key in TRIANGLES for member in list_case_family(key, OTHER_DIAGONALS)[1:]),
    *list_case_family(TRIANGLES[1], UNPRINTED_DATA)[1:],
]
PANELS = {
    "force_n": "normal nodal force / mean",
    "pressure": "normal pressure / $p$",
    "shear": "shear stress / $p$",
}
LIMITS = {"force_n": (0, 2.1), "pressure": (0, 2.1), "shear": (-0.4, 0.6)}


def draw(results: Results) -> Figure:
    """Rows: triangles and quadrilaterals; the strips below are the new elements' zones."""
    fig, axes = plt.subplots(2, 3, figsize=(FULL, 4.9), sharex=True, sharey="col")
    titles = ("Fig. 7: triangles", "Fig. 8: quadrilaterals")
    for row, elements, title in zip(axes, FAMILIES, titles, strict=True):
        for ax, quantity in zip(row, PANELS, strict=True):
            _panel(ax, results, elements, quantity)
            ax.set_ylabel(PANELS[quantity])
        row[0].set_title(title, loc="left")
    for ax, quantity in zip(axes[1], PANELS, strict=True):
        ax.set(xlabel="$x$", xlim=(-0.05, 4.05), ylim=LIMITS[quantity])
    handles = {h.get_label(): h for ax in axes[:, 1] for h in ax.get_legend_handles_labels()[0]}
    zones = zone_legend(results.curves("7.2/pw-T6"))
    fig.legend(handles=[*handles.values(), *zones], loc="outside lower center", ncols=4, fontsize=7)
    return fig


def _panel(ax: Axes, results: Results, elements: tuple[str, ...], quantity: str) -> None:
    def lines(curves: list[Curves]) -> list[Curves]:
        return [{"x": c["x"], quantity: c[quantity] / _scale(c, quantity)} for c in curves]

    band(ax, lines(family(results, TRIANGLES[1], UNPRINTED_DATA)), quantity, 1.0, DATA_BAND)
    if elements is FAMILIES[0]:
        for key, element in zip(TRIANGLES, elements, strict=False):
            cut = lines(family(results, key, OTHER_DIAGONALS))
            band(ax, cut, quantity, 1.0, diagonal_band(element))
    (fine,) = lines([results.curves(FINE)])
    ax.plot(fine["x"], fine[quantity], color="black", lw=0.9, label="new T6, 80 × 40")
    for element in elements:
        (curves,) = lines([results.curves(f"7.2/{element}")])
        look = {**LOOK[element], "linewidth": 0.8, "markersize": 2}
        if "composite" in element:  # on the new one's
            look |= {"markerfacecolor": "none", "markersize": 4.5, "markeredgewidth": 0.6}
        ax.plot(curves["x"], curves[quantity], **look)
    zone_strip(ax, results.curves(f"7.2/{elements[1]}"))


def _scale(curves: Curves, quantity: str) -> float:
    """The applied pressure, or its mean nodal force."""
    if quantity == "force_n":
        return float(curves["force_n"].sum() / (len(curves["x"]) - 1))
    return BLOCK_PRESSURE


def caption(results: Results) -> str:
    """What the figure shows."""
    saw = "; ".join(
        f"{ELEMENTS[element].name} {results.scalar(f'7.2/{element}', 'sawtooth'):.3f}"
        for family in FAMILIES
        for element in family
    )
    return (
        "Nodal forces and stresses along the contact area: triangles (the paper's Fig. 7) and "
        f"quadrilaterals (Fig. 8). Stresses are {OWN_FUNCTION_READING.name} ones: {OWN_FUNCTION_READING.meaning}. Ratio of the "
        f"normal force of a mid-side node to that of its corners: {saw}. Grey band: proportions, "
        "traction, order of loading, plane strain and the shared node as they could be, new T6. "
        "Coloured bands, hardly wider than a line: squares cut along all diagonals. Strips: "
        "contact zones of the new elements."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    stick = results.scalar("7.2/pw-T6", "stick_to")
    return (
        "Six panels over the contact line. The standard elements' nodal forces form a sawtooth, "
        "the others' do not; pressures and shear stresses of all elements lie on the fine mesh's "
        f"curve; sticking up to x = {stick:.3f}, slip on the right."
    )
