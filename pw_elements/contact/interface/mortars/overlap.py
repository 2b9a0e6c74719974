"""Overlaps of the sub-facets of two surfaces, split into simplices.

A sub-facet is an interval, a triangle or a quadrilateral, defined by its corners and treated as
flat. Each sub-facet of the slave has a projection direction, along which sub-facets of the master
are projected onto it. The overlaps are intervals or polygons. They are split into simplices, in
coordinates along the edges of the slave's sub-facet, so that a quadrature rule for a simplex
integrates polynomials on both surfaces exactly.

Corners of quadrilaterals are in tensor-product order. The weight functions of quadrilaterals are
bilinear in the reference coordinates. Only on parallelograms are these polynomials of the
coordinates along the edges.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices

# Corners of the simplices that make up a sub-facet, by its number of corners
_SIMPLEX_SPLIT_BY_CORNER_COUNT = {2: ([0, 1],), 3: ([0, 1, 2],), 4: ([0, 1, 3], [0, 3, 2])}
# Smallest overlap, relative to the size of the slave's sub-facet
_MIN_OVERLAP_FRACTION_OF_SLAVE_SUB_FACET = 1e-12
# Largest cosine between the outward normals of two sub-facets that face each other
MAX_COSINE_OF_FACING_OUTWARD_NORMALS = -1e-2
# Corners of a sub-facet in the order along its rim, by its number of corners
RIM_CORNER_ORDER_BY_CORNER_COUNT = {3: [0, 1, 2], 4: [0, 1, 3, 2]}


def compute_unoriented_cell_normals(corners: Array) -> Array:
    """Return unit normals (n, dim), of arbitrary sign, of cells with corners (n, k, dim).

    Cells are intervals in the plane, and triangles or quadrilaterals in space.
    """
    vectors = _compute_edge_or_diagonal_vectors(corners)
    if corners.shape[2] == 2:
        normal = np.asarray(vectors[:, 0, ::-1] * [1.0, -1.0])
    else:
        normal = np.asarray(np.cross(vectors[:, 0], vectors[:, 1]))
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def compute_cell_lengths_or_areas(corners: Array) -> Array:
    """Return lengths or areas (n,) of cells with corners (n, k, dim).

    The area of a quadrilateral is the area of its projection along its normal.
    """
    if corners.shape[1] == 4:
        u, v = np.swapaxes(_compute_edge_or_diagonal_vectors(corners), 0, 1)
        return np.asarray(np.linalg.norm(np.cross(u, v), axis=1) / 2)
    return compute_jacobian_factors(corners) / (corners.shape[1] - 1)


def _compute_edge_or_diagonal_vectors(corners: Array) -> Array:
    """Return edges from the first corner of simplices, or diagonals of quadrilaterals."""
    if corners.shape[1] == 4:
        return np.asarray(corners[:, [3, 2]] - corners[:, :2])
    return np.asarray(corners[:, 1:] - corners[:, :1])


@dataclass(frozen=True)
class OverlapSimplices:
    """Simplices (q) of dimension d into which the overlaps of sub-facets are split.

    Corners are given in coordinates along the edges of the slave's sub-facet that start at its
    first corner.
    """

    slave_sub_facet: Indices  # (q,), index of the slave's sub-facet
    master_sub_facet: Indices  # (q,), index of the master's sub-facet
    corners: Array  # (q, d + 1, d), corners of the simplices
    slave_corners: Array  # (q, k, d), corners of the slave's sub-facet
    master_corners: Array  # (q, k, d), projected corners of the master's sub-facet
    size: Array  # (q,), lengths or areas of the simplices in these coordinates


def find_overlap_simplices(
    slave_sub_facets: Array,
    master_sub_facets: Array,
    projection_directions: Array,
    master_normals: Array,
) -> OverlapSimplices:
    """Find the overlaps of the sub-facets of two surfaces and split them into simplices.

    Args:
        slave_sub_facets: (s, k, dim), corners of the slave's sub-facets.
        master_sub_facets: (m, k, dim), corners of the master's sub-facets.
        projection_directions: (s, dim), unit vectors out of the slave's body, along which the
            master is projected onto each sub-facet of the slave.
        master_normals: (m, dim), outward unit normals of the master's sub-facets.
    """
    slave_index, master_index = _find_sub_facet_pairs_with_intersecting_boxes(
        slave_sub_facets, master_sub_facets, projection_directions
    )
    cosine = np.sum(projection_directions[slave_index] * master_normals[master_index], axis=1)
    facing = cosine < MAX_COSINE_OF_FACING_OUTWARD_NORMALS
    slave_index, master_index = slave_index[facing], master_index[facing]
    edges = slave_sub_facets[:, 1 : slave_sub_facets.shape[2]] - slave_sub_facets[:, :1]
    basis = np.concatenate([edges, projection_directions[:, None]], axis=1)[slave_index]
    slave_corners, master_corners = (  # without the last coordinate, along the projection
        _compute_coordinates_in_edge_basis(basis, corners - slave_sub_facets[slave_index, :1])[
            ..., :-1
        ]
        for corners in (slave_sub_facets[slave_index], master_sub_facets[master_index])
    )
    pair, corners = (
        _intersect_intervals
        if slave_sub_facets.shape[2] == 2
        else _intersect_polygons_into_triangles
    )(slave_corners, master_corners)
    size, whole = compute_cell_lengths_or_areas(corners), slave_corners[pair]
    keep = size > _MIN_OVERLAP_FRACTION_OF_SLAVE_SUB_FACET * sum(
        compute_cell_lengths_or_areas(whole[:, simplex])
        for simplex in _SIMPLEX_SPLIT_BY_CORNER_COUNT[whole.shape[1]]
    )
    pair, corners, size = pair[keep], corners[keep], size[keep]
    return OverlapSimplices(
        slave_index[pair],
        master_index[pair],
        corners,
        slave_corners[pair],
        master_corners[pair],
        size,
    )


def evaluate_corner_shape_functions(corners: Array, points: Array) -> Array:
    """Return the shape functions (q, g, k) of cells with corners (q, k, d) at points (q, g, d).

    Shape functions are linear on intervals and triangles, and bilinear on quadrilaterals.
    """
    k, d = corners.shape[1:]
    if k == 4:
        rim = RIM_CORNER_ORDER_BY_CORNER_COUNT[k]
        u, v = np.moveaxis(invert_bilinear_mappings(corners[:, rim], points) + 0.5, 2, 0)
        return np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=2)
    edges = corners[:, 1 : d + 1] - corners[:, :1]
    coordinates = _compute_coordinates_in_edge_basis(edges, points - corners[:, :1])
    vertex_function = 1 - coordinates.sum(axis=2, keepdims=True)
    return np.concatenate([vertex_function, coordinates], axis=2)


def invert_bilinear_mappings(corners: Array, points: Array) -> Array:
    """Return the coordinates u (t, g, 2) of points in quadrilaterals in the plane.

    The coordinates are between -1/2 and 1/2. With the mean c of the corners x_k, the means a_1 and
    a_2 of opposite edges, and the twist t = x_0 - x_1 + x_2 - x_3, they have the points

        x = c + u_1 a_1 + u_2 a_2 + u_1 u_2 t.

    With the coordinates s of x - c and q of t in the basis of a_1 and a_2, the inverse is

        u_1 = 2 s_1 / (1 + e + J),   u_2 = 2 s_2 / (1 - e + J),   e = q_1 s_2 - q_2 s_1,
        J^2 = 1 + 2 (q_1 s_2 + q_2 s_1) + e^2,

    where J is the ratio of the areas of the mapping at this point and at u = 0. Only convex
    quadrilaterals have an inverse at all points.

    Args:
        corners: (t, 4, 2), corners of the quadrilaterals in the order along the rim.
        points: (t, g, 2), points of the plane.
    """
    inverse, q = compute_inverse_frames_and_twists(corners)
    s = (points - corners.mean(axis=1, keepdims=True)) @ inverse
    e = q[..., 0] * s[..., 1] - q[..., 1] * s[..., 0]
    square = 1 + 2 * (q[..., 0] * s[..., 1] + q[..., 1] * s[..., 0]) + e**2
    J = np.sqrt(np.maximum(square, 0.0))
    return np.stack([2 * s[..., 0] / (1 + e + J), 2 * s[..., 1] / (1 - e + J)], axis=2)


def compute_inverse_frames_and_twists(corners: Array) -> tuple[Array, Array]:
    """Return what turns vectors into coordinates s, and the twists q, of quadrilaterals.

    The symbols are those of `invert_bilinear_mappings`.

    Args:
        corners: (t, 4, 2), corners of the quadrilaterals in the order along the rim.

    Returns:
        Matrices (t, 2, 2) by which rows are multiplied from the right, and twists (t, 1, 2).
    """
    along_axes = [
        (corners[:, ahead].sum(axis=1) - corners[:, behind].sum(axis=1)) / 2
        for ahead, behind in (([1, 2], [0, 3]), ([2, 3], [0, 1]))
    ]
    inverse = np.linalg.inv(np.stack(along_axes, axis=1))
    twist = corners[:, [0, 2]].sum(axis=1) - corners[:, [1, 3]].sum(axis=1)
    return inverse, twist[:, None] @ inverse


def _compute_coordinates_in_edge_basis(edges: Array, vectors: Array) -> Array:
    """Return the coordinates (q, g, d) of vectors (q, g, d) in the bases formed by `edges`.

    The rows of `edges` (q, d, d) are the basis vectors.
    """
    return np.swapaxes(np.linalg.solve(*(np.swapaxes(x, 1, 2) for x in (edges, vectors))), 1, 2)


def compute_jacobian_factors(corners: Array, corner_shape_functions: Array | None = None) -> Array:
    """Return the Jacobian factors (q,) at one point of each cell.

    The factor is the length or area on the cell per unit length or area on the reference cell.

    Args:
        corners: (q, k, dim), corners of the cells.
        corner_shape_functions: (q, k), shape functions of the corners at the point. They are needed
            on quadrilaterals only, since the factor is constant on simplices.
    """
    edges = corners[:, 1:3] - corners[:, :1]
    if corners.shape[1] == 2:
        return np.asarray(np.linalg.norm(edges[:, 0], axis=1))
    if corner_shape_functions is not None and corners.shape[1] == 4:
        opposite_edges = corners[:, 3:] - corners[:, [2, 1]]
        v_and_u = np.stack(
            [
                corner_shape_functions[:, 2:].sum(axis=1),
                corner_shape_functions[:, 1::2].sum(axis=1),
            ],
            axis=1,
        )
        edges = edges + v_and_u[:, :, None] * (opposite_edges - edges)
    if corners.shape[2] == 2:
        return np.asarray(np.abs(np.linalg.det(edges)))
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))


def _find_sub_facet_pairs_with_intersecting_boxes(
    slave_sub_facets: Array, master_sub_facets: Array, projection_directions: Array
) -> tuple[Indices, Indices]:
    """Return the pairs of a slave and a master sub-facet whose bounding boxes intersect.

    The box of a slave sub-facet is aligned with its projection direction, along which it extends as
    far as the search radius. The boxes of master sub-facets are aligned with the coordinate axes.
    Taken in the order of a k-d tree, they are merged two by two into a binary tree, whose root
    contains the whole master. All slave sub-facets are searched for in this tree at the same time,
    from the root downwards.

    Args:
        slave_sub_facets: (s, k, dim), corners of the slave's sub-facets.
        master_sub_facets: (m, k, dim), corners of the master's sub-facets.
        projection_directions: (s, dim), unit vectors out of the slave's body.

    Returns:
        Indices (q,) of the slave sub-facets and of the master sub-facets of the pairs.
    """
    if not len(slave_sub_facets) or not len(master_sub_facets):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    slave_middle, master_middle = slave_sub_facets.mean(axis=1), master_sub_facets.mean(axis=1)
    tree = cKDTree(master_middle)
    from_middle = slave_sub_facets - slave_middle[:, None]
    slave_radius, master_radius = (
        np.linalg.norm(x, axis=2).max(axis=1)
        for x in (from_middle, master_sub_facets - master_middle[:, None])
    )
    search_radius = slave_radius + master_radius.max() + tree.query(slave_middle)[0]
    axes = np.linalg.svd(projection_directions[:, None])[
        2
    ]  # axes of the slave's boxes; the first is the projection direction
    half_width = np.abs(from_middle @ np.swapaxes(axes, 1, 2)).max(axis=1)
    half_width[:, 0] = search_radius
    boxes = [np.stack([end(master_sub_facets[tree.indices], axis=1) for end in (np.min, np.max)])]
    while (n := boxes[-1].shape[1]) > 1:
        pairs = np.arange(0, n, 2)
        low, high = boxes[-1]
        merged = np.minimum.reduceat(low, pairs), np.maximum.reduceat(high, pairs)
        boxes.append(np.stack(merged))
    slave_index: Indices = np.arange(len(slave_sub_facets))
    box: Indices = np.zeros(len(slave_sub_facets), dtype=np.int64)
    for level, (low, high) in enumerate(reversed(boxes)):
        if level:
            slave_index, box = np.repeat(slave_index, 2), (2 * box[:, None] + np.arange(2)).ravel()
            slave_index, box = slave_index[box < len(low)], box[box < len(low)]
        centre, extent = (low + high) / 2, (high - low) / 2
        for k in range(slave_sub_facets.shape[2]):
            axis = axes[slave_index, k]
            distance = np.abs(np.sum(axis * (centre[box] - slave_middle[slave_index]), axis=1))
            reach = half_width[slave_index, k] + np.sum(np.abs(axis) * extent[box], axis=1)
            intersects = distance <= reach
            slave_index, box = slave_index[intersects], box[intersects]
    master_index = tree.indices[box]
    distance = np.linalg.norm(master_middle[master_index] - slave_middle[slave_index], axis=1)
    near = distance <= search_radius[slave_index]
    return slave_index[near], master_index[near]


def _intersect_intervals(slave: Array, master: Array) -> tuple[Indices, Array]:  # noqa: ARG001
    """Return the pairs (q,) of intervals that overlap, and the ends (q, 2, 1) of their overlaps.

    Coordinates run along the slave's intervals, all of which are [0, 1]. Hence `slave` is not used.
    """
    low, high = (np.clip(end(master[:, :, 0], axis=1), 0.0, 1.0) for end in (np.min, np.max))
    pair = np.flatnonzero(high > low)
    return pair, np.stack([low, high], axis=1)[pair, :, None]


def _intersect_polygons_into_triangles(slave: Array, master: Array) -> tuple[Indices, Array]:
    """Return the triangles into which the overlaps of pairs of polygons are split.

    The master's polygon is clipped at each side of the slave's polygon in turn (Sutherland and
    Hodgman, https://doi.org/10.1145/360767.360802). The remaining polygon is split into a fan of
    triangles.

    Returns:
        The pair (q,) to which each triangle belongs, and the corners (q, 3, 2) of the triangles.
    """
    n, k = master.shape[:2]
    rim = slave[:, RIM_CORNER_ORDER_BY_CORNER_COUNT[k]]
    polygon: Array = np.zeros((n, 2 * k + 1, 2))
    polygon[:, :k] = master[:, RIM_CORNER_ORDER_BY_CORNER_COUNT[k]]
    count: Indices = np.full(n, k)
    for side in range(k):
        start, end = rim[:, side], rim[:, (side + 1) % k]
        inwards = np.stack([start[:, 1] - end[:, 1], end[:, 0] - start[:, 0]], axis=1)
        height = np.einsum("nd,nmd->nm", inwards, polygon - start[:, None])
        polygon, count = _clip_polygons_at_zero_height(polygon, count, height)
    fans = [np.flatnonzero(count > j + 2) for j in range(2 * k - 1)]
    pair = np.concatenate(fans)
    triangles = [polygon[indices][:, [0, j + 1, j + 2]] for j, indices in enumerate(fans)]
    return pair, np.concatenate(triangles)


def _clip_polygons_at_zero_height(
    polygon: Array, corner_count: Indices, height: Array
) -> tuple[Array, Indices]:
    """Remove the parts of polygons in which the height is negative.

    The height is linear between corners.

    Args:
        polygon: (n, max_count, 2), corners of the polygons.
        corner_count: (n,), number of corners of each polygon.
        height: (n, max_count), heights at the corners.

    Returns:
        Corners (n, max_count, 2) of the clipped polygons, and the number (n,) of corners of each.
    """
    n, max_count, _ = polygon.shape
    clipped, size = np.zeros_like(polygon), np.zeros(n, dtype=np.int64)
    row = np.arange(n)
    for k in range(max_count):
        exists = k < corner_count
        following = np.where(k + 1 < corner_count, k + 1, 0)
        start, end = polygon[:, k], polygon[row, following]
        a, b = height[:, k], height[row, following]
        inside = exists & (a >= 0)
        clipped[row[inside], size[inside]] = start[inside]
        size += inside
        crossed = exists & ((a >= 0) != (b >= 0))
        t = (a / np.where(crossed, a - b, 1.0))[:, None]
        clipped[row[crossed], size[crossed]] = (start + t * (end - start))[crossed]
        size += crossed
    return clipped, size
