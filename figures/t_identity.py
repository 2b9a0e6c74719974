"""Where PW = T Galerkin and composite = T Galerkin Tᵀ hold, and where they fail."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.core.store import Results

SECTION = "T"
NEW = (
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
COMPOSITE = (
    "stiffness-plane-stress",
    "stiffness-plane-strain",
    "initial-stress-G",
    "initial-stress-J",
    "stiffness-varying-modulus",
    "initial-stress-linear",
    "stiffness-axisymmetric",
    "mass",
)
CASES = NEW + tuple(f"composite-{name}" for name in COMPOSITE)
NEEDS = [f"T/{name}" for name in CASES]


def draw(results: Results) -> Figure:
    """Relative defect of both identities, a row a quantity."""
    fig, axes = plt.subplots(
        2, 1, figsize=(FULL, 3.6), sharex=True, height_ratios=(len(NEW), len(COMPOSITE))
    )
    _bars(axes[0], results, NEW, "")
    _bars(axes[1], results, COMPOSITE, "composite-")
    axes[0].set_title("new element: A = T Galerkin", loc="left")
    axes[1].set_title("composite triangle: A = T Galerkin Tᵀ", loc="left")
    axes[1].set_xlabel("relative defect of the identity")
    return fig


def _bars(ax: Axes, results: Results, names: tuple[str, ...], prefix: str) -> None:
    values = [results.scalar(f"T/{prefix}{name}", "difference") for name in names]
    colors = [LOOK["pw-T6" if value < 1e-12 else "galerkin-T6"]["color"] for value in values]
    ax.barh(range(len(values)), values, color=colors, left=1e-17, height=0.65)
    for row, value in enumerate(values):
        ax.annotate(f"{value:.1e}", (max(value, 1e-17) * 1.4, row), va="center", fontsize=7)
    ax.set_yticks(range(len(values)), [name.replace("-", " ") for name in names])
    ax.set(xscale="log", xlim=(1e-17, 10))
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Relative defects |A_PW - T A_G| / |A_PW| and |A_composite - T A_G Tᵀ| / |A_composite| on "
        "a distorted mesh of straight triangles (curved ones where named). Blue: an identity up to "
        "round-off. Orange: no identity."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return "Bars on a logarithmic scale: " + "; ".join(
        f"{name.replace('-', ' ')} {results.scalar(f'T/{name}', 'difference'):.1e}"
        for name in CASES
    )
