"""Two deformable bodies at large sliding: mortar, objectivity, balance, friction, restart."""

import itertools
import logging
from dataclasses import replace

import numpy as np
import pytest
import ufl

from pw_elements import Spaces, prescribe
from pw_elements.contact import (
    OPEN,
    SLIP,
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    SolutionNotFound,
    SurfacePassed,
)
from pw_elements.contact.interface import BoundaryFacets, PlaneSlidingMortar, SlidingMortar
from pw_elements.contact.rescue.smallness import warn_if_slip_and_path_slip_differ
from pw_elements.contact.steps import finite
from tests.contact.cases import on_plane, rotation_matrix
from tests.contact.sliding import (
    DIE_TOP_TRANSLATIONS,
    SAVED_INCREMENT_INDEX,
    SlidingBodies,
    compare_mortar_with_verification,
    make_die_on_block,
    mesh_of_two_rectangles,
    mortar_and_positions_in_states,
    slide_along_path,
)

FRICTION = 0.3


def make_boundary_facets_of_curve(n_facets, curve, first_node, outward_normal_y):
    """Return the quadratic facets of a curve y(x) over the interval [-1, 1]."""
    s = np.linspace(-1, 1, 2 * n_facets + 1)
    x = np.stack([s, curve(s)], axis=1)
    node = 2 * np.arange(n_facets)[:, None] + [0, 2, 1]
    return BoundaryFacets(
        node + first_node, x[node], np.tile([0.0, outward_normal_y], (n_facets, 1))
    )


def make_mortar_and_disturbed_positions(revolved):
    """Return a mortar of two curved sides, and randomly disturbed positions (n, 2) of its nodes."""
    slave_side = make_boundary_facets_of_curve(5, lambda s: 0.1 * s**2 + 0.01, 0, -1.0)
    master_side = make_boundary_facets_of_curve(4, lambda s: 0.08 * np.sin(3 * s), 100, 1.0)
    mortar, rng = PlaneSlidingMortar(slave_side, master_side, revolved), np.random.default_rng(3)
    shift = np.where(np.arange(len(mortar.x)) < mortar.n_slave_nodes, 0.0, 0.33)[:, None] * [1, 0]
    return mortar, mortar.x + shift + [2.0, 0.0] + rng.normal(size=mortar.x.shape) * 0.004


@pytest.mark.parametrize("revolved", [False, True])
def test_mortar_derivatives_agree_with_central_differences(revolved):
    mortar, x = make_mortar_and_disturbed_positions(revolved)
    projected, h = mortar.linearise(x), 1e-6
    force = np.random.default_rng(5).normal(size=(mortar.n_slave_nodes, 2))
    assert 0 < projected.faces_master.sum() < len(projected.faces_master)
    assert np.abs(projected.master_fractions.sum(axis=1) - projected.faces_master).max() < 1e-13
    start_x = x + np.random.default_rng(7).normal(size=x.shape) * 0.01
    start_x[: mortar.n_slave_nodes] -= [0.3, 0.0]  # so that some nodes face nothing at the start
    reference = mortar.make_slip_reference(start_x)
    assert (projected.faces_master & ~reference.is_facing_master).any()
    assert (projected.faces_master & reference.is_facing_master).any()

    def evaluate_mortar_quantities(x):
        projected = mortar.linearise(x)
        angles = np.arctan2(projected.normals[:, 1], projected.normals[:, 0])
        slip, _ = projected.measure_slip_and_motion_derivatives(reference, x)
        return [
            (projected.master_fractions.T @ force).ravel(),
            projected.mean_distance.ravel(),
            projected.gaps,
            slip[:, 0],
            angles,
        ]

    derivatives = [
        projected.differentiate_master_forces(force),
        projected.distance_rate,
        *projected.measure_slip_and_motion_derivatives(reference, x)[1],
    ]
    for k in range(x.size):
        step = h * np.eye(x.size)[k].reshape(x.shape)
        end_values = [evaluate_mortar_quantities(x + sign * step) for sign in (1, -1)]
        for derivative, forward, backward in zip(derivatives, *end_values, strict=True):
            column = derivative.toarray()[:, k]
            assert (
                np.abs((forward - backward) / (2 * h) - column).max() < 1e-7 * abs(derivative).max()
            )


@pytest.mark.parametrize("revolved", [False, True])
@pytest.mark.parametrize("at_ends", [(True, True), (False, True), (True, False)])
@pytest.mark.parametrize("seed", range(5))
def test_the_verification_agrees_with_the_mortar(revolved, at_ends, seed):
    """The independent verification and the mortar compute the same integrals for disturbed sides.

    The sides are shifted and, unless the bodies are axisymmetric, rotated. Normals at the ends of
    the slave may lie in planes of symmetry.
    """
    mortar, x = make_mortar_and_disturbed_positions(revolved)
    end_nodes = np.setxor1d(*mortar.sides.slave_facets.T)
    mortar.allowed_components[end_nodes[0]] = at_ends
    mortar.allowed_components[end_nodes[1], 0] = seed % 2 == 0
    rng = np.random.default_rng(seed)
    is_slave = (np.arange(len(x)) < mortar.n_slave_nodes)[:, None]
    start_x = (
        x + rng.normal(size=x.shape) * 0.01 + is_slave * rng.uniform(-0.6, 0.6, 2) * [1.0, 0.1]
    )
    if not revolved:
        start_x = start_x @ rotation_matrix(np.radians(rng.uniform(0, 360))).T
    for start, end in ((x, start_x), (start_x, x), (x, x)):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < 1e-12
    assert mortar.linearise(x).faces_master.any()


@pytest.mark.parametrize("degrees", [90, 170])
def test_a_rigid_motion_of_both_bodies_is_no_slip(degrees):
    """A rigid motion of both bodies together causes no slip.

    The mortar operators at the end equal those at the start: paired points stay paired.
    """
    mortar, x = make_mortar_and_disturbed_positions(False)
    end = x @ rotation_matrix(np.radians(degrees)).T + [3.0, -2.0]
    start, projected = mortar.make_slip_reference(x), mortar.linearise(end)
    assert abs(projected.distance_rows - start.distance_rows).max() < 1e-13
    # nodes that face nothing at the start do not slip either, wherever they are
    unfaced_start = replace(
        start,
        distance_rows=0.0 * start.distance_rows,
        is_facing_master=np.zeros_like(start.is_facing_master),
    )
    for reference in (start, unfaced_start):
        assert (
            np.abs(projected.measure_slip_and_motion_derivatives(reference, end)[0]).max() < 1e-13
        )


def test_linear_fields_are_transferred_exactly():
    """Linear fields are transferred exactly between the sides of a mortar.

    The sides are straight, have non-matching meshes, and overlap only partly.
    """
    slave_side = make_boundary_facets_of_curve(5, lambda s: 0.02 + 0.0 * s, 0, -1.0)
    master_side = make_boundary_facets_of_curve(3, lambda s: 0.0 * s, 100, 1.0)
    mortar = PlaneSlidingMortar(slave_side, master_side, False)
    shift = np.where(np.arange(len(mortar.x)) < mortar.n_slave_nodes, 0.0, 0.31)
    x = mortar.x + shift[:, None] * [1, 0]
    projected = mortar.linearise(x)
    linear = x[:, 0] * 3 - 1
    assert np.abs((projected.distance_rows @ linear)[projected.faces_master]).max() < 1e-12
    assert np.abs(projected.gaps[projected.faces_master] - 0.02).max() < 1e-13


@pytest.fixture(scope="module")
def die_states_and_violations():
    """Return the die on its block, the states along its path, and the violations in all iterations.

    The violations of the contact law are given as pairs (increment, violation).
    """
    violations = []

    def record_violation(progress):
        if progress.state is None:
            violations.append((progress.increment, progress.violation * 1e-9))

    bodies = make_die_on_block(friction=FRICTION, callback=record_violation)
    return bodies, slide_along_path(bodies), tuple(violations)


def test_the_verification_of_states_agrees_with_the_iteration(die_states_and_violations):
    bodies, states, _ = die_states_and_violations
    mortar, positions = mortar_and_positions_in_states(bodies, states)
    for start, end in itertools.pairwise([mortar.x, *positions]):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < 1e-10


@pytest.mark.parametrize("revolved", [False, True])
def test_the_verification_agrees_for_bodies_cut_by_a_symmetry_plane(revolved):
    """The independent verification and the mortar agree for bodies cut by a plane of symmetry.

    The normal at the end of the die's lower side lies in this plane. The bodies may be
    axisymmetric.
    """

    def die_bottom_height(x):
        return 0.01 + 0.6 * x**2

    def map_node_coordinates(x, y, body_index):
        return (
            (x, y)
            if body_index == 0
            else (x, die_bottom_height(x) + y * (1 - die_bottom_height(x)))
        )

    def on_die_bottom(x):
        return (
            (x[0] < 0.5 + 1e-9) & (x[1] > 0.005) & (np.abs(x[1] - die_bottom_height(x[0])) < 0.02)
        )

    boxes = ((0.0, -1.0), (1.5, 0.0)), ((0.0, 0.0), (0.5, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, ((8, 3), (5, 3)), map_node_coordinates)
    half_die = SlidingBodies(
        mesh, on_die_bottom, on_plane(1, 0.0), on_plane(1, -1.0), on_plane(1, 1.0), FRICTION
    )
    conditions = [*half_die.conditions, prescribe(half_die.space, 0, on_plane(0, 0.0))]
    surface = replace(half_die.pair.surface, revolved=revolved)
    pair = replace(half_die.pair, surface=surface)
    half_die.problem = ContactProblem.of_residual(half_die.residual, half_die.u, conditions, pair)
    states = slide_along_path(half_die, [(0.0, -0.05), (0.0, -0.12), (0.0, -0.04)])
    mortar, positions = mortar_and_positions_in_states(half_die, states)
    assert not mortar.allowed_components.all()
    for start, end in itertools.pairwise([mortar.x, *positions]):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < 1e-10


def relative_friction_law_error(state):
    """Return the largest error of the friction law, relative to the largest nodal force.

    At slipping nodes, the error is the difference between the shear force and the friction limit;
    at other nodes it is the excess of the shear force over this limit.
    """
    (pair,) = state.pairs
    limit = FRICTION * pair.force_normal
    shear = np.linalg.norm(pair.force_tangential, axis=1)
    error = np.where(pair.status == SLIP, np.abs(shear - limit), shear - limit)
    return error.max() / np.abs(pair.force_vector).max()


def test_a_die_slides_by_more_than_an_element(die_states_and_violations):
    """A die slides on a block by more than the length of an element.

    Forces balance, each node obeys the friction law, and Newton's method converges quadratically.
    """
    _, states, violations = die_states_and_violations
    for k, state in enumerate(states):
        (pair,) = state.pairs
        total_force = np.abs(pair.force).max()
        assert np.abs(pair.opposite_force.sum(axis=0) + pair.force).max() < 1e-12 * total_force
        assert relative_friction_law_error(state) < 1e-8
        previous, last_violation = [
            violation for increment, violation in violations if increment == k
        ][-2:]
        assert last_violation < max(1e-11, 1e3 * previous**2)
    assert np.abs(states[-1].pairs[0].slip).max() > 0.1


def make_block_under_narrow_punch(n_block_cells):
    """Return a flat block, the slave, under a narrower punch; there is friction between them."""
    boxes = ((-1.5, -1.0), (1.5, 0.0)), ((-0.5, 0.01), (0.5, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, ((n_block_cells, 4), (4, 4)), lambda x, y, _: (x, y))
    return SlidingBodies(
        mesh, *(on_plane(1, height) for height in (0.0, 0.01, -1.0, 1.0)), friction=0.8
    )


@pytest.mark.parametrize(("divisions", "last_closed_x"), [(6, 0.75), (12, 0.5)])
def test_nodes_that_reach_the_end_of_the_master_slip_with_it(divisions, last_closed_x):
    """Slave nodes that reach the end of the master move together with it, without large slips.

    As the block sticks to the punch, its shear forces do not depend on the number of increments.
    """
    shears = []
    for n_increments in (1, 2, 4):
        bodies = make_block_under_narrow_punch(divisions)
        path = [(0.0, -0.11 * (k + 1) / n_increments) for k in range(n_increments)]
        (pair,) = slide_along_path(bodies, path)[-1].pairs
        is_closed = pair.status != OPEN
        assert np.abs(pair.position[is_closed, 0]).max() == pytest.approx(last_closed_x)
        assert np.abs(pair.slip).max() < 1e-3  # half the length of a facet is 0.125
        is_right = is_closed & (pair.position[:, 0] > 0.2)
        assert (pair.force_tangential[is_right, 0] > 0).all()  # all shears have one sign
        shears.append(pair.force_tangential[:, 0] / pair.force[1])
    assert np.abs(shears[1] - shears[0]).max() < 1e-5
    assert np.abs(shears[2] - shears[1]).max() < 1e-5


def test_nothing_is_faced_beyond_the_point_where_normals_meet():
    """Slave nodes face nothing beyond the point where the normals of their side meet.

    A curved slave side is moved so far away that the other side lies beyond this point.
    """
    slave_side = make_boundary_facets_of_curve(5, lambda s: 0.6 * s**2 + 0.01, 0, -1.0)
    master_side = make_boundary_facets_of_curve(4, lambda s: 0.0 * s, 100, 1.0)
    mortar = PlaneSlidingMortar(slave_side, master_side, False)
    for shift in np.stack(np.meshgrid([-5.0, -3.2, 3.2, 5.0], [-0.3, -0.1, 0.2]), -1).reshape(
        -1, 2
    ):
        x = (
            mortar.x
            + np.where(np.arange(len(mortar.x)) < mortar.n_slave_nodes, 1.0, 0.0)[:, None] * shift
        )
        assert not mortar.linearise(x).faces_master.any()


@pytest.mark.parametrize("upper_is_slave", [True, False])
def test_a_die_slides_off_its_block(upper_is_slave):
    """A die that slides off its block ends without contact forces, where its supports carry it.

    It moves farther than its own width. The last increments take at most three times the usual
    number of iterations.
    """
    bodies = make_die_on_block(friction=FRICTION, upper_is_slave=upper_is_slave)
    path = [(0.0, -0.12), *((0.4 * k, -0.12) for k in range(1, 8))]
    states = slide_along_path(bodies, path)
    usual_iterations = max(state.iterations for state in states[:5])
    for state, end in zip(states[6:], path[6:], strict=True):
        (pair,) = state.pairs
        assert state.iterations <= 3 * usual_iterations
        assert np.abs(pair.force_vector).max() < 1e-12
        assert (pair.status == OPEN).all()
        assert np.abs(pair.displacement - np.array(end) * upper_is_slave).max() < 1e-9


def test_slip_agrees_with_that_of_the_path(die_states_and_violations, caplog):
    """The slip agrees with the slip of material points along the path.

    The two slips are computed by different formulas. If they differ in a pair with friction, a
    warning is logged once.
    """
    bodies, states, _ = die_states_and_violations
    for state in states[2:]:
        (pair,) = state.pairs
        difference = np.linalg.norm(pair.slip - pair.path_slip, axis=1)
        path_length = np.linalg.norm(pair.path_slip, axis=1)
        is_sliding = path_length > 0.01
        assert is_sliding.sum() > 5
        assert (difference < 0.06 * path_length)[is_sliding].all()
    interface, warned_pairs = bodies.problem._large_strain_stepping.interface, set()
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        warn_if_slip_and_path_slip_differ(states[-1], interface, warned_pairs)
        assert not caplog.records
        (pair,) = states[-1].pairs
        state_without_slip = replace(states[-1], pairs=(replace(pair, slip=0 * pair.slip),))
        warn_if_slip_and_path_slip_differ(state_without_slip, interface, warned_pairs)
        warn_if_slip_and_path_slip_differ(state_without_slip, interface, warned_pairs)
    (record,) = caplog.records
    assert record.getMessage().startswith("increment 3, contact pair 0: slip differs")
    frictionless_pair = replace(pair, slip=0 * pair.slip, friction=0 * pair.friction)
    frictionless_state = replace(state_without_slip, pairs=(frictionless_pair,))
    warn_if_slip_and_path_slip_differ(frictionless_state, interface, set())
    assert len(caplog.records) == 1


def test_slip_from_the_closest_point_is_refused_and_would_be_logged(caplog, monkeypatch):
    """The verification refuses slips that are computed from closest points.

    At nodes beyond the end of the master, such a slip differs from the mean slip of the covered
    part. Without the verification, a warning would be logged.
    """
    make_reference = SlidingMortar.make_slip_reference

    def make_reference_by_closest_points(mortar, x):
        reference = make_reference(mortar, x)
        ends, parts = mortar._find_closest_master_points(x)
        rows = reference.distance_rows.tolil()
        for j in np.flatnonzero(~reference.is_facing_master):
            rows[j, j], rows[j, ends[j]] = 1.0, -parts[j]
        return replace(
            reference,
            distance_rows=rows.tocsr(),
            is_facing_master=np.ones_like(reference.is_facing_master),
        )

    monkeypatch.setattr(SlidingMortar, "make_slip_reference", make_reference_by_closest_points)
    with pytest.raises(SolutionNotFound, match="computed anew"):
        slide_along_path(make_block_under_narrow_punch(6), [(0.0, -0.11)])
    monkeypatch.setattr(finite, "verify_state", lambda state, *_, **__: state)
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        slide_along_path(make_block_under_narrow_punch(6), [(0.0, -0.11)])
    (record,) = caplog.records
    assert "by up to 0.25" in record.getMessage()
    assert "at 2 contact nodes" in record.getMessage()


@pytest.mark.parametrize("upper_is_slave", [True, False])
@pytest.mark.parametrize("path", [[(0.0, -3.0)], [(0.0, -0.12), (0.1, -3.0)]])
def test_bodies_driven_through_each_other_are_refused(upper_is_slave, path):
    """Bodies that their supports would drive through each other are refused.

    No linear system is solved before the refusal.
    """
    calls = []
    bodies = make_die_on_block(upper_is_slave=upper_is_slave, callback=calls.append)
    start = slide_along_path(bodies, path[:-1])
    start = start[-1] if start else bodies.problem.undeformed
    del calls[:]
    with pytest.raises(SurfacePassed, match="pass each other by 1: the bodies are driven through"):
        bodies.problem.step(
            start,
            lambda load_factor: bodies.prescribe_base_and_top(
                load_factor * np.array(path[-1]), 0.0
            ),
        )
    assert not calls


def test_a_body_may_move_down_beside_another_one():
    bodies = make_die_on_block()
    state_above, state_beside = slide_along_path(bodies, [(3.0, 0.0), (3.0, -3.0)])
    assert not state_above.substates
    assert np.abs(state_beside.pairs[0].displacement - [3.0, -3.0]).max() < 1e-12


def test_the_depth_of_penetration_is_measured_between_the_ends_of_a_side():
    """The depth of penetration is measured at nodes between the ends of the other side.

    It is zero for nodes that were not outside the other body at the start.
    """
    slave_side = make_boundary_facets_of_curve(5, lambda s: 0.02 + 0.0 * s, 0, -1.0)
    master_side = make_boundary_facets_of_curve(3, lambda s: 0.0 * s, 100, 1.0)
    mortar = PlaneSlidingMortar(slave_side, master_side, False)
    is_slave = (np.arange(len(mortar.x)) < mortar.n_slave_nodes)[:, None]
    lowered_x, shifted_x = mortar.x - is_slave * [0.0, 0.52], mortar.x + is_slave * [2.5, 0.0]
    depth = mortar.measure_max_penetration_along_path(mortar.x, lowered_x)
    assert depth[1:-1] == pytest.approx(0.5)
    assert not mortar.measure_max_penetration_along_path(
        shifted_x, shifted_x - is_slave * [0.0, 0.52]
    ).any()
    assert not mortar.measure_max_penetration_along_path(lowered_x, lowered_x).any()
    depth_behind = mortar.measure_max_penetration_along_path(
        mortar.x, mortar.x - is_slave * [0.0, 3.0]
    )
    assert depth_behind[mortar.x[: mortar.n_slave_nodes, 0] == 0.0] == pytest.approx(2.98)


def test_resultants_agree_if_slave_and_master_are_exchanged(die_states_and_violations):
    """If slave and master are exchanged, the resultant force agrees to the mesh's accuracy, 3 %."""
    histories = (
        die_states_and_violations[1],
        slide_along_path(make_die_on_block(upper_is_slave=False)),
    )
    forces = [states[-1].pairs[0].force for states in histories]
    assert np.abs(forces[0] + forces[1]).max() < 0.03 * np.abs(forces[0]).max()


def test_a_rotated_problem_has_rotated_forces(die_states_and_violations):
    (pair,), (rotated_pair,) = (
        die_states_and_violations[1][2].pairs,
        slide_along_path(make_die_on_block(rotation_degrees=90.0), DIE_TOP_TRANSLATIONS[:3])[
            -1
        ].pairs,
    )
    largest = np.abs(pair.force_vector).max()
    assert (
        np.abs(np.sort(pair.force_normal) - np.sort(rotated_pair.force_normal)).max()
        < 1e-9 * largest
    )
    assert (
        np.abs(pair.force @ rotation_matrix(np.radians(90.0)).T - rotated_pair.force).max()
        < 1e-9 * largest
    )


def test_a_resumed_history_is_the_same_history(die_states_and_violations, tmp_path):
    bodies, states, _ = die_states_and_violations
    bodies.problem.save(states[SAVED_INCREMENT_INDEX], tmp_path / "state.npz")
    loaded_state = bodies.problem.load(tmp_path / "state.npz")
    (pair,), (expected,) = (
        slide_along_path(bodies, DIE_TOP_TRANSLATIONS[SAVED_INCREMENT_INDEX + 1 :], loaded_state)[
            -1
        ].pairs,
        states[-1].pairs,
    )
    for name in ("force_vector", "opposite_force", "slip"):
        values = getattr(expected, name)
        assert np.abs(getattr(pair, name) - values).max() < 1e-12 * np.abs(values).max()


def test_fields_contain_pressures_and_forces_of_both_sides(die_states_and_violations):
    bodies, states, _ = die_states_and_violations
    fields = ContactFields.from_state(states[0], bodies.body)
    fields.fill(states[-1])
    (pair,) = states[-1].pairs
    forces = fields.force.x.array.reshape(-1, 2)
    assert np.abs(forces[pair.opposite_node] - pair.opposite_force).max() < 1e-15
    is_closed = pair.status > 0
    slave_pressure, master_pressure = (
        fields.pressure.x.array[node] for node in (pair.node[is_closed], pair.opposite_node)
    )
    assert (slave_pressure > 0).all()
    is_pressed = master_pressure > 0.1 * np.nanmax(master_pressure)
    assert 3 < is_pressed.sum() < len(master_pressure)
    assert np.nanmax(master_pressure) < 1.1 * slave_pressure.max()
    (master_fields,) = fields.opposite
    master_results = master_fields.results(pair)
    assert 0 < master_results.tension_ratio < 0.1
    assert (
        master_results.tension_ratio
        == -master_results.normal_force.min() / master_results.normal_force.max()
    )
    true_pressure = fields.true_pressure.x.array[pair.opposite_node][is_pressed]
    assert np.abs(true_pressure / master_pressure[is_pressed] - 1).max() < 0.2
    refilled_fields = ContactFields.from_state(states[-1], bodies.body)
    for function, refilled in zip(fields.functions(), refilled_fields.functions(), strict=True):
        assert np.array_equal(function.x.array, refilled.x.array, equal_nan=True), function.name


def test_a_uniform_pressure_is_transferred_exactly():
    """A uniform pressure is transferred exactly between two blocks with non-matching meshes.

    The blocks have the same width and lie between frictionless walls.
    """
    mesh = mesh_of_two_rectangles(
        ((0, 0), (1, 0.5)), ((0, 0.51), (1, 1)), ((7, 2), (5, 2)), lambda x, y, _: (x, y)
    )

    bodies = SlidingBodies(mesh, *(on_plane(1, height) for height in (0.51, 0.5, 0.0, 1.0)), 0.0)
    walls = prescribe(bodies.space, 0, lambda x: np.isclose(x[0] * (1 - x[0]), 0))
    problem = ContactProblem.of_residual(
        bodies.residual, bodies.u, [*bodies.conditions, walls], bodies.pair
    )
    state = problem.step(
        problem.undeformed,
        lambda load_factor: bodies.prescribe_base_and_top((0, -0.1 * load_factor), 0),
    )
    fields = ContactFields.from_state(state, bodies.body)
    (pair,) = state.pairs
    both_sides = np.concatenate([pair.node, pair.opposite_node])
    for function in (fields.pressure, fields.true_pressure, fields.tributary_pressure):
        values = function.x.array[both_sides]
        assert np.ptp(values) < 1e-9 * values.max()
    assert abs(fields.pressure.x.array[both_sides[0]] - pair.force[1]) < 1e-9 * pair.force[1]


def make_invalid_pairs_and_bodies():
    """Return tuples (residual, pair, error message) of pairs to be refused, and the two bodies."""
    bodies = make_die_on_block()
    surface = bodies.pair.surface
    galerkin = Spaces.galerkin(bodies.space.mesh)
    galerkin_residual = ufl.replace(
        bodies.residual, {bodies.residual.arguments()[0]: ufl.TestFunction(galerkin.test)}
    )
    unspecified_surface = DeformableSurface(surface.where)
    coincident = replace(surface, coincident=True)
    empty_pair = replace(bodies.pair, nodes=lambda x: np.zeros(x.shape[1], dtype=bool))
    return [
        (bodies.residual, empty_pair, "pair 0 has no nodes: its marker holds nowhere"),
        (galerkin_residual, bodies.pair, "piecewise-linear weights"),
        (
            bodies.residual,
            replace(bodies.pair, surface=unspecified_surface),
            "revolved=True or False",
        ),
        (bodies.residual, replace(bodies.pair, surface=coincident), "small displacements only"),
    ], bodies


def test_unsupported_pairs_are_refused():
    (cases, bodies), make_problem = make_invalid_pairs_and_bodies(), ContactProblem.of_residual
    for residual, pair, message in cases:
        with pytest.raises(ValueError, match=message):
            make_problem(residual, bodies.u, bodies.conditions, pair)
    with pytest.raises(ValueError, match="cannot have free motions"):
        bodies.problem.step(bodies.problem.undeformed, motions=Motion((0.0, None)))
    distant_pair = ContactPair(on_plane(1, 1.0), bodies.pair.surface)
    with pytest.raises(ValueError, match="faces the opposite part"):
        make_problem(bodies.residual, bodies.u, bodies.conditions, distant_pair)
