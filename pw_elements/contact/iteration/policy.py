"""Policies that keep the active-set iteration from cycling and from losing its last hold.

The active set that an increment starts from is chosen here, too.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from hashlib import blake2b

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import Interface
from pw_elements.contact.iteration.law import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    Contact,
    Place,
    mixed,
    sticking,
)
from pw_elements.contact.model import ContactState, Cycling, FreeBody, LostHold, NotFound

FreeMotions = Callable[[ActiveSet, Array], list[str]]  # of an active set in frames, by name

# Directions closer than this belong to the same active set
_DIGITS = 10

# Returns to active sets that tell a cycle; change of displacements, over the largest, at which a
# set's equations are solved; and iterations for which a set is kept at most
_RETURNS_OF_A_CYCLE = 4
_SOLVED_CHANGE = 1e-6
_MOST_KEPT = 6
# Changes of the active set among which a cycle is looked for
_RECENT = 8

# A gap up to this part of the contact nodes' extent counts as closed where no active set is known
_TOUCHING_GAP = 1e-9


class Cycles:
    """Active sets visited, and points that change one at a time since they were caught cycling."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: list[tuple[bytes, ActiveSet]] = []
        self._slow: Mask | None = None

    def repeats(self, active: ActiveSet) -> bool:
        """Notes an active set; True if it has come back, and more points are slowed now."""
        digest = blake2b(active.status.tobytes(), digest_size=16)
        for values in (active.direction, active.turning, active.slope):
            digest.update((np.round(values, _DIGITS) + 0.0).tobytes())
        digest.update(active.friction.tobytes())
        key = b"".join(self._comm.allgather(digest.digest()))
        known = [seen for seen, _ in self._visited]
        self._visited.append((key, active))
        if key not in known:
            return False
        cycle = [visited for _, visited in self._visited[known.index(key) :]]
        cycling = np.zeros(len(active.status), dtype=bool)
        for other in cycle:
            cycling |= _differs(other, active)
        if self._slow is None:
            self._slow = np.zeros_like(cycling)
        new = self._comm.allreduce(int(np.sum(cycling & ~self._slow)), MPI.SUM)
        if new == 0:
            raise NotFound(
                f"the iteration runs through the same {len(cycle) - 1} active sets again, also "
                "when the nodes concerned change one at a time"
            )
        self._slow |= cycling
        self._visited.clear()
        return True

    def slowed(self, old: ActiveSet, contact: Contact) -> ActiveSet:
        """The next active set, in which at most one of the slow points changes."""
        new = contact.active_set(old)
        if self._slow is None:
            return new
        wrong = np.where(self._slow, np.linalg.norm(contact.violation(), axis=1), 0.0)
        worst = self._comm.allreduce(wrong.max(initial=0.0), MPI.MAX)
        return mixed(self._slow & (wrong < worst * (1 - 1e-6)), old, new)


class Patience:
    """Solves the equations of an active set before it changes, once sets come back.

    Newton's method with sets that change in each iteration may run through a few of them for ever,
    though one of them has a solution: it is left before its equations are solved.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: set[bytes] = set()
        self._last, self._returns, self._kept = b"", 0, 0
        self._recent: deque[tuple[bytes, ActiveSet]] = deque(maxlen=_RECENT)

    def keeps(self, active: ActiveSet, change: float) -> bool:
        """Note an active set that was solved for; True if it is to stay for the next iteration.

        Args:
            active: the set.
            change: of the displacements in this iteration, over the largest of them.
        """
        digest = blake2b(active.status.tobytes(), digest_size=16)
        digest.update((np.round(active.direction) + 0.0).tobytes())
        key = b"".join(self._comm.allgather(digest.digest()))
        if key != self._last:
            self._recent.append((key, active))
            self._returns += key in self._visited
            self._visited.add(key)
            self._last, self._kept = key, 0
        self._kept += 1
        return self._cycles and change > _SOLVED_CHANGE and self._kept < _MOST_KEPT

    @property
    def _cycles(self) -> bool:
        return self._returns >= _RETURNS_OF_A_CYCLE

    def make_error(self, words: str, interface: Interface) -> NotFound:
        """Return the error, with the nodes whose statuses change in turn if sets have come back."""
        if not self._cycles:
            return NotFound(words)
        changing = np.zeros(len(interface.pair), dtype=bool)
        for _, one in self._recent:
            changing |= one.status != self._recent[-1][1].status
            turned = np.round(one.direction) != np.round(self._recent[-1][1].direction)
            changing |= turned.any(axis=1)
        places = interface.gathered(interface.position[changing])
        sets = len({key for key, _ in self._recent})
        return Cycling.at(
            f"{words}: {sets} sets come back, which differ at {len(places)} of the nodes, at {{}}, "
            "and the law holds in none of them",
            places,
        )


class LastHold:
    """Keeps a body from losing the last points that hold it, as far as the loads allow."""

    def __init__(self, free_motions: FreeMotions, interface: Interface) -> None:
        self._free_motions, self._interface = free_motions, interface
        self._comm: MPI.Comm = interface.comm

    def kept(self, new: ActiveSet, old: ActiveSet, contact: Contact) -> ActiveSet:
        """The new set, less the changes by which the body would lose its last hold.

        Of the points that let go, those that violate the law least are kept for one more iteration,
        as many as it takes. NotFound is raised if they do not suffice.
        """
        loosened = (new.status != old.status) & (old.status != OPEN) & (new.status != STICK)
        in_space = new.direction.shape[1] > 1  # where a slipping point holds across its slip
        if not in_space and not self._comm.allreduce(int(np.any(loosened)), MPI.MAX):
            return new  # nothing that held before lets go
        motions = self._free_motions(new, contact.frame)
        if not motions:
            return new
        wrong = np.linalg.norm(contact.violation(), axis=1)
        ranked = np.sort(np.concatenate(self._comm.allgather(wrong[loosened])))[::-1]
        count = len(ranked) // 2
        while count > 0:
            candidate = mixed(loosened & (wrong < ranked[count - 1]), old, new)
            if not self._free_motions(candidate, contact.frame):
                return candidate
            count //= 2
        raise LostHold(
            f"{' and '.join(motions)}: nothing holds it once the nodes that would have to pull are "
            f"open and those that cannot hold slip ({counted(new, self._comm)})"
        )


class Policy:
    """The next active set, by the law, slowed where it cycles and with its last hold kept."""

    def __init__(self, free_motions: FreeMotions, interface: Interface) -> None:
        self._comm: MPI.Comm = interface.comm
        self._hold, self._cycles = LastHold(free_motions, interface), Cycles(self._comm)

    def restart(self, first: ActiveSet | None = None) -> None:
        """Forgets the active sets visited, as after a new linearisation; begins anew at a first."""
        self._cycles = Cycles(self._comm)
        if first is not None:
            self._cycles.repeats(first)

    def wanted(self, active: ActiveSet, contact: Contact) -> ActiveSet:
        """The set that should follow; raises NotFound if it would let the body go."""
        following = self._cycles.slowed(active, contact)
        return self._hold.kept(following, active, contact)

    def taken(self, wanted: ActiveSet, active: ActiveSet, contact: Contact) -> ActiveSet:
        """Notes the set that follows; takes another one where it has been there before."""
        return self.wanted(active, contact) if self._cycles.repeats(wanted) else wanted


def same(a: ActiveSet, b: ActiveSet, comm: MPI.Comm) -> bool:
    return not comm.allreduce(int(np.any(_differs(a, b))), MPI.MAX)


def counted(active: ActiveSet, comm: MPI.Comm) -> str:
    counts = [comm.allreduce(int(np.sum(active.status == s)), MPI.SUM) for s in (OPEN, STICK, SLIP)]
    return "{} open, {} sticking, {} slipping contact nodes".format(*counts)


def _differs(a: ActiveSet, b: ActiveSet) -> Mask:
    turned = np.abs(a.direction - b.direction).max(axis=1) > 10.0**-_DIGITS
    steeper = np.abs(a.slope - b.slope) > 10.0**-_DIGITS
    sheared = np.abs(a.friction - b.friction) > 10.0**-_DIGITS * np.abs(a.friction)
    return (a.status != b.status) | turned | steeper | sheared.any(axis=1)


def initial_active_set(
    interface: Interface,
    place: Place,
    before: ContactState,
    free_motions: FreeMotions,
    idle: Mask,
) -> ActiveSet:
    """The active set that the state before ended with, or, from the undeformed body, what touches.

    Pairs (pairs,) that are `idle`, whose surfaces are free and unloaded, begin with what touches in
    any case. If the set would not hold the body, every point that faces something sticks; raises
    FreeBody if not even that does.
    """
    if before.increment:
        first, just = resumed(interface, place, before), idle[interface.pair]
        landed = _touching(interface, place)
        smooth = np.where(landed.status == STICK, SLIP, landed.status).astype(np.int8)
        firsts = [mixed(just, some, first) for some in (replace(landed, status=smooth), landed)]
    else:
        firsts = [_touching(interface, place)]
    every = sticking(np.isfinite(place.gap), interface.cone, place.frame.shape[1] - 1)
    for candidate in (*firsts, every):
        motions = free_motions(candidate, place.frame)
        if not motions:
            return candidate
    raise FreeBody(
        f"{' and '.join(motions)}: held neither by supports nor by contact, even if every "
        "contact node touched and stuck; add a support, friction or contact nodes"
    )


def _touching(interface: Interface, place: Place) -> ActiveSet:
    """Points that the moved surface reaches; the nearest of each pair in any case."""
    gap, near = place.gap, _TOUCHING_GAP * interface.extent
    closed = gap <= near
    for k in range(interface.pairs):
        mine = interface.pair == k
        nearest = interface.comm.allreduce(gap[mine].min(initial=np.inf), MPI.MIN)
        closed |= mine & np.isfinite(gap) & (gap <= nearest + near)
    return sticking(closed, interface.cone, place.frame.shape[1] - 1)


def resumed(interface: Interface, place: Place, before: ContactState) -> ActiveSet:
    """The active set that a state ended with."""
    local, pairs = interface.local, before.pairs
    status = local([pair.status for pair in pairs])
    direction, friction = (
        np.einsum("nab,nb->na", place.frame[:, 1:], local(vectors))
        for vectors in zip(
            *((pair.direction, pair.force_tangential) for pair in pairs), strict=True
        )
    )
    return ActiveSet.of(
        np.where(status == HELD, STICK, status).astype(np.int8),
        direction,
        local([pair.turning for pair in pairs]),
        interface.cone,
        local([pair.force_normal for pair in pairs]),
        friction=np.where(place.held, friction, 0.0),
    )
