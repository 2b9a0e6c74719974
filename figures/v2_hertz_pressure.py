"""Hertz contact, pressures over the surface by two measures."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.core.store import Results

SECTION = "V2"
ELEMENTS = ("galerkin-T6", "pw-T6")
KINDS = {"line": "cylinder", "sphere": "sphere"}
NEEDS = [f"V2/{kind}-{element}" for kind in KINDS for element in ELEMENTS]
MEASURES = {"pressure": "own test function", "pressure_tributary": "tributary area"}


def draw(results: Results) -> Figure:
    """Cylinder by both measures, then the sphere."""
    fig, axes = plt.subplots(1, 4, figsize=(FULL, 2.3), sharex=True, sharey=True)
    for pair, (kind, title) in zip((axes[:2], axes[2:]), KINDS.items(), strict=True):
        for ax, (name, label) in zip(pair, MEASURES.items(), strict=True):
            for element in ELEMENTS:
                key = f"V2/{kind}-{element}"
                curves = results.curves(key)
                a, p0 = (results.scalar(key, f"exact_{what}") for what in ("radius", "peak"))
                ax.plot(curves["x"] / a, curves[name] / p0, **LOOK[element])
            s = np.linspace(0, 1, 201)
            ax.plot(s, np.sqrt(1 - s**2), **LOOK["exact"], linestyle="--", zorder=3)
            ax.set_title(f"{title},\n{label}", fontsize=8)
            ax.set(xlim=(-0.02, 1.25), ylim=(0, 1.45))
    axes[0].set_ylabel("pressure / exact peak")
    for ax in axes:
        ax.set_xlabel("$x/a$" if ax in axes[:2] else "$r/a$")
    axes[0].legend(loc="lower left", fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    elements = results.curves(NEEDS[0])["elements"][1]
    return (
        f"Contact pressures of Hertz contacts with {elements:.0f} elements over the half width. "
        "Divided by the integral of their own test function the nodal forces of both elements "
        "follow the exact pressure; divided by the tributary area the standard element's form a "
        "sawtooth. Its node on the sphere's axis has no weight, and no pressure of its own."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Four plots of pressure over distance. On the left both elements lie on the exact "
        "semi-ellipse; on the right the standard element alternates between two thirds and four "
        "thirds of it, and the new element lies on it."
    )
