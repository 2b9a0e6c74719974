"""Laws of friction other than Coulomb's, stated as a user would."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Direct, Iterative
from pw_elements.contact import SLIP, ContactPair, Coulomb, Motion, NoEquilibrium, Plane
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, BlockOnFloor, ElasticBody, on_plane
from tests.contact.iterative import FLOOR, SolidBlock

BLOCK = BlockOnFloor(8)
SOLVERS = pytest.mark.parametrize("solver", [Direct(), Iterative()], ids=["factors", "krylov"])


def on_floor(law, *options):
    return ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), law, *options)


class SaturatingFriction:
    """mu r_n / (1 + r_n / h), with h a force at each node."""

    def __init__(self, mu, half):
        self.mu, self.half_force = mu, half

    def at(self, x):
        return self.half_force(x) if callable(self.half_force) else self.half_force

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


class Adhesive(SaturatingFriction):
    """It holds without any pressure, which no law here may."""

    def limit(self, half, force):
        limit, slope = super().limit(half, force)
        return limit + 1.0, slope


class Stiffening(SaturatingFriction):
    """Its coefficient is 0.1 without pressure and four times that under much of it."""

    def limit(self, half, force):
        limit, slope = super().limit(half, force)
        return 0.4 * force - limit, 0.4 - slope


@SOLVERS
@pytest.mark.parametrize("p", [5.0, 60.0])
def test_an_even_stress_has_the_friction_of_its_pressure(solver, p):
    """The exact solution is a uniform stress, so that each node has that of its own area."""
    mu, p_0, h = 0.6, 20.0, 0.5  # piecewise-linear weights: h at inner nodes, half of it at ends
    tau = mu * p / (1 + p / p_0)

    def half(x):
        return p_0 * h * np.where(np.isclose(x[0] % 4.0, 0.0), 0.5, 1.0)

    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (4.0, 2.0), (4, 2))
    body = ElasticBody(mesh, state="plane stress", E=1e4, nu=0.0)
    sides = body.traction_load((0.0, tau), on_plane(0, 0.0)) + body.traction_load(
        (0.0, -tau), on_plane(0, 4.0)
    )
    load, held = (
        body.traction_load((0.0, -p), on_plane(1, 2.0)) + sides,
        body.make_supports((0, on_plane(1, 2.0))),
    )
    floor = on_floor(SaturatingFriction(mu, half), Motion((0.1, 0.0)))
    (state,) = body.solve_contact(floor, held, load, solver=solver)
    (pair,) = state.pairs
    assert (pair.status == SLIP).all()
    area = np.where(np.isclose(pair.position[:, 0] % 4.0, 0.0), h / 2, h)
    assert pair.force_normal == pytest.approx(p * area, rel=1e-8)
    assert pair.force_tangential[:, 0] == pytest.approx(tau * area, rel=1e-8)
    assert pair.friction == pytest.approx(tau / p, rel=1e-8)


def assert_friction_law(pair, limit_of, half):
    """Each node's force and slip, by arithmetic of their own."""
    most = pair.force_normal.max()
    assert pair.force_normal.min() > -1e-9 * most
    assert np.abs(pair.force_normal * np.minimum(pair.gap, 1.0)).max() < 1e-9 * most
    for force, pressed, slip in zip(
        pair.force_tangential, pair.force_normal, pair.slip, strict=True
    ):
        limit = limit_of(max(pressed, 0.0), half)
        size, length = np.linalg.norm(force), np.linalg.norm(slip)
        assert size < limit + 1e-8 * most
        assert np.linalg.norm(force * length + limit * slip) < 1e-8 * most * max(length, 1e-6)


LAWS = {
    "falling": (SaturatingFriction(0.8, 4.0), 4.0, lambda r, h: 0.8 * r / (1 + r / h)),
    "capped": (Capped(0.6, 3.0), 3.0, lambda r, h: min(0.6 * r, h)),
}


@SOLVERS
@pytest.mark.parametrize(
    ("name", "block"),
    [("falling", BLOCK), ("capped", BLOCK), ("falling", BlockOnFloor(8, GALERKIN))],
)
def test_a_law_holds_at_each_node_of_a_block_that_is_pulled(name, block, solver):
    law, half, exact = LAWS[name]
    problem = block.contact_problem(on_floor(law), solver=solver)
    state, slipping = problem.undeformed, 0
    for pull in (0.0, 4.0, 7.0, 9.0):
        load = 0.05 * block.pressure_load + block.traction_load((pull, 0.0), on_plane(0, 4.0))
        state = problem.step(state, load)
        assert_friction_law(state.pairs[0], exact, half)
        slipping = max(slipping, int(np.sum(state.pairs[0].status == SLIP)))
    assert slipping > 3
    resumed = problem.step(state, load)  # starts where it has ended
    assert resumed.iterations <= 2


def test_a_law_holds_in_space_where_slip_turns():
    solid = SolidBlock()
    floor = ContactPair(on_plane(2, 0.0), FLOOR, SaturatingFriction(0.4, 1.5))
    (state,) = solid.solve_contact(floor, loads=solid.press_and_push_load())
    assert_friction_law(state.pairs[0], lambda r, h: 0.4 * r / (1 + r / h), 1.5)
    assert state.iterations <= 12  # Newton's method converges fast there, too


def test_coulomb_is_what_a_number_means():
    one, *others = (
        BLOCK.solve_contact(on_floor(friction), loads=BLOCK.pull_loads(90.0, 2))[-1]
        for friction in (
            0.3,
            Coulomb(0.3),
            lambda x: 0.3 + 0 * x[0],
            SaturatingFriction(0.3, 1e300),
        )
    )
    for state in others:
        assert np.array_equal(state.pairs[0].status, one.pairs[0].status)
        assert (state.displacement - one.displacement).norm() < 1e-12 * one.displacement.norm()


class Limited(Coulomb):
    """Coulomb's law with a cap of the force."""

    most = 1.0

    def limit(self, at, force):
        limit, slope = super().limit(at, force)
        return np.minimum(limit, self.most), np.where(limit < self.most, slope, 0.0)


def test_a_law_derived_from_coulombs_is_asked_for_its_own_limit():
    drag = Motion((0.2, 0.0))
    load = BLOCK.pressure_load
    for law, capped in ((Coulomb(0.3), False), (Limited(0.3), True)):
        (state,) = BLOCK.solve_contact(
            on_floor(law, [drag]), BLOCK.make_supports((0, on_plane(0, 4.0))), [load]
        )
        (pair,) = state.pairs
        limit = 0.3 * pair.force_normal
        expected = np.minimum(limit, Limited.most) if capped else limit
        slips = pair.status == SLIP
        assert slips.sum() > 3
        size = np.abs(pair.force_tangential[:, 0])
        assert size[slips] == pytest.approx(expected[slips], rel=1e-9)
        assert (limit[slips] > 1.5 * Limited.most).any()


def test_coulombs_limit_is_what_all_nodes_are_asked_for(monkeypatch):
    """Half of the limit is half of the friction: nothing else multiplies coefficients."""
    supports, floor = (
        BLOCK.make_supports((0, on_plane(0, 4.0))),
        on_floor(0.3, [Motion((0.2, 0.0))]),
    )
    forces = []
    for part in (1.0, 0.5):
        monkeypatch.setattr(
            Coulomb, "limit", lambda _, at, force, part=part: (part * at * force, part * at)
        )
        (state,) = BLOCK.solve_contact(floor, supports, [BLOCK.pressure_load])
        (pair,) = state.pairs
        slips = pair.status == SLIP
        assert slips.sum() > 3
        forces.append(np.abs(pair.force_tangential[slips, 0]) / pair.force_normal[slips])
    assert forces[0] == pytest.approx(0.3, rel=1e-9)
    assert forces[1] == pytest.approx(0.15, rel=1e-9)


class WrongSlope(SaturatingFriction):
    """Its slope is an eighth too large."""

    def limit(self, half, force):
        limit, slope = super().limit(half, force)
        return limit, 1.13 * slope


class Bumpy(Coulomb):
    """Its coefficient rises by a tenth between two forces within one decade, and falls again."""

    low, high = 3.0, 3.3

    def limit(self, at, force):
        inside = (force > self.low) & (force < self.high)
        coefficient = np.where(inside, 1.0, 0.9)
        coefficient = np.where(force > 1e-9, coefficient, 1.0)
        return at * coefficient * force, at * coefficient


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (WrongSlope(0.3, 4.0), r"slope .* differences of its limit give"),
        (Bumpy(0.3), "coefficient, the limit over the normal force, rises"),
    ],
)
def test_a_law_that_contradicts_itself_is_refused(law, words):
    with pytest.raises(ValueError, match=words):
        BLOCK.solve_contact(on_floor(law), loads=BLOCK.pressure_load)


def test_a_law_that_rises_between_the_forces_it_was_asked_for_first_is_refused_where_it_is_used():
    """The bump is narrower than the samples."""

    class Narrow(Bumpy):
        low, high = 10.0005, 10.0015

    block = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1)), nu=0.0)
    floor = on_floor(Narrow(0.3))
    for pressure, wrong in ((10.001 * 2, True), (9.9 * 2, False)):
        load = block.traction_load((0.0, -pressure), on_plane(1, 1.0))
        if wrong:
            with pytest.raises(ValueError, match=r"rises up to the normal force 10\.001"):
                block.solve_contact(floor, loads=load)
        else:
            assert block.solve_contact(floor, loads=load)


def test_derivatives_know_the_slope_of_no_other_law():
    problem = BLOCK.contact_problem(on_floor(Limited(0.3)))
    states = [problem.undeformed, problem.step(problem.undeformed, BLOCK.pressure_load)]
    with pytest.raises(ValueError, match="is not Coulomb's"):
        problem.sensitivity(states, [("force", 0, 0)], [("friction", 0)])


def test_more_than_a_law_can_hold_is_proved_to_be_too_much():
    """Its steepest cone, 0.3, does not hold a pull of 0.4 of the pressure either."""
    load = BLOCK.pressure_load + BLOCK.traction_load((0.4 * 200 * 4 / 2, 0.0), on_plane(0, 4.0))
    with pytest.raises(NoEquilibrium, match="slides"):
        BLOCK.solve_contact(on_floor(SaturatingFriction(0.3, 1e3)), loads=load)


@pytest.mark.parametrize(
    "law",
    [
        *(
            SaturatingFriction(-0.3, 1.0),
            SaturatingFriction(np.nan, 1.0),
            SaturatingFriction(0.3, lambda x: x),
            SaturatingFriction,
        ),
        *(Stiffening(0.3, 1e-8), Stiffening(0.3, 1e9)),
        *(Adhesive(0.3, 1.0), Coulomb(-0.1), Coulomb("0.3")),
    ],
)
def test_what_is_no_law_is_refused(law):
    with pytest.raises(ValueError, match="friction"):
        BLOCK.solve_contact(on_floor(law), loads=BLOCK.pressure_load)
