"""Problems of two deformable bodies of tetrahedra that slide on each other at large strains."""

import numpy as np

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
from study.meshes.mesh_lines import BODY_SIZE
from study.meshes.two_body_meshes import mesh_ball_on_block
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
    displace_patch,
    displace_sliding_block,
    exact_patch_normals_and_pressures,
    list_sliding_times,
    rotate_about_general_axis,
    solve_uniaxial_stress,
)
from study.solutions.calculix.blocks_in_space_forces import (
    QUADRATURE_DEGREE,
    compare_calculix_nodal_forces_with_exact,
    compare_patch_with_exact,
    measure_change_by_rotation,
    mesh_blocks,
)
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.die import FRICTION
from study.solutions.calculix.grids import Grid
from study.solutions.half_space import (
    ElasticHalfSpace,
    HertzSphere,
    displacement_of_pressed_half_spaces,
)
from study.solutions.rubber import (
    POISSONS_RATIO,
    NeoHookeanBody,
    compare_force_over_weight,
    first_lame_constant_over_shear_modulus,
)

# Stresses are relative to the shear modulus
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


def _cell_of(element: str) -> str:
    return "hexahedron" if element.endswith("H27") else "tetrahedron"


def _quadrature_degree(element: str) -> int:
    """Return the degree of quadrature; that of both programs would leave H27 without stiffness."""
    return 4 if element == "galerkin-H27" else QUADRATURE_DEGREE


def _mask_base_and_top(bodies: NeoHookeanBody) -> tuple[Mask, Mask]:
    z = bodies.x[:, 2]
    return np.isclose(z, z.min()), np.isclose(z, z.max())


def _pair(state: ContactState) -> PairState:
    return state.pairs[0]


# Patch


def _press_and_rotate_patch(
    element: str, curvature: float, lame: float | None
) -> tuple[NeoHookeanBody, tuple[Indices, Indices], SlidingHistory]:
    mesh, sides = mesh_blocks(PATCH_GRIDS, (curvature, curvature), _cell_of(element))
    bodies = NeoHookeanBody(
        element, mesh, _quadrature_degree(element), calculix_energy=lame is None
    )

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[:] = displace_patch(bodies.x, time, lame)

    moved = _mask_base_and_top(bodies)
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, moved, PATCH_TIMES)
    return bodies, sides, record


def patch(element: str, curvature: float) -> Result:
    """Compress two blocks uniformly, then rotate both; compare with uniaxial stress.

    Args:
        element: Name of the element.
        curvature: Curvature of the common side along both axes; zero if it is flat.
    """
    bodies, sides, record = _press_and_rotate_patch(element, curvature, LAME)
    pressed, last = record.states[1], record.states[-1]
    rotation = rotate_about_general_axis(ROTATION_DEGREES)
    errors, curves = compare_patch_with_exact(
        bodies, sides, last, curvature, LAME, ROTATION_DEGREES
    )
    scalars = record.summarise_iterations() | {
        "objectivity_error": measure_change_by_rotation(_pair(pressed), _pair(last), rotation),
        "balance_error": record.largest_force_imbalance(),
        "moment_error": max(measure_relative_moment(bodies, state) for state in record.states),
        "pressure": solve_uniaxial_stress(PATCH_STRETCH, LAME)[1],
    }
    return make_dimensionless_result(scalars | errors, curves, len(bodies.solution.x.array))


def patch_by_calculix(element: str, case: str, tracked: str) -> Result:
    """Compress and rotate the patch with the energy of CalculiX; compare both with exact values.

    Args:
        element: Name of our element.
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    problem, numbers = PATCHES[case], load_recorded_result_if_unchanged(case, tracked).numbers
    curvature, slave = problem.curvature, problem.nodes[problem.slave_nodes - 1]
    bodies, sides, record = _press_and_rotate_patch(element, curvature, None)
    stretches, pressure = solve_uniaxial_stress(PATCH_STRETCH)
    total = pressure * stretches[0] ** 2
    _, exact = exact_patch_normals_and_pressures(slave, curvature)
    scalars: dict[str, float] = {}
    for suffix, state, degrees in (
        ("", record.states[1], 0.0),
        ("_rotated", record.states[-1], ROTATION_DEGREES),
    ):
        _, ours = compare_patch_with_exact(bodies, sides, state, curvature, None, degrees)
        for program, force, error in (
            ("", _pair(state).force, ours["force"] / ours["weight"] / ours["exact"] - 1),
            ("calculix_", numbers[f"force{suffix}"], numbers[f"pressure{suffix}"] / exact - 1),
        ):
            scalars |= {
                f"{program}force_error{suffix}": abs(np.linalg.norm(force) / total - 1),
                f"{program}largest_error{suffix}": np.abs(error).max(),
                f"{program}median_error{suffix}": np.median(np.abs(error)),
            }
    errors = compare_calculix_nodal_forces_with_exact(problem, numbers["displacement"])
    scalars |= {f"calculix_{name}": value for name, value in errors.items()}
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def transfer(element: str, method: str) -> Result:
    """Transfer a uniform pressure between both flat sides of the patch by dual multipliers.

    Args:
        element: Standard element.
        method: Method of section V11, "p2-dual" for dual quadratic multipliers.
    """
    mesh, sides = mesh_blocks(PATCH_GRIDS, (0.0, 0.0))
    bodies = NeoHookeanBody(element, mesh, _quadrature_degree(element))
    space = bodies.solution.function_space
    slave, master = (gather_boundary_facets(space, side.astype(np.int32)) for side in sides)
    coupling = integrate_mortar_coupling_of_multipliers(method, slave, master, len(bodies.x), 1.0)
    force = np.asarray(coupling.forces.T @ np.ones(len(slave.nodes)))
    weight = bodies.integrate_weights_over_deformed_sides(sides)
    scalars = {"balance_error": float(abs(force.sum()) / force[slave.nodes].sum())}
    for name, nodes, sign in (("", slave.nodes, 1.0), ("_master", master.nodes, -1.0)):
        errors = compare_force_over_weight(sign * force[nodes], weight[nodes], np.ones(len(nodes)))
        scalars |= {scalar + name: value for scalar, value in errors.items()}
    return make_dimensionless_result(scalars, {}, 3 * len(bodies.x))


# Sliding


def press_and_slide_block(
    element: str, calculix_energy: bool = False, n_elements: int = 10
) -> tuple[NeoHookeanBody, SlidingHistory]:
    """Press a small block into a long one and slide it over some of its elements.

    Args:
        element: Name of the element.
        calculix_energy: Whether to use CalculiX' strain energy.
        n_elements: Number of elements to slide over, at most 10.
    """
    mesh, sides = mesh_blocks(SLIDING_GRIDS, (0.0, SLIDING_CURVATURE), _cell_of(element))
    bodies = NeoHookeanBody(element, mesh, _quadrature_degree(element), calculix_energy)

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[:] = displace_sliding_block(bodies.x, time)

    moved, times = _mask_base_and_top(bodies), list_sliding_times(n_elements)
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, moved, times)
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
    scalars: dict[str, float] = {}
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
    mesh, sides = mesh_blocks(FLAT_GRIDS, (0.0, 0.0), _cell_of(element))
    bodies = NeoHookeanBody(element, mesh, _quadrature_degree(element))
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
    mesh, sides = mesh_ball_on_block(elements_per_radius, BALL_OVER_BLOCK_CELLS, BALL_RADIUS, gap)
    bodies = NeoHookeanBody(element, mesh, _quadrature_degree(element))
    x = bodies.x
    is_lateral = np.any(np.isclose(np.abs(x[:, :2]), BODY_SIZE), axis=1)
    is_outer = np.any([is_lateral, *_mask_base_and_top(bodies)], axis=0)
    pressing = np.zeros_like(x)
    pressing[is_outer] = displacement_of_pressed_half_spaces(exact, x[is_outer], gap)
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
