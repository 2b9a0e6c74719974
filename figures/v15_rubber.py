"""Nearly incompressible bodies: errors over the mesh, and the pressure of Hertz's line contact."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK, plain_ticks
from study.run.store import Results

SECTION = "V15"
SHOWN = ("galerkin-T6", "pw-T6", "galerkin-hybrid-T6", "pw-hybrid-T6")
SIDES = (8, 16, 32)
NEEDS = [f"V15/square-{e}-0.4999-{n}" for e in SHOWN for n in SIDES]
NEEDS += [f"V15/hertz-{e}-8" for e in SHOWN]


def draw(results: Results) -> Figure:
    """Panels: errors of slopes and of pressure on the square, pressure under the parabola."""
    fig, axes = plt.subplots(1, 3, figsize=(FULL, 2.9))
    for element in SHOWN:
        cases = [f"V15/square-{element}-0.4999-{n}" for n in SIDES]
        for ax, name in zip(axes, ("h1_error", "pressure_error"), strict=False):
            errors = [100 * results.scalar(case, name) for case in cases]
            # the new elements' lie on the standard ones'
            new = {"markerfacecolor": "none", "markersize": 8, "linestyle": ":"}
            look = LOOK[element] | (new if element.startswith("pw") else {"markersize": 4})
            ax.loglog(SIDES, errors, **look)
        curves = results.curves(f"V15/hertz-{element}-8")
        look = LOOK[element] | {"linestyle": "none", "markersize": 4, "zorder": 2}
        axes[2].plot(curves["x"], curves["pressure"] / curves["exact_pressure"].max(), **look)
    s = np.linspace(0, 1, 401)
    axes[2].plot(s, np.sqrt(1 - s**2), **(LOOK["exact"] | {"linewidth": 0.9, "zorder": 3}))
    titles = ("(a) square: H1 error / %", "(b) square: pressure error / %")
    for ax, title in zip(axes, titles, strict=False):
        ax.set(title=title, xlabel="cells along a side")
        plain_ticks(ax)
        ax.set_xticks(SIDES, map(str, SIDES))
        ax.set_xticks([], minor=True)
    axes[2].set(
        title="(c) Hertz contact", xlabel="$x/a$", ylabel="pressure / $p_0$", xlim=(-0.03, 1.15)
    )
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Nearly incompressible bodies, ν = 0.4999. Relative errors (a) of the displacement "
        "gradient and (b) of the pressure against a manufactured solution; the new elements' lie "
        "on the standard ones'. (c) Own-function pressures below a rigid parabola, eight elements "
        "over the half width a; the line is exact."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two plots of errors that fall with the number of cells, those of the hybrid elements by "
        "second order and far below the others; and pressures, which lie on half an ellipse with "
        "the hybrid elements and scatter around it with the others."
    )
