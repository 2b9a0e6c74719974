"""Two bodies that slide on each other at large strains: accepted states by outside arithmetic."""

from functools import cache

import numpy as np
import pytest

from pw_elements.contact import ContactFailed
from tests.contact.sliding import iterate_along_path, make_die_on_block
from tests.oracle.large import NeoHookeanBody
from tests.oracle.sliding import SlidingContact
from tests.oracle.test_large import (
    TOLERANCE,
    TRIANGLE_RULE,
    assert_law_in_accepted_states,
    largest_violations,
    states_with_substates,
)


def random_die(seed):
    """A die of any shape and friction, pressed and slid to and fro in a few increments."""
    rng = np.random.default_rng(seed)
    across, path = 0.0, []
    for k in range(rng.integers(2, 5)):
        if k == 0 or rng.random() < 0.4:
            down = rng.uniform(0.02, 0.2)
        if k > 0 or rng.random() < 0.3:
            across += rng.uniform(-0.3, 0.3)
        path.append((across, -down))
    bodies = make_die_on_block(
        friction=0.0 if rng.random() < 0.15 else rng.uniform(0.02, 0.6),
        upper_is_slave=bool(rng.random() < 0.5),
        curvature=rng.uniform(0.5, 1.8),
        divisions=((rng.integers(8, 15), 3), (rng.integers(5, 10), 3)),
        turned=rng.choice([0.0, rng.uniform(-60, 60)]),
    )
    return bodies, path


def outside(bodies):
    """The same two bodies in NumPy."""
    nodes = bodies.space.tabulate_dof_coordinates()[:, :2]
    body = NeoHookeanBody(nodes, bodies.space.dofmap.list, True, 1.5, TRIANGLE_RULE)
    (pair,) = bodies.problem.undeformed.pairs
    sides = [side[np.argsort(nodes[side, 0])] for side in (pair.node, pair.opposite)]
    below = int(nodes[sides[1], 1].mean() < nodes[sides[0], 1].mean())
    sides[below] = sides[below][::-1]  # its outside is above
    held = np.zeros_like(nodes, dtype=bool)
    for condition in bodies.conditions:
        held.ravel()[condition.dof_indices()[0]] = True
    return SlidingContact(body, *sides, held, bodies.pair.law.mu)


def displacements(states):
    return [
        part.displacement.array_r.reshape(-1, 2).copy() for part in states_with_substates(states)
    ]


@cache
def solved(seed):
    """A random problem by outside arithmetic, the history that the library accepts, its error."""
    bodies, path = random_die(seed)
    states, error = [bodies.problem.undeformed], None
    try:
        for state in iterate_along_path(bodies, path):
            states.append(state)
    except ContactFailed as failed:
        error = failed
    return outside(bodies), displacements(states), error


def outcome(seed):
    """Largest violation of each condition in the states that the library accepts; its error."""
    problem, history, error = solved(seed)
    lengths = range(2, len(history) + 1)
    return largest_violations([problem.violations(history[:length]) for length in lengths]), error


@pytest.mark.random
def test_law_holds_in_every_accepted_state_and_few_problems_are_given_up(request):
    assert_law_in_accepted_states(
        outcome, range(100 if request.config.getoption("--nightly") else 4)
    )


@pytest.mark.parametrize(
    ("name", "size"),
    [("equilibrium", 1e-6), ("penetration", -1e-6), ("complementarity", 1e-6), ("cone", 1e-5)],
)
def test_outside_arithmetic_sees_what_is_wrong(name, size):
    problem, history, _ = solved(0)
    assert max(problem.violations(history).values()) < TOLERANCE
    u = history[-1].copy()
    if name == "equilibrium":
        inside = ~problem.prescribed_mask.any(axis=1)
        inside[np.concatenate([problem.slave, problem.master])] = False
        u[np.flatnonzero(inside)[0]] += size
    elif name == "cone":
        problem = SlidingContact(*list(vars(problem).values())[:4], problem.friction * (1 - size))
    else:  # the slave's body moves away or into the other
        upper = problem.bodies.nodes[problem.slave, 1].mean() > 0.005
        moved = (problem.bodies.nodes[:, 1] > 0.005) == upper
        u[moved, 1] += size if upper else -size
    assert problem.violations([*history[:-1], u])[name] > 10 * TOLERANCE
