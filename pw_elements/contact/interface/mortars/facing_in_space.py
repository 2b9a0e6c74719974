"""Mortar integrals of two sides in space, by which accepted states are verified.

The integrals are computed from the node positions alone. The theory page has the formulas ("Large
strains"). The module shares no code with `space`, whose integrals are used in the iteration.

A triangle of the master is projected onto the plane of a triangle of the slave along the latter's
normal. The corners of the intersection are among the corners of both triangles and the points at
which their edges cross. Taken in the order of their angle around their mean position, they divide
the intersection into triangles, on which a quadrature rule is exact for the integrands. Distances
are measured between the curved facets, to which the triangles belong, by their quadratic functions.
"""

from dataclasses import dataclass

import basix
import numpy as np

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.mortars.facing import MortarMatrices, assemble_mortar_matrices

# Largest cosine between the outward normals of two triangles that face each other
_MAX_COSINE_OF_OUTWARD_NORMALS = -0.01
# A slave triangle is ignored unless a larger fraction of its area than this faces the master
_MIN_FACING_FRACTION_OF_SLAVE_TRIANGLE = 1e-6
# Largest distance by which a point may be outside of a triangle or edge, in its own coordinates, to
# count as inside
_COORDINATE_TOLERANCE = 1e-13
# Number of distances between triangles that are computed at once, to limit memory
_MAX_DISTANCES_AT_ONCE = 1_000_000
# Degree of a weight function times a quadratic function
_INTEGRAND_DEGREE = 3
# Corners at both ends of each edge of a triangle
_EDGE_ENDS = np.array([[0, 1], [1, 2], [2, 0]])


@dataclass(frozen=True)
class TriangulatedSides:
    """Data of slave and master in space that are independent of the state.

    The m nodes of the slave are numbered first, followed by the nodes of the master.

    Args:
        slave_triangles: (f, 3), corners of the slave's triangles, anticlockwise from outside.
        master_triangles: (e, 3), corners of the master's triangles, in the same order.
        allowed_components: (m, 3), mask of the components in which normals at the slave's nodes may
            be nonzero.
        slave_facets: (f / 4, 6), nodes of the slave's facets, each of which consists of four
            triangles in turn; vertices first, then the middles of the edges (1, 2), (0, 2), (0, 1).
        master_facets: (e / 4, 6), nodes of the master's facets.
        slave_corners: (f, 3), corners of the slave's triangles as local nodes of their facets.
        master_corners: (e, 3), corners of the master's triangles as local nodes of their facets.
    """

    slave_triangles: Indices
    master_triangles: Indices
    allowed_components: Mask
    slave_facets: Indices
    master_facets: Indices
    slave_corners: Indices
    master_corners: Indices


def evaluate_mortar_matrices_in_space(sides: TriangulatedSides, x: Array) -> MortarMatrices:
    """Return normals, areas and mortar matrices for nodes at positions x (n, 3)."""
    slave, master = _find_near_facing_triangles(sides, x)
    slave_x, master_x = x[sides.slave_triangles[slave]], x[sides.master_triangles[master]]
    origin = slave_x[:, :1]
    along = _normalise(slave_x[:, 1] - slave_x[:, 0])
    normal = _unit_normals(slave_x)
    basis = np.stack([along, np.cross(normal, along)], axis=2)  # (q, 3, 2)
    slave_plane, master_plane = (slave_x - origin) @ basis, (master_x - origin) @ basis
    points, weights = _make_rules_on_intersections(slave_plane, master_plane)
    slave_functions = _barycentric_coordinates(slave_plane, points)
    master_functions = _barycentric_coordinates(master_plane, points)
    area = weights.sum(axis=1)
    size = np.linalg.norm(
        np.cross(slave_x[:, 1] - slave_x[:, 0], slave_x[:, 2] - slave_x[:, 0]), axis=1
    )
    covered = np.bincount(slave, area, minlength=len(sides.slave_triangles))[slave] / (size / 2)
    facing = (area > 0) & (covered > _MIN_FACING_FRACTION_OF_SLAVE_TRIANGLE)
    slave, master, weights = slave[facing], master[facing], weights[facing]
    slave_functions, master_functions = slave_functions[facing], master_functions[facing]
    distance_functions = np.concatenate(
        [
            _evaluate_quadratic_functions(sides.slave_corners[slave], slave_functions),
            -_evaluate_quadratic_functions(sides.master_corners[master], master_functions),
        ],
        axis=2,
    )
    return assemble_mortar_matrices(
        _average_normals_at_slave_nodes(sides, x),
        len(sides.slave_triangles),
        slave,
        sides.slave_triangles[slave],
        sides.master_triangles[master],
        np.einsum("qg,qgi,qgj->qij", weights, slave_functions, slave_functions),
        np.einsum("qg,qgi,qgk->qik", weights, slave_functions, master_functions),
        np.concatenate([sides.slave_facets[slave // 4], sides.master_facets[master // 4]], axis=1),
        np.einsum("qg,qgi,qga->qia", weights, slave_functions, distance_functions),
        len(x),
        sides.master_triangles,
    )


def _find_near_facing_triangles(sides: TriangulatedSides, x: Array) -> tuple[Indices, Indices]:
    """Return the pairs (q,) of triangles that are near and face each other.

    A triangle of the master is near if the distance of the midpoints does not exceed the sum of
    three lengths: the distance of the slave's midpoint from the nearest midpoint, the largest
    distance of a corner of the slave's triangle from its midpoint, and the largest such distance of
    all triangles of the master.
    """
    slave_x, master_x = x[sides.slave_triangles], x[sides.master_triangles]
    centre, master_centre = slave_x.sum(axis=1) / 3, master_x.sum(axis=1) / 3
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


def _make_rules_on_intersections(slave: Array, master: Array) -> tuple[Array, Array]:
    """Return quadrature points (q, g, 2) and weights (q, g) on intersections of triangles.

    Args:
        slave: (q, 3, 2), corners of triangles in the plane.
        master: (q, 3, 2), corners of the triangles with which they intersect.
    """
    points, exists = [], []
    for corners, other in ((slave, master), (master, slave)):
        inside = (_barycentric_coordinates(other, corners) >= -_COORDINATE_TOLERANCE).all(axis=2)
        points.append(corners)
        exists.append(inside)
    for start, end in _EDGE_ENDS:
        edge = slave[:, end] - slave[:, start]
        for master_start, master_end in _EDGE_ENDS:
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
            # round-off makes the crossings of almost parallel edges arbitrary
            inside = (_barycentric_coordinates(master, crossing) >= -_COORDINATE_TOLERANCE).all(
                axis=2
            )
            points.append(crossing)
            exists.append(crosses[:, None] & inside)
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
    area = np.maximum(_cross(ordered, following), 0.0) / 2
    rule_points, rule_weights = basix.make_quadrature(basix.CellType.triangle, _INTEGRAND_DEGREE)
    rule = [middle[:, None] + s * ordered + t * following for s, t in rule_points]
    weights = [2 * weight * area for weight in rule_weights]
    return np.concatenate(rule, axis=1), np.concatenate(weights, axis=1)


def _evaluate_quadratic_functions(corners: Indices, weights: Array) -> Array:
    """Return the six quadratic functions (q, g, 6) of facets at points of their triangles.

    Args:
        corners: (q, 3), corners of the triangles as local nodes of their facets.
        weights: (q, g, 3), weights of the corners at the points.
    """
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


def _average_normals_at_slave_nodes(sides: TriangulatedSides, x: Array) -> Array:
    """Return unit normals (m, 3) at the slave's nodes, which point out of the master.

    Each normal is the mean of the inward normals of the adjacent triangles, weighted with their
    areas. Components that are not allowed are set to zero.
    """
    a, b, c = (x[node] for node in sides.slave_triangles.T)
    inward = np.cross(a - b, c - b)
    m = len(sides.allowed_components)
    total = np.stack(
        [
            np.bincount(sides.slave_triangles.ravel(), np.repeat(inward[:, axis], 3), minlength=m)
            for axis in range(3)
        ],
        axis=1,
    )
    return _normalise(np.where(sides.allowed_components, total, 0.0))


def _unit_normals(corners: Array) -> Array:
    """Return unit normals (n, 3) of triangles with corners (n, 3, 3), anticlockwise around them."""
    vectors = np.cross(corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 1])
    return _normalise(np.asarray(vectors, dtype=float))


def _normalise(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.sum(vectors**2, axis=-1, keepdims=True)))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
