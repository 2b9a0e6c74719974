"""Two deformable bodies at large sliding: kernel, objectivity, balance, friction, restart."""

import itertools
import logging
from dataclasses import replace

import numpy as np
import pytest
import ufl

from pw_elements import Iterative, Spaces, prescribe
from pw_elements.contact import (
    OPEN,
    SLIP,
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    NotFound,
    SurfacePassed,
)
from pw_elements.contact.interface import SlidingMortar, Trace
from pw_elements.contact.steps import finite
from pw_elements.contact.steps.smallness import SlipCheck
from tests.contact.cases import on_plane
from tests.contact.sliding import (
    DIE_PATH,
    STORED_INCREMENT,
    SlidingBodies,
    kernel_check_differences,
    make_die_on_block,
    mesh_of_two_rectangles,
    mortar_positions_in_states,
    slide_along_path,
)

FRICTION = 0.3


def arc(n, curve, first, outward):
    """A curve over [-1, 1] of n quadratic facets."""
    s = np.linspace(-1, 1, 2 * n + 1)
    x = np.stack([s, curve(s)], axis=1)
    node = 2 * np.arange(n)[:, None] + [0, 2, 1]
    return Trace(node + first, x[node], np.tile([0.0, outward], (n, 1)))


def sides(revolved):
    one = arc(5, lambda s: 0.1 * s**2 + 0.01, 0, -1.0)
    other = arc(4, lambda s: 0.08 * np.sin(3 * s), 100, 1.0)
    mortar, rng = SlidingMortar(one, other, revolved), np.random.default_rng(3)
    moved = np.where(np.arange(len(mortar.x)) < mortar.n_slave_nodes, 0.0, 0.33)[:, None] * [1, 0]
    return mortar, mortar.x + moved + [2.0, 0.0] + rng.normal(size=mortar.x.shape) * 0.004


def turn(degrees):
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("revolved", [False, True])
def test_derivatives_are_those_of_central_differences(revolved):
    mortar, x = sides(revolved)
    met, h = mortar.linearise(x), 1e-6
    force = np.random.default_rng(5).normal(size=(mortar.n_slave_nodes, 2))
    assert 0 < met.faced.sum() < len(met.faced)
    assert np.abs(met.master_fractions.sum(axis=1) - met.faced).max() < 1e-13
    before = x + np.random.default_rng(7).normal(size=x.shape) * 0.01
    before[: mortar.n_slave_nodes] -= [0.3, 0.0]  # so that some face something only now
    reference = mortar.make_reference(before)
    assert (met.faced & ~reference.faced).any()
    assert (met.faced & reference.faced).any()

    def quantities(x):
        met = mortar.linearise(x)
        angles = np.arctan2(met.normals[:, 1], met.normals[:, 0])
        slip, _ = met.measure_slip_and_rates(reference, x)
        return [
            (met.master_fractions.T @ force).ravel(),
            met.mean_distance.ravel(),
            met.gaps,
            slip,
            angles,
        ]

    known = [
        met.differentiate_master_forces(force),
        met.distance_rate,
        *met.measure_slip_and_rates(reference, x)[1],
    ]
    for k in range(x.size):
        step = h * np.eye(x.size)[k].reshape(x.shape)
        ends = [quantities(x + sign * step) for sign in (1, -1)]
        for slope, ahead, behind in zip(known, *ends, strict=True):
            column = slope.toarray()[:, k]
            assert np.abs((ahead - behind) / (2 * h) - column).max() < 1e-7 * abs(slope).max()


@pytest.mark.parametrize("revolved", [False, True])
@pytest.mark.parametrize("at_ends", [(True, True), (False, True), (True, False)])
@pytest.mark.parametrize("seed", range(5))
def test_checks_measure_what_the_kernel_does(revolved, at_ends, seed):
    """On disturbed sides that shift and turn; normals of ends may lie in planes of symmetry."""
    mortar, x = sides(revolved)
    ends = np.setxor1d(*mortar.sides.slave_facets.T)
    mortar.allowed_components[ends[0]], mortar.allowed_components[ends[1], 0] = (
        at_ends,
        seed % 2 == 0,
    )
    rng = np.random.default_rng(seed)
    slaves = (np.arange(len(x)) < mortar.n_slave_nodes)[:, None]
    before = x + rng.normal(size=x.shape) * 0.01 + slaves * rng.uniform(-0.6, 0.6, 2) * [1.0, 0.1]
    if not revolved:
        before = before @ turn(rng.uniform(0, 360)).T
    for start, end in ((x, before), (before, x), (x, x)):
        assert max(kernel_check_differences(mortar, start, end).values()) < 1e-12
    assert mortar.linearise(x).faced.any()


@pytest.mark.parametrize("degrees", [90, 170])
def test_a_rigid_motion_of_both_is_no_slip(degrees):
    """Operators are those from before, so that what was paired stays together."""
    mortar, x = sides(False)
    end = x @ turn(degrees).T + [3.0, -2.0]
    start, met = mortar.make_reference(x), mortar.linearise(end)
    assert abs(met.distance_rows - start.distance_rows).max() < 1e-13
    # nor of what faces nothing at first, wherever it was
    none = replace(start, distance_rows=0.0 * start.distance_rows, faced=np.zeros_like(start.faced))
    for reference in (start, none):
        assert np.abs(met.measure_slip_and_rates(reference, end)[0]).max() < 1e-13


def test_linear_fields_are_handed_on_and_seen_exactly():
    """On straight sides: of any meshes, covered in part as well."""
    one = arc(5, lambda s: 0.02 + 0.0 * s, 0, -1.0)
    other = arc(3, lambda s: 0.0 * s, 100, 1.0)
    mortar = SlidingMortar(one, other, False)
    x = mortar.x + np.where(np.arange(len(mortar.x)) < mortar.n_slave_nodes, 0.0, 0.31)[:, None] * [
        1,
        0,
    ]
    met = mortar.linearise(x)
    linear = x[:, 0] * 3 - 1
    assert np.abs((met.distance_rows @ linear)[met.faced]).max() < 1e-12
    assert np.abs(met.gaps[met.faced] - 0.02).max() < 1e-13


@pytest.fixture(scope="module")
def whole():
    """The die, its states along the path, and increments and violations of their iterations."""
    violations = []

    def told(progress):
        if progress.state is None:
            violations.append((progress.increment, progress.violation * 1e-9))

    bodies = make_die_on_block(friction=FRICTION, callback=told)
    return bodies, slide_along_path(bodies), tuple(violations)


def test_checks_of_states_measure_what_the_iteration_does(whole):
    bodies, states, _ = whole
    mortar, positions = mortar_positions_in_states(bodies, states)
    for start, end in itertools.pairwise([mortar.x, *positions]):
        assert max(kernel_check_differences(mortar, start, end).values()) < 1e-10


@pytest.mark.parametrize("revolved", [False, True])
def test_checks_of_bodies_cut_by_a_plane_of_symmetry_measure_what_the_iteration_does(revolved):
    """Half of a die; normals at the end of its side lie in the plane, areas may be revolved."""

    def bottom(x):
        return 0.01 + 0.6 * x**2

    def shape(x, y, body):
        return (x, y) if body == 0 else (x, bottom(x) + y * (1 - bottom(x)))

    def under(x):
        return (x[0] < 0.5 + 1e-9) & (x[1] > 0.005) & (np.abs(x[1] - bottom(x[0])) < 0.02)

    boxes = ((0.0, -1.0), (1.5, 0.0)), ((0.0, 0.0), (0.5, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, ((8, 3), (5, 3)), shape)
    half = SlidingBodies(
        mesh, under, on_plane(1, 0.0), on_plane(1, -1.0), on_plane(1, 1.0), FRICTION
    )
    held = [*half.conditions, prescribe(half.space, 0, on_plane(0, 0.0))]
    surface = replace(half.pair.surface, revolved=revolved)
    pair = replace(half.pair, surface=surface)
    half.problem = ContactProblem.of_residual(half.residual, half.u, held, pair)
    states = slide_along_path(half, [(0.0, -0.05), (0.0, -0.12), (0.0, -0.04)])
    mortar, positions = mortar_positions_in_states(half, states)
    assert not mortar.allowed_components.all()
    for start, end in itertools.pairwise([mortar.x, *positions]):
        assert max(kernel_check_differences(mortar, start, end).values()) < 1e-10


def cone(state):
    """How far friction is from mu p where nodes slip, and beyond it where they stick."""
    (pair,) = state.pairs
    limit = FRICTION * pair.force_normal
    size = np.linalg.norm(pair.force_tangential, axis=1)
    away = np.where(pair.status == SLIP, np.abs(size - limit), size - limit)
    return away.max() / np.abs(pair.force_vector).max()


def test_a_die_slides_over_its_element_and_more(whole):
    """Forces balance, the cone holds node by node, and Newton's method ends quadratically."""
    _, states, violations = whole
    for k, state in enumerate(states):
        (pair,) = state.pairs
        size = np.abs(pair.force).max()
        assert np.abs(pair.opposite_force.sum(axis=0) + pair.force).max() < 1e-12 * size
        assert cone(state) < 1e-8
        before, last = [v for increment, v in violations if increment == k][-2:]
        assert last < max(1e-11, 1e3 * before**2)
    assert np.abs(states[-1].pairs[0].slip).max() > 0.1


def flat_punch(divisions):
    """A flat block as the slave, under a punch that is narrower; both are rough."""
    boxes = ((-1.5, -1.0), (1.5, 0.0)), ((-0.5, 0.01), (0.5, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, ((divisions, 4), (4, 4)), lambda x, y, _: (x, y))
    return SlidingBodies(
        mesh, *(on_plane(1, height) for height in (0.0, 0.01, -1.0, 1.0)), friction=0.8
    )


@pytest.mark.parametrize(("divisions", "last"), [(6, 0.75), (12, 0.5)])
def test_nodes_that_come_to_face_the_end_of_the_master_slip_as_it_does(divisions, last):
    """The block sticks to the punch: pressed at once or in equal pieces, shears are the same."""
    shears = []
    for pieces in (1, 2, 4):
        bodies = flat_punch(divisions)
        path = [(0.0, -0.11 * (k + 1) / pieces) for k in range(pieces)]
        (pair,) = slide_along_path(bodies, path)[-1].pairs
        closed = pair.status != OPEN
        assert np.abs(pair.position[closed, 0]).max() == pytest.approx(last)
        assert np.abs(pair.slip).max() < 1e-3  # half a facet is .125
        right = closed & (pair.position[:, 0] > 0.2)
        assert (pair.force_tangential[right, 0] > 0).all()  # none pushes against the others
        shears.append(pair.force_tangential[:, 0] / pair.force[1])
    assert np.abs(shears[1] - shears[0]).max() < 1e-5
    assert np.abs(shears[2] - shears[1]).max() < 1e-5


def test_nothing_is_faced_beyond_the_place_where_normals_meet():
    """A hollow side, far away and to the side of the other one, whose normals do not meet it."""
    one = arc(5, lambda s: 0.6 * s**2 + 0.01, 0, -1.0)
    other = arc(4, lambda s: 0.0 * s, 100, 1.0)
    mortar = SlidingMortar(one, other, False)
    for shift in np.stack(np.meshgrid([-5.0, -3.2, 3.2, 5.0], [-0.3, -0.1, 0.2]), -1).reshape(
        -1, 2
    ):
        x = (
            mortar.x
            + np.where(np.arange(len(mortar.x)) < mortar.n_slave_nodes, 1.0, 0.0)[:, None] * shift
        )
        assert not mortar.linearise(x).faced.any()


@pytest.mark.parametrize("upper_is_slave", [True, False])
def test_a_die_slides_off_its_block(upper_is_slave):
    """It ends as a body without any force, though it has moved by more than its size."""
    bodies = make_die_on_block(friction=FRICTION, upper_is_slave=upper_is_slave)
    path = [(0.0, -0.12), *((0.4 * k, -0.12) for k in range(1, 8))]
    states = slide_along_path(bodies, path)
    ordinary = max(state.iterations for state in states[:5])
    for state, end in zip(states[6:], path[6:], strict=True):
        (pair,) = state.pairs
        assert state.iterations <= 3 * ordinary
        assert np.abs(pair.force_vector).max() < 1e-12
        assert (pair.status == OPEN).all()
        assert np.abs(pair.displacement - np.array(end) * upper_is_slave).max() < 1e-9


def test_slip_is_that_of_the_path(whole, caplog):
    """Of material points, by other formulas; what is told where slip is lost."""
    bodies, states, _ = whole
    for state in states[2:]:
        (pair,) = state.pairs
        apart = np.linalg.norm(pair.slip - pair.path_slip, axis=1)
        size = np.linalg.norm(pair.path_slip, axis=1)
        moved = size > 0.01
        assert moved.sum() > 5
        assert (apart < 0.06 * size)[moved].all()
    check = SlipCheck(bodies.problem._finite.interface)
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        check.log_differences(states[-1])
        assert not caplog.records
        (pair,) = states[-1].pairs
        lost = replace(states[-1], pairs=(replace(pair, slip=0 * pair.slip),))
        check.log_differences(lost)
        check.log_differences(lost)
    (record,) = caplog.records
    assert record.getMessage().startswith("increment 3, contact pair 0: slip differs")
    smooth = replace(pair, slip=0 * pair.slip, friction=0 * pair.friction)
    SlipCheck(bodies.problem._finite.interface).log_differences(replace(lost, pairs=(smooth,)))
    assert len(caplog.records) == 1


def test_slip_from_the_closest_point_is_refused_and_would_be_told(caplog, monkeypatch):
    """Of nodes beyond the master's end, which a mean over the covered part is not next to."""
    make_reference = SlidingMortar.make_reference

    def by_closest_points(mortar, x):
        reference = make_reference(mortar, x)
        ends, parts = mortar._find_closest_points(x)
        rows = reference.distance_rows.tolil()
        for j in np.flatnonzero(~reference.faced):
            rows[j, j], rows[j, ends[j]] = 1.0, -parts[j]
        return replace(reference, distance_rows=rows.tocsr(), faced=np.ones_like(reference.faced))

    monkeypatch.setattr(SlidingMortar, "make_reference", by_closest_points)
    with pytest.raises(NotFound, match="computed anew"):
        slide_along_path(flat_punch(6), [(0.0, -0.11)])
    monkeypatch.setattr(finite, "verify_state", lambda found, *_: found)
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        slide_along_path(flat_punch(6), [(0.0, -0.11)])
    (record,) = caplog.records
    assert "by up to 0.25" in record.getMessage()
    assert "at 2 contact nodes" in record.getMessage()


@pytest.mark.parametrize("upper_is_slave", [True, False])
@pytest.mark.parametrize("path", [[(0.0, -3.0)], [(0.0, -0.12), (0.1, -3.0)]])
def test_bodies_are_not_driven_through_each_other(upper_is_slave, path):
    """Without any linear system, where supports are led past each other; beside them they may."""
    solved = []
    bodies = make_die_on_block(upper_is_slave=upper_is_slave, callback=solved.append)
    start = slide_along_path(bodies, path[:-1])
    start = start[-1] if start else bodies.problem.undeformed
    del solved[:]
    with pytest.raises(SurfacePassed, match="pass each other by 1: the bodies are driven through"):
        bodies.problem.step(
            start, lambda share: bodies.prescribe_base_and_top(share * np.array(path[-1]), 0.0)
        )
    assert not solved


def test_a_body_that_goes_down_beside_another_one_is_not_driven_through_it():
    bodies = make_die_on_block()
    above, beside = slide_along_path(bodies, [(3.0, 0.0), (3.0, -3.0)])
    assert not above.substates
    assert np.abs(beside.pairs[0].displacement - [3.0, -3.0]).max() < 1e-12


def test_depth_of_what_goes_through_a_side():
    """Between its ends only, and of what was outside at first."""
    one = arc(5, lambda s: 0.02 + 0.0 * s, 0, -1.0)
    other = arc(3, lambda s: 0.0 * s, 100, 1.0)
    mortar = SlidingMortar(one, other, False)
    slaves = (np.arange(len(mortar.x)) < mortar.n_slave_nodes)[:, None]
    down, beside = mortar.x - slaves * [0.0, 0.52], mortar.x + slaves * [2.5, 0.0]
    depth = mortar.measure_penetration(mortar.x, down)
    assert depth[1:-1] == pytest.approx(0.5)
    assert not mortar.measure_penetration(beside, beside - slaves * [0.0, 0.52]).any()
    assert not mortar.measure_penetration(down, down).any()
    passed = mortar.measure_penetration(mortar.x, mortar.x - slaves * [0.0, 3.0])
    assert passed[mortar.x[: mortar.n_slave_nodes, 0] == 0.0] == pytest.approx(2.98)


def test_both_sides_may_be_the_slave(whole):
    """Resultants are those of the exchanged sides, to the accuracy of the mesh."""
    ways = whole[1], slide_along_path(make_die_on_block(upper_is_slave=False))
    forces = [states[-1].pairs[0].force for states in ways]
    assert np.abs(forces[0] + forces[1]).max() < 0.03 * np.abs(forces[0]).max()


def test_a_turned_problem_has_turned_forces(whole):
    (mine,), (theirs,) = (
        whole[1][2].pairs,
        slide_along_path(make_die_on_block(rotation_degrees=90.0), DIE_PATH[:3])[-1].pairs,
    )
    size = np.abs(mine.force_vector).max()
    assert np.abs(np.sort(mine.force_normal) - np.sort(theirs.force_normal)).max() < 1e-9 * size
    assert np.abs(mine.force @ turn(90.0).T - theirs.force).max() < 1e-9 * size


def test_a_way_that_is_resumed_is_the_way(whole, tmp_path):
    bodies, states, _ = whole
    bodies.problem.save(states[STORED_INCREMENT], tmp_path / "state.npz")
    read = bodies.problem.load(tmp_path / "state.npz")
    (pair,), (known,) = (
        slide_along_path(bodies, DIE_PATH[STORED_INCREMENT + 1 :], read)[-1].pairs,
        states[-1].pairs,
    )
    for name in ("force_vector", "opposite_force", "slip"):
        values = getattr(known, name)
        assert np.abs(getattr(pair, name) - values).max() < 1e-12 * np.abs(values).max()


def test_fields_have_pressures_and_forces_of_both_sides(whole):
    bodies, states, _ = whole
    fields = ContactFields.from_state(states[0], bodies.body)
    fields.fill(states[-1])
    (pair,) = states[-1].pairs
    forces = fields.force.x.array.reshape(-1, 2)
    assert np.abs(forces[pair.opposite_node] - pair.opposite_force).max() < 1e-15
    closed = pair.status > 0
    own, theirs = (
        fields.pressure.x.array[node] for node in (pair.node[closed], pair.opposite_node)
    )
    assert (own > 0).all()
    pressed = theirs > 0.1 * np.nanmax(theirs)
    assert 3 < pressed.sum() < len(theirs)
    assert np.nanmax(theirs) < 1.1 * own.max()
    (other,) = fields.opposite
    seen = other.results(pair)
    assert 0 < seen.tension_ratio < 0.1
    assert seen.tension_ratio == -seen.normal_force.min() / seen.normal_force.max()
    true = fields.true_pressure.x.array[pair.opposite_node][pressed]
    assert np.abs(true / theirs[pressed] - 1).max() < 0.2
    again = ContactFields.from_state(states[-1], bodies.body)
    for one, same in zip(fields.functions(), again.functions(), strict=True):
        assert np.array_equal(one.x.array, same.x.array, equal_nan=True), one.name


def test_an_even_pressure_arrives_as_it_is():
    """Two blocks between smooth walls, the lower one wider: meshes do not match, forces do."""
    mesh = mesh_of_two_rectangles(
        ((0, 0), (1, 0.5)), ((0, 0.51), (1, 1)), ((7, 2), (5, 2)), lambda x, y, _: (x, y)
    )

    walled = SlidingBodies(mesh, *(on_plane(1, height) for height in (0.51, 0.5, 0.0, 1.0)), 0.0)
    walls = prescribe(walled.space, 0, lambda x: np.isclose(x[0] * (1 - x[0]), 0))
    problem = ContactProblem.of_residual(
        walled.residual, walled.u, [*walled.conditions, walls], walled.pair
    )
    state = problem.step(
        problem.undeformed, lambda share: walled.prescribe_base_and_top((0, -0.1 * share), 0)
    )
    fields = ContactFields.from_state(state, walled.body)
    (pair,) = state.pairs
    both = np.concatenate([pair.node, pair.opposite_node])
    for function in (fields.pressure, fields.true_pressure, fields.tributary_pressure):
        values = function.x.array[both]
        assert np.ptp(values) < 1e-9 * values.max()
    assert abs(fields.pressure.x.array[both[0]] - pair.force[1]) < 1e-9 * pair.force[1]


def refusals():
    bodies = make_die_on_block()
    surface = bodies.pair.surface
    galerkin = Spaces.galerkin(bodies.space.mesh)
    standard = ufl.replace(
        bodies.residual, {bodies.residual.arguments()[0]: ufl.TestFunction(galerkin.test)}
    )
    unknown = DeformableSurface(surface.where)
    coincident = replace(surface, coincident=True)
    nowhere = replace(bodies.pair, nodes=lambda x: np.zeros(x.shape[1], dtype=bool))
    return [
        (bodies.residual, nowhere, "pair 0 has no nodes: its marker holds nowhere"),
        (standard, bodies.pair, "piecewise-linear weights"),
        (bodies.residual, replace(bodies.pair, surface=unknown), "revolved=True or False"),
        (bodies.residual, replace(bodies.pair, surface=coincident), "plane and in axisymmetry"),
    ], bodies


def test_what_is_not_supported_is_refused_in_words():
    (cases, bodies), of = refusals(), ContactProblem.of_residual
    for residual, pair, words in cases:
        with pytest.raises(ValueError, match=words):
            of(residual, bodies.u, bodies.conditions, pair)
    with pytest.raises(ValueError, match="does not serve two bodies"):
        of(bodies.residual, bodies.u, bodies.conditions, bodies.pair, Iterative())
    with pytest.raises(ValueError, match="not free to move"):
        bodies.problem.step(bodies.problem.undeformed, motions=Motion((0.0, None)))
    far = ContactPair(on_plane(1, 1.0), bodies.pair.surface)
    with pytest.raises(ValueError, match="faces the opposite part"):
        of(bodies.residual, bodies.u, bodies.conditions, far)
