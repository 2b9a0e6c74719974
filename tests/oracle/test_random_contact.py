"""Random contact problems: the law holds in every state, and each refusal has a cause."""

from collections import Counter
from dataclasses import replace
from functools import cache
from time import process_time

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import prescribe
from pw_elements.contact import OPEN, SLIP, STICK, ContactFailed, ContactPair, Motion, Plane, Sphere
from pw_elements.meshes import triangles
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.residuals import (
    DisplacementAndTranslations,
    LinearContactProblemData,
    contact_nodes_and_friction,
    largest_residual,
    recompute_residuals_per_step,
    split_increments_at_substeps,
)
from tests.oracle.proofs import is_valid_proof, linearise_next_increment, measure_proof_defects
from tests.oracle.random_contact import PRESS_AND_DRAG_FACTORS_BY_PATH, draw_sketch, make_problem
from tests.oracle.search import find_state_by_status_search

N_SUITE_SEEDS, N_NIGHTLY_SEEDS = 60, 1600
# Fixed beforehand. The largest value in seeds 0 to 1 599 is 7.7e-10, except 6.5e-9 in seed 637. The
# solver's tolerance is 1e-9 of the largest force plus round-off, which is larger if Poisson's ratio
# is 0.4997
RELATIVE_LAW_TOLERANCE = 1e-8
# Seeds that are refused although a search finds a state. In this problem cells lock, the strain is
# 1.7, and there is no friction
SEEDS_REFUSED_DESPITE_SOLUTION = {1397}


def solve_and_find_faults(seed):
    """Return the outcome, CPU seconds, dimension, and a list of all faults of the result.

    Refusals are caught, other errors are not. The library's own residuals have to be small if
    round-off is negligible, or if all forces are round-off. Their tolerance is multiplied by the
    friction coefficient if that is above 1.
    """
    problem, faults, outcome = make_problem(seed), [], "solved"
    start = process_time()
    try:
        states = problem.solve()
        seconds = process_time() - start
        faults += ["states"] * (len(states) != len(problem.loads))
    except ContactFailed as error:
        seconds, states, outcome = process_time() - start, list(error.states), type(error).__name__
        if outcome == "NoEquilibrium":
            defects = measure_proof_defects(problem, len(states), error)
            faults += [] if is_valid_proof(defects) else [defects]
        elif _is_searchable(problem):
            increment = linearise_next_increment(problem, states)
            is_determined = outcome != "FreeBody" or _has_no_undetermined_motion(increment)
            faults += ["a search finds a state"] * bool(
                is_determined and find_state_by_status_search(increment) is not None
            )
    violations = recompute_residuals_per_step(*split_increments_at_substeps(problem, states))
    faults += [violations] * (not largest_residual(violations) < RELATIVE_LAW_TOLERANCE)
    mu = max(pair.mu for pair in problem.sketch.pairs)
    own_residuals = [state.residuals.largest() for state in states]
    for relative_force, residual in zip(
        _largest_forces_over_round_off(problem, states), own_residuals, strict=True
    ):
        faults += [own_residuals] * (
            residual >= RELATIVE_LAW_TOLERANCE * max(1.0, mu) and not 1e3 < relative_force < 1e10
        )
    return outcome, seconds, problem.sketch.dim, faults and [problem.sketch, *faults]


def _is_searchable(problem):
    """Return whether the problem is plane, has linear gaps, and has few contact nodes."""
    n_nodes = sum(len(contact_nodes_and_friction(pair, problem.space)[0]) for pair in problem.pairs)
    is_linear = all(
        pair.kind == "plane" or (pair.normal_drive != "pushed" and pair.tangential_drive != "free")
        for pair in problem.sketch.pairs
    )
    return is_linear and n_nodes <= 60 and problem.space.mesh.geometry.dim == 2


def _has_no_undetermined_motion(increment):
    """Return whether every motion changes a quantity of the law or of the force balances."""
    has_friction = increment.faced & (increment.mu > 0)
    quantities = increment.normal, increment.shear, increment.gap[increment.faced]
    rows = np.concatenate([*quantities, increment.slip[has_friction], increment.balance])[:, :-1]
    return np.linalg.matrix_rank(rows) == rows.shape[1]


def _largest_forces_over_round_off(problem, states):
    """Return the largest nodal contact force of each state, divided by the round-off of forces.

    This round-off is estimated by that of positions and displacements times the largest stiffness.
    """
    x = np.abs(problem.space.tabulate_dof_coordinates()).max()
    stiffness = np.abs(problem.K.getValuesCSR()[2]).max()
    lengths = np.array([x + np.abs(state.displacement.array_r).max() for state in states])
    forces = [max(np.abs(pair.force_normal).max() for pair in state.pairs) for state in states]
    return (np.array(forces) / (np.finfo(float).eps * stiffness * lengths)).tolist()


@pytest.mark.random
def test_law_holds_in_every_state_and_refusals_are_few_cheap_and_with_cause(request):
    """The contact law holds in every state, and refusals are few, cheap and justified.

    The limits were fixed before the first run: at most 4 % of the plane problems and 5 % of the
    solid ones may be refused without a proof. In a run of 8 000 problems, 91 % were solved.
    """
    nightly, outcomes = request.config.getoption("--nightly"), []
    for seed in range(N_NIGHTLY_SEEDS if nightly else N_SUITE_SEEDS):
        outcomes.append(solve_and_find_faults(seed))
        assert bool(outcomes[-1][-1]) == (seed in SEEDS_REFUSED_DESPITE_SOLUTION), seed
    kinds = Counter(kind for kind, *_ in outcomes)
    assert set(kinds) <= {"solved", "FreeBody", "NotUnique", "SolutionNotFound", "NoEquilibrium"}
    assert kinds["solved"] >= (0.88 if nightly else 0.85) * len(outcomes), kinds
    if not nightly:
        return  # percentages of few problems mean little
    for dim, max_share in ((2, 0.04), (3, 0.05)):
        kinds_of_dim = [kind for kind, _, problem_dim, _ in outcomes if problem_dim == dim]
        assert kinds_of_dim.count("SolutionNotFound") <= max_share * len(kinds_of_dim)
    seconds_solved, seconds_refused = (
        sum(seconds for kind, seconds, *_ in outcomes if (kind == "solved") == is_solved)
        for is_solved in (True, False)
    )
    assert seconds_refused < seconds_solved


EXPECTED_PROBLEM_VALUES = {
    "cell": {"triangle", "quadrilateral", "tetrahedron", "hexahedron"},
    "state": {"plane stress", "plane strain", "axisymmetric", "solid"},
    "element": {"galerkin", "petrov_galerkin", "serendipity", "composite"},
    "support": {"clamped", "roller", "cantilever", "symmetry", "contact alone"},
    "path": set(PRESS_AND_DRAG_FACTORS_BY_PATH),
}
EXPECTED_PAIR_VALUES = {
    "kind": {"plane", "sphere", "parabola", "flat punch", "polyline", "signed distance"},
    "friction": {"constant", "graded", "half smooth"},
    "normal_drive": {"rest", "moved", "pushed"},
    "tangential_drive": {"held", "moved", "free"},
}


def test_random_problems_are_of_all_kinds():
    """Random problems include all kinds of cells, states, elements, supports, pairs and paths.

    At least 40 % of them are driven by forces.
    """
    sketches = [draw_sketch(seed) for seed in range(N_SUITE_SEEDS)]
    pairs = [pair for sketch in sketches for pair in sketch.pairs]
    assert np.mean([sketch.is_driven_by_force for sketch in sketches]) >= 0.4
    for sketched, fields in ((sketches, EXPECTED_PROBLEM_VALUES), (pairs, EXPECTED_PAIR_VALUES)):
        for field, names in fields.items():
            counts = Counter(getattr(item, field) for item in sketched)
            assert set(counts) == names
            assert min(counts.values()) >= (1 if field == "element" else 2)
    assert {len(sketch.steps) for sketch in sketches} == {1, 2, 3, 4, 5}
    assert {len(sketch.pairs) for sketch in sketches} >= {1, 2, 3}
    assert {0.0} < {pair.mu for pair in pairs}
    assert 10 < max(pair.mu for pair in pairs) <= 30
    # curved surfaces under a force, whose normals change with their position
    curved = [
        p for p in pairs if p.kind in ("sphere", "signed distance") and p.normal_drive == "pushed"
    ]
    assert len(curved) > 2


# -- a check that can fail -------------------------------------------------------------------


@cache
def solve_ball_dragged_on_block():
    """Solve a ball that is pressed on a clamped block and then dragged.

    Return the problem's data and its steps. There are open, sticking and slipping nodes.
    """
    body = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (10, 4)), E=50.0)
    pushes = [Motion((None, None), (factor * 0.3, -1.0)) for factor in (0.0, 0.6)]
    top = lambda x: np.isclose(x[1], 1.0) & (x[0] < 2 - 1e-9)  # noqa: E731
    ball = ContactPair(top, Sphere((1.0, 9.0), 8.0), 0.3, pushes)
    side = lambda x: np.isclose(x[0], 2.0) & (x[1] > 1e-9)  # noqa: E731
    wall = ContactPair(side, Plane((2.01, 0.0), (-1.0, 0.0)), 0.3)
    base_conditions, loads = [(i, on_plane(1, 0.0)) for i in (0, 1)], [body.zero_load] * 2
    conditions = [prescribe(body.space, *condition) for condition in base_conditions]
    problem = LinearContactProblemData(body.K, body.space, loads, conditions, [ball, wall])
    states = body.solve_contact(problem.pairs, body.make_supports(*base_conditions), loads)
    assert set(states[-1].pairs[0].status) == {OPEN, STICK, SLIP}
    steps = [DisplacementAndTranslations.from_state(state) for state in states]
    assert largest_residual(recompute_residuals_per_step(problem, steps)) < 1e-10
    return problem, steps


def problem_with_changed_ball_and_steps(**pair_changes):
    """Return the problem of the dragged ball after changing its contact pair, and its steps."""
    problem, steps = solve_ball_dragged_on_block()
    ball, wall = problem.pairs
    return replace(problem, pairs=[replace(ball, **pair_changes), wall]), steps


def problem_and_steps_with_changed_step(change, step_index=-1):
    """Return the problem of the dragged ball, and its steps after changing one of them."""
    problem, steps = solve_ball_dragged_on_block()
    steps = list(steps)
    steps[step_index] = change(steps[step_index])
    return problem, steps


def make_node_displacer(marker, shift):
    """Return a function that changes a step by displacing the marked nodes."""

    def displace_marked_nodes(step):
        a, x = (
            step.displacement.copy(),
            solve_ball_dragged_on_block()[0].space.tabulate_dof_coordinates(),
        )
        a[mask := marker(x.T)] += shift
        assert mask.any()
        return replace(step, displacement=a)

    return displace_marked_nodes


def make_surface_displacer(shift_per_surface):
    """Return a function that changes a step by displacing the surfaces."""
    return lambda step: replace(step, translations=step.translations + np.array(shift_per_surface))


def reduce_force_by_tenth(motion):
    return Motion(motion.translation, [0.9 * force for force in motion.force])


VIOLATING_PROBLEMS_BY_CONDITION = {
    "equilibrium": lambda: problem_and_steps_with_changed_step(
        make_node_displacer(lambda x: np.abs(x[1] - 0.5) < 0.2, (1e-5, 0))
    ),
    "supports": lambda: problem_and_steps_with_changed_step(
        make_node_displacer(lambda x: x[1] < 1e-9, (1e-5, 0))
    ),
    "penetration": lambda: problem_and_steps_with_changed_step(
        make_surface_displacer([(0, -1e-5), (0, 0)])
    ),
    "complementarity": lambda: problem_and_steps_with_changed_step(
        make_surface_displacer([(0, 1e-5), (0, 0)])
    ),
    "tension": lambda: problem_and_steps_with_changed_step(
        lambda step: replace(step, displacement=-step.displacement)
    ),
    "cone": lambda: problem_with_changed_ball_and_steps(friction=0.297),
    "stick": lambda: problem_and_steps_with_changed_step(
        make_surface_displacer([(1e-5, 0), (0, 0)]), step_index=0
    ),
    "direction": lambda: problem_and_steps_with_changed_step(
        make_surface_displacer([(0.1, 0), (0, 0)]), step_index=0
    ),
    "balance": lambda: problem_with_changed_ball_and_steps(
        motions=list(map(reduce_force_by_tenth, solve_ball_dragged_on_block()[0].pairs[0].motions))
    ),
    "motion": lambda: problem_and_steps_with_changed_step(
        make_surface_displacer([(0, 0), (1e-5, 0)])
    ),
}


@pytest.mark.parametrize("condition", VIOLATING_PROBLEMS_BY_CONDITION)
def test_each_violation_is_measured(condition):
    problem, steps = VIOLATING_PROBLEMS_BY_CONDITION[condition]()
    assert recompute_residuals_per_step(problem, steps)[-1][condition] > 1e-5


def test_another_friction_violates_cone_and_direction_alone():
    (violations,) = recompute_residuals_per_step(
        *problem_with_changed_ball_and_steps(friction=0.15)
    )[1:]
    other_violations = {
        name: value for name, value in violations.items() if name not in ("cone", "direction")
    }
    assert max(other_violations.values()) < 1e-10
