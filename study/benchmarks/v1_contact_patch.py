"""Contact patch test: a uniform pressure must be transmitted unchanged to a rigid plane."""

from functools import partial

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh
from matplotlib.figure import Figure

from pw_elements import Material, SurfaceNodes, prescribe
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from study.judge.checks import check
from study.judge.measures.general import largest
from study.model.contact_result import CONTACT_QUANTITIES
from study.model.discretisation import discretise, mesh_nodes_and_cells
from study.model.units import assign_units_to_scalars
from study.model.vocabulary import OWN_FUNCTION_READING, TRIBUTARY_READING
from study.publish.plots.style import ELEMENT_LOOK, PAGE_WIDTH, draw_quadratic_mesh_with_nodes
from study.publish.plots.symbols import draw_uniform_load_pressing_down
from study.run.cases import Case
from study.run.pages import PageFigure
from study.run.store import Result, Results

Array = npt.NDArray[np.float64]

SECTION = "V1"
TITLE = "Contact patch test"
FACTS = {
    "geometry": "a block 2 × 1 on a rigid plane",
    "mesh": "6 × 3 squares: regular, distorted, with curved inner sides",
    "material": "linear elastic, plane strain and axisymmetric; E = 1000, ν = 0.3",
    "supports": "symmetry at the left; smooth contact below",
    "load": "uniform pressure 3 on top",
    "reference": "uniform stress",
    "uncertainty": "none but round-off on straight sides",
}

# Problem and exact solution

PROBLEM = r"""
A block is pressed uniformly on a smooth rigid plane. The exact stress is uniform; a contact formulation has to transmit
the pressure unchanged, whatever the mesh.
"""

YOUNGS_MODULUS, POISSONS_RATIO, PRESSURE = 1000.0, 0.3, 3.0
LENGTH, HEIGHT = 2.0, 1.0


def exact_uniaxial_displacement(x: Array, state: StressState) -> Array:
    """Return the exact displacements (n, 2) at points (n, 3) under uniaxial stress.

    Plane strain equals plane stress with E/(1 - nu²) and nu/(1 - nu) instead of E and nu. In
    axisymmetry the stress is uniaxial in three dimensions.

    Args:
        x: Points (n, 3).
        state: Stress state.
    """
    E, nu = YOUNGS_MODULUS, POISSONS_RATIO
    if state is StressState.PLANE_STRAIN:
        E, nu = E / (1 - nu**2), nu / (1 - nu)
    return PRESSURE / E * x[:, :2] * np.array([nu, -1.0])


# Method

METHOD = r"""
The block is in plane strain, with symmetry on the left and unilateral contact with the rigid plane below. The meshes of
6 × 3 squares are regular, have all nodes moved at random (those on the outline along it), or have curved inner sides; in
axisymmetry a distorted mesh is used. Nodal forces, own-function pressures and tributary pressures, as node-to-surface
codes print them, are compared with the exact ones at every node; there is no own-function pressure where a node's test
function has no integral.
"""

BLOCK_DIVISIONS = (6, 3)
MAX_RELATIVE_NODE_MOVE = 0.15
"""Largest random displacement of a node, over the side of a square cell."""
MAX_RELATIVE_BEND = 0.06
"""Largest displacement of a node along an axis on curved meshes, over the size of the block."""


def patch(element: str, mesh: str, state: str = "plane strain") -> Result:
    """Solve the contact patch test; return forces, pressures and their errors.

    Each error is the largest one of all nodes, relative to the uniform pressure, the largest nodal
    force or the largest displacement. An own-function pressure (`pressure_own`) is a nodal force
    over the integral of the node's test function. The scalar `weightless` is the number of nodes
    for which this integral vanishes, so that they have no such pressure.

    Args:
        element: Element name such as "pw-T6" or "galerkin-Q8".
        mesh: Kind of mesh: "straight", "distorted" or "curved".
        state: Name of the stress state.
    """
    material = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = discretise(element, partial(_build_block_mesh, mesh), material, StressState(state))
    space = body.space
    load = body.surface_load((0.0, -PRESSURE), lambda x: np.isclose(x[1], HEIGHT))
    symmetry = prescribe(space, 0, lambda x: np.isclose(x[0], 0.0))
    contact_pair = ContactPair(_is_on_lower_side, Plane((0.0, 0.0), (0.0, 1.0)))
    (solution,) = solve_contact(body.K, load, body.supports([symmetry]), [contact_pair], space)
    (contact,) = solution.pairs

    surface = SurfaceNodes.from_body(body.body, _is_on_lower_side)
    force = contact.force_normal
    own_pressure = surface.pressure(force)
    tributary_pressure = surface.tributary_pressure(force)
    displacement = solution.displacement.array_r.reshape(-1, 2)
    expected = exact_uniaxial_displacement(space.tabulate_dof_coordinates(), StressState(state))
    scalars = {
        "error_force": np.abs(force - PRESSURE * surface.weight_area).max() / force.max(),
        "error_pressure_own": np.nanmax(np.abs(own_pressure / PRESSURE - 1)),
        "error_pressure_tributary": np.abs(tributary_pressure / PRESSURE - 1).max(),
        "error_displacement": np.abs(displacement - expected).max() / np.abs(expected).max(),
        "weightless": np.isnan(own_pressure).sum(),
        "applied_pressure": PRESSURE,
        "force_normal": force.sum(),
        "force_tangential": contact.force_tangential.sum(),
        "sawtooth": surface.sawtooth(force),
        "unevenness": surface.unevenness(own_pressure),
        "peak_pressure": np.nanmax(own_pressure),
        "iterations": solution.iterations,
        "residual": solution.residuals.largest(),
    }
    scalars = {name: float(value) for name, value in scalars.items()}
    unit_kinds = {
        **CONTACT_QUANTITIES,
        "error_*": "1",
        "weightless": "1",
        "applied_pressure": "stress",
    }
    curves: dict[str, np.ndarray] = {
        "x": contact.position[:, 0],
        "force_n": force,
        "force_t": -contact.force_tangential[:, 0],
        "pressure": own_pressure,
        "pressure_tributary": tributary_pressure,
        "status": contact.status,
        **mesh_nodes_and_cells(space),
    }
    return Result(
        scalars, assign_units_to_scalars(scalars, unit_kinds), curves, dofs=body.K.getSize()[0]
    )


def _build_block_mesh(mesh_kind: str, cell: str) -> Mesh:
    build = triangles if cell == "triangle" else quadrilaterals
    mesh = build(MPI.COMM_SELF, (0.0, 0.0), (LENGTH, HEIGHT), BLOCK_DIVISIONS)
    if mesh_kind == "distorted":
        return move_nodes(mesh, _move_nodes_at_random)
    if mesh_kind == "curved":
        return curved_mesh(mesh, _bend_inner_mesh_lines)
    return mesh


def _move_nodes_at_random(x: Array) -> Array:
    """Displace nodes (n, 3) of the block at random; nodes on the outline move along it."""
    moved = x.copy()
    generator = np.random.default_rng(1)
    for axis, (size, count) in enumerate(zip((LENGTH, HEIGHT), BLOCK_DIVISIONS, strict=True)):
        is_inside = ~np.isclose(x[:, axis] % size, 0.0)
        move = MAX_RELATIVE_NODE_MOVE * size / count * generator.uniform(-1, 1, len(x))
        moved[:, axis] += np.where(is_inside, move, 0.0)
    return moved


def _bend_inner_mesh_lines(x: Array) -> Array:
    """Displace nodes (n, 3) so that inner mesh lines are curved and the outline is straight."""
    s, t = np.pi * x[:, 0] / LENGTH, np.pi * x[:, 1] / HEIGHT
    bent = x.copy()
    bent[:, 0] += MAX_RELATIVE_BEND * LENGTH * np.sin(s) * np.cos(1.5 * t)
    bent[:, 1] += MAX_RELATIVE_BEND * HEIGHT * np.sin(t) * np.cos(1.5 * s)
    return bent


def _is_on_lower_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[1], 0.0)


# Cases

ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")
MESH_KINDS = ("straight", "distorted", "curved")
CASES = [
    Case("V1", f"{element}-{mesh}", patch, {"element": element, "mesh": mesh})
    for element in ELEMENTS
    for mesh in MESH_KINDS
]
CASES += [
    Case(
        "V1",
        f"{element}-round",
        patch,
        {"element": element, "mesh": "distorted", "state": "axisymmetric"},
    )
    for element in ELEMENTS
]

# Results

MACROS = r"""
{% set meshes = [("straight", "straight"), ("distorted", "distorted"), ("curved", "curved"), ("round", "axisymmetric, distorted")] %}
"""

RESULT = r"""
{{ figure("v1_patch_test") }}
"""

DETAILS = r"""
{% call table("v1-contact-patch-test", "Contact patch test.", long=True) %}
| Element | Mesh | Error of displacements | Error of nodal forces | Error of pressure, own test function | Error of pressure, tributary area | Mid-side over corner force | Nodes without weight |
|---|---|---:|---:|---:|---:|---:|---:|
{% for element, name in elements %}{% for mesh, mesh_name in meshes %}{% set key = "V1/" ~ element ~ "-" ~ mesh %}
| {{ name }} | {{ mesh_name }} |{% for error in ("error_displacement", "error_force", "error_pressure_own", "error_pressure_tributary") %} {{ num(s(key, error), 2) }} |{% endfor %} {{ fixed(s(key, "sawtooth"), 3) }} | {{ fixed(s(key, "weightless"), 0) }} |
{% endfor %}{% endfor %}
{% endcall %}
"""


DRAWN_CASE_KEYS = {element: f"V1/{element}-distorted" for element in ("galerkin-T6", "pw-T6")}


def draw_patch_test_mesh_and_pressures(results: Results) -> Figure:
    """Draw the mesh of the contact patch test, and its nodal pressures by two measures.

    The panels show the distorted mesh with the load, pressures by integrals of test functions, and
    pressures by tributary areas.
    """
    fig, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.3), width_ratios=(1.3, 1, 1))
    curves = results.curves(DRAWN_CASE_KEYS["galerkin-T6"])
    draw_quadratic_mesh_with_nodes(axes[0], curves["nodes"], curves["cells"])
    length, height = curves["nodes"].max(axis=0)
    draw_uniform_load_pressing_down(
        axes[0], [length * i / 8 for i in range(9)], height + 0.04, 0.16
    )
    axes[0].axhspan(-0.12, 0, color="#CCCCCC", lw=0)
    axes[0].set(title="(a) mesh and load", xlabel="$x$", ylabel="$y$")
    axes[0].grid(visible=False)
    measures = {
        "pressure": f"(b) {OWN_FUNCTION_READING.name}",
        "pressure_tributary": f"(c) {TRIBUTARY_READING.name}",
    }
    for ax, (name, title) in zip(axes[1:], measures.items(), strict=True):
        for element, key in DRAWN_CASE_KEYS.items():
            curves = results.curves(key)
            look = dict(ELEMENT_LOOK[element])
            if element == "pw-T6":
                look |= {"markerfacecolor": "none", "markersize": 7}
            applied = results.scalar(key, "applied_pressure")
            ax.plot(curves["x"], curves[name] / applied, **look)
        ax.set(title=title, xlabel="$x$", ylim=(0, 1.6))
    axes[1].set_ylabel("pressure / applied one")
    axes[1].legend(fontsize=7, loc="lower center")
    return fig


FIGURES = [
    PageFigure(
        "v1_patch_test",
        draw_patch_test_mesh_and_pressures,
        needs=list(DRAWN_CASE_KEYS.values()),
        caption=f"Contact patch test on a distorted mesh (a). The {OWN_FUNCTION_READING.name} pressure (b) of both "
        f"elements is the applied one; the {TRIBUTARY_READING.name} pressure (c), {TRIBUTARY_READING.meaning} it, "
        "is off by a third with the standard element.",
        alt="A distorted mesh of triangles on a rigid plane and two plots of pressure along it: "
        "constant for both elements by the own test function, a sawtooth between two thirds and "
        "four thirds for the standard element by the tributary length.",
    )
]

VERIFICATION = r"""
| patch test, distorted mesh | exact | pressure, largest | {{ num(s("V1/pw-T6-distorted", "error_pressure_own"), 1) }} | {{ num(s("V1/galerkin-T6-distorted", "error_pressure_own"), 1) }} |
"""

# Findings

CHECKS = [
    check(
        "V1-own",
        "Contact patch test: nodal force over the integral of the node's own test function "
        "is the applied pressure, for all elements on straight and distorted meshes.",
        lambda results: largest(
            results,
            section="V1",
            cases={"mesh": ["distorted", "straight"], "state": "plane strain"},
            name="error_pressure_own",
        ),
        "=",
        0.0,
        tolerance=1e-11,
        tolerance_why="round-off of a small linear system",
        why="Linear displacements are among the trial functions of all elements, and test "
        "functions that sum to one balance a uniform stress.",
    ),
    check(
        "V1-tributary-standard",
        "Standard elements: the pressure as node-to-surface codes print it, the nodal force"
        " over the tributary length, is off by a third.",
        lambda results: largest(
            results,
            section="V1",
            cases={
                "element": ["galerkin-Q8", "galerkin-T6"],
                "mesh": ["distorted", "straight"],
                "state": "plane strain",
            },
            name="error_pressure_tributary",
        ),
        "=",
        0.33333333333,
        tolerance=1e-10,
        tolerance_why="digits of the value, and round-off",
        why="2/3 and 1/6 of an edge's force go to a mid-side node and a corner, 1/2 and 1/4 "
        "would be even.",
    ),
]

FINDINGS = r"""
In own-function pressure all elements pass, on regular and distorted meshes, in plane strain and axisymmetry (largest
relative error of the standard and the new triangle
{{ num([s("V1/pw-T6-distorted", "error_pressure_own"), s("V1/galerkin-T6-distorted", "error_pressure_own")] | max, 1) }}).
In tributary pressure, as node-to-surface codes print it, the standard elements are off by
{{ pct(s("V1/galerkin-T6-distorted", "error_pressure_tributary")) }}. In axisymmetry the integral of the standard shape
function at a node on the axis is zero, and no pressure can be read there.
"""

FURTHER_FINDINGS = r"""
1. In axisymmetry the node on the axis has no weight in the standard elements: its force is zero under any uniform
   pressure, and no pressure can be read there. The new elements have one.
2. With curved inner sides the standard 8-node quadrilateral fails by
   {{ num(s("V1/galerkin-Q8-curved", "error_pressure_own"), 2) }}, since its geometry has nine nodes here. The composite
   triangle gives the exact pressure, but its displacements are off by
   {{ num(s("V1/composite-T6-curved", "error_displacement"), 2) }}.
"""

# Limits

LIMITS = r"""
A uniform stress says nothing about accuracy where pressures vary, nor about the edge of a contact zone: see V2 and V3.
The contact line is straight and all nodes are in contact.
"""
