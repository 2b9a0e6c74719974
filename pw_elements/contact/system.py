"""The linear system of one active set: the law in place of one equation per component of force.

With K and f reduced by the supports, the forces at the contact points are read from their own
equations, r = L (K a - f), and taken out of all others, K' = K - H L K without these. The law's
linearisation E r + C G a - D U = c stands in the places that have become free, and the balance of
the free translations U at the end:

    K' a                    = f'        all equations but the contact points' own
    (E L K + C G) a - D U   = c + E L f     theirs
    sum L K a               = totals + sum L f

The nonzero pattern is that of all active sets. `krylov.KrylovTangent` assembles nothing instead.
"""

from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.algebra import free_pressure
from pw_elements.contact.assembly import (
    PointRows,
    balance_rows,
    border_columns,
    local_rows,
    own_entries,
    read_and_spread,
    stated_mean,
    tangent_rows,
    with_points,
)
from pw_elements.contact.interface import Interface
from pw_elements.contact.krylov import KrylovTangent
from pw_elements.contact.state import Free
from pw_elements.contact.unassembled import NodePoints
from pw_elements.iterative import Iterative
from pw_elements.linear_solver import LinearSolver, SolverReport
from pw_elements.matrices import destroy
from pw_elements.reduction import Reduction

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# What does not count as different
_SAME = 1e-12


class ContactSystem:
    """Equations of the reduced displacements and of the free translations of surfaces.

    The free translations come last, on the last process; their equations are balances of force.

    Args:
        K: free stiffness, (n, n).
        reduction: supports.
        interface: contact points, m of this process.
        free: (pair, component) of each free translation.
        solver: of the linear systems.

    Attributes:
        stiffness: K reduced, L^T K R of the reduction.
        solved: number of linear systems solved so far.
        tangent: matrix and solver of the systems.
        scale: c of the law, (m,): mean stiffness of a point's components, or 1 without any.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        interface: Interface,
        free: Free,
        solver: LinearSolver,
    ) -> None:
        self.reduction, self.interface, self.free = reduction, interface, free
        self.comm: MPI.Comm = interface.comm
        self.solved = 0
        self._found: tuple[PETSc.Vec, PETSc.Vec, tuple[Array, float]] | None = None
        reduced = reduction.supported if isinstance(solver, Iterative) else reduction.matrix
        self.stiffness = reduced(K)
        (first, last), stated = self.stiffness.getOwnershipRange(), interface.equation >= 0
        self._own = np.where(stated, interface.equation - first, -1)
        outside = stated & ((self._own < 0) | (self._own >= last - first))
        if self.comm.allreduce(int(outside.any()), MPI.MAX):
            raise ValueError("the reduction moves a contact node to another process")
        force = interface.force.transposeMatMult(reduction.left)  # (points dim, equations)
        self._flexible, self._spread = read_and_spread(force, interface.equation)
        self.tangent: Tangent | KrylovTangent
        moved = local_rows(interface.motion.matMult(reduction.right), len(free))
        unit = own_entries(moved, interface.equation)
        if isinstance(solver, Iterative):
            assert reduction.supports is not None, "other reductions are refused before"
            stiffness = K.getDiagonal().array_r[self._own] * self._flexible
            self.scale = stated_mean(stiffness / unit, stated)
            of_points = self._own, self._flexible, self.scale, free
            points = NodePoints.of(interface, self._spread, *of_points)
            self.tangent = KrylovTangent(K, reduction.supports, points, solver)
            return
        operators = self.stiffness, force, self._flexible, self._spread
        fixed, read = tangent_rows(*operators, interface.equation, len(free))
        self.scale = stated_mean(own_entries(read, interface.equation) / unit, stated)
        borders = border_columns(free, interface.pair, self._own.shape[1])
        self.tangent = Tangent(fixed, read, moved, borders, self._own, first, self.comm, solver)

    def start(self, unknowns: Callable[[], PETSc.Vec], translations: Array) -> None:
        """Has an iterative solver begin at unknowns (n,) and surfaces (pairs, dim)."""
        if isinstance(self.tangent, KrylovTangent):
            scale = self.reduction.right.getDiagonal().array_r
            begin = np.divide(unknowns().array_r, scale, out=0 * scale, where=scale != 0)
            self.tangent.start(begin, np.array([translations[at] for at in self.free]))

    def insist(self) -> bool:
        """Has all solutions of an increment exact; False if they were."""
        inexact = not self.tangent.always_exact
        self.tangent.always_exact = True
        return inexact

    @property
    def report(self) -> SolverReport:
        """What the linear solver has done so far."""
        return self.tangent.solver.report

    def solve(
        self,
        load: PETSc.Vec,
        E: Array,
        C: Array,
        D: Array,
        constraint: Array,
        totals: Array,
    ) -> tuple[PETSc.Vec, Array]:
        """Solves E r + C G a - D U = constraint at every contact point, with equilibrium.

        Args:
            load: reduced load f.
            E: (m, dim, dim), combines a point's forces.
            C: (m, dim, dim), combines its motion.
            D: (m, dim, dim), combines the free translations of its surface.
            constraint: (m, dim), prescribed translations included.
            totals: total forces, one per free translation.

        Returns:
            Reduced displacements, and the free translations on every process.

        Raises:
            SingularSystem: if there is no unique solution.
        """
        self.solved += 1
        loads, right = self._read(load), self._spread_load(load)
        stated = self._own >= 0
        right[self._own[stated]] = (np.einsum("nab,nb->na", E, loads) + constraint)[stated]
        balance = totals + self.totals(loads)
        solution = self.tangent.solve(right, balance, E, C, D)
        reduced = load.duplicate()
        reduced.setArray(solution[: len(right)])
        if isinstance(self.tangent, KrylovTangent):
            self._found = reduced, load, (self.tangent.force - loads, self.tangent.unbalanced)
        return reduced, np.array(self.comm.bcast(solution[len(right) :], self.comm.size - 1))

    def forces(self, reduced: PETSc.Vec, load: PETSc.Vec) -> tuple[Array, float]:
        """Forces r (m, dim) at the points, and the largest unbalanced one elsewhere here."""
        if self._found and reduced is self._found[0] and load is self._found[1]:
            return self._found[2]
        unbalanced = load.duplicate()
        self.stiffness.mult(reduced, unbalanced)
        unbalanced.axpy(-1.0, load)
        force = self._read(unbalanced)
        rest = np.abs(self._spread_load(unbalanced))
        rest[self._own[self._own >= 0]] = 0.0
        return force, float(rest.max(initial=0.0))

    def motions(self, displacement: PETSc.Vec) -> Array:
        """G a, (m, dim), of a full displacement vector (n,)."""
        return np.array((self.interface.motion * displacement).array_r.reshape(self._own.shape))

    def encloses(self) -> bool:
        """Whether a constant pressure in an incompressible body acts on contact points alone."""
        if isinstance(self.tangent, KrylovTangent):
            return self.tangent.encloses
        return free_pressure(self.stiffness, self.reduction, self._own[self._own >= 0])

    def release(self) -> None:
        """Frees what an iterative solver holds, on all processes."""
        if isinstance(self.tangent, KrylovTangent):
            self.tangent.release()
            destroy(self.stiffness)

    def totals(self, forces: Array) -> Array:
        """Sums of forces (m, dim) at the points of all processes, one per free translation."""
        pair = self.interface.pair
        sums = np.array([forces[pair == k, axis].sum() for k, axis in self.free])
        self.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return sums

    def forget_factors(self) -> None:
        """Has the next matrix factorised, whatever it is."""
        self.tangent.factorised = None

    def _read(self, equations: PETSc.Vec) -> Array:
        """L x, (m, dim), of a reduced vector; 0 where the law is not stated."""
        local = equations.array_r
        return np.where(self._own >= 0, local[self._own] * self._flexible, 0.0)

    def _spread_load(self, equations: PETSc.Vec) -> Array:
        """What `_read` takes is taken out of all other equations: (I - H L) x on this process."""
        local: Array = equations.array_r.copy()
        if self._spread is None:
            return local
        read, spread = self._spread.createVecLeft(), equations.duplicate()
        read.setArray(self._read(equations))
        self._spread.multTranspose(read, spread)
        return local + spread.array_r


class Tangent:
    """The assembled matrix of any active set, and its solver.

    Args:
        fixed: K', rows of this process, with columns for the free translations, as all below.
        forces: L K, (m dim, unknowns).
        motion: G, (m dim, unknowns).
        borders: (free translations, m dim), ones where a translation moves a point.
        own: (m, dim), local number of each point's own equations, -1 where there is none.
        first: number of this process' first equation.
        comm: of the processes; the last of them has the free translations.
        solver: of the systems.

    Attributes:
        solver: that is bound to the matrix.
        own_factors: whether the last solution is by factors of its own matrix.
        settled, always_exact: True, as all of its solutions are.
        factorised: combinations (m, 3, dim, dim) at the last factorisation.
    """

    def __init__(
        self,
        fixed: sp.csr_matrix,
        forces: sp.csr_matrix,
        motion: sp.csr_matrix,
        borders: sp.csr_matrix,
        own: Indices,
        first: int,
        comm: MPI.Comm,
        solver: LinearSolver,
    ) -> None:
        self._comm = comm
        self._points = PointRows.of(forces, motion, borders, own)
        border = balance_rows(borders @ forces, comm)
        self._borders = border.shape[0]
        self.matrix = with_points(fixed, self._points, border, comm)
        self._place = self._points.place(first)
        self.solver = solver.prepare(self.matrix)
        self.factorised: Array | None = None
        self.own_factors, self.settled, self.always_exact = False, True, True

    def solve(self, right: Array, balance: Array, E: Array, C: Array, D: Array) -> Array:
        """Unknowns of this process, those of free translations at the end of the last one.

        Args:
            right: of this process' equations.
            balance: right-hand sides of the free translations.
            E: (m, dim, dim), combines a point's forces.
            C: (m, dim, dim), combines its motion.
            D: (m, dim, dim), combines the free translations of its surface.

        Raises:
            SingularSystem: if there is no unique solution.
        """
        combinations = np.stack([E, C, D], axis=1)
        values = sum(
            np.einsum("eab,eb->ea", combinations[self._points.point, k], part)
            for k, part in enumerate(self._points.parts)
        )
        pointers, columns, rows = self._place
        self.matrix.setValuesIJV(pointers, columns, values[self._points.taken], rowmap=rows)
        self.matrix.assemble()
        known = self.matrix.createVecRight()
        known.setArray(np.append(right, balance[: self._borders]))
        return np.asarray(self._solution(known, combinations).array_r)

    def _solution(self, right: PETSc.Vec, combinations: Array) -> PETSc.Vec:
        """A few rows that differ from the last factorisation's are cheaper to correct."""
        if self.factorised is not None:  # no process differs in this
            size = np.abs(self.factorised).max(axis=(0, 2, 3), keepdims=True, initial=0.0)
            change = np.abs(combinations - self.factorised) > _SAME * size
            rows = self._comm.allreduce(int(np.sum(change.any(axis=(1, 3)))), MPI.SUM)
            solution = self.solver.solve_changed(right, rows)
            if solution is not None:
                self.own_factors = False
                return solution
        solution = self.solver.solve(right)
        self.factorised, self.own_factors = combinations, True
        return solution
