"""Projection of the master's sub-facets onto the slave's, their overlaps, and derivatives.

Points of the master are projected onto a sub-facet of the slave along the normal of the latter,
which is the direction of its area vector. They have coordinates s with respect to an origin and two
vectors that depend on the corners of the slave's sub-facet. On a triangle, these are the first
corner and the edges from it, so that its weight functions are 1 - s_1 - s_2, s_1 and s_2. On a
quadrilateral, they are the mean of the corners and the means of opposite edges. With coordinates u
between -1/2 and 1/2 in which weight functions are bilinear, its points are at

    s_1 = u_1 + q_1 u_1 u_2,   s_2 = u_2 + q_2 u_1 u_2,

where the twist q has the coordinates of x_0 - x_1 + x_2 - x_3, which is zero for parallelograms.

An overlap and all integrals over it depend on the positions of the corners only through the
projected corners p of the master, the twist q and the area of the slave's sub-facet. Derivatives
are first computed with respect to z = (p, q), and then multiplied by the derivative of z.

Where corners or edges of both sides coincide, as on matching meshes, integrals have different
derivatives in different directions. The corners of the overlap are then those after a tiny common
shift of the master's corners. The derivatives of all sub-facets of the master that meet at such a
place thereby belong to the same direction, and their sum is that of the whole.
"""

from dataclasses import dataclass

import numpy as np

from pw_elements.arrays import Array, Indices, Mask

# Shift of the master's corners that decides between coinciding corners and edges, in coordinates of
# the slave's sub-facet. It is larger than round-off, and its direction is arbitrary
TIE_BREAKING_SHIFT = np.array([0.83e-11, 0.47e-11])
# Origin and two vectors from which coordinates are measured, and twist, as coefficients of the
# corners; by the number of corners
_FRAME_BY_CORNER_COUNT = {
    3: np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]),
    4: np.array([[0.25] * 4, [-0.5, 0.5, 0.5, -0.5], [-0.5, -0.5, 0.5, 0.5]]),
}
_TWIST_BY_CORNER_COUNT = {3: np.zeros((0, 3)), 4: np.array([[1.0, -1.0, 1.0, -1.0]])}
# Coordinates u of the corners
CORNER_COORDINATES_BY_CORNER_COUNT = {
    3: np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    4: np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]),
}


@dataclass(frozen=True)
class ProjectedFacets:
    """Pairs (q) of sub-facets of the slave with k corners and of the master with l corners.

    Args:
        master: (q, l, 2), projected corners p of the master in coordinates of the slave. They run
            anticlockwise.
        twist: (q, t), twist of the slave's sub-facet; t = 2 on quadrilaterals, and 0 on triangles.
        slave: (q, k, 2), corners of the slave's sub-facet in its coordinates.
    """

    master: Array
    twist: Array
    slave: Array

    @property
    def n_variables(self) -> int:
        """Number of the components of z."""
        return 2 * self.master.shape[1] + self.twist.shape[1]

    def select(self, pairs: Indices | Mask) -> "ProjectedFacets":
        """Return the given pairs."""
        return ProjectedFacets(self.master[pairs], self.twist[pairs], self.slave[pairs])

    def are_convex_and_near(self) -> Mask:
        """Return whether both polygons are convex, and no edge of the slave separates them.

        The functions on a quadrilateral that is not convex have no inverse mapping.
        """
        result = np.ones(len(self.master), dtype=bool)
        for polygon in (self.master, self.slave):
            edge = np.roll(polygon, -1, axis=1) - polygon
            result &= (_cross(edge, np.roll(edge, -1, axis=1)) > 0).all(axis=1)
        shifted = self.master + TIE_BREAKING_SHIFT
        for k in range(self.slave.shape[1]):
            start, end = self.slave[:, k - 1, None], self.slave[:, k, None]
            result &= (_cross(end - start, shifted - start) >= 0).any(axis=1)
        return result


@dataclass(frozen=True)
class Polygons:
    """Overlaps (q) of pairs of sub-facets in coordinates of the slave.

    Args:
        corner: (q, c, 2), corners, of which the first ones are used.
        rate: (q, c, 2, z), their derivatives with respect to z.
        count: (q,), numbers of corners.
    """

    corner: Array
    rate: Array
    count: Indices

    def select(self, pairs: Indices | Mask) -> "Polygons":
        """Return the given polygons."""
        return Polygons(self.corner[pairs], self.rate[pairs], self.count[pairs])

    @property
    def area(self) -> Array:
        """Areas (q,) of the polygons."""
        total = np.zeros(len(self.count))
        for k in range(1, self.corner.shape[1] - 1):
            first, second = (self.corner[:, k + i] - self.corner[:, 0] for i in (0, 1))
            total += np.where(k + 1 < self.count, _cross(first, second), 0.0) / 2
        return total


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def project_onto_slave_facets(corners: Array, n_slave_corners: int) -> ProjectedFacets:
    """Project sub-facets of the master onto sub-facets of the slave along the latter's normals.

    Args:
        corners: (q, k + l, 3), corners of the slave's sub-facet, followed by the master's.
        n_slave_corners: number k of the slave's corners.
    """
    items, _, _ = _coordinates_in_slave_frames(corners, n_slave_corners)
    n_master_corners = corners.shape[1] - n_slave_corners
    # without columns for triangles
    twist = np.concatenate([items[:, :0, 0], *np.swapaxes(items[:, n_master_corners:], 0, 1)], 1)
    base = CORNER_COORDINATES_BY_CORNER_COUNT[n_slave_corners]
    slave = np.broadcast_to(base, (len(corners), *base.shape))
    if n_slave_corners == 4:
        slave = slave + base.prod(axis=1)[:, None] * twist[:, None]
    return ProjectedFacets(items[:, :n_master_corners], twist, slave)


def _list_item_coefficients(n_slave_corners: int, n_master_corners: int) -> Array:
    """Return the coefficients (l + t / 2, k + l) of the corners in the vectors that make up z.

    These vectors are those from the origin to the master's corners, and the twist.
    """
    frame, twist = (
        values[n_slave_corners] for values in (_FRAME_BY_CORNER_COUNT, _TWIST_BY_CORNER_COUNT)
    )
    to_master = np.hstack([np.tile(-frame[0], (n_master_corners, 1)), np.eye(n_master_corners)])
    return np.vstack([to_master, np.pad(twist, [(0, 0), (0, n_master_corners)])])


def _coordinates_in_slave_frames(
    corners: Array, n_slave_corners: int
) -> tuple[Array, Array, Array]:
    """Return the coordinates of the vectors that make up z, and what turns vectors into them.

    Returns:
        Coordinates (q, l + t / 2, 2); matrices H (q, 2, 3) that turn vectors into coordinates; and
        the inverse metrics (q, 2, 2) of the two vectors of the frames.
    """
    k = n_slave_corners
    edges = _FRAME_BY_CORNER_COUNT[k][1:] @ corners[:, :k]
    inverse_metric: Array = np.asarray(np.linalg.inv(edges @ np.swapaxes(edges, 1, 2)), dtype=float)
    H = inverse_metric @ edges
    vectors = _list_item_coefficients(k, corners.shape[1] - k) @ corners
    return vectors @ np.swapaxes(H, 1, 2), H, inverse_metric


def differentiate_projection(corners: Array, n_slave_corners: int) -> tuple[Array, Array, Array]:
    """Return the derivatives of projected coordinates and of the areas of the slave's frames.

    Args:
        corners: (q, k + l, 3), corners of the slave's sub-facet, followed by the master's.
        n_slave_corners: number k of the slave's corners.

    Returns:
        Derivatives (q, z, 3 (k + l)) of z with respect to the corners; the areas (q,) in space per
        unit area in coordinates of the slave, and their derivatives (q, 3 (k + l)).
    """
    q, n_corners = corners.shape[:2]
    coordinates, H, inverse_metric = _coordinates_in_slave_frames(corners, n_slave_corners)
    by_corner = _list_item_coefficients(n_slave_corners, n_corners - n_slave_corners)
    edges_by_corner = np.pad(
        _FRAME_BY_CORNER_COUNT[n_slave_corners][1:], [(0, 0), (0, n_corners - n_slave_corners)]
    )
    edges = edges_by_corner @ corners
    height = by_corner @ corners - coordinates @ edges  # parts along the normal
    # by changes of the two vectors
    by_edge = -coordinates[:, :, :, None, None] * H[:, None, None]
    by_edge = by_edge + np.einsum("qae,qix->qieax", inverse_metric, height)
    rates = np.einsum("ic,qax->qiacx", by_corner, H)
    rates += np.einsum("ec,qieax->qiacx", edges_by_corner, by_edge)
    area_vector = np.cross(edges[:, 0], edges[:, 1])
    jacobian = np.linalg.norm(area_vector, axis=1)
    normal = area_vector / jacobian[:, None]
    jacobian_by_edge = np.stack([np.cross(edges[:, 1], normal), np.cross(normal, edges[:, 0])], 1)
    jacobian_rates = np.einsum("ec,qex->qcx", edges_by_corner, jacobian_by_edge)
    return (
        rates.reshape(q, 2 * len(by_corner), 3 * n_corners),
        jacobian,
        jacobian_rates.reshape(q, 3 * n_corners),
    )


def intersect_with_slave_facets(projected: ProjectedFacets) -> Polygons:
    """Return the overlaps of projected sub-facets of the master with those of the slave.

    The polygons of the master are clipped at the edges of the slave's sub-facet in turn (Sutherland
    and Hodgman, https://doi.org/10.1145/360767.360802). Which corners are inside is decided after
    a shift by `TIE_BREAKING_SHIFT`.
    """
    q, n_master, _ = projected.master.shape
    n_slave, n_variables = projected.slave.shape[1], projected.n_variables
    max_count = n_slave + n_master
    corner: Array = np.zeros((q, max_count, 2))
    rate: Array = np.zeros((q, max_count, 2, n_variables))
    corner[:, :n_master] = projected.master
    rate[:, :n_master] = np.eye(2 * n_master, n_variables).reshape(n_master, 2, n_variables)
    count: Indices = np.full(q, n_master)
    slave, slave_rate = projected.slave, np.zeros((n_slave, 2, n_variables))
    if n_slave == 4:
        factor = CORNER_COORDINATES_BY_CORNER_COUNT[n_slave].prod(axis=1)
        for axis in (0, 1):
            slave_rate[:, axis, 2 * n_master + axis] = factor
    row = np.arange(q)
    for side in range(n_slave):
        start, edge = slave[:, side - 1, None], (slave[:, side] - slave[:, side - 1])[:, None]
        edge_rate = slave_rate[side] - slave_rate[side - 1]
        from_start = corner - start
        height = _cross(edge, from_start)
        shifted = height + _cross(edge, TIE_BREAKING_SHIFT)
        height_rate = _cross_rate(edge, edge_rate, from_start, rate - slave_rate[side - 1])
        next_corner, next_rate = np.zeros_like(corner), np.zeros_like(rate)
        size = np.zeros(q, dtype=np.int64)
        for k in range(max_count):
            exists = k < count
            following = np.where(k + 1 < count, k + 1, 0)
            inside = exists & (shifted[:, k] >= 0)
            next_inside = shifted[row, following] >= 0
            kept = row[inside]
            next_corner[kept, size[kept]] = corner[kept, k]
            next_rate[kept, size[kept]] = rate[kept, k]
            size[kept] += 1
            cut = np.flatnonzero(exists & (inside != next_inside))
            ends = following[cut]
            h, h_end = height[cut, k], height[cut, ends]
            t = np.clip(h / (h - h_end), 0.0, 1.0)
            t_rate = (
                h[:, None] * height_rate[cut, ends] - h_end[:, None] * height_rate[cut, k]
            ) / ((h - h_end) ** 2)[:, None]
            along = corner[cut, ends] - corner[cut, k]
            next_corner[cut, size[cut]] = corner[cut, k] + t[:, None] * along
            next_rate[cut, size[cut]] = (
                (1 - t)[:, None, None] * rate[cut, k]
                + t[:, None, None] * rate[cut, ends]
                + along[:, :, None] * t_rate[:, None]
            )
            size[cut] += 1
        corner, rate, count = next_corner, next_rate, size
    return Polygons(corner, rate, count)


def _cross_rate(a: Array, a_rate: Array, b: Array, b_rate: Array) -> Array:
    """Return the derivative (..., z) of the cross product of vectors (..., 2) in the plane."""
    (a0, a1), (b0, b1) = ((v[..., 0, None], v[..., 1, None]) for v in (a, b))
    return np.asarray(
        a0 * b_rate[..., 1, :]
        - a1 * b_rate[..., 0, :]
        + a_rate[..., 0, :] * b1
        - a_rate[..., 1, :] * b0
    )
