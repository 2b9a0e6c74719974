"""Small displacements are watched, surfaces stay outside, residuals do not cry wolf."""

import logging
from itertools import pairwise

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import Spaces
from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    SurfacePassed,
)
from pw_elements.contact.model import Smallness
from pw_elements.contact.steps.smallness import gradient_at_vertices, measure_largest_gradient
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from study.elements import composite, serendipity
from tests.contact.cases import BlockOnFloor, ElasticBody, PunchedBlock, on_plane
from tests.contact.polyline import Polyline
from tests.contact.test_matching import Blocks

BLOCK = BlockOnFloor(16)  # 4 x 2, on a clamped base in these tests
FOOT = BLOCK.clamp(on_plane(1, 0.0))
BALL = Sphere((2, 3), 1)
PLATE = Plane((0, 2), (0, -1))


def driven(surface, *motions, friction=0.0, body=BLOCK, supports=FOOT, level=2.0):
    """States of the block under a surface that takes these translations."""
    motions = [m if isinstance(m, Motion) else Motion(m) for m in motions]
    up = on_plane(len(motions[0].translation) - 1, level)
    return body.solve_contact(ContactPair(up, surface, friction, motions), supports)


# -- strain and rotation ---------------------------------------------------------------------


def bent(x):
    """Smooth and invertible on the unit square and cube."""
    return x + 0.08 * np.sin(2 * x[:, [1, 0, 2]] + np.array([0.0, 1.0, 2.0]))


def flat(build):
    return build(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 3))


def cube(cell):
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (2, 2, 2), cell)


SPACES = {
    "triangles": lambda: Spaces.galerkin(move_nodes(flat(triangles), bent)),
    "curved triangles": lambda: Spaces.petrov_galerkin(curved_mesh(flat(triangles), bent)),
    "quadrilaterals": lambda: Spaces.petrov_galerkin(move_nodes(flat(quadrilaterals), bent)),
    "8 nodes": lambda: serendipity(flat(quadrilaterals)),
    "composite": lambda: composite(move_nodes(flat(triangles), bent)),
    "tetrahedra": lambda: Spaces.petrov_galerkin(move_nodes(cube(CellType.tetrahedron), bent)),
    "hexahedra": lambda: Spaces.galerkin(move_nodes(cube(CellType.hexahedron), bent)),
}


def in_space(space, field):
    """Vector of the nodal values of a field of positions (n, 3), (n, dim)."""
    owned = space.dofmap.index_map.size_local
    values = field(space.tabulate_dof_coordinates()[:owned])[:, : space.mesh.geometry.dim]
    return PETSc.Vec().createWithArray(np.ascontiguousarray(values).ravel(), comm=MPI.COMM_SELF)


@pytest.mark.parametrize("name", SPACES)
def test_uniform_gradients_are_met_exactly(name):
    space = SPACES[name]().trial
    dim = space.mesh.geometry.dim
    u, rng = fem.Function(space), np.random.default_rng(8)
    gradient = gradient_at_vertices(u)
    turn = np.zeros((3, 3))
    turn[:2, :2] = [[0.0, -1e-3], [1e-3, 0.0]]
    along = np.zeros((3, 3))
    along[0, 0] = -0.02
    for A in [along, turn, *rng.normal(size=(5, 3, 3))]:
        displacement = in_space(space, lambda x, A=A: x @ A.T + 7.0)
        strain, rotation = measure_largest_gradient(gradient, u, displacement)
        part = A[:dim, :dim]
        assert strain == pytest.approx(np.linalg.norm(part + part.T, 2) / 2, abs=1e-12)
        assert rotation == pytest.approx(np.linalg.norm(part - part.T, 2) / 2, abs=1e-12)


# -- what states report ----------------------------------------------------------------------


def test_states_report_strain_rotation_and_slip():
    """Uniaxial stress: strain d/h, no rotation; the plate slips along and the block widens."""
    sides = BLOCK.make_supports((1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)))
    aside = Motion((-0.3, -0.02))
    state, rested, lifted = driven(PLATE, aside, aside, (3.0, 1.0), supports=sides)
    widened, edge = 0.3 * 0.01 * 4, 4 / 16
    expected = Smallness(0.01, 0.0, (0.3 + widened) / edge)
    assert vars(state.smallness) == pytest.approx(vars(expected), abs=1e-12)
    assert rested.smallness.slip == pytest.approx(0.0, abs=1e-12)  # of this increment
    assert lifted.smallness.slip == 0.0  # of what touches


def test_matching_nodes_slip_away_from_their_partners():
    """They keep them, so that all slip counts that there ever was."""
    blocks = Blocks()
    problem = blocks.contact_problem(blocks.make_pair(0.0), blocks.base_supports)
    state, slips = problem.undeformed, []
    for aside in (0.02, 0.05):
        state = problem.step(state, blocks.traction_load((0.0, -0.1)), [Motion((aside, 0.0))])
        (pair,) = state.pairs
        relative = np.abs(pair.displacement[:, 0] - aside).max()
        assert state.smallness.slip == pytest.approx(relative * 3)  # edges of 1/3
        slips.append(state.smallness.slip)
    assert slips[1] == pytest.approx(0.15, rel=0.1)


def test_leaving_the_range_is_logged_once(caplog):
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        driven(PLATE, (0, -0.001), (0, -0.2), (0, -0.25), (0, 0.0), friction=0.3)
    (record,) = caplog.records
    assert record.name == "pw_elements.contact"
    message = record.getMessage()
    assert message.startswith("increment 1 leaves the range of small displacements: largest strain")
    assert "(above 0.05)" in message


# -- surfaces that pass through --------------------------------------------------------------

ROUND = SignedDistance(lambda x: (x[:, 0] - 2) ** 2 + (x[:, 1] - 3) ** 2 - 1)
TIP = Polyline([(6, 4), (2, 2), (-2, 4)])
HALVES = [(0, -0.1 * k) for k in range(1, 25)]

PASSED = {
    "ball pulls": (BALL, [(0, -1.1)], "passes through .* nodes at .1.125, 2., .1.25, 2"),
    "ball is below": (BALL, [(0, -2.2)], "passes through"),
    "ball is far below": (BALL, [(0, -1e3)], "passes through"),
    "ball in steps": (BALL, HALVES, "passes through .* nodes at .2, 2.;"),
    "ball in fine steps": (BALL, [(0, -0.93 - 0.02 * k) for k in range(9)], "outwards|passes"),
    "ball from afar": (BALL, [(0, 20), (0, -2.2)], "passes through"),
    "ball goes through sideways": (BALL, [(-4, -1), (4, -1.5)], "passes through"),
    "level set": (ROUND, [(0, -2.2)], "passes through"),
    "plate": (PLATE, [(0, -10)], "whole thickness .* at .0, 2., .0.125, 2."),
    "plate just through": (PLATE, [(0, -2.001)], "whole thickness"),
    "slanted plate": (Plane((0, 2), (0.3, -1)), [(0, -4)], "whole thickness"),
    "flat punch": (FlatPunch((2, 2), (0, -1), 1), [(0, -3)], "whole thickness"),
    "parabola": (Parabola((2, 2), 1), [(0, -3)], "whole thickness"),
    "tip": (TIP, [(0, -3)], "whole thickness"),
}


@pytest.mark.parametrize("name", PASSED)
def test_surfaces_do_not_pass_through(name):
    surface, motions, message = PASSED[name]
    with pytest.raises(SurfacePassed, match="contact pair 0 .*" + message) as caught:
        driven(surface, *motions)
    assert len(caught.value.states) < len(motions)


ALLOWED = {
    "deep": (PLATE, [(0, -1.999998)]),
    "far along": (PLATE, [(1e2, -0.1)]),
    "lifted far": (PLATE, [(0, -0.1), (100, 1e5), (0, -0.1)]),
    "ball rolls by": (BALL, [(20, -0.01), (-30, -0.01), (0, -0.01)]),
    "ball comes from afar": (BALL, [(0, 1e5), (0, -0.01)]),
    "ball passes over the corner": (BALL, [(-3, -0.1), (0, -0.1)]),
    "ball goes round the side": (BALL, [(10, 0), (10, -10), (0, -10)]),
    "level set": (ROUND, [(5, -0.3), (-5, -0.3), (0, -0.3)]),
    "punch slides off": (FlatPunch((2, 2), (0, -1), 1), [(0, -0.1), (1.5, -0.1), (9, -5)]),
    "tip ploughs": (TIP, [(-1, -0.2), (1, -0.2)]),
    "parabola": (Parabola((2, 2), 4), [(50, -0.1), (-50, -0.1), (0, -0.1)]),
}


@pytest.mark.parametrize("name", ALLOWED)
def test_surfaces_may_go_where_they_like_outside(name):
    surface, motions = ALLOWED[name]
    states = driven(surface, *motions, friction=0.3)
    assert len(states) == len(motions)
    assert all(state.residuals.largest() < 1e-10 for state in states)


def test_a_plate_from_below_may_come_as_near_to_the_far_side_as_one_from_above():
    options = {"supports": BLOCK.clamp(on_plane(1, 2.0)), "level": 0.0}
    assert driven(Plane((0, 0), (0, 1)), (0, 1.999998), **options)
    with pytest.raises(SurfacePassed, match="whole thickness"):
        driven(Plane((0, 0), (0, 1)), (0, 2.000002), **options)


@pytest.mark.parametrize("cell", [CellType.tetrahedron, CellType.hexahedron])
def test_thickness_in_space(cell):
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (2, 2, 1)], (4, 4, 2), cell)
    body = ElasticBody(mesh, state="solid")
    options = {"body": body, "supports": body.clamp(on_plane(2, 0.0)), "level": 1.0}
    plate, ball = Plane((0, 0, 1), (0, 0, -1)), Sphere((1, 1, 1.5), 0.5)
    assert driven(plate, (0, 0, -0.9), **options)[0].smallness.strain > 0.9
    assert driven(ball, (0, 0, -0.02), **options)
    for surface, depth, words in (
        (plate, 1.01, "whole thickness"),
        *((ball, depth, "passes through") for depth in (0.6, 1.6, 10.0)),
    ):
        with pytest.raises(SurfacePassed, match=words):
            driven(surface, (0, 0, -depth), **options)


def test_ways_through_the_body_by_brute_force():
    """Random ways of balls above and below the top: a dense sampling of each says the same."""
    rng = np.random.default_rng(1)
    # sides of the block see the outermost ones
    x = BLOCK.x[np.isclose(BLOCK.x[:, 1], 2.0) & (np.abs(BLOCK.x[:, 0] - 2) < 1.99)]
    found = []
    for _ in range(20):
        way = rng.uniform((-3, -3), (3, 0.2))
        centres = np.array([2.0, 3.0]) + np.linspace(0, 1, 4001)[:, None] * way
        away = x[:, None] - centres
        distance = np.linalg.norm(away, axis=2)
        inside = 1 - distance
        outwards = away[:, :, 1] / distance
        clearly = np.any((inside > 0.05) & (outwards > 0.2))
        hardly = np.any((inside > 0) & (outwards > 0.1))
        message = ""
        try:
            driven(BALL, tuple(way))
        except SurfacePassed as error:
            message = str(error)
        passed = "passes through" in message or "outwards" in message
        assert passed >= clearly
        assert passed <= hardly
        found.append(passed)
    assert 3 < sum(found) < 17


# -- residuals of unloaded states ------------------------------------------------------------


def test_histories_carry_their_scale(tmp_path):
    """Pressed, and released by a ten-thousandth at a time until nothing is left."""
    case = PunchedBlock()
    problem = case.contact_problem(case.punch_pair(0.6), case.base_supports)
    depths, states = (-0.2, -0.1, -1e-5, -1e-9, -1e-13, 0.0, 5.0, -0.05), [problem.undeformed]
    for depth in depths:
        motion = [Motion((0.01 if depth < -0.01 else 0.0, depth))]
        states.append(problem.step(states[-1], case.zero_load, motion))
    for before, after in pairwise(states):
        assert after.scale.force >= before.scale.force
        assert after.residuals.largest() < 1e-10
    largest = np.hypot(
        states[1].pairs[0].force_normal, np.abs(states[1].pairs[0].force_tangential[:, 0])
    ).max()
    assert states[-1].scale.force == pytest.approx(largest)
    assert states[-1].scale.length < 0.3  # not the way through the air
    problem.save(states[-2], tmp_path / "lifted.npz")
    read = problem.load(tmp_path / "lifted.npz")
    assert (read.scale, read.smallness) == (states[-2].scale, states[-2].smallness)
