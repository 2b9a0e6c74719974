"""Where the sub-facets of two surfaces face each other: segments of lines, polygons of planes.

A sub-facet is an interval or a triangle, given by its corners and seen as flat. The master's are
projected on the slave's, along a direction of the latter; overlaps are cut into simplices whose
corners are known in barycentric coordinates of both, so that a rule for a simplex integrates
polynomials on both surfaces exactly.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Overlaps of less than this part of the slave's sub-facet are none
_NOTHING = 1e-12
# Sub-facets whose normals have a larger cosine stand across each other, or look the same way
_FACING = -1e-2


@dataclass(frozen=True)
class Segments:
    """Overlaps (q) of sub-facets of dimension d.

    Args:
        slave: (q,), number of the slave's sub-facet.
        master: (q,), of the master's.
        on_slave: (q, d + 1, d + 1), corners in barycentric coordinates of the slave's.
        on_master: (q, d + 1, d + 1), of the master's.
        share: (q,), size over that of the slave's sub-facet.
    """

    slave: Indices
    master: Indices
    on_slave: Array
    on_master: Array
    share: Array


def segments(slave: Array, master: Array, along: Array, outward: Array) -> Segments:
    """Overlaps of two surfaces.

    Args:
        slave: (s, d + 1, dim), corners of its sub-facets.
        master: (m, d + 1, dim).
        along: (s, dim), unit directions of projection, out of the slave's body.
        outward: (m, dim), unit normals out of the master's.
    """
    one, other = _candidates(slave, master)
    facing = np.sum(along[one] * outward[other], axis=1) < _FACING
    one, other = one[facing], other[facing]
    corners = _projected(slave[one], master[other], along[one])
    pair, on_slave = _of_lines(corners) if slave.shape[1] == 2 else _of_triangles(corners)
    share = np.asarray(np.abs(np.linalg.det(on_slave)), dtype=float)
    some = share > _NOTHING
    pair, on_slave = pair[some], on_slave[some]
    # corners = projected master's in the slave's coordinates, so that on_slave = on_master corners
    on_master = np.linalg.solve(
        np.swapaxes(corners[pair], 1, 2), np.swapaxes(on_slave, 1, 2)
    ).swapaxes(1, 2)
    return Segments(one[pair], other[pair], on_slave, np.asarray(on_master), share[some])


def _candidates(slave: Array, master: Array) -> tuple[Indices, Indices]:
    """Pairs whose bounding balls meet, the slave's widened by its distance from the master."""
    if not len(slave) or not len(master):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    middles, tree = slave.mean(axis=1), cKDTree(master.mean(axis=1))
    sizes, largest = (
        np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
        for corners in (slave, master)
    )
    reach = sizes + largest.max() + tree.query(middles)[0]
    found = tree.query_ball_point(middles, reach)
    one = np.repeat(np.arange(len(slave)), [len(near) for near in found])
    return one, np.concatenate([np.asarray(near, dtype=np.int64) for near in found])


def _projected(slave: Array, master: Array, along: Array) -> Array:
    """Barycentric coordinates (n, d + 1, d + 1) of the master's corners on the slave's."""
    edges = np.swapaxes(slave[:, 1:] - slave[:, :1], 1, 2)
    basis = np.concatenate([edges, along[:, :, None]], axis=2)
    away = np.swapaxes(master - slave[:, :1], 1, 2)
    inner = np.swapaxes(np.linalg.solve(basis, away)[:, :-1], 1, 2)
    return np.concatenate([1 - inner.sum(axis=2, keepdims=True), inner], axis=2)


def _of_lines(corners: Array) -> tuple[Indices, Array]:
    """Pairs (q,) that overlap, and their corners (q, 2, 2)."""
    low, high = (np.clip(end(corners[:, :, 1], axis=1), 0.0, 1.0) for end in (np.min, np.max))
    ends = np.stack([low, high], axis=1)
    pair = np.flatnonzero(high > low)
    return pair, np.stack([1 - ends, ends], axis=2)[pair]


def _of_triangles(corners: Array) -> tuple[Indices, Array]:
    """Pairs (q,) that overlap, a triangle each, and their corners (q, 3, 3).

    The master's triangle is cut off at each side of the slave's in turn (Sutherland and Hodgman,
    https://doi.org/10.1145/360767.360802); what is left is a polygon, cut into a fan.
    """
    n = len(corners)
    polygon: Array = np.zeros((n, 7, 3))
    polygon[:, :3] = corners
    count: Indices = np.full(n, 3)
    for side in range(3):
        polygon, count = _cut(polygon, count, side)
    fans = [np.flatnonzero(count > k + 2) for k in range(5)]
    pair = np.concatenate(fans)
    cut = [polygon[some][:, [0, k + 1, k + 2]] for k, some in enumerate(fans)]
    return pair, np.concatenate(cut)


def _cut(polygon: Array, count: Indices, side: int) -> tuple[Array, Indices]:
    """Polygons (n, 7, 3) of `count` (n,) corners, less what has a negative coordinate."""
    n, most, _ = polygon.shape
    kept, size = np.zeros_like(polygon), np.zeros(n, dtype=np.int64)
    row = np.arange(n)
    for k in range(most):
        there = k < count
        start = polygon[:, k]
        end = polygon[row, np.where(k + 1 < count, k + 1, 0)]
        a, b = start[:, side], end[:, side]
        inside = there & (a >= 0)
        kept[row[inside], size[inside]] = start[inside]
        size += inside
        crossed = there & ((a >= 0) != (b >= 0))
        t = (a / np.where(crossed, a - b, 1.0))[:, None]
        kept[row[crossed], size[crossed]] = (start + t * (end - start))[crossed]
        size += crossed
    return kept, size
