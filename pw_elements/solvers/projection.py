"""What supports or contact hold, taken out of vectors; nothing of K is changed or copied.

Nodes may also move with others where they are held. Where contact closes, a node of one body moves
as the means O b of the other's nodes around do, in the directions H that are held; forces are
handed on by the same weights. With W = 1 + H O, which acts on displacements b that vanish in H,
W^T K W is the stiffness of both bodies in one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Sizes = tuple[int, int]


class Ties:
    """W and its transpose, for some nodes (k) of this process.

    Args:
        opposite: O, (points block, n), rows of other nodes' weights.
        nodes: (k,), local.
        block: unknowns of a node.
        rows: (k,), local numbers of their rows of O, in blocks; all in turn unless given.

    Attributes:
        opposite, nodes: as given.
    """

    def __init__(
        self, opposite: PETSc.Mat, nodes: Indices, block: int, rows: Indices | None = None
    ) -> None:
        self.opposite, self.nodes, self._block = opposite, nodes, block
        self._rows = np.arange(len(nodes)) if rows is None else rows
        self._around, self._mean = opposite.createVecs()
        self._held: Array = np.zeros((len(nodes), block, block))

    def hold(self, held: Array) -> None:
        """Takes over projectors (k, block, block) onto what is held."""
        self._held = held

    def follow(self, x: PETSc.Vec) -> None:
        """W x in place of x (n,)."""
        x.copy(self._around)
        self.opposite.mult(self._around, self._mean)
        mean = self._mean.array_r.reshape(-1, self._block)[self._rows]
        x.array.reshape(-1, self._block)[self.nodes] += np.einsum("nij,nj->ni", self._held, mean)

    def hand_on(self, y: PETSc.Vec) -> None:
        """W^T y in place of y (n,)."""
        force = y.array_r.reshape(-1, self._block)[self.nodes]
        self._mean.set(0.0)
        at = self._mean.array.reshape(-1, self._block)
        at[self._rows] = np.einsum("nji,nj->ni", self._held, force)
        self.opposite.multTranspose(self._mean, self._around)
        y.axpy(1.0, self._around)

    def followed(self, rows: Indices, local: int, opposite: PETSc.Mat | None = None) -> PETSc.Mat:
        """H O, (local block here, n), at local rows (k,) in blocks; O may be another one."""
        return scattered(self._held, rows, local, self._rows, opposite or self.opposite)


def scattered(
    blocks: Array, rows: Indices, local: int, columns: Indices, factor: PETSc.Mat
) -> PETSc.Mat:
    """Blocks (k, b, b) at local rows (k,) of `local` and at columns (k,), times a matrix."""
    comm: MPI.Comm = factor.comm.tompi4py()
    k, b = blocks.shape[:2]
    order = np.argsort(rows)
    number = np.zeros(local, dtype=PETSc.IntType)
    number[rows] = 1
    indptr = np.append(0, np.cumsum(np.repeat(b * number, b))).astype(PETSc.IntType)
    first = factor.getOwnershipRange()[0]
    column = first + b * columns[order, None, None] + np.arange(b)
    column = np.broadcast_to(column, (k, b, b)).ravel().astype(PETSc.IntType)
    sizes = ((local * b, PETSc.DETERMINE), factor.getSizes()[0])
    placed = PETSc.Mat().createAIJ(sizes, csr=(indptr, column, blocks[order].ravel()), comm=comm)
    product = placed.matMult(factor)
    placed.destroy()
    return product


def diagonal_blocks(matrix: PETSc.Mat, block: int) -> tuple[Indices, Array]:
    """Local numbers (k,) of the nodes with entries on the diagonal, and their blocks there."""
    indptr, column, value = matrix.getValuesCSR()
    row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    column = column - matrix.getOwnershipRange()[0]
    own = (column // block == row // block) & (column >= 0)
    row, column, value = row[own], column[own], value[own]
    nodes, at = np.unique(row // block, return_inverse=True)
    blocks = np.zeros((len(nodes), block, block))
    blocks[at, row % block, column % block] = value
    return nodes.astype(np.int64), blocks


@dataclass(frozen=True)
class Supports:
    """Which degrees of freedom of a space are free, the others being prescribed.

    Args:
        space: of the trial functions.
        free: (owned dofs,).
    """

    space: fem.FunctionSpace
    free: npt.NDArray[np.bool_]


class Projection:
    """Takes the held parts out of vectors: whole unknowns, and directions at some nodes."""

    def __init__(self, free: npt.NDArray[np.bool_], block: int) -> None:
        self._free, self._block = free.reshape(-1, block), block
        self._prescribed: Indices = np.flatnonzero(~free)
        none = np.empty(0)
        self.hold(none.astype(np.int64), none.reshape(0, block, block), none)

    def hold(self, nodes: Indices, held: Array, weight: Array) -> None:
        """Holds at local nodes (m,) what the projectors (m, block, block) leave of a vector.

        They get the stiffness `weight` (m,), prescribed unknowns 1.
        """
        self._nodes, self._held, self._weight = nodes, held, weight[:, None]
        self._of_free = held * self._free[nodes][:, None, :]

    def take_out(self, values: Array) -> None:
        """Leaves what is free of a vector (owned dofs,)."""
        values[self._prescribed] = 0.0
        if len(self._nodes):
            at = values.reshape(-1, self._block)
            at[self._nodes] -= np.einsum("nij,nj->ni", self._of_free, at[self._nodes])

    def put_back(self, values: Array, given: Array) -> None:
        """Adds what is held of a given vector, weighted."""
        values[self._prescribed] += given[self._prescribed]
        if len(self._nodes):
            at, to = given.reshape(-1, self._block), values.reshape(-1, self._block)
            back = np.einsum("nij,nj->ni", self._of_free, at[self._nodes])
            to[self._nodes] += self._weight * back

    def blocks(self, others: Sequence[int] | Indices = ()) -> tuple[Indices, Array, Array]:
        """Nodes with anything held, projectors (k, block, block) onto what is free, and the rest.

        The latter is weighted; `others` are nodes that are wanted, too.
        """
        held = np.union1d(np.flatnonzero(~self._free.all(axis=1)), self._nodes)
        some = np.union1d(held, np.asarray(others, dtype=np.int64))
        blocks = np.eye(self._block) * self._free[some][:, None, :]
        rest = np.eye(self._block) - blocks
        at = np.searchsorted(some, self._nodes)
        blocks[at] -= self._held
        rest[at] += self._weight[:, :, None] * self._held
        return some, blocks, rest

    def all_blocks(self) -> Array:
        """The projectors (nodes, block, block) onto what is free."""
        return self.blocks_at(np.arange(len(self._free)))

    def blocks_at(self, some: Indices) -> Array:
        """The same at some nodes (k,), in ascending order."""
        every = np.tile(np.eye(self._block), (len(some), 1, 1))
        nodes, free, _ = self.blocks()
        mine = np.isin(nodes, some)
        every[np.searchsorted(some, nodes[mine])] = free[mine]
        return every


class Masked:
    """Pi s W^T K W s Pi + (1 - Pi), for `PETSc.Mat.createPython`.

    W is one without ties, and so are the scales s where none are given.
    """

    def __init__(
        self, K: PETSc.Mat, projection: Projection, scale: PETSc.Vec | None = None
    ) -> None:
        self._K, self._projection, self._scale = K, projection, scale
        self.ties: Ties | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x."""
        self._K.mult(self._kept(x), y)
        self._finish(x, y)

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Image y of x under the transposed matrix."""
        self._K.multTranspose(self._kept(x), y)
        self._finish(x, y)

    def _kept(self, x: PETSc.Vec) -> PETSc.Vec:
        kept = self._work
        x.copy(kept)
        self._projection.take_out(kept.array)
        if self._scale is not None:
            kept.array *= self._scale.array_r
        if self.ties:
            self.ties.follow(kept)
        return kept

    def _finish(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        if self.ties:
            self.ties.hand_on(y)
        self._projection.take_out(y.array)
        if self._scale is not None:
            y.array *= self._scale.array_r
        self._projection.put_back(y.array, x.array_r)

    @cached_property
    def _work(self) -> PETSc.Vec:
        return self._K.createVecRight()  # contact hardly needs it
