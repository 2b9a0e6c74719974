"""Mortar integrals of two sides in the plane, by which accepted states are verified.

The integrals are computed from the node positions alone. The theory page has the formulas ("Large
strains"). The module shares no code with `sliding`, whose integrals are used in the iteration.

On a slave facet with ends a and b, and with normals n_a and n_b at these ends, points and
projection directions are x(s) = (1 - s) a + s b and n(s) = (1 - s) n_a + s n_b. A master facet has
the ends c and d. An end p of the master facet is projected onto the slave facet at the coordinate s
for which the cross product (x(s) - p) x n(s) is zero. Since the two sides are traversed in opposite
directions, the facets face each other from the projection of d to the projection of c.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask

# Three-point Gauss rule on [0, 1], which is part of the definition of the integrals
_GAUSS_POINTS_ON_UNIT_INTERVAL = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS_ON_UNIT_INTERVAL = np.array([5.0, 8.0, 5.0]) / 18
# Smallest cosine between the mean normal of a facet of the slave and the outward normal of a facet
# of the master, at which the two can face each other
_MIN_COSINE_OF_CONTACT_TO_MASTER_NORMAL = 0.01
# A slave facet is ignored unless a larger fraction than this faces the master
_MIN_FACING_FRACTION_OF_SLAVE_FACET = 1e-6
# Number of distances between facets that are computed at once, to limit memory
_MAX_FACET_DISTANCES_AT_ONCE = 1_000_000


@dataclass(frozen=True)
class MortarSides:
    """Data of slave and master that are independent of the state.

    The m nodes of the slave are numbered first, followed by the nodes of the master.

    Args:
        slave_facets: (f, 2), nodes of the slave's straight facets. The outside is on the right of
            the direction from the first to the second node.
        master_facets: (e, 2), nodes of the master's straight facets, with the same orientation.
        allowed_components: (m, 2), mask of the components in which normals at the slave's nodes may
            be nonzero.
        revolved: whether areas are those of the whole circumference (axisymmetric bodies).
    """

    slave_facets: Indices
    master_facets: Indices
    allowed_components: Mask
    revolved: bool


@dataclass(frozen=True)
class MortarMatrices:
    """Normals, areas and mortar matrices at the m nodes of the slave.

    Slave and master together have n nodes.

    Args:
        normals: (m, d), unit vectors out of the master.
        areas: (m,), integrals of the weight functions over the facing parts; zero for nodes that do
            not face the master.
        distance_rows: (m, n), matrix that turns nodal values of both sides into weighted means of
            the difference between the slave's and the master's values.
        master_fractions: (m, n - m), fractions of the force at each node of the slave that the
            nodes of the master receive.
        fraction_error: (m,), estimated round-off of `master_fractions`.
        master_facets: (e, l), corners of the master's facets; those of quadrilaterals in the order
            along the rim.
    """

    normals: Array
    areas: Array
    distance_rows: sp.csr_array
    master_fractions: sp.csr_array
    fraction_error: Array
    master_facets: Indices

    @property
    def faces_master(self) -> Mask:
        """Mask (m,) of the slave's nodes that face the master."""
        return np.asarray(self.areas > 0)

    def measure_gaps(self, x: Array) -> Array:
        """Return gaps (m,) at node positions x (n, d); infinite where the master is not faced."""
        distance = self.distance_rows @ x
        return np.where(self.faces_master, np.sum(self.normals * distance, axis=1), np.inf)


def measure_gap_and_slip(
    start: MortarMatrices, end: MortarMatrices, x_start: Array, x_end: Array
) -> tuple[Array, Array]:
    """Return gaps (m,) at the end of an increment, and slips (m, d) since its start.

    Nodes that do not face the master at the end have an infinite gap and zero slip.

    Args:
        start: matrices at the start of the increment.
        end: matrices at the end of the increment.
        x_start: (n, d), positions of the nodes at the start.
        x_end: (n, d), positions of the nodes at the end.
    """
    distance = end.distance_rows @ x_end
    # for nodes that faced the master at the start: the slip between the points that were opposite
    # each other at the start
    paired = start.distance_rows @ x_end - distance
    slip = np.where(start.faces_master[:, None], paired, distance)
    entered = np.flatnonzero(end.faces_master & ~start.faces_master)
    if len(entered):
        rotation = _rotate_with_master_surface(start, end, x_start, x_end, entered)
        start_distance = end.distance_rows[entered] @ x_start
        start_distance -= _along(start.normals[entered], start_distance)
        slip[entered] -= np.einsum("mxy,my->mx", rotation, start_distance)
    slip -= _along(end.normals, slip)
    return end.measure_gaps(x_end), slip * end.faces_master[:, None]


def _rotate_with_master_surface(
    start: MortarMatrices, end: MortarMatrices, x_start: Array, x_end: Array, nodes: Indices
) -> Array:
    """Return the rotations (q, d, d) from start to end at the given nodes (q,) of the slave.

    A rotation turns the normal at the start into that at the end. Among all such rotations it is
    the closest to the mean surface deformation gradient of the master over the part that the node
    faces at the end.
    """
    facets, n, dim = end.master_facets, len(x_start), x_start.shape[1]
    # edges from the first corner, or diagonals of quadrilaterals
    ends, starts = ([2, 3], [0, 1]) if facets.shape[1] == 4 else (range(1, dim), [0] * (dim - 1))
    start_edges, edges = (
        np.swapaxes(x[facets[:, list(ends)]] - x[facets[:, starts]], 1, 2) for x in (x_start, x_end)
    )
    gradient = edges @ np.linalg.pinv(start_edges)  # (e, d, d)
    area = np.sqrt(np.linalg.det(np.swapaxes(start_edges, 1, 2) @ start_edges))
    total, weight = np.zeros((n, dim, dim)), np.zeros(n)
    for corner in facets.T:
        np.add.at(total, corner, area[:, None, None] * gradient)
        np.add.at(weight, corner, area)
    nodal = total.reshape(n, -1) / np.where(weight > 0, weight, 1.0)[:, None]
    mean = -(end.distance_rows[nodes] @ nodal).reshape(-1, dim, dim)
    n_start, n_end = (matrices.normals[nodes] for matrices in (start, end))
    outer, start_outer, end_outer = (
        a[:, :, None] * b[:, None]
        for a, b in ((n_end, n_start), (n_start, n_start), (n_end, n_end))
    )
    identity = np.eye(dim)
    tangential = (identity - end_outer) @ mean @ (identity - start_outer)
    # the large part along the normals makes the closest rotation turn one normal into the other
    size = 1 + np.linalg.norm(tangential, axis=(1, 2))
    left, _, right = np.linalg.svd(tangential + size[:, None, None] * outer)
    left[:, :, -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)


def _along(normals: Array, vectors: Array) -> Array:
    """Return the parts of vectors (m, d) along unit normals (m, d)."""
    return np.sum(normals * vectors, axis=1, keepdims=True) * normals


def evaluate_mortar_matrices(sides: MortarSides, x: Array) -> MortarMatrices:
    """Return normals, areas and mortar matrices for nodes at positions x (n, 2)."""
    f = len(sides.slave_facets)
    normals = _average_normals_at_slave_nodes(sides, x)
    facet, (low, high), master = _find_facing_facet_parts(sides, x, normals)
    slave_nodes, master_nodes = sides.slave_facets[facet], sides.master_facets[master]
    s = low[:, None] + (high - low)[:, None] * _GAUSS_POINTS_ON_UNIT_INTERVAL
    weights = np.stack([1 - s, s], axis=1)  # (q, 2, 3), of both ends at the Gauss points
    points, directions = (
        np.einsum("qig,qix->qgx", weights, end_values)
        for end_values in (x[slave_nodes], normals[slave_nodes])
    )
    # signed distances of the ends of the master's facet from the line of projection
    offset_c, offset_d = (
        _cross_product_in_plane(x[node][:, None] - points, directions) for node in master_nodes.T
    )
    master_s = offset_c / (offset_c - offset_d)
    length = np.linalg.norm(x[slave_nodes[:, 1]] - x[slave_nodes[:, 0]], axis=1)
    measure = (length * (high - low))[:, None] * _GAUSS_WEIGHTS_ON_UNIT_INTERVAL
    if sides.revolved:
        measure = measure * 2 * np.pi * points[..., 0]
    slave_products = np.einsum("qg,qig,qjg->qij", measure, weights, weights)
    master_weights = np.stack([1 - master_s, master_s], axis=1)
    mixed_products = np.einsum("qg,qig,qkg->qik", measure, weights, master_weights)
    return assemble_mortar_matrices(
        normals,
        f,
        facet,
        slave_nodes,
        master_nodes,
        slave_products,
        mixed_products,
        np.concatenate([slave_nodes, master_nodes], axis=1),
        np.concatenate([slave_products, -mixed_products], axis=2),
        len(x),
        sides.master_facets,
    )


def assemble_mortar_matrices(
    normals: Array,
    n_slave_facets: int,
    facet: Indices,
    slave_nodes: Indices,
    master_nodes: Indices,
    slave_products: Array,
    mixed_products: Array,
    distance_nodes: Indices,
    distance_products: Array,
    n_nodes: int,
    master_facets: Indices,
) -> MortarMatrices:
    """Assemble the mortar matrices from the integrals over q facing parts.

    Facets of the slave have k corners, and those of the master l.

    Args:
        normals: (m, d), unit vectors out of the master at the slave's nodes.
        n_slave_facets: number of facets of the slave.
        facet: (q,), slave facet of each part.
        slave_nodes: (q, k), corners of the slave's facets.
        master_nodes: (q, l), corners of the master's facets.
        slave_products: (q, k, k), integrals of products of two weight functions of the slave.
        mixed_products: (q, k, l), integrals of a weight function of the slave times one of the
            master.
        distance_nodes: (q, a), nodes by which the distance of both sides is interpolated.
        distance_products: (q, k, a), integrals of a weight function of the slave times the factor
            of each of these nodes in the distance of the slave from the master.
        n_nodes: number n of nodes of both sides.
        master_facets: (e, l), corners of all facets of the master.
    """
    m, k = len(normals), slave_nodes.shape[1]
    areas, facet_products = np.zeros(m), np.zeros((n_slave_facets, k, k))
    np.add.at(areas, slave_nodes, slave_products.sum(axis=2))
    np.add.at(facet_products, facet, slave_products)
    # dual functions diag(W 1) W^-1 w on each facet, with the weight functions w and the integrals W
    # of their products
    covered = np.unique(facet)
    duals, loss = np.zeros_like(facet_products), np.zeros(n_slave_facets)
    W = facet_products[covered]
    duals[covered] = W.sum(axis=2)[:, :, None] * np.linalg.inv(W)
    loss[covered] = np.finfo(float).eps * np.linalg.cond(W)
    fraction_error = np.zeros(m)
    np.maximum.at(fraction_error, slave_nodes, loss[facet][:, None])
    fractions = duals[facet] @ mixed_products / areas[slave_nodes][:, :, None]
    scale = sp.diags_array(1 / np.where(areas > 0, areas, 1.0))
    distance_rows = scale @ _sum_blocks_into_matrix(
        distance_products, slave_nodes, distance_nodes, (m, n_nodes)
    )
    master_fractions = _sum_blocks_into_matrix(
        fractions, slave_nodes, master_nodes - m, (m, n_nodes - m)
    )
    return MortarMatrices(
        normals, areas, distance_rows, master_fractions, fraction_error, master_facets
    )


def _sum_blocks_into_matrix(
    blocks: Array, rows: Indices, columns: Indices, shape: tuple[int, int]
) -> sp.csr_array:
    """Return the sparse matrix with blocks (q, k, a) at rows (q, k) and columns (q, a).

    Entries at the same position are summed.
    """
    row, column = np.broadcast_arrays(rows[:, :, None], columns[:, None])
    return sp.csr_array(sp.coo_array((blocks.ravel(), (row.ravel(), column.ravel())), shape))


def _find_facing_facet_parts(
    sides: MortarSides, x: Array, slave_normals: Array
) -> tuple[Indices, tuple[Array, Array], Indices]:
    """Return the parts (q) of the slave's facets that face a facet of the master.

    Args:
        sides: facets of both sides.
        x: (n, 2), positions of the nodes.
        slave_normals: (m, 2), normals at the slave's nodes.

    Returns:
        The slave facet (q,) of each part; the lower and upper limits (q,) of each part in the
        coordinate s, which runs from 0 to 1 along the slave facet; and the master facet (q,) that
        each part faces.
    """
    slave, master = _find_near_facing_facet_pairs(sides, x, slave_normals)
    ends = sides.slave_facets[slave]
    (a, b), (n_a, n_b) = (np.swapaxes(v[ends], 0, 1) for v in (x, slave_normals))
    limits = []
    # the coordinate s increases towards c, the first node of the master's facet
    for node, sign, limit in ((1, 1.0, 0.0), (0, -1.0, 1.0)):
        p = x[sides.master_facets[master, node]]
        start, middle, end = (
            _cross_product_in_plane((1 - s) * a + s * b - p, (1 - s) * n_a + s * n_b)
            for s in (0.0, 0.5, 1.0)
        )
        root, slope = _find_central_parabola_root_and_slope(start, middle, end)
        within = np.abs(root - 0.5) <= 0.5
        # beyond the point where normals intersect, p would be projected in the wrong order, and no
        # part faces the master
        visible = np.where(within, slope > 0, sign * middle > 0)
        limits.append(np.where(visible, np.where(within, root, limit), np.nan))
    low, high = limits
    with np.errstate(invalid="ignore"):
        length = np.where(high > low, high - low, 0.0)
    covered = np.bincount(slave, length, minlength=len(sides.slave_facets))[slave]
    faced = (length > 0) & (covered > _MIN_FACING_FRACTION_OF_SLAVE_FACET)
    return slave[faced], (low[faced], high[faced]), master[faced]


def _find_central_parabola_root_and_slope(
    value_at_start: Array, value_at_middle: Array, value_at_end: Array
) -> tuple[Array, Array]:
    """Return the root of each parabola that is nearest to s = 1/2, and the slope at the root.

    The q parabolas are defined by their values (q,) at s = 0, 1/2 and 1. Root (q,) and slope (q,)
    are NaN for a parabola without a root.
    """
    rise, bend = (
        value_at_end - value_at_start,
        2 * (value_at_start + value_at_end) - 4 * value_at_middle,
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -(rise + np.copysign(np.sqrt(rise**2 - 4 * bend * value_at_middle), rise)) / 2
        from_middle = value_at_middle / q
        return 0.5 + from_middle, rise + 2 * bend * from_middle


def _find_near_facing_facet_pairs(
    sides: MortarSides, x: Array, slave_normals: Array
) -> tuple[Indices, Indices]:
    """Return the pairs of a slave facet and a master facet that are near and face each other.

    A master facet is near if its midpoint is at most h farther from the slave facet's midpoint than
    the nearest master midpoint is. Here h is half the length of the slave facet plus half the
    length of the longest master facet.

    Args:
        sides: facets of both sides.
        x: (n, 2), positions of the nodes.
        slave_normals: (m, 2), normals at the slave's nodes.

    Returns:
        Slave facets (q,) and master facets (q,) of the pairs.
    """
    (middle, edge), (master_middle, master_edge) = (
        (x[facets].mean(axis=1), x[facets[:, 1]] - x[facets[:, 0]])
        for facets in (sides.slave_facets, sides.master_facets)
    )
    half_length = np.linalg.norm(edge, axis=1) / 2
    master_length = np.linalg.norm(master_edge, axis=1)
    outward = master_edge[:, ::-1] * [1.0, -1.0] / master_length[:, None]
    mean_normal = slave_normals[sides.slave_facets].mean(axis=1)
    rows, pairs = max(1, _MAX_FACET_DISTANCES_AT_ONCE // len(master_middle)), []
    for start in range(0, len(middle), rows):
        block = slice(start, start + rows)
        distance = np.linalg.norm(middle[block, None] - master_middle, axis=2)
        radius = distance.min(axis=1) + half_length[block] + master_length.max() / 2
        facing = mean_normal[block] @ outward.T > _MIN_COSINE_OF_CONTACT_TO_MASTER_NORMAL
        slave, master = np.nonzero((distance <= radius[:, None]) & facing)
        pairs.append((slave + start, master))
    slave, master = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return slave, master


def _average_normals_at_slave_nodes(sides: MortarSides, x: Array) -> Array:
    """Return unit normals (m, 2) at the slave's nodes.

    Each normal is perpendicular to the chord between the two neighbours of its node, except that
    components that are not allowed are set to zero. The node positions x are (n, 2).
    """
    chord = np.zeros((len(sides.allowed_components), 2))
    edge = x[sides.slave_facets[:, 1]] - x[sides.slave_facets[:, 0]]
    for nodes in sides.slave_facets.T:
        np.add.at(chord, nodes, edge)
    normals = np.where(sides.allowed_components, chord[:, ::-1] * [-1.0, 1.0], 0.0)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def _cross_product_in_plane(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
