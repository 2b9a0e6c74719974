"""Where PW = T Galerkin and composite = T Galerkin Tᵀ hold, and where they fail."""

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.publish.plots.style import FULL
from study.run.store import Results

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
QUANTITIES = ("stiffness", "initial-stress", "body-load")
HOLDS, FAILS = "#333333", "#BBBBBB"  # colours that no element has
ROUND_OFF = 1e-12
CASES = NEW + tuple(f"composite-{name}" for name in COMPOSITE)
NEEDS = [f"T/{name}" for name in CASES]


def draw(results: Results) -> Figure:
    """Relative defect of both identities, a row a quantity."""
    fig, axes = plt.subplots(
        2, 1, figsize=(FULL, 3.6), sharex=True, height_ratios=(len(NEW), len(COMPOSITE))
    )
    _bars(axes[0], results, NEW, "")
    _bars(axes[1], results, COMPOSITE, "composite-")
    axes[0].set_title(r"(a) new: $\mathbf{A} = \mathbf{T\,A}_\mathrm{standard}$")
    both = r"$\mathbf{A} = \mathbf{T\,A}_\mathrm{standard}\mathbf{T}^\mathsf{T}$"
    axes[1].set_title(f"(b) composite: {both}")
    axes[1].set_xlabel("relative difference of both sides")
    return fig


def _bars(ax: Axes, results: Results, names: tuple[str, ...], prefix: str) -> None:
    values = [results.scalar(f"T/{prefix}{name}", "difference") for name in names]
    colors = [HOLDS if value < ROUND_OFF else FAILS for value in values]
    ax.barh(range(len(values)), values, color=colors, left=1e-17, height=0.65)
    for row, value in enumerate(values):
        mantissa, _, power = f"{value:.1e}".partition("e")
        number = rf"${mantissa} \times 10^{{{int(power)}}}$"
        ax.annotate(number, (max(value, 1e-17) * 1.4, row), va="center", fontsize=7)
    ax.set_yticks(range(len(values)), [_words(name) for name in names])
    ax.set(xscale="log", xlim=(1e-17, 10))
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")


def _words(name: str) -> str:
    """The name of a case with a comma after the quantity: "stiffness, plane stress"."""
    quantity = next((q for q in QUANTITIES if name.startswith(f"{q}-")), name)
    rest = name.removeprefix(quantity).removeprefix("-").replace("-", " ")
    return ", ".join(filter(None, (quantity.replace("-", " "), rest)))


def caption(results: Results) -> str:
    """What the figure shows."""
    return (
        "Relative differences in norm between both sides of the identities, for matrices and load "
        "vectors A on a distorted mesh of straight-sided triangles (curved ones where named). "
        "Dark: an identity up to round-off. Light: no identity."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return "Bars on a logarithmic scale: " + "; ".join(
        f"{name.replace('-', ' ')} {results.scalar(f'T/{name}', 'difference'):.1e}"
        for name in CASES
    )
