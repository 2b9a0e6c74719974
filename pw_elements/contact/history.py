"""Active sets visited in an iteration, and the remedy for cycles."""

from hashlib import blake2b

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.contact.errors import ContactNotConverged
from pw_elements.contact.law import ActiveSet, Contact

# Directions closer than this belong to the same active set
_DIGITS = 10


class History:
    """Active sets visited, and nodes that change one at a time since they were caught cycling."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._visited: list[tuple[bytes, ActiveSet]] = []
        self._slow: npt.NDArray[np.bool_] | None = None

    def repeats(self, active: ActiveSet) -> bool:
        """Notes an active set; True if it has been there and the remedy changes something.

        Raises:
            ContactNotConverged: if it has been there with the remedy in force already.
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
            raise ContactNotConverged(
                f"the iteration runs through the same {len(cycle) - 1} active sets again, also "
                "when the nodes concerned change one at a time: there may be no solution, or "
                "several (large friction); smaller increments, or a start from the states of a "
                "smaller friction, may help"
            )
        self._slow |= cycling
        self._visited.clear()
        return True

    def slowed(self, old: ActiveSet, contact: Contact) -> ActiveSet:
        """The next active set, in which at most one of the slow nodes changes."""
        new = contact.active_set(old)
        if self._slow is None:
            return new
        wrong = np.where(self._slow, np.linalg.norm(contact.violation(), axis=1), 0.0)
        worst = self._comm.allreduce(wrong.max(initial=0.0), MPI.MAX)
        return mixed(self._slow & (wrong < worst * (1 - 1e-6)), old, new)


def mixed(keep: npt.NDArray[np.bool_], old: ActiveSet, new: ActiveSet) -> ActiveSet:
    """The old set where `keep` holds, the new one elsewhere."""
    return ActiveSet(
        np.where(keep, old.status, new.status).astype(np.int8),
        np.where(keep[:, None], old.direction, new.direction),
        np.where(keep, old.turning, new.turning),
    )


def same(a: ActiveSet, b: ActiveSet, comm: MPI.Comm) -> bool:
    """Whether two active sets are one, on all processes."""
    return not comm.allreduce(int(np.any(_differs(a, b))), MPI.MAX)


def _differs(a: ActiveSet, b: ActiveSet) -> npt.NDArray[np.bool_]:
    turned = np.abs(a.direction - b.direction).max(axis=1) > 10.0**-_DIGITS
    return (a.status != b.status) | turned
