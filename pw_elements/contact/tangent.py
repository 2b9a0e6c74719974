"""Direct solver of a matrix of which only some rows change from one solve to the next."""

from petsc4py import PETSc

import numpy as np

from pw_elements.algebra import check_factors

# An iteration per changed row is exact, for the change has that rank; round-off needs some more
_SPARE = 5
_CONVERGED = 1e-13
# Operations of a factorisation are done faster than those of a solve, by about this (measured)
_FASTER = 6


class TangentSolver:
    """MUMPS with one analysis of the pattern, and old factors while few rows have changed.

    Attributes:
        orientations: signs of the determinants of all matrices factorised so far.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        self.orientations: set[float] = set()
        self._matrix = matrix
        self._worthwhile = -1.0
        self._solver = PETSc.KSP().create(matrix.comm)
        self._solver.setOperators(matrix)
        self._solver.setTolerances(rtol=_CONVERGED, atol=0.0)
        self._preconditioner = self._solver.getPC()
        self._preconditioner.setType("lu")
        self._preconditioner.setFactorSolverType("mumps")
        self._preconditioner.setFactorSetUpSolverType()
        self._factor = self._preconditioner.getFactorMatrix()
        self._factor.setMumpsIcntl(24, 1)  # null pivots are counted, not divided by
        self._factor.setMumpsIcntl(33, 1)  # determinant

    def solve_as_changed(self, right: PETSc.Vec, rows: int) -> PETSc.Vec | None:
        """Solution by GMRES with the last factors, `rows` rows having changed since.

        None if new factors would cost less, or it takes more iterations than it should.
        """
        if rows > self._worthwhile:
            return None
        self._solver.setType("gmres")
        self._solver.setGMRESRestart(rows + _SPARE)
        self._solver.setTolerances(max_it=rows + _SPARE)
        self._preconditioner.setReusePreconditioner(True)
        solution = right.duplicate()
        self._solver.solve(right, solution)
        return solution if self._solver.getConvergedReason() > 0 else None

    def solve(self, right: PETSc.Vec) -> PETSc.Vec:
        """Solution with new factors.

        Raises:
            SingularSystem: if a pivot is zero or a known solution does not come back.
        """
        self._solver.setType("preonly")
        self._preconditioner.setReusePreconditioner(False)
        self._worthwhile = -1.0
        solution = right.duplicate()
        self._solver.solve(right, solution)
        check_factors(self._solver, self._matrix)
        factorisation, entries = self._factor.getMumpsRinfog(3), self._factor.getMumpsInfog(29)
        entries = entries if entries > 0 else -1e6 * entries  # in millions where it is negative
        self._worthwhile = factorisation / (4 * entries) / _FASTER
        self.orientations.add(float(np.sign(self._factor.getMumpsRinfog(12))))
        return solution
