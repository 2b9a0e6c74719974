"""What is tried where the active-set iteration has failed: ways that do without active sets.

The increment is condensed to its contact points and solved there as a complementarity problem with
small springs (`complementarity`), then by Newton's method with a line search and without springs
(`condensed`). Curved surfaces that are free to move are linearised anew where they were found.
The active set so found starts the ordinary iteration, which alone decides what is a solution.
"""

import logging
from collections.abc import Callable
from typing import Literal, TypeAlias

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.collective import collective
from pw_elements.contact.complementarity import sprung, unknowns
from pw_elements.contact.condensed import Condensation, CondensedIncrement, scattered
from pw_elements.contact.errors import ContactFailed, NotUnique
from pw_elements.contact.globalisation import Policy
from pw_elements.contact.interface import Interface
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.law import ActiveSet
from pw_elements.contact.newton import Increment, Iterate, newton
from pw_elements.linear_solver import SingularSystem

Array = npt.NDArray[np.float64]

Remedy: TypeAlias = Literal["condensed", "cutback", "search"]
REMEDIES: tuple[Remedy, ...] = ("condensed", "cutback", "search")

log = logging.getLogger("pw_elements.contact")

# Stiffness of the springs over the points' own, how often their ends follow, and Newton's steps
_SPRINGS = (1e-3, 1e-5, 1e-7)
_ROUNDS = 3
_STEPS = 30
_DAMPED_STEPS = 100
# Unknowns of the complementarity problem: its table takes 16 bytes times their square
_MOST = 3000


def tractable(interface: Interface) -> bool:
    """Whether the contact points are few enough for a dense problem."""
    points = sum(interface.comm.allgather(len(interface.pair)))
    return unknowns(points, interface.position.shape[1]) <= _MOST


def otherwise(
    failure: ContactFailed,
    increment: Increment,
    condensed: Callable[[], Condensation],
    place: Kinematics,
    policy: Callable[[], Policy],
    most: int,
) -> tuple[Iterate | None, ContactFailed]:
    """The solution where the iteration has failed, if there is one, and what else is to be told.

    `NotUnique` is told as it is; for the arguments see `without_active_sets`.
    """
    if isinstance(failure, NotUnique):
        return None, failure
    try:
        return without_active_sets(increment, condensed, place, policy, most), failure
    except NotUnique as unique:
        return None, unique


def without_active_sets(
    increment: Increment,
    condensed: Callable[[], Condensation],
    place: Kinematics,
    policy: Callable[[], Policy],
    most: int,
) -> Iterate | None:
    """The solution of an increment, or None.

    Args:
        increment: its equations.
        condensed: the body, condensed to its contact points.
        place: where the kinematics are linearised first.
        policy: makes one for each ordinary iteration.
        most: linear systems of each ordinary iteration.

    Raises:
        NotUnique: if the tangent is singular at all solutions met.
    """
    comm = increment.interface.comm
    if not tractable(increment.interface):
        _log(comm, "too many contact points to do without active sets")
        return None
    try:
        condensation = condensed()
    except SingularSystem:
        return None
    near: Array | None = None
    one_of_many: NotUnique | None = None
    for spring in _SPRINGS:
        for _ in range(_ROUNDS):
            problem = CondensedIncrement(increment, condensation, place)
            near = problem.start if near is None else near
            with collective(comm):
                found = _search(problem, spring, near) if comm.rank == 0 else None
            z, exact = comm.bcast(found)
            if z is None:
                break
            if exact is not None:
                way = f"springs of {spring:.0e}"
                solution = confirmed(problem, increment, exact, place, policy, most, way)
                if isinstance(solution, Iterate):
                    return solution
                one_of_many = solution or one_of_many
            reached: Array = z if exact is None else exact
            near, place = reached, increment.kinematics(*problem.split(reached))
    if one_of_many is not None:
        raise one_of_many
    return None


def confirmed(
    problem: CondensedIncrement,
    increment: Increment,
    z: Array,
    place: Kinematics,
    policy: Callable[[], Policy],
    most: int,
    way: str,
) -> Iterate | NotUnique | None:
    """What the ordinary iteration makes of z: a solution, one of many, or nothing.

    Args:
        problem: condensed with the kinematics of a place.
        increment: its equations.
        z: found in some way, which is logged.
        place: where the iteration starts.
        policy: makes one for it.
        most: linear systems that it may solve.
        way: in words.
    """
    comm = increment.interface.comm
    try:
        solution = newton(increment, _active_set(problem, increment, z), place, policy(), most)
    except ContactFailed as failed:
        _log(comm, f"not from {way}: {failed}")
        there = at_itself(problem, increment, z)
        if there is not None and isinstance(failed.__cause__, SingularSystem):
            return NotUnique(f"at a solution, {failed}")
        if there is None:
            return None
        solution = there
    _log(comm, f"solved without active sets, from {way}")
    return solution


def _log(comm: MPI.Comm, message: str) -> None:
    if comm.rank == 0:
        log.info(message)


def at_itself(problem: CondensedIncrement, increment: Increment, z: Array) -> Iterate | None:
    """The increment at z, if it is a solution as it is; None else.

    Newton's method may leave it for ever by round-off of curved surfaces.
    """
    translations, moved, force = problem.split(z)
    reduced = problem.condensation.displaced(increment.load, moved - increment.supported)
    there = increment.kinematics(translations, moved, force)
    now = increment.seen(reduced, translations, there)
    violation = increment.violation(now)
    if increment.nearest is None or violation < increment.nearest[1]:
        increment.nearest = now, violation
    return now if violation <= 1 else None


def _search(
    problem: CondensedIncrement, spring: float, near: Array
) -> tuple[Array | None, Array | None]:
    """The z with springs, and without, as far as they are found."""
    z = sprung(problem, spring, near)
    if z is None:
        return None, None
    exact = problem.newton(z, _STEPS, damped=False)
    return z, problem.newton(z, _DAMPED_STEPS, damped=True) if exact is None else exact


def _active_set(problem: CondensedIncrement, increment: Increment, z: Array) -> ActiveSet:
    active = problem.contact(z).active_set()
    status, direction, turning = (
        scattered(increment.interface, values)
        for values in (active.status, active.direction, active.turning)
    )
    return ActiveSet(status, direction, turning)
