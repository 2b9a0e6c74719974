"""Newton's method of one increment, step by step as the guide's page on theory has it."""

from collections.abc import Callable
from typing import TypeAlias

from pw_elements.contact.iteration.increment import Increment, NewtonState
from pw_elements.contact.iteration.updates import ActiveSetUpdate
from pw_elements.contact.nodes import ActiveSet, LinearisedKinematics

# Called with an iteration's number, active set and violation; what it raises ends the iteration
AfterIteration: TypeAlias = Callable[[int, ActiveSet, float], None]


def solve_increment(
    increment: Increment,
    active: ActiveSet,
    kinematics: LinearisedKinematics,
    update: ActiveSetUpdate,
    *,
    max_iterations: int,
    after_iteration: AfterIteration,
) -> NewtonState:
    """Iterate from an active set and linearised kinematics until all conditions hold.

    Args:
        increment: the equations.
        active: first active set.
        kinematics: linearised where the iteration begins.
        update: how active sets follow each other.
        max_iterations: the most linear systems solved.
        after_iteration: called after each of them.

    Raises:
        NotUnique: if the tangent is singular at a solution.
        NotFound: if no active set satisfies the conditions.
        NotConverged: if an iterative solver fails.
    """
    active = increment.make_first_set(active, kinematics)
    update.start(active, increment)
    accuracy = update.accuracy
    for iteration in range(1, max_iterations + 1):
        state = increment.solve(active, kinematics, accuracy)
        after_iteration(iteration, active, state.violation)
        state = increment.relinearise(state)
        if state.is_solution:
            return state
        increment.record(state)
        active, accuracy = update.advance(active, kinematics, state)
        kinematics = state.kinematics
    raise update.make_error(max_iterations)
