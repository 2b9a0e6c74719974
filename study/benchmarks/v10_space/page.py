"""Verification of contact pressures on the faces of tetrahedra and hexahedra.

Pressures of four problems are compared with exact solutions. The corner nodes of a standard 10-node
tetrahedron carry no force under uniform pressure, because the integrals of their test functions
over a face vanish. Standard elements, elements with piecewise-linear test functions, and two
elements derived from the standard tetrahedron (see `study.solutions.solids`) are compared.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from pw_elements import Material, prescribe
from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    solve_contact,
)
from study.benchmarks.v10_space.partial_slip import mindlin
from study.judge.checks import check
from study.judge.measures.general import ratio, scalar, smallest
from study.meshes.mesh_families import on_cube
from study.meshes.mesh_lines import (
    BODY_SIZE,
    GROWTH,
    geometrically_growing_lines,
    mesh_lines_of_body_under_sphere,
    mesh_lines_over_depth,
)
from study.meshes.solid_meshes import mesh_box_along_lines, mesh_quarter_cylinder, solid_cell_name
from study.model.vocabulary import ELEMENTS as NAMED_ELEMENTS
from study.model.vocabulary import (
    OPEN,
    OWN_FUNCTION_READING,
    SLIP,
    STATUS_NAMES,
    STICK,
    UNDEFINED_READING_NOTE,
)
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH
from study.run.cases import Case, mark_costly
from study.run.pages import PageFigure
from study.run.store import Result, Results
from study.solutions.half_space import (
    ElasticHalfSpace,
    ExactIndentation,
    FlatRoundPunch,
    HertzSphere,
    axisymmetric_displacement_in_space,
)
from study.solutions.half_space_shear import force_that_gives_contact_radius_1
from study.solutions.solids import INNER_PART, SolidBody, evaluate_pressure_errors_on_face

SECTION = "V10"
TITLE = "Contact in space"
FACTS = {
    "geometry": "a unit cube; a quarter of a sphere's and of a flat punch's contact on a half "
    "space; two equal spheres; outer sides 2.5 radii a away",
    "mesh": "tetrahedra and hexahedra; cubes with sides of 1/4, up to eight elements over a",
    "material": "linear elastic, in space; E = 1, ν = 0.3, and 0 where shear is known",
    "supports": "exact displacements on the outer sides; smooth contact; friction 0.5 (cube) and "
    "0.4 (spheres)",
    "load": "pressure 0.001 and shear 0.0004; indentation; a tangential force of half of what "
    "friction can carry",
    "reference": "uniform stress, Hertz, Boussinesq, Mindlin",
    "uncertainty": "none of the bodies' size; Mindlin's solution is exact for ν = 0 only; corners "
    "of standard tetrahedra have no reading",
}
SHORT_FACTS = {
    "uncertainty": "Mindlin's is exact for ν = 0 alone; corners of T10 have no reading",
}

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Problems

PROBLEM = r"""
Five problems have known solutions: a cube under uniform pressure on a smooth plane; the same cube in an oblique
position, pressed and pushed on a rough plane; a rigid sphere and a rigid circular punch on a half space
{{ cite("johnson") }}; and two equal spheres in partial slip {{ cite("mindlin") }}. Standard and new tetrahedra (T10) and
hexahedra (H27) are compared with two other uses of the standard tetrahedron: its forces multiplied by
$\boldsymbol{T}$, and its *symmetric sibling*. The sibling has the same displacements in another basis,
$\boldsymbol{u} = \boldsymbol{T}^\mathrm{T} \boldsymbol{a}$; its stiffness is
$\boldsymbol{T} \boldsymbol{K} \boldsymbol{T}^\mathrm{T}$, and its contact conditions are stated on
$\boldsymbol{T}^{-\mathrm{T}}$ times the gaps.

Each element is read by its own weights. A corner of the standard tetrahedron has none on a flat face, so it has no
pressure and no shear. Errors are therefore compared at *common nodes*, which have a reading with every element (mid-side
nodes, on tetrahedra), and given separately for corners.
"""

# Method

METHOD = r"""
**Half spaces.** The exact displacements are prescribed on all outer sides, 2.5 contact radii away, so that there is no
truncation error. Indenters move to their known depth, and the force is a result. The meshes consist of boxes, with six
tetrahedra in each, that do not follow the edge of the contact zone. Below the punch they consist of prisms that fit its
edge and become smaller towards it. The cubes are made of unstructured tetrahedra and distorted hexahedra. The meshes of
the two equal spheres match.

**Partial slip.** Errors of the shear are relative to $\mu\,p_0$, for $r < 0.8\,a$ and farther than $0.15\,a$ from the
border of the stick zone. The *stick area* is the sum of the weights of the sticking nodes over that of the nodes inside
the exact circle. The *stick radius* does not count nodes: $(\mu\,p - |t|)^2$, the square of the friction that is left, is
a straight line over $r^2$ in Mindlin's solution; such a line is fitted through the sticking nodes, and its zero is taken.
Interpolating instead would end at the first slipping node and so count nodes again.
"""

# Lengths are divided by the contact radius, stresses by E
YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
SPHERE_RADIUS = 1e3
"""Radius of the sphere, so large that slopes are small."""
PUNCH_DEPTH = 1e-3

# Cubes
PRESSURE, SHEAR_TRACTION, CUBE_FRICTION = 1e-3, 0.4e-3, 0.5
CELL_SIZE = 0.25
MAX_RELATIVE_NODE_SHIFT = 0.12
"""Largest random displacement of a node of the hexahedral mesh, over the size of a cell."""


def patch(element: str) -> Result:
    """Press a cube uniformly on a smooth rigid plane; the exact stress is uniaxial.

    Args:
        element: Element name such as "pw-T10" or "galerkin-H27".
    """
    return _solve_rotated_cube_on_rigid_plane(element, np.eye(3), 0.0, 0.0, POISSONS_RATIO)


def tilted(element: str) -> Result:
    """Press and shear a rotated cube uniformly on a rough rigid plane, with Poisson's ratio zero.

    Args:
        element: Element name such as "pw-T10" or "galerkin-H27".
    """
    return _solve_rotated_cube_on_rigid_plane(
        element, _rotation_matrix_about_oblique_axis(), SHEAR_TRACTION, CUBE_FRICTION, 0.0
    )


def _solve_rotated_cube_on_rigid_plane(
    element: str, rotation: Array, shear: float, friction: float, poissons_ratio: float
) -> Result:
    """Solve a rotated cube that uniform tractions press and shear on a rigid plane.

    Args:
        element: Element name.
        rotation: Rotation matrix (3, 3) of the cube and of the plane.
        shear: Shear traction along the cube's rotated x axis.
        friction: Coefficient of friction; if it is zero, symmetry planes support the cube.
        poissons_ratio: Poisson's ratio of the cube.
    """
    mesh = _make_unstructured_or_distorted_cube_mesh(element)
    mesh.geometry.x[:] = mesh.geometry.x @ rotation.T
    solid = SolidBody.from_mesh(element, mesh, Material(YOUNGS_MODULUS, poissons_ratio))

    def make_cube_side_marker(axis: int, position: float) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(rotation[:, axis] @ p, position, atol=1e-9)

    base = make_cube_side_marker(2, 0.0)
    # stress in the rotated axes of the cube, and its tractions on all sides but the base
    stress = np.array([[0.0, 0.0, shear], [0.0, 0.0, 0.0], [shear, 0.0, -PRESSURE]])
    load = solid.surface_load(rotation @ stress[:, 2], make_cube_side_marker(2, 1.0))
    if shear:
        for position, sign in ((0.0, -1.0), (1.0, 1.0)):
            load.axpy(
                sign,
                solid.surface_load(rotation @ stress[:, 0], make_cube_side_marker(0, position)),
            )
    conditions = []
    if not friction:  # use symmetry planes; with friction, contact alone holds the cube
        conditions = [prescribe(solid.space, i, make_cube_side_marker(i, 0.0)) for i in (0, 1)]
    plane = Plane((0.0, 0.0, 0.0), tuple(rotation[:, 2]))
    pair = ContactPair(base, plane, friction)
    supports = solid.supports(conditions)
    states = solve_contact(solid.K, load, supports, [pair], solid.space)

    forces = solid.nodal_forces(states[-1], load, base) @ rotation
    faces = solid.surface_nodes_with_own_and_standard_weights(base)
    scalars = {}
    if shear:
        shear_error = np.abs(faces[0].pressure(forces)[:, 0] + shear) / PRESSURE
        scalars["shear_error_max"] = np.nanmax(shear_error)
    return evaluate_pressure_errors_on_face(
        states,
        solid,
        faces,
        forces,
        np.full(len(forces), PRESSURE),
        PRESSURE,
        np.inf,
        force_error=float(np.linalg.norm(forces.sum(axis=0) + stress[:, 2])) / PRESSURE,
        **scalars,
    )


def _make_unstructured_or_distorted_cube_mesh(element: str) -> Mesh:
    """Mesh a unit cube with unstructured tetrahedra or with randomly distorted hexahedra."""
    if solid_cell_name(element) == "tetrahedron":
        return on_cube(element, CELL_SIZE)
    lines: Array = np.linspace(0, 1, round(1 / CELL_SIZE) + 1, dtype=np.float64)
    mesh = mesh_box_along_lines("hexahedron", lines, lines, lines)
    x = mesh.geometry.x
    is_inside = ~np.isclose(np.abs(x - 0.5), 0.5)
    random = np.random.default_rng(1).uniform(-1, 1, (len(lines) ** 3, 3))
    number = np.rint(x / CELL_SIZE).astype(int) @ [len(lines) ** 2, len(lines), 1]
    x[:] += MAX_RELATIVE_NODE_SHIFT * CELL_SIZE * random[number] * is_inside
    return mesh


def _rotation_matrix_about_oblique_axis() -> Array:
    """Return a rotation matrix (3, 3) whose axis is oblique to all mesh lines."""
    return np.asarray(Rotation.from_rotvec([0.5, -0.9, 0.4]).as_matrix())


def sphere(element: str, elements: int, poissons_ratio: float = POISSONS_RATIO) -> Result:
    """Press a rigid sphere on an elastic half space, of which a quarter is modelled.

    Args:
        element: Element name such as "pw-T10" or "galerkin-H27".
        elements: Number of elements along the contact radius.
        poissons_ratio: Poisson's ratio of the half space.
    """
    body = ElasticHalfSpace(YOUNGS_MODULUS, poissons_ratio)
    exact = HertzSphere(body, SPHERE_RADIUS, force_that_gives_contact_radius_1(body, SPHERE_RADIUS))
    lines = mesh_lines_of_body_under_sphere(elements)
    mesh = mesh_box_along_lines(
        solid_cell_name(element), lines.horizontal, lines.horizontal, lines.vertical
    )

    def is_contact_face(p: Array) -> Mask:
        return np.isclose(p[2], 0.0) & (np.maximum(p[0], p[1]) < lines.contact_zone_size + 1e-9)

    def is_outer_side(p: Array) -> Mask:
        return np.isclose(p[2], -BODY_SIZE) | np.isclose(np.maximum(p[0], p[1]), BODY_SIZE)

    paraboloid = Parabola((0.0, 0.0, 0.0), SPHERE_RADIUS)
    return _press_rigid_indenter_to_exact_depth(
        element, mesh, exact, paraboloid, is_contact_face, is_outer_side
    )


def punch(element: str, elements: int) -> Result:
    """Press a rigid circular flat punch on an elastic half space, of which a quarter is modelled.

    Args:
        element: Element name such as "pw-T10" or "galerkin-H27".
        elements: Half of the number of elements along the radius of the punch.
    """
    exact = FlatRoundPunch(ElasticHalfSpace(YOUNGS_MODULUS, POISSONS_RATIO), 1.0, PUNCH_DEPTH)
    size_at_edge = 0.5 / elements**2
    radii = 1 + geometrically_growing_lines(size_at_edge, BODY_SIZE - 1, GROWTH)[1:]
    mesh = mesh_quarter_cylinder(
        solid_cell_name(element), elements, radii, mesh_lines_over_depth(size_at_edge)
    )

    def is_contact_face(p: Array) -> Mask:
        return np.isclose(p[2], 0.0) & (np.hypot(p[0], p[1]) < 1 + 1e-9)

    def is_outer_side(p: Array) -> Mask:
        # the middle of a straight element side lies inside the cylinder
        chord = BODY_SIZE * np.cos(np.pi / (8 * elements))
        return np.isclose(p[2], -BODY_SIZE) | (np.hypot(p[0], p[1]) > chord * (1 - 1e-9))

    flat_punch = FlatPunch((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0)
    return _press_rigid_indenter_to_exact_depth(
        element, mesh, exact, flat_punch, is_contact_face, is_outer_side
    )


def _press_rigid_indenter_to_exact_depth(
    element: str,
    mesh: Mesh,
    exact: ExactIndentation,
    indenter: Parabola | FlatPunch,
    is_contact_face: Callable[[Array], Mask],
    is_outer_side: Callable[[Array], Mask],
) -> Result:
    """Solve a quarter of a half space under a rigid indenter that is moved to its exact depth.

    The exact displacements are prescribed on the outer sides of the mesh.

    Args:
        element: Element name.
        mesh: Mesh of the quarter of the half space.
        exact: Exact solution of the contact.
        indenter: Surface of the rigid indenter before it moves.
        is_contact_face: Marker of the part of the surface that may touch the indenter.
        is_outer_side: Marker of the sides with prescribed exact displacements.
    """
    body = exact.body
    solid = SolidBody.from_mesh(element, mesh, Material(body.youngs_modulus, body.poissons_ratio))

    def make_symmetry_plane_marker(axis: int) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(p[axis], 0.0) & ~is_outer_side(p)

    conditions = solid.prescribe_displacements_on_faces(
        is_outer_side, partial(axisymmetric_displacement_in_space, exact)
    )
    conditions += [prescribe(solid.space, i, make_symmetry_plane_marker(i)) for i in (0, 1)]
    pair = ContactPair(is_contact_face, indenter, 0.0, [Motion((0.0, 0.0, -exact.approach))])
    no_load = solid.K.createVecLeft()
    supports = solid.supports(conditions)
    states = solve_contact(solid.K, no_load, supports, [pair], solid.space)
    faces = solid.surface_nodes_with_own_and_standard_weights(is_contact_face)
    forces = -solid.nodal_forces(states[-1], no_load, is_contact_face)
    r = np.linalg.norm(faces[0].position[:, :2], axis=1)
    with np.errstate(invalid="ignore"):
        pressure = np.where(r < 1 - 1e-9, exact.pressure(np.minimum(r, 1 - 1e-9)), 0.0)
    hertz_peak = 1.5 * exact.force / np.pi  # Hertz's peak pressure for the same force
    return evaluate_pressure_errors_on_face(
        states,
        solid,
        faces,
        forces,
        pressure,
        hertz_peak,
        INNER_PART,
        force_error=abs(4 * forces[:, 2].sum() / exact.force - 1),
    )


# Cases

TETRAHEDRA = ("galerkin-T10", "transferred-T10", "sibling-T10", "pw-T10")
ELEMENTS = (*TETRAHEDRA, "galerkin-H27", "pw-H27")
REFINED_TETRAHEDRA = ("galerkin-T10", "sibling-T10", "pw-T10")
"""Tetrahedral elements with which partial slip is also computed on finer meshes."""


def _make_mindlin_case(element: str, n_elements_over_contact_radius: int) -> Case:
    return Case(
        "V10",
        f"mindlin-{element}-{n_elements_over_contact_radius}",
        mindlin,
        {"element": element, "elements": n_elements_over_contact_radius},
    )


CASES = [
    Case("V10", f"{problem.__name__}-{element}", problem, {"element": element})
    for problem in (patch, tilted)
    for element in ELEMENTS
]
CASES += [
    Case(
        "V10",
        f"mindlin-{element}-3-nu0.3",
        mindlin,
        {"element": element, "elements": 3, "poissons_ratio": 0.3},
    )
    for element in ("galerkin-T10", "pw-T10")
]
CASES += [
    Case("V10", f"{problem.__name__}-{element}-{n}", problem, {"element": element, "elements": n})
    for problem, numbers in ((sphere, (3, 5)), (punch, (2, 4)), (mindlin, (2, 3)))
    for element in ELEMENTS
    for n in numbers
]
CASES = mark_costly(
    CASES,
    *("mindlin-*-H27-3", "punch-*-H27-4", "sphere-*-H27-3", "*-H27-2", "*-H27"),
    *("*-transferred-*[234]", "*-transferred", "*-nu0.3"),
)
CASES += mark_costly(
    [_make_mindlin_case(element, n) for element in REFINED_TETRAHEDRA for n in (4, 5, 6, 8)]
)
CASES += mark_costly(
    [_make_mindlin_case(element, n) for element in ("galerkin-H27", "pw-H27") for n in (4, 5)]
)

# Results

RESULT = r"""
{% call table("solids", "Contact in three dimensions: errors of the own-function pressure where r < 0.8 a, in % of Hertz's peak pressure p₀ for the same force, at common nodes and at corners of tetrahedra; and errors of the total force.") %}
| Element | Sphere, 5 elements over $a$: median, % | largest, % | corners, largest, % | force, % | nodes without a reading | Punch, 4 elements: median, % | largest, % | corners, largest, % | force, % |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|
{% for element in ("galerkin-T10", "transferred-T10", "sibling-T10", "pw-T10", "galerkin-H27", "pw-H27") %}{% set sphere = "V10/sphere-" ~ element ~ "-5" %}{% set punch = "V10/punch-" ~ element ~ "-4" %}
| {{ names[element] }} |{% for case in (sphere, punch) %} {{ fixed(100 * s(case, "pressure_error_common_median"), 2) }} | {{ fixed(100 * s(case, "pressure_error_common_max"), 2) }} |{% if element.endswith("T10") and element != "galerkin-T10" %} {{ fixed(100 * s(case, "pressure_error_alone_max"), 2) }}{% endif %} | {{ fixed(100 * s(case, "force_error"), 2) }} |{% if case == sphere %} {{ fixed(s(case, "weightless_nodes"), 0) }} of {{ fixed(s(case, "nodes"), 0) }} |{% endif %}{% endfor %}

{% endfor %}
{% endcall %}

{{ figure("v10_stick") }}

{% call table("slip", "Two spheres in partial slip (tetrahedra, ν = 0): errors of the shear in % of μ p₀ away from the border of the stick zone, at common nodes and at corners, and the stick zone over the exact one.") %}
| Elements over $a$ | |{% for n in (2, 3, 4, 5, 6, 8) %} {{ n }} |{% endfor %}

|---|---|---:|---:|---:|---:|---:|---:|
{% for name, words, digits, factor in (("shear_error_common_median", "median", 3, 100), ("shear_error_common_rms", "root mean square", 2, 100), ("shear_error_common_max", "largest", 2, 100), ("shear_error_alone_max", "corners, largest", 2, 100), ("sticking_area_own", "stick area", 3, 1), ("stick_radius", "stick radius", 3, 1)) %}
{% for element in ("galerkin-T10", "sibling-T10", "pw-T10") if element != "galerkin-T10" or "alone" not in name %}
| {{ words }} | {{ names[element] }} |{% for n in (2, 3, 4, 5, 6, 8) %} {{ fixed(factor * s("V10/mindlin-" ~ element ~ "-" ~ n, name), digits) }} |{% endfor %}

{% endfor %}
{% endfor %}
{% endcall %}
"""

DETAILS = r"""
{{ figure("v10_radius") }}

{{ figure("v10_faces") }}

{% call table("v10-partial-slip-of-hexahedra", "Two spheres in partial slip, hexahedra: as in the table for tetrahedra; all nodes are common.") %}
| Elements over $a$ | |{% for n in (2, 3, 4, 5) %} {{ n }} |{% endfor %}

|---|---|---:|---:|---:|---:|
{% for name, words, digits, factor in (("shear_error_common_median", "median", 3, 100), ("shear_error_common_rms", "root mean square", 2, 100), ("shear_error_common_max", "largest", 2, 100), ("sticking_area_own", "stick area", 3, 1), ("stick_radius", "stick radius", 3, 1)) %}
{% for element in ("galerkin-H27", "pw-H27") %}
| {{ words }} | {{ names[element] }} |{% for n in (2, 3, 4, 5) %} {{ fixed(factor * s("V10/mindlin-" ~ element ~ "-" ~ n, name), digits) }} |{% endfor %}

{% endfor %}
{% endfor %}
{% endcall %}

<p class="note">Partial slip with 4 and more elements over <i>a</i>, and most results with forces times <b><i>T</i></b>, ν = 0.3 or hexahedra, come from a longer series that is computed and compared by <code>./run nightly</code>.</p>
"""

PLOT_TETRAHEDRA = ("galerkin-T10", "sibling-T10", "pw-T10")
STICK_ZONE_RADIUS = np.cbrt(0.5)
"""Radius of Mindlin's stick zone over the contact radius, for half of the available friction."""

# Figure: which nodes stick

MINDLIN_KEYS = [f"V10/mindlin-{element}-3" for element in PLOT_TETRAHEDRA]
STATUS_COLOURS = {STICK: "#0072B2", SLIP: "#E8A33D", OPEN: "#777777"}


def draw_stick_zones_of_two_spheres(results: Results) -> Figure:
    """Draw which nodes stick, slip or are open in the contact of two spheres in partial slip.

    Each panel shows one half of the contact for one element.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.2), sharex=True, sharey=True)
    angle = np.linspace(0, np.pi, 201)
    for ax, element, key in zip(axes, PLOT_TETRAHEDRA, MINDLIN_KEYS, strict=True):
        curves = results.curves(key)
        x, y, _ = curves["x"].T
        has_reading = np.isfinite(curves["pressure"])
        for status, colour in STATUS_COLOURS.items():
            is_shown = (curves["status"] == status) & (np.hypot(x, y) < 1)
            dots, crosses = is_shown & has_reading, is_shown & ~has_reading
            ax.plot(x[dots], y[dots], "o", ms=3.4, color=colour, label=STATUS_NAMES[status])
            ax.plot(x[crosses], y[crosses], "x", ms=3.0, color=colour)
        for radius, line in ((1.0, ":"), (STICK_ZONE_RADIUS, "-")):
            ax.plot(radius * np.cos(angle), radius * np.sin(angle), line, color="black", lw=0.8)
        radius = results.scalar(key, "stick_radius")
        ax.set_title(f"{NAMED_ELEMENTS[element].name}: {radius:.3f}", fontsize=8)
        ax.set(aspect="equal", xlim=(-1.1, 1.1), ylim=(-0.06, 1.1), xlabel="$x/a$")
        ax.grid(visible=False)
    axes[0].set_ylabel("$y/a$")
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


# Figure: tractions over the radius

SPHERE_CASE, PUNCH_CASE, MINDLIN_CASE = "sphere-{}-5", "punch-{}-4", "mindlin-{}-3"
PLOT_ELEMENTS_BY_CASE = {
    SPHERE_CASE: (*PLOT_TETRAHEDRA, "pw-H27"),
    PUNCH_CASE: PLOT_TETRAHEDRA,
    MINDLIN_CASE: PLOT_TETRAHEDRA,
}
TRACTION_KEYS = [
    f"V10/{case.format(element)}"
    for case, elements in PLOT_ELEMENTS_BY_CASE.items()
    for element in elements
]


def draw_contact_tractions_over_radius(results: Results) -> Figure:
    """Draw pressure and shear tractions over the distance from the axis of the contact.

    The panels show the pressure below a sphere, the pressure below a flat punch, and the shear in
    partial slip. Each marker is a node whose test function has a nonzero integral over the surface.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.5))
    panels = (
        (SPHERE_CASE, "pressure", "(a) rigid sphere"),
        (PUNCH_CASE, "pressure", "(b) rigid flat punch"),
        (MINDLIN_CASE, "shear", "(c) partial slip, shear"),
    )
    for ax, (case, quantity, title) in zip(axes, panels, strict=True):
        for element in PLOT_ELEMENTS_BY_CASE[case]:
            curves = results.curves("V10/" + case.format(element))
            r = np.hypot(*curves["x"][:, :2].T)
            look = ELEMENT_LOOK[element] | {"linestyle": "none", "markersize": 2.5, "zorder": 2}
            ax.plot(r, curves[quantity], **look)
        ax.set(title=title, xlabel="$r/a$", xlim=(0, 1.15))
    r = np.linspace(0, 1, 401)[:-1]
    hertz = np.sqrt(1 - r**2)
    flat_punch = 1 / np.sqrt(1 - r**2) / 3
    in_stick_zone = np.sqrt(np.maximum(0, 1 - (r / STICK_ZONE_RADIUS) ** 2))
    shear = 0.4 * (hertz - STICK_ZONE_RADIUS * in_stick_zone)
    for ax, exact in zip(axes, (hertz, flat_punch, shear), strict=True):
        ax.plot(r, exact, **(ELEMENT_LOOK["exact"] | {"linewidth": 0.9, "zorder": 3}))
    axes[0].set(ylabel="traction / $p_0$ of the sphere", ylim=(0, 1.1))
    axes[1].set(ylim=(0, 1.4))
    axes[2].set(ylim=(0, 0.3))
    axes[0].legend(loc="lower left", fontsize=6.5)
    return fig


# Figure: errors on the face below the sphere

SPHERE_KEYS = [f"V10/sphere-{element}-5" for element in ELEMENTS]
MAX_COLOURED_ERROR = 2.0
"""Largest error of the colour scale, in % of p0."""
COLOUR_SCALE: dict[str, Any] = {
    "norm": plt.Normalize(-MAX_COLOURED_ERROR, MAX_COLOURED_ERROR),
    "cmap": "RdBu_r",
}


def draw_pressure_error_maps_below_sphere(results: Results) -> Figure:
    """Draw maps of the nodal pressure errors below a rigid sphere.

    Each panel shows a quarter of the contact for one element.
    """
    fig, axes = plt.subplots(2, 3, figsize=(PAGE_WIDTH, 4.0), sharex=True, sharey=True)
    for ax, element, key in zip(axes.flat, ELEMENTS, SPHERE_KEYS, strict=True):
        curves = results.curves(key)
        error = 100 * (curves["pressure"] - curves["exact_pressure"])
        _draw_error_map_of_contact_nodes(ax, curves["x"], error)
        ax.set_title(NAMED_ELEMENTS[element].name)
    for ax in axes[1]:
        ax.set_xlabel("$x/a$")
    for ax in axes[:, 0]:
        ax.set_ylabel("$y/a$")
    label = f"error of the {OWN_FUNCTION_READING.name} pressure, % of $p_0$"
    colours = ScalarMappable(**COLOUR_SCALE)
    fig.colorbar(colours, ax=axes, label=label, shrink=0.8, extend="both")
    return fig


def _draw_error_map_of_contact_nodes(ax: Axes, x: Array, error: Array) -> None:
    """Draw the contact nodes, coloured by their pressure error.

    Args:
        ax: Axes of the panel.
        x: Positions (m, 3) of the nodes over the contact radius.
        error: Errors (m,) in per cent of the peak pressure; nodes with NaN are drawn as crosses.
    """
    is_near = np.hypot(*x[:, :2].T) < 1
    dots, crosses = is_near & np.isfinite(error), is_near & ~np.isfinite(error)
    ax.scatter(x[dots, 0], x[dots, 1], s=22, c=error[dots], ec="#777777", lw=0.4, **COLOUR_SCALE)
    ax.scatter(x[crosses, 0], x[crosses, 1], s=12, marker="x", color="black", lw=0.8)
    angle = np.linspace(0, np.pi / 2, 101)
    for radius, line in ((1.0, ":"), (INNER_PART, "--")):
        ax.plot(radius * np.cos(angle), radius * np.sin(angle), line, color="black", lw=0.7)
    ax.set(aspect="equal", xlim=(-0.05, 1.05), ylim=(-0.05, 1.05))
    ax.grid(visible=False)


def caption_pressure_error_maps_below_sphere(results: Results) -> str:
    """Return the caption of the error maps, including the number of nodes without a pressure."""
    weightless = results.scalar("V10/sphere-galerkin-T10-5", "weightless_nodes")
    nodes = results.scalar("V10/sphere-galerkin-T10-5", "nodes")
    return (
        "Errors of the pressure at the nodes in a quarter of the contact of a rigid sphere with a "
        f"half space, five elements over the radius a (dotted). The pressure is the {OWN_FUNCTION_READING.meaning}, "
        f"with {UNDEFINED_READING_NOTE}. Crosses are such nodes: {weightless:.0f} of the {nodes:.0f} with "
        "r < 0.8 a (dashed)."
    )


FIGURES = [
    PageFigure(
        "v10_stick",
        draw_stick_zones_of_two_spheres,
        needs=MINDLIN_KEYS,
        caption="What the nodes do in one half of the contact of two equal spheres in partial "
        "slip, three elements over the radius a (dotted), ν = 0; the solid line is the border of "
        f"Mindlin's stick zone. A traction is the {OWN_FUNCTION_READING.meaning}, with {UNDEFINED_READING_NOTE} (crosses). "
        "Above, the stick radius over the exact one. It is where the friction that is left, "
        "(μ p − |t|)², vanishes along a line fitted over r² through the sticking nodes; in "
        "Mindlin's solution it is such a line.",
        alt="Three half discs of nodes. In each, the nodes that stick fill the exact half circle "
        "to within half an element; those around them slip. In the standard element's some of the "
        "corners inside the half circle slip or are open.",
    ),
    PageFigure(
        "v10_radius",
        draw_contact_tractions_over_radius,
        needs=TRACTION_KEYS,
        caption="Own-function tractions over the distance from the axis, at all nodes whose "
        "integral is not zero: (a) below a rigid sphere, five elements over the radius a; (b) "
        "below a rigid flat punch, four elements, smaller towards its edge; (c) shear between two "
        "equal spheres in partial slip, three elements, ν = 0. Lines are exact; the kink in (c) is "
        "the border of the sticking disc.",
        alt="Three plots of traction over radius; the nodes of all elements lie along the exact "
        "curves: half an ellipse, a curve that rises to infinity, and one that rises, has a "
        "corner and falls to zero.",
    ),
    PageFigure(
        "v10_faces",
        draw_pressure_error_maps_below_sphere,
        needs=SPHERE_KEYS,
        caption=caption_pressure_error_maps_below_sphere,
        alt="Six quarter discs of nodes, pale inside and coloured towards the edge of the contact, "
        "where errors are largest. The standard tetrahedron's has crosses at all corners of its "
        "elements; the new hexahedron's is the palest.",
    ),
]

VERIFICATION = r"""
| sphere on a half space, T10 | exact (Hertz) | pressure at common nodes, median | {{ pct(s("V10/sphere-pw-T10-5", "pressure_error_common_median")) }} | {{ pct(s("V10/sphere-galerkin-T10-5", "pressure_error_common_median")) }} |
| spheres in partial slip, T10, common nodes | exact for $\nu = 0$ (Mindlin) | shear, rms | {{ pct(s("V10/mindlin-pw-T10-4", "shear_error_common_rms")) }} | {{ pct(s("V10/mindlin-galerkin-T10-4", "shear_error_common_rms")) }} |
"""

# Findings

CHECKS = [
    check(
        "V10-weightless",
        "Contact in space: standard tetrahedra leave nodes of a flat face without weight.",
        lambda results: smallest(
            results, section="V10", cases={"element": "galerkin-T10"}, name="weightless_nodes"
        ),
        ">",
        0.0,
        tolerance_why="none: a count",
        why="The shape function of a corner integrates to zero over a 6-node triangle.",
    ),
    check(
        "V10-sphere-median",
        "Rigid sphere, five elements over the contact's radius: median error of the new "
        "tetrahedron's pressure over p0 for r < 0.8 a.",
        lambda results: scalar(results, key="V10/sphere-pw-T10-5", name="pressure_error_median"),
        "<",
        0.01,
        tolerance_why="none: 1 % was asked for before it was computed",
        why="Second order in the size of elements.",
    ),
    check(
        "V10-shear",
        "Partial slip of spheres, eight elements over the contact's radius: root mean "
        "square error of the new tetrahedron's shear over the standard one's, away from the"
        " edge of the stick zone, at the nodes that have a shear in both.",
        lambda results: ratio(
            results,
            key="V10/mindlin-pw-T10-8",
            other="V10/mindlin-galerkin-T10-8",
            name="shear_error_common_rms",
        ),
        "<",
        0.75,
        tolerance_why="none: an outside computation has 0.68",
        tolerance_set="after",
        why="Not derived.",
    ),
]

FINDINGS = r"""
**Finding.** All variants pass the patch test wherever a node has a reading (largest error
{{ num(measure("largest", section="V10", cases="(patch|tilted)-.*", name="pressure_error_max"), 1) }}). Below the sphere no
tetrahedron is best throughout: at common nodes the median error is
{{ fixed(100 * s("V10/sphere-galerkin-T10-5", "pressure_error_common_median"), 2) }} % with the standard and
{{ fixed(100 * s("V10/sphere-pw-T10-5", "pressure_error_common_median"), 2) }} % with the new one. What the new
tetrahedron, the sibling and $\boldsymbol{T}$ add is a reading at the corners, with larger errors than at mid-side nodes.
Total forces are less accurate with the new weights ({{ fixed(100 * s("V10/sphere-pw-T10-5", "force_error"), 2) }} against
{{ fixed(100 * s("V10/sphere-galerkin-T10-5", "force_error"), 2) }} % on tetrahedra). Hexahedra gain most: the largest
error falls from {{ fixed(100 * s("V10/sphere-galerkin-H27-5", "pressure_error_common_max"), 1) }} to
{{ fixed(100 * s("V10/sphere-pw-H27-5", "pressure_error_common_max"), 1) }} % of $p_0$ on the same nodes.

**Friction.** At common nodes the new tetrahedron's root mean square error of the shear is
{{ fixed(measure("ratio", key="V10/mindlin-pw-T10-4", other="V10/mindlin-galerkin-T10-4", name="shear_error_common_rms"), 2) }}
times the standard one's with four elements over $a$ and
{{ fixed(measure("ratio", key="V10/mindlin-pw-T10-8", other="V10/mindlin-galerkin-T10-8", name="shear_error_common_rms"), 2) }}
times with eight. The sibling's is
{{ fixed(measure("ratio", key="V10/mindlin-sibling-T10-4", other="V10/mindlin-galerkin-T10-4", name="shear_error_common_rms"), 2) }}
and
{{ fixed(measure("ratio", key="V10/mindlin-sibling-T10-8", other="V10/mindlin-galerkin-T10-8", name="shear_error_common_rms"), 2) }}
times as large. With eight elements the medians of all three are alike, and at corners the new element's largest error is
{{ fixed(100 * s("V10/mindlin-pw-T10-8", "shear_error_alone_max"), 2) }} %, above the standard one's
{{ fixed(100 * s("V10/mindlin-galerkin-T10-8", "shear_error_common_max"), 2) }} % at its own nodes. The stick zone does not
distinguish the elements. Some corners of the standard element slip or open within it, but they carry no force, and its
stick radius is as accurate as the others' ({{ ref("v10_stick") }}). No order is claimed for the stick zone.
"""

FURTHER_FINDINGS = r"""
1. **Hexahedra in partial slip.** With five elements over $a$ the new element's root mean square error of the shear is
   {{ fixed(measure("ratio", key="V10/mindlin-pw-H27-5", other="V10/mindlin-galerkin-H27-5", name="shear_error_common_rms"), 2) }}
   times the standard one's; its median is
   {{ fixed(measure("ratio", key="V10/mindlin-pw-H27-5", other="V10/mindlin-galerkin-H27-5", name="shear_error_common_median"), 2) }}
   times.
2. **Total forces** are within
   {{ most(100 * measure("largest", section="V10", cases="(sphere|punch)-.*-(4|5)", name="force_error")) }} % of the exact
   ones on the finer meshes.
3. **Other Poisson's ratios in partial slip.** At $\nu = 0.3$ Mindlin's solution, which neglects slip perpendicular to the
   tangential force, is no longer exact. The median error of the shear at common nodes, with three new tetrahedra over
   $a$, changes from {{ fixed(100 * s("V10/mindlin-pw-T10-3", "shear_error_common_median"), 2) }} to
   {{ fixed(100 * s("V10/mindlin-pw-T10-3-nu0.3", "shear_error_common_median"), 2) }} % of $\mu\,p_0$.
"""

# Limits

LIMITS = r"""
All faces are flat, the meshes match, the bodies are compressible, and displacements are small. Partial slip is computed
on one family of meshes. Sections K, V12 and V11 compare the methods in cost, under impact and on non-matching meshes.
"""
