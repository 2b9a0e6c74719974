"""Parts of the boundary as mortar interfaces see them, gathered from all processes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices

from pw_elements.recovery import facet_nodes

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Nodes of the sub-facets of a facet of so many nodes: vertices first, then the middles of edges,
# and a quadrilateral's own
_PARTS = {
    3: ((0, 2), (2, 1)),
    6: ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
    9: ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
}
_EDGES = {3: ((0, 1),), 6: ((1, 2), (0, 2), (0, 1))}
# Places of a quadrilateral's nodes
_PLACES = np.array(
    [[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0], [0, 0.5], [1, 0.5], [0.5, 1], [0.5, 0.5]]
)
_NINE = 9


@dataclass(frozen=True)
class Trace:
    """A part of the boundary, gathered from all processes: facets (f) with k nodes each.

    Args:
        node: (f, k), global numbers, vertices first, then the middles of edges.
        x: (f, k, dim).
        outward: (f, dim), unit normals of the facets, seen as flat.
    """

    node: Indices
    x: Array
    outward: Array

    @property
    def dim(self) -> int:
        """Of space."""
        return int(self.x.shape[2])

    @cached_property
    def _local(self) -> Indices:
        """Nodes (parts, k) of the sub-facets of a facet."""
        return np.array(_PARTS[self.node.shape[1]])

    @cached_property
    def parts(self) -> tuple[Indices, Array, Array]:
        """Nodes (s, k) of the sub-facets, their corners (s, k, dim), and normals (s, dim)."""
        parts, k = self._local.shape
        corners = self.x[:, self._local].reshape(-1, k, self.dim)
        outward = np.repeat(self.outward, parts, axis=0)
        normal = across(corners)
        normal *= np.sign(np.sum(normal * outward, axis=1))[:, None]
        return self.node[:, self._local].reshape(-1, k), corners, normal

    def functions(self, part: Indices, place: Array) -> tuple[Indices, Array]:
        """Nodes (q, n) and quadratic functions (q, n) at weights (q, k) of sub-facets (q,)."""
        facet, which = np.divmod(part, len(self._local))
        if self.node.shape[1] == _NINE:
            at = np.einsum("qa,qab->qb", place, _PLACES[self._local][which])[:, None]
            ends = np.where(_PLACES == 0, (1 - at) * (1 - 2 * at), at * (2 * at - 1))
            values = np.where(_PLACES == 0.5, 4 * at * (1 - at), ends)
            return self.node[facet], values.prod(axis=2)
        corner = np.eye(self.dim)
        edges = np.array(_EDGES[self.node.shape[1]])
        corner = np.concatenate([corner, corner[edges].mean(axis=1)])[self._local]
        L = np.einsum("qa,qab->qb", place, corner[which])
        middle = 4 * L[:, edges[:, 0]] * L[:, edges[:, 1]]
        return self.node[facet], np.concatenate([L * (2 * L - 1), middle], axis=1)

    def positions(self, part: Indices, values: Array) -> Array:
        """Positions (q, dim) by quadratic functions (q, k)."""
        return np.einsum("qk,qkd->qd", values, self.x[part // len(self._local)])

    @cached_property
    def nodes(self) -> Indices:
        """Numbers (n,) of the nodes, sorted."""
        return np.unique(self.node)

    @cached_property
    def averaged(self) -> Array:
        """Unit normals (n, dim) of the nodes, means over the sub-facets around by their sizes."""
        nodes, corners, normal = self.parts
        of = np.searchsorted(self.nodes, nodes)
        sums = np.zeros((len(self.nodes), self.dim))
        np.add.at(sums, of, (normal * sizes(corners)[:, None])[:, None, :])
        return np.asarray(sums / np.linalg.norm(sums, axis=1, keepdims=True))

    def normals(self, nodes: Indices) -> Array:
        """Averaged normals (..., dim) of nodes (...)."""
        return self.averaged[np.searchsorted(self.nodes, nodes)]

    def positions_of_nodes(self) -> Array:
        """Positions (n, dim) of the nodes."""
        _, first = np.unique(self.node, return_index=True)
        return self.x.reshape(-1, self.dim)[first]


def gathered_trace(space: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> Trace:
    """Exterior facets (local numbers) of all processes."""
    mesh = space.mesh
    dim = mesh.topology.dim
    nodes = facet_nodes(space, facets)
    behind = mesh.topology.connectivity(dim - 1, dim)
    cells = space.dofmap.list[behind.array[behind.offsets[facets]]]
    x = space.tabulate_dof_coordinates()[:, :dim]
    inside = x[cells].mean(axis=1)
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    flat = across(x[nodes[:, :dim]])
    flat *= np.sign(np.sum(flat * (x[nodes[:, 0]] - inside), axis=1))[:, None]
    parts = zip(*mesh.comm.allgather((number, x[nodes], flat)), strict=True)
    return Trace(*(np.concatenate(part) for part in parts))


def facets_of(space: fem.FunctionSpace, node: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Exterior facets of owned cells all of whose nodes are among the owned ones (m,) of a pair."""
    chosen = la.vector(space.dofmap.index_map, 1)
    chosen.array[:] = 0.0
    chosen.array[node] = 1.0
    chosen.scatter_forward()
    topology = space.mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    facets = exterior_facet_indices(topology)
    kept = chosen.array[facet_nodes(space, facets)].all(axis=1)
    return np.asarray(facets[kept], dtype=np.int32)


def across(corners: Array) -> Array:
    """Unit normals (n, dim) of intervals, triangles or quadrilaterals, of either sign."""
    edges = _spanning(corners)
    if corners.shape[2] == 2:
        normal = np.asarray(edges[:, 0, ::-1] * [1.0, -1.0])
    else:
        normal = np.asarray(np.cross(edges[:, 0], edges[:, 1]))
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def sizes(corners: Array) -> Array:
    """Lengths or areas (n,), of quadrilaterals those of their projection along the normal."""
    edges = _spanning(corners)
    if corners.shape[2] == 2:
        return np.asarray(np.linalg.norm(edges[:, 0], axis=1))
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


def _spanning(corners: Array) -> Array:
    """Edges from the first corner, or a quadrilateral's diagonals."""
    if corners.shape[1] == 4:
        return np.asarray(corners[:, [3, 2]] - corners[:, :2])
    return np.asarray(corners[:, 1:] - corners[:, :1])
