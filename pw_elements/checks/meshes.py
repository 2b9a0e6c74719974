"""Checks of the mesh wherever a body is made: what its cells and its boundary can tell.

Errors are cells without volume or partly inside out (curved ones and non-convex quadrilaterals,
too), neighbours on the same side of a facet (folds), facets with more than two cells, parts that
overlap, and hanging nodes. Coinciding facets that face each other are a crack or two bodies that
touch: both are legitimate, so that they are logged only, by the logger `pw_elements`, a crack as a
warning.

The outward area vectors of both cells of an inner facet have to cancel; the cells' volumes then
add up to the boundary's integral of x·n / dim, which need not be computed.

What cannot be told is in the guide's page on meshes.
"""

import logging
from weakref import WeakKeyDictionary
from zlib import crc32

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import geometry, la
from dolfinx.common import IndexMap
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements._compat import cell_nodes
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.progress import log_on_root

# Largest coordinate whose products with others, such as volumes, are finite
MAX_COORDINATE = 1e100
# Smallest Jacobian determinant over the dim-th power of a cell's size
_FLAT_DETERMINANT = 1e-10
# Sum of both area vectors of a facet within, over their sizes: 0 but for round-off, or else 1
_CANCELS = 1e-6
# Distance of places that are the same, over the size of a facet
_NEAR = 1e-6
# Cells whose Jacobians are in memory at the same time
_CELLS_AT_ONCE = 20_000
# Its axes are such that no facet is likely to be parallel to one, nor a ray to meet an edge
_TURN = np.sin(np.arange(9.0).reshape(3, 3) ** 2 + 1)

_checked: WeakKeyDictionary[Mesh, int] = WeakKeyDictionary()


class DegenerateMesh(ValueError):
    """Cells that are flat or inverted, or cells and boundaries that do not make a body."""


def format_points(points: Array) -> str:
    """Positions (m, dim) as words, in order of their coordinates, round-off left out."""
    points = np.round(points, 12) + 0.0
    points = points[np.lexsort(np.round(points, 9).T[::-1])]
    words = ["(" + ", ".join(f"{c:.4g}" for c in point) + ")" for point in points[:6]]
    more = f" and {len(points) - 6} more" if len(points) > 6 else ""
    return ", ".join(words) + more


def check_mesh(mesh: Mesh) -> None:
    """Refuses cells and boundaries that do not make a body; again only when nodes have moved."""
    now = crc32(np.ascontiguousarray(mesh.geometry.x))
    if not mesh.comm.allreduce(_checked.get(mesh) != now, MPI.LOR):
        return
    if mesh.topology.dim != mesh.geometry.dim:
        raise DegenerateMesh("the mesh is a surface or line in space, not a body")
    _check_coordinates(mesh)
    cells = _Cells(mesh)
    cells.check()
    if mesh.topology.dim > 1:
        surface = _Surface(cells)
        surface.check_hanging()
        surface.check_overlap()
        surface.log_contacts()
    _checked[mesh] = now


def _check_coordinates(mesh: Mesh) -> None:
    largest = mesh.comm.allgather(float(np.abs(mesh.geometry.x).max(initial=0.0)))
    if not np.isfinite(largest).all():
        raise DegenerateMesh("a node of the mesh has coordinates that are not finite")
    if max(largest) > MAX_COORDINATE:
        raise DegenerateMesh(
            f"a node of the mesh has a coordinate of {max(largest):.3g}, and volumes overflow: "
            "choose another unit of length"
        )


def check_cells(mesh: Mesh) -> None:
    """Refuse cells without volume or partly inside out, folds, and facets of more than two cells.

    Raises:
        DegenerateMesh: with the places of such cells.
    """
    _check_coordinates(mesh)
    _Cells(mesh).check()


class _Cells:
    """Cells of this process (without ghosts), and what is around them.

    Area vectors (dim, sides, cells) point outwards; a triangle's is twice as long as it is large.
    """

    def __init__(self, mesh: Mesh) -> None:
        topology, dim = mesh.topology, mesh.topology.dim
        self.mesh, self.dim = mesh, dim
        self.element = mesh.ufl_domain().ufl_coordinate_element().basix_element
        nodes = cell_nodes(mesh)[: topology.index_map(dim).size_local]
        corner = [dofs[0] for dofs in self.element.entity_dofs[0]]
        self.vertices = nodes[:, corner].astype(np.int64)
        self._x = np.ascontiguousarray(mesh.geometry.x[:, :dim].T)[:, nodes.T]
        self.middle = self._x[:, corner].mean(axis=1).T

    def check(self) -> None:
        kind, dim, cells = self.element.cell_type, self.dim, len(self.middle)
        corners = basix.geometry(kind)
        sides = np.array([corners[c].mean(axis=0) for c in basix.topology(kind)[dim - 1]])
        straight = self.element.degree == 1 and len(corners) == dim + 1
        inner = np.vstack([self.element.points, basix.make_quadrature(kind, 4)[0]])
        points = sides[:1] if straight else np.vstack([sides, inner])
        slopes = self.element.tabulate(1, points)[1:, :, :, 0]
        at_sides = np.empty((dim, dim, 1 if straight else len(sides), cells))
        flat, turned = np.zeros((2, cells), dtype=bool)
        for first in range(0, cells, _CELLS_AT_ONCE):
            some = slice(first, first + _CELLS_AT_ONCE)
            jacobian = np.einsum("jpn,inc->ijpc", slopes, self._x[:, :, some], optimize=True)
            cofactor = _cofactors(jacobian)
            determinant = sum(jacobian[i, 0] * cofactor[i, 0] for i in range(dim))
            size = np.sqrt(np.sum(jacobian[:, :, 0] ** 2, axis=(0, 1)))
            flat[some] = np.abs(determinant).min(axis=0) <= _FLAT_DETERMINANT * size**dim
            turned[some] = determinant.min(axis=0) * determinant.max(axis=0) < 0
            at_sides[..., some] = cofactor[:, :, : at_sides.shape[2]] * np.sign(determinant[0])
        self._refuse(flat, "have no volume")
        self._refuse(turned, "are turned inside out in a part of them")
        if dim > 1:
            self._check_facets(np.broadcast_to(at_sides, (dim, dim, len(sides), cells)))

    def _check_facets(self, cofactor: Array) -> None:
        """Looks for folds and more than two cells at a facet, cells of other processes too."""
        topology, dim = self.mesh.topology, self.dim
        topology.create_connectivity(dim, dim - 1)
        sides = cofactor.shape[2]
        self.facets = topology.connectivity(dim, dim - 1).array.reshape(-1, sides)
        self.facets = self.facets[: len(self.middle)].T
        kind = self.element.cell_type
        normal, tangents = basix.cell.facet_outward_normals(kind), basix.cell.facet_jacobians(kind)
        sizes = np.sqrt(np.linalg.det(np.swapaxes(tangents, 1, 2) @ tangents))
        self.area = np.einsum("ijpc,pj->ipc", cofactor, normal * sizes[:, None])

        size = np.sqrt(sum(a**2 for a in self.area))
        index_map = topology.index_map(dim - 1)
        sums = la.vector(index_map, dim + 2)
        total = sums.array.reshape(-1, dim + 2)
        for k, values in enumerate((*self.area, size, np.ones_like(size))):
            total[:, k] = np.bincount(self.facets.ravel(), values.ravel(), len(total))
        sums.scatter_reverse(la.InsertMode.add)
        sums.scatter_forward()
        cells = total[:, -1]
        self.exterior = (cells == 1)[self.facets]
        rest = np.sqrt(sum(total[:, k] ** 2 for k in range(dim)))
        folded = ((cells == 2) & (rest > _CANCELS * total[:, dim]))[self.facets].any(axis=0)
        self._refuse((cells > 2)[self.facets].any(axis=0), "share a facet with two others")
        self._refuse(folded, "lie on the same side of a facet as their neighbour")

    def _refuse(self, wrong: Mask, what: str) -> None:
        places = np.concatenate(self.mesh.comm.allgather(self.middle[wrong]))
        if len(places):
            raise DegenerateMesh(f"cells around {format_points(np.unique(places, axis=0))} {what}")


class _Surface:
    """Exterior facets (m of k corners) of this process, and all above, below and beside these.

    Areas (m, dim) point outwards. Up is a direction in which hardly a facet stands.
    """

    def __init__(self, cells: _Cells) -> None:
        self._cells, mesh = cells, cells.mesh
        self._comm: MPI.Comm = mesh.comm
        side, self._cell = np.nonzero(cells.exterior)
        of_side = np.array(basix.topology(cells.element.cell_type)[cells.dim - 1])
        local = np.take_along_axis(cells.vertices[self._cell], of_side[side], axis=1)
        number = mesh.geometry.index_map().local_to_global(local.ravel().astype(np.int32))
        corner = mesh.geometry.x[local, : cells.dim]
        self._turn = np.linalg.qr(_TURN[: cells.dim, : cells.dim])[0]
        self._centre = cells.middle[np.unique(self._cell)]
        shadow = (corner @ self._turn)[:, :, :-1]
        low, high = shadow.min(axis=1), shadow.max(axis=1)
        centre = (self._centre @ self._turn)[:, :-1]
        first = np.concatenate([low, centre]).min(axis=0, initial=np.inf)
        last = np.concatenate([high, centre]).max(axis=0, initial=-np.inf)
        slack = 2 * _NEAR * np.maximum(last - first, 0.0)
        self._to = [
            np.flatnonzero((high >= first).all(axis=1) & (low <= last).all(axis=1))
            for first, last in self._comm.allgather((first - slack, last + slack))
        ]
        self.corner = self._exchanged(corner)
        self.vertex = self._exchanged(number.reshape(local.shape))
        self.area = self._exchanged(cells.area[:, side, self._cell].T)
        self._owner = self._exchanged(np.full(len(corner), self._comm.rank))
        self._middle = self.corner.mean(axis=1)
        self._radius = np.linalg.norm(self.corner - self._middle[:, None], axis=2).max(axis=1)

    def _exchanged(self, values: npt.NDArray) -> npt.NDArray:
        """Values (m, ...) of the facets, by process, of those (own facets, ...) of this one."""
        return np.concatenate(self._comm.alltoall([values[some] for some in self._to]))

    def _gathered(self, values: npt.NDArray) -> npt.NDArray:
        return np.concatenate(self._comm.allgather(values))

    def check_hanging(self) -> None:
        """Refuses smaller facets that lie on a larger one and share its vertices.

        Non-matching bodies in contact have no common vertices. Curved facets are not looked at.
        """
        if len(places := self._gathered(self._middle[self._torn()])):
            raise DegenerateMesh(
                f"facets around {format_points(places)} have hanging nodes: smaller facets of "
                "their neighbours lie on them, and the mesh is torn apart there"
            )

    def _torn(self) -> Indices:
        """Facets of this process whose corners are corners of smaller ones that lie on them."""
        vertex, first = np.unique(self.vertex, return_index=True)
        x, own = self.corner.reshape(-1, self._cells.dim)[first], self._owner == self._comm.rank
        facet, near = _near(cKDTree(x), self._middle[own], self._radius[own] * (1 + _NEAR))
        facet = np.flatnonzero(own)[facet]
        inside = self._contains(facet, x[near])
        corner = (self.vertex[facet] == vertex[near][:, None]).any(axis=1)
        suspects = np.unique(facet[inside & ~corner])
        if not len(suspects):
            return suspects
        ones = np.ones(self.vertex.size, dtype=np.int32)
        at = np.searchsorted(vertex, self.vertex.ravel())
        facets = np.arange(0, self.vertex.size + 1, self.vertex.shape[1])
        corners = sp.csr_matrix((ones, at, facets))  # of each facet
        where = facet[inside], near[inside]
        on = sp.csr_matrix((ones[:1].repeat(len(near[inside])), where), corners.shape)[suspects]
        beside = (on @ corners.T == self.vertex.shape[1]).tolil()  # all of whose corners lie on it
        beside[np.arange(len(suspects)), suspects] = False
        shared = (beside.astype(np.int32) @ corners).multiply(corners[suspects]) > 0
        return suspects[np.diff(shared.tocsr().indptr) == self.vertex.shape[1]]

    def _contains(self, facet: Indices, x: Array) -> Mask:
        """Whether facets (n,) have points x (n, dim) on them, their rims included."""
        middle, size = self._middle[facet], np.linalg.norm(self.area[facet], axis=1)
        height = np.abs(np.sum((x - middle) * self.area[facet], axis=1))
        around = self.corner[facet] - x[:, None]
        if around.shape[1] == 4:
            around, size = around[:, [0, 1, 3, 2]], 2 * size
        # in space triangles between the point and each edge
        spans = np.cross(around, np.roll(around, -1, axis=1)) if x.shape[1] == 3 else around
        fan = np.linalg.norm(spans, axis=2).sum(axis=1)
        return (height < _NEAR * self._radius[facet] * size) & (fan < (1 + _NEAR) * size)

    def check_overlap(self) -> None:
        """Raises DegenerateMesh if centres of cells at the boundary lie in other cells, too.

        A ray from each centre upwards leaves the body once oftener than it enters it.
        """
        cells, mesh, turn, centre = self._cells, self._cells.mesh, self._turn, self._centre
        x, corner, up = centre @ turn, self.corner @ turn, (self.area @ turn)[:, -1]
        if corner.shape[1] == 4:
            corner, up = np.concatenate([corner[:, :3], corner[:, 1:]]), np.tile(up, 2)
        shadow, under = corner[:, :, :-1], x[:, :-1]  # seen along the ray
        middle = shadow.mean(axis=1)
        radius = np.linalg.norm(shadow - middle[:, None], axis=2).max(axis=1)
        facet, point = _near(cKDTree(under), middle, radius)
        spans = np.linalg.inv(np.swapaxes(shadow[:, 1:] - shadow[:, :1], 1, 2))
        share = np.einsum("nij,nj->ni", spans[facet], under[point] - shadow[facet, 0])
        rise = (corner[:, 1:, -1] - corner[:, :1, -1])[facet]
        height = corner[facet, 0, -1] + np.sum(share * rise, axis=1)
        hit = (share >= 0).all(axis=1) & (share.sum(axis=1) < 1) & (height > x[point, -1])
        times = np.bincount(point[hit], np.sign(up[facet[hit]]), len(x))
        suspects = self._gathered(centre[times > 1.5])
        if not len(suspects):
            return
        points = np.zeros((len(suspects), 3))
        points[:, : cells.dim] = suspects
        own = np.arange(len(cells.middle), dtype=np.int32)
        tree = geometry.bb_tree(mesh, cells.dim, entities=own)
        found = geometry.compute_collisions_points(tree, points)
        found = geometry.compute_colliding_cells(mesh, found, points)
        number = np.diff(found.offsets)
        mesh.comm.Allreduce(MPI.IN_PLACE, number, MPI.SUM)
        if np.any(number > 1):
            places = np.unique(suspects[number > 1], axis=0)
            raise DegenerateMesh(
                f"cells around {format_points(places)} lie in other parts of the mesh"
            )

    def log_contacts(self) -> None:
        least = self._comm.allreduce(self._radius.min(initial=np.inf), MPI.MIN)
        pairs = cKDTree(self._middle).query_pairs(_NEAR * least, output_type="ndarray")
        pairs = pairs[self._owner[pairs].min(axis=1) == self._comm.rank]
        if not self._comm.allreduce(len(pairs)):
            return
        cells, mesh = self._cells, self._cells.mesh
        number, _ = connected_components(mesh.comm, mesh.geometry.index_map(), cells.vertices)
        piece = self._exchanged(number[cells.vertices[self._cell, 0]])[pairs]
        crack = self._gathered(piece[:, 0] == piece[:, 1])
        middle = self._gathered(self._middle[pairs[:, 0]])
        for which, level, what in (
            (crack, logging.WARNING, "a crack in one piece of the mesh"),
            (~crack, logging.INFO, "two pieces of the mesh that touch"),
        ):
            if which.any():
                words = (
                    f"facets coincide, but share no nodes: {what} at {format_points(middle[which])}"
                )
                log_on_root(mesh.comm, level, words)


def _cofactors(jacobian: Array) -> Array:
    dim = len(jacobian)
    if dim == 1:
        return np.ones_like(jacobian)
    if dim == 2:
        (a, b), (c, d) = jacobian
        return np.array([[d, -c], [-b, a]])
    a, b, c = jacobian
    return np.array([np.cross(*rows, axis=0) for rows in ((b, c), (c, a), (a, b))])


def connected_components(
    comm: MPI.Comm, index_map: IndexMap, cells: npt.NDArray
) -> tuple[Indices, int]:
    """Number of the connected piece that each node (ghosts too) of cells (n, k) belongs to."""
    nodes = index_map.size_local + index_map.num_ghosts
    others = cells[:, 1:]  # a cell's first node links them
    part = _components(nodes, np.repeat(cells[:, 0], others.shape[1]), others.ravel())
    part += sum(comm.allgather(int(part.max(initial=-1)) + 1)[: comm.rank])
    # parts of two processes are one piece if they share a node: the owner's number tells which
    owner = la.vector(index_map, 1)
    owner.array[:] = part
    owner.scatter_forward()
    links = np.unique(np.stack([part, owner.array.astype(np.int64)]), axis=1)
    own, other = np.concatenate(comm.allgather(links), axis=1)
    piece = _components(int(max(own.max(), other.max())) + 1, own, other)
    return piece[part], int(piece.max()) + 1


def _components(count: int, a: Indices, b: Indices) -> Indices:
    graph = sp.coo_matrix((np.ones(len(a)), (a, b)), (count, count))
    return sp.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _near(tree: cKDTree, middle: Array, radius: Array) -> tuple[Indices, Indices]:
    """Pairs of a ball (middle and radius) and a point of the tree in it."""
    found = tree.query_ball_point(middle, radius)
    ball = np.repeat(np.arange(len(middle)), [len(points) for points in found])
    return ball, np.array([p for points in found for p in points], dtype=np.int64)
