"""Newton's method for one increment, in the steps of the theory page ("One increment").

The module guarantees that a returned state satisfies all linearised conditions to their tolerances.
It assumes an `Increment` whose state at the start is a converged solution.
"""

from collections.abc import Callable
from typing import TypeAlias

from pw_elements.contact.iteration.increment import Increment, NewtonState
from pw_elements.contact.iteration.updates import ActiveSetUpdate
from pw_elements.contact.nodes import ActiveSet, LinearisedKinematics

# Called with the iteration number, the active set and the violation; its exceptions end the
# iteration
IterationCallback: TypeAlias = Callable[[int, ActiveSet, float], None]


def solve_increment(
    increment: Increment,
    active: ActiveSet,
    kinematics: LinearisedKinematics,
    update: ActiveSetUpdate,
    *,
    max_iterations: int,
    after_iteration: IterationCallback,
) -> NewtonState:
    """Iterate from an active set and linearised kinematics until all conditions hold.

    Args:
        increment: equations of the increment.
        active: initial active set.
        kinematics: kinematics linearised at the initial iterate.
        update: rule that chooses the next active set.
        max_iterations: largest number of linear systems that are solved.
        after_iteration: called after each linear solution.

    Raises:
        NotUnique: if the tangent is singular at a solution.
        NotFound: if no active set satisfies the conditions.
        NotConverged: if an iterative solver fails.
    """
    active = increment.add_support_friction(active, kinematics)
    update.start(active, increment)
    accuracy = update.accuracy
    for iteration in range(1, max_iterations + 1):
        state = increment.solve(active, kinematics, accuracy)
        after_iteration(iteration, active, state.violation)
        state = increment.relinearise(state)
        if state.is_solution:
            return state
        increment.record_best_state(state)
        active, accuracy = update.choose_next_set(active, kinematics, state)
        kinematics = state.kinematics
    raise update.make_error(max_iterations)
