"""Contact pressures computed from nodal forces, and two applications of those of Hertz contact.

1. `conduct_heat_through_joint`: heat flow through a joint whose conductance grows with the
    pressure.
2. `solve_stress_in_refined_submodel`: stress just below the surface, computed with a finer model of
    part of the body.

Lengths are relative to the half width of the contact, and stresses to Young's modulus.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx import fem, geometry
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    solve,
)
from pw_elements.elasticity import StressState
from pw_elements.spaces import Marker
from study.benchmarks.q_rivals.methods import pw_t6, snes_vi
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_lines import CONTACT_EDGE_POSITION
from study.meshes.solid_meshes import mesh_box_along_lines
from study.solutions.hertz_problem import (
    NU,
    E,
    Problem,
    line_contact_problem,
    make_function,
    make_quarter_sphere_contact_problem,
    solve_lu,
)

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]

# Pressures from nodal forces


def nodal_force_to_pressure_matrix(pressure_rule: str, surface: SurfaceNodes) -> Array:
    """Return the matrix (m, m) that converts nodal forces (m,) to nodal pressures (m,).

    The rule "own" divides each force by the integral of the node's test function over the surface,
    "tributary" divides it by the tributary area. The rule "projected" gives the piecewise-linear
    pressure that does the same work as the forces on all piecewise-linear displacements. Two more
    rules are like "own", except at nodes for which the integral vanishes (corner nodes of the
    standard T10): the pressure there is zero ("skip") or the mean of the adjacent mid-side nodes
    ("neighbours").

    Args:
        pressure_rule: Name of the pressure rule.
        surface: The m surface nodes.

    Raises:
        ValueError: If the rule is "own" and the integral of a node's test function vanishes.
    """
    if pressure_rule == "projected":
        P = linear_hat_functions_at_nodes(surface)
        return np.asarray(P @ np.linalg.solve(_mass_matrix_of_linear_hat_functions(surface), P.T))
    if pressure_rule == "tributary":
        return np.diag(1 / surface.tributary_area)
    is_weightless = surface.weight_area < 1e-9 * surface.tributary_area
    R = np.diag(1 / np.where(is_weightless, np.inf, surface.weight_area))
    if pressure_rule == "neighbours":
        is_beside = np.zeros_like(R)
        midside = surface.edges[:, :1].repeat(2, axis=1)
        is_beside[surface.edges[:, 1:], midside] = 1.0
        mean = is_beside / np.maximum(1.0, is_beside.sum(axis=1, keepdims=True))
        R[is_weightless] = (mean @ R)[is_weightless]
    elif pressure_rule == "own" and is_weightless.any():
        raise ValueError('there are nodes whose own weight vanishes; read them by "skip"')
    return R


def linear_hat_functions_at_nodes(surface: SurfaceNodes) -> Array:
    """Return the linear hat functions of the c corners at all m surface nodes, (m, c)."""
    P = np.eye(len(surface.position))
    P[surface.edges[:, 0]] = (P[surface.edges[:, 1]] + P[surface.edges[:, 2]]) / 2
    return P[:, _unique_corner_nodes(surface)]


def _unique_corner_nodes(surface: SurfaceNodes) -> npt.NDArray[np.int64]:
    corners: npt.NDArray[np.int64] = np.unique(surface.edges[:, 1:])
    return corners


def _mass_matrix_of_linear_hat_functions(surface: SurfaceNodes) -> Array:
    """Return the mass matrix (c, c) of linear hat functions on a surface of edges or triangles."""
    n_corners = surface.position.shape[1]  # of a facet
    facets = np.searchsorted(_unique_corner_nodes(surface), surface.facets[:, :n_corners])
    x = surface.position[surface.facets[:, :n_corners]]
    sides = x[:, 1:] - x[:, :1]
    sizes = np.sqrt(np.linalg.det(sides @ sides.transpose(0, 2, 1))) / (n_corners - 1)
    of_unit_facet = np.ones((n_corners, n_corners)) + np.eye(n_corners)
    of_unit_facet /= n_corners * (n_corners + 1)
    M = np.zeros((len(_unique_corner_nodes(surface)),) * 2)
    np.add.at(M, (facets[:, :, None], facets[:, None, :]), sizes[:, None, None] * of_unit_facet)
    return M


@dataclass(frozen=True)
class HertzContact:
    """Solved contact of a rigid parabola or paraboloid with an elastic half plane or space.

    The problem is that of section Q.

    Args:
        problem: Mesh and exact solution.
        u: Displacements.
        surface: The m surface nodes that may touch.
        force: Normal forces (m,) of the indenter on these nodes.
    """

    problem: Problem
    u: fem.Function
    surface: SurfaceNodes
    force: Array

    @classmethod
    def solve(cls, element: str, edges: int, offset: float = 0.0) -> "HertzContact":
        """Solve the contact with one element.

        Args:
            element: Element name such as "pw-T6" or "galerkin-T10".
            edges: Number of edges over the half width of the contact.
            offset: Shift of the contact's end within the adjacent edge, over the length of this
                edge.
        """
        kind, cell = element.split("-")
        is_new = kind == "pw"
        problem = (line_contact_problem if cell == "T6" else make_quarter_sphere_contact_problem)(
            edges, CONTACT_EDGE_POSITION + offset
        )
        answer = (pw_t6 if is_new else snes_vi).solve(problem)
        state = StressState.PLANE_STRAIN if cell == "T6" else StressState.SOLID
        spaces = (Spaces.petrov_galerkin if is_new else Spaces.galerkin)(problem.mesh)
        surface = SurfaceNodes.from_body(Body(spaces, Material(E, NU), state), problem.may_touch)
        force = problem.nodal_forces(answer.u, answer.test_space)[surface.node, problem.normal_axis]
        return cls(problem, answer.u, surface, force)


# Heat through a joint

CONDUCTANCE, EXPONENT = 2.0, 0.95
"""Constants h0 and m of the conductance h = h0 (p / p0)^m, where p0 is Hertz's peak pressure."""


class HeatResult(NamedTuple):
    """Result of the heat conduction through a joint.

    Args:
        heat: Heat flow through the joint.
        temperature_jump: Temperature jump in the middle of the joint.
        dofs: Number of unknowns.
    """

    heat: float
    temperature_jump: float
    dofs: int


def conduct_heat_through_joint(
    element: str,
    pressure_rule: str,
    edges: int,
    conductance_exponent: float = EXPONENT,
    offset: float = 0.0,
) -> HeatResult:
    """Compute the heat flow through a joint whose conductance depends on contact pressures.

    Heat flows from the far sides, at temperature 1, through the joint into the indenter, at
    temperature 0. The surface outside the contact is insulated, and the conductivity is one. The
    mesh is that of the contact problem. The conductance is lumped at the nodes: it is h(p) times
    the integral of the node's test function, or times its tributary area if the pressure rule is
    "tributary". The default exponent is M. M. Yovanovich's. If it were one and the temperature
    uniform, the heat flow would depend only on the total force.

    Args:
        element: Element name such as "pw-T6" or "galerkin-T10".
        pressure_rule: Pressure rule (see `nodal_force_to_pressure_matrix`).
        edges: Number of edges over the half width of the contact.
        conductance_exponent: Exponent m of the conductance.
        offset: Shift of the contact's end within the adjacent edge, over the length of this edge.
    """
    contact = HertzContact.solve(element, edges, offset)
    problem = contact.problem
    make_spaces = Spaces.petrov_galerkin if element.startswith("pw") else Spaces.galerkin
    spaces = make_spaces(problem.mesh, 0)
    nodes = SurfaceNodes.from_scalar_spaces(spaces, problem.may_touch)
    pressure = np.maximum(
        0.0, nodal_force_to_pressure_matrix(pressure_rule, contact.surface) @ contact.force
    )
    relative_pressure = pressure / problem.exact.peak_pressure
    joint = np.zeros(spaces.trial.dofmap.index_map.size_local)
    area = nodes.tributary_area if pressure_rule == "tributary" else nodes.weight_area
    joint[nodes.node] = CONDUCTANCE * relative_pressure**conductance_exponent * area
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    indptr, indices, values = K.getValuesCSR()
    matrix = sp.csr_matrix((values, indices, indptr)) + sp.diags(joint)
    T = _solve_nodal_temperatures(problem, matrix, spaces.trial)
    return HeatResult(
        float(joint @ T), float(T[nodes.node[_node_nearest_to_origin(nodes)]]), len(T)
    )


def conduct_heat_with_exact_pressure(cell: str, edges: int) -> HeatResult:
    """Compute the heat flow for Hertz's exact pressure on a mesh of standard elements.

    Args:
        cell: "T6" or "T10".
        edges: Number of edges over the half width of the contact.
    """
    problem = (line_contact_problem if cell == "T6" else make_quarter_sphere_contact_problem)(
        edges, CONTACT_EDGE_POSITION
    )
    spaces = Spaces.galerkin(problem.mesh, 0)
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.trial)
    relative_pressure = ufl.sqrt(ufl.max_value(0.0, 1 - problem.distance_from_middle**2))
    conductance = CONDUCTANCE * relative_pressure**EXPONENT
    form = (
        ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx + conductance * u * v * problem.contact_measure
    )
    K = fem.assemble_matrix(fem.form(form)).to_scipy()
    T = _solve_nodal_temperatures(problem, K, spaces.trial)
    nodes = SurfaceNodes.from_scalar_spaces(spaces, problem.may_touch)
    flux = conductance * make_function(spaces.trial, T) * problem.contact_measure
    heat = float(fem.assemble_scalar(fem.form(flux)))
    return HeatResult(heat, float(T[nodes.node[_node_nearest_to_origin(nodes)]]), len(T))


def _solve_nodal_temperatures(
    problem: Problem, K: sp.csr_matrix, space: fem.FunctionSpace
) -> Array:
    """Solve for the nodal temperatures (n,) with a temperature of 1 on the far sides.

    Args:
        problem: Mesh and exact solution of the contact.
        K: Conductivity matrix (n, n), including the joint.
        space: Space of the temperature.
    """
    x = space.tabulate_dof_coordinates()
    is_far = np.isclose(np.abs(x[:, : problem.normal_axis + 1]).max(axis=1), problem.body_size)
    T = is_far.astype(float)
    T[~is_far] = solve_lu(K[~is_far][:, ~is_far], -(K[~is_far][:, is_far] @ T[is_far]))
    return T


def _node_nearest_to_origin(surface: SurfaceNodes) -> int:
    return int(np.linalg.norm(surface.position, axis=1).argmin())


# Submodel below the contact

LINE_DEPTH = 0.1
"""Depth of the line on which stresses are compared."""
LINE = np.linspace(0.01, 0.79, 79)
"""Distances of the points of the line from the axis."""
LINE_ANGLE = np.deg2rad(20.0)
"""Angle between the line and the x axis in 3D, so that the line lies in no mesh plane."""
PART_DEPTH = 1.0
"""Minimum depth of the submodel."""


class SubmodelResult(NamedTuple):
    """Compressive stress normal to the surface along a line, over Hertz's peak pressure.

    Args:
        stress: Stresses (n,) computed with the submodel.
        exact: Exact stresses (n,) by Hertz's theory.
        dofs: Number of unknowns of the global model.
    """

    stress: Array
    exact: Array
    dofs: int


def solve_stress_in_refined_submodel(
    element: str, surface_load: str, edges: int, offset: float = 0.0
) -> SubmodelResult:
    """Compute the stress in a submodel, which is a part of the body with a mesh twice as fine.

    The submodel is the box below all nodes that may touch, meshed with standard elements. The
    displacements of the global model are prescribed on its cut sides.

    Args:
        element: Element name of the global model.
        surface_load: Load on the submodel's surface: the nodal forces themselves ("forces"),
            Hertz's exact pressure ("exact"), or a pressure rule of
            `nodal_force_to_pressure_matrix`, whose pressures are interpolated linearly between all
            nodes.
        edges: Number of edges of the global model over the half width of the contact.
        offset: Shift of the contact's end within the adjacent edge, over the length of this edge.
    """
    whole = HertzContact.solve(element, edges, offset)
    part = _make_refined_submodel(whole.problem)
    V, up = part.make_space(), part.normal_axis
    K = assemble_matrix(part.virtual_work(ufl.TrialFunction(V), ufl.TestFunction(V)))
    load = _assemble_submodel_surface_load(whole, part, V, surface_load, K)
    supports = Reduction.dirichlet(V, _make_submodel_supports(whole, part, V))
    u = make_function(V, solve(K, load, supports).array_r)

    stress = fem.Function(fem.functionspace(part.mesh, ("DG", 1)))
    points = stress.function_space.element.interpolation_points
    points = points() if callable(points) else points  # a method in some versions of DOLFINx
    stress.interpolate(fem.Expression(part.stress(u)[up, up], points))
    pressing = (
        -_evaluate_function_at_points(stress, _points_on_comparison_line(up))[:, 0]
        / part.exact.peak_pressure
    )
    return SubmodelResult(
        pressing, exact_normal_stress_below_contact(up, LINE, LINE_DEPTH), whole.u.x.array.size
    )


def exact_normal_stress_below_contact(
    normal_axis: int, distance_from_axis: Array, depth: float
) -> Array:
    """Return exact compressive stresses (n,) normal to the surface, over Hertz's peak pressure.

    Sources are K. L. Johnson, "Contact Mechanics" (1985), (4.49), in two dimensions, and M. T.
    Huber (1904) in three.

    Args:
        normal_axis: Axis normal to the surface: 1 in two dimensions, 2 in three.
        distance_from_axis: Distances (n,) from the axis of symmetry.
        depth: Depth below the surface.
    """
    if normal_axis == 1:
        root = np.sqrt(
            (1 - distance_from_axis**2 + depth**2) ** 2 + 4 * distance_from_axis**2 * depth**2
        )
        m2, n2 = (
            (root + 1 - distance_from_axis**2 + depth**2) / 2,
            (root - 1 + distance_from_axis**2 - depth**2) / 2,
        )
        return np.asarray(np.sqrt(m2) * (1 - (depth**2 + n2) / (m2 + n2)))
    difference = distance_from_axis**2 + depth**2 - 1
    u = (difference + np.sqrt(difference**2 + 4 * depth**2)) / 2
    return np.asarray((depth / np.sqrt(u)) ** 3 * u / (u**2 + depth**2))


def _make_refined_submodel(whole: Problem) -> Problem:
    """Make the submodel's box with a mesh twice as fine as that of the global model.

    Args:
        whole: Mesh and exact solution of the global model.
    """
    x = whole.mesh.geometry.x
    lines = [np.unique(x[:, axis].round(12)) for axis in range(whole.normal_axis + 1)]
    for axis in range(whole.normal_axis):
        lines[axis] = _halve_intervals(lines[axis][lines[axis] < whole.contact_zone_size + 1e-9])
    z = lines[whole.normal_axis]
    bottom = z[z < -PART_DEPTH + 1e-9].max()
    lines[whole.normal_axis] = _halve_intervals(z[z > bottom - 1e-9])
    mesh = (
        mesh_along_lines(MPI.COMM_SELF, lines[0], lines[1], "triangle")
        if whole.normal_axis == 1
        else mesh_box_along_lines("tetrahedron", *lines)
    )
    return Problem(
        mesh, whole.edge_length / 2, whole.contact_zone_size, whole.body_size, whole.exact
    )


def _halve_intervals(x: Array) -> Array:
    return np.sort(np.concatenate([x, (x[1:] + x[:-1]) / 2]))


def _make_submodel_supports(
    whole: HertzContact, part: Problem, V: fem.FunctionSpace
) -> list[fem.DirichletBC]:
    """Make the supports of the submodel: global displacements on cut sides, and symmetry planes.

    Args:
        whole: Solved global model.
        part: Mesh of the submodel.
        V: Space of the submodel's displacements.
    """
    is_cut = _make_cut_side_marker(part)
    nodes = fem.locate_dofs_geometrical(V, is_cut)
    displacement = fem.Function(V)
    x = V.tabulate_dof_coordinates()[nodes]
    displacement.x.array.reshape(-1, part.normal_axis + 1)[nodes] = _evaluate_function_at_points(
        whole.u, x
    )
    supports = [fem.dirichletbc(displacement, nodes)]
    for axis in range(part.normal_axis):
        sub, zero = V.sub(axis), fem.Function(V.sub(axis).collapse()[0])
        is_on_symmetry_plane = _make_uncut_symmetry_plane_marker(axis, is_cut)
        dofs = fem.locate_dofs_geometrical((sub, zero.function_space), is_on_symmetry_plane)
        supports.append(fem.dirichletbc(zero, dofs, sub))
    return supports


def _make_cut_side_marker(part: Problem) -> Callable[[Array], Mask]:
    """Return a function that marks the sides where the submodel is cut from the global model."""
    bottom = part.mesh.geometry.x[:, part.normal_axis].min()

    def is_cut(x: Array) -> Mask:
        is_beside = np.isclose(x[: part.normal_axis].max(axis=0), part.contact_zone_size)
        return np.asarray(np.isclose(x[part.normal_axis], bottom) | is_beside)

    return is_cut


def _make_uncut_symmetry_plane_marker(axis: int, is_cut: Callable[[Array], Mask]) -> Marker:
    return lambda x: np.asarray(np.isclose(x[axis], 0) & ~is_cut(x))


def _assemble_submodel_surface_load(
    whole: HertzContact, part: Problem, V: fem.FunctionSpace, surface_load: str, K: PETSc.Mat
) -> PETSc.Vec:
    """Assemble the load vector of forces or pressures on the submodel's surface.

    Args:
        whole: Solved global model.
        part: Mesh of the submodel.
        V: Space of the submodel's displacements.
        surface_load: Kind of load (see `solve_stress_in_refined_submodel`).
        K: Stiffness matrix of the submodel.
    """
    up, surface = part.normal_axis, whole.surface
    virtual_displacement = ufl.TestFunction(V)[up]
    if surface_load == "forces":
        load = K.createVecLeft()
        nodes = cKDTree(V.tabulate_dof_coordinates()[:, : up + 1]).query(surface.position)[1]
        load.array[nodes * (up + 1) + up] = -whole.force
        return load
    if surface_load == "exact":
        relative_pressure = ufl.sqrt(ufl.max_value(0.0, 1 - part.distance_from_middle**2))
        return assemble_vector(
            -part.exact.peak_pressure
            * relative_pressure
            * virtual_displacement
            * part.contact_measure
        )
    Q = fem.functionspace(part.mesh, ("Lagrange", 1))
    pressure = fem.Function(Q)
    nodes = fem.locate_dofs_geometrical(Q, part.may_touch)
    x = Q.tabulate_dof_coordinates()[nodes, : up + 1]
    node_of_whole = cKDTree(surface.position).query(x)[1]
    pressure.x.array[nodes] = (nodal_force_to_pressure_matrix(surface_load, surface) @ whole.force)[
        node_of_whole
    ]
    return assemble_vector(-pressure * virtual_displacement * part.contact_measure)


def _points_on_comparison_line(normal_axis: int) -> Array:
    direction = (np.cos(LINE_ANGLE), np.sin(LINE_ANGLE)) if normal_axis == 2 else (1.0,)
    points = np.zeros((len(LINE), 3))
    points[:, :normal_axis] = LINE[:, None] * direction
    points[:, normal_axis] = -LINE_DEPTH
    return points


def _evaluate_function_at_points(u: fem.Function, points: Array) -> Array:
    """Evaluate a finite-element function at points (n, 3).

    Each value is taken from one cell that contains the point.

    Returns:
        Values (n, components).
    """
    mesh: Mesh = u.function_space.mesh
    tree = geometry.bb_tree(mesh, mesh.topology.dim, padding=1e-9)
    candidates = geometry.compute_collisions_points(tree, points)
    colliding = geometry.compute_colliding_cells(mesh, candidates, points)
    cells = [colliding.links(k)[0] for k in range(len(points))]
    return np.asarray(u.eval(points, cells)).reshape(len(points), -1)


# Elements, meshes and pressure rules that the cases combine

MESHES = {
    "wear": {"T6": (4, 8, 32), "T10": (4, 8, 12)},
    "friction": {"T6": (4, 8, 32), "T10": (3, 5, 8)},
    "conductance": {"T6": (4, 8, 32), "T10": (3, 5, 8)},
    "impact": {"T6": (4, 8, 32), "T10": (4, 8, 16)},
    "submodel": {"T6": (4, 8, 32), "T10": (3, 5, 8)},
}
"""Numbers of cells over the height of a punch or block, or of edges over half of the contact.

They are given by problem and cell, from coarse to fine.
"""
READINGS: dict[tuple[str, str], tuple[str, ...]] = {
    ("wear", "galerkin-T6"): ("own", "projected", "tributary"),
    ("wear", "galerkin-T10"): ("projected", "skip", "neighbours", "tributary"),
    ("friction", "pw-T6"): ("own",),
    ("friction", "pw-T10"): ("own",),
    ("friction", "galerkin-T6"): ("own", "tributary"),
    ("friction", "galerkin-T10"): ("projected", "skip", "tributary"),
    ("conductance", "galerkin-T6"): ("own", "projected", "tributary"),
    ("conductance", "galerkin-T10"): ("skip", "projected", "tributary"),
    ("submodel", "galerkin-T6"): ("own", "projected", "forces", "tributary"),
    ("submodel", "galerkin-T10"): ("skip", "projected", "forces", "neighbours", "tributary"),
    ("submodel", "pw-T6"): ("own", "projected", "forces"),
    ("submodel", "pw-T10"): ("own", "projected", "forces"),
}
"""Pressure rules (see `nodal_force_to_pressure_matrix`) by problem and element.

The default is "own" and "projected".
"""
BEST_READINGS: dict[tuple[str, str], tuple[str, ...]] = {
    ("conductance", "galerkin-T10"): ("skip", "tributary"),
    ("submodel", "pw-T10"): ("own", "projected"),
}
"""Pressure rules among which an element's best is sought.

The default is "projected" for the standard T10, otherwise "own".
"""
RULES_ON_FINEST_MESH = {
    "wear": ("skip", "neighbours", "tributary"),
    "friction": ("tributary",),
    "conductance": ("tributary",),
    "submodel": ("tributary",),
}
"""Pressure rules of common codes, also computed for standard elements on the finest mesh."""


def standard_and_new_element(problem: str, cell: str) -> tuple[str, str]:
    """Return the names of the standard element and of the new one, or for impact of its sibling.

    The sibling is the symmetric element that is derived from the standard one.

    Args:
        problem: Name of the problem, a key of `MESHES`.
        cell: "T6" or "T10".
    """
    return f"galerkin-{cell}", f"{'sibling' if problem == 'impact' else 'pw'}-{cell}"


def candidate_best_pressure_rules(problem: str, element: str) -> tuple[str, ...]:
    """Return the pressure rules that may be the best for an element.

    The problem "impact" needs no pressures; the only rule is then "none".

    Args:
        problem: Name of the problem, a key of `MESHES`.
        element: Element name.
    """
    if problem == "impact":
        return ("none",)
    usual = "projected" if element == "galerkin-T10" else "own"
    return BEST_READINGS.get((problem, element), (usual,))


def pressure_rules_on_mesh(problem: str, element: str, mesh: int) -> tuple[str, ...]:
    """Return the pressure rules that are computed on a mesh; there are fewer on the finest mesh.

    Args:
        problem: Name of the problem, a key of `MESHES`.
        element: Element name.
        mesh: Number of cells or edges.
    """
    if problem == "impact":
        return ("none",)
    if mesh == MESHES[problem][element.split("-")[1]][-1]:
        rules = RULES_ON_FINEST_MESH[problem] if element.startswith("galerkin") else ()
        possible = READINGS.get((problem, element), ())
        best = candidate_best_pressure_rules(problem, element)
        return best + tuple(r for r in rules if r in possible and r not in best)
    return READINGS.get((problem, element), ("own", "projected"))


def list_case_parameters(problem: str, cell: str) -> list[tuple[str, str, int, str]]:
    """List problem, element, mesh and pressure rule of each case of a problem on one kind of cell.

    Args:
        problem: Name of the problem, a key of `MESHES`.
        cell: "T6" or "T10".
    """
    return [
        (problem, element, mesh, reading)
        for element in standard_and_new_element(problem, cell)
        for mesh in MESHES[problem][cell]
        for reading in pressure_rules_on_mesh(problem, element, mesh)
    ]
