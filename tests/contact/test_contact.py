import functools

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactPair,
    Motion,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved, mapped, quadrilaterals, triangles
from tests.contact.cases import Block, at

PRESSURE = 3.0


def skewed(x):
    """Moves all nodes of the unit square but in y those below and above, in x those aside."""
    moved = x.copy()
    bubble = np.sin(np.pi * x[:, 0])
    moved[:, 0] += 0.07 * bubble + 0.05 * bubble * np.sin(5 * x[:, 1])
    moved[:, 1] += 0.06 * np.sin(np.pi * x[:, 1]) * np.cos(4 * x[:, 0])
    return moved


ELEMENTS = {
    "galerkin-T6": (triangles, Spaces.galerkin, (1 / 6, 2 / 3)),
    "pw-T6": (triangles, Spaces.petrov_galerkin, (1 / 4, 1 / 2)),
    "galerkin-Q8": (quadrilaterals, Spaces.serendipity, (1 / 6, 2 / 3)),
    "galerkin-Q9": (quadrilaterals, Spaces.galerkin, (1 / 6, 2 / 3)),
    "pw-Q9": (quadrilaterals, Spaces.petrov_galerkin, (1 / 4, 1 / 2)),
}


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("state", [StressState.PLANE_STRESS, StressState.PLANE_STRAIN])
def test_contact_patch(element, state):
    """A uniform pressure arrives at the rigid plane as exact nodal forces on a skewed mesh."""
    build, method, (end, middle) = ELEMENTS[element]
    mesh = mapped(build(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 4)), skewed)
    body = Body(method(mesh), Material(10.0, 0.3), state)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.surface_load((0.0, -PRESSURE), boundary_measure(mesh, at(1, 1.0))))
    left = Reduction.dirichlet(U, [prescribe(U, 0, at(0, 0.0))])
    pair = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)))
    (state_,) = solve_contact(K, f, left, [pair], U)
    (contact,) = state_.pairs

    length = np.diff(contact.position[::2, 0])
    expected = np.zeros(len(contact.position))
    np.add.at(expected, np.arange(0, len(expected) - 2, 2), end * length)
    np.add.at(expected, np.arange(1, len(expected), 2), middle * length)
    np.add.at(expected, np.arange(2, len(expected), 2), end * length)
    assert contact.force_normal / expected == pytest.approx(PRESSURE, rel=1e-10)
    assert np.abs(contact.force_tangential).max() < 1e-10
    assert state_.iterations == 1
    assert state_.residuals.largest() < 1e-12


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_contact_patch_in_space(method):
    """Corners of a face carry nothing on T10, a twelfth of the face with macro functions."""
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], CellType.tetrahedron)
    body = Body(method(mesh), Material(10.0, 0.3), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    top, foot = (boundary_measure(mesh, at(2, z)) for z in (1.0, 0.0))
    f = assemble_vector(body.surface_load((0.0, 0.0, -PRESSURE), top))
    even = assemble_vector(body.surface_load((0.0, 0.0, PRESSURE), foot)).array_r.reshape(-1, 3)
    sides = Reduction.dirichlet(U, [prescribe(U, i, at(i, 0.0)) for i in range(2)])
    pair = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
    (state,) = solve_contact(K, f, sides, [ContactPair(pair.nodes, pair.surface)], U)
    (contact,) = state.pairs
    x = U.tabulate_dof_coordinates()
    for place, force in zip(contact.position, contact.force_normal, strict=True):
        node = np.argmin(np.linalg.norm(x - place, axis=1))
        assert force == pytest.approx(even[node, 2], abs=1e-10)
    assert contact.force == pytest.approx((0, 0, PRESSURE), abs=1e-10)
    assert state.residuals.largest() < 1e-12


# mu, traction/pressure, divisions, stick zone, pressure and shear over 200 by position
TABLE = {
    "t .15, 80x40": (
        (0.3, 0.15, 80),
        (0.2, 3.025),
        {0.5: 0.939, 1: 0.914, 2: 0.9035, 3: 0.948, 3.5: 1.099},
        {1: -0.043, 2: 0.073, 3: 0.249},
    ),
    "t .30, 20x10": (
        (0.3, 0.30, 20),
        (0.2, 2.20),
        {0.5: 0.883, 1: 0.881, 2: 0.889, 3: 1.009, 3.5: 1.156},
        {1: 0.024, 2: 0.191, 3: 0.303},
    ),
    "t .30, 80x40": (
        (0.3, 0.30, 80),
        (0.2, 2.125),
        {0.5: 0.875, 1: 0.881, 2: 0.890, 3: 1.014, 3.5: 1.163},
        {1: 0.025, 2: 0.202, 3: 0.304},
    ),
    "t .40, 80x40": (
        (0.3, 0.40, 80),
        (0.2, 1.425),
        {0.5: 0.821, 1: 0.858, 2: 0.936, 3: 1.039, 3.5: 1.193},
        {1: 0.106, 2: 0.281, 3: 0.312},
    ),
    "mu .5, t .50, 80x40": (
        (0.5, 0.50, 80),
        (0.2, 2.70),
        {0.5: 0.818, 1: 0.843, 2: 0.860, 3: 0.995, 3.5: 1.240},
        {1: 0.080, 2: 0.241, 3: 0.498},
    ),
}


@functools.cache
def block(n):
    return Block(n)


@pytest.mark.parametrize("case", TABLE)
def test_block_on_a_rough_plane(case):
    """Table of section 7.2, from an independent prototype."""
    (mu, ratio, n), (first, last), pressure, shear = TABLE[case]
    states = block(n).solve(mu, 200 * ratio)
    contact = states[-1].pairs[0]
    x = contact.position[:, 0]
    stick = x[contact.status == STICK]
    assert (stick.min(), stick.max()) == pytest.approx((first, last), abs=1e-9)
    tributary = 4 / (2 * n)
    for at_x, value in pressure.items():
        r_n = contact.force_normal[np.isclose(x, at_x)]
        assert r_n / tributary / 200 == pytest.approx(value, abs=6e-4)
    for at_x, value in shear.items():
        r_t = contact.force_tangential[np.isclose(x, at_x), 0]
        assert -r_t / tributary / 200 == pytest.approx(value, abs=6e-4)
    assert contact.force == pytest.approx((-400 * ratio, 800.0), rel=1e-9)
    for state in states:
        assert state.residuals.largest() < 1e-10
        assert state.iterations <= 8
        (step,) = state.pairs
        power = np.sum(step.slip * step.force_tangential, axis=1)
        assert np.all(power[step.status == SLIP] < 1e-12)


def test_node_between_smooth_and_rough_matters():
    pulled = [
        block(20).solve(0.3, 60.0, shared_is_rough=rough)[-1].displacement
        for rough in (True, False)
    ]
    u = [a.array_r.reshape(-1, 2)[:, 0].mean() for a in pulled]
    assert 1.03 < u[1] / u[0] < 1.15


def test_start_from_a_coarser_mesh():
    """Same answer, in as many iterations as it takes to correct the ends of the zones."""
    coarse = block(40).solve(0.3, 60.0, increments=3)
    warm = block(80).solve(0.3, 60.0, increments=3, start=coarse)
    cold = block(80).solve(0.3, 60.0, increments=3)
    for a, b in zip(warm, cold, strict=True):
        assert a.displacement.array_r == pytest.approx(b.displacement.array_r, abs=1e-9)
        assert a.pairs[0].status.tolist() == b.pairs[0].status.tolist()
        assert a.iterations <= 3
        assert a.iterations <= b.iterations
    again = block(80).solve(0.3, 60.0, increments=3, start=cold)
    assert [state.iterations for state in again] == [1, 1, 1, 1]


def test_stick_remembers_its_slip():
    """Pulled and let go, the block does not come back to where it was pressed."""
    loads = block(20).pulled(60.0, 4)
    path = [*loads, *loads[-2::-1]]
    states = solve_contact(
        block(20).K, path, block(20).free, [block(20).pair(0.3)], block(20).space
    )
    pressed, back = states[0], states[-1]
    assert back.pairs[0].force == pytest.approx((0, 800), abs=1e-9)
    slipped = sum(state.pairs[0].slip for state in states)
    assert np.abs(slipped[:, 0]).max() > 1e-3
    difference = back.displacement - pressed.displacement
    assert difference.norm(PETSc.NormType.INFINITY) > 1e-3
    x = block(20).owned()
    foot = np.flatnonzero(np.isclose(x[:, 1], 0.0))
    foot = foot[np.argsort(x[foot, 0])]
    moved = difference.array_r.reshape(-1, 2)[foot]
    total = slipped - pressed.pairs[0].slip  # open or not, contact nodes move as they slip
    assert moved[:, 0] == pytest.approx(total[:, 0], abs=1e-12)


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_block_between_two_surfaces(method):
    """Two pairs: the floor, and a smooth plate on top that goes down and carries a force."""
    b = Block(10, method)
    nothing = b.K.createVecLeft()
    floor = b.pair(0.3, smooth=0.0)
    plate = Plane((0, 2.5), (0, -1))
    down = ContactPair(at(1, 2.0), plate, 0.0, [Motion((0, -0.8))])
    (state,) = solve_contact(b.K, nothing, b.free, [floor, down], b.space)
    below, above = state.pairs
    assert below.force[1] == pytest.approx(-above.force[1])
    assert above.gap == pytest.approx(0, abs=1e-12)
    assert state.residuals.largest() < 1e-11
    force = ContactPair(at(1, 2.0), plate, 0.0, [Motion((0, None), (0, above.force[1]))])
    (other,) = solve_contact(b.K, nothing, b.free, [floor, force], b.space)
    assert other.pairs[1].translation == pytest.approx((0, -0.8))
    assert other.displacement.array_r == pytest.approx(state.displacement.array_r, abs=1e-9)


def test_tilted_world_gives_the_same_contact():
    """Nothing depends on the axes: the block, floor and loads turned by 30 degrees."""
    turn = np.array([[np.sqrt(3), -1.0], [1.0, np.sqrt(3)]]) / 2
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (4.0, 2.0), (20, 10))

    def below(x):
        return np.isclose(turn.T[1] @ x[:2], 0.0)

    mapped(mesh, lambda x: np.column_stack([x[:, :2] @ turn.T, x[:, 2]]))
    body = Body(Spaces.petrov_galerkin(mesh), Material(1000.0, 0.3), StressState.PLANE_STRESS)
    U = body.spaces.trial

    def load(traction, where):
        return assemble_vector(body.surface_load(turn @ traction, boundary_measure(mesh, where)))

    pressure = load((0.0, -200.0), lambda x: np.isclose(turn.T[1] @ x[:2], 2.0))
    pulled = pressure + load((60.0, 0.0), lambda x: np.isclose(turn.T[0] @ x[:2], 4.0))

    def friction(x):
        along = turn.T[0] @ x[:2]
        return np.where((along > 0.2 - 1e-9) & (along < 3.8 + 1e-9), 0.3, 0.0)

    floor = ContactPair(below, Plane((0, 0), turn[:, 1]), friction)
    K = assemble_matrix(body.stiffness())
    turned = solve_contact(K, [pressure, pulled], Reduction.dirichlet(U, []), [floor], U)
    straight = block(20).solve(0.3, 60.0, increments=1)
    for a, b in zip(turned, straight, strict=True):
        assert a.pairs[0].force_normal == pytest.approx(b.pairs[0].force_normal, abs=1e-9)
        tangential = b.pairs[0].force_tangential @ turn.T
        assert a.pairs[0].force_tangential == pytest.approx(tangential, abs=1e-9)
        assert a.pairs[0].status.tolist() == b.pairs[0].status.tolist()


def test_residuals_of_contacts_without_force_or_displacement():
    block, nothing = Block(4), Block(4).K.createVecLeft()
    pressed = block.pulled(0.0, increments=1)[0]
    foot = Reduction.dirichlet(block.space, [prescribe(block.space, 0, at(0, 0.0))])
    states = solve_contact(
        block.K, [pressed, nothing, pressed], foot, [block.pair(0.3)], block.space
    )
    assert max(state.residuals.largest() for state in states) < 1e-9
    # all nodes stick between two walls, and never move against them
    walls = [
        ContactPair(
            at(0, 0.0), Plane((0, 0), (1, 0)), 2.0, [Motion((0.01 * k, 0)) for k in (1, 2)]
        ),
        ContactPair(
            at(0, 4.0), Plane((4, 0), (-1, 0)), 2.0, [Motion((-0.01 * k, 0)) for k in (1, 2)]
        ),
    ]
    states = solve_contact(block.K, [nothing] * 2, block.free, walls, block.space)
    assert all(np.all(pair.status == STICK) for state in states for pair in state.pairs)
    assert max(state.residuals.largest() for state in states) < 1e-9


@pytest.mark.parametrize("divisions", [(90, 12), (100, 12)])
def test_soft_ring_between_plates(divisions):
    """Large displacements of a soft body: round-off of gaps counts for more than elsewhere."""

    def bent(x):
        return np.column_stack((x[:, 0] * np.cos(x[:, 1]), x[:, 0] * np.sin(x[:, 1]), x[:, 2]))

    around, across = divisions
    sector = quadrilaterals(MPI.COMM_SELF, (14.0, 0.0), (20.0, np.pi / 2), (across, around))
    body = Body(
        Spaces.petrov_galerkin(curved(sector, bent)), Material(2.0, 0.49), StressState.PLANE_STRAIN
    )
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    symmetry = Reduction.dirichlet(U, [prescribe(U, 1, at(1, 0.0)), prescribe(U, 0, at(0, 0.0))])
    steps = 8
    plate = ContactPair(
        lambda x: (np.hypot(x[0], x[1]) > 20 - 1e-6) & (x[1] > 17.0),
        Plane((0, 20), (0, -1)),
        0.2,
        [Motion((0, -0.6 * k / steps)) for k in range(1, steps + 1)],
    )
    states = solve_contact(K, [K.createVecLeft()] * steps, symmetry, [plate], U)
    assert max(state.residuals.largest() for state in states) < 1e-8
    force = [-state.pairs[0].force[1] for state in states]
    assert np.all(np.diff(force) > 0)


@pytest.mark.parametrize("gap", [1e-4, 0.01, 0.2])
@pytest.mark.parametrize("force", [1.0, 100.0])
def test_block_tips_from_one_pad_to_another(gap, force):
    """Held by friction on three pads, the right one lower by a gap, and loaded left, then right."""
    block = Block(16)

    def pad(low, high, level):
        def marker(x):
            return np.isclose(x[1], 0) & (x[0] > low - 1e-9) & (x[0] < high + 1e-9)

        return ContactPair(marker, Plane((0, -level), (0, 1)), 0.3)

    pads = [pad(0, 0.5, 0.0), pad(1.75, 2.25, 0.0), pad(3.5, 4.0, gap)]
    left = block.load((0, -force), lambda x: np.isclose(x[1], 2) & (x[0] < 1 + 1e-9))
    right = block.load((0, -force), lambda x: np.isclose(x[1], 2) & (x[0] > 3 - 1e-9))
    states = solve_contact(block.K, [left, right], block.free, pads, block.space)
    for state, x in zip(states, (0.5, 3.5), strict=True):
        assert state.residuals.largest() < 1e-8
        normal = np.concatenate([pair.force_normal for pair in state.pairs])
        place = np.concatenate([pair.position[:, 0] for pair in state.pairs])
        assert normal.sum() == pytest.approx(force, rel=1e-7)
        assert normal @ place == pytest.approx(force * x, rel=2e-2)  # and friction's arm
    assert states[1].pairs[2].force[1] > 0


def test_any_level_set_is_a_surface():
    block = Block(16)
    foot = Reduction.dirichlet(block.space, [prescribe(block.space, i, at(1, 2.0)) for i in (0, 1)])
    centre, radius = np.array([2.0, -5.0]), 5.0
    up = [Motion((0, 0.02))]
    quadric = SignedDistance(lambda x: np.sum((x - centre) ** 2, axis=1) - radius**2)
    circle, level_set = (
        solve_contact(
            block.K,
            block.K.createVecLeft(),
            foot,
            ContactPair(at(1, 0.0), surface, 0.3, up),
            block.space,
        )[0].pairs[0]
        for surface in (Sphere(centre, radius), quadric)
    )
    assert level_set.force == pytest.approx(circle.force, rel=0.01)


def test_level_set_may_face_a_part_only():
    def low(x):
        return np.where(np.abs(x[:, 0] - 2.0) < 1.0, x[:, 1], np.inf)

    block = Block(8)
    (state,) = solve_contact(
        block.K,
        block.pressure,
        block.free,
        ContactPair(at(1, 0.0), SignedDistance(low), 0.3),
        block.space,
    )
    (pair,) = state.pairs
    assert np.all((pair.status != OPEN) <= (np.abs(pair.position[:, 0] - 2.0) < 1.0))
    assert pair.force[1] == pytest.approx(800)
