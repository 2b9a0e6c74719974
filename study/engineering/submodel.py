"""Stress just below the surface, by a finer model of a part that is loaded by nodal forces.

Of Hertz' contact, solved on the whole, the box below all nodes that may touch is meshed again,
with standard elements of half the size. It has the whole's displacements on its cut sides, and on
its surface the nodal forces as they are ("forces"), or the pressures that are read from them,
linear between all nodes. The stress across the surface is compared on a line below it.
"""

from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, geometry
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements import Reduction, assemble_matrix, assemble_vector, solve
from pw_elements.spaces import Marker
from study.engineering.indented import Indented
from study.engineering.readings import reading as read_by
from study.meshes.line_mesh import on_lines
from study.meshes.solid_meshes import box
from study.rivals.problem import Problem, function

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]

DEPTH, BELOW = 0.1, 1.0  # of the line, and of the box at least, over the half width
LINE = np.linspace(0.01, 0.79, 79)  # distances of points from the axis
ANGLE = np.deg2rad(20.0)  # of the line in space from x: no plane of the mesh


class Below(NamedTuple):
    """Stress across the surface over the peak pressure, pressing, along the line.

    Args:
        stress: by the submodel.
        exact: Hertz'.
        dofs: unknowns of the whole.
    """

    stress: Array
    exact: Array
    dofs: int


def below(element: str, reading: str, edges: int) -> Below:
    """The stress by a submodel; "exact": with Hertz' own pressure on its surface."""
    whole = Indented.of(element, edges)
    part = _part(whole.problem)
    V, up = part.space(), part.up
    x, cut = V.tabulate_dof_coordinates(), _cut(part)
    held = fem.locate_dofs_geometrical(V, cut)
    given = fem.Function(V)
    given.x.array.reshape(-1, up + 1)[held] = _evaluated(whole.u, x[held])
    conditions = [fem.dirichletbc(given, held)]
    for axis in range(up):
        sub, zero = V.sub(axis), fem.Function(V.sub(axis).collapse()[0])
        dofs = fem.locate_dofs_geometrical(
            (sub, zero.function_space), lambda p, axis=axis: np.isclose(p[axis], 0) & ~cut(p)
        )
        conditions.append(fem.dirichletbc(zero, dofs, sub))
    K = assemble_matrix(part.work(ufl.TrialFunction(V), ufl.TestFunction(V)))
    load = _load(whole, part, V, reading, K)
    u = function(V, solve(K, load, Reduction.dirichlet(V, conditions)).array_r)
    along = (np.cos(ANGLE), np.sin(ANGLE)) if up == 2 else (1.0,)
    points = np.zeros((len(LINE), 3))
    points[:, :up], points[:, up] = LINE[:, None] * along, -DEPTH
    across = fem.functionspace(part.mesh, ("DG", 1))
    stress = fem.Function(across)
    interpolation = across.element.interpolation_points
    at = interpolation() if callable(interpolation) else interpolation
    stress.interpolate(fem.Expression(part.stress(u)[up, up], at))
    peak = part.known.peak
    found = -_evaluated(stress, points)[:, 0] / peak
    return Below(found, exact_stress(up, LINE, DEPTH), whole.u.x.array.size)


def exact_stress(up: int, r: Array, z: float) -> Array:
    """Pressing stress across the surface at distances r (n,) and the depth z, over the peak.

    In the plane K. L. Johnson, "Contact Mechanics" (1985), (4.49); in space M. T. Huber (1904).
    """
    if up == 1:
        squares = np.sqrt((1 - r**2 + z**2) ** 2 + 4 * r**2 * z**2)
        m2, n2 = (squares + 1 - r**2 + z**2) / 2, (squares - 1 + r**2 - z**2) / 2
        return np.asarray(np.sqrt(m2) * (1 - (z**2 + n2) / (m2 + n2)))
    reduced = r**2 + z**2 - 1
    u = (reduced + np.sqrt(reduced**2 + 4 * z**2)) / 2
    return np.asarray((z / np.sqrt(u)) ** 3 * u / (u**2 + z**2))


def _part(problem: Problem) -> Problem:
    """The finer box, as a problem on its own mesh."""
    x = problem.mesh.geometry.x
    lines = [np.unique(x[:, axis].round(12)) for axis in range(problem.up + 1)]
    for axis in range(problem.up):
        lines[axis] = _halved(lines[axis][lines[axis] < problem.zone + 1e-9])
    depths = lines[problem.up]
    lines[problem.up] = _halved(depths[depths > depths[depths < -BELOW + 1e-9].max() - 1e-9])
    mesh = (
        on_lines(MPI.COMM_SELF, lines[0], lines[1], "triangle")
        if problem.up == 1
        else box("tetrahedron", *lines)
    )
    return Problem(mesh, problem.size / 2, problem.zone, problem.outer, problem.known)


def _halved(lines: Array) -> Array:
    return np.sort(np.concatenate([lines, (lines[1:] + lines[:-1]) / 2]))


def _cut(part: Problem) -> Marker:
    """Marker of the sides at which the whole goes on."""
    bottom = part.mesh.geometry.x[:, part.up].min()

    def cut(x: Array) -> Mask:
        beside = np.isclose(x[: part.up].max(axis=0), part.zone)
        return np.asarray(np.isclose(x[part.up], bottom) | beside)

    return cut


def _load(
    whole: Indented, part: Problem, V: fem.FunctionSpace, reading: str, K: PETSc.Mat
) -> PETSc.Vec:
    """Load (n,) on the surface of the part."""
    up, surface = part.up, whole.surface
    if reading == "forces":
        load = K.createVecLeft()
        nodes = cKDTree(V.tabulate_dof_coordinates()[:, : up + 1]).query(surface.position)[1]
        load.array[nodes * (up + 1) + up] = -whole.force
        return load
    Q = fem.functionspace(part.mesh, ("Lagrange", 1))
    pressure, x = fem.Function(Q), Q.tabulate_dof_coordinates()
    if reading == "exact":
        exact = ufl.sqrt(ufl.max_value(0.0, 1 - part.distance**2))
        return assemble_vector(-part.known.peak * exact * ufl.TestFunction(V)[up] * part.surface)
    nodes = fem.locate_dofs_geometrical(Q, part.touching)
    of_whole = cKDTree(surface.position).query(x[nodes, : up + 1])[1]
    pressure.x.array[nodes] = (read_by(reading, surface) @ whole.force)[of_whole]
    return assemble_vector(-pressure * ufl.TestFunction(V)[up] * part.surface)


def _evaluated(u: fem.Function, points: Array) -> Array:
    """Values (n, components) at points (n, 3), each in one of the cells around it."""
    mesh: Mesh = u.function_space.mesh
    tree = geometry.bb_tree(mesh, mesh.topology.dim, padding=1e-9)
    near = geometry.compute_collisions_points(tree, points)
    hits = geometry.compute_colliding_cells(mesh, near, points)
    cells = [hits.links(k)[0] for k in range(len(points))]
    return np.asarray(u.eval(points, cells)).reshape(len(points), -1)
