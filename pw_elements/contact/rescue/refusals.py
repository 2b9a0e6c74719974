"""What is tried where the iteration of an increment has failed, and which refusal it is.

Springs hold the contact points. They end where these were found last, get softer where a state is
found, and stiffer where none is.

Statics alone may prove that no contact forces balance the loads: by a rigid motion in which they do
work, with v_n >= mu |v_t| at every point that a surface faces. A linear program looks for it; the
guide's page on theory has the argument ("Where the iteration fails").

Only contact points are gathered, and the program runs on one process: 3 seconds for 10 000 points
in space, 0.2 in the plane.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from scipy.optimize import linprog

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import collective_errors, format_points
from pw_elements.contact.iteration import (
    ActiveSetUpdate,
    Increment,
    LinearIncrement,
    NewtonState,
    make_contact_state,
    reference_sizes,
    solve_increment,
)
from pw_elements.contact.model import (
    ContactFailed,
    ContactState,
    LastContactLost,
    MissingForce,
    NoEquilibrium,
    NotFound,
    NotUnique,
    RigidVelocity,
    Smallness,
    describe_exhausted_friction,
)
from pw_elements.contact.nodes import (
    TOLERANCE,
    ActiveSet,
    LinearisedKinematics,
    UndeformedKinematics,
    is_same_set,
)
from pw_elements.contact.rescue.rigid import NOTHING, Basis, RigidModes, RigidMotions, direction
from pw_elements.progress import log_on_root
from pw_elements.solvers import NotConverged, SingularSystem, SolverReport, group_connected_nodes

# Stiffness of the first and of the softest springs, over the points' own
_FIRST, _SOFTEST = 1e-2, 1e-13
# How much softer they get where a state is found, and stiffer where none is
_SOFTER, _STIFFER = 30.0, 5.0
# After a failure the factor of softening is raised to this power, but stays above the least
_SLOWER, _LEAST = 0.7, 2.0
_FAILURES = 20
# Iterations with springs, and without
_MOST = 25
_CONFIRMED = 12
_LOOSE = (
    "the loads are balanced without any contact force, and the body is loose: it can be where "
    "nothing touches it, in many places; a support, or a load that presses it against something, "
    "makes it one"
)

# Work of the loads over the sum of its parts' magnitudes: none below
_ZERO_WORK = 1e-9
# Contact forces over loads that would undo the proof where a cone is overstepped by round-off
_HUGE = 1e3
# Overstepping of a cone, a velocity over the largest one, that calls for a cut; rounds of cuts
_OVERSTEPPING = 1e-10
_MOST_CUTS = 40
# What motion costs, so that only moves what the loads push
_PRICE = 1e-7
# Steps along a free translation, over the extent of the contact points, at which normals are
# asked, and the change that tells a curved surface
_TURNING_STEPS = (1e-4, 1e-2, 1.0)
_TURNED = 1e-9
_HIGHS_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}

_ENCLOSED = (
    "Supports and contact enclose an incompressible body, whose volume has no room and whose "
    "pressure no scale: leave a part of its surface free, or use nu below 1/2"
)

# Makes an increment with springs of a share of the points' stiffness, which end where all unknowns
# (n,) and the surfaces' translations (pairs, dim) are given
Sprung = Callable[[float, PETSc.Vec, Array], LinearIncrement]


@dataclass(frozen=True)
class Points:
    """Contact points of all processes (m) that a surface faces, or may come to face."""

    pair: Indices  # (m,)
    steepest: Array  # (m,), slope of the cone of friction at zero
    turning: Mask  # (m,), whether the normal turns with a free translation
    normal: Array  # (m, k), v_n in each of k motions
    tangential: Array  # (m, dim, k), v_t

    def clusters(self) -> list[Indices]:
        """Motions that have points in common, directly or by others."""
        moved = self._moved().astype(float)
        return group_connected_nodes(moved.T @ moved > 0)

    def within(self, motions: Indices) -> "Points":
        """The points that some of the motions move, and their velocities in these."""
        some = self.where(np.any(self._moved()[:, motions], axis=1))
        normal, tangential = some.normal[:, motions], some.tangential[..., motions]
        return replace(some, normal=normal, tangential=tangential)

    def rows(self, along: Array) -> Array:
        """v_n - mu v_t·d over the length of (1, mu), (m, k), for unit vectors d (m, dim)."""
        sliding = np.einsum("ma,mak->mk", along, self.tangential)
        mu = self.steepest[:, None]
        return np.asarray((self.normal - mu * sliding) / np.sqrt(1 + mu**2))

    def clearance(self, velocity: Array) -> Array:
        """v_n - mu |v_t| over the length of (1, mu), (m,), in a motion (k,)."""
        sliding = np.linalg.norm(self.tangential @ velocity, axis=1)
        return (self.normal @ velocity - self.steepest * sliding) / np.sqrt(1 + self.steepest**2)

    def where(self, mask: Mask) -> "Points":
        return Points(*(values[mask] for values in vars(self).values()))

    def _moved(self) -> Mask:
        return (self.normal != 0) | np.any(self.tangential != 0, axis=1)


def proof(points: Points, power: Array, size: Array) -> tuple[Array, Array] | None:
    """A motion in which loads do work that no contact force takes away, by arithmetic.

    With it are the least forces to be added for a balance. `size` (k,) are the magnitudes of which
    the `power` is made.
    """
    for price in (_PRICE, 0.0):  # it hides work next to the limit, and makes HiGHS give up at times
        velocity, least = escape(points, power, price)
        if proves_imbalance(points, power, size, velocity):
            return velocity, least
    return None


def proves_imbalance(points: Points, power: Array, size: Array, velocity: Array) -> bool:
    """Check by arithmetic that no contact forces take away the work of loads in a motion (k,).

    Where the motion oversteps a cone, forces along it would do so if they were large enough: the
    work has to exceed what forces `_HUGE` times as large as the loads can take away.
    """
    overstepping = float(np.max(-points.clearance(velocity), initial=0.0))
    least_work = max(_ZERO_WORK, _HUGE * overstepping) * float(size @ np.abs(velocity))
    return bool(power @ velocity > least_work)


def escape(points: Points, power: Array, price: float = _PRICE) -> tuple[Array, Array]:
    """The motion (k,) in which loads do most work and no contact force takes any away.

    Its components are one at most; with it are the least forces (k,) to be added for a balance.
    """
    k, scale = len(power), np.abs(power).max() or 1.0
    costs = np.concatenate([-power, power]) / scale + price  # of each way in each motion
    axes = np.eye(points.tangential.shape[1])
    rows = [points.rows(np.tile(d, (len(points.pair), 1))) for d in (*axes, *-axes)]
    for _ in range(_MOST_CUTS):
        limits = np.unique(np.vstack(rows), axis=0)
        best = linprog(
            costs,
            A_ub=np.hstack([-limits, limits]),
            b_ub=np.zeros(len(limits)),
            bounds=(0, 1),
            options=_HIGHS_TOLERANCES,
        )
        if not best.success:
            return np.zeros(k), np.zeros(k)
        velocity = best.x[:k] - best.x[k:]
        beyond = points.where(points.clearance(velocity) < -_OVERSTEPPING)
        sliding: Array = beyond.tangential @ velocity
        size = np.linalg.norm(sliding, axis=1, keepdims=True)
        if not size.any():
            break
        rows.append(beyond.where(size[:, 0] > 0).rows((sliding / size)[size[:, 0] > 0]))
    least = best.upper.marginals
    return velocity, scale * (least[:k] - least[k:])


def gather_points(increment: Increment, kinematics: LinearisedKinematics, works: Array) -> Points:
    """Points of all processes, in an order independent of them; `works` are (m, dim, k)."""
    interface, free = increment.interface, np.isnan(increment.prescribed)
    faced = np.isfinite(kinematics.gap) | np.any(free, axis=1)[interface.pair]
    acted_on = (interface.equation >= 0) | interface.held_components
    works = np.where(acted_on[..., None], works, 0.0)
    tangents = kinematics.frame[:, 1:]
    values = (
        interface.pair,
        interface.cone.max_coefficient,
        _find_turning(increment, kinematics),
        np.einsum("na,nak->nk", kinematics.frame[:, 0], works),
        np.einsum("nta,ntb,nbk->nak", tangents, tangents, works),
        faced,
    )
    *points, some = (
        np.concatenate([interface.in_order(k, part) for k in range(interface.pairs)])
        for part in values
    )
    return Points(*points).where(some)


def _find_turning(increment: Increment, kinematics: LinearisedKinematics) -> Mask:
    """Return the points (m,) whose normals turn with a free translation of their surface."""
    interface, free = increment.interface, np.isnan(increment.prescribed)
    here, turning = interface.normals(kinematics.q0), np.zeros(len(interface.pair), dtype=bool)
    for axis in np.flatnonzero(free.any(axis=0)):
        for step in (sign * part * interface.extent for part in _TURNING_STEPS for sign in (-1, 1)):
            moved = kinematics.q0.copy()
            moved[free[:, axis], axis] += step
            try:
                change = np.abs(interface.normals(moved) - here).max(axis=1)
            except Exception:  # a user's surface may not know its normals so far away
                change = np.where(free[interface.pair, axis], np.inf, 0.0)
            turning |= ~(change <= _TURNED)
    return turning


def prove_no_equilibrium(
    increment: Increment, load: PETSc.Vec, kinematics: LinearisedKinematics, rigid: RigidMotions
) -> NoEquilibrium | None:
    """Return the refusal with its proof, if there is one, under a reduced load.

    It is the same on all processes.
    """
    basis, works = rigid.virtual()
    work, size = rigid.power(load, increment.totals)
    points = gather_points(increment, kinematics, works)
    error: NoEquilibrium | None = None
    comm = increment.system.comm
    with collective_errors(comm):
        if comm.rank == 0:
            error = _proved(points, basis, work, size, rigid.modes)
    return comm.bcast(error)


def check_loose(
    increment: Increment,
    end: NewtonState,
    rigid: RigidMotions,
    before: ContactState,
    spent: Callable[[], tuple[int, SolverReport]],
) -> None:
    """Raise NotUnique for a solution in which a body is clear of all contact forces and loose."""
    if not (motions := rigid.loose(end.nodes, end.allowance)):
        return
    failure = NotUnique(f"{_LOOSE}. Nothing stops a {', '.join(motions)}")
    failure.state = _make_unsolved_state(increment, end, before, spent())
    raise failure


def _make_unsolved_state(
    increment: Increment, state: NewtonState, before: ContactState, cost: tuple[int, SolverReport]
) -> ContactState:
    """Return the contact state of a Newton state that is no solution, at a cost so far."""
    iterations, report = cost
    return make_contact_state(
        increment,
        state,
        before,
        sizes=reference_sizes(increment, state, before.scale),
        iterations=iterations,
        report=report,
        smallness=Smallness(np.nan, np.nan, np.nan),
        converged=False,
    )


def rescue(
    failure: ContactFailed | NotConverged,
    increment: Increment,
    proved: Callable[[], NoEquilibrium | None],
    remedy: Callable[[], NewtonState | None] | None,
    before: ContactState,
    spent: Callable[[], tuple[int, SolverReport]],
) -> NewtonState:
    """The solution of an increment whose iteration has failed, or the refusal that says why.

    A remedy is tried if there is one. A failure to converge stays one, unless statics explain it.
    """
    if proof := proved():
        raise proof from None
    if isinstance(failure, NotConverged):
        raise failure
    if remedy is not None and not isinstance(failure, NotUnique):
        try:
            found = remedy()
        except NotUnique as unique:
            failure, found = unique, None
        if found is not None:
            return found
    near, state = "", None
    if increment.nearest is not None:
        state = _make_unsolved_state(increment, increment.nearest, before, spent())
        share = f"{increment.nearest.violation * TOLERANCE:.1g}"
        near = f" The state that came nearest violates the law by {share} of its largest force."
    if not isinstance(failure, NotUnique):
        enclosed = f" {_ENCLOSED}." if increment.system.tangent.has_enclosed_pressure() else ""
        advice = "Smaller increments, or pressing before pushing, may find one"
        if state is not None and isinstance(failure, LastContactLost):
            advice = describe_exhausted_friction(state) or advice
        failure = NotFound(
            f"{failure}. That is no proof that there is no solution.{enclosed}{near} {advice}"
        )
    failure.state = state
    raise failure from None


def _proved(
    points: Points, basis: Basis, work: Array, size: Array, modes: RigidModes
) -> NoEquilibrium | None:
    """One refusal with the proofs of all clusters of motions, None if there is no proof."""
    motion, missing, words = np.zeros(len(work)), np.zeros(len(work)), []
    for cluster in points.clusters():
        touched, motions = points.within(cluster), basis.motions[cluster]
        if touched.turning.any():
            continue
        found = proof(touched, motions @ work, np.abs(motions) @ size)
        if found is None:
            continue
        velocity, lacking = found
        motion += velocity @ motions
        lacking[np.abs(lacking) <= NOTHING * np.abs(lacking).max()] = 0.0
        missing[basis.pivot[cluster]] = lacking
        words.append(modes.name(velocity @ motions) + _contacts(touched, velocity))
    if not words:
        return None
    (moved, turned, surface), (force, moment, push) = modes.parts(motion), modes.parts(missing)
    rate, couple = turned / modes.length[:, None], moment * modes.length[:, None]
    lacks = MissingForce(force, couple, push)
    error = NoEquilibrium(
        f"no contact forces balance the loads: {'; '.join(words)}. At least "
        f"{_amount(modes.centre, lacks)} would have to be added to the loads"
    )
    error.velocity = RigidVelocity(modes.centre, moved, rate, surface, float(motion @ work))
    error.missing = lacks
    return error


def _contacts(points: Points, velocity: Array) -> str:
    """Says what the body does at each pair in a motion (k,)."""
    sliding, clear = points.tangential @ velocity, points.clearance(velocity)
    speed = np.linalg.norm(sliding, axis=1)
    nothing = NOTHING * max(speed.max(initial=0.0), clear.max(initial=0.0))
    words = []
    for k in np.unique(points.pair):
        slides = (points.pair == k) & (clear <= nothing) & (speed > nothing)
        if slides.any():
            along = sliding[slides] / speed[slides, None]
            one = np.all(along @ along[0] > 1 - NOTHING)
            words.append(f"slides {f'along {direction(along[0])} ' if one else ''}on pair {k}")
        elif np.any(clear[points.pair == k] > nothing):
            words.append(f"lifts off pair {k}")
    return f", by which the body {' and '.join(words)}" if words else ""


def _amount(centre: Array, missing: MissingForce) -> str:
    words = []
    for k in range(len(centre)):
        place = format_points(centre[k : k + 1])
        on = f" on the body around {place}" if len(centre) > 1 else ""
        if missing.force[k].any():
            words.append(f"a force of {_numbers(missing.force[k])}{on}")
        if missing.moment[k].any():
            words.append(f"a moment of {_numbers(missing.moment[k])} about {place}{on}")
    for k in range(len(missing.surface)):
        if missing.surface[k].any():
            words.append(f"a force of {_numbers(missing.surface[k])} of the surface of pair {k}")
    return " and ".join(words)


def _numbers(values: Array) -> str:
    words = ", ".join(f"{value:.4g}" for value in values)
    return f"({words})" if len(values) > 1 else words


def solve_with_springs(
    increment: LinearIncrement,
    with_springs: Sprung,
    kinematics: UndeformedKinematics,
    *,
    first: tuple[ActiveSet, LinearisedKinematics, PETSc.Vec],
    make_update: Callable[[], ActiveSetUpdate],
    max_iterations: int,
    left: Callable[[], float],
) -> NewtonState | None:
    """Solve an increment by springs at the contact points that get softer and softer.

    Args:
        increment: without springs.
        with_springs: makes the increment with springs of a share of the points' stiffness.
        kinematics: of the body.
        first: active set, kinematics and all unknowns (n,) from which it starts.
        make_update: how active sets of the increment without springs follow each other.
        max_iterations: the most linear systems solved in one iteration.
        left: how many may still be solved in all.

    Returns:
        The solution without springs, or None.

    Raises:
        NotUnique: where tangents are singular at a solution.
    """

    def at_most(some: int) -> int:
        return int(max(1, min(some, max_iterations, left())))

    (active, linearised, unknowns), comm = first, increment.interface.comm
    q, stiffness, softening, n_failures = linearised.q0, _FIRST, _SOFTER, 0
    previous: ActiveSet | None = None
    words = f"by springs, for what {left():.0f} linear systems take at most"
    log_on_root(comm, logging.INFO, words, ".contact")
    while stiffness > _SOFTEST and n_failures < _FAILURES and left() > 0:
        held_by_springs = with_springs(stiffness, unknowns, q)
        update = ActiveSetUpdate(_no_free_motions, increment.interface)
        try:
            sprung = solve_increment(
                held_by_springs,
                active,
                linearised,
                update,
                max_iterations=at_most(_MOST),
                after_iteration=_say_nothing,
            )
        except ContactFailed as failed:
            log_on_root(
                comm, logging.INFO, f"not with springs of {stiffness:.0e}: {failed}", ".contact"
            )
            n_failures, softening = n_failures + 1, max(_LEAST, softening**_SLOWER)
            stiffness *= _STIFFER
            continue
        unknowns, q = sprung.unknowns, sprung.q
        linearised = kinematics.linearise(q, sprung.displacement, sprung.force)
        state = increment.evaluate(sprung.reduced, q, linearised)
        increment.record(state)
        active = sprung.nodes.active_set
        is_steady = previous is not None and is_same_set(previous, active, comm)
        if state.violation <= 1 or is_steady:
            try:
                solution = solve_increment(
                    increment,
                    active,
                    linearised,
                    make_update(),
                    max_iterations=at_most(_CONFIRMED),
                    after_iteration=_say_nothing,
                )
                log_on_root(comm, logging.INFO, f"solved by springs of {stiffness:.0e}", ".contact")
                return solution
            except ContactFailed as failed:
                words = f"not from springs of {stiffness:.0e}: {failed}"
                log_on_root(comm, logging.INFO, words, ".contact")
                if state.violation <= 1:
                    if isinstance(failed.__cause__, SingularSystem):
                        (force,) = increment.max_over_ranks(np.abs(state.force))
                        loose = force <= state.round_off
                        raise NotUnique(_LOOSE if loose else f"at a solution, {failed}") from failed
                    return state  # which the iteration leaves by round-off
        previous, stiffness = active, stiffness / softening
    return None


def _no_free_motions(active: ActiveSet, frame: Array) -> list[str]:  # noqa: ARG001
    """Return no motions: springs hold all of them."""
    return []


def _say_nothing(iteration: int, active: ActiveSet, violation: float) -> None:
    """Ignore an iteration with springs."""
