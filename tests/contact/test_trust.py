"""No number that is far off, no refusal without cause."""

import logging
from dataclasses import fields, replace

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Iterative
from pw_elements.contact import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    NotFound,
    Sphere,
)
from pw_elements.contact.iteration import choose_first_set, make_contact_state, solve_increment
from pw_elements.contact.model import Residuals
from pw_elements.contact.steps.stepping import IncrementTarget, Stepping
from pw_elements.meshes import triangles
from pw_elements.solvers import SolverReport
from pw_elements.spaces import AssemblyRecord
from tests.contact.cases import BlockOnFloor, ElasticBody, PunchedBlock, on_plane
from tests.contact.two_bodies import StackedBlocks
from tests.oracle.random_contact import make_problem

# -- what a stiffness and a surface are ------------------------------------------------------------


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_a_surface_with_an_edge_is_refused(cell):
    stack = StackedBlocks((3, 2), cell)
    below, up = stack.x[:, stack.up] < 1 + 1e-9, np.isclose(stack.x[:, stack.up], 1.0)
    nodes = below & ~stack.side_nodes("upper") & (up | np.isclose(stack.x[:, 0], 1.0))
    pair = ContactPair(nodes, DeformableSurface(stack.sides["upper"]))
    with pytest.raises(ValueError, match=r"has an edge at .*1\)"):
        stack.contact_problem(pair)


def test_a_stiffness_by_hand_does_not_tell_whether_it_is_axisymmetric():
    stack = StackedBlocks((3, 2), state="axisymmetric")
    free, pair = stack.make_supports(), stack.make_pair()
    with pytest.raises(ValueError, match="give DeformableSurface"):
        ContactProblem(AssemblyRecord().attach(stack.K.copy()), free, pair, stack.space)
    pair = ContactPair(pair.nodes, DeformableSurface(pair.surface.where, revolved=False))
    with pytest.raises(ValueError, match="the stiffness is one in axisymmetric"):
        stack.contact_problem(pair)


def test_a_stiffness_that_is_scaled_between_steps_is_noticed():
    block = BlockOnFloor(8)
    problem = block.contact_problem(block.floor_pair(0.3))
    problem.step(problem.undeformed, block.pressure_load)
    block.K.scale(3.0)
    state = problem.step(problem.undeformed, block.pressure_load)
    (fresh,) = block.solve_contact(block.floor_pair(0.3), loads=block.pressure_load)
    assert np.abs(state.displacement.array - fresh.displacement.array).max() < 1e-12
    assert state.residuals.largest() < 1e-9


# -- diagnostics -----------------------------------------------------------------------------------


def test_a_slave_node_on_the_axis_neither_sticks_nor_slips():
    """Its weighted slip has that of its neighbours, which their friction allows or not."""
    stack = StackedBlocks((4, 3), state="axisymmetric", modulus_ratio=30.0)
    supports, load = (
        stack.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, 0.0))),
        stack.traction_load((0.0, -0.01)),
    )
    (state,) = stack.solve_contact(stack.make_pair(friction=5.0), supports, load)
    (pair,) = state.pairs
    on_axis = np.isclose(pair.position[:, 0], 0.0)
    assert np.array_equal(pair.status == HELD, on_axis)
    moved = np.abs(state.displacement.array).max()
    assert np.abs(pair.displacement[on_axis, 0]).max() > 1e-6 * moved
    assert np.allclose(pair.slip[on_axis, 0], pair.displacement[on_axis, 0])
    assert np.abs(pair.displacement[pair.status == STICK, 0]).max() < 1e-9 * moved


def test_residuals_of_two_bodies_that_stick_are_round_off(caplog):
    """Lengths are over both bodies' displacements, not over what is next to nothing."""
    caplog.set_level(logging.INFO)
    stack = StackedBlocks((3, 2))
    pair, load = stack.make_pair(friction=10.0), stack.traction_load((0.0, -0.01))
    (state,) = stack.solve_contact(pair, stack.clamp(on_plane(1, 0.0)), load, solver=Iterative())
    assert set(state.pairs[0].status) == {STICK}
    assert state.residuals.largest() < 1e-8


@pytest.fixture(scope="module")
def accepted():
    """An increment with open, sticking and slipping nodes, and a free surface; its solution."""
    punch = PunchedBlock()
    stated = punch.contact_problem(punch.punch_pair(0.6), punch.base_supports)
    stepping, motion = stated._stepping, Motion((0.02, None), (0, -217.3))
    start = stated.undeformed
    target = IncrementTarget.from_motions(punch.zero_load, [motion], stepping.interface)
    increment, kinematics = stepping._start_increment(start, target)
    linearised = stepping._linearise_start(increment, kinematics, start, target)
    rigid = stepping._system_for(target.free)[1]
    solution = solve_increment(
        increment,
        choose_first_set(
            stepping.interface,
            linearised,
            start,
            rigid.describe_free_motions,
            target.unloaded_free_surfaces,
        ),
        linearised,
        stepping._make_update(rigid, "rough"),
        max_iterations=50,
        after_iteration=lambda *_: None,
    )
    return increment, solution, start


@pytest.mark.parametrize("name", [field.name for field in fields(Residuals)])
def test_no_state_is_accepted_that_its_residuals_reject(accepted, name):
    """Each condition alone is violated by 1e-7 of the largest force, then by 1e-10 of it."""
    increment, right, before = accepted
    contact = right.nodes
    status, largest = contact.active_set.status, np.abs(right.force).max()
    first = {kind: np.flatnonzero(status == kind)[0] for kind in (OPEN, STICK, SLIP)}
    for share in (1e-7, 1e-10):
        small, now = share * largest, right
        force, gap, slip = contact.force.copy(), contact.gap.copy(), contact.slip.copy()
        if name == "equilibrium":
            now = replace(right, unbalanced=np.array([small]))
        elif name == "balance":
            pushed = right.force.copy()
            pushed[first[OPEN], 1] += small
            now = replace(right, force=pushed)
        elif name in ("penetration", "stick"):
            changed = gap if name == "penetration" else slip[:, 0]
            changed[first[STICK]] -= small / contact.scale[first[STICK]]
        elif name in ("tension", "complementarity"):
            force[first[OPEN], 0] += small if name == "complementarity" else -small
        else:
            way = np.sign(force[first[SLIP], 1]) * (1 if name == "cone" else -1)
            force[first[SLIP], 1] += way * small
        if now is right:
            now = replace(right, nodes=replace(contact, force=force, gap=gap, slip=slip))
        state = make_contact_state(
            increment, now, before, iterations=1, report=SolverReport("", 0), smallness=None
        )
        assert (increment.violation(now) <= 1) == (share == 1e-10)
        assert getattr(state.residuals, name) > share / 100
    assert increment.violation(right) <= 1


@pytest.mark.parametrize(("share", "unique"), [(0.9, True), (1.0, False)])
def test_a_block_drawn_by_all_its_friction_is_not_unique(share, unique):
    """It may slide as far as it likes."""
    block = BlockOnFloor(8)
    states = block.solve(0.3, share * 120.0, increments=1, smooth=0.0)
    assert states[-1].unique is unique


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_ball_without_force_just_touches(mu):
    """From a start in which it does, not from what it touched before: no remedy is needed."""
    body = ElasticBody(triangles(MPI.COMM_SELF, (-2.0, 0.0), (2.0, 2.0), (9, 4)))
    motions = [Motion((0, None), (0, force)) for force in (-300.0, -20.0, 0.0)]
    pair = ContactPair(on_plane(1, 2.0), Sphere((0.37, 7.0), 5.0), mu, motions)
    states = body.solve_contact(pair, body.clamp(on_plane(1, 0.0)), remedies=())
    assert states[-1].displacement.norm() < 1e-12 * states[0].displacement.norm()
    assert states[-1].pairs[0].gap.min() == pytest.approx(0.0, abs=1e-12)
    assert states[-1].residuals.largest() < 1e-9


def test_a_refusal_says_what_was_tried_and_how_far_it_got(caplog):
    with caplog.at_level("INFO", "pw_elements.contact"), pytest.raises(NotFound) as refused:
        make_problem(104).solve()
    for remedy in ("by springs", "in parts"):
        assert f"{remedy}, for what 150 linear systems take at most" in caplog.text
    share, state = refused.value.last_substate
    assert f"In parts {share} of it was reached" in str(refused.value)
    assert share == 0.5
    assert state.converged
    assert state.residuals.largest() < 1e-9


def test_a_remedy_costs_as_many_first_attempts_as_it_may(monkeypatch):
    """But for what is begun before these are used up."""
    remedies, ends = [], []
    allowed = Stepping._budget

    def noted(stepping, remedy, free):
        ends.extend(left() for left, _ in remedies[-1:])  # of the one before
        left = allowed(stepping, remedy, free)
        remedies.append((left, left()))
        return left

    monkeypatch.setattr(Stepping, "_budget", noted)
    for multiple in (0.1, 3.0):
        remedies.clear()
        ends.clear()
        with pytest.raises(NotFound):
            make_problem(93).solve(remedies={"springs": multiple, "cutback": multiple})
        ends.append(remedies[-1][0]())
        assert [most for _, most in remedies] == [50 * multiple] * 2
        assert all(end > -0.5 * 50 * multiple - 10 for end in ends)
