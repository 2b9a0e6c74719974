"""Problems of two deformable bodies of tetrahedra that slide on each other at large strains."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from dolfinx.mesh import Mesh
from scipy.spatial.transform import Rotation

from pw_elements import Spaces, SurfaceNodes
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import SLIP
from pw_elements.contact.interface import gather_boundary_facets
from pw_elements.contact.model import ContactState, PairState
from study.benchmarks.v11_two_bodies.methods import integrate_mortar_coupling_of_multipliers
from study.benchmarks.v17_bodies.problems import (
    SlidingHistory,
    make_dimensionless_result,
    measure_relative_moment,
    solve_sliding_of_two_bodies,
)
from study.meshes.mesh_lines import BODY_SIZE, mesh_lines_of_block_under_ball
from study.meshes.two_body_meshes import mesh_two_blocks_of_tetrahedra
from study.run.store import Result
from study.solutions.calculix.blocks_in_space import (
    GAP,
    N_PRESSING_INCREMENTS,
    PATCH_GRIDS,
    PATCH_STRETCH,
    PATCH_TIMES,
    PATCHES,
    ROTATION_DEGREES,
    SLIDING_CURVATURE,
    SLIDING_GRIDS,
    SLIDING_TIMES,
    RotatedPatch,
    displace_patch,
    displace_sliding_block,
    exact_patch_normals_and_pressures,
    rotate_about_general_axis,
    solve_uniaxial_stress,
)
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.die import FRICTION
from study.solutions.calculix.grids import Grid
from study.solutions.half_space import (
    ElasticHalfSpace,
    HertzSphere,
    axisymmetric_displacement_in_space,
)
from study.solutions.rubber import (
    POISSONS_RATIO,
    NeoHookeanBody,
    drop_small_weights,
    first_lame_constant_over_shear_modulus,
)

# Stresses relative to the shear modulus
QUADRATURE_DEGREE = 2
LAME = first_lame_constant_over_shear_modulus(POISSONS_RATIO)
N_STARTING_INCREMENTS = 6
"""Number of increments of sliding before the force is steady."""

# Flat sides, of which the lower one is kept flat by supports
FLAT_GRIDS = (
    Grid("T10", (-0.5, -0.5, -0.4), (1.5, 0.5, 0.0), (7, 3, 1)),
    Grid("T10", (-0.3, -0.25, 0.0), (0.3, 0.25, 0.3), (3, 2, 2)),
)
FLAT_DEPTH, FLAT_TILT, FLAT_TRAVEL, N_FLAT_INCREMENTS = 0.03, 0.5, 0.6, 6

# Hertz: a ball on a block; lengths relative to the contact radius
BALL_RADIUS = 1e3
BALL_OVER_BLOCK_CELLS = 1.25
"""Number of elements of the ball along the contact radius over that of the block."""
INNER_RADIUS = 0.8
"""Distance from the axis up to which pressures are compared."""


def _mesh_blocks(
    grids: Sequence[Grid], curvatures: tuple[float, float]
) -> tuple[Mesh, tuple[Indices, Indices]]:
    lower, upper = (
        [
            np.linspace(*ends[:2], ends[2] + 1)
            for ends in zip(g.lower, g.upper, g.divisions, strict=True)
        ]
        for g in grids
    )
    return mesh_two_blocks_of_tetrahedra(lower, upper, curvatures, GAP)


def _mask_base_and_top(bodies: NeoHookeanBody) -> tuple[Mask, Mask]:
    z = bodies.x[:, 2]
    return np.isclose(z, z.min()), np.isclose(z, z.max())


def _pair(state: ContactState) -> PairState:
    return state.pairs[0]


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


def _press_and_rotate_patch(
    element: str, curvature: float, lame: float | None
) -> tuple[NeoHookeanBody, tuple[Indices, Indices], SlidingHistory]:
    mesh, sides = _mesh_blocks(PATCH_GRIDS, (curvature, curvature))
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE, calculix_energy=lame is None)

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[:] = displace_patch(bodies.x, time, lame)

    moved = _mask_base_and_top(bodies)
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, moved, PATCH_TIMES)
    return bodies, sides, record


def _compare_patch_with_exact(
    bodies: NeoHookeanBody,
    sides: tuple[Indices, Indices],
    state: ContactState,
    curvature: float,
    lame: float | None,
    degrees: float,
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return errors of force over weight on both sides, and curves of forces and exact values."""
    bodies.solution.x.array[:] = state.displacement.array_r
    weight = bodies.integrate_weights_over_deformed_sides(sides)
    pair, rotation = _pair(state), rotate_about_general_axis(degrees)
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    for side, node, force in (
        ("", pair.node, -pair.force_vector),
        ("_master", pair.opposite_node, pair.opposite_force),
    ):
        normal, exact = exact_patch_normals_and_pressures(bodies.x[node], curvature, lame)
        normal_force = -np.sum(force * rotation.apply(normal), axis=1)
        errors = _compare_force_over_weight(normal_force, weight[node], exact)
        scalars |= {name + side: value for name, value in errors.items()}
        curves |= {f"x{side}": bodies.x[node, :2], f"force{side}": normal_force}
        curves |= {f"weight{side}": weight[node], f"exact{side}": exact}
    return scalars, curves


def patch(element: str, curvature: float) -> Result:
    """Compress two blocks uniformly, then rotate both; compare with uniaxial stress.

    Args:
        element: Name of the element.
        curvature: Curvature of the common side along both axes; zero if it is flat.
    """
    bodies, sides, record = _press_and_rotate_patch(element, curvature, LAME)
    pressed, last = record.states[1], record.states[-1]
    rotation = rotate_about_general_axis(ROTATION_DEGREES)
    errors, curves = _compare_patch_with_exact(
        bodies, sides, last, curvature, LAME, ROTATION_DEGREES
    )
    scalars = record.summarise_iterations() | {
        "objectivity_error": _measure_change_by_rotation(_pair(pressed), _pair(last), rotation),
        "balance_error": record.largest_force_imbalance(),
        "moment_error": max(measure_relative_moment(bodies, state) for state in record.states),
        "pressure": solve_uniaxial_stress(PATCH_STRETCH, LAME)[1],
    }
    return make_dimensionless_result(scalars | errors, curves, len(bodies.solution.x.array))


def patch_by_calculix(element: str, case: str, tracked: str) -> Result:
    """Compress and rotate the patch with the energy of CalculiX; compare both with exact values.

    CalculiX' nodal forces are those of its elements under its displacements.

    Args:
        element: Name of our element.
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    problem, numbers = PATCHES[case], load_recorded_result_if_unchanged(case, tracked).numbers
    bodies, sides, record = _press_and_rotate_patch(element, problem.curvature, None)
    stretches, pressure = solve_uniaxial_stress(PATCH_STRETCH)
    _, exact = exact_patch_normals_and_pressures(
        problem.nodes[problem.slave_nodes - 1], problem.curvature, None
    )
    scalars = {}
    for suffix, state, degrees in (
        ("", record.states[1], 0.0),
        ("_rotated", record.states[-1], ROTATION_DEGREES),
    ):
        errors, _ = _compare_patch_with_exact(
            bodies, sides, state, problem.curvature, None, degrees
        )
        scalars |= {
            f"pressure_error{suffix}": errors["force_over_weight_error"],
            f"pressure_error_master{suffix}": errors["force_over_weight_error_master"],
            f"calculix_pressure_error{suffix}": np.abs(
                numbers[f"pressure{suffix}"] / exact - 1
            ).max(),
        }
        for name, force in (("", _pair(state).force), ("calculix_", numbers[f"force{suffix}"])):
            error = np.linalg.norm(force) / (pressure * stretches[0] ** 2) - 1
            scalars[f"{name}force_error{suffix}"] = abs(error)
    errors = _compare_calculix_nodal_forces_with_exact(problem, numbers["displacement"])
    scalars |= {f"calculix_{name}": value for name, value in errors.items()}
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def _compare_calculix_nodal_forces_with_exact(
    problem: RotatedPatch, displacement: Array
) -> dict[str, float]:
    """Return errors of the forces of the standard element on the slave of the pressed patch.

    Args:
        problem: Problem that CalculiX has solved.
        displacement: Displacements (3 k,) of its `nodes_of_elements_at_contact`.
    """
    mesh, sides = _mesh_blocks(PATCH_GRIDS, problem.curvatures)
    bodies = NeoHookeanBody("galerkin-T10", mesh, QUADRATURE_DEGREE, calculix_energy=True)
    moved, slave = problem.nodes_of_elements_at_contact - 1, problem.slave_nodes - 1
    u = bodies.solution.x.array.reshape(-1, 3)
    u[bodies.find_nodes(problem.nodes[moved])] = displacement.reshape(-1, 3)
    node = bodies.find_nodes(problem.nodes[slave])
    normal, exact = exact_patch_normals_and_pressures(bodies.x[node], problem.curvature, None)
    force = np.sum(bodies.nodal_forces()[node] * normal, axis=1)
    weight = bodies.integrate_weights_over_deformed_sides(sides)[node]
    return _compare_force_over_weight(force, weight, exact)


def _measure_change_by_rotation(before: PairState, after: PairState, rotation: Rotation) -> float:
    """Return the largest change of forces, over the largest force, and of gaps, over `GAP`."""
    changes = [
        rotation.inv().apply(after.force_vector) - before.force_vector,
        rotation.inv().apply(after.opposite_force) - before.opposite_force,
    ]
    largest = np.abs(before.force_vector).max()
    gap_change = np.abs(after.gap - before.gap).max() / GAP
    return float(max(gap_change, *(np.abs(change).max() / largest for change in changes)))


def transfer(element: str, method: str) -> Result:
    """Transfer a uniform pressure between both flat sides of the patch by dual multipliers.

    Args:
        element: Standard element.
        method: Method of section V11, "p2-dual" for dual quadratic multipliers.
    """
    mesh, sides = _mesh_blocks(PATCH_GRIDS, (0.0, 0.0))
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    space = bodies.solution.function_space
    slave, master = (gather_boundary_facets(space, side.astype(np.int32)) for side in sides)
    coupling = integrate_mortar_coupling_of_multipliers(method, slave, master, len(bodies.x), 1.0)
    force = np.asarray(coupling.forces.T @ np.ones(len(slave.nodes)))
    make_weights = partial(SurfaceNodes.from_scalar_spaces, Spaces.galerkin(mesh, 0))
    scalars = {"balance_error": float(abs(force.sum()) / force[slave.nodes].sum())}
    for name, side, sign in (("", sides[0], 1.0), ("_master", sides[1], -1.0)):
        surface = make_weights(side.astype(np.int32))
        weight = drop_small_weights(surface.weight_area)
        errors = _compare_force_over_weight(
            sign * force[surface.node], weight, np.ones_like(weight)
        )
        scalars |= {scalar + name: value for scalar, value in errors.items()}
    return make_dimensionless_result(scalars, {}, 3 * len(bodies.x))


# Sliding


def press_and_slide_block(
    element: str, calculix_energy: bool = False
) -> tuple[NeoHookeanBody, SlidingHistory]:
    """Press a small block into a long one and slide it over ten of its elements.

    Args:
        element: Name of the element.
        calculix_energy: Whether to use CalculiX' strain energy.
    """
    mesh, sides = _mesh_blocks(SLIDING_GRIDS, (0.0, SLIDING_CURVATURE))
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE, calculix_energy)

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[:] = displace_sliding_block(bodies.x, time)

    moved = _mask_base_and_top(bodies)
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, moved, SLIDING_TIMES)
    return bodies, record


def slide(element: str) -> Result:
    """Press a small block into a long one and slide it; measure forces and iterations.

    Args:
        element: Name of the element.
    """
    bodies, record = press_and_slide_block(element)
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
    return make_dimensionless_result(scalars, curves, len(bodies.solution.x.array))


def slide_by_calculix(element: str, case: str, tracked: str) -> Result:
    """Slide the block with the energy of CalculiX, and compare its forces with CalculiX'.

    Args:
        element: Name of our element.
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    peer = load_recorded_result_if_unchanged(case, tracked).numbers
    bodies, record = press_and_slide_block(element, calculix_energy=True)
    force = np.array([_pair(state).force for state in record.states])
    ours = {"N": force[:, 2], "T": -force[:, 0]}
    scalars = {}
    for name in ("N", "T"):
        scalars[f"{name}_difference"] = np.abs(ours[name] - peer[name]).max() / peer["N"].max()
        for program, forces in (("", ours), ("calculix_", peer)):
            steady = forces[name][N_PRESSING_INCREMENTS + N_STARTING_INCREMENTS :]
            scalars |= {
                f"{program}{name}": forces[name][-1],
                f"{program}ripple_{name}": _measure_ripple(steady),
            }
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


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
    mesh, sides = _mesh_blocks(FLAT_GRIDS, (0.0, 0.0))
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
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def _measure_friction_sum_error(pair: PairState) -> float:
    """Return the difference of the friction force and Coulomb's nodal forces, over the former.

    Coulomb's forces have the sizes of the normal forces times the coefficient of friction, and are
    opposed to the slips.
    """
    direction = pair.slip / np.linalg.norm(pair.slip, axis=1)[:, None]
    coulomb = -FRICTION * pair.force_normal @ direction
    return float(np.linalg.norm(pair.force[:2] - coulomb[:2]) / np.linalg.norm(pair.force[:2]))


# Hertz


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
    across, depth, extent = mesh_lines_of_block_under_ball(elements_per_radius)
    block_across, block_depth, _ = mesh_lines_of_block_under_ball(
        elements_per_radius / BALL_OVER_BLOCK_CELLS
    )
    lower_lines = block_across, block_across, -block_depth[::-1]
    mesh, sides = mesh_two_blocks_of_tetrahedra(
        lower_lines, (across, across, depth), (0.0, 1 / BALL_RADIUS), gap, extent
    )
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_ball = x[:, 2] > gap / 2
    z = np.where(is_ball, -(x[:, 2] - gap), x[:, 2])
    is_outer = np.any(np.isclose(np.abs(x[:, :2]), BODY_SIZE), axis=1) | np.isclose(
        np.abs(z), BODY_SIZE
    )
    # displacements of the press: the exact ones, mirrored in the ball, which also approaches
    pressing = np.zeros_like(x)
    pressing[is_outer] = axisymmetric_displacement_in_space(
        exact, np.column_stack([x[:, :2], np.minimum(z, 0.0)])[is_outer]
    )
    pressing[is_ball, 2] = -pressing[is_ball, 2] - (gap + 2 * exact.approach)
    rotation = rotate_about_general_axis(ROTATION_DEGREES)

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
    bodies.solution.x.array[:] = state.displacement.array_r
    weight = bodies.integrate_weights_over_deformed_sides(sides)
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
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))
