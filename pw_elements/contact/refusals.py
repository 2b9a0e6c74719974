"""Which refusal it is when the iteration of an increment has failed, and its words."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pw_elements.collective import collective
from pw_elements.contact.equilibrium import Points, gathered, proof
from pw_elements.contact.errors import (
    ContactFailed,
    MissingForce,
    NoEquilibrium,
    NotFound,
    NotUnique,
    RigidVelocity,
    listed,
)
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.newton import TOLERANCE, Increment
from pw_elements.contact.results import contact_state
from pw_elements.contact.rigid import NOTHING, Basis, RigidModes, direction
from pw_elements.contact.state import ContactState, Smallness
from pw_elements.contact.statics import RigidMotions
from pw_elements.linear_solver import SolverReport

Array = npt.NDArray[np.float64]

_ENCLOSED = (
    "Supports and contact enclose an incompressible body, whose volume has no room and whose "
    "pressure no scale: leave a part of its surface free, or use nu below 1/2"
)


def no_equilibrium(
    increment: Increment, place: Kinematics, rigid: RigidMotions
) -> tuple[NoEquilibrium | None, list[int]]:
    """The refusal with its proof, if there is one; the same on all processes.

    And the pairs of which no proof was looked for: their surfaces are curved and free to move.

    Args:
        increment: whose iteration has failed.
        place: kinematics at its start.
        rigid: motions of the body's pieces and of free surfaces.
    """
    basis, works = rigid.virtual()
    work, size = rigid.power(increment.load, increment.totals)
    points = gathered(increment, place, works)
    error: NoEquilibrium | None = None
    comm = increment.system.comm
    with collective(comm):
        if comm.rank == 0:
            error = _proved(points, basis, work, size, rigid.modes)
    return comm.bcast(error), [int(k) for k in np.unique(points.pair[points.turning])]


def refusal(
    failure: ContactFailed,
    increment: Increment,
    before: ContactState,
    spent: tuple[int, SolverReport],
    unproved: Sequence[int],
) -> ContactFailed:
    """`NotUnique` if that is what the tangent showed, else `NotFound`; both with a state.

    Args:
        failure: of the iteration; no proof against an equilibrium has been found.
        increment: that failed.
        before: state at its start.
        spent: linear systems solved in vain, and what they took.
        unproved: pairs of which no proof was looked for.
    """
    near, state = "", None
    doubt = "That is no proof that there is no solution" + "".join(
        f", and none was looked for where pair {k} is concerned: its surface is curved and free to "
        "move, so that its normals are not given"
        for k in unproved
    )
    if increment.nearest is not None:
        now, violation = increment.nearest
        size = Smallness(np.nan, np.nan, np.nan)  # of no solution
        iterations, report = spent
        state = contact_state(increment, now, iterations, before, report, size, converged=False)
        share = f"{violation * TOLERANCE:.1g}"
        near = f" The state that came nearest violates the law by {share} of its largest force."
    if not isinstance(failure, NotUnique):
        enclosed = ""
        if increment.system.encloses():
            enclosed = f" {_ENCLOSED}."
        failure = NotFound(
            f"{failure}. {doubt}.{enclosed}{near} Smaller increments, pressing before pushing, or "
            "a start from states of a smaller friction or a coarser mesh may find one"
        )
    failure.state = state
    return failure


def _proved(
    points: Points, basis: Basis, work: Array, size: Array, modes: RigidModes
) -> NoEquilibrium | None:
    """What is proved of all clusters of motions, in one."""
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
        words.append(_movement(modes, touched, velocity, velocity @ motions))
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


def _movement(modes: RigidModes, points: Points, velocity: Array, motion: Array) -> str:
    """Who is lifted, overturned or dragged off, in words."""
    movers = modes.movers(motion, motion[None])
    if len(movers) > 1:
        contacts = _contacts(points, velocity, False)
        return f"{modes.names(motion[None])[0]}, by which the body {' and '.join(contacts)}"
    ((who, how),) = movers
    turns = [how.replace("rotation", "turns")] if how.startswith("rotation") else []
    contacts = _contacts(points, velocity, who.startswith("the surface"))
    return f"{who} {' and '.join([*turns, *contacts])}"


def _contacts(points: Points, velocity: Array, of_surface: bool) -> list[str]:
    """What the body, or else the surface, does at each pair in a motion (k,)."""
    sliding, clear = points.tangential @ velocity, points.clearance(velocity)
    speed = np.linalg.norm(sliding, axis=1)
    nothing = NOTHING * max(speed.max(initial=0.0), clear.max(initial=0.0))
    words = []
    for k in np.unique(points.pair):
        what = "the body" if of_surface else f"pair {k}"
        slides = (points.pair == k) & (clear <= nothing) & (speed > nothing)
        if slides.any():
            along = sliding[slides] / speed[slides, None] * (-1.0 if of_surface else 1.0)
            one = np.all(along @ along[0] > 1 - NOTHING)
            words.append(f"slides {f'along {direction(along[0])} ' if one else ''}on {what}")
        elif np.any(clear[points.pair == k] > nothing):
            words.append(f"lifts off {what}")
    return words


def _amount(centre: Array, missing: MissingForce) -> str:
    """Forces and moments in words."""
    words = []
    for k in range(len(centre)):
        place = listed(centre[k : k + 1])
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
