"""Matrix formats and products that petsc4py lacks, null spaces, and constraints without assembly.

Supports and contact constrain directions at nodes. A projection removes the constrained components
from vectors; the stiffness K is neither changed nor copied. Springs between nodes form a matrix B,
and K + B then replaces K in the operator.
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

from pw_elements._compat import matrix_with_single_entry_rows
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.spaces import read_record

# A blocked matrix is converted in parts, to save memory: smallest number of rows of a part, a
# multiple of any block size; and largest number of parts, since their products have to be added
_MIN_ROWS_PER_AIJ_CONVERSION = 12_000
_MAX_AIJ_CONVERSIONS_PER_PRODUCT = 32
# Largest number of rows that are added to a dense QR factorisation at once, to save memory
_MAX_ROWS_PER_DENSE_QR = 20_000
# Largest number of modes for which dense algebra is used, where it is faster than sparse algebra
_MAX_DENSE_MODES = 60
# Displacements and forces in a mode of unit size are regarded as round-off if they are smaller
_ENTRY_ROUND_OFF_OVER_MODE_SIZE = 1e-13


def is_stored_in_blocks(matrix: PETSc.Mat) -> bool:
    return "baij" in matrix.getType()


def galerkin_product(K: PETSc.Mat, P: PETSc.Mat, rows_in_K: Indices | None = None) -> PETSc.Mat:
    """Return the product P^T K P (m, m).

    PETSc does not have this product for blocked matrices, which are therefore converted in parts.

    Args:
        K: matrix (n, n), blocked or not.
        P: matrix (n, m); if `rows_in_K` is given, only some of its rows, as a matrix (k, m).
        rows_in_K: global row numbers in K that correspond to this process' rows of P.
    """
    if not is_stored_in_blocks(K) and rows_in_K is None:
        product = K.ptap(P)
        result = product.copy()
        product.destroy()  # it keeps its factors alive; its copy does not
        return result
    comm, P_rows = K.comm, np.arange(*P.getOwnershipRange())
    K_rows = P_rows if rows_in_K is None else rows_in_K
    n_rows = comm.tompi4py().allreduce(len(P_rows), MPI.MAX)
    step = _MIN_ROWS_PER_AIJ_CONVERSION * max(
        1, -(-n_rows // (_MIN_ROWS_PER_AIJ_CONVERSION * _MAX_AIJ_CONVERSIONS_PER_PRODUCT))
    )
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
    """Add a multiple of a matrix to `total`, in place.

    Args:
        total: matrix that is changed.
        factor: factor of the term.
        term: matrix to add.
        destroy_term: whether to destroy the term afterwards.
        same_pattern: whether the sparsity pattern of `total` contains that of the term.
    """
    structure = PETSc.Mat.Structure
    pattern = (
        structure.SUBSET_NONZERO_PATTERN if same_pattern else structure.DIFFERENT_NONZERO_PATTERN
    )
    total.axpy(factor, term, pattern)
    if destroy_term:
        destroy_objects(term)


def destroy_objects(*objects: PETSc.Object) -> None:
    """Destroy PETSc objects, which Python by itself does not free in parallel runs.

    A PETSc object may contain a Python object. It keeps this object, and everything that the object
    refers to, in memory until it is destroyed here; `collect_garbage` does not free them.
    """
    for petsc_object in objects:
        petsc_object.destroy()


def collect_garbage(object_of_communicator: PETSc.Object) -> None:
    """Free unused PETSc objects of a communicator; collective.

    In parallel runs, petsc4py defers the destruction of unused objects, since Python may delete
    them in a different order on each process.

    Args:
        object_of_communicator: any object of the communicator.
    """
    PETSc.garbage_cleanup(object_of_communicator.comm)


def block_diagonal_matrix(
    blocks: Array,
    row_sizes: tuple[int, int],
    comm: PETSc.Comm,
    column_sizes: tuple[int, int] | None = None,
) -> PETSc.Mat:
    """Return a block-diagonal matrix.

    Args:
        blocks: blocks (nodes, b, c) on the diagonal at this process' nodes.
        row_sizes: local and global number of rows.
        comm: communicator of the matrix.
        column_sizes: local and global number of columns; by default that of the rows.
    """
    n, b, c = blocks.shape
    offset = comm.tompi4py().exscan(n) or 0
    indptr = c * np.arange(n * b + 1, dtype=PETSc.IntType)
    columns = np.arange(offset * c, (offset + n) * c).reshape(n, 1, c).repeat(b, axis=1)
    csr = (indptr, columns.ravel().astype(PETSc.IntType), blocks.ravel())
    return PETSc.Mat().createAIJ((row_sizes, column_sizes or row_sizes), csr=csr, comm=comm)


def identity_with_free_columns(
    free: Mask, row_layout: PETSc.Vec, drop_other_columns: bool = True
) -> PETSc.Mat:
    """Return the columns of the identity matrix that belong to free rows.

    Args:
        free: mask (owned rows,) of the free rows.
        row_layout: vector with the parallel layout of the rows.
        drop_other_columns: whether the columns of other rows are left out; if not, they are zero.
    """
    comm = row_layout.comm.tompi4py()
    count = int(free.sum()) if drop_other_columns else len(free)
    number = np.cumsum(free) - 1 if drop_other_columns else np.arange(count)
    column = np.where(free, comm.scan(count) - count + number, -1)
    return matrix_with_single_entry_rows(
        column, (row_layout.getSizes(), (count, PETSc.DETERMINE)), row_layout.comm
    )


def matrix_from_python_context(
    sizes: tuple[tuple[int, int], ...], context: object, comm: PETSc.Comm
) -> PETSc.Mat:
    matrix = PETSc.Mat().createPython(sizes, context, comm=comm)
    matrix.setUp()
    return matrix


def to_aij(matrix: PETSc.Mat) -> PETSc.Mat:
    """Return a matrix in PETSc's AIJ format, for which PETSc has more products.

    The matrix itself is returned unless it is blocked.
    """
    if not is_stored_in_blocks(matrix):
        return matrix
    return read_record(matrix).attach(matrix.convert("aij", PETSc.Mat()))


def qr_triangle(rows: sp.csr_array | Array, comm: MPI.Comm) -> sp.csr_array | Array:
    """Return the triangular matrix R of a QR factorisation of the rows of all processes.

    Collective. If there are many modes, they are split into groups that share no rows, and each
    group is factorised separately. R preserves small entries, which the product of the transposed
    rows with the rows would lose.

    Args:
        rows: rows (n, modes) of this process.
        comm: communicator of the processes.
    """
    if isinstance(rows, np.ndarray) or rows.shape[1] <= _MAX_DENSE_MODES:
        return _dense_qr_triangle(rows, comm)
    rows.data[np.abs(rows.data) < _ENTRY_ROUND_OFF_OVER_MODE_SIZE] = 0.0
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
    for begin in range(0, rows.shape[0], _MAX_ROWS_PER_DENSE_QR):
        dense = _to_dense(rows[begin : begin + _MAX_ROWS_PER_DENSE_QR])
        R = np.asarray(np.linalg.qr(np.vstack([R, dense]), mode="r"))
    if comm.size == 1:
        return R
    return np.asarray(np.linalg.qr(np.concatenate(comm.allgather(R)), mode="r"))


def _to_dense(rows: sp.csr_array | Array) -> Array:
    return rows if isinstance(rows, np.ndarray) else rows.toarray()


def null_space_basis(
    parts: Sequence[sp.csr_array | Array], singular_value_tolerance: float
) -> Array:
    """Return an orthonormal basis (k, modes) of the common null space of several matrices.

    Args:
        parts: matrices (n, modes), all dense or all sparse, whose entries are of the order of one.
        singular_value_tolerance: limit below which a singular value is regarded as zero, divided by
            the square root of the number of modes.
    """
    are_dense = isinstance(parts[0], np.ndarray)
    rows = np.vstack(parts) if are_dense else sp.vstack(parts, "csr")
    n = rows.shape[1]
    bases = [np.zeros((0, n))]
    is_dense = n <= _MAX_DENSE_MODES
    for modes in [np.arange(n)] if is_dense else group_connected_nodes(abs(rows).T @ abs(rows)):
        columns = _to_dense(rows if is_dense else rows[:, modes])
        padded = np.vstack([columns, np.zeros((len(modes), len(modes)))])
        _, values, vectors = np.linalg.svd(padded, full_matrices=False)
        null_vectors = vectors[values < singular_value_tolerance * np.sqrt(n)]
        basis = np.zeros((len(null_vectors), n))
        basis[:, modes] = null_vectors
        bases.append(basis)
    return np.concatenate(bases)


def group_connected_nodes(adjacency_matrix: npt.ArrayLike) -> list[Indices]:
    """Return the node numbers of each connected component of a graph.

    Args:
        adjacency_matrix: adjacency matrix (nodes, nodes).
    """
    count, component = connected_components(adjacency_matrix, directed=False)
    return [np.flatnonzero(component == k) for k in range(count)]


def diagonal_blocks(matrix: PETSc.Mat, block_size: int) -> tuple[Indices, Array]:
    """Return the nodes at which a matrix has diagonal blocks, and these blocks.

    Args:
        matrix: square matrix.
        block_size: number of unknowns of a node.

    Returns:
        Local numbers (k,) of the nodes, and the blocks (k, block_size, block_size).
    """
    indptr, column, value = matrix.getValuesCSR()
    row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    column = column - matrix.getOwnershipRange()[0]
    is_diagonal = (column // block_size == row // block_size) & (column >= 0)
    row, column, value = row[is_diagonal], column[is_diagonal], value[is_diagonal]
    nodes, index = np.unique(row // block_size, return_inverse=True)
    blocks = np.zeros((len(nodes), block_size, block_size))
    blocks[index, row % block_size, column % block_size] = value
    return nodes.astype(np.int64), blocks


@dataclass(frozen=True)
class Supports:
    """Supports of a space; they prescribe all degrees of freedom that are not free.

    Args:
        space: trial space.
        free: mask (owned dofs,) of the free degrees of freedom.
    """

    space: fem.FunctionSpace
    free: Mask


class StiffnessWithAddedMatrix:
    """Sum K + S of a stiffness and another matrix, as the Python context of a PETSc matrix.

    Args:
        K: stiffness (n, n).

    Attributes:
        added: matrix S (n, n), which may be replaced by one with another sparsity pattern; None
            for zero.
    """

    def __init__(self, K: PETSc.Mat) -> None:
        self._K = K
        self.added: PETSc.Mat | None = None

    def mult(self, _: PETSc.Mat | None, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._K.mult(x, y)
        if self.added is not None:
            self.added.multAdd(x, y, y)

    def multTranspose(self, _: PETSc.Mat | None, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._K.multTranspose(x, y)
        if self.added is not None:
            self.added.multTransposeAdd(x, y, y)


class ConstraintProjection:
    """Projection that removes constrained components from vectors.

    Prescribed unknowns are always constrained. In addition, `set_constrained_directions` constrains
    directions at some nodes. Each constrained direction has a stiffness, which is one for
    prescribed unknowns, and by which `add_constrained_components_times_stiffness` multiplies.

    Args:
        free: mask (owned dofs,) of the unknowns that are not prescribed.
        block: number of unknowns of a node.
    """

    def __init__(self, free: Mask, block: int) -> None:
        self._free, self._block = free.reshape(-1, block), block
        self._prescribed: Indices = np.flatnonzero(~free)
        empty = np.empty(0)
        self.set_constrained_directions(
            empty.astype(np.int64), empty.reshape(0, block, block), empty
        )

    def set_constrained_directions(
        self, nodes: Indices, projectors: Array, stiffnesses: Array
    ) -> None:
        """Constrain directions at nodes, in addition to the prescribed unknowns.

        The directions of an earlier call are replaced.

        Args:
            nodes: local numbers (m,) of the nodes.
            projectors: projectors (m, block, block) onto the constrained directions.
            stiffnesses: stiffnesses (m,) of the constrained directions.
        """
        self._nodes, self._projectors, self._stiffnesses = nodes, projectors, stiffnesses[:, None]
        self._free_part = projectors * self._free[nodes][:, None, :]  # without prescribed unknowns

    def zero_constrained_components(self, values: Array) -> None:
        """Set the constrained components of a vector (owned dofs,) to zero, in place."""
        values[self._prescribed] = 0.0
        if len(self._nodes):
            vectors = values.reshape(-1, self._block)
            vectors[self._nodes] -= np.einsum("nij,nj->ni", self._free_part, vectors[self._nodes])

    def add_constrained_components_times_stiffness(self, values: Array, source: Array) -> None:
        """Add the constrained components of `source`, times their stiffnesses, to a vector.

        Args:
            values: vector (owned dofs,) that is changed in place.
            source: vector (owned dofs,) whose constrained components are added.
        """
        values[self._prescribed] += source[self._prescribed]
        if len(self._nodes):
            sources, vectors = source.reshape(-1, self._block), values.reshape(-1, self._block)
            constrained = np.einsum("nij,nj->ni", self._free_part, sources[self._nodes])
            vectors[self._nodes] += self._stiffnesses * constrained

    def constrained_nodes_free_projectors_and_stiffness(
        self, extra_nodes: Sequence[int] | Indices = ()
    ) -> tuple[Indices, Array, Array]:
        """Return all nodes with a constraint, and projectors at these nodes.

        Args:
            extra_nodes: local numbers of further nodes to include.

        Returns:
            The local numbers (k,) of the nodes in ascending order; the projectors
            (k, block, block) onto the free directions; and the projectors (k, block, block) onto
            the constrained directions, times the stiffness of these directions.
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
        """Return projectors (k, block, block) onto the free directions at nodes.

        Args:
            nodes: local numbers (k,) of the nodes in ascending order.
        """
        projectors = np.tile(np.eye(self._block), (len(nodes), 1, 1))
        constrained, free, _ = self.constrained_nodes_free_projectors_and_stiffness()
        is_asked = np.isin(constrained, nodes)
        projectors[np.searchsorted(nodes, constrained[is_asked])] = free[is_asked]
        return projectors


@dataclass(eq=False)
class ConstrainedOperator:
    """Operator Pi s (K + B) s Pi + (1 - Pi), as the Python context of a PETSc matrix.

    Args:
        K: matrix (n, n) without supports.
        projection: projection Pi that removes constrained components. In constrained directions
            whose stiffness is not one, this stiffness replaces 1 - Pi.
        scales: diagonal (n,) of the scaling s; None for no scaling.
        springs: matrix B (n, n) of springs between nodes; None for no springs.
    """

    K: PETSc.Mat
    projection: ConstraintProjection
    scales: PETSc.Vec | None = None
    springs: PETSc.Mat | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._multiply_constrained("mult", x, y)

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._multiply_constrained("multTranspose", x, y)

    def _multiply_constrained(self, method_name: str, x: PETSc.Vec, y: PETSc.Vec) -> None:
        projected = self._work_vector
        x.copy(projected)
        self.projection.zero_constrained_components(projected.array)
        if self.scales is not None:
            projected.array *= self.scales.array_r
        getattr(self.K, method_name)(projected, y)
        if self.springs is not None:
            getattr(self.springs, f"{method_name}Add")(projected, y, y)
        self.projection.zero_constrained_components(y.array)
        if self.scales is not None:
            y.array *= self.scales.array_r
        self.projection.add_constrained_components_times_stiffness(y.array, x.array_r)

    @cached_property
    def _work_vector(self) -> PETSc.Vec:
        return self.K.createVecRight()  # created on first use, since contact rarely needs it
