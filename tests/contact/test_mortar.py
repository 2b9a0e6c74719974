"""Two deformable bodies on meshes that do not match."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import compute_midpoints, create_rectangle

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    reactions,
    split,
)
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    FreeBody,
    Motion,
    NoEquilibrium,
    Plane,
    plot,
    solve_contact,
    write,
)
from pw_elements.contact.interface import gathered_trace
from pw_elements.contact.interface.geometry import segments
from pw_elements.contact.model import MatchingNodes
from pw_elements.spaces import SubSpace, exterior_facets
from tests.contact.cases import at
from tests.contact.two_bodies import Stack, joined

PRESSURE = 1e-3
PLANE = ("triangle", "quadrilateral")


def pressed(stack, slave="upper", friction=0.0):
    """Uniaxial stress: symmetry planes, a base that slides, pressure on top."""
    up = stack.up
    down = np.zeros(stack.dim)
    down[up] = -PRESSURE
    load = stack.load(down)
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
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_patch(cell, slave, friction):
    stack = Stack((4, 7) if cell in PLANE else (2, 3), cell)
    state, _ = pressed(stack, slave, friction)
    exact = uniaxial(stack)
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=1e-11 * np.abs(exact).max())
    assert state.residuals.largest() < 1e-11


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_patch_of_hybrid_bodies(nu, cell, slave):
    stack = Stack((2, 3) if cell == "tetrahedron" else (4, 7), cell, element="hybrid", nu=nu)
    state, load = pressed(stack, slave, 0.3)
    exact = uniaxial(stack, nu)
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=1e-11 * np.abs(exact).max())
    _, pressure = split(stack.space, state.unknowns)
    share = nu if stack.dim == 2 else nu / (1 + nu)
    assert pressure.x.array == pytest.approx(PRESSURE * share, rel=1e-9)
    assert balance(stack, state, load) < 1e-12


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("bend", [0.05, 0.15])
def test_patch_on_quadrilaterals_of_any_shape(slave, bend):
    """Flat faces that are no parallelograms, on which weights are no polynomials."""

    def moved(x):
        hill = bend * np.sin(np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])
        across = np.stack([np.cos(3 * x[:, 1] + 1), np.sin(2 * x[:, 0] + 0.3), 0 * hill], axis=1)
        return x + hill[:, None] * across

    stack = Stack((2, 3), "hexahedron", shape=moved)
    state, _ = pressed(stack, slave)
    exact = uniaxial(stack)
    displacement = state.displacement.array.reshape(exact.shape)
    assert displacement == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_slave_whose_facets_stick_out(cell):
    """A column on a wider block, which is the slave: what faces nothing stays open."""
    stack = Stack((5, 3) if cell in PLANE else (3, 2), cell, lower=(-0.37, 1.37))
    up = stack.up
    down = np.zeros(stack.dim)
    down[up] = -PRESSURE
    load = stack.load(down)
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
    field = SubSpace.displacements(stack.space)
    r = field.part(reactions(stack.K, state.unknowns, load)).array.reshape(-1, stack.dim)
    face = stack.nodes("upper") | stack.nodes("lower")
    force, x = r[face], stack.x[face]
    moment = np.cross(x, force) if stack.dim == 3 else x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    total = np.abs(r[face]).sum()
    return max(np.abs(force.sum(axis=0)).max(), np.abs(moment.sum(axis=0)).max()) / total


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize(("element", "nu"), [("petrov_galerkin", 0.3), ("hybrid", 0.5)])
def test_forces_and_moments_balance(cell, slave, element, nu):
    """Of an uneven contact with friction, on parts of facets."""
    divisions = (5, 4) if cell in PLANE else (3, 2)
    stack = Stack(divisions, cell, upper=(0.13, 0.83), element=element, nu=nu)
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


def apart(corners):
    """By how much a quadrilateral is no parallelogram."""
    return corners[3] - corners[2] - corners[1] + corners[0]


def test_segments_have_the_area_of_what_faces():
    """Against a polygon clipped by hand, and by chance against sampling and bilinear maps."""
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

        square = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
        one, other = (square + rng.uniform(-0.2, 0.2, (4, 2)) for _ in range(2))
        found = segments(*(np.pad(q, ((0, 0), (0, 1)))[None] for q in (one, other)), up, down)
        s, t = rng.uniform(0, 1, (2, 40000))
        hats = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
        sides = other[[0, 1, 3, 2]], other[[1, 3, 2, 0]]
        left = np.all(
            [
                (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0
                for a, b in zip(*sides, strict=True)
                for x, y in [(hats @ one).T]
            ],
            axis=0,
        )
        edges = one[1:3] - one[0]
        u, v = one[1] - one[0] + t[:, None] * apart(one), one[2] - one[0] + s[:, None] * apart(one)
        area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        assert found.size.sum() * np.abs(np.linalg.det(edges)) == pytest.approx(
            np.mean(area * left), abs=0.02
        )
        w1, w2 = found.weights(np.array([[0.2, 0.5, 0.3]]))
        assert w1 @ one == pytest.approx(w2 @ other, abs=1e-12)


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
    with pytest.raises(ValueError, match="which looks the same way"):
        solved(lambda x: np.isclose(x[1], 2.0), stack.sides["lower"])
    with pytest.raises(ValueError, match="has no opposite facets"):
        solved(stack.nodes("upper"), lambda x: x[1] > 3)
    with pytest.raises(ValueError, match="do not overlap"):
        solved(stack.nodes("upper"), lambda x: np.isclose(x[0], 0.0) & (x[1] < 1))
    with pytest.raises(TypeError, match="a surface is given in place of facets"):
        DeformableSurface(Plane((0, 0), (0, 1)))
    with pytest.raises(TypeError, match="revolved"):
        DeformableSurface(stack.sides["lower"], "axis")


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_other_weights_are_refused(cell):
    """By them the patch test fails, by up to 60 % of the pressure."""
    for element in ("galerkin", "taylor_hood"):
        stack = Stack((3, 2), cell, element=element)
        with pytest.raises(ValueError, match="forces of piecewise-linear weights"):
            pressed(stack)
    if cell == "triangle":
        pressed(Stack((3, 2), cell, element="composite"))


def test_the_sibling_is_refused():
    stack = Stack((3, 2), element="galerkin")
    sibling = Sibling.of(stack.space)
    K = sibling.matrix(stack.K)
    supports = sibling.dirichlet([prescribe(stack.space, i, at(1, 0.0)) for i in (0, 1)])
    with pytest.raises(ValueError, match="forces of piecewise-linear weights"):
        ContactProblem(K, supports, stack.pair(), stack.space)


def weights_beyond(corners, end):
    """Integrals (s, k) of the hats of sub-facets (s, k, dim) over what has x > end.

    By cutting polygons off and the values at a triangle's corners; in the plane a trapezium, and
    on rectangles along the axes a product.
    """
    result = np.zeros(corners.shape[:2])
    if corners.shape[1] == 4:
        low, wide = corners[:, 0], corners[:, 3] - corners[:, 0]
        u = np.clip((end - low[:, 0]) / wide[:, 0], 0.0, 1.0)
        along = np.stack([(1 - u) ** 2 / 2, (1 - u**2) / 2], axis=1)
        return np.tile(along, 2) * (wide[:, 0] * wide[:, 1] / 2)[:, None]
    for k, corner in enumerate(corners):
        polygon = [(x, hats) for x, hats in zip(corner, np.eye(len(corner)), strict=True)]
        kept = []
        for (a, va), (b, vb) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            if a[0] > end:
                kept.append((a, va))
            if (a[0] > end) != (b[0] > end):
                t = (end - a[0]) / (b[0] - a[0])
                kept.append((a + t * (b - a), va + t * (vb - va)))
        if corners.shape[2] == 2:
            if len(kept) > 1:
                (a, va), (b, vb) = kept[:2]
                result[k] = np.linalg.norm(b - a) * (va + vb) / 2
            continue
        for i in range(1, len(kept) - 1):
            (a, va), (b, vb), (c, vc) = kept[0], kept[i], kept[i + 1]
            result[k] += np.linalg.norm(np.cross(b - a, c - a)) / 2 * (va + vb + vc) / 3
    return result


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_patch_of_a_slave_that_ends_later(cell, friction):
    """The master ends inside of facets; what it leaves of the slave is pressed by loads."""
    end = 0.83

    def narrow(x):
        return x * [end, 1.0, 1.0]

    stack = Stack((5, 4) if cell in PLANE else (3, 2), cell, shape=narrow)
    up, dim = stack.up, stack.dim
    down = np.zeros(dim)
    down[up] = -PRESSURE
    load = stack.load(down)
    trace = gathered_trace(stack.space, stack.sides["lower"])
    nodes, corners, _ = trace.parts
    values = load.array.reshape(-1, dim)
    np.add.at(values[:, up], nodes, -PRESSURE * weights_beyond(corners, end))
    load.array[:] = values.ravel()
    held = [prescribe(stack.space, i, at(i, 0.0)) for i in range(dim)]
    supports = Reduction.dirichlet(stack.space, held)
    pair = stack.pair("lower", friction)
    (state,) = solve_contact(stack.K, load, supports, pair, stack.space)
    exact = uniaxial(stack)
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())
    assert np.isinf(state.pairs[0].gap).any()


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_patch_of_cylinders_on_each_other(slave):
    stack = Stack((4, 7), state="axisymmetric")
    load = stack.load((0.0, -PRESSURE))
    held = [prescribe(stack.space, 1, at(1, 0.0)), prescribe(stack.space, 0, at(0, 0.0))]
    supports = Reduction.dirichlet(stack.space, held)
    (state,) = solve_contact(stack.K, load, supports, stack.pair(slave), stack.space)
    exact = PRESSURE * stack.x * [0.3, -1.0]
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=1e-10 * PRESSURE)
    pressure = ContactFields.of(state, stack.body).pressure.x.array
    face = stack.nodes("upper") | stack.nodes("lower")
    assert pressure[face] == pytest.approx(PRESSURE, rel=1e-8)


def test_ring_in_a_ring():
    """Lame's tube of two parts under inner pressure: the pressure between them, on all radii."""
    inner, between, outer, height = 1.0, 1.5, 2.2, 0.4

    def ring(low, high, n):
        size = (n, n // 2 + 1)
        return create_rectangle(MPI.COMM_SELF, [(low, 0.0), (high, height)], size)

    mesh = joined(ring(inner, between, 8), ring(between, outer, 11))
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), "axisymmetric")
    space, K = body.spaces.trial, assemble_matrix(body.stiffness())
    cells = np.arange(mesh.topology.index_map(2).size_local)
    of_outer = compute_midpoints(mesh, 2, cells)[:, 0] > between
    facets = exterior_facets(mesh, at(0, between))
    behind = np.array([mesh.topology.connectivity(1, 2).links(f)[0] for f in facets])
    theirs, own = facets[of_outer[behind]], facets[~of_outer[behind]]
    nodes = fem.locate_dofs_topological(space, 1, own)
    pair = ContactPair(nodes, DeformableSurface(theirs))
    bore = boundary_measure(mesh, at(0, inner))
    load = assemble_vector(body.surface_load((PRESSURE, 0.0), bore))
    held = [prescribe(space, 1, lambda x: np.isclose(x[1], 0.0) | np.isclose(x[1], height))]
    (state,) = solve_contact(K, load, Reduction.dirichlet(space, held), pair, space)
    both = np.concatenate([state.pairs[0].node, state.pairs[0].opposite])
    pressure = ContactFields.of(state, body).pressure.x.array[both]
    exact = PRESSURE * ((outer / between) ** 2 - 1) / ((outer / inner) ** 2 - 1)
    assert pressure == pytest.approx(np.full(len(pressure), exact), rel=2e-3)


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
@pytest.mark.parametrize("element", ["petrov_galerkin", "hybrid"])
def test_fields_have_the_forces_on_both_bodies(cell, element):
    divisions = (3, 2) if cell == "tetrahedron" else (5, 4)
    stack = Stack(divisions, cell, upper=(0.13, 0.83), element=element)
    supports = moved_top(stack, ([0.01, -0.02] if stack.dim == 2 else [0.01, -0.02, -0.02]))
    load = stack.K.createVecLeft()
    problem = ContactProblem(stack.K, supports, stack.pair("upper", 0.2), stack.space)
    state = problem.step(problem.undeformed, load)
    fields = ContactFields.of(state, stack.body)
    force = fields.force.x.array.reshape(-1, stack.dim)
    face = stack.nodes("upper") | stack.nodes("lower")
    left = reactions(stack.K, state.unknowns, load)
    left = SubSpace.displacements(stack.space).part(left).array.reshape(force.shape)
    assert force[face] == pytest.approx(left[face], abs=1e-11 * np.abs(left[face]).max())
    assert not force[~face].any()
    (pair,) = state.pairs
    for name in ("gap", "status", "slip"):
        values = getattr(fields, name).x.array.reshape(len(stack.x), -1)
        known = np.nan_to_num(getattr(pair, name).reshape(len(pair.node), -1), posinf=-1.0)
        assert np.array_equal(np.nan_to_num(values[pair.node], nan=-1.0), known)
    pressed = fields.pressure.x.array
    assert np.array_equal(pressed[pair.node] > 0, pair.force_normal > 0)


def test_a_file_keeps_the_opposite_forces(tmp_path):
    stack = Stack((5, 4))
    supports, load = moved_top(stack, [0.001, -0.02]), stack.K.createVecLeft()
    problem = ContactProblem(stack.K, supports, stack.pair("upper", 0.2), stack.space)
    state = problem.step(problem.undeformed, load)
    problem.save(state, tmp_path / "state.npz")
    (before,), (after,) = state.pairs, problem.load(tmp_path / "state.npz").pairs
    for name, values in vars(before).items():
        assert np.array_equal(values, getattr(after, name)), name
    assert before.opposite_force.sum(axis=0) == pytest.approx(-before.force, rel=1e-12)


def test_contact_points_alone_find_the_same():
    """The remedy, on the Schur complement, after an iteration that may take one step only."""
    stack = Stack((5, 4), upper=(0.13, 0.83))
    supports, load = moved_top(stack, [0.002, -0.02]), stack.K.createVecLeft()
    pair = stack.pair("upper", 0.2)
    problems = [
        ContactProblem(stack.K, supports, pair, stack.space),
        ContactProblem(stack.K, supports, pair, stack.space, max_iterations=2),
    ]
    states = [problem.step(problem.undeformed, load) for problem in problems]
    assert states[0].iterations > 2
    moved = [state.displacement.array for state in states]
    assert moved[1] == pytest.approx(moved[0], abs=1e-10 * np.abs(moved[0]).max())


def test_a_coarse_slave_is_warned_of(caplog):
    stack = Stack((3, 12))
    supports, load = moved_top(stack, [0.0, -0.01]), stack.K.createVecLeft()
    for slave, warned in (("upper", False), ("lower", True)):
        caplog.clear()
        solve_contact(stack.K, load, supports, stack.pair(slave), stack.space)
        assert ("facets are 4.0 times as large as those they face" in caplog.text) == warned


def test_a_body_held_by_nothing_is_named():
    stack = Stack((3, 2))
    held = [prescribe(stack.space, i, at(1, 0.0)) for i in (0, 1)]
    supports = Reduction.dirichlet(stack.space, held)
    with pytest.raises(FreeBody, match="translation x of the body around"):
        solve_contact(stack.K, stack.load((0.0, -PRESSURE)), supports, stack.pair(), stack.space)
    with pytest.raises(NoEquilibrium, match="slides along"):
        solve_contact(
            stack.K,
            stack.load((0.4 * PRESSURE, -PRESSURE)),
            supports,
            stack.pair("upper", 0.3),
            stack.space,
        )
    with pytest.raises(NoEquilibrium, match="lifts off pair 0"):
        solve_contact(
            stack.K, stack.load((0.0, PRESSURE)), supports, stack.pair("upper", 0.3), stack.space
        )


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_friction_on_a_slave_that_is_moved_along_is_refused(cell):
    """The law is not stated there: exchanged, the other body feels it."""
    stack = Stack((3, 2), cell)
    up = stack.up
    moved = np.array([0.02] + [0.0] * (up - 1) + [-0.01])
    held = [prescribe(stack.space, i, at(up, 0.0)) for i in range(stack.dim)]
    held += [prescribe(stack.space, i, at(up, 2.0), moved[i]) for i in range(stack.dim)]
    for i in range(up):
        part = stack.space.sub(i)
        dofs = fem.locate_dofs_topological(part, up, stack.sides["upper"])
        held.append(fem.dirichletbc(moved[i], dofs, part))
    problem = stack.K, stack.K.createVecLeft(), Reduction.dirichlet(stack.space, held)
    with pytest.raises(ValueError, match="would get no friction: exchange both sides"):
        solve_contact(*problem, stack.pair("upper", 0.3), stack.space)
    solve_contact(*problem, stack.pair("upper"), stack.space)
    (state,) = solve_contact(*problem, stack.pair("lower", 0.3), stack.space)
    (pair,) = state.pairs
    assert pair.force[0] == pytest.approx(-0.3 * pair.force[up], rel=5e-3)
    assert pair.opposite_force.sum(axis=0) == pytest.approx(-pair.force, rel=1e-9, abs=1e-12)


def test_bodies_that_overlap_are_named():
    stack = Stack((3, 2), shape=lambda x: x - 0.01 * (2 - x[:, 1:2]) * [0, 1, 0])
    supports, load = moved_top(stack, [0.0, 0.0]), stack.K.createVecLeft()
    with pytest.raises(ValueError, match="lie inside the body that they face"):
        solve_contact(stack.K, load, supports, stack.pair(), stack.space)


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_interference_is_pressed_out(cell):
    """Uniaxial stress of two blocks that overlap by d: p = E' d / 2 for heights of one."""
    depth = 1e-3
    count = (3, 2) if cell == "tetrahedron" else (5, 4)
    up = 2 if cell == "tetrahedron" else 1
    stack = Stack(count, cell, shape=lambda x: x - depth * (2 - x[:, [up]]) * np.eye(3)[up])
    sides = [prescribe(stack.space, i, at(i, 0.0)) for i in range(stack.dim)]
    supports = Reduction.dirichlet(stack.space, [*sides, prescribe(stack.space, up, at(up, 2.0))])
    pair = replace(stack.pair(), interference=True)
    (state,) = solve_contact(stack.K, stack.K.createVecLeft(), supports, pair, stack.space)
    modulus = 1.0 if stack.dim == 3 else 1 / (1 - 0.3**2)
    exact = depth * modulus / (2 + depth)  # the upper block is longer by it
    assert state.pairs[0].force[up] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("element", ["petrov_galerkin", "hybrid"])
def test_pictures_and_files_take_two_bodies(tmp_path, element):
    stack = Stack((5, 4), element=element)
    supports, load = moved_top(stack, [0.001, -0.02]), stack.K.createVecLeft()
    states = solve_contact(stack.K, load, supports, stack.pair("upper", 0.2), stack.space)
    write(tmp_path / "two.bp", states, stack.body)
    plot(states[-1], stack.body)
