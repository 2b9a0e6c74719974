"""Matrices in formats and products that petsc4py has not, their memory, and connected pieces."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from scipy import sparse as sp
from scipy.sparse.csgraph import connected_components

from pw_elements.spaces import Assembled

Array = npt.NDArray[np.float64]

# Rows of a matrix in blocks (a multiple of any block) that are converted at once, to save memory,
# and the most parts in which it is done, for their sum takes time
_AT_ONCE, _PARTS = 12_000, 32


def is_blocked(matrix: PETSc.Mat) -> bool:
    """Whether a matrix is stored in blocks of nodes."""
    return "baij" in matrix.getType()


def galerkin_product(K: PETSc.Mat, P: PETSc.Mat) -> PETSc.Mat:
    """P^T K P; PETSc has no such product of matrices in blocks: parts of them are converted."""
    if not is_blocked(K):
        product = K.ptap(P)
        made = product.copy()
        product.destroy()  # which keeps what it was made by
        return made
    comm, first, rows = K.comm, K.getOwnershipRange()[0], K.getLocalSize()[0]
    most = comm.tompi4py().allreduce(rows, MPI.MAX)
    at_once = _AT_ONCE * max(1, -(-most // (_AT_ONCE * _PARTS)))
    sets = [
        PETSc.IS().createStride(last - start, start, 1, comm=comm)
        for start, last in (K.getOwnershipRangeColumn(), P.getOwnershipRangeColumn())
    ]
    total = None
    for begin in range(0, most, at_once):
        start, last = min(begin, rows), min(begin + at_once, rows)
        mine = PETSc.IS().createStride(last - start, first + start, 1, comm=comm)
        K_part, P_part = (
            matrix.createSubMatrix(mine, columns)
            for matrix, columns in zip((K, P), sets, strict=True)
        )
        plain = K_part.convert("aij", PETSc.Mat())
        destroy(K_part)
        half = plain.matMult(P)
        some = P_part.transposeMatMult(half)
        if total is None:
            total = some.copy()
            destroy(some)
        else:
            add(total, 1.0, some)
        destroy(plain, half, P_part, mine)
    destroy(*sets)
    return total


def add(
    total: PETSc.Mat, factor: float, some: PETSc.Mat, last: bool = True, within: bool = False
) -> None:
    """Adds a multiple of a matrix, which is destroyed then if that was its last use.

    Where its entries are `within` those of the sum, the latter keeps its pattern: that is faster.
    """
    structure = PETSc.Mat.Structure
    pattern = structure.SUBSET_NONZERO_PATTERN if within else structure.DIFFERENT_NONZERO_PATTERN
    total.axpy(factor, some, pattern)
    if last:
        destroy(some)


def destroy(*things: PETSc.Object) -> None:
    """Frees what Python alone would not on several processes, see `collect_garbage`.

    What Python objects inside of PETSc's hold is freed by neither, unless those go first by this.
    """
    for thing in things:
        thing.destroy()


def collect_garbage(*like: PETSc.Object) -> None:
    """Frees objects that have gone out of use and live where these do; collective.

    On several processes petsc4py leaves them alone until then: Python may drop them in any order.
    """
    for thing in like:
        PETSc.garbage_cleanup(thing.comm)


def block_diagonal(blocks: Array, sizes: tuple[int, int], comm: PETSc.Comm) -> PETSc.Mat:
    """Matrix of blocks (nodes, b, b) along its diagonal; `sizes` local and global."""
    n, b = blocks.shape[:2]
    first = comm.tompi4py().exscan(n) or 0
    indptr = b * np.arange(n * b + 1, dtype=PETSc.IntType)
    columns = np.arange(first * b, (first + n) * b).reshape(n, 1, b).repeat(b, axis=1)
    csr = (indptr, columns.ravel().astype(PETSc.IntType), blocks.ravel())
    return PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=comm)


def selection(free: npt.NDArray[np.bool_], rows: PETSc.Vec, renumbered: bool = True) -> PETSc.Mat:
    """Columns of the identity that belong to those of the owned rows that are free.

    Those of the others are left out, or else zero.
    """
    comm = rows.comm.tompi4py()
    count = int(free.sum()) if renumbered else len(free)
    first = comm.scan(count) - count
    indptr = np.concatenate(([0], np.cumsum(free))).astype(PETSc.IntType)
    columns = np.arange(count) if renumbered else np.flatnonzero(free)
    return PETSc.Mat().createAIJ(
        (rows.getSizes(), (count, PETSc.DETERMINE)),
        csr=(indptr, (first + columns).astype(PETSc.IntType), np.ones(len(columns))),
        comm=rows.comm,
    )


def python_matrix(
    sizes: tuple[tuple[int, int], ...], context: object, comm: PETSc.Comm
) -> PETSc.Mat:
    """Matrix whose products a Python object makes."""
    matrix = PETSc.Mat().createPython(sizes, context, comm=comm)
    matrix.setUp()
    return matrix


def unblocked(matrix: PETSc.Mat) -> PETSc.Mat:
    """The matrix, or a copy of one stored in blocks, in the format that products need."""
    if not is_blocked(matrix):
        return matrix
    return Assembled.of(matrix).mark(matrix.convert("aij", PETSc.Mat()))


def unbalanced(K: PETSc.Mat, a: PETSc.Vec, f: PETSc.Vec) -> PETSc.Vec:
    """K a - f."""
    r = f.duplicate()
    K.mult(a, r)
    r.axpy(-1.0, f)
    return r


def connected_pieces(space: fem.FunctionSpace) -> tuple[npt.NDArray[np.int64], int]:
    """Number of the connected piece of the mesh that each node (ghosts too) belongs to."""
    comm, cells = space.mesh.comm, space.dofmap.list
    index_map = space.dofmap.index_map
    local = index_map.size_local + index_map.num_ghosts
    others = cells[:, 1:]  # a cell's first node links them
    edges = (np.repeat(cells[:, 0], others.shape[1]), others.ravel())
    graph = sp.csr_matrix((np.ones(others.size, dtype=np.int8), edges), (local, local))
    count, part = connected_components(graph, directed=False)
    first = sum(comm.allgather(count)[: comm.rank])
    # parts of two processes are one piece if they share a node: the owner's number tells which
    number = la.vector(index_map, 1)
    number.array[:] = part + first
    number.scatter_forward()
    ghosts = np.arange(index_map.size_local, local)
    ends = np.stack([part[ghosts] + first, number.array[ghosts].astype(np.int64)])
    total = comm.allreduce(count, MPI.SUM)
    links = np.unique(np.concatenate(comm.allgather(ends), axis=1), axis=1)
    graph = sp.csr_matrix((np.ones(links.shape[1]), links), (total, total))
    pieces, piece = connected_components(graph, directed=False)
    return piece[part + first].astype(np.int64), int(pieces)
