"""Random contact problems: the law holds in every state, and refusals have a cause."""

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
    ProblemData,
    StepMotion,
    contact_nodes_and_friction,
    largest_residual,
    measure_residuals,
    split_into_substeps,
)
from tests.oracle.proofs import is_valid_proof, linear_increment, measure_proof_defects
from tests.oracle.random_contact import LOAD_PATHS, draw_sketch, make_problem
from tests.oracle.search import search_statuses

SUITE, NIGHTLY = 60, 1600
# Stated before. Largest seen in seeds 0 to 1 599: 7.7e-10, but for 6.5e-9 in seed 637. The
# solver's tolerance is 1e-9 of the largest force and what may be round-off, more at nu = 0.4997.
TOLERANCE = 1e-8
# Refused though a search finds a state: cells that lock, strained by 1.7, without friction
LOST = {1397}


def outcome(seed):
    """What came of a seed: solved or refused, how exactly, and what is not as it has to be.

    Other errors than refusals are not caught. The library's own residuals agree where round-off is
    small, and where there is nothing but round-off; they leave mu in its cone.
    """
    stated, wrong, kind = make_problem(seed), [], "solved"
    begun = process_time()
    try:
        states = stated.solve()
        seconds = process_time() - begun
        wrong += ["states"] * (len(states) != len(stated.loads))
    except ContactFailed as error:
        seconds, states, kind = process_time() - begun, list(error.states), type(error).__name__
        if kind == "NoEquilibrium":
            proof = measure_proof_defects(stated, len(states), error)
            wrong += [] if is_valid_proof(proof) else [proof]
        elif _is_searchable(stated):
            increment = linear_increment(stated, states)
            one = kind != "FreeBody" or _is_determined(increment)
            wrong += ["a search finds a state"] * bool(
                one and search_statuses(increment) is not None
            )
    found = measure_residuals(*split_into_substeps(stated, states))
    wrong += [found] * (not largest_residual(found) < TOLERANCE)
    mu = max(pair.mu for pair in stated.sketch.pairs)
    own = [state.residuals.largest() for state in states]
    for pressed, one in zip(_pressed(stated, states), own, strict=True):
        wrong += [own] * (one >= TOLERANCE * max(1.0, mu) and not 1e3 < pressed < 1e10)
    return kind, seconds, stated.sketch.dim, wrong and [stated.sketch, *wrong]


def _is_searchable(stated):
    """Whether gaps are linear in all motions, in the plane, and contact nodes are few."""
    nodes = sum(len(contact_nodes_and_friction(pair, stated.space)[0]) for pair in stated.pairs)
    linear = all(
        pair.kind == "plane" or (pair.normal_drive != "pushed" and pair.tangential_drive != "free")
        for pair in stated.sketch.pairs
    )
    return linear and nodes <= 60 and stated.space.mesh.geometry.dim == 2


def _is_determined(increment):
    """Whether no motion leaves all alone that the law and the balances speak of."""
    rough = increment.faced & (increment.mu > 0)
    parts = increment.normal, increment.shear, increment.gap[increment.faced]
    rows = np.concatenate([*parts, increment.slip[rough], increment.balance])[:, :-1]
    return np.linalg.matrix_rank(rows) == rows.shape[1]


def _pressed(stated, states):
    """Largest nodal contact force of each state over the round-off of forces.

    That is of positions and displacements, times the stiffness.
    """
    x = np.abs(stated.space.tabulate_dof_coordinates()).max()
    stiffness = np.abs(stated.K.getValuesCSR()[2]).max()
    lengths = np.array([x + np.abs(state.displacement.array_r).max() for state in states])
    forces = [max(np.abs(pair.force_normal).max() for pair in state.pairs) for state in states]
    return (np.array(forces) / (np.finfo(float).eps * stiffness * lengths)).tolist()


@pytest.mark.random
def test_law_holds_in_every_state_and_refusals_are_few_cheap_and_with_cause(request):
    """Stated before: 4 % without a proof in the plane, 5 % in space; 91 % of 8 000 are solved."""
    nightly, outcomes = request.config.getoption("--nightly"), []
    for seed in range(NIGHTLY if nightly else SUITE):
        outcomes.append(outcome(seed))
        assert bool(outcomes[-1][-1]) == (seed in LOST), seed
    kinds = Counter(kind for kind, *_ in outcomes)
    assert set(kinds) <= {"solved", "FreeBody", "NotUnique", "NotFound", "NoEquilibrium"}
    assert kinds["solved"] >= (0.88 if nightly else 0.85) * len(outcomes), kinds
    if not nightly:
        return  # shares of few say little
    for dim, most in ((2, 0.04), (3, 0.05)):
        there = [kind for kind, _, of, _ in outcomes if of == dim]
        assert there.count("NotFound") <= most * len(there)
    solved, rest = (
        sum(seconds for kind, seconds, *_ in outcomes if (kind == "solved") == so)
        for so in (True, False)
    )
    assert rest < solved


OF_PROBLEMS = {
    "cell": {"triangle", "quadrilateral", "tetrahedron", "hexahedron"},
    "state": {"plane stress", "plane strain", "axisymmetric", "solid"},
    "element": {"galerkin", "petrov_galerkin", "serendipity", "composite"},
    "support": {"clamped", "roller", "cantilever", "symmetry", "contact alone"},
    "path": set(LOAD_PATHS),
}
OF_PAIRS = {
    "kind": {"plane", "sphere", "parabola", "flat punch", "polyline", "signed distance"},
    "friction": {"constant", "graded", "half smooth"},
    "normal_drive": {"rest", "moved", "pushed"},
    "tangential_drive": {"held", "moved", "free"},
}


def test_what_occurs():
    """Force drives 40 % at least."""
    sketches = [draw_sketch(seed) for seed in range(SUITE)]
    pairs = [pair for plan in sketches for pair in plan.pairs]
    assert np.mean([plan.driven_by_force for plan in sketches]) >= 0.4
    for of, fields in ((sketches, OF_PROBLEMS), (pairs, OF_PAIRS)):
        for field, names in fields.items():
            counts = Counter(getattr(one, field) for one in of)
            assert set(counts) == names
            assert min(counts.values()) >= (1 if field == "element" else 2)
    assert {len(plan.steps) for plan in sketches} == {1, 2, 3, 4, 5}
    assert {len(plan.pairs) for plan in sketches} >= {1, 2, 3}
    assert {0.0} < {pair.mu for pair in pairs}
    assert 10 < max(pair.mu for pair in pairs) <= 30
    # curved surfaces under a force, whose normals turn with their place
    curved = [
        p for p in pairs if p.kind in ("sphere", "signed distance") and p.normal_drive == "pushed"
    ]
    assert len(curved) > 2


# -- a check that can fail -------------------------------------------------------------------


@cache
def dragged():
    """A ball pressed on a clamped block, then dragged: nodes are open, stick and slip."""
    body = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (10, 4)), E=50.0)
    pushes = [Motion((None, None), (share * 0.3, -1.0)) for share in (0.0, 0.6)]
    top = lambda x: np.isclose(x[1], 1.0) & (x[0] < 2 - 1e-9)  # noqa: E731
    ball = ContactPair(top, Sphere((1.0, 9.0), 8.0), 0.3, pushes)
    side = lambda x: np.isclose(x[0], 2.0) & (x[1] > 1e-9)  # noqa: E731
    wall = ContactPair(side, Plane((2.01, 0.0), (-1.0, 0.0)), 0.3)
    foot, loads = [(i, on_plane(1, 0.0)) for i in (0, 1)], [body.zero_load] * 2
    conditions = [prescribe(body.space, *one) for one in foot]
    stated = ProblemData(body.K, body.space, loads, conditions, [ball, wall])
    states = body.solve_contact(stated.pairs, body.make_supports(*foot), loads)
    assert set(states[-1].pairs[0].status) == {OPEN, STICK, SLIP}
    steps = [StepMotion.from_state(state) for state in states]
    assert largest_residual(measure_residuals(stated, steps)) < 1e-10
    return stated, steps


def with_ball(**changes):
    stated, steps = dragged()
    ball, wall = stated.pairs
    return replace(stated, pairs=[replace(ball, **changes), wall]), steps


def with_last(change, number=-1):
    stated, steps = dragged()
    steps = list(steps)
    steps[number] = change(steps[number])
    return stated, steps


def moved(nodes, shift):
    def change(step):
        a, x = step.displacement.copy(), dragged()[0].space.tabulate_dof_coordinates()
        a[chosen := nodes(x.T)] += shift
        assert chosen.any()
        return replace(step, displacement=a)

    return change


def surfaces_moved(shift):
    return lambda step: replace(step, translations=step.translations + np.array(shift))


def less_force(motion):
    return Motion(motion.translation, [0.9 * force for force in motion.force])


VIOLATIONS = {
    "equilibrium": lambda: with_last(moved(lambda x: np.abs(x[1] - 0.5) < 0.2, (1e-5, 0))),
    "supports": lambda: with_last(moved(lambda x: x[1] < 1e-9, (1e-5, 0))),
    "penetration": lambda: with_last(surfaces_moved([(0, -1e-5), (0, 0)])),
    "complementarity": lambda: with_last(surfaces_moved([(0, 1e-5), (0, 0)])),
    "tension": lambda: with_last(lambda step: replace(step, displacement=-step.displacement)),
    "cone": lambda: with_ball(friction=0.297),
    "stick": lambda: with_last(surfaces_moved([(1e-5, 0), (0, 0)]), number=0),
    "direction": lambda: with_last(surfaces_moved([(0.1, 0), (0, 0)]), number=0),
    "balance": lambda: with_ball(motions=list(map(less_force, dragged()[0].pairs[0].motions))),
    "motion": lambda: with_last(surfaces_moved([(0, 0), (1e-5, 0)])),
}


@pytest.mark.parametrize("condition", VIOLATIONS)
def test_violation_is_found(condition):
    stated, steps = VIOLATIONS[condition]()
    assert measure_residuals(stated, steps)[-1][condition] > 1e-5


def test_nothing_else_is_asked_of_another_friction():
    (result,) = measure_residuals(*with_ball(friction=0.15))[1:]
    others = {name: value for name, value in result.items() if name not in ("cone", "direction")}
    assert max(others.values()) < 1e-10
