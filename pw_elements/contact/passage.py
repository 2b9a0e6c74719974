"""Surfaces that have gone through the body: states in which the law means nothing.

The law takes gap and normal at the undeformed body, and nothing in it says that a surface comes
from outside: one that has gone too far pulls, or is out of reach on the other side of the body,
and all conditions hold. So three things are refused of rigid surfaces:

- nodes that a surface swallows, on its straight way to its place, from where it would push them
  outwards: against the outward normals of all facets around;
- nodes in contact that are pushed outwards;
- nodes in contact that have been pushed as far as the other side of the body: the chord from
  the node through the body, along the push, has no length left. The body as a whole may move and
  bend however far with the surface.
"""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.collective import collective
from pw_elements.contact.errors import SurfacePassed, listed
from pw_elements.contact.facets import Exterior, Facets
from pw_elements.contact.gradients import with_ghosts
from pw_elements.contact.interface import Interface
from pw_elements.contact.law import OPEN
from pw_elements.contact.newton import Iterate, Reference
from pw_elements.contact.points import RIGID

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Cosine from which on a push counts as outwards, and below minus which as inwards
_OUTWARDS = 0.1
# Step along a surface's way, and depth that counts as swallowed, over the smallest facet
_STEP, _DEPTH = 0.25, 1e-3
# The way has this many steps at most
_STEPS = 10_000
# A chord without length has a mean strain of -1; no strain is as large at fewer than this
_CRUSHED = 0.5
# What is left of a chord without length, by round-off
_LEFT = 1e-9
# Number of nodes in contact, those pushed farthest, whose chords are looked at
_CHORDS = 50


class Passage:
    """Looks for rigid surfaces that pass through a body.

    Args:
        interface: its contact points, nodes.
        space: of the displacements.
        exterior: facets of the body.
        facets: around the points.
    """

    def __init__(
        self,
        interface: Interface,
        space: fem.FunctionSpace,
        exterior: Exterior,
        facets: Facets,
    ) -> None:
        self._interface, self._space, self._comm = interface, space, interface.comm
        self._exterior, self._facets = exterior, facets
        rows = [np.flatnonzero(interface.pair == k) for k in range(interface.pairs)]
        self._around = [facets.of(mine) for mine in rows]
        self._finest = [
            self._comm.allreduce(around.size.min(initial=np.inf), MPI.MIN)
            for around in self._around
        ]
        self._rigid = [
            not self._comm.allreduce(bool(np.any(interface.faced[mine] != RIGID)), MPI.LOR)
            for mine in rows
        ]

    def check_way(self, past: Reference, translations: Array) -> None:
        """Looks along the straight ways of the surfaces to translations (pairs, dim).

        Raises:
            SurfacePassed: where one goes through the body.
        """
        for k, rigid in enumerate(self._rigid):
            way = translations[k] - past.translations[k]
            if rigid and np.linalg.norm(way) > _STEP * self._finest[k]:
                mine = self._interface.pair == k
                wrong = np.zeros(len(mine), dtype=bool)
                wrong[mine] = self._swallowed(k, past, way)
                self._refuse(k, wrong, "passes through the body: it goes through the nodes at")

    def check(self, now: Iterate, strain: float) -> None:
        """Looks at the points in contact; `strain` is the body's largest.

        Raises:
            SurfacePassed: where a surface pushes the body outwards, or is through it.
        """
        closed = now.contact.active_set().status != OPEN
        closed &= np.array(self._rigid)[self._interface.pair]
        cosine = self._facets.cosines(now.contact.frame[:, 0])
        for k in range(self._interface.pairs):
            mine = closed & (self._interface.pair == k)
            self._refuse(k, mine & (cosine > _OUTWARDS), "pushes the body outwards at")
            if strain > _CRUSHED:
                through = self._through(now, mine & (cosine < -_OUTWARDS))
                self._refuse(k, through, "is through the whole thickness of the body at")

    def _swallowed(self, k: int, past: Reference, way: Array) -> Mask:
        """Points (m,) of a pair that its surface swallows from the wrong side on its way."""
        interface, mine = self._interface, self._interface.pair == k
        surface, around, size = interface.surfaces[k], self._around[k], self._finest[k]
        x, before = interface.position[mine] - past.translations[k], past.displacement[mine]
        length = float(np.linalg.norm(way))
        step = max(_STEP * size, length / _STEPS)
        # no sample just where a surface has no normal, such as the centre of a sphere
        x = x + 1e-7 * size * np.sqrt(np.arange(2, 2 + x.shape[1]))

        share, wrong = np.zeros(len(x)), np.zeros(len(x), dtype=bool)
        with collective(self._comm):
            while len(x):
                place = x - share[:, None] * way
                gap, normal = surface.gap(place), surface.normal(place)
                depth = -(gap + np.sum(normal * before, axis=1))
                wrong |= (depth > _DEPTH * size) & (around.cosines(normal) > _OUTWARDS)
                if share.min() >= 1:
                    break
                # outside, the surface is a gap away at least; half of it, if that is no distance
                stride = np.maximum(np.where(np.isfinite(gap), gap / 2, 0.0), step)
                share = np.minimum(share + stride / length, 1.0)
        return wrong

    def _through(self, now: Iterate, chosen: Mask) -> Mask:
        """Which of the chosen points (m,), or of the farthest pushed of them, are through."""
        interface, comm = self._interface, self._comm
        normal, a = now.contact.frame[:, 0], now.displacement
        points = np.flatnonzero(chosen)
        pushed = np.sum(normal * a, axis=1)[points]
        size = comm.allreduce(np.abs(pushed).max(initial=0.0), MPI.MAX) or 1.0
        keys = np.column_stack([interface.position[points], -np.round(pushed / size, 9)])
        every = interface.gathered(keys)
        first = sum(comm.allgather(len(points))[: comm.rank])
        far = np.sort(np.lexsort(every.T)[:_CHORDS])  # where many are alike, the first by position
        farthest = points[far[(far >= first) & (far < first + len(points))] - first]
        moved = with_ghosts(self._space, self._interface.field.part(now.full))[
            self._exterior.vertices
        ]
        origins, directions = (
            interface.gathered(values[farthest]) for values in (interface.position, normal)
        )
        found = [self._exterior.exit(x, n, moved) for x, n in zip(origins, directions, strict=True)]
        # of all processes, the nearest way out
        ends = comm.allgather([(t, tuple(there)) for t, there in found])
        nearest = [min(each) for each in zip(*ends, strict=True)]
        first = sum(comm.allgather(len(farthest))[: comm.rank])
        through = np.zeros(len(chosen), dtype=bool)
        for point, (length, there) in zip(farthest, nearest[first:], strict=False):
            left = length + normal[point] @ (np.array(there) - a[point])
            through[point] = left <= _LEFT * length < np.inf
        return through

    def _refuse(self, k: int, wrong: Mask, what: str) -> None:
        places = self._interface.gathered(self._interface.position[wrong])
        if len(places):
            raise SurfacePassed(
                f"the surface of contact pair {k} {what} {listed(places)}; contact is stated for "
                "small displacements and surfaces that come from outside: move it less far, or "
                "round the body in increments that stay clear of it"
            )
