"""Friction laws other than Coulomb's, written as a user would write them."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Direct, Iterative
from pw_elements.contact import SLIP, ContactPair, Coulomb, Motion, NoEquilibrium, Plane
from pw_elements.meshes import triangles
from tests.contact.cases import GALERKIN, BlockOnFloor, ElasticBody, on_plane
from tests.contact.iterative import FLOOR_IN_SPACE, SolidBlock

BLOCK_ON_FLOOR = BlockOnFloor(8)
FOR_DIRECT_AND_ITERATIVE_SOLVER = pytest.mark.parametrize(
    "solver", [Direct(), Iterative()], ids=["factors", "krylov"]
)


def floor_pair(law, *pair_options):
    return ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), law, *pair_options)


class SaturatingFriction:
    """Friction law with the limit mu r_n / (1 + r_n / h) for a nodal normal force r_n.

    At the nodal force r_n = h, the limit is half of that of Coulomb's law.
    """

    def __init__(self, mu, half):
        self.mu, self.half_force = mu, half

    def parameter_at(self, x):
        return self.half_force(x) if callable(self.half_force) else self.half_force

    def limit(self, half_force, normal_force):
        reduction = half_force / (half_force + normal_force)
        return self.mu * reduction * normal_force, self.mu * reduction**2


class CappedFriction:
    """Friction law with the limit min(mu r_n, cap) for a normal force r_n; it has a corner."""

    def __init__(self, mu, cap):
        self.mu, self.cap = mu, cap

    def parameter_at(self, x):
        return self.cap + 0 * x[0]

    def limit(self, cap, normal_force):
        return np.minimum(self.mu * normal_force, cap), np.where(
            self.mu * normal_force < cap, self.mu, 0.0
        )


class AdhesiveFriction(SaturatingFriction):
    """A friction law with a limit above zero at zero pressure, which is not allowed."""

    def limit(self, half_force, normal_force):
        limit, slope = super().limit(half_force, normal_force)
        return limit + 1.0, slope


class RisingCoefficientFriction(SaturatingFriction):
    """A law whose coefficient rises from 0.1 at zero pressure to 0.4 under large pressures.

    These are the coefficients for mu = 0.3. A coefficient that rises with pressure is not allowed.
    """

    def limit(self, half_force, normal_force):
        limit, slope = super().limit(half_force, normal_force)
        return 0.4 * normal_force - limit, 0.4 - slope


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("p", [5.0, 60.0])
def test_a_uniform_stress_has_the_friction_of_its_pressure(solver, p):
    """In a uniformly stressed block, the friction at each node is the limit at its normal force.

    The exact solution is a uniform stress; each nodal force is this stress times the node's
    tributary area.
    """
    mu, p_0, h = 0.6, 20.0, 0.5  # tributary length h of inner nodes, h/2 at ends
    tau = mu * p / (1 + p / p_0)

    def half_force_at(x):
        return p_0 * h * np.where(np.isclose(x[0] % 4.0, 0.0), 0.5, 1.0)

    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (4.0, 2.0), (4, 2))
    body = ElasticBody(mesh, state="plane stress", E=1e4, nu=0.0)
    side_load = body.traction_load((0.0, tau), on_plane(0, 0.0)) + body.traction_load(
        (0.0, -tau), on_plane(0, 4.0)
    )
    load, supports = (
        body.traction_load((0.0, -p), on_plane(1, 2.0)) + side_load,
        body.make_supports((0, on_plane(1, 2.0))),
    )
    floor = floor_pair(SaturatingFriction(mu, half_force_at), Motion((0.1, 0.0)))
    (state,) = body.solve_contact(floor, supports, load, solver=solver)
    (pair,) = state.pairs
    assert (pair.status == SLIP).all()
    area = np.where(np.isclose(pair.position[:, 0] % 4.0, 0.0), h / 2, h)
    assert pair.force_normal == pytest.approx(p * area, rel=1e-8)
    assert pair.force_tangential[:, 0] == pytest.approx(tau * area, rel=1e-8)
    assert pair.friction == pytest.approx(tau / p, rel=1e-8)


def assert_friction_law(pair, friction_limit, law_parameter):
    """Assert that force and slip of each node obey the friction law, by independent arithmetic."""
    largest = pair.force_normal.max()
    assert pair.force_normal.min() > -1e-9 * largest
    assert np.abs(pair.force_normal * np.minimum(pair.gap, 1.0)).max() < 1e-9 * largest
    for force, normal_force, slip in zip(
        pair.force_tangential, pair.force_normal, pair.slip, strict=True
    ):
        limit = friction_limit(max(normal_force, 0.0), law_parameter)
        size, length = np.linalg.norm(force), np.linalg.norm(slip)
        assert size < limit + 1e-8 * largest
        assert np.linalg.norm(force * length + limit * slip) < 1e-8 * largest * max(length, 1e-6)


FRICTION_LAWS_AND_EXACT_LIMITS = {
    "falling": (SaturatingFriction(0.8, 4.0), 4.0, lambda r, h: 0.8 * r / (1 + r / h)),
    "capped": (CappedFriction(0.6, 3.0), 3.0, lambda r, h: min(0.6 * r, h)),
}


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize(
    ("name", "block"),
    [
        ("falling", BLOCK_ON_FLOOR),
        ("capped", BLOCK_ON_FLOOR),
        ("falling", BlockOnFloor(8, GALERKIN)),
    ],
)
def test_a_law_holds_at_each_node_of_a_block_that_is_pulled(name, block, solver):
    law, half_force, exact_limit = FRICTION_LAWS_AND_EXACT_LIMITS[name]
    problem = block.contact_problem(floor_pair(law), solver=solver)
    state, n_slipping = problem.undeformed, 0
    for pull in (0.0, 4.0, 7.0, 9.0):
        load = 0.05 * block.pressure_load + block.traction_load((pull, 0.0), on_plane(0, 4.0))
        state = problem.step(state, load)
        assert_friction_law(state.pairs[0], exact_limit, half_force)
        n_slipping = max(n_slipping, int(np.sum(state.pairs[0].status == SLIP)))
    assert n_slipping > 3
    repeated = problem.step(state, load)  # starts at the solution
    assert repeated.iterations <= 2


def test_a_law_holds_in_space_where_slip_changes_direction():
    solid = SolidBlock()
    floor = ContactPair(on_plane(2, 0.0), FLOOR_IN_SPACE, SaturatingFriction(0.4, 1.5))
    (state,) = solid.solve_contact(floor, loads=solid.press_and_push_load())
    assert_friction_law(state.pairs[0], lambda r, h: 0.4 * r / (1 + r / h), 1.5)
    assert state.iterations <= 12  # Newton's method converges fast even with this law


def test_a_number_means_coulombs_law():
    reference, *states = (
        BLOCK_ON_FLOOR.solve_contact(
            floor_pair(friction), loads=BLOCK_ON_FLOOR.press_then_pull_loads(90.0, 2)
        )[-1]
        for friction in (
            0.3,
            Coulomb(0.3),
            lambda x: 0.3 + 0 * x[0],
            SaturatingFriction(0.3, 1e300),
        )
    )
    for state in states:
        assert np.array_equal(state.pairs[0].status, reference.pairs[0].status)
        assert (
            state.displacement - reference.displacement
        ).norm() < 1e-12 * reference.displacement.norm()


class CappedCoulomb(Coulomb):
    """Coulomb's law with an upper limit of the friction force."""

    cap = 1.0

    def limit(self, mu, force):
        limit, slope = super().limit(mu, force)
        return np.minimum(limit, self.cap), np.where(limit < self.cap, slope, 0.0)


def test_a_subclass_of_coulomb_uses_its_own_limit():
    drag = Motion((0.2, 0.0))
    load = BLOCK_ON_FLOOR.pressure_load
    for law, is_capped in ((Coulomb(0.3), False), (CappedCoulomb(0.3), True)):
        (state,) = BLOCK_ON_FLOOR.solve_contact(
            floor_pair(law, [drag]), BLOCK_ON_FLOOR.make_supports((0, on_plane(0, 4.0))), [load]
        )
        (pair,) = state.pairs
        limit = 0.3 * pair.force_normal
        expected = np.minimum(limit, CappedCoulomb.cap) if is_capped else limit
        is_slipping = pair.status == SLIP
        assert is_slipping.sum() > 3
        shear = np.abs(pair.force_tangential[:, 0])
        assert shear[is_slipping] == pytest.approx(expected[is_slipping], rel=1e-9)
        assert (limit[is_slipping] > 1.5 * CappedCoulomb.cap).any()


def test_coulombs_limit_is_used_at_all_nodes(monkeypatch):
    """If `Coulomb.limit` returns half the limit, the friction at all slipping nodes is halved.

    This shows that no other code multiplies forces by the friction coefficient.
    """
    supports, floor = (
        BLOCK_ON_FLOOR.make_supports((0, on_plane(0, 4.0))),
        floor_pair(0.3, [Motion((0.2, 0.0))]),
    )
    coefficients = []
    for factor in (1.0, 0.5):
        monkeypatch.setattr(
            Coulomb, "limit", lambda _, mu, force, factor=factor: (factor * mu * force, factor * mu)
        )
        (state,) = BLOCK_ON_FLOOR.solve_contact(floor, supports, [BLOCK_ON_FLOOR.pressure_load])
        (pair,) = state.pairs
        is_slipping = pair.status == SLIP
        assert is_slipping.sum() > 3
        coefficients.append(
            np.abs(pair.force_tangential[is_slipping, 0]) / pair.force_normal[is_slipping]
        )
    assert coefficients[0] == pytest.approx(0.3, rel=1e-9)
    assert coefficients[1] == pytest.approx(0.15, rel=1e-9)


class WrongSlopeFriction(SaturatingFriction):
    """A friction law that returns a slope that is 13 % too large."""

    def limit(self, half_force, normal_force):
        limit, slope = super().limit(half_force, normal_force)
        return limit, 1.13 * slope


class CoulombWithCoefficientBump(Coulomb):
    """A law whose coefficient rises from 0.9 mu to mu at the force `low` and falls at `high`."""

    low, high = 3.0, 3.3

    def limit(self, mu, force):
        is_within_bump = (force > self.low) & (force < self.high)
        coefficient = np.where(is_within_bump, 1.0, 0.9)
        coefficient = np.where(force > 1e-9, coefficient, 1.0)
        return mu * coefficient * force, mu * coefficient


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (WrongSlopeFriction(0.3, 4.0), r"slope .* differences of its limit give"),
        (CoulombWithCoefficientBump(0.3), "coefficient, the limit over the normal force, rises"),
    ],
)
def test_a_law_that_contradicts_itself_is_refused(law, message):
    with pytest.raises(ValueError, match=message):
        BLOCK_ON_FLOOR.solve_contact(floor_pair(law), loads=BLOCK_ON_FLOOR.pressure_load)


def test_a_law_whose_coefficient_rises_between_the_sampled_forces_is_refused_where_it_is_used():
    """A rise of the friction coefficient is refused if the iteration meets it.

    The rise lies between two of the forces at which laws are sampled beforehand. A problem whose
    forces do not reach it is solved.
    """

    class NarrowBump(CoulombWithCoefficientBump):
        low, high = 10.0005, 10.0015

    block = ElasticBody(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1)), nu=0.0)
    floor = floor_pair(NarrowBump(0.3))
    for pressure, is_refused in ((10.001 * 2, True), (9.9 * 2, False)):
        load = block.traction_load((0.0, -pressure), on_plane(1, 1.0))
        if is_refused:
            with pytest.raises(ValueError, match=r"rises at or below the normal force 10\.001"):
                block.solve_contact(floor, loads=load)
        else:
            assert block.solve_contact(floor, loads=load)


def test_sensitivity_refuses_other_laws_than_coulombs():
    problem = BLOCK_ON_FLOOR.contact_problem(floor_pair(CappedCoulomb(0.3)))
    states = [problem.undeformed, problem.step(problem.undeformed, BLOCK_ON_FLOOR.pressure_load)]
    with pytest.raises(ValueError, match="is not Coulomb's"):
        problem.sensitivity(states, [("force", 0, 0)], [("friction", 0)])


def test_a_pull_above_the_friction_limit_is_proved_to_have_no_equilibrium():
    """A pull above the friction limit is refused with a proof that no equilibrium exists.

    The pull is 0.4 times the pressing force, while the largest friction coefficient is 0.3.
    """
    load = BLOCK_ON_FLOOR.pressure_load + BLOCK_ON_FLOOR.traction_load(
        (0.4 * 200 * 4 / 2, 0.0), on_plane(0, 4.0)
    )
    with pytest.raises(NoEquilibrium, match="slides"):
        BLOCK_ON_FLOOR.solve_contact(floor_pair(SaturatingFriction(0.3, 1e3)), loads=load)


@pytest.mark.parametrize(
    "law",
    [
        *(
            SaturatingFriction(-0.3, 1.0),
            SaturatingFriction(np.nan, 1.0),
            SaturatingFriction(0.3, lambda x: x),
            SaturatingFriction,
        ),
        *(RisingCoefficientFriction(0.3, 1e-8), RisingCoefficientFriction(0.3, 1e9)),
        *(AdhesiveFriction(0.3, 1.0), Coulomb(-0.1), Coulomb("0.3")),
    ],
)
def test_invalid_laws_are_refused(law):
    with pytest.raises(ValueError, match="friction"):
        BLOCK_ON_FLOOR.solve_contact(floor_pair(law), loads=BLOCK_ON_FLOOR.pressure_load)
