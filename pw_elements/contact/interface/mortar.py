"""Mortar interfaces: two deformable bodies whose meshes need not match.

The theory page describes the method ("Two bodies"). Multipliers are expanded in the duals psi of
the slave's weight functions w: slave node j receives the force r_j = A_j t_j, and master node k
receives -M_jk r_j / A_j, with M_jk = integral of psi_j w_k. H has a unit entry in the equation of
each contact point, as for matching nodes. H is not G^T, because tractions are weighted with duals
and gaps with weight functions (B. Wohlmuth, https://doi.org/10.1137/S0036142999350929).
"""

from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI

import basix
import numpy as np
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.arrays import Array, Indices, LocalIndices
from pw_elements.contact.interface.overlap import (
    compute_cell_normals,
    compute_cell_sizes,
    compute_jacobian_factors,
    evaluate_corner_functions,
    find_overlaps,
)
from pw_elements.elasticity import locate_facets_in_cells

# Nodes of each sub-facet of a facet, by the number of the facet's nodes: vertices come first, then
# the middles of edges, then the centre of a quadrilateral
_SUB_FACET_NODES = {
    3: ((0, 2), (2, 1)),
    6: ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
    9: ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
}
# Cell type of a sub-facet, by its number of corners
_SUB_FACET_CELL_TYPES = {
    2: basix.CellType.interval,
    3: basix.CellType.triangle,
    4: basix.CellType.quadrilateral,
}
# Cosine of the angle between the normals of adjacent facets below which their edge is sharp
_MAX_SHARP_EDGE_COSINE = float(np.cos(np.pi / 4)) - 1e-9
# Polynomial degree of products of weights, quadratic functions and, in axisymmetry, the radius, by
# the number of corners of a sub-facet; and the degree of the rule where quadrilaterals are not
# parallelograms, so that the integrand is not a polynomial
_QUADRATURE_DEGREES = {2: 4, 3: 4, 4: 6}
_NON_PARALLELOGRAM_DEGREE = 10
# Largest difference of opposite sides of a parallelogram, relative to its size
_PARALLELOGRAM_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Trace:
    """A part of the boundary, gathered from all processes: facets (f) with k nodes each."""

    facet_nodes: Indices  # (f, k), global; vertices first, then the middles of edges
    facet_x: Array  # (f, k, dim), positions of these nodes
    facet_normals: Array  # (f, dim), outward unit normals of the facets, treated as flat

    @property
    def dim(self) -> int:
        """Dimension of the space that contains the surface."""
        return int(self.facet_x.shape[2])

    @cached_property
    def _element(self) -> basix.finite_element.FiniteElement:
        return basix.create_element(
            basix.ElementFamily.P, _SUB_FACET_CELL_TYPES[self._sub_facet_nodes.shape[1]], 2
        )

    @cached_property
    def _sub_facet_nodes(self) -> Indices:
        """Nodes (sub-facets, k) of the sub-facets of one facet."""
        return np.array(_SUB_FACET_NODES[self.facet_nodes.shape[1]])

    @cached_property
    def sub_facets(self) -> tuple[Indices, Array, Array]:
        """Nodes (s, k) of all sub-facets, their corners (s, k, dim) and unit normals (s, dim)."""
        count, k = self._sub_facet_nodes.shape
        corners = self.facet_x[:, self._sub_facet_nodes].reshape(-1, k, self.dim)
        outward = np.repeat(self.facet_normals, count, axis=0)
        normal = compute_cell_normals(corners)
        normal *= np.sign(np.sum(normal * outward, axis=1))[:, None]
        return self.facet_nodes[:, self._sub_facet_nodes].reshape(-1, k), corners, normal

    def evaluate_trial_functions(
        self, sub_facet: Indices, corner_weights: Array
    ) -> tuple[Indices, Array]:
        """Return nodes (q, n) and values (q, n) of the quadratic trial functions at points.

        Args:
            sub_facet: (q,), number of the sub-facet that contains each point.
            corner_weights: (q, k), values of the functions of its corners at the point.
        """
        facet, part = np.divmod(sub_facet, len(self._sub_facet_nodes))
        corner_coordinates = self._element.points[self._sub_facet_nodes][part]
        coordinates = np.einsum("qa,qab->qb", corner_weights, corner_coordinates)
        values = np.zeros((len(sub_facet), self.facet_nodes.shape[1]))
        if len(sub_facet):  # Basix does not accept empty arrays
            values = self._element.tabulate(0, coordinates)[0, :, :, 0]
        return self.facet_nodes[facet], values

    def interpolate_positions(self, sub_facet: Indices, values: Array) -> Array:
        """Return positions (q, dim) of points with these values (q, n) of trial functions."""
        facet_x = self.facet_x[sub_facet // len(self._sub_facet_nodes)]
        return np.einsum("qk,qkd->qd", values, facet_x)

    @cached_property
    def nodes(self) -> Indices:
        """Global numbers (n,) of the nodes, sorted."""
        return np.unique(self.facet_nodes)

    def with_positions(self, x: Array) -> "Trace":
        """Return a copy with the nodes at positions x (n, dim)."""
        return replace(self, facet_x=x[np.searchsorted(self.nodes, self.facet_nodes)])

    def average_normals(self, nodes: Indices) -> Array:
        """Return unit normals (..., dim) at nodes (...): means of sub-facets weighted by size."""
        sub_facet_nodes, corners, normal = self.sub_facets
        position = np.searchsorted(self.nodes, sub_facet_nodes)
        sums = np.zeros((len(self.nodes), self.dim))
        np.add.at(sums, position, (normal * compute_cell_sizes(corners)[:, None])[:, None, :])
        sums /= np.linalg.norm(sums, axis=1, keepdims=True)
        return sums[np.searchsorted(self.nodes, nodes)]

    def find_sharp_edges(self) -> Array:
        """Return positions (n, dim) where normals of adjacent facets differ by over 45 degrees."""
        k, element = self.facet_nodes.shape[1], self._element
        slopes = element.tabulate(1, element.points)[1:, :, :, 0]
        tangents = np.einsum("dqk,fkx->fqdx", slopes, self.facet_x)
        tangents = tangents.reshape(-1, self.dim - 1, self.dim)
        normal = compute_cell_normals(
            np.concatenate([np.zeros_like(tangents[:, :1]), tangents], axis=1)
        )
        normal *= np.sign(np.sum(normal * np.repeat(self.facet_normals, k, axis=0), axis=1))[
            :, None
        ]
        # local nodes at which at most two facets meet: end nodes in the plane, mid-side nodes in
        # space
        shared = np.concatenate(element.entity_dofs[self.dim - 2]).astype(np.int64)
        normal = normal.reshape(-1, k, self.dim)[:, shared].reshape(-1, self.dim)
        node = self.facet_nodes[:, shared].ravel()
        x = self.facet_x[:, shared].reshape(-1, self.dim)
        order = np.argsort(node, kind="stable")
        facet, neighbour = order[:-1], order[1:]
        cosine = np.sum(normal[facet] * normal[neighbour], axis=1)
        sharp = (node[facet] == node[neighbour]) & (cosine < _MAX_SHARP_EDGE_COSINE)
        return np.asarray(x[facet[sharp]])

    def node_positions(self) -> Array:
        """Return positions (n, dim) of the nodes."""
        _, index = np.unique(self.facet_nodes, return_index=True)
        return self.facet_x.reshape(-1, self.dim)[index]


def gather_trace(space: fem.FunctionSpace, facets: LocalIndices) -> Trace:
    """Return the trace of exterior facets (local numbers) of all processes; collective."""
    nodes, x, outward = compute_flat_facets(space, facets)
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    parts = zip(*space.mesh.comm.allgather((number, x, outward)), strict=True)
    return Trace(*(np.concatenate(part) for part in parts))


def compute_flat_facets(
    space: fem.FunctionSpace, facets: LocalIndices
) -> tuple[LocalIndices, Array, Array]:
    """Return nodes (f, k) of exterior facets, their positions, and outward unit normals (f, dim).

    Normals are those of facets treated as flat.
    """
    dim, (cells, local_nodes) = space.mesh.topology.dim, locate_facets_in_cells(space, facets)
    cell_nodes = space.dofmap.list[cells]
    nodes = np.take_along_axis(cell_nodes, local_nodes, axis=1)
    x = space.tabulate_dof_coordinates()[:, :dim]
    cell_middle = x[cell_nodes].mean(axis=1)
    normal = compute_cell_normals(x[nodes[:, :dim]])
    normal *= np.sign(np.sum(normal * (x[nodes[:, 0]] - cell_middle), axis=1))[:, None]
    return nodes, x[nodes], normal


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) on the overlaps of the slave's sub-facets with the master.

    Only sub-facets at contact points of this process are included.
    """

    point: Indices  # (q, k), contact point at each corner, -1 for those of other processes
    weight: Array  # (q, k), weight functions of the corners
    dual: Array  # (q, k), dual functions of the corners
    measure: Array  # (q,), quadrature weights times lengths or areas
    slave_size: Array  # (q,), length or area of the slave's sub-facet
    size_ratio: Array  # (q,), size of the slave's sub-facet over that of the master's
    separation: Array  # (q, dim), vector from the master to the slave
    # nodes (q, n) and values (q, n) of the slave's and the master's quadratic functions, and of the
    # master's weight functions
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def from_traces(cls, slave: Trace, master: Trace, owned: Indices, revolved: bool) -> "Overlap":
        """Find the overlap of two traces.

        Args:
            slave: trace of the slave.
            master: trace of the master.
            owned: (m,), global numbers of the slave's nodes that are points of this process.
            revolved: whether areas are those of the whole circumference.
        """
        slave_nodes, slave_corners, _ = slave.sub_facets
        master_nodes, master_corners, outward = master.sub_facets
        local = np.flatnonzero(np.isin(slave_nodes, owned).any(axis=1))
        directions = slave.average_normals(slave_nodes[local]).mean(axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        simplices = find_overlaps(slave_corners[local], master_corners, directions, outward)
        order = np.argsort(owned)
        index = np.searchsorted(owned, slave_nodes, sorter=order)
        point = (
            order[np.minimum(index, len(owned) - 1)] if len(owned) else np.zeros_like(slave_nodes)
        )
        point = np.where(np.isin(slave_nodes, owned), point, -1)
        degree = _QUADRATURE_DEGREES[slave_corners.shape[1]]
        if _has_non_parallelogram(simplices.slave_corners) or _has_non_parallelogram(
            simplices.master_corners
        ):
            degree = _NON_PARALLELOGRAM_DEGREE
        points, rule = basix.make_quadrature(_SUB_FACET_CELL_TYPES[slave.dim], degree)
        barycentric = np.column_stack([1 - points.sum(axis=1), points])
        rule = rule / rule.sum()
        slave_index, master_index = (
            np.repeat(k, len(rule))
            for k in (local[simplices.slave_sub_facet], simplices.master_sub_facet)
        )
        coordinates = np.einsum("ga,qad->qgd", barycentric, simplices.corners)
        w1, w2 = (
            evaluate_corner_functions(corners, coordinates).reshape(
                len(slave_index), corners.shape[1]
            )
            for corners in (simplices.slave_corners, simplices.master_corners)
        )
        flat_corners = np.repeat(simplices.slave_corners, len(rule), axis=0)
        area_ratio = compute_jacobian_factors(
            slave_corners[slave_index], w1
        ) / compute_jacobian_factors(flat_corners, w1)
        slave_size = compute_cell_sizes(slave_corners)[slave_index]
        master_size = compute_cell_sizes(master_corners)[master_index]
        measure = area_ratio * np.outer(simplices.size, rule).ravel()
        nodes1, N1 = slave.evaluate_trial_functions(slave_index, w1)
        nodes2, N2 = master.evaluate_trial_functions(master_index, w2)
        x1 = slave.interpolate_positions(slave_index, N1)
        x2 = master.interpolate_positions(master_index, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _evaluate_duals(slave_index, w1, measure)
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

    def mean_edge(self, size: Array, comm: MPI.Comm) -> float:
        """Return the mean of lengths (q,), or of roots of areas (q,), over all processes."""
        edges = size ** (1 / (self.separation.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def integrate_per_point(self, values: Array, m: int) -> Array:
        """Integrate weight functions of m contact points times values; return (m,).

        Args:
            values: (q,), or (q, k) with one value for each corner.
            m: number of contact points of this process.
        """
        values = np.atleast_2d(values.T).T
        owned = self.point >= 0
        products = (self.weight * (self.measure[:, None] * values))[owned]
        return np.asarray(np.bincount(self.point[owned], products, minlength=m), dtype=float)

    def assemble_integrals(
        self, tested: Array, column: Indices, values: Array, shape: tuple[int, int]
    ) -> sp.csr_array:
        """Assemble the matrix of integrals of two sets of functions.

        Args:
            tested: (q, k), functions of the contact points, which are the rows.
            column: (q, n), column of each of the other functions.
            values: (q, n), of the other functions.
            shape: of the matrix.
        """
        products = np.einsum("q,qa,qk->qak", self.measure, tested, values)
        row = np.broadcast_to(self.point[:, :, None], products.shape)
        owned = row >= 0
        indices = (row[owned], np.broadcast_to(column[:, None], products.shape)[owned])
        return sp.csr_array(sp.coo_array((products[owned], indices), shape))


def compute_tributary_areas(trace: Trace, revolved: bool) -> Array:
    """Integrate the weight function of each node over a whole trace; return (n,).

    Sub-facets are treated as those of an `Overlap`. `revolved` integrates over the circumference.
    """
    nodes, corners, _ = trace.sub_facets
    k = corners.shape[1]
    cell_type = _SUB_FACET_CELL_TYPES[k]
    points, rule = basix.make_quadrature(cell_type, _QUADRATURE_DEGREES[k])
    element = basix.create_element(basix.ElementFamily.P, cell_type, 1)
    values = element.tabulate(0, points)[0, :, :, 0]
    sub_facet, w = np.repeat(np.arange(len(corners)), len(rule)), np.tile(values, (len(corners), 1))
    measure = compute_jacobian_factors(corners[sub_facet], w) * np.tile(rule, len(corners))
    if revolved:
        _, N = trace.evaluate_trial_functions(sub_facet, w)
        measure = measure * 2 * np.pi * trace.interpolate_positions(sub_facet, N)[:, 0]
    index = np.searchsorted(trace.nodes, nodes[sub_facet])
    return np.asarray(np.bincount(index.ravel(), (w * measure[:, None]).ravel()), dtype=float)


def _has_non_parallelogram(corners: Array) -> bool:
    """Return whether any of the cells (q, k, d) is a quadrilateral but no parallelogram."""
    if corners.shape[1] < 4:
        return False
    difference = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    return bool(np.abs(difference).max(initial=0.0) > _PARALLELOGRAM_TOLERANCE)


def _evaluate_duals(sub_facet: Indices, weight: Array, measure: Array) -> Array:
    """Return dual functions D M^-1 w, (q, k), at quadrature points.

    Args:
        sub_facet: (q,), that contains each point; M and D are integrated over its points.
        weight: (q, k), w.
        measure: (q,).
    """
    if not len(sub_facet):
        return weight
    unique, index = np.unique(sub_facet, return_inverse=True)
    n = weight.shape[1]
    M = np.zeros((len(unique), n, n))
    np.add.at(M, index, np.einsum("q,qa,qb->qab", measure, weight, weight))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[index], inverse[index], weight))
