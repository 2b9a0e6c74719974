"""Krylov's method with two-level p-multigrid; of hybrid bodies with a block triangle.

The guide's page on theory has its blocks ("Large systems"). Solver "auto" chooses between factors
and Krylov's method. Factors serve every body, as long as there is memory for them; Krylov's method
takes little, and may give up where supports or contact hardly hold the body. Then factors go on, if
they fit.
"""

import logging
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import ClassVar, Literal, TypeAlias, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix, assemble_vector

from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import (
    arguments,
    check_same_arguments,
    collective_errors,
    connected_components,
    defer_errors_if_parallel,
    vector_sizes,
)
from pw_elements.progress import log_on_root
from pw_elements.solvers.direct import (
    Direct,
    FreePressure,
    LinearSolver,
    NotConverged,
    Options,
    PreparedSolver,
    SingularSystem,
    SolverReport,
    check_options,
    name_options_in_errors,
    refuse_unused_options,
    set_options,
)
from pw_elements.solvers.matrices import (
    ConstrainedOperator,
    ConstraintProjection,
    Supports,
    destroy_objects,
    galerkin_product,
    null_space,
    python_matrix,
    qr_triangle,
)
from pw_elements.solvers.multigrid import Multigrid, linear_interpolation
from pw_elements.spaces import PRESSURE_MODE_TOLERANCE, SubSpace, equilibration_scale, is_hybrid

# Eigenvalues of P1 or Q1 mass matrices over their diagonal, and the polynomial's degree
_MASS = {
    "triangle": (0.5, 2.0, 6),
    "quadrilateral": (0.25, 2.25, 9),
    "tetrahedron": (0.5, 2.5, 6),
    "hexahedron": (0.125, 3.375, 12),
}

# An x with |right - product(x)| <= size, of (product, preconditioner, right, size)
_Map: TypeAlias = Callable[[Array], Array]
_Iterate: TypeAlias = Callable[[_Map, _Map, Array, float], Array]

Solver: TypeAlias = LinearSolver | Literal["auto"] | None

NO_SUPPORTS_MESSAGE = (
    "Iterative() solves under the supports of Reduction.dirichlet alone: static condensation and "
    "other reductions, and a pressure that is split, need Direct()"
)

# Options that would take the levels from their places
_LEVELS = re.compile(r"-?(pc_type|pc_mg_levels|mg_levels_(1_)?(pc_type|ksp_type))")
# Iterations allowed, and vectors kept to be orthogonal to
_MOST_ITERATIONS = 1000
_KEPT_VECTORS = 100
# Stiffnesses that differ by more than 1e5 make vectors lose their orthogonality
_GMRES: Options = {"ksp_converged_maxits": True, "ksp_gmres_cgs_refinement_type": "refine_ifneeded"}
# The true residual over what the method takes it for
_DRIFT = 10
_EPSILON = float(np.finfo(float).eps)
# Force of one piece on another over the stiffness that is more than round-off
_COUPLED = 1e-11
# Stiffness of a rigid motion over that of an arbitrary one: as good as none below
_FREE_STIFFNESS = 1e-8

# Bytes of MUMPS' LU factors and work space in space: coefficient and power of the unknowns,
# fitted to what MUMPS says of blocks of tetrahedra and hexahedra with 8 000 to 92 000 unknowns
_FACTOR_BYTES = 160.0
_FACTOR_POWER = 1.42

T = TypeVar("T")

# Unknowns in space from which on "auto" takes Krylov's method; for modes, which take some 50
# solutions, it is slower than factors until these take several gigabytes
_MANY = 15_000
_MANY_FOR_MODES = 200_000
# The same where contact alone holds a piece, which takes more iterations: a lap joint took factors
# and Krylov's method 2.7 and 4.2 CPU s for 14 310 unknowns, 16.5 and 12.2 s for 46 242
_MANY_LOOSE = 30_000
# Memory that has to be left, over what factors are expected to take, which is a fit
_SPARE_MEMORY = 2.0


class BlockTriangularPreconditioner:
    """The levels for one matrix (n, n) of hybrid spaces, in the place of a `Multigrid`.

    Pressures are scaled to lengths, as by `equilibration`: `scaled` is s K s, the operator Pi s K s
    Pi + (1 - Pi). `elastic` are the stiffness A of displacements, in blocks, and its supports,
    `levels` its multigrid, and `inner` a preconditioner of A by these, or in contact by `Sprung`.
    """

    def __init__(self, K: PETSc.Mat, supports: Supports) -> None:
        space, comm = supports.space, K.comm
        self._K = K
        self.displacements, self._p = SubSpace.displacements(space), SubSpace.pressure(space)
        self._scale, every = equilibration_scale(space, K), np.ones_like(supports.free)
        self.operator, self.scaled_matrix = (
            python_matrix(
                K.getSizes(),
                ConstrainedOperator(K, ConstraintProjection(free, 1), self._scale),
                comm,
            )
            for free in (supports.free, every)
        )
        own = supports.free[self.displacements.owned_unknowns.ravel()]
        self._free = supports.free[self._p.owned_unknowns.ravel()].astype(float)
        A = self._blocks()
        self.displacement_block = A, Supports(self.displacements.space, own)
        self.multigrid = Multigrid(*self.displacement_block)
        self.displacement_pc = PETSc.PC().create(comm)
        self._given, self._found = A.createVecs()
        self._pressed, self._rest = self._B.createVecLeft(), self._B.createVecLeft()

    def _blocks(self, A: PETSc.Mat | None = None) -> PETSc.Mat:
        """Makes the triangle's blocks of K; the first, which it returns, in a matrix given."""
        space = self.displacements.space
        u, p = (field.global_numbers() for field in (self.displacements, self._p))
        plain = self._K.createSubMatrix(u, u)
        plain.setBlockSize(space.mesh.geometry.dim)
        A = plain.convert("baij", A or PETSc.Mat())
        destroy_objects(plain)
        self._B = self._K.createSubMatrix(p, u)
        scales = self._p.extract(self._scale)
        S = _mass(space, self._p.space, A, self._B)
        volumes = self._K.createSubMatrix(p, p)
        S.axpy(-1.0, volumes, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        S.diagonalScale(scales, scales)
        self._B.diagonalScale(scales)
        self._pressure = _chebyshev(S, space.mesh.topology.cell_name())
        return A

    def refresh(self) -> None:
        self._blocks(self.displacement_block[0])
        self.multigrid.refresh()

    def set_up(self, preconditioner: PETSc.PC) -> None:
        self.displacement_pc.setOptionsPrefix(preconditioner.getOptionsPrefix())
        self.displacement_pc.setOperators(self.multigrid.operator)
        self.multigrid.set_up(self.displacement_pc)
        self.displacement_pc.setFromOptions()
        preconditioner.setType("python")
        preconditioner.setPythonContext(self)

    def release(self) -> None:
        destroy_objects(self.displacement_pc, self.operator, self.scaled_matrix)
        self.multigrid.release()

    def set_up_levels(self) -> None:
        """Makes the multigrid's coarse level, unless a constant pressure is free."""
        if self.has_free_constant_pressure(self.operator):
            raise FreePressure
        self.multigrid.set_up_levels()

    def has_free_constant_pressure(self, operator: PETSc.Mat) -> bool:
        """Whether a constant pressure does nothing under an operator (n, n), or a larger one."""
        constant, effect = operator.createVecs()
        pressures = self._p.embed(self._free)
        constant.array[: len(pressures)] = pressures
        operator.mult(constant, effect)
        largest = PETSc.NormType.INFINITY
        return bool(
            effect.norm(largest)
            <= PRESSURE_MODE_TOLERANCE * self.displacement_block[0].norm(largest)
        )

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        values = x.array_r
        self._given.setArray(values[self.displacements.owned_unknowns.ravel()])
        self.displacement_pc.apply(self._given, self._found)
        self._B.mult(self._found, self._rest)
        wanted = values[self._p.owned_unknowns.ravel()]
        self._rest.setArray((self._rest.array_r - wanted) * self._free)
        self._pressure.solve(self._rest, self._pressed)
        out = self.displacements.embed(self._found.array_r)
        p = np.where(self._free > 0, self._pressed.array_r, wanted)
        y.setArray(out + self._p.embed(p))


def _mass(
    displacements: fem.FunctionSpace, pressures: fem.FunctionSpace, A: PETSc.Mat, B: PETSc.Mat
) -> PETSc.Mat:
    """Mass matrix of pressures over twice the shear modulus, which A and B tell at vertices.

    A's product with linear functions is the stiffness of linear elements; B's with a unit strain,
    integrals of the vertices' functions. They have the thickness of plane bodies, and the radius.
    """
    mesh = displacements.mesh
    linear, _, P = linear_interpolation(displacements)
    u, v = ufl.TrialFunction(linear), ufl.TestFunction(linear)
    unit = assemble_matrix(fem.form(2 * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) * ufl.dx))
    unit.assemble()
    dim = mesh.geometry.dim
    mine, theirs = (
        matrix.getDiagonal().array_r.reshape(-1, dim).sum(axis=1)
        for matrix in (galerkin_product(A, P), unit)
    )
    q = ufl.TestFunction(pressures)
    areas = assemble_vector(fem.form(q * ufl.dx))
    areas.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    strained, volumes = B.createVecs()
    x = displacements.tabulate_dof_coordinates()[: strained.getLocalSize() // dim]
    strained.array.reshape(-1, dim)[:, -1] = x[:, dim - 1]
    B.mult(strained, volumes)
    thickness, modulus = np.abs(volumes.array_r / areas.array_r), np.abs(mine / theirs)
    weight = fem.Function(pressures)
    weight.x.array[: len(modulus)] = thickness**2 / (2 * modulus)
    weight.x.scatter_forward()
    mass = assemble_matrix(fem.form(weight * ufl.TrialFunction(pressures) * q * ufl.dx))
    mass.assemble()
    return mass


def _chebyshev(matrix: PETSc.Mat, cell: str) -> PETSc.KSP:
    least, largest, degree = _MASS[cell]
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOperators(matrix)
    ksp.setType("chebyshev")
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    ksp.setTolerances(max_it=degree)
    ksp.getPC().setType("jacobi")
    set_options(ksp, {"ksp_chebyshev_eigenvalues": f"{least},{largest}"})
    return ksp


@dataclass(frozen=True)
class Iterative:
    """Right-preconditioned GMRES with two-level p-multigrid, for quadratic elements.

    The coarse level is the stiffness of linear elements, P^T K P, under one cycle of algebraic
    multigrid that knows the rigid motions; the smoother treats nodes as blocks. It takes some
    25 iterations for ten digits whatever the size of the mesh, at a Poisson's ratio of 0.3, and
    several times as many near 1/2; in hybrid spaces some 50 are enough at any ratio. It accepts
    the supports of `Reduction.dirichlet`, but no condensation, and computes no determinants.

    Args:
        tolerance: of the residual over the load, in the Euclidean norm; in contact over the largest
            nodal contact force, and never above 1e-10, a tenth of the tolerance of the law.
        options: PETSc options without prefix and hyphen, such as
            `{"mg_levels_1_ksp_max_it": 4, "mg_coarse_pc_gamg_threshold": 0.02}`; `ksp_type` sets
            the method and `ksp_max_it` its iterations. The two levels cannot be exchanged.

    Raises:
        TypeError, ValueError: for a tolerance that is not between 0 and 1, or invalid options; once
            it solves, for those that are not used.
    """

    matrix_free: ClassVar[bool] = True
    tolerance: float = 1e-11
    options: Options = field(default_factory=dict)

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        if not 0 < arguments.check_number("tolerance", self.tolerance) < 1:
            raise ValueError(f"tolerance = {self.tolerance}: has to lie between 0 and 1")
        check_options(self.options)
        for name, value in self.options.items():
            if _LEVELS.fullmatch(name) or (value in ("preonly", "none") and "ksp_type" in name):
                raise ValueError(
                    f"option {name} = {value}: what Iterative() is made of cannot be exchanged; "
                    "Direct() has factors, mg_coarse_ the coarse level's own options"
                )

    @check_same_arguments
    def prepare(
        self, matrix: PETSc.Mat, symmetric: bool = False, supports: Supports | None = None
    ) -> "KrylovSolver":
        """Binds the method to a free matrix (n, n) under supports.

        Args:
            matrix: free (n, n).
            symmetric: whether the pair of an eigenvalue problem is to be taken as symmetric.
            supports: of `Reduction.dirichlet`.

        Raises:
            ValueError: without supports, or for a symmetric pair of eigenvalue problems.
        """
        if supports is None:
            raise ValueError(NO_SUPPORTS_MESSAGE)
        arguments.check_type("supports", supports, Supports, "a reduction's `supports` are some")
        arguments.check_flag("symmetric", symmetric)
        with collective_errors(supports.space.mesh.comm):
            arguments.check_matrix("the matrix", matrix)
        if symmetric:
            raise ValueError(
                "Iterative() does not count negative pivots, without which a symmetrised pair is "
                "not known to be positive definite: use Direct()"
            )
        with name_options_in_errors(self.options):
            return KrylovSolver(matrix, supports, self)


class KrylovSolver:
    """Iterative solutions with one free matrix under supports, of all n unknowns.

    The stiffness of displacements, free, and their supports are `elastic`.
    """

    determinant_signs: ClassVar[tuple[int, ...]] = ()  # determinants and pivots are not known
    negative_pivots: ClassVar[None] = None

    def __init__(
        self, matrix: PETSc.Mat, supports: Supports, how: Iterative, foreign: _Iterate | None = None
    ) -> None:
        self._matrix, self._foreign, self.tolerance = matrix, foreign, how.tolerance
        self.options, self.uses_external_method = how.options, foreign is not None
        self._counted: list[int] = []  # iterations, by each call of PETSc's monitor
        self._stiffness = -1, 0.0  # its norm, at a state of the matrix
        saddle = (
            BlockTriangularPreconditioner(matrix, supports) if is_hybrid(supports.space) else None
        )
        self.block_preconditioner, self.displacement_block = (
            saddle,
            saddle.displacement_block if saddle else (matrix, supports),
        )
        self.multigrid = saddle.multigrid if saddle else Multigrid(matrix, supports)
        self.preconditioner: Multigrid | BlockTriangularPreconditioner = saddle or self.multigrid
        self.operator = self.preconditioner.operator
        self.ksp = self._method_for(self.operator, "gmres")
        # the levels take over the prefix
        self.preconditioner.set_up(self.ksp.getPC())
        self.ksp.getPC().setFromOptions()
        how_inside = " in a block triangle" if saddle else ""
        self._method = f"{self.ksp.getType().upper()} with p-multigrid{how_inside}"

    def create_flexible_ksp(self, operator: PETSc.Mat, preconditioner: object | None) -> PETSc.KSP:
        """For a few iterations with another matrix, and a preconditioner in Python or the levels.

        It keeps what the preconditioner makes of each vector, or would have to apply it once more.
        """
        ksp = self._method_for(operator, "fgmres")
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

    def _method_for(self, operator: PETSc.Mat, kind: str) -> PETSc.KSP:
        ksp = PETSc.KSP().create(operator.comm)
        ksp.setOperators(operator)
        if self._foreign is not None:
            ksp.setType("python")
            ksp.setPythonContext(_Foreign(self._foreign))
            return ksp
        ksp.setType(kind)
        ksp.setGMRESRestart(_KEPT_VECTORS)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=self.tolerance, atol=0.0, max_it=_MOST_ITERATIONS)
        ksp.setComputeEigenvalues(True)
        counted = self._counted  # a method would make a cycle that is never freed
        ksp.setMonitor(lambda _, iteration, __: counted.append(int(iteration > 0)))
        # residuals are judged here, not by an error of PETSc's
        set_options(ksp, {**_GMRES, **self.options})
        return ksp

    @property
    def report(self) -> SolverReport:
        return SolverReport(self._method, 0, sum(self._counted))

    def set_up(self) -> None:
        """Refuses a body that supports do not hold."""
        if has_free_rigid_motion(*self.displacement_block):
            raise SingularSystem("the system matrix is singular")
        self.preconditioner.set_up_levels()

    def solve(self, rhs: PETSc.Vec) -> PETSc.Vec:
        """Solution (n,); the right-hand side is zero where values are prescribed."""
        self.set_up()
        solution, step = rhs.duplicate(), rhs.duplicate()
        rest, size = rhs.copy(), rhs.norm()
        # Rounding makes the residual that GMRES updates drift from the true one
        for _ in range(2):
            solve_with_ksp(self.ksp, rest, step, self.options)
            solution.axpy(1.0, step)
            self.operator.mult(solution, rest)
            rest.aypx(-1.0, rhs)
            left = rest.norm()
            if left <= self.tolerance * size:
                break
        if not left <= _DRIFT * self.tolerance * size + self.round_off(solution.norm()):
            raise self.not_converged(left / size)
        return solution

    def round_off(self, size: float) -> float:
        """Residual that may be nothing but round-off, of a solution with the norm `size`."""
        matrix = self.displacement_block[0]
        if self._stiffness[0] != matrix.stateGet():
            self._stiffness = matrix.stateGet(), matrix.norm(PETSc.NormType.INFINITY)
        return float(_DRIFT * _EPSILON * self._stiffness[1] * size)

    def not_converged(self, left: float) -> NotConverged:
        dofs = self._matrix.getSize()[0]
        return NotConverged(
            f"{self.report.method} left the relative residual {left:.1e} after "
            f"{sum(self._counted)} iterations in all: Poisson's ratio near 1/2, flat cells or "
            "supports that hardly hold make it slow; use Direct() "
            f"(some {memory_of_factors(dofs) / 1e9:.2g} GB in space), or raise ksp_max_it"
        )

    def solve_with_changed_rows(self, rhs: PETSc.Vec, rows: Indices) -> None:  # noqa: ARG002
        """Nothing: there are no old factors."""
        return


class _Foreign:
    """Another's Krylov method, for a `PETSc.KSP` in Python."""

    def __init__(self, iterate: _Iterate) -> None:
        self._iterate = iterate
        self.failed: BaseException | None = None  # PETSc would make an error of its own of it

    def solve(self, ksp: PETSc.KSP, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        comm, self.failed = right.comm.tompi4py(), None

        def of(apply: Callable[[PETSc.Vec, PETSc.Vec], None]) -> Callable[[Array], Array]:
            x, y = right.duplicate(), right.duplicate()

            def image(values: Array) -> Array:
                with collective_errors(comm) as same:  # all still iterate, and ask for the same
                    same["the next step of iterate"] = apply.__name__
                    x.setArray(_own(values, x))
                apply(x, y)
                return np.array(y.array_r)

            return image

        product, precondition = of(ksp.getOperators()[0].mult), of(ksp.getPC().apply)
        size = ksp.getTolerances()[1]
        try:
            with collective_errors(comm):
                found = self._iterate(product, precondition, np.array(right.array_r), size)
                solution.setArray(_own(found, right))
        except BaseException as error:
            self.failed = error
        ksp.setConvergedReason(PETSc.KSP.ConvergedReason.CONVERGED_ATOL)


def solve_with_ksp(ksp: PETSc.KSP, right: PETSc.Vec, solution: PETSc.Vec, options: Options) -> None:
    """Solves by a method, PETSc's or another's, whose own errors are raised."""
    with name_options_in_errors(options):
        ksp.solve(right, solution)
    refuse_unused_options(ksp, options)
    if ksp.getType() == "python" and (failed := ksp.getPythonContext().failed):
        raise failed


def _own(values: Array, like: PETSc.Vec) -> Array:
    layout = "it takes and gives this process' part of vectors (n,)"
    return arguments.check_function_values("iterate", np.ravel(values), like.array_r.shape, layout)


def as_krylov_solver(solver: PreparedSolver, matrix: PETSc.Mat, supports: Supports) -> KrylovSolver:
    """A prepared `Iterative` itself; the levels of one around the `iterate` of another solver."""
    if isinstance(solver, KrylovSolver):
        return solver
    iterate = getattr(solver, "iterate", None)
    if not callable(iterate):
        raise TypeError(
            f"contact needs of a matrix-free solver what {type(solver).__name__} has not: a method "
            "iterate(product, precondition, right, size), which returns an x"
        )
    return KrylovSolver(matrix, supports, Iterative(), iterate)


@dataclass(frozen=True)
class RigidComponents:
    """Connected pieces of a mesh, sorted by their centres, and rigid motions of their nodes.

    Modes (k) of a piece are its translations and rotations about its centre, over its length, so
    that displacements are of the translations' size. A field that is no displacement has its
    constants in their place.
    """

    component_of_node: Indices  # (nodes,) of each node's piece, ghosts too
    centre: Array  # (pieces, dim), mean of its nodes' positions
    length: Array  # (pieces,), their radius of gyration
    modes: Array  # (owned nodes, block, k), of each node in its piece's modes
    comm: MPI.Comm

    @classmethod
    def from_space(cls, space: fem.FunctionSpace) -> "RigidComponents":
        comm, dim, block = space.mesh.comm, space.mesh.geometry.dim, space.dofmap.index_map_bs
        number, count = connected_components(comm, space.dofmap.index_map, space.dofmap.list)
        owned = number[: space.dofmap.index_map.size_local]

        def total(values: Array) -> Array:
            sums = np.zeros((count, values.shape[1]))
            np.add.at(sums, owned, values)
            comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
            return sums

        x, nodes = space.tabulate_dof_coordinates()[: len(owned), :dim], np.ones((len(owned), 1))
        centre = total(x) / total(nodes)
        away = x - centre[owned]
        length = np.sqrt(total(np.sum(away**2, axis=1)[:, None]) / total(nodes))[:, 0]
        away /= length[owned, None]
        planes = list(combinations(range(dim), 2)) if block == dim else []
        motion = np.zeros((len(owned), block, block + len(planes)))
        motion[:, :, :block] = np.eye(block)
        for k, (i, j) in enumerate(planes, start=block):
            motion[:, i, k], motion[:, j, k] = -away[:, j], away[:, i]
        order = np.lexsort(np.round(np.column_stack([length, centre[:, ::-1]]) / length.max(), 9).T)
        return cls(np.argsort(order)[number], centre[order], length[order], motion, comm)

    def mode_matrix(self, values: Array, n_other_modes: int = 0) -> sp.csr_array:
        """Values (owned nodes, block, k) in their pieces' modes: (owned dofs, modes and others)."""
        n, block, k = values.shape
        mode = np.broadcast_to(
            self.component_of_node[:n, None, None] * k + np.arange(k), values.shape
        )
        known = values != 0
        pointers = np.append(0, np.cumsum(known.sum(axis=2)))
        shape = n * block, len(self.centre) * k + n_other_modes
        return sp.csr_array((values[known], mode[known], pointers), shape)

    def resistance(
        self,
        K: PETSc.Mat,
        free: Mask,
        rows: LocalIndices | None = None,
        transposed: bool = False,
        n_other_modes: int = 0,
    ) -> sp.csr_array:
        """Motions (owned dofs, modes and others) where they are prescribed, and forces elsewhere.

        Forces K m or K^T m count over the largest stiffness. `at` (owned dofs,) are rows of K, if
        it has more unknowns than these displacements. `free` (owned dofs,).
        """
        where = np.arange(len(free), dtype=np.int32) if rows is None else rows
        product = K.multTranspose if transposed else K.mult
        free, diagonal = free.reshape(self.modes.shape[:2]), K.getDiagonal()
        largest = np.abs(diagonal.array_r[where]).max(initial=0.0)
        size = self.comm.allreduce(largest, MPI.MAX)
        moved, image = K.createVecs()

        def forces(of: Array) -> Array:
            moved.array[where] = np.where(free, of, 0.0).ravel()
            product(moved, image)
            return image.array_r[where].reshape(free.shape)

        def resistance(motion: Array) -> Array:
            each = [np.where(free, forces(of) / size, of) for of in np.moveaxis(motion, 2, 0)]
            return np.stack(each, axis=2)

        if not self._coupled(forces, size):
            return self.mode_matrix(resistance(self.modes), n_other_modes)
        number, shape = (
            self.component_of_node[: len(free), None, None],
            (len(where), self.modes.shape[2]),
        )
        alone = [
            sp.csr_array(resistance(np.where(number == k, self.modes, 0.0)).reshape(shape))
            for k in range(len(self.centre))
        ]
        return sp.csr_array(sp.hstack([*alone, sp.csr_array((len(where), n_other_modes))]))

    def _coupled(self, forces: Callable[[Array], Array], size: float) -> bool:
        """Whether pieces act on each other, by springs, say: they cannot be moved all at once."""
        if len(self.centre) == 1:
            return False
        nodes, block, _ = self.modes.shape
        arbitrary = 1.0 + np.cos(np.arange(nodes * block)).reshape(nodes, block)
        weight = 1.0 + np.cos(self.component_of_node[:nodes, None])
        apart = np.abs(forces(weight * arbitrary) - weight * forces(arbitrary)).max(initial=0.0)
        return bool(self.comm.allreduce(apart, MPI.MAX) > _COUPLED * size)


def has_free_rigid_motion(K: PETSc.Mat, supports: Supports) -> bool:
    """Whether a rigid motion of a connected piece meets neither supports nor stiffness."""
    pieces = RigidComponents.from_space(supports.space)
    held = qr_triangle(pieces.resistance(K, supports.free), pieces.comm)
    return len(null_space(held, _FREE_STIFFNESS)) > 0


def memory_of_factors(dofs: int) -> float:
    """Bytes that LU factors in space take, by a fit: within a factor of two."""
    return float(_FACTOR_BYTES * dofs**_FACTOR_POWER)


def free_memory(comm: MPI.Comm) -> float:
    """Bytes that the machines of all processes have left, the same on all of them."""
    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    # one process of each machine speaks for it; limits of single processes' groups count there
    own = machine.allreduce(_free_here(), MPI.MIN)
    total = comm.allreduce(own if machine.rank == 0 else 0.0, MPI.SUM)
    machine.Free()
    return float(total)


def _free_here() -> float:
    """Bytes left on this machine, to a container or job of a limited memory."""
    try:
        told = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        left = 1024.0 * int(told["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):  # no Linux
        left = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    try:
        group = Path("/proc/self/cgroup").read_text().rpartition("0::/")[2].strip()
        limits = Path("/sys/fs/cgroup") / group
        most, taken = ((limits / f"memory.{name}").read_text() for name in ("max", "current"))
        return min(left, float(most) - float(taken))
    except (OSError, ValueError):  # none, or "max"
        return left


def choose_solver(
    solver: Solver,
    supports: Supports | None,
    factors_reason: str = "",
    for_modes: bool = False,
    contact_stiffness: PETSc.Mat | None = None,
) -> LinearSolver:
    """The solver that is meant; `needs_factors` says why only factors will do.

    A body `in_contact`, whose stiffness that is, may be one that its supports do not hold.
    """
    if solver is not None and not isinstance(solver, str):
        return solver
    if not (solver is None or arguments.is_one_of(solver, ("auto",))):
        raise ValueError(f'solver {solver!r}: use Direct(), Iterative() or "auto"')
    if supports is None:
        return Direct()
    mesh, dofs = supports.space.mesh, vector_sizes(supports.space)[1]
    if mesh.geometry.dim < 3 or dofs < (_MANY_FOR_MODES if for_modes else _MANY):
        return Direct()
    small = contact_stiffness is not None and dofs < _MANY_LOOSE and not is_hybrid(supports.space)
    if small and has_free_rigid_motion(contact_stiffness, supports):
        log_on_root(
            mesh.comm, logging.INFO, f"auto: Direct for {dofs} unknowns that contact has to hold"
        )
        return Direct()
    taken: LinearSolver = Direct() if factors_reason else Iterative()
    why, needed = f" ({factors_reason})" if factors_reason else "", memory_of_factors(dofs) / 1e9
    what = f"{type(taken).__name__} for {dofs} unknowns in space{why}"
    log_on_root(mesh.comm, logging.INFO, f"auto: {what}; factors take some {needed:.2g} GB")
    return taken


def compute_with_fallback(
    taken: LinearSolver,
    solver: Solver,
    supports: Supports | None,
    compute: Callable[[LinearSolver], T],
) -> T:
    """Computes with `taken`; if "auto" took it and it gives up, with factors, given the memory."""
    try:
        return compute(taken)
    except NotConverged as failure:
        if supports is None or solver not in (None, "auto"):
            raise
        comm = supports.space.mesh.comm
        needed, left = memory_of_factors(vector_sizes(supports.space)[1]), free_memory(comm)
        if not _SPARE_MEMORY * needed <= left:
            raise NotConverged(
                f'{failure}. "auto" does not use Direct() with {left / 1e9:.2g} GB left'
            ) from failure
    memory = f"factors take some {needed / 1e9:.2g} of {left / 1e9:.2g} GB"
    log_on_root(comm, logging.INFO, f"auto: Iterative gave up, Direct goes on; {memory}")
    return compute(Direct())  # whatever the first attempt took has been freed
