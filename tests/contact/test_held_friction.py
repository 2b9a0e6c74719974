"""Friction at contact nodes whose motion along the surface a support prescribes."""

from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import Direct, Iterative, Reduction, prescribe
from pw_elements.contact import (
    HELD,
    SLIP,
    STICK,
    ContactPair,
    Motion,
    NoEquilibrium,
    NotFound,
    Plane,
)
from pw_elements.meshes import quadrilaterals
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.iterative import SolidBlock
from tests.contact.residuals import (
    ProblemData,
    largest_residual,
    measure_residuals,
    split_into_substeps,
)
from tests.contact.test_large import RubberUnderCircle
from tests.contact.test_large import step_through as steps
from tests.contact.test_matching import Blocks
from tests.contact.two_bodies import StackedBlocks, split_facets_by_side
from tests.parallel import same_numbers

MU = 0.3
SOLVERS = pytest.mark.parametrize("solver", [Direct(), Iterative()], ids=["factors", "krylov"])
PRESSED = Motion((0.0, None), force=(0.0, -10.0))


class Held(ElasticBody):
    """A unit square whose sides (or all nodes) are held along x, and a rough plate on top."""

    def __init__(self, n, everywhere=False, comm=MPI.COMM_SELF):
        super().__init__(quadrilaterals(comm, (0.0, 0.0), (1.0, 1.0), (n, n)))
        sides = [(0, on_plane(0, 0.0)), (0, on_plane(0, 1.0)), (0, on_plane(1, 0.0))]
        along = [(0, lambda x: x[0] > -1)] if everywhere else sides
        self.supports = self.make_supports((1, on_plane(1, 0.0)), *along)

    def under_plate(self, *motions, **options):
        plate = ContactPair(on_plane(1, 1.0), Plane((0.0, 1.0), (0.0, -1.0)), MU, list(motions))
        return self.solve_contact(plate, self.supports, **options)


def assert_law(pair, before, friction=MU, tol=1e-9):
    """Each closed node's friction, by arithmetic of displacements; some nodes slip."""
    moved = (pair.displacement - pair.translation) - (before.displacement - before.translation)
    slip = moved - np.sum(moved * pair.normal, axis=1)[:, None] * pair.normal
    most, limit = pair.force_normal.max(), friction * pair.force_normal
    size = np.linalg.norm(pair.force_tangential, axis=1)
    assert (size <= limit + tol * most).all()
    length = np.linalg.norm(slip, axis=1)
    slides = (length > 1e-6 * length.max()) & (limit > 1e-6 * most)
    assert slides.any()
    off = pair.force_tangential * length[:, None] + limit[:, None] * slip
    assert np.linalg.norm(off, axis=1).max() < tol * most * length.max()
    assert set(pair.status[slides]) == {SLIP}
    assert pair.slip[slides] == pytest.approx(slip[slides], abs=1e-12)


@SOLVERS
@pytest.mark.parametrize("n", [4, 8])
def test_a_plate_that_slides_over_a_block_between_walls_has_all_its_friction(n, solver):
    for press in (Motion((0.0, -0.01)), PRESSED):
        drag = replace(press, translation=(0.05, press.translation[1]))
        pressed, dragged = Held(n).under_plate(press, drag, solver=solver)
        (pair,) = dragged.pairs
        assert pair.force[0] == pytest.approx(-MU * pair.force[1], rel=1e-9)
        assert (pair.status == SLIP).all()
        assert_law(pair, pressed.pairs[0])
        assert dragged.residuals.largest() < 1e-9


def test_friction_turns_with_the_slip_and_stays_where_there_is_none():
    """Dragged there and back, left alone, left alone under a tenth of the force, and lifted."""
    ways = [0.0, 0.05, 0.02, 0.02, 0.02, 0.02]
    forces = [-10.0, -10.0, -10.0, -10.0, -1.0, 0.0]
    motions = [Motion((x, None), force=(0.0, f)) for x, f in zip(ways, forces, strict=True)]
    motions[-1] = Motion((0.02, 0.1))
    states = Held(4, everywhere=True).under_plate(*motions)
    total = [state.pairs[0].force[0] for state in states]
    expected = [0.0, 10 * MU, -10 * MU, -10 * MU, -MU, 0.0]
    assert total == pytest.approx(expected, abs=1e-9)
    statuses = [set(state.pairs[0].status) for state in states]
    assert statuses[:5] == [{STICK}, {SLIP}, {SLIP}, {STICK}, {STICK}]


@SOLVERS
def test_a_plate_that_a_force_pushes_sticks_to_nodes_that_supports_hold(solver):
    block = Held(4, everywhere=True)
    push = [Motion((None, None), force=(part * 10 * MU, -10.0)) for part in (0.3, 0.99, -0.99)]
    _, *pushed = block.under_plate(PRESSED, *push, solver=solver)
    for part, state in zip((0.3, 0.99, -0.99), pushed, strict=True):
        (pair,) = state.pairs
        assert pair.force[0] == pytest.approx(part * 10 * MU, rel=1e-9)
        assert abs(pair.translation[0]) < 1e-9 * abs(pair.translation[1])
        size = np.abs(pair.force_tangential[:, 0])
        assert (size <= MU * pair.force_normal * (1 + 1e-9)).all()
        assert state.residuals.largest() < 1e-9
    with pytest.raises(NoEquilibrium, match="slides"):
        block.under_plate(PRESSED, Motion((None, None), force=(10.01 * MU, -10.0)), solver=solver)


@SOLVERS
def test_held_and_free_nodes_share_what_a_plate_is_pushed_by(solver):
    """Between smooth walls; most nodes slip before the plate does."""
    push = [Motion((None, None), force=(f, -10.0)) for f in (1.0, 2.9)]
    states = Held(8).under_plate(PRESSED, *push, solver=solver)
    for before, state, force in zip(states, states[1:], (1.0, 2.9), strict=False):
        (pair,) = state.pairs
        assert pair.force == pytest.approx([force, -10.0], abs=1e-8)
        assert_law(pair, before.pairs[0], tol=1e-8)
    with pytest.raises(NoEquilibrium):
        Held(8).under_plate(PRESSED, Motion((None, None), force=(3.01, -10.0)), solver=solver)


def in_space(solid, *motions, **options):
    """A block 2 x 1 x 1 on its foot, held along x at both ends, under a plate."""
    supports = solid.make_supports(
        (0, on_plane(0, 0.0)), (0, on_plane(0, 2.0)), *((i, on_plane(2, 0.0)) for i in range(3))
    )
    plate = ContactPair(on_plane(2, 1.0), Plane((0, 0, 1), (0, 0, -1)), MU, list(motions))
    return solid.solve_contact(plate, supports, **options)


SLANTED = [Motion((0, 0, -0.01)), Motion((0.02, 0.03, -0.01)), Motion((0.02, 0.0, -0.02))]


@SOLVERS
def test_in_space_the_disc_couples_a_held_and_a_free_tangent(solver):
    states = in_space(SolidBlock(n=2), *SLANTED, solver=solver)
    for before, state in pairwise(states):
        assert_law(state.pairs[0], before.pairs[0])
        assert state.iterations <= 12
    ends = np.isin(states[1].pairs[0].position[:, 0], (0.0, 2.0))
    along = states[1].pairs[0].force_tangential[ends]
    assert np.abs(along[:, :2]).min() > 0  # in both directions


@SOLVERS
def test_in_space_a_plate_is_free_along_the_direction_that_supports_hold(solver):
    motions = [Motion((0, 0, -0.01)), Motion((None, 0.03, -0.01), force=(0.5, 0.0, 0.0))]
    pressed, moved = in_space(SolidBlock(n=2), *motions, solver=solver)
    (pair,) = moved.pairs
    assert pair.force[0] == pytest.approx(0.5, rel=1e-8)
    assert_law(pair, pressed.pairs[0], tol=1e-7)


def test_a_ring_that_is_pushed_off_its_shaft_takes_all_of_the_friction():
    """Its end is held, and with it the nodes at the end of the bore."""
    mesh = quadrilaterals(MPI.COMM_SELF, (1.0, 0.0), (2.0, 1.0), (6, 8))
    ring = ElasticBody(mesh, state="axisymmetric")
    supports = ring.make_supports((1, on_plane(1, 0.0)))
    shaft = ContactPair(
        on_plane(0, 1.0),
        Plane((1.0, 0.0), (1.0, 0.0)),
        MU,
        [Motion((1e-3, 0.0)), Motion((1e-3, -0.1))],
    )
    for state, all_slip in zip(ring.solve_contact(shaft, supports), (False, True), strict=True):
        (pair,) = state.pairs
        if all_slip:
            assert pair.force[1] == pytest.approx(-MU * pair.force[0], rel=1e-9)
            held = np.isclose(pair.position[:, 1], 0.0)
            assert pair.force_tangential[held, 1] == pytest.approx(-MU * pair.force_normal[held])


def test_on_the_axis_there_is_no_friction():
    """A plate may grow in radius; its middle has no direction to drag the node there."""
    mesh = quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 4))
    disc = ElasticBody(mesh, state="axisymmetric")
    motions = [Motion((0.0, -0.01)), Motion((0.02, -0.01))]
    plate = ContactPair(on_plane(1, 1.0), Plane((0.0, 1.0), (0.0, -1.0)), MU, motions)
    supports = disc.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, 0.0)))
    (pair,) = disc.solve_contact(plate, supports)[-1].pairs
    on_axis = np.isclose(pair.position[:, 0], 0.0)
    assert pair.force_normal[on_axis].min() > 0
    assert not pair.force_tangential[on_axis].any()
    assert np.abs(pair.force_tangential[~on_axis, 0]) == pytest.approx(
        MU * pair.force_normal[~on_axis]
    )


def test_matching_nodes_that_supports_move_apart_rub_on_each_other():
    """The upper block is moved between walls that go with it."""
    blocks = Blocks()
    below, above = split_facets_by_side(blocks, on_plane(1, 1.0), lambda x: x[:, 1] > 1)
    supports = blocks.make_supports((1, on_plane(1, 0.0)), (0, below), (0, above, 0.05))
    (state,) = blocks.solve_contact(
        blocks.make_pair(MU), supports, blocks.traction_load((0.0, -3.0))
    )
    (pair,) = state.pairs
    assert (pair.status == SLIP).all()
    assert pair.force_tangential[:, 0] == pytest.approx(-MU * pair.force_normal, rel=1e-9)


@pytest.mark.parametrize("dragged", [0.0, 0.05])
def test_bodies_that_supports_drag_over_each_other_are_refused(dragged):
    """Walls that hold both sides alike are planes of symmetry, with no friction along them."""
    stack = StackedBlocks((4, 3))
    below, above = split_facets_by_side(stack, on_plane(0, 0.0), lambda x: x[:, 1] > 1)
    supports = stack.make_supports((1, on_plane(1, 0.0)), (0, below), (0, above, dragged))
    pair = stack.make_pair(friction=0.3)
    given = pair, supports, stack.traction_load((0.0, -0.01))
    if dragged:
        with pytest.raises(ValueError, match="not moved in the same way"):
            stack.solve_contact(*given)
    else:
        (state,) = stack.solve_contact(*given)
        assert HELD in state.pairs[0].status


class TestLargeSliding:
    def test_a_plate_has_all_its_friction(self):
        rubber = RubberUnderCircle(n=3, friction=MU)
        sides = [prescribe(rubber.space, 0, on_plane(0, x), 0.0) for x in (-1.0, 1.0)]
        plate = rubber.problem_with(
            conditions=rubber.conditions + sides, surface=Plane((0.0, 0.0), (0.0, -1.0))
        )
        way = [Motion((0.0, -0.1)), Motion((0.3, -0.1)), Motion((0.25, -0.1))]
        states = steps(plate, [*way, Motion((None, -0.1), force=(0.02, 0.0))])
        for before, state in pairwise(states[:3]):
            assert_law(state.pairs[0], before.pairs[0])
        (pair,) = states[1].pairs
        assert pair.force[0] == pytest.approx(-MU * pair.force[1], rel=1e-9)
        (pushed,) = states[3].pairs
        assert pushed.force[0] == pytest.approx(0.02, rel=1e-8)
        assert all(state.residuals.largest() < 1e-8 for state in states)

    def test_a_plate_that_turns_rubs_on_nodes_that_a_support_holds(self):
        """At an angle the support bears a part of the normal force, too."""
        rubber = RubberUnderCircle(n=3, friction=MU)
        top = prescribe(rubber.space, 0, on_plane(1, 0.0), 0.0)
        plate = rubber.problem_with(
            conditions=[*rubber.conditions, top],
            surface=Plane((0.0, 0.0), (0.0, -1.0)),
            pivot=(0.0, 0.0),
        )
        way = [Motion((0.0, -0.1)), Motion((0.1, -0.1), rotation=0.05)]
        _, state = steps(plate, way)
        (pair,) = state.pairs
        normal = -np.array([-np.sin(0.05), np.cos(0.05)])
        closed = pair.force_normal > 0
        assert closed.all()
        assert pair.normal == pytest.approx(np.tile(normal, (len(closed), 1)))
        size = np.linalg.norm(pair.force_tangential, axis=1)
        assert size == pytest.approx(MU * pair.force_normal, rel=1e-9)
        assert (pair.force_tangential @ [1.0, 0.0] > 0).all()  # dragged along x
        vertical = pair.force_normal * normal[1] + pair.force_tangential[:, 1]
        assert pair.force[1] == pytest.approx(vertical.sum())

    def test_half_of_a_symmetric_block_has_the_friction_of_the_whole(self):
        """A circle presses in two steps; the node below it is held along the surface."""
        forces = []
        for left in (-1.0, 0.0):
            mesh = quadrilaterals(MPI.COMM_SELF, (left, -1.0), (1.0, 0.0), (4 - int(4 * left), 4))
            rubber = RubberUnderCircle(mesh=mesh, friction=MU)
            held = rubber.conditions + [prescribe(rubber.space, 0, on_plane(0, 0.0), 0.0)] * (
                left == 0
            )
            problem = rubber.problem_with(conditions=held)
            *_, state = steps(problem, [Motion((0.0, -0.05)), Motion((0.0, -0.1))])
            pair = state.pairs[0]
            forces.append(pair.force_vector[pair.position[:, 0] > -1e-9])
        whole, half = forces
        whole[0] /= 2
        assert abs(half[0, 1]) > 0.01
        assert half == pytest.approx(whole, abs=1e-9)


def on_processes(comm):
    plane = Held(4, comm=comm).under_plate(
        PRESSED,
        Motion((None, None), force=(2.0, -10.0)),
        Motion((0.05, None), force=(0.0, -10.0)),
    )
    numbers = {}
    for k, state in enumerate([*plane, *in_space(SolidBlock(n=1, comm=comm), *SLANTED)]):
        pair = state.pairs[0]
        numbers |= {f"{k} force": pair.force_vector, f"{k} status": pair.status}
    return numbers


def test_several_processes_find_the_same():
    same_numbers(on_processes, processes=(2,), rel=1e-9)


def test_derivatives_are_refused_where_friction_acts_on_supports():
    block = Held(4)
    plate = ContactPair(on_plane(1, 1.0), Plane((0.0, 1.0), (0.0, -1.0)), MU)
    problem = block.contact_problem(plate, block.supports)
    nothing = block.zero_load
    pressed = problem.step(problem.undeformed, nothing, Motion((0.0, -0.01)))
    dragged = problem.step(pressed, nothing, Motion((0.05, -0.01)))
    states = [problem.undeformed, pressed, dragged]
    with pytest.raises(ValueError, match="supports hold them"):
        problem.sensitivity(states, [("force", 0, 0)], [("friction", 0)])


# of which no state is found: a plate in space, dragged in one direction and pushed by a force in
# the other, in which supports hold some of its nodes
LOST = {1, 13}


def random_history(seed):
    """A block on its foot, nodes of its top held along it at random, under a rough plate."""
    rng = np.random.default_rng([47, seed])
    dim = int(rng.integers(2, 4))
    body = Held(3) if dim == 2 else SolidBlock("hexahedron", n=1)
    up, end = dim - 1, 1.0 if dim == 2 else 2.0
    top = on_plane(up, 1.0)
    places = [on_plane(0, 0.0), on_plane(0, end), top] + (
        [on_plane(1, 0.0), on_plane(1, 1.0)] if dim == 3 else []
    )
    given = [(axis, on_plane(up, 0.0), 0.0) for axis in range(dim)]
    for axis in range(up):
        for where in places:
            if rng.random() < (0.15 if where is top else 0.4):
                given.append((axis, where, 0.0))
    conditions = [prescribe(body.space, *one) for one in given]
    mu, motions = float(rng.choice([0.1, 0.5, 1.0])), []
    press = 0.02 * np.arange(1, 5) if rng.random() < 0.5 else None
    for k in range(4):
        pushed = k > 0 and rng.random() < 0.4
        way = (0.01 * rng.normal(size=up) * (k > 0)).tolist()
        force = [0.0] * dim
        if pushed:
            axis = int(rng.integers(0, up))
            way[axis], force[axis] = None, float(rng.uniform(-0.8, 0.8) * mu * 10.0)
        if press is None:
            force[up] = -10.0
        motions.append(Motion((*way, None if press is None else -float(press[k])), force=force))
    corner = [0.0] * up + [1.0]
    plate = ContactPair(top, Plane(corner, [0.0] * up + [-1.0]), mu, motions)
    loads = [body.zero_load] * 4
    return body, ProblemData(body.K, body.space, loads, conditions, [plate])


@pytest.mark.parametrize("seed", range(24))
def test_random_plates_on_random_supports_obey_the_law(seed):
    """By arithmetic of its own."""
    body, stated = random_history(seed)
    supports = Reduction.dirichlet(body.space, stated.conditions)
    try:
        states = body.solve_contact(stated.pairs, supports, stated.loads)
    except NotFound as refused:
        assert seed in LOST
        states = refused.states
    assert largest_residual(measure_residuals(*split_into_substeps(stated, states))) < 1e-8
