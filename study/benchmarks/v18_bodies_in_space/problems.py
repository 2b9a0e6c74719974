"""Problems of two deformable bodies of tetrahedra that slide on each other at large strains."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from dolfinx.mesh import Mesh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from pw_elements import Spaces, SurfaceNodes
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import SLIP
from pw_elements.contact.interface import gather_boundary_facets
from pw_elements.contact.model import ContactState, PairState
from study.benchmarks.v11_two_bodies.methods import integrate_mortar_coupling_of_multipliers
from study.benchmarks.v17_bodies.problems import SlidingHistory, solve_sliding_of_two_bodies
from study.meshes.two_body_meshes import mesh_two_blocks_of_tetrahedra
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.calculix.die import FRICTION
from study.solutions.half_space import (
    ElasticHalfSpace,
    HertzSphere,
    axisymmetric_displacement_in_space,
)
from study.solutions.rubber import (
    POISSONS_RATIO,
    NeoHookeanBody,
    first_lame_constant_over_shear_modulus,
)

# Stresses relative to the shear modulus
QUADRATURE_DEGREE = 2
GAP = 0.01
"""Initial gap between both bodies, by which their sides are told apart."""
ROTATION_AXIS, ROTATION_DEGREES, N_ROTATION_INCREMENTS = (1.0, -2.0, 2.0), 70.0, 4
MIN_RELATIVE_WEIGHT = 0.02
"""Integral of a weight function, over the largest one, below which a node has no pressure.

Corners of standard tetrahedra have no weight on flat facets, and a small one on curved facets.
"""

# Patch: two blocks with square sections of side 1 and heights of 0.5
PATCH_CELLS = ((3, 3, 2), (4, 4, 2))
"""Numbers of boxes, of six tetrahedra each, of the lower block (master) and the upper one."""
PATCH_BOXES = [[(-0.5, 0.5), (-0.5, 0.5), depths] for depths in ((-0.5, 0.0), (0.0, 0.5))]
PATCH_STRETCH = 0.9

# Sliding: a small block with a convex lower side on a long one
SLIDING_CELL_SIZE = 0.15
"""Length of the small block's elements along the path."""
SLIDING_CELLS = ((12, 3, 1), (4, 2, 2))
SLIDING_BOXES = (
    ((-0.5, 2.1), (-0.4, 0.4), (-0.3, 0.0)),
    ((-0.3, 0.3), (-0.25, 0.25), (0.0, 0.4)),
)
SLIDING_CURVATURE, SLIDING_DEPTH = 0.4, 0.05
N_PRESSING_INCREMENTS, N_SLIDING_INCREMENTS, N_STARTING_INCREMENTS = 2, 20, 6
"""Numbers of increments of pressing, of sliding, and of sliding before the force is steady."""

# Flat sides, of which the lower one is kept flat by supports
FLAT_CELLS = ((7, 3, 1), (3, 2, 2))
FLAT_BOXES = (
    ((-0.5, 1.5), (-0.5, 0.5), (-0.4, 0.0)),
    ((-0.3, 0.3), (-0.25, 0.25), (0.0, 0.3)),
)
FLAT_DEPTH, FLAT_TILT, FLAT_TRAVEL, N_FLAT_INCREMENTS = 0.03, 0.5, 0.6, 6

# Hertz: a ball on a block; lengths relative to the contact radius
BALL_RADIUS = 1e3
HERTZ_SIZE = 2.5
"""Distance of the outer sides from the contact, on which exact displacements are prescribed."""
BALL_OVER_BLOCK_CELLS = 1.25
"""Number of elements of the ball along the contact radius over that of the block."""
INNER_RADIUS = 0.8
"""Distance from the axis up to which pressures are compared."""


def _rotation(degrees: float) -> Rotation:
    axis = np.array(ROTATION_AXIS) / np.linalg.norm(ROTATION_AXIS)
    return Rotation.from_rotvec(np.radians(degrees) * axis)


def _rotation_times() -> list[float]:
    return [1 + (k + 1) / N_ROTATION_INCREMENTS for k in range(N_ROTATION_INCREMENTS)]


def _divide_box(box: Sequence[tuple[float, float]], cells: Sequence[int]) -> list[Array]:
    """Return even mesh lines along each axis of a box, given by its ends along each axis."""
    return [np.linspace(*ends, n + 1, dtype=np.float64) for ends, n in zip(box, cells, strict=True)]


def _mask_base_and_top(bodies: NeoHookeanBody) -> tuple[Mask, Mask]:
    z = bodies.x[:, 2]
    return np.isclose(z, z.min()), np.isclose(z, z.max())


def _pair(state: ContactState) -> PairState:
    return state.pairs[0]


def _integrate_weights_over_deformed_sides(
    bodies: NeoHookeanBody, state: ContactState, slave_and_master_facets: Sequence[Indices]
) -> Array:
    """Integrate each node's test function (n,) over the deformed facets of its side."""
    make_spaces = Spaces.petrov_galerkin if bodies.element.startswith("pw") else Spaces.galerkin
    bodies.solution.x.array[:] = state.displacement.array_r
    stretch = SurfaceNodes.area_stretch(bodies.solution)
    scalar_spaces = make_spaces(bodies.solution.function_space.mesh, 0)
    weights = np.zeros(len(bodies.x))
    for side in slave_and_master_facets:
        surface = SurfaceNodes.from_scalar_spaces(scalar_spaces, side.astype(np.int32), stretch)
        weights[surface.node] = surface.weight_area
    return np.where(weights > MIN_RELATIVE_WEIGHT * weights.max(), weights, 0.0)


def _compare_force_over_weight(force: Array, weight: Array, exact: Array) -> dict[str, float]:
    """Return the largest relative error of nodal forces over weights, and of weightless nodes.

    Args:
        force: Normal forces (m,) of nodes whose whole patches are in contact.
        weight: Integrals (m,) of their weight functions.
        exact: Exact pressures (m,) at these nodes.
    """
    has_weight = weight > 0
    pressure = force[has_weight] / weight[has_weight]
    return {
        "force_over_weight_error": float(np.abs(pressure / exact[has_weight] - 1).max()),
        "weightless_nodes": float(np.mean(~has_weight)),
        "weightless_force": float(np.abs(force[~has_weight]).max(initial=0.0) / force.mean()),
    }


# Patch


def _deformation_of_uniaxial_stress(stretch: float) -> tuple[Array, float]:
    """Return stretches (3,), and the pressure on sections z = constant, for a stretch along z."""
    lame = first_lame_constant_over_shear_modulus(POISSONS_RATIO)

    def lateral_stress(lateral: float) -> float:
        return float(lateral**2 - 1 + lame * np.log(lateral**2 * stretch))

    lateral = brentq(lateral_stress, 0.5, 2.0, xtol=1e-15)
    J = lateral**2 * stretch
    return np.array([lateral, lateral, stretch]), -(stretch**2 - 1 + lame * np.log(J)) / J


def _mesh_patch(curvature: float) -> tuple[Mesh, tuple[Indices, Indices]]:
    lower_lines, upper_lines = map(_divide_box, PATCH_BOXES, PATCH_CELLS)
    return mesh_two_blocks_of_tetrahedra(lower_lines, upper_lines, (curvature, curvature), GAP)


def patch(element: str, curvature: float) -> Result:
    """Compress two blocks uniformly, then rotate both; compare with uniaxial stress.

    Args:
        element: Name of the element.
        curvature: Curvature of the common side along both axes; zero if it is flat.
    """
    mesh, sides = _mesh_patch(curvature)
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    is_base, is_top = _mask_base_and_top(bodies)
    closed = bodies.x - np.outer(is_top, [0.0, 0.0, GAP])

    def set_displacements(time: float, displacement: Array) -> None:
        stretches, _ = _deformation_of_uniaxial_stress(1 - (1 - PATCH_STRETCH) * min(time, 1.0))
        rotation = _rotation(ROTATION_DEGREES * max(0.0, time - 1))
        displacement[:] = rotation.apply(stretches * closed) - bodies.x

    times = [0.5, 1.0, *_rotation_times()]
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, (is_base, is_top), times)
    pressed, last = record.states[1], record.states[-1]
    rotation = _rotation(ROTATION_DEGREES)
    stretches, pressure = _deformation_of_uniaxial_stress(PATCH_STRETCH)
    scalars = record.summarise_iterations() | {
        "objectivity_error": _measure_change_by_rotation(_pair(pressed), _pair(last), rotation),
        "balance_error": record.largest_force_imbalance(),
        "moment_error": max(_relative_moment(bodies, state) for state in record.states),
        "pressure": pressure,
    }
    weight = _integrate_weights_over_deformed_sides(bodies, last, sides)
    curves: dict[str, Array] = {}
    forces = {
        "": (_pair(last).node, -_pair(last).force_vector),
        "_master": (_pair(last).opposite_node, _pair(last).opposite_force),
    }
    for side, (node, force) in forces.items():
        normal = np.column_stack([-curvature * bodies.x[node, :2], np.ones(len(node))]) / stretches
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        exact = pressure * normal[:, 2] ** 2
        normal_force = -np.sum(force * rotation.apply(normal), axis=1)
        errors = _compare_force_over_weight(normal_force, weight[node], exact)
        scalars |= {name + side: value for name, value in errors.items()}
        curves |= {f"x{side}": bodies.x[node, :2], f"force{side}": normal_force}
        curves |= {f"weight{side}": weight[node], f"exact{side}": exact}
    return _make_dimensionless_result(scalars, curves, len(bodies.solution.x.array))


def _measure_change_by_rotation(before: PairState, after: PairState, rotation: Rotation) -> float:
    """Return the largest change of forces, over the largest force, and of gaps, over `GAP`."""
    changes = [
        rotation.inv().apply(after.force_vector) - before.force_vector,
        rotation.inv().apply(after.opposite_force) - before.opposite_force,
    ]
    largest = np.abs(before.force_vector).max()
    gap_change = np.abs(after.gap - before.gap).max() / GAP
    return float(max(gap_change, *(np.abs(change).max() / largest for change in changes)))


def _relative_moment(bodies: NeoHookeanBody, state: ContactState) -> float:
    """Return the resultant moment of all contact forces, over the sum of its parts' sizes."""
    pair = _pair(state)
    nodes = np.concatenate([pair.node, pair.opposite_node])
    x = (bodies.x + state.displacement.array_r.reshape(-1, 3))[nodes]
    moments = np.cross(x - x.mean(axis=0), np.concatenate([pair.force_vector, pair.opposite_force]))
    sizes = np.linalg.norm(moments, axis=1).sum()
    return float(np.linalg.norm(moments.sum(axis=0)) / sizes)


def transfer(element: str, method: str) -> Result:
    """Transfer a uniform pressure between both flat sides of the patch by dual multipliers.

    Args:
        element: Standard element.
        method: Method of section V11, "p2-dual" for dual quadratic multipliers.
    """
    mesh, sides = _mesh_patch(0.0)
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    space = bodies.solution.function_space
    slave, master = (gather_boundary_facets(space, side.astype(np.int32)) for side in sides)
    coupling = integrate_mortar_coupling_of_multipliers(method, slave, master, len(bodies.x), 1.0)
    force = np.asarray(coupling.forces.T @ np.ones(len(slave.nodes)))
    make_weights = partial(SurfaceNodes.from_scalar_spaces, Spaces.galerkin(mesh, 0))
    scalars = {"balance_error": float(abs(force.sum()) / force[slave.nodes].sum())}
    for name, side, sign in (("", sides[0], 1.0), ("_master", sides[1], -1.0)):
        surface = make_weights(side.astype(np.int32))
        weight = surface.weight_area
        weight = np.where(weight > MIN_RELATIVE_WEIGHT * weight.max(), weight, 0.0)
        errors = _compare_force_over_weight(
            sign * force[surface.node], weight, np.ones_like(weight)
        )
        scalars |= {scalar + name: value for scalar, value in errors.items()}
    return _make_dimensionless_result(scalars, {}, 3 * len(bodies.x))


# Sliding


def slide(element: str) -> Result:
    """Press a small block into a long one and slide it over ten of its elements.

    Args:
        element: Name of the element.
    """
    lower_lines, upper_lines = map(_divide_box, SLIDING_BOXES, SLIDING_CELLS)
    mesh, sides = mesh_two_blocks_of_tetrahedra(
        lower_lines, upper_lines, (0.0, SLIDING_CURVATURE), GAP
    )
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    is_base, is_top = _mask_base_and_top(bodies)

    def set_displacements(time: float, displacement: Array) -> None:
        travel = 10 * SLIDING_CELL_SIZE * max(0.0, time - 1)
        displacement[is_top] = [travel, 0.0, -(GAP + SLIDING_DEPTH) * min(time, 1.0)]

    times = [(k + 1) / N_PRESSING_INCREMENTS for k in range(N_PRESSING_INCREMENTS)]
    times += [1 + (k + 1) / N_SLIDING_INCREMENTS for k in range(N_SLIDING_INCREMENTS)]
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, (is_base, is_top), times)
    sliding = SlidingHistory(
        record.states[N_PRESSING_INCREMENTS:],
        record.contact_law_violations[N_PRESSING_INCREMENTS:],
    )
    force = np.array([_pair(state).force for state in sliding.states])
    steady = force[N_STARTING_INCREMENTS:]
    scalars = sliding.summarise_iterations() | {
        "convergence_order": sliding.median_convergence_order(),
        "balance_error": sliding.largest_force_imbalance(),
        "cone_error": sliding.largest_friction_law_violation(),
        "ripple_N": _measure_ripple(steady[:, 2]),
        "ripple_T": _measure_ripple(steady[:, 0]),
        "N": force[-1, 2],
        "T_over_N": abs(force[-1, 0] / force[-1, 2]),
    }
    curves = {"N": force[:, 2], "T": np.abs(force[:, 0])}
    return _make_dimensionless_result(scalars, curves, len(bodies.solution.x.array))


def _measure_ripple(force: Array) -> float:
    """Return the largest deviation of forces from a parabola over the path, over their mean."""
    path = np.linspace(-1, 1, len(force))
    trend = np.polynomial.Polynomial.fit(path, force, 2)(path)
    return float(np.abs(force - trend).max() / abs(force.mean()))


def flat(element: str, plane_strain: bool) -> Result:
    """Slide a flat block on one whose upper side is kept flat, so that all nodes slip.

    Args:
        element: Name of the element.
        plane_strain: Whether displacements across the direction of sliding are zero.
    """
    lower_lines, upper_lines = map(_divide_box, FLAT_BOXES, FLAT_CELLS)
    mesh, sides = mesh_two_blocks_of_tetrahedra(lower_lines, upper_lines, (0.0, 0.0), GAP)
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    is_base, is_top = _mask_base_and_top(bodies)

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_top, 0] = FLAT_TRAVEL * max(0.0, time - 1)
        depth = FLAT_DEPTH * (1 - FLAT_TILT * bodies.x[is_top, 0])
        displacement[is_top, 2] = -(GAP + depth) * min(time, 1.0)

    times = [1.0, *(1 + (k + 1) / N_FLAT_INCREMENTS for k in range(N_FLAT_INCREMENTS))]
    record = solve_sliding_of_two_bodies(
        bodies,
        sides,
        set_displacements,
        (is_base, is_top),
        times,
        lambda x: np.isclose(x[2], 0),
        plane_strain=plane_strain,
    )
    pairs = [_pair(state) for state in record.states[-3:]]
    shear_over_limit = [
        np.linalg.norm(pair.force_tangential, axis=1) / (FRICTION * pair.force_normal)
        for pair in pairs
    ]
    scalars = record.summarise_iterations() | {
        "nodal_friction_error": float(np.abs(np.array(shear_over_limit) - 1).max()),
        "friction_error": max(
            abs(np.hypot(*pair.force[:2]) / pair.force[2] / FRICTION - 1) for pair in pairs
        ),
        "friction_sum_error": max(map(_measure_friction_sum_error, pairs)),
        "slipping": min(float(np.mean(pair.status == SLIP)) for pair in pairs),
        "balance_error": record.largest_force_imbalance(),
    }
    return _make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def _measure_friction_sum_error(pair: PairState) -> float:
    """Return the difference of the friction force and Coulomb's nodal forces, over the former.

    Coulomb's forces have the sizes of the normal forces times the coefficient of friction, and are
    opposed to the slips.
    """
    direction = pair.slip / np.linalg.norm(pair.slip, axis=1)[:, None]
    coulomb = -FRICTION * pair.force_normal @ direction
    return float(np.linalg.norm(pair.force[:2] - coulomb[:2]) / np.linalg.norm(pair.force[:2]))


# Hertz


def _mesh_lines(elements_per_radius: float) -> tuple[Array, Array, float]:
    """Return mesh lines across and into the body, and the extent of the part that may touch."""
    size = 1 / (elements_per_radius + 0.375)
    inner = size * np.arange(np.ceil(1.2 / size) + 1)
    n_outer = int(np.ceil((HERTZ_SIZE - inner[-1]) / (2.5 * size)))
    outwards = np.concatenate([inner, np.linspace(inner[-1], HERTZ_SIZE, n_outer + 1)[1:]])
    horizontal = np.concatenate([-outwards[:0:-1], outwards])
    n_depth = int(np.ceil(np.log1p(HERTZ_SIZE / size) / np.log(2)))
    depth = HERTZ_SIZE * (2 ** np.arange(n_depth + 1) - 1) / (2**n_depth - 1)
    return horizontal, depth, float(inner[-1])


def hertz(element: str, elements_per_radius: float) -> Result:
    """Press a ball and a block, both rotated by 70°, together, and compare with Hertz.

    Args:
        element: Name of the element.
        elements_per_radius: Number of elements of the ball (the slave) over the contact radius.
    """
    body = ElasticHalfSpace(2 * (1 + POISSONS_RATIO), POISSONS_RATIO)
    # each half space is deformed as by a rigid ball of twice the radius
    force = 4 / 3 * body.plane_strain_modulus / (2 * BALL_RADIUS)
    exact = HertzSphere(body, 2 * BALL_RADIUS, force)

    gap = exact.approach
    across, depth, extent = _mesh_lines(elements_per_radius)
    block_across, block_depth, _ = _mesh_lines(elements_per_radius / BALL_OVER_BLOCK_CELLS)
    lower_lines = block_across, block_across, -block_depth[::-1]
    mesh, sides = mesh_two_blocks_of_tetrahedra(
        lower_lines, (across, across, depth), (0.0, 1 / BALL_RADIUS), gap, extent
    )
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_ball = x[:, 2] > gap / 2
    z = np.where(is_ball, -(x[:, 2] - gap), x[:, 2])
    is_outer = np.any(np.isclose(np.abs(x[:, :2]), HERTZ_SIZE), axis=1) | np.isclose(
        np.abs(z), HERTZ_SIZE
    )
    # displacements of the press: the exact ones, mirrored in the ball, which also approaches
    pressing = np.zeros_like(x)
    pressing[is_outer] = axisymmetric_displacement_in_space(
        exact, np.column_stack([x[:, :2], np.minimum(z, 0.0)])[is_outer]
    )
    pressing[is_ball, 2] = -pressing[is_ball, 2] - (gap + 2 * exact.approach)
    rotation = _rotation(ROTATION_DEGREES)

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[:] = rotation.apply(x + time * pressing) - x

    record = solve_sliding_of_two_bodies(
        bodies,
        sides,
        set_displacements,
        (is_outer,),
        [1.0],
        friction=0.0,
        start_displacements=rotation.apply(x) - x,
    )
    state = record.states[-1]
    weight = _integrate_weights_over_deformed_sides(bodies, state, sides)
    pair, scalars = _pair(state), record.summarise_iterations()
    normal = rotation.apply([0.0, 0.0, 1.0])
    scalars["force_error"] = abs(float(pair.force @ normal) / force - 1)
    scalars["balance_error"] = float(
        np.abs(pair.force + pair.opposite_force.sum(axis=0)).max() / np.abs(pair.force).max()
    )
    for side, node, normal_force in (
        ("", pair.node, pair.force_normal),
        ("_master", pair.opposite_node, -pair.opposite_force @ normal),
    ):
        r = np.hypot(x[node, 0], x[node, 1])
        has_weight = weight[node] > 0
        pressure = normal_force[has_weight] / weight[node][has_weight]
        # Hertz: the mean of r², weighted by the pressure, is 2/5
        radius = np.sqrt(2.5 * np.sum(normal_force * r**2) / normal_force.sum())
        r, inner = r[has_weight], r[has_weight] < INNER_RADIUS
        peak = exact.peak_pressure
        error = (pressure - exact.pressure(r))[inner] / peak
        scalars |= {
            f"peak_error{side}": float(abs(pressure.max() / peak - 1)),
            f"radius_error{side}": float(abs(radius - 1)),
            f"pressure_error{side}": float(np.sqrt(np.mean(error**2))),
        }
    return _make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def _make_dimensionless_result(
    scalars: dict[str, float], curves: dict[str, Array], dofs: int
) -> Result:
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), curves, dofs=dofs)
