"""The linear system of an active set as an assembled matrix, solved by factorisation.

If only a few rows have changed since the last factorisation, the solution is corrected and the
factors are kept. The module guarantees the same sparsity pattern for all active sets. It assumes
that each equation contains the force of at most one component of one contact point.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, LocalIndices
from pw_elements.contact.nodes import LinearisedContactLaw
from pw_elements.contact.system.solution import LinearSolveAccuracy, LocalTangentSolution
from pw_elements.solvers import LinearSolver

# Row pointers, columns and values of this process' rows in PETSc's compressed row format
CsrArrays: TypeAlias = tuple[npt.NDArray, npt.NDArray, Array]
# Largest relative change at which a matrix row counts as unchanged
_RELATIVE_ROW_CHANGE_TOLERANCE = 1e-12


class ContactLawRows:
    """Matrix rows of the contact points, in which the linearised law replaces equilibrium.

    The rows are E F + C G - D B. The matrices F, G and B give the forces of the points, the motions
    of the points and the motions of the surfaces as functions of the unknowns. E, C and D are their
    coefficients in the law. The sparsity pattern is fixed: the rows of a point contain all columns
    on which its forces and motions depend.

    Args:
        forces: matrix F (m dim, n).
        motion: motion operator G (m p, n), with p motions per point.
        borders: matrix B (m k, n) with k rows per point, one for each motion of its surface. The
            row of a free motion has an entry of one, all other rows are zero.
        equations: local row numbers (m, dim) of the points in the matrix, -1 for components without
            an equation.

    Attributes:
        rows: local numbers of the rows, ascending.
        pointers, columns: pattern of the rows in compressed row format.
        entries_by_law: matrix that maps the coefficients E, C and D (m, dim, ...), side by side, to
            the values of all entries of the rows.
    """

    def __init__(
        self,
        forces: sp.csr_matrix,
        motion: sp.csr_matrix,
        borders: sp.csr_matrix,
        equations: Indices,
    ) -> None:
        self.equations, (m, dim), n = equations, equations.shape, np.int64(forces.shape[1])
        operators = [matrix.tocoo() for matrix in (forces, motion, -borders)]
        widths = [dim, motion.shape[0] // max(m, 1), borders.shape[0] // max(m, 1)]
        offsets, width = np.cumsum([0, *widths[:2]]), sum(widths)
        point, coefficient_column = (
            np.concatenate(indices)
            for indices in zip(
                *(np.divmod(p.row, w) for p, w in zip(operators, widths, strict=True)), strict=True
            )
        )
        coefficient_column = coefficient_column + np.repeat(offsets, [p.nnz for p in operators])
        column = np.concatenate([p.col for p in operators])
        value = np.concatenate([p.data for p in operators])
        # sorted (point, column) keys of the entries, and the number of the entry to which each
        # value of the operators belongs
        entries, entry = np.unique(point * n + column, return_inverse=True)
        n_entries, first_entry = _group_sizes_and_starts(entries // n, m)
        flat = np.flatnonzero(equations.ravel() >= 0)
        flat = flat[np.argsort(equations.ravel()[flat])]
        self.rows, (row_point, axis) = equations.ravel()[flat], np.divmod(flat, dim)
        self.pointers = np.concatenate([[0], np.cumsum(n_entries[row_point])])
        self.columns = (entries % n)[
            _concatenate_ranges(first_entry[row_point], n_entries[row_point])
        ]
        # linear map from E, C and D of all points to the values of the entries
        order = np.argsort(point, kind="stable")
        n_values, first_value = _group_sizes_and_starts(point, m)
        repeats = n_values[row_point]
        selected = order[_concatenate_ranges(first_value[row_point], repeats)]
        shift = self.pointers[:-1] - first_entry[row_point]
        row = np.repeat(shift, repeats) + entry[selected]
        coefficient = (
            width * (np.repeat(axis, repeats) + dim * point[selected])
            + coefficient_column[selected]
        )
        shape = (len(self.columns), m * dim * width)
        self.entries_by_law = sp.csr_matrix((value[selected], (row, coefficient)), shape)

    def petsc_sparsity_pattern(self, first_row: int) -> list[npt.NDArray]:
        """Return row pointers, columns and row numbers in PETSc's compressed row format.

        `first_row` is the global number of this process' first row.
        """
        indices = self.pointers, self.columns, first_row + self.rows
        return [index.astype(PETSc.IntType) for index in indices]


def _group_sizes_and_starts(labels: Indices, n_groups: int) -> tuple[Indices, Indices]:
    """Return the size of each group of equal labels, and its start in the sorted labels.

    The labels are 0 to `n_groups` - 1.
    """
    count = np.bincount(labels, minlength=n_groups)
    return count, np.cumsum(count) - count


def _concatenate_ranges(starts: Indices, lengths: Indices) -> Indices:
    """Return the integers of all ranges [start, start + length) in one array."""
    shifts = starts - (np.cumsum(lengths) - lengths)
    return np.repeat(shifts, lengths) + np.arange(lengths.sum())


def extract_local_rows(matrix: PETSc.Mat, n_extra_columns: int) -> sp.csr_matrix:
    """Return this process' rows of a matrix, with empty columns appended for free motions."""
    indptr, indices, data = matrix.getValuesCSR()
    rows = sp.csr_matrix(
        (data, indices, indptr), (len(indptr) - 1, matrix.getSize()[1] + n_extra_columns)
    )
    rows.sort_indices()
    return rows


def replace_contact_rows_and_append_balance_rows(
    stiffness_rows: sp.csr_matrix, contact_rows: ContactLawRows, balance_rows: sp.csr_matrix
) -> CsrArrays:
    """Return the stiffness with the contact points' rows replaced and force balances appended.

    Only the sparsity pattern of the contact points' rows is inserted. Their entries are zero until
    the law is known.

    Args:
        stiffness_rows: rows of the stiffness on this process.
        contact_rows: rows of the contact points, which replace rows of the stiffness.
        balance_rows: force balances of the free motions, which are appended.
    """
    replaced = np.zeros(stiffness_rows.shape[0], dtype=bool)
    replaced[contact_rows.rows] = True
    row_sizes = np.diff(stiffness_rows.indptr)
    is_kept = np.repeat(~replaced, row_sizes)
    row_sizes[replaced] = np.diff(contact_rows.pointers)
    row_sizes = np.concatenate([row_sizes, np.diff(balance_rows.indptr)])
    is_unchanged = np.repeat(
        np.append(~replaced, np.ones(balance_rows.shape[0], dtype=bool)), row_sizes
    )
    indptr = np.concatenate([[0], np.cumsum(row_sizes)]).astype(PETSc.IntType)
    indices, data = np.empty(indptr[-1], dtype=PETSc.IntType), np.zeros(indptr[-1])
    indices[is_unchanged] = np.concatenate([stiffness_rows.indices[is_kept], balance_rows.indices])
    indices[~is_unchanged] = contact_rows.columns
    data[is_unchanged] = np.concatenate([stiffness_rows.data[is_kept], balance_rows.data])
    return indptr, indices, data


def make_map_from_free_motions_to_points(
    free_motions: Sequence[tuple[int, int]],
    pair_of_point: LocalIndices,
    n_motions_per_surface: int,
    n_empty_columns: int = 0,
) -> sp.csr_matrix:
    """Return a matrix of ones and zeros that maps free motions to motions at the points.

    Args:
        free_motions: pair index and component index of each free motion.
        pair_of_point: pair index (m,) of each point.
        n_motions_per_surface: number of motions of each surface.
        n_empty_columns: number of empty columns before those of the free motions.

    Returns:
        Matrix (m n_motions_per_surface, n_empty_columns + free), with ones where a free motion
        moves a point.
    """
    rows_by_motion = [
        np.flatnonzero(pair_of_point == number) * n_motions_per_surface + axis
        for number, axis in free_motions
    ]
    rows = np.concatenate([np.empty(0, dtype=np.int64), *rows_by_motion])
    motion_number = np.repeat(np.arange(len(free_motions)), [len(r) for r in rows_by_motion])
    return sp.csr_matrix(
        (np.ones(len(rows)), (rows, n_empty_columns + motion_number)),
        (len(pair_of_point) * n_motions_per_surface, n_empty_columns + len(free_motions)),
    )


def gather_balance_rows_on_last_rank(
    local_contributions: sp.coo_matrix, springs: Array, comm: MPI.Comm
) -> sp.csr_matrix:
    """Return the force-balance rows of the free motions on the last process; collective.

    The result has no rows on all other processes.

    Args:
        local_contributions: contributions (free, n) of this process' contact points.
        springs: stiffness (free,) of the spring of each free motion.
        comm: communicator of the matrix.
    """
    parts = comm.gather(
        (local_contributions.row, local_contributions.col, local_contributions.data),
        root=comm.size - 1,
    )
    if parts is None:
        return sp.csr_matrix((0, local_contributions.shape[1]))
    motion_number = np.arange(local_contributions.shape[0])
    parts.append(
        (motion_number, local_contributions.shape[1] - len(motion_number) + motion_number, springs)
    )
    # explicit zeros are kept, because the pattern must not depend on values
    row, column, data = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    balance = sp.csr_matrix((data, (row, column)), local_contributions.shape)
    balance.sort_indices()
    return balance


def split_force_operator_at_own_equations(
    transposed_force_operator: PETSc.Mat, own_equation: Indices
) -> tuple[Array, PETSc.Mat | None]:
    """Split a force operator into the entries at the points' own equations and all other entries.

    Args:
        transposed_force_operator: transposed force operator (m dim, n), which distributes contact
            forces to equations.
        own_equation: global number (m, dim) of the own equation of each force component, -1 for a
            component without an equation.

    Returns:
        Inverses (m, dim) of the entries at the own equations; and a matrix (m dim, n) of the other
        entries with opposite sign, or None if they are zero on all processes.
    """
    indptr, column, value = transposed_force_operator.getValuesCSR()
    value = value.copy()
    equation_of_entry = np.repeat(own_equation.ravel(), np.diff(indptr))
    is_own_equation = column == equation_of_entry
    diagonal = np.ones(len(indptr) - 1)
    diagonal[np.repeat(np.arange(len(diagonal)), np.diff(indptr))[is_own_equation]] = value[
        is_own_equation
    ]
    value[is_own_equation | (equation_of_entry < 0)] = 0.0
    force_factor = 1 / diagonal.reshape(own_equation.shape)
    if not transposed_force_operator.comm.tompi4py().allreduce(int(np.any(value != 0)), MPI.MAX):
        return force_factor, None
    csr = (indptr, column, -value)
    return force_factor, PETSc.Mat().createAIJ(
        transposed_force_operator.getSizes(), csr=csr, comm=transposed_force_operator.comm
    )


def extract_entries_at_own_equations(matrix: sp.csr_matrix, own_equation: Indices) -> Array:
    """Return the entries of a matrix (m dim, n) at the contact points' own equations.

    Args:
        matrix: matrix with one row per component of each contact point.
        own_equation: column (m, dim) of each component's own equation, -1 for a component without
            an equation.

    Returns:
        Entries (m, dim), which are 1 for components without an equation.
    """
    point_equations = own_equation.ravel()
    rows = np.flatnonzero(point_equations >= 0)
    values = np.ones(len(point_equations))
    values[rows] = np.asarray(matrix[rows, point_equations[rows]]).ravel()
    return values.reshape(own_equation.shape)


class AssembledTangent:
    """Assembled matrix of the contact system with its factors.

    Args:
        matrix: matrix of the contact system, with the pattern of all active sets.
        contact_rows: rows of the contact points.
        first_row: global number of this process' first row.
        n_borders: number of rows on this process that are force balances of free motions.
        solver: solver of the linear systems.
        is_constant_pressure_held_by_contact_only: function that returns whether a constant pressure
            in an incompressible body acts on the contact points alone.
    """

    solves_exactly = True

    def __init__(
        self,
        matrix: PETSc.Mat,
        contact_rows: ContactLawRows,
        first_row: int,
        n_borders: int,
        solver: LinearSolver,
        is_constant_pressure_held_by_contact_only: Callable[[], bool],
    ) -> None:
        self._comm: MPI.Comm = matrix.comm.tompi4py()
        self.matrix, self._points, self._n_borders = matrix, contact_rows, n_borders
        self._first_row, self._row_pattern = (
            first_row,
            contact_rows.petsc_sparsity_pattern(first_row),
        )
        self._solver, self.solver = solver, solver.prepare(matrix)
        self.is_constant_pressure_held_by_contact_only = is_constant_pressure_held_by_contact_only
        self._factorised: Array | None = None
        # stiffness of free motions that is added to the springs in the matrix
        self._springs: Array | None = None

    def set_initial_iterate(self, get_unknowns: Callable[[], Array], free_motions: Array) -> None:
        """Do nothing, because direct solvers do not need an initial iterate."""

    def set_free_motion_springs(self, springs: Array) -> None:
        if self._springs is None and not springs.any():
            return  # the matrix has no springs from support friction
        previous = np.zeros_like(springs) if self._springs is None else self._springs
        if np.array_equal(previous, springs):
            return
        self.matrix.assemble()  # PETSc cannot mix inserted and added values
        first_spring_row = self.matrix.getSize()[0] - len(springs)
        for k in range(len(springs) if self._n_borders else 0):
            change = springs[k] - previous[k]
            self.matrix.setValue(
                first_spring_row + k, first_spring_row + k, change, PETSc.InsertMode.ADD_VALUES
            )
        self.matrix.assemble()
        self._springs, self._factorised = springs.copy(), None

    def estimate_determinant_signs(self) -> tuple[int, ...]:
        return ()

    def release(self) -> None:
        """Do nothing, because the factors are freed with the last reference to them."""

    def update_stiffness(
        self, assemble_rows: Callable[[], tuple[ContactLawRows, CsrArrays]], pattern_changed: bool
    ) -> None:
        (self._points, csr), self._factorised = assemble_rows(), None
        self._springs = None
        if not pattern_changed:
            self.matrix.setValuesCSR(*csr)
            return
        self._row_pattern = self._points.petsc_sparsity_pattern(self._first_row)
        self.matrix = PETSc.Mat().createAIJ(self.matrix.getSizes(), csr=csr, comm=self._comm)
        set_matrix = getattr(self.solver, "set_matrix", None)
        if set_matrix is None:
            raise ValueError(
                "two bodies at large sliding change the sparsity pattern of the matrix, which this "
                "solver does not support: use Direct()"
            )
        set_matrix(self.matrix)

    def solve(
        self,
        rhs: Array,
        balance_rhs: Array,
        law: LinearisedContactLaw,
        accuracy: LinearSolveAccuracy,
    ) -> LocalTangentSolution:
        coefficients, combined_rhs = (
            self._write_law_into_matrix(law),
            self._combine_right_hand_sides(rhs, balance_rhs),
        )
        if accuracy == "tightened":
            self._factorised = None
        solution = self._solve_by_correcting_last_factors(combined_rhs, coefficients)
        if solution is not None:
            return LocalTangentSolution(np.asarray(solution.array_r), is_exact=False, is_final=True)
        solution = self.solver.solve(combined_rhs)
        self._factorised = coefficients
        return LocalTangentSolution(np.asarray(solution.array_r), is_exact=True, is_final=True)

    def solve_transposed(self, rhs: Array, balance_rhs: Array, law: LinearisedContactLaw) -> Array:
        """Return this process' part of the solution of the transposed system.

        Args:
            rhs: right-hand side (n,) of this process.
            balance_rhs: right-hand side (free,) of the force balances of free motions.
            law: linearised law.
        """
        self.set_free_motion_springs(np.zeros_like(balance_rhs))
        self._write_law_into_matrix(law)
        solver = self._solver.prepare(self.matrix.transpose(PETSc.Mat()))
        weights = np.array(solver.solve(self._combine_right_hand_sides(rhs, balance_rhs)).array_r)
        solver.release()
        return weights

    def _write_law_into_matrix(self, law: LinearisedContactLaw) -> Array:
        """Write the contact rows into the matrix; return the coefficients of the law.

        The coefficients (m, dim, ...) are the law's matrices E, C and D, side by side.
        """
        coefficients = np.concatenate([law.E, law.C, law.D], axis=2)
        pointers, columns, rows = self._row_pattern
        values = self._points.entries_by_law @ coefficients.ravel()
        self.matrix.setValuesIJV(pointers, columns, values, rowmap=rows)
        self.matrix.assemble()
        return coefficients

    def _combine_right_hand_sides(self, rhs: Array, balance_rhs: Array) -> PETSc.Vec:
        combined_rhs = self.matrix.createVecRight()
        combined_rhs.setArray(np.append(rhs, balance_rhs[: self._n_borders]))
        return combined_rhs

    def _solve_by_correcting_last_factors(
        self, rhs: PETSc.Vec, law_coefficients: Array
    ) -> PETSc.Vec | None:
        """Solve with the last factors, corrected for the rows that have changed since.

        Args:
            rhs: right-hand side of the whole system.
            law_coefficients: coefficients (m, dim, ...) of the law.

        Returns:
            The solution, or None if a new factorisation is needed.
        """
        if self._factorised is None:  # equal on all processes
            return None
        scale = np.abs(self._factorised).max(axis=(0, 1), keepdims=True, initial=0.0)
        has_changed = (
            np.abs(law_coefficients - self._factorised) > _RELATIVE_ROW_CHANGE_TOLERANCE * scale
        )
        rows = self._points.equations[has_changed.any(axis=2)]
        return self.solver.solve_with_changed_rows(rhs, self._first_row + rows[rows >= 0])
