"""Matrix formats and products that petsc4py lacks, null spaces, and constraints without assembly.

Supports and contact constrain directions at nodes. A projection removes these from vectors; K is
neither changed nor copied. Springs that join nodes are a matrix B: the operator then has K + B in
place of K.
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

# Rows of a blocked matrix (a multiple of any block size) that are converted at once, to save
# memory, and the largest number of such parts, whose products have to be added
_CONVERTED_ROWS = 12_000
_MAX_CONVERSIONS = 32
# Rows of a dense QR factorisation, to save memory
_DENSE_QR_ROWS = 20_000
# Largest number of modes for dense algebra, which is faster there than sparse algebra
_MAX_DENSE_MODES = 60
# Displacements and forces, in a mode of unit size, that are round-off
_MODE_ROUND_OFF = 1e-13


def is_blocked(matrix: PETSc.Mat) -> bool:
    return "baij" in matrix.getType()


def galerkin_product(K: PETSc.Mat, P: PETSc.Mat, rows: Indices | None = None) -> PETSc.Mat:
    """Compute P^T K P.

    PETSc has no product of blocked matrices: they are converted part by part.

    Args:
        K: (n, n), blocked or not.
        P: (n, m), or (k, m) with the rows `rows` only.
        rows: (k,), global numbers in K of this process' rows of P.
    """
    if not is_blocked(K) and rows is None:
        product = K.ptap(P)
        result = product.copy()
        product.destroy()  # it keeps its factors alive, the copy does not
        return result
    comm, P_rows = K.comm, np.arange(*P.getOwnershipRange())
    K_rows = P_rows if rows is None else rows
    n_rows = comm.tompi4py().allreduce(len(P_rows), MPI.MAX)
    step = _CONVERTED_ROWS * max(1, -(-n_rows // (_CONVERTED_ROWS * _MAX_CONVERSIONS)))
    K_columns, total = index_set(K_rows, comm), None
    P_columns = index_set(np.arange(*P.getOwnershipRangeColumn()), comm)
    for begin in range(0, n_rows, step):
        part = slice(begin, begin + step)
        K_set, P_set = index_set(K_rows[part], comm), index_set(P_rows[part], comm)
        K_part, P_part = K.createSubMatrix(K_set, K_columns), P.createSubMatrix(P_set, P_columns)
        aij = K_part.convert("aij", PETSc.Mat())
        destroy_objects(K_part)
        K_P = aij.matMult(P)
        term = P_part.transposeMatMult(K_P)
        if total is None:
            total = term.copy()
            destroy_objects(term)
        else:
            add_scaled(total, 1.0, term)
        destroy_objects(aij, K_P, P_part, K_set, P_set)
    destroy_objects(K_columns, P_columns)
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
    """Add factor times a matrix to `total`, in place.

    Args:
        total: sum.
        factor: of the term.
        term: matrix to add.
        destroy_term: destroy the term afterwards.
        same_pattern: whether `total` has all entries of the term.
    """
    structure = PETSc.Mat.Structure
    pattern = (
        structure.SUBSET_NONZERO_PATTERN if same_pattern else structure.DIFFERENT_NONZERO_PATTERN
    )
    total.axpy(factor, term, pattern)
    if destroy_term:
        destroy_objects(term)


def destroy_objects(*objects: PETSc.Object) -> None:
    """Destroy PETSc objects, which Python alone does not free on several processes.

    A PETSc object keeps the Python object inside it, and all that this refers to, until it is
    destroyed here; `collect_garbage` does not reach them.
    """
    for petsc_object in objects:
        petsc_object.destroy()


def collect_garbage(like: PETSc.Object) -> None:
    """Free unused PETSc objects of the communicator of `like`; collective.

    On several processes petsc4py defers their destruction, as Python may drop them in any order.
    """
    PETSc.garbage_cleanup(like.comm)


def block_diagonal_matrix(blocks: Array, sizes: tuple[int, int], comm: PETSc.Comm) -> PETSc.Mat:
    """Assemble a matrix of blocks (nodes, b, b) on its diagonal; `sizes` are local and global."""
    n, b = blocks.shape[:2]
    offset = comm.tompi4py().exscan(n) or 0
    indptr = b * np.arange(n * b + 1, dtype=PETSc.IntType)
    columns = np.arange(offset * b, (offset + n) * b).reshape(n, 1, b).repeat(b, axis=1)
    csr = (indptr, columns.ravel().astype(PETSc.IntType), blocks.ravel())
    return PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=comm)


def selection_matrix(free: Mask, rows: PETSc.Vec, renumbered: bool = True) -> PETSc.Mat:
    """Return the columns of the identity that belong to free rows.

    Args:
        free: (owned rows,).
        rows: vector with the layout of the rows.
        renumbered: leave out the columns of other rows; otherwise they are zero.
    """
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
    """Return the matrix, or a copy in PETSc's AIJ format if it is blocked, for products."""
    if not is_blocked(matrix):
        return matrix
    return AssemblyRecord.read(matrix).attach(matrix.convert("aij", PETSc.Mat()))


def qr_triangle(rows: sp.csr_array | Array, comm: MPI.Comm) -> sp.csr_array | Array:
    """Return R of a QR factorisation of all processes' rows (n, modes).

    Many modes are factorised by groups that share rows. The Gram matrix R^T R would lose small
    entries.
    """
    if isinstance(rows, np.ndarray) or rows.shape[1] <= _MAX_DENSE_MODES:
        return _dense_qr_triangle(rows, comm)
    rows.data[np.abs(rows.data) < _MODE_ROUND_OFF] = 0.0
    rows.eliminate_zeros()
    rows = rows[np.diff(rows.indptr) > 0]
    count, group = connected_components(
        sum(comm.allgather(abs(rows).T @ abs(rows))), directed=False
    )
    group_of_row = group[rows.indices[rows.indptr[:-1]]]
    order = np.argsort(group_of_row, kind="stable")
    ends = np.searchsorted(group_of_row[order], np.arange(count + 1))
    rows, triangles = rows[order], []
    for k in range(count):
        modes = np.flatnonzero(group == k)
        R = _dense_qr_triangle(rows[ends[k] : ends[k + 1]][:, modes], comm)
        indices = np.repeat(np.arange(len(R)), len(modes)), np.tile(modes, len(R))
        triangles.append(sp.csr_array((R.ravel(), indices), (len(R), rows.shape[1])))
    return sp.vstack(triangles, "csr")


def _dense_qr_triangle(rows: sp.csr_array | Array, comm: MPI.Comm) -> Array:
    R = np.zeros((0, rows.shape[1]))
    for begin in range(0, rows.shape[0], _DENSE_QR_ROWS):
        dense = _to_dense(rows[begin : begin + _DENSE_QR_ROWS])
        R = np.asarray(np.linalg.qr(np.vstack([R, dense]), mode="r"))
    return np.asarray(np.linalg.qr(np.concatenate(comm.allgather(R)), mode="r"))


def _to_dense(rows: sp.csr_array | Array) -> Array:
    return rows if isinstance(rows, np.ndarray) else rows.toarray()


def null_space(rows: sp.csr_array | Array, tolerance: float) -> Array:
    """Return an orthonormal basis (k, modes) of the null space of rows (n, modes) of unit size."""
    n = rows.shape[1]
    bases = [np.zeros((0, n))]
    is_dense = n <= _MAX_DENSE_MODES
    for modes in [np.arange(n)] if is_dense else group_connected_nodes(abs(rows).T @ abs(rows)):
        columns = _to_dense(rows if is_dense else rows[:, modes])
        padded = np.vstack([columns, np.zeros((len(modes), len(modes)))])
        _, values, vectors = np.linalg.svd(padded, full_matrices=False)
        null_vectors = vectors[values < tolerance * np.sqrt(n)]
        basis = np.zeros((len(null_vectors), n))
        basis[:, modes] = null_vectors
        bases.append(basis)
    return np.concatenate(bases)


def group_connected_nodes(graph: npt.ArrayLike) -> list[Indices]:
    """Return the nodes of each connected component of a graph, a matrix (nodes, nodes)."""
    count, component = connected_components(graph, directed=False)
    return [np.flatnonzero(component == k) for k in range(count)]


def diagonal_blocks(matrix: PETSc.Mat, block: int) -> tuple[Indices, Array]:
    """Return local numbers (k,) of the nodes with diagonal blocks, and these (k, block, block)."""
    indptr, column, value = matrix.getValuesCSR()
    row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    column = column - matrix.getOwnershipRange()[0]
    is_diagonal = (column // block == row // block) & (column >= 0)
    row, column, value = row[is_diagonal], column[is_diagonal], value[is_diagonal]
    nodes, index = np.unique(row // block, return_inverse=True)
    blocks = np.zeros((len(nodes), block, block))
    blocks[index, row % block, column % block] = value
    return nodes.astype(np.int64), blocks


@dataclass(frozen=True)
class Supports:
    """Mask of the free degrees of freedom (owned dofs,) of a space; all others are prescribed."""

    space: fem.FunctionSpace
    free: Mask


class ConstraintProjection:
    """Removes constrained parts from vectors: whole unknowns, and directions at some nodes."""

    def __init__(self, free: Mask, block: int) -> None:
        self._free, self._block = free.reshape(-1, block), block
        self._prescribed: Indices = np.flatnonzero(~free)
        empty = np.empty(0)
        self.constrain(empty.astype(np.int64), empty.reshape(0, block, block), empty)

    def constrain(self, nodes: Indices, projectors: Array, stiffnesses: Array) -> None:
        """Constrain directions at nodes, besides prescribed unknowns, whose stiffness is one.

        Args:
            nodes: (m,), local numbers.
            projectors: (m, block, block), onto the constrained directions.
            stiffnesses: (m,), of the constrained directions.
        """
        self._nodes, self._projectors, self._stiffnesses = nodes, projectors, stiffnesses[:, None]
        self._free_part = projectors * self._free[nodes][:, None, :]  # of unknowns not prescribed

    def remove_constrained(self, values: Array) -> None:
        """Set the constrained part of a vector (owned dofs,) to zero, in place."""
        values[self._prescribed] = 0.0
        if len(self._nodes):
            vectors = values.reshape(-1, self._block)
            vectors[self._nodes] -= np.einsum("nij,nj->ni", self._free_part, vectors[self._nodes])

    def add_constrained(self, values: Array, source: Array) -> None:
        """Add to a vector the constrained part of `source`, times its stiffness, in place."""
        values[self._prescribed] += source[self._prescribed]
        if len(self._nodes):
            sources, vectors = source.reshape(-1, self._block), values.reshape(-1, self._block)
            constrained = np.einsum("nij,nj->ni", self._free_part, sources[self._nodes])
            vectors[self._nodes] += self._stiffnesses * constrained

    def constrained_blocks(
        self, extra_nodes: Sequence[int] | Indices = ()
    ) -> tuple[Indices, Array, Array]:
        """Return the nodes (k,) with a constraint, and `extra_nodes`, with two blocks for each.

        Returns:
            The nodes, in ascending order; projectors (k, block, block) onto free directions; and
            projectors onto constrained ones times their stiffness.
        """
        constrained = np.union1d(np.flatnonzero(~self._free.all(axis=1)), self._nodes)
        nodes = np.union1d(constrained, np.asarray(extra_nodes, dtype=np.int64))
        free = np.eye(self._block) * self._free[nodes][:, None, :]
        weighted = np.eye(self._block) - free
        index = np.searchsorted(nodes, self._nodes)
        free[index] -= self._projectors
        weighted[index] += self._stiffnesses[:, :, None] * self._projectors
        return nodes, free, weighted

    def free_projectors(self, nodes: Indices) -> Array:
        """Return projectors (k, block, block) onto free directions at nodes (k,), ascending."""
        projectors = np.tile(np.eye(self._block), (len(nodes), 1, 1))
        constrained, free, _ = self.constrained_blocks()
        is_asked = np.isin(constrained, nodes)
        projectors[np.searchsorted(nodes, constrained[is_asked])] = free[is_asked]
        return projectors


@dataclass(eq=False)
class ConstrainedOperator:
    """Operator Pi s (K + B) s Pi + (1 - Pi), for `PETSc.Mat.createPython`.

    Pi is the projection, s the scales (1 if there are none) and B the springs, if there are any.
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
        projected = self._work
        x.copy(projected)
        self.projection.remove_constrained(projected.array)
        if self.scales is not None:
            projected.array *= self.scales.array_r
        getattr(self.K, product)(projected, y)
        if self.springs is not None:
            getattr(self.springs, f"{product}Add")(projected, y, y)
        self.projection.remove_constrained(y.array)
        if self.scales is not None:
            y.array *= self.scales.array_r
        self.projection.add_constrained(y.array, x.array_r)

    @cached_property
    def _work(self) -> PETSc.Vec:
        return self.K.createVecRight()  # created on first use, as contact hardly needs it
