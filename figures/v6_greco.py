"""GRECO plate: displacements along the base, nodal contact stresses, zones."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.judge import measures
from study.model.vocabulary import OWN
from study.publish.plots.style import FULL, LOOK
from study.publish.plots.zones import zone_legend, zone_strip
from study.run.store import Results
from study.solutions.stick_slip import GRECO_PLACES, GRECO_PUBLISHED

SECTION = "V6"
ELEMENTS = ("galerkin-T6", "pw-T6")
COARSE, FINE = ([f"V6/{element}-{squares}" for element in ELEMENTS] for squares in (16, 64))
NEEDS = COARSE + FINE
HOLLOW = {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.6}  # the new one on the other
ALLOWED = 0.05  # of the published values; the manual calls their uncertainty average


def draw(results: Results) -> Figure:
    """Panels: displacements, fine mesh; stresses, coarse mesh."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(FULL, 3.0))
    for key, line in zip(FINE, ("-", "--"), strict=True):
        curves = results.curves(key)
        look = {**_look(results, key), "marker": "", "linestyle": line}
        left.plot(1e3 * curves["x"], 1e5 * curves["u"], **look)
    places, published = 1e3 * np.array(GRECO_PLACES), 1e5 * np.array(GRECO_PUBLISHED)
    left.errorbar(
        places, published, ALLOWED * published, fmt="ko", ms=3.5, capsize=2.5, lw=0.9,
        label="published, ± 5 %",
    )  # fmt: skip
    left.set(title="(a) 64 × 64 squares", ylabel="displacement / 10⁻⁵ m", ylim=(0, 3.2))
    left.legend(loc="upper right")

    for key in COARSE:
        curves = results.curves(key)
        for quantity, line in (("pressure", "-"), ("shear", ":")):
            look = {**_look(results, key), "linestyle": line, "markersize": 2.5}
            look["label"] = f"{look['label']}: {quantity}"
            look |= HOLLOW if key == COARSE[1] else {}
            sign = -1.0 if quantity == "shear" else 1.0
            right.plot(1e3 * curves["x"], 1e-6 * sign * curves[quantity], **look)
    right.set(title="(b) 16 × 16 squares", ylabel="pressure, shear / MPa", ylim=(-110, 215))
    right.legend(loc="upper left", fontsize=7)
    for ax, key in ((left, FINE[1]), (right, COARSE[1])):
        curves = results.curves(key)
        zone_strip(ax, {**curves, "x": 1e3 * curves["x"]})
        ax.set(xlabel="$x$ / mm", xlim=(-1, 41))
    fig.legend(handles=zone_legend(curves), loc="outside lower center", ncols=3)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    opened, stuck = (measures.zone_end(results, FINE[1], zone) for zone in ("open", "stick"))
    return (
        "GRECO plate. (a) Horizontal displacements of the base, in which both elements coincide, "
        "and the published ones; code_aster's manual calls their uncertainty average, the bars of "
        f"5 % are ours. (b) {OWN.name.capitalize()} stresses; shear is what the plane exerts "
        "against the plate's movement. Strips: contact zones; on the fine mesh the plate is open "
        f"up to {opened:.1f} mm, slips up to {stuck:.1f} mm and sticks beyond."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "A falling curve of displacement over x through five published points within their "
        "error bars. Pressure and shear over x, alike for both elements but where zones end."
    )


def _look(results: Results, key: str) -> dict[str, Any]:
    return LOOK[results[key].parameters["element"]]
