"""The linear system of an active set as an assembled matrix, solved by factors.

A few rows that differ from those of the last factorisation are corrected without a new one. The
module guarantees one nonzero pattern for all active sets, and assumes that each equation holds the
force of one component of one point.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, LocalIndices
from pw_elements.contact.nodes import LinearisedLaw
from pw_elements.contact.system.solution import Accuracy, TangentSolution
from pw_elements.solvers import LinearSolver

# Pointers, columns and values of this process' rows, for PETSc
CsrArrays: TypeAlias = tuple[npt.NDArray, npt.NDArray, Array]
# Relative tolerance below which a matrix row counts as unchanged
_ROW_CHANGE_TOLERANCE = 1e-12


class PointRows:
    """Rows E L K + C G - D of the contact points, whose entries are linear in E, C and D.

    The sparsity pattern is fixed: each row of a point has all columns of its equations and motions.
    L K is (m dim, n), G (m p, n) with p motions a point; `borders` (m k, n) are ones where a free
    translation, one of k of each surface, moves a point; `own` (m, dim) are local numbers of the
    rows in the matrix, -1 where there is none.
    """

    def __init__(
        self, forces: sp.csr_matrix, motion: sp.csr_matrix, borders: sp.csr_matrix, own: Indices
    ) -> None:
        self.own, (m, dim), n = own, own.shape, np.int64(forces.shape[1])
        parts = [part.tocoo() for part in (forces, motion, -borders)]
        widths = [dim, motion.shape[0] // max(m, 1), borders.shape[0] // max(m, 1)]
        before, width = np.cumsum([0, *widths[:2]]), sum(widths)
        point, across = (
            np.concatenate(each)
            for each in zip(
                *(np.divmod(p.row, w) for p, w in zip(parts, widths, strict=True)), strict=True
            )
        )
        across = across + np.repeat(before, [part.nnz for part in parts])
        column = np.concatenate([part.col for part in parts])
        value = np.concatenate([part.data for part in parts])
        # entries of points, in order, and which of them each number of the parts belongs to
        entries, entry = np.unique(point * n + column, return_inverse=True)
        count, first = _runs(entries // n, m)
        flat = np.flatnonzero(own.ravel() >= 0)
        flat = flat[np.argsort(own.ravel()[flat])]
        self.row, (at, axis) = own.ravel()[flat], np.divmod(flat, dim)
        self.pointers = np.concatenate([[0], np.cumsum(count[at])])
        self.column = (entries % n)[_spans(first[at], count[at])]
        # and what each of them takes of E, C and D
        order = np.argsort(point, kind="stable")
        given, begin = _runs(point, m)
        taken, times = order[_spans(begin[at], given[at])], given[at]
        row = np.repeat(self.pointers[:-1] - first[at], times) + entry[taken]
        place = width * (np.repeat(axis, times) + dim * point[taken]) + across[taken]
        shape = (len(self.column), m * dim * width)
        self._of_law = sp.csr_matrix((value[taken], (row, place)), shape)

    def values(self, combinations: Array) -> Array:
        """Values of all entries for E, C and D of each point, side by side: (m, dim, ...)."""
        return np.asarray(self._of_law @ combinations.ravel())

    def place(self, first: int) -> list[npt.NDArray]:
        """Pointers, columns and rows for PETSc, in a matrix whose first row here has a number."""
        parts = self.pointers, self.column, first + self.row
        return [part.astype(PETSc.IntType) for part in parts]


def _runs(of: Indices, most: int) -> tuple[Indices, Indices]:
    """Number of times that 0 to `most` - 1 occur, and where each begins if they are in order."""
    count = np.bincount(of, minlength=most)
    return count, np.cumsum(count) - count


def _spans(first: Indices, count: Indices) -> Indices:
    """Whole numbers from each first on, as many as are counted, one span after the other."""
    shift = first - (np.cumsum(count) - count)
    return np.repeat(shift, count) + np.arange(count.sum())


def local_rows(matrix: PETSc.Mat, more: int) -> sp.csr_matrix:
    """Rows of this process, with more columns, which are empty, for free translations."""
    indptr, indices, data = matrix.getValuesCSR()
    rows = sp.csr_matrix((data, indices, indptr), (len(indptr) - 1, matrix.getSize()[1] + more))
    rows.sort_indices()
    return rows


def with_points(rows: sp.csr_matrix, points: PointRows, border: sp.csr_matrix) -> CsrArrays:
    """CSR of this process' `rows`, those of the points being replaced by zeros, a border below."""
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
    return indptr, indices, data


def border_columns(free: Sequence[tuple[int, int]], pair: LocalIndices, each: int) -> sp.csr_matrix:
    """(m each, free translations): ones where one, among each surface's, moves a point."""
    row = [np.flatnonzero(pair == number) * each + axis for number, axis in free]
    rows = np.concatenate([np.empty(0, dtype=np.int64), *row])
    column = np.repeat(np.arange(len(free)), [len(r) for r in row])
    return sp.csr_matrix((np.ones(len(rows)), (rows, column)), (len(pair) * each, len(free)))


def balance_rows(sums: sp.coo_matrix, springs: Array, comm: MPI.Comm) -> sp.csr_matrix:
    """Equations of free translations, on the last process; `sums` are this process' own part.

    Each translation has a spring besides.
    """
    parts = comm.gather((sums.row, sums.col, sums.data), root=comm.size - 1)
    if parts is None:
        return sp.csr_matrix((0, sums.shape[1]))
    own = np.arange(sums.shape[0])
    parts.append((own, sums.shape[1] - len(own) + own, springs))
    # zeros stay: sums have one pattern
    row, column, data = (np.concatenate(each) for each in zip(*parts, strict=True))
    balance = sp.csr_matrix((data, (row, column)), sums.shape)
    balance.sort_indices()
    return balance


def read_and_spread(force: PETSc.Mat, equation: Indices) -> tuple[Array, PETSc.Mat | None]:
    """Inverse of H at the points' own equations (m, dim), and -H^T elsewhere, if there is."""
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


def own_entries(matrix: sp.csr_matrix, equation: Indices) -> Array:
    """Entries (m, dim) of a matrix (m dim, n) at each point's own unknowns; 1 where it has none."""
    own = equation.ravel()
    rows = np.flatnonzero(own >= 0)
    values = np.ones(len(own))
    values[rows] = np.asarray(matrix[rows, own[rows]]).ravel()
    return values.reshape(equation.shape)


class AssembledTangent:
    """A `ContactTangent` with an assembled matrix and its factors."""

    solves_exactly = True

    def __init__(
        self,
        matrix: PETSc.Mat,
        points: PointRows,
        first: int,
        borders: int,
        solver: LinearSolver,
        enclosed: Callable[[], bool],
    ) -> None:
        self._comm: MPI.Comm = matrix.comm.tompi4py()
        self.matrix, self._points, self._borders = matrix, points, borders
        self._first, self._place = first, points.place(first)
        self._solver, self.solver = solver, solver.prepare(matrix)
        self.encloses = enclosed
        self._factorised: Array | None = None
        self._springs: Array | None = None  # of the free motions, besides those of the matrix

    def start(self, unknowns: Callable[[], Array], free_motions: Array) -> None:
        """Ignore the initial iterate, which direct solvers do not need."""

    def set_springs(self, springs: Array) -> None:
        if self._springs is None and not springs.any():
            return  # the matrix has zeros
        before = np.zeros_like(springs) if self._springs is None else self._springs
        if np.array_equal(before, springs):
            return
        self.matrix.assemble()  # rows were inserted, springs are added
        first = self.matrix.getSize()[0] - len(springs)
        for k in range(len(springs) if self._borders else 0):
            value = springs[k] - before[k]
            self.matrix.setValue(first + k, first + k, value, PETSc.InsertMode.ADD_VALUES)
        self.matrix.assemble()
        self._springs, self._factorised = springs.copy(), None

    def determinant_signs(self) -> tuple[int, ...]:
        return ()

    def release(self) -> None:
        """Do nothing: factors go with the last reference."""

    def renew(self, rows: Callable[[], tuple[PointRows, CsrArrays]], pattern_changed: bool) -> None:
        (self._points, csr), self._factorised = rows(), None
        self._springs = None
        if not pattern_changed:
            self.matrix.setValuesCSR(*csr)
            return
        self._place = self._points.place(self._first)
        self.matrix = PETSc.Mat().createAIJ(self.matrix.getSizes(), csr=csr, comm=self._comm)
        take = getattr(self.solver, "set_matrix", None)
        if take is None:
            raise ValueError(
                "two bodies at large sliding need a solver whose factors follow another pattern, "
                "such as Direct()"
            )
        take(self.matrix)

    def solve(
        self, right: Array, balance: Array, law: LinearisedLaw, accuracy: Accuracy
    ) -> TangentSolution:
        coefficients, known = self._assemble_law(law), self._assemble_right(right, balance)
        if accuracy == "tightened":
            self._factorised = None
        solution = self._solve_by_correction(known, coefficients)
        if solution is not None:
            return TangentSolution(np.asarray(solution.array_r), is_exact=False, is_final=True)
        solution = self.solver.solve(known)
        self._factorised = coefficients
        return TangentSolution(np.asarray(solution.array_r), is_exact=True, is_final=True)

    def solve_transposed(self, right: Array, balance: Array, law: LinearisedLaw) -> Array:
        """Solve with the transposed matrix and return all weights of this process' equations."""
        self.set_springs(np.zeros_like(balance))
        self._assemble_law(law)
        solver = self._solver.prepare(self.matrix.transpose(PETSc.Mat()))
        weights = np.array(solver.solve(self._assemble_right(right, balance)).array_r)
        solver.release()
        return weights

    def _assemble_law(self, law: LinearisedLaw) -> Array:
        """Write the law into the matrix; return E, C and D side by side, (m, dim, ...)."""
        coefficients = np.concatenate([law.E, law.C, law.D], axis=2)
        pointers, columns, rows = self._place
        values = self._points.values(coefficients)
        self.matrix.setValuesIJV(pointers, columns, values, rowmap=rows)
        self.matrix.assemble()
        return coefficients

    def _assemble_right(self, right: Array, balance: Array) -> PETSc.Vec:
        known = self.matrix.createVecRight()
        known.setArray(np.append(right, balance[: self._borders]))
        return known

    def _solve_by_correction(self, right: PETSc.Vec, coefficients: Array) -> PETSc.Vec | None:
        """Return the solution by the last factors with a few rows corrected, None if too many."""
        if self._factorised is None:  # no process differs in this
            return None
        size = np.abs(self._factorised).max(axis=(0, 1), keepdims=True, initial=0.0)
        change = np.abs(coefficients - self._factorised) > _ROW_CHANGE_TOLERANCE * size
        rows = self._points.own[change.any(axis=2)]
        return self.solver.solve_with_changed_rows(right, self._first + rows[rows >= 0])
