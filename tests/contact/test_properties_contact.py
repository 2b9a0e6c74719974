"""The laws of contact in random problems, read from K a - f and the surface alone."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st

from pw_elements import Material, Reduction, assemble_vector, boundary_measure
from pw_elements.contact import (
    SLIP,
    STICK,
    ContactFailed,
    ContactPair,
    Plane,
    solve_contact,
)
from tests.contact.drawn_contact import problems
from tests.contact.solved_contact import read
from tests.library.properties import Elastic, assert_small, rigid_modes
from tests.library.random_meshes import MODULI, SEEDS, UNITS, Grid, Placement, powers, same_nodes
from tests.library.random_meshes import rotation as random_rotation

pytestmark = pytest.mark.random


def attempt(stated):
    """The increments solved, or the name of the refusal."""
    try:
        return read(stated, stated.solve())
    except ContactFailed as refusal:
        return type(refusal).__name__


def test_equilibrium_and_the_laws_of_contact():
    outcomes = Counter()

    @given(problems())
    def holds(problem):
        solved = attempt(problem.at())
        outcome = solved if isinstance(solved, str) else "solved"
        outcomes[outcome] += 1
        event(outcome)
        if outcome == "solved":
            for increment in solved:
                assert_equilibrium(increment)
                assert_law(increment, problem.friction)
                if slides(increment):
                    outcomes["slides"] += 1  # a hundredth of friction less or more would show
                    for factor in (0.99, 1.01):
                        with pytest.raises(AssertionError):
                            assert_law(increment, factor * problem.friction)

    holds()
    assert outcomes.pop("slides") > outcomes["solved"] / 5
    assert outcomes["solved"] > outcomes.total() / 5, outcomes


def assert_equilibrium(now):
    e, dim = now.stated.elastic, now.a.shape[1]
    total = len(now.K) * e.error_of_forces(now.a)
    balance = np.einsum("nak,na->k", rigid_modes(e.x), now.r + now.f)
    if e.state == "axisymmetric":
        balance = balance[1:2]  # radial sums round the axis are no resultants
    assert_small(balance, total)
    free = now.stated.reduction.right.getValuesCSR()[0]
    free = (np.diff(free) > 0).reshape(-1, dim)
    free[now.node] = False
    assert_small(now.r[free], e.error_of_forces(now.a))
    motions = now.stated.pair.motions
    if motions:
        for axis, way in enumerate(motions[now.increment].translation):
            if way is None:
                wanted = motions[now.increment].forces()[axis]
                # an equation of the iteration, which like the law is met to a promised part
                assert_small(now.r[now.node, axis].sum() - wanted, total + now.tolerance().max())


def slides(now):
    """Whether some node under pressure slides far, with friction."""
    limit = now.stated.problem.friction * now.r_n
    far = now.stiffness * np.linalg.norm(now.slip, axis=1) > 0.1 * limit
    return np.any(far & (limit > 0.1 * limit.max()) & (now.r_n > 0))


def assert_law(now, mu):
    c = now.stiffness
    lost = now.tolerance()
    faced = np.isfinite(now.gap)
    assert_small(now.r[now.node][~faced], lost.max())
    r_n, gap, lost = now.r_n[faced], now.gap[faced], lost[faced]
    tangential, slip = now.r_t[faced], now.slip[faced]
    size, slid = np.linalg.norm(tangential, axis=1), np.linalg.norm(slip, axis=1)
    c = c[faced]
    assert np.all(r_n >= -lost)
    assert np.all(c * gap >= -lost)
    assert np.all(np.minimum(r_n, c * gap) <= lost)
    lost = (1 + mu) * lost
    assert np.all(size <= mu * r_n + lost)
    # friction not used up holds, and friction that is used up points against the slip
    assert np.all(np.minimum(mu * r_n - size, c * slid) <= 2 * lost)
    against = slid[:, None] * tangential + size[:, None] * slip
    assert np.all(c * np.linalg.norm(against, axis=1) <= 2 * lost * (size + c * slid))


def test_same_contact_in_other_units_elsewhere_turned_and_renumbered():
    outcomes = Counter()

    @given(problems(), placements())
    def holds(problem, elsewhere):
        place, modulus, renumbered = elsewhere(problem)
        grid = problem.grid if renumbered is None else problem.grid.renumbered(renumbered)
        one, two = attempt(problem.at()), attempt(problem.at(place, modulus, grid))
        outcome = " / ".join(o if isinstance(o, str) else "solved" for o in (one, two))
        outcomes[outcome] += 1
        event(outcome)
        assert isinstance(one, str) == isinstance(two, str), outcome
        if not isinstance(one, str):
            for increments in zip(one, two, strict=True):
                assert_same(*increments)

    holds()
    assert outcomes["solved / solved"] > outcomes.total() / 5, outcomes


@st.composite
def placements(draw):
    """Of a problem: its place, the modulus and the seed of another numbering, or None."""
    unit, modulus, seed = draw(UNITS), draw(MODULI), draw(SEEDS)
    far, turned = draw(powers(-2, 6)), draw(st.booleans())
    renumbered = draw(st.none() | SEEDS)

    def elsewhere(problem):
        dim = problem.dim
        offset, turn = far * np.random.default_rng(seed).uniform(-1, 1, dim), np.eye(dim)
        if problem.state == "axisymmetric":
            offset[0] = 0.0  # the axis is where it is
        elif turned and problem.kind == "punch" and not problem.held:
            turn = right_angles(dim, seed)  # axes stay axes, along which a motion may be free
        elif turned:
            turn = random_rotation(dim, seed)
        if problem.kind == "punch" and problem.surface == "parabola":
            turn = np.eye(dim)  # its axis is the last one
        return Placement(unit, turn, offset), modulus, renumbered

    return elsewhere


def right_angles(dim, seed):
    """A turn that permutes the axes, some of them reversed."""
    rng = np.random.default_rng(seed)
    turn = np.eye(dim)[rng.permutation(dim)] * rng.choice([-1.0, 1.0], dim)
    turn[0] *= np.sign(np.linalg.det(turn))
    return turn


def assert_same(one, two):
    """Displacements and nodal forces of a problem and of the same problem elsewhere."""
    place, dim = two.stated.place, one.a.shape[1]
    scale = two.stated.modulus * place.unit ** (dim - 1)
    if one.stated.problem.state == "axisymmetric":
        scale *= place.unit
    at = same_nodes(one.stated.elastic.x, two.stated.elastic.x, place)
    (moved, forced), (moved_two, forced_two) = one.errors(), two.errors()
    moved = moved.max() + moved_two.max() / place.unit
    forced = forced.max() + forced_two.max() / scale
    assert_small(two.a / place.unit - place.vector(one.a)[at], dim * moved)
    assert_small(two.r / scale - place.vector(one.r)[at], dim * forced)


def test_finds_the_only_solution_of_three_nodes():
    """Of the 64 sets of status that they can have one is a solution; the iteration cycles."""
    x = [(1, 0), (1, 0.30265714), (1, 0.65394022), (1, 1)]
    x += [(3, 0), (3, 0.294989), (3, 0.67465787), (3, 1)]
    grid = Grid("quadrilateral", np.array(x), np.arange(3)[:, None] + [0, 4, 1, 5])
    elastic = Elastic(grid, state="axisymmetric", material=Material(1.0, 0.2))
    top = boundary_measure(elastic.body.spaces.mesh, lambda x: np.isclose(x[1], 1))
    loads = [
        assemble_vector(elastic.body.surface_load((pull, -0.041), top)) for pull in (0.0, -0.034)
    ]
    pair = ContactPair(lambda x: np.isclose(x[1], 0), Plane((0, 0), (0, 1)), 1.5)
    free = Reduction.dirichlet(elastic.space, [])
    _, pulled = solve_contact(elastic.K, loads, free, [pair], elastic.space)
    assert pulled.pairs[0].status.tolist() == [STICK, STICK, SLIP]
