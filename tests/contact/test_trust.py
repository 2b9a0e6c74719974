"""No state with large errors is accepted, and no problem is refused without cause."""

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
    SolutionNotFound,
    Sphere,
)
from pw_elements.contact.iteration import (
    TargetLoadsAndMotions,
    choose_first_active_set,
    solve_increment,
)
from pw_elements.contact.model import Residuals
from pw_elements.contact.nodes import MAX_CONTACT_VIOLATION_PER_NODAL_FORCE
from pw_elements.contact.steps.stepping import SmallStrainStepping
from pw_elements.meshes import triangles
from pw_elements.spaces import AssemblyRecord
from tests.contact.cases import BlockOnFloor, ElasticBody, PunchedBlock, on_plane
from tests.contact.two_bodies import StackedBlocks
from tests.oracle.random_contact import make_problem

# -- stiffness and surface -------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_a_surface_with_an_edge_is_refused(cell):
    stack = StackedBlocks((3, 2), cell)
    is_lower, is_on_top = stack.x[:, stack.up] < 1 + 1e-9, np.isclose(stack.x[:, stack.up], 1.0)
    nodes = is_lower & ~stack.side_node_mask("upper") & (is_on_top | np.isclose(stack.x[:, 0], 1.0))
    pair = ContactPair(nodes, DeformableSurface(stack.sides["upper"]))
    with pytest.raises(ValueError, match=r"has an edge at .*1\)"):
        stack.contact_problem(pair)


def test_revolved_has_to_be_given_and_to_agree_with_the_stiffness():
    stack = StackedBlocks((3, 2), state="axisymmetric")
    no_supports, pair = stack.make_supports(), stack.make_pair()
    with pytest.raises(ValueError, match="give DeformableSurface"):
        ContactProblem(AssemblyRecord().attach(stack.K.copy()), no_supports, pair, stack.space)
    pair = ContactPair(pair.nodes, DeformableSurface(pair.surface.where, revolved=False))
    with pytest.raises(ValueError, match="the stiffness is one in axisymmetric"):
        stack.contact_problem(pair)


def test_a_stiffness_that_is_scaled_between_steps_is_noticed():
    block = BlockOnFloor(8)
    problem = block.contact_problem(block.floor_pair(0.3))
    problem.step(problem.undeformed, block.pressure_load)
    block.K.scale(3.0)
    state = problem.step(problem.undeformed, block.pressure_load)
    (reference,) = block.solve_contact(block.floor_pair(0.3), loads=block.pressure_load)
    assert np.abs(state.displacement.array - reference.displacement.array).max() < 1e-12
    assert state.residuals.largest() < 1e-9


# -- diagnostics -----------------------------------------------------------------------------------


def test_a_slave_node_on_the_axis_neither_sticks_nor_slips():
    """The status of a slave node on the axis of revolution is "held", neither stick nor slip.

    The slip at this node is not zero, because it is a weighted mean that contains the slip of its
    neighbours.
    """
    stack = StackedBlocks((4, 3), state="axisymmetric", modulus_ratio=30.0)
    supports, load = (
        stack.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, 0.0))),
        stack.traction_load((0.0, -0.01)),
    )
    (state,) = stack.solve_contact(stack.make_pair(friction=5.0), supports, load)
    (pair,) = state.pairs
    on_axis = np.isclose(pair.position[:, 0], 0.0)
    assert np.array_equal(pair.status == HELD, on_axis)
    largest = np.abs(state.displacement.array).max()
    assert np.abs(pair.displacement[on_axis, 0]).max() > 1e-6 * largest
    assert np.allclose(pair.slip[on_axis, 0], pair.displacement[on_axis, 0])
    assert np.abs(pair.displacement[pair.status == STICK, 0]).max() < 1e-9 * largest


def test_residuals_of_two_bodies_that_stick_are_round_off(caplog):
    """The residuals of two bodies that stick to each other are at the level of round-off.

    The reason is that lengths are divided by the displacements of the bodies and not by the small
    difference of these displacements.
    """
    caplog.set_level(logging.INFO)
    stack = StackedBlocks((3, 2))
    pair, load = stack.make_pair(friction=10.0), stack.traction_load((0.0, -0.01))
    (state,) = stack.solve_contact(
        pair, stack.make_clamping_supports(on_plane(1, 0.0)), load, solver=Iterative()
    )
    assert set(state.pairs[0].status) == {STICK}
    assert state.residuals.largest() < 1e-8


@pytest.fixture(scope="module")
def increment_solution_and_start():
    """Return the equations of a contact increment, its solution and its start state.

    The solution has open, sticking and slipping nodes.
    """
    punch = PunchedBlock()
    problem = punch.contact_problem(punch.punch_pair(0.6), punch.base_supports)
    stepping, motion = problem._small_strain_stepping, Motion((0.02, None), (0, -217.3))
    start = problem.undeformed
    target = TargetLoadsAndMotions.from_load_and_motions(
        punch.zero_load, [motion], n_motions_per_surface=2
    )
    increment, kinematics = stepping._make_equations_and_kinematics(start, target)
    linearised = stepping._check_and_linearise_initial_kinematics(
        increment, kinematics, start, target
    )
    rigid = stepping._cached_system_and_rigid_motions(target.free_motions)[1]
    solution = solve_increment(
        increment,
        choose_first_active_set(
            stepping.interface,
            linearised,
            start,
            rigid.describe_free_rigid_motions,
            target,
        ),
        linearised,
        stepping._make_active_set_update(rigid, "rough"),
        max_iterations=50,
        after_iteration=lambda *_: None,
    )
    return increment, solution, start


def law_violation_over_tolerance(increment, newton_state):
    """Return the contact law's largest violation in a Newton state, divided by its tolerance."""
    largest_force, of_displacements, of_coordinates = (
        increment._max_contact_force_and_round_off_forces(
            newton_state.force, newton_state.displacement_size, newton_state.kinematics.torque_map
        )
    )
    allowed = MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * largest_force + of_displacements
    return increment.max_residual_to_tolerance_ratio(newton_state, allowed, of_coordinates)


@pytest.mark.parametrize("name", [field.name for field in fields(Residuals) if field.name != "law"])
def test_no_state_is_accepted_that_its_residuals_reject(increment_solution_and_start, name):
    """The iteration accepts no state that would be rejected because of its residuals.

    Each condition is violated alone. The iteration rejects violations by 1e-7 of the largest force
    and accepts those by 1e-10.
    """
    increment, solution, start = increment_solution_and_start
    contact = solution.nodes
    status, largest = contact.active_set.status, np.abs(solution.force).max()
    node_of_status = {kind: np.flatnonzero(status == kind)[0] for kind in (OPEN, STICK, SLIP)}
    for relative_error in (1e-7, 1e-10):
        error, disturbed = relative_error * largest, solution
        force, gap, slip = contact.force.copy(), contact.gap.copy(), contact.slip.copy()
        if name == "equilibrium":
            disturbed = replace(solution, unbalanced=np.array([error]))
        elif name == "balance":
            unbalanced_force = solution.force.copy()
            unbalanced_force[node_of_status[OPEN], 1] += error
            disturbed = replace(solution, force=unbalanced_force)
        elif name in ("penetration", "stick"):
            values = gap if name == "penetration" else slip[:, 0]
            values[node_of_status[STICK]] -= error / contact.scale[node_of_status[STICK]]
        elif name in ("tension", "complementarity"):
            force[node_of_status[OPEN], 0] += error if name == "complementarity" else -error
        else:
            sign = np.sign(force[node_of_status[SLIP], 1]) * (1 if name == "cone" else -1)
            force[node_of_status[SLIP], 1] += sign * error
        if disturbed is solution:
            disturbed = replace(solution, nodes=replace(contact, force=force, gap=gap, slip=slip))
        _, force_size, length_size = increment.updated_scale_and_reference_force_and_length(
            disturbed, start.scale
        )
        residuals = increment.largest_residuals(disturbed, force_size, length_size)
        assert (law_violation_over_tolerance(increment, disturbed) <= 1) == (
            relative_error == 1e-10
        )
        assert getattr(residuals, name) > relative_error / 100
    assert law_violation_over_tolerance(increment, solution) <= 1


@pytest.mark.parametrize(("load_ratio", "is_unique"), [(0.9, True), (1.0, False)])
def test_a_block_pulled_at_the_friction_limit_is_not_unique(load_ratio, is_unique):
    """The state of a block that is pulled at the friction limit is not unique.

    At the limit the block may slide by any distance. At 0.9 times the limit, its state is unique.
    """
    block = BlockOnFloor(8)
    states = block.solve(0.3, load_ratio * 120.0, n_pull_increments=1, frictionless_end_length=0.0)
    assert states[-1].unique is is_unique


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_ball_released_to_zero_force_just_touches(mu):
    """A ball that is released to zero force just touches the body.

    The iteration needs no fallback, because it starts from touching nodes. It would need one if it
    started from the last active set.
    """
    body = ElasticBody(triangles(MPI.COMM_SELF, (-2.0, 0.0), (2.0, 2.0), (9, 4)))
    motions = [Motion((0, None), (0, force)) for force in (-300.0, -20.0, 0.0)]
    pair = ContactPair(on_plane(1, 2.0), Sphere((0.37, 7.0), 5.0), mu, motions)
    states = body.solve_contact(pair, body.make_clamping_supports(on_plane(1, 0.0)), remedies=())
    assert states[-1].displacement.norm() < 1e-12 * states[0].displacement.norm()
    assert states[-1].pairs[0].gap.min() == pytest.approx(0.0, abs=1e-12)
    assert states[-1].residuals.largest() < 1e-9


def test_a_refusal_names_the_fallbacks_and_the_part_that_was_reached(caplog):
    with caplog.at_level("INFO", "pw_elements.contact"), pytest.raises(SolutionNotFound) as caught:
        make_problem(104).solve()
    for remedy in ("by springs", "in parts"):
        assert f"{remedy}, at the cost of at most 150 linear systems" in caplog.text
    fraction, state = caught.value.last_substate
    assert f"Substeps reached {fraction} of the increment" in str(caught.value)
    assert fraction == 0.5
    assert state.converged
    assert state.residuals.largest() < 1e-9


def test_a_fallback_costs_at_most_its_multiple_of_the_first_attempt(monkeypatch):
    """A fallback may cost at most a given multiple of the work of the first attempt.

    Only a substep that has already begun may exceed this budget.
    """
    budgets, remaining_budgets = [], []
    budget = SmallStrainStepping._make_remaining_solves_counter

    def record_budget(stepping, remedy, free):
        remaining_budgets.extend(
            remaining() for remaining, _ in budgets[-1:]
        )  # the unused part of the preceding fallback's budget
        remaining = budget(stepping, remedy, free)
        budgets.append((remaining, remaining()))
        return remaining

    monkeypatch.setattr(SmallStrainStepping, "_make_remaining_solves_counter", record_budget)
    for multiple in (0.1, 3.0):
        budgets.clear()
        remaining_budgets.clear()
        with pytest.raises(SolutionNotFound):
            make_problem(93).solve(remedies={"springs": multiple, "cutback": multiple})
        remaining_budgets.append(budgets[-1][0]())
        assert [initial_budget for _, initial_budget in budgets] == [50 * multiple] * 2
        assert all(end > -0.5 * 50 * multiple - 10 for end in remaining_budgets)
