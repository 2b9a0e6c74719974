"""Mortar integrals of two deformed sides in space, with derivatives.

The sides consist of flat triangles between the nodes of quadratic facets, on which weight functions
are linear. Points of the master are projected onto a triangle of the slave along the normal of this
triangle. On it, points have the coordinates (s_1, s_2) with respect to the edges from its first
corner, so that its weight functions are 1 - s_1 - s_2, s_1 and s_2. The corners p of a triangle of
the master are at projected coordinates, too; the intersection of both triangles is a polygon, over
which the products of weight functions are integrated exactly.

Distances are measured between the curved quadratic facets. On a triangle with the weight functions
w_a, a quadratic function f differs from its linear interpolation by

    -1/2 sum over edges of w_a w_b B_ab,

where B_ab is the second difference of f along the edge ab. The edges of all four triangles of a
facet are parallel to the edges of the facet, so that B_ab = f_p - 2 f_m + f_q with the ends p, q
and the middle m of the parallel edge.

A polygon and all integrals over it depend on the positions of the six corners only through the six
coordinates p and the area of the slave's triangle. Therefore the derivatives are first computed
with respect to p, and then multiplied by the derivative of p.

Where corners or edges of both sides coincide, as on matching meshes, integrals have different
derivatives in different directions. The corners of the polygon are then those after a tiny common
shift of the master's corners. The derivatives of all triangles of the master that meet at such a
place thereby belong to the same direction, and their sum is that of the whole.
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.mortars.boundary_facets import BoundaryFacets
from pw_elements.contact.interface.mortars.facing import MortarMatrices
from pw_elements.contact.interface.mortars.facing_in_space import (
    TriangulatedSides,
    evaluate_mortar_matrices_in_space,
)
from pw_elements.contact.interface.mortars.overlap import MAX_COSINE_OF_FACING_OUTWARD_NORMALS
from pw_elements.contact.interface.mortars.sliding import (
    MIN_FACING_FRACTION_OF_SLAVE_FACET,
    FacingParts,
    NormalsWithDerivatives,
    PairOfArrays,
    SlidingMortar,
    add_image_of_perpendicular,
    sum_into_matrix,
)

# Shift of the master's corners that decides between coinciding corners and edges, in the edge
# coordinates of a slave's triangle. It is larger than round-off, and its direction is arbitrary
_TIE_BREAKING_SHIFT = np.array([0.83e-11, 0.47e-11])
# Largest number of corners of the intersection of two triangles
_MAX_POLYGON_CORNERS = 6
# Three-point Gauss rule on [0, 1], exact for the polynomials that are integrated along edges
_GAUSS_POINTS = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
# Weight functions of a triangle's corners, as coefficients of 1, s_1 and s_2
_WEIGHT_FUNCTION_COEFFICIENTS = np.array([[1.0, -1.0, -1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
# Exponents of s_1 and s_2 in the monomials of degree 0 to 3
_MONOMIAL_EXPONENTS = np.array([[d - j, j] for d in range(4) for j in range(d + 1)])
# Corners at the ends of the edge opposite to each corner of a triangle
_EDGE_ENDS = np.array([[1, 2], [2, 0], [0, 1]])
# Ends and middle of the edges of a facet with six nodes; edge of the facet that is parallel to the
# connection of two of its nodes
_FACET_EDGES = np.array([[1, 3, 2], [0, 4, 2], [0, 5, 1]])
_PARALLEL_FACET_EDGE = {
    frozenset(nodes): edge
    for edge, connections in enumerate(
        (
            ((1, 3), (3, 2), (4, 5)),
            ((0, 4), (4, 2), (3, 5)),
            ((0, 5), (5, 1), (3, 4)),
        )
    )
    for nodes in connections
}


class SpaceSlidingMortar(SlidingMortar):
    """Mortar between two sides in space, each made of the sub-triangles of quadratic triangles.

    The normal at a slave's node is that of the sum of the area vectors of its triangles.

    Args:
        slave: boundary facets of the undeformed slave.
        master: boundary facets of the undeformed master.
    """

    def __init__(self, slave: BoundaryFacets, master: BoundaryFacets) -> None:
        triangles = [_orient_triangles_outwards(side) for side in (slave, master)]
        super().__init__(slave, master, *(corners for corners, _ in triangles))
        self._local_corners = [local for _, local in triangles]
        facet_nodes = [
            np.searchsorted(side.nodes, side.facet_nodes) + first
            for side, first in ((slave, 0), (master, self.n_slave_nodes))
        ]
        self._facet_nodes = facet_nodes
        # number of the second difference along each edge of each triangle
        n_slave_bubbles = 3 * len(facet_nodes[0])
        self._slave_bubbles, self._master_bubbles = (
            _number_parallel_edges(local) + first
            for local, first in zip(self._local_corners, (0, n_slave_bubbles), strict=True)
        )
        ends_and_middles = np.concatenate(facet_nodes)[:, _FACET_EDGES].reshape(-1, 3)
        number = np.arange(len(ends_and_middles))[:, None]
        self._second_differences = sum_into_matrix(
            np.broadcast_to([1.0, -2.0, 1.0], ends_and_middles.shape),
            number,
            ends_and_middles,
            (len(number), len(self.x)),
        )
        sides = self._master_facets[:, _EDGE_ENDS].reshape(-1, 2)
        edges, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
        self._master_rim_edges = edges[count == 1]

    @property
    def sides(self) -> TriangulatedSides:
        """Triangles of both sides and allowed components of normals, independent of the state."""
        return TriangulatedSides(
            self._slave_facets,
            self._master_facets,
            self.allowed_components,
            *self._facet_nodes,
            *self._local_corners,
        )

    def evaluate_mortar_matrices_independently(self, x: Array) -> MortarMatrices:
        return evaluate_mortar_matrices_in_space(self.sides, x)

    def _average_slave_normals(self, x: Array) -> Array:
        total = self._sum_area_vectors_into_master(x)
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))

    def _sum_area_vectors_into_master(self, x: Array) -> Array:
        """Return sums (m, 3) of area vectors at the slave's nodes, without forbidden components.

        The vectors point out of the master, and hence into the slave.
        """
        a, b, c = np.swapaxes(x[self._slave_facets], 0, 1)
        vector = np.cross(c - a, b - a)
        total = np.zeros((self.n_slave_nodes, 3))
        for corner in self._slave_facets.T:
            np.add.at(total, corner, vector)
        return np.where(self.allowed_components, total, 0.0)

    def _differentiate_slave_normals(self, x: Array) -> NormalsWithDerivatives:
        total = self._sum_area_vectors_into_master(x)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        normals = total / length
        tangents = _make_tangents(normals)
        corners = x[self._slave_facets]
        # derivative of t·(area vector) by corner i is t x (edge opposite to i)
        opposite = corners[:, [1, 2, 0]] - corners[:, [2, 0, 1]]
        rates = []
        for tangent in np.swapaxes(tangents, 0, 1):
            # components that are not allowed do not count
            allowed = np.where(self.allowed_components, tangent, 0.0) / length
            by_corner = np.cross(allowed[self._slave_facets][:, :, None], opposite[:, None])
            row = self._slave_facets[:, :, None, None]
            column = 3 * self._slave_facets[:, None, :, None] + np.arange(3)
            rates.append(sum_into_matrix(by_corner, row, column, (len(normals), x.size)))
        return NormalsWithDerivatives(normals, tangents, rates)

    def _integrate_over_facing_parts(self, x: Array) -> FacingParts:
        slave, master = self._find_near_facing_facet_pairs(x)
        # seen from outside the slave, the master's corners run clockwise
        nodes = np.concatenate(
            [self._slave_facets[slave], self._master_facets[master][:, ::-1]], axis=1
        )
        p = _project_onto_slave_triangles(x[nodes])[0]
        shifted = p + _TIE_BREAKING_SHIFT
        overlaps = (
            (shifted.max(axis=1) >= 0).all(axis=1)
            & (shifted.min(axis=1) <= 1).all(axis=1)
            & (shifted.sum(axis=2).min(axis=1) <= 1)
        )
        slave, master, nodes, p = (
            slave[overlaps],
            master[overlaps],
            nodes[overlaps],
            p[overlaps],
        )
        moments, moment_rates, is_polygon = _integrate_monomials_over_overlaps(p)
        covered = np.bincount(slave, moments[:, 0], minlength=len(self._slave_facets))[slave] * 2
        # polygons without area count, as they grow in the direction to which derivatives belong
        facing = is_polygon & (covered > MIN_FACING_FRACTION_OF_SLAVE_FACET)
        slave, master, nodes = slave[facing], master[facing], nodes[facing]
        p, moments, moment_rates = p[facing], moments[facing], moment_rates[facing]
        p_rates, jacobian, jacobian_rates = _differentiate_projection(x[nodes])
        i, j = np.triu_indices(3)
        W, ends = _WEIGHT_FUNCTION_COEFFICIENTS, _EDGE_ENDS
        # integrals over the polygons in edge coordinates, and derivatives with respect to p
        by_moments = np.einsum("ia,ib,abcv,c->iv", W[i], W[j], _CUBIC_MONOMIALS, _CONSTANT)
        D, dD = moments @ by_moments.T, by_moments @ moment_rates
        slave_bubble_products = np.einsum(
            "ia,eb,ec,abcv->iev", W, W[ends[:, 0]], W[ends[:, 1]], _CUBIC_MONOMIALS
        )
        slave_bubble = np.einsum("iev,qv->qie", slave_bubble_products, moments)
        slave_bubble_rate = np.einsum("iev,qvz->qiez", slave_bubble_products, moment_rates)
        # integrals of a weight function of the slave times products of two monomials
        by_monomials = np.einsum("ia,abcv->ibcv", W, _CUBIC_MONOMIALS).reshape(27, -1)
        A = (moments @ by_monomials.T).reshape(-1, 3, 3, 3)
        dA = (by_monomials @ moment_rates).reshape(-1, 3, 3, 3, 6)
        c, dc = _find_weight_functions_of_projected_triangles(p)
        M = A[:, :, :, 0] @ np.swapaxes(c, 1, 2)
        dM = np.einsum("qib,qkbz->qikz", A[:, :, :, 0], dc)
        dM += np.einsum("qkb,qibz->qikz", c, dA[:, :, :, 0])
        first, second = c[:, ends[:, 0]], c[:, ends[:, 1]]
        A_second = np.einsum("qibc,qec->qieb", A, second)
        master_bubble = np.einsum("qieb,qeb->qie", A_second, first)
        master_bubble_rate = np.einsum("qieb,qebz->qiez", A_second, dc[:, ends[:, 0]])
        master_bubble_rate += np.einsum(
            "qiec,qecz->qiez", np.einsum("qibc,qeb->qiec", A, first), dc[:, ends[:, 1]]
        )
        outer = first[:, :, :, None] * second[:, :, None]
        master_bubble_rate += outer.reshape(-1, 1, 3, 9) @ dA.reshape(-1, 3, 9, 6)
        bubble = np.concatenate([-slave_bubble, master_bubble], axis=2) / 2
        bubble_rate = np.concatenate([-slave_bubble_rate, master_bubble_rate], axis=2) / 2

        def per_area(values: Array, rates: Array) -> tuple[Array, Array]:
            """Return integrals over the areas in space, and derivatives by the corners."""
            shape, n_integrals = values.shape, int(np.prod(values.shape[1:]))
            values, rates = values.reshape(-1, n_integrals), rates.reshape(-1, n_integrals, 6)
            by_corners = (rates @ p_rates) * jacobian[:, None, None]
            by_corners += values[:, :, None] * jacobian_rates[:, None]
            return (values * jacobian[:, None]).reshape(shape), by_corners.reshape(*shape, 18)

        slave_products, slave_products_rate = per_area(D, dD)
        mixed_products, mixed_products_rate = per_area(M, dM)
        bubble_products, bubble_products_rate = per_area(bubble, bubble_rate)
        # the master's corners are in reversed order
        bubbles = [self._slave_bubbles[slave], self._master_bubbles[master][:, ::-1]]
        return FacingParts(
            slave,
            nodes[:, :3],
            nodes[:, 3:],
            nodes,
            slave_products,
            slave_products_rate,
            mixed_products,
            mixed_products_rate,
            np.concatenate(bubbles, axis=1),
            bubble_products,
            bubble_products_rate,
        )

    def _find_near_facing_facet_pairs(self, x: Array) -> tuple[Indices, Indices]:
        """Return the pairs of a triangle of the slave and one of the master that may face.

        A triangle of the master is near if its midpoint is at most h farther from the midpoint of
        the slave's triangle than the nearest midpoint of the master is. Here h is the radius of the
        slave's triangle around its midpoint plus the largest radius of the master's triangles.

        Returns:
            Slave facets (q,) and master facets (q,) of the pairs.
        """
        (middle, radius, normal), (master_middle, master_radius, master_normal) = (
            _measure_triangles(x[facets]) for facets in (self._slave_facets, self._master_facets)
        )
        tree = cKDTree(master_middle)
        reach = radius + master_radius.max() + tree.query(middle)[0]
        neighbours = tree.query_ball_point(middle, reach)
        slave = np.repeat(np.arange(len(middle)), [len(near) for near in neighbours])
        master = np.concatenate([np.asarray(near, dtype=np.int64) for near in neighbours])
        cosine = np.sum(normal[slave] * master_normal[master], axis=1)
        facing = cosine < MAX_COSINE_OF_FACING_OUTWARD_NORMALS
        return slave[facing], master[facing]

    def _average_master_surface_derivatives(self, x: Array) -> list[sp.csr_array]:
        facets, n = self._master_facets, len(x)
        corners = x[facets]
        # derivative of the weight function of corner i, times twice the area: unit normal x edge
        # opposite to i
        opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
        products = np.cross(_measure_triangles(corners)[2][:, None], opposite)
        double_area = np.linalg.norm(np.cross(opposite[:, 0], opposite[:, 1]), axis=1)
        around = np.bincount(facets.ravel(), np.repeat(double_area, 3), minlength=n)
        at_corner = products[:, None] / around[facets][:, :, None, None]
        return [
            sum_into_matrix(at_corner[..., axis], facets[:, :, None], facets[:, None], (n, n))
            for axis in range(3)
        ]

    def _find_closest_master_points(self, x: Array) -> tuple[Indices, Array]:
        points, corners = x[: self.n_slave_nodes], x[self._master_facets]
        middle, radius, _ = _measure_triangles(corners)
        tree = cKDTree(middle)
        # a triangle with a closer point than the nearest midpoint has its midpoint within the reach
        near = tree.query_ball_point(points, tree.query(points)[0] + radius.max())
        point = np.repeat(np.arange(len(points)), [len(part) for part in near])
        triangle = np.concatenate([np.asarray(part, dtype=np.int64) for part in near])
        weights = _find_closest_points_on_triangles(points[point], corners[triangle])
        offset = points[point] - np.einsum("qk,qkx->qx", weights, corners[triangle])
        order = np.lexsort((np.linalg.norm(offset, axis=1), point))
        first = order[np.searchsorted(point[order], np.arange(len(points)))]
        return self._master_facets[triangle[first]], weights[first]

    def _rotate_with_normals_and_master_facets(
        self, vectors: Array, normals: PairOfArrays, positions: PairOfArrays, corners: Indices
    ) -> Array:
        start_edges, edges = (
            np.swapaxes(x[corners[:, 1:]] - x[corners[:, :1]], 1, 2) for x in positions
        )
        F = edges @ np.linalg.pinv(start_edges)
        start_normals, end_normals = normals
        images = (
            np.einsum("mxy,my->mx", F, start)
            for start in (vectors, np.cross(start_normals, vectors))
        )
        rotated = add_image_of_perpendicular(end_normals, *images)
        size, rotated_size = (
            np.linalg.norm(values, axis=1, keepdims=True) for values in (vectors, rotated)
        )
        return np.asarray(rotated * size / np.where(rotated_size > 0, rotated_size, 1.0))

    def _compute_outward_normals_of_master_facets(self, x: Array, corners: Indices) -> Array:
        return _measure_triangles(x[corners])[2]

    def _is_on_master_rim(self, corners: Indices, weights: Array) -> Mask:
        on_rim = np.zeros(len(corners), dtype=bool)
        n = len(self.nodes)
        rim = self._master_rim_edges @ [n, 1]
        for opposite_corner, edge in enumerate(_EDGE_ENDS):
            ends = np.sort(corners[:, edge], axis=1)
            on_rim |= (weights[:, opposite_corner] == 0) & np.isin(ends @ [n, 1], rim)
        at_corner = (weights == 1) & np.isin(corners, self._master_rim_edges)
        return on_rim | at_corner.any(axis=1)


def _select_products_of_linear_monomials() -> Array:
    """Return the array (3, 3, 3, 10) of monomials that are the product of three of 1, s_1, s_2."""
    exponents, selection = _MONOMIAL_EXPONENTS, np.zeros((3, 3, 3, len(_MONOMIAL_EXPONENTS)))
    for a, b, c in np.ndindex(3, 3, 3):
        total = exponents[a] + exponents[b] + exponents[c]
        selection[a, b, c, (exponents == total).all(axis=1)] = 1.0
    return selection


_CUBIC_MONOMIALS = _select_products_of_linear_monomials()
_CONSTANT = np.array([1.0, 0.0, 0.0])  # the monomial 1 among 1, s_1 and s_2


def _number_parallel_edges(local_corners: Indices) -> Indices:
    """Return numbers (f, 3) of the facet edges parallel to the edges of sub-triangles.

    The edges of a triangle are in the order of `_EDGE_ENDS`. The three edges of facet i, which has
    the triangles 4 i to 4 i + 3, have the numbers 3 i to 3 i + 2.

    Args:
        local_corners: (f, 3), corners of the triangles as local nodes of their facets.
    """
    edge = np.array(
        [
            [_PARALLEL_FACET_EDGE[frozenset(corners[ends].tolist())] for ends in _EDGE_ENDS]
            for corners in local_corners
        ]
    )
    return 3 * (np.arange(len(edge)) // 4)[:, None] + edge


def _orient_triangles_outwards(boundary_facets: BoundaryFacets) -> tuple[Indices, Indices]:
    """Return the corners of each sub-triangle, anticlockwise if seen from outside of the body.

    Returns:
        Corners (f, 3) as indices into `boundary_facets.nodes`, and as local nodes of the facets.
    """
    nodes, corners, outward = boundary_facets.sub_facet_nodes_corners_and_normals
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_outward = (np.sum(normal * outward, axis=1) > 0)[:, None]
    index = np.searchsorted(boundary_facets.nodes, nodes)
    local = np.tile(boundary_facets.local_sub_facet_nodes, (len(boundary_facets.facet_nodes), 1))
    return tuple(  # type: ignore[return-value]
        np.where(is_outward, numbers, numbers[:, [0, 2, 1]]) for numbers in (index, local)
    )


def _measure_triangles(corners: Array) -> tuple[Array, Array, Array]:
    """Return midpoints (n, 3), radii (n,) around them, and unit normals (n, 3) of triangles.

    The corners (n, 3, 3) run anticlockwise around the normals.
    """
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return middle, radius, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _make_tangents(normals: Array) -> Array:
    """Return two orthonormal vectors (m, 2, 3) perpendicular to each unit normal (m, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=1)


def _project_onto_slave_triangles(corners: Array) -> tuple[Array, Array, Array]:
    """Project triangles of the master onto triangles of the slave along the latter's normals.

    Args:
        corners: (q, 6, 3), three corners of the slave's triangle, followed by the master's.

    Returns:
        Coordinates p (q, 3, 2) of the master's corners in the edge coordinates of the slave; the
        matrices H (q, 2, 3) that turn vectors into edge coordinates; and the inverse metrics
        (q, 2, 2) of the edges.
    """
    edges = corners[:, 1:3] - corners[:, :1]
    inverse_metric: Array = np.asarray(np.linalg.inv(edges @ np.swapaxes(edges, 1, 2)), dtype=float)
    H = inverse_metric @ edges
    return (corners[:, 3:] - corners[:, :1]) @ np.swapaxes(H, 1, 2), H, inverse_metric


def _differentiate_projection(corners: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of projected coordinates and of the areas of the slave's triangles.

    Args:
        corners: (q, 6, 3), three corners of the slave's triangle, followed by the master's.

    Returns:
        Derivatives (q, 6, 18) of p (see `_project_onto_slave_triangles`) with respect to the
        corners; twice the areas (q,) of the slave's triangles, and their derivatives (q, 18).
    """
    q = len(corners)
    p, H, inverse_metric = _project_onto_slave_triangles(corners)
    a, edges = corners[:, 0], corners[:, 1:3] - corners[:, :1]
    from_a = corners[:, 3:] - a[:, None]
    height = from_a - p @ edges  # parts along the normal
    rates = np.zeros((q, 3, 2, 6, 3))
    for k in range(3):
        rates[:, k, :, 3 + k] += H
        for e in range(2):  # a change of an edge
            by_edge = -p[:, k, e, None, None] * H
            by_edge = by_edge + inverse_metric[:, :, e, None] * height[:, k, None]
            rates[:, k, :, 1 + e] += by_edge
            rates[:, k, :, 0] -= by_edge
        rates[:, k, :, 0] -= H
    area_vector = np.cross(edges[:, 0], edges[:, 1])
    jacobian = np.linalg.norm(area_vector, axis=1)
    normal = area_vector / jacobian[:, None]
    jacobian_rates = np.zeros((q, 6, 3))
    jacobian_rates[:, 1] = np.cross(edges[:, 1], normal)
    jacobian_rates[:, 2] = np.cross(normal, edges[:, 0])
    jacobian_rates[:, 0] = -jacobian_rates[:, 1] - jacobian_rates[:, 2]
    return rates.reshape(q, 6, 18), jacobian, jacobian_rates.reshape(q, 18)


def _integrate_monomials_over_overlaps(p: Array) -> tuple[Array, Array, Mask]:
    """Integrate the monomials of s_1 and s_2 up to degree 3 over polygons.

    A polygon is the intersection of the unit triangle, with the corners (0, 0), (1, 0) and (0, 1),
    and a triangle with the corners p (q, 3, 2), which run anticlockwise.

    Returns:
        The integrals (q, 10), their derivatives (q, 10, 6) with respect to p, and a mask (q,) of
        the polygons that are not empty.
    """
    corner, rate, count = _intersect_with_unit_triangle(p)
    q = len(p)
    n_monomials = len(_MONOMIAL_EXPONENTS)
    moments, moment_rates = np.zeros((q, n_monomials)), np.zeros((q, n_monomials, 6))
    row = np.arange(q)
    degree = _MONOMIAL_EXPONENTS.sum(axis=1)
    for k in range(_MAX_POLYGON_CORNERS):
        following = np.where(k + 1 < count, k + 1, 0)
        exists = (k < count).astype(float)
        start, end = corner[:, k], corner[row, following]
        start_rate, end_rate = rate[:, k], rate[row, following]
        edge = end - start
        cross = exists * (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])
        # a motion v of the edge's ends sweeps the area v x edge
        sweeps = [
            exists[:, None] * (v[:, 0] * edge[:, 1, None] - v[:, 1] * edge[:, 0, None])
            for v in (start_rate, end_rate)
        ]
        for t, weight in zip(_GAUSS_POINTS, _GAUSS_WEIGHTS, strict=True):
            point = start + t * edge
            values = np.prod(point[:, None] ** _MONOMIAL_EXPONENTS, axis=2)
            # by the divergence theorem for homogeneous functions
            moments += weight * values * cross[:, None] / (degree + 2)
            sweep = (1 - t) * sweeps[0] + t * sweeps[1]
            moment_rates += weight * values[:, :, None] * sweep[:, None]
    return moments, moment_rates, count > 0


def _intersect_with_unit_triangle(p: Array) -> tuple[Array, Array, Indices]:
    """Return the corners of the intersections of triangles with the unit triangle.

    The corners p (q, 3, 2) of the triangles run anticlockwise. They are clipped at the three sides
    of the unit triangle in turn (Sutherland and Hodgman, https://doi.org/10.1145/360767.360802).
    Which corners are inside is decided after a shift by `_TIE_BREAKING_SHIFT`.

    Returns:
        The corners (q, 6, 2) of the polygons, of which the first ones are used; their derivatives
        (q, 6, 2, 6) with respect to p; and the numbers (q,) of corners.
    """
    q = len(p)
    corner: Array = np.zeros((q, _MAX_POLYGON_CORNERS, 2))
    rate: Array = np.zeros((q, _MAX_POLYGON_CORNERS, 2, 6))
    corner[:, :3] = p
    rate[:, :3] = np.eye(6).reshape(3, 2, 6)
    count: Indices = np.full(q, 3)
    row = np.arange(q)
    for gradient, constant in (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((-1.0, -1.0), 1.0)):
        direction = np.array(gradient)
        height = constant + corner @ direction
        shifted = height + direction @ _TIE_BREAKING_SHIFT
        height_rate = np.einsum("a,qkac->qkc", direction, rate)
        next_corner, next_rate = np.zeros_like(corner), np.zeros_like(rate)
        size = np.zeros(q, dtype=np.int64)
        for k in range(_MAX_POLYGON_CORNERS):
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
            edge = corner[cut, ends] - corner[cut, k]
            next_corner[cut, size[cut]] = corner[cut, k] + t[:, None] * edge
            next_rate[cut, size[cut]] = (
                (1 - t)[:, None, None] * rate[cut, k]
                + t[:, None, None] * rate[cut, ends]
                + edge[:, :, None] * t_rate[:, None]
            )
            size[cut] += 1
        corner, rate, count = next_corner, next_rate, size
    return corner, rate, count


def _find_weight_functions_of_projected_triangles(p: Array) -> tuple[Array, Array]:
    """Return the weight functions of triangles with the corners p (q, 3, 2), and derivatives.

    Returns:
        Coefficients (q, 3, 3) of 1, s_1 and s_2 for each corner, and their derivatives
        (q, 3, 3, 6) with respect to p.
    """
    values = np.concatenate([np.ones((len(p), 3, 1)), p], axis=2)  # monomials at each corner
    inverse = np.linalg.inv(values)  # (q, monomial, corner)
    rates = np.zeros((len(p), 3, 3, 6))
    for corner in range(3):
        for axis in range(2):
            # d(inverse) = -inverse d(values) inverse; d(values) has one entry
            change = -inverse[:, :, corner, None] * inverse[:, None, 1 + axis]
            rates[..., 2 * corner + axis] = np.swapaxes(change, 1, 2)
    return np.swapaxes(inverse, 1, 2), rates


def _find_closest_points_on_triangles(points: Array, corners: Array) -> Array:
    """Return the weights (q, 3) of the corners at the points of triangles closest to given points.

    Args:
        points: (q, 3), points in space.
        corners: (q, 3, 3), corners of the triangles.
    """
    edges = corners[:, 1:] - corners[:, :1]
    metric = edges @ np.swapaxes(edges, 1, 2)
    right = np.einsum("qex,qx->qe", edges, points - corners[:, 0])
    inner = np.linalg.solve(metric, right[:, :, None])[:, :, 0]
    weights = np.column_stack([1 - inner.sum(axis=1), inner])
    distance = np.where((weights >= 0).all(axis=1), -1.0, np.inf)
    for i, j in _EDGE_ENDS:  # closest points on the edges
        start, edge = corners[:, i], corners[:, j] - corners[:, i]
        t = np.sum((points - start) * edge, axis=1) / np.sum(edge**2, axis=1)
        t = np.clip(t, 0.0, 1.0)
        on_edge = np.linalg.norm(points - start - t[:, None] * edge, axis=1)
        closer = on_edge < distance
        weights[closer] = 0.0
        weights[closer, i], weights[closer, j] = 1 - t[closer], t[closer]
        distance = np.where(closer, on_edge, distance)
    return weights
