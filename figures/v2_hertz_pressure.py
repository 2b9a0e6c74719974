"""Hertz contact, pressures over the surface by two measures."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.model.vocabulary import OWN, TRIBUTARY
from study.run.store import Results

SECTION = "V2"
ELEMENTS = ("galerkin-T6", "pw-T6")
KINDS = {"line": "cylinder", "sphere": "sphere"}
NEEDS = [f"V2/{kind}-{element}" for kind in KINDS for element in ELEMENTS]
MEASURES = {"pressure": OWN.name, "pressure_tributary": TRIBUTARY.name}


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
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    elements = results.curves(NEEDS[0])["elements"][1]
    return (
        f"Hertz contact with {elements:.0f} elements over the half width a. The own-function "
        "pressures of both elements follow the exact pressure; the tributary pressures, as "
        "node-to-surface codes print them, form a sawtooth with the standard element. At its node "
        "on the sphere's axis the integral of the shape function is zero, and there is no "
        "own-function pressure."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Four plots of pressure over distance. In the own-function plots both elements lie on the "
        "exact semi-ellipse; in the tributary plots the standard element alternates between two "
        "thirds and four thirds of it, and the new element lies on it."
    )
