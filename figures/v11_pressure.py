"""Two deformable bodies: pressures of all ways on the same meshes."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.model.vocabulary import OWN, WAYS
from study.publish.plots.style import FULL, WAY_LOOK
from study.run.store import Results

SECTION = "V11"
PROBLEMS = {"hertz-2d-{}-4": "cylinders, 4 edges", "spheres-{}-3": "spheres, 3 edges"}
NEEDS = [f"V11/{problem.format(way)}" for problem in PROBLEMS for way in WAYS]


def draw(results: Results) -> Figure:
    """A panel for each problem and way; the line is exact."""
    fig, axes = plt.subplots(2, len(WAYS), figsize=(FULL, 3.1), sharex=True, sharey=True)
    s = np.linspace(0, 1, 401)
    for row, (problem, title) in zip(axes, PROBLEMS.items(), strict=True):
        for ax, way in zip(row, WAYS, strict=True):
            curves = results.curves("V11/" + problem.format(way))
            r = np.linalg.norm(curves["x"][:, :-1], axis=1)
            look = WAY_LOOK[way] | {"linestyle": "none", "markersize": 2.0}
            ax.plot(r, curves["pressure"], **look)
            ax.plot(s, np.sqrt(1 - s**2), color="black", linewidth=0.8)
            ax.set(xlim=(-0.03, 1.25), ylim=(-0.3, 1.5))
        row[0].set_ylabel(f"{title}\n$p/p_0$")
    for ax, way in zip(axes[0], WAYS, strict=True):
        ax.set_title(WAYS[way].name.replace(", ", ",\n"), fontsize=6)
    for ax in axes[1]:
        ax.set_xlabel("distance$/a$")
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    r = {way: results.curves(f"V11/spheres-{way}-3")["pressure"] for way in WAYS}
    out = sum(int(np.sum((p < -0.3) | (p > 1.5))) for p in r.values())
    return (
        "Pressures at the slave's nodes over Hertz's peak pressure p₀ and half width (radius) a; "
        "E₂/E₁ = 3, no friction, four edges over the half width of two cylinders and three over "
        f"the radius of two spheres. Lines are exact. {out} nodes lie outside the panels. With "
        "both of the new weights' ways and node to segment, the pressure is the "
        f"{OWN.meaning}; node to segment has none at corners of the spheres' tetrahedra. With the "
        "others it is the multiplier."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Two rows of six plots of pressure over radius with half an ellipse. Points of the three "
        "dual ways and of node to segment lie on the ellipses, but for a bulge of the first near "
        "the edge of the spheres' contact; those of standard multipliers waver about them."
    )
