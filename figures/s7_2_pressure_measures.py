"""One computation read in three ways: nodal force, and two pressures."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.contact import RECONSTRUCTED_NOTE
from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.judge.measures.contact import BLOCK_PRESSURE
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
from study.run.store import Results

SECTION = "7.2"
ELEMENTS = ("galerkin-T6", "pw-T6")
NEEDS = [f"7.2/{element}" for element in ELEMENTS]
PANELS = {
    "force_n": "(a) nodal force / mean",
    "pressure": f"(b) {OWN_FUNCTION_READING.name} pressure / mean",
    "pressure_tributary": f"(c) {TRIBUTARY_READING.name} pressure / mean",
}


def draw(results: Results) -> Figure:
    """Plot nodal force, own-function pressure and tributary pressure along x, one panel each."""
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 1.85), sharey=True)
    for ax, (name, label) in zip(axes, PANELS.items(), strict=True):
        for element in ELEMENTS:
            curves = results.curves(f"7.2/{element}")
            mean = BLOCK_PRESSURE
            if name == "force_n":
                mean = curves["force_n"].sum() / (len(curves["x"]) - 1)
            ax.plot(curves["x"], curves[name] / mean, **ELEMENT_LOOK[element])
        ax.set(xlabel="$x$", title=label, ylim=(0, 2.3), xlim=(-0.1, 4.1))
    axes[1].legend(loc="lower center", fontsize=7)
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "A block pressed and pulled on a rough plane, computed once with either element and read "
        f"in three ways. (a) Nodal forces. (b) {OWN_FUNCTION_READING.name.capitalize()} "
        f"pressure, {OWN_FUNCTION_READING.meaning}: "
        "the standard element's sawtooth disappears. "
        f"(c) {TRIBUTARY_READING.name.capitalize()} pressure, {TRIBUTARY_READING.meaning} it: "
        f"the sawtooth is "
        f"back. {RECONSTRUCTED_NOTE}"
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Three plots over x. Nodal force and pressure over tributary length of the standard "
        "element form a sawtooth; in the middle plot both elements' curves coincide but for the "
        "ends."
    )
