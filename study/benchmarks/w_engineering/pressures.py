"""Pressures "read" (computed) from nodal forces, and two problems that use those of Hertz contact.

1. `conduct_heat`: heat through a joint whose conductance grows with the pressure.
2. `solve_submodel`: stress just below the surface, computed with a finer model of part of the body.

Lengths are over the half width of the contact, stresses over Young's modulus.
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
from study.meshes.solid_meshes import mesh_box
from study.solutions.hertz_problem import (
    NU,
    E,
    Problem,
    line_contact_problem,
    make_function,
    solve_lu,
    sphere_contact_problem,
)

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]

# Pressures from nodal forces


def pressure_matrix(reading: str, surface: SurfaceNodes) -> Array:
    """Return the matrix (m, m) that converts nodal forces (m,) to pressures.

    Readings: "own" divides each force by the integral of the node's own weight function;
    "tributary" divides by the tributary area; "projected" gives the piecewise-linear pressure that
    does the same work as the forces on all piecewise-linear displacements. Two more readings are
    like "own", except at nodes whose own weight vanishes (corners of the standard T10), where the
    pressure is zero ("skip") or the mean of the adjacent mid-side nodes ("neighbours").

    Raises:
        ValueError: if the reading is "own" and the own weight of a node vanishes.
    """
    if reading == "projected":
        P = interpolate_linearly(surface)
        return np.asarray(P @ np.linalg.solve(_linear_mass(surface), P.T))
    if reading == "tributary":
        return np.diag(1 / surface.tributary_area)
    is_weightless = surface.weight_area < 1e-9 * surface.tributary_area
    R = np.diag(1 / np.where(is_weightless, np.inf, surface.weight_area))
    if reading == "neighbours":
        is_beside = np.zeros_like(R)
        midside = surface.edges[:, :1].repeat(2, axis=1)
        is_beside[surface.edges[:, 1:], midside] = 1.0
        mean = is_beside / np.maximum(1.0, is_beside.sum(axis=1, keepdims=True))
        R[is_weightless] = (mean @ R)[is_weightless]
    elif reading == "own" and is_weightless.any():
        raise ValueError('there are nodes whose own weight vanishes; read them by "skip"')
    return R


def interpolate_linearly(surface: SurfaceNodes) -> Array:
    """Return the values (m, c) of the c corners' linear hat functions at all m nodes."""
    P = np.eye(len(surface.position))
    P[surface.edges[:, 0]] = (P[surface.edges[:, 1]] + P[surface.edges[:, 2]]) / 2
    return P[:, _corners(surface)]


def _corners(surface: SurfaceNodes) -> npt.NDArray[np.int64]:
    corners: npt.NDArray[np.int64] = np.unique(surface.edges[:, 1:])
    return corners


def _linear_mass(surface: SurfaceNodes) -> Array:
    """Return the mass matrix (c, c) of linear hat functions on a surface of edges or triangles."""
    n_corners = surface.position.shape[1]  # of a facet
    facets = np.searchsorted(_corners(surface), surface.facets[:, :n_corners])
    x = surface.position[surface.facets[:, :n_corners]]
    sides = x[:, 1:] - x[:, :1]
    sizes = np.sqrt(np.linalg.det(sides @ sides.transpose(0, 2, 1))) / (n_corners - 1)
    of_unit_facet = np.ones((n_corners, n_corners)) + np.eye(n_corners)
    of_unit_facet /= n_corners * (n_corners + 1)
    M = np.zeros((len(_corners(surface)),) * 2)
    np.add.at(M, (facets[:, :, None], facets[:, None, :]), sizes[:, None, None] * of_unit_facet)
    return M


@dataclass(frozen=True)
class HertzContact:
    """Solved contact of section Q: a rigid parabola or paraboloid on a half plane or space.

    Args:
        problem: Mesh and exact solution.
        u: Displacements.
        surface: The m nodes that may touch.
        force: Normal forces (m,) of the indenter on these nodes.
    """

    problem: Problem
    u: fem.Function
    surface: SurfaceNodes
    force: Array

    @classmethod
    def solve(cls, element: str, edges: int, offset: float = 0.0) -> "HertzContact":
        """Solve the contact.

        Args:
            element: Name of the element.
            edges: Number of edges over the half width of the contact.
            offset: Shift of the end of contact within the next edge, over the edge's length.
        """
        kind, cell = element.split("-")
        is_new = kind == "pw"
        problem = (line_contact_problem if cell == "T6" else sphere_contact_problem)(
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
"""Constants h0 and m of the conductance h = h0 (p / p0)^m, where p0 is Hertz' peak pressure."""


class HeatResult(NamedTuple):
    """Heat flow through the joint, temperature jump in its middle, and number of unknowns."""

    heat: float
    jump: float
    dofs: int


def conduct_heat(
    element: str, reading: str, edges: int, exponent: float = EXPONENT, offset: float = 0.0
) -> HeatResult:
    """Compute the heat flow through the joint from an element's pressures, on the same mesh.

    Heat flows from the far sides, at temperature 1, through the joint into the indenter, at
    temperature 0; the surface outside the contact is insulated. The conductivity is one. The joint
    conducts at the nodes: a node's conductance is h(p) times the integral of its test function, or
    times its tributary area if the reading is "tributary". The exponent is M. M. Yovanovich's. If
    it were one and the temperature uniform, the heat flow would depend on the total force only,
    whatever the nodal forces.
    """
    contact = HertzContact.solve(element, edges, offset)
    problem = contact.problem
    make_spaces = Spaces.petrov_galerkin if element.startswith("pw") else Spaces.galerkin
    spaces = make_spaces(problem.mesh, 0)
    nodes = SurfaceNodes.from_scalar_spaces(spaces, problem.may_touch)
    pressure = np.maximum(0.0, pressure_matrix(reading, contact.surface) @ contact.force)
    relative_pressure = pressure / problem.exact.peak_pressure
    joint = np.zeros(spaces.trial.dofmap.index_map.size_local)
    area = nodes.tributary_area if reading == "tributary" else nodes.weight_area
    joint[nodes.node] = CONDUCTANCE * relative_pressure**exponent * area
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    indptr, indices, values = K.getValuesCSR()
    matrix = sp.csr_matrix((values, indices, indptr)) + sp.diags(joint)
    T = _solve_temperature(problem, matrix, spaces.trial)
    return HeatResult(float(joint @ T), float(T[nodes.node[_middle_node(nodes)]]), len(T))


def conduct_heat_of_exact_pressure(cell: str, edges: int) -> HeatResult:
    """Compute the heat flow for Hertz' exact pressure, on a mesh of standard elements."""
    problem = (line_contact_problem if cell == "T6" else sphere_contact_problem)(
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
    T = _solve_temperature(problem, K, spaces.trial)
    nodes = SurfaceNodes.from_scalar_spaces(spaces, problem.may_touch)
    flux = conductance * make_function(spaces.trial, T) * problem.contact_measure
    heat = float(fem.assemble_scalar(fem.form(flux)))
    return HeatResult(heat, float(T[nodes.node[_middle_node(nodes)]]), len(T))


def _solve_temperature(problem: Problem, K: sp.csr_matrix, space: fem.FunctionSpace) -> Array:
    """Return the nodal temperatures (n,) for a temperature of 1 on the far sides."""
    x = space.tabulate_dof_coordinates()
    is_far = np.isclose(np.abs(x[:, : problem.normal_axis + 1]).max(axis=1), problem.body_size)
    T = is_far.astype(float)
    T[~is_far] = solve_lu(K[~is_far][:, ~is_far], -(K[~is_far][:, is_far] @ T[is_far]))
    return T


def _middle_node(surface: SurfaceNodes) -> int:
    return int(np.linalg.norm(surface.position, axis=1).argmin())


# Submodel below the contact

LINE_DEPTH = 0.1
"""Depth of the line on which stresses are compared."""
LINE = np.linspace(0.01, 0.79, 79)
"""Distances of the line's points from the axis."""
LINE_ANGLE = np.deg2rad(20.0)
"""Angle of the line to the x axis in space, chosen so that it lies in no plane of the mesh."""
PART_DEPTH = 1.0
"""Minimum depth of the submodel."""


class SubmodelResult(NamedTuple):
    """Compressive stress normal to the surface along the line, over the peak pressure.

    Args:
        stress: Stress computed with the submodel.
        exact: Exact stress by Hertz' theory.
        dofs: Number of unknowns of the whole model.
    """

    stress: Array
    exact: Array
    dofs: int


def solve_submodel(element: str, reading: str, edges: int, offset: float = 0.0) -> SubmodelResult:
    """Compute the stress in a submodel: a part of the body that is meshed again, twice as fine.

    The part is the box below all nodes that may touch, meshed with standard elements. On its cut
    sides the displacements of the whole model are prescribed.

    Args:
        element: Name of the element of the whole model.
        reading: Load on the submodel's surface: the nodal forces themselves ("forces"), Hertz'
            pressure ("exact"), or a reading of `pressure_matrix`, whose pressures are interpolated
            linearly between all nodes.
        edges: Number of edges of the whole model over the half width of the contact.
        offset: Shift of the end of contact within the next edge, over the edge's length.
    """
    whole = HertzContact.solve(element, edges, offset)
    part = _refine_part(whole.problem)
    V, up = part.make_space(), part.normal_axis
    K = assemble_matrix(part.virtual_work(ufl.TrialFunction(V), ufl.TestFunction(V)))
    load = _load_on_part(whole, part, V, reading, K)
    supports = Reduction.dirichlet(V, _supports_of_part(whole, part, V))
    u = make_function(V, solve(K, load, supports).array_r)

    stress = fem.Function(fem.functionspace(part.mesh, ("DG", 1)))
    points = stress.function_space.element.interpolation_points
    points = points() if callable(points) else points  # a method in some versions of DOLFINx
    stress.interpolate(fem.Expression(part.stress(u)[up, up], points))
    pressing = -_evaluate(stress, _points_on_line(up))[:, 0] / part.exact.peak_pressure
    return SubmodelResult(pressing, exact_stress(up, LINE, LINE_DEPTH), whole.u.x.array.size)


def exact_stress(up: int, r: Array, z: float) -> Array:
    """Return the exact compressive stress (n,) normal to the surface, over the peak pressure.

    In the plane it is from K. L. Johnson, "Contact Mechanics" (1985), (4.49); in space from M. T.
    Huber (1904).

    Args:
        up: Axis normal to the surface: 1 in the plane, 2 in space.
        r: Distances (n,) from the axis.
        z: Depth.
    """
    if up == 1:
        root = np.sqrt((1 - r**2 + z**2) ** 2 + 4 * r**2 * z**2)
        m2, n2 = (root + 1 - r**2 + z**2) / 2, (root - 1 + r**2 - z**2) / 2
        return np.asarray(np.sqrt(m2) * (1 - (z**2 + n2) / (m2 + n2)))
    difference = r**2 + z**2 - 1
    u = (difference + np.sqrt(difference**2 + 4 * z**2)) / 2
    return np.asarray((z / np.sqrt(u)) ** 3 * u / (u**2 + z**2))


def _refine_part(whole: Problem) -> Problem:
    """Return the submodel's box, meshed twice as fine as the whole, as a problem of its own."""
    x = whole.mesh.geometry.x
    lines = [np.unique(x[:, axis].round(12)) for axis in range(whole.normal_axis + 1)]
    for axis in range(whole.normal_axis):
        lines[axis] = _halve_intervals(lines[axis][lines[axis] < whole.zone + 1e-9])
    z = lines[whole.normal_axis]
    bottom = z[z < -PART_DEPTH + 1e-9].max()
    lines[whole.normal_axis] = _halve_intervals(z[z > bottom - 1e-9])
    mesh = (
        mesh_along_lines(MPI.COMM_SELF, lines[0], lines[1], "triangle")
        if whole.normal_axis == 1
        else mesh_box("tetrahedron", *lines)
    )
    return Problem(mesh, whole.size / 2, whole.zone, whole.body_size, whole.exact)


def _halve_intervals(x: Array) -> Array:
    return np.sort(np.concatenate([x, (x[1:] + x[:-1]) / 2]))


def _supports_of_part(
    whole: HertzContact, part: Problem, V: fem.FunctionSpace
) -> list[fem.DirichletBC]:
    """Return the submodel's supports: the whole's displacements on cut sides, and symmetry."""
    is_cut = _cut_sides(part)
    nodes = fem.locate_dofs_geometrical(V, is_cut)
    displacement = fem.Function(V)
    x = V.tabulate_dof_coordinates()[nodes]
    displacement.x.array.reshape(-1, part.normal_axis + 1)[nodes] = _evaluate(whole.u, x)
    supports = [fem.dirichletbc(displacement, nodes)]
    for axis in range(part.normal_axis):
        sub, zero = V.sub(axis), fem.Function(V.sub(axis).collapse()[0])
        is_on_symmetry_plane = _symmetry_plane(axis, is_cut)
        dofs = fem.locate_dofs_geometrical((sub, zero.function_space), is_on_symmetry_plane)
        supports.append(fem.dirichletbc(zero, dofs, sub))
    return supports


def _cut_sides(part: Problem) -> Callable[[Array], Mask]:
    """Return a marker of the sides along which the submodel is cut from the whole model."""
    bottom = part.mesh.geometry.x[:, part.normal_axis].min()

    def is_cut(x: Array) -> Mask:
        is_beside = np.isclose(x[: part.normal_axis].max(axis=0), part.zone)
        return np.asarray(np.isclose(x[part.normal_axis], bottom) | is_beside)

    return is_cut


def _symmetry_plane(axis: int, is_cut: Callable[[Array], Mask]) -> Marker:
    return lambda x: np.asarray(np.isclose(x[axis], 0) & ~is_cut(x))


def _load_on_part(
    whole: HertzContact, part: Problem, V: fem.FunctionSpace, reading: str, K: PETSc.Mat
) -> PETSc.Vec:
    """Return the load vector (n,) of forces or pressures on the submodel's surface."""
    up, surface = part.normal_axis, whole.surface
    virtual_displacement = ufl.TestFunction(V)[up]
    if reading == "forces":
        load = K.createVecLeft()
        nodes = cKDTree(V.tabulate_dof_coordinates()[:, : up + 1]).query(surface.position)[1]
        load.array[nodes * (up + 1) + up] = -whole.force
        return load
    if reading == "exact":
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
    pressure.x.array[nodes] = (pressure_matrix(reading, surface) @ whole.force)[node_of_whole]
    return assemble_vector(-pressure * virtual_displacement * part.contact_measure)


def _points_on_line(up: int) -> Array:
    direction = (np.cos(LINE_ANGLE), np.sin(LINE_ANGLE)) if up == 2 else (1.0,)
    points = np.zeros((len(LINE), 3))
    points[:, :up] = LINE[:, None] * direction
    points[:, up] = -LINE_DEPTH
    return points


def _evaluate(u: fem.Function, points: Array) -> Array:
    """Return values (n, components) at points (n, 3), each from one cell that contains it."""
    mesh: Mesh = u.function_space.mesh
    tree = geometry.bb_tree(mesh, mesh.topology.dim, padding=1e-9)
    candidates = geometry.compute_collisions_points(tree, points)
    colliding = geometry.compute_colliding_cells(mesh, candidates, points)
    cells = [colliding.links(k)[0] for k in range(len(points))]
    return np.asarray(u.eval(points, cells)).reshape(len(points), -1)
