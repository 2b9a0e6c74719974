"""Exterior facets around contact points: where the body ends there, and their size."""

from dataclasses import dataclass
from itertools import combinations

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices

from pw_elements._compat import cell_nodes

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Corners of the simplices that a facet with so many corners is made of
_SIMPLICES = {2: ([0, 1],), 3: ([0, 1, 2],), 4: ([0, 1, 3], [0, 3, 2])}
# Least cosine between a ray and the outward normal of a facet that lies across it
_ACROSS = 0.6
# Round-off of places, relative
_NEAR = 1e-9


@dataclass(frozen=True)
class Facets:
    """Facets (f of them) around points (m) of this process; those of other processes, too.

    Args:
        point: (f,), number of the point.
        outward: (f, dim), unit normal at the facet's middle.
        size: (f,), largest distance of its corners.
        points: m.
    """

    point: Indices
    outward: Array
    size: Array
    points: int

    @classmethod
    def around(cls, node: Indices, space: fem.FunctionSpace, exterior: "Exterior") -> "Facets":
        """Of points that are nodes of this process, given by their global numbers (m,)."""
        index_map, comm = space.dofmap.index_map, space.mesh.comm
        first = index_map.local_range[0]
        wanted = la.vector(index_map, 1)
        wanted.array[:] = 0.0
        wanted.array[node - first] = 1.0
        wanted.scatter_forward()
        facet, place = np.nonzero(wanted.array[exterior.nodes] > 0)
        touched = index_map.local_to_global(exterior.nodes[facet, place].astype(np.int32))
        touched, outward, size = (
            np.concatenate(comm.allgather(part))
            for part in (touched, exterior.outward[facet], exterior.size[facet])
        )
        order = np.argsort(node)
        at = np.searchsorted(node[order], touched)
        mine = at < len(node)
        mine[mine] = node[order][at[mine]] == touched[mine]
        return cls(order[at[mine]], outward[mine], size[mine], len(node))

    def of(self, rows: Indices) -> "Facets":
        """Those around some of the points, numbered anew."""
        number = np.full(self.points, -1)
        number[rows] = np.arange(len(rows))
        mine = number[self.point] >= 0
        return Facets(number[self.point[mine]], self.outward[mine], self.size[mine], len(rows))

    def cosines(self, normal: Array) -> Array:
        """Least cosine (m,) between vectors (m, dim) and the outward normals around a point."""
        least = np.full(self.points, np.inf)
        np.minimum.at(least, self.point, np.sum(normal[self.point] * self.outward, axis=1))
        return least

    def sizes(self) -> Array:
        """Size (m,) of the smallest facet around each point."""
        least = np.full(self.points, np.inf)
        np.minimum.at(least, self.point, self.size)
        return least


@dataclass(frozen=True)
class Exterior:
    """Exterior facets (f of them) of this process.

    Args:
        nodes: (f, k), local numbers of all nodes.
        vertices: (f, l), of those at the corners.
        corner: (f, l, dim), positions.
        outward: (f, dim), unit normal at the middle.
    """

    nodes: npt.NDArray[np.int32]
    vertices: npt.NDArray[np.int32]
    corner: Array
    outward: Array

    @classmethod
    def of(cls, space: fem.FunctionSpace) -> "Exterior":
        """Of a space's mesh."""
        mesh, dim = space.mesh, space.mesh.topology.dim
        shape = mesh.ufl_domain().ufl_coordinate_element().basix_element
        topology = mesh.topology
        topology.create_connectivity(dim - 1, dim)
        topology.create_connectivity(dim, dim - 1)
        facets = exterior_facet_indices(topology)
        behind = topology.connectivity(dim - 1, dim)
        cell = behind.array[behind.offsets[facets]]
        on_facet = np.array(basix.topology(shape.cell_type)[dim - 1])
        own = topology.connectivity(dim, dim - 1).array.reshape(-1, len(on_facet))[cell]
        side = np.argmax(own == facets[:, None], axis=1)

        middles = basix.geometry(shape.cell_type)[on_facet].mean(axis=1)
        x = mesh.geometry.x[cell_nodes(mesh)[cell]][:, :, :dim]
        slopes = shape.tabulate(1, middles)[1:, :, :, 0][:, side]
        jacobian = np.einsum("jfn,fni->fij", slopes, x)
        reference = basix.cell.facet_outward_normals(shape.cell_type)[side]
        outward = np.linalg.solve(np.swapaxes(jacobian, 1, 2), reference[:, :, None])[:, :, 0]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)

        element = space.element.basix_element
        x_of, u_of = (
            np.array([dofs[0] for dofs in e.entity_dofs[0]])[on_facet][side]
            for e in (shape, element)
        )
        closure = np.array(element.entity_closure_dofs[dim - 1])[side]
        rows = np.arange(len(cell))[:, None]
        dofs = space.dofmap.list[cell]
        return cls(dofs[rows, closure], dofs[rows, u_of], x[rows, x_of], outward)

    @property
    def size(self) -> Array:
        """Largest distance (f,) of two corners."""
        ends = combinations(range(self.corner.shape[1]), 2)
        sides = [self.corner[:, a] - self.corner[:, b] for a, b in ends]
        return np.asarray(np.max([np.linalg.norm(side, axis=1) for side in sides], axis=0))

    def exit(self, origin: Array, direction: Array, moved: Array) -> tuple[float, Array]:
        """Where a ray leaves the body through a facet that lies across it, of this process.

        Args:
            origin: (dim,), on the boundary.
            direction: (dim,), a unit vector into the body.
            moved: (f, l, dim), displacements of the corners.

        Returns:
            Distance, infinite if there is none, and displacement (dim,) there.
        """
        distance, there = np.inf, np.zeros(len(origin))
        across = self.outward @ direction > _ACROSS
        least = _NEAR * np.abs(self.corner).max(initial=0.0)
        for corners in _SIMPLICES[self.corner.shape[1]]:
            x, u = self.corner[across][:, corners], moved[across][:, corners]
            edges = np.swapaxes(x[:, 1:] - x[:, :1], 1, 2)
            rays = np.broadcast_to(-direction[:, None], (len(x), len(origin), 1))
            matrix = np.concatenate([edges, rays], axis=2)
            found = np.linalg.solve(matrix, (origin - x[:, 0])[:, :, None])[:, :, 0]
            share, t = found[:, :-1], found[:, -1]
            inside = (share >= -_NEAR).all(axis=1) & (share.sum(axis=1) <= 1 + _NEAR)
            t = np.where(inside & (t > least), t, np.inf)
            if len(t) and t.min() < distance:
                k = int(np.argmin(t))
                distance = float(t[k])
                there = u[k, 0] + share[k] @ (u[k, 1:] - u[k, 0])
        return distance, there
