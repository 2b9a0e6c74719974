"""Verification of the GRECO/Raous plate on a rough plane, with open, slip and stick zones."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pw_elements import Material, prescribe
from pw_elements.contact import OPEN, STICK, ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import quadrilaterals, triangles
from study.judge.checks import check
from study.judge.measures.general import scalar
from study.judge.measures.known_solutions import greco_deviation, zone_end
from study.model.contact_result import contact_result
from study.model.discretisation import discretise
from study.model.units import SI_UNITS
from study.model.vocabulary import OWN_FUNCTION_READING
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results

Array = npt.NDArray[np.float64]

SECTION = "V6"
TITLE = "GRECO plate with open, slipping and sticking zones"
FACTS = {
    "geometry": "half of a plate, 40 mm × 40 mm, on a rigid plane",
    "mesh": "16, 32, 64 and 128 squares along a side",
    "material": "linear elastic, plane strain; E = 130 GPa, ν = 0.2",
    "supports": "symmetry at x = 40 mm; contact with μ = 1",
    "load": "pressures of 50 MPa on top and 150 MPa at the left, in one increment",
    "reference": "published displacements of the GRECO benchmark (code_aster SSNV128); a prototype "
    "that shares no code",
    "uncertainty": "called average in the manual; judged by 5 % here",
}
SHORT_FACTS = {
    "reference": "the GRECO benchmark (code_aster SSNV128); a prototype",
    "uncertainty": "average by the manual: 5 % here",
}

# Problem and reference solutions

PROBLEM = r"""
Half of a plate, 40 mm × 40 mm, in plane strain ($E = 130$ GPa, $\nu = 0.2$) lies on a rigid plane with the friction
coefficient 1. A pressure of 50 MPa acts on the top and one of 150 MPa on the left side; $x = 40$ mm is a line of
symmetry. The base has a zone that opens, one that slips and one that sticks. The benchmark is that of the French research
group GRECO (Raous and others); code_aster's validation manual {{ cite("aster") }} publishes horizontal displacements at
five places and calls their uncertainty “average”; 5 %, by which they are judged here, is our reading of that word.
"""

# Half of the plate in SI units; the symmetry line is at x = PLATE_SIDE
PLATE_SIDE = 0.04
YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_COEFFICIENT = 1.3e11, 0.2, 1.0
PRESSURE_TOP, PRESSURE_LEFT = 5e7, 15e7

REFERENCE_POSITIONS = (0.0, 1.25e-3, 5e-3, 7.5e-3, 11.25e-3)
"""Positions x on the base, in m, at which reference displacements are given."""
PUBLISHED_DISPLACEMENTS = (2.86e-5, 2.72e-5, 2.28e-5, 1.98e-5, 1.5e-5)
"""Horizontal displacements in m from code_aster's validation manual, V6.04.128 (SSNV128)."""
PROTOTYPE_DISPLACEMENTS = (2.8602e-5, 2.7225e-5, 2.2868e-5, 1.9807e-5, 1.5414e-5)
"""Horizontal displacements in m from an independent prototype, on 64 × 64 squares of triangles."""
PUBLISHED_UNCERTAINTY = 0.05
"""Relative uncertainty of the published displacements; the manual just says "average"."""

# Method

METHOD = r"""
All loads are applied in one step, on meshes of 16, 32, 64 and (for two of the elements) 128 squares along a side. In
addition to the published values there are values on a finer mesh from a prototype of this study that shares no code with
it (64 × 64 squares of triangles); the direction of its diagonals is not known.
"""


def plate(element: str, squares: int) -> Result:
    """Solve the loaded plate; return displacements and contact forces along its base.

    In addition to those of `contact_result`, the scalars are the horizontal displacements `u_1` to
    `u_5` at `REFERENCE_POSITIONS`, the end `open_up_to` of the open zone, and the start
    `sticking_from` of the stick zone. These ends are midway between two nodes.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        squares: Number of squares along a side; a multiple of 16, so that there are nodes at the
            reference positions.
    """
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = discretise(
        element, partial(_build_plate_mesh, squares), material, StressState.PLANE_STRAIN
    )
    load = body.surface_load((0.0, -PRESSURE_TOP), _is_on_top)
    load.axpy(1.0, body.surface_load((PRESSURE_LEFT, 0.0), _is_on_left_side))
    symmetry = body.supports([prescribe(body.space, 0, _is_on_symmetry_line)])
    contact_pair = ContactPair(_is_on_base, Plane((0.0, 0.0), (0.0, 1.0)), FRICTION_COEFFICIENT)
    states = solve_contact(body.K, load, symmetry, [contact_pair], body.space)

    result = contact_result(body, states, load, _is_on_base, PRESSURE_TOP, SI_UNITS)
    x, u = result.curves["x"], _collect_horizontal_base_displacements(result.curves)
    lengths = {
        f"u_{i}": float(u[np.argmin(np.abs(x - p))])
        for i, p in enumerate(REFERENCE_POSITIONS, start=1)
    }
    lengths |= _find_end_of_open_and_start_of_stick_zone(x, result.curves["status"])
    return replace(
        result,
        scalars={**result.scalars, **lengths},
        units={**result.units, **dict.fromkeys(lengths, SI_UNITS.length)},
        curves={**result.curves, "u": u},
    )


def _find_end_of_open_and_start_of_stick_zone(
    x: Array, status: npt.NDArray[np.integer]
) -> dict[str, float]:
    """Return the end of the open zone and the start of the stick zone by name.

    Args:
        x: Positions (m,) of the contact nodes in ascending order.
        status: Contact status (m,) of these nodes.
    """
    last_open = int(np.flatnonzero(status == OPEN).max())
    first_sticking = int(np.flatnonzero(status == STICK).min())
    return {
        "open_up_to": float(x[last_open : last_open + 2].mean()),
        "sticking_from": float(x[first_sticking - 1 : first_sticking + 1].mean()),
    }


def _collect_horizontal_base_displacements(curves: Mapping[str, np.ndarray]) -> Array:
    """Return the horizontal displacements (m,) of the base nodes, in ascending order of x.

    Args:
        curves: Curves of a result, with `nodes` (n, 2) and `displacement` (n, 2).
    """
    nodes = np.flatnonzero(_is_on_base(curves["nodes"].T))
    nodes = nodes[np.argsort(curves["nodes"][nodes, 0])]
    return curves["displacement"][nodes, 0]


def _build_plate_mesh(squares: int, cell: str) -> Mesh:
    build = triangles if cell == "triangle" else quadrilaterals
    return build(MPI.COMM_SELF, (0.0, 0.0), (PLATE_SIDE, PLATE_SIDE), (squares, squares))


def _is_on_base(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0)


def _is_on_top(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], PLATE_SIDE)


def _is_on_left_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


def _is_on_symmetry_line(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], PLATE_SIDE)


# Cases

ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
SQUARE_COUNTS = (16, 32, 64)
FINEST_SQUARE_COUNTS = {"pw-T6": 128, "galerkin-Q8": 128}
CASES = [
    Case("V6", f"{element}-{n}", plate, {"element": element, "squares": n})
    for element in ELEMENTS
    for n in SQUARE_COUNTS
]
CASES += [
    Case("V6", f"{element}-{n}", plate, {"element": element, "squares": n})
    for element, n in FINEST_SQUARE_COUNTS.items()
]
CASES = mark_costly(CASES, "galerkin-Q8-128", "composite-*-64", "*-Q[89]-64")

# Results

MACROS = r"""
{% macro zone_ends(key) %}{{ fixed(measure("zone_end", key=key, zone="open"), 2) }} | {{ fixed(measure("zone_end", key=key, zone="stick"), 2) }} | {{ fixed(s(key, "sawtooth"), 3) }}{% endmacro %}
"""

RESULT = r"""
{{ figure("v6_greco") }}

{% call table("v6-displacements-of-the-greco-plate", "Displacements of the GRECO plate.") %}
| Horizontal displacement / $10^{-5}$ m at $x$ = | 0 mm | 1.25 mm | 5 mm | 7.5 mm | 11.25 mm | Open up to / mm | Sticks from / mm | Mid-side over corner force |
|---|---:|---:|---:|---:|---:|---:|---:|---:|
{% for element, name in elements %}
| {{ name }}, 64 × 64 |{% for i in range(1, 6) %} {{ fixed(1e5 * s("V6/" ~ element ~ "-64", "u_" ~ i), 4) }} |{% endfor %} {{ zone_ends("V6/" ~ element ~ "-64") }} |
{% endfor %}
{% for element, name in [("pw-T6", "new T6"), ("galerkin-Q8", "standard Q8")] %}
| {{ name }}, 128 × 128 |{% for i in range(1, 6) %} {{ fixed(1e5 * s("V6/" ~ element ~ "-128", "u_" ~ i), 4) }} |{% endfor %} {{ zone_ends("V6/" ~ element ~ "-128") }} |
{% endfor %}
{% for name, reference in [("prototype, 64 × 64", "prototype"), ("published", "published")] %}
| {{ name }} |{% for i in range(1, 6) %} {{ short(1e5 * measure("greco_reference_displacement", place=i, reference=reference), 5) }} |{% endfor %} | | |
{% endfor %}
{% endcall %}

Largest change of one of the five displacements against the new triangle on 128 × 128 squares, in per cent:

{% call table("v6-convergence-of-the-greco-plate", "Convergence of the GRECO plate.") %}
| Element | 16 × 16 | 32 × 32 | 64 × 64 |
|---|---:|---:|---:|
{% for element, name in elements %}
| {{ name }} |{% for n in (16, 32, 64) %} {{ num(measure("greco_change", cases=element ~ "-" ~ n, other="pw-T6-128"), 2) }} |{% endfor %}

{% endfor %}
{% endcall %}
"""


def draw_base_displacements_and_stresses(results: Results) -> Figure:
    """Draw displacements along the base of the GRECO plate, contact stresses, and contact zones.

    The panels show displacements on a fine mesh and stresses on a coarse mesh.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.0))
    _draw_base_displacements(left, results)
    _draw_contact_stresses(right, results)
    for ax, key in ((left, FINE_CASE_KEYS["pw-T6"]), (right, COARSE_CASE_KEYS["pw-T6"])):
        curves = results.curves(key)
        draw_contact_zone_strip(ax, {**curves, "x": 1e3 * curves["x"]})
        ax.set(xlabel="$x$ / mm", xlim=(-1, 41))
    fig.legend(handles=contact_zone_legend_handles(curves), loc="outside lower center", ncols=3)
    return fig


def _draw_base_displacements(ax: Axes, results: Results) -> None:
    for (element, key), line in zip(FINE_CASE_KEYS.items(), ("-", "--"), strict=True):
        curves = results.curves(key)
        look = {**ELEMENT_LOOK[element], "marker": "", "linestyle": line}
        ax.plot(1e3 * curves["x"], 1e5 * curves["u"], **look)
    positions, published = (
        1e3 * np.array(REFERENCE_POSITIONS),
        1e5 * np.array(PUBLISHED_DISPLACEMENTS),
    )
    uncertainty = PUBLISHED_UNCERTAINTY * published
    bars: dict[str, Any] = {"fmt": "ko", "ms": 3.5, "capsize": 2.5, "lw": 0.9}
    ax.errorbar(positions, published, uncertainty, label="published, ± 5 %", **bars)
    ax.set(title="(a) 64 × 64 squares", ylabel="displacement / 10⁻⁵ m", ylim=(0, 3.2))
    ax.legend(loc="upper right")


def _draw_contact_stresses(ax: Axes, results: Results) -> None:
    for element, key in COARSE_CASE_KEYS.items():
        curves = results.curves(key)
        for quantity, line in (("pressure", "-"), ("shear", ":")):
            look = {**ELEMENT_LOOK[element], "linestyle": line, "markersize": 2.5}
            look["label"] = f"{look['label']}: {quantity}"
            if element == "pw-T6":  # drawn over the other element
                look |= {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.6}
            sign = -1.0 if quantity == "shear" else 1.0
            ax.plot(1e3 * curves["x"], 1e-6 * sign * curves[quantity], **look)
    ax.set(title="(b) 16 × 16 squares", ylabel="pressure, shear / MPa", ylim=(-110, 215))
    ax.legend(loc="upper left", fontsize=7)


def caption_base_displacements_and_stresses(results: Results) -> str:
    """Return the caption of displacements and stresses, including the ends of the contact zones."""
    open_end, stick_start = (
        zone_end(results, FINE_CASE_KEYS["pw-T6"], zone) for zone in ("open", "stick")
    )
    return (
        "GRECO plate. (a) Horizontal displacements of the base, in which both elements coincide, "
        "and the published ones; code_aster's manual calls their uncertainty average, the bars of "
        f"5 % are ours. (b) {OWN_FUNCTION_READING.name.capitalize()} stresses; shear is what the plane exerts "
        "against the plate's movement. Strips: contact zones; on the fine mesh the plate is open "
        f"up to {open_end:.1f} mm, slips up to {stick_start:.1f} mm and sticks beyond."
    )


COARSE_CASE_KEYS, FINE_CASE_KEYS = (
    {element: f"V6/{element}-{squares}" for element in ("galerkin-T6", "pw-T6")}
    for squares in (16, 64)
)
FIGURES = [
    PageFigure(
        "v6_greco",
        draw_base_displacements_and_stresses,
        needs=[*COARSE_CASE_KEYS.values(), *FINE_CASE_KEYS.values()],
        caption=caption_base_displacements_and_stresses,
        alt="A falling curve of displacement over x through five published points within their "
        "error bars. Pressure and shear over x, alike for both elements but where zones end.",
    )
]

VERIFICATION = r"""
| GRECO plate | published, uncertainty “average” | displacements, largest deviation | {{ num(measure("greco_deviation", cases="pw-T6-64", reference="published"), 2) }} % | {{ num(measure("greco_deviation", cases="galerkin-T6-64", reference="published"), 2) }} % |
"""

# Findings

CHECKS = [
    check(
        "V6-prototype",
        "GRECO plate: the new triangle on 64 x 64 squares has the displacements of an "
        "independent prototype on as many.",
        lambda results: greco_deviation(
            results, cases={"element": "pw-T6", "squares": 64}, reference="prototype"
        ),
        "=",
        0.0,
        tolerance=0.01,
        tolerance_why="a unit of the last printed digit is up to 0.007 %, and the prototype's diagonals "
        "are not known",
        unit="%",
        why="Both solve the same equations by programs that share no code.",
    ),
    check(
        "V6-sawtooth-pw",
        "GRECO plate: nodal contact forces of the new triangle are even, mid-side over corner.",
        lambda results: scalar(results, key="V6/pw-T6-64", name="sawtooth"),
        "=",
        1.0,
        tolerance=0.001,
        tolerance_why="the pressure bends: the tolerance is that of the mesh",
        why="1/4, 1/2, 1/4 per edge.",
    ),
]

FINDINGS = r"""
1. All elements are within 5 % of the published values on every mesh; the largest deviation,
   {{ fixed(measure("greco_deviation", cases=".*", reference="published"), 1) }} %, is at $x = 11.25$ mm, where the manual
   prints 1.5. It is not a mesh error, since refinement does not reduce it.
2. The displacements hardly depend on the element. They do not converge smoothly, since the boundaries of the zones move
   by whole nodes, so no order is stated.
3. The elements do not differ in their displacements, but they do in their nodal forces: the ratio of mid-side to corner
   forces is {{ fixed(s("V6/galerkin-T6-64", "sawtooth"), 2) }} for the standard triangle and
   {{ fixed(s("V6/pw-T6-64", "sawtooth"), 2) }} for the new one, and in the slip zone the same holds for the shear forces.
4. On the finest mesh the new triangle takes {{ fixed(s("V6/pw-T6-128", "iterations"), 0) }} linear solutions.
"""

# Limits

LIMITS = r"""
The published displacements are those of other programs, on coarse meshes and, it seems, with large displacements; there
is no exact solution. The load acts in one step; friction depends on the loading path, and another path may lead to other
zones.
"""
