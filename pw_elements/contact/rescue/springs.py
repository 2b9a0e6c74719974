"""Solve an increment whose iteration has failed with springs at the contact nodes.

The springs are unstressed in the last solution with springs. They get softer after each solution,
and stiffer after each failure. The module guarantees that a state is returned only if its forces
are larger than round-off. All functions are collective.
"""

import logging
from collections.abc import Callable

from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array
from pw_elements.contact.iteration import (
    ActiveSetUpdate,
    LinearIncrementEquations,
    NewtonIterate,
    report_no_free_motions,
    solve_increment,
)
from pw_elements.contact.model import ContactFailed, NotUnique
from pw_elements.contact.nodes import (
    ActiveSet,
    LinearisedKinematics,
    SmallStrainKinematics,
    is_same_set,
)
from pw_elements.contact.rescue.refusals import LOOSE_BODY_MESSAGE
from pw_elements.progress import log_on_root
from pw_elements.solvers import SingularSystem

# Stiffness of the first and of the softest springs, relative to the diagonal stiffness of the nodes
_FIRST_SPRING_TO_NODE_STIFFNESS_RATIO, _MIN_SPRING_TO_NODE_STIFFNESS_RATIO = 1e-2, 1e-13
# Factors by which the springs get softer after a solution, and stiffer after a failure
_SPRING_SOFTENING_FACTOR, _SPRING_STIFFENING_FACTOR = 30.0, 5.0
# After a failure the softening factor is raised to this power, and limited by the smallest factor
_SOFTENING_FACTOR_EXPONENT_AFTER_FAILURE, _MIN_SPRING_SOFTENING_FACTOR = 0.7, 2.0
_MAX_FAILED_SOLVES_WITH_SPRINGS = 20
# Largest number of iterations with springs, and without springs from the solution with springs
_MAX_ITERATIONS_WITH_SPRINGS, _MAX_ITERATIONS_WITHOUT_SPRINGS = 25, 12
# Round-off of the residuals, relative to the applied forces, above which residuals prove nothing
_MAX_ROUND_OFF_PER_APPLIED_FORCE = 1e-3

# Function that returns an increment with springs. Its arguments are the stiffness of the springs,
# relative to the diagonal stiffness of the nodes, and the unknowns (n,) and translations
# (pairs, dim) of the surfaces at which the springs are unstressed
SpringIncrementMaker = Callable[[float, PETSc.Vec, Array], LinearIncrementEquations]


def solve_with_softening_springs(
    increment: LinearIncrementEquations,
    make_increment_with_springs: SpringIncrementMaker,
    kinematics: SmallStrainKinematics,
    *,
    start: tuple[ActiveSet, LinearisedKinematics, PETSc.Vec],
    make_update: Callable[[], ActiveSetUpdate],
    max_iterations: int,
    remaining_systems: Callable[[], float],
) -> NewtonIterate | None:
    """Solve an increment with springs at the contact nodes that are softened in stages.

    Args:
        increment: equations of the increment without springs.
        make_increment_with_springs: function that returns the increment with springs of a given
            stiffness.
        kinematics: kinematics of the contact points.
        start: active set, linearised kinematics and all unknowns (n,) of the initial iterate.
        make_update: function that returns the rule for the next active set without springs.
        max_iterations: largest number of linear systems solved in one iteration.
        remaining_systems: function that returns the number of linear systems that may still be
            solved.

    Returns:
        The solution without springs, or None if no solution is found.

    Raises:
        NotUnique: if the tangent is singular at a solution.
    """

    def limit_iterations(n: int) -> int:
        return int(max(1, min(n, max_iterations, remaining_systems())))

    (active, linearised, unknowns), comm = start, increment.interface.comm
    q, stiffness, softening, n_failures = (
        linearised.q0,
        _FIRST_SPRING_TO_NODE_STIFFNESS_RATIO,
        _SPRING_SOFTENING_FACTOR,
        0,
    )
    previous: ActiveSet | None = None
    words = f"by springs, at the cost of at most {remaining_systems():.0f} linear systems"
    log_on_root(comm, logging.INFO, words, ".contact")
    while (
        stiffness > _MIN_SPRING_TO_NODE_STIFFNESS_RATIO
        and n_failures < _MAX_FAILED_SOLVES_WITH_SPRINGS
        and remaining_systems() > 0
    ):
        spring_increment = make_increment_with_springs(stiffness, unknowns, q)
        update = ActiveSetUpdate(report_no_free_motions, increment.interface)
        try:
            spring_state = solve_increment(
                spring_increment,
                active,
                linearised,
                update,
                max_iterations=limit_iterations(_MAX_ITERATIONS_WITH_SPRINGS),
                after_iteration=_ignore_iteration,
            )
        except ContactFailed as failed:
            log_on_root(
                comm,
                logging.INFO,
                f"no solution with springs of {stiffness:.0e}: {failed}",
                ".contact",
            )
            n_failures, softening = (
                n_failures + 1,
                max(
                    _MIN_SPRING_SOFTENING_FACTOR,
                    softening**_SOFTENING_FACTOR_EXPONENT_AFTER_FAILURE,
                ),
            )
            stiffness *= _SPRING_STIFFENING_FACTOR
            continue
        unknowns, q = spring_state.unknowns, spring_state.q
        linearised = kinematics.linearise(q, spring_state.displacement, spring_state.force)
        state = increment.evaluate_all_conditions(
            spring_state.reduced_unknowns, q, linearised, additional_forces=spring_state.force
        )
        increment.keep_if_smallest_violation(state)
        active = spring_state.nodes.active_set
        is_steady = previous is not None and is_same_set(previous, active, comm)
        nearest_state = increment.best_state
        if _is_round_off_too_large(increment, state):
            words = f"springs of {stiffness:.0e} let the body move so far that forces are lost in"
            log_on_root(comm, logging.INFO, f"{words} round-off", ".contact")
            return None
        if state.violation <= 1 or is_steady:
            try:
                solution = solve_increment(
                    increment,
                    active,
                    linearised,
                    make_update(),
                    max_iterations=limit_iterations(_MAX_ITERATIONS_WITHOUT_SPRINGS),
                    after_iteration=_ignore_iteration,
                )
                if _is_round_off_too_large(increment, solution):
                    words = f"from springs of {stiffness:.0e} the body moves so far that forces are"
                    log_on_root(comm, logging.INFO, f"{words} lost in round-off", ".contact")
                    increment.best_state = nearest_state
                else:
                    words = f"solved by springs of {stiffness:.0e}"
                    log_on_root(comm, logging.INFO, words, ".contact")
                    return solution
            except ContactFailed as failed:
                words = f"no solution from springs of {stiffness:.0e}: {failed}"
                log_on_root(comm, logging.INFO, words, ".contact")
                if state.violation <= 1:
                    if isinstance(failed.__cause__, SingularSystem):
                        (force,) = increment.nonnegative_max_over_ranks(np.abs(state.force))
                        is_loose = force <= state.round_off
                        message = LOOSE_BODY_MESSAGE if is_loose else f"at a solution, {failed}"
                        raise NotUnique(message) from failed
                    return state  # the iteration has left this solution because of round-off
        previous, stiffness = active, stiffness / softening
    return None


def _is_round_off_too_large(increment: LinearIncrementEquations, state: NewtonIterate) -> bool:
    """Return whether the round-off of an iterate is too large compared with the applied forces.

    With soft springs, a body moves very far if the loads exceed the friction limit. All residuals
    are then within their round-off, which says nothing about equilibrium. The call is collective.
    """
    start_force, free_motion_force = increment.nonnegative_max_over_ranks(
        np.abs(increment.start.force), np.abs(increment.free_motion_forces)
    )
    load = increment.equilibrium.load.norm(PETSc.NormType.INFINITY)
    applied_force = max(start_force, free_motion_force, load)
    return applied_force > 0 and state.round_off > _MAX_ROUND_OFF_PER_APPLIED_FORCE * applied_force


def _ignore_iteration(iteration: int, active: ActiveSet, violation: float) -> None:
    """Do nothing after an iteration."""
