"""Normal pressures and shear stresses along the four contact surfaces of the column."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.column import MM, NAMES, SURFACES, SYNTHETIC, surface
from figures.contact import reported, zone_legend, zone_strip
from figures.style import FULL, LOOK
from study.core.store import Results

SECTION = "7.5"
ELEMENTS = ("galerkin-T6", "galerkin-Q8", "pw-T6", "pw-Q8")
FINE = "7.5/pw-T6-fine"
NEEDS = [*(f"7.5/{element}" for element in ELEMENTS), FINE]
STRESSES = {"pressure": "normal pressure", "shear": "shear stress"}
HOLLOW = {"markerfacecolor": "none", "markersize": 6.5, "linewidth": 0.6}


def draw(results: Results) -> Figure:
    """Rows: surfaces from the base upwards; columns: normal and shear stress."""
    fig, axes = plt.subplots(4, 2, figsize=(FULL, 7.9))
    for row, number in zip(axes, SURFACES, strict=True):
        fine = surface(results.curves(FINE), number)
        zones = surface(results.curves("7.5/pw-T6"), number)
        for column, (ax, quantity) in enumerate(zip(row, STRESSES, strict=True)):
            label = "new T6, mesh halved"
            ax.plot(MM * fine["x"], fine[quantity] / 1e3, color="black", lw=0.9, label=label)
            for element in ELEMENTS:
                curves = surface(results.curves(f"7.5/{element}"), number)
                size = {"galerkin-T6": 5.5, "galerkin-Q8": 2.5}.get(element, 3.0)
                look = {"markersize": size, "linewidth": 1.0, **LOOK[element]}
                look |= HOLLOW if element == "pw-Q8" else {}  # it lies on the new T6's
                ax.plot(MM * curves["x"], reported(curves, quantity) / 1e3, **look)
            _, high = ax.get_ylim()
            ax.set_ylim(None, min(high, 2.4 * float(reported(zones, quantity).max()) / 1e3))
            zone_strip(ax, {**zones, "x": MM * zones["x"]})
            paper = f"Fig. {14 + 2 * number + column}"
            title = f"{paper}: surface {number}, {NAMES[number]}"
            ax.set_title(title, loc="left", fontsize=8)
            ax.set_ylabel(f"{STRESSES[quantity]} / MPa", fontsize=8)
            ax.tick_params(labelsize=7)
    for ax in axes[-1]:
        ax.set_xlabel("$r$ / mm")
    handles = [*axes[0, 0].lines, *zone_legend(surface(results.curves("7.5/pw-T6"), 1))]
    fig.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=7.5)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    saws = {
        element: [results.scalar(f"7.5/{element}", f"sawtooth_{k}") for k in SURFACES]
        for element in ELEMENTS
    }
    standard, new = (
        [value for element, values in saws.items() if element.startswith(kind) for value in values]
        for kind in ("galerkin", "pw")
    )
    return (
        "Stresses along the four contact surfaces (nodal force over tributary area). Ratio of the "
        "normal force of a mid-side node to that of its corners, over all surfaces: standard "
        f"elements {min(standard):.3f} to {max(standard):.3f}, new elements {min(new):.3f} to "
        f"{max(new):.3f}. Strips: contact zones of the new T6. {SYNTHETIC}"
    )


def alt(results: Results) -> str:
    """The figure in words."""
    forces = ", ".join(f"{results.scalar('7.5/pw-T6', f'force_normal_{k}'):.0f}" for k in SURFACES)
    return (
        "Eight panels of stress over the radius. The standard elements' form a sawtooth around "
        "the smooth curves of the new ones, which follow the finer mesh's and rise to the edge. "
        f"Normal forces on the four surfaces: {forces} kN."
    )
