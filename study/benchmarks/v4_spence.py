"""Verification of Spence's problem: stick radius below a flat punch with friction."""

from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pw_elements import Material, prescribe
from pw_elements.contact import STICK, ContactPair, FlatPunch, Motion, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from study.judge.checks import check
from study.judge.measures.general import scalar_difference
from study.judge.measures.stored_cases import select_results
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_lines import geometrically_growing_lines
from study.model.contact_result import contact_result
from study.model.discretisation import Discretisation, discretise
from study.model.units import DIMENSIONLESS_UNITS
from study.model.vocabulary import OWN_FUNCTION_READING
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.publish.plots.zones import contact_zone_legend_handles, draw_contact_zone_strip
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results
from study.solutions.half_space import ElasticHalfSpace

Array = npt.NDArray[np.float64]

SECTION = "V4"
TITLE = "Stick radius below a flat punch with friction"
FACTS = {
    "geometry": "a flat punch of half width 1 on a half plane; one half, 5 wide and deep",
    "mesh": "16, 32, 64 and 128 elements below half of the punch, four times finer at its edge",
    "material": "linear elastic, plane strain; E = 1; ν = 0.25, 0.2, 0.3 and 0 with μ = tan 20°, "
    "tan 20°, 0.3 and 0.6",
    "supports": "outer sides moved as in a half plane under the computed forces; contact with "
    "friction",
    "load": "a normal force of 0.001 in two increments (one and ten give the same)",
    "reference": "stick radii of D. A. Spence's problem (1973), by a boundary-element program of "
    "this study",
    "uncertainty": "± 0.003 by that program's own estimate; there are no published values",
}
SHORT_FACTS = {
    "reference": "D. A. Spence's radii (1973) by our boundary elements",
    "uncertainty": "± 0.003 by its own estimate; no values are published",
}

# Problem and reference solution

PROBLEM = r"""
A rigid flat punch of half width $b$ is pressed on an elastic half plane with friction. The surface below it tends to move
inwards; it sticks for $|x| < c$ and slips outside. The load grows monotonically, and Spence {{ cite("spence") }} showed
that $c/b$ then depends only on Poisson's ratio and friction. Unlike in section V5, pressure and shear influence each
other.
"""

REFERENCE_STICK_RADII = {
    (0.25, float(np.tan(np.deg2rad(20)))): 0.696,
    (0.20, float(np.tan(np.deg2rad(20)))): 0.588,
    (0.3, 0.3): 0.688,
    (0.0, 0.6): 0.653,
}
"""Stick radius c/b in plane strain, by Poisson's ratio and coefficient of friction.

The values are from a boundary-element program of this study for the half plane.
"""
REFERENCE_RADIUS_ACCURACY = 0.003
"""Accuracy of `REFERENCE_STICK_RADII` as estimated by the boundary-element program."""


def equivalent_plane_strain_material(
    youngs_modulus: float, poissons_ratio: float, state: StressState
) -> ElasticHalfSpace:
    """Return the plane-strain material that has the same plane fields as a given material.

    Args:
        youngs_modulus: Young's modulus of the given material.
        poissons_ratio: Poisson's ratio of the given material.
        state: Stress state of the given material, plane strain or plane stress.
    """
    if state is StressState.PLANE_STRAIN:
        return ElasticHalfSpace(youngs_modulus, poissons_ratio)
    return ElasticHalfSpace(
        youngs_modulus * (1 + 2 * poissons_ratio) / (1 + poissons_ratio) ** 2,
        poissons_ratio / (1 + poissons_ratio),
    )


# Method

METHOD = r"""
The right half of the body is modelled, five half widths wide and deep. There is no closed formula. The reference radii
were computed for this study by **an independent boundary-element program** for the half plane with a stated accuracy of
± 0.003; they are a reconstruction, not published values.

The far field is that of a half plane under the computed nodal forces: each mesh is solved, the displacements that its
contact forces cause on the outer sides are prescribed, and it is solved again. The last such pass changes no nodal force
by more than {{ num(measure("largest", section="V4", cases=".*", name="pass_change"), 1) }} of the largest one. Below the
punch, element sizes decrease linearly to a quarter at the edge, where the pressure is singular. Stick radii lie midway
between the last node that sticks and the first that slips.
"""

YOUNGS_MODULUS, FORCE = 1.0, 1e-3
"""Young's modulus, and force over E b; lengths are relative to b. They do not affect c/b."""
BODY_SIDE, MESH_GROWTH = 5.0, 1.3
"""Side of the meshed body, and size ratio of adjacent elements beside and below the punch."""
EDGE_SIZE_RATIO = 0.25
"""Ratio of the element sizes at the edge and in the middle of the punch."""
COARSEST_ELEMENT_COUNT = 16
"""Number of elements below half of the punch on the coarsest mesh of each series."""
N_INCREMENTS = 2
N_FAR_FIELD_PASSES = 2
"""Number of solutions on each mesh.

In each solution, the far field is that of the nodal forces of the preceding solution.
"""


def stick_radius(
    element: str,
    poissons_ratio: float,
    friction: float,
    elements: int,
    far_field: bool = True,
    increments: int = N_INCREMENTS,
    state: str = "plane strain",
) -> Result:
    """Compute the stick radius below a punch, over its half width.

    The scalar `stick` is midway between the last sticking and the first slipping node, and
    `stick_between` is the distance of these nodes. `pass_change` is the largest change of a nodal
    force between the last two solutions on the finest mesh, over the largest force. Each mesh
    starts with the far field of the nodal forces on the next coarser mesh.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        poissons_ratio: Poisson's ratio of the body.
        friction: Coefficient of friction.
        elements: Number of elements below half of the punch: `COARSEST_ELEMENT_COUNT` times a power
            of two.
        far_field: Whether the displacements of a half plane under the nodal forces are prescribed
            on the outer sides; otherwise these are fixed.
        increments: Number of equal increments of the force.
        state: Name of the stress state.
    """
    material = Material(YOUNGS_MODULUS, poissons_ratio)
    half_plane = equivalent_plane_strain_material(
        YOUNGS_MODULUS, poissons_ratio, StressState(state)
    )
    load_factors = np.arange(1, increments + 1) / increments
    motions = [Motion((0.0, None), (0.0, -FORCE / 2 * factor)) for factor in load_factors]
    punch = FlatPunch((0.0, 0.0), (0.0, -1.0), 1.0)
    pair = ContactPair(_is_below_punch, punch, friction, motions)
    forces = np.array([[0.0, FORCE / 2, 0.0]])
    for level in COARSEST_ELEMENT_COUNT * 2 ** np.arange(
        1 + int(np.log2(elements // COARSEST_ELEMENT_COUNT))
    ):
        mesh = partial(_build_mesh_refined_at_punch_edge, int(level))
        body = discretise(element, mesh, material, StressState(state))
        fixed_sides = [prescribe(body.space, i, _is_on_outer_sides) for i in (0, 1)]
        supports = body.supports([*fixed_sides, prescribe(body.space, 0, _is_on_axis)])
        for _ in range(N_FAR_FIELD_PASSES if far_field else 1):
            sources = forces if far_field else forces[:0]
            full_load = _load_replacing_outer_side_displacements(body, half_plane, sources)
            loads = [full_load * factor for factor in load_factors]
            states = solve_contact(body.K, loads, supports, [pair], body.space)
            previous_forces, forces = forces, _collect_contact_positions_and_forces(states[-1])
    pass_change = np.abs(forces - previous_forces).max() / forces.max() if far_field else 0.0
    last_sticking, first_slipping = _last_sticking_and_first_slipping_position(states[-1])
    reference = {}
    if state == "plane strain" and (poissons_ratio, friction) in REFERENCE_STICK_RADII:
        reference = {"stick_known": REFERENCE_STICK_RADII[poissons_ratio, friction]}
    return contact_result(
        body,
        states,
        loads[-1],
        _is_below_punch,
        FORCE / 2,
        DIMENSIONLESS_UNITS,
        extra_quantities={"stick*": "1", "pass_change": "1"},
        stick=(first_slipping + last_sticking) / 2,
        stick_between=first_slipping - last_sticking,
        pass_change=pass_change,
        **reference,
    )


def _load_replacing_outer_side_displacements(
    body: Discretisation, half_plane: ElasticHalfSpace, surface_forces: Array
) -> PETSc.Vec:
    """Return the load vector that replaces prescribed displacements of the outer sides.

    The load acts on a body whose outer sides are fixed. The displacements are those of a half plane
    under line forces on its surface.

    Args:
        body: Discretised body.
        half_plane: Material of the half plane.
        surface_forces: Position, normal force and tangential force of each line force on the right
            half, an array (m, 3).
    """
    nodes = fem.locate_dofs_geometrical(body.space, _is_on_outer_sides)
    x = body.space.tabulate_dof_coordinates()[nodes, :2]
    s, normal, tangential = surface_forces.T
    displacement = body.K.createVecRight()
    displacement.array.reshape(-1, 2)[nodes] = half_plane.displacement_by_line_forces(
        x, np.r_[s, -s], np.r_[normal, normal], np.r_[tangential, -tangential]
    )
    load = body.K * displacement
    load.scale(-1.0)
    return load


def _collect_contact_positions_and_forces(state: ContactState) -> Array:
    """Return position, normal force and tangential force of the m contact nodes, (m, 3)."""
    (contact,) = state.pairs
    tangential = contact.force_tangential[:, 0]
    return np.column_stack([contact.position[:, 0], contact.force_normal, tangential])


def _last_sticking_and_first_slipping_position(state: ContactState) -> tuple[float, float]:
    """Return the positions of the last sticking node and of the first slipping node."""
    x, status = state.pairs[0].position[:, 0], state.pairs[0].status
    last_sticking = int(np.flatnonzero(status == STICK).max())
    return float(x[last_sticking]), float(x[last_sticking + 1])


def _build_mesh_refined_at_punch_edge(elements: int, cell: str) -> Mesh:
    """Mesh the body with element sizes that decrease linearly towards the edge of the punch.

    Args:
        elements: Number of elements below half of the punch.
        cell: Cell type, "triangle" or "quadrilateral".
    """
    s = np.linspace(0.0, 1.0, elements + 1)
    below_punch = 2 / (1 + EDGE_SIZE_RATIO) * (s - (1 - EDGE_SIZE_RATIO) / 2 * s**2)
    smallest = below_punch[-1] - below_punch[-2]
    beside_punch = 1 + geometrically_growing_lines(smallest, BODY_SIDE - 1, MESH_GROWTH)[1:]
    x_lines = np.concatenate([below_punch, beside_punch])
    y_lines = -geometrically_growing_lines(smallest, BODY_SIDE, MESH_GROWTH)[::-1]
    return mesh_along_lines(MPI.COMM_SELF, x_lines, y_lines, cell, "left_right")


def _is_below_punch(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0) & (x[0] < 1 + 1e-9)


def _is_on_axis(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


def _is_on_outer_sides(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], BODY_SIDE) | np.isclose(x[1], -BODY_SIDE)


# Cases

ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
ELEMENT_COUNTS = (16, 32, 64)
FINEST_ELEMENT_COUNT = 128


def make_case_name(element: str, poissons_ratio: float, friction: float, elements: int) -> str:
    """Return the name of a case, which contains the friction angle in degrees.

    Args:
        element: Element name.
        poissons_ratio: Poisson's ratio.
        friction: Coefficient of friction, the tangent of the friction angle.
        elements: Number of elements below half of the punch.
    """
    angle = np.rad2deg(np.arctan(friction))
    return f"{element}-nu{poissons_ratio:.2f}-{angle:.1f}deg-{elements}"


def _make_stick_radius_case(
    element: str,
    poissons_ratio_and_friction: tuple[float, float],
    elements: int,
    suffix: str = "",
    **parameters: object,
) -> Case:
    nu, mu = poissons_ratio_and_friction
    name = make_case_name(element, nu, mu, elements) + suffix
    problem = {"element": element, "poissons_ratio": nu, "friction": mu, "elements": elements}
    return Case("V4", name, stick_radius, problem | parameters)


FIRST_MATERIAL, *OTHER_MATERIALS = REFERENCE_STICK_RADII
CASES = [
    _make_stick_radius_case(element, FIRST_MATERIAL, n)
    for element in ELEMENTS
    for n in ELEMENT_COUNTS
]
CASES += [
    _make_stick_radius_case(element, FIRST_MATERIAL, FINEST_ELEMENT_COUNT)
    for element in ("galerkin-T6", "pw-T6")
]
CASES += [
    _make_stick_radius_case("pw-T6", material, n)
    for material in OTHER_MATERIALS
    for n in (64, FINEST_ELEMENT_COUNT)
]
CASES += [
    _make_stick_radius_case("pw-T6", FIRST_MATERIAL, 32, "-one-step", increments=1),
    _make_stick_radius_case("pw-T6", FIRST_MATERIAL, 32, "-ten-steps", increments=10),
    _make_stick_radius_case("pw-T6", FIRST_MATERIAL, 64, "-held", far_field=False),
    _make_stick_radius_case(
        "pw-T6", (0.25, FIRST_MATERIAL[1]), 64, "-stress", state="plane stress"
    ),
]
CASES = mark_costly(CASES, "*-128", "composite-*-64", "*-Q[89]-*-64")

# Results

RESULT = r"""
{{ figure("v4_spence") }}

{% call table("v4-stick-radii", "Stick radii.") %}
| New T6, 128 elements | c/b | Nodes | Boundary elements (ours) | Difference |
|---|---:|---:|---:|---:|
{% for case, words in [("nu0.25-20.0deg", "ν = 0.25, tan 20°"), ("nu0.20-20.0deg", "ν = 0.20, tan 20° (plane stress 0.25)"), ("nu0.30-16.7deg", "ν = 0.3, μ = 0.3"), ("nu0.00-31.0deg", "ν = 0, μ = 0.6")] %}{% set key = "V4/pw-T6-" ~ case ~ "-128" %}
| {{ words }} | {{ fixed(s(key, "stick"), 4) }} | ± {{ fixed(s(key, "stick_between") / 2, 4) }} | {{ fixed(s(key, "stick_known"), 3) }} ± 0.003 | {{ fixed(measure("scalar_difference", key=key, name="stick", other="stick_known"), 4) }} |
{% endfor %}
{% endcall %}

Results with 128 elements, and those of four elements with 64, come from a longer series that is computed and compared by
`./run nightly`.

Stick radius for $\nu = 0.25$ and tan 20° for each mesh, with half the distance between the two nodes:

{% call table("v4-stick-radii-over-the-mesh", "Stick radii over the mesh.") %}
| Element | 16 elements | 32 elements | 64 elements | Mid-side over corner force, 64 |
|---|---:|---:|---:|---:|
{% for element, name in elements %}
| {{ name }} |{% for n in (16, 32, 64) %}{% set key = "V4/" ~ element ~ "-nu0.25-20.0deg-" ~ n %} {{ fixed(s(key, "stick"), 4) }} ± {{ fixed(s(key, "stick_between") / 2, 4) }} |{% endfor %} {{ fixed(s("V4/" ~ element ~ "-nu0.25-20.0deg-64", "sawtooth"), 3) }} |
{% endfor %}
{% endcall %}
"""


def draw_contact_stresses_and_used_friction(results: Results) -> Figure:
    """Draw the contact stresses below a flat punch, and the ratio of shear to the friction limit.

    The panels show stresses of two elements, and the ratio for four combinations of Poisson's ratio
    and coefficient of friction.
    """
    fig, (left, right) = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.3))
    _draw_contact_stresses(left, results)
    _draw_used_friction(right, results)
    zones = contact_zone_legend_handles(results.curves(STRESS_CASE_KEYS["pw-T6"]))
    fig.legend(handles=zones, loc="outside lower left", ncols=2)
    return fig


def _draw_contact_stresses(ax: Axes, results: Results) -> None:
    for element, key in STRESS_CASE_KEYS.items():
        curves = results.curves(key)
        mean = results.scalar(key, "peak_pressure") / results.scalar(key, "peak_over_mean")
        for quantity, line in (("pressure", "-"), ("shear", ":")):
            look = {**ELEMENT_LOOK[element], "linestyle": line, "markersize": 2.5}
            look["label"] = f"{look['label']}: {quantity}"
            if element == "pw-T6":  # drawn over the other element
                look |= {"markerfacecolor": "none", "markersize": 5, "linewidth": 0.6}
            ax.plot(curves["x"], np.abs(curves[quantity]) / mean, **look)
    ax.set(
        title=f"(a) {OWN_FUNCTION_READING.name} stresses",
        xlabel="$x/b$",
        xlim=(0, 1.0),
        ylim=(0, 3.4),
    )
    ax.set_ylabel("stress / mean pressure")
    ax.legend(loc="upper left", fontsize=7)
    draw_contact_zone_strip(ax, results.curves(STRESS_CASE_KEYS["pw-T6"]))


def _draw_used_friction(ax: Axes, results: Results) -> None:
    for key, line in zip(USED_FRICTION_CASE_KEYS, ("-", "--", "-.", ":"), strict=True):
        stored = results[key]
        curves, parameters = stored.curves, stored.parameters
        used = np.abs(curves["force_t"]) / (curves["friction"] * curves["force_n"])
        angle = np.rad2deg(np.arctan(parameters["friction"]))
        label = f"ν = {parameters['poissons_ratio']:.2f}, friction angle {angle:.1f}°"
        color = ELEMENT_LOOK["pw-T6"]["color"]
        ax.plot(curves["x"], used, color=color, lw=1.2, ls=line, label=label)
        ax.plot([stored.scalars["stick_known"]] * 2, [0.9, 1.1], color="black", lw=1.0)
    ax.set(title="(b) friction used, new T6", xlabel="$x/b$", xlim=(0, 1.0), ylim=(0, 1.75))
    ax.set_ylabel("shear / ($\\mu$ pressure)")
    ax.set_yticks([0, 0.25, 0.5, 0.75, 1.0])
    ax.legend(loc="upper left", fontsize=7)


def caption_contact_stresses_and_used_friction(results: Results) -> str:
    """Return the caption of the stresses and the used friction, including the stick radii."""
    radii = "; ".join(
        f"{results.scalar(key, 'stick'):.3f} ({results.scalar(key, 'stick_known'):.3f})"
        for key in USED_FRICTION_CASE_KEYS
    )
    return (
        f"One half of a flat punch of half width b. (a) {OWN_FUNCTION_READING.name.capitalize()} stresses, "
        "ν = 0.25, friction angle 20°, 32 elements below the half; strip: contact zones of the new "
        "triangle; the singularity at the edge is cut off. (b) Shear over the largest possible "
        "one, new triangle, 64 elements; black ticks: stick radii by a boundary-element program "
        "of this study, to ± 0.003. Computed stick radii (by that program) in "
        f"the order of the legend: {radii}."
    )


STRESS_CASE_KEYS = {
    element: f"V4/{element}-nu0.25-20.0deg-32" for element in ("galerkin-T6", "pw-T6")
}
USED_FRICTION_CASE_KEYS = [
    "V4/pw-T6-nu0.25-20.0deg-64",
    "V4/pw-T6-nu0.20-20.0deg-64",
    "V4/pw-T6-nu0.30-16.7deg-64",
    "V4/pw-T6-nu0.00-31.0deg-64",
]
FIGURES = [
    PageFigure(
        "v4_spence",
        draw_contact_stresses_and_used_friction,
        needs=[*STRESS_CASE_KEYS.values(), *USED_FRICTION_CASE_KEYS],
        caption=caption_contact_stresses_and_used_friction,
        alt="Pressure and shear grow towards the punch's edge, alike for both elements. Four "
        "curves of used friction rise from zero to one, which each reaches at its black tick, and "
        "stay there.",
    )
]

# Findings


def largest_distance_of_reference_stick_radius(results: Results) -> float:
    """Return the largest distance of a reference stick radius from a computed stick-zone border.

    The distance is zero if the reference radius lies between the last sticking and the first
    slipping node.
    """
    distances = []
    cases = {"far_field": True, "increments": N_INCREMENTS, "state": "plane strain"}
    for stored in select_results(results, "V4", cases):
        scalars = stored.scalars
        radius_error = abs(scalars["stick"] - scalars["stick_known"])
        distances.append(max(0.0, radius_error - scalars["stick_between"] / 2))
    return max(distances)


VERIFICATION = r"""
| flat punch with friction | our own boundary elements, ± 0.003 | stick radius, difference | {{ num(measure("scalar_difference", key="V4/pw-T6-nu0.25-20.0deg-64", name="stick", other="stick_known") | abs, 1) }} | {{ num(measure("scalar_difference", key="V4/galerkin-T6-nu0.25-20.0deg-64", name="stick", other="stick_known") | abs, 1) }} |
"""

CHECKS = [
    check(
        "V4-nu030-167",
        "Spence's punch, nu = 0.3, mu = 0.3: stick radius over half width, against that of "
        "this study's own boundary-element program.",
        lambda results: scalar_difference(
            results, key="V4/pw-T6-nu0.30-16.7deg-128", name="stick", other="stick_known"
        ),
        "=",
        0.0,
        tolerance=REFERENCE_RADIUS_ACCURACY,
        tolerance_why="accuracy that the boundary-element program states; here the border lies "
        "between nodes 0.004 apart",
        why="The two methods share nothing but the problem.",
    ),
    check(
        "V4-between",
        "Spence's punch: on every mesh of every element the known stick radius lies between"
        " the last node that sticks and the first that slips, or beside them by no more "
        "than its own accuracy.",
        largest_distance_of_reference_stick_radius,
        "<=",
        REFERENCE_RADIUS_ACCURACY,
        tolerance_why="none: the bound is the accuracy of the reference radius",
        why="With all elements the border lies between the same nodes.",
    ),
]

FINDINGS = r"""
1. All four radii agree with the reference radii within their accuracy. All elements place the edge of the stick zone
   between the same nodes: it does not depend on the test functions.
2. The number of load steps has no influence: one step and ten give the same nodal forces to round-off
   ({{ num(measure("curve_difference", key="V4/pw-T6-nu0.25-20.0deg-32-one-step", name="force_t", other="V4/pw-T6-nu0.25-20.0deg-32-ten-steps", other_name="force_t"), 1) }}),
   since with a flat punch the solution scales with the load. A curved punch has no such property.
3. **A body of five half widths with its sides fixed is not a half plane**: the stick zone then extends to
   {{ fixed(s("V4/pw-T6-nu0.25-20.0deg-64-held", "stick"), 3) }} $b$ instead of
   {{ fixed(s("V4/pw-T6-nu0.25-20.0deg-64", "stick"), 3) }} $b$. The stick zones in section 7.4, where the body is larger
   but finite and fixed at its sides, are therefore not Spence's either.
"""

# Limits

LIMITS = r"""
The reference values are not an exact solution. Tractions are not compared, because none are known, and the radius is
found only to within a node distance. At the edge pressure and shear are singular, and peak values mean nothing.
"""
