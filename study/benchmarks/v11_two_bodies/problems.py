"""Problems of two deformable bodies whose meshes do not match, and their comparison."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import basix
import gmsh
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import CellType, Mesh, create_box, create_rectangle
from scipy.spatial import cKDTree

from pw_elements import Spaces, SurfaceNodes, assemble_matrix, prescribe
from pw_elements.contact import STICK, Motion
from pw_elements.contact.interface import (
    BoundaryFacets,
    compute_cell_lengths_or_areas,
    gather_boundary_facets,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh, move_nodes
from pw_elements.spaces import locate_exterior_facets
from study.benchmarks.v11_two_bodies.methods import NEW, Solution, TwoBodies
from study.meshes.graded_meshes import joined
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_families import meshed
from study.meshes.mesh_lines import OUTER, graded, growing
from study.meshes.solid_meshes import box
from study.model.reading import compared
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.calculix.calculix import load_unchanged_answer
from study.solutions.calculix.two_bodies import PAIRS, StackedBlocks
from study.solutions.half_space import Elastic, HertzLine, HertzSphere
from study.solutions.stick_slip import Cattaneo

Array = npt.NDArray[np.floating[Any]]
Doubles = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Facets = npt.NDArray[np.int32]

# Lengths are divided by the half width or radius of the contact, stresses by the lower body's E
POISSONS_RATIO = 0.3
MODULI = (1.0, 3.0)
EDGE_RATIO = 0.7
"""Number of the master's edges over that of the slave's."""
RELATIVE_RADIUS = 1e3
"""Radius of the relative curvature, so large that slopes are small."""
INNER = 0.8
"""Distance from the middle within which inner errors are taken."""
SLOW_PRESSURE_RATIO = 2.0
"""A pressure varies slowly where neighbouring nodes differ by less than this factor."""
NO_PRESSURE_BELOW = 1e-9
"""Fraction of the largest pressure below which a pressure counts as zero."""

# Patch tests: blocks of height 1, the lower one as wide as 1

PRESSURE = 1e-3
NARROW_WIDTH = 0.83
"""Of the upper block where the slave is wider than the master."""


def patch(way: str, dim: int) -> Result:
    """Solve a block on another, pressed evenly: uniaxial stress."""
    return _solve_blocks(way, dim, 1.0)


def overhang(way: str, dim: int) -> Result:
    """Solve the same where the slave is wider; loads press what the master does not cover."""
    return _solve_blocks(way, dim, NARROW_WIDTH)


def _solve_blocks(method: str, dim: int, width: float) -> Result:
    two, up = _two_blocks(method, dim, width), dim - 1
    traction = np.zeros(dim)
    traction[up] = -PRESSURE
    load = two.load(traction, lambda x: np.isclose(x[up], 2.0))
    if width < 1:
        trace = gather_boundary_facets(two.space, two.slave)
        nodes, weights = _integrate_weights_beyond(trace, width, method in NEW)
        values = load.array.reshape(-1, dim)
        np.add.at(values[:, up], nodes, -PRESSURE * weights)
        load.array[:] = values.ravel()
    symmetry = [prescribe(two.space, i, _plane(i, 0.0)) for i in range(dim)]
    solution = two.solve(load, symmetry)
    # nodes that the master does not cover have no pressure
    exact = np.full(len(solution.node), PRESSURE)
    return compare(two, solution, exact, PRESSURE, np.inf)


def _two_blocks(method: str, dim: int, width: float) -> TwoBodies:
    """Return two blocks, the upper one of a given width."""
    up, (n_upper, n_lower) = dim - 1, (4, 7) if dim == 2 else (2, 3)

    def block(n: int, bottom: float) -> Mesh:
        build, cell = (create_rectangle, "triangle") if dim == 2 else (create_box, "tetrahedron")
        corners = [[0.0] * up + [bottom], [1.0] * up + [bottom + 1]]
        return build(MPI.COMM_SELF, corners, [n, n + 1, n][:dim], CellType[cell])

    upper = move_nodes(block(n_upper, 1.0), lambda x: x * [width, 1.0, 1.0])
    mesh, is_lower_cell = joined(block(n_lower, 0.0), upper)
    state = StressState.PLANE_STRAIN if dim == 2 else StressState.SOLID
    faces = _contact_faces(mesh, is_lower_cell, lambda x: np.isclose(x[up], 1.0))
    return TwoBodies.from_mesh(
        method, mesh, is_lower_cell, (1.0, 1.0), POISSONS_RATIO, state, faces
    )


def _integrate_weights_beyond(
    trace: BoundaryFacets, end: float, linear: bool
) -> tuple[npt.NDArray[np.int64], Array]:
    """Integrate test functions over the part x > end of a flat face.

    Sub-facets are cut at the end, and the pieces are integrated by a rule of degree 2.

    Args:
        trace: of the face.
        end: where the part begins.
        linear: whether test functions are linear on sub-facets, or quadratic on facets.

    Returns:
        Nodes and integrals, one row for each piece; nodes occur more than once.
    """
    sub_facet_nodes, corners, _ = trace.sub_facet_nodes_corners_and_normals
    points, weights = basix.make_quadrature(
        {2: basix.CellType.interval, 3: basix.CellType.triangle}[trace.space_dim], 2
    )
    weights = weights / weights.sum()
    barycentric_points = np.column_stack([1 - points.sum(axis=1), points])
    nodes, integrals = [], []
    for sub_facet in range(len(corners)):
        corner: Array = corners[sub_facet]
        for piece in _cut_simplex(corner, end, trace.space_dim):
            size = compute_cell_lengths_or_areas((piece @ corner)[None])[0]
            position = barycentric_points @ piece
            if linear:
                nodes.append(sub_facet_nodes[sub_facet])
                integrals.append(size * weights @ position)
            else:
                node, N = trace.evaluate_trial_functions(
                    np.full(len(position), sub_facet), position
                )
                nodes.append(node[0])
                integrals.append(size * weights @ N)
    return np.concatenate(nodes), np.concatenate(integrals)


def _cut_simplex(corner: Array, end: float, dim: int) -> list[Doubles]:
    """Return the pieces of an edge or triangle with x > end, each as barycentric corners."""
    kept: list[Doubles] = []
    vertices: list[Doubles] = [np.eye(dim)[k] for k in range(dim)]
    for a, b in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        xa, xb = (float(vertex @ corner[:, 0]) for vertex in (a, b))
        if xa > end:
            kept.append(a)
        if (xa > end) != (xb > end):
            kept.append(a + (end - xa) / (xb - xa) * (b - a))
    if dim == 2:
        pieces = [kept[:2]] if len(kept) > 1 else []
    else:
        pieces = [[kept[0], *kept[i : i + 2]] for i in range(1, len(kept) - 1)]
    return [np.array(piece) for piece in pieces]


# Two cylinders: plane strain, exact displacements on the outer sides

SIDE = 5.0
"""Height and half width of either body."""
ZONE, GROWTH = 1.4, 1.3
"""Half width of the part that may touch; growth of cells outside of it."""
EDGE_POSITION = 0.375
"""Where the contact ends within an element, as a fraction of its length."""
FRICTION_OF_UNEQUAL = 0.3
REFERENCE_EDGES = 32
"""Of the mesh from which differences are taken where nothing is known."""
FRICTION, FRICTION_FRACTION = 0.4, 0.5
"""Of partial slip: mu, and the tangential force over what friction can carry."""
N_SOURCES = 64
"""Point forces that stand for an elliptic traction on a half plane."""


def hertz(way: str, edges: int, ratio: float = EDGE_RATIO) -> Result:
    """Solve two cylinders of unequal moduli without friction; far fields are exact.

    Args:
        way: name of the method.
        edges: of the slave, over the half width of the contact.
        ratio: number of the master's edges over that of the slave's.
    """
    two, exact, solution = _press_cylinders(way, edges, ratio, 0.0)
    x = two.x[solution.node][:, 0]
    force = exact[0].force / 2
    return compare(two, solution, exact[0].pressure(x), exact[0].peak, INNER, force)


def unequal(way: str, edges: int) -> Result:
    """Solve two cylinders of unequal moduli with friction, whose sides move as without it.

    Errors are differences from a mesh of 32 edges.
    """
    result, fine = (_press_with_friction(way, n) for n in (edges, REFERENCE_EDGES))
    x, area = result.curves["x"][:, 0], result.curves["area"]
    reference = {
        name: np.interp(x, fine.curves["x"][:, 0], fine.curves[name])
        for name in ("pressure", "shear")
    }
    error = {name: np.abs(result.curves[name] - value) for name, value in reference.items()}
    inner = x < INNER
    scalars = {
        "pressure_error": error["pressure"][inner].max(),
        "pressure_error_median": np.median(error["pressure"][inner]),
        "pressure_l2": np.sqrt(
            (area * error["pressure"] ** 2).sum() / (area * reference["pressure"] ** 2).sum()
        ),
        "shear_error": error["shear"][inner].max(),
        "stick_off": abs(result.scalars["stick"] - fine.scalars["stick"]) * edges,
        "force_error": abs(result.scalars["force"] / fine.scalars["force"] - 1),
    }
    numbers = {**result.scalars, **{name: float(value) for name, value in scalars.items()}}
    del numbers["force"]
    curves = {
        **result.curves,
        "exact_pressure": reference["pressure"],
        "exact_shear": reference["shear"],
    }
    return replace(result, scalars=numbers, units=dimensionless(numbers), curves=curves)


def _press_with_friction(method: str, edges: int) -> Result:
    two, exact, solution = _press_cylinders(method, edges, EDGE_RATIO, FRICTION_OF_UNEQUAL)
    x = two.x[solution.node][:, 0]
    (pair,) = solution.states[-1].pairs
    scalars = {
        "stick": float(x[pair.status == STICK].max(initial=0.0)),
        "force": float(pair.force_normal.sum()) / exact[0].force,
    }
    peak = exact[0].peak
    curves = {"shear": pair.force_tangential[:, 0] / solution.area / peak}
    pressure, force = exact[0].pressure(x), exact[0].force / 2
    return compare(two, solution, pressure, peak, INNER, force, scalars, curves)


def _press_cylinders(
    method: str, edges: int, ratio: float, friction: float
) -> tuple[TwoBodies, list[HertzLine], Solution]:
    """Solve one half of two cylinders; return the bodies, their exact fields and the solution."""
    lower, upper = (Elastic(E, POISSONS_RATIO) for E in MODULI)
    force = np.pi / (4 * RELATIVE_RADIUS) / _compliance(lower, upper)
    exact = [
        HertzLine(body, np.pi * body.plane_modulus / (4 * force), force) for body in (lower, upper)
    ]
    two = _two_cylinders(method, edges, ratio)
    outer = _prescribe_outer_sides(two, exact)
    symmetry = prescribe(two.space, 0, lambda x: np.isclose(x[0], 0.0) & ~_outer_sides(x))
    solution = two.solve(two.K.createVecLeft(), [outer, symmetry], friction)
    return two, exact, solution


def cattaneo(way: str, edges: int) -> Result:
    """Solve two equal cylinders pressed and then pushed by forces; approach and shift are free."""
    body = Elastic(1.0, POISSONS_RATIO)
    force = np.pi / (4 * RELATIVE_RADIUS) / _compliance(body, body)
    exact = Cattaneo(1.0, force, FRICTION, FRICTION_FRACTION)
    two = _two_cylinders(way, edges, EDGE_RATIO, (1.0, 1.0), whole=True)
    fractions = (0.0, FRICTION_FRACTION / 2, FRICTION_FRACTION)
    # the far field differs between the increments: loads stand for its prescribed values
    loads = []
    for fraction in fractions:
        prescribed = two.K.createVecRight()
        nodes = fem.locate_dofs_geometrical(two.space, _outer_sides)
        x = two.x[nodes]
        is_upper = (_nodes_above(two)[nodes])[:, None]
        field = _partial_slip_field(body, force, fraction, np.where(is_upper, -x, x))
        prescribed.array.reshape(-1, 2)[nodes] = np.where(is_upper, -field, field)
        load = two.K * prescribed
        load.scale(-1.0)
        loads.append(load)
    outer = [prescribe(two.space, i, _outer_sides) for i in (0, 1)]
    motions = [
        Motion((None, None), (fraction * FRICTION * force, -force)) for fraction in fractions
    ]
    motions[0] = Motion((0.0, None), (0.0, -force))
    solution = two.solve(loads, outer, FRICTION, motions)
    x = two.x[solution.node][:, 0]
    (pair,) = solution.states[-1].pairs
    shear = pair.force_tangential[:, 0] / solution.area
    # away from the kinks of the exact shear
    is_compared = np.abs(np.abs(x) - exact.stick) > 1.5 / edges
    is_compared &= np.abs(x) < 1 - 1.5 / edges
    shear_error = float(np.abs(shear - exact.shear(x))[is_compared].max())
    stick = float(np.ptp(x[pair.status == STICK])) / 2
    scalars = {
        "stick": stick,
        "stick_off": abs(stick - exact.stick) * edges,
        "shear_error": shear_error / (FRICTION * exact.peak),
    }
    curves = {"shear": shear / exact.peak, "exact_shear": exact.shear(x) / exact.peak}
    pressure = exact.pressure(x)
    return compare(two, solution, pressure, exact.peak, INNER, force, scalars, curves)


def _two_cylinders(
    method: str,
    edges: int,
    ratio: float,
    moduli: tuple[float, float] = MODULI,
    whole: bool = False,
) -> TwoBodies:
    """Return two cylinders, the lower one flat and the slave; one half of them, or the whole."""

    def mesh_lines(n: int) -> tuple[Doubles, Doubles, float]:
        size = 1 / (n + EDGE_POSITION)
        near = size * np.arange(np.ceil(ZONE / size) + 1)
        across = np.concatenate([near, near[-1] + growing(size, SIDE - near[-1], GROWTH)[1:]])
        if whole:
            across = np.concatenate([-across[:0:-1], across])
        return across, growing(size, SIDE, GROWTH), float(near[-1])

    def curve(x: Doubles) -> Doubles:
        return x + x[:, :1] ** 2 / (2 * RELATIVE_RADIUS) * [0.0, 1.0, 0.0]

    x_lower, depth, zone = mesh_lines(edges)
    x_upper, height, _ = mesh_lines(max(1, round(ratio * edges)))
    comm = MPI.COMM_SELF
    flat_lower = on_lines(comm, x_lower, -depth[::-1], "triangle", "left_right")
    flat_upper = on_lines(comm, x_upper, height, "triangle", "left_right")
    lower, upper = curved_mesh(flat_lower, lambda x: x), curved_mesh(flat_upper, curve)
    mesh, is_lower_cell = joined(lower, upper)

    def near_contact(x: Array) -> Mask:
        return np.abs(x[1]) < x[0] ** 2 / (2 * RELATIVE_RADIUS) + 1e-9

    faces = _contact_faces(mesh, is_lower_cell, near_contact)
    state = StressState.PLANE_STRAIN
    two = TwoBodies.from_mesh(method, mesh, is_lower_cell, moduli, POISSONS_RATIO, state, faces)
    return _restrict_slave(two, lambda x: np.abs(x[:, 0]) < zone + 1e-9)


def _outer_sides(x: Array) -> Mask:
    return np.isclose(np.abs(x[0]), SIDE) | np.isclose(x[1], -SIDE) | (x[1] > SIDE - 1e-9)


def _prescribe_outer_sides(two: TwoBodies, exact: list[HertzLine]) -> fem.DirichletBC:
    """Prescribe exact displacements, those of the upper body with the approach of both."""
    nodes = fem.locate_dofs_geometrical(two.space, _outer_sides)
    is_upper = _nodes_above(two)[nodes]
    field = fem.Function(two.space)
    values, x = field.x.array.reshape(-1, 2), two.x[nodes]
    values[nodes[~is_upper]] = exact[0].displacement(x[~is_upper])
    values[nodes[is_upper]] = exact[1].displacement(x[is_upper] * [1, -1]) * [1, -1]
    values[nodes[is_upper], 1] -= sum(body.approach for body in exact)
    return fem.dirichletbc(field, nodes)


def _partial_slip_field(body: Elastic, force: float, fraction: float, x: Array) -> Array:
    """Return displacements (n, 2) of the lower half plane under the tractions of partial slip."""
    theta = np.arange(1, N_SOURCES + 1) * np.pi / (N_SOURCES + 1)
    s, weight = np.cos(theta), 2 / (N_SOURCES + 1) * np.sin(theta) ** 2
    normal, none = force * weight, np.zeros(N_SOURCES)
    stick = np.sqrt(1 - fraction)
    field = body.line_displacement(x, s, normal, FRICTION * normal if fraction else none)
    if fraction:
        in_stick_zone = (1 - fraction) * FRICTION * normal
        field = field - body.line_displacement(x, stick * s, none, in_stick_zone)
    return np.asarray(field)


# Two spheres: a quarter of them, exact displacements on the outer sides


def spheres(way: str, edges: float, ratio: float = 0.71) -> Result:
    """Solve a quarter of two spheres of unequal moduli without friction; far fields are exact.

    Args:
        way: name of the method.
        edges: of the slave, over the radius of the contact.
        ratio: number of the master's edges over that of the slave's.
    """
    two, exact = _two_spheres(way, edges, ratio)

    def outer_sides(x: Array) -> Mask:
        return (np.abs(x[2]) > OUTER - 1e-9) | np.isclose(np.maximum(x[0], x[1]), OUTER)

    def symmetry(axis: int) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(p[axis], 0.0) & ~outer_sides(p)

    nodes = fem.locate_dofs_geometrical(two.space, outer_sides)
    x, is_upper = two.x[nodes], _nodes_above(two)[nodes]
    field = fem.Function(two.space)
    values = field.x.array.reshape(-1, 3)
    for body, of_body, sign in zip(exact, (~is_upper, is_upper), (1.0, -1.0), strict=True):
        r = np.hypot(x[of_body, 0], x[of_body, 1])
        u = body.displacement(np.column_stack([r, sign * x[of_body, 2]]))
        values[nodes[of_body], :2] = u[:, :1] * x[of_body, :2] / np.maximum(r, 1e-12)[:, None]
        values[nodes[of_body], 2] = sign * u[:, 1]
    values[nodes[is_upper], 2] -= sum(body.approach for body in exact)
    conditions = [fem.dirichletbc(field, nodes)]
    conditions += [prescribe(two.space, i, symmetry(i)) for i in (0, 1)]
    solution = two.solve(two.K.createVecLeft(), conditions)
    r = np.linalg.norm(two.x[solution.node][:, :2], axis=1)
    force = exact[0].force / 4
    return compare(two, solution, exact[0].pressure(r), exact[0].peak, INNER, force)


def _two_spheres(method: str, edges: float, ratio: float) -> tuple[TwoBodies, list[HertzSphere]]:
    """Return a quarter of both spheres, and their exact fields."""
    bodies = [Elastic(E, POISSONS_RATIO) for E in MODULI]
    force = 4 / 3 / RELATIVE_RADIUS / _compliance(*bodies)
    exact = [HertzSphere(body, 4 * body.plane_modulus / (3 * force), force) for body in bodies]
    lines = graded(edges)
    upper_lines = graded(edges * ratio)
    lower = box("tetrahedron", lines.beside, lines.beside, lines.below)
    upper = curved_mesh(
        box("tetrahedron", upper_lines.beside, upper_lines.beside, -upper_lines.below[::-1]),
        lambda x: x + (x[:, :1] ** 2 + x[:, 1:2] ** 2) / (2 * RELATIVE_RADIUS) * [0.0, 0.0, 1.0],
    )
    mesh, is_lower_cell = joined(curved_mesh(lower, lambda x: x), upper)

    def near_contact(x: Array) -> Mask:
        return np.abs(x[2]) < (x[0] ** 2 + x[1] ** 2) / (2 * RELATIVE_RADIUS) + 1e-9

    faces = _contact_faces(mesh, is_lower_cell, near_contact)
    state = StressState.SOLID
    two = TwoBodies.from_mesh(method, mesh, is_lower_cell, MODULI, POISSONS_RATIO, state, faces)
    return _restrict_slave(two, lambda x: np.maximum(x[:, 0], x[:, 1]) < lines.zone + 1e-9), exact


# CalculiX on the same meshes

CALCULIX_DEGREE = 2
"""Degree that CalculiX's four points in a tetrahedron integrate exactly."""


def calculix(case: str, tracked: str) -> Result:
    """Evaluate CalculiX's stored solution of the same bodies on the same mesh.

    Pressures are those that it gives to the slave's nodes; nodal forces are residuals of the
    standard element, with its quadrature, under its displacements.

    Args:
        case: name of the deck.
        tracked: digest of the stored solution.
    """
    problem, peer = PAIRS[case], load_unchanged_answer(case, tracked)
    exact: list[HertzSphere] = []
    if isinstance(problem, StackedBlocks):
        two = _two_blocks("p2-p2", 3, 1.0)
    else:
        two, exact = _two_spheres("p2-p2", problem.edges, problem.size_ratio)
    x, peer_x = two.x, problem.nodes
    # nodes of both bodies may coincide: a fourth coordinate tells the bodies apart
    face, n_lower = peer_x[problem.slave_nodes[0] - 1, -1], len(problem.grids[0].straight_nodes)
    peer_positions = np.column_stack([peer_x, np.arange(len(peer_x)) >= n_lower])
    positions = np.column_stack([x, _nodes_above(two, face)])
    distance, peer_node = cKDTree(peer_positions).query(positions)
    assert distance.max() < 1e-9
    assert len(np.unique(peer_node)) == len(peer_x) == len(x)
    displacement = np.zeros_like(peer_x)
    displacement[problem.nodes_around_contact - 1] = peer.numbers["displacement"].reshape(-1, 3)
    body = replace(two.body, quadrature_degree=CALCULIX_DEGREE)
    u = two.K.createVecRight()
    u.setArray(displacement[peer_node].ravel())
    residual = (assemble_matrix(body.stiffness()) * u).array_r.reshape(x.shape)
    surface = SurfaceNodes.from_body(two.body, two.slave)
    node, area = surface.node, surface.tributary_area
    opposite = gather_boundary_facets(two.space, two.master).nodes
    force = np.zeros_like(x)
    for nodes in (node, opposite):
        force[nodes, -1] = residual[nodes, -1]
    peer_pressure = np.zeros(len(peer_x))
    peer_pressure[problem.slave_nodes - 1] = peer.numbers["pressure"]
    pressure, displacement = peer_pressure[peer_node[node]], displacement[peer_node]
    solution = Solution(node, pressure, area, force, opposite, displacement, 0, True, [])
    if isinstance(problem, StackedBlocks):
        exact_pressure: Array = np.full(len(node), problem.pressure)
        result = compare(two, solution, exact_pressure, problem.pressure, np.inf)
    else:
        sphere = exact[0]
        exact_pressure = sphere.pressure(np.linalg.norm(x[node, :-1], axis=1))
        total = sphere.force / 4
        result = compare(two, solution, exact_pressure, sphere.peak, INNER, total)
    numbers = {k: v for k, v in result.scalars.items() if k not in ("iterations", "settled")}
    return replace(result, scalars=numbers, units=dimensionless(numbers))


# NAFEMS R0094-1 in N and mm: a steel cylinder on an aluminium block, plane strain

CYLINDER_RADIUS, BLOCK_HALF_WIDTH, BLOCK_HEIGHT, FORCE = 50.0, 100.0, 200.0, 35e3
STEEL, ALUMINIUM = 210e3, 70e3
FINEST_CELL, COARSENING, FINE_DISTANCE = 0.6, 0.12, 9.0
"""Size of cells at the contact, its growth, and the distance up to which it stays."""
LOADED_HALF_WIDTH = 30.0
"""Of the part of the cylinder's top that is loaded."""
HERTZ_WIDTH, HERTZ_PEAK = 6.215, 3585.4
"""Half width and peak pressure by Hertz, as the benchmark prints them."""


def r0094(way: str) -> Result:
    """Solve NAFEMS R0094-1 as it is stated: one half of a cylinder pressed into a block."""

    def cylinder() -> None:
        disc = gmsh.model.occ.addDisk(0, CYLINDER_RADIUS, 0, CYLINDER_RADIUS, CYLINDER_RADIUS)
        half = gmsh.model.occ.addRectangle(0, 0, 0, CYLINDER_RADIUS, 2 * CYLINDER_RADIUS)
        gmsh.model.occ.intersect([(2, disc)], [(2, half)])

    def block() -> None:
        gmsh.model.occ.addRectangle(0, -BLOCK_HEIGHT, 0, BLOCK_HALF_WIDTH, BLOCK_HEIGHT)

    def cell_size(finest: float) -> str:
        return f"{finest} + {COARSENING} * Max(0, Sqrt(x * x + y * y) - {FINE_DISTANCE})"

    finest_below = FINEST_CELL / EDGE_RATIO
    above = meshed(cylinder, 2, FINEST_CELL, 2, cell_size(FINEST_CELL))
    below = meshed(block, 2, finest_below, 2, cell_size(finest_below))
    mesh, is_lower_cell = joined(below, above)

    def on_cylinder(x: Array) -> Mask:
        return np.isclose(np.hypot(x[0], x[1] - CYLINDER_RADIUS), CYLINDER_RADIUS)

    def near_contact(x: Array) -> Mask:
        on_either_face = np.isclose(x[1], 0.0) | (on_cylinder(x) & (x[1] < CYLINDER_RADIUS))
        return (x[0] < 2 * FINE_DISTANCE) & on_either_face

    def loaded_part(x: Array) -> Mask:
        return on_cylinder(x) & (x[1] > CYLINDER_RADIUS) & (x[0] < LOADED_HALF_WIDTH)

    lower, upper = _contact_faces(mesh, is_lower_cell, near_contact)
    moduli, state = (ALUMINIUM, STEEL), StressState.PLANE_STRAIN
    two = TwoBodies.from_mesh(
        way, mesh, is_lower_cell, moduli, POISSONS_RATIO, state, (upper, lower)
    )
    two = _restrict_slave(two, lambda x: x[:, 0] < FINE_DISTANCE)
    load = two.load((0.0, -1.0), loaded_part)
    load.scale(FORCE / 2 / -load.sum())
    supports = [
        prescribe(two.space, 0, _plane(0, 0.0)),
        prescribe(two.space, 1, _plane(1, -BLOCK_HEIGHT)),
    ]
    solution = two.solve(load, supports)
    x = two.x[solution.node][:, 0]
    bodies = Elastic(ALUMINIUM, POISSONS_RATIO), Elastic(STEEL, POISSONS_RATIO)
    width = np.sqrt(4 * FORCE * CYLINDER_RADIUS * _compliance(*bodies) / np.pi)
    peak = 2 * FORCE / (np.pi * width)
    exact = peak * np.sqrt(np.maximum(0.0, 1 - (x / width) ** 2))
    # p² = p0² (1 - x²/a²) is a straight line over x²
    is_fitted = (x < 0.9 * width) & ~np.isnan(solution.pressure)
    slope, intercept = np.polyfit(x[is_fitted] ** 2, solution.pressure[is_fitted] ** 2, 1)
    scalars = {
        "width_error": np.sqrt(intercept / -slope) / HERTZ_WIDTH - 1,
        "peak_error": np.sqrt(intercept) / HERTZ_PEAK - 1,
    }
    return compare(two, solution, exact, peak, INNER * width, FORCE / 2, scalars)


# Parts of both bodies


def _restrict_slave(two: TwoBodies, near: Callable[[Array], Mask]) -> TwoBodies:
    """Keep the facets of the slave's face all of whose nodes (n, dim) are near."""
    trace = gather_boundary_facets(two.space, two.slave)
    is_near = near(trace.facet_x.reshape(-1, trace.space_dim))
    kept = is_near.reshape(trace.facet_nodes.shape).all(axis=1)
    return TwoBodies(two.method, two.body, two.K, two.slave[kept], two.master)


def _contact_faces(
    mesh: Mesh, is_lower_cell: Mask, near: Callable[[Array], Mask]
) -> tuple[Facets, Facets]:
    """Return the facets of the lower and of the upper body that are near."""
    facets, dim = locate_exterior_facets(mesh, near), mesh.topology.dim
    cells = mesh.topology.connectivity(dim - 1, dim)
    is_lower = is_lower_cell[cells.array[cells.offsets[facets]]]
    return facets[is_lower], facets[~is_lower]


def _nodes_above(two: TwoBodies, face: float = 0.0) -> Mask:
    """Return whether a node (n,) belongs to a cell above a face."""
    up = two.x.shape[1] - 1
    cells = two.space.dofmap.list
    is_above = np.zeros(len(two.x), dtype=bool)
    is_above[cells[two.x[cells, up].mean(axis=1) > face]] = True
    return is_above


def _plane(axis: int, value: float) -> Callable[[Array], Mask]:
    return lambda x: np.isclose(x[axis], value)


def _compliance(*bodies: Elastic) -> float:
    """Return 1/E* of bodies in contact."""
    return sum(1 / body.plane_modulus for body in bodies)


# Comparison with the exact pressure


def compare(
    two: TwoBodies,
    solution: Solution,
    exact: Array,
    scale: float,
    inner: float,
    force: float | None = None,
    further: dict[str, float] | None = None,
    curves: dict[str, Array] | None = None,
) -> Result:
    """Compare pressures at the slave's nodes with exact ones; evaluate forces on both bodies.

    In space errors are given on the nodes that the standard element reads, `common`, and on others.

    Args:
        two: the bodies.
        solution: by one of the methods.
        exact: (m,), pressure.
        scale: what errors are relative to.
        inner: distance from the origin within which errors count.
        force: exact total.
        further: scalars to store besides.
        curves: values (m,) to store besides.
    """
    x, dim = two.x, two.x.shape[1]
    slave_x, master_x = x[solution.node], x[solution.opposite]
    has_pressure = ~np.isnan(solution.pressure)
    error = np.where(has_pressure, np.abs(solution.pressure - exact), 0.0)
    counts = has_pressure & (np.linalg.norm(slave_x[:, :-1], axis=1) < inner)
    squared_error = (solution.area * error**2)[has_pressure].sum()
    squared_pressure = (solution.area * exact**2)[has_pressure].sum()
    slave_force = solution.force[solution.node, -1]
    # positive in compression
    master_force = solution.force[solution.opposite, -1]
    master_force = master_force * np.sign(master_force.sum())
    # smooth pressures: away from the edge of the contact and from the ends of the faces
    middle_radius = inner if np.isfinite(inner) else INNER
    in_middle = np.linalg.norm(master_x[:, :-1], axis=1) < middle_radius
    if np.isinf(inner):
        in_middle &= (master_x[:, :-1] > 1e-9).all(axis=1)
    mean = master_force[in_middle].mean()
    scalars = {
        "pressure_error": error[counts].max() / scale,
        "pressure_l2": np.sqrt(squared_error / squared_pressure),
        "pressure_error_median": np.median(error[counts]) / scale,
        "master_force_min": master_force[in_middle].min() / mean,
        "master_force_max": master_force[in_middle].max() / mean,
        "master_force_least": master_force.min() / mean,
        "slave_force_least": (slave_force * np.sign(slave_force.sum())).min() / mean,
        "iterations": solution.iterations,
        "settled": solution.settled,
        **solution.balances(x),
        **(further or {}),
    }
    if dim == 3:
        galerkin = replace(two.body, spaces=Spaces.galerkin(two.space.mesh))
        no_force = np.zeros(len(slave_x))
        standard = SurfaceNodes.from_body(galerkin, two.slave).pressure(no_force)
        errors = compared(np.where(counts, error, np.nan) / scale, standard)
        scalars |= {f"pressure_error_{which}": size for which, size in errors.items()}
    varies_slowly = _master_nodes_with_slow_pressure(two, solution)
    if varies_slowly.any():
        scalars["master_force_slow"] = master_force[varies_slowly].min() / mean
    if force is not None:
        scalars["force_error"] = abs(np.abs(slave_force.sum()) / force - 1)
    stored = {
        "x": slave_x,
        "pressure": solution.pressure / scale,
        "exact_pressure": exact / scale,
        "area": solution.area,
        "force": slave_force,
        "opposite_x": master_x,
        "opposite_force": solution.force[solution.opposite, -1],
        **(curves or {}),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), stored, dofs=dim * len(x))


def _master_nodes_with_slow_pressure(two: TwoBodies, solution: Solution) -> Mask:
    """Return the master's nodes (k,) around which the slave's pressures differ by less than 2.

    Pressures count that are no farther from the node than a facet of each body.
    """
    dim = two.x.shape[1]
    reach: Array = np.zeros(len(two.x))
    edges = []
    for facets in (two.slave, two.master):
        trace = gather_boundary_facets(two.space, facets)
        corners = trace.facet_x[:, :dim]
        edges.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1))
    np.maximum.at(reach, trace.facet_nodes.ravel(), np.repeat(edges[1], trace.facet_nodes.shape[1]))
    has_pressure = ~np.isnan(solution.pressure)
    neighbours = cKDTree(two.x[solution.node[has_pressure], :-1]).query_ball_point(
        two.x[solution.opposite, :-1], reach[solution.opposite] + edges[0].max()
    )
    pressures = [solution.pressure[has_pressure][nodes] for nodes in neighbours]
    smallest = NO_PRESSURE_BELOW * np.nanmax(solution.pressure)
    return np.array(
        [
            len(p) > 0 and smallest < p.min() and p.max() < SLOW_PRESSURE_RATIO * p.min()
            for p in pressures
        ]
    )
