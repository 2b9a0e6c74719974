"""Mortar integrals of two sides in the plane from positions alone, to check accepted states.

The formulas are those of the guide's page on theory ("Large strains"); they share no code with
`sliding`, whose integrals the iteration takes. A slave's facet with ends a and b, and normals n_a
and n_b there, has the points x(s) = (1 - s) a + s b and looks along n(s) = (1 - s) n_a + s n_b. It
has a master's facet from c to d between the s of d and c, where (x(s) - p) x n(s) = 0 for p = d
and c: both run against each other.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask

# Gauss' rule of three points on [0, 1], which belongs to the definition of the integrals
_GAUSS_POINTS = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
# Least cosine between a slave's mean normal and the outward normal of a facet that it faces
_MIN_FACING_COSINE = 0.01
# Least part of a slave's facet that has to face the master
_MIN_COVERED_FRACTION = 1e-6
# Distances between facets that are in memory at a time
_DISTANCES_PER_BLOCK = 1_000_000


@dataclass(frozen=True)
class MortarSides:
    """Slave and master (n nodes, the slave's m first): data that no state changes.

    Args:
        slave_facets: (f, 2), nodes of straight facets, with the outside on their right.
        master_facets: (e, 2), likewise.
        kept: (m, 2), components that the slave's normals may have.
        revolved: whether areas are those of the circumference.
    """

    slave_facets: Indices
    master_facets: Indices
    allowed_components: Mask
    revolved: bool


@dataclass(frozen=True)
class FacedParts:
    """Slave nodes (m) and what they have of the master, n nodes being those of both sides.

    Args:
        normals: (m, 2), out of the master, unit vectors.
        areas: (m,), A_j; zero of nodes that face nothing.
        distance_rows: S, (m, n), means of the slave's values less the master's.
        master_parts: (m, n - m), parts of a force at each slave's node that the master's get.
        parts_error: (m,), round-off of these parts, from the condition of the duals.
    """

    normals: Array
    areas: Array
    distance_rows: sp.csr_array
    master_parts: sp.csr_array
    parts_error: Array

    @property
    def faced(self) -> Mask:
        """Return which nodes (m,) face anything."""
        return np.asarray(self.areas > 0)

    @property
    def tangents(self) -> Array:
        """Return unit vectors (m, 2) along the slave, on the left of the normals."""
        return self.normals[:, ::-1] * [-1.0, 1.0]

    def measure_gaps(self, x: Array) -> Array:
        """Return gaps (m,) at positions (n, 2), infinite where nothing is faced."""
        distance = self.distance_rows @ x
        return np.where(self.faced, np.sum(self.normals * distance, axis=1), np.inf)


def measure_gap_and_slip(
    start: FacedParts, end: FacedParts, x_start: Array, x_end: Array
) -> tuple[Array, Array]:
    """Return gaps (m,), infinite where nothing is faced, and slips (m, 2) since the start.

    Positions are (n, 2). A node that faces nothing at the end has not slipped.
    """
    distance = end.distance_rows @ x_end
    # where a node faced something at the start: how far apart what was paired then is now
    slip = np.sum(end.tangents * (start.distance_rows @ x_end - distance), axis=1)
    entered = np.sum(end.tangents * distance, axis=1)
    entered -= np.sum(start.tangents * (end.distance_rows @ x_start), axis=1)
    slip = np.where(start.faced, slip, entered) * end.faced
    return end.measure_gaps(x_end), slip[:, None] * end.tangents


def measure_facing(sides: MortarSides, x: Array) -> FacedParts:
    """Return what both sides have of each other where their nodes are at x (n, 2)."""
    m, f = len(sides.allowed_components), len(sides.slave_facets)
    normals = _average_normals(sides, x)
    facet, (low, high), master = _find_faced_parts(sides, x, normals)
    slave_nodes, master_nodes = sides.slave_facets[facet], sides.master_facets[master]
    s = low[:, None] + (high - low)[:, None] * _GAUSS_POINTS
    weights = np.stack([1 - s, s], axis=1)  # (q, 2, 3)
    points, directions = (
        np.einsum("qig,qix->qgx", weights, of_ends)
        for of_ends in (x[slave_nodes], normals[slave_nodes])
    )
    # sides of the ray on which the ends of the master's facet are
    beside_c, beside_d = (_cross(x[node][:, None] - points, directions) for node in master_nodes.T)
    along = beside_c / (beside_c - beside_d)
    length = np.linalg.norm(x[slave_nodes[:, 1]] - x[slave_nodes[:, 0]], axis=1)
    measure = (length * (high - low))[:, None] * _GAUSS_WEIGHTS
    if sides.revolved:
        measure = measure * 2 * np.pi * points[..., 0]
    own = np.einsum("qg,qig,qjg->qij", measure, weights, weights)
    theirs = np.einsum("qg,qig,qkg->qik", measure, weights, np.stack([1 - along, along], axis=1))
    areas, whole = np.zeros(m), np.zeros((f, 2, 2))
    np.add.at(areas, slave_nodes, own.sum(axis=2))
    np.add.at(whole, facet, own)
    # psi = diag(W 1) W^-1 w on each facet
    covered = np.unique(facet)
    duals, loss = np.zeros((f, 2, 2)), np.zeros(f)
    duals[covered] = whole[covered].sum(axis=2)[:, :, None] * np.linalg.inv(whole[covered])
    loss[covered] = np.finfo(float).eps * np.linalg.cond(whole[covered])
    parts_error = np.zeros(m)
    np.maximum.at(parts_error, slave_nodes, loss[facet][:, None])
    parts = duals[facet] @ theirs / areas[slave_nodes][:, :, None]
    scale = sp.diags_array(1 / np.where(areas > 0, areas, 1.0))
    distance_rows = scale @ (
        _sum_entries(own, slave_nodes, slave_nodes, (m, len(x)))
        - _sum_entries(theirs, slave_nodes, master_nodes, (m, len(x)))
    )
    master_parts = _sum_entries(parts, slave_nodes, master_nodes - m, (m, len(x) - m))
    return FacedParts(normals, areas, distance_rows, master_parts, parts_error)


def _sum_entries(
    values: Array, rows: Indices, columns: Indices, shape: tuple[int, int]
) -> sp.csr_array:
    """Return the matrix of values (q, 2, 2), summed, at rows (q, 2) and columns (q, 2)."""
    row, column = np.broadcast_arrays(rows[:, :, None], columns[:, None])
    return sp.csr_array(sp.coo_array((values.ravel(), (row.ravel(), column.ravel())), shape))


def _find_faced_parts(
    sides: MortarSides, x: Array, normals: Array
) -> tuple[Indices, tuple[Array, Array], Indices]:
    """Return the slave's facets (q,), the s that limit what they face, and the master's facets."""
    slave, master = _find_near_facets(sides, x, normals)
    ends = sides.slave_facets[slave]
    (a, b), (n_a, n_b) = (np.swapaxes(v[ends], 0, 1) for v in (x, normals))
    limits = []
    # s rises towards c, the first node of the master's facet
    for node, sign, limit in ((1, 1.0, 0.0), (0, -1.0, 1.0)):
        p = x[sides.master_facets[master, node]]
        start, middle, end = (
            _cross((1 - s) * a + s * b - p, (1 - s) * n_a + s * n_b) for s in (0.0, 0.5, 1.0)
        )
        root, slope = _nearest_root(start, middle, end)
        within = np.abs(root - 0.5) <= 0.5
        # beyond the point where normals meet, which p passes the wrong way, nothing is seen
        seen = np.where(within, slope > 0, sign * middle > 0)
        limits.append(np.where(seen, np.where(within, root, limit), np.nan))
    low, high = limits
    with np.errstate(invalid="ignore"):
        length = np.where(high > low, high - low, 0.0)
    covered = np.bincount(slave, length, minlength=len(sides.slave_facets))[slave]
    faced = (length > 0) & (covered > _MIN_COVERED_FRACTION)
    return slave[faced], (low[faced], high[faced]), master[faced]


def _nearest_root(start: Array, middle: Array, end: Array) -> tuple[Array, Array]:
    """Return the root that is nearest to s = 1/2 of parabolas (q,) on [0, 1], and the slope there.

    Parabolas are stated by their values at 0, 1/2 and 1; NaN where there is no root.
    """
    rise, bend = end - start, 2 * (start + end) - 4 * middle
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -(rise + np.copysign(np.sqrt(rise**2 - 4 * bend * middle), rise)) / 2
        from_middle = middle / q
        return 0.5 + from_middle, rise + 2 * bend * from_middle


def _find_near_facets(sides: MortarSides, x: Array, normals: Array) -> tuple[Indices, Indices]:
    """Return pairs of facets, slave's and master's, that look at each other and are near.

    Their middles are at most by half of both lengths (the master's longest) farther apart than
    those of the slave's facet and the nearest one.
    """
    (own, own_edge), (other, edge) = (
        (x[facets].mean(axis=1), x[facets[:, 1]] - x[facets[:, 0]])
        for facets in (sides.slave_facets, sides.master_facets)
    )
    half, longest = np.linalg.norm(own_edge, axis=1) / 2, np.linalg.norm(edge, axis=1).max()
    outward = edge[:, ::-1] * [1.0, -1.0] / np.linalg.norm(edge, axis=1)[:, None]
    mean_normal = normals[sides.slave_facets].mean(axis=1)
    rows, pairs = max(1, _DISTANCES_PER_BLOCK // len(other)), []
    for first in range(0, len(own), rows):
        block = slice(first, first + rows)
        distance = np.linalg.norm(own[block, None] - other, axis=2)
        reach = distance.min(axis=1) + half[block] + longest / 2
        facing = mean_normal[block] @ outward.T > _MIN_FACING_COSINE
        slave, master = np.nonzero((distance <= reach[:, None]) & facing)
        pairs.append((slave + first, master))
    slave, master = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return slave, master


def _average_normals(sides: MortarSides, x: Array) -> Array:
    """Return unit normals (m, 2) of the chords between the slave's neighbouring nodes."""
    chord = np.zeros((len(sides.allowed_components), 2))
    edge = x[sides.slave_facets[:, 1]] - x[sides.slave_facets[:, 0]]
    for nodes in sides.slave_facets.T:
        np.add.at(chord, nodes, edge)
    normals = np.where(sides.allowed_components, chord[:, ::-1] * [-1.0, 1.0], 0.0)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
