"""Refuse an increment whose iteration has failed, with a proof or the likely reason.

Statics alone may prove that no contact forces balance the loads. The proof is a rigid motion in
which the loads do work and v_n >= mu |v_t| at every node that a surface faces. Here v_n and v_t are
the normal and tangential velocities of the node, and mu is the slope of its friction limit. A
linear program searches for the motion; docs/theory.md has the argument ("Where the iteration
fails").

The module guarantees that each proof is checked by direct evaluation, and that errors are the same
on all processes. It assumes an increment at small strains. Only contact nodes are gathered, and the
linear program runs on one process. It takes 3 seconds for 10 000 nodes in three dimensions, and 0.2
seconds in two dimensions.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import scipy  # loads scipy.optimize when it is first used

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import format_points, raise_errors_on_all_processes
from pw_elements.contact.iteration import (
    IncrementEquations,
    NewtonIterate,
    make_contact_state,
)
from pw_elements.contact.model import (
    ContactFailed,
    ContactState,
    LastContactLost,
    LoadMissingForEquilibrium,
    NoEquilibrium,
    NotUnique,
    RigidVelocity,
    SmallDisplacementMeasures,
    SolutionNotFound,
    describe_exhausted_friction,
)
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    LinearisedKinematics,
)
from pw_elements.contact.rescue.rigid import (
    NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO,
    RigidModes,
    RigidMotionBasis,
    RigidMotions,
    format_direction,
)
from pw_elements.contact.system import SolveCountAndReport
from pw_elements.solvers import NotConverged, group_connected_nodes

LOOSE_BODY_MESSAGE = (
    "the loads are balanced without any contact force, and the body is loose: it is in equilibrium "
    "wherever nothing touches it; a support, or a load that presses it against a surface, makes "
    "its position unique"
)

# Largest work of the loads that counts as zero, divided by the sum of the magnitudes of its parts
_NEGLIGIBLE_TO_ABSOLUTE_WORK_RATIO = 1e-9
# Largest ratio of contact forces to loads that is considered where a motion violates the condition
# of a friction cone by round-off
_MAX_CONTACT_FORCE_TO_LOAD_RATIO = 1e3
# Smallest violation of a friction cone that requires a cut in the linear program
_MAX_CONE_VIOLATION_WITHOUT_CUTTING_PLANE = 1e-10
_MAX_CUTTING_PLANE_ROUNDS = 40
# Cost of motion in the linear program, relative to the largest power. It prevents motions in which
# the loads do no work
_MOTION_COST_PER_MAX_POWER = 1e-7
# Distances along a free translation at which normals are evaluated, relative to the extent of the
# contact nodes; and largest change of a normal that counts as zero
_NORMAL_PROBE_STEPS_PER_EXTENT = (1e-4, 1e-2, 1.0)
_NEGLIGIBLE_NORMAL_CHANGE = 1e-9
_HIGHS_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}

_ENCLOSED_INCOMPRESSIBLE_BODY_MESSAGE = (
    "Supports and contact enclose an incompressible body: its volume cannot change and its "
    "pressure is not determined; leave a part of its surface free, or use nu below 1/2"
)


@dataclass(frozen=True)
class NodeVelocitiesInRigidMotions:
    """Velocities of contact nodes in k rigid motions.

    The m nodes are all nodes, on any process, that face a surface or may face one after a free
    translation.

    Args:
        pair: number (m,) of the contact pair of each node.
        friction_slope: slope (m,) of the friction limit at zero normal force.
        has_turning_normal: whether the normal of each node (m,) changes with a free translation.
        normal: normal velocity (m, k).
        tangential: tangential velocity (m, dim, k) in global components.
    """

    pair: Indices
    friction_slope: Array
    has_turning_normal: Mask
    normal: Array
    tangential: Array

    def group_coupled_motions(self) -> list[Indices]:
        """Return the groups of motions that are coupled because they move the same nodes."""
        is_moved = self._mask_of_nodes_moved_by_motions().astype(float)
        return group_connected_nodes(is_moved.T @ is_moved > 0)

    def restrict_to_motions(self, motions: Indices) -> "NodeVelocitiesInRigidMotions":
        """Return the nodes moved by any of the given motions, with velocities in these motions."""
        moved_nodes = self.select_nodes(
            np.any(self._mask_of_nodes_moved_by_motions()[:, motions], axis=1)
        )
        normal, tangential = moved_nodes.normal[:, motions], moved_nodes.tangential[..., motions]
        return replace(moved_nodes, normal=normal, tangential=tangential)

    def friction_cone_cut_rows(self, sliding_direction: Array) -> Array:
        """Return normalised rows (m, k) of the linear functions v_n - mu v_t·d of a motion.

        Here v_n and v_t are the normal and tangential velocities, and mu is the slope of the
        friction limit. Each row is divided by the length of the vector (1, mu).

        Args:
            sliding_direction: unit vector d (m, dim) at each node.
        """
        sliding = np.einsum("ma,mak->mk", sliding_direction, self.tangential)
        mu = self.friction_slope[:, None]
        return np.asarray((self.normal - mu * sliding) / np.sqrt(1 + mu**2))

    def friction_cone_margins(self, motion: Array) -> Array:
        """Return the normalised margin v_n - mu |v_t| of each node (m,) in a motion (k,).

        Here v_n and v_t are the normal and tangential velocities, and mu is the slope of the
        friction limit. The margin is divided by the length of the vector (1, mu). If it is not
        negative, no admissible contact force resists the motion.
        """
        sliding = np.linalg.norm(self.tangential @ motion, axis=1)
        margin = self.normal @ motion - self.friction_slope * sliding
        return np.asarray(margin / np.sqrt(1 + self.friction_slope**2))

    def select_nodes(self, mask: Mask) -> "NodeVelocitiesInRigidMotions":
        """Return a copy with the nodes at which a mask (m,) is True."""
        return NodeVelocitiesInRigidMotions(*(values[mask] for values in vars(self).values()))

    def _mask_of_nodes_moved_by_motions(self) -> Mask:
        """Return a mask (m, k) of the nodes that each motion moves."""
        return (self.normal != 0) | np.any(self.tangential != 0, axis=1)


def find_motion_proving_no_equilibrium(
    nodes: NodeVelocitiesInRigidMotions, load_power: Array, absolute_power: Array
) -> tuple[Array, Array] | None:
    """Return a motion which proves that there is no equilibrium, or None if none is found.

    In this motion, the loads do work that no contact forces can balance.

    Args:
        nodes: velocities of the contact nodes in each motion.
        load_power: work (k,) of the loads in each motion.
        absolute_power: sum (k,) of the magnitudes of the parts of the work in each motion.

    Returns:
        The motion (k,), and the smallest forces (k,) that would have to be added for equilibrium.
    """
    # the cost of motion hides work near the friction limit, and HiGHS sometimes fails with it
    for price in (_MOTION_COST_PER_MAX_POWER, 0.0):
        motion, missing = find_unresisted_motion_of_most_work(nodes, load_power, price)
        if does_motion_prove_no_equilibrium(nodes, load_power, absolute_power, motion):
            return motion, missing
    return None


def does_motion_prove_no_equilibrium(
    nodes: NodeVelocitiesInRigidMotions, load_power: Array, absolute_power: Array, motion: Array
) -> bool:
    """Return whether a motion (k,) proves that no contact forces balance the loads.

    The conditions are evaluated directly, without the linear program. If the motion violates the
    condition of a friction cone by round-off, large contact forces could balance the work of the
    loads. The work of the loads therefore has to exceed the work of contact forces that are
    `_MAX_CONTACT_FORCE_TO_LOAD_RATIO` times as large as the loads.

    Args:
        nodes: velocities of the contact nodes in each motion.
        load_power: work (k,) of the loads in each motion.
        absolute_power: sum (k,) of the magnitudes of the parts of the work in each motion.
        motion: factor (k,) of each motion.
    """
    violation = float(np.max(-nodes.friction_cone_margins(motion), initial=0.0))
    min_work = max(
        _NEGLIGIBLE_TO_ABSOLUTE_WORK_RATIO, _MAX_CONTACT_FORCE_TO_LOAD_RATIO * violation
    ) * float(absolute_power @ np.abs(motion))
    return bool(load_power @ motion > min_work)


def find_unresisted_motion_of_most_work(
    nodes: NodeVelocitiesInRigidMotions,
    load_power: Array,
    motion_cost: float = _MOTION_COST_PER_MAX_POWER,
) -> tuple[Array, Array]:
    """Return the motion in which the loads do the most work and no contact force resists.

    It is found by linear programs in which cutting planes approximate the friction cones.

    Args:
        nodes: velocities of the contact nodes in each motion.
        load_power: work (k,) of the loads in each motion.
        motion_cost: cost of motion, divided by the largest power.

    Returns:
        The motion (k,), with components of at most one, and the smallest forces (k,) that would
        have to be added for equilibrium. Both are zero if the linear program fails.
    """
    k, scale = len(load_power), np.abs(load_power).max() or 1.0
    # both directions of each motion
    costs = np.concatenate([-load_power, load_power]) / scale + motion_cost
    axes = np.eye(nodes.tangential.shape[1])
    rows = [nodes.friction_cone_cut_rows(np.tile(d, (len(nodes.pair), 1))) for d in (*axes, *-axes)]
    for _ in range(_MAX_CUTTING_PLANE_ROUNDS):
        cuts = np.unique(np.vstack(rows), axis=0)
        best = scipy.optimize.linprog(
            costs,
            A_ub=np.hstack([-cuts, cuts]),
            b_ub=np.zeros(len(cuts)),
            bounds=(0, 1),
            options=_HIGHS_TOLERANCES,
        )
        if not best.success:
            return np.zeros(k), np.zeros(k)
        motion = best.x[:k] - best.x[k:]
        violating = nodes.select_nodes(
            nodes.friction_cone_margins(motion) < -_MAX_CONE_VIOLATION_WITHOUT_CUTTING_PLANE
        )
        sliding: Array = violating.tangential @ motion
        speed = np.linalg.norm(sliding, axis=1, keepdims=True)
        if not speed.any():
            break
        is_sliding = speed[:, 0] > 0
        rows.append(
            violating.select_nodes(is_sliding).friction_cone_cut_rows((sliding / speed)[is_sliding])
        )
    multipliers = best.upper.marginals
    return motion, scale * (multipliers[:k] - multipliers[k:])


def gather_node_velocities(
    increment: IncrementEquations,
    kinematics: LinearisedKinematics,
    force_conjugate_velocities: Array,
) -> NodeVelocitiesInRigidMotions:
    """Return the velocities of the contact nodes of all processes in rigid motions; collective.

    The result does not depend on the number of processes.

    Args:
        increment: equations of the increment.
        kinematics: linearised kinematics, with the frames of the contact nodes.
        force_conjugate_velocities: velocities (m, dim, k) of the contact nodes of this process in
            each motion, with which contact forces do work.
    """
    interface, is_free = increment.interface, np.isnan(increment.prescribed_motions)
    is_faced = np.isfinite(kinematics.gap) | np.any(is_free, axis=1)[interface.pair]
    has_force = (interface.equation >= 0) | interface.held_components
    force_conjugate_velocities = np.where(has_force[..., None], force_conjugate_velocities, 0.0)
    tangents = kinematics.frame[:, 1:]
    values = (
        interface.pair,
        interface.cone.max_coefficient,
        _find_normals_turned_by_free_translation(increment, kinematics),
        np.einsum("na,nak->nk", kinematics.frame[:, 0], force_conjugate_velocities),
        np.einsum("nta,ntb,nbk->nak", tangents, tangents, force_conjugate_velocities),
        is_faced,
    )
    *fields, is_faced = (
        np.concatenate(
            [interface.gather_pair_in_position_order(k, part) for k in range(interface.pairs)]
        )
        for part in values
    )
    return NodeVelocitiesInRigidMotions(*fields).select_nodes(is_faced)


def _find_normals_turned_by_free_translation(
    increment: IncrementEquations, kinematics: LinearisedKinematics
) -> Mask:
    """Return a mask (m,) of nodes at which a free translation of the surface turns the normal."""
    interface, is_free = increment.interface, np.isnan(increment.prescribed_motions)
    normals = interface.evaluate_undeformed_normals(kinematics.q0)
    is_turning = np.zeros(len(interface.pair), dtype=bool)
    for axis in np.flatnonzero(is_free.any(axis=0)):
        for step in (
            sign * part * interface.max_extent_of_points
            for part in _NORMAL_PROBE_STEPS_PER_EXTENT
            for sign in (-1, 1)
        ):
            translations = kinematics.q0.copy()
            translations[is_free[:, axis], axis] += step
            try:
                change = np.abs(interface.evaluate_undeformed_normals(translations) - normals).max(
                    axis=1
                )
            except ValueError:  # the user's surface may have no normals so far away
                change = np.where(is_free[interface.pair, axis], np.inf, 0.0)
            is_turning |= ~(change <= _NEGLIGIBLE_NORMAL_CHANGE)
    return is_turning


def prove_no_equilibrium(
    increment: IncrementEquations,
    load: PETSc.Vec,
    kinematics: LinearisedKinematics,
    rigid: RigidMotions,
) -> NoEquilibrium | None:
    """Return an error if statics proves that no contact forces balance the loads, otherwise None.

    Args:
        increment: equations of the increment.
        load: load vector (n_r,), reduced by the supports.
        kinematics: linearised kinematics, with the frames of the contact nodes.
        rigid: rigid motions of the body and of free surfaces.
    """
    basis, works = rigid.find_motions_without_strain_work()
    work, size = rigid.compute_work_and_absolute_work_in_modes(load, increment.free_motion_forces)
    nodes = gather_node_velocities(increment, kinematics, works)
    error: NoEquilibrium | None = None
    comm = increment.system.comm
    with raise_errors_on_all_processes(comm):
        if comm.rank == 0:
            error = _prove_no_equilibrium_by_motion_groups(nodes, basis, work, size, rigid.modes)
    return comm.bcast(error)


def raise_if_body_is_loose(
    increment: IncrementEquations,
    end: NewtonIterate,
    rigid: RigidMotions,
    start_state: ContactState,
    measure_cost: Callable[[], SolveCountAndReport],
) -> None:
    """Raise NotUnique if a piece of the body is loose, without any contact force, in a solution.

    Args:
        increment: equations of the increment.
        end: solution of the increment.
        rigid: rigid motions of the body and of free surfaces.
        start_state: contact state at the start of the increment.
        measure_cost: function that returns the number of iterations and the solver report of the
            increment so far.
    """
    if not (motions := rigid.describe_unstopped_motion_of_loose_pieces(end.nodes, end.allowance)):
        return
    failure = NotUnique(f"{LOOSE_BODY_MESSAGE}. Nothing stops a {', '.join(motions)}")
    failure.state = _make_state_of_unsolved_iterate(increment, end, start_state, measure_cost())
    raise failure


def _make_state_of_unsolved_iterate(
    increment: IncrementEquations,
    state: NewtonIterate,
    start_state: ContactState,
    cost: SolveCountAndReport,
) -> ContactState:
    """Return the contact state of an iterate that is not a solution, with the cost so far."""
    iterations, report = cost
    scale, force, length = increment.updated_scale_and_reference_force_and_length(
        state, start_state.scale
    )
    residuals = increment.largest_residuals(state, force, length)
    unsolved = make_contact_state(
        increment,
        state,
        start_state,
        scale=scale,
        iterations=iterations,
        report=report,
        smallness=SmallDisplacementMeasures(np.nan, np.nan, np.nan),
    )
    return replace(unsolved, residuals=residuals, converged=False)


def rescue_increment(
    failure: ContactFailed | NotConverged,
    increment: IncrementEquations,
    try_proof: Callable[[], NoEquilibrium | None],
    solve_otherwise: Callable[[], NewtonIterate | None] | None,
    start_state: ContactState,
    measure_cost: Callable[[], SolveCountAndReport],
) -> NewtonIterate:
    """Return the solution of an increment whose iteration has failed, or raise an error.

    The other method is tried unless statics proves that there is no equilibrium, the linear solver
    has not converged, or the solution is known not to be unique.

    Args:
        failure: error of the iteration.
        increment: equations of the increment.
        try_proof: function that returns an error if it proves that there is no equilibrium.
        solve_otherwise: function that solves the increment by another method and returns None if it
            fails; None if no other method is available.
        start_state: contact state at the start of the increment.
        measure_cost: function that returns the number of iterations and the solver report of the
            increment so far.

    Raises:
        NoEquilibrium: if it is proved that there is no equilibrium.
        NotConverged: if the linear solver has not converged.
        NotUnique: if a solution has a singular tangent.
        SolutionNotFound: in all other cases; its `state` is the closest approximation found.
    """
    if proof := try_proof():
        raise proof from None
    if isinstance(failure, NotConverged):
        raise failure
    if solve_otherwise is not None and not isinstance(failure, NotUnique):
        try:
            solution = solve_otherwise()
        except NotUnique as unique:
            failure, solution = unique, None
        if solution is not None:
            return solution
    nearest, state = "", None
    if increment.best_state is not None:
        state = _make_state_of_unsolved_iterate(
            increment, increment.best_state, start_state, measure_cost()
        )
        violation = f"{increment.best_state.violation * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE:.1g}"
        nearest = (
            f" The state that came nearest violates the law by {violation} of its largest force."
        )
    if not isinstance(failure, NotUnique):
        enclosed = (
            f" {_ENCLOSED_INCOMPRESSIBLE_BODY_MESSAGE}."
            if increment.system.tangent.is_constant_pressure_held_by_contact_only()
            else ""
        )
        advice = "Smaller increments, or pressing before pushing, may find one"
        if state is not None and isinstance(failure, LastContactLost):
            advice = describe_exhausted_friction(state, start_state) or advice
        failure = SolutionNotFound(
            f"{failure}. This does not prove that there is no solution.{enclosed}{nearest} {advice}"
        )
    failure.state = state
    raise failure from None


def _prove_no_equilibrium_by_motion_groups(
    nodes: NodeVelocitiesInRigidMotions,
    basis: RigidMotionBasis,
    work: Array,
    absolute_work: Array,
    modes: RigidModes,
) -> NoEquilibrium | None:
    """Return one error with the proofs for all groups of motions, or None if there is no proof.

    Args:
        nodes: velocities of the contact nodes in the motions of the basis.
        basis: basis of the rigid motions.
        work: work (modes,) of the loads in each mode of rigid motion.
        absolute_work: sum (modes,) of the magnitudes of the parts of the work in each mode.
        modes: modes of rigid motion.
    """
    motion, missing, words = np.zeros(len(work)), np.zeros(len(work)), []
    for group in nodes.group_coupled_motions():
        moved_nodes, motions = nodes.restrict_to_motions(group), basis.motions[group]
        if moved_nodes.has_turning_normal.any():
            continue
        proof = find_motion_proving_no_equilibrium(
            moved_nodes, motions @ work, np.abs(motions) @ absolute_work
        )
        if proof is None:
            continue
        escape, lacking = proof
        motion += escape @ motions
        lacking[
            np.abs(lacking) <= NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO * np.abs(lacking).max()
        ] = 0.0
        missing[basis.pivot[group]] = lacking
        words.append(
            modes.describe_motion(escape @ motions)
            + _describe_sliding_and_lifting_pairs(moved_nodes, escape)
        )
    if not words:
        return None
    translation, rotation, surface = modes.split_into_pieces_and_surfaces(motion)
    force, moment, surface_force = modes.split_into_pieces_and_surfaces(missing)
    missing_force = LoadMissingForEquilibrium(force, moment * modes.length[:, None], surface_force)
    error = NoEquilibrium(
        f"no contact forces balance the loads: {'; '.join(words)}. At least "
        f"{_describe_missing_force(modes.centre, missing_force)} would have to be added to the "
        "loads"
    )
    error.velocity = RigidVelocity(
        modes.centre, translation, rotation / modes.length[:, None], surface, float(motion @ work)
    )
    error.missing = missing_force
    return error


def _describe_sliding_and_lifting_pairs(nodes: NodeVelocitiesInRigidMotions, motion: Array) -> str:
    """Return a text that names the pairs on which a body slides or lifts off in a motion (k,)."""
    sliding, margin = nodes.tangential @ motion, nodes.friction_cone_margins(motion)
    speed = np.linalg.norm(sliding, axis=1)
    negligible = NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO * max(
        speed.max(initial=0.0), margin.max(initial=0.0)
    )
    words = []
    for k in np.unique(nodes.pair):
        slides = (nodes.pair == k) & (margin <= negligible) & (speed > negligible)
        if slides.any():
            directions = sliding[slides] / speed[slides, None]
            is_common = np.all(
                directions @ directions[0] > 1 - NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO
            )
            direction = f"along {format_direction(directions[0])} " if is_common else ""
            words.append(f"slides {direction}on pair {k}")
        elif np.any(margin[nodes.pair == k] > negligible):
            words.append(f"lifts off pair {k}")
    return f", by which the body {' and '.join(words)}" if words else ""


def _describe_missing_force(centre: Array, missing: LoadMissingForEquilibrium) -> str:
    """Return a list, in words, of missing forces and of moments about centres (pieces, dim)."""
    words = []
    for k in range(len(centre)):
        location = format_points(centre[k : k + 1])
        body = f" on the body around {location}" if len(centre) > 1 else ""
        if missing.force[k].any():
            words.append(f"a force of {_format_vector(missing.force[k])}{body}")
        if missing.moment[k].any():
            words.append(f"a moment of {_format_vector(missing.moment[k])} about {location}{body}")
    for k in range(len(missing.surface)):
        if missing.surface[k].any():
            force = _format_vector(missing.surface[k])
            words.append(f"a force of {force} of the surface of pair {k}")
    return " and ".join(words)


def _format_vector(values: Array) -> str:
    components = ", ".join(f"{value:.4g}" for value in values)
    return f"({components})" if len(values) > 1 else components
