"""Press fits of two tubes in space: shrunk on, and pushed on with friction."""

from collections.abc import Callable, Sequence
from functools import partial

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, create_mesh, locate_entities_boundary
from scipy.spatial import cKDTree

from pw_elements import Body, Material, Reduction, Spaces, SurfaceNodes, assemble_matrix, prescribe
from pw_elements._compat import cell_geometry_nodes
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh
from study.benchmarks.v17_bodies.problems import (
    SlidingHistory,
    make_dimensionless_result,
    solve_sliding_of_bodies,
)
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.solid_meshes import mesh_box_along_lines
from study.meshes.two_body_meshes import join_lower_and_upper_mesh
from study.model.discretisation import make_element_spaces
from study.run.store import Result
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.shrink_fit import (
    INTERFERENCE,
    LENGTH,
    RADII,
    SHRUNK_TUBES,
    YOUNGS_MODULUS,
    compute_lame_pressure,
    divide_tubes,
)
from study.solutions.rubber import (
    POISSONS_RATIO,
    NeoHookeanBody,
    compare_force_over_weight,
    drop_small_weights,
    first_lame_constant_over_shear_modulus,
)

QUADRATURE_DEGREE = 4
TubeLines = tuple[Array, Array, Array]
"""Mesh lines of a tube: radii, angles, and coordinates along the axis."""
# A shaft pushed through a hub: radii of the shaft and of the hub
SHAFT_RADII, HUB_RADII, HUB_LENGTH = (0.5, 1.03), (1.0, 2.0), 1.0
SHAFT_ENDS, NOSE = (-1.35, 0.05), (-0.35, 0.05, 0.06)
HELD_RADIUS = 1.6
"""Radius beyond which the upper side of the hub is held."""
PUSH_FRICTION, STEP = 0.2, 0.1
WAYS = (*(STEP * k for k in range(1, 13)), 1.15, 1.05, 0.95)
"""Displacements of the shaft: it is pushed in, then pulled back."""
STEADY = (11, 14)
"""Increments at whose ends all of the fit slips."""
INNER_PART = (0.15, 0.85)
"""Coordinates along the axis between which nodal pressures are compared; peaks are at the ends."""
REFERENCE_ELEMENT, REFERENCE_REFINEMENT = "pw-T6", 4
"""Element and refinement of the axisymmetric reference."""


def bend_shaft_nose(x: Array, nose: tuple[float, float, float], columns: tuple[int, int]) -> Array:
    """Return points (n, dim) of a shaft whose end is made conical; smooth where the cone begins.

    Args:
        x: Points (n, dim) of the straight shaft.
        nose: Coordinate along the axis where the cone begins, its end, and the decrease of the
            radius there. The outline is a parabola.
        columns: Columns of the radius and of the coordinate along the axis.
    """
    start, end, decrease = nose
    radius, axial = columns
    moved = x.copy()
    share = np.clip((x[:, axial] - start) / (end - start), 0.0, 1.0)
    moved[:, radius] -= decrease * share**2
    return moved


def merge_coinciding_nodes(mesh: Mesh) -> Mesh:
    """Return the mesh with one node wherever nodes are less than 1e-9 apart."""
    x = mesh.geometry.x
    pairs = cKDTree(x).query_pairs(1e-9, output_type="ndarray")
    node = np.arange(len(x))
    node[pairs.max(axis=1)] = pairs.min(axis=1)
    kept, number = np.unique(node, return_inverse=True)
    order = np.argsort(mesh.topology.original_cell_index)
    cells = number[cell_geometry_nodes(mesh)[order]].astype(np.int64)
    return create_mesh(
        mesh.comm, cells=cells, x=x[kept], e=mesh.ufl_domain().ufl_coordinate_element()
    )


def mesh_tubes(
    inner: TubeLines, outer: TubeLines, nose: tuple[float, float, float] | None = None
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh sectors of two tubes, or tubes, about z by quadratic tetrahedra with curved sides.

    Args:
        inner: Mesh lines of the inner tube. Angles from 0 to 2 pi mesh the whole tube.
        outer: Mesh lines of the outer tube.
        nose: Arguments of `bend_shaft_nose` for the inner tube; None for a straight one.

    Returns:
        Mesh, and the facets of the bore of the outer tube and of the outside of the inner tube.
    """

    def bend_to_tube(x: Array, is_inner: bool) -> Array:
        if is_inner and nose is not None:
            x = bend_shaft_nose(x, nose, (0, 2))
        return np.column_stack([x[:, 0] * np.cos(x[:, 1]), x[:, 0] * np.sin(x[:, 1]), x[:, 2]])

    tubes = [
        merge_coinciding_nodes(
            curved_mesh(
                mesh_box_along_lines("tetrahedron", *lines),
                partial(bend_to_tube, is_inner=is_inner),
            )
        )
        for lines, is_inner in ((inner, True), (outer, False))
    ]
    mesh, is_inner_cell = join_lower_and_upper_mesh(*tubes)

    def is_on_bore(x: Array) -> Mask:
        return np.asarray(np.isclose(np.hypot(x[0], x[1]), outer[0][0]))

    def is_on_shaft(x: Array) -> Mask:
        radius: Array = np.full(x.shape[1], inner[0][-1])
        if nose is not None:
            outline = np.column_stack([radius, x[2]])
            radius = bend_shaft_nose(outline, nose, (0, 1))[:, 0]
        return np.asarray(np.isclose(np.hypot(x[0], x[1]), radius))

    mesh.topology.create_connectivity(2, 3)
    cells_of_facets = mesh.topology.connectivity(2, 3)

    def find_facets(is_on_side: Callable[[Array], Mask], is_of_inner: bool) -> Indices:
        facets = locate_entities_boundary(mesh, 2, is_on_side).astype(np.int64)
        cells = np.array([cells_of_facets.links(facet)[0] for facet in facets])
        return facets[is_inner_cell[cells] == is_of_inner]

    bore, shaft = find_facets(is_on_bore, False), find_facets(is_on_shaft, True)
    return mesh, (bore, shaft)


def _divide(start: float, end: float, cells: int) -> Array:
    return np.linspace(start, end, cells + 1, dtype=np.float64)


def _tube(
    radii: Sequence[float], length: Sequence[float], cells: Sequence[int], angle: float
) -> TubeLines:
    return (
        _divide(radii[0], radii[1], cells[0]),
        _divide(0.0, angle, cells[1]),
        _divide(length[0], length[1], cells[2]),
    )


def _is_on_plane_of_symmetry(axis: int, x: Array) -> Mask:
    return np.asarray(np.isclose(x[axis], 0.0))


def shrink(element: str, around: int) -> Result:
    """Shrink a tube onto another without friction; compare pressures on both sides with Lamé's.

    Args:
        element: Name of the element.
        around: Number of elements of the outer tube around a quarter; the inner one has fewer.
    """
    inner, outer = divide_tubes(around)
    mesh, (bore, shaft) = mesh_tubes(
        _tube(RADII[:2], (0.0, LENGTH), inner, np.pi / 2),
        _tube(RADII[1:], (0.0, LENGTH), outer, np.pi / 2),
    )
    steel = Material(YOUNGS_MODULUS, POISSONS_RATIO)
    body = Body(make_element_spaces(element, mesh), steel, StressState.SOLID)
    space = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    supports = [prescribe(space, k, partial(_is_on_plane_of_symmetry, k)) for k in range(3)]
    pair = ContactPair(
        fem.locate_dofs_topological(space, 2, bore.astype(np.int32)),
        DeformableSurface(shaft.astype(np.int32), coincident=True),
        interference=INTERFERENCE,
    )
    reduction = Reduction.dirichlet(space, supports)
    (state,) = solve_contact(K, K.createVecRight(), reduction, pair, space)
    (on_bore,) = state.pairs
    exact = compute_lame_pressure(RADII, INTERFERENCE)
    scalar_spaces = make_scalar_spaces(element, mesh)
    x = space.tabulate_dof_coordinates()
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    for suffix, facets, nodes, force in (
        ("", bore, on_bore.node, on_bore.force_vector),
        ("_master", shaft, on_bore.opposite_node, -on_bore.opposite_force),
    ):
        surface = SurfaceNodes.from_scalar_spaces(scalar_spaces, facets.astype(np.int32))
        weight = np.zeros(len(x))
        weight[surface.node] = surface.weight_area
        radial_direction = x[nodes, :2] / np.linalg.norm(x[nodes, :2], axis=1)[:, None]
        radial_force = np.sum(force[:, :2] * radial_direction, axis=1)
        area = drop_small_weights(weight[nodes])
        errors = compare_force_over_weight(radial_force, area, np.full(len(nodes), exact))
        scalars |= {name + suffix: value for name, value in errors.items()}
        has_weight = area > 0
        curves[f"pressure{suffix}"] = radial_force[has_weight] / area[has_weight] / exact
        curves[f"z{suffix}"] = x[nodes[has_weight], 2]
    total = float(np.sum(on_bore.force_normal))
    scalars["mean_error"] = abs(total / (np.pi / 2 * RADII[1] * LENGTH) / exact - 1)
    return make_dimensionless_result(scalars, curves, 3 * len(x))


def shrink_by_calculix(element: str, case: str, tracked: str) -> Result:
    """Compare pressures that CalculiX prints for nodes of the bore with Lamé's.

    Args:
        element: Name of the element that CalculiX' C3D10 is.
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    problem = SHRUNK_TUBES[case]
    pressure = load_recorded_result_if_unchanged(case, tracked).numbers["pressure"]
    error = pressure / compute_lame_pressure(RADII, INTERFERENCE) - 1
    scalars = {
        "largest_error": np.abs(error).max(),
        "median_error": np.median(np.abs(error)),
        "mean_error": abs(error.mean()),
    }
    curves = {"pressure": 1 + error, "z": problem.nodes[problem.slave_nodes - 1, 2]}
    return make_dimensionless_result(scalars, curves, problem.nodes.size)


def make_scalar_spaces(element: str, mesh: object) -> Spaces:
    """Return scalar spaces with the weight functions of an element."""
    make = Spaces.petrov_galerkin if element.startswith("pw") else Spaces.galerkin
    return make(mesh, 0)


def push(element: str, around: int) -> Result:
    """Push a shaft with a rounded nose through a hub with friction, and pull it back, in space.

    Args:
        element: Name of the element.
        around: Number of elements around the hub; the shaft has two fewer.
    """
    mesh, sides = mesh_tubes(
        _tube(SHAFT_RADII, SHAFT_ENDS, (1, around - 2, 8), 2 * np.pi),
        _tube(HUB_RADII, (0.0, HUB_LENGTH), (2, around, 7), 2 * np.pi),
        NOSE,
    )
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_base = np.isclose(x[:, 2], SHAFT_ENDS[0])
    is_held = np.isclose(x[:, 2], HUB_LENGTH) & (np.hypot(x[:, 0], x[:, 1]) > HELD_RADIUS)

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_base, 2] = time

    record = solve_sliding_of_bodies(
        bodies,
        [sides],
        set_displacements,
        (is_base, is_held),
        WAYS,
        friction=PUSH_FRICTION,
    )
    axial = np.array([state.pairs[0].force[2] for state in record.states])
    normal = np.array([state.pairs[0].force_normal.sum() for state in record.states])
    reference = push_axisymmetric(REFERENCE_ELEMENT, REFERENCE_REFINEMENT)
    exact = reference.curves["axial"]
    scalars = record.summarise_iterations() | _measure_push(axial, normal)
    scalars["force_difference"] = float(np.abs(axial - exact).max() / np.abs(exact).max())
    scalars["balance_error"] = max(
        abs(pair.force[2] + pair.opposite_force[:, 2].sum()) / abs(pair.force[2])
        for state in record.states
        for pair in state.pairs
        if pair.force_normal.sum() > 0
    )
    pushed = record.states[STEADY[0]]
    (pair,) = pushed.pairs
    displacement = np.asarray(pushed.displacement.array_r.reshape(-1, 3))
    bodies.solution.x.array[:] = displacement.ravel()
    weight = bodies.integrate_weights_over_deformed_sides(sides)
    moved = x + displacement
    for suffix, node, force in (
        ("", pair.node, pair.force_vector),
        ("_master", pair.opposite_node, -pair.opposite_force),
    ):
        z = moved[node, 2]
        inner = (INNER_PART[0] < z) & (z < INNER_PART[1])
        node, force, z = node[inner], force[inner], z[inner]
        radial = moved[node, :2] / np.linalg.norm(moved[node, :2], axis=1)[:, None]
        has_weight = weight[node] > 0
        pressure = np.sum(force[:, :2] * radial, axis=1)[has_weight] / weight[node][has_weight]
        expected = np.interp(z[has_weight], reference.curves["z"], reference.curves["pressure"])
        mean = float(expected.mean())
        scalars |= {
            f"pressure_error{suffix}": float(np.sqrt(np.mean((pressure - expected) ** 2)) / mean),
            f"largest_pressure_error{suffix}": float(np.abs(pressure - expected).max() / mean),
            f"weightless_nodes{suffix}": float(np.mean(~has_weight)),
        }
    return make_dimensionless_result(
        scalars, {"axial": axial, "normal": normal}, len(bodies.solution.x.array)
    )


def _measure_push(axial: Array, normal: Array) -> dict[str, float]:
    pushed, pulled = STEADY
    return {
        "largest": float(np.abs(axial).max()),
        "push": axial[pushed],
        "pull": axial[pulled],
        "push_over_normal": axial[pushed] / normal[pushed],
        "pull_over_normal": axial[pulled] / normal[pulled],
    }


def push_axisymmetric(element: str, refinement: int) -> Result:
    """Push the shaft through the hub in axisymmetry, as a reference.

    Args:
        element: Name of an element in the plane.
        refinement: Number of times by which the mesh is finer than that in space.
    """

    def section(lines: tuple[Array, Array], is_shaft: bool) -> object:
        mesh = mesh_along_lines(MPI.COMM_SELF, *lines, "triangle")
        return curved_mesh(mesh, lambda x: bend_shaft_nose(x, NOSE, (0, 1)) if is_shaft else x)

    n = refinement
    shaft, hub = (
        section((_divide(*SHAFT_RADII, 2 * n), _divide(*SHAFT_ENDS, 8 * n)), True),
        section((_divide(*HUB_RADII, 3 * n), _divide(0.0, HUB_LENGTH, 7 * n)), False),
    )
    mesh, _ = join_lower_and_upper_mesh(shaft, hub)
    spaces = make_element_spaces(element, mesh)
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    r = ufl.SpatialCoordinate(mesh)[0]

    def gradient(f: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        g = ufl.grad(f)
        return ufl.as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, f[0] / r]])

    F = ufl.Identity(3) + gradient(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    lame = first_lame_constant_over_shear_modulus(POISSONS_RATIO)
    stress = F - inverse + lame * ufl.ln(J) * inverse
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE + 2})
    residual = ufl.inner(stress, gradient(v)) * 2 * np.pi * r * dx
    way = fem.Constant(mesh, 0.0)

    def is_base(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], SHAFT_ENDS[0]))

    def is_held(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], HUB_LENGTH) & (x[0] > HELD_RADIUS))

    supports = [
        prescribe(spaces.trial, 0, is_base),
        prescribe(spaces.trial, 1, is_base, way),
        *(prescribe(spaces.trial, component, is_held) for component in (0, 1)),
    ]

    def is_bore(x: Array) -> Mask:
        return np.asarray(np.isclose(x[0], HUB_RADII[0]) & (x[1] > -1e-9))

    def is_shaft(x: Array) -> Mask:
        outline = np.column_stack([np.full(x.shape[1], SHAFT_RADII[1]), x[1]])
        return np.asarray(np.isclose(x[0], bend_shaft_nose(outline, NOSE, (0, 1))[:, 0]))

    pair = ContactPair(is_bore, DeformableSurface(is_shaft, True), PUSH_FRICTION)
    problem = ContactProblem.of_residual(residual, u, supports, pair, max_iterations=40)
    state, start, record = problem.undeformed, 0.0, SlidingHistory()
    for end in WAYS:

        def move_shaft(load_factor: float, start: float = start, end: float = end) -> None:
            way.value = (1 - load_factor) * start + load_factor * end

        state, start = problem.step(state, move_shaft), end
        record.states.append(state)
    axial = np.array([state.pairs[0].force[1] for state in record.states])
    normal = np.array([state.pairs[0].force_normal.sum() for state in record.states])
    scalars = _measure_push(axial, normal)
    scalars["iterations_mean"] = float(np.mean([s.iterations for s in record.states]))
    pushed = record.states[STEADY[0]]
    u.x.array[:] = pushed.displacement.array_r
    stretch = 2 * np.pi * (r + u[0]) * SurfaceNodes.area_stretch(u)
    surface = SurfaceNodes.from_scalar_spaces(make_scalar_spaces(element, mesh), is_bore, stretch)
    weight = np.zeros(len(u.x.array) // 2)
    weight[surface.node] = surface.weight_area
    (slave,) = pushed.pairs
    z = slave.position[:, 1] + slave.displacement[:, 1]
    order = np.argsort(z)
    curves = {
        "axial": axial,
        "normal": normal,
        "z": z[order],
        "pressure": (slave.force_normal / weight[slave.node])[order],
    }
    return make_dimensionless_result(scalars, curves, len(u.x.array))
