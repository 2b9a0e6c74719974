"""Rigid tools that turn: derivatives, poses that are one, torques, restart, refusals."""

import logging
from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_unit_cube

from pw_elements import Iterative, Spaces, prescribe
from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    Sphere,
)
from pw_elements.contact.nodes import (
    DeformedKinematics,
    IncrementStart,
    RigidSurfaceMotion,
    RigidSurfacesOnly,
)
from pw_elements.contact.steps import finite
from tests.contact.cases import BlockOnFloor, finite_strain_residual, on_plane
from tests.contact.test_large import (
    SOLVERS,
    SURFACES,
    RubberUnderCircle,
    collect_pair_fields,
    interface_of_one_surface,
    on_top,
    step_through,
)
from tests.parallel import assert_same

PIVOT = (0.2, 0.5)
PRESSED = Motion((0.0, -0.15), rotation=0.1)
# dragged under a force, and turned by a torque
FREE = Motion((0.1, None), (0.0, -0.3), rotation=None, torque=-0.02)
ROLLER_MOTIONS = [PRESSED, Motion((0.1, -0.2), rotation=-0.1), FREE]
POSE_FIELDS = ("translation", "rotation", "torque")


def make_roller(pivot=PIVOT, mesh=None, friction=0.3, **options):
    """The block of `Rubber` below a circle with a pivot."""
    rubber = RubberUnderCircle(mesh=mesh, friction=friction)
    rubber.problem = rubber.problem_with(options=options, pivot=pivot)
    return rubber


@pytest.mark.parametrize("name", ["plane", "circle", "sphere", "ellipse"])
def test_what_turns_is_linearised_consistently(name):
    surface, rng = SURFACES[name], np.random.default_rng(3)
    dim, m, h = (3 if name == "sphere" else 2), 20, 1e-5
    x = rng.normal(size=(m, dim)) * 0.2 + [*[0.3] * (dim - 1), 1.3]
    axis = (1.0, -2.0, 0.5) if dim == 3 else None
    points = interface_of_one_surface(surface, x, dim)
    pair = ContactPair(on_top, surface, pivot=rng.normal(size=dim), axis=axis)
    surfaces = RigidSurfaceMotion(points, [pair])
    q = np.append(rng.normal(size=dim) * 0.1, 0.7)[None]
    before = np.append(rng.normal(size=dim) * 0.1, 0.5)[None]
    # in the frame of the surface all is near to its place
    starts, ends = (rng.normal(size=(m, dim)) * 0.2 for _ in range(2))
    displacement = surfaces.displacement_of(before, starts)
    start = IncrementStart(displacement, np.zeros((m, dim)), before)
    kinematics = DeformedKinematics(points, surfaces, start, RigidSurfacesOnly())
    a, r = surfaces.displacement_of(q, ends), rng.normal(size=(m, dim))
    here = kinematics.linearise(q, a, r)
    R, w = np.eye(dim) + surfaces.rotation_change(q), here.torque_map.w

    def seen(share, motion, way):
        """Gap, slip and force in the surface's frame, size of the shear, and the torque."""
        there, moved = q + share * motion, a + share * way
        place, turn = kinematics.linearise(there, moved, r), np.eye(dim)
        turn = turn + surfaces.rotation_change(there)
        slip = np.einsum("nta,nt->na", place.frame[:, 1:] @ turn, place.slip)
        parts = place.gap[:, None], slip, place.frame[:, :1] @ turn, r[:, None] @ turn
        sheared = np.linalg.norm(np.einsum("nab,nb->na", place.frame, r)[:, 1:], axis=1)
        torque = place.torque_map.resultants(r)[:, -1]
        return np.column_stack([*(part.reshape(m, -1) for part in parts), sheared, torque])

    motions = [*np.eye(dim + 1), *np.zeros((dim, dim + 1))]
    ways = [*np.zeros((dim + 1, dim)), *np.eye(dim)]
    for motion, way in zip(motions, ways, strict=True):
        way = np.tile(way, (m, 1))
        found = (seen(h, motion, way) - seen(-h, motion, way)) / (2 * h)
        parts = np.split(found, np.cumsum([1, dim, dim, dim, 1]), axis=1)
        gap, slip, normal, force, shear, torque = parts
        known = np.einsum("nab,nb->na", here.motion_by_v, way) + here.motion_by_q @ motion
        assert np.abs(gap[:, 0] - known[:, 0]).max() < 1e-7
        tangents = here.frame[:, 1:] @ R
        assert np.abs(np.einsum("nta,na->nt", tangents, slip) - known[:, 1:]).max() < 1e-7
        # of the pressing component, r being fixed in space
        spun = np.einsum("nba,nb->na", R, w) * motion[-1]
        assert np.abs(force + spun).max() < 1e-7
        own = np.einsum("nb,nba->na", here.frame[:, 0], R), np.einsum("nba,nb->na", R, r)
        pressed = np.sum(normal * own[1] + force * own[0], axis=1)
        turns = np.einsum("nab,nb->na", here.force_by_v, way) + here.force_by_q @ motion
        assert np.abs(pressed - turns[:, 0]).max() < 1e-7
        sheared = np.einsum("nab,nb->na", here.frame, r)[:, 1:]
        along = np.sum(sheared * turns[:, 1:], axis=1) / np.linalg.norm(sheared, axis=1)
        assert np.abs(shear[:, 0] - along).max() < 1e-6
        known = -np.sum(w * (way - motion[:-1]), axis=1)
        assert np.abs(torque[:, 0] - known).max() < 1e-7


def turned(vectors, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[cos, sin], [-sin, cos]])


def test_any_pivot_states_the_same_poses():
    """A turn about one point is a turn about another, and moved; torques differ by F x r."""
    (one,) = step_through(make_roller().problem, [Motion((0.05, -0.15), rotation=0.3)])[-1].pairs
    other, shift = (-0.4, 0.1), np.array([-0.6, -0.4])
    moved = turned(shift, 0.3) - shift + [0.05, -0.15]
    (two,) = step_through(make_roller(pivot=other).problem, [Motion(moved, rotation=0.3)])[-1].pairs
    assert np.abs(one.force_vector - two.force_vector).max() < 1e-10
    assert np.abs(one.slip - two.slip).max() < 1e-10
    arm = shift + two.translation - one.translation
    assert one.torque == pytest.approx(two.torque + np.cross([*arm, 0], [*two.force, 0])[2])
    away = one.position + one.displacement - PIVOT - one.translation
    torque = np.cross(np.pad(away, [(0, 0), (0, 1)]), np.pad(one.force_vector, [(0, 0), (0, 1)]))
    assert one.torque == pytest.approx(torque[:, 2].sum(), rel=1e-12)


def test_a_torque_turns_as_far_as_the_angle_needs():
    """Free angle and height come out as prescribed; Newton's method converges quadratically."""
    seen = []
    rubber = make_roller(callback=lambda progress: seen.append(progress.violation))
    pressed, driven = step_through(rubber.problem, [PRESSED, Motion((0.1, -0.2), rotation=-0.1)])
    (asked,) = driven.pairs
    free = Motion((0.1, None), (0.0, asked.force[1]), rotation=None, torque=float(asked.torque))
    del seen[:]
    found = rubber.problem.step(pressed, motions=free)
    (pair,) = found.pairs
    assert found.free_motions == ((0, 1), (0, 2))
    assert pair.rotation == pytest.approx(-0.1, abs=1e-9)
    assert np.abs(pair.force_vector - asked.force_vector).max() < 1e-9
    assert found.residuals.balance < 1e-9
    before, last = (violation * 1e-9 for violation in seen[-4:-2])
    assert last < 20 * before**2


def test_what_turns_with_its_body_makes_no_slip():
    """Body and tool, turned by a right angle together: forces turn, and all nodes stick."""
    rubber = make_roller()
    base = fem.Function(rubber.space)
    x = rubber.space.tabulate_dof_coordinates()[:, :2]
    nodes = fem.locate_dofs_geometrical(rubber.space, on_plane(1, -1.0))
    held = fem.dirichletbc(base, nodes)
    problem = rubber.problem_with(held, pivot=PIVOT)
    pressed = step_through(problem, [Motion((0.05, -0.15), rotation=0.1)])[-1]
    arm = x - PIVOT - pressed.pairs[0].translation

    def load(share):
        base.x.array[:] = (turned(arm, share * np.pi / 2) - arm).ravel()

    after = problem.step(pressed, load, Motion((0.05, -0.15), rotation=0.1 + np.pi / 2))
    (was,), (now,) = pressed.pairs, after.pairs
    size = np.abs(was.force_vector).max()
    assert np.abs(turned(was.force_vector, np.pi / 2) - now.force_vector).max() < 1e-9 * size
    assert np.abs(now.slip).max() < 1e-10
    assert now.torque == pytest.approx(was.torque, rel=1e-9)


def turned_on(problem, pressed, depth, angle, pieces):
    """The state after a turn that is made in equal increments."""
    ends = angle * np.arange(1, pieces + 1) / pieces
    way = [Motion((0.0, -depth), rotation=end) for end in ends]
    return step_through(problem, way, pressed)[-1]


@pytest.mark.parametrize("angle", [5.0, 6.0, 2 * np.pi, -2 * np.pi, 4 * np.pi])
def test_whole_turns_are_not_forgotten(angle):
    """At once as in equal pieces of a quarter turn at most: friction is that of the last ones."""
    problem = make_roller((0.0, 0.6)).problem
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    pieces = 4 if abs(angle) < 7 else 8
    at_once, in_pieces = (turned_on(problem, pressed, 0.1, angle, count) for count in (1, pieces))
    size = np.abs(in_pieces.pairs[0].force_vector).max()
    apart = at_once.pairs[0].force_vector - in_pieces.pairs[0].force_vector
    assert np.abs(apart).max() < 1e-8 * size
    limit = 0.3 * in_pieces.pairs[0].force_normal.sum() * 0.6
    assert in_pieces.pairs[0].torque == pytest.approx(np.sign(angle) * limit, rel=1e-9)
    closed = at_once.pairs[0].status != OPEN
    slips = np.linalg.norm(at_once.pairs[0].slip[closed], axis=1)
    assert slips == pytest.approx(0.6 * abs(angle), rel=0.05)
    assert len(at_once.substates) >= pieces - 1


def test_a_turn_that_slip_does_not_see_would_be_told(caplog, monkeypatch):
    """The path knows whole turns."""
    problem = make_roller((0.0, 0.6)).problem
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        (pair,) = turned_on(problem, pressed, 0.1, 2 * np.pi, 1).pairs
        assert np.abs(pair.slip - pair.path_slip).max() < 0.01 * np.abs(pair.slip).max()
        assert not caplog.records
        monkeypatch.setattr(finite, "MAX_TURN", np.inf)
        # which would refuse the state, as its own slip has whole turns, too
        monkeypatch.setattr(finite, "verify_state", lambda found, *_: found)
        (pair,) = turned_on(problem, pressed, 0.1, 2 * np.pi, 1).pairs
    closed = pair.status != OPEN
    path = np.linalg.norm(pair.path_slip[closed], axis=1)
    assert path == pytest.approx(2 * np.pi * 0.6, rel=0.05)  # less what eight chords are shorter
    assert np.abs(pair.slip).max() < 1e-12
    (record,) = caplog.records
    assert "slip differs from that of the path by up to" in record.getMessage()


def test_rolling_in_smaller_and_smaller_pieces_converges():
    """A wheel that rolls with 5 % of slip sticks in places: shears depend on the pieces."""
    problem = make_roller((0.0, 0.6), friction=0.9).problem
    pressed = problem.step(problem.undeformed, motions=Motion((-0.4, -0.1)))
    shears = []
    for pieces in (1, 2, 4, 8, 16, 32):
        shares = np.arange(1, pieces + 1) / pieces
        way = [Motion((-0.4 + 0.8 * k, -0.1), rotation=-0.95 * 0.8 / 0.6 * k) for k in shares]
        (pair,) = step_through(problem, way, pressed)[-1].pairs
        shears.append(pair.force_vector / np.abs(pair.force_vector).max())
    apart = [np.abs(one - other).max() for one, other in pairwise(shears)]
    assert apart[0] < 1e-8  # as it is cut in two at once
    assert apart[4] < apart[3] < apart[2] < apart[1]
    assert apart[4] < 0.05


def on_a_turning_base(pivot, angle):
    """The problem of a block, and a load that turns its base about the tool's pivot, .1 deep."""
    rubber = make_roller(pivot)
    base = fem.Function(rubber.space)
    x = rubber.space.tabulate_dof_coordinates()[:, :2]
    held = fem.dirichletbc(base, fem.locate_dofs_geometrical(rubber.space, on_plane(1, -1.0)))
    arm = x - pivot - [0.0, -0.1]

    def load(share):
        base.x.array[:] = (turned(arm, share * angle) - arm).ravel()

    return rubber.problem_with(held, pivot=pivot), load


def test_supports_that_turn_the_body_are_not_forgotten():
    """A body that goes round a tool at rest is as under one that turns the other way."""
    angle, pivot = 2 * np.pi, np.array([0.0, 0.6])
    problem = make_roller(pivot).problem
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    (known,) = turned_on(problem, pressed, 0.1, -angle, 8).pairs
    problem, load = on_a_turning_base(pivot, angle)
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    (pair,) = problem.step(pressed, load, Motion((0.0, -0.1))).pairs
    size = np.abs(known.force_vector).max()
    assert np.abs(pair.force_vector - known.force_vector).max() < 1e-8 * size
    assert abs(pair.force[0]) > 0.2 * abs(pair.force[1])


def test_a_tool_that_torque_turns_too_far_is_cut(monkeypatch):
    """Its angle is known at the end only: no part has more of it than is allowed."""
    problem = make_roller().problem
    pressed = problem.step(problem.undeformed, motions=PRESSED)

    def turns():
        state = problem.step(pressed, motions=FREE)
        ends = [pressed, *(part for _, part in state.substates), state]
        return np.abs(np.diff([float(part.pairs[0].rotation) for part in ends]))

    whole = turns()
    most = 0.6 * whole.max()
    monkeypatch.setattr(finite, "MAX_TURN", most)
    parts = turns()
    assert len(parts) > len(whole)
    assert parts.max() <= most


def ball(friction, **options):
    """A cube on a held base below a sphere that turns about its upright diameter."""
    mesh = create_unit_cube(MPI.COMM_SELF, 2, 2, 2, CellType.tetrahedron)
    pair = Spaces.petrov_galerkin(mesh)
    u, residual = finite_strain_residual(pair)
    held = [prescribe(pair.trial, k, on_plane(2, 0.0)) for k in range(3)]
    top = 0.5, 0.4, 1.8
    pair = ContactPair(on_plane(2, 1.0), Sphere(top, 0.8), friction, pivot=top, axis=(0, 0, 2))
    return ContactProblem.of_residual(residual, u, held, pair, **options)


def test_a_ball_turns_about_an_axis():
    """Without friction nothing happens; with it, the torque turns the ball as far."""
    down = (0.0, 0.0, -0.15)
    smooth = step_through(ball(0.0), [Motion(down), Motion(down, rotation=0.7)])
    still, spun = (state.pairs[0] for state in smooth)
    assert np.abs(still.force_vector - spun.force_vector).max() < 1e-9
    assert abs(spun.torque) < 1e-12
    assert np.abs(spun.slip).max() > 0.1
    assert np.abs(spun.slip - spun.path_slip).max() < 0.03 * np.abs(spun.slip).max()
    rough = ball(0.5)
    pressed, driven = step_through(rough, [Motion(down), Motion(down, rotation=0.05)])
    (pair,) = driven.pairs
    away = pair.position + pair.displacement - [0.5, 0.4, 1.8] - pair.translation
    assert pair.torque == pytest.approx(np.cross(away, pair.force_vector)[:, 2].sum(), rel=1e-12)
    assert pair.torque > 1e-3
    free = Motion(down, rotation=None, torque=float(pair.torque))
    assert rough.step(pressed, motions=free).pairs[0].rotation == pytest.approx(0.05, abs=1e-8)


def rolled(solver):
    """In the plane, where the last motion is free to rise, too."""
    weighted = Motion((0.1, None), (0.0, -0.3), rotation=-0.1)
    return make_roller(solver=solver).problem, [PRESSED, weighted]


def spun(solver):
    """In space, about an upright axis."""
    down = (0.0, 0.0, -0.15)
    return ball(0.5, solver=solver), [Motion(down), Motion(down, rotation=0.05)]


@pytest.mark.parametrize("way", [rolled, spun])
def test_krylov_turns_as_factors_do(way):
    factors, krylov = (
        collect_pair_fields({"end": step_through(*way(solver))[-1]}, POSE_FIELDS)
        for solver in SOLVERS.values()
    )
    assert_same(factors, krylov, 1e-9, way.__name__)
    problem, (pressed, *_) = way(Iterative())
    with pytest.raises(ValueError, match="free to turn"):
        problem.step(problem.undeformed, motions=replace(pressed, rotation=None))


def test_a_state_with_another_pivot_is_refused(tmp_path):
    """Its angle would mean another pose."""
    problem, path = make_roller().problem, tmp_path / "state.npz"
    problem.save(problem.undeformed, path)
    for pivot in ((-0.4, 0.1), None):
        with pytest.raises(ValueError, match="another pivot"):
            make_roller(pivot=pivot).problem.load(path)


def test_an_increment_that_is_cut_turns_in_parts():
    rubber = make_roller(max_iterations=6)
    state = rubber.problem.step(
        rubber.problem.undeformed, motions=Motion((0.0, -0.25), rotation=-1.0)
    )
    assert state.substates
    for share, part in state.substates:
        assert part.pairs[0].rotation == pytest.approx(-share, abs=1e-14)
    assert state.pairs[0].rotation == -1.0


def test_derivatives_of_what_has_turned_are_refused():
    """They would lack the turn of the frame that slip is seen in."""
    problem = make_roller().problem
    (state,) = step_through(problem, [PRESSED])
    with pytest.raises(ValueError, match="has turned"):
        problem.sensitivity([problem.undeformed, state], [("force", 0, 0)], [("friction", 0)])


def test_wrong_pivots_are_refused():
    rubber, block = RubberUnderCircle(), BlockOnFloor(4)
    surface, step = rubber.pair.surface, rubber.problem.step
    for attempt, words in (
        (lambda: ContactPair(on_top, DeformableSurface(on_top), pivot=PIVOT), "are its supports"),
        (lambda: ContactPair(on_top, surface, pivot=(0, 0, 1)), "axis"),
        (lambda: ContactPair(on_top, surface, pivot=PIVOT, axis=(0, 0, 1)), "in space"),
        (lambda: step(rubber.problem.undeformed, motions=PRESSED), "give it a pivot"),
        (
            lambda: rubber.problem_with(pivot=(0, 0, 1), axis=(0, 0, 1)),
            "its pivot has 3 components in 2-D",
        ),
        (
            lambda: block.contact_problem(replace(block.floor_pair(0.3), pivot=(0.0, -1.0))),
            "of_residual",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            attempt()
