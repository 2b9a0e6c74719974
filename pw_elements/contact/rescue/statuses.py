"""What is tried last, where iterations and parts of an increment have failed.

In the plane, all statuses of few contact points are searched: that ends with a state,
or with the proof that there is none, or too early to tell. Curved surfaces that are free to move
are linearised anew where the state was found, which is looked for near and then farther off; of
these nothing is proved. In space, and where the search ends too early, a state without any
contact force is looked for: where there is one, the body is loose, and there are many.

The search is by branch and bound. A branch allows each point some of the four statuses: open,
sticking, slipping forwards or backwards along its tangent. What these have in common is linear in
the motions z of the condensed increment:

    r_n >= 0,  g >= 0,  |r_t| <= mu r_n    always,
    r = 0                                  of points that can but be open,
    g = 0                                  of points that cannot,
    v >= 0,  r_t = -mu r_n                 of points that can but slip forwards,

and so on. A linear program asks by how much these conditions are violated at the least. If they can
all hold, Newton's method tries from there, and a point at which r_n g, or the friction's work, is
wrong has its statuses divided between two branches. If they cannot, the branch is closed, and the
program's multipliers say why: a combination of the conditions that is negative for every z,

    sum (force.r + gap g + slip.v) + sum total (R - P) = -1,

while each term is positive or zero by the law, or zero by balance. Where all branches are closed
and the kinematics are linear, the increment has no state. That is arithmetic, and is checked
as such: round-off could undo it only at motions that are `_HUGE` times those of the loads.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from pw_elements.checks import collective
from pw_elements.contact.iteration import ActiveSet, Increment, Iterate, Kinematics, Policy
from pw_elements.contact.model import ClosedBranch, NoSolution, NotUnique
from pw_elements.contact.rescue.condensed import (
    Condensation,
    CondensedIncrement,
    at_itself,
    confirmed,
    tractable,
)
from pw_elements.solvers import SingularSystem

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]

# Sets of statuses that a branch may allow, and into which two of them each is divided
_ANY, _OPENED, _CLOSED, _NOT_FORWARDS, _FORWARDS, _STICKING, _BACKWARDS = range(7)
_ALLOWED = np.array([*map(list, ("1111", "1000", "0111", "0101", "0010", "0100", "0001"))]) == "1"
_DIVIDED = {
    _ANY: (_OPENED, _CLOSED),
    _CLOSED: (_NOT_FORWARDS, _FORWARDS),
    _NOT_FORWARDS: (_STICKING, _BACKWARDS),
}
# Violation over the largest force that closes a branch, and that is none
_CLOSES, _NONE = 1e-7, 1e-9
# Motions, over those of the loads, up to which round-off leaves a closed branch closed
_HUGE = 1e3
# Points whose division is tried at once, Newton's steps and attempts
_CANDIDATES, _DIRECT_STEPS, _ATTEMPTS = 3, 8, 200
# Linear programs times points squared: some ten seconds
_MOST = 2_500_000
_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}

# Points that are few: a linear program of more takes long
_POINTS = 100
# How far free, curved surfaces are looked for, over the extent of the contact points, how often
# they are linearised anew, and the share of a search's work that each time is worth
_REACHES, _ROUNDS, _SHARE = (0.01, 0.1, 1.0), 6, 0.02
# Translations, over the same extent, at which gaps are asked, and their change that tells a curve
_STEPS, _CURVED = (1e-4, 1e-2, 1.0), 1e-9
# Smallest gap of a loose body, over the largest at rest
_OPEN = 1e-9


@dataclass(frozen=True)
class Search:
    """What a search has come to.

    Args:
        z: a solution of the condensed increment, or None.
        closed: all branches, if there is no solution; none of them if that is not known.
    """

    z: Array | None
    closed: tuple[ClosedBranch, ...] = ()


def searched(problem: CondensedIncrement, reach: Array | None, share: float = 1.0) -> Search:
    """Searches all statuses of a condensed increment in the plane.

    Args:
        problem: the increment.
        reach: (free translations, 2), between which these are looked for, if anywhere.
        share: of the work that may be done.
    """
    conditions = _Conditions(problem, reach)
    most = share * _MOST / max(1, len(conditions.faced)) ** 2
    root = np.zeros(len(conditions.faced), dtype=np.int8)
    first = conditions.least(root)
    if first is None or first.closed:
        return Search(None, first.why if first else ())
    waiting: list[tuple[Codes, Array]] = [(root, first.z)]
    closed: tuple[ClosedBranch, ...] = ()
    programs, attempts = 1, 0
    while waiting:
        codes, z = waiting.pop()
        if attempts < _ATTEMPTS:
            attempts += 1
            solution = problem.newton(z, _DIRECT_STEPS, damped=False)
            if solution is not None and conditions.within(solution):
                return Search(solution)
        options: list[tuple[Codes, Array]] = []
        for k in conditions.worst(codes, z):
            tried = [(part, conditions.least(part)) for part in _parts(codes, k)]
            programs += len(tried)
            found = [(part, least) for part, least in tried if least is not None]
            if len(found) < len(tried):
                return Search(None)
            left = [(part, least.z) for part, least in found if not least.closed]
            if len(left) < len(tried):
                closed += sum((least.why for _, least in found), ())
                options = left
                break
            options = options or left
        else:
            if not options:
                return Search(None)  # nothing is wrong, and yet it is no solution
        if programs > most:
            return Search(None)
        waiting += sorted(options, key=lambda option: -conditions.wrong(*option).sum())
    return Search(None, closed)


def _parts(codes: Codes, point: int) -> Iterator[Codes]:
    for code in _DIVIDED[int(codes[point])]:
        part = codes.copy()
        part[point] = code
        yield part


@dataclass(frozen=True)
class _Least:
    """A z of least violation, whether that closes the branch, and then why, if asked for."""

    z: Array
    closed: bool
    why: tuple[ClosedBranch, ...] = ()


class _Conditions:
    """Conditions >= 0, <= 0 or both, linear in z: r_n, g, mu r_n + r_t, mu r_n - r_t, v, others.

    Lengths are stated as forces, by the points' stiffness, and forces over the largest one.
    """

    def __init__(self, problem: CondensedIncrement, reach: Array | None) -> None:
        self.faced = np.flatnonzero(problem.faced)
        self._problem, self._reach = problem, reach
        faced, frame, stiffness = self.faced, problem.frame, problem.scale.mean()
        slides = np.linalg.norm(frame[:, 1], axis=1) > 0.5
        self._friction = problem.cone.steepest[faced]
        self._rough = slides[faced] & (self._friction > 0)
        force, balance = problem.force, problem.balance
        n = force.slope.shape[-1]
        # what is zero in any case: smooth shear, forces where nothing faces a point, balances
        away, smooth = ~problem.faced, slides & ~(problem.faced & (problem.cone.steepest > 0))
        normal, shear = force.slope[:, 0], force.slope[:, 1]
        mu = self._friction
        slopes = [
            normal[faced],
            stiffness * problem.gap.slope[faced],
            mu[:, None] * normal[faced] + shear[faced],
            mu[:, None] * normal[faced] - shear[faced],
            stiffness * problem.slip.slope[faced, 0],
            normal[away],
            shear[smooth],
            balance.slope,
        ]
        r_n, r_t = force.value.T
        values = [
            r_n[faced],
            stiffness * problem.gap.value[faced],
            mu * r_n[faced] + r_t[faced],
            mu * r_n[faced] - r_t[faced],
            stiffness * problem.slip.value[faced, 0],
            r_n[away],
            r_t[smooth],
            balance.value,
        ]
        self._away, self._smooth, self._stiffness = away, smooth, stiffness
        self._weight = np.ones(len(np.concatenate(values)))
        self._weight[2 * len(faced) : 4 * len(faced)] = np.tile(np.sqrt(1 + mu**2), 2)
        self.force = max(np.abs(part).max(initial=0.0) for part in values) or 1.0
        self._length = self.force / stiffness
        self._slope = np.concatenate(slopes).reshape(-1, n) / stiffness
        self._value = np.concatenate(values) / self.force
        self._rescale()

    def _rescale(self) -> None:
        """Takes the largest sum of normal forces for the scale, where there is one."""
        least, _ = self._limits(np.zeros(len(self.faced), dtype=np.int8))
        total = self._slope[: len(self.faced)].sum(axis=0)
        best = linprog(
            -total,
            A_ub=-self._slope[least],
            b_ub=self._value[least],
            bounds=(None, None),
            method="highs-ds",
        )
        if best.success:
            most = total @ best.x + self._value[: len(self.faced)].sum()
            share = float(np.clip(most, _CLOSES, 1.0))
            self.force, self._length = share * self.force, share * self._length
            self._value = self._value / share

    def _limits(self, codes: Codes) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Which conditions are >= 0, and which are <= 0."""
        points, rough = len(codes), self._rough
        least = np.ones((5, points), dtype=bool)
        least[2:4] = rough
        least[4] = rough & np.isin(codes, (_FORWARDS, _STICKING))
        most = np.zeros((5, points), dtype=bool)
        most[0] = codes == _OPENED
        most[1] = codes >= _CLOSED
        most[2] = rough & np.isin(codes, (_OPENED, _FORWARDS))
        most[3] = rough & np.isin(codes, (_OPENED, _BACKWARDS))
        most[4] = rough & np.isin(codes, (_NOT_FORWARDS, _STICKING, _BACKWARDS))
        always = np.ones(len(self._value) - 5 * points, dtype=bool)
        return np.append(least.ravel(), always), np.append(most.ravel(), always)

    def least(self, codes: Codes) -> _Least | None:
        """The z at which the conditions of a branch are violated least.

        None if HiGHS fails, or if round-off might undo what closes the branch.
        """
        least, most = self._limits(codes)
        sign = np.repeat((1.0, -1.0), (least.sum(), most.sum()))
        row = np.concatenate([np.flatnonzero(least), np.flatnonzero(most)])
        n = self._slope.shape[1]
        bounds = np.tile((-np.inf, np.inf), (n + 1, 1))
        bounds[n, 0] = 0.0
        if self._reach is not None:
            bounds[n - len(self._reach) : n] = self._reach / self._length
        best = linprog(
            np.append(np.zeros(n), 1.0),
            A_ub=np.column_stack([-sign[:, None] * self._slope[row], -self._weight[row]]),
            b_ub=sign * self._value[row],
            bounds=bounds,
            method="highs-ds",
            options=_TOLERANCES,
        )
        if not best.success:  # HiGHS gives up at times
            return None
        z = self._length * best.x[:n]
        if best.fun <= _CLOSES or self._reach is not None:
            return _Least(z, best.fun > _CLOSES)
        part = sign * np.maximum(0.0, -best.ineqlin.marginals)
        multiplier = np.zeros(len(self._value))
        np.add.at(multiplier, row, part)
        why = self._closed(codes, multiplier)
        return None if why is None else _Least(z, True, (why,))

    def _closed(self, codes: Codes, multiplier: Array) -> ClosedBranch | None:
        """The proof that multipliers of the conditions give, if they do."""
        constant, slope = multiplier @ self._value, multiplier @ self._slope
        if not -constant > _HUGE * np.abs(slope).sum():
            return None
        problem, faced, points = self._problem, self.faced, len(self.faced)
        by_row = np.split(multiplier / -constant, np.cumsum([points] * 5))
        normal, gap, forwards, backwards, slip, rest = by_row
        mu = self._friction
        along = np.zeros(problem.frame.shape[:2])
        along[faced, 0] = normal + mu * (forwards + backwards)
        along[faced, 1] = forwards - backwards
        away, smooth = np.flatnonzero(self._away), np.flatnonzero(self._smooth)
        along[away, 0] += rest[: len(away)]
        along[smooth, 1] += rest[len(away) : len(away) + len(smooth)]
        frame = problem.frame
        gaps, slips = np.zeros(len(frame)), np.zeros(len(frame))
        gaps[faced], slips[faced] = gap, slip
        allowed = np.tile(_ALLOWED[_OPENED], (len(frame), 1))
        allowed[faced] = _ALLOWED[codes]
        allowed[faced[~self._rough], 2:] = False  # smooth points have two statuses only
        return ClosedBranch(
            allowed,
            frame[:, 1],
            np.einsum("na,nab->nb", along, frame) / self.force,
            gaps * self._stiffness / self.force,
            slips[:, None] * frame[:, 1] * self._stiffness / self.force,
            rest[len(away) + len(smooth) :] / self.force,
        )

    def within(self, z: Array) -> bool:
        """Whether the free translations are where they are looked for."""
        if self._reach is None:
            return True
        moved = z[len(z) - len(self._reach) :]
        return bool(np.all((moved >= self._reach[:, 0]) & (moved <= self._reach[:, 1])))

    def wrong(self, codes: Codes, z: Array) -> Array:
        """What each point's law is violated by, beyond the conditions of a branch; (points,)."""
        values = self._slope @ (z / self._length) + self._value
        r_n, gap, ahead, behind, slip = values[: 5 * len(codes)].reshape(5, -1)
        r_n, gap, ahead, behind = (np.maximum(0.0, part) for part in (r_n, gap, ahead, behind))
        rubs = self._rough & (codes != _OPENED) & (r_n > gap)
        forwards = np.minimum(np.maximum(0.0, slip), ahead) * (codes != _FORWARDS)
        backwards = np.minimum(np.maximum(0.0, -slip), behind) * (codes != _BACKWARDS)
        return np.where(codes == _ANY, np.minimum(r_n, gap), 0.0) + rubs * (forwards + backwards)

    def worst(self, codes: Codes, z: Array) -> npt.NDArray[np.intp]:
        """The points at which the law is violated most, and whose statuses can be divided."""
        wrong = np.where(np.isin(codes, list(_DIVIDED)), self.wrong(codes, z), 0.0)
        wrong[~self._rough & (codes != _ANY)] = 0.0
        ranked = np.argsort(-wrong, kind="stable")[:_CANDIDATES]
        return ranked[wrong[ranked] > _NONE]


def search(
    increment: Increment,
    condensed: Callable[[], Condensation],
    place: Kinematics,
    policy: Callable[[], Policy],
    most: int,
) -> Iterate | None:
    """The solution of an increment, or None; the arguments are those of `without_active_sets`.

    Raises:
        NoSolution: if it is proved that there is none.
        NotUnique: if the tangent is singular at a solution.
    """
    interface = increment.interface
    if not tractable(interface):
        return None
    try:
        condensation = condensed()
    except SingularSystem:
        return None
    first, linear = CondensedIncrement(increment, condensation, place), _linear(increment, place)
    if interface.position.shape[1] == 2 and len(first.cone.steepest) <= _POINTS:
        for reach in (None,) if linear else _REACHES:
            problem, here = first, place
            for _ in range(1 if linear else _ROUNDS):
                z, closed = _found(problem, increment, place, reach)
                if closed:
                    raise _no_solution(closed, first)
                if z is None:
                    break
                solution = confirmed(problem, increment, z, here, policy, most, "a search")
                if isinstance(solution, NotUnique):
                    raise solution
                if solution is not None:
                    return solution
                here = increment.kinematics(*problem.split(z))
                problem = CondensedIncrement(increment, condensation, here)
    _refuse_loose(first, increment)
    return None


def _found(
    problem: CondensedIncrement, increment: Increment, place: Kinematics, reach: float | None
) -> tuple[Array | None, tuple[ClosedBranch, ...]]:
    """A solution of the condensed increment, or closed branches, of `searched` on one process."""
    interface = increment.interface
    comm, limits, share = interface.comm, None, 1.0
    if reach is not None:
        here = np.array([place.translations[at] for at in problem.free])
        limits = here[:, None] + reach * interface.extent * np.array([-1.0, 1.0])
        share = _SHARE
    with collective(comm):
        search = searched(problem, limits, share) if comm.rank == 0 else None
    found: Search = comm.bcast(search)
    return found.z, found.closed


def _linear(increment: Increment, place: Kinematics) -> bool:
    """Whether gaps are linear in the free translations, as far as asking tells."""
    interface, free = increment.interface, np.isnan(increment.prescribed)
    gap, normal = interface.gaps(place.translations), interface.normals(place.translations)
    faced, extent = np.isfinite(gap), interface.extent
    wrong = False
    for axis in np.flatnonzero(free.any(axis=0)):
        for step in (sign * part * extent for part in _STEPS for sign in (-1, 1)):
            moved = place.translations.copy()
            moved[free[:, axis], axis] += step
            try:
                there, turned = interface.gaps(moved), interface.normals(moved)
            except Exception:  # a user's surface may not know its gaps so far away
                wrong = True
                continue
            follows = free[interface.pair, axis] * step
            still = faced & np.isfinite(there)
            change = (there[still] - gap[still]) + (follows * normal[:, axis])[still]
            wrong |= bool(np.any(np.isfinite(there) != faced))
            wrong |= bool(np.any(np.abs(turned - normal) > _CURVED))
            wrong |= bool(np.any(np.abs(change) > _CURVED * extent))
    return not interface.comm.allreduce(int(wrong), MPI.MAX)


def _no_solution(closed: tuple[ClosedBranch, ...], problem: CondensedIncrement) -> NoSolution:
    error = NoSolution(
        f"no state obeys the contact conditions: all statuses of the {len(problem.cone.steepest)} "
        "contact nodes have been searched, and each branch of the search contradicts them. "
        "Smaller increments take another path, on which there may be one"
    )
    error.branches = closed
    return error


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
    n, scale = problem.force.slope.shape[-1], np.abs(problem.gap.value).max(initial=0.0) or 1.0
    stiffness = problem.scale.mean()
    balanced = np.concatenate([problem.force.slope.reshape(-1, n), problem.balance.slope])
    forces = np.append(problem.force.value.ravel(), problem.balance.value)
    faced = problem.faced
    best = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.column_stack([-problem.gap.slope[faced], np.ones(int(faced.sum()))]),
        b_ub=problem.gap.value[faced] / scale,
        A_eq=np.column_stack([balanced / stiffness, np.zeros(len(balanced))]),
        b_eq=-forces / (stiffness * scale),
        bounds=[(None, None)] * n + [(None, 1.0)],
    )
    if not best.success or best.x[-1] <= _OPEN:
        return None
    z = scale * best.x[:n]
    points, dim = problem.frame.shape[:2]
    none = ActiveSet(np.zeros(points, np.int8), np.zeros((points, dim - 1)), *np.zeros((3, points)))
    return z + problem.step(none, z)
