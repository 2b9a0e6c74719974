"""Newton's method for one increment, as described in docs/theory.md ("One increment").

The module guarantees that a returned state satisfies all linearised conditions within their
tolerances. It assumes that the state at the start of the increment is a converged solution.
"""

from collections.abc import Callable
from typing import TypeAlias

from pw_elements.contact.iteration.increment import IncrementEquations
from pw_elements.contact.iteration.increment_data import NewtonIterate
from pw_elements.contact.iteration.updates import ActiveSetUpdate
from pw_elements.contact.nodes import ActiveSet, LinearisedKinematics

# Function that is called with the iteration number, the active set and the violation. If it raises
# an exception, the iteration ends
IterationCallback: TypeAlias = Callable[[int, ActiveSet, float], None]


def solve_increment(
    increment: IncrementEquations,
    active: ActiveSet,
    kinematics: LinearisedKinematics,
    update: ActiveSetUpdate,
    *,
    max_iterations: int,
    after_iteration: IterationCallback,
) -> NewtonIterate:
    """Iterate from an active set and linearised kinematics until all conditions hold.

    Args:
        increment: equations of the increment.
        active: initial active set.
        kinematics: kinematics linearised at the initial iterate.
        update: rule that chooses the next active set.
        max_iterations: largest number of linear systems that are solved.
        after_iteration: function that is called after each linear solution.

    Raises:
        NotUnique: if the tangent is singular at a solution.
        SolutionNotFound: if no active set that satisfies the conditions has been found.
        NotConverged: if an iterative solver fails.
    """
    active = increment.add_initial_support_friction(active, kinematics)
    update.restart_record_with_first_set(active, increment)
    accuracy = update.accuracy
    for iteration in range(1, max_iterations + 1):
        state = increment.solve_linearised_system(active, kinematics, accuracy)
        after_iteration(iteration, active, state.violation)
        state = increment.reevaluate_with_kinematics_at_solution(state)
        if state.is_solution:
            return increment.prefer_friction_of_start(state)
        increment.keep_if_smallest_violation(state)
        active, accuracy = update.choose_next_set_and_accuracy(active, kinematics, state)
        kinematics = state.kinematics
    raise update.make_iteration_limit_error(max_iterations)
