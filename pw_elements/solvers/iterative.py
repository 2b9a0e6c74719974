"""Krylov method with two-level p-multigrid as the preconditioner.

For hybrid bodies, multigrid is part of a block-triangular preconditioner.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array, Indices
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    defer_errors_if_parallel,
    raise_errors_on_all_processes,
)
from pw_elements.solvers.block_triangular import BlockTriangularPreconditioner
from pw_elements.solvers.direct import (
    NotConverged,
    PetscOptions,
    PreparedSolver,
    SingularSystem,
    SolverReport,
    check_petsc_options,
    name_options_in_errors,
    refuse_unused_options,
    set_options,
)
from pw_elements.solvers.matrices import Supports, destroy_objects
from pw_elements.solvers.multigrid import Multigrid
from pw_elements.solvers.rigid_components import has_free_rigid_motion
from pw_elements.spaces import is_hybrid

_ArrayToArrayFunction: TypeAlias = Callable[[Array], Array]
# Takes (product, precondition, rhs, max_residual), returns x: |rhs - product(x)| <= max_residual
_UserKrylovSolveFunction: TypeAlias = Callable[
    [_ArrayToArrayFunction, _ArrayToArrayFunction, Array, float], Array
]

ITERATIVE_NEEDS_SUPPORTS_MESSAGE = (
    "Iterative() solves under the supports of Reduction.dirichlet alone: static condensation and "
    "other reductions, and a pressure that is split, need Direct()"
)

# Options that would replace the two levels, and are therefore refused
_LEVEL_REPLACING_OPTIONS_PATTERN = re.compile(
    r"-?(pc_type|pc_mg_levels|mg_levels_(1_)?(pc_type|ksp_type))"
)
_MAX_KRYLOV_ITERATIONS = 1000
# Vectors that GMRES keeps until it restarts
_GMRES_RESTART = 100
# The vectors are orthogonalised again if needed: orthogonality is lost if stiffnesses differ by a
# factor of more than 1e5. Entries of the coarse matrix that are zero connect no nodes of aggregates
_DEFAULT_OPTIONS: PetscOptions = {
    "ksp_converged_maxits": True,
    "ksp_gmres_cgs_refinement_type": "refine_ifneeded",
    "mg_coarse_pc_gamg_threshold": 0.0,
}
# Largest ratio of the true residual to the residual that the method updates
_MAX_TRUE_OVER_UPDATED_RESIDUAL = 10
_MACHINE_EPSILON = float(np.finfo(float).eps)

# Memory of MUMPS' LU factors and work space in three dimensions: a coefficient times a power of the
# number of unknowns. Coefficient and exponent are fitted to the memory that MUMPS reports for
# blocks of tetrahedra and hexahedra with 8 000 to 92 000 unknowns
_FACTOR_MEMORY_COEFFICIENT_IN_BYTES = 160.0
_FACTOR_MEMORY_EXPONENT_OF_DOFS = 1.42


@dataclass(frozen=True)
class Iterative:
    """Right-preconditioned GMRES with two-level p-multigrid, for quadratic elements.

    The coarse level has the stiffness of linear elements, P^T K P, where K is the stiffness and P
    interpolates linear functions at all nodes. It is solved approximately by one cycle of algebraic
    multigrid that knows the rigid motions. The smoother treats the unknowns of a node as a block.

    At a Poisson's ratio of 0.3, ten digits take about 25 iterations for any size of the mesh. Near
    1/2 they take several times as many; in hybrid spaces about 50 iterations are enough at any
    ratio. The solver accepts the supports of `Reduction.dirichlet`, but no condensation. It
    does not compute determinants.

    Args:
        tolerance: largest Euclidean norm of the residual, relative to that of the load. In contact,
            the tolerance is relative to the largest nodal contact force and at most 1e-10, a tenth
            of the tolerance of the contact law.
        options: PETSc options without prefix and hyphen, such as
            `{"mg_levels_1_ksp_max_it": 4, "mg_coarse_pc_gamg_threshold": 0.02}`. The option
            `ksp_type` sets the method, and `ksp_max_it` its number of iterations. The two levels
            cannot be replaced.

    Raises:
        TypeError, ValueError: for a tolerance that is not between 0 and 1, or for invalid options;
            at the first solution, for options that are not used.
    """

    matrix_free: ClassVar[bool] = True
    tolerance: float = 1e-11
    options: PetscOptions = field(default_factory=dict)

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        if not 0 < arguments.check_finite_number("tolerance", self.tolerance) < 1:
            raise ValueError(f"tolerance = {self.tolerance}: has to lie between 0 and 1")
        check_petsc_options(self.options)
        for name, value in self.options.items():
            replaces_method = value in ("preonly", "none") and "ksp_type" in name
            if _LEVEL_REPLACING_OPTIONS_PATTERN.fullmatch(name) or replaces_method:
                raise ValueError(
                    f"option {name} = {value}: what Iterative() is made of cannot be exchanged; "
                    "Direct() has factors, mg_coarse_ the coarse level's own options"
                )

    @check_same_arguments_on_all_processes
    def prepare(
        self, matrix: PETSc.Mat, symmetric: bool = False, supports: Supports | None = None
    ) -> "KrylovSolver":
        """Return a solver for a matrix under supports.

        Args:
            matrix: matrix (n, n) without supports.
            symmetric: whether an eigenvalue problem needs a symmetric solver.
            supports: free unknowns of a reduction made by `Reduction.dirichlet`.

        Raises:
            ValueError: if `supports` is None, or if `symmetric` is true.
        """
        if supports is None:
            raise ValueError(ITERATIVE_NEEDS_SUPPORTS_MESSAGE)
        arguments.check_type("supports", supports, Supports, "a reduction's `supports` are some")
        arguments.check_flag("symmetric", symmetric)
        with raise_errors_on_all_processes(supports.space.mesh.comm):
            arguments.check_assembled_square_matrix("the matrix", matrix)
        if symmetric:
            raise ValueError(
                "Iterative() does not count negative pivots, without which a symmetrised pair is "
                "not known to be positive definite: use Direct()"
            )
        with name_options_in_errors(self.options):
            return KrylovSolver(matrix, supports, self)


class KrylovSolver:
    """Iterative solver of systems with one matrix (n, n) under supports.

    Right-hand sides and solutions contain all n unknowns, including prescribed ones. The attribute
    `displacement_block` contains the stiffness of the displacements, assembled without supports,
    and the supports.
    """

    determinant_signs: ClassVar[tuple[int, ...]] = ()  # determinants and pivots are unknown
    negative_pivots: ClassVar[None] = None

    def __init__(
        self,
        matrix: PETSc.Mat,
        supports: Supports,
        settings: Iterative,
        external_iterate: _UserKrylovSolveFunction | None = None,
    ) -> None:
        self._matrix, self._external_iterate = matrix, external_iterate
        self.tolerance, self.options = settings.tolerance, settings.options
        self.uses_external_method = external_iterate is not None
        self._counted: list[int] = []  # iterations counted in each call of PETSc's monitor
        self._stiffness_norm = -1, 0.0  # state of the matrix, and its norm in that state
        blocks = (
            BlockTriangularPreconditioner(matrix, supports) if is_hybrid(supports.space) else None
        )
        self.block_preconditioner = blocks
        self.displacement_block = blocks.displacement_block if blocks else (matrix, supports)
        self.multigrid = blocks.multigrid if blocks else Multigrid(matrix, supports)
        self.preconditioner: Multigrid | BlockTriangularPreconditioner = blocks or self.multigrid
        self.operator = self.preconditioner.operator
        self.ksp = self._create_ksp(self.operator, "gmres")
        # the levels of multigrid take over the prefix
        self.preconditioner.configure_petsc_pc(self.ksp.getPC())
        self.ksp.getPC().setFromOptions()
        triangle = " in a block triangle" if blocks else ""
        self._method = f"{self.ksp.getType().upper()} with p-multigrid{triangle}"

    def create_flexible_ksp(self, operator: PETSc.Mat, preconditioner: object | None) -> PETSc.KSP:
        """Return a flexible Krylov method for a few iterations with another matrix.

        The method stores preconditioned vectors, which saves one application of the preconditioner.

        Args:
            operator: matrix of the system.
            preconditioner: Python context of the preconditioner. If None, the preconditioner of
                this solver is used.
        """
        ksp = self._create_ksp(operator, "fgmres")
        if preconditioner is None:
            ksp.setPC(self.ksp.getPC())
            ksp.setOperators(operator, self.operator)
        else:
            ksp.getPC().setType("python")
            ksp.getPC().setPythonContext(preconditioner)
        return ksp

    def release(self) -> None:
        destroy_objects(self.ksp, self.operator)
        self.preconditioner.release()

    def _create_ksp(self, operator: PETSc.Mat, method: str) -> PETSc.KSP:
        ksp = PETSc.KSP().create(operator.comm)
        ksp.setOperators(operator)
        if self._external_iterate is not None:
            ksp.setType("python")
            ksp.setPythonContext(_ExternalKrylovMethod(self._external_iterate))
            return ksp
        ksp.setType(method)
        ksp.setGMRESRestart(_GMRES_RESTART)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=self.tolerance, atol=0.0, max_it=_MAX_KRYLOV_ITERATIONS)
        ksp.setComputeEigenvalues(True)
        counted = self._counted  # `self` would create a reference cycle that is never freed
        ksp.setMonitor(lambda _, iteration, __: counted.append(int(iteration > 0)))
        # PETSc raises no error; `solve` checks the residual instead
        set_options(ksp, {**_DEFAULT_OPTIONS, **self.options})
        return ksp

    @property
    def report(self) -> SolverReport:
        return SolverReport(self._method, 0, sum(self._counted))

    def set_up(self) -> None:
        """Set up the levels of multigrid.

        Raises:
            SingularSystem: if supports and stiffness leave a rigid motion free.
        """
        if has_free_rigid_motion(*self.displacement_block):
            raise SingularSystem("the system matrix is singular")
        self.preconditioner.set_up_levels()

    def solve(self, rhs: PETSc.Vec) -> PETSc.Vec:
        """Return the solution (n,).

        Args:
            rhs: right-hand side (n,), zero where values are prescribed.

        Raises:
            SingularSystem: if supports and stiffness leave a rigid motion free.
            NotConverged: if the residual remains too large.
        """
        self.set_up()
        solution, correction = rhs.duplicate(), rhs.duplicate()
        residual, load_norm = rhs.copy(), rhs.norm()
        # because of round-off, the residual that GMRES updates drifts away from the true residual
        for _ in range(2):
            solve_with_ksp(self.ksp, residual, correction, self.options)
            solution.axpy(1.0, correction)
            self.operator.mult(solution, residual)
            residual.aypx(-1.0, rhs)
            residual_norm = residual.norm()
            if residual_norm <= self.tolerance * load_norm:
                break
        round_off = self.residual_round_off(solution.norm())
        if (
            not residual_norm
            <= _MAX_TRUE_OVER_UPDATED_RESIDUAL * self.tolerance * load_norm + round_off
        ):
            raise self.make_not_converged_error(residual_norm / load_norm)
        return solution

    def residual_round_off(self, solution_norm: float) -> float:
        """Return the residual that round-off may cause if a solution has the given norm."""
        matrix = self.displacement_block[0]
        if self._stiffness_norm[0] != matrix.stateGet():
            self._stiffness_norm = matrix.stateGet(), matrix.norm(PETSc.NormType.INFINITY)
        return float(
            _MAX_TRUE_OVER_UPDATED_RESIDUAL
            * _MACHINE_EPSILON
            * self._stiffness_norm[1]
            * solution_norm
        )

    def make_not_converged_error(self, relative_residual: float) -> NotConverged:
        dofs = self._matrix.getSize()[0]
        return NotConverged(
            f"{self.report.method} left the relative residual {relative_residual:.1e} after "
            f"{sum(self._counted)} iterations in all: Poisson's ratio near 1/2, flat cells or "
            "supports that hardly hold make it slow; use Direct() "
            f"(some {estimate_factor_memory_in_bytes(dofs) / 1e9:.2g} GB in space), or raise "
            "ksp_max_it"
        )

    def solve_with_changed_rows(self, rhs: PETSc.Vec, rows: Indices) -> None:  # noqa: ARG002
        """Return None, since an iterative solver has no factors that could be corrected."""
        return


class _ExternalKrylovMethod:
    """Wrapper by which a `PETSc.KSP` calls the Krylov method of a user's solver."""

    def __init__(self, iterate: _UserKrylovSolveFunction) -> None:
        self._iterate = iterate
        self.error: BaseException | None = None  # PETSc would raise an error of its own instead

    def solve(self, ksp: PETSc.KSP, rhs: PETSc.Vec, solution: PETSc.Vec) -> None:
        comm, self.error = rhs.comm.tompi4py(), None

        def as_array_function(
            apply: Callable[[PETSc.Vec, PETSc.Vec], None],
        ) -> _ArrayToArrayFunction:
            x, y = rhs.duplicate(), rhs.duplicate()

            def apply_to_array(values: Array) -> Array:
                with raise_errors_on_all_processes(comm) as same:  # all processes iterate
                    same["the next step of iterate"] = apply.__name__
                    x.setArray(_check_local_vector_values(values, x))
                apply(x, y)
                return np.array(y.array_r)

            return apply_to_array

        product, precondition = (
            as_array_function(ksp.getOperators()[0].mult),
            as_array_function(ksp.getPC().apply),
        )
        max_residual = ksp.getTolerances()[1]
        try:
            with raise_errors_on_all_processes(comm):
                x = self._iterate(product, precondition, np.array(rhs.array_r), max_residual)
                solution.setArray(_check_local_vector_values(x, rhs))
        except BaseException as error:
            self.error = error
        ksp.setConvergedReason(PETSc.KSP.ConvergedReason.CONVERGED_ATOL)


def solve_with_ksp(
    ksp: PETSc.KSP, rhs: PETSc.Vec, solution: PETSc.Vec, options: PetscOptions
) -> None:
    """Solve with PETSc's or a user's Krylov method; raise errors that the user's method has met.

    Args:
        ksp: solver, with its matrix and preconditioner.
        rhs: right-hand side (n,).
        solution: vector (n,) that is set to the solution.
        options: options of the solver, named in error messages.
    """
    with name_options_in_errors(options):
        ksp.solve(rhs, solution)
    refuse_unused_options(ksp, options)
    if ksp.getType() == "python" and (error := ksp.getPythonContext().error):
        raise error


def _check_local_vector_values(values: Array, vector: PETSc.Vec) -> Array:
    layout = "it takes and gives this process' part of vectors (n,)"
    return arguments.check_user_function_values(
        "iterate", np.ravel(values), vector.array_r.shape, layout
    )


def as_krylov_solver(solver: PreparedSolver, matrix: PETSc.Mat, supports: Supports) -> KrylovSolver:
    """Return a `KrylovSolver` that uses the Krylov method of a matrix-free solver.

    A solver prepared by `Iterative` is returned unchanged. For a user's solver, a new
    `KrylovSolver` is created that calls the solver's method `iterate`.

    Args:
        solver: solver that a matrix-free `LinearSolver` has prepared.
        matrix: matrix (n, n) without supports.
        supports: free unknowns.

    Raises:
        TypeError: for a user's solver without a method `iterate`.
    """
    if isinstance(solver, KrylovSolver):
        return solver
    iterate = getattr(solver, "iterate", None)
    if not callable(iterate):
        raise TypeError(
            f"contact needs of a matrix-free solver what {type(solver).__name__} has not: a method "
            "iterate(product, precondition, rhs, max_residual), which returns an x"
        )
    return KrylovSolver(matrix, supports, Iterative(), iterate)


def estimate_factor_memory_in_bytes(n_dofs: int) -> float:
    """Return the estimated memory of LU factors in three dimensions, in bytes.

    The estimate is accurate to within a factor of two.

    Args:
        n_dofs: number of unknowns.
    """
    return float(_FACTOR_MEMORY_COEFFICIENT_IN_BYTES * n_dofs**_FACTOR_MEMORY_EXPONENT_OF_DOFS)
