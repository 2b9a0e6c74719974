"""The linear system of one active set as E K + C, never assembled, solved as well as it pays.

With y = K a, the rows of the contact points become E r + C G a - D U with r read from y; all
others stay, but those of opposite nodes, which r acts on, too. The preconditioner is multigrid for
K in which the directions that an active set holds are taken out, as supports are, or follow the
opposite nodes: so a body that contact alone holds has a stiffness. Free translations U, of which
there are few, are eliminated by the Schur complement of the preconditioner.

Newton's iteration needs no exact solutions on its way: each reduces the residual, which begins
at that of the nonlinear equations, to a part of it. The last ones are exact, when the loop asks.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.anchors import Anchors
from pw_elements.contact.unassembled import Bordered, NodePoints, Tied, Unassembled
from pw_elements.iterative import Iterative, Krylov, free_motion
from pw_elements.matrices import collect_garbage, python_matrix
from pw_elements.multigrid import Multigrid
from pw_elements.projection import Supports

Array = npt.NDArray[np.float64]

# Residual on the way, over the one before
_FORCING = 0.02
# Residual at the end, over the largest nodal contact force, and what each further exact solution
# takes of it
_EXACT, _MORE = 1e-11, 0.1
# Forces over the residual from which on they say anything of the solution
_KNOWN = 1e-3
# A true residual over the one asked for that shows round-off at work, as does one that stays
_STALLED = 2.0
# Singular values of E (0: held, 1: free): no equation of forces, and held for the preconditioner
_NONE, _HELD = 1e-9, 0.5


class KrylovTangent:
    """The matrix of any active set and its solver, in place of `system.Tangent`.

    Unknowns are numbered as the nodes are, prescribed ones being zero; the free translations come
    last, on the last process.

    Args:
        K: stiffness (n, n), free.
        supports: of the space.
        points: at nodes.
        how: options.

    Attributes:
        solver: what counts iterations.
        own_factors: whether the last solution is as exact as any can be.
        settled: whether it is exact enough to be the last.
        always_exact: whether every solution is to be exact.
        factorised: None, when the next solution is to be more exact than the last.
    """

    def __init__(
        self, K: PETSc.Mat, supports: Supports, points: NodePoints, how: Iterative
    ) -> None:
        self._points = points
        self._comm: MPI.Comm = K.comm.tompi4py()
        self.solver: Krylov = how.prepare(K, supports=supports)
        levels = self.solver.multigrid
        assert isinstance(levels, Multigrid), "hybrid bodies are refused before"
        self._multigrid = levels
        blocked = self._multigrid.blocked
        self._context = Unassembled(blocked, supports.free, points)
        local, whole = K.getSizes()[0]
        last = self._comm.rank == self._comm.size - 1
        sizes = (local + points.translations * last, whole + points.translations)
        self._operator = python_matrix((sizes, sizes), self._context, K.comm)
        inner = self.solver.ksp.getPC()
        self._tied: Tied | None = None
        self._border: Bordered | None = None
        if points.spread is not None:
            ties = self._multigrid.tie(points.node, points.spread)
            self._tied = Tied(inner, ties, points)
        if points.translations:
            if self._tied is not None:
                inner = PETSc.PC().createPython(self._tied, comm=K.comm)
                inner.setOperators(self._multigrid.operator)
            sums = [self._sum(blocked, supports, j) for j in range(points.translations)]
            self._border = Bordered(inner, sums, self._comm, K.createVecRight())
        if outer := self._border or self._tied:
            self._ksp = self.solver.preconditioned(self._operator, outer)
        else:
            self._ksp = self.solver.ksp
            self._ksp.setOperators(self._operator, self._multigrid.operator)
        # supports that hold all pieces need no help of contact
        loose = free_motion(K, supports)
        self._anchors = Anchors.of(supports.space, points.node) if loose else None
        self._solution = self._operator.createVecRight()
        self.own_factors = self.settled = self.always_exact = False
        self.factorised: bool | None = True
        self._accuracy, self._size = _EXACT, 0.0

    def start(self, displacement: Array, translations: Array) -> None:
        """Begins at a displacement (n,) of this process, zero where prescribed."""
        n = len(displacement)
        local = self._solution.array
        local[:n] = displacement
        local[n:] = translations[: len(local) - n]
        self.factorised, self.always_exact = True, False
        self._size = self._solution.norm()

    def solve(self, right: Array, balance: Array, E: Array, C: Array, D: Array) -> Array:
        """Unknowns of this process, those of free translations at the end of the last one.

        Args:
            right: of this process' equations.
            balance: right-hand sides of the free translations.
            E: (m, dim, dim), combines a point's forces.
            C: (m, dim, dim), combines its motion.
            D: (m, dim, dim), combines the free translations of its surface.

        Raises:
            SolverNotConverged: if the residual does not become small.
        """
        exact = self.factorised is None or self.always_exact
        again = self.factorised is None and self.settled
        self._accuracy = self._accuracy * _MORE if again else _EXACT
        self.factorised = True
        self._context.state(E, C, D)
        known, x = self._operator.createVecLeft(), self._solution
        known.setArray(np.append(right, balance[: known.getLocalSize() - len(right)]))
        held = self._hold(E)
        self._land(known, x, held)
        if self._ksp is not self.solver.ksp:
            self.solver.ksp.setUp()
        if self._border is not None:
            self._border.update([self._column(j, D) for j in range(self._points.translations)])
        rest, step = known.duplicate(), known.duplicate()
        left = self._left(known, rest)
        reduced = 0.0 if exact else _FORCING * left
        stalled = False
        while left > (target := self._target(left, reduced)) and not stalled:
            self._ksp.setTolerances(rtol=0.0, atol=target)
            self._ksp.solve(rest, step)
            x.axpy(1.0, step)
            before, left = left, self._left(known, rest)
            stalled = left >= min(_STALLED * target, before)
        force = self._largest()
        self._size = max(self._size, x.norm())
        if stalled and left > self.solver.round_off(self._size) + self._points.round_off + target:
            raise self.solver.not_converged(left / max(known.norm(), force))
        self.settled = left <= _EXACT * force or stalled
        self.own_factors = stalled
        collect_garbage(known)
        return np.array(x.array_r)

    def _target(self, left: float, reduced: float) -> float:
        """The residual to be reached; on the way `reduced`, if that is small beside the forces.

        It may be large, where an active set moves nodes of a body that does not follow yet.
        """
        square = self._comm.allreduce(float(np.sum(self._context.force**2)), MPI.SUM)
        if square > (_KNOWN * left) ** 2:
            reduced = min(reduced, _FORCING * square**0.5)
        return max(reduced, self._accuracy * self._largest())

    def _left(self, known: PETSc.Vec, rest: PETSc.Vec) -> float:
        """The residual's norm; `rest` becomes what remains of a right-hand side."""
        self._operator.mult(self._solution, rest)
        rest.aypx(-1.0, known)
        return float(rest.norm())

    def _largest(self) -> float:
        """The largest nodal contact force."""
        force = float(np.abs(self._context.force).max(initial=0.0))
        return float(self._comm.allreduce(force, MPI.MAX))

    def _hold(self, E: Array) -> Array:
        """Tells multigrid what an active set holds; projectors (m, dim, dim) onto what it fixes."""
        left, size, _ = np.linalg.svd(E)
        held, fixed = (
            np.einsum("nak,nk,nbk->nab", left, (size < bound).astype(float), left)
            for bound in (_HELD, _NONE)
        )
        if self._anchors is not None:
            held = self._anchors.held(held)
        self._multigrid.hold(self._points.node, held, self._points.scale)
        if self._tied is not None:
            self._tied.hold(held)
        return fixed

    def _land(self, known: PETSc.Vec, x: PETSc.Vec, fixed: Array) -> None:
        """Moves nodes to where they are held: the iteration then stays there."""
        points, image = self._points, known.duplicate()
        self._operator.mult(x, image)
        wrong = np.where(points.own >= 0, (known.array_r - image.array_r)[points.own], 0.0)
        step = np.einsum("nab,nb->na", fixed, wrong) / points.scale[:, None]
        stated = points.own >= 0
        local = x.array
        local[points.own[stated]] += step[stated]
        image.destroy()

    def _sum(self, K: PETSc.Mat, supports: Supports, translation: int) -> Array:
        """Row (n,) of the balance of a free translation."""
        points = self._points
        ones, row = K.createVecs()
        some = (points.moved == translation) & (points.own >= 0)
        local = ones.array
        local[points.own[some]] = points.flexible[some]
        K.multTranspose(ones, row)
        return np.asarray(row.array_r * supports.free)

    def _column(self, translation: int, D: Array) -> Array:
        """Column (n,) of a free translation."""
        points = self._points
        law = -np.einsum("nab,nb->na", D, (points.moved == translation).astype(float))
        column = np.zeros(self._multigrid.blocked.getLocalSize()[0])
        stated = points.own >= 0
        column[points.own[stated]] = law[stated]
        return column
