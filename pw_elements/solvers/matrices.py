"""Matrix formats and products that petsc4py has not, null spaces, and what is held.

What supports or contact hold is taken out of vectors; nothing of K is changed or copied.

Nodes may also be joined to others by springs, a matrix B: then the operator has K + B for K.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem
from scipy.sparse.csgraph import connected_components

from pw_elements._compat import single_entry_matrix
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.spaces import AssemblyRecord

# Rows of a matrix in blocks (a multiple of any block) that are converted at once, to save memory,
# and the most parts in which it is done, for their sum takes time
_ROWS_AT_ONCE = 12_000
_MOST_PARTS = 32
# Rows that are factorised as dense ones at once, to save memory
_DENSE_AT_ONCE = 20_000
# Up to so many modes are handled as one dense block: sparse algebra would take longer
_FEW_MODES = 60
# Displacements and forces in a mode of unit size that are none
_ROUND_OFF = 1e-13


def is_blocked(matrix: PETSc.Mat) -> bool:
    return "baij" in matrix.getType()


def galerkin_product(K: PETSc.Mat, P: PETSc.Mat, rows: Indices | None = None) -> PETSc.Mat:
    """P^T K P; P may have rows for some of K's alone, whose global numbers (k,) on it are `rows`.

    PETSc has no product of matrices in blocks: parts of them are converted.
    """
    if not is_blocked(K) and rows is None:
        product = K.ptap(P)
        made = product.copy()
        product.destroy()  # which keeps what it was made by
        return made
    comm, own = K.comm, np.arange(*P.getOwnershipRange())
    numbers = own if rows is None else rows
    most = comm.tompi4py().allreduce(len(own), MPI.MAX)
    at_once = _ROWS_AT_ONCE * max(1, -(-most // (_ROWS_AT_ONCE * _MOST_PARTS)))
    chosen, total = index_set(numbers, comm), None
    columns = index_set(np.arange(*P.getOwnershipRangeColumn()), comm)
    for begin in range(0, most, at_once):
        part = slice(begin, begin + at_once)
        of_K, of_P = index_set(numbers[part], comm), index_set(own[part], comm)
        K_part, P_part = K.createSubMatrix(of_K, chosen), P.createSubMatrix(of_P, columns)
        plain = K_part.convert("aij", PETSc.Mat())
        destroy_objects(K_part)
        half = plain.matMult(P)
        some = P_part.transposeMatMult(half)
        if total is None:
            total = some.copy()
            destroy_objects(some)
        else:
            add_scaled(total, 1.0, some)
        destroy_objects(plain, half, P_part, of_K, of_P)
    destroy_objects(chosen, columns)
    return total


def index_set(numbers: Indices, comm: PETSc.Comm) -> PETSc.IS:
    return PETSc.IS().createGeneral(numbers.astype(PETSc.IntType), comm=comm)


def add_scaled(
    total: PETSc.Mat,
    factor: float,
    term: PETSc.Mat,
    destroy_term: bool = True,
    same_pattern: bool = False,
) -> None:
    """Adds a multiple of a matrix, destroyed at its `last` use; if `within`, the pattern stays."""
    structure = PETSc.Mat.Structure
    pattern = (
        structure.SUBSET_NONZERO_PATTERN if same_pattern else structure.DIFFERENT_NONZERO_PATTERN
    )
    total.axpy(factor, term, pattern)
    if destroy_term:
        destroy_objects(term)


def destroy_objects(*things: PETSc.Object) -> None:
    """Frees what Python alone would not on several processes, see `collect_garbage`.

    What Python objects inside of PETSc's hold is freed by neither, unless those go first by this.
    """
    for thing in things:
        thing.destroy()


def collect_garbage(like: PETSc.Object) -> None:
    """Frees objects that have gone out of use and live where this one does; collective.

    On several processes petsc4py leaves them alone until then: Python may drop them in any order.
    """
    PETSc.garbage_cleanup(like.comm)


def block_diagonal_matrix(blocks: Array, sizes: tuple[int, int], comm: PETSc.Comm) -> PETSc.Mat:
    """Matrix of blocks (nodes, b, b) along its diagonal; `sizes` local and global."""
    n, b = blocks.shape[:2]
    first = comm.tompi4py().exscan(n) or 0
    indptr = b * np.arange(n * b + 1, dtype=PETSc.IntType)
    columns = np.arange(first * b, (first + n) * b).reshape(n, 1, b).repeat(b, axis=1)
    csr = (indptr, columns.ravel().astype(PETSc.IntType), blocks.ravel())
    return PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=comm)


def selection_matrix(free: Mask, rows: PETSc.Vec, renumbered: bool = True) -> PETSc.Mat:
    """Columns of the identity of the owned rows that are free; others are left out, or zero."""
    comm = rows.comm.tompi4py()
    count = int(free.sum()) if renumbered else len(free)
    number = np.cumsum(free) - 1 if renumbered else np.arange(count)
    column = np.where(free, comm.scan(count) - count + number, -1)
    return single_entry_matrix(column, (rows.getSizes(), (count, PETSc.DETERMINE)), rows.comm)


def python_matrix(
    sizes: tuple[tuple[int, int], ...], context: object, comm: PETSc.Comm
) -> PETSc.Mat:
    matrix = PETSc.Mat().createPython(sizes, context, comm=comm)
    matrix.setUp()
    return matrix


def to_aij(matrix: PETSc.Mat) -> PETSc.Mat:
    """The matrix, or a copy of one stored in blocks, in the format that products need."""
    if not is_blocked(matrix):
        return matrix
    return AssemblyRecord.read(matrix).attach(matrix.convert("aij", PETSc.Mat()))


def qr_triangle(rows: sp.csr_array | Array, comm: MPI.Comm) -> sp.csr_array | Array:
    """R of QR factorisations of all processes' rows (n, modes): of modes that hang together.

    It is a dense one where modes are few. A Gram matrix would lose what is small.
    """
    if isinstance(rows, np.ndarray) or rows.shape[1] <= _FEW_MODES:
        return _dense_triangle(rows, comm)
    rows.data[np.abs(rows.data) < _ROUND_OFF] = 0.0
    rows.eliminate_zeros()
    rows = rows[np.diff(rows.indptr) > 0]
    count, part = connected_components(sum(comm.allgather(abs(rows).T @ abs(rows))), directed=False)
    of_row = part[rows.indices[rows.indptr[:-1]]]
    order = np.argsort(of_row, kind="stable")
    ends = np.searchsorted(of_row[order], np.arange(count + 1))
    rows, found = rows[order], []
    for k in range(count):
        modes = np.flatnonzero(part == k)
        R = _dense_triangle(rows[ends[k] : ends[k + 1]][:, modes], comm)
        places = np.repeat(np.arange(len(R)), len(modes)), np.tile(modes, len(R))
        found.append(sp.csr_array((R.ravel(), places), (len(R), rows.shape[1])))
    return sp.vstack(found, "csr")


def _dense_triangle(rows: sp.csr_array | Array, comm: MPI.Comm) -> Array:
    R = np.zeros((0, rows.shape[1]))
    for first in range(0, rows.shape[0], _DENSE_AT_ONCE):
        some = _dense(rows[first : first + _DENSE_AT_ONCE])
        R = np.asarray(np.linalg.qr(np.vstack([R, some]), mode="r"))
    return np.asarray(np.linalg.qr(np.concatenate(comm.allgather(R)), mode="r"))


def _dense(rows: sp.csr_array | Array) -> Array:
    return rows if isinstance(rows, np.ndarray) else rows.toarray()


def null_space(rows: sp.csr_array | Array, tolerance: float) -> Array:
    """Orthonormal motions (k, modes) that rows of unit size take to nothing."""
    n = rows.shape[1]
    found = [np.zeros((0, n))]
    few = n <= _FEW_MODES
    for modes in [np.arange(n)] if few else group_connected_nodes(abs(rows).T @ abs(rows)):
        own = _dense(rows if few else rows[:, modes])
        dense = np.vstack([own, np.zeros((len(modes), len(modes)))])
        _, values, vectors = np.linalg.svd(dense, full_matrices=False)
        none = vectors[values < tolerance * np.sqrt(n)]
        found.append(np.zeros((len(none), n)))
        found[-1][:, modes] = none
    return np.concatenate(found)


def group_connected_nodes(graph: npt.ArrayLike) -> list[Indices]:
    """Nodes of each connected part of a graph, given by a matrix (nodes, nodes)."""
    count, part = connected_components(graph, directed=False)
    return [np.flatnonzero(part == k) for k in range(count)]


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
    """Which degrees of freedom (owned dofs,) of a space are free, the others being prescribed."""

    space: fem.FunctionSpace
    free: Mask


class ConstraintProjection:
    """Takes the held parts out of vectors: whole unknowns, and directions at some nodes."""

    def __init__(self, free: Mask, block: int) -> None:
        self._free, self._block = free.reshape(-1, block), block
        self._prescribed: Indices = np.flatnonzero(~free)
        none = np.empty(0)
        self.constrain(none.astype(np.int64), none.reshape(0, block, block), none)

    def constrain(self, nodes: Indices, projectors: Array, stiffnesses: Array) -> None:
        """Holds directions at local nodes (m,) by projectors, with stiffness (m,); others by 1."""
        self._nodes, self._held, self._weight = nodes, projectors, stiffnesses[:, None]
        self._of_free = projectors * self._free[nodes][:, None, :]

    def remove_constrained(self, values: Array) -> None:
        """Leaves what is free of a vector (owned dofs,)."""
        values[self._prescribed] = 0.0
        if len(self._nodes):
            at = values.reshape(-1, self._block)
            at[self._nodes] -= np.einsum("nij,nj->ni", self._of_free, at[self._nodes])

    def add_constrained(self, values: Array, source: Array) -> None:
        """Adds what is held of a given vector, weighted."""
        values[self._prescribed] += source[self._prescribed]
        if len(self._nodes):
            at, to = source.reshape(-1, self._block), values.reshape(-1, self._block)
            back = np.einsum("nij,nj->ni", self._of_free, at[self._nodes])
            to[self._nodes] += self._weight * back

    def constrained_blocks(
        self, extra_nodes: Sequence[int] | Indices = ()
    ) -> tuple[Indices, Array, Array]:
        """Nodes with anything held, and `others`; projectors onto what is free; weighted rest."""
        held = np.union1d(np.flatnonzero(~self._free.all(axis=1)), self._nodes)
        some = np.union1d(held, np.asarray(extra_nodes, dtype=np.int64))
        blocks = np.eye(self._block) * self._free[some][:, None, :]
        rest = np.eye(self._block) - blocks
        at = np.searchsorted(some, self._nodes)
        blocks[at] -= self._held
        rest[at] += self._weight[:, :, None] * self._held
        return some, blocks, rest

    def free_projectors(self, nodes: Indices) -> Array:
        """Projectors onto what is free at some nodes (k,), in ascending order."""
        every = np.tile(np.eye(self._block), (len(nodes), 1, 1))
        constrained, free, _ = self.constrained_blocks()
        mine = np.isin(constrained, nodes)
        every[np.searchsorted(nodes, constrained[mine])] = free[mine]
        return every


@dataclass(eq=False)
class ConstrainedOperator:
    """Pi s (K + B) s Pi + (1 - Pi), for `PETSc.Mat.createPython`; B are springs, if there are any.

    The scales s are one where none are given.
    """

    K: PETSc.Mat
    projection: ConstraintProjection
    scales: PETSc.Vec | None = None
    springs: PETSc.Mat | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._apply("mult", x, y)

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._apply("multTranspose", x, y)

    def _apply(self, product: str, x: PETSc.Vec, y: PETSc.Vec) -> None:
        kept = self._work
        x.copy(kept)
        self.projection.remove_constrained(kept.array)
        if self.scales is not None:
            kept.array *= self.scales.array_r
        getattr(self.K, product)(kept, y)
        if self.springs is not None:
            getattr(self.springs, f"{product}Add")(kept, y, y)
        self.projection.remove_constrained(y.array)
        if self.scales is not None:
            y.array *= self.scales.array_r
        self.projection.add_constrained(y.array, x.array_r)

    @cached_property
    def _work(self) -> PETSc.Vec:
        return self.K.createVecRight()  # contact hardly needs it
