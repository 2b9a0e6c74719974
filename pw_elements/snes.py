"""Newton's method, PETSc's SNES, for a residual under Dirichlet conditions.

Conditions are equations as all others, u_i - g_i times a stiffness: so the first step of an
increment moves the whole body along, not the prescribed nodes alone, which would turn cells over.
A pressure beside displacements is scaled to be a length, and so are the equations of volume.
"""

import logging
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.fem import petsc

from pw_elements.given import is_finite
from pw_elements.hybrid import equilibration
from pw_elements.linear_solver import LinearSolver, SingularSystem

log = logging.getLogger("pw_elements.problems")

# Newton's method is done with a correction below this, over the largest value of u: it is
# quadratic, and the next one would be round-off
_CORRECTION = 1e-8
# Largest residual of a solution, over the tangent's norm times that of u; a line search that finds
# nothing better has failed unless it is round-off
_RESIDUAL, _ROUND_OFF = 1e-10, 1e-14
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


class NotConverged(RuntimeError):
    """Newton's method has found no solution."""


@dataclass(frozen=True)
class Increment:
    """What it took to solve an increment, or a part of one.

    Args:
        share: of the load, at its end.
        residuals: Euclidean norms, the one at the start first; with a pressure beside
            displacements, of what `hybrid.equilibration` makes of them.
        corrections: largest change of a nodal value in each iteration, over the largest value.
    """

    share: float
    residuals: tuple[float, ...]
    corrections: tuple[float, ...]


class System:
    """Residual and tangent at an unknown function, assembled in place.

    Args:
        u: the unknown.
        residual: compiled, of rank 1.
        tangent: its derivative, compiled.
    """

    def __init__(self, u: fem.Function, residual: fem.Form, tangent: fem.Form) -> None:
        self.u, self._residual, self._tangent = u, residual, tangent
        self.matrix = petsc.create_matrix(tangent)
        self.matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self._forces = petsc.assemble_vector(residual)

    def take(self, x: PETSc.Vec) -> None:
        """Sets u to a vector (n,)."""
        self.u.x.array[: x.getLocalSize()] = x.array_r
        self.u.x.scatter_forward()

    def forces(self) -> PETSc.Vec:
        """A new vector (n,) of the residual."""
        forces = self._forces.duplicate()
        with forces.localForm() as local:
            local.set(0.0)
        petsc.assemble_vector(forces, self._residual)
        forces.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        forces.setAttr("form", self._residual)
        return forces

    def assemble(self) -> None:
        """The tangent, free."""
        self.matrix.zeroEntries()
        petsc.assemble_matrix(self.matrix, self._tangent)
        self.matrix.assemble()


class Newton:
    """One solution of a system under conditions.

    Args:
        system: whose u is the start, and holds the solution in the end.
        fixed: own local numbers (k,) of the prescribed degrees of freedom.
        prescribed: vector (n,) with their values.
        linear: one step does.
        solver: of linear systems.

    Attributes:
        residuals: norms, so far.
        corrections: so far, see `Increment`.
    """

    def __init__(
        self,
        system: System,
        fixed: npt.NDArray[np.integer],
        prescribed: PETSc.Vec,
        linear: bool,
        solver: LinearSolver,
    ) -> None:
        self._system, self._fixed, self._prescribed = system, fixed, prescribed
        self._linear = linear
        self._rows = (prescribed.getOwnershipRange()[0] + fixed).astype(PETSc.IntType)
        self._x = prescribed.duplicate()
        self._x.setArray(system.u.x.array[: self._x.getLocalSize()])
        self.residuals: list[float] = []
        self.corrections: list[float] = []
        self._singular: SingularSystem | None = None
        system.assemble()
        self._scale = equilibration(system.u.function_space, system.matrix)
        if self._scale is not None:
            system.matrix.diagonalScale(self._scale, self._scale)
            self._x.pointwiseDivide(self._x, self._scale)
            self._prescribed = prescribed.copy()
            self._prescribed.pointwiseDivide(prescribed, self._scale)
        self._before = self._x.copy()
        diagonal = system.matrix.getDiagonal()
        # what makes equations of conditions
        self._stiffness = diagonal.norm(PETSc.NormType.NORM_1) / diagonal.getSize() or 1.0
        self._norm = 0.0
        self._prepared = solver.prepare(system.matrix)

    def solve(self) -> None:
        """Solves it.

        Raises:
            NotConverged, SingularSystem: if that fails; u is worth nothing then.
        """
        snes = PETSc.SNES().create(self._prescribed.comm)
        snes.setFunction(self._equations, self._prescribed.duplicate())
        snes.setJacobian(self._linearised, self._system.matrix)
        snes.setType("ksponly" if self._linear else "newtonls")
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
            self._prepared.ksp.destroy()

    def _take(self, x: PETSc.Vec) -> None:
        """Sets u to what the scaled unknowns stand for."""
        if self._scale is not None:
            scaled, x = x, x.duplicate()
            x.pointwiseMult(scaled, self._scale)
        self._system.take(x)

    def _equations(self, _: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self._take(x)
        forces = self._system.forces().array_r.copy()
        if self._scale is not None:
            forces *= self._scale.array_r
        off = x.array_r[self._fixed] - self._prescribed.array_r[self._fixed]
        forces[self._fixed] = self._stiffness * off
        out.setArray(forces)

    def _linearised(self, _: PETSc.SNES, x: PETSc.Vec, *__: PETSc.Mat) -> None:
        self._take(x)
        self._system.assemble()
        if self._scale is not None:
            self._system.matrix.diagonalScale(self._scale, self._scale)
        self._system.matrix.zeroRows(self._rows, diag=self._stiffness)
        self._norm = self._system.matrix.norm(PETSc.NormType.INFINITY)
        try:
            self._prepared.set_up()
        except SingularSystem as error:
            self._singular = error  # PETSc has no words of its own for it
            raise

    def _converged(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        now, residual = snes.getSolution(), norms[2]
        self.residuals.append(residual)
        if iteration:
            self._before.aypx(-1.0, now)
            self.corrections.append(_largest(self._before) / (_largest(now) or 1.0))
            words = "iteration %d: correction %.1e, residual %.1e"
            told(now.comm, logging.DEBUG, words, iteration, self.corrections[-1], residual)
        now.copy(self._before)
        small = iteration and self.corrections[-1] <= _CORRECTION
        if residual == 0 or (small and self._relative_residual(snes) <= _RESIDUAL):
            return PETSc.SNES.ConvergedReason.CONVERGED_SNORM_RELATIVE
        return None

    def _judge(self, snes: PETSc.SNES) -> None:
        """Raises NotConverged unless there is a solution."""
        reason = snes.getConvergedReason()
        words = _REASONS.get(reason, f"SNES stopped with the reason {reason}")
        if self._linear:
            self._equations(snes, self._x, snes.getFunction()[0])
            relative = self._relative_residual(snes)
            if np.isnan(relative):
                raise NotConverged(_NOT_FINITE)
            if relative > _RESIDUAL:
                raise NotConverged(f"the linear solver left the relative residual {relative:.1e}")
        elif reason == _LINE_SEARCH:
            if not self._relative_residual(snes) <= _ROUND_OFF:
                raise NotConverged(words)
        elif reason <= 0:
            raise NotConverged(words)

    def _relative_residual(self, snes: PETSc.SNES) -> float:
        """Of the last equations, over the tangent's norm times that of u."""
        residual = _largest(snes.getFunction()[0])
        scale = self._norm * _largest(snes.getSolution())
        return 0.0 if residual == 0 else residual / (scale or np.nan)


def _largest(x: PETSc.Vec) -> float:
    """Largest size of an entry; NaN if one is not finite, over which PETSc's maximum may pass."""
    return float(x.norm(PETSc.NormType.INFINITY)) if is_finite(x) else np.nan


def told(comm: MPI.Comm | PETSc.Comm, level: int, words: str, *values: object) -> None:
    """Logs on process 0 alone."""
    if comm.rank == 0:
        log.log(level, words, *values)
