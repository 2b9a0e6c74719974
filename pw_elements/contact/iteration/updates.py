"""Choice of the active sets of an increment.

In principle, the contact law determines the next active set, but the iteration must not cycle and
the tangent must not become singular. The module guarantees that decisions are the same on all
processes, and that a cycling iteration ends. It assumes that its functions are called on all
processes.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from hashlib import blake2b

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import MIN_DEGREES_BETWEEN_NORMALS, ContactInterface
from pw_elements.contact.iteration.increment import IncrementEquations
from pw_elements.contact.iteration.increment_data import NewtonIterate, TargetLoadsAndMotions
from pw_elements.contact.model import (
    ActiveSetCycling,
    ContactState,
    FreeBody,
    LastContactLost,
    NotUnique,
    SolutionNotFound,
)
from pw_elements.contact.nodes import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    ContactNodes,
    LinearisedKinematics,
    combine_active_sets,
    describe_status_counts,
    find_differing_nodes,
    is_same_set,
    linearise_friction_limits,
    make_sticking_active_set,
    rotate_active_set,
)
from pw_elements.contact.system import LinearSolveAccuracy

# Function that returns the names of the rigid motions that remain free. Its arguments are an active
# set and the frames (m, dim, dim) of the contact nodes
FreeRigidMotionDescriber = Callable[[ActiveSet, Array], list[str]]

# Number of decimal places in comparisons of the directions and slopes of active sets
_DECIMALS_IN_ACTIVE_SET_COMPARISON = 10
# Smallest number of returns to visited active sets at which the iteration counts as cycling;
# largest relative change of displacements at which the equations of a set count as solved; and
# largest number of iterations for which a set is kept
_MIN_ACTIVE_SET_REVISITS_OF_CYCLING = 4
_MAX_RELATIVE_DISPLACEMENT_CHANGE_IF_SOLVED = 1e-6
_MAX_ITERATIONS_WITH_KEPT_SET = 6
# Number of shortened Newton steps after which the iteration ends in contact of two bodies
_MAX_SHORTENED_NEWTON_STEPS = 3
# Number of recent active sets that are searched for a cycle
_N_RECENT_SETS_IN_CYCLE_MESSAGE = 8
_NO_VALID_ACTIVE_SET_MESSAGE = "no active set satisfies the contact conditions"
_DEPENDENT_NORMALS_MESSAGE = (
    "contact nodes at {} are pressed by surfaces of several pairs, and one of their normals is "
    f"within {MIN_DEGREES_BETWEEN_NORMALS:g} degree of the span of the others: how they share the "
    "force is not determined; let each of these nodes belong to fewer pairs"
)
# Fraction of the largest violation above which the violation of a node counts as the largest
_MIN_VIOLATION_RATIO_OF_WORST_NODES = 1 - 1e-6
# Largest gap that counts as closed in the first active set, relative to the extent of the contact
# nodes
_MAX_TOUCHING_GAP_PER_EXTENT = 1e-9


class ActiveSetHistory:
    """Record of active sets at large strains, for the detection of cycles.

    At large strains the equations of an active set are nonlinear. If the active set changes in each
    iteration, Newton's method may cycle through a few sets although one of them has a solution,
    because it leaves each set before the equations are solved.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: set[bytes] = set()
        self._last_key, self._n_returns, self._n_kept = b"", 0, 0
        self._recent: deque[tuple[bytes, ActiveSet]] = deque(maxlen=_N_RECENT_SETS_IN_CYCLE_MESSAGE)

    def record_and_decide_to_keep_set(
        self, active: ActiveSet, relative_displacement_change: float
    ) -> bool:
        """Record the active set of an iteration; return whether the next iteration keeps it.

        Args:
            active: active set of the iteration.
            relative_displacement_change: largest change of a displacement in the iteration, divided
                by the largest displacement.
        """
        key = _hash_arrays_of_all_ranks(self._comm, active.status, np.round(active.direction))
        if key != self._last_key:
            self._recent.append((key, active))
            self._n_returns += key in self._visited
            self._visited.add(key)
            self._last_key, self._n_kept = key, 0
        self._n_kept += 1
        is_solved = relative_displacement_change <= _MAX_RELATIVE_DISPLACEMENT_CHANGE_IF_SOLVED
        return self.is_cycle and not is_solved and self._n_kept < _MAX_ITERATIONS_WITH_KEPT_SET

    @property
    def is_cycle(self) -> bool:
        """Whether visited active sets have come back often enough to count as a cycle."""
        return self._n_returns >= _MIN_ACTIVE_SET_REVISITS_OF_CYCLING

    def make_error_naming_cycling_nodes(
        self, message: str, interface: ContactInterface
    ) -> SolutionNotFound:
        """Return an error; if active sets cycle, its message gives positions of cycling nodes."""
        if not self.is_cycle:
            return SolutionNotFound(message)
        changing = np.zeros(len(interface.pair), dtype=bool)
        latest = self._recent[-1][1]
        for _, active in self._recent:
            changing |= active.status != latest.status
            changing |= (np.round(active.direction) != np.round(latest.direction)).any(axis=1)
        positions = interface.gather_values(interface.position[changing])
        n_sets = len({key for key, _ in self._recent})
        return ActiveSetCycling.with_positions(
            f"{message}: {n_sets} active sets recur, which differ at {len(positions)} of the "
            "nodes, at {}, and the law holds in none of them",
            positions,
        )


class ActiveSetUpdate:
    """Rule that chooses the next active set from the contact law.

    The rule prevents singular tangents, and detects and ends cycles. Of the nodes that have taken
    part in a cycle, only one changes its status in each iteration. These nodes are called limited.

    Args:
        free_motions: function that returns the names of the rigid motions that remain free for an
            active set.
        interface: contact points of all pairs.
        accuracy: accuracy of all linear solutions except the last one.
    """

    def __init__(
        self,
        free_motions: FreeRigidMotionDescriber,
        interface: ContactInterface,
        accuracy: LinearSolveAccuracy = "rough",
    ) -> None:
        self._interface, self._comm = interface, interface.comm
        self._free_motions, self.accuracy = free_motions, accuracy
        self._visited: list[tuple[bytes, ActiveSet]] = []
        self._limited: Mask | None = None
        self._keeps_forces = interface.shared_nodes.exist and self._comm.allreduce(
            _has_shared_nodes_that_keep_forces(interface), MPI.LOR
        )

    def restart_record_with_first_set(
        self,
        active: ActiveSet,
        increment: IncrementEquations,  # noqa: ARG002
    ) -> None:
        """Clear the record of visited sets and record the first active set of an increment."""
        self._visited, self._limited = [], None
        self.record_set_and_limit_cycling_nodes(active)

    def record_set_and_limit_cycling_nodes(self, active: ActiveSet) -> bool:
        """Record an active set; return whether it was visited before.

        If it was, the nodes that change in the cycle are limited to one change per iteration.

        Raises:
            SolutionNotFound: if all nodes of the cycle are already limited.
        """
        vectors = [
            np.round(v, _DECIMALS_IN_ACTIVE_SET_COMPARISON)
            for v in (active.direction, active.friction_ratio, active.limit_slope)
        ]
        if (law := active.interface_law) is not None:
            vectors += [law.intercept, law.by_motion, law.by_force]
        key = _hash_arrays_of_all_ranks(
            self._comm, active.status, *vectors, active.support_friction
        )
        keys = [visited_key for visited_key, _ in self._visited]
        self._visited.append((key, active))
        if key not in keys:
            return False
        cycle = [visited_set for _, visited_set in self._visited[keys.index(key) :]]
        cycling = np.zeros(len(active.status), dtype=bool)
        for visited in cycle:
            cycling |= find_differing_nodes(visited, active)
        if self._limited is None:
            self._limited = np.zeros_like(cycling)
        n_new = self._comm.allreduce(int(np.sum(cycling & ~self._limited)), MPI.SUM)
        if n_new == 0:
            raise SolutionNotFound(
                f"the iteration runs through the same {len(cycle) - 1} active sets again, even "
                "though only one of the cycling nodes changes in each iteration"
            )
        self._limited |= cycling
        self._visited.clear()
        return True

    def propose_set_changing_one_cycling_node(
        self, active: ActiveSet, nodes: ContactNodes
    ) -> ActiveSet:
        """Return the next active set, in which only one of the limited nodes changes.

        The limited node that changes is the one with the largest violation of the law.
        """
        proposed = nodes.next_active_set(active)
        if self._limited is None:
            return proposed
        violation = np.where(self._limited, np.linalg.norm(nodes.law_violation(), axis=1), 0.0)
        worst = self._comm.allreduce(violation.max(initial=0.0), MPI.MAX)
        return combine_active_sets(
            self._limited & (violation < worst * _MIN_VIOLATION_RATIO_OF_WORST_NODES),
            active,
            proposed,
        )

    def choose_next_set_and_accuracy(
        self, active: ActiveSet, kinematics: LinearisedKinematics, state: NewtonIterate
    ) -> tuple[ActiveSet, LinearSolveAccuracy]:
        """Return the next active set and the accuracy of its linear solution.

        Args:
            active: active set of the iteration, in the frames of the kinematics.
            kinematics: kinematics of the linear system that was solved.
            state: solution of the linear system.

        Raises:
            SolutionNotFound: if the active sets cycle.
            LastContactLost: if the next active set leaves a rigid motion free.
        """
        if state.violation <= 1:
            return active, "tightened"  # the linear system was not solved to the final accuracy
        active = self._rotate_set_to_new_frames_and_clear_record(active, kinematics, state)
        return self._propose_next_set_and_accuracy(active, state)

    def make_iteration_limit_error(self, max_iterations: int) -> SolutionNotFound:
        """Return the error for an iteration without a solution after `max_iterations`."""
        return SolutionNotFound(_format_iteration_limit_message(max_iterations))

    def _rotate_set_to_new_frames_and_clear_record(
        self, active: ActiveSet, kinematics: LinearisedKinematics, state: NewtonIterate
    ) -> ActiveSet:
        """Return the active set in the frames of a new iterate.

        If the iterate has new kinematics, the record of visited sets is cleared.
        """
        if state.kinematics is kinematics:
            return active
        self._visited, self._limited = [], None
        return rotate_active_set(active, kinematics.frame, state.kinematics.frame)

    def _propose_next_set_and_accuracy(
        self, active: ActiveSet, state: NewtonIterate
    ) -> tuple[ActiveSet, LinearSolveAccuracy]:
        proposed = self._propose_set_that_holds_body(active, state.nodes)
        if not state.is_exact and is_same_set(proposed, active, self._comm):
            return active, "tightened"  # corrected factors may leave small gaps
        if self._keeps_forces and is_same_set(proposed, active, self._comm):
            # the forces that are kept have changed, and with them the equations of laws
            return replace(active, interface_law=proposed.interface_law), self.accuracy
        if self.record_set_and_limit_cycling_nodes(proposed):
            proposed = self._propose_set_that_holds_body(active, state.nodes)
        return proposed, self.accuracy

    def _propose_set_that_holds_body(self, active: ActiveSet, nodes: ContactNodes) -> ActiveSet:
        proposed = self._postpone_releases_that_free_body(
            self.propose_set_changing_one_cycling_node(active, nodes), active, nodes
        )
        if not self._interface.shared_nodes.exist:
            return proposed
        independent = open_points_with_dependent_normals(
            self._interface, proposed, nodes.frame[:, 0], nodes.trial_pressure
        )
        is_opened = independent.status != proposed.status
        positions = self._interface.gather_values(self._interface.position[is_opened])
        if len(positions) and is_same_set(independent, active, self._comm):
            raise SolutionNotFound.with_positions(_DEPENDENT_NORMALS_MESSAGE, positions)
        return independent

    def _postpone_releases_that_free_body(
        self, proposed: ActiveSet, active: ActiveSet, nodes: ContactNodes
    ) -> ActiveSet:
        """Return the proposed set without status changes that would make the tangent singular.

        A node is released if it opens or starts to slip. If the proposed set leaves a rigid motion
        free, the releases with the smallest violations of the law are postponed. The number of
        remaining releases is halved until no rigid motion is free.

        Args:
            proposed: active set that the law proposes.
            active: active set of the iteration.
            nodes: contact nodes with their gaps, slips and forces.

        Raises:
            LastContactLost: if a rigid motion is free although only the node with the largest
                violation is released.
        """
        releases = (proposed.status != active.status) & (active.status != OPEN)
        releases &= proposed.status != STICK
        # in three dimensions, a slipping node holds the body perpendicular to the direction of slip
        is_spatial = proposed.direction.shape[1] > 1
        if not is_spatial and not self._comm.allreduce(int(np.any(releases)), MPI.MAX):
            return proposed
        motions = self._free_motions(proposed, nodes.frame)
        if not motions:
            return proposed
        violation = np.linalg.norm(nodes.law_violation(), axis=1)
        ranked = np.sort(np.concatenate(self._comm.allgather(violation[releases])))[::-1]
        n_released = len(ranked) // 2
        while n_released > 0:
            is_kept = releases & (violation < ranked[n_released - 1])
            candidate = combine_active_sets(is_kept, active, proposed)
            if not self._free_motions(candidate, nodes.frame):
                return candidate
            n_released //= 2
        raise LastContactLost(
            f"{' and '.join(motions)}: not held once the nodes in tension are open and the nodes "
            "beyond the friction limit slip "
            f"({describe_status_counts(proposed, self._comm)})"
        )


class LargeStrainActiveSetUpdate(ActiveSetUpdate):
    """Rule that chooses the next active set at large strains.

    Each iteration has new linearised kinematics. For two bodies, an iteration ends early if its
    active sets cycle, or if several Newton steps had to be shortened because they inverted cells:
    smaller substeps then cost less than further iterations.

    Args:
        interface: contact points of all pairs.
    """

    keeps_cycling_sets = False

    def __init__(self, interface: ContactInterface) -> None:
        super().__init__(report_no_free_motions, interface)
        self._ends_early = bool(interface.mortars)

    def restart_record_with_first_set(
        self, active: ActiveSet, increment: IncrementEquations
    ) -> None:
        """Clear the record of visited sets and record the first active set of an increment."""
        super().restart_record_with_first_set(active, increment)
        self._history, self._n_shortened_steps = ActiveSetHistory(self._comm), 0
        self._displacement = increment.start.displacement

    def make_iteration_limit_error(self, max_iterations: int) -> SolutionNotFound:
        """Return the error for too many iterations, with positions of any cycling nodes."""
        return self._history.make_error_naming_cycling_nodes(
            _format_iteration_limit_message(max_iterations), self._interface
        )

    def _propose_next_set_and_accuracy(
        self, active: ActiveSet, state: NewtonIterate
    ) -> tuple[ActiveSet, LinearSolveAccuracy]:
        change = self._nonnegative_max_over_ranks(np.abs(state.displacement - self._displacement))
        self._displacement = state.displacement
        relative_change = change / (
            self._nonnegative_max_over_ranks(np.abs(state.displacement)) or 1.0
        )
        is_kept = self._history.record_and_decide_to_keep_set(active, relative_change)
        if self._ends_early:
            self._raise_if_cycling_or_steps_often_shortened(state)
        if self.keeps_cycling_sets and is_kept:
            return active, self.accuracy
        return super()._propose_next_set_and_accuracy(active, state)

    def _raise_if_cycling_or_steps_often_shortened(self, state: NewtonIterate) -> None:
        """Raise SolutionNotFound if sets cycle or too many Newton steps have been shortened."""
        self._n_shortened_steps += state.step_length < 1
        if self._n_shortened_steps >= _MAX_SHORTENED_NEWTON_STEPS:
            raise SolutionNotFound(
                f"{self._n_shortened_steps} Newton steps would have inverted cells and were "
                "shortened"
            )
        if self._history.is_cycle and not self.keeps_cycling_sets:
            raise self._history.make_error_naming_cycling_nodes(
                _NO_VALID_ACTIVE_SET_MESSAGE, self._interface
            )

    def _nonnegative_max_over_ranks(self, values: Array) -> float:
        return float(self._comm.allreduce(values.max(initial=0.0), MPI.MAX))


class UpdateKeepingCyclingSetsUntilSolved(LargeStrainActiveSetUpdate):
    """Rule that, once active sets cycle, keeps each set until its nonlinear equations are solved.

    A set is kept for at most `_MAX_ITERATIONS_WITH_KEPT_SET` iterations.
    """

    keeps_cycling_sets = True


def report_no_free_motions(active: ActiveSet, frame: Array) -> list[str]:  # noqa: ARG001
    """Return an empty list instead of the names of free rigid motions.

    At large strains, free rigid motions are not determined. In increments with springs at the
    contact nodes, the springs hold all rigid motions.
    """
    return []


def _format_iteration_limit_message(max_iterations: int) -> str:
    return f"{_NO_VALID_ACTIVE_SET_MESSAGE} after {max_iterations} iterations (max_iterations)"


def _hash_arrays_of_all_ranks(comm: MPI.Comm, *arrays: npt.NDArray) -> bytes:
    """Return a hash of the arrays of all processes; collective.

    The values -0.0 and 0.0 give the same hash.
    """
    digest = blake2b(digest_size=16)
    for values in arrays:
        digest.update((values + np.zeros(1, values.dtype)).tobytes())
    return b"".join(comm.allgather(digest.digest()))


def choose_first_active_set(
    interface: ContactInterface,
    kinematics: LinearisedKinematics,
    start_state: ContactState,
    describe_free_rigid_motions: FreeRigidMotionDescriber,
    target: TargetLoadsAndMotions,
) -> ActiveSet:
    """Return the first active set of an increment.

    It is the final set of the previous state or, if the previous state is undeformed, the set of
    touching nodes. If this set does not hold the body, all nodes that face a surface stick. In the
    pairs of surfaces that are free to move without a prescribed force, the touching nodes are
    closed, whatever the previous state.

    Args:
        interface: contact points of all pairs.
        kinematics: kinematics linearised at the initial iterate.
        start_state: contact state at the start of the increment.
        describe_free_rigid_motions: function that returns the names of the rigid motions that
            remain free for an active set.
        target: loads and motions at the end of the increment.

    Raises:
        FreeBody: if a rigid motion remains free even with all nodes that face a surface sticking.
    """
    if start_state.increment:
        candidates = [recover_active_set_of_state(interface, kinematics, start_state)]
    else:
        candidates = [_close_touching_and_nearest_nodes(interface, kinematics)]
    if start_state.increment and target.unloaded_free_surfaces.any():
        (resumed,), is_unloaded = candidates, target.unloaded_free_surfaces[interface.pair]
        touching = _close_touching_and_nearest_nodes(interface, kinematics)
        slipping_status = np.where(touching.status == STICK, SLIP, touching.status)
        slipping = replace(touching, status=slipping_status.astype(np.int8))
        candidates = [
            combine_active_sets(is_unloaded, candidate, resumed)
            for candidate in (slipping, touching)
        ]
    n_tangents = kinematics.frame.shape[1] - 1
    all_stick = make_sticking_active_set(np.isfinite(kinematics.gap), interface.cone, n_tangents)
    for candidate in (*candidates, all_stick):
        candidate = open_points_with_dependent_normals(
            interface, candidate, kinematics.frame[:, 0], -kinematics.gap
        )
        motions = describe_free_rigid_motions(candidate, kinematics.frame)
        if not motions:
            return candidate
    remedies = _list_remedies_for_free_rigid_motions(
        interface, kinematics, describe_free_rigid_motions, bool(target.free_motions)
    )
    raise FreeBody(
        f"{' and '.join(motions)}: held neither by supports nor by contact, even if all contact "
        f"nodes touched and stuck where there is friction; {', or '.join(remedies)}"
    )


def open_points_with_dependent_normals(
    interface: ContactInterface, active: ActiveSet, normal: Array, priority: Array
) -> ActiveSet:
    """Return the active set without closed points that would make the tangent singular.

    At a node that belongs to several pairs, closed points with linearly dependent normals would
    share the force in an undetermined way. Of these points, those with the lowest priority open.
    Points with an interface law do not count: their equations determine the force in any case.

    Args:
        interface: contact points of all pairs.
        active: active set.
        normal: normals (m, dim).
        priority: priorities (m,) of the points.
    """
    if not interface.shared_nodes.exist:
        return active
    closed = active.status != OPEN
    if interface.laws is not None:
        closed &= ~interface.laws.has_law
    dependent = interface.shared_nodes.find_dependent_points(closed, normal, priority)
    if not dependent.any():
        return active
    all_open = make_sticking_active_set(
        np.zeros_like(dependent), interface.cone, active.direction.shape[1]
    )
    return combine_active_sets(dependent, all_open, active)


def raise_if_force_shares_are_not_unique(
    interface: ContactInterface, nodes: ContactNodes, force_tolerance: float
) -> None:
    """Raise NotUnique if pressed nodes touch surfaces with linearly dependent normals; collective.

    Args:
        interface: contact points of all pairs.
        nodes: contact nodes of a solution.
        force_tolerance: largest force, and product of a gap and the stiffness of the law, that
            counts as zero.
    """
    if not interface.shared_nodes.exist:
        return
    touches = nodes.find_touching_points(force_tolerance)
    is_pressed = nodes.force[:, 0] > force_tolerance
    for points in interface.shared_nodes.points_of_each_node:
        touches[points] &= is_pressed[points].any()
    dependent = interface.shared_nodes.find_dependent_points(
        touches, nodes.frame[:, 0], nodes.trial_pressure
    )
    positions = interface.gather_values(interface.position[dependent])
    if len(positions):
        raise NotUnique.with_positions(_DEPENDENT_NORMALS_MESSAGE, positions)


def _list_remedies_for_free_rigid_motions(
    interface: ContactInterface,
    kinematics: LinearisedKinematics,
    describe_free_rigid_motions: FreeRigidMotionDescriber,
    has_free_surfaces: bool,
) -> list[str]:
    """Return advice to a user whose body moves freely although all its nodes are closed.

    Friction is proposed only if no motion were free with friction in the named pairs. The call is
    collective.

    Args:
        interface: contact points of all pairs.
        kinematics: kinematics linearised at the initial iterate.
        describe_free_rigid_motions: function that returns the names of the rigid motions that
            remain free for an active set.
        has_free_surfaces: whether a translation of a surface is free.
    """
    faces_surface, cone = np.isfinite(kinematics.gap), interface.cone
    numbers_by_kind = [
        [
            k
            for k in range(interface.pairs)
            if interface.comm.allreduce(bool(np.any(mask & (interface.pair == k))), MPI.LOR)
        ]
        for mask in (faces_surface, faces_surface & ~cone.has_friction)
    ]
    facing_pairs, smooth_pairs = numbers_by_kind
    remedies = ["hold it by a support, whose reaction is zero unless the loads drive the motion"]
    if has_free_surfaces:
        remedies.append("prescribe the translation of a surface that is free")
    if smooth_pairs:
        all_stick = make_sticking_active_set(faces_surface, cone, kinematics.frame.shape[1] - 1)
        status = np.where(faces_surface, STICK, OPEN).astype(np.int8)
        if not describe_free_rigid_motions(replace(all_stick, status=status), kinematics.frame):
            remedies.append(
                f"give contact pair {' and '.join(map(str, smooth_pairs))} friction, which acts "
                "only under pressure"
            )
    missing_pairs = sorted(set(range(interface.pairs)) - set(facing_pairs))
    if missing_pairs:
        remedies.append(
            f"give contact pair {' and '.join(map(str, missing_pairs))} nodes that face its "
            "surface, as none of them does"
        )
    return remedies


def close_nearest_nodes_of_free_surfaces(
    interface: ContactInterface, gap: Array, is_closed: Mask, is_free: Mask
) -> Mask:
    """Return the mask (m,) of closed points in which each free surface touches a node; collective.

    The force balance of a surface that is free to move has no unknown unless a node of its pair is
    closed. In pairs without a closed point, the nearest nodes are closed.

    Args:
        interface: contact points of all pairs.
        gap: (m,), gaps.
        is_closed: (m,), mask of the closed points.
        is_free: (pairs,), mask of the surfaces that are free to move.
    """
    n_closed = np.bincount(interface.pair[is_closed], minlength=interface.pairs)
    interface.comm.Allreduce(MPI.IN_PLACE, n_closed, MPI.SUM)
    is_alone = is_free & (n_closed == 0)
    return is_closed | (is_alone[interface.pair] & _find_nearest_nodes(interface, gap))


def _find_nearest_nodes(interface: ContactInterface, gap: Array) -> Mask:
    """Return a mask (m,) of the nodes with the smallest gap in each pair; collective."""
    tolerance = _MAX_TOUCHING_GAP_PER_EXTENT * interface.max_extent_of_points
    is_nearest = np.zeros(len(gap), dtype=bool)
    for k in range(interface.pairs):
        in_pair = interface.pair == k
        min_gap = interface.comm.allreduce(gap[in_pair].min(initial=np.inf), MPI.MIN)
        is_nearest |= in_pair & np.isfinite(gap) & (gap <= min_gap + tolerance)
    return is_nearest


def _close_touching_and_nearest_nodes(
    interface: ContactInterface, kinematics: LinearisedKinematics
) -> ActiveSet:
    """Return the active set in which touching nodes are closed.

    In each pair, at least the node nearest to the surface is closed.
    """
    closed = kinematics.gap <= _MAX_TOUCHING_GAP_PER_EXTENT * interface.max_extent_of_points
    closed |= _find_nearest_nodes(interface, kinematics.gap)
    return make_sticking_active_set(closed, interface.cone, kinematics.frame.shape[1] - 1)


def recover_active_set_of_state(
    interface: ContactInterface, kinematics: LinearisedKinematics, state: ContactState
) -> ActiveSet:
    """Return the active set of a state in the frames of the given kinematics."""
    status, friction_ratio, force_normal, *vectors = interface.extract_local_pair_state_values(
        state.pairs, "status", "friction_ratio", "force_normal", "direction", "force_tangential"
    )
    direction, friction = (
        np.einsum("nab,nb->na", kinematics.frame[:, 1:], vector) for vector in vectors
    )
    pressure = np.maximum(0.0, force_normal)
    limits = interface.cone.friction_limits_and_slopes(pressure)
    slope, intercept = linearise_friction_limits(pressure, limits, direction)
    return ActiveSet(
        np.where(status == HELD, STICK, status).astype(np.int8),
        direction,
        friction_ratio,
        slope,
        intercept,
        friction_per_slip=np.zeros_like(friction_ratio),
        support_friction=np.where(kinematics.held_tangents, friction, 0.0),
        support_slip=np.zeros_like(direction),
    )


def _has_shared_nodes_that_keep_forces(interface: ContactInterface) -> bool:
    """Return whether nodes of this process in several pairs have friction or interface laws."""
    may_keep = interface.cone.has_friction
    if interface.laws is not None:
        may_keep = may_keep | interface.laws.has_law
    return bool(np.any(interface.shared_nodes.is_shared & may_keep))
