"""Rotating rigid tools: derivatives, equivalent pivots, torques, restart, refusals."""

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
    IncrementStart,
    LargeStrainKinematics,
    NoDeformablePairs,
    RigidSurfaceMotion,
)
from pw_elements.contact.steps import finite
from tests.contact.cases import BlockOnFloor, make_finite_strain_unknown_and_residual, on_plane
from tests.contact.test_large import (
    ON_TOP,
    SOLVERS_BY_NAME,
    SURFACES_BY_NAME,
    RubberUnderCircle,
    collect_first_pair_fields,
    make_interface_stand_in,
    step_through,
)
from tests.parallel import assert_same_values

PIVOT = (0.2, 0.5)
PRESSING_MOTION = Motion((0.0, -0.15), rotation=0.1)
# dragged under a force, and rotated by a torque
MOTION_UNDER_FORCE_AND_TORQUE = Motion((0.1, None), (0.0, -0.3), rotation=None, torque=-0.02)
ROLLER_MOTIONS = [
    PRESSING_MOTION,
    Motion((0.1, -0.2), rotation=-0.1),
    MOTION_UNDER_FORCE_AND_TORQUE,
]
POSE_AND_TORQUE_FIELDS = ("translation", "rotation", "torque")


def make_rubber_under_roller(pivot=PIVOT, mesh=None, friction=0.3, **options):
    """Return the block of `RubberUnderCircle` under a circle that can rotate about a pivot."""
    rubber = RubberUnderCircle(mesh=mesh, friction=friction)
    rubber.problem = rubber.problem_with(options=options, pivot=pivot)
    return rubber


@pytest.mark.parametrize("name", ["plane", "circle", "sphere", "ellipse"])
def test_the_kinematics_of_a_rotating_tool_are_linearised_consistently(name):
    surface, rng = SURFACES_BY_NAME[name], np.random.default_rng(3)
    dim, m, h = (3 if name == "sphere" else 2), 20, 1e-5
    x = rng.normal(size=(m, dim)) * 0.2 + [*[0.3] * (dim - 1), 1.3]
    axis = (1.0, -2.0, 0.5) if dim == 3 else None
    interface = make_interface_stand_in(surface, x, dim)
    pair = ContactPair(ON_TOP, surface, pivot=rng.normal(size=dim), axis=axis)
    surfaces = RigidSurfaceMotion(interface, [pair])
    q = np.append(rng.normal(size=dim) * 0.1, 0.7)[None]
    start_q = np.append(rng.normal(size=dim) * 0.1, 0.5)[None]
    # in the frame of the surface, displacements are small
    starts, ends = (rng.normal(size=(m, dim)) * 0.2 for _ in range(2))
    displacement = surfaces.displacement_from_surface_frame(start_q, starts)
    start = IncrementStart(displacement, np.zeros((m, dim)), start_q)
    kinematics = LargeStrainKinematics(interface, surfaces, start, NoDeformablePairs())
    a, r = surfaces.displacement_from_surface_frame(q, ends), rng.normal(size=(m, dim))
    linearised = kinematics.linearise(q, a, r)
    R, w = np.eye(dim) + surfaces.rotation_minus_identity(q), linearised.torque_map.w

    def quantities_in_surface_frame(step, motion, displacement_change):
        """Return quantities in the surface's frame after motion and displacements have changed.

        `step` scales both changes. The quantities are gap, slip, normal, force, magnitude of the
        shear force, and torque.
        """
        changed_q, changed_a = q + step * motion, a + step * displacement_change
        changed_kinematics, rotation = kinematics.linearise(changed_q, changed_a, r), np.eye(dim)
        rotation = rotation + surfaces.rotation_minus_identity(changed_q)
        slip = np.einsum(
            "nta,nt->na", changed_kinematics.frame[:, 1:] @ rotation, changed_kinematics.slip
        )
        quantities = (
            changed_kinematics.gap[:, None],
            slip,
            changed_kinematics.frame[:, :1] @ rotation,
            r[:, None] @ rotation,
        )
        shear_size = np.linalg.norm(
            np.einsum("nab,nb->na", changed_kinematics.frame, r)[:, 1:], axis=1
        )
        torque = changed_kinematics.torque_map.compute_force_and_torque_of_each_point(r)[:, -1]
        return np.column_stack([*(part.reshape(m, -1) for part in quantities), shear_size, torque])

    motions = [*np.eye(dim + 1), *np.zeros((dim, dim + 1))]
    displacement_changes = [*np.zeros((dim + 1, dim)), *np.eye(dim)]
    for motion, displacement_change in zip(motions, displacement_changes, strict=True):
        displacement_change = np.tile(displacement_change, (m, 1))
        derivatives = (
            quantities_in_surface_frame(h, motion, displacement_change)
            - quantities_in_surface_frame(-h, motion, displacement_change)
        ) / (2 * h)
        split_derivatives = np.split(derivatives, np.cumsum([1, dim, dim, dim, 1]), axis=1)
        gap, slip, normal, force, shear, torque = split_derivatives
        expected = (
            np.einsum("nab,nb->na", linearised.motion_by_v, displacement_change)
            + linearised.motion_by_q @ motion
        )
        assert np.abs(gap[:, 0] - expected[:, 0]).max() < 1e-7
        tangents = linearised.frame[:, 1:] @ R
        assert np.abs(np.einsum("nta,na->nt", tangents, slip) - expected[:, 1:]).max() < 1e-7
        # derivative of the normal component, with the force fixed in space
        force_rotation = np.einsum("nba,nb->na", R, w) * motion[-1]
        assert np.abs(force + force_rotation).max() < 1e-7
        rotated = np.einsum("nb,nba->na", linearised.frame[:, 0], R), np.einsum("nba,nb->na", R, r)
        normal_change = np.sum(normal * rotated[1] + force * rotated[0], axis=1)
        force_change = (
            np.einsum("nab,nb->na", linearised.force_by_v, displacement_change)
            + linearised.force_by_q @ motion
        )
        assert np.abs(normal_change - force_change[:, 0]).max() < 1e-7
        sheared = np.einsum("nab,nb->na", linearised.frame, r)[:, 1:]
        shear_change = np.sum(sheared * force_change[:, 1:], axis=1) / np.linalg.norm(
            sheared, axis=1
        )
        assert np.abs(shear[:, 0] - shear_change).max() < 1e-6
        expected = -np.sum(w * (displacement_change - motion[:-1]), axis=1)
        assert np.abs(torque[:, 0] - expected).max() < 1e-7


def rotate_in_plane(vectors, radians):
    cos, sin = np.cos(radians), np.sin(radians)
    return vectors @ np.array([[cos, sin], [-sin, cos]])


def test_any_pivot_can_describe_the_same_poses():
    """The same pose of a tool can be described with any pivot.

    A rotation about another pivot needs an additional translation, and has the same contact forces.
    The torques differ by the cross product of the vector between the pivots and the force.
    """
    (pair,) = step_through(
        make_rubber_under_roller().problem, [Motion((0.05, -0.15), rotation=0.3)]
    )[-1].pairs
    other_pivot, shift = (-0.4, 0.1), np.array([-0.6, -0.4])
    translation = rotate_in_plane(shift, 0.3) - shift + [0.05, -0.15]
    (other_pair,) = step_through(
        make_rubber_under_roller(pivot=other_pivot).problem, [Motion(translation, rotation=0.3)]
    )[-1].pairs
    assert np.abs(pair.force_vector - other_pair.force_vector).max() < 1e-10
    assert np.abs(pair.slip - other_pair.slip).max() < 1e-10
    arm = shift + other_pair.translation - pair.translation
    assert pair.torque == pytest.approx(
        other_pair.torque + np.cross([*arm, 0], [*other_pair.force, 0])[2]
    )
    lever = pair.position + pair.displacement - PIVOT - pair.translation
    torque = np.cross(np.pad(lever, [(0, 0), (0, 1)]), np.pad(pair.force_vector, [(0, 0), (0, 1)]))
    assert pair.torque == pytest.approx(torque[:, 2].sum(), rel=1e-12)


def test_a_free_angle_under_a_torque_is_the_prescribed_one():
    """A tool that is free to rotate under a torque takes the angle at which this torque arose.

    The torque and the vertical force were computed for prescribed motions. The contact forces agree
    as well, and Newton's method converges quadratically.
    """
    violations = []
    rubber = make_rubber_under_roller(
        callback=lambda progress: violations.append(progress.violation)
    )
    pressed_state, driven_state = step_through(
        rubber.problem, [PRESSING_MOTION, Motion((0.1, -0.2), rotation=-0.1)]
    )
    (driven_pair,) = driven_state.pairs
    free = Motion(
        (0.1, None), (0.0, driven_pair.force[1]), rotation=None, torque=float(driven_pair.torque)
    )
    del violations[:]
    free_state = rubber.problem.step(pressed_state, motions=free)
    (pair,) = free_state.pairs
    assert free_state.free_motions == ((0, 1), (0, 2))
    assert pair.rotation == pytest.approx(-0.1, abs=1e-9)
    assert np.abs(pair.force_vector - driven_pair.force_vector).max() < 1e-9
    assert free_state.residuals.balance < 1e-9
    previous, last_violation = (violation * 1e-9 for violation in violations[-4:-2])
    assert last_violation < 20 * previous**2


def test_a_tool_that_rotates_with_its_body_does_not_slip():
    """A tool that rotates together with the body does not slip on it.

    Body and tool are rotated by a right angle. The forces rotate with them, and the slip is zero.
    """
    rubber = make_rubber_under_roller()
    base_displacement = fem.Function(rubber.space)
    x = rubber.space.tabulate_dof_coordinates()[:, :2]
    nodes = fem.locate_dofs_geometrical(rubber.space, on_plane(1, -1.0))
    condition = fem.dirichletbc(base_displacement, nodes)
    problem = rubber.problem_with(condition, pivot=PIVOT)
    pressed_state = step_through(problem, [Motion((0.05, -0.15), rotation=0.1)])[-1]
    arm = x - PIVOT - pressed_state.pairs[0].translation

    def load(load_factor):
        base_displacement.x.array[:] = (rotate_in_plane(arm, load_factor * np.pi / 2) - arm).ravel()

    rotated_state = problem.step(
        pressed_state, load, Motion((0.05, -0.15), rotation=0.1 + np.pi / 2)
    )
    (start_pair,), (end_pair,) = pressed_state.pairs, rotated_state.pairs
    largest = np.abs(start_pair.force_vector).max()
    assert (
        np.abs(rotate_in_plane(start_pair.force_vector, np.pi / 2) - end_pair.force_vector).max()
        < 1e-9 * largest
    )
    assert np.abs(end_pair.slip).max() < 1e-10
    assert end_pair.torque == pytest.approx(start_pair.torque, rel=1e-9)


def rotate_tool_in_increments(problem, pressed_state, depth, total_angle, n_increments):
    """Return the state after a pressed tool is rotated in equal increments."""
    ends = total_angle * np.arange(1, n_increments + 1) / n_increments
    motions = [Motion((0.0, -depth), rotation=end) for end in ends]
    return step_through(problem, motions, pressed_state)[-1]


@pytest.mark.parametrize("angle", [5.0, 6.0, 2 * np.pi, -2 * np.pi, 4 * np.pi])
def test_whole_turns_are_counted_as_slip(angle):
    """The slip of a rotating tool includes whole turns.

    One increment gives the same state as several equal increments of at most a quarter turn.
    """
    problem = make_rubber_under_roller((0.0, 0.6)).problem
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    n_increments = 4 if abs(angle) < 7 else 8
    single_state, divided_state = (
        rotate_tool_in_increments(problem, pressed, 0.1, angle, count)
        for count in (1, n_increments)
    )
    largest = np.abs(divided_state.pairs[0].force_vector).max()
    difference = single_state.pairs[0].force_vector - divided_state.pairs[0].force_vector
    assert np.abs(difference).max() < 1e-8 * largest
    limit = 0.3 * divided_state.pairs[0].force_normal.sum() * 0.6
    assert divided_state.pairs[0].torque == pytest.approx(np.sign(angle) * limit, rel=1e-9)
    is_closed = single_state.pairs[0].status != OPEN
    slips = np.linalg.norm(single_state.pairs[0].slip[is_closed], axis=1)
    assert slips == pytest.approx(0.6 * abs(angle), rel=0.05)
    assert len(single_state.substates) >= n_increments - 1


def test_a_rotation_that_the_slip_misses_would_be_logged(caplog, monkeypatch):
    """A warning is logged if the slip does not include a rotation of the tool.

    The slip is compared with the slip along the path, which includes whole turns.
    """
    problem = make_rubber_under_roller((0.0, 0.6)).problem
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        (pair,) = rotate_tool_in_increments(problem, pressed, 0.1, 2 * np.pi, 1).pairs
        assert np.abs(pair.slip - pair.path_slip).max() < 0.01 * np.abs(pair.slip).max()
        assert not caplog.records
        monkeypatch.setattr(finite, "MAX_SURFACE_RADIANS_PER_SUBSTEP", np.inf)
        # the verification, whose slip includes whole turns, would refuse the state
        monkeypatch.setattr(finite, "verify_state", lambda found, *_, **__: found)
        (pair,) = rotate_tool_in_increments(problem, pressed, 0.1, 2 * np.pi, 1).pairs
    is_closed = pair.status != OPEN
    path_lengths = np.linalg.norm(pair.path_slip[is_closed], axis=1)
    assert path_lengths == pytest.approx(
        2 * np.pi * 0.6, rel=0.05
    )  # the sum of eight chords is slightly shorter
    assert np.abs(pair.slip).max() < 1e-12
    (record,) = caplog.records
    assert "slip differs from that of the path by up to" in record.getMessage()


def test_rolling_in_smaller_increments_converges():
    """The contact forces of a rolling wheel converge as increments become smaller.

    The wheel rolls with 5 % of slip and sticks in places. Its shear forces therefore depend on the
    size of the increments.
    """
    problem = make_rubber_under_roller((0.0, 0.6), friction=0.9).problem
    pressed = problem.step(problem.undeformed, motions=Motion((-0.4, -0.1)))
    shears = []
    for n_increments in (1, 2, 4, 8, 16, 32):
        fractions = np.arange(1, n_increments + 1) / n_increments
        motions = [
            Motion((-0.4 + 0.8 * fraction, -0.1), rotation=-0.95 * 0.8 / 0.6 * fraction)
            for fraction in fractions
        ]
        (pair,) = step_through(problem, motions, pressed)[-1].pairs
        shears.append(pair.force_vector / np.abs(pair.force_vector).max())
    differences = [np.abs(shear - finer_shear).max() for shear, finer_shear in pairwise(shears)]
    assert differences[0] < 1e-8  # a single increment is cut in two
    assert differences[4] < differences[3] < differences[2] < differences[1]
    assert differences[4] < 0.05


def problem_and_load_of_rotating_base(pivot, angle):
    """Return the problem of a block, and a load that rotates its base about the tool's pivot."""
    rubber = make_rubber_under_roller(pivot)
    base_displacement = fem.Function(rubber.space)
    x = rubber.space.tabulate_dof_coordinates()[:, :2]
    condition = fem.dirichletbc(
        base_displacement, fem.locate_dofs_geometrical(rubber.space, on_plane(1, -1.0))
    )
    arm = x - pivot - [0.0, -0.1]

    def load(load_factor):
        base_displacement.x.array[:] = (rotate_in_plane(arm, load_factor * angle) - arm).ravel()

    return rubber.problem_with(condition, pivot=pivot), load


def test_rotations_of_the_body_by_supports_are_counted_as_slip():
    """Rotations of the body by its supports are included in the slip.

    A body that rotates under a resting tool has the same contact as a body under a tool that
    rotates backwards.
    """
    angle, pivot = 2 * np.pi, np.array([0.0, 0.6])
    problem = make_rubber_under_roller(pivot).problem
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    (expected,) = rotate_tool_in_increments(problem, pressed, 0.1, -angle, 8).pairs
    problem, load = problem_and_load_of_rotating_base(pivot, angle)
    pressed = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
    (pair,) = problem.step(pressed, load, Motion((0.0, -0.1))).pairs
    largest = np.abs(expected.force_vector).max()
    assert np.abs(pair.force_vector - expected.force_vector).max() < 1e-8 * largest
    assert abs(pair.force[0]) > 0.2 * abs(pair.force[1])


def test_an_increment_with_too_large_a_free_rotation_is_cut(monkeypatch):
    """An increment in which a free tool rotates too far is cut.

    The angle follows from a torque and is known only at the end of the increment. No substep
    exceeds the allowed angle.
    """
    problem = make_rubber_under_roller().problem
    pressed = problem.step(problem.undeformed, motions=PRESSING_MOTION)

    def rotation_angles_of_substeps():
        state = problem.step(pressed, motions=MOTION_UNDER_FORCE_AND_TORQUE)
        ends = [pressed, *(substate for _, substate in state.substates), state]
        return np.abs(np.diff([float(substate.pairs[0].rotation) for substate in ends]))

    uncut_steps = rotation_angles_of_substeps()
    max_turn = 0.6 * uncut_steps.max()
    monkeypatch.setattr(finite, "MAX_SURFACE_RADIANS_PER_SUBSTEP", max_turn)
    cut_steps = rotation_angles_of_substeps()
    assert len(cut_steps) > len(uncut_steps)
    assert cut_steps.max() <= max_turn


def make_ball_problem(friction, **options):
    """Return the problem of a fixed cube below a ball that rotates about its vertical axis."""
    mesh = create_unit_cube(MPI.COMM_SELF, 2, 2, 2, CellType.tetrahedron)
    spaces = Spaces.petrov_galerkin(mesh)
    u, residual = make_finite_strain_unknown_and_residual(spaces)
    conditions = [prescribe(spaces.trial, k, on_plane(2, 0.0)) for k in range(3)]
    centre = 0.5, 0.4, 1.8
    pair = ContactPair(
        on_plane(2, 1.0), Sphere(centre, 0.8), friction, pivot=centre, axis=(0, 0, 2)
    )
    return ContactProblem.of_residual(residual, u, conditions, pair, **options)


def test_a_ball_rotating_about_its_axis_has_a_friction_torque():
    """A ball that rotates about its vertical axis has a friction torque; without friction it is 0.

    If this torque is prescribed instead of the angle, the ball rotates by the same angle.
    """
    down = (0.0, 0.0, -0.15)
    frictionless_states = step_through(
        make_ball_problem(0.0), [Motion(down), Motion(down, rotation=0.7)]
    )
    resting_pair, rotated_pair = (state.pairs[0] for state in frictionless_states)
    assert np.abs(resting_pair.force_vector - rotated_pair.force_vector).max() < 1e-9
    assert abs(rotated_pair.torque) < 1e-12
    assert np.abs(rotated_pair.slip).max() > 0.1
    assert (
        np.abs(rotated_pair.slip - rotated_pair.path_slip).max()
        < 0.03 * np.abs(rotated_pair.slip).max()
    )
    rough_problem = make_ball_problem(0.5)
    pressed_state, driven_state = step_through(
        rough_problem, [Motion(down), Motion(down, rotation=0.05)]
    )
    (pair,) = driven_state.pairs
    lever = pair.position + pair.displacement - [0.5, 0.4, 1.8] - pair.translation
    assert pair.torque == pytest.approx(np.cross(lever, pair.force_vector)[:, 2].sum(), rel=1e-12)
    assert pair.torque > 1e-3
    free = Motion(down, rotation=None, torque=float(pair.torque))
    assert rough_problem.step(pressed_state, motions=free).pairs[0].rotation == pytest.approx(
        0.05, abs=1e-8
    )


def make_roller_problem_and_motions(solver):
    """Return the problem and motions of a plane roller, whose height is free in the last motion."""
    weighted = Motion((0.1, None), (0.0, -0.3), rotation=-0.1)
    return make_rubber_under_roller(solver=solver).problem, [PRESSING_MOTION, weighted]


def make_ball_problem_and_motions(solver):
    """Return the problem and motions of a ball that rotates about its vertical axis."""
    down = (0.0, 0.0, -0.15)
    return make_ball_problem(0.5, solver=solver), [Motion(down), Motion(down, rotation=0.05)]


@pytest.mark.parametrize(
    "make_case", [make_roller_problem_and_motions, make_ball_problem_and_motions]
)
def test_iterative_and_direct_solvers_rotate_tools_alike(make_case):
    direct, iterative = (
        collect_first_pair_fields(
            {"end": step_through(*make_case(solver))[-1]}, POSE_AND_TORQUE_FIELDS
        )
        for solver in SOLVERS_BY_NAME.values()
    )
    assert_same_values(direct, iterative, 1e-9, make_case.__name__)
    problem, (pressing_motion, *_) = make_case(Iterative())
    with pytest.raises(ValueError, match="free to turn"):
        problem.step(problem.undeformed, motions=replace(pressing_motion, rotation=None))


def test_a_state_with_another_pivot_is_refused(tmp_path):
    """A problem whose tool has another pivot refuses to load a state.

    With another pivot, the same angle would mean another position of the tool.
    """
    problem, path = make_rubber_under_roller().problem, tmp_path / "state.npz"
    problem.save(problem.undeformed, path)
    for pivot in ((-0.4, 0.1), None):
        with pytest.raises(ValueError, match="another pivot"):
            make_rubber_under_roller(pivot=pivot).problem.load(path)


def test_an_increment_that_is_cut_rotates_in_proportion():
    rubber = make_rubber_under_roller(max_iterations=6)
    state = rubber.problem.step(
        rubber.problem.undeformed, motions=Motion((0.0, -0.25), rotation=-1.0)
    )
    assert state.substates
    for fraction, substate in state.substates:
        assert substate.pairs[0].rotation == pytest.approx(-fraction, abs=1e-14)
    assert state.pairs[0].rotation == -1.0


def test_sensitivities_of_rotated_tools_are_refused():
    """Sensitivities of histories with rotating tools are refused.

    The derivatives would not include the rotation of the frame in which slip is measured.
    """
    problem = make_rubber_under_roller().problem
    (state,) = step_through(problem, [PRESSING_MOTION])
    with pytest.raises(ValueError, match="has turned"):
        problem.sensitivity([problem.undeformed, state], [("force", 0, 0)], [("friction", 0)])


def test_invalid_pivots_are_refused():
    rubber, block = RubberUnderCircle(), BlockOnFloor(4)
    surface, step = rubber.pair.surface, rubber.problem.step
    for attempt, message in (
        (lambda: ContactPair(ON_TOP, DeformableSurface(ON_TOP), pivot=PIVOT), "supports rotate it"),
        (lambda: ContactPair(ON_TOP, surface, pivot=(0, 0, 1)), "axis"),
        (lambda: ContactPair(ON_TOP, surface, pivot=PIVOT, axis=(0, 0, 1)), "in space"),
        (lambda: step(rubber.problem.undeformed, motions=PRESSING_MOTION), "give it a pivot"),
        (
            lambda: rubber.problem_with(pivot=(0, 0, 1), axis=(0, 0, 1)),
            "its pivot has 3 components in 2-D",
        ),
        (
            lambda: block.contact_problem(replace(block.floor_pair(0.3), pivot=(0.0, -1.0))),
            "of_residual",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            attempt()
