"""Bodies and tools that leave each other in one step, and tools that leave no room for a body."""

import numpy as np
import pytest

from pw_elements.contact import (
    OPEN,
    ContactPair,
    ContactProblem,
    Motion,
    NotFound,
    Plane,
    Sphere,
    SurfacePassed,
)
from pw_elements.contact.rescue import (
    SupportedPieces,
    ends_all_contact,
    refuse_tools_through_supports,
)
from tests.contact.cases import on_plane
from tests.contact.sliding import (
    SlidingBodies,
    make_die_on_block,
    mesh_of_two_rectangles,
    slide_along_path,
)
from tests.contact.test_large import RubberUnderCircle, step_through

PRESSED = (0.0, -0.12)
LOWERED = Plane((0.0, 0.0), (0.0, -1.0))


@pytest.mark.parametrize("upper_is_slave", [True, False])
@pytest.mark.parametrize("turned", [0.0, 50.0])
def test_a_body_slides_off_in_one_step(upper_is_slave, turned):
    """It ends where its supports have carried it, with the systems of any other step at most."""
    bodies = make_die_on_block(friction=0.8, upper_is_slave=upper_is_slave, rotation_degrees=turned)
    pressed, left = slide_along_path(bodies, [PRESSED, (4.0, -0.12)])
    assert left.iterations <= pressed.iterations
    assert not left.substates
    assert (left.pairs[0].status == OPEN).all()
    assert np.abs(left.pairs[0].force_vector).max() < 1e-12
    x = bodies.space.tabulate_dof_coordinates()[:, :2]
    moved = x + np.where(x[:, 1:] > 0.005, [4.0, -0.12], 0.0)
    c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    expected = moved @ np.array([[c, s], [-s, c]]) - x
    assert np.abs(left.displacement.array_r.reshape(-1, 2) - expected).max() < 1e-9


@pytest.mark.parametrize("moved", ["tool", "supports"])
def test_a_tool_slides_off_in_one_step(moved):
    rubber, ends = RubberUnderCircle(), [(0.0, 0.2), (8.0, 0.2)]
    state = rubber.problem.undeformed
    systems = []
    for k, end in enumerate(ends):
        before = ends[k - 1] if k else (0.0, 0.0)

        def load(share, before=before, end=end):
            for value, low, high in zip(rubber.base_displacement, before, end, strict=True):
                value.value = (1 - share) * low + share * high

        if moved == "tool":
            state = rubber.problem.step(state, motions=Motion((-end[0], -end[1])))
        else:
            state = rubber.problem.step(state, load)
        systems.append(state.iterations)
    assert systems[1] <= systems[0]
    assert (state.pairs[0].status == OPEN).all()
    expected = ends[-1] if moved == "supports" else (0.0, 0.0)
    assert np.abs(state.displacement.array_r.reshape(-1, 2) - expected).max() < 1e-9


def test_a_step_is_made_the_ordinary_way_if_the_end_is_not_found_at_once(monkeypatch):
    rubber = RubberUnderCircle()
    (pressed,) = step_through(rubber.problem, [Motion((0.0, -0.2))])
    stepping, at_once = rubber.problem._finite, []
    solve = stepping._solve_part

    def fail_at_first(*given):
        at_once.append(given[-1] is not None)
        if at_once[-1]:
            raise NotFound("not at once")
        return solve(*given)

    monkeypatch.setattr(stepping, "_solve_part", fail_at_first)
    state = rubber.problem.step(pressed, motions=Motion((0.0, 2.0)))
    assert at_once == [True, False]
    assert (state.pairs[0].status == OPEN).all()


def lifts_clear(problem, ends, unknowns):
    """Whether a circle that is led from one end to another leaves the rubber without contact."""
    stepping = problem._finite
    shares = np.linspace(0, 1, 129)
    ways = np.array([[[*((1 - s) * np.array(ends[0]) + s * np.array(ends[1])), 0]] for s in shares])
    path = np.zeros((len(shares), *stepping._positions.shape))
    pieces = SupportedPieces.fit(
        stepping._positions, stepping._held, stepping._piece, path, stepping.interface.comm
    )
    return ends_all_contact(stepping.interface, stepping._surfaces, pieces, ways, unknowns)


def test_what_goes_through_a_body_does_not_leave_it():
    """A circle beside the block; it is deepest when its centre is in the block's left side."""
    rubber = RubberUnderCircle()
    circle, side = Sphere((-1.6, 0.0), 0.6), on_plane(0, -1.0)
    problem = rubber.problem_with(surface=circle, nodes=lambda x: side(x) & (x[1] > -0.7))
    undeformed = problem.undeformed.unknowns
    assert lifts_clear(problem, [(0.3, 0.0), (-4.0, 0.0)], undeformed)
    assert lifts_clear(problem, [(0.3, 0.0), (0.3, 4.0)], undeformed)
    assert not lifts_clear(problem, [(0.7, 0.0), (4.0, 0.0)], undeformed)  # behind the side
    assert not lifts_clear(problem, [(0.1, 0.0), (-4.0, 0.0)], undeformed + 5.0)  # out of reach
    assert not lifts_clear(problem, [(0.1, 0.0), (1.5, 2.0)], undeformed)  # first deeper
    assert not lifts_clear(problem, [(0.3, 0.0), (0.05, 0.0)], undeformed)  # not clear
    assert not lifts_clear(problem, [(-1.0, 0.0), (-4.0, 0.0)], undeformed)  # not in contact


@pytest.mark.parametrize("surface", [LOWERED, Sphere((0.0, 0.6), 0.6)], ids=["plane", "circle"])
@pytest.mark.parametrize("depth", [1.0, 1.1])
def test_a_tool_leaves_room_for_the_body(surface, depth):
    """Without any linear system."""
    solved = []
    rubber = RubberUnderCircle(callback=solved.append)
    problem = rubber.problem_with(surface=surface, options={"callback": solved.append})
    with pytest.raises(SurfacePassed, match=r"up to the supports at .* no room is left"):
        problem.step(problem.undeformed, motions=Motion((0.0, -depth)))
    assert not solved


def test_bodies_leave_room_for_each_other():
    solved = []
    bodies = make_die_on_block(callback=solved.append)
    with pytest.raises(SurfacePassed, match="led up to each other: no room is left"):
        slide_along_path(bodies, [(0.0, -2.0)])
    assert not solved


def test_supports_behind_a_gap_may_be_reached():
    """The tool pushes on the upper body alone, and may go as far as the lower one's supports."""
    boxes = ((-1.0, -1.0), (1.0, 0.0)), ((-1.0, 0.5), (1.0, 1.0))
    mesh = mesh_of_two_rectangles(*boxes, ((4, 2), (4, 2)), lambda x, y, _: (x, y))
    bodies = SlidingBodies(
        mesh, on_plane(1, 0.5), on_plane(1, 0.0), on_plane(1, 0.0), on_plane(1, -1.0), 0.0
    )
    pair = ContactPair(on_plane(1, 1.0), Plane((0.0, 1.0), (0.0, -1.0)))
    problem = ContactProblem.of_residual(bodies.residual, bodies.u, bodies.conditions, pair)
    stepping = problem._finite
    nodes = stepping._positions, stepping._held, 0 * stepping._piece  # as if joined
    ways, path = np.zeros((65, 1, 3)), np.zeros((65, *nodes[0].shape))
    ways[:, 0, 1] = np.linspace(0.0, -1.1, 65)
    refuse_tools_through_supports(stepping.interface, stepping._surfaces, *nodes, ways, path)
