"""Where PW = T Galerkin holds and where it fails."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.store import Results

SECTION = "T"
QUANTITIES = (
    "stiffness-plane-stress",
    "stiffness-plane-strain",
    "initial-stress-G",
    "initial-stress-J",
    "surface-load",
    "body-load",
    "stiffness-varying-modulus",
    "body-load-linear",
    "stiffness-curved-sides",
    "stiffness-axisymmetric",
    "initial-stress-linear",
    "mass",
    "point-load",
)
NEEDS = [f"T/{name}" for name in QUANTITIES]


def draw(results: Results) -> Figure:
    """Relative defect of the identity, a row a quantity."""
    fig, ax = plt.subplots(figsize=(FULL, 3.1))
    values = [results.scalar(key, "difference") for key in NEEDS]
    holds = [value < 1e-12 for value in values]
    colors = [LOOK["pw-T6" if h else "galerkin-T6"]["color"] for h in holds]
    ax.barh(range(len(values)), values, color=colors, left=1e-17, height=0.65)
    for row, value in enumerate(values):
        ax.annotate(f"{value:.1e}", (max(value, 1e-17) * 1.4, row), va="center", fontsize=7)
    ax.set_yticks(range(len(values)), [name.replace("-", " ") for name in QUANTITIES])
    ax.set(xscale="log", xlim=(1e-17, 10), xlabel="relative defect of PW = T Galerkin")
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Relative defect |A_PW - T A_G| / |A_PW| on a distorted mesh of straight triangles (curved "
        "ones where named). Blue: an identity up to round-off. Orange: no identity."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return "Bars on a logarithmic scale: " + "; ".join(
        f"{name.replace('-', ' ')} {results.scalar(f'T/{name}', 'difference'):.1e}"
        for name in QUANTITIES
    )
