"""Bodies and tools that separate in one step, and tools that leave no space for a body."""

from collections import Counter

import numpy as np
import pytest

from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    SolutionNotFound,
    Sphere,
    SurfacePassed,
)
from pw_elements.contact.rescue import (
    PiecesMovingWithSupports,
    does_rigid_motion_end_all_contact,
    raise_if_tools_reach_or_pass_supports,
)
from tests.contact.cases import on_plane
from tests.contact.sliding import (
    SlidingBodies,
    make_die_on_block,
    mesh_of_two_rectangles,
    slide_along_path,
)
from tests.contact.test_large import RubberUnderCircle, step_through

PRESSED_TRANSLATION = (0.0, -0.12)
PLANE_ABOVE = Plane((0.0, 0.0), (0.0, -1.0))


@pytest.mark.parametrize("upper_is_slave", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 50.0])
def test_a_body_slides_off_in_one_step(upper_is_slave, degrees):
    """A die that is moved off a block in one step ends where its supports carry it.

    This takes no more linear systems than pressing the die on the block, and no substeps.
    """
    bodies = make_die_on_block(
        friction=0.8, upper_is_slave=upper_is_slave, rotation_degrees=degrees
    )
    pressed_state, separate_state = slide_along_path(bodies, [PRESSED_TRANSLATION, (4.0, -0.12)])
    assert separate_state.iterations <= pressed_state.iterations
    assert not separate_state.substates
    assert (separate_state.pairs[0].status == OPEN).all()
    assert np.abs(separate_state.pairs[0].force_vector).max() < 1e-12
    x = bodies.space.tabulate_dof_coordinates()[:, :2]
    end_positions = x + np.where(x[:, 1:] > 0.005, [4.0, -0.12], 0.0)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    expected = end_positions @ np.array([[c, s], [-s, c]]) - x
    assert np.abs(separate_state.displacement.array_r.reshape(-1, 2) - expected).max() < 1e-9


# Largest number of linear systems allowed in an increment of a die with sharp corners. If
# iterations were not ended early, the three cases would need 237, 664 and 231
MAX_LINEAR_SYSTEMS_PER_INCREMENT = 140


@pytest.mark.parametrize(
    ("upper_is_slave", "ends"), [(True, (1.0,)), (False, (1.0,)), (False, (0.5, 1.0))]
)
def test_a_sharp_die_is_solved_or_refused_after_few_linear_systems(upper_is_slave, ends):
    """A sliding die with sharp corners is solved or refused after few linear systems.

    It is refused if the die is the master, so that its corners are the ends of the master.
    """
    reports = []
    bodies = make_die_on_block(
        friction=0.8, upper_is_slave=upper_is_slave, curvature=0.0, callback=reports.append
    )
    path = [PRESSED_TRANSLATION, *((end, -0.12) for end in ends)]
    if upper_is_slave:
        slide_along_path(bodies, path)
    else:
        with pytest.raises(SolutionNotFound, match="which cannot be halved further"):
            slide_along_path(bodies, path)
    n_systems = Counter(report.increment for report in reports if report.state is None)
    assert sorted(n_systems) == list(range(len(path)))
    assert max(n_systems.values()) <= MAX_LINEAR_SYSTEMS_PER_INCREMENT


@pytest.mark.parametrize("moving_part", ["tool", "supports"])
def test_a_tool_slides_off_in_one_step(moving_part):
    rubber, ends = RubberUnderCircle(), [(0.0, 0.2), (8.0, 0.2)]
    state = rubber.problem.undeformed
    n_systems = []
    for k, end in enumerate(ends):
        start = ends[k - 1] if k else (0.0, 0.0)

        def load(load_factor, start=start, end=end):
            for value, start_value, end_value in zip(
                rubber.base_displacement, start, end, strict=True
            ):
                value.value = (1 - load_factor) * start_value + load_factor * end_value

        if moving_part == "tool":
            state = rubber.problem.step(state, motions=Motion((-end[0], -end[1])))
        else:
            state = rubber.problem.step(state, load)
        n_systems.append(state.iterations)
    assert n_systems[1] <= n_systems[0]
    assert (state.pairs[0].status == OPEN).all()
    expected = ends[-1] if moving_part == "supports" else (0.0, 0.0)
    assert np.abs(state.displacement.array_r.reshape(-1, 2) - expected).max() < 1e-9


def test_a_step_is_solved_as_usual_if_immediate_separation_fails(monkeypatch):
    rubber = RubberUnderCircle()
    (pressed_state,) = step_through(rubber.problem, [Motion((0.0, -0.2))])
    stepping, is_direct = rubber.problem._large_strain_stepping, []
    solve = stepping._solve_substep

    def fail_immediate_separation(*arguments):
        is_direct.append(arguments[-1] is not None)
        if is_direct[-1]:
            raise SolutionNotFound("not at once")
        return solve(*arguments)

    monkeypatch.setattr(stepping, "_solve_substep", fail_immediate_separation)
    state = rubber.problem.step(pressed_state, motions=Motion((0.0, 2.0)))
    assert is_direct == [True, False]
    assert (state.pairs[0].status == OPEN).all()


def is_separated_by_move(problem, start_and_end_translations, unknowns):
    """Return whether a circle separates from the rubber as it moves between two positions."""
    stepping = problem._large_strain_stepping
    fractions = np.linspace(0, 1, 129)
    motions = np.array(
        [
            [
                [
                    *(
                        (1 - fraction) * np.array(start_and_end_translations[0])
                        + fraction * np.array(start_and_end_translations[1])
                    ),
                    0,
                ]
            ]
            for fraction in fractions
        ]
    )
    displacements = np.zeros((len(fractions), *stepping._supports.node_positions.shape))
    pieces = PiecesMovingWithSupports.fit_rigid_motions_to_supports(
        stepping._supports.node_positions,
        stepping._supports.is_supported,
        stepping._supports.connected_piece_of_node,
        displacements,
        stepping.interface.comm,
    )
    return does_rigid_motion_end_all_contact(
        stepping.interface, stepping._surfaces, pieces, motions, unknowns
    )


def test_a_tool_that_passes_through_a_body_does_not_separate():
    """A tool that would pass through a body does not count as separating from it.

    The circle overlaps the left side of the block; the overlap is largest if the centre of the
    circle lies on this side.
    """
    rubber = RubberUnderCircle()
    circle, on_left_side = Sphere((-1.6, 0.0), 0.6), on_plane(0, -1.0)
    problem = rubber.problem_with(surface=circle, nodes=lambda x: on_left_side(x) & (x[1] > -0.7))
    undeformed = problem.undeformed.unknowns
    assert is_separated_by_move(problem, [(0.3, 0.0), (-4.0, 0.0)], undeformed)
    assert is_separated_by_move(problem, [(0.3, 0.0), (0.3, 4.0)], undeformed)
    assert not is_separated_by_move(problem, [(0.7, 0.0), (4.0, 0.0)], undeformed)  # into the block
    assert not is_separated_by_move(
        problem, [(0.1, 0.0), (-4.0, 0.0)], undeformed + 5.0
    )  # out of reach
    assert not is_separated_by_move(
        problem, [(0.1, 0.0), (1.5, 2.0)], undeformed
    )  # deeper at first
    assert not is_separated_by_move(
        problem, [(0.3, 0.0), (0.05, 0.0)], undeformed
    )  # still overlaps
    assert not is_separated_by_move(
        problem, [(-1.0, 0.0), (-4.0, 0.0)], undeformed
    )  # no contact yet


@pytest.mark.parametrize("surface", [PLANE_ABOVE, Sphere((0.0, 0.6), 0.6)], ids=["plane", "circle"])
@pytest.mark.parametrize("depth", [1.0, 1.1])
def test_a_tool_that_leaves_no_space_for_the_body_is_refused(surface, depth):
    """A tool that leaves no space for the body is refused without solving any linear system."""
    calls = []
    rubber = RubberUnderCircle(callback=calls.append)
    problem = rubber.problem_with(surface=surface, options={"callback": calls.append})
    with pytest.raises(SurfacePassed, match=r"up to the supports at .* no room is left"):
        problem.step(problem.undeformed, motions=Motion((0.0, -depth)))
    assert not calls


def test_bodies_that_leave_no_space_for_each_other_are_refused():
    calls = []
    bodies = make_die_on_block(callback=calls.append)
    with pytest.raises(SurfacePassed, match="led up to each other: no room is left"):
        slide_along_path(bodies, [(0.0, -2.0)])
    assert not calls


def test_a_tool_may_move_to_supports_of_a_body_behind_a_gap():
    """A tool may reach the supports of a body that lies beyond a gap.

    The tool pushes only the upper body; the supports that it reaches are those of the lower body.
    """
    boxes = ((-1.0, -1.0), (1.0, 0.0)), ((-1.0, 0.5), (1.0, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, ((4, 2), (4, 2)), lambda x, y, _: (x, y))
    bodies = SlidingBodies(
        mesh, on_plane(1, 0.5), on_plane(1, 0.0), on_plane(1, 0.0), on_plane(1, -1.0), 0.0
    )
    pair = ContactPair(on_plane(1, 1.0), Plane((0.0, 1.0), (0.0, -1.0)))
    problem = ContactProblem.of_residual(bodies.residual, bodies.u, bodies.conditions, pair)
    stepping = problem._large_strain_stepping
    node_data = (
        stepping._supports.node_positions,
        stepping._supports.is_supported,
        0 * stepping._supports.connected_piece_of_node,
    )  # positions and supports, as if both bodies were one connected piece
    motions, displacements = np.zeros((65, 1, 3)), np.zeros((65, *node_data[0].shape))
    motions[:, 0, 1] = np.linspace(0.0, -1.1, 65)
    raise_if_tools_reach_or_pass_supports(
        stepping.interface, stepping._surfaces, *node_data, motions, displacements
    )
