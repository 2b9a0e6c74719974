"""The coarse level of quadratic functions: linear ones on the same mesh, under what is held."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

from pw_elements.linear_functions import interpolation_matrix, linear_space, near_null_space
from pw_elements.matrices import (
    add,
    block_diagonal,
    destroy,
    galerkin_product,
    is_blocked,
    python_matrix,
)
from pw_elements.projection import Projection, Supports
from pw_elements.ties import Ties, diagonal_blocks

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class LinearLevel:
    """Linear functions, and what they make of K under what is held on both levels.

    The matrix is P^T Pi K Pi P between the vertices' projections, with multiples of one where
    these hold. It is made once; then only the part near nodes that are held at times is exchanged.

    Args:
        K: (n, n), all rows and columns free.
        supports: of its space.
        fine: what is held at all nodes.

    Attributes:
        interpolation: from vertices to nodes, without what is held on either side.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports, fine: Projection) -> None:
        space = supports.space
        self._K, self._fine, self._space = K, fine, space
        self._block = space.dofmap.index_map_bs
        linear, self._vertex_node = linear_space(space)
        free = supports.free.reshape(-1, self._block)[self._vertex_node].ravel()
        self._held = Projection(free, self._block)
        self._P = interpolation_matrix(linear, space, supports.free, free)
        self._near_null = near_null_space(linear)
        self._moved = _Interpolation(self._P, fine, self._held)
        self.interpolation = python_matrix(self._P.getSizes(), self._moved, K.comm)
        self._ties: Ties | None = None
        self._tied: PETSc.Mat | None = None
        self._near: _Near | None = None
        self._matrix: PETSc.Mat | None = None
        self._exchanged: PETSc.Mat | None = None  # the part of it that is

    def tie(self, ties: Ties) -> None:
        """Has what is held of nodes follow others from now on, see `Multigrid.tie`."""
        vertex, at = self._vertices_of(ties.nodes)
        self._ties = ties
        self._moved.ties = Ties(ties.opposite.matMult(self._P), vertex, self._block, at)

    def watch(self, nodes: Indices) -> None:
        """Says which local nodes are held at times."""
        if self._near is None:
            self._near = _Near.of(self._K, self._P, self._space, nodes)
            self._matrix = None

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds at the vertices what is held at local nodes (m,), always the same ones."""
        vertex, at = self._vertices_of(nodes)
        self._held.hold(vertex, held[at], weight[at])
        if self._moved.ties:
            self._moved.ties.hold(held[at])

    def carried(self) -> tuple[Indices, Array]:
        """Nodes (k,) that others follow, and the blocks (k, block, block) of K they so get."""
        ties, near = self._ties, self._near
        if ties is None:
            return np.empty(0, dtype=np.int64), np.empty((0, self._block, self._block))
        assert near is not None, "what is held at times is known before"
        if self._tied is None:
            first = near.K.getOwnershipRange()[0] // self._block
            rows = first + np.searchsorted(near.nodes, np.sort(ties.nodes))
            numbers = rows.astype(PETSc.IntType)
            held = PETSc.IS().createBlock(self._block, numbers, comm=self._K.comm)
            self._tied = near.K.createSubMatrix(held, held)
        order = np.argsort(np.argsort(ties.nodes))
        followed = ties.followed(order, len(order))
        carried = self._tied.ptap(followed)
        found = diagonal_blocks(carried, self._block)
        destroy(carried, followed)
        return found

    def _vertices_of(self, nodes: Indices) -> tuple[Indices, Indices]:
        """Local vertices (k,) among local nodes (m,), and which of the nodes they are."""
        vertex = np.flatnonzero(np.isin(self._vertex_node, nodes))
        order = np.argsort(nodes)
        return vertex, order[np.searchsorted(nodes, self._vertex_node[vertex], sorter=order)]

    def matrix(self) -> PETSc.Mat:
        """The matrix under what is held now, always the same object."""
        near, comm, columns = self._near, self._K.comm, self._P.getSizes()[1]
        if self._matrix is None:
            self._matrix = galerkin_product(self._K, self._P)
            self._exchanged = galerkin_product(near.K, near.P) if near else None
        if self._exchanged is not None:
            add(self._matrix, -1.0, self._exchanged)
        free = self._held.all_blocks()
        part = None
        if near is not None:
            P = self._moved_near(near, free)
            part = galerkin_product(near.K, P)
            destroy(P)
            add(self._matrix, 1.0, part, last=False)
        size = self._matrix.getDiagonal().sum() / columns[1]
        rest = block_diagonal(size * (np.eye(self._block) - free), columns, comm)
        add(self._matrix, 1.0, rest, last=False)
        if part is None:
            part = rest
        else:
            add(part, 1.0, rest)
        self._exchanged = part
        self._matrix.setBlockSize(self._block)
        if self._near_null is not None:
            self._matrix.setNearNullSpace(self._near_null)
        return self._matrix

    def _moved_near(self, near: "_Near", coarse: Array) -> PETSc.Mat:
        """What linear functions, (vertices, block, block) of which are free, move near contact."""
        columns, comm = self._P.getSizes()[1], self._K.comm
        left = block_diagonal(self._fine.blocks_at(near.nodes), near.P.getSizes()[0], comm)
        right = block_diagonal(coarse, columns, comm)
        at_nodes, at_vertices = self._ties, self._moved.ties
        if at_vertices is not None:
            followed = at_vertices.followed(at_vertices.nodes, len(coarse))
            add(right, 1.0, followed.matMult(right))
            destroy(followed)
        half = left.matMult(near.P)
        P = half.matMult(right)
        if at_nodes is not None and at_vertices is not None:
            rows = np.searchsorted(near.nodes, at_nodes.nodes)
            followed = at_nodes.followed(rows, len(near.nodes), at_vertices.opposite)
            add(P, 1.0, followed.matMult(right))
            destroy(followed)
        destroy(left, right, half)
        return P


class _Interpolation:
    """Pi P Pi_c, for `PETSc.Mat.createPython`."""

    def __init__(self, P: PETSc.Mat, fine: Projection, coarse: Projection) -> None:
        self._P, self._fine, self._coarse = P, fine, coarse
        self._on_coarse, self._on_fine = P.createVecs()
        self.ties: Ties | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Values y at all nodes from x at vertices."""
        x.copy(self._on_coarse)
        self._coarse.take_out(self._on_coarse.array)
        if self.ties:
            self.ties.follow(self._on_coarse)
        self._P.mult(self._on_coarse, y)
        self._fine.take_out(y.array)

    def multAdd(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec, z: PETSc.Vec) -> None:
        """The same, added to y."""
        self.mult(_, x, self._on_fine)
        z.array[:] = y.array_r + self._on_fine.array_r

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Forces y at vertices from x at all nodes."""
        x.copy(self._on_fine)
        self._fine.take_out(self._on_fine.array)
        self._P.multTranspose(self._on_fine, y)
        if self.ties:
            self.ties.hand_on(y)
        self._coarse.take_out(y.array)


@dataclass(frozen=True)
class _Near:
    """The part of K at nodes whose interpolation may be held, and at those that they couple to.

    Args:
        nodes: (k,), local, ascending.
        K: (k block, k block).
        P: rows of the interpolation.
    """

    nodes: Indices
    K: PETSc.Mat
    P: PETSc.Mat

    @classmethod
    def of(cls, K: PETSc.Mat, P: PETSc.Mat, space: fem.FunctionSpace, held: Indices) -> "_Near":
        """Around the local nodes that are held at times."""
        index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
        owned = index_map.size_local
        fine, coarse = P.createVecLeft(), P.createVecRight()
        fine.array.reshape(-1, block)[held] = 1.0
        P.multTranspose(fine, coarse)
        P.mult(coarse, fine)  # all nodes that see a vertex which a held node sees
        touched = la.vector(index_map, 1)
        touched.array[:] = 0.0
        touched.array[:owned] = fine.array_r.reshape(-1, block).max(axis=1) > 0
        touched.array[held] = 1.0
        touched.scatter_forward()
        topology = space.mesh.topology
        cells = space.dofmap.list[: topology.index_map(topology.dim).size_local]
        around = cells[(touched.array[cells] > 0).any(axis=1)]
        touched.array[:] = 0.0
        touched.array[around] = 1.0
        touched.scatter_reverse(la.InsertMode.add)
        nodes = np.flatnonzero(touched.array[:owned]).astype(np.int64)
        numbers = (nodes + index_map.local_range[0]).astype(PETSc.IntType)
        rows = PETSc.IS().createBlock(block, numbers, comm=K.comm)
        start, last = P.getOwnershipRangeColumn()
        columns = PETSc.IS().createStride(last - start, start, 1, comm=K.comm)
        part = K.createSubMatrix(rows, rows)
        near = part
        if is_blocked(part):
            near = part.convert("aij", PETSc.Mat())
            destroy(part)
        made = cls(nodes, near, P.createSubMatrix(rows, columns))
        destroy(fine, coarse, rows, columns)
        return made
