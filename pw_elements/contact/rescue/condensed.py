"""What is tried where the active-set iteration has failed: ways that do without active sets.

The increment is condensed to its contact points and solved there as a complementarity problem with
small springs, then by Newton's method with a line search and without springs. Curved surfaces that
are free to move are linearised anew where they were found. The active set so found starts the
ordinary iteration, which alone decides what is a solution.

As its contact points alone see it, an increment is dense, small, and the same on every process:
the body's stiffness is condensed to the contact points (a Schur complement): with w the motion of
the points' free components, the forces are r = S w + r_0. S is found by moving one component at
a time, by one factorisation of the matrix in which all points are held; a body that floats is held
then, too, so that it has a stiffness S where it has no compliance. With the free translations U,
all that the law speaks of is linear in z = (w; U).

The complementarity problem is solved by Lemke's pivots. With polygonal cones of friction (in the
plane there are no others) a point's law is

    0 <= r_n  _|_  g >= 0,
    0 <= b_k  _|_  d_k.v + s >= 0,        r_t = sum b_k d_k,
    0 <= s    _|_  mu r_n - sum b_k >= 0,

s being the speed of slip. Where the points have a compliance that is positive definite the matrix
is copositive, and Lemke's method ends at a solution whatever the friction is (Cottle, Pang and
Stone, The Linear Complementarity Problem, theorem 4.4.13; Klarbring, Ing. Arch. 56 (1986)
529-541, doi:10.1007/BF00533830). Free translations and bodies that float have none: small springs
at the points and at the free surfaces give one. Their ends are moved to where the points were
found, so that they let go.
"""

import logging
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgWarning, lstsq, solve
from scipy.linalg.blas import dger
from scipy.optimize import linprog

from pw_elements.algebra import Reduction
from pw_elements.arrays import Array
from pw_elements.checks import collective
from pw_elements.contact.interface import Interface
from pw_elements.contact.iteration import (
    OPEN,
    STICK,
    ActiveSet,
    Contact,
    ContactSystem,
    Increment,
    Iterate,
    LinearisedLaw,
    Place,
    Policy,
    border_columns,
    equations,
    newton,
)
from pw_elements.contact.model import Cone, ContactFailed, Free, NotUnique
from pw_elements.progress import told
from pw_elements.solvers import LinearSolver, SingularSystem, SolverReport

# Sides of the polygon that stands for the circle of friction
_SIDES = 8
# Violation of the law and of balances over the largest contact force
_TOLERANCE = 1e-9
# Singular values that count as none, over the largest
_SINGULAR = 1e-12
# Smallest part of a step that a line search tries, and decrease that it asks for
_SHORTEST = 1e-6
_DECREASE = 1e-4

# Smallest pivot over the largest entry of its column, and how near a generic right-hand side is
_PIVOT = 1e-11
_GENERIC = 1e-10
# Pivots per unknown
_PIVOTS = 20
# Smallest gap of a loose body, over the largest at rest
_OPEN = 1e-9

# Stiffness of the springs over the points' own, how often their ends follow, and Newton's steps
_SPRINGS = (1e-3, 1e-5, 1e-7)
_SPRING_ROUNDS = 3
_NEWTON_STEPS = 30
_DAMPED_STEPS = 100
# Unknowns of the complementarity problem: its table takes 16 bytes times their square
_MOST_UNKNOWNS = 3000
# What takes as long as a linear system, over which part of it: a solution with factors, Newton's
# step on a dense system, what grows with its size's cube, a trial of a line search, and one of
# Lemke's pivots, which grows with the square of the table's size
_SUBSTITUTED = 0.05
_DENSE_STEP, _DENSE, _SEARCHED = 0.15, 1e-9, 0.02
_PIVOTED = 5e-8


@dataclass
class Budget:
    """What a remedy may still do, in linear systems and what takes about as long."""

    left: float

    def take(self, systems: float) -> bool:
        """Whether there was anything left before so many are taken."""
        self.left -= systems
        return self.left + systems > 0


class Condensation:
    """Stiffness S of a body (p, p), condensed to the stated components of its contact points."""

    def __init__(
        self, K: PETSc.Mat, reduction: Reduction, interface: Interface, solver: LinearSolver
    ) -> None:
        self._interface = interface
        self._system = ContactSystem(K, reduction, interface, (), solver)
        stated = gathered(interface, interface.equation >= 0)
        load = self._system.stiffness.createVecLeft()
        columns = []
        for point, axis in np.argwhere(stated):
            moved = np.zeros(stated.shape)
            moved[point, axis] = 1.0
            columns.append(self._forces(load, scattered(interface, moved))[stated])
        self.stiffness = np.stack(columns, axis=1)

    @property
    def report(self) -> SolverReport:
        return self._system.report

    def at_rest(self, load: PETSc.Vec, supported: Array) -> Array:
        """Forces (points, dim) under a reduced load while the points rest, supports aside."""
        return self._forces(load, -supported)

    def displaced(self, load: PETSc.Vec, moved: Array) -> PETSc.Vec:
        """Reduced displacements under a reduced load, the points' motion (m, dim) being given."""
        system, dim = self._system, moved.shape[1]
        none = np.zeros((len(moved), dim, dim))
        held = system.scale[:, None, None] * np.eye(dim)
        law = LinearisedLaw(none, held, none, system.scale[:, None] * moved)
        return system.solve(load, law, np.zeros(0)).reduced

    def _forces(self, load: PETSc.Vec, moved: Array) -> Array:
        residual = self._system.stiffness * self.displaced(load, moved) - load
        force, _ = self._system.forces(residual)
        return gathered(self._interface, force)


def gathered(interface: Interface, values: npt.NDArray) -> npt.NDArray:
    """Values (m, ...) at the points of all processes: pair after pair, by position."""
    return np.concatenate([interface.in_order(k, values) for k in range(interface.pairs)])


def scattered(interface: Interface, values: npt.NDArray) -> npt.NDArray:
    """Hands `gathered` values back: the rows (m, ...) of this process."""
    counts = [len(interface.in_order(k, interface.pair)) for k in range(interface.pairs)]
    return interface.local(np.split(values, np.cumsum(counts)[:-1]))


class CondensedIncrement:
    """Forces, gaps and slips of all contact points, linear in z = (w; U) about a place.

    Linear functions have the coefficients of z along their last axis, then their value at zero:
    `force` (points, dim, n + 1) has components along the frames, `seen` gaps, of what a surface
    faces, and slips; `balance` (k, n + 1) total forces of free translations less what is
    prescribed. `start` is z at the increment's start.
    """

    def __init__(self, increment: Increment, condensation: Condensation, place: Place) -> None:
        interface = increment.interface
        self._interface = interface
        self.free: Free = increment.system.free
        self.condensation = condensation

        def all_of(values: npt.NDArray) -> npt.NDArray:
            return gathered(interface, values)

        pair, stated = all_of(interface.pair), all_of(interface.equation >= 0)
        self.frame, self._gap = all_of(place.frame), all_of(place.gap)
        self.faced, self._places = np.isfinite(self._gap), np.flatnonzero(stated.ravel())
        said = np.concatenate(interface.cone.at)
        each = [interface.in_order(k, said) for k in range(interface.pairs)]
        self.cone = Cone(interface.cone.laws, each)
        self.scale = all_of(increment.system.scale)
        (points, dim), self.unknowns = stated.shape, len(self._places)
        size = self.unknowns + len(self.free) + 1

        self._translations = np.zeros((*increment.prescribed.shape, size))
        self._translations[..., -1] = np.nan_to_num(increment.prescribed)
        for k, at in enumerate(self.free, start=self.unknowns):
            self._translations[at][k] = 1.0
        moved, nodal = np.zeros((2, points * dim, size))
        moved[:, -1] = np.where(stated, 0.0, all_of(increment.supported)).ravel()
        moved[self._places, np.arange(self.unknowns)] = 1.0
        nodal[np.ix_(self._places, np.arange(self.unknowns))] = condensation.stiffness
        rest = condensation.at_rest(increment.equilibrium.load, increment.supported)
        nodal[self._places, -1] = rest.ravel()[self._places]
        self._moved, self._nodal = (of.reshape(points, dim, size) for of in (moved, nodal))
        sums = border_columns(self.free, pair, dim).T
        self.balance, self.sums = sums @ nodal, sums[:, self._places].sum(axis=1)
        self.balance[:, -1] -= increment.totals
        past = all_of(increment.past.displacement).ravel()[self._places]
        self.start = np.append(past, [increment.past.translations[at] for at in self.free])

        fields = ("pair", "at", "frame", "gap", "slip", "moved", "followed", "turned", "spun")
        every: dict[str, Any] = {name: all_of(getattr(place, name)) for name in fields}
        whole = replace(place, **every)
        following = self._translations[pair]

        def law(status: int) -> Array:
            """What vanishes by the law where all points are alike, along the frames."""
            none = np.zeros((points, dim - 1)), *np.zeros((3, points))
            law = whole.law(ActiveSet(np.full(points, status), *none), self.scale)
            rows = law.E @ self._nodal + law.C @ self._moved - law.D @ following
            rows[:, :, -1] -= law.c
            return self.frame @ rows

        self.force, self.seen = law(OPEN), law(STICK) / self.scale[:, None, None]

    def contact(self, z: Array) -> Contact:
        force, seen = (of @ np.append(z, 1.0) for of in (self.force, self.seen))
        gap = np.where(self.faced, seen[:, 0], np.inf)
        return Contact(self.frame, gap, seen[:, 1:], force, self.cone, self.scale)

    def step(self, active: ActiveSet, z: Array) -> Array:
        """The way from z to the solution of an active set; the shortest if there are many."""
        A, B, b = equations(active, self.scale)
        law = A @ self.force + B @ self.seen
        law[:, :, -1] -= b
        rows = np.vstack([self.in_components(law), self.balance])
        matrix, right = rows[:, :-1], -rows @ np.append(z, 1.0)
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)  # singular but for round-off
            try:
                return np.asarray(solve(matrix, right))
            except (np.linalg.LinAlgError, LinAlgWarning):
                return np.asarray(lstsq(matrix, right, _SINGULAR, lapack_driver="gelsy")[0])

    def in_components(self, framed: Array) -> Array:
        """Turns values (points, dim, ...) along the frames into the stated components (p, ...)."""
        turned = np.einsum("nab,na...->nb...", self.frame, framed)
        return turned.reshape(-1, *framed.shape[2:])[self._places]

    def residual(self, z: Array) -> Array:
        wrong = self.in_components(self.contact(z).violation())
        return np.append(wrong, self.balance @ np.append(z, 1.0))

    def error(self, z: Array) -> float:
        """Largest violation of the law and of the balances over the largest force."""
        largest = np.abs(self._nodal @ np.append(z, 1.0)).max(initial=0.0)
        wrong = np.abs(self.residual(z)).max(initial=0.0)
        return float(wrong / largest) if wrong > 0 else 0.0

    def newton(self, z: Array, most: int, damped: bool, budget: Budget) -> Array | None:
        """Semismooth Newton from z, damped by a line search on the residual; None if it fails."""
        for _ in range(most):
            if self.error(z) <= _TOLERANCE:
                return z
            if not budget.take(_DENSE_STEP + _DENSE * len(z) ** 3):
                return None
            step = self.step(self.contact(z).active_set(), z)
            if not np.isfinite(step).all():
                return None
            part, wrong = 1.0, np.linalg.norm(self.residual(z))
            while damped and not (
                np.linalg.norm(self.residual(z + part * step)) <= (1 - _DECREASE * part) * wrong
            ):
                part /= 2
                if part < _SHORTEST or not budget.take(_SEARCHED):
                    return None
            z = z + part * step
        return None

    def split(self, z: Array) -> tuple[Array, Array, Array]:
        """Translations (pairs, dim), motions and forces (m, dim) of this process."""
        translations, *points = (
            of @ np.append(z, 1.0) for of in (self._translations, self._moved, self._nodal)
        )
        moved, force = (scattered(self._interface, values) for values in points)
        return translations, moved, force


def lemke(M: Array, q: Array, budget: Budget) -> Array | None:
    """Finds x >= 0 with M x + q >= 0 and x.(M x + q) = 0; None if it ends on a ray, or has to.

    Rows are chosen with a generic q very near to the given one, so that no ratios are equal, and
    no basis comes back; the solution is that of its last basis for the given q.
    """
    n = len(q)
    if np.all(q >= 0):
        return np.zeros(n)
    generic = q + _GENERIC * np.abs(q).max() * np.random.default_rng(0).uniform(1, 2, n)
    # basic = table[:, -1] - table[:, :-2] @ others; variables are w, x and the artificial one
    artificial = 2 * n
    table = np.asfortranarray(np.column_stack([-M, -np.ones(n), generic, q]))
    basic, other = np.arange(n), np.arange(n, artificial + 1)
    row, column = int(np.argmin(generic)), n
    for _ in range(_PIVOTS * n):
        if not budget.take(_PIVOTED * n**2):
            return None
        _pivot(table, row, column)
        leaving, basic[row], other[column] = basic[row], other[column], basic[row]
        if leaving == artificial:
            x = np.zeros(artificial + 1)
            x[basic] = table[:, -1]
            return np.maximum(x[n:artificial], 0.0)
        column = int(np.flatnonzero(other == (leaving + n) % artificial)[0])
        entering = table[:, column]
        rows = np.flatnonzero(entering > _PIVOT * max(1.0, np.abs(entering).max()))
        if len(rows) == 0:
            return None
        row = int(rows[np.argmin(np.maximum(table[rows, -2], 0.0) / entering[rows])])
    return None


def _pivot(table: Array, row: int, column: int) -> None:
    pivot, entering = table[row, column], table[:, column].copy()
    scaled = table[row] / pivot
    entering[row] = scaled[column] = 0.0
    dger(-1.0, entering, scaled, a=table, overwrite_a=1)
    table[row] = scaled
    table[:, column] = -entering / pivot
    table[row, column] = 1.0 / pivot


def sprung(problem: CondensedIncrement, spring: float, near: Array, budget: Budget) -> Array | None:
    """The z of a problem with polygonal cones and springs at rest `near`; None without one."""
    faced = np.flatnonzero(problem.faced)
    tangents = problem.frame[:, 1:] * problem.cone.rough[:, None, None]
    directions = [_corners(tangents[n]) for n in faced]
    rough = np.array([k for k, d in enumerate(directions) if len(d)], dtype=np.intp)
    sides = np.array([len(directions[k]) for k in rough], dtype=np.intp)
    pressed, count = len(faced), int(sides.sum())
    owner = np.repeat(rough, sides)  # of each side, among those that are faced
    d = np.concatenate([np.zeros((0, problem.frame.shape[1] - 1)), *directions])
    # z of x = (r_n, b), and what it is without any
    along = np.zeros((*problem.frame.shape[:2], pressed + count + 1))
    along[faced, 0, np.arange(pressed)] = 1.0
    along[faced[owner], 1:, pressed + np.arange(count)] = d
    rows = np.vstack([problem.in_components(problem.force), problem.balance])
    right = np.pad(problem.in_components(along), [(0, len(problem.free)), (0, 0)])
    springs = spring * np.abs(np.diag(problem.condensation.stiffness)).mean()
    springs = springs * np.append(np.ones(problem.unknowns), problem.sums)
    right[:, -1] = springs * near - rows[:, -1]
    try:
        z = np.linalg.solve(rows[:, :-1] + np.diag(springs), right)
    except np.linalg.LinAlgError:
        return None

    # gaps and slips along the sides, times c
    seen = problem.seen[:, :, :-1] @ z
    seen[:, :, -1] += problem.seen[:, :, -1]
    seen *= problem.scale[:, None, None]
    met = along[..., :-1].reshape(-1, pressed + count).T @ seen.reshape(-1, z.shape[1])
    size = pressed + count + len(rough)
    M, q = np.zeros((size, size)), np.zeros(size)
    M[: pressed + count, : pressed + count], q[: pressed + count] = met[:, :-1], met[:, -1]
    side = pressed + np.arange(count)
    speed = pressed + count + np.repeat(np.arange(len(rough)), sides)
    M[side, speed], M[speed, side] = 1.0, -1.0
    force = np.maximum(0.0, problem.contact(near).force[:, 0])  # limits are linearised there
    limit, steep = problem.cone.limit(force)
    last = pressed + count + np.arange(len(rough))
    M[last, rough] = steep[faced[rough]]
    q[last] = (limit - steep * force)[faced[rough]]
    scale = np.abs(q).max(initial=0.0) or 1.0
    x = lemke(M, q / scale, budget)
    return None if x is None else z @ np.append(scale * x[: pressed + count], 1.0)


def _corners(tangents: Array) -> Array:
    """Corners (k, t) of the unit polygon of friction, for tangents (t, dim), zero or of length one.

    In the plane it is the circle itself.
    """
    one = np.eye(len(tangents))[np.linalg.norm(tangents, axis=1) > 0.5]
    if len(one) < 2:
        return np.concatenate([one, -one])
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def without_active_sets(
    increment: Increment,
    condensed: Callable[[], Condensation],
    place: Place,
    policy: Callable[[], Policy],
    most: int,
    budget: Budget,
) -> Iterate | None:
    """The solution of an increment, or None; NotUnique of a loose body or singular tangents."""
    comm, dim = increment.interface.comm, increment.interface.position.shape[1]
    points = sum(comm.allgather(len(increment.interface.pair)))
    size = points * (2 + (2 if dim == 2 else _SIDES))  # of the complementarity problem, at most
    if size > _MOST_UNKNOWNS or _SUBSTITUTED * points * dim > budget.left:
        told(comm, logging.INFO, "too many contact points to do without active sets", ".contact")
        return None
    words = f"without active sets, for what {budget.left:.0f} linear systems take at most"
    told(comm, logging.INFO, words, ".contact")
    try:
        condensation = condensed()
    except SingularSystem:
        return None
    budget.take(_SUBSTITUTED * len(condensation.stiffness))
    first = problem = CondensedIncrement(increment, condensation, place)
    near = first.start
    one_of_many: NotUnique | None = None
    for spring in _SPRINGS:
        for _ in range(_SPRING_ROUNDS):
            if not budget.take(0):
                break
            with collective(comm):
                found = _search(problem, spring, near, budget) if comm.rank == 0 else None
            z, exact, budget.left = comm.bcast(found)
            if z is None:
                break
            if exact is not None:
                way = f"springs of {spring:.0e}"
                solution = confirmed(problem, increment, exact, place, policy, most, way, budget)
                if isinstance(solution, Iterate):
                    return solution
                one_of_many = solution or one_of_many
            reached: Array = z if exact is None else exact
            near, place = reached, increment.kinematics(*problem.split(reached))
            problem = CondensedIncrement(increment, condensation, place)
    if one_of_many is not None:
        raise one_of_many
    _refuse_loose(first, increment)
    return None


def confirmed(
    problem: CondensedIncrement,
    increment: Increment,
    z: Array,
    place: Place,
    policy: Callable[[], Policy],
    most: int,
    way: str,
    budget: Budget,
) -> Iterate | NotUnique | None:
    """Starts the ordinary iteration from z: a solution, one of many, or nothing."""
    comm, before = increment.interface.comm, increment.system.solved
    most = int(max(1, min(most, budget.left)))
    try:
        active = vars(problem.contact(z).active_set()).values()
        first = ActiveSet(*(scattered(increment.interface, part) for part in active))
        solution = newton(increment, first, place, policy(), most)
    except ContactFailed as failed:
        told(comm, logging.INFO, f"not from {way}: {failed}", ".contact")
        there = at_itself(problem, increment, z)
        if there is not None and isinstance(failed.__cause__, SingularSystem):
            return NotUnique(f"at a solution, {failed}")
        if there is None:
            return None
        solution = there
    finally:
        budget.take(increment.system.solved - before)
    told(comm, logging.INFO, f"solved without active sets, from {way}", ".contact")
    return solution


def at_itself(problem: CondensedIncrement, increment: Increment, z: Array) -> Iterate | None:
    """The increment at z if it is a solution, which Newton may leave by round-off for ever."""
    translations, moved, force = problem.split(z)
    reduced = problem.condensation.displaced(
        increment.equilibrium.load, moved - increment.supported
    )
    there = increment.kinematics(translations, moved, force)
    now = increment.seen(reduced, translations, there)
    violation = increment.violation(now)
    if increment.nearest is None or violation < increment.nearest[1]:
        increment.nearest = now, violation
    return now if violation <= 1 else None


def _search(
    problem: CondensedIncrement, spring: float, near: Array, budget: Budget
) -> tuple[Array | None, Array | None, float]:
    """The z with springs, and without, as far as they are found, and what is left to do."""
    z = sprung(problem, spring, near, budget)
    exact = None if z is None else problem.newton(z, _NEWTON_STEPS, False, budget)
    if z is not None and exact is None:
        exact = problem.newton(z, _DAMPED_STEPS, True, budget)
    return z, exact, budget.left


def _refuse_loose(problem: CondensedIncrement, increment: Increment) -> None:
    """Raises NotUnique if there is a state without contact forces, in which nothing touches."""
    comm = increment.interface.comm
    with collective(comm):
        found = _loose(problem) if comm.rank == 0 else None
    z = comm.bcast(found)
    if z is not None and at_itself(problem, increment, z) is not None:
        raise NotUnique(
            "the loads are balanced without any contact force, and the body is loose: it can be "
            "where nothing touches it, in many places; a support, or a load that presses it "
            "against something, makes it one"
        )


def _loose(problem: CondensedIncrement) -> Array | None:
    """The z without contact forces in which the smallest gap is largest; None if it is not open."""
    n, gap = problem.balance.shape[1], problem.seen[problem.faced, 0]
    scale = np.abs(gap[:, -1]).max(initial=0.0) or 1.0
    balanced = np.concatenate([problem.force.reshape(-1, n), problem.balance])
    left, size, motions = np.linalg.svd(balanced[:, :-1], full_matrices=False)
    held = size > _SINGULAR * size.max(initial=0.0)
    if held.all():
        return None
    z, free = -motions[held].T @ (balanced[:, -1] @ left[:, held] / size[held]), motions[~held].T
    best = linprog(
        np.append(np.zeros(free.shape[1]), -1.0),
        A_ub=np.column_stack([-gap[:, :-1] @ free, np.ones(len(gap))]),
        b_ub=gap @ np.append(z, 1.0) / scale,
        bounds=[(None, None)] * free.shape[1] + [(None, 1.0)],
    )
    if not best.success or best.x[-1] <= _OPEN:
        return None
    return z + scale * (free @ best.x[:-1])
