"""What is tried last, where iterations and parts of an increment have failed.

In the plane, all statuses of few contact points are searched (`branching`): that ends with a state,
or with the proof that there is none, or too early to tell. Curved surfaces that are free to move
are linearised anew where the state was found, which is looked for near and then farther off; of
these nothing is proved. In space, and where the search ends too early, a state without any
contact force is looked for: where there is one, the body is loose, and there are many.
"""

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from pw_elements.collective import collective
from pw_elements.contact.branching import Search, searched
from pw_elements.contact.condensed import Condensation, CondensedIncrement
from pw_elements.contact.errors import ClosedBranch, NoSolution, NotUnique
from pw_elements.contact.globalisation import Policy
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.law import ActiveSet
from pw_elements.contact.newton import Increment, Iterate
from pw_elements.contact.remedies import at_itself, confirmed, tractable
from pw_elements.linear_solver import SingularSystem

Array = npt.NDArray[np.float64]

# Points that are few: a linear program of more takes long
_POINTS = 100
# How far free, curved surfaces are looked for, over the extent of the contact points, how often
# they are linearised anew, and the share of a search's work that each time is worth
_REACHES, _ROUNDS, _SHARE = (0.01, 0.1, 1.0), 6, 0.02
# Translations, over the same extent, at which gaps are asked, and their change that tells a curve
_STEPS, _CURVED = (1e-4, 1e-2, 1.0), 1e-9
# Smallest gap of a loose body, over the largest at rest
_OPEN = 1e-9


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
    if interface.position.shape[1] == 2 and len(first.friction) <= _POINTS:
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
        f"no state obeys the contact conditions: all statuses of the {len(problem.friction)} "
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
    none = ActiveSet(np.zeros(points, np.int8), np.zeros((points, dim - 1)), np.zeros(points))
    return z + problem.step(none, z)
