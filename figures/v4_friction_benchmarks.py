"""Four problems of friction with known answers: Spence, Cattaneo and Mindlin, GRECO, a wedge."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.core.store import Results
from study.verification.friction import (
    GRECO_PLACES,
    GRECO_PUBLISHED,
    WEDGE_SLOPE,
    WEDGE_SPRINGS,
    wedge_ratio,
)

SECTION = "V4"
ELEMENTS = ("galerkin-T6", "pw-T6")
CATTANEO = [f"V5/{element}-20" for element in ELEMENTS]
SPENCE = [
    f"V4/pw-T6-nu{nu}-{angle}deg-128"
    for nu, angle in (("0.25", "20.0"), ("0.20", "20.0"), ("0.30", "16.7"), ("0.00", "31.0"))
]
GRECO = [f"V6/{element}-64" for element in ELEMENTS]
WEDGE = {mu: [f"V7/{element}-mu{mu}-16x4" for element in ELEMENTS] for mu in WEDGE_SPRINGS}
NEEDS = [*CATTANEO, *SPENCE, *GRECO, *(key for keys in WEDGE.values() for key in keys)]
STYLES = ("-", "--", "-.", ":")
ALLOWED = 0.05  # of the published displacements; the manual calls their uncertainty average


def draw(results: Results) -> Figure:
    """One panel a problem; exact and published answers are black."""
    fig, axes = plt.subplots(2, 2, figsize=(FULL, 4.5))
    _spence(axes[0, 0], results)
    _cattaneo(axes[0, 1], results)
    _greco(axes[1, 0], results)
    _wedge(axes[1, 1], results)
    handles = [axes[0, 1].lines[0], axes[0, 1].lines[2], axes[0, 1].lines[-1]]
    labels = [LOOK[element]["label"] for element in ELEMENTS]
    fig.legend(handles, [*labels, "known"], loc="outside lower center", ncols=3)
    return fig


def _spence(ax: Axes, results: Results) -> None:
    for key, line in zip(SPENCE, STYLES, strict=True):
        stored = results[key]
        curves, parameters = stored.curves, stored.parameters
        used = np.abs(curves["force_t"]) / (curves["friction"] * curves["force_n"])
        label = f"ν = {parameters['poissons_ratio']:.2f}, μ = {parameters['friction']:.3f}"
        ax.plot(curves["x"], used, color=LOOK["pw-T6"]["color"], ls=line, lw=1.1, label=label)
        ax.plot(2 * [stored.scalars["stick_known"]], [0.9, 1.1], color="black", lw=1.0)
    ax.set(
        title="(a) flat punch: friction used", xlabel="$x/b$", ylabel="shear / ($\\mu$ pressure)"
    )
    ax.set(xlim=(0, 1), ylim=(0, 1.15))
    ax.legend(loc="lower right", fontsize=7)


def _cattaneo(ax: Axes, results: Results) -> None:
    for key, element in zip(CATTANEO, ELEMENTS, strict=True):
        curves, peak = results.curves(key), results.scalar(key, "peak_known")
        for name, scale in (("pressure", peak), ("shear", results.scalar(key, "friction") * peak)):
            hollow = {"markerfacecolor": "none", "markersize": 6, "ls": "none"}
            look = LOOK[element] | ({"markersize": 3} if element == "galerkin-T6" else hollow)
            ax.plot(curves["x"], curves[name] / scale, **{**look, "ls": "none"})
    x = np.linspace(-1, 1, 801)
    stick = results.scalar(CATTANEO[1], "stick_known")
    pressure = np.sqrt(1 - x**2)
    for exact in (pressure, pressure - stick * np.sqrt(np.maximum(0, 1 - (x / stick) ** 2))):
        ax.plot(x, exact, color="black", lw=0.9)
    ax.set(title="(b) partial slip", xlabel="$x/a$", xlim=(-1.15, 1.15))
    ax.set(ylabel="$p/p_0$ and $q/(\\mu p_0)$", ylim=(0, 1.1))


def _greco(ax: Axes, results: Results) -> None:
    for key, element, line in zip(GRECO, ELEMENTS, ("-", "--"), strict=True):
        curves = results.curves(key)
        ax.plot(1e3 * curves["x"], 1e5 * curves["u"], color=LOOK[element]["color"], ls=line)
    published = 1e5 * np.array(GRECO_PUBLISHED)
    places = 1e3 * np.array(GRECO_PLACES)
    ax.errorbar(places, published, ALLOWED * published, fmt="ko", ms=3.5, capsize=2.5, lw=0.9)
    ax.set(title="(c) GRECO plate: base", xlabel="$x$ / mm", ylabel="displacement / 10⁻⁵ m")
    ax.set(xlim=(-1, 41), ylim=(0, 3.2))


def _wedge(ax: Axes, results: Results) -> None:
    mu = np.linspace(0, 0.25, 51)
    ax.plot(mu, [wedge_ratio(WEDGE_SLOPE, m) for m in mu], color="black", lw=1.0)
    for place, element in enumerate(ELEMENTS):
        ratios = [results.scalar(keys[place], "ratio") for keys in WEDGE.values()]
        hollow = {"markerfacecolor": "none", "markersize": 9} if place else {}
        ax.plot(list(WEDGE), ratios, **{**LOOK[element], **hollow, "linestyle": "none"})
    ax.set(title="(d) wedge on an incline", xlabel="friction coefficient $\\mu$", ylim=(0, None))
    ax.set_ylabel("horizontal / vertical force")


def caption(results: Results) -> str:
    """What the figure shows."""
    stick, exact = (results.scalar(CATTANEO[1], name) for name in ("stick", "stick_known"))
    return (
        "Friction with known answers (black). (a) Flat punch of half width b on a half plane, new "
        "T6, 128 elements below one half: shear over the largest possible one; black ticks: end of "
        "sticking by this study's boundary-element program (± 0.003 b). (b) Pressure p and shear "
        "q of two equal cylinders pressed together and pulled by half of what friction can hold, "
        "16 elements over the half width a; sticking ends at "
        f"{stick:.3f} a (exact {exact:.3f} a). (c) GRECO plate, 64 × 64 squares, and the published "
        "displacements with bars of 5 %, for an uncertainty that is called average. (d) Wedge "
        "pushed up an incline of 1:10 (NAFEMS CGS-4)."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Four panels. Used friction rises to one where the known stick radii are; pressure and "
        "shear of both elements lie on the exact curves; displacements of the plate's base pass "
        "through five published points; force ratios of the wedge lie on the curve of statics."
    )
