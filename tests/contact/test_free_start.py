"""Surfaces that move freely under a force and touch few nodes, or none, at the start."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import fsolve

from pw_elements import prescribe
from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    SolutionNotFound,
    Sphere,
)
from pw_elements.contact.model import UnilateralContact
from pw_elements.meshes import quadrilaterals
from tests.contact.cases import ElasticBody, make_finite_strain_unknown_and_residual, on_plane
from tests.contact.test_interface_laws import BAR_STIFFNESS, WIDTH, Bar
from tests.parallel import assert_same_on_processes

LAWS = [None, UnilateralContact(0.0)]
RADIUS = 1.0


class Block(ElasticBody):
    """A square with edges of length 1, whose upper side is pressed."""

    def __init__(self, comm=MPI.COMM_SELF):
        super().__init__(quadrilaterals(comm, (0, 0), (1, 1), (4, 4)))

    def make_rubber_problem(self, surface, law, *, is_clamped):
        """Return a problem at large strains, with a lower side that is clamped or slides in x."""
        u, residual = make_finite_strain_unknown_and_residual(self.body.spaces)
        held = [(1, on_plane(1, 0.0)), (0, on_plane(1 if is_clamped else 0, 0.0))]
        conditions = [prescribe(self.space, axis, part) for axis, part in held]
        return ContactProblem.of_residual(residual, u, conditions, make_pair(surface, law))

    def make_elastic_problem(self, surface, law):
        supports = self.make_clamping_supports(on_plane(1, 0.0))
        return self.contact_problem(make_pair(surface, law), supports)


def make_pair(surface, law):
    return ContactPair(on_plane(1, 1.0), surface, interface_law=law)


def press(force):
    return Motion((0, None), force=(0, force))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_plate_that_falls_on_rubber_gives_uniaxial_stress(gap, law):
    problem = Block().make_rubber_problem(Plane((0, 1 + gap), (0, -1)), law, is_clamped=False)
    state = problem.step(problem.undeformed, motions=press(-0.2))

    def stress_errors(stretches):
        a, b = stretches
        log_J = np.log(a * b)
        return [a - 1 / a + 1.5 * log_J / a, b - 1 / b + 1.5 * log_J / b + 0.2]

    _, b = fsolve(stress_errors, (1.0, 0.95), xtol=1e-13)
    assert state.pairs[0].translation[1] == pytest.approx(b - 1 - gap, abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("gap", [0.0, 0.01])
@pytest.mark.parametrize("is_large", [False, True])
def test_disc_on_one_node_has_the_state_of_prescribed_motion(is_large, gap, law):
    surface = Sphere((0.5, 1 + RADIUS + gap), RADIUS)
    if is_large:
        problem = Block().make_rubber_problem(surface, law, is_clamped=True)
    else:
        problem = Block().make_elastic_problem(surface, law)
    state = problem.step(problem.undeformed, motions=press(-0.02))
    assert 1 <= np.count_nonzero(state.pairs[0].status != OPEN) < 9
    depth = state.pairs[0].translation[1]
    moved = problem.step(problem.undeformed, motions=Motion((0, depth)))
    assert moved.pairs[0].force[1] == pytest.approx(-0.02, rel=1e-6)
    assert (moved.displacement - state.displacement).norm() < 1e-8 * moved.displacement.norm()


def solve_disc_on_several_processes(comm):
    problem = Block(comm).make_rubber_problem(
        Sphere((0.5, 1 + RADIUS + 0.01), RADIUS), UnilateralContact(0.2), is_clamped=True
    )
    state = problem.step(problem.undeformed, motions=press(-0.02))
    return {"translation": state.pairs[0].translation, "force": state.pairs[0].force_normal}


def test_disc_under_a_force_is_the_same_on_several_processes():
    assert_same_on_processes(solve_disc_on_several_processes)


@pytest.mark.parametrize("coefficient", [1e-3, 1.0])
def test_wear_that_opens_all_nodes_lowers_the_surface_by_its_depth(coefficient):
    """The depth of one increment is up to 100 times the compression of the bar."""
    bar, pressure, worn, path = Bar(), 5.0, 0.0, 0.0
    problem = bar.make_problem(UnilateralContact(0.0, wear_coefficient=coefficient), 0.0)
    state = problem.undeformed
    for position in (0.0, 0.1, 0.3):
        motion = Motion((position, None), force=(0.0, pressure * WIDTH))
        state = problem.step(state, motions=motion)
        (pair,) = state.pairs
        assert pair.translation[1] == pytest.approx(worn + pressure / BAR_STIFFNESS, rel=1e-9)
        path = position
        worn = coefficient * pressure * path
        np.testing.assert_allclose(pair.law_history[:, 3], worn, rtol=1e-8, atol=1e-14)


def test_a_force_that_presses_no_node_is_refused():
    away = Plane((0, 1.01), (0, -1))
    problem = Block().make_elastic_problem(away, UnilateralContact(0.2))
    with pytest.raises(SolutionNotFound, match=r"pair 0 is free to move, and its force presses it"):
        problem.step(problem.undeformed, motions=press(0.1))
    problem = Block().make_rubber_problem(away, None, is_clamped=True)
    with pytest.raises(SolutionNotFound, match=r"free to move may have lost all its nodes"):
        problem.step(problem.undeformed, motions=press(0.1))


def test_pairs_without_a_law_open_beside_a_pair_with_a_law():
    """Unilateral contact as the law of one pair changes nothing, also where the other one opens."""

    def solve_states(law):
        block = Block()
        floor = ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)), interface_law=law)
        pairs = [make_pair(Sphere((0.5, 1 + RADIUS), RADIUS), None), floor]
        supports = block.make_supports((0, lambda x: np.isclose(x[:2], 0).all(axis=0)))
        problem = block.contact_problem(pairs, supports)
        return problem.step(problem.undeformed, motions=[Motion((0, -0.01)), None])

    state, expected = (solve_states(law) for law in (UnilateralContact(0.0), None))
    assert np.count_nonzero(expected.pairs[0].status == OPEN) > 2
    for pair, expected_pair in zip(state.pairs, expected.pairs, strict=True):
        np.testing.assert_allclose(pair.force_normal, expected_pair.force_normal, atol=1e-9)
