"""Nodes that move with others where they are held, as multigrid sees them.

Where contact closes, a node of one body moves as the means O b of the other's nodes around do, in
the directions H that are held; forces are handed on by the same weights. With W = 1 + H O, which
acts on displacements b that vanish in H, W^T K W is the stiffness of both bodies in one.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

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
