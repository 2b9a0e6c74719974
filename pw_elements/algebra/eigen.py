"""Natural frequencies and buckling factors of unsymmetric pairs, by SLEPc.

Harmonic motion, Eq. (13), makes Eq. (14) of vibration; Eq. (24) is that of buckling.

The critical time step follows from the largest eigenvalue, see the guide's page on theory ("The
symmetric sibling").
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TypeVar

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra.linear import explain_singular_system, factorise, symmetric_part
from pw_elements.algebra.problem_checks import check_problem, refuse_negative_trace
from pw_elements.algebra.reduction import Reduction, full_size_reduction, scale_pressures
from pw_elements.arrays import Array
from pw_elements.checks import arguments, check_same_arguments, collective_errors
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import (
    Direct,
    Iterative,
    LinearSolver,
    NotConverged,
    PreparedSolver,
    Solver,
    SolverReport,
    choose_solver,
    compute_with_fallback,
    is_matrix_free,
    to_aij,
)
from pw_elements.spaces import AssemblyRecord, SubSpace, is_hybrid

T = TypeVar("T")

_EIGENVALUE_TOLERANCE = 1e-12
_MAX_ITERATIONS = 500
# Eigenvalues that have to converge beyond those asked for, unless that is one buckling factor:
# further copies of a multiple one come from round-off alone, and late. A free body has six rigid
# modes. The space is for all of them in any case, or a load that pulls does not converge
_SPARE_EIGENVALUES = 6
# The shift below zero, in eigenvalues of the lowest mode of a compact body: so near to zero that
# each copy of a multiple rigid mode outgrows the elastic ones within a few steps
_SHIFT = 1e-2
# A slender body's lowest mode is far slower: where it is below this part of the shift, copies may
# be missed, and the shift is taken to its size
_SLENDER = 1e-3
# Eigenvalues below this, over that of a mode as short as an element, are zeros with round-off.
# Those of free bars, slender ones too, lie below 1e-16; a clamped one 500 times as long as high,
# of elements as long as high, has 7e-13
_RIGID_EIGENVALUE = 2e-15
# |x.A y - y.A x| over |A y| |x|, of random x and y, that makes a symmetric matrix: one that LDL^T
# factorises as well as LU does, and one with the round-off of its assembly
_SYMMETRIC = 1e-14
_ROUND_OFF = 1e-10
# Residual of a mode that an iterative solver may leave
_MODE_RESIDUAL = 1e-8
# Values mu of buckling below this belong to motions without any initial stress
_UNSTRESSED = 1e-10
# Critical prestress over stiffness, as `BucklingModes` has it. At prestresses nearly as large as
# the stiffness no body buckles: such factors belong to the few cells about a clamp, and exist when
# the load pulls, too. Columns as wide as high have .1, their fourth modes up to .3
MAX_PRESTRESS_RATIO = 0.6
WARNING_PRESTRESS_RATIO = 0.4

# Relative residual of the largest eigenvalue; its error is of the size of the square
_POWER_TOLERANCE = 1e-8
_POWER_STEPS = 1000
# Tolerance of the smallest eigenvalue; a negative one is round-off up to this part of the largest
_ROUGH, _INDEFINITE = 1e-3, 1e-9


class NoModes(RuntimeError):
    """An eigenvalue problem has fewer modes than requested, or some did not converge."""


@dataclass(frozen=True)
class BucklingModes:
    """Buckling factors, smallest positive first.

    Args:
        factors: (n,), multiples of the prestress' load.
        prestress: (n,), critical prestress over stiffness, where the mode moves: the sum of
            factor |row of K_sigma| d^2 over that of |K_ii| d^2, of displacements d. It is of
            the size of the strain at which the mode buckles: linear theory needs it small.
        shapes: n full vectors, in the trial space's numbering, largest entry 1.
        residuals: (n,), |K d + factor K_sigma d| / |K d|.
        imaginary: largest |Im| / |Re| of them: 0 where the unsymmetric pair stays real.
        report: what solved the linear systems.
    """

    factors: Array
    prestress_ratios: Array
    shapes: list[PETSc.Vec]
    residuals: Array
    imaginary_ratio: float
    report: SolverReport


@dataclass(frozen=True)
class VibrationModes:
    """Natural vibrations, slowest first.

    Args:
        eigenvalues: (n,), squares of the angular frequencies; round-off in rigid modes.
        shapes: n full vectors, in the trial space's numbering, largest entry 1.
        residuals: (n,), |K d - eigenvalue M d| / |(K - shift M) d|.
        imaginary: largest |Im| / |Re| of the elastic ones: 0 where the unsymmetric pair stays
            real; double eigenvalues may become a complex pair, whose two shapes are the real and
            the imaginary part of one.
        rigid: how many of them are rigid motions: the first ones, unless a symmetrised pair has
            negative eigenvalues.
        report: what solved the linear systems.
    """

    eigenvalues: Array
    shapes: list[PETSc.Vec]
    residuals: Array
    imaginary_ratio: float
    n_rigid: int
    report: SolverReport


@check_same_arguments
def vibration_modes(
    K: PETSc.Mat,
    M: PETSc.Mat,
    reduction: Reduction,
    count: int = 1,
    symmetrised: bool = False,
    solver: Solver = None,
) -> VibrationModes:
    """Smallest eigenvalues omega^2 of (K - omega^2 M) d = 0; the body may be free.

    Args:
        K: stiffness, (n, n), free.
        M: mass, (n, n), free.
        reduction: supports, and condensation.
        count: how many eigenvalues, those of rigid motions among them.
        symmetrised: take the symmetric parts of both matrices, as a symmetric eigenvalue
            solver does with an unsymmetric element.
        solver: of the systems with K - shift M, for a small negative shift: `Direct()` (by LDL^T if
            they are symmetric), `Iterative()`, or, by default, "auto" as in `solve`, which takes
            the latter in space from 200 000 unknowns on. A symmetrised pair needs `Direct()`.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite; for
            matrices whose diagonals add up to less than zero, and numbers out of range.
        NotConverged: if an iterative solver does not reach its tolerance.
        NoModes: if fewer than `count` eigenvalues lie above the shift, or some did not converge;
            of a symmetrised pair, if one lies below the shift.
    """
    asked = _Asked(reduction, count, symmetrised, solver)
    asked.check(K, "the mass", M)
    refuse_negative_trace("the mass", M, reduction.space)
    K, M = to_aij(K), to_aij(M)
    return asked.by_solver(lambda taken: _vibrations(K, M, asked, taken))


def _vibrations(
    K: PETSc.Mat, M: PETSc.Mat, asked: "_Asked", solver: LinearSolver, lowest: float | None = None
) -> VibrationModes:
    A, B, reduction = asked.pair(M, K, solver)
    mass, stiffness = (matrix.norm(PETSc.NormType.FROBENIUS) for matrix in (A, B))
    if not (0 < mass < np.inf and 0 < stiffness < np.inf):
        raise NoModes("the mass or stiffness matrix is zero or not finite")
    short = stiffness / mass  # eigenvalue of a mode as short as an element
    shift = -_SHIFT * short / B.getSize()[0] if lowest is None else -lowest
    # M d = mu (K - shift M) d has the largest mu = 1 / (eigenvalue - shift) at the smallest one
    AssemblyRecord().attach(
        B
    )  # the next call would lose what it knows, and never free mesh and all
    mass_matrix = M if is_matrix_free(solver) else A
    B.axpy(-shift, mass_matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    A.scale(short)
    if is_matrix_free(solver):  # by this the solver scales pressures
        reduction = scale_pressures(full_size_reduction(asked.reduction), B)
    mu, shapes, residuals, report = _largest(A, B, reduction, asked, solver, shifted=True)
    if mu.real.min() <= 0:
        raise NoModes(
            f"only {np.sum(mu.real > 0)} of {asked.count} eigenvalues lie above the shift "
            f"{shift:.6g}"
        )
    values = shift + short / mu
    rigid = np.abs(values) < _RIGID_EIGENVALUE * short
    elastic = values[~rigid]
    slowest = elastic.real.min(initial=np.inf)
    if lowest is None and 0 < slowest < -_SLENDER * shift:
        again = _vibrations(K, M, asked, solver, slowest)
        return replace(again, report=again.report.plus(report))
    imaginary = float(np.max(np.abs(elastic.imag) / np.abs(elastic.real), initial=0.0))
    return VibrationModes(values.real, shapes, residuals, imaginary, int(rigid.sum()), report)


@check_same_arguments
def buckling(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    reduction: Reduction,
    count: int = 1,
    symmetrised: bool = False,
    solver: Solver = None,
) -> BucklingModes:
    """Smallest positive factors of (K + factor K_sigma) d = 0.

    Args:
        K: stiffness, (n, n), free.
        K_sigma: initial stress matrix of the load to be multiplied, (n, n), free.
        reduction: supports; prescribed values do not move in a mode.
        count: how many factors.
        symmetrised: take the symmetric parts of both matrices, as a symmetric eigenvalue
            solver does with an unsymmetric element.
        solver: of the systems with K, as in `vibration_modes`.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite; for
            a stiffness whose diagonal adds up to less than zero, and numbers out of range.
        SingularSystem: if the supports leave the body a rigid motion.
        NotConverged: if an iterative solver does not reach its tolerance.
        NoModes: if fewer than `count` positive factors exist at which the prestress is below the
            stiffness, or some did not converge.
    """
    asked = _Asked(reduction, count, symmetrised, solver)
    asked.check(K, "the initial stress", K_sigma)
    K, K_sigma = to_aij(K), to_aij(K_sigma)
    return asked.by_solver(lambda taken: _buckles(K, K_sigma, asked, taken))


def _buckles(
    K: PETSc.Mat, K_sigma: PETSc.Mat, asked: "_Asked", solver: LinearSolver
) -> BucklingModes:
    A, B, reduction = asked.pair(K_sigma, K, solver)
    size = A.norm(PETSc.NormType.FROBENIUS)
    if not 0 < size < np.inf:
        raise NoModes("the initial stress matrix is zero or not finite: there is no prestress")
    # K_sigma d = mu K d with mu = -scale/factor: the largest positive -mu is the smallest
    # positive factor, and the scale brings mu to order one whatever the units of the load
    scale = B.norm(PETSc.NormType.FROBENIUS) / size
    A.scale(-scale)
    mu, shapes, residuals, report = _largest(A, B, reduction, asked, solver, shifted=False)
    if mu.real.min() <= _UNSTRESSED:
        raise NoModes(
            f"only {np.sum(mu.real > _UNSTRESSED)} of {asked.count} factors are positive: "
            "the load pulls where it should press"
        )
    imaginary = float(np.max(np.abs(mu.imag) / mu.real))
    factors = scale / mu.real
    prestress = factors * _prestress_over_stiffness(K, K_sigma, shapes, asked.reduction.space)
    _check_prestress(factors, prestress, K.comm.tompi4py())
    return BucklingModes(factors, prestress, shapes, residuals, imaginary, report)


def _prestress_over_stiffness(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    shapes: Sequence[PETSc.Vec],
    space: fem.FunctionSpace | None,
) -> Array:
    """Return |row of K_sigma| d^2 over |K_ii| d^2 (n,), sums over the displacements d of modes."""
    rows, _, entries = K_sigma.getValuesCSR()
    size = np.sqrt(np.bincount(np.repeat(np.arange(len(rows) - 1), np.diff(rows)), entries**2))
    prestress = np.pad(size, (0, len(rows) - 1 - len(size)))
    stiffness = np.abs(K.getDiagonal().array_r)
    own = slice(None) if space is None else SubSpace.displacements(space).owned_unknowns.ravel()
    sums = np.array(
        [[np.sum((s.array_r**2 * size)[own]) for s in shapes] for size in (prestress, stiffness)]
    )
    K.comm.tompi4py().Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
    return np.asarray(sums[0] / sums[1], dtype=float)


def _check_prestress(factors: Array, prestress: Array, comm: MPI.Comm) -> None:
    """Raise NoModes for prestresses beyond the stiffness; warn of those near it."""
    too_large = prestress > MAX_PRESTRESS_RATIO
    if too_large.any():
        raise NoModes(
            f"only {np.sum(~too_large)} of {len(factors)} factors are of buckling: at the factor "
            f"{factors[too_large][0]:.4g} the prestress is {prestress[too_large][0]:.3g} times the "
            "stiffness, and no body is elastic there. Either the load pulls where it should press "
            "(then reverse it), or fewer modes have to be asked for"
        )
    if prestress.max() > WARNING_PRESTRESS_RATIO:
        worst = int(np.argmax(prestress))
        words = (
            f"at the buckling factor {factors[worst]:.4g} the prestress is {prestress[worst]:.2g} "
            "times the stiffness: strains are far from small, and the factor means little. Look "
            "at the sign of the load"
        )
        log_on_root(comm, logging.WARNING, words, ".eigen")


@dataclass(frozen=True)
class _Asked:
    """How many modes of a pair, or of its symmetric part, under which supports, and by what."""

    reduction: Reduction
    count: int
    symmetrised: bool
    solver: Solver

    def check(self, K: PETSc.Mat, name: str, other: PETSc.Mat) -> None:
        pair, reductions = {"the stiffness": K, name: other}, (self.reduction,)
        check_problem(pair, reductions=reductions, solver=self.solver)
        arguments.check_integer("count", self.count, 1)
        arguments.check_flag("symmetrised", self.symmetrised)
        refuse_negative_trace("the stiffness", K, self.reduction.space)

    def by_solver(self, modes: Callable[[LinearSolver], T]) -> T:
        why = "a symmetrised pair needs its pivots counted" if self.symmetrised else ""
        space, supports = self.reduction.space, self.reduction.supports
        if self.symmetrised and space is not None and is_hybrid(space):
            raise ValueError(
                "a pair of hybrid spaces has no symmetrised twin: it is never definite"
            )
        taken = choose_solver(self.solver, supports, why, for_modes=True)
        return compute_with_fallback(taken, self.solver, supports, modes)

    def pair(
        self, A: PETSc.Mat, B: PETSc.Mat, solver: LinearSolver
    ) -> tuple[PETSc.Mat, PETSc.Mat, Reduction]:
        """A and B of A d = mu B d, reduced; for a solver without matrix A masked, B a free copy."""
        reduction = scale_pressures(self.reduction, B)
        if is_matrix_free(solver):
            reduction = full_size_reduction(reduction)
            return reduction.matrix(A), B.copy(), reduction
        A, B = reduction.matrix(A), reduction.matrix(B)
        if self.symmetrised:
            A, B = symmetric_part(A), symmetric_part(B)
        return A, B, reduction


def _largest(
    A: PETSc.Mat,
    B: PETSc.Mat,
    reduction: Reduction,
    asked: _Asked,
    solver: LinearSolver,
    shifted: bool,
) -> tuple[npt.NDArray[np.complex128], list[PETSc.Vec], Array, SolverReport]:
    """The values mu (n,) of A d = mu B d with the largest real parts, full d, and residuals.

    The two d of a complex pair are the real and the imaginary part of one. A shifted pair is
    regular though rigid motions be free.
    """
    count = asked.count
    if count > A.getSize()[0]:
        raise NoModes(f"{count} eigenvalues of {A.getSize()[0]} degrees of freedom are asked for")
    inverse: PreparedSolver
    if isinstance(solver, Iterative):
        inverse = krylov = solver.prepare(B, asked.symmetrised, reduction.supports)
        if shifted:
            krylov.preconditioner.set_up_levels()
        else:
            with explain_singular_system():
                krylov.set_up()
        B = krylov.operator
    else:
        named = {name.lstrip("-") for name in getattr(solver, "options", ())}
        mumps = isinstance(solver, Direct) and "pc_factor_mat_solver_type" not in named
        ldl = asked.symmetrised or (mumps and _is_symmetric(B))
        inverse = factorise(B, ldl, solver, reduction)
    if asked.symmetrised:
        _refuse_indefinite(inverse)
    eigensolver = SLEPc.EPS().create(A.comm)
    eigensolver.setOperators(A, B)
    kind = SLEPc.EPS.ProblemType
    eigensolver.setProblemType(kind.GHEP if asked.symmetrised else kind.GNHEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    several, size = count + _SPARE_EIGENVALUES, A.getSize()[0]
    wanted = several if shifted or count > 1 else count
    eigensolver.setDimensions(nev=min(wanted, size), ncv=min(max(2 * several, several + 15), size))
    eigensolver.setTolerances(_EIGENVALUE_TOLERANCE, _MAX_ITERATIONS)
    begun, comm = perf_counter(), A.comm.tompi4py()
    eigensolver.getST().setKSP(inverse.ksp)
    what = f"{count} eigenvalues of {A.getSize()[0]} unknowns"
    try:
        with report_activity(comm, what):
            eigensolver.solve()
    except PETSc.Error as error:
        raise NoModes(f"the eigenvalue solver broke down: {error}") from error
    steps, how = eigensolver.getIterationNumber(), inverse.report.method
    words = f"{what}: {steps} iterations, {how}, {perf_counter() - begun:.2f} s"
    log_on_root(comm, logging.INFO, words, ".eigen")
    if eigensolver.getConverged() < count:
        raise NoModes(
            f"only {eigensolver.getConverged()} of {count} eigenvalues converged "
            f"in {steps} iterations"
        )
    values, residuals, modes = np.empty(count, dtype=complex), np.empty(count), []
    for i in range(count):
        real, imaginary = B.createVecRight(), B.createVecRight()
        values[i] = eigensolver.getEigenpair(i, real, imaginary)
        residuals[i] = _residual(A, B, values[i], real, imaginary)
        modes.append(_shape(reduction, imaginary if values[i].imag < 0 else real))
    eigensolver.destroy()
    if is_matrix_free(solver) and not residuals.max() <= _MODE_RESIDUAL:
        raise NotConverged(
            f"{inverse.report.method} left a mode with the residual {residuals.max():.1e}: use "
            "Direct(), or raise ksp_max_it"
        )
    return values, modes, residuals, inverse.report


def _is_symmetric(matrix: PETSc.Mat, tolerance: float = _SYMMETRIC) -> bool:
    """Whether x.A y is y.A x for random x and y."""
    x, y, A_x, A_y = (matrix.createVecRight() for _ in range(4))
    first, last = x.getOwnershipRange()
    random = np.random.default_rng(first)
    for vector, image in ((x, A_x), (y, A_y)):
        vector.setArray(random.normal(size=last - first))
        matrix.mult(vector, image)
    return bool(abs(x.dot(A_y) - y.dot(A_x)) <= tolerance * A_y.norm() * x.norm())


def _refuse_indefinite(inverse: PreparedSolver) -> None:
    if inverse.negative_pivots is None:
        raise ValueError(
            f"{inverse.report.method} does not count negative pivots, without which a symmetrised "
            "pair is not known to be positive definite: use Direct() with MUMPS"
        )
    if inverse.negative_pivots > 0:
        raise NoModes(
            "the symmetric part of the stiffness is not positive definite: on so coarse a mesh "
            "the symmetrised element is no stable one; refine the mesh"
        )


def _residual(
    A: PETSc.Mat, B: PETSc.Mat, mu: complex, real: PETSc.Vec, imaginary: PETSc.Vec
) -> float:
    """The relative residual |A d - mu B d| / |mu B d| of d = real + i imaginary."""
    of_A, of_B = ((X * real).array_r + 1j * (X * imaginary).array_r for X in (A, B))
    squares = np.array([np.sum(np.abs(x) ** 2) for x in (of_A - mu * of_B, mu * of_B)])
    difference, size = A.comm.tompi4py().allreduce(squares)
    return float(np.sqrt(difference / size))


def _shape(reduction: Reduction, reduced: PETSc.Vec) -> PETSc.Vec:
    """Full vector of a mode, its entry of largest absolute value 1."""
    mode = reduction.offset.duplicate()
    reduction.right.mult(reduced, mode)  # prescribed values do not move in a mode
    low, high = mode.min()[1], mode.max()[1]
    mode.scale(1 / (high if abs(high) >= abs(low) else low))
    return mode


@check_same_arguments
def critical_step(K: PETSc.Mat, M: PETSc.Mat, reduction: Reduction) -> float:
    """Largest stable time step of central differences: 2 over the highest frequency.

    Args:
        K: stiffness (n, n), symmetric, free.
        M: mass (n, n), diagonal and positive.
        reduction: supports.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite, a stiffness
            that is not symmetric or has negative eigenvalues, or a mass that is not diagonal and
            positive.
        NoModes: if the highest frequency is not found.
    """
    check_problem({"the stiffness": K, "the mass": M}, reductions=(reduction,))
    if not _is_symmetric(K, _ROUND_OFF):
        raise ValueError(
            "the stiffness is not symmetric: some of its upper eigenvalues are complex, and "
            "undamped motions would grow whatever the time step; use the symmetric sibling, "
            "Sibling.from_space(space).matrix(K_standard), whose nodal forces are even, too"
        )
    inverse = extract_diagonal_mass(M)
    inverse.reciprocal()
    inverse.sqrtabs()
    scaled = K.copy()
    scaled.diagonalScale(inverse, inverse)
    # rows of supports go: what they leave is M^-1/2 K M^-1/2 of the free unknowns
    scaled = reduction.right.transposeMatMult(scaled.matMult(reduction.right))
    eigensolver = SLEPc.EPS().create(scaled.comm)
    eigensolver.setOperators(scaled)
    eigensolver.setProblemType(SLEPc.EPS.ProblemType.HEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    eigensolver.setTolerances(_POWER_TOLERANCE, _POWER_STEPS)
    eigensolver.solve()
    if eigensolver.getConverged() < 1:
        raise NoModes("the highest frequency, and with it the critical step, was not found")
    largest = eigensolver.getEigenvalue(0).real
    # at the other end a rough value will do: Ritz' are never below the smallest one
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
    eigensolver.setTolerances(_ROUGH, _POWER_STEPS)
    eigensolver.setConvergenceTest(SLEPc.EPS.Conv.NORM)
    eigensolver.solve()
    least = eigensolver.getEigenvalue(0).real if eigensolver.getConverged() else 0.0
    eigensolver.destroy()
    if least < -_INDEFINITE * abs(largest):
        raise ValueError(
            f"the stiffness over the mass has the eigenvalue {least:.3g}, the largest being "
            f"{largest:.3g}: a body's are not negative; look at the sign of its form"
        )
    if not 0 < largest < np.inf:
        raise NoModes(f"the largest eigenvalue of mass and stiffness is {largest:.6g}")
    return float(2 / np.sqrt(largest))


def extract_diagonal_mass(M: PETSc.Mat) -> PETSc.Vec:
    """Masses (n,) of a matrix, which is refused unless it is diagonal and positive."""
    mass = M.getDiagonal()
    first, last = M.getOwnershipRange()
    indptr, column, value = M.getValuesCSR()
    row = np.repeat(np.arange(first, last), np.diff(indptr))
    with collective_errors(M.comm.tompi4py()):
        if np.any(value[row != column] != 0):
            raise ValueError(
                "the mass is not diagonal, as explicit dynamics needs it: lumped_mass makes one"
            )
        if not np.all(mass.array_r > 0):
            raise ValueError(
                "a mass is not positive: standard elements' row sums are not; take those of the "
                "symmetric sibling, Sibling.matrix(M), or of piecewise-linear weights"
            )
    return mass
