"""Pressures read from nodal forces, and two problems that use those of a solved Hertz contact.

1. `conduct_heat`: heat through a joint whose conductance grows with the pressure.
2. `solve_submodel`: stress just below the surface, by a finer model of a part of the body.

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
    """Return the matrix (m, m) that makes pressures of nodal forces (m,).

    Readings without a parameter: forces over "own" weights, or "tributary" areas, or "projected"
    to linear functions of the surface, which do the same work on all linear displacements. Where
    own weights vanish, at corners of the standard T10, two rules make up a pressure: none ("skip"),
    or the mean of the mid-side "neighbours".

    Raises:
        ValueError: if the reading is "own" and an own weight vanishes.
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
    """Return the values (m, c) at all nodes of the linear functions that are one at a corner."""
    P = np.eye(len(surface.position))
    P[surface.edges[:, 0]] = (P[surface.edges[:, 1]] + P[surface.edges[:, 2]]) / 2
    return P[:, _corners(surface)]


def _corners(surface: SurfaceNodes) -> npt.NDArray[np.int64]:
    corners: npt.NDArray[np.int64] = np.unique(surface.edges[:, 1:])
    return corners


def _linear_mass(surface: SurfaceNodes) -> Array:
    """Return integrals (c, c) of products of the linear functions, over intervals or triangles."""
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
    """A solved contact of section Q: a half plane below a parabola, or the same in space.

    Args:
        problem: mesh and exact solution.
        u: displacements.
        surface: nodes that may touch, m.
        force: (m,), of the indenter on them.
    """

    problem: Problem
    u: fem.Function
    surface: SurfaceNodes
    force: Array

    @classmethod
    def solve(cls, element: str, edges: int, offset: float = 0.0) -> "HertzContact":
        """Solve the contact.

        Args:
            element: its name.
            edges: number of edges over the contact's half width.
            offset: how much farther in the next edge the contact ends, over the edge's length.
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
"""h0 and the exponent in the conductance h = h0 (p / p0)^.95; p0 is Hertz' peak pressure."""


class HeatResult(NamedTuple):
    """Heat through the joint, the jump of temperature in its middle, and unknowns."""

    heat: float
    jump: float
    dofs: int


def conduct_heat(
    element: str, reading: str, edges: int, exponent: float = EXPONENT, offset: float = 0.0
) -> HeatResult:
    """Return the heat with an element's pressures, on its own mesh and by its test functions.

    Heat flows from the far sides, at the temperature 1, through the joint into the indenter, at 0;
    the surface beside the contact is insulated. The conductivity is one. Joints conduct at nodes,
    h(p) times the integral of the node's test function, or its tributary area if this is how
    pressures are read. The exponent is M. M. Yovanovich's; of h linear in p the heat
    at an even temperature is that of the total force, whatever the nodal forces.
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
    """Return the heat of Hertz' exact pressure, on a mesh of standard elements."""
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
    """Return temperatures (n,), which are 1 at the far sides."""
    x = space.tabulate_dof_coordinates()
    is_far = np.isclose(np.abs(x[:, : problem.normal_axis + 1]).max(axis=1), problem.body_size)
    T = is_far.astype(float)
    T[~is_far] = solve_lu(K[~is_far][:, ~is_far], -(K[~is_far][:, is_far] @ T[is_far]))
    return T


def _middle_node(surface: SurfaceNodes) -> int:
    return int(np.linalg.norm(surface.position, axis=1).argmin())


# Submodel below the contact

LINE_DEPTH = 0.1
"""Depth of the line_contact_problem on which stresses are compared."""
LINE = np.linspace(0.01, 0.79, 79)
"""Distances of its points from the axis."""
LINE_ANGLE = np.deg2rad(20.0)
"""Angle of the line_contact_problem in space from x: it lies in no plane of the mesh."""
PART_DEPTH = 1.0
"""Least depth of the part that is meshed again."""


class SubmodelResult(NamedTuple):
    """Pressing stress across the surface along the line_contact_problem, over the peak pressure.

    Args:
        stress: by the submodel.
        exact: by Hertz' theory.
        dofs: unknowns of the whole.
    """

    stress: Array
    exact: Array
    dofs: int


def solve_submodel(element: str, reading: str, edges: int, offset: float = 0.0) -> SubmodelResult:
    """Return the stress in a part of the body that is meshed again, twice as fine.

    The part is the mesh_box below all nodes that may touch, of standard elements. It has the whole's
    displacements on its cut sides.

    Args:
        element: its name.
        reading: load on the part's surface: nodal forces as they are ("forces"); pressures that
            are read from them, linear between all nodes; or Hertz' pressure ("exact").
        edges: of the whole, over the half width of the contact.
        offset: how much farther in the next edge the contact ends, over the edge's length.
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
    points = points() if callable(points) else points  # versions of DOLFINx differ
    stress.interpolate(fem.Expression(part.stress(u)[up, up], points))
    pressing = -_evaluate(stress, _points_on_line(up))[:, 0] / part.exact.peak_pressure
    return SubmodelResult(pressing, exact_stress(up, LINE, LINE_DEPTH), whole.u.x.array.size)


def exact_stress(up: int, r: Array, z: float) -> Array:
    """Return the pressing stress across the surface, over the peak pressure.

    In the plane K. L. Johnson, "Contact Mechanics" (1985), (4.49); in space M. T. Huber (1904).

    Args:
        up: axis across the surface, 1 in the plane, 2 in space.
        r: (n,), distances from the axis.
        z: depth.
    """
    if up == 1:
        root = np.sqrt((1 - r**2 + z**2) ** 2 + 4 * r**2 * z**2)
        m2, n2 = (root + 1 - r**2 + z**2) / 2, (root - 1 + r**2 - z**2) / 2
        return np.asarray(np.sqrt(m2) * (1 - (z**2 + n2) / (m2 + n2)))
    difference = r**2 + z**2 - 1
    u = (difference + np.sqrt(difference**2 + 4 * z**2)) / 2
    return np.asarray((z / np.sqrt(u)) ** 3 * u / (u**2 + z**2))


def _refine_part(whole: Problem) -> Problem:
    """Return the finer mesh_box, as a problem on its own mesh."""
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
    """Return the whole's displacements on the cut sides, and symmetry."""
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
    """Return a marker of the sides at which the whole continues."""
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
    """Return the load (n,) on the surface of the part."""
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
    """Return values (n, components) at points (n, 3), each in one of the cells around it."""
    mesh: Mesh = u.function_space.mesh
    tree = geometry.bb_tree(mesh, mesh.topology.dim, padding=1e-9)
    candidates = geometry.compute_collisions_points(tree, points)
    colliding = geometry.compute_colliding_cells(mesh, candidates, points)
    cells = [colliding.links(k)[0] for k in range(len(points))]
    return np.asarray(u.eval(points, cells)).reshape(len(points), -1)
