"""The linear system of one active set as E K + C, never assembled, solved as well as it pays.

With y = K a, the rows of the contact points become E r + C G a - D U with r read from y; all
others stay, but those of opposite nodes, which r acts on, too. The preconditioner is multigrid for
K in which directions are held, see the guide's page on theory ("Large systems") and `Sprung`. Free
translations U, of which there are few, are eliminated by the Schur complement of the
preconditioner. In hybrid bodies held are displacements alone, the first block of the triangle, see
`BlockTriangularPreconditioner`.
"""

from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.arrays import Array
from pw_elements.contact.nodes import TOLERANCE, LinearisedLaw
from pw_elements.contact.system.solution import Accuracy, TangentSolution
from pw_elements.contact.system.unassembled import NodePoints, Unassembled, stated_mean
from pw_elements.solvers import (
    MatrixFreeSolver,
    PreparedSolver,
    RigidComponents,
    SingularSystem,
    Supports,
    add_scaled,
    as_krylov_solver,
    block_diagonal_matrix,
    collect_garbage,
    destroy_objects,
    has_free_rigid_motion,
    python_matrix,
    solve_with_ksp,
)

# Sticking nodes of a piece that hold it well enough
_ENOUGH = 6

# Residual on the way, over the one before: of a tangent that stays, for which less would save no
# step of Newton's; and of one that is renewed, where rougher steps lead to other branches
_FORCING = 0.1
_FORCING_RENEWED = 0.02
# The least of `Sprung.shares` is about one over this for equally stiff bodies; smaller if one is
# softer: its forces then say less of the gaps, and the residual has to be smaller
_SOFTER = 5.0
# Residual at the end over the largest nodal contact force: the solver's tolerance, up to _LOOSEST;
# _EXACT_TANGENT if tangents are renewed (large strains); "tightened" takes a share _TIGHTENED of it
_LOOSEST = TOLERANCE / 10
_EXACT_TANGENT = 1e-13
_TIGHTENED = 0.1
# Residual at which eigenvalues are looked at
_EXAMINED = 1e-4
# Forces over the residual from which on they say anything of the solution
_KNOWN = 1e-3
# A true residual over the one asked for that shows round-off at work, as does one that stays
_STALLED = 2.0
# What old levels may cost in one solution, over the operations of making new ones, which are done
# slower than those of products by about as much
_LEVELS_WORTH = 3.0
# Singular values of E (0: held, 1: free): no equation of forces, and held for the preconditioner
_NO_FORCE = 1e-9
_HELD = 0.5


class Sprung:
    """Preconditioner of E K + C from one of bodies with springs, for a `PETSc.PC` in Python.

    The guide's page on theory has the springs k, directions Q and W = G D^-1 H ("Large systems").
    """

    def __init__(self, inner: PETSc.PC, points: NodePoints, K: PETSc.Mat) -> None:
        self._inner, self._points = inner, points
        flexible = points.force.copy()
        flexible.diagonalScale(R=1 / K.getDiagonal())
        self._flexible = points.motion.matMult(flexible.transpose())
        self._stated = stated = points.own >= 0
        compliance = self._flexible.getDiagonal().array_r.reshape(stated.shape)
        self._springs = 1 / stated_mean(compliance, stated)[:, None, None]
        self._law, self._force = self._flexible.createVecs()
        self._moved, self._rest = self._law.duplicate(), points.motion.createVecRight()
        self._ksp = PETSc.KSP().create(K.comm)
        self._ksp.setType("preonly")
        self._ksp.getPC().setType("lu")
        self._ksp.getPC().setFactorSolverType("mumps")

    def shares(self, law: LinearisedLaw) -> Array:
        """Factors (m, dim) that make gaps of the law forces of the springs."""
        size = np.linalg.norm(law.E, axis=2) + np.linalg.norm(law.C, axis=2) / self._springs[:, 0]
        return np.asarray(1 / np.where(size > 0, size, 1.0))

    def hold(self, law: LinearisedLaw, held: Array, anchored: Array) -> PETSc.Mat:
        """H k Q G (n, n) of what holds the bodies; an active set alone lets less be held."""
        points, one = self._points, np.eye(held.shape[1])
        both = self._stated[:, :, None] & self._stated[:, None, :]
        self._held: Array = self._springs * held * both
        E, C = np.where(both, law.E, one), np.where(both, law.C, 0.0)
        T = self._times(C, self._flexible)
        add_scaled(
            T, 1.0, block_diagonal_matrix(E, points.motion.getSizes()[0], points.motion.comm)
        )
        self._ksp.setOperators(T)
        half = self._times(self._springs * anchored * both, points.motion)
        return points.force.transposeMatMult(half)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        points, stated = self._points, self._stated
        self._law.array[:] = np.where(stated, x.array_r[points.own], 0.0).ravel()
        self._ksp.solve(self._law, self._force)
        self._flexible.mult(self._force, self._moved)
        moved = self._moved.array_r.reshape(stated.shape)
        self._force.array[:] += np.einsum("nab,nb->na", self._held, moved).ravel()
        x.copy(self._rest)
        self._rest.array[points.own[stated]] = 0.0
        points.force.multTransposeAdd(self._force, self._rest, self._rest)
        self._inner.apply(self._rest, y)

    def release(self) -> None:
        destroy_objects(self._ksp)

    def _times(self, blocks: Array, matrix: PETSc.Mat) -> PETSc.Mat:
        return block_diagonal_matrix(
            blocks, self._points.motion.getSizes()[0], matrix.comm
        ).matMult(matrix)


class Bordered:
    """Preconditioner of the bordered system from one without border, for a `PETSc.PC` in Python."""

    def __init__(self, inner: PETSc.PC, sums: list[Array], comm: MPI.Comm, like: PETSc.Vec) -> None:
        self._inner, self._sums, self._comm = inner, sums, comm
        self._x, self._y = like.duplicate(), like.duplicate()
        self._images: list[Array] = []
        self._schur = np.eye(len(sums))

    def update(self, columns: list[Array], springs: Array) -> None:
        self._images = [self._solved(column) for column in columns]
        self._schur = np.diag(springs) - np.array([self._summed(im) for im in self._images]).T

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        given, n = x.array_r, self._x.getLocalSize()
        balance = self._comm.bcast(given[n:].copy(), self._comm.size - 1)
        result = self._solved(given[:n])
        U = np.linalg.lstsq(self._schur, balance - self._summed(result))[0]
        for moved, image in zip(U, self._images, strict=True):
            result -= moved * image
        y.array[:n] = result
        y.array[n:] = U[: len(given) - n]

    def _solved(self, right: Array) -> Array:
        self._x.array[:] = right
        self._inner.apply(self._x, self._y)
        return np.array(self._y.array_r)

    def _summed(self, values: Array) -> Array:
        totals = np.array([total @ values for total in self._sums])
        self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
        return totals


class RigidHolds:
    """As many nodes of each connected piece as there are dimensions, far from each other.

    They are picked among those of the local contact nodes (m,) that face anything.
    """

    def __init__(self, space: fem.FunctionSpace, points: NodePoints) -> None:
        nodes = points.node
        self._comm: MPI.Comm = space.mesh.comm
        pieces = RigidComponents.from_space(space)
        self._piece, self._pieces = pieces.component_of_node[nodes], len(pieces.centre)
        x = space.tabulate_dof_coordinates()[nodes, : space.mesh.geometry.dim]
        among = np.where(points.facing, self._piece, -1)
        every, where = (np.concatenate(self._comm.allgather(part)) for part in (x, among))
        chosen = np.zeros(len(every), dtype=bool)
        for k in range(self._pieces):
            mine = np.flatnonzero(where == k)
            chosen[mine[_apart(every[mine])]] = True
        first = sum(self._comm.allgather(len(nodes))[: self._comm.rank])
        self._chosen = chosen[first : first + len(nodes)]

    def held(self, projectors: Array) -> Array:
        """Projectors (m, dim, dim) onto what is held, with the anchors where few nodes stick."""
        dim = projectors.shape[1]
        sticks = np.einsum("naa->n", projectors) > dim - 0.5
        count = np.bincount(self._piece[sticks], minlength=self._pieces)
        self._comm.Allreduce(MPI.IN_PLACE, count, MPI.SUM)
        loose = self._chosen & (count < _ENOUGH)[self._piece]
        return np.where(loose[:, None, None], np.eye(dim), projectors)


def _apart(x: Array) -> list[int]:
    """Points of x (n, dim), the first far from their mean, each next one from those before."""
    if not len(x):
        return []
    chosen = [int(np.argmax(np.linalg.norm(x - x.mean(axis=0), axis=1)))]
    rest = x - x[chosen[0]]
    for _ in range(x.shape[1] - 1):
        far = int(np.argmax(np.linalg.norm(rest, axis=1)))
        size = np.linalg.norm(rest[far])
        if size == 0:
            break
        chosen.append(far)
        rest = rest - np.outer(rest @ rest[far], rest[far]) / size**2
    return chosen


class KrylovTangent:
    """What `Tangent` is with factors, by an iteration that assembles nothing; `supported` goes too.

    Unknowns are numbered as the nodes are, prescribed ones being zero; the free translations come
    last, on the last process.
    """

    solves_exactly = False

    def __init__(
        self,
        K: PETSc.Mat,
        supports: Supports,
        points: NodePoints,
        how: MatrixFreeSolver,
        supported: PETSc.Mat,
    ) -> None:
        self._supported = supported
        self._points = points
        self._comm: MPI.Comm = K.comm.tompi4py()
        self.solver: PreparedSolver = how.prepare(K, supports=supports)
        self._krylov = krylov = as_krylov_solver(self.solver, K, supports)
        saddle = self._saddle = krylov.block_preconditioner
        self._multigrid = krylov.multigrid
        stiffness = saddle.scaled_matrix if saddle else self._multigrid.block_matrix
        self._context = Unassembled(stiffness, supports.free, points)
        local, whole = K.getSizes()[0]
        self._unknowns = local
        last = self._comm.rank == self._comm.size - 1
        sizes = (local + points.translations * last, whole + points.translations)
        self._operator = python_matrix((sizes, sizes), self._context, K.comm)
        inner = krylov.ksp.getPC()
        self._sprung: Sprung | None = None
        self._border: Bordered | None = None
        if points.spread is not None:
            alone = points.of_displacements(saddle.displacements) if saddle else points
            self._sprung = Sprung(
                saddle.displacement_pc if saddle else inner, alone, krylov.displacement_block[0]
            )
            sprung = PETSc.PC().createPython(self._sprung, comm=K.comm)
            sprung.setOperators(self._multigrid.operator)
            if saddle:
                saddle.displacement_pc = sprung
            else:
                inner = sprung
        if points.translations:
            sums = [self._sum(stiffness, supports, j) for j in range(points.translations)]
            self._border = Bordered(inner, sums, self._comm, K.createVecRight())
        outer = self._border or (None if saddle else self._sprung)
        self._ksp = krylov.create_flexible_ksp(self._operator, outer)
        # supports that hold all pieces need no help of contact
        elastic, held = krylov.displacement_block
        loose = has_free_rigid_motion(elastic, held)
        self._rigid_holds = RigidHolds(held.space, points) if loose else None
        self._solution = self._operator.createVecRight()
        self._final = self._enclosed = False
        self._exact = self._accuracy = min(krylov.tolerance, _LOOSEST)
        self._renewed = False
        self._size = self._left_before = 0.0
        # operations: of making levels, what they have lost since, and a digit's at first
        self._set_up = self._wasted = 0.0
        self._pace: float | None = None
        self._each = 1.0  # an iteration's then
        self._most: int = self._ksp.getTolerances()[3]

    def start(self, unknowns: Callable[[], Array], free_motions: Array) -> None:
        begin, local = unknowns(), self._solution.array
        local[: len(begin)] = begin
        local[len(begin) :] = free_motions[: len(local) - len(begin)]
        self._size, self._left_before = self._solution.norm(), 0.0

    def set_springs(self, springs: Array) -> None:
        self._context.springs = springs

    def renew(self, *_: object, **__: object) -> None:
        """Makes new levels, when old ones have cost as much as these would; K is the same."""
        self._renewed = True
        if self._wasted >= self._set_up:
            self._krylov.preconditioner.refresh()
            self._pace = None

    def determinant_signs(self) -> tuple[int, ...]:
        """Signs of the levels, and of the tangent that has been solved last.

        Over the levels its eigenvalues are near one, and each that changes its sign leaves them: an
        outlier, which Arnoldi's method from an arbitrary vector finds first. This is no proof.
        """
        if self._krylov.uses_external_method:
            return ()
        arbitrary, image = self._operator.createVecs()
        first, last = arbitrary.getOwnershipRange()
        arbitrary.setArray(np.cos(np.arange(first, last, dtype=float)))
        sign = -1
        for again in (False, True):
            if again:  # a smoother beyond its bounds changes signs, too
                self._multigrid.re_estimate_eigenvalues()
            self._ksp.setTolerances(rtol=_EXAMINED, atol=0.0, max_it=self._most)
            self._ksp.solve(arbitrary, image)
            values = self._ksp.computeEigenvalues()
            if not len(values):  # of another method than GMRES
                return ()
            sign = (-1) ** int(np.sum((values.imag == 0) & (values.real < 0)))
            if sign > 0:
                break
        return 1, sign

    def encloses(self) -> bool:
        return self._enclosed

    def solve(
        self, right: Array, balance: Array, law: LinearisedLaw, accuracy: Accuracy
    ) -> TangentSolution:
        law = replace(law, D=law.D[:, :, : law.E.shape[1]])  # the border has translations alone
        more = accuracy == "tightened" and self._final
        exact = min(self._exact, _EXACT_TANGENT) if self._renewed else self._exact
        self._accuracy = self._accuracy * _TIGHTENED if more else exact
        law, forcing = self._in_forces(law, right)
        self._context.state(law)
        known, x = self._operator.createVecLeft(), self._solution
        known.setArray(np.append(right, balance[: known.getLocalSize() - len(right)]))
        fixed = self._make_ready(law)
        if self._sprung is None:
            self._land(known, x, fixed)
        # needed again only where levels may be old
        start, rest = x.copy() if self._renewed else x, known.duplicate()
        left = self._left(known, rest)
        if self._left_before:
            forcing = min(forcing, 0.9 * (left / self._left_before) ** 2)
        self._left_before = left
        reduced = forcing * left if accuracy == "rough" else 0.0
        found = self._reduced(known, rest, left, reduced, forcing)
        if found is None:  # old levels are too wrong
            self._wasted = np.inf
            self.renew()
            self._make_ready(law)
            start.copy(x)
            found = self._reduced(known, rest, self._left(known, rest), reduced, forcing)
            assert found is not None, "these levels are new"
        left, stalled = found
        self._final = bool(left <= self._exact * self._largest() or stalled)
        self._forget_vectors()
        collect_garbage(known)
        return TangentSolution(np.array(x.array_r), is_exact=stalled, is_final=self._final)

    def _in_forces(self, law: LinearisedLaw, right: Array) -> tuple[LinearisedLaw, float]:
        """The law, whose gaps are read as forces of springs if there are any; and the forcing."""
        forcing = _FORCING_RENEWED if self._renewed else _FORCING
        if self._sprung is None:
            return law, forcing
        share, stated = self._sprung.shares(law), self._points.own >= 0
        right[self._points.own[stated]] *= share[stated]
        E, C, D = (share[:, :, None] * each for each in (law.E, law.C, law.D))
        least = self._comm.allreduce(share.min(initial=1.0), MPI.MIN)
        return replace(law, E=E, C=C, D=D, c=share * law.c), forcing * min(1.0, _SOFTER * least)

    def _make_ready(self, law: LinearisedLaw) -> Array:
        """Makes the preconditioner for a law; projectors (m, dim, dim) onto what it fixes."""
        begun = self._operations()
        fixed = self._hold(law)
        if self._saddle and self._saddle.has_free_constant_pressure(self._operator):
            self._enclosed = True
            raise SingularSystem("the pressure is known up to a constant")
        self._krylov.ksp.getPC().setUp()
        if self._border is not None:
            columns = [self._column(j, law.D) for j in range(self._points.translations)]
            self._border.update(columns, self._context.springs)
        if self._pace is None:
            self._set_up, self._wasted = self._operations() - begun, 0.0
        return fixed

    def _reduced(
        self, known: PETSc.Vec, rest: PETSc.Vec, left: float, reduced: float, forcing: float
    ) -> tuple[float, bool] | None:
        """Residual of the solution, and whether round-off lets it be no smaller; `rest` is left.

        None if levels are old and cost more than new ones. Raises NotConverged if these fail.
        """
        x, step, begun = self._solution, rest.duplicate(), self._operations()
        pace = self._pace if self._renewed else None
        first, stalled, lost, done = left, False, 0.0, 0
        while not stalled and not left <= (target := self._target(left, reduced, forcing)):
            most = self._most
            if pace is not None:
                worth = _LEVELS_WORTH * self._set_up + pace * np.log10(first / target)
                most = min(most, 1 + int(worth / self._each))
            self._ksp.setTolerances(rtol=0.0, atol=target, max_it=most)
            if (
                self._size and not self._krylov.uses_external_method
            ):  # its options have been looked at
                self._ksp.solve(rest, step)
            else:
                solve_with_ksp(self._ksp, rest, step, self._krylov.options)
            done += self._ksp.getIterationNumber()
            x.axpy(1.0, step)
            before, left = left, self._left(known, rest)
            self._size = max(self._size, x.norm())
            lost = self._krylov.round_off(self._size) + self._points.round_off + target
            # so it is where a factorisation has given no numbers
            stalled = not left < (
                min(before, _STALLED * target) if left <= lost else _TIGHTENED * before
            )
            if pace is not None and not left <= lost and (stalled or done >= most):
                return None
        if stalled and not left <= lost:
            raise self._krylov.not_converged(left / max(known.norm(), self._largest()))
        digits, spent = np.log10(first / max(left, 1e-300)), self._operations() - begun
        if self._pace is None:
            self._pace, self._each = spent / max(digits, 1), spent / max(done, 1) or 1.0
        else:
            self._wasted = max(0.0, self._wasted + spent - self._pace * digits)
        return left, stalled

    def _forget_vectors(self) -> None:
        preconditioner, none = self._ksp.getPC(), PETSc.PC().create(self._operator.comm)
        self._ksp.setPC(none)  # levels would be reset with the method
        self._ksp.reset()
        self._ksp.setPC(preconditioner)
        destroy_objects(none)

    def release(self) -> None:
        if self._sprung is not None:
            self._sprung.release()
        destroy_objects(self._ksp, self._operator, self._supported)
        self._krylov.release()
        if self.solver is not self._krylov:
            self.solver.release()

    def _target(self, left: float, reduced: float, forcing: float) -> float:
        """The residual to be reached; on the way `reduced`, if that is small beside the forces.

        It may be large, where an active set moves nodes of a body that does not follow yet.
        """
        square = self._comm.allreduce(float(np.sum(self._context.force**2)), MPI.SUM)
        if square > (_KNOWN * left) ** 2:
            reduced = min(reduced, forcing * square**0.5)
        largest = self._largest()
        # where the next step would be the last, this one is
        reduced = reduced if reduced > TOLERANCE * largest else 0.0
        return max(reduced, self._accuracy * largest)

    def _left(self, known: PETSc.Vec, rest: PETSc.Vec) -> float:
        """The residual's norm; `rest` becomes what remains of a right-hand side."""
        self._operator.mult(self._solution, rest)
        rest.aypx(-1.0, known)
        return float(rest.norm())

    def _operations(self) -> float:
        return float(self._comm.allreduce(PETSc.Log.getFlops(), MPI.SUM))

    def _largest(self) -> float:
        force = float(np.abs(self._context.force).max(initial=0.0))
        return float(self._comm.allreduce(force, MPI.MAX))

    def _hold(self, law: LinearisedLaw) -> Array:
        """Tells multigrid what an active set holds; projectors (m, dim, dim) onto what it fixes."""
        left, size, _ = np.linalg.svd(law.E)
        held, fixed = (
            np.einsum("nak,nk,nbk->nab", left, (size < bound).astype(float), left)
            for bound in (_HELD, _NO_FORCE)
        )
        anchored, points = held, self._points
        if self._rigid_holds is not None:
            anchored = self._rigid_holds.held(held)
        springs = self._sprung.hold(law, held, anchored) if self._sprung else None
        self._multigrid.constrain(points.node, anchored, points.scale, springs)
        return fixed

    def _land(self, known: PETSc.Vec, x: PETSc.Vec, fixed: Array) -> None:
        """Moves nodes to where they are held: the iteration then stays there."""
        points, stated = self._points, self._points.own >= 0
        wrong = np.where(stated, known.array_r[points.own] - self._context.of_motion(x), 0.0)
        step = np.einsum("nab,nb->na", fixed, wrong) / points.scale[:, None]
        x.array[points.own[stated]] += step[stated]

    def _sum(self, K: PETSc.Mat, supports: Supports, translation: int) -> Array:
        points = self._points
        ones, row = K.createVecs()
        some = (points.moved == translation) & (points.own >= 0)
        ones.array[points.own[some]] = points.flexible[some]
        K.multTranspose(ones, row)
        return np.asarray(row.array_r * supports.free)

    def _column(self, translation: int, D: Array) -> Array:
        points = self._points
        law = -np.einsum("nab,nb->na", D, (points.moved == translation).astype(float))
        column = np.zeros(self._unknowns)
        stated = points.own >= 0
        column[points.own[stated]] = law[stated]
        return column
