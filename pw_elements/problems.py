"""Problems stated by any UFL residual, with piecewise-linear weight functions.

Where test and trial space differ, DOLFINx's own `LinearProblem` and `NonlinearProblem` take the
prescribed columns out of a matrix but no rows: the first returns `inf`, the second fails.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from ufl.algorithms import expand_derivatives

from pw_elements import arguments
from pw_elements.algebra import compiled_form, prescribed
from pw_elements.collective import agree, answer, collective
from pw_elements.linear_solver import Direct, LinearSolver, SingularSystem
from pw_elements.problem import check_solver
from pw_elements.progress import doing
from pw_elements.quadrature import with_cell_rules, with_degrees
from pw_elements.spaces import Spaces
from pw_elements.values import whole

Array = npt.NDArray[np.float64]
Load: TypeAlias = Callable[[float], None] | fem.Constant | Sequence[fem.Constant]

log = logging.getLogger(__name__)

# Newton's method is done with a correction below this, over the largest value of u: it is
# quadratic, and the next one would be round-off
_CORRECTION = 1e-8
# Largest residual of a solution, over the tangent's norm times that of u; a line search that finds
# nothing better has failed unless it is round-off
_RESIDUAL, _ROUND_OFF = 1e-10, 1e-14
_ITERATIONS = 25
# An increment is cut into so many parts at most
_PARTS = 16

# PETSc's SNESConvergedReason by number: one name has changed
_LINE_SEARCH = -6
_REASONS = {
    -1: "the residual is not finite",
    -3: "the linear solver did not converge",
    -4: "the residual is not finite",
    -5: f"no convergence in {_ITERATIONS} iterations",
    _LINE_SEARCH: "no step along Newton's direction helps",
}


class NotConverged(RuntimeError):
    """Newton's method has found no solution."""


@dataclass(frozen=True)
class Increment:
    """What it took to solve an increment, or a part of one.

    Args:
        share: of the load, at its end.
        residuals: Euclidean norms, the one at the start first.
        corrections: largest change of a nodal value in each iteration, over the largest value.
    """

    share: float
    residuals: tuple[float, ...]
    corrections: tuple[float, ...]


class PetrovGalerkinProblem:
    """F(u; v) = 0 for all weights v, linear or not in u, under Dirichlet conditions.

    Newton's method is PETSc's, with its backtracking line search; the tangent is UFL's derivative
    at the residual's own quadrature points. -div((1 + u^2) grad u) = 10 with u = 0 around:

        V = fem.functionspace(mesh, ("Lagrange", 2))
        u, v = fem.Function(V), ufl.TestFunction(test_space(V))
        F = ufl.inner((1 + u**2) * ufl.grad(u), ufl.grad(v)) * ufl.dx - 10.0 * v * ufl.dx
        rim = fem.locate_dofs_topological(V, 1, exterior_facet_indices(mesh.topology))
        problem = PetrovGalerkinProblem(F, u, fem.dirichletbc(0.0, rim, V))
        problem.solve()

    Large loads grow in increments, which are cut where Newton's method fails:

        depth = fem.Constant(mesh, -0.3)
        conditions = [prescribe(V, 1, top, depth), ...]
        PetrovGalerkinProblem(F, u, conditions).solve(depth, increments=4)

    Args:
        residual: F, a UFL form linear in its test function, which `test_space` (or, for the
            standard element, the trial space) has; a `ufl.TrialFunction` in it stands for u. State
            the quadrature degree of integrands that are no polynomials: UFL's estimate is high.
        u: unknown function in the quadratic trial space; it holds the start and the solution.
        conditions: Dirichlet conditions on its space; what they refer to may change.
        solver: of linear systems, `Direct()` unless given.

    Attributes:
        u: the unknown.
        increments: what each part of the last `solve` took, a tuple of `Increment`.

    Raises:
        TypeError: for things of another kind.
        ValueError: for a form without a test function or without u, of several meshes, or that
            cannot be compiled.
        NumberingError: if trial and test space number their nodes differently.
    """

    def __init__(
        self,
        residual: ufl.Form,
        u: fem.Function,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC] = (),
        solver: LinearSolver | None = None,
    ) -> None:
        with collective(arguments.processes(u)):
            arguments.of_type("u", u, fem.Function, "fem.Function(V) is an unknown")
            arguments.of_type("the residual", residual, ufl.Form, "an integrand times a measure")
            check_solver(solver)
        self.u, self.increments = u, tuple[Increment, ...]()
        self._space, self._conditions = u.function_space, conditions
        self._comm: MPI.Comm = self._space.mesh.comm
        form = _residual(residual, u)
        tangent = expand_derivatives(ufl.derivative(form, u, ufl.TrialFunction(self._space)))
        if tangent.empty():
            raise ValueError("the residual does not depend on u: it has to be stated with u itself")
        self._is_linear = u not in tangent.coefficients()
        self._residual = compiled_form(form, 1, "a residual")
        self._tangent = compiled_form(tangent, 2, "a tangent")
        prescribed(self._space, conditions)  # what is wrong is refused at once
        self._forces = petsc.assemble_vector(self._residual)
        self._J = petsc.create_matrix(self._tangent)
        self._J.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self._solver: LinearSolver = solver or Direct()
        self._unit = 1.0  # a stiffness by which conditions become equations like the others
        self._held: dict[fem.Constant, Array] = {}

    def solve(self, load: Load | None = None, increments: int = 1) -> fem.Function:
        """Solves for u, from what it holds.

        Args:
            load: what grows with the increments: `fem.Constant`s of the residual or conditions,
                which grow from their values in the last `solve` (0 at first) to those they have
                now; or a function of the share (0, 1] that sets them, without communication.
            increments: equal ones; where Newton's method fails, they are cut.

        Returns:
            The problem's u.

        Raises:
            NotConverged: if no solution is found even in small parts, or in one without a load; u
                and the load's constants are those of the last solution.
            SingularSystem: likewise, if the tangent is singular.
            TypeError, ValueError: for a load that is none, or conditions that contradict each
                other or are not finite.
        """
        with collective(self._comm):
            whole("increments", increments, 1)
            path = self._path(load)
        loads = [np.array(constant.value) for constant in _constants(load)]
        agree(self._comm, {"increments": increments, "the load": loads})
        total, size, done = increments * _PARTS, _PARTS, 0
        self.increments = ()
        while done < total:
            size = min(size, total - done)
            if load is None:
                size = total
            last = self.u.x.array.copy()
            share = (done + size) / total
            self._apply(path, share)
            try:
                with doing(self._comm, f"load {share:.3g}"):
                    self._newton(share)
            except (NotConverged, SingularSystem) as failed:
                self._tell(logging.INFO, "not from %.4g to %.4g: %s", done / total, share, failed)
                self.u.x.array[:] = last
                self._apply(path, done / total)
                if load is None or size == 1:
                    raise type(failed)(_advice(failed, load, done / total, share)) from None
                size //= 2
                continue
            done += size
            size = min(2 * size, _PARTS)
        self._keep(load)
        return self.u

    def reactions(self) -> PETSc.Vec:
        """Residual (n,) at all nodes: at prescribed ones what the supports exert on the body.

        That is K a - f, as of `reactions`, if the residual is linear.
        """
        forces = self._forces.duplicate()
        self._assemble_residual(forces)
        forces.setAttr("form", self._residual)
        return forces

    def _path(self, load: Load | None) -> Callable[[float], None]:
        """What sets the load to a share of it; local."""
        if callable(load) and not isinstance(load, fem.Constant):  # UFL's expressions are, too
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
        with collective(self._comm):
            answer(self._comm, "the load", path, share)

    def _keep(self, load: Load | None) -> None:
        self._held |= {constant: np.array(constant.value) for constant in _constants(load)}

    def _newton(self, share: float) -> None:
        """Solves for u under the load as it is.

        Raises:
            NotConverged, SingularSystem: if that fails; u is worth nothing then.
        """
        free, values = prescribed(self._space, self._conditions)
        fixed = np.flatnonzero(~free)
        x = values.duplicate()
        owned = x.getLocalSize()
        x.setArray(self.u.x.array[:owned])
        residuals: list[float] = []
        corrections: list[float] = []
        self._take(x)
        self._unit = self._assemble_tangent(np.zeros(0, dtype=PETSc.IntType))
        prepared, before = self._solver.prepare(self._J), x.copy()
        first = values.getOwnershipRange()[0]
        rows = (first + fixed).astype(PETSc.IntType)
        singular: list[SingularSystem] = []
        norm = 0.0

        def equations(_: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
            self._take(x)
            self._assemble_residual(self._forces)
            forces = self._forces.array_r.copy()
            forces[fixed] = self._unit * (x.array_r[fixed] - values.array_r[fixed])
            out.setArray(forces)

        def linearised(_: PETSc.SNES, x: PETSc.Vec, *__: PETSc.Mat) -> None:
            nonlocal norm
            self._take(x)
            self._assemble_tangent(rows)
            norm = self._J.norm(PETSc.NormType.INFINITY)
            try:
                prepared.set_up()
            except SingularSystem as error:
                singular.append(error)  # PETSc has no words of its own for it
                raise

        def size(x: PETSc.Vec) -> float:
            return float(x.norm(PETSc.NormType.INFINITY))

        def converged(
            snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
        ) -> PETSc.SNES.ConvergedReason | None:
            now = snes.getSolution()
            residuals.append(norms[2])
            if iteration:
                before.aypx(-1.0, now)
                corrections.append(size(before) / (size(now) or 1.0))
                self._tell(
                    logging.DEBUG,
                    "load %.4g, iteration %d: correction %.1e, residual %.1e",
                    share,
                    iteration,
                    corrections[-1],
                    norms[2],
                )
            now.copy(before)
            small = iteration and corrections[-1] <= _CORRECTION
            if norms[2] == 0 or (small and within(snes, _RESIDUAL)):
                return PETSc.SNES.ConvergedReason.CONVERGED_SNORM_RELATIVE
            return None

        def within(snes: PETSc.SNES, bound: float) -> bool:
            """Whether the residual is a rounding error, more or less, of the tangent times u."""
            return size(snes.getFunction()[0]) <= bound * norm * size(snes.getSolution())

        snes = PETSc.SNES().create(self._comm)
        snes.setFunction(equations, values.duplicate())
        snes.setJacobian(linearised, self._J)
        snes.setType("ksponly" if self._is_linear else "newtonls")
        snes.setKSP(prepared.ksp)
        snes.setTolerances(max_it=_ITERATIONS)
        snes.setConvergenceTest(converged)
        try:
            snes.solve(None, x)
            reason = snes.getConvergedReason()
            if self._is_linear:
                equations(snes, x, snes.getFunction()[0])
            accepted = reason > 0
            if self._is_linear or reason == _LINE_SEARCH:
                accepted = within(snes, _RESIDUAL if self._is_linear else _ROUND_OFF)
        except PETSc.Error:
            if singular:
                raise singular[0] from None
            raise
        finally:
            snes.destroy()  # and with it resets the KSP
            prepared.ksp.destroy()
        self._take(x)
        if not accepted:
            raise NotConverged(_REASONS.get(reason, f"SNES stopped with the reason {reason}"))
        self.increments += (Increment(share, tuple(residuals), tuple(corrections)),)
        self._tell(
            logging.INFO, "load %.4g: solved in %d iterations", share, max(len(corrections), 1)
        )

    def _take(self, x: PETSc.Vec) -> None:
        """Sets u to a vector (n,)."""
        self.u.x.array[: x.getLocalSize()] = x.array_r
        self.u.x.scatter_forward()

    def _assemble_residual(self, out: PETSc.Vec) -> None:
        with out.localForm() as local:
            local.set(0.0)
        petsc.assemble_vector(out, self._residual)
        out.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)

    def _assemble_tangent(self, fixed: npt.NDArray[np.integer]) -> float:
        """Assembles it with rows of the identity times a stiffness; returns its mean diagonal."""
        self._J.zeroEntries()
        petsc.assemble_matrix(self._J, self._tangent)
        self._J.assemble()
        diagonal = self._J.getDiagonal()
        mean = diagonal.norm(PETSc.NormType.NORM_1) / diagonal.getSize()
        self._J.zeroRows(fixed, diag=self._unit)
        return mean or 1.0

    def _tell(self, level: int, words: str, *values: object) -> None:
        if self._comm.rank == 0:
            log.log(level, words, *values)


def _residual(residual: ufl.Form, u: fem.Function) -> ufl.Form:
    """The form with u in place of a trial function, with a rule in each of its measures."""
    by_number = {argument.number(): argument for argument in residual.arguments()}
    if 0 not in by_number:
        raise ValueError("the residual has no test function: test_space(V) is the space of one")
    test = by_number[0].ufl_function_space()
    Spaces(u.function_space, test)
    if 1 in by_number:
        trial = by_number[1]
        if trial.ufl_function_space() != u.function_space:
            raise ValueError("the residual's trial function belongs to another space than u")
        residual = ufl.replace(residual, {trial: u})
    return with_degrees(with_cell_rules(residual))


def _constants(load: Load | None) -> Sequence[fem.Constant]:
    if isinstance(load, fem.Constant):
        return [load]
    if load is None or callable(load):
        return ()
    remedy = "give a fem.Constant, a list of these, or a function of the share"
    arguments.of_type("the load", load, Sequence, remedy)
    for constant in load:
        arguments.of_type("a load", constant, fem.Constant, remedy)
    return load


def _advice(failed: Exception, load: Load | None, done: float, share: float) -> str:
    words = str(failed)
    if isinstance(failed, SingularSystem):
        words += ": conditions leave a motion free, or the solution branches here"
    if load is None:
        return (
            f"{words}; u is as before: start nearer to the solution, or give what makes the load "
            "as `load`, so that it can grow"
        )
    return f"{words}, from {done:.4g} to {share:.4g} of the load; u is the solution at {done:.4g}"
