"""Mortars of two deformed sides in the plane, with derivatives with respect to all positions.

Dual functions, forces and gaps are defined as in `mortar`, but at the current positions of both
sides, for which the search for facing facets is repeated. The theory page gives the reasons ("Large
strains"). Let w be weight functions, j and i nodes of the slave, and k a node of the master. With
the integrals over the parts of the slave's facets that face the master,

    D_ji = integral of w_j w_i,   M_jk = integral of w_j w_k,   A_j = integral of w_j,

the mean distance of slave nodes at x_1 from the master's nodes at x_2 is (D x_1 - M x_2) / A. It is
written S x, with a matrix S and the positions x of all nodes. With the normal n and the tangent t,
the gap of a slave node is n·S x. Its slip since the start of the increment, where S was S_0, is
t·(S_0 - S) x. A node that did not face the master at the start has no S_0. Its slip is
t·S x - t_0·S x_0, with the positions x_0 and the tangent t_0 at the start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, AutoDiffArray, Indices, Mask, stack_values_and_derivatives
from pw_elements.contact.interface.facing import (
    MortarMatrices,
    MortarSides,
    evaluate_mortar_matrices,
)
from pw_elements.contact.interface.mortar import BoundaryFacets
from pw_elements.contact.interface.overlap import MAX_COSINE_OF_FACING_OUTWARD_NORMALS

# Three-point Gauss rule on [-1, 1]. It is exact for the product of two weight functions and a
# radius along a segment, which is a cubic. Weight functions of the master, projected onto the
# slave, are not polynomials
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)
# Number of pieces of the straight path along which slip is integrated
N_SLIP_PATH_PIECES = 8
# A slave facet is ignored unless a larger fraction than this faces the master. At smaller fractions
# the dual functions would be dominated by round-off
_MIN_FACING_FRACTION_OF_SLAVE_FACET = 1e-6


PlaneVector: TypeAlias = tuple[Any, Any]  # two components, with or without derivatives


def _cross_product_in_plane(a: PlaneVector, b: PlaneVector) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _dot(a: PlaneVector, b: PlaneVector) -> Any:  # noqa: ANN401
    return a[0] * b[0] + a[1] * b[1]


def sum_into_matrix(
    values: Array, row: Indices, column: Indices, shape: tuple[int, int]
) -> sp.csr_array:
    """Return the sparse matrix with the given values; values at the same position are summed.

    The indices `row` and `column` are broadcast to the shape of `values`.
    """
    indices = tuple(np.broadcast_to(index, values.shape).ravel() for index in (row, column))
    return sp.csr_array(sp.coo_array((values.ravel(), indices), shape))


@dataclass(frozen=True)
class MortarSlipReference:
    """State of both sides at the start of an increment, from which slip is measured.

    Args:
        distance_rows: (m, n), matrix that turns positions into mean distances of the slave's nodes
            from the master; zero for nodes that did not face the master.
        is_facing_master: (m,), mask of the slave's nodes that faced the master.
        x: (n, 2), positions of the nodes of both sides.
        tangents: (m, 2), unit tangents at the slave's nodes.
    """

    distance_rows: sp.csr_array
    is_facing_master: Mask
    x: Array
    tangents: Array


@dataclass(frozen=True)
class LinearisedMortar:
    """Mortar of two sides at given positions, with derivatives with respect to the positions.

    The n nodes consist of the m nodes of the slave, followed by the k nodes of the master. Let S be
    the matrix that turns values at the nodes into weighted mean differences between both sides.

    Args:
        faces_master: (m,), mask of the slave's nodes that face the master.
        normals: (m, 2), unit vectors out of the master.
        mean_distance: (m, 2), mean distances S x of the slave's nodes from the master, at positions
            x; zero for nodes that do not face the master.
        distance_rows: (m, n), the matrix S.
        master_fractions: (m, k), fractions of the force at each node of the slave that the nodes of
            the master receive. They add up to one.
        areas: (m,), integrals of the slave's weight functions.
        angle_rate: (m, 2 n), derivative of the angles of the normals.
        differentiate_mean_differences: function that returns the derivative (2 m, 2 n) of S y with
            respect to the positions, for constant values y (n, 2).
        distance_rate: (2 m, 2 n), derivative of the mean distances S x.
        differentiate_master_forces: function that returns the derivative (2 k, 2 n) of the forces
            on the master's nodes with respect to the positions, for constant forces (m, 2) on the
            slave's nodes.
    """

    faces_master: Mask
    normals: Array
    mean_distance: Array
    distance_rows: sp.csr_array
    master_fractions: sp.csr_array
    areas: Array
    angle_rate: sp.csr_array
    differentiate_mean_differences: Callable[[Array], sp.csr_array]
    distance_rate: sp.csr_array
    differentiate_master_forces: Callable[[Array], sp.csr_array]

    @property
    def tangents(self) -> Array:
        """Unit tangents (m, 2), which are the normals rotated anticlockwise by a right angle."""
        return np.stack([-self.normals[:, 1], self.normals[:, 0]], axis=1)

    @property
    def gaps(self) -> Array:
        """Gaps (m,), mean distances along the normals; zero where the master is not faced."""
        return np.asarray(np.sum(self.normals * self.mean_distance, axis=1))

    def measure_slip_and_gap_slip_angle_derivatives(
        self, reference: MortarSlipReference, x: Array
    ) -> tuple[Array, list[sp.csr_array]]:
        """Return slips since the reference, and derivatives of gaps, slips and normal angles.

        Args:
            reference: state at the start of the increment.
            x: (n, 2), positions at which this mortar has been linearised.

        Returns:
            The slips (m,); and a list of three derivatives (m, 2 n) with respect to the positions:
            those of the gaps, of the slips and of the angles of the normals.
        """
        n, t, m = self.normals, self.tangents, len(self.faces_master)
        entering = self.faces_master & ~reference.is_facing_master
        # S_0 x - S x for nodes that faced the master at the start, S x for all other nodes
        distance = np.where(
            entering[:, None], self.mean_distance, reference.distance_rows @ x - self.mean_distance
        )
        slip = np.sum(t * distance, axis=1)

        def matrix_of_components_along(direction: Array) -> sp.csr_array:
            node = np.arange(m)[:, None]
            return sum_into_matrix(direction, node, 2 * node + np.arange(2), (m, 2 * m))

        gap_rate = matrix_of_components_along(n) @ self.distance_rate
        gap_rate += sp.diags_array(np.sum(t * self.mean_distance, axis=1)) @ self.angle_rate
        sign = np.where(entering, 1.0, -1.0)[:, None]
        slip_rate = matrix_of_components_along(sign * t) @ self.distance_rate
        slip_rate += matrix_of_components_along(t) @ sp.csr_array(
            sp.kron(reference.distance_rows, sp.eye_array(2))
        )
        slip_rate -= sp.diags_array(np.sum(n * distance, axis=1)) @ self.angle_rate
        if entering.any():
            slip -= np.where(
                entering,
                np.sum(reference.tangents * (self.distance_rows @ reference.x), axis=1),
                0.0,
            )
            start_tangents = np.where(entering[:, None], reference.tangents, 0.0)
            slip_rate -= matrix_of_components_along(
                start_tangents
            ) @ self.differentiate_mean_differences(reference.x)
        return slip, [gap_rate, slip_rate, self.angle_rate]


class SlidingMortar:
    """Mortar between two sides in the plane, which can be evaluated at any node positions.

    Args:
        slave: boundary facets of the undeformed slave.
        master: boundary facets of the undeformed master.
        revolved: whether areas are those of the whole circumference (axisymmetric bodies).

    Attributes:
        allowed_components: (m, 2), mask of the components in which normals at the slave's nodes may
            be nonzero; by default all components.
        nodes: (m + k,), global numbers of the slave's nodes, followed by the master's.
        n_slave_nodes: number m of the slave's nodes.
        x: (m + k, 2), undeformed positions of the nodes.
    """

    def __init__(self, slave: BoundaryFacets, master: BoundaryFacets, revolved: bool) -> None:
        self.nodes = np.concatenate([slave.nodes, master.nodes])
        self.x = np.concatenate([slave.node_positions(), master.node_positions()])
        self.n_slave_nodes, self._revolved = len(slave.nodes), revolved
        self._slave_facets = _orient_facets_with_outside_on_right(slave)
        self._master_facets = _orient_facets_with_outside_on_right(master) + self.n_slave_nodes
        self.allowed_components = np.ones((self.n_slave_nodes, 2), dtype=bool)
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
        """Return the mortar matrices at node positions x (n, 2), for verification.

        They are computed by code that `linearise` does not use.
        """
        return evaluate_mortar_matrices(self.sides, x)

    def linearise(self, x: Array) -> LinearisedMortar:
        """Return the mortar at node positions x (n, 2), with its derivatives."""
        n, m, f = len(x), self.n_slave_nodes, len(self._slave_facets)
        facet, nodes, (W, dW), (Q, dQ) = self._integrate_weight_products_over_facing_segments(x)
        slave_nodes, master_nodes = nodes[:, 1:3], nodes[:, 4:]
        dofs = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 12)  # columns of derivatives
        # integrals of products of the weight functions of both ends a and b of each facet, and the
        # matrix that sums them to areas
        facet_integrals = np.zeros((f, 3))
        np.add.at(facet_integrals, facet, W)
        lumped = np.array([[1, 1, 0], [0, 1, 1]])
        integral_index = 3 * np.arange(f)[:, None] + np.arange(3)
        area_by_integral = sum_into_matrix(
            np.tile(lumped, (f, 1, 1)),
            self._slave_facets[:, :, None],
            integral_index[:, None],
            (m, 3 * f),
        )
        areas = area_by_integral @ facet_integrals.ravel()
        faced = areas > 0
        inverse_area = 1 / (areas + ~faced)
        integral_by_x = sum_into_matrix(
            dW, integral_index[facet][:, :, None], dofs[:, None], (3 * f, 2 * n)
        )
        # coefficients of the dual functions (of a at a and b, of b at a and b) divided by areas.
        # They depend on five variables: three integrals of the facet and the areas of both ends
        variables = np.column_stack([facet_integrals[facet], areas[slave_nodes]])
        units = np.tile(np.eye(5)[:, None], (len(variables), 1))
        aa, ab, bb, A, B = (AutoDiffArray(variables[:, v], units[v]) for v in range(5))
        determinant = aa * bb - ab**2.0
        a_factor, b_factor = (aa + ab) / (determinant * A), (ab + bb) / (determinant * B)
        duals, dual_derivatives = (
            values.reshape(-1, 2, 2, *values.shape[2:])
            for values in stack_values_and_derivatives(
                [bb * a_factor, -ab * a_factor, -ab * b_factor, aa * b_factor]
            )
        )
        master_fractions = sum_into_matrix(
            duals @ Q, slave_nodes[:, :, None], master_nodes[:, None] - m, (m, n - m)
        )

        def differentiate_master_forces(force: Array) -> sp.csr_array:
            row = (2 * (master_nodes - m)[:, :, None] + np.arange(2))[..., None]
            direct = np.einsum("qjx,qji,qikc->qkxc", force[slave_nodes], duals, dQ)
            by_variable = np.einsum("qjx,qjiv,qik->qkxv", force[slave_nodes], dual_derivatives, Q)
            variable = np.concatenate([integral_index[facet], 3 * f + slave_nodes], axis=1)
            variable = variable[:, None, None]
            variable_by_x = sp.vstack([integral_by_x, area_by_integral @ integral_by_x])
            indirect = sum_into_matrix(by_variable, row, variable, (2 * (n - m), 3 * f + m))
            return sum_into_matrix(direct, row, dofs[:, None, None], (2 * (n - m), 2 * n)) + (
                indirect @ variable_by_x
            )

        D, dD = (v[:, [[0, 1], [1, 2]]] for v in (W, dW))
        distance_rows = sp.diags_array(inverse_area) @ (
            sum_into_matrix(D, slave_nodes[:, :, None], slave_nodes[:, None], (m, n))
            - sum_into_matrix(Q, slave_nodes[:, :, None], master_nodes[:, None], (m, n))
        )
        mean_distance = distance_rows @ x

        def differentiate_mean_differences(constant_nodal_values: Array) -> sp.csr_array:
            # (q, 2, 2, 2), difference between y at node i and the mean S y of node j
            difference = (
                constant_nodal_values[slave_nodes][:, None]
                - (distance_rows @ constant_nodal_values)[slave_nodes][:, :, None]
            )
            derivative = np.einsum("qjic,qjix->qjxc", dD, difference)
            derivative -= np.einsum("qjkc,qkx->qjxc", dQ, constant_nodal_values[master_nodes])
            row = (2 * slave_nodes[:, :, None] + np.arange(2))[..., None]
            derivative = derivative * inverse_area[slave_nodes][:, :, None, None]
            return sum_into_matrix(derivative, row, dofs[:, None, None], (2 * m, 2 * n))

        distance_rate = differentiate_mean_differences(x) + sp.kron(distance_rows, sp.eye_array(2))
        normals, angle_rate = self._average_slave_normals_and_angle_derivatives(x)
        return LinearisedMortar(
            faced,
            normals,
            mean_distance,
            distance_rows,
            master_fractions,
            areas,
            angle_rate,
            differentiate_mean_differences,
            distance_rate,
            differentiate_master_forces,
        )

    def _average_slave_normals_and_angle_derivatives(self, x: Array) -> tuple[Array, sp.csr_array]:
        """Return unit normals (m, 2) at the slave's nodes, and derivatives of their angles.

        Each normal is perpendicular to the chord between the two neighbours of its node. The
        derivatives (m, 2 n) are with respect to the positions x (n, 2). They are zero where a
        component of the normal is not allowed.
        """
        chord = x[self._next_node] - x[self._previous_node]
        perpendicular = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
        node = np.arange(self.n_slave_nodes)[:, None]
        angle_by_end = perpendicular / np.sum(chord**2, axis=1, keepdims=True)
        angle_by_end[~self.allowed_components.all(axis=1)] = 0.0
        ends = np.stack([self._next_node, self._previous_node], axis=1)
        column = 2 * ends[:, :, None] + np.arange(2)
        signed = angle_by_end[:, None] * np.array([1, -1])[:, None]
        shape = len(chord), x.size
        normals = np.stack(
            self._normalise_allowed_components(tuple(perpendicular.T), slice(None)), axis=1
        )
        return normals, sum_into_matrix(signed, node[:, :, None], column, shape)

    def _integrate_weight_products_over_facing_segments(
        self, x: Array
    ) -> tuple[Indices, Indices, tuple, tuple]:
        """Integrate products of weight functions over all q segments.

        A segment is a part of a slave facet that faces one master facet. It depends on six nodes:
        the node before the slave facet, the ends a and b of the slave facet, the node after it, and
        both ends of the master facet.

        Returns:
            The slave facet (q,) of each segment; its six nodes (q, 6); the integrals (q, 3) of the
            products aa, ab and bb of the slave's weight functions; and the integrals (q, 2, 2) of
            the products of a slave and a master weight function. Both kinds of integrals are tuples
            of values and derivatives (..., 12) with respect to the positions of the six nodes.
        """
        facet, master_facet = self._find_near_facing_facet_pairs(x)
        (a, b), (c, d) = self._slave_facets[facet].T, self._master_facets[master_facet].T
        nodes = np.stack([self._previous_node[a], a, b, self._next_node[b], c, d], axis=1)
        corners: Any = [(x[node, 0], x[node, 1]) for node in nodes.T]
        low, high = self._find_limits_of_facing_parts(corners, nodes)
        length = np.maximum(0.0, np.minimum(high, 1.0) - np.maximum(low, -1.0)) / 2
        covered = np.bincount(facet, length, minlength=len(self._slave_facets))[facet]
        facing = (length > 0) & (covered > _MIN_FACING_FRACTION_OF_SLAVE_FACET)
        facet, nodes = facet[facing], nodes[facing]
        units: Any = np.eye(12).reshape(6, 2, 1, 12) + np.zeros((len(facet), 1))
        corners = [
            tuple(AutoDiffArray(x[node, axis], unit[axis]) for axis in (0, 1))
            for node, unit in zip(nodes.T, units, strict=True)
        ]
        W, Q = self._integrate_weight_function_products(
            corners, nodes, (low[facing] < -1, high[facing] > 1)
        )
        Q_value, Q_derivative = stack_values_and_derivatives(Q)
        return (
            facet,
            nodes,
            stack_values_and_derivatives(W),
            (Q_value.reshape(-1, 2, 2), Q_derivative.reshape(-1, 2, 2, 12)),
        )

    def make_slip_reference(self, x: Array) -> MortarSlipReference:
        """Return the state from which slip is measured, for node positions x (m + k, 2)."""
        mortar = self.linearise(x)
        return MortarSlipReference(mortar.distance_rows, mortar.faces_master, x, mortar.tangents)

    def integrate_slip_along_path(self, start_positions: Array, end_positions: Array) -> Array:
        """Return the slip (m, 2) along the straight path from start to end positions (n, 2).

        The path is divided into `N_SLIP_PATH_PIECES` pieces. On each piece, the slip of a slave
        node j is measured relative to the material point p of the master that is closest to j at
        the end of the piece. It is the change of t·(x_j - x_p) from the start to the end of the
        piece, with the tangent t.
        """
        slip, previous_x = np.zeros(self.n_slave_nodes), start_positions
        previous_tangents = self._average_slave_tangents(start_positions)
        for fraction in np.arange(1, N_SLIP_PATH_PIECES + 1) / N_SLIP_PATH_PIECES:
            next_x = (1 - fraction) * start_positions + fraction * end_positions
            ends, fractions = self._find_closest_master_facets_and_weights(next_x)
            next_tangents = self._average_slave_tangents(next_x)
            for x, tangents, sign in (
                (next_x, next_tangents, 1.0),
                (previous_x, previous_tangents, -1.0),
            ):
                closest = np.einsum("jk,jkx->jx", fractions, x[ends])
                slip += sign * np.sum(tangents * (x[: self.n_slave_nodes] - closest), axis=1)
            previous_x, previous_tangents = next_x, next_tangents
        return slip[:, None] * previous_tangents

    def measure_max_penetration_along_path(
        self, start_positions: Array, end_positions: Array
    ) -> Array:
        """Return the largest depth (m,) to which slave nodes penetrate the master on their path.

        The path from `start_positions` (n, 2) to `end_positions` (n, 2) is straight, and is sampled
        at the ends of `2 N_SLIP_PATH_PIECES` pieces. The depth counts as zero for nodes that start
        inside the master by more than the length of a facet, and wherever the closest point is an
        end of the master.
        """
        end_nodes = np.setdiff1d(*self._master_facets.T), np.setdiff1d(*self._master_facets.T[::-1])
        depth, outside = np.zeros(self.n_slave_nodes), np.zeros(self.n_slave_nodes, dtype=bool)
        for piece, fraction in enumerate(np.linspace(0, 1, 2 * N_SLIP_PATH_PIECES + 1)):
            x = (1 - fraction) * start_positions + fraction * end_positions
            ends, fractions = self._find_closest_master_facets_and_weights(x)
            edge = x[ends[:, 1]] - x[ends[:, 0]]
            from_closest = x[: self.n_slave_nodes] - np.einsum("jk,jkx->jx", fractions, x[ends])
            height = np.sum(edge[:, ::-1] * [1, -1] * from_closest, axis=1)
            height /= np.linalg.norm(edge, axis=1)
            at_end = (np.isin(ends, np.concatenate(end_nodes)) & (fractions == 1)).any(axis=1)
            if piece == 0:
                outside = height > -self.measure_shortest_facet_at_slave_nodes()
            depth = np.maximum(depth, np.where(at_end, 0.0, -height))
        return np.where(outside, depth, 0.0)

    def measure_shortest_facet_at_slave_nodes(self) -> Array:
        """Return the length (m,) of the shortest undeformed facet at each slave node."""
        shortest = np.full(self.n_slave_nodes, np.inf)
        edges = np.diff(self.x[self._slave_facets], axis=1)[:, 0]
        for end in self._slave_facets.T:
            np.minimum.at(shortest, end, np.linalg.norm(edges, axis=1))
        return shortest

    def _average_slave_tangents(self, x: Array) -> Array:
        normals = self._average_slave_normals_and_angle_derivatives(x)[0]
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)

    def _find_closest_master_facets_and_weights(self, x: Array) -> tuple[Indices, Array]:
        """Find the point of the master that is closest to each of the slave's nodes.

        Returns:
            The two nodes (m, 2) of the master facet that contains the closest point, and their
            weights (m, 2), by which the point is interpolated between them.
        """
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
        n, _ = self._average_slave_normals_and_angle_derivatives(x)
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
