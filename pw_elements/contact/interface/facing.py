"""Mortar integrals of two sides in the plane from positions alone, to verify accepted states.

The formulas are on the theory page ("Large strains"); they share no code with `sliding`, whose
integrals the iteration uses. A slave's facet with ends a and b, and normals n_a and n_b there, has
the points x(s) = (1 - s) a + s b and the directions n(s) = (1 - s) n_a + s n_b. It faces a
master's facet from c to d between the s of d and that of c, where (x(s) - p) x n(s) = 0 for p = d
and p = c, because both sides are traversed in opposite directions.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask

# Gauss' rule of three points on [0, 1]; it is part of the definition of the integrals
_GAUSS_POINTS = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
# Smallest cosine between the mean normal of a slave's facet and the outward normal of a facet that
# it faces
_MIN_FACING_COSINE = 0.01
# Smallest fraction of a slave's facet that has to face the master
_MIN_COVERED_FRACTION = 1e-6
# Distances between facets that are computed at a time, to limit memory
_DISTANCES_PER_BLOCK = 1_000_000


@dataclass(frozen=True)
class MortarSides:
    """Facets of slave and master, which do not depend on the state; nodes are the slave's m first.

    Args:
        slave_facets: (f, 2), nodes of straight facets, with the outside on their right.
        master_facets: (e, 2), likewise.
        allowed_components: (m, 2), components that normals at the slave's nodes may have.
        revolved: whether areas are those of the whole circumference.
    """

    slave_facets: Indices
    master_facets: Indices
    allowed_components: Mask
    revolved: bool


@dataclass(frozen=True)
class MortarMatrices:
    """Normals, areas and mortar matrices of the slave's nodes (m); both sides have n nodes.

    Args:
        normals: (m, 2), unit vectors out of the master.
        areas: (m,), A_j; zero for nodes that face nothing.
        distance_rows: S, (m, n), mean difference between values of the slave and of the master.
        master_fractions: (m, n - m), fractions of the force at each slave node that the master's
            nodes receive.
        fraction_error: (m,), round-off of these fractions, from the condition of the duals.
    """

    normals: Array
    areas: Array
    distance_rows: sp.csr_array
    master_fractions: sp.csr_array
    fraction_error: Array

    @property
    def faces_master(self) -> Mask:
        """Nodes (m,) that face the master."""
        return np.asarray(self.areas > 0)

    @property
    def tangents(self) -> Array:
        """Unit vectors (m, 2) along the slave, on the left of the normals."""
        return self.normals[:, ::-1] * [-1.0, 1.0]

    def measure_gaps(self, x: Array) -> Array:
        """Return gaps (m,) at positions x (n, 2), infinite for nodes that face nothing."""
        distance = self.distance_rows @ x
        return np.where(self.faces_master, np.sum(self.normals * distance, axis=1), np.inf)


def measure_gap_and_slip(
    start: MortarMatrices, end: MortarMatrices, x_start: Array, x_end: Array
) -> tuple[Array, Array]:
    """Return gaps (m,) at the end of an increment, and slips (m, 2) since its start.

    Nodes that face nothing at the end have an infinite gap and no slip.

    Args:
        start: matrices at the start.
        end: matrices at the end.
        x_start: (n, 2), positions at the start.
        x_end: (n, 2), positions at the end.
    """
    distance = end.distance_rows @ x_end
    # of nodes that faced the master at the start: distance of the points that were paired then
    slip = np.sum(end.tangents * (start.distance_rows @ x_end - distance), axis=1)
    entered = np.sum(end.tangents * distance, axis=1)
    entered -= np.sum(start.tangents * (end.distance_rows @ x_start), axis=1)
    slip = np.where(start.faces_master, slip, entered) * end.faces_master
    return end.measure_gaps(x_end), slip[:, None] * end.tangents


def evaluate_mortar_matrices(sides: MortarSides, x: Array) -> MortarMatrices:
    """Return normals, areas and mortar matrices with the nodes at positions x (n, 2)."""
    m, f = len(sides.allowed_components), len(sides.slave_facets)
    normals = _average_normals(sides, x)
    facet, (low, high), master = _find_facing_parts(sides, x, normals)
    slave_nodes, master_nodes = sides.slave_facets[facet], sides.master_facets[master]
    s = low[:, None] + (high - low)[:, None] * _GAUSS_POINTS
    weights = np.stack([1 - s, s], axis=1)  # (q, 2, 3)
    points, directions = (
        np.einsum("qig,qix->qgx", weights, end_values)
        for end_values in (x[slave_nodes], normals[slave_nodes])
    )
    # signed distances of the ends of the master's facet from the ray
    offset_c, offset_d = (_cross(x[node][:, None] - points, directions) for node in master_nodes.T)
    master_s = offset_c / (offset_c - offset_d)
    length = np.linalg.norm(x[slave_nodes[:, 1]] - x[slave_nodes[:, 0]], axis=1)
    measure = (length * (high - low))[:, None] * _GAUSS_WEIGHTS
    if sides.revolved:
        measure = measure * 2 * np.pi * points[..., 0]
    slave_products = np.einsum("qg,qig,qjg->qij", measure, weights, weights)
    master_weights = np.stack([1 - master_s, master_s], axis=1)
    mixed_products = np.einsum("qg,qig,qkg->qik", measure, weights, master_weights)
    areas, facet_products = np.zeros(m), np.zeros((f, 2, 2))
    np.add.at(areas, slave_nodes, slave_products.sum(axis=2))
    np.add.at(facet_products, facet, slave_products)
    # psi = diag(W 1) W^-1 w on each facet
    covered = np.unique(facet)
    duals, loss = np.zeros((f, 2, 2)), np.zeros(f)
    W = facet_products[covered]
    duals[covered] = W.sum(axis=2)[:, :, None] * np.linalg.inv(W)
    loss[covered] = np.finfo(float).eps * np.linalg.cond(W)
    fraction_error = np.zeros(m)
    np.maximum.at(fraction_error, slave_nodes, loss[facet][:, None])
    fractions = duals[facet] @ mixed_products / areas[slave_nodes][:, :, None]
    scale = sp.diags_array(1 / np.where(areas > 0, areas, 1.0))
    distance_rows = scale @ (
        _sum_entries(slave_products, slave_nodes, slave_nodes, (m, len(x)))
        - _sum_entries(mixed_products, slave_nodes, master_nodes, (m, len(x)))
    )
    master_fractions = _sum_entries(fractions, slave_nodes, master_nodes - m, (m, len(x) - m))
    return MortarMatrices(normals, areas, distance_rows, master_fractions, fraction_error)


def _sum_entries(
    values: Array, rows: Indices, columns: Indices, shape: tuple[int, int]
) -> sp.csr_array:
    """Return the matrix with the sums of values (q, 2, 2) at rows (q, 2) and columns (q, 2)."""
    row, column = np.broadcast_arrays(rows[:, :, None], columns[:, None])
    return sp.csr_array(sp.coo_array((values.ravel(), (row.ravel(), column.ravel())), shape))


def _find_facing_parts(
    sides: MortarSides, x: Array, normals: Array
) -> tuple[Indices, tuple[Array, Array], Indices]:
    """Return the slave's facets (q,), the limits of s of their facing parts, and the master's."""
    slave, master = _find_near_facets(sides, x, normals)
    ends = sides.slave_facets[slave]
    (a, b), (n_a, n_b) = (np.swapaxes(v[ends], 0, 1) for v in (x, normals))
    limits = []
    # s increases towards c, the first node of the master's facet
    for node, sign, limit in ((1, 1.0, 0.0), (0, -1.0, 1.0)):
        p = x[sides.master_facets[master, node]]
        start, middle, end = (
            _cross((1 - s) * a + s * b - p, (1 - s) * n_a + s * n_b) for s in (0.0, 0.5, 1.0)
        )
        root, slope = _nearest_root(start, middle, end)
        within = np.abs(root - 0.5) <= 0.5
        # no facing part beyond the point where normals intersect, which p passes the wrong way
        visible = np.where(within, slope > 0, sign * middle > 0)
        limits.append(np.where(visible, np.where(within, root, limit), np.nan))
    low, high = limits
    with np.errstate(invalid="ignore"):
        length = np.where(high > low, high - low, 0.0)
    covered = np.bincount(slave, length, minlength=len(sides.slave_facets))[slave]
    faced = (length > 0) & (covered > _MIN_COVERED_FRACTION)
    return slave[faced], (low[faced], high[faced]), master[faced]


def _nearest_root(start: Array, middle: Array, end: Array) -> tuple[Array, Array]:
    """Return the roots (q,) of parabolas that are nearest to s = 1/2, and the slopes there.

    Parabolas are defined by their values (q,) at s = 0, 1/2 and 1. Both are NaN without a root.
    """
    rise, bend = end - start, 2 * (start + end) - 4 * middle
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -(rise + np.copysign(np.sqrt(rise**2 - 4 * bend * middle), rise)) / 2
        from_middle = middle / q
        return 0.5 + from_middle, rise + 2 * bend * from_middle


def _find_near_facets(sides: MortarSides, x: Array, normals: Array) -> tuple[Indices, Indices]:
    """Return pairs of facets, slave's and master's, that are near and face each other.

    The distance of their middles exceeds that of the nearest facet by at most half the length of
    the slave's facet and half the length of the longest facet of the master.
    """
    (middle, edge), (master_middle, master_edge) = (
        (x[facets].mean(axis=1), x[facets[:, 1]] - x[facets[:, 0]])
        for facets in (sides.slave_facets, sides.master_facets)
    )
    half_length = np.linalg.norm(edge, axis=1) / 2
    master_length = np.linalg.norm(master_edge, axis=1)
    outward = master_edge[:, ::-1] * [1.0, -1.0] / master_length[:, None]
    mean_normal = normals[sides.slave_facets].mean(axis=1)
    rows, pairs = max(1, _DISTANCES_PER_BLOCK // len(master_middle)), []
    for start in range(0, len(middle), rows):
        block = slice(start, start + rows)
        distance = np.linalg.norm(middle[block, None] - master_middle, axis=2)
        radius = distance.min(axis=1) + half_length[block] + master_length.max() / 2
        facing = mean_normal[block] @ outward.T > _MIN_FACING_COSINE
        slave, master = np.nonzero((distance <= radius[:, None]) & facing)
        pairs.append((slave + start, master))
    slave, master = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return slave, master


def _average_normals(sides: MortarSides, x: Array) -> Array:
    """Return unit normals (m, 2) of the chords between neighbours of the slave's nodes."""
    chord = np.zeros((len(sides.allowed_components), 2))
    edge = x[sides.slave_facets[:, 1]] - x[sides.slave_facets[:, 0]]
    for nodes in sides.slave_facets.T:
        np.add.at(chord, nodes, edge)
    normals = np.where(sides.allowed_components, chord[:, ::-1] * [-1.0, 1.0], 0.0)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
