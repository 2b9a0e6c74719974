"""The oracle checks accepted states of two bodies that slide on each other at large strains."""

from functools import cache

import numpy as np
import pytest

from pw_elements.contact import ContactFailed
from tests.contact.cases import list_states_and_substates
from tests.contact.sliding import make_die_on_block, yield_states_along_path
from tests.oracle.random_sliding import make_oracle_contact
from tests.oracle.sliding import SlidingContact
from tests.oracle.test_large import (
    RELATIVE_LAW_TOLERANCE,
    assert_law_holds_and_few_are_refused,
    largest_violation_by_name,
)


def make_random_die_and_path(seed):
    """Return a random die on a block, and its path back and forth in a few increments."""
    rng = np.random.default_rng(seed)
    translation, path = 0.0, []
    for k in range(rng.integers(2, 5)):
        if k == 0 or rng.random() < 0.4:
            depth = rng.uniform(0.02, 0.2)
        if k > 0 or rng.random() < 0.3:
            translation += rng.uniform(-0.3, 0.3)
        path.append((translation, -depth))
    bodies = make_die_on_block(
        friction=0.0 if rng.random() < 0.15 else rng.uniform(0.02, 0.6),
        upper_is_slave=bool(rng.random() < 0.5),
        curvature=rng.uniform(0.5, 1.8),
        divisions=((rng.integers(8, 15), 3), (rng.integers(5, 10), 3)),
        rotation_degrees=rng.choice([0.0, rng.uniform(-60, 60)]),
    )
    return bodies, path


def displacements_with_substates(states):
    """Return the displacements (n, 2) of all states and substates."""
    return [
        state.displacement.array_r.reshape(-1, 2).copy()
        for state in list_states_and_substates(states)
    ]


@cache
def solve_random_die(seed):
    """Return the oracle's model, the accepted displacements, and the library's error."""
    bodies, path = make_random_die_and_path(seed)
    states, error = [bodies.problem.undeformed], None
    try:
        for state in yield_states_along_path(bodies, path):
            states.append(state)
    except ContactFailed as failed:
        error = failed
    return make_oracle_contact(bodies), displacements_with_substates(states), error


def solve_and_find_largest_violations(seed):
    """Return each condition's largest violation in the accepted states, and the library's error."""
    problem, history, error = solve_random_die(seed)
    lengths = range(2, len(history) + 1)
    return largest_violation_by_name(
        [problem.largest_violations_in_last_increment(history[:length]) for length in lengths]
    ), error


@pytest.mark.random
def test_law_holds_in_every_accepted_state_and_few_problems_are_refused(request):
    assert_law_holds_and_few_are_refused(
        solve_and_find_largest_violations,
        range(100 if request.config.getoption("--nightly") else 4),
    )


@pytest.mark.parametrize(
    ("name", "size"),
    [("equilibrium", 1e-6), ("penetration", -1e-6), ("complementarity", 1e-6), ("cone", 1e-5)],
)
def test_a_disturbed_state_violates_the_condition(name, size):
    problem, history, _ = solve_random_die(0)
    assert (
        max(problem.largest_violations_in_last_increment(history).values()) < RELATIVE_LAW_TOLERANCE
    )
    u = history[-1].copy()
    if name == "equilibrium":
        is_inner = ~problem.prescribed_mask.any(axis=1)
        is_inner[np.concatenate([problem.slave, problem.master])] = False
        u[np.flatnonzero(is_inner)[0]] += size
    elif name == "cone":
        problem = SlidingContact(*list(vars(problem).values())[:4], problem.friction * (1 - size))
    else:  # the slave's body moves away from the other one, or into it
        upper = problem.bodies.nodes[problem.slave, 1].mean() > 0.005
        moved_nodes = (problem.bodies.nodes[:, 1] > 0.005) == upper
        u[moved_nodes, 1] += size if upper else -size
    assert (
        problem.largest_violations_in_last_increment([*history[:-1], u])[name]
        > 10 * RELATIVE_LAW_TOLERANCE
    )
