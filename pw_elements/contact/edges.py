"""How far the edges of a contact recede, beyond what the law asks for."""

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pw_elements.contact.law import OPEN, SLIP, STICK, ActiveSet, Contact, mixed, sticking

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# Points around one, with it, by the dimension
_NEIGHBOURS = {2: 3, 3: 7}
# Decimals of coordinates that count, over the extent of the points
_DIGITS = 9
# Where the way from a point that pulls to the nearest free one is looked at, the part of it that
# may be held, and of its length that is gone on by
_ALONG, _MOST, _SHARE = np.linspace(0.1, 0.9, 9), 0.5, 0.99


@dataclass(frozen=True)
class _Part:
    """The points of a pair.

    Args:
        own: (m,), which of this process' points they are.
        order: (n,), of all processes' points.
        place: (m,), of the own points in this order.
        x: (n, dim), positions in this order.
        around: (n, k), the nearest ones of each.
    """

    own: Indices
    order: Indices
    place: Indices
    x: Array
    around: Indices


class Edges:
    """Lets points at the edge of a contact, or of its sticking part, go as deep again as they pull.

    Where a smooth contact is taken for larger than it is, by a length e, the pressure at a distance
    d from its edge is that of the true one, A (d - e)^(1/2), to first order in e, or
    A (d^(1/2) - e/2 d^(-1/2)): it pulls up to d = e/2 only. So the law alone halves the excess.
    What shear lacks to friction's limit is alike at the edge of what sticks. Forces next to an edge
    oscillate from node to node, so that means of neighbours tell who pulls.

    Args:
        position: (m, dim), of the points.
        pair: (m,), number of each point's pair.
        chosen: numbers of the pairs in which this is done.
        comm: of the processes.
    """

    def __init__(
        self,
        position: Array,
        pair: npt.NDArray[np.int32],
        chosen: Sequence[int],
        comm: MPI.Comm,
    ) -> None:
        self._comm = comm
        self._parts: list[_Part] = []
        for k in chosen:
            own = np.flatnonzero(pair == k)
            x = np.concatenate(comm.allgather(position[own]))
            first = sum(comm.allgather(len(own))[: comm.rank])
            # the same on any number of processes, which round coordinates in their own ways
            x = np.round(x / np.ptp(x, axis=0).max(initial=1e-300), _DIGITS)
            order = np.lexsort(x.T)
            place = np.argsort(order)[first : first + len(own)]
            near = min(_NEIGHBOURS[x.shape[1]], len(x))
            around = cKDTree(x[order]).query(x[order], near)[1].reshape(len(x), near)
            self._parts.append(_Part(own, order, place, x[order], around))

    def deeper(self, new: ActiveSet, old: ActiveSet, contact: Contact) -> ActiveSet:
        """The new set, in which more points let go next to those that have done so."""
        shear = contact.shearing
        size = np.linalg.norm(shear, axis=1)
        excess = size - contact.friction * np.maximum(0.0, contact.pressing)
        sticking_, closed = old.status == STICK, old.status != OPEN
        slips = self._beside(sticking_, new.status == STICK, excess) & (contact.friction > 0)
        slips &= size > 0
        direction = np.where(slips, 1 / np.where(slips, size, 1.0), 0.0)[:, None] * shear
        slipping = ActiveSet(np.full_like(new.status, SLIP), direction, slips.astype(float))
        opens = self._beside(closed, new.status != OPEN, -contact.force[:, 0])
        open_ = sticking(np.zeros_like(opens), contact.friction, direction.shape[1])
        return mixed(~opens, mixed(~slips, new, slipping), open_)

    def _beside(self, before: Mask, now: Mask, pull: Array) -> Mask:
        """Points (m,) to let go that hold now and did before, by forces (m,) that pull these."""
        deeper = np.zeros(len(now), dtype=bool)
        for part in self._parts:
            values = self._comm.allgather((before[part.own], now[part.own], pull[part.own]))
            held, holds, force = (
                np.concatenate(each)[part.order] for each in zip(*values, strict=True)
            )
            pulls = held & (np.where(held, force, 0.0)[part.around].mean(axis=1) > 0)
            free, rest, x = ~held & ~holds, held & ~pulls, part.x
            if not (pulls.any() and free.any() and rest.any()):
                continue
            width, nearest = cKDTree(x[free]).query(x[pulls])
            along = x[pulls][:, None] + _ALONG[:, None] * (x[free][nearest] - x[pulls])[:, None]
            to_rest, to_others = (cKDTree(x[some]).query(along)[0] for some in (rest, ~rest))
            width[np.mean(to_rest < to_others, axis=1) > _MOST] = 0.0  # no edge
            found = cKDTree(x).query_ball_point(x[pulls], _SHARE * width)
            deep = np.zeros(len(x), dtype=bool)
            deep[np.concatenate(found).astype(np.int64)] = True
            deeper[part.own] = (deep & held & holds)[part.place]
        return deeper
