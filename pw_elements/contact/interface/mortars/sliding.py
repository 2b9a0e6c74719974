"""Mortars of two deformed sides, with derivatives with respect to the positions of all nodes.

Dual functions, forces and gaps are defined as in `overlap_quadrature`, but at the current positions
of both sides, for which the search for facing facets is repeated. The theory page gives the reasons
("Large strains"). Let w be weight functions, j and i nodes of the slave, and k a node of the
master. With the integrals over the parts of the slave's facets that face the master,

    D_ji = integral of w_j w_i,   M_jk = integral of w_j w_k,   A_j = integral of w_j,

the mean distance of slave nodes at x_1 from the master's nodes at x_2 is (D x_1 - M x_2) / A. In
space, distances are measured between the curved quadratic facets: the same integrals of bubble
functions, products of two weight functions, are added, times the second differences of positions
along the edges of the facets (`space`). The mean distance is written S x, with a matrix S and the
positions x of all nodes. With the normal n and the tangents t,
the gap of a slave node is n·S x. Its slip since the start of the increment, where S was S_0, is
t·(S_0 - S) x. A node that did not face the master at the start has no S_0. Its slip is
t·(S x - R d_0), where d_0 is the tangential part of S x_0 with the positions x_0 and the normal n_0
at the start. R is a rotation that turns n_0 into n. In the plane there is only one. In space, it
rotates about the normal as the master's surface does in the mean over the part that the node faces:
with the mean surface deformation gradient F of this part, and the tangential part U of F for
directions perpendicular to n_0, R is the rotation that is closest to U. With n_0 x t_0 = s_0,

    R t_0 = r / |r|,   r = U t_0 - n x U s_0,   R s_0 = n x R t_0.

Plane and space differ in the facets, which are segments, triangles or quadrilaterals, in the
integrals over their facing parts and in the normals. These are in `plane` and `space`; all else is
here. The dimension of space is d. A facet of the slave has k corners, and one of the master l.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.mortars.boundary_facets import BoundaryFacets
from pw_elements.contact.interface.mortars.facing import MortarMatrices

PairOfArrays: TypeAlias = tuple[Array, Array]
# Number of pieces of the straight path along which slip is integrated
N_SLIP_PATH_PIECES = 8
# A slave facet is ignored unless a larger fraction than this faces the master. At smaller fractions
# the dual functions would be dominated by round-off
MIN_FACING_FRACTION_OF_SLAVE_FACET = 1e-6
# Smallest divisor of vectors that are rotated with the normal
_MIN_ROTATION_DIVISOR = 1e-3


def sum_into_matrix(
    values: Array, row: Indices, column: Indices, shape: tuple[int, int]
) -> sp.csr_array:
    """Return the sparse matrix with the given values; values at the same position are summed.

    The indices `row` and `column` are broadcast to the shape of `values`.
    """
    indices = tuple(np.broadcast_to(index, values.shape).ravel() for index in (row, column))
    return sp.csr_array(sp.coo_array((values.ravel(), indices), shape))


def number_unique_products(k: int) -> Indices:
    """Return the numbers (k, k) of the products of k functions, equal for equal products."""
    number = np.zeros((k, k), dtype=np.int64)
    i, j = np.triu_indices(k)
    number[i, j] = number[j, i] = np.arange(len(i))
    return number


@dataclass(frozen=True)
class FacingParts:
    """Integrals over the q parts of the slave's facets that face one facet of the master each.

    Args:
        slave_facet: (q,), facet of the slave.
        slave_nodes: (q, k), corners of the slave's facet.
        master_nodes: (q, l), corners of the master's facet, numbered after the slave's nodes.
        nodes: (q, p), nodes on whose positions the integrals depend.
        slave_products: (q, k (k + 1) / 2), integrals of the products of two weight functions of the
            slave, in the order of `number_unique_products`.
        slave_products_rate: (q, k (k + 1) / 2, p d), their derivatives.
        mixed_products: (q, k, l), integrals of a weight function of the slave times one of the
            master.
        mixed_products_rate: (q, k, l, p d), their derivatives.
        bubbles: (q, b), numbers of the second differences along edges by which the curved facets
            differ from the parts; b = 0 if distances are measured between flat facets.
        bubble_products: (q, k, b), integrals of a weight function of the slave times the factor of
            each second difference in the distance of the slave from the master.
        bubble_products_rate: (q, k, b, p d), their derivatives.
    """

    slave_facet: Indices
    slave_nodes: Indices
    master_nodes: Indices
    nodes: Indices
    slave_products: Array
    slave_products_rate: Array
    mixed_products: Array
    mixed_products_rate: Array
    bubbles: Indices
    bubble_products: Array
    bubble_products_rate: Array


@dataclass(frozen=True)
class NormalsWithDerivatives:
    """Unit vectors at the slave's nodes, and derivatives of the normals.

    Args:
        normals: (m, d), unit vectors out of the master.
        tangents: (m, d - 1, d), orthonormal vectors perpendicular to the normals.
        rates: for each tangent, the derivative (m, d n) of the normal along this tangent.
    """

    normals: Array
    tangents: Array
    rates: list[sp.csr_array]


@dataclass(frozen=True)
class MortarSlipReference:
    """State of both sides at the start of an increment, from which slip is measured.

    Args:
        distance_rows: (m, n), matrix that turns positions into mean distances of the slave's nodes
            from the master; zero for nodes that did not face the master.
        is_facing_master: (m,), mask of the slave's nodes that faced the master.
        x: (n, d), positions of the nodes of both sides.
        normals: (m, d), unit normals at the slave's nodes.
        tangents: (m, d - 1, d), orthonormal tangents at the slave's nodes.
        master_surface_derivatives: for each axis, the matrix (n, n) that turns nodal values into
            mean derivatives along this axis, tangential to the master's surface, around the
            master's nodes; empty in the plane.
    """

    distance_rows: sp.csr_array
    is_facing_master: Mask
    x: Array
    normals: Array
    tangents: Array
    master_surface_derivatives: list[sp.csr_array]


@dataclass(frozen=True)
class LinearisedMortar:
    """Mortar of two sides at given positions, with derivatives with respect to the positions.

    The n nodes consist of the m nodes of the slave, followed by the k nodes of the master. Let S be
    the matrix that turns values at the nodes into weighted mean differences between both sides.

    Args:
        faces_master: (m,), mask of the slave's nodes that face the master.
        directions: normals out of the master and tangents at the slave's nodes.
        mean_distance: (m, d), mean distances S x of the slave's nodes from the master, at positions
            x; zero for nodes that do not face the master.
        distance_rows: (m, n), the matrix S.
        master_fractions: (m, k), fractions of the force at each node of the slave that the nodes of
            the master receive. They add up to one.
        mixed_products: (m, k), integrals of the products of a weight function of the slave and one
            of the master.
        areas: (m,), integrals of the slave's weight functions.
        differentiate_mean_differences: function that returns the derivative (d m, d n) of S y with
            respect to the positions, for constant values y (n, d).
        distance_rate: (d m, d n), derivative of the mean distances S x.
        differentiate_master_forces: function that returns the derivative (d k, d n) of the forces
            on the master's nodes with respect to the positions, for constant forces (m, d) on the
            slave's nodes.
    """

    faces_master: Mask
    directions: NormalsWithDerivatives
    mean_distance: Array
    distance_rows: sp.csr_array
    master_fractions: sp.csr_array
    mixed_products: sp.csr_array
    areas: Array
    differentiate_mean_differences: Callable[[Array], sp.csr_array]
    distance_rate: sp.csr_array
    differentiate_master_forces: Callable[[Array], sp.csr_array]

    @property
    def normals(self) -> Array:
        """Unit vectors (m, d) out of the master."""
        return self.directions.normals

    @property
    def gaps(self) -> Array:
        """Gaps (m,), mean distances along the normals; zero where the master is not faced."""
        return np.asarray(np.sum(self.normals * self.mean_distance, axis=1))

    def measure_slip_and_motion_derivatives(
        self, reference: MortarSlipReference, x: Array
    ) -> tuple[Array, list[sp.csr_array]]:
        """Return slips since the reference, and derivatives of gaps, slips and normals.

        Args:
            reference: state at the start of the increment.
            x: (n, d), positions at which this mortar has been linearised.

        Returns:
            The slips (m, d - 1) along the tangents; and a list of 2 d - 1 derivatives (m, d n) with
            respect to the positions: those of the gaps, of the slips along each tangent, and of the
            normals along each tangent.
        """
        n, t = self.normals, self.directions.tangents
        normal_rates = self.directions.rates
        tangents: list[Array] = list(np.swapaxes(t, 0, 1))
        entering = self.faces_master & ~reference.is_facing_master
        # S_0 x - S x for nodes that faced the master at the start, S x for all other nodes
        distance = np.where(
            entering[:, None], self.mean_distance, reference.distance_rows @ x - self.mean_distance
        )
        slip = np.einsum("mtx,mx->mt", t, distance)
        gap_rate = _components_along(n) @ self.distance_rate
        for tangent, rate in zip(tangents, normal_rates, strict=True):
            gap_rate += sp.diags_array(np.sum(tangent * self.mean_distance, axis=1)) @ rate
        sign = np.where(entering, 1.0, -1.0)[:, None]
        start_rows = sp.csr_array(sp.kron(reference.distance_rows, sp.eye_array(n.shape[1])))
        normal_part = sp.diags_array(np.sum(n * distance, axis=1))
        slip_rates = [
            _components_along(sign * tangent) @ self.distance_rate
            + _components_along(tangent) @ start_rows
            - normal_part @ rate
            for tangent, rate in zip(tangents, normal_rates, strict=True)
        ]
        if entering.any():
            start_slip, start_rates = self._rotate_start_distance_of_entering_nodes(
                reference, x, entering
            )
            slip -= start_slip
            slip_rates = [a - b for a, b in zip(slip_rates, start_rates, strict=True)]
        return slip, [gap_rate, *slip_rates, *normal_rates]

    def _rotate_start_distance_of_entering_nodes(
        self, reference: MortarSlipReference, x: Array, entering: Mask
    ) -> tuple[Array, list[sp.csr_array]]:
        """Return the rotated tangential distances at the start, and derivatives.

        The distances (m, d - 1) are t·R d_0 (see the module's docstring). They are zero except at
        the `entering` nodes (m,), which face the master but did not at the start.
        """
        t, start_distance = self.directions.tangents, self.distance_rows @ reference.x
        components = np.einsum("mtx,mx->mt", reference.tangents, start_distance)
        components *= entering[:, None]
        rotated_tangents, spin_rate = self._rotate_start_tangents(reference, x)
        distance = np.einsum("mtx,msx,ms->mt", t, rotated_tangents, components)
        # R^T t, which multiply a change of d_0
        rotated_back = np.einsum("mtx,msx,msy->mty", t, rotated_tangents, reference.tangents)
        rotated_back *= entering[:, None, None]
        change = self.differentiate_mean_differences(reference.x)
        rates = [_components_along(tangent) @ change for tangent in np.swapaxes(rotated_back, 0, 1)]
        if spin_rate is not None:
            # a rotation about the normal n changes v = R d_0 by n x v
            by_spin = np.stack([-distance[:, 1], distance[:, 0]], axis=1)
            rates = [
                rate + sp.diags_array(factor) @ spin_rate
                for rate, factor in zip(rates, by_spin.T, strict=True)
            ]
        return distance, rates

    def _rotate_start_tangents(
        self, reference: MortarSlipReference, x: Array
    ) -> tuple[Array, sp.csr_array | None]:
        """Return the rotated tangents (m, d - 1, d) of the start, and derivatives of their angles.

        The angles in space are those about the normal. Their derivative has the shape (m, d n). In
        the plane, the tangents are those at the positions x, and there is no such angle.
        """
        n, t = self.normals, self.directions.tangents
        if not reference.master_surface_derivatives:
            return t, None
        start_t, start_s = np.swapaxes(reference.tangents, 0, 1)
        master_gradient = [matrix @ x for matrix in reference.master_surface_derivatives]
        # F for each axis; S takes the master's values away from those of the slave, which are zero
        F = np.stack([-(self.distance_rows @ values) for values in master_gradient], axis=2)
        F_t, F_s = (np.einsum("mxy,my->mx", F, start) for start in (start_t, start_s))
        first = add_image_of_perpendicular(n, F_t, F_s)
        length = np.maximum(np.linalg.norm(first, axis=1, keepdims=True), np.finfo(float).tiny)
        first = first / length
        second = np.cross(n, first)
        # changes of F turn the tangents by (s·dF t_0 - t·dF s_0) / length with t = R t_0, s = R s_0
        spin_rate = sp.csr_array((len(n), x.size))
        for axis, (matrix, values) in enumerate(
            zip(reference.master_surface_derivatives, master_gradient, strict=True)
        ):
            factor = (start_t[:, axis, None] * second - start_s[:, axis, None] * first) / length
            spin_rate -= _components_along(factor) @ (
                self.differentiate_mean_differences(values)
                + sp.kron(self.distance_rows @ matrix, sp.eye_array(3))
            )
        # changes of the normal
        along_normal = [np.sum(n * vector, axis=1, keepdims=True) for vector in (F_s, F_t)]
        tilt = (along_normal[0] * first - along_normal[1] * second) / length
        for tangent, rate in zip(np.swapaxes(t, 0, 1), self.directions.rates, strict=True):
            spin_rate += sp.diags_array(np.sum(tilt * tangent, axis=1)) @ rate
        return np.stack([first, second], axis=1), spin_rate


def _components_along(direction: Array) -> sp.csr_array:
    """Return the matrix (m, d m) of the components of m vectors along directions (m, d)."""
    m, dim = direction.shape
    node = np.arange(m)[:, None]
    return sum_into_matrix(direction, node, dim * node + np.arange(dim), (m, dim * m))


class SlidingMortar(ABC):
    """Mortar between two sides, which can be evaluated at any node positions.

    Args:
        slave: boundary facets of the undeformed slave.
        master: boundary facets of the undeformed master.
        slave_facets: (f, k), corners of the slave's sub-facets as indices into `slave.nodes`.
        master_facets: (e, l), corners of the master's sub-facets as indices into `master.nodes`.

    Attributes:
        allowed_components: (m, d), mask of the components in which normals at the slave's nodes may
            be nonzero; by default all components.
        nodes: (n,), global numbers of the slave's nodes, followed by the master's.
        n_slave_nodes: number m of the slave's nodes.
        x: (n, d), undeformed positions of the nodes.
    """

    def __init__(
        self,
        slave: BoundaryFacets,
        master: BoundaryFacets,
        slave_facets: Indices,
        master_facets: Indices,
    ) -> None:
        self.nodes = np.concatenate([slave.nodes, master.nodes])
        self.x = np.concatenate([slave.node_positions(), master.node_positions()])
        self.n_slave_nodes = len(slave.nodes)
        self._slave_facets, self._master_facets = slave_facets, master_facets + self.n_slave_nodes
        self.allowed_components = np.ones((self.n_slave_nodes, self.x.shape[1]), dtype=bool)
        # matrix that turns nodal values into second differences along the edges of curved facets
        self._second_differences = sp.csr_array((0, len(self.x)))

    @abstractmethod
    def evaluate_mortar_matrices_independently(self, x: Array) -> MortarMatrices:
        """Return the mortar matrices at node positions x (n, d), for verification.

        They are computed by code that `linearise` does not use.
        """

    @abstractmethod
    def _integrate_over_facing_parts(self, x: Array) -> FacingParts:
        """Return the integrals over the facing parts for nodes at positions x (n, d)."""

    @abstractmethod
    def _differentiate_slave_normals(self, x: Array) -> NormalsWithDerivatives:
        """Return the normals at the slave's nodes for nodes at positions x (n, d)."""

    @abstractmethod
    def _average_slave_normals(self, x: Array) -> Array:
        """Return the normals (m, d) at the slave's nodes for nodes at positions x (n, d)."""

    @abstractmethod
    def _average_master_surface_derivatives(self, x: Array) -> list[sp.csr_array]:
        """Return matrices (n, n) of mean derivatives along each axis around the master's nodes.

        They turn nodal values into the mean of the derivatives, tangential to the surface, on the
        facets around each of the master's nodes, weighted with their areas, for nodes at positions
        x (n, d). The list is empty in the plane.
        """

    @abstractmethod
    def _find_closest_master_points(self, x: Array) -> tuple[Indices, Array]:
        """Find the point of the master that is closest to each of the slave's nodes.

        Returns:
            The corners (m, k) of the master's facet that contains the closest point, and their
            weights (m, k), by which the point is interpolated between them.
        """

    @abstractmethod
    def _rotate_with_normals_and_master_facets(
        self, vectors: Array, normals: PairOfArrays, positions: PairOfArrays, corners: Indices
    ) -> Array:
        """Return tangential vectors (m, d) after a rotation that turns normals into new ones.

        In space, it is the rotation closest to the deformation gradients of facets of the master.

        Args:
            vectors: (m, d), vectors perpendicular to the normals at the start.
            normals: unit normals (m, d) at the start and at the end.
            positions: (n, d), of all nodes at the start and at the end.
            corners: (m, k), corners of the facet of the master for each vector.
        """

    @abstractmethod
    def _compute_outward_normals_of_master_facets(self, x: Array, corners: Indices) -> Array:
        """Return outward unit normals (q, d) of the master's facets with corners (q, k)."""

    @abstractmethod
    def _is_on_master_rim(self, corners: Indices, weights: Array) -> Mask:
        """Return whether points (q,) of the master are on its rim.

        Args:
            corners: (q, k), corners of the facets that contain the points.
            weights: (q, k), weights of the corners.
        """

    def linearise(self, x: Array) -> LinearisedMortar:
        """Return the mortar at node positions x (n, d), with its derivatives."""
        (n, dim), m, f = x.shape, self.n_slave_nodes, len(self._slave_facets)
        parts = self._integrate_over_facing_parts(x)
        slave_nodes, master_nodes, facet = parts.slave_nodes, parts.master_nodes, parts.slave_facet
        k = slave_nodes.shape[1]
        axis, number = np.arange(dim), number_unique_products(k)
        n_products = parts.slave_products.shape[1]
        # columns of derivatives
        dofs = (dim * parts.nodes[:, :, None] + axis).reshape(
            len(facet), dim * parts.nodes.shape[1]
        )
        product_index = n_products * np.arange(f)[:, None] + np.arange(n_products)
        facet_products = np.zeros((f, n_products))
        np.add.at(facet_products, facet, parts.slave_products)
        area_by_product = sum_into_matrix(
            np.ones((f, k, k)),
            self._slave_facets[:, :, None],
            product_index[:, number],
            (m, n_products * f),
        )
        areas = area_by_product @ facet_products.ravel()
        faced = areas > 0
        inverse_area = 1 / (areas + ~faced)
        duals, duals_by_product = self._divide_dual_functions_by_areas(
            facet_products[:, number], inverse_area, number
        )
        Q, dQ = parts.mixed_products, parts.mixed_products_rate
        master_fractions = sum_into_matrix(
            duals[facet] @ Q, slave_nodes[:, :, None], master_nodes[:, None] - m, (m, n - m)
        )

        def differentiate_master_forces(force: Array) -> sp.csr_array:
            row = (dim * (master_nodes - m)[:, :, None] + axis)[..., None]
            nodal = force[slave_nodes]
            direct = np.einsum("qix,qikc->qkxc", np.swapaxes(duals[facet], 1, 2) @ nodal, dQ)
            # the dual functions depend on the products of their facet and on the areas of nodes
            by_product = np.einsum(
                "qixv,qik->qkxv", np.einsum("qjx,qjiv->qixv", nodal, duals_by_product[facet]), Q
            )
            by_area = -np.einsum(
                "qjx,qjk->qkxj",
                nodal * inverse_area[slave_nodes][:, :, None],
                duals[facet] @ Q,
            )
            shape = dim * (n - m), n_products * f
            indirect = sum_into_matrix(
                by_product, row, product_index[facet][:, None, None], shape
            ) + (
                sum_into_matrix(by_area, row, slave_nodes[:, None, None], (shape[0], m))
                @ area_by_product
            )
            products_by_x = sum_into_matrix(
                parts.slave_products_rate,
                product_index[facet][:, :, None],
                dofs[:, None],
                (shape[1], dim * n),
            )
            return sum_into_matrix(direct, row, dofs[:, None, None], (shape[0], dim * n)) + (
                indirect @ products_by_x
            )

        D, dD = parts.slave_products[:, number], parts.slave_products_rate[:, number]
        distance_rows = sp.diags_array(inverse_area) @ (
            sum_into_matrix(D, slave_nodes[:, :, None], slave_nodes[:, None], (m, n))
            - sum_into_matrix(Q, slave_nodes[:, :, None], master_nodes[:, None], (m, n))
            + sum_into_matrix(
                parts.bubble_products,
                slave_nodes[:, :, None],
                parts.bubbles[:, None],
                (m, self._second_differences.shape[0]),
            )
            @ self._second_differences
        )
        mean_distance = distance_rows @ x

        def differentiate_mean_differences(constant_nodal_values: Array) -> sp.csr_array:
            # (q, k, k, d), difference between y at node i and the mean S y of node j
            difference = (
                constant_nodal_values[slave_nodes][:, None]
                - (distance_rows @ constant_nodal_values)[slave_nodes][:, :, None]
            )
            derivative = np.einsum("qjic,qjix->qjxc", dD, difference)
            derivative -= np.einsum("qjkc,qkx->qjxc", dQ, constant_nodal_values[master_nodes])
            derivative += np.einsum(
                "qjbc,qbx->qjxc",
                parts.bubble_products_rate,
                (self._second_differences @ constant_nodal_values)[parts.bubbles],
            )
            row = (dim * slave_nodes[:, :, None] + axis)[..., None]
            derivative = derivative * inverse_area[slave_nodes][:, :, None, None]
            return sum_into_matrix(derivative, row, dofs[:, None, None], (dim * m, dim * n))

        distance_rate = differentiate_mean_differences(x) + sp.kron(
            distance_rows, sp.eye_array(dim)
        )
        return LinearisedMortar(
            faced,
            self._differentiate_slave_normals(x),
            mean_distance,
            distance_rows,
            master_fractions,
            sum_into_matrix(Q, slave_nodes[:, :, None], master_nodes[:, None] - m, (m, n - m)),
            areas,
            differentiate_mean_differences,
            distance_rate,
            differentiate_master_forces,
        )

    def _divide_dual_functions_by_areas(
        self, facet_products: Array, inverse_area: Array, number: Indices
    ) -> tuple[Array, Array]:
        """Return the dual functions of each facet, divided by the areas of the slave's nodes.

        Args:
            facet_products: (f, k, k), integrals W of the products of weight functions.
            inverse_area: (m,), inverse areas of the slave's nodes.
            number: (k, k), numbers of the unique products.

        Returns:
            The coefficients (f, k, k) of the dual functions diag(W 1) W^-1, divided by areas; and
            their derivatives (f, k, k, k (k + 1) / 2) with respect to the unique products at
            constant areas. Both are zero on facets that do not face the master.
        """
        f, k, _ = facet_products.shape
        covered = np.flatnonzero(facet_products.any(axis=(1, 2)))
        W = facet_products[covered]
        inverse, scale = np.linalg.inv(W), inverse_area[self._slave_facets[covered]]
        row_sums = W.sum(axis=2)
        duals, rates = np.zeros((f, k, k)), np.zeros((f, k, k, number.max() + 1))
        duals[covered] = (scale * row_sums)[:, :, None] * inverse
        for a in range(k):
            for b in range(k):  # derivative with respect to the entry (a, b) of W
                change = -(row_sums * inverse[:, :, a])[:, :, None] * inverse[:, b][:, None]
                change[:, a] += inverse[:, a]
                rates[covered, :, :, number[a, b]] += scale[:, :, None] * change
        return duals, rates

    def make_slip_reference(self, x: Array) -> MortarSlipReference:
        """Return the state from which slip is measured, for node positions x (n, d)."""
        mortar = self.linearise(x)
        return MortarSlipReference(
            mortar.distance_rows,
            mortar.faces_master,
            x,
            mortar.normals,
            mortar.directions.tangents,
            self._average_master_surface_derivatives(x),
        )

    def integrate_slip_along_path(self, start_positions: Array, end_positions: Array) -> Array:
        """Return the slip (m, d) along the straight path from start to end positions (n, d).

        The path is divided into `N_SLIP_PATH_PIECES` pieces. On each piece, the slip of a slave
        node j is measured relative to the material point p of the master that is closest to j at
        the end of the piece. It is the change of the tangential part of x_j - x_p from the start to
        the end of the piece. Vectors rotate with the normal and, in space, about it with the facet
        of the master that contains p.
        """
        previous_x, previous_normals = start_positions, self._average_slave_normals(start_positions)
        slip = np.zeros_like(previous_normals)
        for fraction in np.arange(1, N_SLIP_PATH_PIECES + 1) / N_SLIP_PATH_PIECES:
            next_x = (1 - fraction) * start_positions + fraction * end_positions
            corners, weights = self._find_closest_master_points(next_x)
            next_normals = self._average_slave_normals(next_x)
            start, end = (
                tangential_part(
                    x[: self.n_slave_nodes] - np.einsum("jk,jkx->jx", weights, x[corners]), normals
                )
                for x, normals in ((previous_x, previous_normals), (next_x, next_normals))
            )
            slip = end + self._rotate_with_normals_and_master_facets(
                slip - start, (previous_normals, next_normals), (previous_x, next_x), corners
            )
            previous_x, previous_normals = next_x, next_normals
        return slip

    def measure_max_penetration_along_path(
        self, start_positions: Array, end_positions: Array
    ) -> Array:
        """Return the largest depth (m,) to which slave nodes penetrate the master on their path.

        The path from `start_positions` (n, d) to `end_positions` (n, d) is straight, and is sampled
        at the ends of `2 N_SLIP_PATH_PIECES` pieces. The depth counts as zero for nodes that start
        inside the master by more than the size of a facet, and wherever the closest point is on the
        rim of the master.
        """
        depth, outside = np.zeros(self.n_slave_nodes), np.zeros(self.n_slave_nodes, dtype=bool)
        for piece, fraction in enumerate(np.linspace(0, 1, 2 * N_SLIP_PATH_PIECES + 1)):
            x = (1 - fraction) * start_positions + fraction * end_positions
            corners, weights = self._find_closest_master_points(x)
            from_closest = x[: self.n_slave_nodes] - np.einsum("jk,jkx->jx", weights, x[corners])
            outward = self._compute_outward_normals_of_master_facets(x, corners)
            height = np.sum(outward * from_closest, axis=1)
            if piece == 0:
                outside = height > -self.measure_shortest_facet_at_slave_nodes()
            depth = np.maximum(
                depth, np.where(self._is_on_master_rim(corners, weights), 0.0, -height)
            )
        return np.where(outside, depth, 0.0)

    def measure_shortest_facet_at_slave_nodes(self) -> Array:
        """Return the length (m,) of the shortest undeformed facet edge at each slave node."""
        shortest = np.full(self.n_slave_nodes, np.inf)
        corners = self.x[self._slave_facets]
        for i in range(corners.shape[1]):
            for j in range(i):
                length = np.linalg.norm(corners[:, i] - corners[:, j], axis=1)
                for node in (i, j):
                    np.minimum.at(shortest, self._slave_facets[:, node], length)
        return shortest


def tangential_part(vectors: Array, normals: Array) -> Array:
    """Return the parts (m, d) of vectors perpendicular to unit normals (m, d)."""
    return vectors - np.sum(vectors * normals, axis=1, keepdims=True) * normals


def add_image_of_perpendicular(normals: Array, image: Array, perpendicular_image: Array) -> Array:
    """Return the tangential vectors U v - n x U (n_0 x v) for images under a gradient F.

    U is the tangential part of F for directions perpendicular to n_0. The result has the direction
    in which v is turned by the closest rotation to U among those that turn n_0 into n: in
    orthonormal bases with one vector along the normals, the closest rotation to a matrix U (2, 2)
    is U plus its matrix of cofactors, divided by a number.

    Args:
        normals: (m, d), unit normals n at the end.
        image: (m, d), vectors F v, for vectors v perpendicular to the normals n_0 at the start.
        perpendicular_image: (m, d), vectors F (n_0 x v).
    """
    return tangential_part(image, normals) - np.cross(normals, perpendicular_image)


def rotate_with_normal(vectors: Array, normals: Array, next_normals: Array) -> Array:
    """Return tangential vectors (m, d) after the smallest rotation of `normals` to new ones."""
    along = np.sum(vectors * next_normals, axis=1, keepdims=True)
    divisor = np.maximum(
        1 + np.sum(normals * next_normals, axis=1, keepdims=True), _MIN_ROTATION_DIVISOR
    )
    return vectors - along / divisor * (normals + next_normals)
