"""Contact of two deformable bodies with non-matching meshes, compared with exact pressures."""

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

from pw_elements import SurfaceNodes, assemble_matrix, prescribe
from pw_elements.contact import STICK, Motion
from pw_elements.contact.interface import (
    BoundaryFacets,
    compute_cell_lengths_or_areas,
    gather_boundary_facets,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh, move_nodes
from pw_elements.spaces import locate_exterior_facets
from study.benchmarks.v11_two_bodies.methods import (
    INNER_RADIUS,
    NEW_WEIGHT_METHODS,
    ContactSolution,
    TwoBodies,
    compare_pressures_with_exact_ones,
)
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_families import mesh_with_gmsh
from study.meshes.mesh_lines import BODY_SIZE as SPHERE_BODY_SIZE
from study.meshes.mesh_lines import geometrically_growing_lines, mesh_lines_of_body_under_sphere
from study.meshes.solid_meshes import mesh_box_along_lines
from study.meshes.two_body_meshes import join_lower_and_upper_mesh
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.two_bodies import PAIRS, StackedBlocksPatchTest
from study.solutions.half_space import (
    ElasticHalfSpace,
    HertzLine,
    HertzSphere,
    axisymmetric_displacement_in_space,
)
from study.solutions.stick_slip import CattaneoPartialSlip

Array = npt.NDArray[np.floating[Any]]
Doubles = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Facets = npt.NDArray[np.int32]

# Lengths are divided by the half width or radius of the contact, stresses by the lower body's E
POISSONS_RATIO = 0.3
YOUNGS_MODULI = (1.0, 3.0)
MASTER_EDGE_RATIO = 0.7
"""Default ratio of the number of master edges to the number of slave edges."""
CURVATURE_RADIUS = 1e3
"""Radius of the relative curvature, so large that slopes are small."""
# Patch tests: two blocks of height 1, the lower one of width 1

PRESSURE = 1e-3
NARROW_WIDTH = 0.83
"""Width of the upper block where the slave is wider than the master."""


def patch(way: str, dim: int) -> Result:
    """Press two equally wide blocks uniformly together; the exact stress is uniaxial.

    Args:
        way: Name of the contact method.
        dim: Dimension of space.
    """
    return _press_two_blocks_uniformly(way, dim, 1.0)


def overhang(way: str, dim: int) -> Result:
    """Press together two blocks of which the slave is wider; its uncovered part is loaded, too.

    Args:
        way: Name of the contact method.
        dim: Dimension of space.
    """
    return _press_two_blocks_uniformly(way, dim, NARROW_WIDTH)


def _press_two_blocks_uniformly(method: str, dim: int, upper_block_width: float) -> Result:
    bodies, up = _make_two_blocks(method, dim, upper_block_width), dim - 1
    traction = np.zeros(dim)
    traction[up] = -PRESSURE
    load = bodies.load(traction, lambda x: np.isclose(x[up], 2.0))
    if upper_block_width < 1:
        trace = gather_boundary_facets(bodies.space, bodies.slave)
        nodes, weights = _integrate_test_functions_beyond_x(
            trace, upper_block_width, method in NEW_WEIGHT_METHODS
        )
        values = load.array.reshape(-1, dim)
        np.add.at(values[:, up], nodes, -PRESSURE * weights)
        load.array[:] = values.ravel()
    symmetry = [prescribe(bodies.space, i, _make_plane_marker(i, 0.0)) for i in range(dim)]
    solution = bodies.solve(load, symmetry)
    # the method has no pressure at nodes that the master does not cover
    exact_pressure = np.full(len(solution.slave_node), PRESSURE)
    return compare_pressures_with_exact_ones(bodies, solution, exact_pressure, PRESSURE, np.inf)


def _make_two_blocks(method: str, dim: int, upper_block_width: float) -> TwoBodies:
    """Make two blocks of height one, of which the lower is the slave and the upper the master.

    Args:
        method: Name of the contact method.
        dim: Dimension of space.
        upper_block_width: Width of the upper block; that of the lower block is one.
    """
    up, (n_upper, n_lower) = dim - 1, (4, 7) if dim == 2 else (2, 3)

    def make_block(n: int, bottom: float) -> Mesh:
        build, cell = (create_rectangle, "triangle") if dim == 2 else (create_box, "tetrahedron")
        corners = [[0.0] * up + [bottom], [1.0] * up + [bottom + 1]]
        return build(MPI.COMM_SELF, corners, [n, n + 1, n][:dim], CellType[cell])

    upper = move_nodes(make_block(n_upper, 1.0), lambda x: x * [upper_block_width, 1.0, 1.0])
    mesh, is_lower_cell = join_lower_and_upper_mesh(make_block(n_lower, 0.0), upper)
    state = StressState.PLANE_STRAIN if dim == 2 else StressState.SOLID
    faces = _find_contact_facets(mesh, is_lower_cell, lambda x: np.isclose(x[up], 1.0))
    return TwoBodies.from_mesh(
        method, mesh, is_lower_cell, (1.0, 1.0), POISSONS_RATIO, state, faces
    )


def _integrate_test_functions_beyond_x(
    face: BoundaryFacets, x_min: float, is_linear_on_sub_facets: bool
) -> tuple[npt.NDArray[np.int64], Array]:
    """Integrate each node's test function over the part x > end of a flat face.

    Sub-facets are cut at x = end, and the pieces are integrated by a rule of degree 2.

    Args:
        face: Facets of the face.
        x_min: Lower bound of x on the part that is integrated.
        is_linear_on_sub_facets: Whether test functions are linear on sub-facets; otherwise they are
            quadratic on facets.

    Returns:
        Nodes (pieces, k) and integrals (pieces, k), one row per piece; a node may occur in several
        rows.
    """
    sub_facet_nodes, corners, _ = face.sub_facet_nodes_corners_and_normals
    points, weights = basix.make_quadrature(
        {2: basix.CellType.interval, 3: basix.CellType.triangle}[face.space_dim], 2
    )
    weights = weights / weights.sum()
    barycentric_points = np.column_stack([1 - points.sum(axis=1), points])
    nodes, integrals = [], []
    for sub_facet in range(len(corners)):
        corner: Array = corners[sub_facet]
        for piece in _cut_sub_facet_beyond_x(corner, x_min, face.space_dim):
            size = compute_cell_lengths_or_areas((piece @ corner)[None])[0]
            position = barycentric_points @ piece
            if is_linear_on_sub_facets:
                nodes.append(sub_facet_nodes[sub_facet])
                integrals.append(size * weights @ position)
            else:
                node, N = face.evaluate_trial_functions(np.full(len(position), sub_facet), position)
                nodes.append(node[0])
                integrals.append(size * weights @ N)
    return np.concatenate(nodes), np.concatenate(integrals)


def _cut_sub_facet_beyond_x(corners: Array, x_min: float, dim: int) -> list[Doubles]:
    """Return the pieces of an edge or triangle that lie at x > end.

    Args:
        corners: Positions (dim, dim) of the corners.
        x_min: Lower bound of x.
        dim: Dimension of space: 2 for an edge, 3 for a triangle.

    Returns:
        Barycentric coordinates (dim, dim) of the corners of each piece, which is an edge or
        triangle.
    """
    polygon: list[Doubles] = []
    vertices: list[Doubles] = [np.eye(dim)[k] for k in range(dim)]
    for a, b in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        xa, xb = (float(vertex @ corners[:, 0]) for vertex in (a, b))
        if xa > x_min:
            polygon.append(a)
        if (xa > x_min) != (xb > x_min):
            polygon.append(a + (x_min - xa) / (xb - xa) * (b - a))
    if dim == 2:
        pieces = [polygon[:2]] if len(polygon) > 1 else []
    else:
        pieces = [[polygon[0], *polygon[i : i + 2]] for i in range(1, len(polygon) - 1)]
    return [np.array(piece) for piece in pieces]


# Two cylinders: plane strain, exact displacements on the outer sides

BODY_SIZE = 5.0
"""Height and half width of each body."""
CONTACT_ZONE, CELL_GROWTH = 1.4, 1.3
"""Half width of the part that may come into contact; growth ratio of cells outside of it."""
EDGE_POSITION = 0.375
"""Position of the edge of contact within an element, as a fraction of its length."""
UNEQUAL_BODIES_FRICTION = 0.3
N_REFERENCE_EDGES = 32
"""Number of edges of the reference mesh where no exact solution is known."""
PARTIAL_SLIP_FRICTION, FRICTION_FRACTION = 0.4, 0.5
"""Partial slip: coefficient of friction, and tangential force over the friction limit."""


def hertz(way: str, edges: int, ratio: float = MASTER_EDGE_RATIO) -> Result:
    """Press two cylinders with different Young's moduli together without friction.

    The exact displacements are prescribed on the outer sides.

    Args:
        way: Name of the contact method.
        edges: Number of slave edges over the half width of the contact.
        ratio: Ratio of the number of master edges to the number of slave edges.
    """
    bodies, exact, solution = _press_halves_of_two_cylinders(way, edges, ratio, 0.0)
    x = bodies.x[solution.slave_node][:, 0]
    exact_force = exact[0].force / 2
    return compare_pressures_with_exact_ones(
        bodies, solution, exact[0].pressure(x), exact[0].peak_pressure, INNER_RADIUS, exact_force
    )


def unequal(way: str, edges: int) -> Result:
    """Press two cylinders with different Young's moduli together with friction.

    The displacements of frictionless contact are prescribed on the outer sides. Errors are
    differences from the solution with `N_REFERENCE_EDGES` edges.

    Args:
        way: Name of the contact method.
        edges: Number of slave edges over the half width of the contact.
    """
    result, fine = (
        _press_unequal_cylinders_with_friction(way, n) for n in (edges, N_REFERENCE_EDGES)
    )
    x, area = result.curves["x"][:, 0], result.curves["area"]
    reference = {
        name: np.interp(x, fine.curves["x"][:, 0], fine.curves[name])
        for name in ("pressure", "shear")
    }
    error = {name: np.abs(result.curves[name] - value) for name, value in reference.items()}
    is_inner = x < INNER_RADIUS
    scalars = {
        "pressure_error": error["pressure"][is_inner].max(),
        "pressure_error_median": np.median(error["pressure"][is_inner]),
        "pressure_l2": np.sqrt(
            (area * error["pressure"] ** 2).sum() / (area * reference["pressure"] ** 2).sum()
        ),
        "shear_error": error["shear"][is_inner].max(),
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
    return replace(
        result, scalars=numbers, units=assign_unit_one_to_scalars(numbers), curves=curves
    )


def _press_unequal_cylinders_with_friction(method: str, edges: int) -> Result:
    bodies, exact, solution = _press_halves_of_two_cylinders(
        method, edges, MASTER_EDGE_RATIO, UNEQUAL_BODIES_FRICTION
    )
    x = bodies.x[solution.slave_node][:, 0]
    (pair,) = solution.states[-1].pairs
    scalars = {
        "stick": float(x[pair.status == STICK].max(initial=0.0)),
        "force": float(pair.force_normal.sum()) / exact[0].force,
    }
    peak = exact[0].peak_pressure
    curves = {"shear": pair.force_tangential[:, 0] / solution.tributary_area / peak}
    pressure, force = exact[0].pressure(x), exact[0].force / 2
    return compare_pressures_with_exact_ones(
        bodies, solution, pressure, peak, INNER_RADIUS, force, scalars, curves
    )


def _press_halves_of_two_cylinders(
    method: str, edges: int, edge_ratio: float, friction: float
) -> tuple[TwoBodies, list[HertzLine], ContactSolution]:
    """Press two cylinders together, of which the half x > 0 is modelled.

    Args:
        method: Name of the contact method.
        edges: Number of slave edges over the half width of the contact.
        edge_ratio: Ratio of the number of master edges to the number of slave edges.
        friction: Coefficient of friction.

    Returns:
        Bodies, exact solutions of the lower and of the upper body, and the computed solution.
    """
    lower, upper = (ElasticHalfSpace(E, POISSONS_RATIO) for E in YOUNGS_MODULI)
    force = np.pi / (4 * CURVATURE_RADIUS) / _sum_of_plane_contact_compliances(lower, upper)
    exact = [
        HertzLine(body, np.pi * body.plane_strain_modulus / (4 * force), force)
        for body in (lower, upper)
    ]
    bodies = _make_two_cylinders(method, edges, edge_ratio)
    outer = _prescribe_exact_outer_displacements(bodies, exact)
    symmetry = prescribe(bodies.space, 0, lambda x: np.isclose(x[0], 0.0) & ~_is_outer_side(x))
    solution = bodies.solve(bodies.K.createVecLeft(), [outer, symmetry], friction)
    return bodies, exact, solution


def cattaneo(way: str, edges: int) -> Result:
    """Press two equal cylinders together and push them sideways, both by prescribed forces.

    Args:
        way: Name of the contact method.
        edges: Number of slave edges over the half width of the contact.
    """
    body = ElasticHalfSpace(1.0, POISSONS_RATIO)
    force = np.pi / (4 * CURVATURE_RADIUS) / _sum_of_plane_contact_compliances(body, body)
    exact = CattaneoPartialSlip(1.0, force, PARTIAL_SLIP_FRICTION, FRICTION_FRACTION)
    bodies = _make_two_cylinders(way, edges, MASTER_EDGE_RATIO, (1.0, 1.0), is_whole=True)
    fractions = (0.0, FRICTION_FRACTION / 2, FRICTION_FRACTION)
    # loads replace the prescribed far displacements, which differ between the increments
    loads = []
    for fraction in fractions:
        prescribed = bodies.K.createVecRight()
        nodes = fem.locate_dofs_geometrical(bodies.space, _is_outer_side)
        x = bodies.x[nodes]
        is_upper = (_mask_nodes_of_upper_body(bodies)[nodes])[:, None]
        increment = CattaneoPartialSlip(1.0, force, PARTIAL_SLIP_FRICTION, fraction)
        field = increment.displacement(body, np.where(is_upper, -x, x))
        prescribed.array.reshape(-1, 2)[nodes] = np.where(is_upper, -field, field)
        load = bodies.K * prescribed
        load.scale(-1.0)
        loads.append(load)
    outer = [prescribe(bodies.space, i, _is_outer_side) for i in (0, 1)]
    motions = [
        Motion((None, None), (fraction * PARTIAL_SLIP_FRICTION * force, -force))
        for fraction in fractions
    ]
    motions[0] = Motion((0.0, None), (0.0, -force))
    solution = bodies.solve(loads, outer, PARTIAL_SLIP_FRICTION, motions)
    x = bodies.x[solution.slave_node][:, 0]
    (pair,) = solution.states[-1].pairs
    shear = pair.force_tangential[:, 0] / solution.tributary_area
    # away from the kinks of the exact shear
    is_compared = np.abs(np.abs(x) - exact.stick_half_width) > 1.5 / edges
    is_compared &= np.abs(x) < 1 - 1.5 / edges
    shear_error = float(np.abs(shear - exact.shear(x))[is_compared].max())
    stick = float(np.ptp(x[pair.status == STICK])) / 2
    scalars = {
        "stick": stick,
        "stick_off": abs(stick - exact.stick_half_width) * edges,
        "shear_error": shear_error / (PARTIAL_SLIP_FRICTION * exact.peak_pressure),
    }
    curves = {
        "shear": shear / exact.peak_pressure,
        "exact_shear": exact.shear(x) / exact.peak_pressure,
    }
    pressure = exact.pressure(x)
    return compare_pressures_with_exact_ones(
        bodies, solution, pressure, exact.peak_pressure, INNER_RADIUS, force, scalars, curves
    )


def _make_two_cylinders(
    method: str,
    edges: int,
    edge_ratio: float,
    moduli: tuple[float, float] = YOUNGS_MODULI,
    is_whole: bool = False,
) -> TwoBodies:
    """Make two cylinders, of which the lower one is the slave and has a flat face.

    Args:
        method: Name of the contact method.
        edges: Number of slave edges over the half width of the contact.
        edge_ratio: Ratio of the number of master edges to the number of slave edges.
        moduli: Young's moduli of the lower and of the upper cylinder.
        is_whole: Whether both halves are modelled; otherwise only x > 0.
    """

    def make_mesh_lines_and_contact_zone(n: int) -> tuple[Doubles, Doubles, float]:
        size = 1 / (n + EDGE_POSITION)
        near = size * np.arange(np.ceil(CONTACT_ZONE / size) + 1)
        across = np.concatenate(
            [
                near,
                near[-1] + geometrically_growing_lines(size, BODY_SIZE - near[-1], CELL_GROWTH)[1:],
            ]
        )
        if is_whole:
            across = np.concatenate([-across[:0:-1], across])
        return across, geometrically_growing_lines(size, BODY_SIZE, CELL_GROWTH), float(near[-1])

    def bend_face_to_parabola(x: Doubles) -> Doubles:
        return x + x[:, :1] ** 2 / (2 * CURVATURE_RADIUS) * [0.0, 1.0, 0.0]

    x_lower, depth, zone = make_mesh_lines_and_contact_zone(edges)
    x_upper, height, _ = make_mesh_lines_and_contact_zone(max(1, round(edge_ratio * edges)))
    comm = MPI.COMM_SELF
    flat_lower = mesh_along_lines(comm, x_lower, -depth[::-1], "triangle", "left_right")
    flat_upper = mesh_along_lines(comm, x_upper, height, "triangle", "left_right")
    lower, upper = (
        curved_mesh(flat_lower, lambda x: x),
        curved_mesh(flat_upper, bend_face_to_parabola),
    )
    mesh, is_lower_cell = join_lower_and_upper_mesh(lower, upper)

    def is_on_contact_faces(x: Array) -> Mask:
        return np.abs(x[1]) < x[0] ** 2 / (2 * CURVATURE_RADIUS) + 1e-9

    faces = _find_contact_facets(mesh, is_lower_cell, is_on_contact_faces)
    state = StressState.PLANE_STRAIN
    bodies = TwoBodies.from_mesh(method, mesh, is_lower_cell, moduli, POISSONS_RATIO, state, faces)
    return _restrict_slave_facets(bodies, lambda x: np.abs(x[:, 0]) < zone + 1e-9)


def _is_outer_side(x: Array) -> Mask:
    return (
        np.isclose(np.abs(x[0]), BODY_SIZE)
        | np.isclose(x[1], -BODY_SIZE)
        | (x[1] > BODY_SIZE - 1e-9)
    )


def _prescribe_exact_outer_displacements(
    bodies: TwoBodies, exact: list[HertzLine]
) -> fem.DirichletBC:
    """Prescribe the exact displacements on the outer sides of two cylinders.

    The upper body is also moved downwards by the sum of the exact approaches of both bodies.
    """
    nodes = fem.locate_dofs_geometrical(bodies.space, _is_outer_side)
    is_upper = _mask_nodes_of_upper_body(bodies)[nodes]
    field = fem.Function(bodies.space)
    values, x = field.x.array.reshape(-1, 2), bodies.x[nodes]
    values[nodes[~is_upper]] = exact[0].displacement(x[~is_upper])
    values[nodes[is_upper]] = exact[1].displacement(x[is_upper] * [1, -1]) * [1, -1]
    values[nodes[is_upper], 1] -= sum(body.approach for body in exact)
    return fem.dirichletbc(field, nodes)


# Two spheres: a quarter of them, exact displacements on the outer sides


def spheres(way: str, edges: float, ratio: float = 0.71) -> Result:
    """Press two spheres with different Young's moduli together; a quarter of them is modelled.

    The exact displacements are prescribed on the outer sides.

    Args:
        way: Name of the contact method.
        edges: Number of slave edges over the radius of the contact.
        ratio: Ratio of the number of master edges to the number of slave edges.
    """
    bodies, exact = _make_quarters_of_two_spheres(way, edges, ratio)

    def is_outer_side(x: Array) -> Mask:
        return (np.abs(x[2]) > SPHERE_BODY_SIZE - 1e-9) | np.isclose(
            np.maximum(x[0], x[1]), SPHERE_BODY_SIZE
        )

    def make_symmetry_plane_marker(axis: int) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(p[axis], 0.0) & ~is_outer_side(p)

    nodes = fem.locate_dofs_geometrical(bodies.space, is_outer_side)
    x, is_upper = bodies.x[nodes], _mask_nodes_of_upper_body(bodies)[nodes]
    field = fem.Function(bodies.space)
    values = field.x.array.reshape(-1, 3)
    for contact, is_in_body, sign in zip(exact, (~is_upper, is_upper), (1.0, -1.0), strict=True):
        mirror = [1.0, 1.0, sign]
        values[nodes[is_in_body]] = (
            axisymmetric_displacement_in_space(contact, mirror * x[is_in_body]) * mirror
        )
    values[nodes[is_upper], 2] -= sum(body.approach for body in exact)
    conditions = [fem.dirichletbc(field, nodes)]
    conditions += [prescribe(bodies.space, i, make_symmetry_plane_marker(i)) for i in (0, 1)]
    solution = bodies.solve(bodies.K.createVecLeft(), conditions)
    r = np.linalg.norm(bodies.x[solution.slave_node][:, :2], axis=1)
    force = exact[0].force / 4
    return compare_pressures_with_exact_ones(
        bodies, solution, exact[0].pressure(r), exact[0].peak_pressure, INNER_RADIUS, force
    )


def _make_quarters_of_two_spheres(
    method: str, edges: float, edge_ratio: float
) -> tuple[TwoBodies, list[HertzSphere]]:
    """Make a quarter of two spheres, and the exact solutions of the lower and of the upper sphere.

    Args:
        method: Name of the contact method.
        edges: Number of slave edges over the radius of the contact.
        edge_ratio: Ratio of the number of master edges to the number of slave edges.
    """
    materials = [ElasticHalfSpace(E, POISSONS_RATIO) for E in YOUNGS_MODULI]
    force = 4 / 3 / CURVATURE_RADIUS / _sum_of_plane_contact_compliances(*materials)
    exact = [
        HertzSphere(body, 4 * body.plane_strain_modulus / (3 * force), force) for body in materials
    ]
    lines = mesh_lines_of_body_under_sphere(edges)
    upper_lines = mesh_lines_of_body_under_sphere(edges * edge_ratio)
    lower = mesh_box_along_lines("tetrahedron", lines.horizontal, lines.horizontal, lines.vertical)
    upper = curved_mesh(
        mesh_box_along_lines(
            "tetrahedron",
            upper_lines.horizontal,
            upper_lines.horizontal,
            -upper_lines.vertical[::-1],
        ),
        lambda x: x + (x[:, :1] ** 2 + x[:, 1:2] ** 2) / (2 * CURVATURE_RADIUS) * [0.0, 0.0, 1.0],
    )
    mesh, is_lower_cell = join_lower_and_upper_mesh(curved_mesh(lower, lambda x: x), upper)

    def is_on_contact_faces(x: Array) -> Mask:
        return np.abs(x[2]) < (x[0] ** 2 + x[1] ** 2) / (2 * CURVATURE_RADIUS) + 1e-9

    faces = _find_contact_facets(mesh, is_lower_cell, is_on_contact_faces)
    state = StressState.SOLID
    bodies = TwoBodies.from_mesh(
        method, mesh, is_lower_cell, YOUNGS_MODULI, POISSONS_RATIO, state, faces
    )
    return _restrict_slave_facets(
        bodies, lambda x: np.maximum(x[:, 0], x[:, 1]) < lines.contact_zone_size + 1e-9
    ), exact


# CalculiX on the same meshes

CALCULIX_DEGREE = 2
"""Degree of polynomials that CalculiX's four-point rule of a tetrahedron integrates exactly."""


def calculix(case: str, tracked: str) -> Result:
    """Evaluate a stored CalculiX solution of the same bodies on the same mesh.

    The pressures are those that CalculiX gives at the slave nodes. The nodal forces are residuals
    of the standard element under CalculiX's displacements, integrated by CalculiX's quadrature
    rule.

    Args:
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    problem, peer = PAIRS[case], load_recorded_result_if_unchanged(case, tracked)
    exact: list[HertzSphere] = []
    if isinstance(problem, StackedBlocksPatchTest):
        bodies = _make_two_blocks("p2-p2", 3, 1.0)
    else:
        bodies, exact = _make_quarters_of_two_spheres("p2-p2", problem.edges, problem.size_ratio)
    x, peer_x = bodies.x, problem.nodes
    # nodes of both bodies may coincide: a further coordinate distinguishes the bodies
    face, n_lower = (
        peer_x[problem.slave_nodes[0] - 1, -1],
        len(problem.grids[0].nodes_without_bulge),
    )
    peer_positions = np.column_stack([peer_x, np.arange(len(peer_x)) >= n_lower])
    positions = np.column_stack([x, _mask_nodes_of_upper_body(bodies, face)])
    distance, peer_node = cKDTree(peer_positions).query(positions)
    assert distance.max() < 1e-9
    assert len(np.unique(peer_node)) == len(peer_x) == len(x)
    displacement = np.zeros_like(peer_x)
    displacement[problem.nodes_of_elements_at_contact - 1] = peer.numbers["displacement"].reshape(
        -1, 3
    )
    body = replace(bodies.body, quadrature_degree=CALCULIX_DEGREE)
    u = bodies.K.createVecRight()
    u.setArray(displacement[peer_node].ravel())
    residual = (assemble_matrix(body.stiffness()) * u).array_r.reshape(x.shape)
    surface = SurfaceNodes.from_body(bodies.body, bodies.slave)
    node, area = surface.node, surface.tributary_area
    opposite = gather_boundary_facets(bodies.space, bodies.master).nodes
    force = np.zeros_like(x)
    for nodes in (node, opposite):
        force[nodes, -1] = residual[nodes, -1]
    peer_pressure = np.zeros(len(peer_x))
    peer_pressure[problem.slave_nodes - 1] = peer.numbers["pressure"]
    pressure, displacement = peer_pressure[peer_node[node]], displacement[peer_node]
    solution = ContactSolution(node, pressure, area, force, opposite, displacement, 0, True, [])
    if isinstance(problem, StackedBlocksPatchTest):
        exact_pressure: Array = np.full(len(node), problem.pressure)
        result = compare_pressures_with_exact_ones(
            bodies, solution, exact_pressure, problem.pressure, np.inf
        )
    else:
        sphere = exact[0]
        exact_pressure = sphere.pressure(np.linalg.norm(x[node, :-1], axis=1))
        total = sphere.force / 4
        result = compare_pressures_with_exact_ones(
            bodies, solution, exact_pressure, sphere.peak_pressure, INNER_RADIUS, total
        )
    numbers = {k: v for k, v in result.scalars.items() if k not in ("iterations", "settled")}
    return replace(result, scalars=numbers, units=assign_unit_one_to_scalars(numbers))


# NAFEMS R0094-1 in N and mm: a steel cylinder on an aluminium block, plane strain

CYLINDER_RADIUS, BLOCK_HALF_WIDTH, BLOCK_HEIGHT, R0094_FORCE = 50.0, 100.0, 200.0, 35e3
STEEL, ALUMINIUM = 210e3, 70e3
FINEST_CELL, COARSENING, FINE_DISTANCE = 0.6, 0.12, 9.0
"""Cell size at the contact, growth per distance, and distance where growth starts, in mm."""
LOADED_HALF_WIDTH = 30.0
"""Half width of the loaded part of the cylinder's top."""
HERTZ_WIDTH, HERTZ_PEAK = 6.215, 3585.4
"""Half width and peak pressure of Hertz's solution as printed in the benchmark, in mm and MPa."""


def r0094(way: str) -> Result:
    """Solve NAFEMS benchmark R0094-1: an elastic cylinder pressed into an elastic block.

    One half is modelled by symmetry.

    Args:
        way: Name of the contact method.
    """

    def add_half_cylinder_section() -> None:
        disc = gmsh.model.occ.addDisk(0, CYLINDER_RADIUS, 0, CYLINDER_RADIUS, CYLINDER_RADIUS)
        half = gmsh.model.occ.addRectangle(0, 0, 0, CYLINDER_RADIUS, 2 * CYLINDER_RADIUS)
        gmsh.model.occ.intersect([(2, disc)], [(2, half)])

    def add_half_block() -> None:
        gmsh.model.occ.addRectangle(0, -BLOCK_HEIGHT, 0, BLOCK_HALF_WIDTH, BLOCK_HEIGHT)

    def gmsh_cell_size_expression(finest: float) -> str:
        return f"{finest} + {COARSENING} * Max(0, Sqrt(x * x + y * y) - {FINE_DISTANCE})"

    finest_below = FINEST_CELL / MASTER_EDGE_RATIO
    above = mesh_with_gmsh(
        add_half_cylinder_section, 2, FINEST_CELL, 2, gmsh_cell_size_expression(FINEST_CELL)
    )
    below = mesh_with_gmsh(
        add_half_block, 2, finest_below, 2, gmsh_cell_size_expression(finest_below)
    )
    mesh, is_lower_cell = join_lower_and_upper_mesh(below, above)

    def is_on_cylinder(x: Array) -> Mask:
        return np.isclose(np.hypot(x[0], x[1] - CYLINDER_RADIUS), CYLINDER_RADIUS)

    def is_on_contact_faces(x: Array) -> Mask:
        on_either_face = np.isclose(x[1], 0.0) | (is_on_cylinder(x) & (x[1] < CYLINDER_RADIUS))
        return (x[0] < 2 * FINE_DISTANCE) & on_either_face

    def is_on_loaded_top_of_cylinder(x: Array) -> Mask:
        return is_on_cylinder(x) & (x[1] > CYLINDER_RADIUS) & (x[0] < LOADED_HALF_WIDTH)

    lower, upper = _find_contact_facets(mesh, is_lower_cell, is_on_contact_faces)
    moduli, state = (ALUMINIUM, STEEL), StressState.PLANE_STRAIN
    bodies = TwoBodies.from_mesh(
        way, mesh, is_lower_cell, moduli, POISSONS_RATIO, state, (upper, lower)
    )
    bodies = _restrict_slave_facets(bodies, lambda x: x[:, 0] < FINE_DISTANCE)
    load = bodies.load((0.0, -1.0), is_on_loaded_top_of_cylinder)
    load.scale(R0094_FORCE / 2 / -load.sum())
    supports = [
        prescribe(bodies.space, 0, _make_plane_marker(0, 0.0)),
        prescribe(bodies.space, 1, _make_plane_marker(1, -BLOCK_HEIGHT)),
    ]
    solution = bodies.solve(load, supports)
    x = bodies.x[solution.slave_node][:, 0]
    materials = ElasticHalfSpace(ALUMINIUM, POISSONS_RATIO), ElasticHalfSpace(STEEL, POISSONS_RATIO)
    width = np.sqrt(
        4 * R0094_FORCE * CYLINDER_RADIUS * _sum_of_plane_contact_compliances(*materials) / np.pi
    )
    peak = 2 * R0094_FORCE / (np.pi * width)
    exact = peak * np.sqrt(np.maximum(0.0, 1 - (x / width) ** 2))
    # p² = p0² (1 - x²/a²) is a straight line over x²
    is_fitted = (x < 0.9 * width) & ~np.isnan(solution.pressure)
    slope, intercept = np.polyfit(x[is_fitted] ** 2, solution.pressure[is_fitted] ** 2, 1)
    scalars = {
        "width_error": np.sqrt(intercept / -slope) / HERTZ_WIDTH - 1,
        "peak_error": np.sqrt(intercept) / HERTZ_PEAK - 1,
    }
    return compare_pressures_with_exact_ones(
        bodies, solution, exact, peak, INNER_RADIUS * width, R0094_FORCE / 2, scalars
    )


# Parts of both bodies


def _restrict_slave_facets(bodies: TwoBodies, is_in_region: Callable[[Array], Mask]) -> TwoBodies:
    """Return a copy of the bodies in which all nodes of the slave facets lie within a region.

    Args:
        bodies: Bodies whose slave facets are restricted.
        is_in_region: Function that marks positions (n, dim) within the region.
    """
    trace = gather_boundary_facets(bodies.space, bodies.slave)
    is_node_near = is_in_region(trace.facet_x.reshape(-1, trace.space_dim))
    is_facet_near = is_node_near.reshape(trace.facet_nodes.shape).all(axis=1)
    return TwoBodies(
        bodies.method, bodies.body, bodies.K, bodies.slave[is_facet_near], bodies.master
    )


def _find_contact_facets(
    mesh: Mesh, is_lower_cell: Mask, is_on_contact_faces: Callable[[Array], Mask]
) -> tuple[Facets, Facets]:
    """Return the exterior facets of the lower and of the upper body within a region.

    Args:
        mesh: Mesh of both bodies.
        is_lower_cell: Mask (cells,) of the cells of the lower body.
        is_on_contact_faces: Function that marks points (3, n) of the region.
    """
    facets, dim = locate_exterior_facets(mesh, is_on_contact_faces), mesh.topology.dim
    cells = mesh.topology.connectivity(dim - 1, dim)
    is_lower = is_lower_cell[cells.array[cells.offsets[facets]]]
    return facets[is_lower], facets[~is_lower]


def _mask_nodes_of_upper_body(bodies: TwoBodies, interface_height: float = 0.0) -> Mask:
    """Return the mask (nodes,) of the nodes of all cells whose centres lie above a plane.

    Args:
        bodies: The two bodies.
        interface_height: Last coordinate of the plane.
    """
    up = bodies.x.shape[1] - 1
    cells = bodies.space.dofmap.list
    is_above = np.zeros(len(bodies.x), dtype=bool)
    is_above[cells[bodies.x[cells, up].mean(axis=1) > interface_height]] = True
    return is_above


def _make_plane_marker(axis: int, value: float) -> Callable[[Array], Mask]:
    return lambda x: np.isclose(x[axis], value)


def _sum_of_plane_contact_compliances(*bodies: ElasticHalfSpace) -> float:
    """Return the sum of 1/E* of bodies, where E* is the plane-strain modulus E/(1 - nu^2)."""
    return sum(1 / body.plane_strain_modulus for body in bodies)
