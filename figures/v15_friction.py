"""Nearly incompressible bodies: shear that friction keeps, and stability over meshes."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V15"
ONE_FIELD, HYBRID = ("galerkin-T6", "pw-T6"), ("galerkin-hybrid-T6", "pw-hybrid-T6")
SIDES: dict[str, tuple[int, ...]] = dict.fromkeys(ONE_FIELD, (8, 16, 32)) | dict.fromkeys(
    HYBRID, (8, 16, 32, 64)
)
STABLE: dict[str, tuple[int, ...]] = {
    "T6": (4, 8, 16, 32),
    "Q9": (4, 8, 16, 32),
    "T10": (2, 4, 6),
    "H27": (2, 4, 6),
}
ALONG = "V15/presses-{}-16"
NEEDS = [f"V15/presses-{element}-{n}" for element, sides in SIDES.items() for n in sides]
NEEDS += [
    f"V15/infsup-{kind}-hybrid-{cell}-{n}"
    for kind in ("galerkin", "pw")
    for cell, sides in STABLE.items()
    for n in sides
]


def draw(results: Results) -> Figure:
    """Panels: shear below a parabola pressed in steps, its largest over meshes, inf-sup."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.9))
    for element, sides in SIDES.items():
        curves = results.curves(ALONG.format(element))
        small = {"markersize": 3, "linewidth": 0.6}
        axes[0].plot(curves["x"], curves["shear"], **(LOOK[element] | small))
        largest = [
            results.scalar(f"V15/presses-{element}-{n}", "shear_spurious_inner") for n in sides
        ]
        axes[1].loglog(sides, largest, **(LOOK[element] | {"markersize": 4}))
    axes[0].axhline(0.0, **(LOOK["exact"] | {"marker": "", "linewidth": 0.8, "label": None}))
    axes[0].set(title="(a) shear / ($\\mu p_0$)", xlabel="$x/a$", xlim=(0, 1.1))
    axes[1].set(title="(b) largest, $x < 0.8\\,a$", xlabel="elements over $a$", ylim=(0.015, 3))
    axes[1].set_xticks(SIDES["pw-hybrid-T6"], map(str, SIDES["pw-hybrid-T6"]))
    axes[1].set_xticks([], minor=True)
    axes[1].legend(loc="upper right", fontsize=6, ncols=2, columnspacing=0.8, handletextpad=0.3)
    for cell, sides in STABLE.items():
        for kind, line in (("galerkin", "--"), ("pw", "-")):
            element = f"{kind}-hybrid-{cell}"
            values = [results.scalar(f"V15/infsup-{element}-{n}", "inf_sup") for n in sides]
            look = LOOK[element] | {"markersize": 5, "linestyle": line, "linewidth": 0.8}
            axes[2].semilogx(sides, values, **look)
    axes[2].set(title="(c) inf-sup constant", xlabel="cells along a side", ylim=(0, 0.5))
    axes[2].set_xticks((2, 4, 8, 16, 32), ("2", "4", "8", "16", "32"))
    axes[2].set_xticks([], minor=True)
    short = [handle.get_label().replace(" hybrid", "") for handle in axes[2].lines]
    axes[2].legend(axes[2].lines, short, loc="lower center", fontsize=6, ncols=2)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "A rough parabola (μ = 0.35) is pressed into a half plane in four steps, ν = 0.4999; the "
        "exact shear is zero. (a) Own-function shear with 16 elements over the half width a; (b) "
        "its largest value over the mesh. (c) Inf-sup constant of the whole operator of the hybrid "
        "elements at ν = 1/2 on a unit square and a unit cube fixed at the base."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Shear of the elements of displacements alone scatters between minus and plus 0.8; that of "
        "the hybrid elements is small and falls with the mesh. Inf-sup constants lie between 0.30 "
        "and 0.44 and do not fall with the mesh; the new weights' lie a few per cent below the "
        "standard ones'."
    )
