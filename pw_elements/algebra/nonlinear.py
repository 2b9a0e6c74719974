"""Problems that are defined by a UFL residual, with piecewise-linear weight functions.

If test and trial space differ, DOLFINx's `LinearProblem` and `NonlinearProblem` remove the
prescribed columns of a matrix, but not the corresponding rows. As a result, the former returns
`inf`, and the latter fails. Here PETSc's SNES performs Newton's method, and Dirichlet conditions
are equations of the system, see the guide's page on theory ("Large strains").
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from ufl.algorithms import compute_form_data, expand_derivatives
from ufl.algorithms.check_arities import ArityMismatch

from pw_elements.algebra.problem_checks import check_solver_type, is_finite
from pw_elements.algebra.reduction import free_dofs_and_prescribed_values
from pw_elements.arrays import Array
from pw_elements.checks import (
    arguments,
    call_user_function,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import (
    Direct,
    LinearSolver,
    NotConverged,
    SingularSystem,
    has_separate_supports,
)
from pw_elements.spaces import (
    AssemblyRecord,
    Spaces,
    add_estimated_quadrature_degrees,
    add_sub_cell_quadrature_rules,
    compile_form,
    compile_tangent,
    has_discontinuous_pressure,
    is_hybrid,
    pressure_equilibration_scales,
)

# Newton's method has converged if the correction, relative to the largest value of u, is at most
# this. Since convergence is quadratic, the next correction would be round-off
_NEWTON_RELATIVE_CORRECTION_TOLERANCE = 1e-8
# Largest residual of a solution, relative to the norm of the tangent times that of u; and largest
# residual at which a point is accepted although the line search finds no better one
_RESIDUAL_TOLERANCE_OVER_TANGENT_TIMES_U = 1e-10
_RESIDUAL_ROUND_OFF_OVER_TANGENT_TIMES_U = 1e-14
_MAX_NEWTON_ITERATIONS = 25

# Values of PETSc's SNESConvergedReason; one of them has different names in different versions
_SNES_REASON_LINE_SEARCH_FAILED = -6
_RESIDUAL_NOT_FINITE_MESSAGE = "the residual is not finite"
_FAILURE_MESSAGE_BY_SNES_REASON = {
    -1: _RESIDUAL_NOT_FINITE_MESSAGE,
    -3: "the linear solver did not converge",
    -4: _RESIDUAL_NOT_FINITE_MESSAGE,
    -5: f"no convergence in {_MAX_NEWTON_ITERATIONS} iterations",
    _SNES_REASON_LINE_SEARCH_FAILED: "no step along Newton's direction helps",
}

LoadSetterOrConstants: TypeAlias = Callable[[float], None] | fem.Constant | Sequence[fem.Constant]

# Largest number of substeps into which an increment is divided
_MAX_SUBSTEPS_PER_INCREMENT = 16


@dataclass(frozen=True)
class SolvedIncrement:
    """Load and convergence of an increment, or of a substep of an increment, that was solved.

    Args:
        load_factor: fraction of the load that is applied at the end of the increment, in (0, 1].
        relative_corrections: for each iteration, the largest change of a nodal value divided by the
            largest nodal value.
    """

    load_factor: float
    relative_corrections: tuple[float, ...]


class ResidualSystem:
    """Compiled residual and tangent, which are assembled at the current values of the unknown u.

    Args:
        u: the unknown function.
        residual: compiled residual.
        tangent: compiled forms whose sum is the tangent. The sparsity pattern of the first one
            contains those of the others.
    """

    def __init__(self, u: fem.Function, residual: fem.Form, tangent: Sequence[fem.Form]) -> None:
        self.u, self._residual_form, self._tangent_forms = u, residual, tangent
        self._blocked = False

    @property
    def blocked(self) -> bool:
        """Whether the tangent is stored in blocks of nodes; it is created again if this changes."""
        return self._blocked

    @blocked.setter
    def blocked(self, blocked: bool) -> None:
        if blocked != self._blocked:
            self.__dict__.pop("tangent", None)
        self._blocked = blocked

    @cached_property
    def tangent(self) -> PETSc.Mat:
        nodal = not is_hybrid(self.u.function_space) and self.u.function_space.dofmap.bs > 1
        first_form = self._tangent_forms[0]
        matrix = petsc.create_matrix(first_form, "baij" if self.blocked and nodal else None)
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return AssemblyRecord(first_form).attach(matrix)

    def set_unknowns(self, x: PETSc.Vec) -> None:
        self.u.x.array[: x.getLocalSize()] = x.array_r
        self.u.x.scatter_forward()

    def assemble_residual(self) -> PETSc.Vec:
        forces = petsc.assemble_vector(self._residual_form)
        forces.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        return AssemblyRecord(self._residual_form).attach(forces)

    def assemble_tangent(self) -> None:
        self.tangent.zeroEntries()
        for form in self._tangent_forms:
            petsc.assemble_matrix(self.tangent, form)
        self.tangent.assemble()


class NewtonSolver:
    """Newton's method for a single solution of a system.

    Args:
        system: compiled residual and tangent. The unknown u of the system contains the initial
            guess, and is replaced by the solution.
        fixed: local numbers (k,) of the prescribed unknowns that this process owns.
        prescribed: vector (n,) that contains the prescribed values of these unknowns.
        is_linear: whether the residual is linear in u.
        solver: solver of the linear systems with the tangent.
    """

    def __init__(
        self,
        system: ResidualSystem,
        fixed: npt.NDArray[np.integer],
        prescribed: PETSc.Vec,
        is_linear: bool,
        solver: LinearSolver,
    ) -> None:
        self._system, self._fixed, self._is_linear = system, fixed, is_linear
        self._fixed_rows = (prescribed.getOwnershipRange()[0] + fixed).astype(PETSc.IntType)
        self._x = prescribed.duplicate()
        self._x.setArray(system.u.x.array[: self._x.getLocalSize()])
        self.relative_corrections: list[float] = []
        self._singular_tangent: SingularSystem | None = None
        system.assemble_tangent()
        for name, values in (
            ("the tangent", system.tangent),
            ("the residual", system.assemble_residual()),
        ):
            norm = values.norm(PETSc.NormType.INFINITY)
            if np.isfinite(norm):  # otherwise the iteration reports where it is infinite
                arguments.check_magnitude(f"{name} at the start", norm)
        self._scale = pressure_equilibration_scales(system.u.function_space, system.tangent)
        system.tangent.diagonalScale(self._scale, self._scale)
        self._x.pointwiseDivide(self._x, self._scale)
        self._prescribed = prescribed.duplicate()
        self._prescribed.pointwiseDivide(prescribed, self._scale)
        self._previous_x = self._x.copy()
        diagonal = system.tangent.getDiagonal()
        # factor of the Dirichlet conditions, which are equations of the system
        self._mean_stiffness = diagonal.norm(PETSc.NormType.NORM_1) / diagonal.getSize() or 1.0
        self._tangent_norm = 0.0
        self._prepared = solver.prepare(system.tangent)

    def solve(self) -> None:
        """Solve for the unknown u of the system; its values are undefined after an error.

        Raises:
            NotConverged: if the iteration does not converge.
            SingularSystem: if a tangent is singular.
        """
        snes = PETSc.SNES().create(self._prescribed.comm)
        snes.setFunction(self._evaluate_scaled_equations, self._prescribed.duplicate())
        snes.setJacobian(self._assemble_and_factorise_tangent, self._system.tangent)
        snes.setType("newtonls")
        snes.setKSP(self._prepared.ksp)
        snes.setTolerances(max_it=_MAX_NEWTON_ITERATIONS)
        snes.setConvergenceTest(self._test_convergence)
        try:
            snes.solve(None, self._x)
            self._set_unscaled_unknowns(self._x)
            self._raise_unless_converged(snes)
        except PETSc.Error:
            if self._singular_tangent:
                raise self._singular_tangent from None
            raise
        finally:
            snes.destroy()  # this also resets the KSP
            self._prepared.release()

    def _set_unscaled_unknowns(self, scaled_x: PETSc.Vec) -> None:
        values = scaled_x.duplicate()
        values.pointwiseMult(scaled_x, self._scale)
        self._system.set_unknowns(values)

    def _evaluate_scaled_equations(
        self, _: PETSc.SNES, scaled_x: PETSc.Vec, out: PETSc.Vec
    ) -> None:
        self._set_unscaled_unknowns(scaled_x)
        forces = self._system.assemble_residual().array_r * self._scale.array_r
        deviation = scaled_x.array_r[self._fixed] - self._prescribed.array_r[self._fixed]
        forces[self._fixed] = self._mean_stiffness * deviation
        out.setArray(forces)

    def _assemble_and_factorise_tangent(
        self, _: PETSc.SNES, scaled_x: PETSc.Vec, *__: PETSc.Mat
    ) -> None:
        self._set_unscaled_unknowns(scaled_x)
        self._system.assemble_tangent()
        self._system.tangent.diagonalScale(self._scale, self._scale)
        self._system.tangent.zeroRows(self._fixed_rows, diag=self._mean_stiffness)
        self._tangent_norm = self._system.tangent.norm(PETSc.NormType.INFINITY)
        try:
            self._prepared.set_up()
        except SingularSystem as error:
            self._singular_tangent = error  # PETSc's own error would hide the reason
            raise

    def _test_convergence(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        x, residual = snes.getSolution(), norms[2]
        if iteration:
            self._previous_x.aypx(-1.0, x)
            relative = _max_norm_or_nan(self._previous_x) / (_max_norm_or_nan(x) or 1.0)
            self.relative_corrections.append(relative)
            words = f"iteration {iteration}: correction {relative:.1e}, residual {residual:.1e}"
            log_on_root(x.comm, logging.DEBUG, words, ".problems")
        x.copy(self._previous_x)
        is_small = iteration and (
            self._is_linear
            or self.relative_corrections[-1] <= _NEWTON_RELATIVE_CORRECTION_TOLERANCE
        )
        if residual == 0 or (
            is_small and self._relative_residual(snes) <= _RESIDUAL_TOLERANCE_OVER_TANGENT_TIMES_U
        ):
            return PETSc.SNES.ConvergedReason.CONVERGED_SNORM_RELATIVE
        return None

    def _raise_unless_converged(self, snes: PETSc.SNES) -> None:
        reason = snes.getConvergedReason()
        if (
            reason == _SNES_REASON_LINE_SEARCH_FAILED
            and self._relative_residual(snes) <= _RESIDUAL_ROUND_OFF_OVER_TANGENT_TIMES_U
        ):
            return
        if reason <= 0:
            message = _FAILURE_MESSAGE_BY_SNES_REASON.get(
                reason, f"SNES stopped with the reason {reason}"
            )
            raise NotConverged(message)

    def _relative_residual(self, snes: PETSc.SNES) -> float:
        residual = _max_norm_or_nan(snes.getFunction()[0])
        scale = self._tangent_norm * _max_norm_or_nan(snes.getSolution())
        return 0.0 if residual == 0 else residual / (scale or np.nan)


def _max_norm_or_nan(x: PETSc.Vec) -> float:
    """Return the largest absolute value of a vector, or NaN if a value is not finite.

    PETSc's maximum norm may miss such values.
    """
    return float(x.norm(PETSc.NormType.INFINITY)) if is_finite(x) else np.nan


class PetrovGalerkinProblem:
    """Linear or nonlinear problem F(u; v) = 0 for all weights v, with Dirichlet conditions.

    PETSc performs Newton's method with its backtracking line search. The tangent is UFL's
    derivative of the residual, integrated at the residual's quadrature points. An example is
    -div((1 + u^2) grad u) = 10 with u = 0 on the boundary:

        V = fem.functionspace(mesh, ("Lagrange", 2))
        u, v = fem.Function(V), ufl.TestFunction(test_space(V))
        F = ufl.inner((1 + u**2) * ufl.grad(u), ufl.grad(v)) * ufl.dx - 10.0 * v * ufl.dx
        mesh.topology.create_connectivity(1, 2)
        rim = fem.locate_dofs_topological(V, 1, exterior_facet_indices(mesh.topology))
        problem = PetrovGalerkinProblem(F, u, fem.dirichletbc(0.0, rim, V))
        problem.solve()

    Large loads are applied in increments. An increment is divided if Newton's method fails:

        depth = fem.Constant(mesh, -0.3)
        conditions = [prescribe(V, 1, top, depth), ...]
        PetrovGalerkinProblem(F, u, conditions).solve(depth, increments=4)

    Args:
        residual: the UFL form F, linear in a test function from `test_space(V)` or, for the
            standard element, from V. Set the quadrature degree of integrands that are not
            polynomials, since UFL's estimate is high.
        u: unknown function in the quadratic trial space V. It contains the initial guess, and is
            replaced by the solution.
        conditions: Dirichlet conditions on the space of u. The values of constants and functions in
            them may change between solutions.
        solver: solver of the linear systems; None for `Direct()`. `Iterative()` cannot be used.

    Attributes:
        u: the unknown function.
        increments: a `SolvedIncrement` for each increment or substep of the last `solve`.
        form: the residual, with a quadrature degree for each of its measures.
        system: the compiled residual and tangent.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a form that has no test function, does not contain u, is not linear in its
            test function, is defined on several meshes or cannot be compiled; for an iterative
            solver; and for a split pressure.
        DifferentNodeNumbering: if trial and test space number their nodes differently.
    """

    @check_same_arguments_on_all_processes
    def __init__(
        self,
        residual: ufl.Form,
        u: fem.Function,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC] = (),
        solver: LinearSolver | None = None,
    ) -> None:
        arguments.check_type("u", u, fem.Function, "fem.Function(V) is an unknown")
        arguments.check_type("the residual", residual, ufl.Form, "an integrand times a measure")
        check_solver_type(solver)
        if isinstance(solver, str) or has_separate_supports(solver):
            raise ValueError(
                'Iterative() and "auto" solve with one free matrix under supports, not with '
                "Newton's tangents: use Direct()"
            )
        self.u, self.increments = u, tuple[SolvedIncrement, ...]()
        self._space, self._conditions = u.function_space, conditions
        self._comm: MPI.Comm = self._space.mesh.comm
        if has_discontinuous_pressure(self._space):
            raise ValueError(
                "the pressure of this space is split, and no residual ties it: use "
                "Spaces.hybrid(mesh) without parts"
            )
        weights = residual.arguments()
        if [argument.number() for argument in weights] != [0]:
            raise ValueError(
                "the residual has no test function, of test_space(V), or more: u itself has to be "
                "in it, and no trial function"
            )
        Spaces(self._space, weights[0].ufl_function_space())
        try:
            form = add_estimated_quadrature_degrees(add_sub_cell_quadrature_rules(residual))
            compute_form_data(form)  # UFL checks here that all terms contain the weights
            tangent = expand_derivatives(ufl.derivative(form, u, ufl.TrialFunction(self._space)))
        except (Exception, ArityMismatch) as error:  # UFL's error is not an Exception
            raise ValueError(f"the residual is no form linear in its weights: {error}") from error
        if tangent.empty():
            raise ValueError("the residual does not depend on u: it has to be stated with u itself")
        self.form, self._is_linear = form, u not in tangent.coefficients()
        free_dofs_and_prescribed_values(
            self._space, conditions
        )  # raises an error for invalid conditions
        self.system = ResidualSystem(
            u, compile_form(form, 1, "a residual"), compile_tangent(tangent)
        )
        self._solver: LinearSolver = Direct() if solver is None else solver
        self._solved_loads: dict[fem.Constant, Array] = {}  # values at the end of the last `solve`

    @property
    def is_galerkin(self) -> bool:
        """Whether trial and test functions are the same."""
        (test_function,) = self.form.arguments()
        return bool(test_function.ufl_element() == self._space.ufl_element())

    @property
    def parts(self) -> "list[PetrovGalerkinProblem]":
        """The problem of each body that has a mesh of its own, which is this problem alone."""
        return [self]

    @check_same_arguments_on_all_processes
    def solve(self, load: LoadSetterOrConstants | None = None, increments: int = 1) -> fem.Function:
        """Solve for u, starting from the current values of u.

        Args:
            load: one or several `fem.Constant`s of the residual or the conditions. Over the
                increments, they change linearly from their values after the last `solve`, or from 0
                in the first call, to their current values. Alternatively, a function that sets the
                load for a given load factor (0 without load, 1 for the full load) and does not
                communicate. None for a load that is applied at once.
            increments: number of equal increments. An increment is divided if Newton's method
                fails.

        Returns:
            The problem's unknown function u.

        Raises:
            NotConverged: if no solution is found, even if increments are divided into small
                substeps. The unknown u and the load's constants are reset to those of the last
                solution.
            SingularSystem: if the tangent is singular; u and the constants are reset in the same
                way.
            TypeError, ValueError: for an invalid load, or for conditions that contradict each
                other or are not finite.
        """
        arguments.check_integer("increments", increments, 1)
        set_load = self._make_load_setter(load)
        n_parts, step, done = (
            increments * _MAX_SUBSTEPS_PER_INCREMENT,
            _MAX_SUBSTEPS_PER_INCREMENT,
            0,
        )
        self.increments = ()
        while done < n_parts:
            step = min(step, n_parts - done)
            if load is None:
                step = n_parts
            start_values = self.u.x.array.copy()
            load_factor = (done + step) / n_parts
            self._apply_load(set_load, load_factor)
            try:
                with report_activity(self._comm, f"load {load_factor:.3g}"):
                    self._solve_increment(load_factor)
            except (NotConverged, SingularSystem) as error:
                words = f"not from {done / n_parts:.4g} to {load_factor:.4g}: {error}"
                log_on_root(self._comm, logging.INFO, words, ".problems")
                self.u.x.array[:] = start_values
                self._apply_load(set_load, done / n_parts)
                if load is None or step == 1:
                    self._store_solved_load_values(load)
                    range_failed = done / n_parts, load_factor
                    message = _increment_failure_message(
                        error, load, range_failed, is_hybrid(self._space)
                    )
                    raise type(error)(message) from None
                step //= 2
                continue
            done += step
            step = min(2 * step, _MAX_SUBSTEPS_PER_INCREMENT)
        self._store_solved_load_values(load)
        return self.u

    @check_same_arguments_on_all_processes
    def reactions(self) -> PETSc.Vec:
        """Return the residual (n,); at prescribed nodes it is the force of supports on the body.

        If the residual is linear, this is K a - f for the stiffness K, the solution a and the load
        f, as computed by the function `reactions`.

        The sum of reactions and loads is zero. The sum of their moments, with nodal forces acting
        at deformed nodes, is exactly zero only with standard elements. With piecewise-linear weight
        functions and a smooth deformation, it decreases with the third power of the cell size if
        the moments of loads are computed from their densities, and with the second power if they
        are computed from nodal loads that act at deformed nodes.
        """
        return self.system.assemble_residual()

    def _make_load_setter(self, load: LoadSetterOrConstants | None) -> Callable[[float], None]:
        """Return a function that sets the load for a load factor, without communication."""
        if arguments.is_user_function(load):
            return load
        ranges = []
        for constant in _list_load_constants(load):
            end = np.array(constant.value)
            start = self._solved_loads.get(constant, np.zeros_like(end))
            ranges.append((constant, start, end))

        def interpolate(load_factor: float) -> None:
            for constant, start, end in ranges:
                constant.value[...] = start + load_factor * (end - start)

        return interpolate

    def _apply_load(self, set_load: Callable[[float], None], load_factor: float) -> None:
        with raise_errors_on_all_processes(self._comm) as same:
            call_user_function(self._comm, "the load", set_load, load_factor)
            same["what the residual and the conditions hold"] = (
                self.form.constants(),
                self._conditions,
            )

    def _store_solved_load_values(self, load: LoadSetterOrConstants | None) -> None:
        constants = _list_load_constants(load)
        self._solved_loads |= {constant: np.array(constant.value) for constant in constants}

    def _solve_increment(self, load_factor: float) -> None:
        """Solve for u under the current load; values of u are undefined after an error."""
        free, values = free_dofs_and_prescribed_values(self._space, self._conditions)
        fixed = np.flatnonzero(~free)
        newton = NewtonSolver(self.system, fixed, values, self._is_linear, self._solver)
        newton.solve()
        corrections = tuple(newton.relative_corrections)
        self.increments += (SolvedIncrement(load_factor, corrections),)
        words = f"load {load_factor:.4g}: {len(corrections)} iterations"
        log_on_root(self._comm, logging.INFO, words, ".problems")


def _list_load_constants(load: LoadSetterOrConstants | None) -> Sequence[fem.Constant]:
    if isinstance(load, fem.Constant):
        return [load]
    if load is None or arguments.is_user_function(load):
        return ()
    remedy = "give a fem.Constant, a list of these, or a function of the share"
    arguments.check_type("the load", load, Sequence, remedy)
    assert isinstance(load, Sequence)
    for constant in load:
        arguments.check_type("a load", constant, fem.Constant, remedy)
    return load


def _increment_failure_message(
    error: Exception,
    load: LoadSetterOrConstants | None,
    load_factor_range: tuple[float, float],
    has_pressure: bool,
) -> str:
    """Return the error message for an increment that fails and cannot be divided further.

    Args:
        error: error that the increment raised.
        load: load that the user has given.
        load_factor_range: load factors at the start and at the end of the increment.
        has_pressure: whether the trial space has pressure unknowns.
    """
    message = str(error)
    if isinstance(error, SingularSystem):
        message += ": conditions leave a motion free, or the solution branches here"
        if has_pressure:
            message += (
                ", or a body that they enclose has a pressure that is known up to a constant: "
                'prescribe(space, "pressure", where)'
            )
    if load is None:
        return (
            f"{message}; u is as before: start nearer to the solution, or give what makes the load "
            "as `load`, so that it can grow"
        )
    start, end = load_factor_range
    return f"{message}, from {start:.4g} to {end:.4g} of the load; u is the solution at {start:.4g}"
