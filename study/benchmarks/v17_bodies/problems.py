"""Problems of two deformable bodies that slide on each other at large strains."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, locate_entities_boundary
from scipy.integrate import quad

from pw_elements import Spaces, SurfaceNodes, prescribe
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact import OPEN, SLIP, ContactPair, ContactProblem, DeformableSurface
from pw_elements.contact.interface import SpaceSlidingMortar, gather_boundary_facets
from pw_elements.contact.model import ContactState, PairState
from pw_elements.contact.nodes import MAX_CONTACT_VIOLATION_PER_NODAL_FORCE
from pw_elements.meshes import curved_mesh
from study.benchmarks.v17_bodies.quadratic_multipliers import (
    DualQuadraticMortar,
    UncheckedMortarContactProblem,
)
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.two_body_meshes import join_lower_and_upper_mesh
from study.model.discretisation import make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.calculix.calculix import load_recorded_result_if_unchanged
from study.solutions.calculix.die import (
    CURVATURE,
    DEPTH,
    DIES,
    FRICTION,
    GAP,
    INCREMENT_ENDS,
    N_CALCULIX_INCREMENTS,
    N_PRESSING_INCREMENTS,
    SLIDING_ELEMENTS,
    map_rectangle_to_die,
    mesh_line_positions_of_block_and_die,
)
from study.solutions.rubber import NeoHookeanBody, first_lame_constant_over_shear_modulus

# Lengths relative to the width of the die, stresses relative to the shear modulus
QUADRATURE_DEGREE, FIT_QUADRATURE_DEGREE = 4, 6
N_END_NODES = 2
"""Number of nodes at each end of the contact that are excluded from measures of smoothness."""
MIN_RELATIVE_SLAVE_FORCE = 1e-9
"""Nodal force on the slave, over the largest one, below which it is considered round-off."""
MIN_RELATIVE_MASTER_FORCE = 0.3
"""Nodal force on the master, over the largest one, above which it is included in measures of
smoothness.
"""
CONTACT_LAW_ROUND_OFF = 1e-12
"""Round-off of violations of the contact law, over the largest nodal force."""

# A flat die, whose top is tilted to prevent the rear end from lifting
FLAT_ELEMENTS = (8, 6)
"""Numbers of elements of the flat die and of the block over the width of the die."""
FLAT_HEIGHT, FLAT_TRAVEL, FLAT_DEPTH, FLAT_TILT = 0.4, 1.0, 0.05, 0.5

RING_RADII, RING_DISTANCE, RING_TRAVEL = (0.7, 1.0), 0.005, 0.3
RING_CELLS = ((24, 2), (17, 2))
"""Numbers of cells around and across each half ring."""

TUBE_RADII, HOLE_RADIUS = ((1.0, 1.5), (1.55, 2.0)), 1.35
"""Inner and outer radii of both tubes, and final radius of the hole of the inner tube."""
TUBE_CELLS, TUBE_POISSONS_RATIO = 8, 0.49999
"""Number of cells across the inner tube (the outer tube has two fewer), and Poisson's ratio."""


@dataclass
class SlidingHistory:
    """Converged states and iteration errors of a sliding simulation.

    Attributes:
        states: State at the end of each increment.
        contact_law_violations: Violations of the contact law after each iteration of each
            increment, over the largest nodal force.
    """

    states: list[ContactState] = field(default_factory=list)
    contact_law_violations: list[list[float]] = field(default_factory=list)

    def summarise_iterations(self) -> dict[str, float]:
        """Return counts of Newton iterations and of increments by name.

        The names are `iterations_mean` (per increment, including abandoned attempts), `cut`
        (increments that were divided), `increments`, and `quadratic` (fraction of the increments
        whose last iteration converges quadratically).
        """
        last_two = [v[-2:] for v in self.contact_law_violations if len(v) > 1]
        is_quadratic = [
            last <= max(CONTACT_LAW_ROUND_OFF, 1e3 * previous**2) for previous, last in last_two
        ]
        return {
            "iterations_mean": float(np.mean([state.iterations for state in self.states])),
            "cut": float(sum(bool(state.substates) for state in self.states)),
            "increments": float(len(self.states)),
            "quadratic": float(np.mean(is_quadratic)),
        }

    def median_convergence_order(self) -> float:
        """Return the median order of convergence of the last three iterations of each increment.

        Violations of the contact law below `CONTACT_LAW_ROUND_OFF` are not considered.
        """
        orders = []
        for violations in self.contact_law_violations:
            above_round_off = [v for v in violations if v > CONTACT_LAW_ROUND_OFF]
            if len(above_round_off) > 2:
                first, second, third = np.log(above_round_off[-3:])
                orders.append((third - second) / (second - first))
        return float(np.median(orders))

    def largest_force_imbalance(self) -> float:
        """Return the largest resultant of all contact forces, over the force on one body."""
        sums = [
            _only_pair_state(state).force + _only_pair_state(state).opposite_force.sum(axis=0)
            for state in self.states
        ]
        magnitudes = np.linalg.norm(
            [_only_pair_state(state).force for state in self.states], axis=1
        )
        return float((np.linalg.norm(sums, axis=1) / magnitudes).max())

    def largest_friction_law_violation(self) -> float:
        """Return the largest violation of Coulomb's friction law, over the largest nodal force."""
        violations = []
        for pair in map(_only_pair_state, self.states):
            limit = pair.friction * pair.force_normal
            excess = np.linalg.norm(pair.force_tangential, axis=1) - limit
            distance = np.where(pair.status == SLIP, np.abs(excess), excess)
            violations.append(distance.max() / np.abs(pair.force_vector).max())
        return float(max(0.0, *violations))


def _only_pair_state(state: ContactState) -> PairState:
    return state.pairs[0]


def solve_sliding_of_two_bodies(
    bodies: NeoHookeanBody,
    slave_and_master_facets: Sequence[Indices],
    set_displacements: Callable[[float, Array], None],
    prescribed_nodes: Sequence[Mask],
    increment_ends: Sequence[float],
    is_held_vertically: Callable[[Array], Mask] | None = None,
    friction: float = FRICTION,
    start_displacements: Array | None = None,
    plane_strain: bool = False,
) -> SlidingHistory:
    """Solve a sequence of increments in which two deformable bodies slide on each other.

    Args:
        bodies: Both bodies in one mesh. Elements with piecewise-linear test functions use the
            library's mortar method. Standard elements use dual quadratic multipliers in the plane,
            and the mortar of the library in space.
        slave_and_master_facets: Facets of the slave and of the master.
        set_displacements: Function that writes the prescribed displacements at a given time into an
            array (n, dim) for all nodes.
        prescribed_nodes: Masks (n,) of the nodes to which these displacements are applied.
        increment_ends: Times at which the increments end; the first increment starts at time 0.
        is_held_vertically: Function that marks nodes whose displacement along the last axis is
            zero.
        friction: Coefficient of friction.
        start_displacements: Rigid motion (n, dim) of both bodies, without contact, from which the
            first increment starts; None if it starts from the undeformed state.
        plane_strain: Whether all displacements of bodies in space along the second axis are zero.
    """
    held_components: list[tuple[int, Callable[[Array], Mask]]] = []
    if is_held_vertically is not None:
        held_components.append((bodies.dim - 1, is_held_vertically))
    if plane_strain:
        held_components.append((1, lambda x: np.ones(x.shape[1], dtype=bool)))
    return solve_sliding_of_bodies(
        bodies,
        [slave_and_master_facets],
        set_displacements,
        prescribed_nodes,
        increment_ends,
        held_components,
        friction,
        start_displacements,
    )


def solve_sliding_of_bodies(
    bodies: NeoHookeanBody,
    sides_of_pairs: Sequence[Sequence[Indices]],
    set_displacements: Callable[[float, Array], None],
    prescribed_nodes: Sequence[Mask],
    increment_ends: Sequence[float],
    held_components: Sequence[tuple[int, Callable[[Array], Mask]]] = (),
    friction: float = FRICTION,
    start_displacements: Array | None = None,
) -> SlidingHistory:
    """Solve a sequence of increments in which deformable bodies slide on each other.

    Args:
        bodies: Bodies, see `solve_sliding_of_two_bodies`, which also describes the arguments that
            are not listed here.
        sides_of_pairs: For each pair, the facets of the slave and of the master.
        set_displacements: Function that writes the prescribed displacements.
        prescribed_nodes: Masks (n,) of the nodes to which these displacements are applied.
        increment_ends: Times at which the increments end.
        held_components: Components of the displacement that are zero, each with a function that
            marks the nodes.
        friction: Coefficient of friction.
        start_displacements: Rigid motion (n, dim) of all bodies at the start.
    """
    space, record = bodies.displacements.space, SlidingHistory()
    prescribed = fem.Function(space)
    nodes = np.flatnonzero(np.any(prescribed_nodes, axis=0)).astype(np.int32)
    supports = [fem.dirichletbc(prescribed, nodes)]
    supports += [prescribe(space, component, is_held) for component, is_held in held_components]

    def record_contact_law_violation(progress: object) -> None:
        if getattr(progress, "state", None) is None:
            violation = getattr(progress, "violation", np.inf)
            record.contact_law_violations[-1].append(
                violation * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE
            )

    sides = [[side.astype(np.int32) for side in pair] for pair in sides_of_pairs]
    pairs = [
        ContactPair(
            fem.locate_dofs_topological(space, bodies.dim - 1, slave),
            DeformableSurface(master, False if bodies.dim == 2 else None),
            friction,
        )
        for slave, master in sides
    ]
    arguments = bodies.residual, bodies.solution, supports, pairs
    problem: ContactProblem | UncheckedMortarContactProblem
    if bodies.element.startswith("pw"):
        problem = ContactProblem.of_residual(*arguments, callback=record_contact_law_violation)
    else:
        mortar_type = DualQuadraticMortar if bodies.dim == 2 else SpaceSlidingMortar
        mortars = [
            mortar_type(*(gather_boundary_facets(space, side) for side in pair)) for pair in sides
        ]
        problem = UncheckedMortarContactProblem(*arguments, mortars, record_contact_law_violation)
    state, start = problem.undeformed, 0.0
    if start_displacements is not None:
        displacement = state.displacement.copy()
        displacement.array[:] = start_displacements.ravel()
        pair_states = tuple(
            replace(pair, displacement=start_displacements[pair.node]) for pair in state.pairs
        )
        state = replace(state, displacement=displacement, unknowns=displacement, pairs=pair_states)
    for end in increment_ends:

        def set_displacements_at_load_factor(
            load_factor: float, start: float = start, end: float = end
        ) -> None:
            time = (1 - load_factor) * start + load_factor * end
            set_displacements(time, prescribed.x.array.reshape(-1, bodies.dim))

        record.contact_law_violations.append([])
        state, start = problem.step(state, set_displacements_at_load_factor), end
        record.states.append(state)
    return record


def make_die_and_block_mesh(
    slave_elements: int, master_elements: int
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh a die with a parabolic lower side and a block below it.

    Args:
        slave_elements: Number of elements of the die over its width.
        master_elements: Number of elements of the block over the same width.

    Returns:
        Mesh, and the facets of the slave (the die) and of the master (the block).
    """
    block, upper = mesh_line_positions_of_block_and_die(slave_elements, master_elements)
    mesh, _ = join_lower_and_upper_mesh(
        _mesh_mapped_rectangle(*block, lambda x: x),
        _mesh_mapped_rectangle(*upper, map_rectangle_to_die),
    )

    def is_on_lower_side_of_die(x: Array) -> Mask:
        return np.asarray(np.isclose(x[1], GAP + CURVATURE * x[0] ** 2 / 2) & (x[1] > GAP / 2))

    return mesh, (
        _find_exterior_facets_in_region(mesh, is_on_lower_side_of_die),
        _find_exterior_facets_in_region(mesh, partial(_is_at_height, 0.0)),
    )


def _is_at_height(y: float, x: Array) -> Mask:
    return np.asarray(np.isclose(x[1], y))


def _find_exterior_facets_in_region(mesh: Mesh, is_in_region: Callable[[Array], Mask]) -> Indices:
    """Return the exterior facets whose vertices all lie in a region.

    Args:
        mesh: Mesh of both bodies.
        is_in_region: Function that marks points (3, n) of the region.
    """
    return locate_entities_boundary(mesh, mesh.topology.dim - 1, is_in_region).astype(np.int64)


def die(element: str, own: int, opposite: int) -> Result:
    """Press a parabolic die into a block, then slide it over the length of ten of its elements.

    Args:
        element: Element name such as "pw-T6" or "galerkin-T6".
        own: Number of elements of the die (the slave) over its width.
        opposite: Number of elements of the block (the master) over the same width.
    """
    bodies, sides, record = _press_and_slide_die(element, own, opposite)
    sliding_states = record.states[N_PRESSING_INCREMENTS:]
    weight_area = _integrate_weight_functions_over_sides(bodies, sides)
    last, force = (
        _only_pair_state(sliding_states[-1]),
        np.array([_only_pair_state(s).force for s in record.states]),
    )
    node, master_force = _master_nodes_and_normal_forces(bodies, sliding_states[-1])
    displacement = _nodal_displacement(bodies, sliding_states[-1])
    scalars = record.summarise_iterations() | {
        "balance_error": record.largest_force_imbalance(),
        "moment_defect": max(measure_relative_moment(bodies, s) for s in sliding_states),
        "cone_error": record.largest_friction_law_violation(),
        **_measure_force_evenness_on_both_sides(bodies, sliding_states, np.ones(len(bodies.x)), ""),
        **_measure_force_evenness_on_both_sides(bodies, sliding_states, weight_area, "_pressure"),
        "edge_draw": max(
            _largest_tension_over_compression(_master_nodes_and_normal_forces(bodies, s)[1])
            for s in sliding_states
        ),
        "N": force[-1, 1],
        "T_over_N": abs(force[-1, 0] / force[-1, 1]),
        "slipping": float(np.mean(last.status[last.status != OPEN] == SLIP)),
    }
    curves = {
        "x": (last.position + last.displacement)[:, 0],
        "force_n": last.force_normal,
        "pressure": last.force_normal / weight_area[last.node],
        "status": last.status.astype(float),
        "master_x": bodies.x[node, 0] + displacement[node, 0],
        "master_force": master_force,
        "master_pressure": master_force / weight_area[node],
        "nodes": bodies.x + displacement,
        "cells": bodies.displacements.space.dofmap.list.copy(),
        "N": force[:, 1],
        "T": force[:, 0],
    }
    return make_dimensionless_result(scalars, curves, len(bodies.solution.x.array))


def _press_and_slide_die(
    element: str, slave_elements: int, master_elements: int, calculix_energy: bool = False
) -> tuple[NeoHookeanBody, tuple[Indices, Indices], SlidingHistory]:
    mesh, sides = make_die_and_block_mesh(slave_elements, master_elements)
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE, calculix_energy)
    x = bodies.x
    is_base, is_top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], 1)
    travel = SLIDING_ELEMENTS / slave_elements

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_top] = [travel * max(0.0, time - 1), -DEPTH * min(time, 1.0)]

    times = INCREMENT_ENDS[:N_CALCULIX_INCREMENTS] if calculix_energy else INCREMENT_ENDS
    return (
        bodies,
        sides,
        solve_sliding_of_two_bodies(bodies, sides, set_displacements, (is_base, is_top), times),
    )


def against_calculix(element: str, case: str, tracked: str) -> Result:
    """Move the die as in a stored CalculiX solution; compare its forces with CalculiX's.

    Args:
        element: Element name such as "pw-T6".
        case: Name of the CalculiX input deck.
        tracked: Digest that the stored solution must have.
    """
    peer, recorded = DIES[case], load_recorded_result_if_unchanged(case, tracked).numbers
    bodies, _, record = _press_and_slide_die(
        element, peer.die_elements_per_width, peer.block_elements_per_width, calculix_energy=True
    )
    force = np.array([_only_pair_state(state).force for state in record.states])
    normal, tangential = force[:, 1], -force[:, 0]
    largest = recorded["N"].max()
    scalars = {
        "N_difference": np.abs(normal - recorded["N"]).max() / largest,
        "T_difference": np.abs(tangential - recorded["T"]).max() / largest,
        "N": normal[-1],
        "T": tangential[-1],
    }
    curves = {
        "N": normal,
        "T": tangential,
        "N_calculix": recorded["N"],
        "T_calculix": recorded["T"],
    }
    return make_dimensionless_result(scalars, curves, len(bodies.solution.x.array))


def ironed(element: str) -> Result:
    """Slide a flat die on a block whose upper side is kept flat, so that all nodes slip.

    Args:
        element: Element name such as "pw-T6".
    """
    (across, _), (die_lines, _) = mesh_line_positions_of_block_and_die(*FLAT_ELEMENTS)
    die_heights = GAP + _divide_interval(0.0, FLAT_HEIGHT, 3)
    block = _mesh_mapped_rectangle(across, _divide_interval(-1.0, 0.0, 3), lambda x: x)
    mesh, _ = join_lower_and_upper_mesh(
        block, _mesh_mapped_rectangle(die_lines, die_heights, lambda x: x)
    )
    sides = [_find_exterior_facets_in_region(mesh, partial(_is_at_height, y)) for y in (GAP, 0.0)]
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_base, is_top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], die_heights[-1])

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_top, 0] = FLAT_TRAVEL * max(0.0, time - 1)
        displacement[is_top, 1] = -FLAT_DEPTH * min(time, 1.0) * (1 - FLAT_TILT * x[is_top, 0])

    times = [0.5, 1.0, *(1 + (k + 1) / 8 for k in range(8))]
    record = solve_sliding_of_two_bodies(
        bodies, sides, set_displacements, (is_base, is_top), times, lambda x: np.isclose(x[1], 0)
    )
    pairs = [_only_pair_state(state) for state in record.states[-4:]]
    scalars = record.summarise_iterations() | {
        "friction_error": max(abs(-p.force[0] / p.force[1] / FRICTION - 1) for p in pairs),
        "slipping": min(float(np.mean(p.status == SLIP)) for p in pairs),
        "cone_error": record.largest_friction_law_violation(),
        "balance_error": record.largest_force_imbalance(),
    }
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def turned(element: str, degrees: int) -> Result:
    """Press the die into the block, then rotate both; contact forces should rotate, too.

    Args:
        element: Element name such as "pw-T6".
        degrees: Angle of rotation in degrees.
    """
    mesh, sides = make_die_and_block_mesh(8, 6)
    bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_base, is_top = np.isclose(x[:, 1], -1), np.isclose(x[:, 1], 1)
    n_increments = round(degrees / 17)

    def set_displacements(time: float, displacement: Array) -> None:
        position = x + np.outer(is_top, [0.0, -DEPTH * min(time, 1.0)])
        displacement[:] = position @ _rotation_matrix(degrees * max(0.0, time - 1)).T - x

    times = [0.5, 1.0, *(1 + (k + 1) / n_increments for k in range(n_increments))]
    record = solve_sliding_of_two_bodies(bodies, sides, set_displacements, (is_base, is_top), times)
    pressed, last = _only_pair_state(record.states[1]), _only_pair_state(record.states[-1])
    rotated_back = last.force_vector @ _rotation_matrix(degrees)
    largest = np.abs(pressed.force_vector).max()
    slips = [
        np.abs(_only_pair_state(s).slip[_only_pair_state(s).status != OPEN]).max()
        for s in record.states[2:]
    ]
    scalars = record.summarise_iterations() | {
        "objectivity_error": float(np.abs(rotated_back - pressed.force_vector).max() / largest),
        "slip": float(max(slips)),
        "balance_error": record.largest_force_imbalance(),
    }
    return make_dimensionless_result(scalars, {}, len(bodies.solution.x.array))


def rings(element: str) -> Result:
    """Press two half rings together in two simulations, with either ring as the slave.

    Args:
        element: Element name such as "pw-T6".
    """
    forces, scalars, dofs = [], {}, 0
    for is_upper_slave in (False, True):
        half_rings = []
        for number, (n_around, n_across) in enumerate(RING_CELLS):
            angles, radii = (
                _divide_interval(0.0, np.pi, n_around),
                _divide_interval(*RING_RADII, n_across),
            )
            half_rings.append(_mesh_half_ring(angles, radii, is_upper=number == 1))
        mesh, _ = join_lower_and_upper_mesh(*half_rings)
        upper_centre = 2 * RING_RADII[1] + RING_DISTANCE

        def is_on_outer_circle_of_ring(centre: float, x: Array) -> Mask:
            return np.asarray(np.isclose(np.hypot(x[0], x[1] - centre), RING_RADII[1]))

        sides = [
            _find_exterior_facets_in_region(mesh, partial(is_on_outer_circle_of_ring, centre))
            for centre in (0.0, upper_centre)
        ]
        bodies = NeoHookeanBody(element, mesh, QUADRATURE_DEGREE)
        is_low, is_high = (np.isclose(bodies.x[:, 1], height) for height in (0.0, upper_centre))

        def set_displacements(time: float, displacement: Array, is_high: Mask = is_high) -> None:
            displacement[is_high] = [0.0, -RING_TRAVEL * time]

        times = [(k + 1) / 8 for k in range(8)]
        record = solve_sliding_of_two_bodies(
            bodies,
            sides[::-1] if is_upper_slave else sides,
            set_displacements,
            (is_low, is_high),
            times,
        )
        forces.append(abs(_only_pair_state(record.states[-1]).force[1]))
        if not is_upper_slave:
            scalars = record.summarise_iterations() | {
                "cone_error": record.largest_friction_law_violation()
            }
            scalars["balance_error"] = record.largest_force_imbalance()
            dofs = len(bodies.solution.x.array)
    scalars |= {"N": forces[0], "side_difference": abs(forces[1] / forces[0] - 1)}
    return make_dimensionless_result(scalars, {}, dofs)


def fit(element: str) -> Result:
    """Widen the hole of an incompressible tube until it presses on an outer tube (a press fit).

    Args:
        element: Name of a hybrid element such as "pw-hybrid-T6".
    """
    strips = [
        mesh_along_lines(
            MPI.COMM_SELF, _divide_interval(*radii, n), _divide_interval(0.0, 0.1, 1), "triangle"
        )
        for radii, n in zip(TUBE_RADII, (TUBE_CELLS, TUBE_CELLS - 2), strict=True)
    ]
    mesh, _ = join_lower_and_upper_mesh(*strips)
    tubes = make_element_spaces(element, mesh)
    solution, (v, q) = fem.Function(tubes.trial), ufl.TestFunctions(tubes.test)
    u, p = ufl.split(solution)
    r = ufl.SpatialCoordinate(mesh)[0]

    def axisymmetric_gradient(f: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        g = ufl.grad(f)
        rows = [[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, f[0] / r]]
        return ufl.as_matrix(rows)

    F = ufl.Identity(3) + axisymmetric_gradient(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    stress, lame = (
        F - inverse - p * J * inverse,
        first_lame_constant_over_shear_modulus(TUBE_POISSONS_RATIO),
    )
    density = ufl.inner(stress, axisymmetric_gradient(v)) - q * (J - 1 + p / lame)
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": FIT_QUADRATURE_DEGREE})
    residual = density * 2 * np.pi * r * dx
    axial, hole = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
    (inner_radius, contact_radius), (outer_tube_radius, _) = TUBE_RADII
    supports = [
        prescribe(tubes.trial, 1, lambda x: np.full(x.shape[1], True), axial),
        prescribe(tubes.trial, 0, lambda x: np.isclose(x[0], inner_radius), hole),
    ]

    def is_at_radius(radius: float, x: Array) -> Mask:
        return np.asarray(np.isclose(x[0], radius))

    master = DeformableSurface(partial(is_at_radius, outer_tube_radius), True)
    pair = ContactPair(partial(is_at_radius, contact_radius), master)
    problem = ContactProblem.of_residual(residual, solution, supports, pair)
    state, start, record = problem.undeformed, 0.0, SlidingHistory()
    for end in np.linspace(0.0, HOLE_RADIUS - inner_radius, 7)[1:]:

        def widen_hole(load_factor: float, start: float = start, end: float = float(end)) -> None:
            hole.value = (1 - load_factor) * start + load_factor * end

        state, start = problem.step(state, widen_hole), float(end)
        record.states.append(state)
    last = _only_pair_state(state)
    x = last.position + last.displacement
    radius = np.sqrt(contact_radius**2 + HOLE_RADIUS**2 - inner_radius**2)
    exact = _exact_press_fit_pressure(radius)
    pressure = last.force_normal.sum() / (2 * np.pi * radius * 0.1)
    imbalance = abs((last.force + last.opposite_force.sum(axis=0)) / pressure)
    scalars = {
        "pressure_error": abs(pressure / exact - 1),
        "radius_error": float(np.abs(x[:, 0] / radius - 1).max()),
        "pressure": exact,
        "interference": float(radius / outer_tube_radius - 1),
        "balance_error": float(imbalance.max()),
        "iterations_mean": float(np.mean([s.iterations for s in record.states])),
    }
    return make_dimensionless_result(scalars, {}, len(solution.x.array))


def _exact_press_fit_pressure(deformed_inner_radius: float) -> float:
    """Return the exact pressure that widens the incompressible outer tube, over the shear modulus.

    Args:
        deformed_inner_radius: Deformed inner radius of the outer tube.
    """
    inner, outer = TUBE_RADII[1]
    squared_increase = deformed_inner_radius**2 - inner**2

    def stress_difference_over_radius(r: float) -> float:
        stretch = r / np.sqrt(r**2 - squared_increase)
        return float((stretch**2 - stretch**-2) / r)

    deformed_outer = np.sqrt(outer**2 + squared_increase)
    return float(
        quad(stress_difference_over_radius, deformed_inner_radius, deformed_outer, epsabs=1e-13)[0]
    )


def _mesh_half_ring(angles: Array, radii: Array, is_upper: bool) -> Mesh:
    """Mesh the upper half of the lower ring, or the lower half of the upper ring.

    Args:
        angles: Angles of the mesh lines in radians, from 0 to pi.
        radii: Radii of the mesh lines.
        is_upper: Whether the ring is the upper one.
    """

    def bend_to_half_ring(x: Array) -> Array:
        sign = -1.0 if is_upper else 1.0
        y = sign * x[:, 1] * np.sin(x[:, 0])
        centre = 2 * RING_RADII[1] + RING_DISTANCE if is_upper else 0.0
        return np.column_stack([-sign * x[:, 1] * np.cos(x[:, 0]), centre + y, x[:, 2]])

    return _mesh_mapped_rectangle(angles, radii, bend_to_half_ring)


def _mesh_mapped_rectangle(x: Array, y: Array, map_nodes: Callable[[Array], Array]) -> Mesh:
    """Mesh a rectangle with quadratic triangles whose nodes are then mapped to other positions.

    Args:
        x: Coordinates of the vertical mesh lines.
        y: Coordinates of the horizontal mesh lines.
        map_nodes: Function from node positions (n, 3) to new positions (n, 3).
    """
    return curved_mesh(mesh_along_lines(MPI.COMM_SELF, x, y, "triangle"), map_nodes)


def _divide_interval(start: float, end: float, cells: int) -> Array:
    return np.linspace(start, end, cells + 1, dtype=np.float64)


def _rotation_matrix(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def _nodal_displacement(bodies: NeoHookeanBody, state: ContactState) -> Array:
    return np.asarray(state.displacement.array_r.reshape(-1, bodies.dim))


def _integrate_weight_functions_over_sides(
    bodies: NeoHookeanBody, slave_and_master_facets: Sequence[Indices]
) -> Array:
    """Integrate each node's test function over the undeformed contact sides.

    Args:
        bodies: Both bodies.
        slave_and_master_facets: Facets of the slave and of the master.

    Returns:
        Integrals (n,) of all nodes; one at nodes that lie on neither side.
    """
    make_spaces = Spaces.petrov_galerkin if bodies.element.startswith("pw") else Spaces.galerkin
    scalar_spaces = make_spaces(bodies.solution.function_space.mesh, 0)
    weight_area = np.ones(len(bodies.x))
    for side in slave_and_master_facets:
        surface = SurfaceNodes.from_scalar_spaces(scalar_spaces, side.astype(np.int32))
        weight_area[surface.node] = surface.weight_area
    return weight_area


def _measure_force_evenness_on_both_sides(
    bodies: NeoHookeanBody, states: Sequence[ContactState], weight_area: Array, name_suffix: str
) -> dict[str, float]:
    """Return median ratios of mid-side to corner forces per area, for slave and master.

    Args:
        bodies: Both bodies.
        states: States of the contact.
        weight_area: Areas (n,) by which the nodal forces are divided.
        name_suffix: Suffix of the names of the returned scalars.
    """
    on_slave, on_master = [], []
    for state in states:
        pair = _only_pair_state(state)
        order = np.argsort(bodies.x[pair.node, 0])
        node, force = pair.node[order], pair.force_normal[order]
        inner = np.flatnonzero(force > MIN_RELATIVE_SLAVE_FORCE * force.max())[
            N_END_NODES:-N_END_NODES
        ]
        on_slave.append(
            _median_midside_to_corner_ratio(bodies, node, force / weight_area[node], inner)
        )
        node, force = _master_nodes_and_normal_forces(bodies, state)
        force = force / weight_area[node]
        inner = np.flatnonzero(force > MIN_RELATIVE_MASTER_FORCE * force.max())
        on_master.append(_median_midside_to_corner_ratio(bodies, node, force, inner))
    return {
        f"mid_over_corner{name_suffix}": float(np.median(on_slave)),
        f"mid_over_corner{name_suffix}_master": float(np.median(on_master)),
    }


def _median_midside_to_corner_ratio(
    bodies: NeoHookeanBody, node: Indices, values: Array, inner_indices: Indices
) -> float:
    """Return the median ratio of a mid-side value to the mean of both adjacent corner values.

    Args:
        bodies: Both bodies.
        node: Nodes (m,) along a side.
        values: Values (m,) at these nodes.
        inner_indices: Indices into `node` of the nodes that are included.
    """
    midside = inner_indices[~bodies.is_vertex[node[inner_indices]]]
    return float(np.median(2 * values[midside] / (values[midside - 1] + values[midside + 1])))


def _master_nodes_and_normal_forces(
    bodies: NeoHookeanBody, state: ContactState
) -> tuple[Indices, Array]:
    """Return the ordered master nodes (k,) and their normal forces (k,), compression positive."""
    pair = _only_pair_state(state)
    order = np.argsort(bodies.x[pair.opposite_node, 0])
    node, force = pair.opposite_node[order], pair.opposite_force[order]
    x = bodies.x[node] + _nodal_displacement(bodies, state)[node]
    chord = np.gradient(x, axis=0)
    normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return node, np.sum(normal * force, axis=1)


def _largest_tension_over_compression(normal_force: Array) -> float:
    """Return the largest tensile nodal force over the largest compressive one."""
    return float(max(0.0, -normal_force.min() / normal_force.max()))


def measure_relative_moment(bodies: NeoHookeanBody, state: ContactState) -> float:
    """Return the resultant moment of all contact forces, over the sum of its parts' sizes."""
    pair = _only_pair_state(state)
    nodes = np.concatenate([pair.node, pair.opposite_node])
    force = np.concatenate([pair.force_vector, pair.opposite_force])
    x = (bodies.x + _nodal_displacement(bodies, state))[nodes]
    to_space = ((0, 0), (0, 3 - bodies.dim))
    moments = np.cross(np.pad(x - x.mean(axis=0), to_space), np.pad(force, to_space))
    sizes = np.linalg.norm(moments, axis=1).sum()
    return float(np.linalg.norm(moments.sum(axis=0)) / sizes)


def make_dimensionless_result(
    scalars: dict[str, float], curves: dict[str, Array], dofs: int
) -> Result:
    """Return a result of numbers without units."""
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), curves, dofs=dofs)
