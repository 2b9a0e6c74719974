"""Two deformable bodies on meshes that do not match."""

import numpy as np
import pytest

from pw_elements import Reduction, assemble_vector, boundary_measure, prescribe, reactions
from pw_elements.contact import (
    ContactPair,
    DeformableSurface,
    MatchingNodes,
    Motion,
    Plane,
    solve_contact,
)
from pw_elements.contact.segments import segments
from tests.contact_cases import at
from tests.two_bodies import Stack

PRESSURE = 1e-3


def pressed(stack, slave="upper", friction=0.0):
    """Uniaxial stress: symmetry planes, a base that slides, pressure on top."""
    up = stack.up
    down = np.zeros(stack.dim)
    down[up] = -PRESSURE
    top = boundary_measure(stack.mesh, at(up, 2.0))
    load = assemble_vector(stack.body.surface_load(down, top))
    held = [prescribe(stack.space, up, at(up, 0.0))]
    held += [prescribe(stack.space, i, at(i, 0.0)) for i in range(up)]
    supports = Reduction.dirichlet(stack.space, held)
    (state,) = solve_contact(stack.K, load, supports, stack.pair(slave, friction), stack.space)
    return state, load


def uniaxial(stack, nu=0.3):
    """Its displacements (nodes, dim)."""
    modulus = 1.0
    if stack.dim == 2:
        modulus, nu = 1 / (1 - nu**2), nu / (1 - nu)
    return PRESSURE / modulus * stack.x * ([nu] * stack.up + [-1.0])


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_patch(cell, slave, friction):
    stack = Stack((2, 3) if cell == "tetrahedron" else (4, 7), cell)
    state, _ = pressed(stack, slave, friction)
    exact = uniaxial(stack)
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=1e-11 * np.abs(exact).max())
    assert state.residuals.largest() < 1e-11


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_slave_whose_facets_stick_out(cell):
    """A column on a wider block, which is the slave: what faces nothing stays open."""
    stack = Stack((3, 2) if cell == "tetrahedron" else (5, 3), cell, lower=(-0.37, 1.37))
    up = stack.up
    down = np.zeros(stack.dim)
    down[up] = -PRESSURE
    top = boundary_measure(stack.mesh, at(up, 2.0))
    load = assemble_vector(stack.body.surface_load(down, top))
    held = [prescribe(stack.space, i, at(up, 0.0)) for i in range(stack.dim)]
    held += [prescribe(stack.space, i, at(up, 2.0)) for i in range(up)]
    supports = Reduction.dirichlet(stack.space, held)
    (state,) = solve_contact(stack.K, load, supports, stack.pair("lower"), stack.space)
    (result,) = state.pairs
    assert result.force[up] == pytest.approx(-PRESSURE, rel=1e-10)
    assert np.isinf(result.gap).any()
    assert balance(stack, state, load) < 1e-12


def balance(stack, state, load):
    """Total force and moment of the contact forces on both bodies, over the force."""
    r = reactions(stack.K, state.displacement, load).array.reshape(-1, stack.dim)
    face = stack.nodes("upper") | stack.nodes("lower")
    force, x = r[face], stack.x[face]
    moment = np.cross(x, force) if stack.dim == 3 else x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    total = np.abs(r[face]).sum()
    return max(np.abs(force.sum(axis=0)).max(), np.abs(moment.sum(axis=0)).max()) / total


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_forces_and_moments_balance(cell, slave):
    """Of an uneven contact with friction, on parts of facets."""
    stack = Stack((3, 2) if cell == "tetrahedron" else (5, 4), cell, upper=(0.13, 0.83))
    supports = moved_top(stack, ([0.01, -0.02] if stack.dim == 2 else [0.01, -0.02, -0.02]))
    load = stack.K.createVecLeft()
    (state,) = solve_contact(stack.K, load, supports, stack.pair(slave, 0.2), stack.space)
    assert state.residuals.largest() < 1e-9
    assert balance(stack, state, load) < 1e-12


def moved_top(stack, by):
    """Supports: the base held, the top moved."""
    up = stack.up
    held = [prescribe(stack.space, i, at(up, 0.0)) for i in range(stack.dim)]
    held += [prescribe(stack.space, i, at(up, 2.0), by[i]) for i in range(stack.dim)]
    return Reduction.dirichlet(stack.space, held)


def test_matching_meshes_give_what_one_body_gives():
    """Bonded by friction, the stack is a single body to the order of its elements."""
    stack = Stack((6, 6))
    supports = moved_top(stack, [0.001, -0.02])
    nothing = stack.K.createVecLeft()
    states = [
        solve_contact(stack.K, nothing, supports, pair, stack.space)[0]
        for pair in (
            stack.pair("upper", 50.0),
            ContactPair(
                stack.nodes("upper"),
                MatchingNodes(stack.nodes("lower"), Plane((0.0, 1.0), (0.0, 1.0))),
                50.0,
            ),
        )
    ]
    mortar, nodal = (state.displacement.array for state in states)
    assert mortar == pytest.approx(nodal, abs=2e-3 * np.abs(nodal).max())
    forces = [state.pairs[0].force for state in states]
    assert forces[0] == pytest.approx(forces[1], rel=2e-3)


def test_motion_brings_the_opposite_body_nearer():
    """Given and, under a force, free."""
    stack = Stack((4, 5), lower=(0.0, 1.0), nu=0.0)
    up = stack.up
    held = [prescribe(stack.space, i, at(up, end)) for i in (0, 1) for end in (0.0, 2.0)]
    supports, load = Reduction.dirichlet(stack.space, held), stack.K.createVecLeft()
    for motion in (Motion((0.0, 0.02)), Motion((0.0, None), (0.0, 0.01))):
        pair = stack.pair("upper", 0.0, [motion])
        (state,) = solve_contact(stack.K, load, supports, pair, stack.space)
        (result,) = state.pairs
        assert result.translation == pytest.approx([0.0, 0.02], rel=1e-9)
        assert result.force == pytest.approx([0.0, 0.01], rel=1e-9, abs=1e-12)


def test_segments_have_the_area_of_what_faces():
    """Against a polygon clipped by hand, and by chance against sampling."""
    slave = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    master = np.array([[[0.25, 0.25, 0.1], [1.25, 0.25, 0.1], [0.25, 1.25, 0.1]]])
    up, down = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]])
    found = segments(slave, master, up, down)
    assert found.share.sum() == pytest.approx(0.25)  # of a triangle with legs 1/2
    assert segments(slave, master, up, up).share.sum() == 0  # both look the same way

    rng = np.random.default_rng(3)
    for _ in range(20):
        flat = rng.uniform(0, 1, (2, 3, 2))
        one, other = (np.pad(t, ((0, 0), (0, 1)))[None] for t in flat)
        share = segments(one, other, up, down).share.sum()
        s, t = rng.uniform(0, 1, (2, 40000))
        s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
        points = flat[0][0] + s[:, None] * (flat[0][1] - flat[0][0])
        points = points + t[:, None] * (flat[0][2] - flat[0][0])
        edges = np.column_stack([flat[1][1] - flat[1][0], flat[1][2] - flat[1][0]])
        a, b = np.linalg.solve(edges, (points - flat[1][0]).T)
        inside = np.mean((a > 0) & (b > 0) & (a + b < 1))
        assert share == pytest.approx(inside, abs=0.02)


def test_what_states_no_mortar_is_named():
    stack = Stack((3, 2))
    supports, load = moved_top(stack, [0.0, -0.01]), stack.K.createVecLeft()

    def solved(nodes, where):
        pair = ContactPair(nodes, DeformableSurface(where))
        return solve_contact(stack.K, load, supports, pair, stack.space)

    with pytest.raises(ValueError, match="belong to both sides"):
        solved(stack.nodes("upper"), stack.sides["upper"])
    with pytest.raises(ValueError, match="belong to no facet that is all in their pair"):
        solved(stack.nodes("upper") & (stack.x[:, 0] > 0.9), stack.sides["lower"])
    with pytest.raises(ValueError, match="faces the opposite part"):
        solved(lambda x: np.isclose(x[1], 2.0), stack.sides["lower"])
