"""Interfaces of linear solvers, and the direct solver.

The functions `solve`, `solve_contact`, `vibration_modes` and `buckling` take a `LinearSolver` as
the argument `solver`. A `LinearSolver` only holds settings, for example
`Direct({"mat_mumps_icntl_14": 50})`. Its method `prepare` returns a solver for a given matrix.
Objects of any class can be used if they have the methods of these protocols.
"""

import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import blake2b
from time import perf_counter
from typing import Any, ClassVar, Protocol, TypeAlias, TypeGuard

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.linalg import lapack

from pw_elements._compat import is_petsc_option_used
from pw_elements.arrays import Array, Indices
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    defer_errors_if_parallel,
)
from pw_elements.progress import log_on_root

PetscOptions: TypeAlias = Mapping[str, str | int | float | bool]

# Largest accepted relative error with which factors reproduce a known solution. The error is about
# the condition number times round-off; fewer than four digits of a solution would be correct above
# this limit
_MAX_RELATIVE_ERROR_OF_KNOWN_SOLUTION = 1e-4
# Correction of factors for changed rows by columns of the inverse. Number of columns that take as
# much CPU time as a factorisation, divided by the ratio of their numbers of operations. With one
# thread it was 0.7 to 1.4 in space (1600 to 27 000 unknowns) and 0.9 to 3 in the plane (400 to
# 100 000 unknowns) if all columns of a contact surface are computed at once
_COLUMNS_PER_FACTORISATION_BY_OPERATIONS = 0.7
# Largest number of factorisations that take as much time as all columns since the last one; and as
# few new columns, which are computed even if all columns have taken more
_MAX_FACTORISATIONS_FOR_ALL_COLUMNS = 2.0
_MAX_FACTORISATIONS_FOR_FEW_COLUMNS = 1 / 3
# Number of columns that MUMPS computes together (ICNTL(27)). In space, a column takes 20 % more
# time with MUMPS' own choice, and the same time with 64
_COLUMNS_PER_BLOCK = 128
# Largest condition number of the correction's small dense matrix; largest residual of A x = b,
# relative to |A| |x| + |b|, that may be due to round-off; and largest number of steps of iterative
# refinement
_MAX_CONDITION_OF_ROW_CORRECTION = 1e8
_RELATIVE_RESIDUAL_ROUND_OFF = 10 * float(np.finfo(float).eps)
_MAX_ITERATIVE_REFINEMENT_STEPS = 4
# MUMPS' number (ICNTL(7)) of the ordering by approximate minimum degree
_MINIMUM_DEGREE_ORDERING = 0
# Matrices that are ordered in this way: largest mean number of entries per row, and largest number
# of unknowns. Stiffness matrices of quadratic elements have at most some 32 entries per row in the
# plane and 81 in space. In the plane, the first factorisation then takes half to two thirds of the
# CPU time that it takes with MUMPS' own choice (PORD in Debian's build), and further ones the same
# up to some 50 000 unknowns, but up to 1.4 times as much beyond; in space both take up to twice as
# much: tests/speed/ordering_speed.py
_MAX_ENTRIES_PER_ROW_FOR_MINIMUM_DEGREE = 50
_MAX_UNKNOWNS_FOR_MINIMUM_DEGREE = 50_000
# Options that limit numbers of iterations; PETSc interprets -3 as no limit
_ITERATION_LIMIT_OPTION_PATTERN = re.compile(r"(max_it|restart|cycles|steps|_l?its)$")
# Options among these that limit the outermost method, which also ends when it has converged
_OUTERMOST_ITERATION_LIMIT_OPTIONS = ("ksp_max_it", "ksp_gmres_restart")
# Largest value of the other options that limit numbers of iterations
_MAX_INNER_ITERATION_LIMIT = 1000


class SingularSystem(RuntimeError):
    """Error raised if a system has no unique solution, usually because supports are missing."""


class FreeConstantPressure(SingularSystem):
    """Error raised if an incompressible body's pressure is determined only up to a constant.

    This happens if the whole boundary of the body is held.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(
            message
            or "an incompressible body whose whole boundary is held has a pressure that is known "
            'up to a constant: prescribe it at a vertex, prescribe(space, "pressure", where)'
        )


class NotConverged(RuntimeError):
    """Error raised if Newton's method or an iterative solver has not reached its tolerance."""


@dataclass(frozen=True)
class SolverReport:
    """Method and cost of a solution.

    Args:
        method: name of the method, such as "LU by mumps".
        factorisations: number of factorised matrices.
        krylov_iterations: number of iterations of an iterative solver; for a direct solver, number
            of solutions that were needed to correct factors for changed rows.
    """

    method: str
    factorisations: int
    krylov_iterations: int = 0

    def plus(self, earlier: "SolverReport") -> "SolverReport":
        """Return the sum of this report and an earlier one.

        Args:
            earlier: report of an earlier solution. The sum keeps the method of this report.
        """
        return SolverReport(
            self.method,
            earlier.factorisations + self.factorisations,
            earlier.krylov_iterations + self.krylov_iterations,
        )


class PreparedSolver(Protocol):
    """Solver of systems with one matrix, whose entries may change between solutions.

    Linear problems and contact problems use the members `solve`, `solve_with_changed_rows`,
    `report`, `determinant_signs` and `release`. Eigenvalue problems and Newton's method use `ksp`
    and `set_up` in addition. Contact of two bodies at large sliding needs a further method
    `set_matrix`, see `FactorisedSolver`.
    """

    ksp: PETSc.KSP

    @property
    def report(self) -> SolverReport:
        """Report of the solver's method and of the cost of all its solutions so far."""

    @property
    def determinant_signs(self) -> tuple[int, ...]:
        """Signs of the determinants of all matrices solved with so far, in order.

        The tuple is empty if the solver computes no determinants.
        """

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a symmetric matrix, or None if it is not known."""

    def set_up(self) -> None:
        """Prepare `ksp` for the current entries of the matrix.

        Raises:
            SingularSystem: if the matrix is singular.
        """

    def solve(self, rhs: PETSc.Vec) -> PETSc.Vec:
        """Return the solution (n,) for the current entries of the matrix.

        Args:
            rhs: right-hand side (n,).

        Raises:
            SingularSystem: if there is no unique solution.
        """

    def solve_with_changed_rows(self, rhs: PETSc.Vec, rows: Indices) -> PETSc.Vec | None:
        """Return the solution (n,) after some rows of the matrix have changed.

        The result is None if `solve` has to be used instead.

        Args:
            rhs: right-hand side (n,).
            rows: global numbers of this process' rows that have changed.
        """

    def release(self) -> None:
        """Free the solver's memory on all processes."""


class LinearSolver(Protocol):
    """Settings of a method for linear systems."""

    def prepare(self, matrix: PETSc.Mat, symmetric: bool = False) -> PreparedSolver:
        """Return a solver for a matrix, which is factorised on first use.

        Args:
            matrix: square matrix (n, n).
            symmetric: whether the matrix is symmetric.
        """


class SeparateSupportsSolver(Protocol):
    """A `LinearSolver` that takes a matrix without supports, and the supports separately.

    Other solvers take a matrix that has been reduced by the supports. Here right-hand sides and
    solutions contain all unknowns, and are zero where displacements are prescribed.

    Contact changes the matrix in each iteration and uses only the solver's Krylov method. For this
    purpose, the object that `prepare` returns needs a method

        iterate(product, precondition, rhs, max_residual)

    instead of `solve_with_changed_rows`. The functions `product` (product with the matrix) and
    `precondition` (multigrid) take and return an array of this process' unknowns. The method
    returns an array x with |rhs - product(x)| <= max_residual, or raises NotConverged.
    """

    matrix_free: ClassVar[bool]  # true

    def prepare(self, matrix: PETSc.Mat, symmetric: bool = False, supports: Any = None) -> Any:  # noqa: ANN401
        """Return a `PreparedSolver` for a matrix under supports.

        Args:
            matrix: matrix (n, n) without supports.
            symmetric: whether an eigenvalue problem needs a symmetric solver.
            supports: free unknowns of a reduction made by `Reduction.dirichlet`; None for any other
                reduction.
        """


def has_separate_supports(solver: object) -> TypeGuard[SeparateSupportsSolver]:
    """Return whether a solver takes a matrix without supports, and the supports separately."""
    return bool(getattr(solver, "matrix_free", False))


@dataclass(frozen=True)
class Direct:
    """Direct solver by LU factorisation, or by LDL^T factorisation of symmetric matrices.

    Matrices are factorised by MUMPS, unless the options name another package.

    Args:
        options: PETSc options of the solver without prefix and hyphen, such as
            `{"mat_mumps_icntl_14": 50}` or `{"pc_factor_mat_solver_type": "superlu_dist"}`.
            Packages other than MUMPS report neither zero pivots nor determinants. Singular matrices
            are recognised nevertheless, but contact does not check whether the solution is unique.

    Raises:
        TypeError, ValueError: for invalid options; at the first solution, for unused options.
    """

    options: PetscOptions = field(default_factory=dict)

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        check_petsc_options(self.options)

    @check_same_arguments_on_all_processes
    def prepare(self, matrix: PETSc.Mat, symmetric: bool = False) -> "FactorisedSolver":
        """Return a solver for a matrix, which is factorised on first use.

        Args:
            matrix: square matrix (n, n).
            symmetric: whether the matrix is symmetric. If so, LDL^T is used.

        Raises:
            TypeError, ValueError: if `matrix` is not a square matrix, or PETSc refuses the options.
        """
        arguments.check_flag("symmetric", symmetric)
        arguments.check_assembled_square_matrix("the matrix", matrix)
        with name_options_in_errors(self.options):
            return FactorisedSolver(matrix, symmetric, self.options)


class FactorisedSolver:
    """Solver that keeps the factors of a matrix.

    When the matrix changes, the factors are computed again, or corrected if only a few rows have
    changed. The guide's page on theory describes the correction ("Large systems").
    """

    def __init__(self, matrix: PETSc.Mat, symmetric: bool, options: PetscOptions) -> None:
        self._options = options
        self._determinant_signs: list[int] = []
        self._factorisations = self._iterations = 0
        self.ksp = PETSc.KSP().create(matrix.comm)
        self.ksp.setOperators(matrix)
        self.ksp.setType("preonly")
        self._preconditioner = self.ksp.getPC()
        if symmetric:
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._preconditioner.setType("cholesky" if symmetric else "lu")
        self._preconditioner.setFactorSolverType("mumps")
        if options:
            set_options(self.ksp, options)
        package = self._preconditioner.getFactorSolverType()
        self._method = f"{'LDL^T' if symmetric else 'LU'} by {package}"
        self._uses_mumps = package == "mumps"
        self.set_matrix(matrix)

    def set_matrix(self, matrix: PETSc.Mat) -> None:
        """Replace the matrix by another one of the same size.

        The sparsity patterns may differ.
        """
        self._matrix, self._has_failed = matrix, False
        self._preconditioner.reset()
        self.ksp.setOperators(matrix)
        self._preconditioner.setFactorSetUpSolverType()
        if self._uses_mumps:
            factor = self._preconditioner.getFactorMatrix()
            factor.setMumpsIcntl(24, 1)  # count null pivots instead of dividing by them
            factor.setMumpsIcntl(33, 1)  # compute the determinant
            # options of the user replace these two
            factor.setMumpsIcntl(27, _COLUMNS_PER_BLOCK)
            if _is_minimum_degree_ordering_faster(matrix):
                factor.setMumpsIcntl(7, _MINIMUM_DEGREE_ORDERING)

    @property
    def report(self) -> SolverReport:
        return SolverReport(self._method, self._factorisations, self._iterations)

    @property
    def determinant_signs(self) -> tuple[int, ...]:
        """Signs of the determinants of all matrices solved with so far; empty without MUMPS."""
        return tuple(self._determinant_signs)

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a symmetric matrix; None unless MUMPS is used."""
        if not self._uses_mumps:
            return None
        return int(self._preconditioner.getFactorMatrix().getInertia()[0])

    def set_up(self) -> None:
        """Factorise the matrix with its current entries.

        Raises:
            SingularSystem: if there are zero pivots, or the factors do not reproduce a known
                solution.
        """
        if self._has_failed:  # PETSc keeps the error of an analysis that failed because of NaN
            self.set_matrix(self._matrix)
        self._preconditioner.setReusePreconditioner(False)
        self._max_stored_columns = self._columns_per_factorisation = 0.0
        self._inverse_columns: list[PETSc.Mat] = []
        self._changed_rows: Indices = np.empty(0, dtype=PETSc.IntType)  # of all processes
        start, comm = perf_counter(), self._matrix.comm.tompi4py()
        n = self._matrix.getSize()[0]
        with name_options_in_errors(self._options):
            self.ksp.setUp()
        self._factorisations += 1
        self._has_failed = True
        self._raise_if_singular()
        self._has_failed = False
        refuse_unused_options(self.ksp, self._options)
        words = f"{self._method} of {n} unknowns: {perf_counter() - start:.2f} s"
        log_on_root(comm, logging.DEBUG, words, ".linear_solver")
        if self._uses_mumps:
            factor = self._preconditioner.getFactorMatrix()
            operations, entries = factor.getMumpsRinfog(3), factor.getMumpsInfog(29)
            entries = entries if entries > 0 else -1e6 * entries  # negative numbers are in millions
            self._max_stored_columns = entries / (2 * n)
            self._columns_per_factorisation = (
                _COLUMNS_PER_FACTORISATION_BY_OPERATIONS * operations / (2 * entries)
            )
            self._factors_sign = int(np.sign(factor.getMumpsRinfog(12)))
            self._determinant_signs.append(self._factors_sign)

    def solve(self, rhs: PETSc.Vec) -> PETSc.Vec:
        self.set_up()
        self._solution = rhs.duplicate()
        self.ksp.solve(rhs, self._solution)
        return self._solution.copy()

    def solve_with_changed_rows(self, rhs: PETSc.Vec, rows: Indices) -> PETSc.Vec | None:
        """Solve with the last factors, corrected for rows that have changed.

        Args:
            rhs: right-hand side (n,).
            rows: global numbers of this process' rows that have changed.

        Returns:
            The solution (n,), or None if new factors would cost less or the correction is not
            accurate.
        """
        A, comm = self._matrix, self._matrix.comm.tompi4py()
        new_rows = np.setdiff1d(np.concatenate(comm.allgather(rows)), self._changed_rows)
        if self._is_factorisation_cheaper_than_columns(len(new_rows)):
            return None
        self._preconditioner.setReusePreconditioner(True)
        begin, end = A.getOwnershipRange()
        if len(new_rows):
            self._inverse_columns.append(self._compute_columns_of_inverse(new_rows))
            self._changed_rows = np.append(self._changed_rows, new_rows).astype(PETSc.IntType)
        is_owned = (self._changed_rows >= begin) & (self._changed_rows < end)
        local_rows = self._changed_rows[is_owned] - begin
        row_set = PETSc.IS().createGeneral(self._changed_rows[is_owned], comm=A.comm)
        A_rows = A.createSubMatrix(row_set)
        capacitance = np.zeros((len(is_owned), len(is_owned)))  # changed rows of A times Z
        products = [A_rows.matMult(Z) for Z in self._inverse_columns]
        capacitance[is_owned] = np.hstack(
            [np.empty((len(local_rows), 0)), *(p.getDenseArray() for p in products)]
        )
        comm.Allreduce(MPI.IN_PLACE, capacitance, MPI.SUM)
        factors, pivots, condition, sign = _factorise_dense(capacitance)
        if not condition < _MAX_CONDITION_OF_ROW_CORRECTION:
            return None
        x, residual, correction = self._solution.copy(), rhs.duplicate(), rhs.duplicate()
        infinity = PETSc.NormType.INFINITY
        matrix_norm, rhs_norm = A.norm(infinity), rhs.norm(infinity)
        for step in range(_MAX_ITERATIVE_REFINEMENT_STEPS):
            if step:
                self.ksp.solve(residual, correction)
                self._iterations += 1
                x.axpy(1.0, correction)
            A.mult(x, residual)
            row_residual = np.zeros(len(is_owned))
            row_residual[is_owned] = (rhs.array_r - residual.array_r)[local_rows]
            comm.Allreduce(MPI.IN_PLACE, row_residual, MPI.SUM)
            weights, column = row_residual, 0
            if len(weights):
                weights = lapack.dgetrs(factors, pivots, row_residual)[0]
            for Z in self._inverse_columns:
                x.array[:] += Z.getDenseArray() @ weights[column : column + Z.getSize()[1]]
                column += Z.getSize()[1]
            A.mult(x, residual)
            residual.aypx(-1.0, rhs)
            size = matrix_norm * x.norm(infinity) + rhs_norm
            if residual.norm(infinity) <= _RELATIVE_RESIDUAL_ROUND_OFF * size:
                self._solution = x
                self._determinant_signs.append(sign * self._factors_sign)
                return x.copy()
        return None

    def _is_factorisation_cheaper_than_columns(self, n_new_columns: int) -> bool:
        """Return whether new factors cost less than further columns of the inverse.

        All columns may take half of the memory of the factors.
        """
        n_columns = len(self._changed_rows) + n_new_columns
        max_columns, max_new_columns = (
            n_factorisations * self._columns_per_factorisation
            for n_factorisations in (
                _MAX_FACTORISATIONS_FOR_ALL_COLUMNS,
                _MAX_FACTORISATIONS_FOR_FEW_COLUMNS,
            )
        )
        needs_too_much_time = n_columns > max_columns and n_new_columns > max_new_columns
        return n_columns > self._max_stored_columns or needs_too_much_time

    def _compute_columns_of_inverse(self, columns: Indices) -> PETSc.Mat:
        """Compute k columns (n, k) of the inverse of the factorised matrix.

        Args:
            columns: global numbers (k,) of the columns, the same on all processes.
        """
        comm, sizes, k = self._matrix.comm, self._matrix.getSizes()[0], len(columns)
        # unit vectors as sparse right-hand sides, which MUMPS takes from the first process
        k_here, n_here = (k, sizes[1]) if comm.rank == 0 else (0, 0)
        pointers, indices = np.arange(k_here + 1), columns[:k_here]
        csr = pointers.astype(PETSc.IntType), indices.astype(PETSc.IntType), np.ones(k_here)
        unit_rows = PETSc.Mat().createAIJ(((k_here, k), (n_here, sizes[1])), csr=csr, comm=comm)
        Z = PETSc.Mat().createDense((sizes, (PETSc.DECIDE, k)), comm=comm)
        Z.assemble()
        factor = self._preconditioner.getFactorMatrix()
        factor.matSolve(PETSc.Mat().createTranspose(unit_rows), Z)
        self._iterations += len(columns)
        return Z

    def release(self) -> None:
        self.ksp.destroy()

    def _raise_if_singular(self) -> None:
        """Raise SingularSystem if there are zero pivots or a known solution is not reproduced."""
        exact = self._matrix.createVecRight()
        # the known solution is neither a rigid motion nor another mode
        exact.setArray(np.cos(np.arange(*exact.getOwnershipRange(), dtype=float)))
        computed = exact.duplicate()
        self.ksp.solve(self._matrix * exact, computed)
        computed.axpy(-1.0, exact)
        error = computed.norm() / exact.norm()
        factor = self._preconditioner.getFactorMatrix() if self._uses_mumps else None
        if factor is not None and (zero_pivots := factor.getMumpsInfog(28)) > 0:
            raise SingularSystem(f"the system matrix is singular, it has {zero_pivots} zero pivots")
        if not error <= _MAX_RELATIVE_ERROR_OF_KNOWN_SOLUTION:
            raise SingularSystem(
                "the system matrix is singular or too badly conditioned, a known solution came "
                f"back with the relative error {error:.1e}"
            )


def _factorise_dense(matrix: Array) -> tuple[Array, Indices, float, int]:
    """Return LU factors, pivots, estimated condition number and sign of the determinant.

    The condition number in the 1-norm is infinite for a singular matrix or one with NaN.

    Args:
        matrix: square matrix (k, k), also an empty one.
    """
    if not len(matrix):
        return matrix, np.empty(0, dtype=np.int32), 1.0, 1
    factors, pivots, info = lapack.dgetrf(matrix)
    reciprocal = lapack.dgecon(factors, np.abs(matrix).sum(axis=0).max())[0] if info == 0 else 0.0
    condition = 1 / reciprocal if reciprocal > 0 else np.inf
    n_sign_changes = np.sum(np.diag(factors) < 0) + np.sum(pivots != np.arange(len(pivots)))
    return factors, pivots, condition, 1 - 2 * int(n_sign_changes % 2)


def _is_minimum_degree_ordering_faster(matrix: PETSc.Mat) -> bool:
    """Return whether a matrix has the sparsity and size of a small plane body's; collective."""
    n = matrix.getSize()[0]
    n_entries = matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
    is_sparse = n_entries <= _MAX_ENTRIES_PER_ROW_FOR_MINIMUM_DEGREE * n
    return bool(is_sparse and n <= _MAX_UNKNOWNS_FOR_MINIMUM_DEGREE)


def check_petsc_options(options: object) -> None:
    arguments.check_type("options", options, Mapping, "give PETSc options such as {'ksp_view': ''}")
    assert isinstance(options, Mapping)
    for name, value in options.items():
        if not isinstance(name, str) or not name.strip("- "):
            raise ValueError(f"option {name!r}: its name has to be a string")
        kinds = (str, int, float, np.number)
        arguments.check_type(
            f"option {name!r}", value, kinds, "it has to be a string, number or bool"
        )
        if _ITERATION_LIMIT_OPTION_PATTERN.search(name):
            _refuse_endless_iteration_limit(name, value)


def _refuse_endless_iteration_limit(name: str, value: str | float) -> None:
    """Raise ValueError if an iteration limit would make PETSc iterate endlessly."""
    is_outer = name.lstrip("-") in _OUTERMOST_ITERATION_LIMIT_OPTIONS
    try:
        count = arguments.check_integer(name, int(value) if isinstance(value, str) else value, 1)
    except ValueError:
        count = 0
    if count < 1 or (count > _MAX_INNER_ITERATION_LIMIT and not is_outer):
        limit = "" if is_outer else f" and at most {_MAX_INNER_ITERATION_LIMIT}"
        raise ValueError(
            f"option {name} = {value!r}: it has to be a whole number, at least 1{limit}. PETSc "
            "takes some others for no limit, and methods within a preconditioner do not look "
            "whether they have converged"
        )


@contextmanager
def name_options_in_errors(options: PetscOptions) -> Iterator[None]:
    """Turn PETSc's errors within a `with` block into a ValueError that names the options."""
    try:
        yield
    except PETSc.Error as error:
        if not options:
            raise
        reason = str(error).strip().splitlines()[-1]
        raise ValueError(
            f"PETSc cannot solve with the options {dict(options)}: {reason}"
        ) from error


def refuse_unused_options(ksp: PETSc.KSP, options: PetscOptions) -> None:
    prefix = ksp.getOptionsPrefix()
    unused = [name for name in options if not is_petsc_option_used(f"{prefix}{name.lstrip('-')}")]
    if unused:
        raise ValueError(f"PETSc has no use for the options {unused} here: look at their names")


def set_options(ksp: PETSc.KSP, options: PetscOptions) -> None:
    """Set the options of a solver, under a prefix that depends only on the options."""
    words = sorted(f"{name} {value}" for name, value in options.items())
    prefix = f"pw_{blake2b(' '.join(words).encode(), digest_size=6).hexdigest()}_"
    database = PETSc.Options(prefix)
    for name, value in options.items():
        database[name.lstrip("-")] = value
    ksp.setOptionsPrefix(prefix)
    ksp.setFromOptions()
