"""The linear system of one active set: the law in place of one equation per component of force.

The guide's page on theory has its rows ("The linear system"). Where surfaces turn, their motions
have angles, too, and sums are those of a `TorqueMap`. The nonzero pattern is that of all active
sets: its rows are built once, before the iteration. `KrylovTangent` assembles nothing instead.
"""

from collections.abc import Callable
from functools import partial
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements._compat import single_entry_matrix
from pw_elements.algebra import (
    Reduction,
    constrained_operator,
    has_free_constant_pressure,
    reduce_matrix,
)
from pw_elements.arrays import Array
from pw_elements.contact.interface import Interface
from pw_elements.contact.model import FreeMotions
from pw_elements.contact.nodes import LinearisedLaw, TorqueMap
from pw_elements.contact.system.assembled import (
    AssembledTangent,
    CsrArrays,
    PointRows,
    balance_rows,
    border_columns,
    local_rows,
    own_entries,
    read_and_spread,
    with_points,
)
from pw_elements.contact.system.krylov import KrylovTangent
from pw_elements.contact.system.solution import Accuracy, Solution, TangentSolution
from pw_elements.contact.system.unassembled import NodePoints, stated_mean
from pw_elements.solvers import (
    LinearSolver,
    PreparedSolver,
    SolverReport,
    add_scaled,
    is_matrix_free,
)


class ContactTangent(Protocol):
    """The linear system of any active set, and how it is solved.

    Attributes:
        solves_exactly: whether all solutions are as exact as they can be.
        solver: of the linear systems.
    """

    solves_exactly: bool
    solver: PreparedSolver

    def start(self, unknowns: Callable[[], Array], free_motions: Array) -> None:
        """Supply the iterate (n,) of this process at which an increment starts."""

    def set_springs(self, springs: Array) -> None:
        """Set the stiffness (free,) by which friction on supports holds each free motion."""

    def renew(self, rows: Callable[[], tuple[PointRows, CsrArrays]], pattern_changed: bool) -> None:
        """Rebuild for a K that has changed; `rows` assembles the matrix."""

    def solve(
        self, right: Array, balance: Array, law: LinearisedLaw, accuracy: Accuracy
    ) -> TangentSolution:
        """Solve for an active set, with right-hand sides of this process and of free motions.

        Raises:
            SingularSystem: if there is no unique solution.
            NotConverged: if an iterative solver fails.
        """

    def determinant_signs(self) -> tuple[int, ...]:
        """Return signs besides those that the solver tells by its determinants."""

    def encloses(self) -> bool:
        """Return whether a constant pressure in an incompressible body acts on the points alone."""

    def release(self) -> None:
        """Free the memory of the solver."""


class ContactSystem:
    """Equations of the reduced displacements and of the free translations of surfaces.

    The free translations, angles among them, come last, on the last process; their equations are
    balances of force and torque. Of the law, c is `scale` (m,): the mean stiffness of a point's
    components, or 1 without any.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        interface: Interface,
        free: FreeMotions,
        solver: LinearSolver,
        torque_map: TorqueMap,
    ) -> None:
        self.reduction, self.interface, self.free = reduction, interface, free
        self.springs: Array = np.zeros(len(free))  # of free translations, see `solve_with_springs`
        self._torque_map = torque_map
        self.comm: MPI.Comm = interface.comm
        self.n_solved = 0
        self.stiffness = (
            constrained_operator(reduction, K) if is_matrix_free(solver) else reduction.matrix(K)
        )
        self._motion_sizes = interface.motion.copy()
        rows = interface.motion.getValuesCSR()
        self._motion_sizes.setValuesCSR(*rows[:2], np.abs(rows[2]))
        self._motion_sizes.assemble()
        (first, last), stated = self.stiffness.getOwnershipRange(), interface.equation >= 0
        self._equations = np.where(stated, interface.equation - first, -1)
        self.set_force_operator(interface.force)
        self.tangent: ContactTangent
        self._motion = interface.motion
        moved = local_rows(interface.motion.matMult(reduction.right), len(free))
        unit = own_entries(moved, interface.equation)
        if is_matrix_free(solver):
            if any(axis == interface.position.shape[1] for _, axis in free):
                raise ValueError("surfaces that are free to turn need a solver such as Direct()")
            assert reduction.supports is not None, "other reductions are refused before"
            stiffness = K.getDiagonal().array_r[self._equations] * self._flexible
            self.scale = stated_mean(stiffness / unit, stated)
            of_points = self._equations, self._flexible, self.scale, free
            points = NodePoints.of(interface, self._force, self._spread, *of_points)
            self.tangent = KrylovTangent(K, reduction.supports, points, solver, self.stiffness)
            return
        self._moved = moved
        borders = border_columns(free, interface.pair, torque_map.V.shape[2])
        before = sp.csr_matrix((borders.shape[0], moved.shape[1] - len(free)))
        self._borders = sp.hstack([before, borders], "csr")
        read, rows, csr = self._assemble_rows()
        self.scale = stated_mean(own_entries(read, interface.equation) / unit, stated)
        sizes = len(csr[0]) - 1, read.shape[1]
        matrix = PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=self.comm)
        enclosed = partial(
            has_free_constant_pressure, self.stiffness, reduction, self._equations[stated]
        )
        borders = len(csr[0]) - 1 - (last - first)
        self.tangent = AssembledTangent(matrix, rows, first, borders, solver, enclosed)

    def _assemble_rows(self) -> tuple[sp.csr_matrix, PointRows, CsrArrays]:
        """Return L K, the points' rows, and the matrix that contains them."""
        K, equation, sizes = self.stiffness, self.interface.equation.ravel(), self._force.getSizes()
        L = single_entry_matrix(equation, sizes, self.comm, self._flexible.ravel())
        forces = L.matMult(K)
        if self._spread is not None:
            fixed = self._spread.transposeMatMult(forces)
            add_scaled(fixed, 1.0, K, destroy_term=False)
            K = fixed
        fixed, read = (local_rows(part, len(self.free)) for part in (K, forces))
        rows = PointRows(read, self._moved, self._borders, self._equations)
        border = balance_rows(self._balances(read), self.springs, self.comm)
        return read, rows, with_points(fixed, rows, border)

    def _balances(self, read: sp.csr_matrix) -> sp.coo_matrix:
        """Return the resultants (free, n) of this process' points on free motions; zeros stay."""
        (m, dim), torque_map = self._equations.shape, self._torque_map
        row, column, value = ([np.empty(0, dtype)] for dtype in (np.int64, np.int64, float))
        for number, (pair, axis) in enumerate(self.free):
            mine = np.flatnonzero(self.interface.pair == pair)
            parts: list[tuple[sp.csr_matrix, int, Array]] = [(read, axis, np.ones((m, 1)))]
            if axis == dim:
                factors = torque_map.V[:, :, axis], -torque_map.w, torque_map.w
                sources = read, self._moved, self._borders
                parts = [(rows, 0, factor) for rows, factor in zip(sources, factors, strict=True)]
            for rows, first, point_factors in parts:
                rows_per_point, factor = rows.shape[0] // max(m, 1), point_factors[mine]
                row_number = first + mine[:, None] * rows_per_point + np.arange(factor.shape[1])
                entries = rows[row_number.ravel()].tocoo()
                row.append(np.full(entries.nnz, number))
                column.append(entries.col)
                value.append(factor.ravel()[entries.row] * entries.data)
        indices = np.concatenate(row), np.concatenate(column)
        shape = len(self.free), read.shape[1]
        return sp.coo_matrix((np.concatenate(value), indices), shape)

    def set_force_operator(self, force: PETSc.Mat) -> None:
        """Set H, (n, m dim)."""
        self.force_operator = force
        self._force = force.transposeMatMult(self.reduction.left)  # (points dim, equations)
        self._flexible, self._spread = read_and_spread(self._force, self.interface.equation)

    def renew(self, K: PETSc.Mat, torque_map: TorqueMap) -> None:
        """Rebuild for another K (n, n) and torques; pattern and scale of the law stay."""
        self._torque_map = torque_map

        def assemble() -> tuple[PointRows, CsrArrays]:
            self.stiffness = reduce_matrix(self.reduction, K)
            return self._assemble_rows()[1:]

        self.tangent.renew(assemble, pattern_changed=False)

    def renew_with_motion(self, K: PETSc.Mat, torque_map: TorqueMap, motion: PETSc.Mat) -> None:
        """Rebuild for another K (n, n), torques and G (m p, n) of another pattern."""
        self._torque_map = torque_map

        def assemble() -> tuple[PointRows, CsrArrays]:
            self.stiffness = reduce_matrix(self.reduction, K)
            self._motion = motion
            self._moved = local_rows(motion.matMult(self.reduction.right), len(self.free))
            return self._assemble_rows()[1:]

        self.tangent.renew(assemble, pattern_changed=True)

    def renew_with_springs(self, K: PETSc.Mat, springs: Array) -> None:
        """Rebuild for another K (n, n) and springs (free,) of the free translations."""
        self.springs = springs
        self.renew(K, self._torque_map)

    def start(self, unknowns: Callable[[], PETSc.Vec], q: Array) -> None:
        """Supply the iterate, unknowns (n,) and motions q (pairs, k), of an iterative solver."""

        def scaled_unknowns() -> Array:
            scale = self.reduction.right.getDiagonal().array_r
            return np.divide(unknowns().array_r, scale, out=0 * scale, where=scale != 0)

        self.tangent.start(scaled_unknowns, self.select_free(q))

    def select_free(self, q: Array) -> Array:
        """Return the free ones (free,) of the surfaces' motions q (pairs, k)."""
        return np.array([q[index] for index in self.free])

    def with_free(self, q: Array, free_motions: Array) -> Array:
        """Return motions q (pairs, k), NaN where they are free, with the free ones filled in."""
        q = q.copy()
        q[np.isnan(q)] = free_motions
        return q

    @property
    def report(self) -> SolverReport:
        return self.tangent.solver.report

    def solve(
        self,
        load: PETSc.Vec,
        law: LinearisedLaw,
        totals: Array,
        *,
        torque_map: TorqueMap,
        accuracy: Accuracy = "final",
        friction_springs: Array | float = 0.0,
    ) -> Solution:
        """Solve equilibrium under a reduced load with the law at every contact point.

        Args:
            load: f, reduced.
            law: linearised, of what is free.
            totals: (free,), forces and torques on the free motions.
            torque_map: of what is free.
            accuracy: of the solution, as far as the solver is iterative.
            friction_springs: (free,), stiffness by which friction on supports holds free motions.
        """
        self.n_solved += 1
        if self.free:
            self.tangent.set_springs(np.broadcast_to(friction_springs, len(self.free)))
        right, balance = self.right_hand_sides(load, law, totals, torque_map)
        solution = self.tangent.solve(right, balance, law, accuracy)
        reduced = load.duplicate()
        reduced.setArray(solution.unknowns[: len(right)])
        free = self.comm.bcast(solution.unknowns[len(right) :], self.comm.size - 1)
        return Solution(reduced, np.array(free), solution.is_exact, solution.is_final)

    def right_hand_sides(
        self, load: PETSc.Vec, law: LinearisedLaw, totals: Array, torque_map: TorqueMap
    ) -> tuple[Array, Array]:
        """Return right-hand sides of this process' equations, and of free motions."""
        point_load, right = self._read(load), self._subtract_read(load)
        stated = self._equations >= 0
        law_right = np.einsum("nab,nb->na", law.E, point_load) + law.c
        right[self._equations[stated]] = law_right[stated]
        if not self.free:
            return right, totals
        known = torque_map.resultants(point_load)
        known[:, -1] -= np.sum(torque_map.w * torque_map.d0, axis=1)
        return right, totals + self.totals(known)

    def weigh_forces(self, force: Array) -> PETSc.Vec:
        """Return reduced weights of equations whose sum is that of forces by weights (m, dim)."""
        stated, weights = self._equations >= 0, self.reduction.left.createVecRight()
        weights.array[self._equations[stated]] = (force * self._flexible)[stated]
        return weights

    def at_points(self, equations: Array) -> Array:
        """Return values (m, dim) of this process' equations at the points; 0 without any."""
        return np.where(self._equations >= 0, equations[self._equations], 0.0)

    def forces(self, residual: PETSc.Vec) -> tuple[Array, Array]:
        """Return forces r (m, dim) of the points, and sizes of unbalanced forces in equations."""
        unbalanced = np.abs(self._subtract_read(residual))
        unbalanced[self._equations[self._equations >= 0]] = 0.0
        return self._read(residual), unbalanced

    def point_displacements(self, displacement: PETSc.Vec) -> Array:
        """G a, (m, dim), of a full displacement vector (n,)."""
        return np.array(
            (self.interface.motion * displacement).array_r.reshape(self._equations.shape)
        )

    def point_motions(self, displacement: PETSc.Vec) -> Array:
        """Motions v = G a of the law, (m, p), of a full displacement vector (n,)."""
        m, dim = self._equations.shape
        n_motions = dim * self._motion.getSize()[0] // self.interface.motion.getSize()[0]
        return np.array((self._motion * displacement).array_r.reshape(m, n_motions))

    def displacement_sizes(self, displacement: PETSc.Vec) -> Array:
        """|G| |a|, (m, dim): how far a point and what it faces have moved together."""
        size = displacement.copy()
        size.abs()
        return np.array((self._motion_sizes * size).array_r.reshape(self._equations.shape))

    def totals(self, forces: Array) -> Array:
        """Return the sums (free,) of forces on motions (m, k) at the points of all processes."""
        pair = self.interface.pair
        sums = np.array([forces[pair == k, axis].sum() for k, axis in self.free])
        self.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return sums

    def balance_residuals(
        self, force: Array, q: Array, totals: Array, torque_map: TorqueMap, size: float
    ) -> Array:
        """Return the unbalanced forces (free,) on the free motions, over a size and lever arms.

        Args:
            force: of the surfaces on the points, (m, dim).
            q: motions of the surfaces, (pairs, k).
            totals: (free,), forces given on the free motions.
            torque_map: of the surfaces.
            size: force that residuals are over.
        """
        if not self.free:
            return np.zeros(0)
        unbalanced = self.totals(torque_map.resultants(force)) - totals
        unbalanced += self.springs * self.select_free(q)
        return np.asarray(np.abs(unbalanced) / (size * self._lever_arms(torque_map)))

    def _lever_arms(self, torque_map: TorqueMap) -> Array:
        """Return the longest lever arm of each free motion; 1 of translations."""
        size = np.linalg.norm(torque_map.V, axis=1)
        pair, tiny = self.interface.pair, np.finfo(float).tiny
        longest = np.array([size[pair == k, axis].max(initial=tiny) for k, axis in self.free])
        self.comm.Allreduce(MPI.IN_PLACE, longest, MPI.MAX)
        return longest

    def _read(self, equations: PETSc.Vec) -> Array:
        """L x, (m, dim), of a reduced vector; 0 where the law is not stated."""
        return self.at_points(equations.array_r) * self._flexible

    def _subtract_read(self, equations: PETSc.Vec) -> Array:
        """(I - H L) x on this process: equations less what `_read` takes of them."""
        local: Array = equations.array_r.copy()
        if self._spread is None:
            return local
        read, spread = self._spread.createVecLeft(), equations.duplicate()
        read.setArray(self._read(equations))
        self._spread.multTranspose(read, spread)
        return local + spread.array_r
