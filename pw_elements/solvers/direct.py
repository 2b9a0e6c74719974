"""Linear solvers: what `solve`, `solve_contact`, `vibration_modes` and `buckling` take as `solver`.

A `LinearSolver` is a statement, such as `Direct({"mat_mumps_icntl_14": 50})`; `prepare` binds it
to one matrix. Any object with these methods is one: nothing asks for its class.
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

from pw_elements._compat import is_petsc_option_used
from pw_elements.arrays import Indices
from pw_elements.checks import arguments, check_same_arguments, defer_errors_if_parallel
from pw_elements.progress import log_on_root

Options: TypeAlias = Mapping[str, str | int | float | bool]

# A known solution comes back with a relative error of condition number x round-off: above
# this, fewer than four digits of any answer would be meant.
_LOST = 1e-4
# Condition of what corrects old factors; residual over round-off, and solutions that refine it
_SINGULAR = 1e8
_ROUND_OFF = 10 * float(np.finfo(float).eps)
_REFINED = 4
# Options that say how often something is repeated, which PETSc's -3 makes endless; those of the
# outermost method, which ends when it has converged, and the most of any other
_COUNT = re.compile(r"(max_it|restart|cycles|steps|_l?its)$")
_OUTER_COUNTS = ("ksp_max_it", "ksp_gmres_restart")
_MOST_INNER_STEPS = 1000


class SingularSystem(RuntimeError):
    """The system has no unique solution, usually because supports are missing."""


class FreePressure(SingularSystem):
    """The pressure of an incompressible body that is held all around is known up to a constant."""

    def __init__(self, words: str = "") -> None:
        super().__init__(
            words
            or "an incompressible body whose whole boundary is held has a pressure that is known "
            'up to a constant: prescribe it at a vertex, prescribe(space, "pressure", where)'
        )


class NotConverged(RuntimeError):
    """Newton's method, or an iterative linear solver, has not reached its tolerance."""


@dataclass(frozen=True)
class SolverReport:
    """How a problem was solved, and at what cost.

    Args:
        method: in words, "LU by mumps" say.
        factorisations: how many matrices have been factorised.
        krylov_iterations: of an iterative solver, or solves that corrected old factors.
    """

    method: str
    factorisations: int
    krylov_iterations: int = 0

    def plus(self, earlier: "SolverReport") -> "SolverReport":
        """Return the sum of this report and an earlier one.

        Args:
            earlier: report of an earlier solution, whose method is dropped.
        """
        return SolverReport(
            self.method,
            earlier.factorisations + self.factorisations,
            earlier.krylov_iterations + self.krylov_iterations,
        )

    def since(self, earlier: "SolverReport") -> "SolverReport":
        """Return the work done since an earlier report of the same solver.

        Args:
            earlier: the earlier report.
        """
        return SolverReport(
            self.method,
            self.factorisations - earlier.factorisations,
            self.krylov_iterations - earlier.krylov_iterations,
        )


class PreparedSolver(Protocol):
    """A solver of systems with one matrix, whose entries may change between solutions.

    `solve` and contact need `solve`, `solve_changed`, `report`, `orientations` and `release` of
    it; eigenvalue problems and Newton's method `ksp` and `set_up` besides. For contact of two
    bodies at large sliding it also has `take`, as `Factors` do.
    """

    ksp: PETSc.KSP

    @property
    def report(self) -> SolverReport:
        """What has been done so far."""

    @property
    def determinant_signs(self) -> tuple[int, ...]:
        """Signs of the determinants met so far, in order; none if the solver knows none."""

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a symmetric matrix; None if the solver knows not."""

    def set_up(self) -> None:
        """Makes `ksp` ready for the matrix as it is now, or raises SingularSystem."""

    def solve(self, rhs: PETSc.Vec) -> PETSc.Vec:
        """Solution (n,) for the matrix as it is now; SingularSystem if there is not just one."""

    def solve_with_changed_rows(self, rhs: PETSc.Vec, rows: Indices) -> PETSc.Vec | None:
        """Solution after rows (global, this process') have changed, if that is cheaper; or None."""

    def release(self) -> None:
        """Frees what it holds, on all processes."""


class LinearSolver(Protocol):
    """How linear systems are solved."""

    def prepare(self, matrix: PETSc.Mat, symmetric: bool = False) -> PreparedSolver:
        """Binds the solver to a square matrix (n, n); it factorises when it first has to.

        Args:
            matrix: square (n, n).
            symmetric: whether the matrix is symmetric.
        """


class MatrixFreeSolver(Protocol):
    """A `LinearSolver` that takes the free stiffness and supports, and needs no reduced matrix.

    Right-hand sides and solutions are zero where displacements are prescribed. In contact, whose
    matrix is another one in each iteration, nothing but the Krylov method is the solver's own: what
    it prepares has a method

        iterate(product, precondition, right, size)

    in place of `solve_changed`. Both functions map arrays of this process' unknowns; it returns an
    x with |right - product(x)| <= size, or raises NotConverged. The preconditioner is multigrid.
    """

    matrix_free: ClassVar[bool]  # true

    def prepare(self, matrix: PETSc.Mat, symmetric: bool = False, supports: Any = None) -> Any:  # noqa: ANN401
        """Binds the solver to a free matrix (n, n); gives a `PreparedSolver`.

        Supports are those of `Reduction.dirichlet`; None where the reduction is another one.
        """


def is_matrix_free(solver: object) -> TypeGuard[MatrixFreeSolver]:
    """Whether a solver takes the free matrix and supports, and does without a reduced one."""
    return bool(getattr(solver, "matrix_free", False))


@dataclass(frozen=True)
class Direct:
    """Factorisation, LU or, for symmetric matrices, LDL^T; by MUMPS unless options say otherwise.

    Args:
        options: PETSc options of the solver without prefix and hyphen, such as
            `{"mat_mumps_icntl_14": 50}` or `{"pc_factor_mat_solver_type": "superlu_dist"}`. Other
            packages than MUMPS tell neither zero pivots (a singular matrix is recognised all the
            same) nor the determinant, so that contact does not check uniqueness.

    Raises:
        TypeError, ValueError: for invalid options; once it solves, for those that are not used.
    """

    options: Options = field(default_factory=dict)

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        check_options(self.options)

    @check_same_arguments
    def prepare(self, matrix: PETSc.Mat, symmetric: bool = False) -> "Factors":
        """Binds the solver to a square matrix (n, n).

        Args:
            matrix: square (n, n).
            symmetric: whether the matrix is symmetric, so that LDL^T will do.

        Raises:
            TypeError, ValueError: if it is not such a matrix, or PETSc refuses the options.
        """
        arguments.check_flag("symmetric", symmetric)
        arguments.check_matrix("the matrix", matrix)
        with name_options_in_errors(self.options):
            return Factors(matrix, symmetric, self.options)


class Factors:
    """Factors of a matrix: made anew where it has changed, corrected where few of its rows have.

    The guide's page on theory says how ("Large systems").
    """

    def __init__(self, matrix: PETSc.Mat, symmetric: bool, options: Options) -> None:
        self._options = options
        self._orientations: list[int] = []
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
        self._mumps = package == "mumps"
        self.set_matrix(matrix)

    def set_matrix(self, matrix: PETSc.Mat) -> None:
        """Goes on with another matrix of the same size, whose pattern may be another one."""
        self._matrix, self._failed = matrix, False
        self._preconditioner.reset()
        self.ksp.setOperators(matrix)
        self._preconditioner.setFactorSetUpSolverType()
        if self._mumps:
            factor = self._preconditioner.getFactorMatrix()
            factor.setMumpsIcntl(24, 1)  # null pivots are counted, not divided by
            factor.setMumpsIcntl(33, 1)  # determinant

    @property
    def report(self) -> SolverReport:
        return SolverReport(self._method, self._factorisations, self._iterations)

    @property
    def determinant_signs(self) -> tuple[int, ...]:
        """Signs of the determinants of all matrices factorised so far, as far as MUMPS did it."""
        return tuple(self._orientations)

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a symmetric matrix (its inertia), by MUMPS alone."""
        if not self._mumps:
            return None
        return int(self._preconditioner.getFactorMatrix().getInertia()[0])

    def set_up(self) -> None:
        """Factorises the matrix as it is now; raises SingularSystem if the factors do not serve."""
        if self._failed:  # PETSc keeps the error of an analysis that NaN made fail
            self.set_matrix(self._matrix)
        self._preconditioner.setReusePreconditioner(False)
        self._most = 0.0  # columns
        self._columns: list[PETSc.Mat] = []
        self._rows: Indices = np.empty(0, dtype=PETSc.IntType)  # S, of all processes
        begun, comm, n = perf_counter(), self._matrix.comm.tompi4py(), self._matrix.getSize()[0]
        with name_options_in_errors(self._options):
            self.ksp.setUp()
        self._factorisations += 1
        self._failed = True
        self._check()
        self._failed = False
        refuse_unused_options(self.ksp, self._options)
        words = f"{self._method} of {n} unknowns: {perf_counter() - begun:.2f} s"
        log_on_root(comm, logging.DEBUG, words, ".linear_solver")
        if self._mumps:
            factor = self._preconditioner.getFactorMatrix()
            operations, entries = factor.getMumpsRinfog(3), factor.getMumpsInfog(29)
            entries = entries if entries > 0 else -1e6 * entries  # in millions if it is negative
            self._most = min(operations / (2 * entries), entries / (2 * n))
            self._factorised = int(np.sign(factor.getMumpsRinfog(12)))
            self._orientations.append(self._factorised)

    def solve(self, rhs: PETSc.Vec) -> PETSc.Vec:
        self.set_up()
        self._solution = rhs.duplicate()
        self.ksp.solve(rhs, self._solution)
        return self._solution.copy()

    def solve_with_changed_rows(self, rhs: PETSc.Vec, rows: Indices) -> PETSc.Vec | None:
        """Solution by the last factors; None if new ones cost less, or it is not exact."""
        A, comm = self._matrix, self._matrix.comm.tompi4py()
        new = np.setdiff1d(np.concatenate(comm.allgather(rows)), self._rows)
        if len(self._rows) + len(new) > self._most:
            return None
        self._preconditioner.setReusePreconditioner(True)
        first, last = A.getOwnershipRange()
        if len(new):
            self._columns.append(self._inverted(new))
            self._rows = np.append(self._rows, new).astype(PETSc.IntType)
        own = (self._rows >= first) & (self._rows < last)
        here = self._rows[own] - first
        part = A.createSubMatrix(PETSc.IS().createGeneral(self._rows[own], comm=A.comm))
        changed = np.zeros((len(own), len(own)))
        products = [part.matMult(Z) for Z in self._columns]
        changed[own] = np.hstack([np.empty((len(here), 0)), *(p.getDenseArray() for p in products)])
        comm.Allreduce(MPI.IN_PLACE, changed, MPI.SUM)
        if len(own) and not np.linalg.cond(changed, 1) < _SINGULAR:
            return None
        x, rest, step = self._solution.copy(), rhs.duplicate(), rhs.duplicate()
        largest = PETSc.NormType.INFINITY
        size, known = A.norm(largest), rhs.norm(largest)
        for refined in range(_REFINED):
            if refined:
                self.ksp.solve(rest, step)
                self._iterations += 1
                x.axpy(1.0, step)
            A.mult(x, rest)
            wrong = np.zeros(len(own))
            wrong[own] = (rhs.array_r - rest.array_r)[here]
            comm.Allreduce(MPI.IN_PLACE, wrong, MPI.SUM)
            weights, at = np.linalg.solve(changed, wrong), 0
            for Z in self._columns:
                x.array[:] += Z.getDenseArray() @ weights[at : at + Z.getSize()[1]]
                at += Z.getSize()[1]
            A.mult(x, rest)
            rest.aypx(-1.0, rhs)
            if rest.norm(largest) <= _ROUND_OFF * (size * x.norm(largest) + known):
                self._solution = x
                sign = int(np.linalg.slogdet(changed)[0])
                self._orientations.append(sign * self._factorised)
                return x.copy()
        return None

    def _inverted(self, rows: Indices) -> PETSc.Mat:
        """The inverse's columns of rows of all processes, by the last factors."""
        (first, last), sizes = self._matrix.getOwnershipRange(), self._matrix.getSizes()[0]
        shape = sizes, (PETSc.DECIDE, len(rows))
        ones, Z = (PETSc.Mat().createDense(shape, comm=self._matrix.comm) for _ in range(2))
        column = np.flatnonzero((rows >= first) & (rows < last))
        ones.getDenseArray()[rows[column] - first, column] = 1.0
        for matrix in (ones, Z):
            matrix.assemble()
        self.ksp.matSolve(ones, Z)
        ones.destroy()
        self._iterations += len(rows)
        return Z

    def release(self) -> None:
        self.ksp.destroy()

    def _check(self) -> None:
        """Raises SingularSystem if MUMPS met zero pivots, or a known solution does not return."""
        known = self._matrix.createVecRight()
        first, last = known.getOwnershipRange()
        known.setArray(np.cos(np.arange(first, last, dtype=float)))  # no rigid motion, nor any mode
        back = known.duplicate()
        self.ksp.solve(self._matrix * known, back)
        back.axpy(-1.0, known)
        error = back.norm() / known.norm()
        if self._mumps and (none := self._preconditioner.getFactorMatrix().getMumpsInfog(28)) > 0:
            raise SingularSystem(f"the system matrix is singular, it has {none} zero pivots")
        if not error <= _LOST:
            raise SingularSystem(
                "the system matrix is singular or too badly conditioned, a known solution came "
                f"back with the relative error {error:.1e}"
            )


def check_options(options: object) -> None:
    arguments.check_type("options", options, Mapping, "give PETSc options such as {'ksp_view': ''}")
    assert isinstance(options, Mapping)
    for name, value in options.items():
        if not isinstance(name, str) or not name.strip("- "):
            raise ValueError(f"option {name!r}: its name has to be a string")
        kinds = (str, int, float, np.number)
        arguments.check_type(
            f"option {name!r}", value, kinds, "it has to be a string, number or bool"
        )
        if _COUNT.search(name):
            _check_count(name, value)


def _check_count(name: str, value: str | float) -> None:
    """Raise ValueError for numbers of repetitions of which PETSc would make an endless loop."""
    of_outer_method = name.lstrip("-") in _OUTER_COUNTS
    try:
        count = arguments.check_integer(name, int(value) if isinstance(value, str) else value, 1)
    except ValueError:
        count = 0
    if count < 1 or (count > _MOST_INNER_STEPS and not of_outer_method):
        most = "" if of_outer_method else f" and at most {_MOST_INNER_STEPS}"
        raise ValueError(
            f"option {name} = {value!r}: it has to be a whole number, at least 1{most}. PETSc "
            "takes some others for no limit, and methods within a preconditioner do not look "
            "whether they have converged"
        )


@contextmanager
def name_options_in_errors(options: Options) -> Iterator[None]:
    """Makes of PETSc's error in a block, which options have caused, one that names them."""
    try:
        yield
    except PETSc.Error as error:
        if not options:
            raise
        said = str(error).strip().splitlines()[-1]
        raise ValueError(f"PETSc cannot solve with the options {dict(options)}: {said}") from error


def refuse_unused_options(ksp: PETSc.KSP, options: Options) -> None:
    prefix = ksp.getOptionsPrefix()
    unused = [name for name in options if not is_petsc_option_used(f"{prefix}{name.lstrip('-')}")]
    if unused:
        raise ValueError(f"PETSc has no use for the options {unused} here: look at their names")


def set_options(ksp: PETSc.KSP, options: Options) -> None:
    """Gives options to a solver under a prefix that is the same for the same options."""
    words = sorted(f"{name} {value}" for name, value in options.items())
    prefix = f"pw_{blake2b(' '.join(words).encode(), digest_size=6).hexdigest()}_"
    database = PETSc.Options(prefix)
    for name, value in options.items():
        database[name.lstrip("-")] = value
    ksp.setOptionsPrefix(prefix)
    ksp.setFromOptions()
