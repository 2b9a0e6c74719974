"""Mortar interfaces between two deformable bodies whose meshes need not match.

The theory page describes the method ("Two bodies"). The contact traction is expanded in the dual
functions psi_j of the slave's weight functions w_j, with coefficients t_j. Let A_j be the integral
of w_j, and M_jk that of psi_j w_k with the weight function w_k of a master node k. Slave node j
then receives the force r_j = A_j t_j, and master node k receives the forces -M_jk r_j / A_j.

As for matching nodes, the force operator has a unit entry in the equation of each contact point. It
is not the transpose of the motion operator, because tractions are weighted with dual functions and
gaps with weight functions (B. Wohlmuth, https://doi.org/10.1137/S0036142999350929).
"""

from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices
from pw_elements.contact.interface.mortars.boundary_facets import (
    SUB_FACET_CELL_TYPE_BY_CORNER_COUNT,
    BoundaryFacets,
)
from pw_elements.contact.interface.mortars.overlap import (
    compute_cell_lengths_or_areas,
    compute_jacobian_factors,
    evaluate_corner_shape_functions,
    find_overlap_simplices,
)

# Polynomial degree of products of a weight function, a quadratic function and, in axisymmetry, the
# radius, by the number of corners of a sub-facet; and degree of the rule for quadrilaterals that
# are not parallelograms, on which the integrand is not a polynomial
_QUADRATURE_DEGREE_BY_CORNER_COUNT = {2: 4, 3: 4, 4: 6}
_NON_PARALLELOGRAM_QUADRATURE_DEGREE = 10
# Largest difference between opposite sides of a parallelogram, relative to its size
_RELATIVE_PARALLELOGRAM_TOLERANCE = 1e-9


@dataclass(frozen=True)
class OverlapQuadrature:
    """Quadrature points (q) where sub-facets of the slave overlap with sub-facets of the master.

    A sub-facet of the slave is included only if one of its corners is a contact point of this
    process.
    """

    point: Indices  # (q, k), contact point at each corner; -1 if another process owns it
    weight: Array  # (q, k), weight functions of the corners
    dual: Array  # (q, k), dual functions of the corners
    measure: Array  # (q,), quadrature weights times lengths or areas
    slave_size: Array  # (q,), length or area of the slave's sub-facet
    size_ratio: Array  # (q,), size of the slave's sub-facet divided by size of the master's
    separation: Array  # (q, dim), vector from the master to the slave
    # nodes (q, n) and values (q, n) of three sets of functions: quadratic functions of the slave,
    # quadratic functions of the master, and weight functions of the master
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def from_slave_and_master(
        cls,
        slave: BoundaryFacets,
        master: BoundaryFacets,
        owned_slave_nodes: Indices,
        revolved: bool,
    ) -> "OverlapQuadrature":
        """Build the quadrature on the overlap of slave and master.

        Args:
            slave: boundary facets of the slave.
            master: boundary facets of the master.
            owned_slave_nodes: (m,), global numbers of the slave's nodes that are contact points of
                this process.
            revolved: whether areas are those of the whole circumference (axisymmetric bodies).
        """
        slave_nodes, slave_corners, _ = slave.sub_facet_nodes_corners_and_normals
        master_nodes, master_corners, outward = master.sub_facet_nodes_corners_and_normals
        local = np.flatnonzero(np.isin(slave_nodes, owned_slave_nodes).any(axis=1))
        directions = slave.average_normals(slave_nodes[local]).mean(axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        simplices = find_overlap_simplices(
            slave_corners[local], master_corners, directions, outward
        )
        order = np.argsort(owned_slave_nodes)
        index = np.searchsorted(owned_slave_nodes, slave_nodes, sorter=order)
        point = (
            order[np.minimum(index, len(owned_slave_nodes) - 1)]
            if len(owned_slave_nodes)
            else np.zeros_like(slave_nodes)
        )
        point = np.where(np.isin(slave_nodes, owned_slave_nodes), point, -1)
        degree = _QUADRATURE_DEGREE_BY_CORNER_COUNT[slave_corners.shape[1]]
        if _has_non_parallelogram(simplices.slave_corners) or _has_non_parallelogram(
            simplices.master_corners
        ):
            degree = _NON_PARALLELOGRAM_QUADRATURE_DEGREE
        points, rule = basix.make_quadrature(
            SUB_FACET_CELL_TYPE_BY_CORNER_COUNT[slave.space_dim], degree
        )
        barycentric = np.column_stack([1 - points.sum(axis=1), points])
        rule = rule / rule.sum()
        slave_index, master_index = (
            np.repeat(k, len(rule))
            for k in (local[simplices.slave_sub_facet], simplices.master_sub_facet)
        )
        coordinates = np.einsum("ga,qad->qgd", barycentric, simplices.corners)
        w1, w2 = (
            evaluate_corner_shape_functions(corners, coordinates).reshape(
                len(slave_index), corners.shape[1]
            )
            for corners in (simplices.slave_corners, simplices.master_corners)
        )
        flat_corners = np.repeat(simplices.slave_corners, len(rule), axis=0)
        area_ratio = compute_jacobian_factors(
            slave_corners[slave_index], w1
        ) / compute_jacobian_factors(flat_corners, w1)
        slave_size = compute_cell_lengths_or_areas(slave_corners)[slave_index]
        master_size = compute_cell_lengths_or_areas(master_corners)[master_index]
        measure = area_ratio * np.outer(simplices.size, rule).ravel()
        nodes1, N1 = slave.evaluate_trial_functions(slave_index, w1)
        nodes2, N2 = master.evaluate_trial_functions(master_index, w2)
        x1 = slave.interpolate_positions(slave_index, N1)
        x2 = master.interpolate_positions(master_index, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _evaluate_dual_functions(slave_index, w1, measure)
        functions = ((nodes1, N1), (nodes2, N2), (master_nodes[master_index], w2))
        return cls(
            point[slave_index],
            w1,
            dual,
            measure,
            slave_size,
            slave_size / master_size,
            x1 - x2,
            functions,
        )

    def average_edge_length(self, sub_facet_sizes: Array, comm: MPI.Comm) -> float:
        """Return the mean edge length over the overlaps of all processes; collective.

        The mean is weighted with `measure`. The `sub_facet_sizes` (q,) are lengths in the plane and
        areas in space; the edge length is the square root of an area. If ratios of sizes are given
        instead, the result is a mean ratio of edge lengths.
        """
        edges = sub_facet_sizes ** (1 / (self.separation.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def integrate_with_weight_functions(self, values: Array, n_contact_points: int) -> Array:
        """Return the integrals (m,) of the contact points' weight functions times given values.

        Args:
            values: values (q,) at the quadrature points, or (q, k) with one value for each corner.
            n_contact_points: number of contact points of this process.
        """
        values = np.atleast_2d(values.T).T
        owned = self.point >= 0
        products = (self.weight * (self.measure[:, None] * values))[owned]
        return np.asarray(
            np.bincount(self.point[owned], products, minlength=n_contact_points), dtype=float
        )

    def assemble_product_integrals(
        self,
        row_functions: Array,
        columns: Indices,
        column_functions: Array,
        shape: tuple[int, int],
    ) -> sp.csr_array:
        """Assemble the integrals of row functions times column functions into a matrix.

        Each row belongs to a contact point of this process.

        Args:
            row_functions: (q, k), values of the functions of the contact points at the corners.
            columns: (q, n), column number of each column function.
            column_functions: (q, n), values of the column functions.
            shape: shape of the matrix.
        """
        products = np.einsum("q,qa,qk->qak", self.measure, row_functions, column_functions)
        row = np.broadcast_to(self.point[:, :, None], products.shape)
        owned = row >= 0
        indices = (row[owned], np.broadcast_to(columns[:, None], products.shape)[owned])
        return sp.csr_array(sp.coo_array((products[owned], indices), shape))


def compute_tributary_areas(boundary_facets: BoundaryFacets, revolved: bool) -> Array:
    """Return the integral (n,) of each node's weight function over all boundary facets.

    Sub-facets are integrated in the same way as in an `OverlapQuadrature`. If `revolved` is true,
    areas are those of the whole circumference.
    """
    nodes, corners, _ = boundary_facets.sub_facet_nodes_corners_and_normals
    k = corners.shape[1]
    cell_type = SUB_FACET_CELL_TYPE_BY_CORNER_COUNT[k]
    points, rule = basix.make_quadrature(cell_type, _QUADRATURE_DEGREE_BY_CORNER_COUNT[k])
    element = basix.create_element(basix.ElementFamily.P, cell_type, 1)
    values = element.tabulate(0, points)[0, :, :, 0]
    sub_facet, w = np.repeat(np.arange(len(corners)), len(rule)), np.tile(values, (len(corners), 1))
    measure = compute_jacobian_factors(corners[sub_facet], w) * np.tile(rule, len(corners))
    if revolved:
        _, N = boundary_facets.evaluate_trial_functions(sub_facet, w)
        measure = measure * 2 * np.pi * boundary_facets.interpolate_positions(sub_facet, N)[:, 0]
    index = np.searchsorted(boundary_facets.nodes, nodes[sub_facet])
    return np.asarray(np.bincount(index.ravel(), (w * measure[:, None]).ravel()), dtype=float)


def _has_non_parallelogram(corners: Array) -> bool:
    """Return whether the cells, with corners (q, k, d), include a non-parallelogram."""
    if corners.shape[1] < 4:
        return False
    difference = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    return bool(np.abs(difference).max(initial=0.0) > _RELATIVE_PARALLELOGRAM_TOLERANCE)


def _evaluate_dual_functions(sub_facet: Indices, weight_functions: Array, measure: Array) -> Array:
    """Return the dual functions (q, k) of the weight functions at quadrature points.

    On each sub-facet the dual functions are D M^-1 w. Here w are the weight functions, M is the
    matrix of the integrals of their products, and D is the diagonal matrix of their integrals.

    Args:
        sub_facet: (q,), sub-facet that contains each point.
        weight_functions: (q, k), values of the weight functions.
        measure: (q,), quadrature weights times lengths or areas.
    """
    if not len(sub_facet):
        return weight_functions
    unique, index = np.unique(sub_facet, return_inverse=True)
    n = weight_functions.shape[1]
    M = np.zeros((len(unique), n, n))
    np.add.at(M, index, np.einsum("q,qa,qb->qab", measure, weight_functions, weight_functions))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[index], inverse[index], weight_functions))
