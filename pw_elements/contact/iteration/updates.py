"""The next active set: by the law, but kept from cycling and from losing a body's last hold.

The active set that an increment starts from is chosen here, too. The module guarantees that a set
is proposed on all processes alike, and that an iteration which runs through the same sets ends.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from hashlib import blake2b

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import Interface
from pw_elements.contact.iteration.increment import Increment, NewtonState
from pw_elements.contact.model import ContactState, Cycling, FreeBody, LastContactLost, NotFound
from pw_elements.contact.nodes import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    ContactNodes,
    LinearisedKinematics,
    count_statuses,
    find_differences,
    is_same_set,
    linearise_friction_limits,
    make_sticking_set,
    rotate_to_frames,
    select_nodes,
)
from pw_elements.contact.system import Accuracy

# Names of the rigid motions that an active set in frames (m, dim, dim) leaves free
FreeMotions = Callable[[ActiveSet, Array], list[str]]

# Decimals to which directions and slopes of active sets are compared
_DECIMALS = 10
# Returns to active sets that tell a cycle; change of displacements, over the largest, at which a
# set's equations are solved; and iterations for which a set is kept at most
_MIN_RETURNS_OF_CYCLE = 4
_MAX_CHANGE_OF_SOLVED = 1e-6
_MAX_ITERATIONS_OF_SET = 6
# Changes of the active set among which a cycle is looked for
_N_RECENT_SETS = 8
# Part of the largest violation from which on a node counts among the worst
_WORST = 1 - 1e-6
# A gap up to this part of the contact nodes' extent counts as closed where no active set is known
_TOUCHING_GAP = 1e-9


class CycleGuard:
    """Active sets visited, and nodes that change one at a time since they were caught cycling."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: list[tuple[bytes, ActiveSet]] = []
        self._limited: Mask | None = None

    def record_and_detect(self, active: ActiveSet) -> bool:
        """Record a set; return whether it was visited before, and more nodes are limited now.

        Raises:
            NotFound: if the cycle remains although its nodes change one at a time.
        """
        vectors = [np.round(v, _DECIMALS) for v in (active.direction, active.turning, active.slope)]
        key = _digest(self._comm, active.status, *vectors, active.support_friction)
        keys = [visited for visited, _ in self._visited]
        self._visited.append((key, active))
        if key not in keys:
            return False
        cycle = [visited for _, visited in self._visited[keys.index(key) :]]
        cycling = np.zeros(len(active.status), dtype=bool)
        for other in cycle:
            cycling |= find_differences(other, active)
        if self._limited is None:
            self._limited = np.zeros_like(cycling)
        n_new = self._comm.allreduce(int(np.sum(cycling & ~self._limited)), MPI.SUM)
        if n_new == 0:
            raise NotFound(
                f"the iteration runs through the same {len(cycle) - 1} active sets again, also "
                "when the nodes concerned change one at a time"
            )
        self._limited |= cycling
        self._visited.clear()
        return True

    def propose(self, active: ActiveSet, nodes: ContactNodes) -> ActiveSet:
        """Return the next active set, in which at most one of the limited nodes changes."""
        proposed = nodes.next_active_set(active)
        if self._limited is None:
            return proposed
        violation = np.where(self._limited, np.linalg.norm(nodes.violation(), axis=1), 0.0)
        worst = self._comm.allreduce(violation.max(initial=0.0), MPI.MAX)
        return select_nodes(self._limited & (violation < worst * _WORST), active, proposed)


class SetHistory:
    """Active sets of iterates whose equations are nonlinear, to tell cycles.

    Newton's method with sets that change in each iteration may run through a few of them for ever,
    though one of them has a solution: it is left before its equations are solved.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: set[bytes] = set()
        self._last, self._n_returns, self._n_kept = b"", 0, 0
        self._recent: deque[tuple[bytes, ActiveSet]] = deque(maxlen=_N_RECENT_SETS)

    def record_and_ask_to_keep(self, active: ActiveSet, change: float) -> bool:
        """Record a set that was solved for; return whether it should stay once more.

        Args:
            active: the set.
            change: of the displacements in this iteration, over the largest of them.
        """
        key = _digest(self._comm, active.status, np.round(active.direction))
        if key != self._last:
            self._recent.append((key, active))
            self._n_returns += key in self._visited
            self._visited.add(key)
            self._last, self._n_kept = key, 0
        self._n_kept += 1
        is_solved = change <= _MAX_CHANGE_OF_SOLVED
        return self._is_cycle and not is_solved and self._n_kept < _MAX_ITERATIONS_OF_SET

    @property
    def _is_cycle(self) -> bool:
        return self._n_returns >= _MIN_RETURNS_OF_CYCLE

    def make_error(self, message: str, interface: Interface) -> NotFound:
        """Return the error, with the nodes whose statuses change in turn if sets have come back."""
        if not self._is_cycle:
            return NotFound(message)
        changing = np.zeros(len(interface.pair), dtype=bool)
        last = self._recent[-1][1]
        for _, active in self._recent:
            changing |= active.status != last.status
            changing |= (np.round(active.direction) != np.round(last.direction)).any(axis=1)
        positions = interface.gathered(interface.position[changing])
        n_sets = len({key for key, _ in self._recent})
        return Cycling.with_positions(
            f"{message}: {n_sets} sets come back, which differ at {len(positions)} of the nodes, "
            "at {}, and the law holds in none of them",
            positions,
        )


class ActiveSetUpdate:
    """The next active set by the law, limited where it cycles and with a body's last hold kept.

    Args:
        free_motions: names the rigid motions that a set leaves free.
        interface: the contact points.
        accuracy: of linear solutions on the way.
    """

    def __init__(
        self, free_motions: FreeMotions, interface: Interface, accuracy: Accuracy = "rough"
    ) -> None:
        self._interface, self._comm = interface, interface.comm
        self._free_motions, self.accuracy = free_motions, accuracy
        self._cycles = CycleGuard(self._comm)

    def start(self, active: ActiveSet, increment: Increment) -> None:  # noqa: ARG002
        """Begin at a first active set of an increment."""
        self._cycles = CycleGuard(self._comm)
        self._cycles.record_and_detect(active)

    def advance(
        self, active: ActiveSet, kinematics: LinearisedKinematics, state: NewtonState
    ) -> tuple[ActiveSet, Accuracy]:
        """Return the set that follows one and its solution, and how exactly to solve it.

        Args:
            active: the set, in the frames of the kinematics.
            kinematics: for which it was solved.
            state: its solution.

        Raises:
            NotFound: for sets that come back.
            LastContactLost: for a set that would let a body go.
        """
        if state.violation <= 1:
            return active, "tightened"  # equilibrium may lag behind
        active = self._enter_frames(active, kinematics, state)
        return self._follow(active, state)

    def make_error(self, max_iterations: int) -> NotFound:
        """Return the error for an iteration that has not found a solution."""
        return NotFound(_not_found(max_iterations))

    def _enter_frames(
        self, active: ActiveSet, kinematics: LinearisedKinematics, state: NewtonState
    ) -> ActiveSet:
        """Return the set in the frames of a state; a new linearisation forgets visited sets."""
        if state.kinematics is kinematics:
            return active
        self._cycles = CycleGuard(self._comm)
        return rotate_to_frames(active, kinematics.frame, state.kinematics.frame)

    def _follow(self, active: ActiveSet, state: NewtonState) -> tuple[ActiveSet, Accuracy]:
        proposed = self._propose(active, state.nodes)
        if not state.is_exact and is_same_set(proposed, active, self._comm):
            return active, "tightened"  # corrected factors leave single gaps open
        if self._cycles.record_and_detect(proposed):
            proposed = self._propose(active, state.nodes)
        return proposed, self.accuracy

    def _propose(self, active: ActiveSet, nodes: ContactNodes) -> ActiveSet:
        return self._prevent_release(self._cycles.propose(active, nodes), active, nodes)

    def _prevent_release(
        self, proposed: ActiveSet, active: ActiveSet, nodes: ContactNodes
    ) -> ActiveSet:
        """Return the proposed set, less changes that would make the tangent singular.

        Of the nodes that let go, those that violate the law least are kept for one more iteration,
        as many as it takes. LastContactLost is raised if they do not suffice.
        """
        releases = (proposed.status != active.status) & (active.status != OPEN)
        releases &= proposed.status != STICK
        in_space = proposed.direction.shape[1] > 1  # where a slipping node holds across its slip
        if not in_space and not self._comm.allreduce(int(np.any(releases)), MPI.MAX):
            return proposed
        motions = self._free_motions(proposed, nodes.frame)
        if not motions:
            return proposed
        violation = np.linalg.norm(nodes.violation(), axis=1)
        ranked = np.sort(np.concatenate(self._comm.allgather(violation[releases])))[::-1]
        n_released = len(ranked) // 2
        while n_released > 0:
            is_kept = releases & (violation < ranked[n_released - 1])
            candidate = select_nodes(is_kept, active, proposed)
            if not self._free_motions(candidate, nodes.frame):
                return candidate
            n_released //= 2
        raise LastContactLost(
            f"{' and '.join(motions)}: nothing holds it once the nodes that would have to pull are "
            f"open and those that cannot hold slip ({count_statuses(proposed, self._comm)})"
        )


class DeformedSetUpdate(ActiveSetUpdate):
    """Active sets of a deformed body, whose equations are linearised anew in each iteration.

    Args:
        interface: the contact points.
        keep_cycling_sets: whether a set that has come back is kept until its equations are solved.
    """

    def __init__(self, interface: Interface, keep_cycling_sets: bool) -> None:
        super().__init__(_no_free_motions, interface)
        self._keeps = keep_cycling_sets

    def start(self, active: ActiveSet, increment: Increment) -> None:
        """Begin at a first active set of an increment."""
        super().start(active, increment)
        self._history = SetHistory(self._comm)
        self._displacement = increment.start.displacement

    def make_error(self, max_iterations: int) -> NotFound:
        """Return the error, with the nodes whose statuses change in turn if sets have come back."""
        return self._history.make_error(_not_found(max_iterations), self._interface)

    def _follow(self, active: ActiveSet, state: NewtonState) -> tuple[ActiveSet, Accuracy]:
        change = self._max(np.abs(state.displacement - self._displacement))
        self._displacement = state.displacement
        relative_change = change / (self._max(np.abs(state.displacement)) or 1.0)
        is_kept = self._history.record_and_ask_to_keep(active, relative_change)
        if self._keeps and is_kept:
            return active, self.accuracy
        return super()._follow(active, state)

    def _max(self, values: Array) -> float:
        return float(self._comm.allreduce(values.max(initial=0.0), MPI.MAX))


def _no_free_motions(active: ActiveSet, frame: Array) -> list[str]:  # noqa: ARG001
    """Return no motions: a deformed body's are not looked at."""
    return []


def _not_found(max_iterations: int) -> str:
    return (
        f"no active set satisfies the contact conditions after {max_iterations} iterations "
        "(max_iterations)"
    )


def _digest(comm: MPI.Comm, *arrays: npt.NDArray) -> bytes:
    """Return a key of arrays of all processes; -0.0 counts as 0.0."""
    digest = blake2b(digest_size=16)
    for values in arrays:
        digest.update((values + np.zeros(1, values.dtype)).tobytes())
    return b"".join(comm.allgather(digest.digest()))


def choose_first_set(
    interface: Interface,
    kinematics: LinearisedKinematics,
    before: ContactState,
    free_motions: FreeMotions,
    unloaded: Mask,
) -> ActiveSet:
    """Return the set that the state before ended with, or, from the undeformed body, what touches.

    Pairs (pairs,) whose surfaces are free and `unloaded` begin with what touches in any case. If
    the set would not hold the body, every node that faces something sticks.

    Raises:
        FreeBody: if not even that holds the body.
    """
    touching = _find_touching(interface, kinematics)
    candidates = [touching]
    if before.increment:
        resumed = resume_active_set(interface, kinematics, before)
        of_unloaded = unloaded[interface.pair]
        smooth = np.where(touching.status == STICK, SLIP, touching.status).astype(np.int8)
        candidates = [
            select_nodes(of_unloaded, some, resumed)
            for some in (replace(touching, status=smooth), touching)
        ]
    n_tangents = kinematics.frame.shape[1] - 1
    all_stick = make_sticking_set(np.isfinite(kinematics.gap), interface.cone, n_tangents)
    for candidate in (*candidates, all_stick):
        motions = free_motions(candidate, kinematics.frame)
        if not motions:
            return candidate
    raise FreeBody(
        f"{' and '.join(motions)}: held neither by supports nor by contact, even if every "
        "contact node touched and stuck; add a support, friction or contact nodes"
    )


def _find_touching(interface: Interface, kinematics: LinearisedKinematics) -> ActiveSet:
    """Return the set of nodes that the surface reaches; the nearest of each pair in any case."""
    gap, tolerance = kinematics.gap, _TOUCHING_GAP * interface.extent
    closed = gap <= tolerance
    for k in range(interface.pairs):
        of_pair = interface.pair == k
        nearest = interface.comm.allreduce(gap[of_pair].min(initial=np.inf), MPI.MIN)
        closed |= of_pair & np.isfinite(gap) & (gap <= nearest + tolerance)
    return make_sticking_set(closed, interface.cone, kinematics.frame.shape[1] - 1)


def resume_active_set(
    interface: Interface, kinematics: LinearisedKinematics, before: ContactState
) -> ActiveSet:
    """Return the active set that a state ended with."""
    status, turning, force_normal, *vectors = interface.local(
        before.pairs, "status", "friction_ratio", "force_normal", "direction", "force_tangential"
    )
    direction, friction = (
        np.einsum("nab,nb->na", kinematics.frame[:, 1:], vector) for vector in vectors
    )
    pressure = np.maximum(0.0, force_normal)
    limits = interface.cone.limit(pressure)
    slope, intercept = linearise_friction_limits(pressure, limits, direction)
    return ActiveSet(
        np.where(status == HELD, STICK, status).astype(np.int8),
        direction,
        turning,
        slope,
        intercept,
        turning_by_slip=np.zeros_like(turning),
        support_friction=np.where(kinematics.held_tangents, friction, 0.0),
        support_slip=np.zeros_like(direction),
    )
