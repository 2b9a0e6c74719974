"""Mortar integrals of two deformed sides in the plane, with derivatives.

The sides are straight sub-facets between neighbouring nodes. A sub-facet of the slave faces a
sub-facet of the master where normals of the slave, which are interpolated between its nodes, point
to it. The theory page has the formulas ("Large strains").
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, AutoDiffArray, Indices, Mask, stack_values_and_derivatives
from pw_elements.contact.interface.mortars.boundary_facets import BoundaryFacets
from pw_elements.contact.interface.mortars.facing import (
    MortarMatrices,
    MortarSides,
    evaluate_mortar_matrices,
)
from pw_elements.contact.interface.mortars.overlap import MAX_COSINE_OF_FACING_OUTWARD_NORMALS
from pw_elements.contact.interface.mortars.sliding import (
    MIN_FACING_FRACTION_OF_SLAVE_FACET,
    FacingParts,
    NormalsWithDerivatives,
    PairOfArrays,
    SlidingMortar,
    rotate_with_normal,
    sum_into_matrix,
)

# Three-point Gauss rule on [-1, 1]. It is exact for the product of two weight functions and a
# radius along a segment, which is a cubic. Weight functions of the master, projected onto the
# slave, are not polynomials
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


PlaneVector: TypeAlias = tuple[Any, Any]  # two components, with or without derivatives


def _cross_product_in_plane(a: PlaneVector, b: PlaneVector) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _dot(a: PlaneVector, b: PlaneVector) -> Any:  # noqa: ANN401
    return a[0] * b[0] + a[1] * b[1]


class PlaneSlidingMortar(SlidingMortar):
    """Mortar between two sides in the plane.

    Args:
        slave: boundary facets of the undeformed slave.
        master: boundary facets of the undeformed master.
        revolved: whether areas are those of the whole circumference (axisymmetric bodies).
    """

    def __init__(self, slave: BoundaryFacets, master: BoundaryFacets, revolved: bool) -> None:
        super().__init__(
            slave,
            master,
            _orient_facets_with_outside_on_right(slave),
            _orient_facets_with_outside_on_right(master),
        )
        self._revolved = revolved
        a, b = self._slave_facets.T
        # neighbours along the slave; the missing neighbour of an end node is the node itself
        self._previous_node, self._next_node = (np.arange(self.n_slave_nodes) for _ in range(2))
        self._previous_node[b], self._next_node[a] = a, b

    @property
    def sides(self) -> MortarSides:
        """Facets of both sides and allowed components of normals, independent of the state."""
        return MortarSides(
            self._slave_facets, self._master_facets, self.allowed_components, self._revolved
        )

    def evaluate_mortar_matrices_independently(self, x: Array) -> MortarMatrices:
        return evaluate_mortar_matrices(self.sides, x)

    def _differentiate_slave_normals(self, x: Array) -> NormalsWithDerivatives:
        """Return the normals at the slave's nodes for nodes at positions x (n, 2).

        Each normal is perpendicular to the chord between the two neighbours of its node. Its
        derivative is zero where a component of the normal is not allowed. The tangents are the
        normals rotated anticlockwise by a right angle, so that derivatives along them are those of
        the angles of the normals.
        """
        chord = x[self._next_node] - x[self._previous_node]
        perpendicular = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
        node = np.arange(self.n_slave_nodes)[:, None]
        angle_by_end = perpendicular / np.sum(chord**2, axis=1, keepdims=True)
        angle_by_end[~self.allowed_components.all(axis=1)] = 0.0
        ends = np.stack([self._next_node, self._previous_node], axis=1)
        column = 2 * ends[:, :, None] + np.arange(2)
        signed = angle_by_end[:, None] * np.array([1, -1])[:, None]
        normals = self._average_slave_normals(x)
        tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        angle_rate = sum_into_matrix(signed, node[:, :, None], column, (len(chord), x.size))
        return NormalsWithDerivatives(normals, tangents[:, None], [angle_rate])

    def _average_slave_normals(self, x: Array) -> Array:
        chord = x[self._next_node] - x[self._previous_node]
        return np.stack(
            self._normalise_allowed_components((-chord[:, 1], chord[:, 0]), slice(None)), axis=1
        )

    def _average_master_surface_derivatives(self, x: Array) -> list[sp.csr_array]:  # noqa: ARG002
        return []

    def _rotate_with_normals_and_master_facets(
        self,
        vectors: Array,
        normals: PairOfArrays,
        positions: PairOfArrays,  # noqa: ARG002
        corners: Indices,  # noqa: ARG002
    ) -> Array:
        return rotate_with_normal(vectors, *normals)

    def _compute_outward_normals_of_master_facets(self, x: Array, corners: Indices) -> Array:
        edge = x[corners[:, 1]] - x[corners[:, 0]]
        return edge[:, ::-1] * [1, -1] / np.linalg.norm(edge, axis=1, keepdims=True)

    def _is_on_master_rim(self, corners: Indices, weights: Array) -> Mask:
        first, second = self._master_facets.T
        end_nodes = np.concatenate([np.setdiff1d(first, second), np.setdiff1d(second, first)])
        return (np.isin(corners, end_nodes) & (weights == 1)).any(axis=1)

    def _integrate_over_facing_parts(self, x: Array) -> FacingParts:
        """Return the integrals over the facing parts for nodes at positions x (n, 2).

        A part is a segment, which depends on six nodes: the node before the slave facet, both ends
        of the slave facet, the node after it, and both ends of the master facet.
        """
        facet, master_facet = self._find_near_facing_facet_pairs(x)
        (a, b), (c, d) = self._slave_facets[facet].T, self._master_facets[master_facet].T
        nodes = np.stack([self._previous_node[a], a, b, self._next_node[b], c, d], axis=1)
        corners: Any = [(x[node, 0], x[node, 1]) for node in nodes.T]
        low, high = self._find_limits_of_facing_parts(corners, nodes)
        length = np.maximum(0.0, np.minimum(high, 1.0) - np.maximum(low, -1.0)) / 2
        covered = np.bincount(facet, length, minlength=len(self._slave_facets))[facet]
        facing = (length > 0) & (covered > MIN_FACING_FRACTION_OF_SLAVE_FACET)
        facet, nodes = facet[facing], nodes[facing]
        units: Any = np.eye(12).reshape(6, 2, 1, 12) + np.zeros((len(facet), 1))
        corners = [
            tuple(AutoDiffArray(x[node, axis], unit[axis]) for axis in (0, 1))
            for node, unit in zip(nodes.T, units, strict=True)
        ]
        W, Q = self._integrate_weight_function_products(
            corners, nodes, (low[facing] < -1, high[facing] > 1)
        )
        mixed, mixed_rate = stack_values_and_derivatives(Q)
        return FacingParts(
            facet,
            nodes[:, 1:3],
            nodes[:, 4:],
            nodes,
            *stack_values_and_derivatives(W),
            mixed.reshape(-1, 2, 2),
            mixed_rate.reshape(-1, 2, 2, 12),
            np.zeros((len(facet), 0), dtype=np.int64),
            np.zeros((len(facet), 2, 0)),
            np.zeros((len(facet), 2, 0, 12)),
        )

    def _find_closest_master_points(self, x: Array) -> tuple[Indices, Array]:
        start = x[self._master_facets[:, 0]]
        edge = x[self._master_facets[:, 1]] - start
        from_start = x[: self.n_slave_nodes, None] - start
        fractions = np.sum(from_start * edge, axis=2) / np.sum(edge**2, axis=1)
        fractions = np.clip(fractions, 0.0, 1.0)
        distance = np.linalg.norm(from_start - fractions[..., None] * edge, axis=2)
        nearest = distance.argmin(axis=1)
        fraction = fractions[np.arange(self.n_slave_nodes), nearest]
        return self._master_facets[nearest], np.stack([1 - fraction, fraction], axis=1)

    def _normalise_allowed_components(self, vector: PlaneVector, slave_node: Any) -> PlaneVector:  # noqa: ANN401
        """Return the unit vector along the allowed components of a vector at slave nodes."""
        x, y = (
            vector[0] * self.allowed_components[slave_node, 0],
            vector[1] * self.allowed_components[slave_node, 1],
        )
        inverse_length = _dot((x, y), (x, y)) ** -0.5
        return x * inverse_length, y * inverse_length

    def _find_near_facing_facet_pairs(self, x: Array) -> tuple[Indices, Indices]:
        """Return the pairs of a slave facet and a master facet that are near and face each other.

        A master facet is near if its midpoint is at most h farther from the slave facet's midpoint
        than the nearest master midpoint is. Here h is half the length of the slave facet plus half
        the length of the longest master facet. Since distances do not depend on the coordinate
        axes, the result is the same for rotated bodies.

        Returns:
            Slave facets (q,) and master facets (q,) of the pairs.
        """
        (middles, half_lengths), (master_middles, master_half_lengths) = (
            (ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2)
            for ends in (x[self._slave_facets], x[self._master_facets])
        )
        tree = cKDTree(master_middles)
        radius = half_lengths + master_half_lengths.max() + tree.query(middles)[0]
        neighbours = tree.query_ball_point(middles, radius)
        facet = np.repeat(np.arange(len(middles)), [len(near) for near in neighbours])
        master_facet = np.concatenate([np.asarray(near, dtype=np.int64) for near in neighbours])
        (a, b), edge = self._slave_facets.T, np.diff(x[self._master_facets], axis=1)[:, 0]
        n = self._average_slave_normals(x)
        outward = edge[:, ::-1] * [1, -1] / np.linalg.norm(edge, axis=1, keepdims=True)
        cosine = np.sum((n[a] + n[b])[facet] * outward[master_facet], axis=1)
        facing = cosine > -2 * MAX_COSINE_OF_FACING_OUTWARD_NORMALS
        return facet[facing], master_facet[facing]

    def _compute_linear_coefficients_of_points_and_normals(
        self, node_positions: Sequence[PlaneVector], segment_nodes: Indices
    ) -> tuple[PlaneVector, ...]:
        """Return x_0, x_1, n_0 and n_1, which define points and normals on slave facets.

        Points are x_0 + s x_1 and normals n_0 + s n_1, with the coordinate s from -1 to 1 along the
        facet. Normals are interpolated linearly between the unit normals at both ends.
        """
        previous_node, a, b, next_node = node_positions[:4]
        normals = [
            self._normalise_allowed_components(
                (low[1] - high[1], high[0] - low[0]), segment_nodes[:, k]
            )
            for k, (low, high) in ((1, (previous_node, b)), (2, (a, next_node)))
        ]
        return tuple(
            ((low[0] + sign * high[0]) * 0.5 * sign, (low[1] + sign * high[1]) * 0.5 * sign)
            for low, high in ((a, b), normals)
            for sign in (1.0, -1.0)
        )

    def _find_limits_of_facing_parts(
        self, node_positions: Sequence[PlaneVector], segment_nodes: Indices
    ) -> tuple[Array, Array]:
        """Return lower and upper limits (q,) of the parts of slave facets that face the master.

        Limits are values of the coordinate s and may be outside [-1, 1]. With the point x(s) and
        the normal n(s), they are roots of f(s) = (x(s) - p) x n(s), where p is an end of the master
        facet. On the side of p on which the master facet lies, f is positive for the lower limit
        and negative for the upper limit. If f decreases with s, the master facet is visible only
        beyond the point where the normals intersect, and does not face the slave facet.
        """
        limits = []
        for side, (c0, c1, c2) in zip(
            (-1.0, 1.0),
            self._compute_polynomials_of_facing_limits(node_positions, segment_nodes),
            strict=True,
        ):
            root = _find_quadratic_root_nearest_zero(c0, c1, c2)
            has_root = np.abs(root) <= 1  # False for NaN
            without_root = np.where(c0 * side < 0, side * np.inf, -side * np.inf)
            limits.append(np.where(has_root, np.where(c1 > 0, root, -side * np.inf), without_root))
        return limits[0], limits[1]

    def _compute_polynomials_of_facing_limits(
        self, node_positions: Sequence[PlaneVector], segment_nodes: Indices
    ) -> list[tuple[Any, Any, Any]]:
        """Return the coefficients c_0, c_1 and c_2 of the quadratic f(s) = (x(s) - p) x n(s).

        x(s) and n(s) are points and normals on the slave facets. The first polynomial is for the
        lower limit, at which p is the second node of the master facet. The second polynomial is for
        the upper limit, at which p is the first node. The reason for this order is that the two
        sides are traversed in opposite directions.
        """
        x0, x1, n0, n1 = self._compute_linear_coefficients_of_points_and_normals(
            node_positions, segment_nodes
        )
        coefficients = []
        for node in (node_positions[5], node_positions[4]):
            from_node = x0[0] - node[0], x0[1] - node[1]
            c1 = _cross_product_in_plane(x1, n0) + _cross_product_in_plane(from_node, n1)
            coefficients.append(
                (_cross_product_in_plane(from_node, n0), c1, _cross_product_in_plane(x1, n1))
            )
        return coefficients

    def _integrate_weight_function_products(
        self,
        node_positions: Sequence[PlaneVector],
        segment_nodes: Indices,
        reaches_facet_end: tuple[Mask, Mask],
    ) -> tuple[list[Any], list[Any]]:
        """Integrate the products of weight functions that `linearise` needs over segments.

        Args:
            node_positions: positions of the six nodes of each segment, with derivatives.
            segment_nodes: (q, 6), the six nodes of each segment.
            reaches_facet_end: masks (q,) for the lower and the upper limit: whether the segment
                extends to this end of the slave facet.

        Returns:
            With the ends a and b of the slave facet, and c and d of the master facet: integrals of
            w_a w_a, w_a w_b and w_b w_b; and integrals of w_a w_c, w_a w_d, w_b w_c and w_b w_d.
            All of them have derivatives with respect to the node positions.
        """
        q, ends = len(segment_nodes), list[Any]()
        x0, x1, n0, n1 = self._compute_linear_coefficients_of_points_and_normals(
            node_positions, segment_nodes
        )
        quadratics = self._compute_polynomials_of_facing_limits(node_positions, segment_nodes)
        for coefficients, is_end, side in zip(
            quadratics, reaches_facet_end, (-1.0, 1.0), strict=True
        ):
            ends.append(
                _set_constant_where(is_end, side, _find_quadratic_root_nearest_zero(*coefficients))
            )
        index, t = np.repeat(np.arange(q), len(_GAUSS_POINTS)), np.tile(_GAUSS_POINTS, q)
        half_extent = (ends[1] - ends[0]) * 0.5
        s = ((ends[0] + ends[1]) * 0.5)[index] + half_extent[index] * t
        measure = (half_extent * _dot(x1, x1) ** 0.5)[index] * np.tile(_GAUSS_WEIGHTS, q)
        point, direction = (
            (mean[0][index] + half[0][index] * s, mean[1][index] + half[1][index] * s)
            for mean, half in ((x0, x1), (n0, n1))
        )
        if self._revolved:
            measure = measure * point[0] * (2 * np.pi)
        c, d = node_positions[4:]
        from_c = point[0] - c[0][index], point[1] - c[1][index]
        edge = (d[0] - c[0])[index], (d[1] - c[1])[index]
        master_coordinate = _cross_product_in_plane(from_c, direction) / _cross_product_in_plane(
            edge, direction
        )
        w = (1 - s) * 0.5, (1 + s) * 0.5

        def sum_over_gauss_points(v: AutoDiffArray) -> AutoDiffArray:
            parts = (
                values.reshape(q, len(_GAUSS_POINTS), *values.shape[1:])
                for values in vars(v).values()
            )
            return AutoDiffArray(*(part.sum(axis=1) for part in parts))

        W = [sum_over_gauss_points(measure * w[i] * w[j]) for i, j in ((0, 0), (0, 1), (1, 1))]
        return W, [
            sum_over_gauss_points(measure * w_i * v)
            for w_i in w
            for v in (1 - master_coordinate, master_coordinate)
        ]


def _find_quadratic_root_nearest_zero(c0: Any, c1: Any, c2: Any) -> Any:  # noqa: ANN401
    """Return the root of c_0 + c_1 s + c_2 s^2 that is nearer to zero, or NaN if there is none."""
    sign = np.where(getattr(c1, "value", c1) < 0, -1.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return c0 * -2.0 / (c1 + (c1**2.0 - c0 * c2 * 4.0) ** 0.5 * sign)


def _set_constant_where(
    is_constant: Mask, constant: float, numbers: AutoDiffArray
) -> AutoDiffArray:
    """Return a copy of numbers (n,), set to a constant where `is_constant` (n,) is true.

    The numbers that the constant replaces may be NaN.
    """
    derivative = np.where(is_constant[:, None], 0.0, numbers.derivative)
    return AutoDiffArray(np.where(is_constant, constant, numbers.value), derivative)


def _orient_facets_with_outside_on_right(boundary_facets: BoundaryFacets) -> Indices:
    """Return the two nodes (f, 2) of each sub-facet, as indices into `boundary_facets.nodes`.

    The outside is on the right of the direction from the first to the second node.
    """
    nodes, corners, outward = boundary_facets.sub_facet_nodes_corners_and_normals
    edge = corners[:, 1] - corners[:, 0]
    is_right = np.sum(edge[:, ::-1] * [1, -1] * outward, axis=1) > 0
    index = np.searchsorted(boundary_facets.nodes, nodes)
    return np.where(is_right[:, None], index, index[:, ::-1])
