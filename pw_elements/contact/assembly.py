"""Sparse rows of the contact tangent, built once: none of this runs in an iteration."""

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PointRows:
    """Rows of the contact points, whose entries are linear in what combines their equations.

    Entry e is the sum over k of combination[k][point[e]] times parts[k][e], a column of dim
    numbers of which `taken` are in the matrix.

    Args:
        point: (entries,), number of the contact point.
        parts: (entries, dim) each.
        taken: (values,) entry and component of each value, in the order of the matrix.
        pointers: (rows + 1,), where the values of each row begin.
        column: (values,).
        row: (rows,), local number in the matrix.
    """

    point: Indices
    parts: list[Array]
    taken: tuple[Indices, Indices]
    pointers: Indices
    column: Indices
    row: Indices

    @classmethod
    def of(
        cls, forces: sp.csr_matrix, motion: sp.csr_matrix, borders: sp.csr_matrix, own: Indices
    ) -> "PointRows":
        """Rows `own` (m, dim) of a matrix, -1 for none, of E L K + C G - D, as `Tangent` has them.

        The columns of D are the last ones.
        """
        m, dim = own.shape
        moved = borders.T.tocsr()
        last = moved.indices + forces.shape[1] - borders.shape[0]
        parts = forces, motion, -sp.csr_matrix((moved.data, last, moved.indptr), forces.shape)
        pattern = sum(_structure(part, np.repeat(np.arange(m), dim), m) for part in parts)
        pattern.sort_indices()
        point = np.repeat(np.arange(m), np.diff(pattern.indptr))
        entry, axis = np.nonzero(own[point] >= 0)
        row = own[point[entry], axis]
        order = np.argsort(row, kind="stable")
        entry, axis = entry[order], axis[order]
        rows, counts = np.unique(row, return_counts=True)
        return cls(
            point,
            [_blocks(part, pattern, dim) for part in parts],
            (entry, axis),
            np.concatenate([[0], np.cumsum(counts)]),
            pattern.indices[entry],
            rows,
        )

    def place(self, first: int) -> list[npt.NDArray]:
        """Pointers, columns and rows for PETSc, in a matrix whose first row here has a number."""
        parts = self.pointers, self.column, first + self.row
        return [part.astype(PETSc.IntType) for part in parts]


def tangent_rows(
    stiffness: PETSc.Mat,
    force: PETSc.Mat,
    flexible: Array,
    spread: PETSc.Mat | None,
    equation: Indices,
    more: int,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Rows of K' and of L K on this process, with empty columns for the free translations."""
    forces = reading(force, flexible, equation).matMult(stiffness)
    fixed = stiffness
    if spread is not None:
        fixed = spread.transposeMatMult(forces)
        fixed.axpy(1.0, stiffness, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return local_rows(fixed, more), local_rows(forces, more)


def local_rows(matrix: PETSc.Mat, more: int) -> sp.csr_matrix:
    """Rows of this process, with empty columns for the free translations."""
    indptr, indices, data = matrix.getValuesCSR()
    rows = sp.csr_matrix((data, indices, indptr), (len(indptr) - 1, matrix.getSize()[1] + more))
    rows.sort_indices()
    return rows


def _structure(rows: sp.csr_matrix, of_point: Indices, points: int) -> sp.csr_matrix:
    """Positive numbers where any row of a point has an entry, zeros among them: (points, n)."""
    ones = sp.csr_matrix((np.ones(len(rows.indices)), rows.indices, rows.indptr), rows.shape)
    gather = sp.csr_matrix(
        (np.ones(len(of_point)), (of_point, np.arange(len(of_point)))), (points, len(of_point))
    )
    return gather @ ones


def _blocks(rows: sp.csr_matrix, pattern: sp.csr_matrix, dim: int) -> Array:
    """Values (entries, dim) of a point's dim rows in the columns of a pattern (points, n)."""
    width = np.int64(pattern.shape[1])
    point = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    keys = width * point + pattern.indices
    values = np.zeros((len(keys), dim))
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    at = np.searchsorted(keys, width * (row // dim) + rows.indices)
    values[at, row % dim] = rows.data
    return values


def with_points(
    rows: sp.csr_matrix, points: PointRows, border: sp.csr_matrix, comm: MPI.Comm
) -> PETSc.Mat:
    """Square matrix: `rows` of this process with those of the points replaced, a border below."""
    replaced = np.zeros(rows.shape[0], dtype=bool)
    replaced[points.row] = True
    number = np.diff(rows.indptr)
    kept = np.repeat(~replaced, number)
    number[replaced] = np.diff(points.pointers)
    number = np.concatenate([number, np.diff(border.indptr)])
    fixed = np.repeat(np.append(~replaced, np.ones(border.shape[0], dtype=bool)), number)
    indptr = np.concatenate([[0], np.cumsum(number)]).astype(PETSc.IntType)
    indices, data = np.empty(indptr[-1], dtype=PETSc.IntType), np.zeros(indptr[-1])
    indices[fixed] = np.concatenate([rows.indices[kept], border.indices])
    indices[~fixed] = points.column
    data[fixed] = np.concatenate([rows.data[kept], border.data])
    sizes = (len(indptr) - 1, rows.shape[1])
    return PETSc.Mat().createAIJ((sizes, sizes), csr=(indptr, indices, data), comm=comm)


def border_columns(
    free: Sequence[tuple[int, int]], pair: npt.NDArray[np.int32], dim: int
) -> sp.csr_matrix:
    """(free translations, m dim): ones at the components of the points that each one moves."""
    column = [np.flatnonzero(pair == number) * dim + axis for number, axis in free]
    indptr = np.concatenate([[0], np.cumsum([len(c) for c in column])]).astype(np.int64)
    columns = np.concatenate([np.empty(0, dtype=np.int64), *column])
    return sp.csr_matrix((np.ones(len(columns)), columns, indptr), (len(free), len(pair) * dim))


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


def read_and_spread(force: PETSc.Mat, equation: Indices) -> tuple[Array, PETSc.Mat | None]:
    """Inverse of H at the points' own equations (m, dim), and -H^T elsewhere, if there is.

    Args:
        force: H^T reduced, (points dim, equations).
        equation: (m, dim), number of each point's own equations, -1 where there is none.
    """
    indptr, column, value = force.getValuesCSR()
    value = value.copy()
    of_entry = np.repeat(equation.ravel(), np.diff(indptr))
    own = column == of_entry
    diagonal = np.ones(len(indptr) - 1)
    diagonal[np.repeat(np.arange(len(diagonal)), np.diff(indptr))[own]] = value[own]
    value[own | (of_entry < 0)] = 0.0
    flexible = 1 / diagonal.reshape(equation.shape)
    if not force.comm.tompi4py().allreduce(int(np.any(value != 0)), MPI.MAX):
        return flexible, None
    csr = (indptr, column, -value)
    return flexible, PETSc.Mat().createAIJ(force.getSizes(), csr=csr, comm=force.comm)


def reading(force: PETSc.Mat, flexible: Array, equation: Indices) -> PETSc.Mat:
    """L, (points dim, equations), of the arguments and the first result of `read_and_spread`."""
    numbers = equation.ravel()
    stated = numbers >= 0
    indptr = np.concatenate([[0], np.cumsum(stated)]).astype(PETSc.IntType)
    csr = (indptr, numbers[stated].astype(PETSc.IntType), flexible.ravel()[stated])
    return PETSc.Mat().createAIJ(force.getSizes(), csr=csr, comm=force.comm)


def own_entries(matrix: sp.csr_matrix, equation: Indices) -> Array:
    """Entries (m, dim) of a matrix (m dim, n) at each point's own unknowns; 1 where it has none."""
    own = equation.ravel()
    rows = np.flatnonzero(own >= 0)
    values = np.ones(len(own))
    values[rows] = np.asarray(matrix[rows, own[rows]]).ravel()
    return values.reshape(equation.shape)


def stated_mean(values: Array, stated: npt.NDArray[np.bool_]) -> Array:
    """Mean (m,) of values (m, dim) where the law is stated; 1 where it is not at all."""
    count, total = np.sum(stated, axis=1), np.sum(values * stated, axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), 1.0)
