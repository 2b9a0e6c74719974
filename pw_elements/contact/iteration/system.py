"""The linear system of one active set: the law in place of one equation per component of force.

The guide's page on theory has its rows ("The linear system"). Where surfaces turn, U has angles,
too, and sums are those of `Levers`. The nonzero pattern is that of all active sets: its rows are
built once, before the iteration. `KrylovTangent` assembles nothing instead.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements._compat import single_entries
from pw_elements.algebra import Reduction, free_pressure, supported
from pw_elements.arrays import Array, Indices, Local
from pw_elements.contact.interface import Interface
from pw_elements.contact.iteration.krylov import KrylovTangent, NodePoints, stated_mean
from pw_elements.contact.iteration.law import Accuracy, Levers, LinearisedLaw, Solved
from pw_elements.contact.model import Free
from pw_elements.solvers import LinearSolver, PreparedSolver, SolverReport, add, is_matrix_free

# What does not count as different
_EQUAL = 1e-12

# Pointers, columns and values of this process' rows, for PETSc
_Csr: TypeAlias = tuple[npt.NDArray, npt.NDArray, Array]


class PointRows:
    """Rows E L K + C G - D of the contact points, whose entries are linear in E, C and D.

    Each row of a point has all columns that any of its equations and motions have. L K is (m dim,
    n), G (m p, n) with p motions a point; `borders` (m k, n) are ones where a free translation,
    one of k of each surface, moves a point; `own` (m, dim) are local numbers of the rows in the
    matrix, -1 where there is none.
    """

    def __init__(
        self, forces: sp.csr_matrix, motion: sp.csr_matrix, borders: sp.csr_matrix, own: Indices
    ) -> None:
        self.own, (m, dim), n = own, own.shape, np.int64(forces.shape[1])
        parts = [part.tocoo() for part in (forces, motion, -borders)]
        widths = [dim, motion.shape[0] // max(m, 1), borders.shape[0] // max(m, 1)]
        before, width = np.cumsum([0, *widths[:2]]), sum(widths)
        point, across = (
            np.concatenate(each)
            for each in zip(
                *(np.divmod(p.row, w) for p, w in zip(parts, widths, strict=True)), strict=True
            )
        )
        across = across + np.repeat(before, [part.nnz for part in parts])
        column = np.concatenate([part.col for part in parts])
        value = np.concatenate([part.data for part in parts])
        # entries of points, in order, and which of them each number of the parts belongs to
        entries, entry = np.unique(point * n + column, return_inverse=True)
        count, first = _runs(entries // n, m)
        flat = np.flatnonzero(own.ravel() >= 0)
        flat = flat[np.argsort(own.ravel()[flat])]
        self.row, (at, axis) = own.ravel()[flat], np.divmod(flat, dim)
        self.pointers = np.concatenate([[0], np.cumsum(count[at])])
        self.column = (entries % n)[_spans(first[at], count[at])]
        # and what each of them takes of E, C and D
        order = np.argsort(point, kind="stable")
        given, begin = _runs(point, m)
        taken, times = order[_spans(begin[at], given[at])], given[at]
        row = np.repeat(self.pointers[:-1] - first[at], times) + entry[taken]
        place = width * (np.repeat(axis, times) + dim * point[taken]) + across[taken]
        shape = (len(self.column), m * dim * width)
        self._of_law = sp.csr_matrix((value[taken], (row, place)), shape)

    def values(self, combinations: Array) -> Array:
        """Values of all entries for E, C and D of each point, side by side: (m, dim, ...)."""
        return np.asarray(self._of_law @ combinations.ravel())

    def place(self, first: int) -> list[npt.NDArray]:
        """Pointers, columns and rows for PETSc, in a matrix whose first row here has a number."""
        parts = self.pointers, self.column, first + self.row
        return [part.astype(PETSc.IntType) for part in parts]


def _runs(of: Indices, most: int) -> tuple[Indices, Indices]:
    """Number of times that 0 to `most` - 1 occur, and where each begins if they are in order."""
    count = np.bincount(of, minlength=most)
    return count, np.cumsum(count) - count


def _spans(first: Indices, count: Indices) -> Indices:
    """Whole numbers from each first on, as many as are counted, one span after the other."""
    shift = first - (np.cumsum(count) - count)
    return np.repeat(shift, count) + np.arange(count.sum())


def local_rows(matrix: PETSc.Mat, more: int) -> sp.csr_matrix:
    """Rows of this process, with more columns, which are empty, for free translations."""
    indptr, indices, data = matrix.getValuesCSR()
    rows = sp.csr_matrix((data, indices, indptr), (len(indptr) - 1, matrix.getSize()[1] + more))
    rows.sort_indices()
    return rows


def with_points(rows: sp.csr_matrix, points: PointRows, border: sp.csr_matrix) -> _Csr:
    """CSR of this process' `rows`, those of the points being replaced by zeros, a border below."""
    replaced = np.zeros(rows.shape[0], dtype=bool)
    replaced[points.row] = True
    number = np.diff(rows.indptr)
    kept = np.repeat(~replaced, number)
    number[replaced] = np.diff(points.pointers)
    number = np.concatenate([number, np.diff(border.indptr)])
    fixed = np.repeat(np.append(~replaced, np.ones(border.shape[0], dtype=bool)), number)
    indptr = np.concatenate([[0], np.cumsum(number)]).astype(PETSc.IntType)
    indices, data = np.empty(indptr[-1], dtype=PETSc.IntType), np.zeros(indptr[-1])
    indices[fixed] = np.concatenate([rows.indices[kept], border.indices])
    indices[~fixed] = points.column
    data[fixed] = np.concatenate([rows.data[kept], border.data])
    return indptr, indices, data


def border_columns(free: Sequence[tuple[int, int]], pair: Local, each: int) -> sp.csr_matrix:
    """(m each, free translations): ones where one, among each surface's, moves a point."""
    row = [np.flatnonzero(pair == number) * each + axis for number, axis in free]
    rows = np.concatenate([np.empty(0, dtype=np.int64), *row])
    column = np.repeat(np.arange(len(free)), [len(r) for r in row])
    return sp.csr_matrix((np.ones(len(rows)), (rows, column)), (len(pair) * each, len(free)))


def balance_rows(sums: sp.coo_matrix, springs: Array, comm: MPI.Comm) -> sp.csr_matrix:
    """Equations of free translations, on the last process; `sums` are this process' own part.

    Each translation has a spring besides.
    """
    parts = comm.gather((sums.row, sums.col, sums.data), root=comm.size - 1)
    if parts is None:
        return sp.csr_matrix((0, sums.shape[1]))
    own = np.arange(sums.shape[0])
    parts.append((own, sums.shape[1] - len(own) + own, springs))
    # zeros stay: sums have one pattern
    row, column, data = (np.concatenate(each) for each in zip(*parts, strict=True))
    balance = sp.csr_matrix((data, (row, column)), sums.shape)
    balance.sort_indices()
    return balance


def read_and_spread(force: PETSc.Mat, equation: Indices) -> tuple[Array, PETSc.Mat | None]:
    """Inverse of H at the points' own equations (m, dim), and -H^T elsewhere, if there is."""
    indptr, column, value = force.getValuesCSR()
    value = value.copy()
    of_entry = np.repeat(equation.ravel(), np.diff(indptr))
    own = column == of_entry
    diagonal = np.ones(len(indptr) - 1)
    diagonal[np.repeat(np.arange(len(diagonal)), np.diff(indptr))[own]] = value[own]
    value[own | (of_entry < 0)] = 0.0
    flexible = 1 / diagonal.reshape(equation.shape)
    if not force.comm.tompi4py().allreduce(int(np.any(value != 0)), MPI.MAX):
        return flexible, None
    csr = (indptr, column, -value)
    return flexible, PETSc.Mat().createAIJ(force.getSizes(), csr=csr, comm=force.comm)


def own_entries(matrix: sp.csr_matrix, equation: Indices) -> Array:
    """Entries (m, dim) of a matrix (m dim, n) at each point's own unknowns; 1 where it has none."""
    own = equation.ravel()
    rows = np.flatnonzero(own >= 0)
    values = np.ones(len(own))
    values[rows] = np.asarray(matrix[rows, own[rows]]).ravel()
    return values.reshape(equation.shape)


@dataclass(frozen=True)
class Solution:
    """Reduced displacements, and the free translations on every process; flags as in `Solved`."""

    reduced: PETSc.Vec
    translations: Array
    exact: bool
    final: bool


class ContactTangent(Protocol):
    """The linear system of any active set, and how it is solved.

    All solutions are as exact as they can be if it is `precise`.
    """

    precise: bool
    solver: PreparedSolver

    def start(self, unknowns: Callable[[], Array], translations: Array) -> None:
        """Begins an increment at unknowns of this process."""

    def hold_motions(self, springs: Array) -> None:
        """Take the stiffness (free,) by which friction on supports holds each free motion."""

    def renew(self, rows: Callable[[], tuple[PointRows, _Csr]], another: bool) -> None:
        """Takes what K has become; `rows` makes the matrix, of another pattern perhaps."""

    def solve(self, right: Array, balance: Array, law: LinearisedLaw, accuracy: Accuracy) -> Solved:
        """Solves for an active set, with right-hand sides of this process and of free translations.

        More than final is by factors of the very matrix. Raises SingularSystem if there is no
        unique solution, NotConverged if an iteration fails.
        """

    def orientation(self) -> tuple[int, ...]:
        """Signs besides those that the solver tells by its determinants."""

    def encloses(self) -> bool:
        """Whether a constant pressure in an incompressible body acts on contact points alone."""

    def release(self) -> None: ...


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
        free: Free,
        solver: LinearSolver,
        levers: Levers | None = None,
    ) -> None:
        self.reduction, self.interface, self.free = reduction, interface, free
        self.springs = np.zeros(len(free))  # of free translations, see `by_springs`
        self.levers = levers or Levers.straight(*interface.position.shape)
        self.comm: MPI.Comm = interface.comm
        self.solved = 0
        self.stiffness = supported(reduction, K) if is_matrix_free(solver) else reduction.matrix(K)
        self._magnitudes = interface.motion.copy()
        rows = interface.motion.getValuesCSR()
        self._magnitudes.setValuesCSR(*rows[:2], np.abs(rows[2]))
        self._magnitudes.assemble()
        (first, last), stated = self.stiffness.getOwnershipRange(), interface.equation >= 0
        self._own = np.where(stated, interface.equation - first, -1)
        self.hand_on(interface.force)
        self.tangent: ContactTangent
        self._motion = interface.motion
        moved = local_rows(interface.motion.matMult(reduction.right), len(free))
        unit = own_entries(moved, interface.equation)
        if is_matrix_free(solver):
            if any(axis == interface.position.shape[1] for _, axis in free):
                raise ValueError("surfaces that are free to turn need a solver such as Direct()")
            assert reduction.supports is not None, "other reductions are refused before"
            stiffness = K.getDiagonal().array_r[self._own] * self._flexible
            self.scale = stated_mean(stiffness / unit, stated)
            of_points = self._own, self._flexible, self.scale, free
            points = NodePoints.of(interface, self._force, self._spread, *of_points)
            self.tangent = KrylovTangent(K, reduction.supports, points, solver, self.stiffness)
            return
        self._moved = moved
        borders = border_columns(free, interface.pair, self.levers.carried.shape[2])
        before = sp.csr_matrix((borders.shape[0], moved.shape[1] - len(free)))
        self._borders = sp.hstack([before, borders], "csr")
        read, rows, csr = self._rows()
        self.scale = stated_mean(own_entries(read, interface.equation) / unit, stated)
        sizes = len(csr[0]) - 1, read.shape[1]
        matrix = PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=self.comm)
        enclosed = partial(free_pressure, self.stiffness, reduction, self._own[stated])
        borders = len(csr[0]) - 1 - (last - first)
        self.tangent = Tangent(matrix, rows, first, borders, solver, enclosed)

    def _rows(self) -> tuple[sp.csr_matrix, PointRows, _Csr]:
        """L K, the points' rows, and the matrix in which they have their places."""
        K, equation, sizes = self.stiffness, self.interface.equation.ravel(), self._force.getSizes()
        L = single_entries(equation, sizes, self.comm, self._flexible.ravel())
        forces = L.matMult(K)
        if self._spread is not None:
            fixed = self._spread.transposeMatMult(forces)
            add(fixed, 1.0, K, last=False)
            K = fixed
        fixed, read = (local_rows(part, len(self.free)) for part in (K, forces))
        rows = PointRows(read, self._moved, self._borders, self._own)
        border = balance_rows(self._balances(read), self.springs, self.comm)
        return read, rows, with_points(fixed, rows, border)

    def _balances(self, read: sp.csr_matrix) -> sp.coo_matrix:
        """Linear forces (free, n) on free motions, by this process' points; zeros stay."""
        (m, dim), levers = self._own.shape, self.levers
        row, column, value = ([np.empty(0, dtype)] for dtype in (np.int64, np.int64, float))
        for number, (pair, axis) in enumerate(self.free):
            mine = np.flatnonzero(self.interface.pair == pair)
            parts: list[tuple[sp.csr_matrix, int, Array]] = [(read, axis, np.ones((m, 1)))]
            if axis == dim:
                turning = levers.carried[:, :, axis], -levers.spun, levers.spun
                every = read, self._moved, self._borders
                parts = [(rows, 0, factors) for rows, factors in zip(every, turning, strict=True)]
            for rows, first, factors in parts:
                each, of = rows.shape[0] // max(m, 1), factors[mine]
                at = first + mine[:, None] * each + np.arange(of.shape[1])
                taken = rows[at.ravel()].tocoo()
                row.append(np.full(taken.nnz, number))
                column.append(taken.col)
                value.append(of.ravel()[taken.row] * taken.data)
        where = np.concatenate(row), np.concatenate(column)
        shape = len(self.free), read.shape[1]
        return sp.coo_matrix((np.concatenate(value), where), shape)

    def hand_on(self, force: PETSc.Mat) -> None:
        """Takes H, (n, m dim)."""
        self.interface.force = force
        self._force = force.transposeMatMult(self.reduction.left)  # (points dim, equations)
        self._flexible, self._spread = read_and_spread(self._force, self.interface.equation)

    def renew(self, K: PETSc.Mat, motion: PETSc.Mat | None = None) -> None:
        """Takes another K (n, n), and perhaps another G (m p, n); the law's scale stays.

        Without the latter the pattern is the same.
        """

        def rows() -> tuple[PointRows, _Csr]:
            self.stiffness = self.reduction.matrix(K)
            if motion is not None:
                self._motion = motion
                self._moved = local_rows(motion.matMult(self.reduction.right), len(self.free))
            return self._rows()[1:]

        self.tangent.renew(rows, another=motion is not None)

    def start(self, unknowns: Callable[[], PETSc.Vec], translations: Array) -> None:
        def begin() -> Array:
            scale = self.reduction.right.getDiagonal().array_r
            return np.divide(unknowns().array_r, scale, out=0 * scale, where=scale != 0)

        self.tangent.start(begin, np.array([translations[at] for at in self.free]))

    @property
    def report(self) -> SolverReport:
        return self.tangent.solver.report

    def solve(
        self,
        load: PETSc.Vec,
        law: LinearisedLaw,
        totals: Array,
        accuracy: Accuracy = "final",
        friction_springs: Array | None = None,
    ) -> Solution:
        """Solve equilibrium under a reduced load with the law at every contact point.

        `friction_springs` (free,) are the stiffnesses by which friction on supports holds the free
        motions; None are no stiffness.
        """
        self.solved += 1
        none = np.zeros(len(self.free))
        self.tangent.hold_motions(none if friction_springs is None else friction_springs)
        right, balance = self.right(load, law, totals)
        found = self.tangent.solve(right, balance, law, accuracy)
        reduced = load.duplicate()
        reduced.setArray(found.unknowns[: len(right)])
        free = self.comm.bcast(found.unknowns[len(right) :], self.comm.size - 1)
        return Solution(reduced, np.array(free), found.exact, found.final)

    def right(self, load: PETSc.Vec, law: LinearisedLaw, totals: Array) -> tuple[Array, Array]:
        """Right-hand sides of this process' equations, and of free translations."""
        loads, right = self._read(load), self._spread_load(load)
        stated = self._own >= 0
        right[self._own[stated]] = (np.einsum("nab,nb->na", law.E, loads) + law.c)[stated]
        known = self.levers.forces(loads)
        known[:, -1] -= np.sum(self.levers.spun * self.levers.at, axis=1)
        return right, totals + self.totals(known)

    def weighed(self, force: Array) -> PETSc.Vec:
        """Weights of equations, reduced, whose sum is that of forces by weights (m, dim)."""
        stated, weights = self._own >= 0, self.reduction.left.createVecRight()
        weights.array[self._own[stated]] = (force * self._flexible)[stated]
        return weights

    def at_points(self, equations: Array) -> Array:
        """What this process' equations have at those of the points, (m, dim); 0 without any."""
        return np.where(self._own >= 0, equations[self._own], 0.0)

    def forces(self, residual: PETSc.Vec) -> tuple[Array, Array]:
        """Forces r (m, dim) at the points, and sizes of what is unbalanced in all equations."""
        rest = np.abs(self._spread_load(residual))
        rest[self._own[self._own >= 0]] = 0.0
        return self._read(residual), rest

    def motions(self, displacement: PETSc.Vec) -> Array:
        """G a, (m, dim), of a full displacement vector (n,)."""
        return np.array((self.interface.motion * displacement).array_r.reshape(self._own.shape))

    def followed(self, displacement: PETSc.Vec) -> Array:
        """G a of the law, (m, p), likewise."""
        m, dim = self._own.shape
        motions = dim * self._motion.getSize()[0] // self.interface.motion.getSize()[0]
        return np.array((self._motion * displacement).array_r.reshape(m, motions))

    def moved(self, displacement: PETSc.Vec) -> Array:
        """|G| |a|, (m, dim): how far a point and what it faces have moved together."""
        size = displacement.copy()
        size.abs()
        return np.array((self._magnitudes * size).array_r.reshape(self._own.shape))

    def totals(self, forces: Array) -> Array:
        """Sums of forces on motions (m, k) at the points of all processes, one per free motion."""
        pair = self.interface.pair
        sums = np.array([forces[pair == k, axis].sum() for k, axis in self.free])
        self.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return sums

    def arms(self, levers: Levers) -> Array:
        """Longest lever arm of each free motion; 1 of translations."""
        size = np.linalg.norm(levers.carried, axis=1)
        pair, tiny = self.interface.pair, np.finfo(float).tiny
        longest = np.array([size[pair == k, axis].max(initial=tiny) for k, axis in self.free])
        self.comm.Allreduce(MPI.IN_PLACE, longest, MPI.MAX)
        return longest

    def _read(self, equations: PETSc.Vec) -> Array:
        """L x, (m, dim), of a reduced vector; 0 where the law is not stated."""
        return self.at_points(equations.array_r) * self._flexible

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
    """A `ContactTangent` with an assembled matrix and its factors."""

    precise = True

    def __init__(
        self,
        matrix: PETSc.Mat,
        points: PointRows,
        first: int,
        borders: int,
        solver: LinearSolver,
        enclosed: Callable[[], bool],
    ) -> None:
        self._comm: MPI.Comm = matrix.comm.tompi4py()
        self.matrix, self._points, self._borders = matrix, points, borders
        self._first, self._place = first, points.place(first)
        self._solver, self.solver = solver, solver.prepare(matrix)
        self.encloses = enclosed
        self._factorised: Array | None = None
        self._springs: Array | None = None  # of the free motions, besides those of the matrix

    def start(self, unknowns: Callable[[], Array], translations: Array) -> None:
        """Factors need no place to begin at."""

    def hold_motions(self, springs: Array) -> None:
        if self._springs is None and not springs.any():
            return  # the matrix has zeros
        before = np.zeros_like(springs) if self._springs is None else self._springs
        if np.array_equal(before, springs):
            return
        self.matrix.assemble()  # rows that have been put in are no sums
        first = self.matrix.getSize()[0] - len(springs)
        for k in range(len(springs) if self._borders else 0):
            value = springs[k] - before[k]
            self.matrix.setValue(first + k, first + k, value, PETSc.InsertMode.ADD_VALUES)
        self.matrix.assemble()
        self._springs, self._factorised = springs.copy(), None

    def orientation(self) -> tuple[int, ...]:
        return ()

    def release(self) -> None:
        """Factors go with the last reference."""

    def renew(self, rows: Callable[[], tuple[PointRows, _Csr]], another: bool) -> None:
        (self._points, csr), self._factorised = rows(), None
        self._springs = None
        if not another:
            self.matrix.setValuesCSR(*csr)
            return
        self._place = self._points.place(self._first)
        self.matrix = PETSc.Mat().createAIJ(self.matrix.getSizes(), csr=csr, comm=self._comm)
        take = getattr(self.solver, "take", None)
        if take is None:
            raise ValueError(
                "two bodies at large sliding need a solver whose factors follow another pattern, "
                "such as Direct()"
            )
        take(self.matrix)

    def solve(self, right: Array, balance: Array, law: LinearisedLaw, accuracy: Accuracy) -> Solved:
        combinations, known = self._stand(law), self._known(right, balance)
        if accuracy == "more":
            self._factorised = None
        solution = self._corrected(known, combinations)
        if solution is not None:
            return Solved(np.asarray(solution.array_r), exact=False, final=True)
        solution = self.solver.solve(known)
        self._factorised = combinations
        return Solved(np.asarray(solution.array_r), exact=True, final=True)

    def solve_transposed(self, right: Array, balance: Array, law: LinearisedLaw) -> Array:
        """Solves with the transposed matrix: all weights of this process' equations."""
        self.hold_motions(np.zeros_like(balance))
        self._stand(law)
        solver = self._solver.prepare(self.matrix.transpose(PETSc.Mat()))
        weights = np.array(solver.solve(self._known(right, balance)).array_r)
        solver.release()
        return weights

    def _stand(self, law: LinearisedLaw) -> Array:
        """Puts a law into the matrix; gives its combinations, side by side (m, dim, ...)."""
        combinations = np.concatenate([law.E, law.C, law.D], axis=2)
        pointers, columns, rows = self._place
        values = self._points.values(combinations)
        self.matrix.setValuesIJV(pointers, columns, values, rowmap=rows)
        self.matrix.assemble()
        return combinations

    def _known(self, right: Array, balance: Array) -> PETSc.Vec:
        known = self.matrix.createVecRight()
        known.setArray(np.append(right, balance[: self._borders]))
        return known

    def _corrected(self, right: PETSc.Vec, combinations: Array) -> PETSc.Vec | None:
        """A few rows that differ from the last factorisation's are cheaper to correct."""
        if self._factorised is None:  # no process differs in this
            return None
        size = np.abs(self._factorised).max(axis=(0, 1), keepdims=True, initial=0.0)
        change = np.abs(combinations - self._factorised) > _EQUAL * size
        rows = self._points.own[change.any(axis=2)]
        return self.solver.solve_changed(right, self._first + rows[rows >= 0])
