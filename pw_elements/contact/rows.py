"""The equations of the contact nodes, in a nonzero pattern that serves all active sets."""

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class ContactRows:
    """Rows E K + C of a matrix, E and C being block-diagonal over the contact nodes.

    Args:
        K: owned rows of the stiffness, columns numbered globally, sorted; the columns of the
            free translations come last and are empty.
        row: (n, dim), local row of each displacement component; -1 where it is prescribed.
        column: (n, dim), its global column; -1 where it is prescribed.
        translations: (n, dim), column of the free translation of each node's surface; -1
            where it is prescribed.
    """

    def __init__(
        self, K: sp.csr_matrix, row: Indices, column: Indices, translations: Indices
    ) -> None:
        self._columns = K.shape[1]
        n, dim = row.shape
        pattern = self._pattern(K, row, [column, translations])
        self._node = np.repeat(np.arange(n), np.diff(pattern.indptr))
        self._column = pattern.indices
        keys = self._key(self._node, self._column)
        node = np.arange(n)[:, None]
        self._own = np.where(column >= 0, np.searchsorted(keys, self._key(node, column)), -1)
        self._translation = np.where(
            translations >= 0, np.searchsorted(keys, self._key(node, translations)), -1
        )
        self._block = np.stack([self._values_of(K, row[:, axis]) for axis in range(dim)], axis=1)

        # entries of all rows, row by row
        entry, axis = np.nonzero(row[self._node] >= 0)
        self.row = row[self._node[entry], axis]
        order = np.argsort(self.row, kind="stable")
        self.row, self._order = self.row[order], (entry[order], axis[order])
        self.column = self._column[entry[order]]

    def values(self, E: Array, C: Array, D: Array) -> Array:
        """Entries at (`row`, `column`).

        Args:
            E: (n, dim, dim), combines a node's equations.
            C: (n, dim, dim), combines its displacements.
            D: (n, dim, dim), combines the translations of its surface; subtracted.
        """
        values = np.einsum("eab,eb->ea", E[self._node], self._block)
        for entries, parts in ((self._own, C), (self._translation, -D)):
            for axis, at in enumerate(entries.T):
                values[at[at >= 0]] += parts[at >= 0, :, axis]
        return values[self._order]

    def compressed(self, first: int) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
        """Row pointers, columns and global row numbers, for `first` the first local row's."""
        rows, counts = np.unique(self.row, return_counts=True)
        pointers = np.concatenate([[0], np.cumsum(counts)])
        parts = (pointers, self.column, first + rows)
        return tuple(part.astype(PETSc.IntType) for part in parts)  # type: ignore[return-value]

    def _pattern(self, K: sp.csr_matrix, row: Indices, more: Sequence[Indices]) -> sp.csr_matrix:
        """Columns (n, columns) that any row of a node has, and those of its displacements."""
        n = len(row)
        pattern = sp.csr_matrix((n, self._columns))
        for axis in range(row.shape[1]):
            rows = K[np.maximum(row[:, axis], 0)]
            rows.data = np.repeat((row[:, axis] >= 0).astype(float), np.diff(rows.indptr))
            pattern = pattern + rows
        for columns in more:
            pattern = pattern + _ones(columns, self._columns)
        pattern.sort_indices()
        return pattern

    def _values_of(self, K: sp.csr_matrix, row: Indices) -> Array:
        """Stiffness (entries,) in a row (n,) of each node, zero where K has no such entry."""
        rows = K[np.maximum(row, 0)]
        keys = self._key(np.repeat(np.arange(len(row)), np.diff(rows.indptr)), rows.indices)
        wanted = self._key(self._node, self._column)
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        there = (row[self._node] >= 0) & (keys[at] == wanted)
        return np.where(there, rows.data[at], 0.0)

    def _key(self, row: npt.NDArray, column: npt.NDArray) -> Indices:
        return np.int64(self._columns) * row + column


def _ones(columns: Indices, width: int) -> sp.csr_matrix:
    """Ones at (i, columns[i, :]), but for negative columns."""
    i, j = np.nonzero(columns >= 0)
    return sp.csr_matrix((np.ones(len(i)), (i, columns[i, j])), shape=(len(columns), width))
