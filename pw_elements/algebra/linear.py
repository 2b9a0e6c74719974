"""Solution of linear systems under a reduction, with an error for singular systems.

DOLFINx cannot apply Dirichlet conditions to a matrix if test and trial space differ. Here the
matrix is assembled without conditions, and a `Reduction` applies the conditions.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.algebra.problem_checks import check_problem
from pw_elements.algebra.reduction import (
    Reduction,
    full_size_masking_reduction,
    scale_pressures_to_displacements,
)
from pw_elements.checks import check_same_arguments_on_all_processes
from pw_elements.progress import report_activity
from pw_elements.solvers import (
    Direct,
    FreeConstantPressure,
    LinearSolver,
    PreparedSolver,
    SingularSystem,
    SolverOrAuto,
    choose_solver,
    collect_garbage,
    compute_with_direct_fallback,
    has_separate_supports,
)
from pw_elements.spaces import (
    CONSTANT_PRESSURE_ROUND_OFF_OVER_STIFFNESS,
    SubSpace,
    is_hybrid,
    read_record,
)


@check_same_arguments_on_all_processes
def solve(
    K: PETSc.Mat, f: PETSc.Vec, reduction: Reduction, solver: SolverOrAuto = None
) -> PETSc.Vec:
    """Solve K a = f under a reduction, and return the displacements a (n,).

    `a.getAttr("report")` returns the `SolverReport` of the solution.

    Args:
        K: stiffness (n, n), assembled without conditions.
        f: load (n,).
        reduction: supports, and static condensation.
        solver: `Direct()`, `Iterative()` or "auto" (also if None). "auto" uses `Iterative()` in
            three dimensions with 15 000 unknowns or more, and `Direct()` otherwise. If
            `Iterative()` fails and there is enough memory, "auto" uses `Direct()` instead and logs
            this.

    Raises:
        SingularSystem: if the reduced system has no unique solution.
        NotConverged: if an iterative solver does not reach its tolerance.
        TypeError, ValueError: for arguments that do not fit together or are not finite, or for a
            solver that does not support the reduction.
    """
    check_problem({"the stiffness": K}, None, {"the load": f}, (reduction,), solver=solver)
    choice = choose_solver(solver, reduction.supports)
    compute = partial(_solve_reduced_system, K, f, reduction)
    return compute_with_direct_fallback(choice, solver, reduction.supports, compute)


def _solve_reduced_system(
    K: PETSc.Mat, f: PETSc.Vec, reduction: Reduction, solver: LinearSolver
) -> PETSc.Vec:
    matrix: PETSc.Mat | None = None
    prepared: PreparedSolver
    if has_separate_supports(solver):
        reduction = scale_pressures_to_displacements(
            full_size_masking_reduction(reduction), K
        ).with_offset_for_load(K, f)
        prepared = solver.prepare(K, supports=reduction.supports)
    else:
        reduction = scale_pressures_to_displacements(reduction, K).with_offset_for_load(K, f)
        matrix = reduction.matrix(K)
        prepared = solver.prepare(matrix)
    load = reduction.load(K, f)
    try:
        with (
            reraise_singular_system_with_cause(matrix, reduction),
            _report_solver_activity(prepared, K),
        ):
            solution, report = prepared.solve(load), prepared.report
    finally:
        prepared.release()
        del prepared
        collect_garbage(K)
    full = reduction.expand(solution)
    full.setAttr("report", report)
    full.setAttr("mesh", read_record(K).mesh)  # copies of the vector need the mesh's communicator
    return full


@check_same_arguments_on_all_processes
def reactions(K: PETSc.Mat, a: PETSc.Vec, f: PETSc.Vec) -> PETSc.Vec:
    """Return the nodal forces r = K a - f (n,) that supports exert on the body.

    Args:
        K: stiffness (n, n), assembled without conditions.
        a: displacement (n,).
        f: load (n,).

    Raises:
        TypeError, ValueError: for arguments that do not fit together or are not finite.
    """
    check_problem({"the stiffness": K}, {"the displacement": a}, {"the load": f})
    return K * a - f


def has_free_constant_pressure(
    reduced_matrix: PETSc.Mat,
    reduction: Reduction,
    ignored_rows: npt.NDArray[np.integer] | None = None,
) -> bool:
    """Return whether a reduced matrix maps a constant pressure to zero.

    Such a matrix is singular: the pressure of a hybrid body is determined only up to a constant.

    Args:
        reduced_matrix: reduced matrix (n_r, n_r), or a larger one in which the n_r unknowns come
            first on each process.
        reduction: reduction of the matrix.
        ignored_rows: local numbers of rows that need not be zero.
    """
    if reduction.space is None or not is_hybrid(reduction.space):
        return False
    pressure = SubSpace.pressure(reduction.space)
    constant = reduction.offset.duplicate()
    constant.setArray(pressure.embed(np.ones(len(pressure.owned_unknowns))))
    unknown = reduced_matrix.createVecRight()
    reduction.right.multTranspose(constant, unknown)
    # pressures of several cells at a vertex may share one unknown
    unknown.setArray(np.array(unknown.array_r != 0, dtype=float))
    effect = reduced_matrix * unknown
    if ignored_rows is not None:
        effect.array[ignored_rows] = 0.0
    infinity = PETSc.NormType.INFINITY
    size = reduced_matrix.norm(infinity) * unknown.norm(infinity)
    return bool(
        size > 0 and effect.norm(infinity) <= CONSTANT_PRESSURE_ROUND_OFF_OVER_STIFFNESS * size
    )


def symmetric_part(matrix: PETSc.Mat) -> PETSc.Mat:
    """Return the symmetric part (A + A^T) / 2 of a matrix A.

    Args:
        matrix: square matrix A (n, n).
    """
    part = matrix + matrix.transpose(PETSc.Mat())
    part.scale(0.5)
    return read_record(matrix).attach(part)


def factorise(
    matrix: PETSc.Mat,
    symmetric: bool = False,
    solver: LinearSolver | None = None,
    reduction: Reduction | None = None,
) -> PreparedSolver:
    """Return a solver that has been prepared for a matrix and has factorised it.

    Args:
        matrix: regular matrix (n, n).
        symmetric: whether the matrix is symmetric.
        solver: linear solver; None for `Direct()`.
        reduction: reduction of the matrix, used to explain in the error message why the matrix is
            singular.

    Raises:
        SingularSystem: for a singular matrix.
    """
    prepared = (solver or Direct()).prepare(matrix, symmetric)
    try:
        with (
            reraise_singular_system_with_cause(matrix, reduction),
            _report_solver_activity(prepared, matrix),
        ):
            prepared.set_up()
    except SingularSystem:
        prepared.release()
        raise
    return prepared


@contextmanager
def reraise_singular_system_with_cause(
    matrix: PETSc.Mat | None = None, reduction: Reduction | None = None
) -> Iterator[None]:
    """Add the likely cause to a `SingularSystem` error that is raised within a `with` block.

    Args:
        matrix: the system's matrix, if it is known.
        reduction: reduction of the matrix, if it is known.
    """
    try:
        yield
    except FreeConstantPressure:
        raise
    except SingularSystem as error:
        if (
            matrix is not None
            and reduction is not None
            and has_free_constant_pressure(matrix, reduction)
        ):
            raise FreeConstantPressure from None
        raise SingularSystem(
            f"{error}: the supports leave a rigid motion free, a node has no stiffness, or the "
            "body is far too slender; add Dirichlet conditions"
        ) from None


def _report_solver_activity(
    prepared: PreparedSolver, matrix: PETSc.Mat
) -> AbstractContextManager[object]:
    task = f"{prepared.report.method} of {matrix.getSize()[0]} unknowns"
    return report_activity(matrix.comm.tompi4py(), task)
