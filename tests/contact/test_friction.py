"""Laws of friction other than Coulomb's, stated as a user would."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import (
    SLIP,
    ContactPair,
    ContactProblem,
    Coulomb,
    Motion,
    NoEquilibrium,
    Plane,
    solve_contact,
)
from pw_elements.contact.model import Cone
from pw_elements.contact.steps.impact import nodal_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from tests.contact.cases import Block, at
from tests.contact.iterative import Solid

BLOCK = Block(8)


class Falling:
    """mu r_n / (1 + r_n / h), with h a force at each node."""

    def __init__(self, mu, half):
        self.mu, self.half = mu, half

    def at(self, x):
        return self.half(x) if callable(self.half) else self.half

    def limit(self, half, force):
        share = half / (half + force)
        return self.mu * share * force, self.mu * share**2


class Capped:
    """The smaller one of mu r_n and a force: its limit has a corner."""

    def __init__(self, mu, most):
        self.mu, self.most = mu, most

    def at(self, x):
        return self.most + 0 * x[0]

    def limit(self, most, force):
        return np.minimum(self.mu * force, most), np.where(self.mu * force < most, self.mu, 0.0)


def even(method, solver, p, tau, law):
    """The state of a block whose stress is uniform if the floor's friction is tau everywhere."""
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (4.0, 2.0), (4, 2))
    body = Body(method(mesh), Material(1e4), StressState.PLANE_STRESS)
    space, K = body.spaces.trial, assemble_matrix(body.stiffness())
    loads = {(1, 2.0): (0.0, -p), (0, 0.0): (0.0, tau), (0, 4.0): (0.0, -tau)}
    f = K.createVecLeft()
    for (axis, value), traction in loads.items():
        side = boundary_measure(mesh, at(axis, value))
        f.axpy(1.0, assemble_vector(body.surface_load(traction, side)))
    held = Reduction.dirichlet(space, prescribe(space, 0, at(1, 2.0)))
    slides = Motion((0.1, 0.0))
    floor = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), law, slides)
    (state,) = solve_contact(K, f, held, floor, space, solver=solver)
    return state.pairs[0]


@pytest.mark.parametrize("solver", [Direct(), Iterative()], ids=["factors", "krylov"])
@pytest.mark.parametrize("p", [5.0, 60.0])
def test_an_even_stress_has_the_friction_of_its_pressure(solver, p):
    """The exact solution is a uniform stress, so that each node has that of its own area."""
    mu, p_0, h = 0.6, 20.0, 0.5  # piecewise-linear weights: h at inner nodes, half of it at ends

    def half(x):
        return p_0 * h * np.where(np.isclose(x[0] % 4.0, 0.0), 0.5, 1.0)

    pair = even(Spaces.petrov_galerkin, solver, p, mu * p / (1 + p / p_0), Falling(mu, half))
    assert (pair.status == SLIP).all()
    area = np.where(np.isclose(pair.position[:, 0] % 4.0, 0.0), h / 2, h)
    assert pair.force_normal == pytest.approx(p * area, rel=1e-8)
    assert pair.force_tangential[:, 0] == pytest.approx(mu * p * area / (1 + p / p_0), rel=1e-8)
    assert pair.friction == pytest.approx(mu / (1 + p / p_0), rel=1e-8)


def assert_law(pair, law, half):
    """Each node's force and slip, by arithmetic of their own."""
    most = pair.force_normal.max()
    assert pair.force_normal.min() > -1e-9 * most
    assert np.abs(pair.force_normal * np.minimum(pair.gap, 1.0)).max() < 1e-9 * most
    for force, pressed, slip, h in zip(
        pair.force_tangential, pair.force_normal, pair.slip, half, strict=True
    ):
        limit = law(max(pressed, 0.0), h)
        size, length = np.linalg.norm(force), np.linalg.norm(slip)
        assert size < limit + 1e-8 * most
        assert np.linalg.norm(force * length + limit * slip) < 1e-8 * most * max(length, 1e-6)


LAWS = {
    "falling": (Falling(0.8, 4.0), lambda r, h: 0.8 * r / (1 + r / h)),
    "capped": (Capped(0.6, 3.0), lambda r, h: min(0.6 * r, h)),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("solver", [Direct(), Iterative()], ids=["factors", "krylov"])
@pytest.mark.parametrize("method", [Spaces.petrov_galerkin, Spaces.galerkin])
def test_a_law_holds_at_each_node_of_a_block_that_is_pulled(name, solver, method):
    law, exact = LAWS[name]
    block = BLOCK if method is Spaces.petrov_galerkin else Block(8, method)
    floor = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), law)
    problem = ContactProblem(block.K, block.free, floor, block.space, solver=solver)
    state, slipping = problem.undeformed, 0
    for pull in (0.0, 4.0, 7.0, 9.0):
        load = 0.05 * block.pressure + block.load((pull, 0.0), at(0, 4.0))
        state = problem.step(state, load)
        (pair,) = state.pairs
        half = np.full(len(pair.status), law.half if name == "falling" else law.most)
        assert_law(pair, exact, half)
        slipping = max(slipping, int(np.sum(pair.status == SLIP)))
    assert slipping > 3
    resumed = problem.step(state, load)  # starts where it has ended
    assert resumed.iterations <= 2


def test_a_law_holds_in_space_where_slip_turns():
    solid = Solid()
    floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), Falling(0.4, 1.5))
    problem = ContactProblem(solid.K, solid.free, floor, solid.space)
    state = problem.step(problem.undeformed, solid.pushed())
    (pair,) = state.pairs
    assert_law(pair, lambda r, h: 0.4 * r / (1 + r / h), np.full(len(pair.status), 1.5))
    assert state.iterations <= 12  # Newton's method converges fast there, too


def test_coulomb_is_what_a_number_means():
    loads = BLOCK.pulled(90.0, 2)
    states = [
        solve_contact(
            BLOCK.K,
            loads,
            BLOCK.free,
            ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), friction),
            BLOCK.space,
        )[-1]
        for friction in (0.3, Coulomb(0.3), lambda x: 0.3 + 0 * x[0], Falling(0.3, 1e300))
    ]
    for state in states[1:]:
        assert np.array_equal(state.pairs[0].status, states[0].pairs[0].status)
        difference = (state.displacement - states[0].displacement).norm()
        assert difference < 1e-12 * states[0].displacement.norm()


def test_more_than_a_law_can_hold_is_proved_to_be_too_much():
    """Its steepest cone, 0.3, does not hold a pull of 0.4 of the pressure either."""
    floor = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), Falling(0.3, 1e3))
    load = BLOCK.pressure + BLOCK.load((0.4 * 200 * 4 / 2, 0.0), at(0, 4.0))
    with pytest.raises(NoEquilibrium, match="slides"):
        solve_contact(BLOCK.K, load, BLOCK.free, floor, BLOCK.space)


def test_a_law_holds_in_a_step_of_explicit_dynamics():
    """Slip that is left is along the friction, which then is all that the law allows."""
    rng, n, step = np.random.default_rng(5), 500, 0.1
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    motion, mass, half = rng.normal(size=(n, 3)), rng.uniform(1, 9, n), rng.uniform(1, 99, n)
    cone, rest = Cone([Falling(0.9, None)], [half]), np.zeros((n, 3))
    held = np.zeros((n, 3), dtype=bool)
    found = nodal_contact(motion, np.zeros(n), normal, rest, held, mass, cone, step)
    after = motion + step**2 * found.force / mass[:, None]
    slip = after - np.sum(after * normal, axis=1)[:, None] * normal
    limit = 0.9 * found.pressed / (1 + found.pressed / half)
    size, length = (np.linalg.norm(part, axis=1) for part in (found.friction, slip))
    assert (size <= limit * (1 + 1e-12)).all()
    assert np.sum(found.friction * slip, axis=1) == pytest.approx(-limit * length, abs=1e-9)
    closed = found.pressed > 0
    assert 0 < (length[closed] < 1e-12).sum() < closed.sum()


def test_chords_of_a_cone():
    cone = Cone([Falling(0.6, None), Coulomb(None)], [np.full(3, 2.0), np.array([0.0, 0.3])])
    force = np.array([0.0, 2.0, 6.0, 5.0, 0.0])
    assert cone.coefficient(force) == pytest.approx([0.6, 0.3, 0.15, 0.0, 0.3], abs=1e-15)
    assert cone.steepest == pytest.approx([0.6, 0.6, 0.6, 0.0, 0.3])
    assert cone.rough.tolist() == [True, True, True, False, True]
    limit, slope = cone.limit(force)
    ahead, behind = (cone.limit(force + d)[0] for d in (1e-6, -1e-6))
    assert slope == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)
    assert limit[1] == pytest.approx(0.6)


class Adhesive(Falling):
    """It holds without any pressure, which no law here may."""

    def limit(self, half, force):
        limit, slope = super().limit(half, force)
        return limit + 1.0, slope


class Stiffening(Falling):
    """Its coefficient is 0.1 without pressure and four times that under much of it."""

    def limit(self, half, force):
        limit, slope = super().limit(half, force)
        return 0.4 * force - limit, 0.4 - slope


@pytest.mark.parametrize(
    ("law", "error"),
    [
        (Stiffening(0.3, 1e-8), ValueError),
        (Stiffening(0.3, 1e9), ValueError),
        (Falling(-0.3, 1.0), ValueError),
        (Falling(np.nan, 1.0), ValueError),
        (Adhesive(0.3, 1.0), ValueError),
        (Falling(0.3, lambda x: x), ValueError),
        (Falling, ValueError),
        (Coulomb(-0.1), ValueError),
        (Coulomb("0.3"), ValueError),
    ],
)
def test_what_is_no_law_is_refused(law, error):
    with pytest.raises(error, match="friction"):
        solve_contact(
            BLOCK.K,
            BLOCK.pressure,
            BLOCK.free,
            ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), law),
            BLOCK.space,
        )
