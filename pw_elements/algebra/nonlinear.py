"""Problems stated by any UFL residual, with piecewise-linear weight functions.

Where test and trial space differ, DOLFINx's own `LinearProblem` and `NonlinearProblem` take the
prescribed columns out of a matrix but no rows: the first returns `inf`, the second fails. Newton's
method is PETSc's SNES; conditions are equations, see the guide's page on theory ("Large strains").
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

from pw_elements.algebra.problem_checks import check_solver, is_finite
from pw_elements.algebra.reduction import evaluate_conditions
from pw_elements.arrays import Array
from pw_elements.checks import (
    arguments,
    call_user_function,
    check_same_arguments,
    collective_errors,
)
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import Direct, LinearSolver, NotConverged, SingularSystem, is_matrix_free
from pw_elements.spaces import (
    AssemblyRecord,
    Spaces,
    add_estimated_degrees,
    add_sub_cell_rules,
    compile_form,
    equilibration_scale,
    has_split_pressure,
    is_hybrid,
)

# Newton's method is done with a correction below this, over the largest value of u: it is
# quadratic, and the next one would be round-off
_CORRECTION = 1e-8
# Largest residual of a solution, over the tangent's norm times that of u; a line search that finds
# nothing better has failed unless it is round-off
_RESIDUAL = 1e-10
_ROUND_OFF_RESIDUAL = 1e-14
_ITERATIONS = 25

# PETSc's SNESConvergedReason by number: one name has changed
_LINE_SEARCH = -6
_NOT_FINITE = "the residual is not finite"
_REASONS = {
    -1: _NOT_FINITE,
    -3: "the linear solver did not converge",
    -4: _NOT_FINITE,
    -5: f"no convergence in {_ITERATIONS} iterations",
    _LINE_SEARCH: "no step along Newton's direction helps",
}

Load: TypeAlias = Callable[[float], None] | fem.Constant | Sequence[fem.Constant]

# An increment is cut into so many parts at most
_MOST_PARTS = 16


@dataclass(frozen=True)
class SolvedIncrement:
    """The work that an increment took, or a part of one.

    Args:
        share: of the load, at its end.
        corrections: largest change of a nodal value in each iteration, over the largest value.
    """

    load_factor: float
    relative_corrections: tuple[float, ...]


class ResidualSystem:
    """Residual and tangent, compiled forms, at an unknown function, assembled in place."""

    def __init__(self, u: fem.Function, residual: fem.Form, tangent: fem.Form) -> None:
        self.u, self._residual_form, self._tangent_form = u, residual, tangent
        self.blocked = False  # whether the matrix is stored by nodes, see `assemble_matrix`

    @cached_property
    def tangent(self) -> PETSc.Mat:
        nodal = not is_hybrid(self.u.function_space) and self.u.function_space.dofmap.bs > 1
        matrix = petsc.create_matrix(self._tangent_form, "baij" if self.blocked and nodal else None)
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return AssemblyRecord(self._tangent_form).attach(matrix)

    def set_unknowns(self, x: PETSc.Vec) -> None:
        self.u.x.array[: x.getLocalSize()] = x.array_r
        self.u.x.scatter_forward()

    def assemble_residual(self) -> PETSc.Vec:
        forces = petsc.assemble_vector(self._residual_form)
        forces.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        return AssemblyRecord(self._residual_form).attach(forces)

    def assemble_tangent(self) -> None:
        self.tangent.zeroEntries()
        petsc.assemble_matrix(self.tangent, self._tangent_form)
        self.tangent.assemble()


class Newton:
    """One solution of a system, whose u is the start and holds the solution in the end.

    The prescribed unknowns, own local numbers (k,), are `fixed`; their values are in a vector (n,).
    """

    def __init__(
        self,
        system: ResidualSystem,
        fixed: npt.NDArray[np.integer],
        prescribed: PETSc.Vec,
        linear: bool,
        solver: LinearSolver,
    ) -> None:
        self._system, self._fixed, self._linear = system, fixed, linear
        self._rows = (prescribed.getOwnershipRange()[0] + fixed).astype(PETSc.IntType)
        self._x = prescribed.duplicate()
        self._x.setArray(system.u.x.array[: self._x.getLocalSize()])
        self.corrections: list[float] = []
        self._singular: SingularSystem | None = None
        system.assemble_tangent()
        for name, values in (
            ("the tangent", system.tangent),
            ("the residual", system.assemble_residual()),
        ):
            size = values.norm(PETSc.NormType.INFINITY)
            if np.isfinite(size):  # the iteration says where it is not
                arguments.check_magnitude(f"{name} at the start", size)
        self._scale = equilibration_scale(system.u.function_space, system.tangent)
        system.tangent.diagonalScale(self._scale, self._scale)
        self._x.pointwiseDivide(self._x, self._scale)
        self._prescribed = prescribed.duplicate()
        self._prescribed.pointwiseDivide(prescribed, self._scale)
        self._before = self._x.copy()
        diagonal = system.tangent.getDiagonal()
        # what makes equations of conditions
        self._stiffness = diagonal.norm(PETSc.NormType.NORM_1) / diagonal.getSize() or 1.0
        self._norm = 0.0
        self._prepared = solver.prepare(system.tangent)

    def solve(self) -> None:
        """Solves, or raises NotConverged or SingularSystem; u is worth nothing then."""
        snes = PETSc.SNES().create(self._prescribed.comm)
        snes.setFunction(self._equations, self._prescribed.duplicate())
        snes.setJacobian(self._linearised, self._system.tangent)
        snes.setType("newtonls")
        snes.setKSP(self._prepared.ksp)
        snes.setTolerances(max_it=_ITERATIONS)
        snes.setConvergenceTest(self._converged)
        try:
            snes.solve(None, self._x)
            self._take(self._x)
            self._judge(snes)
        except PETSc.Error:
            if self._singular:
                raise self._singular from None
            raise
        finally:
            snes.destroy()  # and with it resets the KSP
            self._prepared.release()

    def _take(self, x: PETSc.Vec) -> None:
        values = x.duplicate()
        values.pointwiseMult(x, self._scale)
        self._system.set_unknowns(values)

    def _equations(self, _: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self._take(x)
        forces = self._system.assemble_residual().array_r * self._scale.array_r
        off = x.array_r[self._fixed] - self._prescribed.array_r[self._fixed]
        forces[self._fixed] = self._stiffness * off
        out.setArray(forces)

    def _linearised(self, _: PETSc.SNES, x: PETSc.Vec, *__: PETSc.Mat) -> None:
        self._take(x)
        self._system.assemble_tangent()
        self._system.tangent.diagonalScale(self._scale, self._scale)
        self._system.tangent.zeroRows(self._rows, diag=self._stiffness)
        self._norm = self._system.tangent.norm(PETSc.NormType.INFINITY)
        try:
            self._prepared.set_up()
        except SingularSystem as error:
            self._singular = error  # PETSc has no words of its own for it
            raise

    def _converged(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        now, residual = snes.getSolution(), norms[2]
        if iteration:
            self._before.aypx(-1.0, now)
            self.corrections.append(_largest(self._before) / (_largest(now) or 1.0))
            correction = f"correction {self.corrections[-1]:.1e}, residual {residual:.1e}"
            log_on_root(
                now.comm, logging.DEBUG, f"iteration {iteration}: {correction}", ".problems"
            )
        now.copy(self._before)
        small = iteration and (self._linear or self.corrections[-1] <= _CORRECTION)
        if residual == 0 or (small and self._relative_residual(snes) <= _RESIDUAL):
            return PETSc.SNES.ConvergedReason.CONVERGED_SNORM_RELATIVE
        return None

    def _judge(self, snes: PETSc.SNES) -> None:
        reason = snes.getConvergedReason()
        if reason == _LINE_SEARCH and self._relative_residual(snes) <= _ROUND_OFF_RESIDUAL:
            return
        if reason <= 0:
            words = _REASONS.get(reason, f"SNES stopped with the reason {reason}")
            raise NotConverged(words)

    def _relative_residual(self, snes: PETSc.SNES) -> float:
        residual = _largest(snes.getFunction()[0])
        scale = self._norm * _largest(snes.getSolution())
        return 0.0 if residual == 0 else residual / (scale or np.nan)


def _largest(x: PETSc.Vec) -> float:
    """Largest size of an entry; NaN if one is not finite, over which PETSc's maximum may pass."""
    return float(x.norm(PETSc.NormType.INFINITY)) if is_finite(x) else np.nan


class PetrovGalerkinProblem:
    """F(u; v) = 0 for all weights v, linear in u or not, under Dirichlet conditions.

    Newton's method is PETSc's, with its backtracking line search; the tangent is UFL's derivative
    at the residual's own quadrature points. An example is -div((1 + u^2) grad u) = 10 with u = 0 on
    the boundary:

        V = fem.functionspace(mesh, ("Lagrange", 2))
        u, v = fem.Function(V), ufl.TestFunction(test_space(V))
        F = ufl.inner((1 + u**2) * ufl.grad(u), ufl.grad(v)) * ufl.dx - 10.0 * v * ufl.dx
        mesh.topology.create_connectivity(1, 2)
        rim = fem.locate_dofs_topological(V, 1, exterior_facet_indices(mesh.topology))
        problem = PetrovGalerkinProblem(F, u, fem.dirichletbc(0.0, rim, V))
        problem.solve()

    Large loads are applied in increments, which are divided where Newton's method fails:

        depth = fem.Constant(mesh, -0.3)
        conditions = [prescribe(V, 1, top, depth), ...]
        PetrovGalerkinProblem(F, u, conditions).solve(depth, increments=4)

    Args:
        residual: F, a UFL form linear in its test function, which `test_space` (or, for the
            standard element, the trial space) has. Set the quadrature degree of integrands that
            are not polynomials: UFL's estimate is high.
        u: unknown function in the quadratic trial space; it holds the initial guess, then the
            solution.
        conditions: Dirichlet conditions on its space; constants and functions in them may change.
        solver: of linear systems, by default `Direct()`; `Iterative()` cannot be used here.

    Attributes:
        u: the unknown.
        increments: of the last `solve`, with the work that each took.
        form: the residual, with the degrees of its measures.
        system: residual and tangent, compiled.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a form without a test function or without u, not linear in its weights, of
            several meshes, or that cannot be compiled; for an iterative solver or a split pressure.
        NumberingError: if trial and test space number their nodes differently.
    """

    @check_same_arguments
    def __init__(
        self,
        residual: ufl.Form,
        u: fem.Function,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC] = (),
        solver: LinearSolver | None = None,
    ) -> None:
        arguments.check_type("u", u, fem.Function, "fem.Function(V) is an unknown")
        arguments.check_type("the residual", residual, ufl.Form, "an integrand times a measure")
        check_solver(solver)
        if isinstance(solver, str) or is_matrix_free(solver):
            raise ValueError(
                'Iterative() and "auto" solve with one free matrix under supports, not with '
                "Newton's tangents: use Direct()"
            )
        self.u, self.increments = u, tuple[SolvedIncrement, ...]()
        self._space, self._conditions = u.function_space, conditions
        self._comm: MPI.Comm = self._space.mesh.comm
        if has_split_pressure(self._space):
            raise ValueError(
                "the pressure of this space is split, and no residual ties it: use "
                "Spaces.hybrid(mesh) without parts"
            )
        weights = residual.arguments()
        if [one.number() for one in weights] != [0]:
            raise ValueError(
                "the residual has no test function, of test_space(V), or more: u itself has to be "
                "in it, and no trial function"
            )
        Spaces(self._space, weights[0].ufl_function_space())
        try:
            form = add_estimated_degrees(add_sub_cell_rules(residual))
            compute_form_data(form)  # in which UFL looks whether all terms have the weights
            tangent = expand_derivatives(ufl.derivative(form, u, ufl.TrialFunction(self._space)))
        except (Exception, ArityMismatch) as error:  # UFL's is no Exception
            raise ValueError(f"the residual is no form linear in its weights: {error}") from error
        if tangent.empty():
            raise ValueError("the residual does not depend on u: it has to be stated with u itself")
        self.form, self._is_linear = form, u not in tangent.coefficients()
        evaluate_conditions(self._space, conditions)  # what is wrong is refused at once
        self.system = ResidualSystem(
            u, compile_form(form, 1, "a residual"), compile_form(tangent, 2, "a tangent")
        )
        self._solver: LinearSolver = Direct() if solver is None else solver
        self._held: dict[fem.Constant, Array] = {}

    @check_same_arguments
    def solve(self, load: Load | None = None, increments: int = 1) -> fem.Function:
        """Solves for u, starting from its present values.

        Args:
            load: what grows with the increments: `fem.Constant`s of the residual or conditions,
                which grow from where the last `solve` left them (0 at first) to what they hold
                now; or a function of the share (0, 1] that sets them, without communication.
            increments: number of equal ones; where Newton's method fails, they are divided.

        Returns:
            The problem's u.

        Raises:
            NotConverged: if no solution is found even in small parts, or in one without a load; u
                and the load's constants are those of the last solution.
            SingularSystem: likewise, if the tangent is singular.
            TypeError, ValueError: for an invalid load, or conditions that contradict each
                other or are not finite.
        """
        arguments.check_integer("increments", increments, 1)
        path = self._path(load)
        total, size, done = increments * _MOST_PARTS, _MOST_PARTS, 0
        self.increments = ()
        while done < total:
            size = min(size, total - done)
            if load is None:
                size = total
            last = self.u.x.array.copy()
            share = (done + size) / total
            self._apply(path, share)
            try:
                with report_activity(self._comm, f"load {share:.3g}"):
                    self._newton(share)
            except (NotConverged, SingularSystem) as failed:
                words = f"not from {done / total:.4g} to {share:.4g}: {failed}"
                log_on_root(self._comm, logging.INFO, words, ".problems")
                self.u.x.array[:] = last
                self._apply(path, done / total)
                if load is None or size == 1:
                    self._keep(load)
                    words = _advice(failed, load, done / total, share, is_hybrid(self._space))
                    raise type(failed)(words) from None
                size //= 2
                continue
            done += size
            size = min(2 * size, _MOST_PARTS)
        self._keep(load)
        return self.u

    @check_same_arguments
    def reactions(self) -> PETSc.Vec:
        """Residual (n,) at all nodes: at prescribed ones what the supports exert on the body.

        That is K a - f, as of `reactions`, if the residual is linear.

        Reactions and loads add up to zero. Their moments about deformed nodes do so exactly with
        standard elements only; with piecewise-linear weights, where the deformation is smooth, to
        third order in the size of cells, if a load's moment is that of its density (with nodal
        loads at deformed nodes: to second order).
        """
        return self.system.assemble_residual()

    def _path(self, load: Load | None) -> Callable[[float], None]:
        """The function that sets the load to a share of it; local."""
        if arguments.is_user_function(load):
            return load
        ways = []
        for constant in _constants(load):
            end = np.array(constant.value)
            ways.append((constant, self._held.get(constant, np.zeros_like(end)), end))

        def to(share: float) -> None:
            for constant, start, end in ways:
                constant.value[...] = start + share * (end - start)

        return to

    def _apply(self, path: Callable[[float], None], share: float) -> None:
        with collective_errors(self._comm) as same:
            call_user_function(self._comm, "the load", path, share)
            same["what the residual and the conditions hold"] = (
                self.form.constants(),
                self._conditions,
            )

    def _keep(self, load: Load | None) -> None:
        self._held |= {constant: np.array(constant.value) for constant in _constants(load)}

    def _newton(self, share: float) -> None:
        """Solves for u under the load as it is; where that fails, u is worth nothing."""
        free, values = evaluate_conditions(self._space, self._conditions)
        fixed = np.flatnonzero(~free)
        newton = Newton(self.system, fixed, values, self._is_linear, self._solver)
        newton.solve()
        self.increments += (SolvedIncrement(share, tuple(newton.corrections)),)
        words = f"load {share:.4g}: {len(newton.corrections)} iterations"
        log_on_root(self._comm, logging.INFO, words, ".problems")


def _constants(load: Load | None) -> Sequence[fem.Constant]:
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


def _advice(failed: Exception, load: Load | None, done: float, share: float, hybrid: bool) -> str:
    words = str(failed)
    if isinstance(failed, SingularSystem):
        words += ": conditions leave a motion free, or the solution branches here"
        if hybrid:
            words += (
                ", or a body that they enclose has a pressure that is known up to a constant: "
                'prescribe(space, "pressure", where)'
            )
    if load is None:
        return (
            f"{words}; u is as before: start nearer to the solution, or give what makes the load "
            "as `load`, so that it can grow"
        )
    return f"{words}, from {done:.4g} to {share:.4g} of the load; u is the solution at {done:.4g}"
