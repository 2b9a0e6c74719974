"""Verification of Hertz contact: rigid cylinder on a half plane, rigid sphere on a half space."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from pw_elements.contact import Parabola, Sphere
from pw_elements.elasticity import StressState
from study.judge.checks import check
from study.judge.measures.general import largest, ratio, smallest
from study.model.units import N_MM_UNITS, assign_units_to_scalars
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
from study.publish.plots import convergence
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results
from study.solutions.half_space import ElasticHalfSpace, HertzLine, HertzSphere
from study.solutions.indentation import (
    BODY_SIZE,
    ELEMENTS,
    Indenter,
    solve_indentation_on_refined_meshes,
)

SECTION = "V2"
TITLE = "Hertz contact"
FACTS = {
    "geometry": "a rigid cylinder on a half plane, a rigid sphere on a half space, both of radius "
    "50 mm; one half, five half widths of the contact wide and deep",
    "mesh": "4, 8, 16 and 32 elements over the contact's half width a, growing by 1.3 outside",
    "material": "linear elastic, ν = 0.3; the composite modulus of steel (210 GPa) on aluminium "
    "(70 GPa), as in NAFEMS R0094-1; for the sphere E = 70 GPa",
    "supports": "exact displacements of the half space on the outer sides; smooth contact",
    "load": "a normal force of 35 kN (for the cylinder, per mm of its length)",
    "reference": "H. Hertz (1882)",
    "uncertainty": "none from the body's size; errors are root mean squares over four positions of "
    "the contact's edge in an element",
}
SHORT_FACTS = {
    "uncertainty": "none from the body's size; root mean squares over four positions of the "
    "contact's edge"
}

# Problem and exact solution

PROBLEM = r"""
A rigid parabola is pressed into a half plane, a rigid sphere into a half space {{ cite("johnson") }}. The exact
displacements are prescribed on the outer sides of the meshed bodies, so that there is no truncation error.
"""

THEORY = r"""
Hertz' solution gives the half width $a$ of the contact, the pressure $p_0 \sqrt{1 - x^2/a^2}$, and for the sphere the
depth $a^2/R$.

**Relation to NAFEMS R0094-1.** That benchmark (A. W. A. Konter, 2006) presses a steel cylinder of radius 50 mm
($E = 210$ GPa) with 35 kN into an aluminium block of 200 mm × 200 mm × 1 mm ($E = 70$ GPa; $\nu = 0.3$ for both) and
prints the solution of Hertz' theory, $a = 6.215$ mm and $p_0 = 3585.4$ MPa. Here the indenter is rigid; section V11
treats the benchmark with both bodies elastic. By that same theory a rigid cylinder of the same radius on a half plane of
modulus $1/E^* = (1 - \nu_1^2)/E_1 + (1 - \nu_2^2)/E_2$ has the same $a$ and $p_0$, and this problem is computed here. The
variant of the benchmark with friction is not treated.
"""

# Data of NAFEMS R0094-1 in N and mm
RADIUS, FORCE, POISSONS_RATIO = 50.0, 35e3, 0.3
STEEL_MODULUS, ALUMINIUM_MODULUS = 210e3, 70e3


def make_exact_hertz_line_contact() -> HertzLine:
    """Return Hertz's solution of a rigid cylinder on a half plane of composite modulus."""
    compliance = (1 - POISSONS_RATIO**2) * (1 / STEEL_MODULUS + 1 / ALUMINIUM_MODULUS)
    body = ElasticHalfSpace((1 - POISSONS_RATIO**2) / compliance, POISSONS_RATIO)
    return HertzLine(body, RADIUS, FORCE)


# Method

METHOD = r"""
One half of the body is modelled, a square of side $5a$, with the **exact displacements of the half space on the outer
sides** (Flamant's and Boussinesq's solutions, superposed for Hertz' pressure), so that the finite size of the body adds
no error; the force on the cylinder is prescribed. The gap is measured to Hertz' parabola. There are 4, 8, 16 and 32 equal
elements over $a$, and sizes grow by a factor of 1.3 away from the contact; each error is the root mean square over four
meshes in which the edge of the contact zone falls at different positions within an element. Three measures are compared
with the exact pressure:

1. the nodal force, compared with the integral of the exact pressure over the node's tributary length (sum of absolute
   differences over the total force);
2. the force over the integral of the node's own test function, compared with the pressure at the node (root mean square);
3. the force over the tributary area, as node-to-surface codes print it, also compared with the pressure at the node.

The exact pressure falls like a square root at its edge. There the nodal error is about $\sqrt{h}$ over a length $h$, which
results in order 1 for the root mean square and 3/2 for the sum of forces; away from the edge (the inner 80 %), a weighted
mean taken as a nodal value is of order 2.
"""

ELEMENT_COUNTS = (4, 8, 16, 32)
"""Numbers of elements over the half width of the contact."""
CONTACT_EDGE_OFFSETS = (0.125, 0.375, 0.625, 0.875)
"""Positions of the contact edge within an element, as fractions of the element's length."""
MAX_RELATIVE_CONTACT_WIDTH = 1.3
"""Distance from the middle, over the contact half width, within which nodes may touch."""


def cylinder(
    element: str, true_circle: bool = False, outer: float = BODY_SIZE, far_field: bool = True
) -> Result:
    """Solve the contact of a rigid cylinder with a half plane on a series of meshes.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        true_circle: Whether gaps are measured along the normal of the circle; otherwise they are
            measured vertically to Hertz's parabola.
        outer: Side of the meshed body over the half width of the contact.
        far_field: Whether the exact displacements are prescribed on the outer sides; otherwise
            these are fixed.
    """
    circle = Sphere((0.0, RADIUS), RADIUS)
    surface = circle if true_circle else Parabola((0.0, 0.0), RADIUS)
    indenter = Indenter(
        make_exact_hertz_line_contact(), surface, StressState.PLANE_STRAIN, N_MM_UNITS
    )
    return _solve_refinement_series_of_hertz_contact(element, indenter, outer, far_field)


def sphere(element: str, outer: float = BODY_SIZE, far_field: bool = True) -> Result:
    """Solve the contact of a rigid sphere with an aluminium half space in axisymmetry.

    Radius and force are those of the cylinder.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        outer: Side of the meshed body over the contact radius.
        far_field: Whether the exact displacements are prescribed on the outer sides; otherwise
            these are fixed.
    """
    exact = HertzSphere(ElasticHalfSpace(ALUMINIUM_MODULUS, POISSONS_RATIO), RADIUS, FORCE)
    paraboloid = Parabola((0.0, 0.0), RADIUS)
    indenter = Indenter(exact, paraboloid, StressState.AXISYMMETRIC, N_MM_UNITS)
    return _solve_refinement_series_of_hertz_contact(element, indenter, outer, far_field)


def _solve_refinement_series_of_hertz_contact(
    element: str, indenter: Indenter, outer: float, far_field: bool
) -> Result:
    exact = indenter.exact_contact
    assert isinstance(exact, HertzLine | HertzSphere)
    meshes = {
        n: [
            _make_contact_zone_mesh_lines(exact.half_width, n + position)
            for position in CONTACT_EDGE_OFFSETS
        ]
        for n in ELEMENT_COUNTS
    }
    result = solve_indentation_on_refined_meshes(element, indenter, meshes, outer, far_field)
    scalars = {
        "exact_radius": exact.half_width,
        "exact_peak": exact.peak_pressure,
        "indenter_radius": exact.radius,
    }
    unit_kinds = {"*_radius": "length", "exact_peak": "stress"}
    return replace(
        result,
        scalars={**result.scalars, **scalars},
        units={**result.units, **assign_units_to_scalars(scalars, unit_kinds, indenter.units)},
    )


def _make_contact_zone_mesh_lines(
    half_width: float, elements_over_half_width: float
) -> npt.NDArray[np.float64]:
    size = half_width / elements_over_half_width
    return size * np.arange(np.ceil(MAX_RELATIVE_CONTACT_WIDTH * elements_over_half_width) + 1)


# Cases

CASE_FUNCTIONS = (("line", cylinder), ("sphere", sphere))
CASES = [
    Case("V2", f"{name}-{element}", problem, {"element": element})
    for name, problem in CASE_FUNCTIONS
    for element in ELEMENTS
]
CASES += [
    Case("V2", f"{name}-pw-T6-{suffix}", problem, {"element": "pw-T6", **size})
    for name, problem in CASE_FUNCTIONS
    for suffix, size in (("held", {"far_field": False}), ("outer10", {"outer": 10.0}))
]
CASES.append(Case("V2", "line-pw-T6-circle", cylinder, {"element": "pw-T6", "true_circle": True}))
CASES = mark_costly(CASES, "*-pw-T6-*", "*-pw-Q8")

# Results

RESULT = r"""
{{ figure("v2_hertz_pressure") }}

{% call table("hertz", "Hertz contact: relative error of the pressure with 32 elements over the half width, in per cent (root mean square over four positions of the edge of contact within an element). In brackets: observed order over the last two doublings of the mesh.") %}
| Element | Cylinder: tributary, all nodes | own-function, all nodes | own-function, inner 80 % | Sphere: tributary, all nodes | own-function, all nodes | own-function, inner 80 % |
|---|---:|---:|---:|---:|---:|---:|
{% for element in ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q9") %}
| {{ names[element] }} |{% for kind in ("line", "sphere") %}{% set key = "V2/" ~ kind ~ "-" ~ element %}{% for error in ("pressure_tributary", "pressure_own", "pressure_own_inner") %} {{ num(100 * s(key, "error_" ~ error), 2) }} ({{ fixed(s(key, "order_" ~ error), 1) }}) |{% endfor %}{% endfor %}

{% endfor %}
{% endcall %}

{{ figure("v2_hertz_convergence") }}
"""

DETAILS = r"""
{% for kind, words in [("line", "Cylinder"), ("sphere", "Sphere")] %}
{% call table("v2-" ~ kind, words ~ ", 32 elements over a: other errors, relative; observed orders over the last two doublings in brackets.") %}
| Element | Nodal forces | Peak | Depth | Half width | Mid-side over corner force |
|---|---:|---:|---:|---:|---:|
{% for element, name in elements %}{% set key = "V2/" ~ kind ~ "-" ~ element %}
| {{ name }} |{% for error in ("force", "peak", "approach") %} {{ num(s(key, "error_" ~ error), 2) }} ({{ fixed(s(key, "order_" ~ error), 1) }}) |{% endfor %} {{ num(s(key, "error_radius"), 2) }} | {{ fixed(s(key, "sawtooth"), 3) }} |
{% endfor %}
{% endcall %}
{% endfor %}
"""


def draw_hertz_pressures(results: Results) -> Figure:
    """Draw the pressures of Hertz contact over the distance from the middle, by two measures.

    Two panels show the cylinder and two the sphere, with one panel for each measure.
    """
    fig, axes = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 2.3), sharex=True, sharey=True)
    measures = {"pressure": OWN_FUNCTION_READING.name, "pressure_tributary": TRIBUTARY_READING.name}
    for pair, (kind, title) in zip((axes[:2], axes[2:]), INDENTER_TITLES.items(), strict=True):
        for ax, (name, label) in zip(pair, measures.items(), strict=True):
            for element in ("galerkin-T6", "pw-T6"):
                key = f"V2/{kind}-{element}"
                curves = results.curves(key)
                a, p0 = (results.scalar(key, name) for name in ("exact_radius", "exact_peak"))
                ax.plot(curves["x"] / a, curves[name] / p0, **ELEMENT_LOOK[element])
            s = np.linspace(0, 1, 201)
            ax.plot(s, np.sqrt(1 - s**2), **ELEMENT_LOOK["exact"], linestyle="--", zorder=3)
            ax.set_title(f"{title},\n{label}", fontsize=8)
            ax.set(xlim=(-0.02, 1.25), ylim=(0, 1.45))
    axes[0].set_ylabel("pressure / exact peak")
    for ax in axes:
        ax.set_xlabel("$x/a$" if ax in axes[:2] else "$r/a$")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def draw_convergence_to_hertz_pressure(results: Results) -> Figure:
    """Draw the convergence of contact pressures to Hertz's solution.

    The rows show cylinder and sphere, the columns show different error measures.
    """
    errors = {
        "error_pressure_tributary": f"{TRIBUTARY_READING.name}, all nodes",
        "error_pressure_own": f"{OWN_FUNCTION_READING.name}, all nodes",
        "error_pressure_own_inner": f"{OWN_FUNCTION_READING.name}, inner 80 %",
    }
    orders_and_heights = {
        "error_pressure_own": [(1, 7e-2)],
        "error_pressure_own_inner": [(1, 3e-2), (2, 1.4e-3)],
    }
    fig, axes = plt.subplots(2, 3, figsize=(PAGE_WIDTH, 3.9), sharex=True, sharey=True)
    for row, (kind, title) in zip(axes, INDENTER_TITLES.items(), strict=True):
        keys = {element: f"V2/{kind}-{element}" for element in convergence.ELEMENTS}
        for ax, name in zip(row, errors, strict=True):
            convergence.set_log_axes_with_element_ticks(ax, results, CONVERGENCE_CASE_KEYS[0])
            convergence.plot_error_over_number_of_elements(ax, results, keys, name)
            for order, height in orders_and_heights.get(name, []):
                convergence.draw_line_of_convergence_order(
                    ax, results, CONVERGENCE_CASE_KEYS[0], order, height
                )
        row[0].set_ylabel(f"{title}: error")
    for top, bottom, title in zip(*axes, errors.values(), strict=True):
        top.set_title(title, fontsize=8)
        bottom.set_xlabel("elements over half width")
    convergence.add_element_legend_below_axes(fig, axes[0, 0])
    return fig


def caption_hertz_pressures(results: Results) -> str:
    """Return the caption of the pressure figure, including the number of elements."""
    elements = results.curves("V2/line-galerkin-T6")["elements"][1]
    return (
        f"Hertz contact with {elements:.0f} elements over the half width a. The own-function "
        "pressures of both elements follow the exact pressure; the tributary pressures, as "
        "node-to-surface codes print them, form a sawtooth with the standard element. At its node "
        "on the sphere's axis the integral of the shape function is zero, and there is no "
        "own-function pressure."
    )


INDENTER_TITLES = {"line": "cylinder", "sphere": "sphere"}
CONVERGENCE_CASE_KEYS = [
    f"V2/{kind}-{element}" for kind in INDENTER_TITLES for element in convergence.ELEMENTS
]
FIGURES = [
    PageFigure(
        "v2_hertz_pressure",
        draw_hertz_pressures,
        needs=[
            f"V2/{kind}-{element}"
            for kind in INDENTER_TITLES
            for element in ("galerkin-T6", "pw-T6")
        ],
        caption=caption_hertz_pressures,
        alt="Four plots of pressure over distance. In the own-function plots both elements lie on "
        "the exact semi-ellipse; in the tributary plots the standard element alternates between "
        "two thirds and four thirds of it, and the new element lies on it.",
    ),
    PageFigure(
        "v2_hertz_convergence",
        draw_convergence_to_hertz_pressure,
        needs=CONVERGENCE_CASE_KEYS,
        caption="Relative root mean square error of the contact pressure against Hertz's (over "
        "four positions of the edge of contact within an element). The condensed pair of new "
        "triangles has the errors of the new triangle. In tributary pressure, as node-to-surface "
        "codes print it, both standard elements stay off by a third.",
        alt="Six log-log plots of error over the number of elements. By the tributary area the "
        "standard elements stay at one third; by the own test function all elements fall with "
        "slope one, and away from the contact's edge with slopes near two, but for the composite "
        "triangle, which keeps slope one.",
    ),
]

VERIFICATION = r"""
| Hertz: cylinder, inner 80 % | exact | pressure, rms | {{ pct(s("V2/line-pw-T6", "error_pressure_own_inner")) }} | {{ pct(s("V2/line-galerkin-T6", "error_pressure_own_inner")) }} |
| Hertz: sphere (axisymmetric), inner 80 % | exact | pressure, rms | {{ pct(s("V2/sphere-pw-T6", "error_pressure_own_inner")) }} | {{ pct(s("V2/sphere-galerkin-T6", "error_pressure_own_inner")) }} |
"""

# Findings

CHECKS = [
    check(
        "V2-edge",
        "The contact ends within one node distance from where it should, for all elements "
        "on all meshes.",
        lambda results: largest(
            results, section="V2", cases="(line|sphere)-.*-(T6|Q8|Q9)", name="off_edge"
        ),
        "<=",
        1.0,
        tolerance_why="none: a distance in nodes",
        why="Which nodes touch is decided by the signs of nodal forces and gaps.",
    ),
    check(
        "V2-tributary",
        "The standard elements' pressure as node-to-surface codes print it, over the "
        "tributary area, does not converge: it stays off by a third.",
        lambda results: smallest(
            results,
            section="V2",
            cases={"element": ["galerkin-Q8", "galerkin-T6"]},
            name="error_pressure_tributary",
        ),
        "=",
        0.3333,
        tolerance=0.01,
        tolerance_why="1 %: the contact's edge",
        why="Root mean square of 2/3 - 1 and 4/3 - 1, each for half of the length.",
    ),
    check(
        "V2-pw-better",
        "Cylinder: over all nodes the new triangle's pressure error is less than half of "
        "the standard triangle's, each read over its own test function.",
        lambda results: ratio(
            results, key="V2/line-pw-T6", other="V2/line-galerkin-T6", name="error_pressure_own"
        ),
        "<",
        0.5,
        tolerance_why="none: a bound",
        why="They differ at the edge, where the narrow test functions of mid-side and corner "
        "nodes show better which node touches. In the inner part they are nearly the same; "
        "below a sphere the new one's error is larger there.",
    ),
]

FINDINGS = r"""
In own-function pressure every element converges: with order 1 over all nodes, because the exact pressure ends like a
square root, and with order up to 2 over the inner 80 % of the contact. In tributary pressure, as node-to-surface codes
print it, the standard elements do not converge at all. Inside the contact of the cylinder the error of the new triangle
is {{ fixed(measure("ratio", key="V2/line-pw-T6", other="V2/line-galerkin-T6", name="error_pressure_own_inner"), 2) }}
times that of the standard one. Over all nodes it is
{{ fixed(measure("ratio", key="V2/line-pw-T6", other="V2/line-galerkin-T6", name="error_pressure_own"), 2) }} (cylinder) and
{{ fixed(measure("ratio", key="V2/sphere-pw-T6", other="V2/sphere-galerkin-T6", name="error_pressure_own"), 2) }} times
(sphere): the gain is at the edge of contact. The composite triangle, whose surface is linear between nodes, stays at
order 1. In NAFEMS benchmark R0094-1 {{ cite("konter") }}, restated as a rigid cylinder on a body of the same combined
stiffness, the new triangle gives a peak pressure of {{ fixed(s("V2/line-pw-T6", "peak_pressure"), 1) }} MPa (exact
{{ fixed(s("V2/line-pw-T6", "exact_peak"), 1) }} MPa).
"""

FURTHER_FINDINGS = r"""
1. The forces of the standard triangle times $\boldsymbol{T}$, read by $\boldsymbol{T}$ times its weights, have an error of
   {{ num(s("V2/line-galerkin-T6", "error_pressure_transferred"), 2) }}, between
   {{ num(s("V2/line-galerkin-T6", "error_pressure_own"), 2) }} without $\boldsymbol{T}$ and
   {{ num(s("V2/line-pw-T6", "error_pressure_own"), 2) }} for the new triangle. The native quadrilateral is the most
   accurate.
2. **The composite triangle** is of order one even away from the edge,
   {{ fixed(measure("ratio", key="V2/line-composite-T6", other="V2/line-pw-T6", name="error_pressure_own_inner"), 0) }}
   times less accurate than the new one on the finest mesh: its surface is linear between nodes, and the gap is curved.
3. **The axis.** In axisymmetry the node of the standard elements on the axis carries no force, so that the pressure
   cannot be obtained where it has its peak.
4. **Finite bodies.** On a body twice as large the errors are
   {{ fixed(measure("ratio", key="V2/line-pw-T6-outer10", other="V2/line-pw-T6", name="error_pressure_own"), 3) }}
   (cylinder) and
   {{ fixed(measure("ratio", key="V2/sphere-pw-T6-outer10", other="V2/sphere-pw-T6", name="error_pressure_own"), 3) }}
   (sphere) times those given here. With its outer sides fixed instead, the peak is off by
   {{ num(100 * s("V2/line-pw-T6-held", "error_peak"), 2) }} % (cylinder) and
   {{ num(100 * s("V2/sphere-pw-T6-held", "error_peak"), 2) }} % (sphere) on the finest mesh. With the true circle's gaps
   and normals instead of the parabola's the cylinder's peak is off by
   {{ num(100 * s("V2/line-pw-T6-circle", "error_peak"), 2) }} %, since $a/R$ =
   {{ fixed(s("V2/line-pw-T6", "exact_radius") / s("V2/line-pw-T6", "indenter_radius"), 2) }} is not small.
"""

# Limits

LIMITS = r"""
The parabola shares Hertz' approximations (small slopes, gaps along the axis), so they are not tested. The far field is
prescribed from the exact solution, so the check covers the contact, not the size or shape of a body. Two deformable
bodies are treated in sections V5 and V11.
"""
