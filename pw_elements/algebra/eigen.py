"""Natural frequencies and buckling factors of unsymmetric matrix pairs, by SLEPc.

Harmonic motion, Eq. (13), leads to the eigenvalue problem of vibration, Eq. (14); that of buckling
is Eq. (24). The critical time step follows from the largest eigenvalue, see the guide's page on
theory ("The symmetric sibling").
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
# Eigenvalues that have to converge beyond those requested, except for a single buckling factor:
# further copies of a multiple eigenvalue arise from round-off alone, and late. A free body has six
# rigid modes. The search space has room for all of them in any case; without it, a load that pulls
# does not converge
_SPARE_EIGENVALUES = 6
# Negative shift over the eigenvalue of the lowest mode of a compact body: so near to zero that each
# copy of a multiple rigid mode outgrows the elastic ones within a few steps
_RELATIVE_SHIFT = 1e-2
# Lowest eigenvalue over the shift below which the body is slender and copies may be missed: the
# shift is then reduced to this eigenvalue
_SLENDER_EIGENVALUE = 1e-3
# Eigenvalue, over that of a mode as short as an element, below which a mode is rigid. Rigid modes
# of free bars, slender ones too, have below 1e-16; the first mode of a clamped bar 500 times as
# long as high, with elements as long as high, has 7e-13
_RIGID_EIGENVALUE = 2e-15
# |x.A y - y.A x| over |A y| |x|, of random x and y, below which LDL^T factorises a matrix as well
# as LU does; and the same below which the lack of symmetry is round-off of the assembly
_LDL_ASYMMETRY = 1e-14
_ASSEMBLY_ASYMMETRY = 1e-10
# Largest residual of a mode computed with an iterative solver
_MAX_MODE_RESIDUAL = 1e-8
# Eigenvalue mu of the buckling problem below which a motion meets no initial stress
_MIN_BUCKLING_EIGENVALUE = 1e-10
# `BucklingModes.prestress_ratios` that are refused, and from which on a warning is logged. At
# prestresses nearly as large as the stiffness no body buckles: such factors belong to the few cells
# about a clamp, and exist when the load pulls, too. Columns as wide as high have .1, their fourth
# modes up to .3
MAX_PRESTRESS_RATIO = 0.6
WARNING_PRESTRESS_RATIO = 0.4

# Relative residual of the largest eigenvalue, whose error is of the size of its square
_LARGEST_TOLERANCE = 1e-8
_MAX_LANCZOS_STEPS = 1000
# Tolerance of the smallest eigenvalue over the norm of the matrix
_SMALLEST_TOLERANCE = 1e-3
# Negative eigenvalue over the largest one that is round-off
_NEGATIVE_ROUND_OFF = 1e-9


class NoModes(RuntimeError):
    """An eigenvalue problem has fewer modes than requested, or some did not converge."""


@dataclass(frozen=True)
class BucklingModes:
    """Buckling factors and modes, smallest positive factor first.

    Args:
        factors: (n,), multiples of the load that causes the prestress.
        prestress_ratios: (n,), critical prestress over stiffness, weighted by the mode's
            displacements d: the sum of factor |row of K_sigma| d^2 over that of |K_ii| d^2. It is
            about the strain at which the mode buckles, which linear theory needs to be small.
        shapes: n full vectors, in the trial space's numbering, largest entry 1.
        residuals: (n,), |K d + factor K_sigma d| / |K d|.
        imaginary_ratio: largest |Im| / |Re| of the eigenvalues; 0 if all are real.
        report: of the linear solver.
    """

    factors: Array
    prestress_ratios: Array
    shapes: list[PETSc.Vec]
    residuals: Array
    imaginary_ratio: float
    report: SolverReport


@dataclass(frozen=True)
class VibrationModes:
    """Natural vibration modes, slowest first.

    Args:
        eigenvalues: (n,), squares of the angular frequencies; round-off in rigid modes.
        shapes: n full vectors, in the trial space's numbering, largest entry 1.
        residuals: (n,), |K d - eigenvalue M d| / |(K - shift M) d|.
        imaginary_ratio: largest |Im| / |Re| of the elastic eigenvalues; 0 if all are real. A double
            eigenvalue of an unsymmetric pair may become a complex pair, whose two shapes are the
            real and the imaginary part of one eigenvector.
        n_rigid: number of rigid modes. They come first, unless a symmetrised pair has negative
            eigenvalues.
        report: of the linear solver.
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
    """Compute the smallest eigenvalues omega^2 of (K - omega^2 M) d = 0; the body may be free.

    Args:
        K: stiffness, (n, n), free.
        M: mass, (n, n), free.
        reduction: supports, and condensation.
        count: number of eigenvalues, including those of rigid modes.
        symmetrised: take the symmetric parts of both matrices, as a symmetric eigenvalue
            solver does with an unsymmetric element.
        solver: of systems with K - shift M, for a small negative shift: `Direct()` (by LDL^T if
            they are symmetric), `Iterative()`, or, by default, "auto" as in `solve`, which takes
            `Iterative()` in space from 200 000 unknowns on. A symmetrised pair needs `Direct()`.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite; for
            matrices whose diagonals add up to less than zero, and numbers out of range.
        NotConverged: if an iterative solver does not reach its tolerance.
        NoModes: if fewer than `count` eigenvalues lie above the shift, or some did not converge;
            of a symmetrised pair, if one lies below the shift.
    """
    request = _ModesRequest(reduction, count, symmetrised, solver)
    request.check(K, "the mass", M)
    refuse_negative_trace("the mass", M, reduction.space)
    K, M = to_aij(K), to_aij(M)
    return request.compute(lambda choice: _compute_vibrations(K, M, request, choice))


def _compute_vibrations(
    K: PETSc.Mat,
    M: PETSc.Mat,
    request: "_ModesRequest",
    solver: LinearSolver,
    lowest: float | None = None,
) -> VibrationModes:
    """Compute vibration modes; `lowest` is the lowest eigenvalue, if it is known already."""
    A, B, reduction = request.reduce_pair(M, K, solver)
    mass, stiffness = (matrix.norm(PETSc.NormType.FROBENIUS) for matrix in (A, B))
    if not (0 < mass < np.inf and 0 < stiffness < np.inf):
        raise NoModes("the mass or stiffness matrix is zero or not finite")
    shortest_eigenvalue = stiffness / mass  # of a mode as short as an element
    compact_shift = -_RELATIVE_SHIFT * shortest_eigenvalue / B.getSize()[0]
    shift = compact_shift if lowest is None else -lowest
    # M d = mu (K - shift M) d has the largest mu = 1 / (eigenvalue - shift) at the smallest one
    # `axpy` would lose the record of B, but never free it and the mesh in it
    AssemblyRecord().attach(B)
    mass_matrix = M if is_matrix_free(solver) else A
    B.axpy(-shift, mass_matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    A.scale(shortest_eigenvalue)
    if is_matrix_free(solver):  # with the scale of pressures that the solver takes from B
        reduction = scale_pressures(full_size_reduction(request.reduction), B)
    mu, shapes, residuals, report = _compute_largest_eigenvalues(
        A, B, reduction, request, solver, shifted=True
    )
    if mu.real.min() <= 0:
        raise NoModes(
            f"only {np.sum(mu.real > 0)} of {request.count} eigenvalues lie above the shift "
            f"{shift:.6g}"
        )
    values = shift + shortest_eigenvalue / mu
    is_rigid = np.abs(values) < _RIGID_EIGENVALUE * shortest_eigenvalue
    elastic = values[~is_rigid]
    slowest = elastic.real.min(initial=np.inf)
    if lowest is None and 0 < slowest < -_SLENDER_EIGENVALUE * shift:
        modes = _compute_vibrations(K, M, request, solver, slowest)
        return replace(modes, report=modes.report.plus(report))
    imaginary = float(np.max(np.abs(elastic.imag) / np.abs(elastic.real), initial=0.0))
    n_rigid = int(is_rigid.sum())
    return VibrationModes(values.real, shapes, residuals, imaginary, n_rigid, report)


@check_same_arguments
def buckling(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    reduction: Reduction,
    count: int = 1,
    symmetrised: bool = False,
    solver: Solver = None,
) -> BucklingModes:
    """Compute the smallest positive factors of (K + factor K_sigma) d = 0.

    Args:
        K: stiffness, (n, n), free.
        K_sigma: initial stress matrix of the load to be multiplied, (n, n), free.
        reduction: supports; prescribed displacements are zero in a mode.
        count: number of factors.
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
    request = _ModesRequest(reduction, count, symmetrised, solver)
    request.check(K, "the initial stress", K_sigma)
    K, K_sigma = to_aij(K), to_aij(K_sigma)
    return request.compute(lambda choice: _compute_buckling(K, K_sigma, request, choice))


def _compute_buckling(
    K: PETSc.Mat, K_sigma: PETSc.Mat, request: "_ModesRequest", solver: LinearSolver
) -> BucklingModes:
    A, B, reduction = request.reduce_pair(K_sigma, K, solver)
    size = A.norm(PETSc.NormType.FROBENIUS)
    if not 0 < size < np.inf:
        raise NoModes("the initial stress matrix is zero or not finite: there is no prestress")
    # K_sigma d = mu K d with mu = -scale/factor: the largest positive -mu is the smallest
    # positive factor, and the scale brings mu to order one whatever the units of the load
    scale = B.norm(PETSc.NormType.FROBENIUS) / size
    A.scale(-scale)
    mu, shapes, residuals, report = _compute_largest_eigenvalues(
        A, B, reduction, request, solver, shifted=False
    )
    n_positive = np.sum(mu.real > _MIN_BUCKLING_EIGENVALUE)
    if mu.real.min() <= _MIN_BUCKLING_EIGENVALUE:
        raise NoModes(
            f"only {n_positive} of {request.count} factors are positive: "
            "the load pulls where it should press"
        )
    imaginary = float(np.max(np.abs(mu.imag) / mu.real))
    factors = scale / mu.real
    prestress = factors * _prestress_over_stiffness(K, K_sigma, shapes, request.reduction.space)
    _check_prestress(factors, prestress, K.comm.tompi4py())
    return BucklingModes(factors, prestress, shapes, residuals, imaginary, report)


def _prestress_over_stiffness(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    shapes: Sequence[PETSc.Vec],
    space: fem.FunctionSpace | None,
) -> Array:
    """Return |row of K_sigma| d^2 over |K_ii| d^2 (n,), sums over the displacements d of modes."""
    indptr, _, entries = K_sigma.getValuesCSR()
    row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    row_norms = np.sqrt(np.bincount(row, entries**2))
    prestress = np.pad(row_norms, (0, len(indptr) - 1 - len(row_norms)))
    stiffness = np.abs(K.getDiagonal().array_r)
    dofs: npt.NDArray[np.integer] = np.arange(len(stiffness))
    if space is not None:
        dofs = SubSpace.displacements(space).owned_unknowns.ravel()
    sums = np.array(
        [[np.sum((d.array_r**2 * w)[dofs]) for d in shapes] for w in (prestress, stiffness)]
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
        warning = (
            f"at the buckling factor {factors[worst]:.4g} the prestress is {prestress[worst]:.2g} "
            "times the stiffness: strains are far from small, and the factor means little. Look "
            "at the sign of the load"
        )
        log_on_root(comm, logging.WARNING, warning, ".eigen")


@dataclass(frozen=True)
class _ModesRequest:
    """Arguments of `vibration_modes` or `buckling`: supports, number of modes, and solver."""

    reduction: Reduction
    count: int
    symmetrised: bool
    solver: Solver

    def check(self, K: PETSc.Mat, name: str, matrix: PETSc.Mat) -> None:
        """Check all arguments; `name` is the name in messages of the pair's other matrix."""
        pair, reductions = {"the stiffness": K, name: matrix}, (self.reduction,)
        check_problem(pair, reductions=reductions, solver=self.solver)
        arguments.check_integer("count", self.count, 1)
        arguments.check_flag("symmetrised", self.symmetrised)
        refuse_negative_trace("the stiffness", K, self.reduction.space)

    def compute(self, modes: Callable[[LinearSolver], T]) -> T:
        """Return `modes(solver)` for the requested solver or the choice of "auto"."""
        reason = "a symmetrised pair needs its pivots counted" if self.symmetrised else ""
        space, supports = self.reduction.space, self.reduction.supports
        if self.symmetrised and space is not None and is_hybrid(space):
            raise ValueError(
                "a pair of hybrid spaces has no symmetrised twin: it is never definite"
            )
        choice = choose_solver(self.solver, supports, reason, for_modes=True)
        return compute_with_fallback(choice, self.solver, supports, modes)

    def reduce_pair(
        self, A: PETSc.Mat, B: PETSc.Mat, solver: LinearSolver
    ) -> tuple[PETSc.Mat, PETSc.Mat, Reduction]:
        """Reduce A and B of A d = mu B d.

        For a matrix-free solver A keeps its size, with zeros for prescribed unknowns, and B is a
        free copy.
        """
        reduction = scale_pressures(self.reduction, B)
        if is_matrix_free(solver):
            reduction = full_size_reduction(reduction)
            return reduction.matrix(A), B.copy(), reduction
        A, B = reduction.matrix(A), reduction.matrix(B)
        if self.symmetrised:
            A, B = symmetric_part(A), symmetric_part(B)
        return A, B, reduction


def _compute_largest_eigenvalues(
    A: PETSc.Mat,
    B: PETSc.Mat,
    reduction: Reduction,
    request: _ModesRequest,
    solver: LinearSolver,
    shifted: bool,
) -> tuple[npt.NDArray[np.complex128], list[PETSc.Vec], Array, SolverReport]:
    """Compute the eigenvalues mu of A d = mu B d with the largest real parts.

    Args:
        A: reduced (n_r, n_r).
        B: reduced (n_r, n_r), or free for a matrix-free solver.
        reduction: of the pair.
        request: number of modes, and symmetry.
        solver: of systems with B.
        shifted: whether B contains a shift, so that it is regular even with free rigid motions.

    Returns:
        mu (count,); full vectors d, for a complex pair the real and the imaginary part of one;
        residuals (count,); and the solver's report.
    """
    count = request.count
    if count > A.getSize()[0]:
        raise NoModes(f"{count} eigenvalues of {A.getSize()[0]} degrees of freedom are asked for")
    inverse: PreparedSolver
    if isinstance(solver, Iterative):
        inverse = krylov = solver.prepare(B, request.symmetrised, reduction.supports)
        if shifted:
            krylov.preconditioner.set_up_levels()
        else:
            with explain_singular_system():
                krylov.set_up()
        B = krylov.operator
    else:
        option_names = {name.lstrip("-") for name in getattr(solver, "options", ())}
        uses_mumps = isinstance(solver, Direct) and "pc_factor_mat_solver_type" not in option_names
        use_ldl = request.symmetrised or (uses_mumps and _is_symmetric(B))
        inverse = factorise(B, use_ldl, solver, reduction)
    if request.symmetrised:
        _refuse_indefinite(inverse)
    eigensolver = SLEPc.EPS().create(A.comm)
    eigensolver.setOperators(A, B)
    kind = SLEPc.EPS.ProblemType
    eigensolver.setProblemType(kind.GHEP if request.symmetrised else kind.GNHEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    with_spares, size = count + _SPARE_EIGENVALUES, A.getSize()[0]
    n_converged = with_spares if shifted or count > 1 else count
    n_vectors = max(2 * with_spares, with_spares + 15)
    eigensolver.setDimensions(nev=min(n_converged, size), ncv=min(n_vectors, size))
    eigensolver.setTolerances(_EIGENVALUE_TOLERANCE, _MAX_ITERATIONS)
    start, comm = perf_counter(), A.comm.tompi4py()
    eigensolver.getST().setKSP(inverse.ksp)
    task = f"{count} eigenvalues of {A.getSize()[0]} unknowns"
    try:
        with report_activity(comm, task):
            eigensolver.solve()
    except PETSc.Error as error:
        raise NoModes(f"the eigenvalue solver broke down: {error}") from error
    steps, method = eigensolver.getIterationNumber(), inverse.report.method
    summary = f"{task}: {steps} iterations, {method}, {perf_counter() - start:.2f} s"
    log_on_root(comm, logging.INFO, summary, ".eigen")
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
        modes.append(_full_mode(reduction, imaginary if values[i].imag < 0 else real))
    eigensolver.destroy()
    if is_matrix_free(solver) and not residuals.max() <= _MAX_MODE_RESIDUAL:
        raise NotConverged(
            f"{inverse.report.method} left a mode with the residual {residuals.max():.1e}: use "
            "Direct(), or raise ksp_max_it"
        )
    return values, modes, residuals, inverse.report


def _is_symmetric(matrix: PETSc.Mat, tolerance: float = _LDL_ASYMMETRY) -> bool:
    """Return whether x.A y equals y.A x for random x and y."""
    x, y, A_x, A_y = (matrix.createVecRight() for _ in range(4))
    begin, end = x.getOwnershipRange()
    random = np.random.default_rng(begin)
    for vector, image in ((x, A_x), (y, A_y)):
        vector.setArray(random.normal(size=end - begin))
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
    """Return the relative residual |A d - mu B d| / |mu B d| of d = real + i imaginary."""
    A_d, B_d = ((X * real).array_r + 1j * (X * imaginary).array_r for X in (A, B))
    squares = np.array([np.sum(np.abs(x) ** 2) for x in (A_d - mu * B_d, mu * B_d)])
    difference, size = A.comm.tompi4py().allreduce(squares)
    return float(np.sqrt(difference / size))


def _full_mode(reduction: Reduction, reduced: PETSc.Vec) -> PETSc.Vec:
    """Return the full vector of a mode, scaled so that its largest entry is 1."""
    mode = reduction.offset.duplicate()
    reduction.right.mult(reduced, mode)  # prescribed displacements are zero in a mode
    lowest, highest = mode.min()[1], mode.max()[1]
    mode.scale(1 / (highest if abs(highest) >= abs(lowest) else lowest))
    return mode


@check_same_arguments
def critical_step(K: PETSc.Mat, M: PETSc.Mat, reduction: Reduction) -> float:
    """Compute the largest stable time step of central differences: 2 over the highest frequency.

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
    if not _is_symmetric(K, _ASSEMBLY_ASYMMETRY):
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
    # M^-1/2 K M^-1/2 of the free unknowns
    scaled = reduction.right.transposeMatMult(scaled.matMult(reduction.right))
    eigensolver = SLEPc.EPS().create(scaled.comm)
    eigensolver.setOperators(scaled)
    eigensolver.setProblemType(SLEPc.EPS.ProblemType.HEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    eigensolver.setTolerances(_LARGEST_TOLERANCE, _MAX_LANCZOS_STEPS)
    eigensolver.solve()
    if eigensolver.getConverged() < 1:
        raise NoModes("the highest frequency, and with it the critical step, was not found")
    largest = eigensolver.getEigenvalue(0).real
    # a rough smallest eigenvalue suffices: a Ritz value is never below the exact one
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
    eigensolver.setTolerances(_SMALLEST_TOLERANCE, _MAX_LANCZOS_STEPS)
    eigensolver.setConvergenceTest(SLEPc.EPS.Conv.NORM)
    eigensolver.solve()
    least = eigensolver.getEigenvalue(0).real if eigensolver.getConverged() else 0.0
    eigensolver.destroy()
    if least < -_NEGATIVE_ROUND_OFF * abs(largest):
        raise ValueError(
            f"the stiffness over the mass has the eigenvalue {least:.3g}, the largest being "
            f"{largest:.3g}: a body's are not negative; look at the sign of its form"
        )
    if not 0 < largest < np.inf:
        raise NoModes(f"the largest eigenvalue of mass and stiffness is {largest:.6g}")
    return float(2 / np.sqrt(largest))


def extract_diagonal_mass(M: PETSc.Mat) -> PETSc.Vec:
    """Return the diagonal (n,) of a mass matrix; raise ValueError if it is not lumped or positive.

    Args:
        M: mass (n, n).
    """
    mass = M.getDiagonal()
    indptr, column, value = M.getValuesCSR()
    row = np.repeat(np.arange(*M.getOwnershipRange()), np.diff(indptr))
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
