"""Mortar integrals of two sides in space, by which accepted states are verified.

The integrals are computed from the node positions alone. The theory page has the formulas ("Large
strains"). The module shares no code with `space`, whose integrals are used in the iteration.

A sub-facet of the master, which is a triangle or a quadrilateral, is projected onto the plane of a
sub-facet of the slave along the latter's normal. The corners of the intersection are among the
corners of both and the points at which their edges cross. Taken in the order of their angle around
their mean position, they divide the intersection into triangles. On these, the quadrature rule is
exact for triangular sub-facets, and of a high degree for quadrilaterals. Distances are measured
between the curved facets, to which the sub-facets belong, by their quadratic functions.
"""

from dataclasses import dataclass

import basix
import numpy as np

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.mortars.facing import MortarMatrices, assemble_mortar_matrices

# Largest cosine between the outward normals of two sub-facets that face each other
_MAX_COSINE_OF_OUTWARD_NORMALS = -0.01
# A slave sub-facet is ignored unless a larger fraction of its area than this faces the master
_MIN_FACING_FRACTION_OF_SLAVE_SUB_FACET = 1e-6
# Largest distance by which a point may be outside of a sub-facet or edge, in its own coordinates,
# to count as inside
_COORDINATE_TOLERANCE = 1e-13
# Number of distances between sub-facets that are computed at once, to limit memory
_MAX_DISTANCES_AT_ONCE = 1_000_000
# Degree of a weight function times a quadratic function on triangles, and of the rule if one of two
# sub-facets is a quadrilateral
_TRIANGLE_DEGREE, _QUADRILATERAL_DEGREE = 3, 20
# Numbers of the nodes of a quadrilateral facet along both axes, for its nine nodes
_TENSOR_PRODUCT_NODES = np.array(
    [[0, 0], [2, 0], [0, 2], [2, 2], [1, 0], [0, 1], [2, 1], [1, 2], [1, 1]]
)


@dataclass(frozen=True)
class FacetedSides:
    """Data of slave and master in space that are independent of the state.

    The m nodes of the slave are numbered first, followed by the nodes of the master.

    Args:
        slave_sub_facets: (f, k), corners of the slave's sub-facets in the order along the rim,
            anticlockwise from outside.
        master_sub_facets: (e, l), corners of the master's sub-facets, in the same order.
        allowed_components: (m, 3), mask of the components in which normals at the slave's nodes may
            be nonzero.
        slave_facets: (f / 4, a), nodes of the slave's facets, each of which consists of four
            sub-facets in turn; six nodes (vertices first, then the middles of the edges (1, 2),
            (0, 2), (0, 1)), or nine (vertices in tensor-product order, middles of the edges (0, 1),
            (0, 2), (1, 3), (2, 3), centre).
        master_facets: (e / 4, b), nodes of the master's facets.
        slave_corners: (f, k), corners of the slave's sub-facets as local nodes of their facets.
        master_corners: (e, l), corners of the master's sub-facets as local nodes of their facets.
    """

    slave_sub_facets: Indices
    master_sub_facets: Indices
    allowed_components: Mask
    slave_facets: Indices
    master_facets: Indices
    slave_corners: Indices
    master_corners: Indices


def evaluate_mortar_matrices_in_space(sides: FacetedSides, x: Array) -> MortarMatrices:
    """Return normals, areas and mortar matrices for nodes at positions x (n, 3)."""
    slave, master = _find_near_facing_sub_facets(sides, x)
    slave_x, master_x = x[sides.slave_sub_facets[slave]], x[sides.master_sub_facets[master]]
    origin, normal = slave_x[:, :1], _unit_normals(slave_x)
    along = slave_x[:, 1] - slave_x[:, 0]
    along = _normalise(along - np.sum(along * normal, axis=1, keepdims=True) * normal)
    basis = np.stack([along, np.cross(normal, along)], axis=2)  # (q, 3, 2)
    slave_plane, master_plane = (slave_x - origin) @ basis, (master_x - origin) @ basis
    convex = _are_convex(slave_plane) & _are_convex(master_plane)
    slave, master = slave[convex], master[convex]
    slave_plane, master_plane = slave_plane[convex], master_plane[convex]
    only_triangles = slave_plane.shape[1] + master_plane.shape[1] == 6
    triangle, points, weights = _make_rules_on_intersections(
        slave_plane, master_plane, _TRIANGLE_DEGREE if only_triangles else _QUADRILATERAL_DEGREE
    )
    # from here on, each triangle of an intersection is a part of its own
    slave, master = slave[triangle], master[triangle]
    slave_plane, master_plane = slave_plane[triangle], master_plane[triangle]
    area, size = weights.sum(axis=1), np.abs(_double_areas(slave_plane)) / 2
    covered = np.bincount(slave, area, minlength=len(sides.slave_sub_facets))[slave] / size
    facing = covered > _MIN_FACING_FRACTION_OF_SLAVE_SUB_FACET
    slave, master, weights, points = slave[facing], master[facing], weights[facing], points[facing]
    slave_functions, master_functions = (
        _evaluate_weight_functions(corners[facing], points)
        for corners in (slave_plane, master_plane)
    )
    distance_functions = np.concatenate(
        [
            _evaluate_quadratic_functions(sides.slave_corners[slave], slave_functions),
            -_evaluate_quadratic_functions(sides.master_corners[master], master_functions),
        ],
        axis=2,
    )
    return assemble_mortar_matrices(
        _average_normals_at_slave_nodes(sides, x),
        len(sides.slave_sub_facets),
        slave,
        sides.slave_sub_facets[slave],
        sides.master_sub_facets[master],
        np.einsum("qg,qgi,qgj->qij", weights, slave_functions, slave_functions),
        np.einsum("qg,qgi,qgk->qik", weights, slave_functions, master_functions),
        np.concatenate([sides.slave_facets[slave // 4], sides.master_facets[master // 4]], axis=1),
        np.einsum("qg,qgi,qga->qia", weights, slave_functions, distance_functions),
        len(x),
        sides.master_sub_facets,
    )


def _find_near_facing_sub_facets(sides: FacetedSides, x: Array) -> tuple[Indices, Indices]:
    """Return the pairs (q,) of sub-facets that are near and face each other.

    A sub-facet of the master is near if the distance of the midpoints does not exceed the sum of
    three lengths: the distance of the slave's midpoint from the nearest midpoint, the largest
    distance of a corner of the slave's sub-facet from its midpoint, and the largest such distance
    of all sub-facets of the master.
    """
    slave_x, master_x = x[sides.slave_sub_facets], x[sides.master_sub_facets]
    centre, master_centre = slave_x.mean(axis=1), master_x.mean(axis=1)
    reach, master_reach = (
        np.sqrt(((corners - middle[:, None]) ** 2).sum(axis=2)).max(axis=1)
        for corners, middle in ((slave_x, centre), (master_x, master_centre))
    )
    cosine_rows, master_normal = _unit_normals(slave_x), _unit_normals(master_x)
    rows, pairs = max(1, _MAX_DISTANCES_AT_ONCE // len(master_centre)), []
    for start in range(0, len(centre), rows):
        block = slice(start, start + rows)
        distance = np.sqrt(((centre[block, None] - master_centre) ** 2).sum(axis=2))
        limit = distance.min(axis=1) + reach[block] + master_reach.max()
        facing = cosine_rows[block] @ master_normal.T < _MAX_COSINE_OF_OUTWARD_NORMALS
        first, second = np.nonzero((distance <= limit[:, None]) & facing)
        pairs.append((first + start, second))
    slave, master = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return slave, master


def _make_rules_on_intersections(
    slave: Array, master: Array, degree: int
) -> tuple[Indices, Array, Array]:
    """Return quadrature rules on the triangles (t) that make up intersections of polygons.

    Args:
        slave: (q, k, 2), corners of convex polygons in the plane.
        master: (q, l, 2), corners of the convex polygons with which they intersect.
        degree: degree of the rule on triangles.

    Returns:
        The pair (t,) to which each triangle belongs, points (t, g, 2) and weights (t, g).
    """
    points, exists = [], []
    for corners, other in ((slave, master), (master, slave)):
        points.append(corners)
        exists.append(_are_inside(other, corners))
    for start in range(slave.shape[1]):
        edge = slave[:, (start + 1) % slave.shape[1]] - slave[:, start]
        for master_start in range(master.shape[1]):
            master_end = (master_start + 1) % master.shape[1]
            master_edge = master[:, master_end] - master[:, master_start]
            between = master[:, master_start] - slave[:, start]
            determinant = _cross(edge, master_edge)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = _cross(between, master_edge) / determinant
                t = _cross(between, edge) / determinant
            crosses = np.isfinite(s) & np.isfinite(t)
            for parameter in (s, t):
                crosses &= np.abs(np.where(crosses, parameter, 0.0) - 0.5) <= (
                    0.5 + _COORDINATE_TOLERANCE
                )
            crossing = (slave[:, start] + np.where(crosses, s, 0.0)[:, None] * edge)[:, None]
            points.append(crossing)
            # round-off makes the crossings of almost parallel edges arbitrary
            exists.append(crosses[:, None] & _are_inside(master, crossing))
    point, is_corner = np.concatenate(points, axis=1), np.concatenate(exists, axis=1)
    count = np.maximum(is_corner.sum(axis=1), 1)
    middle = np.where(is_corner[:, :, None], point, 0.0).sum(axis=1) / count[:, None]
    from_middle = np.where(is_corner[:, :, None], point - middle[:, None], 0.0)
    angle = np.where(is_corner, np.arctan2(from_middle[..., 1], from_middle[..., 0]), np.inf)
    order = np.argsort(angle, axis=1)
    first = np.take_along_axis(from_middle, order[:, :1, None], axis=1)
    ordered = np.take_along_axis(from_middle, order[:, :, None], axis=1)
    # points that are no corners are replaced by the first corner, and add nothing
    is_used = np.take_along_axis(is_corner, order, axis=1)
    ordered = np.where(is_used[:, :, None], ordered, first)
    following = np.roll(ordered, -1, axis=1)
    double_area: Array = _cross(ordered, following)
    pair, side = np.nonzero(double_area > 0)
    rule_points, rule_weights = basix.make_quadrature(basix.CellType.triangle, degree)
    ends = np.stack([ordered[pair, side], following[pair, side]], axis=1)
    points_of_rule = middle[pair, None] + rule_points @ ends
    return pair, points_of_rule, np.outer(double_area[pair, side], rule_weights)


def _are_convex(polygon: Array) -> Mask:
    """Return whether polygons with corners (q, k, 2) are convex."""
    k = polygon.shape[1]
    turns = [
        _cross(polygon[:, i - 1] - polygon[:, i - 2], polygon[:, i] - polygon[:, i - 1])
        for i in range(k)
    ]
    return np.asarray(np.abs(np.sign(turns).sum(axis=0)) == k)


def _double_areas(polygon: Array) -> Array:
    """Return twice the areas (q,) of polygons (q, k, 2); negative for clockwise corners."""
    polygon = polygon - polygon[:, :1]
    return np.asarray(_cross(polygon, np.roll(polygon, -1, axis=1)).sum(axis=1))


def _are_inside(polygon: Array, points: Array) -> Mask:
    """Return whether points (q, g, 2) are inside of convex polygons (q, k, 2)."""
    inside, whole = np.ones(points.shape[:2], dtype=bool), _double_areas(polygon)[:, None]
    for i in range(polygon.shape[1]):
        start, end = polygon[:, i - 1, None], polygon[:, i, None]
        height = _cross(end - start, points - start) / whole
        inside &= height >= -_COORDINATE_TOLERANCE
    return inside


def _evaluate_weight_functions(corners: Array, points: Array) -> Array:
    """Return the weight functions (q, g, k) of sub-facets (q, k, 2) at points (q, g, 2)."""
    if corners.shape[1] == 3:
        return _barycentric_coordinates(corners, points)
    a, b, c, d = (corners[:, k, None] for k in range(4))
    u, v = (
        _find_fractions_along_sides(points, a, b, c, d),
        _find_fractions_along_sides(points, a, d, c, b),
    )
    return np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=2)


def _find_fractions_along_sides(points: Array, a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the fractions (q, g) at which lines through points divide opposite sides alike.

    The line through a point divides the sides from a to b and from d to c, all (q, 1, 2), at the
    same fraction of their lengths. The fraction is the root, between 0 and 1, of a quadratic
    function.
    """
    from_point, side, change = a - points, b - a, (c - d) - (b - a)
    constant = _cross(from_point, d - a)
    linear = _cross(from_point, change) + _cross(side, d - a)
    square = np.broadcast_to(_cross(side, change), constant.shape)
    root = np.sqrt(np.maximum(linear**2 - 4 * square * constant, 0.0))
    q = -(linear + np.copysign(root, linear)) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.array([constant / q, q / square])
    distance = np.abs(np.where(np.isfinite(roots), roots, np.inf) - 0.5)
    return np.asarray(np.where(distance[0] <= distance[1], roots[0], roots[1]))


def _evaluate_quadratic_functions(corners: Indices, weights: Array) -> Array:
    """Return the quadratic functions (q, g, a) of facets at points of their sub-facets.

    Args:
        corners: (q, k), corners of the sub-facets as local nodes of their facets.
        weights: (q, g, k), weights of the corners at the points.
    """
    if corners.shape[1] == 4:
        t = np.einsum("qgi,qix->qgx", weights, _TENSOR_PRODUCT_NODES[corners] / 2)
        along_axes = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=3)
        first, second = _TENSOR_PRODUCT_NODES.T
        return np.asarray(along_axes[:, :, 0, first] * along_axes[:, :, 1, second])
    # barycentric coordinates of the six nodes of a facet
    nodes = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    a, b, c = np.moveaxis(np.einsum("qgi,qix->qgx", weights, nodes[corners]), 2, 0)
    vertices = [v * (2 * v - 1) for v in (a, b, c)]
    return np.stack([*vertices, 4 * b * c, 4 * a * c, 4 * a * b], axis=2)


def _barycentric_coordinates(corners: Array, points: Array) -> Array:
    """Return the barycentric coordinates (q, g, 3) of points (q, g, 2) in triangles (q, 3, 2)."""
    a, b, c = (corners[:, None, k] for k in range(3))
    whole = _cross(b - a, c - a)
    opposite = [_cross(c - b, points - b), _cross(a - c, points - c), _cross(b - a, points - a)]
    return np.stack(opposite, axis=2) / whole[:, :, None]


def _average_normals_at_slave_nodes(sides: FacetedSides, x: Array) -> Array:
    """Return unit normals (m, 3) at the slave's nodes, which point out of the master.

    Each normal is the mean of the inward normals of the adjacent sub-facets, weighted with their
    areas. Components that are not allowed are set to zero.
    """
    corners = x[sides.slave_sub_facets]
    corners = corners - corners[:, :1]
    outward = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    inward, k = -outward, corners.shape[1]
    m = len(sides.allowed_components)
    total = np.stack(
        [
            np.bincount(sides.slave_sub_facets.ravel(), np.repeat(inward[:, axis], k), minlength=m)
            for axis in range(3)
        ],
        axis=1,
    )
    return _normalise(np.where(sides.allowed_components, total, 0.0))


def _unit_normals(corners: Array) -> Array:
    """Return unit normals (n, 3) of sub-facets with corners (n, k, 3), anticlockwise around them.

    The normal of a quadrilateral is perpendicular to its diagonals.
    """
    vectors = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    return _normalise(np.asarray(vectors, dtype=float))


def _normalise(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.sum(vectors**2, axis=-1, keepdims=True)))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
