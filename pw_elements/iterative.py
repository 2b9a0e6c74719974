"""Krylov's method with two-level p-multigrid.

In space, factors of quadratic elements take memory that grows faster than the power 4/3 of the
number of unknowns; this method takes a few times that of the matrix, and time in proportion to it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import memory
from pw_elements.connected import connected_pieces
from pw_elements.hybrid import is_hybrid
from pw_elements.linear_solver import (
    LinearSolver,
    SingularSystem,
    SolverNotConverged,
    SolverReport,
    set_options,
)
from pw_elements.multigrid import Multigrid
from pw_elements.projection import Supports
from pw_elements.saddle import SaddlePoint

Array = npt.NDArray[np.float64]
Solver: TypeAlias = LinearSolver | Literal["auto"] | None

NO_SUPPORTS = (
    "Iterative() solves under the supports of Reduction.dirichlet alone: static condensation and "
    "other reductions, and a pressure that is split, need Direct()"
)

# Iterations allowed, and vectors kept to be orthogonal to
_MOST, _KEPT = 1000, 100
# The true residual over what the method takes it for
_DRIFT = 10
_EPSILON = float(np.finfo(float).eps)
# Stiffness of a rigid motion over that of an arbitrary one: as good as none below
_FREE = 1e-8


@dataclass(frozen=True)
class Iterative:
    """Right-preconditioned GMRES with two-level p-multigrid, for quadratic elements.

    The coarse level is the stiffness of linear elements, P^T K P, under one cycle of algebraic
    multigrid that knows the rigid motions; the smoother treats nodes as blocks. It takes some
    25 iterations for ten digits whatever the size of the mesh, at a Poisson's ratio of 0.3, and
    several times as many near 1/2; `solve` with hybrid spaces needs few at any ratio. It accepts
    the supports of `Reduction.dirichlet`, but no condensation, and computes no determinants.

    Args:
        tolerance: on the residual over the load, both in the Euclidean norm. Contact has its own,
            relative to the largest nodal contact force.
        options: PETSc options without prefix and hyphen, such as
            `{"mg_levels_1_ksp_max_it": 4, "mg_coarse_pc_gamg_threshold": 0.02}`; `ksp_type` sets
            the method and `ksp_max_it` its iterations.

    Raises:
        ValueError: for a tolerance that is not between 0 and 1.
    """

    tolerance: float = 1e-11
    options: Mapping[str, str | int | float | bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise ValueError(f"tolerance = {self.tolerance}: has to lie between 0 and 1")

    def prepare(
        self, matrix: PETSc.Mat, symmetric: bool = False, supports: Supports | None = None
    ) -> "Krylov":
        """Binds the method to a free matrix (n, n) under supports.

        Args:
            matrix: free (n, n).
            symmetric: whether the pair of an eigenvalue problem is to be taken as symmetric.
            supports: of `Reduction.dirichlet`.

        Raises:
            ValueError: without supports, or for a symmetric pair of eigenvalue problems.
        """
        if supports is None:
            raise ValueError(NO_SUPPORTS)
        if symmetric:
            raise ValueError(
                "Iterative() does not count negative pivots, without which a symmetrised pair is "
                "not known to be positive definite: use Direct()"
            )
        return Krylov(matrix, supports, self)


class Krylov:
    """Iterative solutions with one matrix under supports.

    Args:
        matrix: (n, n), all rows and columns free.
        supports: of its space.
        how: tolerance and options.

    Attributes:
        ksp: PETSc's solver; its matrix is Pi K Pi + (1 - Pi) of all n unknowns.
        multigrid: its preconditioner.
        operator: that matrix.
    """

    def __init__(self, matrix: PETSc.Mat, supports: Supports, how: Iterative) -> None:
        self._how, self._supports = how, supports
        self._matrix = matrix
        self._counted: list[int] = []  # iterations, by each call of PETSc's monitor
        hybrid = is_hybrid(supports.space)
        levels = SaddlePoint if hybrid else Multigrid
        self.multigrid: Multigrid | SaddlePoint = levels(matrix, supports)
        self.operator = self.multigrid.operator
        self.ksp = self._method_for(self.operator)
        # the levels take over the prefix
        self.multigrid.set_up(self.ksp.getPC())
        self.ksp.getPC().setFromOptions()
        how_inside = " in a block triangle" if hybrid else ""
        self._method = f"{self.ksp.getType().upper()} with p-multigrid{how_inside}"

    def preconditioned(self, operator: PETSc.Mat, preconditioner: object) -> PETSc.KSP:
        """The same method with another matrix, and a preconditioner in Python."""
        ksp = self._method_for(operator)
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(preconditioner)
        return ksp

    def _method_for(self, operator: PETSc.Mat) -> PETSc.KSP:
        ksp = PETSc.KSP().create(operator.comm)
        ksp.setOperators(operator)
        ksp.setType("gmres")
        ksp.setGMRESRestart(_KEPT)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=self._how.tolerance, atol=0.0, max_it=_MOST)
        counted = self._counted  # a method would make a cycle that is never freed
        ksp.setMonitor(lambda _, iteration, __: counted.append(int(iteration > 0)))
        # residuals are judged here, not by an error of PETSc's
        set_options(ksp, {"ksp_converged_maxits": True} | dict(self._how.options))
        return ksp

    @property
    def report(self) -> SolverReport:
        """What has been done so far."""
        return SolverReport(self._method, 0, sum(self._counted))

    @property
    def orientations(self) -> frozenset[int]:
        """None: determinants are not known."""
        return frozenset()

    @property
    def negative_pivots(self) -> None:
        """Not known."""
        return

    def set_up(self) -> None:
        """Refuses a body that supports do not hold.

        Raises:
            SingularSystem: if a rigid motion is free.
        """
        elastic = self._matrix, self._supports
        if isinstance(self.multigrid, SaddlePoint):
            elastic = self.multigrid.elastic
        if free_motion(*elastic):
            raise SingularSystem("the system matrix is singular")
        self.multigrid.ready()

    def solve(self, right: PETSc.Vec) -> PETSc.Vec:
        """Solution (n,); the right-hand side is zero where values are prescribed.

        Raises:
            SingularSystem: if a rigid motion is free.
            SolverNotConverged: if the residual does not become small.
        """
        self.set_up()
        solution, step = right.duplicate(), right.duplicate()
        rest, size = right.copy(), right.norm()
        # Rounding makes the residual that GMRES updates drift from the true one
        for _ in range(2):
            self.ksp.solve(rest, step)
            solution.axpy(1.0, step)
            self.operator.mult(solution, rest)
            rest.aypx(-1.0, right)
            left = rest.norm()
            if left <= self._how.tolerance * size:
                break
        if not left <= _DRIFT * self._how.tolerance * size + self.round_off(solution.norm()):
            raise self.not_converged(left / size)
        return solution

    def round_off(self, size: float) -> float:
        """Residual that may be nothing but round-off, of a solution with the norm `size`."""
        return float(_DRIFT * _EPSILON * self._matrix.norm(PETSc.NormType.INFINITY) * size)

    def not_converged(self, left: float) -> SolverNotConverged:
        """What is to be raised where the relative residual `left` remains."""
        dofs = self._matrix.getSize()[0]
        return SolverNotConverged(
            f"{self.report.method} left the relative residual {left:.1e} after "
            f"{self.ksp.getIterationNumber()} iterations: Poisson's ratio near 1/2, flat cells or "
            "supports that hardly hold make it slow; use Direct() "
            f"(some {memory.of_factors(dofs) / 1e9:.2g} GB in space), or raise ksp_max_it"
        )

    def solve_changed(self, right: PETSc.Vec, rows: int) -> None:  # noqa: ARG002
        """Nothing: there are no old factors."""
        return


def free_motion(K: PETSc.Mat, supports: Supports) -> bool:
    """Whether a rigid motion of a connected piece meets neither supports nor stiffness.

    A field that is no displacement has its constants in place of rigid motions.
    """
    space = supports.space
    comm: MPI.Comm = space.mesh.comm
    owned, block = space.dofmap.index_map.size_local, space.dofmap.index_map_bs
    dim = space.mesh.geometry.dim
    piece, count = connected_pieces(space)
    piece = piece[:owned]
    x = space.tabulate_dof_coordinates()[:owned, :dim]
    sums = np.zeros((count, dim + 2))
    np.add.at(sums, piece, np.column_stack([x, np.sum(x**2, axis=1), np.ones(owned)]))
    comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
    centre, square = sums[:, :dim] / sums[:, -1:], sums[:, dim] / sums[:, -1]
    radius = np.sqrt(np.maximum(square - np.sum(centre**2, axis=1), 0.0))
    s = (x - centre[piece]) / radius[piece][:, None]
    planes = list(combinations(range(dim), 2)) if block == dim else []
    modes = np.zeros((owned, block, block + len(planes)))
    modes[:, :, :block] = np.eye(block)
    for k, (i, j) in enumerate(planes):
        modes[:, i, block + k], modes[:, j, block + k] = -s[:, j], s[:, i]
    size = K.getDiagonal().norm(PETSc.NormType.INFINITY)
    held = ~supports.free.reshape(owned, block)
    forces = np.empty_like(modes)
    motion, image = K.createVecs()
    for k in range(modes.shape[2]):
        motion.setArray(np.where(held, 0.0, modes[:, :, k]).ravel())
        K.mult(motion, image)
        forces[:, :, k] = image.array_r.reshape(owned, block) / size
    rows = np.where(held[:, :, None], modes, forces)
    order = np.argsort(piece, kind="stable")
    ends = np.cumsum(np.bincount(piece, minlength=count))[:-1]
    width = modes.shape[2]
    triangles = []
    for part in np.split(rows[order], ends):
        own = np.linalg.qr(part.reshape(-1, width), mode="r")
        triangles.append(np.vstack([own, np.zeros((width - len(own), width))]))
    every = np.concatenate(comm.allgather(np.array(triangles)), axis=1)
    least = np.linalg.svd(every, compute_uv=False)[:, -1]
    return bool(np.any(least < _FREE * np.sqrt(width)))
