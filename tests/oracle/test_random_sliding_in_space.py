"""The oracle checks accepted states of random problems of two bodies that slide in space."""

from dataclasses import replace

import numpy as np
import pytest

from pw_elements.contact import SolutionNotFound
from tests.oracle.random_sliding_in_space import draw_sketch, make_problem

# fixed before any value was known; relative to the largest force or displacement
RELATIVE_LAW_TOLERANCE = 1e-8
MAX_UNDECIDED_FRACTION_OF_PROBLEMS = 0.05
SEEDS, QUICK_SEEDS = range(40), (2, 3, 4, 10)
FRICTION_OF_SEED_3 = 0.2960967400359487


def find_violations_above_tolerance(seed):
    """Return each condition's largest violation if above the tolerance, and the library's error."""
    problem, largest = make_problem(seed), {}
    _, error = problem.accepted_states_and_error
    for violations in problem.violations_per_accepted_state():
        for name, value in violations.items():
            largest[name] = max(largest.get(name, 0.0), value)
    return {
        name: value for name, value in largest.items() if not value < RELATIVE_LAW_TOLERANCE
    }, error


@pytest.mark.random
@pytest.mark.parametrize("seed", QUICK_SEEDS)
def test_accepted_states_obey_the_law(seed):
    assert find_violations_above_tolerance(seed) == ({}, None)


@pytest.mark.random
def test_law_holds_in_all_accepted_states_and_few_problems_are_undecided(request):
    if not request.config.getoption("--nightly"):
        pytest.skip("40 problems, which --nightly asks for")
    violations_by_seed, undecided = {}, []
    for seed in SEEDS:
        violations, error = find_violations_above_tolerance(seed)
        if violations:
            violations_by_seed[seed] = violations
        if type(error) is SolutionNotFound:
            undecided.append(seed)
    assert not violations_by_seed
    assert len(undecided) <= MAX_UNDECIDED_FRACTION_OF_PROBLEMS * len(SEEDS), undecided


def test_problems_are_of_all_kinds_and_do_not_change_with_numpy():
    sketches = [draw_sketch(seed) for seed in SEEDS]
    for kind in ("upper_is_slave", "is_tetrahedron", "friction"):
        assert 2 < sum(bool(getattr(sketch, kind)) for sketch in sketches) < len(SEEDS)
    assert sketches[3].friction == pytest.approx(FRICTION_OF_SEED_3, abs=0)


@pytest.fixture(scope="module")
def problem_and_history():
    """Return a problem with slipping nodes, and the displacements (n, 3) of its states."""
    problem = make_problem(9)
    return problem, problem.displacement_history


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("equilibrium", 1e-6),
        ("penetration", -1e-6),
        ("complementarity", 1e-6),
        ("cone", 1e-5),
        ("direction", 1e-5),
    ],
)
def test_a_disturbed_state_violates_the_condition(problem_and_history, name, size):
    problem, history = problem_and_history
    contact, u = problem.oracle_contact, history[-1].copy()
    violations = contact.largest_violations_in_last_increment(history)
    assert max(violations.values()) < RELATIVE_LAW_TOLERANCE
    if name == "equilibrium":
        is_free = ~contact.prescribed_mask.any(axis=1)
        is_free[np.concatenate([contact.slave_triangles, contact.master_triangles]).ravel()] = False
        u[np.flatnonzero(is_free)[0]] += size
    elif name in ("cone", "direction"):
        factor = 1 - size if name == "cone" else 1 + size
        contact = replace(contact, friction=factor * contact.friction)
    else:  # the upper body moves away from the other one, or into it
        u[problem.is_upper] += size * problem.upward_direction_at_end
    violations = contact.largest_violations_in_last_increment([*history[:-1], u])
    assert violations[name] > 10 * RELATIVE_LAW_TOLERANCE
