"""Sparse rows of the contact tangent, built once: none of this runs in an iteration."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def local_rows(matrix: PETSc.Mat, more: int) -> sp.csr_matrix:
    """Rows of this process, with empty columns for the free translations."""
    indptr, indices, data = matrix.getValuesCSR()
    rows = sp.csr_matrix((data, indices, indptr), (len(indptr) - 1, matrix.getSize()[1] + more))
    rows.sort_indices()
    return rows


def structure_of(rows: sp.csr_matrix, of_point: Indices, points: int) -> sp.csr_matrix:
    """Positive numbers where any row of a point has an entry, zeros among them: (points, n)."""
    ones = sp.csr_matrix((np.ones(len(rows.indices)), rows.indices, rows.indptr), rows.shape)
    gather = sp.csr_matrix(
        (np.ones(len(of_point)), (of_point, np.arange(len(of_point)))), (points, len(of_point))
    )
    return gather @ ones


def blocks_of(rows: sp.csr_matrix, pattern: sp.csr_matrix, dim: int) -> Array:
    """Values (entries, dim) of a point's dim rows in the columns of a pattern (points, n)."""
    width = np.int64(pattern.shape[1])
    point = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    keys = width * point + pattern.indices
    values = np.zeros((len(keys), dim))
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    at = np.searchsorted(keys, width * (row // dim) + rows.indices)
    values[at, row % dim] = rows.data
    return values


def with_replaced(
    rows: sp.csr_matrix,
    border: sp.csr_matrix,
    replaced: npt.NDArray[np.bool_],
    column: Indices,
    counts: Indices,
) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Arrays of a CSR matrix: some rows with other columns and no values yet, a border below."""
    number = np.diff(rows.indptr)
    kept = np.repeat(~replaced, number)
    number[replaced] = counts
    number = np.concatenate([number, np.diff(border.indptr)])
    fixed = np.repeat(np.append(~replaced, np.ones(border.shape[0], dtype=bool)), number)
    indptr = np.concatenate([[0], np.cumsum(number)]).astype(PETSc.IntType)
    indices, data = np.empty(indptr[-1], dtype=PETSc.IntType), np.zeros(indptr[-1])
    indices[fixed] = np.concatenate([rows.indices[kept], border.indices])
    indices[~fixed] = column
    data[fixed] = np.concatenate([rows.data[kept], border.data])
    return indptr, indices, data


def balance_rows(sums: sp.csr_matrix, comm: MPI.Comm) -> sp.csr_matrix:
    """Equations of the free translations, on the last process, with a diagonal of zeros.

    `sums` (free, unknowns and free) is what this process adds to them.
    """
    parts = comm.gather(sums, root=comm.size - 1)
    if parts is None:
        return sp.csr_matrix((0, sums.shape[1]))
    total = sum(parts[1:], start=parts[0]).tocoo()
    own = np.arange(sums.shape[0])
    row = np.concatenate([total.row, own])
    column = np.concatenate([total.col, sums.shape[1] - len(own) + own])
    data = np.append(total.data, np.zeros(len(own)))
    balance = sp.csr_matrix((data, (row, column)), total.shape)
    balance.sort_indices()
    return balance
