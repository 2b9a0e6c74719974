"""Mortar of two deformed sides in space, made of triangles or quadrilaterals between nodes.

The sub-facets of a side are flat triangles, on which weight functions are linear, or quadrilaterals
with bilinear weight functions. The master's are projected onto each of the slave's along the normal
of the latter (`projection`). The products of weight functions are integrated over the overlaps:
exactly for two triangles (`triangles`), otherwise by quadrature (`quadrilaterals`). Distances are
measured between the curved quadratic facets (`sub_facets`).
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.mortars.boundary_facets import BoundaryFacets
from pw_elements.contact.interface.mortars.facing import MortarMatrices
from pw_elements.contact.interface.mortars.facing_in_space import (
    FacetedSides,
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
from pw_elements.contact.interface.mortars.space.projection import (
    differentiate_projection,
    intersect_with_slave_facets,
    project_onto_slave_facets,
)
from pw_elements.contact.interface.mortars.space.quadrilaterals import (
    evaluate_weights_at_points,
    integrate_over_quadrilateral_overlaps,
)
from pw_elements.contact.interface.mortars.space.sub_facets import (
    compute_area_vectors,
    compute_neighbour_connections,
    compute_spanning_edges,
    list_sub_facets,
)
from pw_elements.contact.interface.mortars.space.triangles import integrate_over_triangle_overlaps

# Corners of the triangles by which closest points are found, by the number of corners of a
# sub-facet
_TRIANGLES_BY_CORNER_COUNT = {3: ([0, 1, 2],), 4: ([0, 1, 2], [0, 2, 3])}
# Order of the bubble functions if that of the corners is reversed
_REVERSED_BUBBLE_ORDER_BY_CORNER_COUNT = {3: [2, 1, 0], 4: [2, 1, 0, 3, 4]}
# Corners at the ends of the edges of a triangle
_TRIANGLE_EDGE_ENDS = ((0, 1), (1, 2), (2, 0))


class SpaceSlidingMortar(SlidingMortar):
    """Mortar between two sides in space, each made of the sub-facets of quadratic facets.

    The normal at a slave's node is that of the sum of the area vectors of its sub-facets.

    Args:
        slave: boundary facets of the undeformed slave.
        master: boundary facets of the undeformed master.
    """

    def __init__(self, slave: BoundaryFacets, master: BoundaryFacets) -> None:
        self._sub_facets = [list_sub_facets(side) for side in (slave, master)]
        super().__init__(slave, master, *(side.corners for side in self._sub_facets))
        differences = [side.second_differences for side in self._sub_facets]
        self._second_differences = sp.csr_array(sp.block_diag(differences))
        # number of the second difference of each bubble function of each sub-facet
        self._slave_bubbles, self._master_bubbles = (
            side.bubbles + first
            for side, first in zip(self._sub_facets, (0, differences[0].shape[0]), strict=True)
        )
        # the corners of the master are projected in reversed order
        order = _REVERSED_BUBBLE_ORDER_BY_CORNER_COUNT[self._master_facets.shape[1]]
        self._reversed_master_bubbles = self._master_bubbles[:, order]
        rim_edges = np.stack([self._master_facets, np.roll(self._master_facets, -1, axis=1)], 2)
        edges, count = np.unique(
            np.sort(rim_edges.reshape(-1, 2), axis=1), axis=0, return_counts=True
        )
        self._master_rim_edges = edges[count == 1]

    @property
    def sides(self) -> FacetedSides:
        """Sub-facets of both sides and allowed components of normals, independent of the state."""
        slave, master = self._sub_facets
        return FacetedSides(
            self._slave_facets,
            self._master_facets,
            self.allowed_components,
            slave.facet_nodes,
            master.facet_nodes + self.n_slave_nodes,
            slave.local_corners,
            master.local_corners,
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
        vector = -compute_area_vectors(x[self._slave_facets])
        total = np.zeros((self.n_slave_nodes, 3))
        for corner in self._slave_facets.T:
            np.add.at(total, corner, vector)
        return np.where(self.allowed_components, total, 0.0)

    def _differentiate_slave_normals(self, x: Array) -> NormalsWithDerivatives:
        total = self._sum_area_vectors_into_master(x)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        normals = total / length
        tangents = _make_tangents(normals)
        # derivative of t·(area vector) by corner i is t x (connection of its neighbours)
        connections = compute_neighbour_connections(x[self._slave_facets])
        rates = []
        for tangent in np.swapaxes(tangents, 0, 1):
            # components that are not allowed do not count
            allowed = np.where(self.allowed_components, tangent, 0.0) / length
            by_corner = np.cross(allowed[self._slave_facets][:, :, None], connections[:, None])
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
        k = self._slave_facets.shape[1]
        projected = project_onto_slave_facets(x[nodes], k)
        near = projected.are_convex_and_near()
        slave, master, nodes, projected = (
            slave[near],
            master[near],
            nodes[near],
            projected.select(near),
        )
        polygons = intersect_with_slave_facets(projected)
        # areas in coordinates of the slave's sub-facets, which have the area 1/2 or 1
        fraction = polygons.area * (2 if k == 3 else 1)
        covered = np.bincount(slave, fraction, minlength=len(self._slave_facets))[slave]
        # polygons without area count, as they grow in the direction to which derivatives belong
        facing = (polygons.count > 0) & (covered > MIN_FACING_FRACTION_OF_SLAVE_FACET)
        slave, master, nodes = slave[facing], master[facing], nodes[facing]
        projected, polygons = projected.select(facing), polygons.select(facing)
        has_only_triangles = k == projected.master.shape[1] == 3
        integrals = (
            integrate_over_triangle_overlaps(projected.master, polygons)
            if has_only_triangles
            else integrate_over_quadrilateral_overlaps(projected, polygons)
        )
        variable_rates, jacobian, jacobian_rates = differentiate_projection(x[nodes], k)

        def per_area(values: Array, rates: Array) -> tuple[Array, Array]:
            """Return integrals over the areas in space, and derivatives by the corners."""
            shape, n_integrals = values.shape, int(np.prod(values.shape[1:]))
            values = values.reshape(len(values), n_integrals)
            rates = rates.reshape(*values.shape, rates.shape[-1])
            by_corners = (rates @ variable_rates) * jacobian[:, None, None]
            by_corners += values[:, :, None] * jacobian_rates[:, None]
            by_corners = by_corners.reshape(*shape, by_corners.shape[-1])
            return (values * jacobian[:, None]).reshape(shape), by_corners

        slave_products, slave_products_rate = per_area(
            integrals.slave_products, integrals.slave_products_rate
        )
        mixed_products, mixed_products_rate = per_area(
            integrals.mixed_products, integrals.mixed_products_rate
        )
        bubble_products, bubble_products_rate = per_area(
            integrals.bubble_products, integrals.bubble_products_rate
        )
        bubbles = [self._slave_bubbles[slave], self._reversed_master_bubbles[master]]
        return FacingParts(
            slave,
            nodes[:, :k],
            nodes[:, k:],
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
        """Return the pairs of a sub-facet of the slave and one of the master that may face.

        A sub-facet of the master is near if its midpoint is at most h farther from the midpoint of
        the slave's than the nearest midpoint of the master is. Here h is the radius of the slave's
        sub-facet around its midpoint plus the largest radius of the master's sub-facets.

        Returns:
            Sub-facets (q,) of the slave and of the master in each pair.
        """
        (middle, radius, normal), (master_middle, master_radius, master_normal) = (
            _measure_sub_facets(x[facets]) for facets in (self._slave_facets, self._master_facets)
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
        vector = compute_area_vectors(corners)
        double_area = np.linalg.norm(vector, axis=1)
        # mean derivative of the weight function of a corner, times twice the area: connection of
        # its neighbours x unit normal
        products = np.cross(
            compute_neighbour_connections(corners), (vector / double_area[:, None])[:, None]
        )
        around = np.bincount(facets.ravel(), np.repeat(double_area, facets.shape[1]), minlength=n)
        at_corner = products[:, None] / around[facets][:, :, None, None]
        return [
            sum_into_matrix(at_corner[..., axis], facets[:, :, None], facets[:, None], (n, n))
            for axis in range(3)
        ]

    def _find_closest_master_points(self, x: Array) -> tuple[Indices, Array]:
        points, corners = x[: self.n_slave_nodes], x[self._master_facets]
        middle, radius, _ = _measure_sub_facets(corners)
        tree = cKDTree(middle)
        # a sub-facet with a closer point than the nearest midpoint has its midpoint within reach
        near = tree.query_ball_point(points, tree.query(points)[0] + radius.max())
        point = np.repeat(np.arange(len(points)), [len(part) for part in near])
        facet = np.concatenate([np.asarray(part, dtype=np.int64) for part in near])
        weights, distance = _find_closest_points(points[point], corners[facet])
        order = np.lexsort((distance, point))
        first = order[np.searchsorted(point[order], np.arange(len(points)))]
        facet, weights = facet[first], weights[first]
        if corners.shape[1] == 4:
            weights = _find_bilinear_weights(corners[facet], weights)
        return self._master_facets[facet], weights

    def _rotate_with_normals_and_master_facets(
        self, vectors: Array, normals: PairOfArrays, positions: PairOfArrays, corners: Indices
    ) -> Array:
        start_edges, edges = (compute_spanning_edges(x[corners]) for x in positions)
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
        return _measure_sub_facets(x[corners])[2]

    def _is_on_master_rim(self, corners: Indices, weights: Array) -> Mask:
        on_rim = np.zeros(len(corners), dtype=bool)
        n, k = len(self.nodes), corners.shape[1]
        rim = self._master_rim_edges @ [n, 1]
        for first in range(k):
            edge = [first, (first + 1) % k]
            ends = np.sort(corners[:, edge], axis=1)
            on_edge = ~np.delete(weights, edge, axis=1).any(axis=1)
            on_rim |= on_edge & np.isin(ends @ [n, 1], rim)
        at_corner = (weights == 1) & np.isin(corners, self._master_rim_edges)
        return on_rim | at_corner.any(axis=1)


def _measure_sub_facets(corners: Array) -> tuple[Array, Array, Array]:
    """Return midpoints (n, 3), radii (n,) around them, and unit normals (n, 3) of sub-facets.

    The corners (n, k, 3) run anticlockwise around the normals.
    """
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    normal = compute_area_vectors(corners)
    return middle, radius, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _make_tangents(normals: Array) -> Array:
    """Return two orthonormal vectors (m, 2, 3) perpendicular to each unit normal (m, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=1)


def _find_closest_points(points: Array, corners: Array) -> tuple[Array, Array]:
    """Return the points of sub-facets, divided into triangles, that are closest to given points.

    Args:
        points: (q, 3), points in space.
        corners: (q, k, 3), corners of the sub-facets.

    Returns:
        Weights (q, k) of the corners at the closest points, and distances (q,).
    """
    weights, distance = np.zeros(corners.shape[:2]), np.full(len(points), np.inf)
    for triangle in _TRIANGLES_BY_CORNER_COUNT[corners.shape[1]]:
        part = _find_closest_points_on_triangles(points, corners[:, triangle])
        closest = np.einsum("qk,qkx->qx", part, corners[:, triangle])
        size = np.linalg.norm(points - closest, axis=1)
        closer = np.flatnonzero(size < distance)
        weights[closer] = 0.0
        weights[closer[:, None], triangle] = part[closer]
        distance[closer] = size[closer]
    return weights, distance


def _find_bilinear_weights(corners: Array, weights: Array) -> Array:
    """Return the bilinear functions (q, 4) at points inside of quadrilaterals.

    Points on an edge keep their weights.

    Args:
        corners: (q, 4, 3), corners of the quadrilaterals.
        weights: (q, 4), weights by which the points are interpolated between corners.
    """
    positive = weights > 0
    on_edge = positive.sum(axis=1) <= 2
    on_edge &= ~(positive[:, 0] & positive[:, 2]) & ~(positive[:, 1] & positive[:, 3])
    inside = np.flatnonzero(~on_edge)
    # in a basis of the plane of each quadrilateral
    basis = np.linalg.pinv(compute_spanning_edges(corners[inside]))
    flat = (corners[inside] - corners[inside, :1]) @ np.swapaxes(basis, 1, 2)
    points = np.einsum("qk,qkx->qx", weights[inside], flat)
    result = weights.copy()
    result[inside] = evaluate_weights_at_points(flat, points[:, None])[:, 0]
    return result


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
    for i, j in _TRIANGLE_EDGE_ENDS:  # closest points on the edges
        start, edge = corners[:, i], corners[:, j] - corners[:, i]
        t = np.sum((points - start) * edge, axis=1) / np.sum(edge**2, axis=1)
        t = np.clip(t, 0.0, 1.0)
        on_edge = np.linalg.norm(points - start - t[:, None] * edge, axis=1)
        closer = on_edge < distance
        weights[closer] = 0.0
        weights[closer, i], weights[closer, j] = 1 - t[closer], t[closer]
        distance = np.where(closer, on_edge, distance)
    return weights
