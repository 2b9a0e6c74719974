"""Policies that keep the active-set iteration from cycling and from losing its last hold.

Each of them turns the next active set that the law asks for into another one, and each can be
used and tested alone. `Policy` is both together, as the loop takes them.
"""

from collections.abc import Callable
from hashlib import blake2b

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.contact.edges import Edges
from pw_elements.contact.errors import NotFound
from pw_elements.contact.law import OPEN, SLIP, STICK, ActiveSet, Contact, mixed, sticking

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
FreeMotions = Callable[[ActiveSet, Array], list[str]]  # of an active set in frames, by name

# Directions closer than this belong to the same active set
_DIGITS = 10
# How often points that had let go are asked to hold the body once more, in an increment
_RESCUES = 3


class Cycles:
    """Active sets visited, and points that change one at a time since they were caught cycling."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: list[tuple[bytes, ActiveSet]] = []
        self._slow: Mask | None = None

    @property
    def slow(self) -> bool:
        """Whether it has been caught cycling."""
        return self._slow is not None

    def repeats(self, active: ActiveSet) -> bool:
        """Notes an active set; True if it has been there and the remedy changes something.

        Raises:
            NotFound: if it has been there with the remedy in force already.
        """
        digest = blake2b(active.status.tobytes(), digest_size=16)
        for values in (active.direction, active.turning):
            digest.update((np.round(values, _DIGITS) + 0.0).tobytes())
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


class LastHold:
    """Keeps a body from losing the last points that hold it, as far as the loads allow.

    Args:
        free_motions: names of the motions that an active set in its frames leaves free.
        pair: (m,), number of each point's pair.
        pairs: their number, on all processes.
        comm: of the processes.

    Attributes:
        rescues: how often points that had let go were asked to hold once more.
    """

    def __init__(
        self,
        free_motions: FreeMotions,
        pair: npt.NDArray[np.int32],
        pairs: int,
        comm: MPI.Comm,
    ) -> None:
        self._free_motions, self._comm = free_motions, comm
        self._pair, self._pairs = pair, pairs
        self.rescues = 0

    def kept(self, new: ActiveSet, old: ActiveSet, contact: Contact) -> ActiveSet:
        """The new set, less the changes by which the body would lose its last hold.

        Of the points that let go, those that violate the law least are kept for one more
        iteration, as many as it takes. If they do not suffice, a point that slips the other way
        sticks in their place. If there is none, points that slipped before stick, or an open
        pair lands: a body may let go at one end to be held by another.

        Raises:
            NotFound: if nothing of that holds the body.
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
        pivoted = self._pivoted(new, contact, loosened)
        if pivoted is not None and not self._free_motions(pivoted, contact.frame):
            return pivoted
        if self.rescues < _RESCUES:
            self.rescues += 1
            gripping = (new.status == SLIP) & ~loosened & (contact.friction > 0)
            for touching in (gripping, gripping | self._landing(new, contact.gap)):
                held = _gripping(touching, new, contact)
                if not self._free_motions(held, contact.frame):
                    return held
        raise NotFound(
            f"{' and '.join(motions)}: nothing holds it once the nodes that would have to pull are "
            f"open and those that cannot hold slip ({counted(new, self._comm)})"
        )

    def _pivoted(self, new: ActiveSet, contact: Contact, loosened: Mask) -> ActiveSet | None:
        """The new set with a point that sticks in place of those that let go, if there is one.

        The body then moves against the forces that held it. Of the points that slipped the
        other way, the slowest is the first that stands still. None if all slip one way: then
        nothing brakes the body but what it overcomes.
        """
        tangents = contact.frame[:, 1:]
        slip, shear = (
            np.einsum("nab,na->nb", tangents, part) for part in (contact.slip, contact.shearing)
        )
        held = shear[loosened & (new.status == SLIP)].sum(axis=0)
        self._comm.Allreduce(MPI.IN_PLACE, held, MPI.SUM)
        braking = (new.status == SLIP) & ~loosened & (contact.friction > 0) & (slip @ held > 0)
        speed = np.where(braking, np.linalg.norm(slip, axis=1), np.inf)
        slowest = self._comm.allreduce(speed.min(initial=np.inf), MPI.MIN)
        if not np.isfinite(slowest):
            return None
        return _gripping(braking & (speed <= slowest * (1 + 1e-9)), new, contact)

    def _landing(self, active: ActiveSet, gap: Array) -> Mask:
        """The nearest point of each pair that is open everywhere."""
        landing = np.zeros(len(gap), dtype=bool)
        for k in range(self._pairs):
            mine = (self._pair == k) & np.isfinite(gap)
            closed = int(np.any(active.status[mine] != OPEN))
            nearest = self._comm.allreduce(gap[mine].min(initial=np.inf), MPI.MIN)
            if not self._comm.allreduce(closed, MPI.MAX):
                landing |= mine & (gap <= nearest)
        return landing


class Policy:
    """The next active set, by the law, slowed where it cycles and with its last hold kept."""

    def __init__(self, hold: LastHold, comm: MPI.Comm, edges: Edges | None = None) -> None:
        self._hold, self._comm, self._edges = hold, comm, edges
        self._cycles = Cycles(comm)

    def restart(self, first: ActiveSet | None = None) -> None:
        """Forgets the active sets visited, as after a new linearisation; begins anew at a first."""
        self._cycles = Cycles(self._comm)
        if first is not None:
            self._hold.rescues = 0
            self._cycles.repeats(first)

    def wanted(self, active: ActiveSet, contact: Contact) -> ActiveSet:
        """The set that should follow.

        Raises:
            NotFound: if it would let the body go.
        """
        following = self._cycles.slowed(active, contact)
        if self._edges is not None and not self._cycles.slow:
            following = self._edges.deeper(following, active, contact)
        return self._hold.kept(following, active, contact)

    def taken(self, wanted: ActiveSet, active: ActiveSet, contact: Contact) -> ActiveSet:
        """Notes the set that follows; takes another one where it has been there before.

        Raises:
            NotFound: if nothing helps against a cycle, or as `wanted`.
        """
        return self.wanted(active, contact) if self._cycles.repeats(wanted) else wanted


def _gripping(where: Mask, active: ActiveSet, contact: Contact) -> ActiveSet:
    """An active set in which some points stick, or slip if they are smooth."""
    return mixed(where, sticking(where, contact.friction, active.direction.shape[1]), active)


def same(a: ActiveSet, b: ActiveSet, comm: MPI.Comm) -> bool:
    """Whether two active sets are one, on all processes."""
    return not comm.allreduce(int(np.any(_differs(a, b))), MPI.MAX)


def counted(active: ActiveSet, comm: MPI.Comm) -> str:
    """How many contact nodes are in each status, in words."""
    counts = [comm.allreduce(int(np.sum(active.status == s)), MPI.SUM) for s in (OPEN, STICK, SLIP)]
    return "{} open, {} sticking, {} slipping contact nodes".format(*counts)


def _differs(a: ActiveSet, b: ActiveSet) -> Mask:
    turned = np.abs(a.direction - b.direction).max(axis=1) > 10.0**-_DIGITS
    return (a.status != b.status) | turned
