"""The stepped column pressed on its supports, with its contact forces."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.column import MM_PER_M, SURFACES, SYNTHETIC_NOTE, select_surface_curves
from figures.contact import draw_deformed_mesh, draw_nodal_force_arrows
from figures.style import PAGE_WIDTH
from study.run.store import Results

SECTION = "7.5"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"7.5/{element}" for element in ELEMENTS]
DISPLACEMENT_SCALE = 20.0
ARROW_LENGTH = 80.0  # length of the largest arrow on each surface, in mm


def draw(results: Results) -> Figure:
    """Draw the deformed section and the nodal contact forces on it, one panel per element."""
    fig, axes = plt.subplots(1, 2, figsize=(0.72 * PAGE_WIDTH, 6.6), sharey=True)
    for ax, element in zip(axes, ELEMENTS, strict=True):
        curves = dict(results.curves(f"7.5/{element}"))
        for name in [
            "nodes",
            "displacement",
            *(f"{coordinate}_{k}" for coordinate in "xy" for k in SURFACES),
        ]:
            curves[name] = MM_PER_M * curves[name]
        deformed_nodes = draw_deformed_mesh(ax, curves, DISPLACEMENT_SCALE, element)
        for surface in SURFACES:
            side = 1.0 if surface == max(SURFACES) else -1.0
            draw_nodal_force_arrows(
                ax,
                select_surface_curves(curves, surface),
                deformed_nodes,
                side,
                ARROW_LENGTH,
                element,
            )
        ax.set(xlabel="$r$ / mm", xlim=(-12, 185), ylim=(-95, 670))
    axes[0].set_ylabel("$z$ / mm")
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    forces = [results.scalar("7.5/pw-T6", f"force_normal_{surface}") for surface in SURFACES]
    return (
        f"The section after the last increment, displacements times {DISPLACEMENT_SCALE:g}, and "
        "nodal forces "
        "of the rigid surfaces on it, each surface to its own scale; their normal sums on "
        f"surfaces 1 to 4: {', '.join(f'{force:.0f}' for force in forces)} kN. {SYNTHETIC_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Two deformed sections, shortened and bulging. Arrows press on the base, both shoulders "
        "and the top; those on the standard element alternate between long and short, those on the "
        "new one grow evenly with the radius."
    )
