"""Partial slip: errors of pressure and shear over the mesh."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.judge import measures
from study.model.vocabulary import OWN
from study.publish.plots.style import BESIDE, CLEAR, LOOK
from study.run.store import Results

SECTION = "V5"
ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q9")
LEVELS = (10, 20, 40)
NEEDS = [f"V5/{element}-{n}" for element in ELEMENTS for n in LEVELS]
ERRORS = {
    "error_pressure": f"(a) {OWN.name} pressure",
    "error_shear_apart": f"(b) {OWN.name} shear",
}


def draw(results: Results) -> Figure:
    """A panel an error."""
    fig, axes = plt.subplots(1, 2, figsize=(BESIDE, 2.9), sharex=True, sharey=True)
    size = np.array([results.scalar(f"V5/{ELEMENTS[0]}-{n}", "element_size") for n in LEVELS])
    for ax, (name, title) in zip(axes, ERRORS.items(), strict=True):
        for element in ELEMENTS:
            errors = [results.scalar(f"V5/{element}-{n}", name) for n in LEVELS]
            ax.plot(1 / size, errors, **LOOK[element])
        ax.set(xscale="log", yscale="log", xlabel="elements over half width")
        ax.set_title(title, fontsize=8)
        ax.set_xticks(1 / size, [f"{1 / h:.0f}" for h in size], minor=False)
        ax.minorticks_off()
    for order, start in ((1, 1.6e-2), (2, 6e-4)):
        axes[0].plot(1 / size, start * (size / size[0]) ** order, color="#888888", lw=0.8, ls="--")
        axes[0].annotate(
            f"order {order}", (1 / size[1], start * (size[1] / size[0]) ** order),
            xytext=(3, 4) if order == 1 else (-30, -11), textcoords="offset points",
            fontsize=7, color="#666666", bbox=CLEAR,
        )  # fmt: skip
    axes[0].set_ylabel("relative error")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""

    def orders(element: str) -> str:
        both = (
            measures.refinement_order(results, element, name)
            for name in ("error_pressure", "error_shear_apart")
        )
        return f"{LOOK[element]['label']} " + " and ".join(f"{order:.1f}" for order in both)

    return (
        "Root mean square errors of contact pressure and shear where |x| < 0.9 a, shear without "
        "the neighbourhood of the ends of the sticking zone. Mean observed orders of "
        "pressure and shear: " + "; ".join(orders(element) for element in ELEMENTS) + "."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two log-log plots of error over the number of elements. All errors fall, the composite "
        "triangle's with slope one and the others' with slopes near two."
    )
