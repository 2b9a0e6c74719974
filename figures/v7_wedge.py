"""Wedge on an incline: force ratio over friction, and nodal forces along the base."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results
from study.solutions.stick_slip import WEDGE_SLOPE, WEDGE_SPRINGS, wedge_ratio

SECTION = "V7"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"V7/{element}-mu{mu}-16x4" for element in ELEMENTS for mu in WEDGE_SPRINGS]


def draw(results: Results) -> Figure:
    """Panels: horizontal over vertical contact force, nodal normal forces."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(FULL, 2.8))
    mu = np.linspace(0, 0.25, 51)
    left.plot(mu, [wedge_ratio(WEDGE_SLOPE, m) for m in mu], color="black", lw=1.0, label="statics")
    for element in ELEMENTS:
        ratios = [results.scalar(f"V7/{element}-mu{m}-16x4", "ratio") for m in WEDGE_SPRINGS]
        look = {**LOOK[element], "linestyle": "none"}
        if element == "pw-T6":  # both coincide
            look |= {"markerfacecolor": "none", "markersize": 9}
        left.plot(list(WEDGE_SPRINGS), ratios, **look)
        curves = results.curves(f"V7/{element}-mu{max(WEDGE_SPRINGS)}-16x4")
        right.plot(curves["x"], curves["force_n"], **LOOK[element])
    left.set(
        title="(a)",
        xlabel="friction coefficient $\\mu$",
        ylabel="horizontal / vertical force",
        ylim=(0, None),
    )
    right.set(title="(b)", xlabel="$x$ / m", ylabel="nodal normal force / N", ylim=(0, None))
    for ax in (left, right):
        ax.legend(loc="lower right" if ax is left else "lower center")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    sliding = ", ".join(
        f"{results.scalar(f'V7/pw-T6-mu{m}-16x4', 'sliding'):.4f} m" for m in WEDGE_SPRINGS
    )
    return (
        "Wedge pushed up an incline of 1:10 against springs (NAFEMS CGS-4). (a) Ratio of the "
        "total contact forces. (b) Nodal forces normal to the incline at the largest "
        f"friction. Sliding distances for the three friction coefficients: {sliding}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Three measured force ratios on the curve of statics. Nodal forces along the "
        "base: the standard element's alternate by a factor of two, the new element's are even."
    )
