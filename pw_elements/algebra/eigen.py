"""Natural frequencies and buckling factors of unsymmetric matrix pairs, by SLEPc.

Harmonic motion, Eq. (13) of the paper that `pw_elements` cites, leads to the eigenvalue problem of
vibration, Eq. (14). The eigenvalue problem of buckling is Eq. (24). The critical time step follows
from the largest eigenvalue, see the guide's page on theory ("The symmetric sibling").
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra.linear import factorise, reraise_singular_system_with_cause, symmetric_part
from pw_elements.algebra.problem_checks import (
    check_problem,
    refuse_negative_displacement_block_trace,
)
from pw_elements.algebra.reduction import (
    Reduction,
    full_size_masking_reduction,
    scale_pressures_to_displacements,
)
from pw_elements.arrays import Array
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import (
    Direct,
    Iterative,
    LinearSolver,
    NotConverged,
    PreparedSolver,
    SolverOrAuto,
    SolverReport,
    choose_solver,
    compute_with_direct_fallback,
    has_separate_supports,
    to_aij,
)
from pw_elements.spaces import AssemblyRecord, SubSpace, is_hybrid

BucklingOrVibrationModes = TypeVar("BucklingOrVibrationModes")

_EIGENSOLVER_RELATIVE_TOLERANCE = 1e-12
_MAX_EIGENSOLVER_ITERATIONS = 500
# Number of eigenvalues that have to converge in addition to those requested, except if a single
# buckling factor is requested. The iteration finds further copies of a multiple eigenvalue late,
# since they arise only from round-off. A free body has six rigid modes. The search space has room
# for the additional eigenvalues in any case: without this room, the iteration would fail if the
# load pulls
_N_EXTRA_CONVERGED_EIGENVALUES = 6
# Magnitude of the negative shift, relative to the estimated lowest elastic eigenvalue of a compact
# body. The shift is so close to zero that each copy of a multiple rigid mode outgrows the elastic
# modes within a few steps
_SHIFT_OVER_LOWEST_ELASTIC_EIGENVALUE = 1e-2
# A body is slender if the ratio of its lowest eigenvalue to the shift is below this value. Copies
# of multiple eigenvalues may then be missed, and the shift is reduced to the lowest eigenvalue
_MAX_EIGENVALUE_OVER_SHIFT_OF_SLENDER_BODY = 1e-3
# A mode is rigid if its eigenvalue, relative to that of a mode as short as an element, is smaller.
# For rigid modes of free bars, even slender ones, the ratio is below 1e-16. It is 7e-13 for the
# first elastic mode of a clamped bar that is 500 times as long as high, with elements as long as
# high
_MAX_RIGID_OVER_ELEMENT_EIGENVALUE = 2e-15
# Largest asymmetries |x.A y - y.A x| / (|A y| |x|) of a matrix A, with random vectors x and y. Up
# to the first, LDL^T factorises A as accurately as LU does; up to the second, the asymmetry may be
# due to round-off of the assembly
_MAX_RELATIVE_ASYMMETRY_FOR_LDL = 1e-14
_MAX_RELATIVE_ASYMMETRY_FROM_ASSEMBLY = 1e-10
# Largest residual of a mode computed with an iterative solver
_MAX_RELATIVE_RESIDUAL_OF_ITERATIVE_MODES = 1e-8
# The initial stress does not act on a mode if the eigenvalue mu of the buckling problem is smaller
_MIN_SCALED_RECIPROCAL_BUCKLING_FACTOR = 1e-10
# Values of `BucklingModes.prestress_ratios` above which a factor is refused, and above which a
# warning is logged. No body buckles at a prestress nearly as large as the stiffness. Factors with
# such a ratio belong to a few cells around a clamp, and exist even if the load pulls. Columns as
# wide as high have a ratio of 0.1, and their fourth modes have ratios up to 0.3
MAX_PRESTRESS_OVER_STIFFNESS = 0.6
WARNING_PRESTRESS_OVER_STIFFNESS = 0.4

# Relative residual of the largest eigenvalue; the eigenvalue's error is about its square
_LARGEST_EIGENVALUE_RELATIVE_TOLERANCE = 1e-8
_MAX_LANCZOS_STEPS = 1000
# Tolerance of the smallest eigenvalue, relative to the norm of the matrix
_SMALLEST_EIGENVALUE_TOLERANCE_OVER_NORM = 1e-3
# Magnitude of a negative eigenvalue, relative to the largest one, that may be due to round-off
_NEGATIVE_EIGENVALUE_ROUND_OFF_OVER_LARGEST = 1e-9


class TooFewModes(RuntimeError):
    """Error raised if there are fewer modes than requested, or if some did not converge."""


@dataclass(frozen=True)
class BucklingModes:
    """Buckling factors and modes, smallest positive factor first.

    Each mode d satisfies (K + factor K_sigma) d = 0, with the stiffness K and the initial stress
    matrix K_sigma.

    Args:
        factors: buckling factors (n,), multiples of the load that causes the prestress.
        prestress_ratios: ratios (n,) of critical prestress to stiffness. A ratio is the sum of
            factor |row i of K_sigma| d_i^2 divided by the sum of |K_ii| d_i^2, both over all
            displacements d_i. It approximates the strain at which the body buckles, which has to be
            small in linear theory.
        shapes: n modes d, as vectors in the trial space's numbering, with largest entry 1.
        residuals: relative residuals (n,), |K d + factor K_sigma d| / |K d|.
        imaginary_ratio: largest ratio |Im| / |Re| of the eigenvalues; 0 if all are real.
        report: report of the linear solver.
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

    Each mode d satisfies (K - eigenvalue M) d = 0, with the stiffness K and the mass M.

    Args:
        eigenvalues: squares (n,) of the angular frequencies; zero up to round-off for rigid modes.
        shapes: n modes d, as vectors in the trial space's numbering, with largest entry 1.
        residuals: relative residuals (n,), |K d - eigenvalue M d| / |(K - shift M) d|, with the
            small negative shift of the eigenvalue solver.
        imaginary_ratio: largest ratio |Im| / |Re| of the elastic eigenvalues; 0 if all are real.
            If K or M is unsymmetric, a double eigenvalue may become a complex pair. The two shapes
            of the pair are then the real and the imaginary part of one eigenvector.
        n_rigid: number of rigid modes. They come first, unless symmetrised matrices have negative
            eigenvalues.
        report: report of the linear solver.
    """

    eigenvalues: Array
    shapes: list[PETSc.Vec]
    residuals: Array
    imaginary_ratio: float
    n_rigid: int
    report: SolverReport


@check_same_arguments_on_all_processes
def vibration_modes(
    K: PETSc.Mat,
    M: PETSc.Mat,
    reduction: Reduction,
    count: int = 1,
    symmetrised: bool = False,
    solver: SolverOrAuto = None,
) -> VibrationModes:
    """Compute the smallest eigenvalues omega^2 of (K - omega^2 M) d = 0; the body may be free.

    Args:
        K: stiffness (n, n), assembled without supports.
        M: mass (n, n), assembled without supports.
        reduction: supports, and static condensation.
        count: number of eigenvalues, including those of rigid modes.
        symmetrised: whether to replace both matrices by their symmetric parts, which a symmetric
            eigenvalue solver would use for an unsymmetric element.
        solver: solver of systems with K - shift M, for a small negative shift: `Direct()`, which
            uses LDL^T for symmetric matrices; `Iterative()`; or "auto" (also if None), which
            chooses between them as in `solve`, but uses `Iterative()` only in three dimensions with
            200 000 unknowns or more. Symmetrised matrices need `Direct()`.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite, for
            matrices whose diagonals have a negative sum, and for a `count` less than one.
        NotConverged: if an iterative solver does not reach its tolerance.
        TooFewModes: if fewer than `count` eigenvalues lie above the shift, or some did not
            converge; for symmetrised matrices, if an eigenvalue lies below the shift.
    """
    request = _EigenmodeRequest(reduction, count, symmetrised, solver)
    request.check_eigenproblem(K, "the mass", M)
    refuse_negative_displacement_block_trace("the mass", M, reduction.space)
    K, M = to_aij(K), to_aij(M)
    return request.compute_with_chosen_solver_or_direct_fallback(
        lambda choice: _compute_vibration_modes(K, M, request, choice)
    )


def _compute_vibration_modes(
    K: PETSc.Mat,
    M: PETSc.Mat,
    request: "_EigenmodeRequest",
    solver: LinearSolver,
    lowest_eigenvalue_of_first_attempt: float | None = None,
) -> VibrationModes:
    """Compute vibration modes for a request that has been checked.

    Args:
        K: stiffness (n, n).
        M: mass (n, n).
        request: supports, number of modes, and whether the matrices are symmetrised.
        solver: linear solver.
        lowest_eigenvalue_of_first_attempt: lowest elastic eigenvalue found by a first attempt;
            None in the first attempt.
    """
    A, B, reduction = request.reduce_matrix_pair(M, K, solver)
    mass, stiffness = (matrix.norm(PETSc.NormType.FROBENIUS) for matrix in (A, B))
    if not (0 < mass < np.inf and 0 < stiffness < np.inf):
        raise TooFewModes("the mass or stiffness matrix is zero or not finite")
    shortest_eigenvalue = stiffness / mass  # of a mode as short as an element
    compact_shift = -_SHIFT_OVER_LOWEST_ELASTIC_EIGENVALUE * shortest_eigenvalue / B.getSize()[0]
    shift = (
        compact_shift
        if lowest_eigenvalue_of_first_attempt is None
        else -lowest_eigenvalue_of_first_attempt
    )
    # M d = mu (K - shift M) d has the largest mu = 1 / (eigenvalue - shift) at the smallest
    # eigenvalue. B gets an empty record, because `axpy` would lose the record of B without ever
    # freeing it and its mesh
    AssemblyRecord().attach(B)
    mass_matrix = M if has_separate_supports(solver) else A
    B.axpy(-shift, mass_matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    A.scale(shortest_eigenvalue)
    if has_separate_supports(solver):  # the solver scales pressures according to B
        reduction = scale_pressures_to_displacements(
            full_size_masking_reduction(request.reduction), B
        )
    mu, shapes, residuals, report = _compute_modes_of_largest_eigenvalues(
        A, B, reduction, request, solver, is_B_shifted=True
    )
    if mu.real.min() <= 0:
        raise TooFewModes(
            f"only {np.sum(mu.real > 0)} of {request.count} eigenvalues lie above the shift "
            f"{shift:.6g}"
        )
    values = shift + shortest_eigenvalue / mu
    is_rigid = np.abs(values) < _MAX_RIGID_OVER_ELEMENT_EIGENVALUE * shortest_eigenvalue
    elastic = values[~is_rigid]
    slowest = elastic.real.min(initial=np.inf)
    if (
        lowest_eigenvalue_of_first_attempt is None
        and 0 < slowest < -_MAX_EIGENVALUE_OVER_SHIFT_OF_SLENDER_BODY * shift
    ):
        modes = _compute_vibration_modes(K, M, request, solver, slowest)
        return replace(modes, report=modes.report.plus(report))
    imaginary = float(np.max(np.abs(elastic.imag) / np.abs(elastic.real), initial=0.0))
    n_rigid = int(is_rigid.sum())
    return VibrationModes(values.real, shapes, residuals, imaginary, n_rigid, report)


@check_same_arguments_on_all_processes
def buckling(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    reduction: Reduction,
    count: int = 1,
    symmetrised: bool = False,
    solver: SolverOrAuto = None,
) -> BucklingModes:
    """Compute the smallest positive factors of (K + factor K_sigma) d = 0.

    Args:
        K: stiffness (n, n), assembled without supports.
        K_sigma: initial stress matrix (n, n) of the reference load, assembled without supports. The
            body buckles under the factor times this load.
        reduction: supports; prescribed displacements are zero in a mode.
        count: number of factors.
        symmetrised: whether to replace both matrices by their symmetric parts, which a symmetric
            eigenvalue solver would use for an unsymmetric element.
        solver: solver of the systems with K, as in `vibration_modes`.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite, for a
            stiffness whose diagonal has a negative sum, and for a `count` less than one.
        SingularSystem: if the supports leave a rigid motion of the body free.
        NotConverged: if an iterative solver does not reach its tolerance.
        TooFewModes: if fewer than `count` factors are positive and represent buckling, or if some
            factors did not converge. A factor represents buckling only if its ratio of prestress to
            stiffness is at most 0.6 (see `BucklingModes.prestress_ratios`).
    """
    request = _EigenmodeRequest(reduction, count, symmetrised, solver)
    request.check_eigenproblem(K, "the initial stress", K_sigma)
    K, K_sigma = to_aij(K), to_aij(K_sigma)
    return request.compute_with_chosen_solver_or_direct_fallback(
        lambda choice: _compute_buckling_modes(K, K_sigma, request, choice)
    )


def _compute_buckling_modes(
    K: PETSc.Mat, K_sigma: PETSc.Mat, request: "_EigenmodeRequest", solver: LinearSolver
) -> BucklingModes:
    A, B, reduction = request.reduce_matrix_pair(K_sigma, K, solver)
    size = A.norm(PETSc.NormType.FROBENIUS)
    if not 0 < size < np.inf:
        raise TooFewModes("the initial stress matrix is zero or not finite: there is no prestress")
    # -scale K_sigma d = mu K d with mu = scale/factor: the largest mu belongs to the smallest
    # positive factor, and the scale makes mu of the order of one whatever the units of the load
    scale = B.norm(PETSc.NormType.FROBENIUS) / size
    A.scale(-scale)
    mu, shapes, residuals, report = _compute_modes_of_largest_eigenvalues(
        A, B, reduction, request, solver, is_B_shifted=False
    )
    n_positive = np.sum(mu.real > _MIN_SCALED_RECIPROCAL_BUCKLING_FACTOR)
    if mu.real.min() <= _MIN_SCALED_RECIPROCAL_BUCKLING_FACTOR:
        raise TooFewModes(
            f"only {n_positive} of {request.count} factors are positive: "
            "the load pulls where it should press"
        )
    imaginary = float(np.max(np.abs(mu.imag) / mu.real))
    factors = scale / mu.real
    prestress = factors * _prestress_over_stiffness_at_unit_factor(
        K, K_sigma, shapes, request.reduction.space
    )
    _check_prestress_ratios(factors, prestress, K.comm.tompi4py())
    return BucklingModes(factors, prestress, shapes, residuals, imaginary, report)


def _prestress_over_stiffness_at_unit_factor(
    K: PETSc.Mat,
    K_sigma: PETSc.Mat,
    mode_shapes: Sequence[PETSc.Vec],
    space: fem.FunctionSpace | None,
) -> Array:
    """Return the ratios (n,) of prestress to stiffness of n modes for a factor of one.

    `BucklingModes.prestress_ratios` defines the ratio.
    """
    indptr, _, entries = K_sigma.getValuesCSR()
    row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    row_norms = np.sqrt(np.bincount(row, entries**2))
    prestress = np.pad(row_norms, (0, len(indptr) - 1 - len(row_norms)))
    stiffness = np.abs(K.getDiagonal().array_r)
    dofs: npt.NDArray[np.integer] = np.arange(len(stiffness))
    if space is not None:
        dofs = SubSpace.displacements(space).owned_unknowns.ravel()
    sums = np.array(
        [[np.sum((d.array_r**2 * w)[dofs]) for d in mode_shapes] for w in (prestress, stiffness)]
    )
    K.comm.tompi4py().Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
    return np.asarray(sums[0] / sums[1], dtype=float)


def _check_prestress_ratios(
    buckling_factors: Array, prestress_ratios: Array, comm: MPI.Comm
) -> None:
    """Raise TooFewModes if a ratio of prestress to stiffness is too large; warn if one is large."""
    too_large = prestress_ratios > MAX_PRESTRESS_OVER_STIFFNESS
    if too_large.any():
        raise TooFewModes(
            f"only {np.sum(~too_large)} of {len(buckling_factors)} factors are of buckling: at "
            "the factor "
            f"{buckling_factors[too_large][0]:.4g} the prestress is "
            f"{prestress_ratios[too_large][0]:.3g} times the "
            "stiffness, and no body is elastic there. Either the load pulls where it should press "
            "(then reverse it), or fewer modes have to be asked for"
        )
    if prestress_ratios.max() > WARNING_PRESTRESS_OVER_STIFFNESS:
        worst = int(np.argmax(prestress_ratios))
        warning = (
            f"at the buckling factor {buckling_factors[worst]:.4g} the prestress is "
            f"{prestress_ratios[worst]:.2g} "
            "times the stiffness: strains are far from small, and the factor means little. Look "
            "at the sign of the load"
        )
        log_on_root(comm, logging.WARNING, warning, ".eigen")


@dataclass(frozen=True)
class _EigenmodeRequest:
    """Arguments that `vibration_modes` and `buckling` have in common."""

    reduction: Reduction
    count: int
    symmetrised: bool
    solver: SolverOrAuto

    def check_eigenproblem(self, K: PETSc.Mat, other_name: str, other_matrix: PETSc.Mat) -> None:
        """Raise an error if the arguments do not define an eigenvalue problem.

        Args:
            K: stiffness.
            other_name: name of the other matrix, used in error messages.
            other_matrix: the other matrix, mass or initial stress.
        """
        pair, reductions = {"the stiffness": K, other_name: other_matrix}, (self.reduction,)
        check_problem(pair, reductions=reductions, solver=self.solver)
        arguments.check_integer("count", self.count, 1)
        arguments.check_flag("symmetrised", self.symmetrised)
        refuse_negative_displacement_block_trace("the stiffness", K, self.reduction.space)

    def compute_with_chosen_solver_or_direct_fallback(
        self, compute_modes: Callable[[LinearSolver], BucklingOrVibrationModes]
    ) -> BucklingOrVibrationModes:
        """Return `compute_modes(solver)` for the requested solver or the choice of "auto".

        If the choice of "auto" fails, `Direct()` is used instead.
        """
        reason = "a symmetrised pair needs its pivots counted" if self.symmetrised else ""
        space, supports = self.reduction.space, self.reduction.supports
        if self.symmetrised and space is not None and is_hybrid(space):
            raise ValueError(
                "a pair of hybrid spaces has no symmetrised twin: it is never definite"
            )
        choice = choose_solver(self.solver, supports, reason, for_modes=True)
        return compute_with_direct_fallback(choice, self.solver, supports, compute_modes)

    def reduce_matrix_pair(
        self, A: PETSc.Mat, B: PETSc.Mat, solver: LinearSolver
    ) -> tuple[PETSc.Mat, PETSc.Mat, Reduction]:
        """Return the matrices A and B of A d = mu B d under the supports, and their reduction.

        For a matrix-free solver, A keeps its size and is zero in the rows and columns of prescribed
        unknowns, and B is a copy without supports.
        """
        reduction = scale_pressures_to_displacements(self.reduction, B)
        if has_separate_supports(solver):
            reduction = full_size_masking_reduction(reduction)
            return reduction.matrix(A), B.copy(), reduction
        A, B = reduction.matrix(A), reduction.matrix(B)
        if self.symmetrised:
            A, B = symmetric_part(A), symmetric_part(B)
        return A, B, reduction


def _compute_modes_of_largest_eigenvalues(
    A: PETSc.Mat,
    B: PETSc.Mat,
    reduction: Reduction,
    request: _EigenmodeRequest,
    solver: LinearSolver,
    is_B_shifted: bool,
) -> tuple[npt.NDArray[np.complex128], list[PETSc.Vec], Array, SolverReport]:
    """Compute the eigenvalues mu of A d = mu B d with the largest real parts.

    Args:
        A: reduced matrix (n_r, n_r).
        B: reduced matrix (n_r, n_r), or the matrix without supports for a matrix-free solver.
        reduction: reduction of both matrices.
        request: number of modes, and whether the matrices are symmetrised.
        solver: solver of systems with B.
        is_B_shifted: whether B contains a shift, which makes it regular even if rigid motions are
            free.

    Returns:
        The eigenvalues mu (count,); the modes d as vectors of all unknowns; the relative residuals
        (count,); and the solver's report. For a complex pair of eigenvalues, the modes are the real
        and the imaginary part of one eigenvector.
    """
    count = request.count
    if count > A.getSize()[0]:
        raise TooFewModes(
            f"{count} eigenvalues of {A.getSize()[0]} degrees of freedom are asked for"
        )
    inverse: PreparedSolver
    if isinstance(solver, Iterative):
        inverse = krylov = solver.prepare(B, request.symmetrised, reduction.supports)
        if is_B_shifted:
            krylov.preconditioner.set_up_levels()
        else:
            with reraise_singular_system_with_cause():
                krylov.set_up()
        B = krylov.operator
    else:
        option_names = {name.lstrip("-") for name in getattr(solver, "options", ())}
        uses_mumps = isinstance(solver, Direct) and "pc_factor_mat_solver_type" not in option_names
        use_ldl = request.symmetrised or (uses_mumps and _is_nearly_symmetric(B))
        inverse = factorise(B, use_ldl, solver, reduction)
    if request.symmetrised:
        _require_positive_definite(inverse)
    from slepc4py import SLEPc  # only eigenvalue problems need this library

    eigensolver = SLEPc.EPS().create(A.comm)
    eigensolver.setOperators(A, B)
    kind = SLEPc.EPS.ProblemType
    eigensolver.setProblemType(kind.GHEP if request.symmetrised else kind.GNHEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    with_spares, size = count + _N_EXTRA_CONVERGED_EIGENVALUES, A.getSize()[0]
    n_converged = with_spares if is_B_shifted or count > 1 else count
    n_vectors = max(2 * with_spares, with_spares + 15)
    eigensolver.setDimensions(nev=min(n_converged, size), ncv=min(n_vectors, size))
    eigensolver.setTolerances(_EIGENSOLVER_RELATIVE_TOLERANCE, _MAX_EIGENSOLVER_ITERATIONS)
    start, comm = perf_counter(), A.comm.tompi4py()
    eigensolver.getST().setKSP(inverse.ksp)
    task = f"{count} eigenvalues of {A.getSize()[0]} unknowns"
    try:
        with report_activity(comm, task):
            eigensolver.solve()
    except PETSc.Error as error:
        raise TooFewModes(f"the eigenvalue solver broke down: {error}") from error
    steps, method = eigensolver.getIterationNumber(), inverse.report.method
    summary = f"{task}: {steps} iterations, {method}, {perf_counter() - start:.2f} s"
    log_on_root(comm, logging.INFO, summary, ".eigen")
    if eigensolver.getConverged() < count:
        raise TooFewModes(
            f"only {eigensolver.getConverged()} of {count} eigenvalues converged "
            f"in {steps} iterations"
        )
    values, residuals, modes = np.empty(count, dtype=complex), np.empty(count), []
    for i in range(count):
        real, imaginary = B.createVecRight(), B.createVecRight()
        values[i] = eigensolver.getEigenpair(i, real, imaginary)
        residuals[i] = _relative_mode_residual(A, B, values[i], real, imaginary)
        modes.append(
            _expand_and_normalise_mode(reduction, imaginary if values[i].imag < 0 else real)
        )
    eigensolver.destroy()
    if (
        has_separate_supports(solver)
        and not residuals.max() <= _MAX_RELATIVE_RESIDUAL_OF_ITERATIVE_MODES
    ):
        raise NotConverged(
            f"{inverse.report.method} left a mode with the residual {residuals.max():.1e}: use "
            "Direct(), or raise ksp_max_it"
        )
    return values, modes, residuals, inverse.report


def _is_nearly_symmetric(
    matrix: PETSc.Mat, relative_tolerance: float = _MAX_RELATIVE_ASYMMETRY_FOR_LDL
) -> bool:
    """Return whether x.A y equals y.A x to a relative tolerance for random vectors x and y."""
    x, y, A_x, A_y = (matrix.createVecRight() for _ in range(4))
    begin, end = x.getOwnershipRange()
    random = np.random.default_rng(begin)
    for vector, image in ((x, A_x), (y, A_y)):
        vector.setArray(random.normal(size=end - begin))
        matrix.mult(vector, image)
    return bool(abs(x.dot(A_y) - y.dot(A_x)) <= relative_tolerance * A_y.norm() * x.norm())


def _require_positive_definite(factorisation: PreparedSolver) -> None:
    if factorisation.negative_pivots is None:
        raise ValueError(
            f"{factorisation.report.method} does not count negative pivots, without which a "
            "symmetrised "
            "pair is not known to be positive definite: use Direct() with MUMPS"
        )
    if factorisation.negative_pivots > 0:
        raise TooFewModes(
            "the symmetric part of the stiffness is not positive definite: on so coarse a mesh "
            "the symmetrised element is no stable one; refine the mesh"
        )


def _relative_mode_residual(
    A: PETSc.Mat, B: PETSc.Mat, mu: complex, real_part: PETSc.Vec, imaginary_part: PETSc.Vec
) -> float:
    """Return |A d - mu B d| / |mu B d|, the residual of the mode d = real + i imaginary."""
    A_d, B_d = ((X * real_part).array_r + 1j * (X * imaginary_part).array_r for X in (A, B))
    squares = np.array([np.sum(np.abs(x) ** 2) for x in (A_d - mu * B_d, mu * B_d)])
    difference, size = A.comm.tompi4py().allreduce(squares)
    return float(np.sqrt(difference / size))


def _expand_and_normalise_mode(reduction: Reduction, reduced_mode: PETSc.Vec) -> PETSc.Vec:
    """Return a mode as a vector of all unknowns, scaled so that its largest entry is 1."""
    mode = reduction.offset.duplicate()
    reduction.right.mult(reduced_mode, mode)  # prescribed displacements are zero in a mode
    lowest, highest = mode.min()[1], mode.max()[1]
    mode.scale(1 / (highest if abs(highest) >= abs(lowest) else lowest))
    return mode


@check_same_arguments_on_all_processes
def critical_step(K: PETSc.Mat, M: PETSc.Mat, reduction: Reduction) -> float:
    """Return the largest stable time step of central differences.

    It is 2 divided by the highest angular frequency.

    Args:
        K: symmetric stiffness (n, n), assembled without supports.
        M: mass (n, n), diagonal and positive.
        reduction: supports.

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite, a stiffness
            that is not symmetric or has negative eigenvalues, or a mass that is not diagonal and
            positive.
        TooFewModes: if the highest frequency is not found.
    """
    check_problem({"the stiffness": K, "the mass": M}, reductions=(reduction,))
    if not _is_nearly_symmetric(K, _MAX_RELATIVE_ASYMMETRY_FROM_ASSEMBLY):
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
    from slepc4py import SLEPc  # only eigenvalue problems need this library

    eigensolver = SLEPc.EPS().create(scaled.comm)
    eigensolver.setOperators(scaled)
    eigensolver.setProblemType(SLEPc.EPS.ProblemType.HEP)
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    eigensolver.setTolerances(_LARGEST_EIGENVALUE_RELATIVE_TOLERANCE, _MAX_LANCZOS_STEPS)
    eigensolver.solve()
    if eigensolver.getConverged() < 1:
        raise TooFewModes("the highest frequency, and with it the critical step, was not found")
    largest = eigensolver.getEigenvalue(0).real
    # a rough estimate of the smallest eigenvalue suffices: a Ritz value is never below it
    eigensolver.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
    eigensolver.setTolerances(_SMALLEST_EIGENVALUE_TOLERANCE_OVER_NORM, _MAX_LANCZOS_STEPS)
    eigensolver.setConvergenceTest(SLEPc.EPS.Conv.NORM)
    eigensolver.solve()
    least = eigensolver.getEigenvalue(0).real if eigensolver.getConverged() else 0.0
    eigensolver.destroy()
    if least < -_NEGATIVE_EIGENVALUE_ROUND_OFF_OVER_LARGEST * abs(largest):
        raise ValueError(
            f"the stiffness over the mass has the eigenvalue {least:.3g}, the largest being "
            f"{largest:.3g}: a body's are not negative; look at the sign of its form"
        )
    if not 0 < largest < np.inf:
        raise TooFewModes(f"the largest eigenvalue of mass and stiffness is {largest:.6g}")
    return float(2 / np.sqrt(largest))


def extract_diagonal_mass(M: PETSc.Mat) -> PETSc.Vec:
    """Return the diagonal (n,) of a lumped mass matrix.

    Args:
        M: mass (n, n).

    Raises:
        ValueError: if the matrix is not diagonal, or an entry is not positive.
    """
    mass = M.getDiagonal()
    indptr, column, value = M.getValuesCSR()
    row = np.repeat(np.arange(*M.getOwnershipRange()), np.diff(indptr))
    with raise_errors_on_all_processes(M.comm.tompi4py()):
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
