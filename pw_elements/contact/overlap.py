"""What of two faces overlaps, as quadrature points with the functions of both sides."""

from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.contact.segments import Segments, segments, stretches
from pw_elements.contact.trace import Trace, sizes

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_SIMPLEX = {2: basix.CellType.interval, 3: basix.CellType.triangle}
# Sub-facets of so many corners
_CELLS = {**_SIMPLEX, 4: basix.CellType.quadrilateral}
# Of products of weights, quadratic functions and, in axisymmetry, the radius, on sub-facets of so
# many corners; and where quadrilaterals are no parallelograms, so that nothing is a polynomial
_DEGREE, _TWISTED = {2: 4, 3: 4, 4: 6}, 10
# Difference of opposite sides of parallelograms, over their size
_PARALLEL = 1e-9


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) of what the slave's sub-facets at own points have of the master.

    Args:
        point: (q, k), numbers of the points that the sub-facet's corners are, -1 for others'.
        weight: (q, k), their weights.
        dual: (q, k), the duals of these.
        measure: (q,), lengths or areas.
        size: (q,), of the slave's sub-facet.
        ratio: (q,), size of the slave's sub-facet over the master's.
        apart: (q, dim), from the master to the slave.
        functions: nodes (q, n) and values (q, n) of the slave's and the master's quadratic
            functions, and of the master's weights.
    """

    point: Indices
    weight: Array
    dual: Array
    measure: Array
    size: Array
    ratio: Array
    apart: Array
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def of(cls, one: Trace, other: Trace, own: Indices, revolved: bool) -> "Overlap":
        """Of both traces, for the points of global numbers `own` (m,)."""
        (nodes, corners, _), (their_nodes, their_corners, outward) = one.parts, other.parts
        found, mine = overlaps(one, other, own, outward)
        order = np.argsort(own)
        place = np.searchsorted(own, nodes, sorter=order)
        point = order[np.minimum(place, len(own) - 1)] if len(own) else np.zeros_like(nodes)
        point = np.where(np.isin(nodes, own), point, -1)
        degree = _DEGREE[corners.shape[1]]
        if _twisted(found.on_slave) or _twisted(found.on_master):
            degree = _TWISTED
        points, weights = basix.make_quadrature(_SIMPLEX[one.dim], degree)
        rule = np.column_stack([1 - points.sum(axis=1), points])
        weights = weights / weights.sum()
        slave, master = (np.repeat(k, len(weights)) for k in (mine[found.slave], found.master))
        w1, w2 = (w.reshape(len(slave), w.shape[2]) for w in found.weights(rule))
        seen = np.repeat(found.on_slave, len(weights), axis=0)
        stretch = stretches(corners[slave], w1) / stretches(seen, w1)
        size, theirs = sizes(corners)[slave], sizes(their_corners)[master]
        measure = stretch * np.outer(found.size, weights).ravel()
        (at1, N1), (at2, N2) = one.functions(slave, w1), other.functions(master, w2)
        x1, x2 = one.positions(slave, N1), other.positions(master, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _duals(slave, w1, measure)
        functions = ((at1, N1), (at2, N2), (their_nodes[master], w2))
        return cls(point[slave], w1, dual, measure, size, size / theirs, x1 - x2, functions)

    def edge(self, comm: MPI.Comm) -> float:
        """Mean length of the slave's sub-facets, or root of their areas, of all processes."""
        lengths = self.size ** (1 / (self.apart.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ lengths, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def coarseness(self, comm: MPI.Comm) -> float:
        """Mean of the slave's edges over the master's, of all processes."""
        edges = self.ratio ** (1 / (self.apart.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def per_point(self, values: Array, m: int) -> Array:
        """Integrals (m,) of weights times values (q,)."""
        part = (self.weight * (self.measure * values)[:, None])[self.point >= 0]
        return np.asarray(np.bincount(self.point[self.point >= 0], part, minlength=m), dtype=float)

    def integrals(
        self, tested: Array, column: Indices, values: Array, shape: tuple[int, int]
    ) -> sp.csr_array:
        """Matrix of integrals of functions `tested` (q, k) of the points times others (q, n)."""
        part = np.einsum("q,qa,qk->qak", self.measure, tested, values)
        row = np.broadcast_to(self.point[:, :, None], part.shape)
        known = row >= 0
        place = (row[known], np.broadcast_to(column[:, None], part.shape)[known])
        return sp.csr_array(sp.coo_array((part[known], place), shape))


def overlaps(one: Trace, other: Trace, own: Indices, outward: Array) -> tuple[Segments, Indices]:
    """What the slave's sub-facets at own points (m,) have of the master.

    Args:
        one: the slave.
        other: the master.
        own: numbers of nodes.
        outward: (s, dim), normals of the master's sub-facets.

    Returns:
        Overlaps, and numbers of the slave's sub-facets which those of `Segments.slave` count.
    """
    nodes, corners, _ = one.parts
    mine = np.flatnonzero(np.isin(nodes, own).any(axis=1))
    normal = one.normals(nodes[mine]).mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return segments(corners[mine], other.parts[1], normal, outward), mine


def whole_areas(trace: Trace, revolved: bool) -> Array:
    """Integrals (n,) of the weights of a trace's nodes over all of it, seen as an overlap's are."""
    nodes, corners, _ = trace.parts
    k = corners.shape[1]
    points, rule = basix.make_quadrature(_CELLS[k], _DEGREE[k])
    hats = basix.create_element(basix.ElementFamily.P, _CELLS[k], 1).tabulate(0, points)[0, :, :, 0]
    part, w = np.repeat(np.arange(len(corners)), len(rule)), np.tile(hats, (len(corners), 1))
    measure = stretches(corners[part], w) * np.tile(rule, len(corners))
    if revolved:
        _, N = trace.functions(part, w)
        measure = measure * 2 * np.pi * trace.positions(part, N)[:, 0]
    place = np.searchsorted(trace.nodes, nodes[part])
    return np.asarray(np.bincount(place.ravel(), (w * measure[:, None]).ravel()), dtype=float)


def _twisted(corners: Array) -> bool:
    """Whether any cells (q, k, d) are quadrilaterals, but no parallelograms."""
    if corners.shape[1] < 4:
        return False
    apart = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    return bool(np.abs(apart).max(initial=0.0) > _PARALLEL)


def _duals(part: Indices, weight: Array, measure: Array) -> Array:
    """D M^-1 w, (q, k), at quadrature points of sub-facets (q,)."""
    if not len(part):
        return weight
    parts, of = np.unique(part, return_inverse=True)
    n = weight.shape[1]
    M = np.zeros((len(parts), n, n))
    np.add.at(M, of, np.einsum("q,qa,qb->qab", measure, weight, weight))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[of], inverse[of], weight))
