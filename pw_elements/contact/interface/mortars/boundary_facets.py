"""Boundary facets of a body and the sub-facets on which its weight functions are linear."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import basix
import numpy as np
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices

from pw_elements.arrays import Array, Indices, LocalIndices
from pw_elements.checks import JoinedSpace, evaluate_at_owned_nodes, list_bodies
from pw_elements.contact.interface.mortars.overlap import (
    compute_cell_lengths_or_areas,
    compute_unoriented_cell_normals,
)
from pw_elements.elasticity import locate_facet_nodes_in_cells

# Nodes of each sub-facet of a facet, by the number of the facet's nodes. Vertices come first, then
# the middles of edges, then the centre of a quadrilateral
_SUB_FACET_NODES_BY_NODE_COUNT = {
    3: ((0, 2), (2, 1)),
    6: ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
    9: ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
}
# Cell type of a sub-facet, by its number of corners
SUB_FACET_CELL_TYPE_BY_CORNER_COUNT = {
    2: basix.CellType.interval,
    3: basix.CellType.triangle,
    4: basix.CellType.quadrilateral,
}
# An edge is sharp if the cosine between the normals of its adjacent facets is below this value
_MAX_NORMAL_COSINE_AT_SHARP_EDGE = float(np.cos(np.pi / 4)) - 1e-9
# Integral of a shape function over a facet that is zero except for round-off, relative to the facet
_NEGLIGIBLE_FRACTION_OF_FACET = 1e-12


@dataclass(frozen=True)
class BoundaryFacets:
    """Part of a body's boundary, gathered from all processes: f facets with k nodes each."""

    facet_nodes: Indices  # (f, k), global nodes; vertices first, then the middles of edges
    facet_x: Array  # (f, k, dim), positions of the nodes of each facet
    facet_normals: Array  # (f, dim), outward unit normals of the facets, treated as flat

    @property
    def space_dim(self) -> int:
        """Dimension of the space that contains the boundary."""
        return int(self.facet_x.shape[2])

    @cached_property
    def _quadratic_facet_element(self) -> basix.finite_element.FiniteElement:
        return basix.create_element(
            basix.ElementFamily.P,
            SUB_FACET_CELL_TYPE_BY_CORNER_COUNT[self.local_sub_facet_nodes.shape[1]],
            2,
        )

    @cached_property
    def local_sub_facet_nodes(self) -> Indices:
        """Local nodes (number of sub-facets, k) of the sub-facets of one facet."""
        return np.array(_SUB_FACET_NODES_BY_NODE_COUNT[self.facet_nodes.shape[1]])

    @cached_property
    def sub_facet_nodes_corners_and_normals(self) -> tuple[Indices, Array, Array]:
        """Nodes (s, k), corners (s, k, dim) and outward unit normals (s, dim) of all sub-facets."""
        count, k = self.local_sub_facet_nodes.shape
        corners = self.facet_x[:, self.local_sub_facet_nodes].reshape(-1, k, self.space_dim)
        outward = np.repeat(self.facet_normals, count, axis=0)
        normal = compute_unoriented_cell_normals(corners)
        normal *= np.sign(np.sum(normal * outward, axis=1))[:, None]
        return self.facet_nodes[:, self.local_sub_facet_nodes].reshape(-1, k), corners, normal

    def evaluate_trial_functions(
        self, sub_facet: Indices, corner_shape_functions: Array
    ) -> tuple[Indices, Array]:
        """Evaluate the quadratic trial functions of facets at q points.

        Args:
            sub_facet: (q,), index of the sub-facet that contains each point.
            corner_shape_functions: (q, k), shape functions of the corners of the sub-facet at each
                point.

        Returns:
            Nodes (q, n) of the facet that contains each point, and the values (q, n) of their trial
            functions at the point.
        """
        facet, part = np.divmod(sub_facet, len(self.local_sub_facet_nodes))
        corner_coordinates = self._quadratic_facet_element.points[self.local_sub_facet_nodes][part]
        coordinates = np.einsum("qa,qab->qb", corner_shape_functions, corner_coordinates)
        values = np.zeros((len(sub_facet), self.facet_nodes.shape[1]))
        if len(sub_facet):  # Basix does not accept empty arrays
            values = self._quadratic_facet_element.tabulate(0, coordinates)[0, :, :, 0]
        return self.facet_nodes[facet], values

    def interpolate_positions(self, sub_facet: Indices, trial_function_values: Array) -> Array:
        """Return positions (q, dim) of points on the facets.

        Args:
            sub_facet: (q,), index of the sub-facet that contains each point.
            trial_function_values: (q, n), values of the facet's trial functions at each point.
        """
        facet_x = self.facet_x[sub_facet // len(self.local_sub_facet_nodes)]
        return np.einsum("qk,qkd->qd", trial_function_values, facet_x)

    @cached_property
    def nodes(self) -> Indices:
        """Sorted global numbers (n,) of the nodes."""
        return np.unique(self.facet_nodes)

    def with_positions(self, x: Array) -> "BoundaryFacets":
        """Return a copy with the nodes at positions x (n, dim), in the order of `nodes`."""
        return replace(self, facet_x=x[np.searchsorted(self.nodes, self.facet_nodes)])

    def average_normals(self, nodes: Indices) -> Array:
        """Return unit normals (..., dim) at nodes with global numbers (...).

        Each normal is the mean of the normals of the adjacent sub-facets, weighted with the lengths
        or areas of the sub-facets.
        """
        sub_facet_nodes, corners, normal = self.sub_facet_nodes_corners_and_normals
        position = np.searchsorted(self.nodes, sub_facet_nodes)
        sums = np.zeros((len(self.nodes), self.space_dim))
        np.add.at(
            sums, position, (normal * compute_cell_lengths_or_areas(corners)[:, None])[:, None, :]
        )
        sums /= np.linalg.norm(sums, axis=1, keepdims=True)
        return sums[np.searchsorted(self.nodes, nodes)]

    def find_sharp_edge_node_positions(self) -> Array:
        """Return positions (n, dim) of nodes at which adjacent facets meet at a sharp edge.

        At a sharp edge, the normals of the two facets differ by more than 45 degrees.
        """
        k, element = self.facet_nodes.shape[1], self._quadratic_facet_element
        slopes = element.tabulate(1, element.points)[1:, :, :, 0]
        tangents = np.einsum("dqk,fkx->fqdx", slopes, self.facet_x)
        tangents = tangents.reshape(-1, self.space_dim - 1, self.space_dim)
        normal = compute_unoriented_cell_normals(
            np.concatenate([np.zeros_like(tangents[:, :1]), tangents], axis=1)
        )
        normal *= np.sign(np.sum(normal * np.repeat(self.facet_normals, k, axis=0), axis=1))[
            :, None
        ]
        # local nodes at which at most two facets meet, which are end nodes in the plane and
        # mid-side nodes in space
        shared = np.concatenate(element.entity_dofs[self.space_dim - 2]).astype(np.int64)
        normal = normal.reshape(-1, k, self.space_dim)[:, shared].reshape(-1, self.space_dim)
        node = self.facet_nodes[:, shared].ravel()
        x = self.facet_x[:, shared].reshape(-1, self.space_dim)
        order = np.argsort(node, kind="stable")
        facet, neighbour = order[:-1], order[1:]
        cosine = np.sum(normal[facet] * normal[neighbour], axis=1)
        sharp = (node[facet] == node[neighbour]) & (cosine < _MAX_NORMAL_COSINE_AT_SHARP_EDGE)
        return np.asarray(x[facet[sharp]])

    def node_positions(self) -> Array:
        """Return positions (n, dim) of the nodes in the order of `nodes`."""
        _, index = np.unique(self.facet_nodes, return_index=True)
        return self.facet_x.reshape(-1, self.space_dim)[index]


def gather_boundary_facets(space: fem.FunctionSpace, facets: LocalIndices) -> BoundaryFacets:
    """Gather the given exterior facets from all processes; collective.

    Args:
        space: space of displacements.
        facets: local numbers of the facets on this process.
    """
    nodes, x, outward = compute_facet_nodes_positions_and_facet_normals(space, facets)
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    parts = zip(*space.mesh.comm.allgather((number, x, outward)), strict=True)
    return BoundaryFacets(*(np.concatenate(part) for part in parts))


def gather_boundary_facets_of_bodies(
    space: fem.FunctionSpace | JoinedSpace, facets_of_bodies: Sequence[LocalIndices]
) -> list[BoundaryFacets]:
    """Gather exterior facets of each body that has some, with node numbers of the whole space.

    Collective.

    Args:
        space: space of displacements.
        facets_of_bodies: for each body, local numbers of the facets on this process.
    """
    sides = []
    for k, (body, facets) in enumerate(zip(list_bodies(space), facets_of_bodies, strict=True)):
        side = gather_boundary_facets(body.space, facets)
        if isinstance(space, JoinedSpace):
            side = replace(side, facet_nodes=space.number_nodes(k, side.facet_nodes))
        if len(side.facet_nodes):
            sides.append(side)
    return sides


def compute_facet_nodes_positions_and_facet_normals(
    space: fem.FunctionSpace, facets: LocalIndices
) -> tuple[LocalIndices, Array, Array]:
    """Return nodes (f, k), node positions (f, k, dim) and outward normals (f, dim) of facets.

    Normals are unit vectors, computed as if the facets were flat.

    Args:
        space: space of displacements.
        facets: (f,), local numbers of exterior facets.
    """
    dim, (cells, local_nodes) = space.mesh.topology.dim, locate_facet_nodes_in_cells(space, facets)
    cell_nodes = space.dofmap.list[cells]
    nodes = np.take_along_axis(cell_nodes, local_nodes, axis=1)
    x = space.tabulate_dof_coordinates()[:, :dim]
    cell_middle = x[cell_nodes].mean(axis=1)
    normal = compute_unoriented_cell_normals(x[nodes[:, :dim]])
    normal *= np.sign(np.sum(normal * (x[nodes[:, 0]] - cell_middle), axis=1))[:, None]
    return nodes, x[nodes], normal


def integrate_outward_normals(space: fem.FunctionSpace | JoinedSpace) -> Array:
    """Return the outward normals (owned nodes, dim), weighted with shape functions; collective.

    The shape functions of the nodes are integrated over the exterior facets as if these were flat.
    The result is zero where these integrals are zero, as at the vertices of quadratic triangles.

    Args:
        space: space of displacements.
    """
    if isinstance(space, JoinedSpace):
        return evaluate_at_owned_nodes(integrate_outward_normals, space)
    mesh, index_map = space.mesh, space.dofmap.index_map
    facet_dim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(facet_dim, mesh.topology.dim)
    nodes, x, normals = compute_facet_nodes_positions_and_facet_normals(
        space, exterior_facet_indices(mesh.topology)
    )
    cell_type, element = mesh.basix_cell(), space.element.basix_element
    facet_type = basix.cell.subentity_types(cell_type)[facet_dim][0]
    points, weights = basix.make_quadrature(
        facet_type, element.embedded_superdegree, polyset_type=element.polyset_type
    )
    corners = basix.geometry(cell_type)[basix.topology(cell_type)[facet_dim][0]]
    points = corners[0] + points @ (corners[1 : facet_dim + 1] - corners[0])
    nodes_of_first_facet = space.dofmap.dof_layout.entity_closure_dofs(facet_dim, 0)
    functions = element.tabulate(0, points)[0, :, nodes_of_first_facet, 0]
    fractions = functions @ weights / weights.sum()  # the same on all facets
    fractions[np.abs(fractions) < _NEGLIGIBLE_FRACTION_OF_FACET] = 0.0
    sizes = compute_cell_lengths_or_areas(x[:, : len(corners)])
    area_vectors = (sizes[:, None] * normals)[:, None, :] * fractions[:, None]
    sums = la.vector(index_map, facet_dim + 1)
    sums.array[:] = 0.0
    np.add.at(sums.array.reshape(-1, facet_dim + 1), nodes, area_vectors)
    sums.scatter_reverse(la.InsertMode.add)
    return np.array(sums.array.reshape(-1, facet_dim + 1)[: index_map.size_local])
