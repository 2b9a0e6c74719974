"""Two deformable bodies on meshes that do not match."""

from dataclasses import replace

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import Sibling, prescribe, reactions, split
from pw_elements.contact import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    DeformableSurface,
    FreeBody,
    Motion,
    NoEquilibrium,
    Plane,
    plot,
    write,
)
from pw_elements.contact.interface import gather_trace
from pw_elements.spaces import SubSpace
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.test_friction import assert_friction_law
from tests.contact.two_bodies import (
    PLANE_CELLS,
    PRESSURE,
    StackedBlocks,
    join_meshes,
    split_facets_by_side,
)


def values(function, nodes):
    """(m,) or (m, dim)."""
    block = function.function_space.dofmap.index_map_bs
    rows = function.x.array.reshape(-1, block)[nodes]
    return rows[:, 0] if block == 1 else rows


def left_over(stack, state, load):
    """Forces (n, dim) that contact and supports have to carry."""
    field = SubSpace.displacements(stack.space)
    return field.extract(reactions(stack.K, state.unknowns, load)).array.reshape(-1, stack.dim)


def balance(stack, state, load):
    """Total force and moment of the contact forces on both bodies, over the force."""
    face = stack.side_nodes("upper") | stack.side_nodes("lower")
    force, x = left_over(stack, state, load)[face], stack.x[face]
    moment = np.cross(x, force) if stack.dim == 3 else x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    total = np.abs(force).sum()
    return max(np.abs(force.sum(axis=0)).max(), np.abs(moment.sum(axis=0)).max()) / total


def assert_uniaxial(stack, state, nu=0.3, near=1e-11):
    exact = stack.uniaxial_displacement(nu)
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=near * np.abs(exact).max())


@pytest.mark.parametrize(
    ("cell", "slave", "friction", "element", "nu", "state"),
    [
        *(
            (cell, slave, 0.3, "petrov_galerkin", 0.3, None)
            for cell in (*PLANE_CELLS, "tetrahedron", "hexahedron")
            for slave in ("upper", "lower")
        ),
        ("quadrilateral", "lower", 0.0, "petrov_galerkin", 0.3, None),
        ("tetrahedron", "upper", 0.0, "petrov_galerkin", 0.3, None),
        ("triangle", "upper", 0.0, "petrov_galerkin", 0.3, "axisymmetric"),
        ("triangle", "lower", 0.0, "petrov_galerkin", 0.3, "axisymmetric"),
        ("triangle", "upper", 0.3, "hybrid", 0.5, None),
        ("triangle", "lower", 0.3, "hybrid", 0.3, None),
        ("tetrahedron", "lower", 0.3, "hybrid", 0.5, None),
        ("hexahedron", "upper", 0.3, "hybrid", 0.5, None),
    ],
)
def test_patch(cell, slave, friction, element, nu, state):
    divisions = (4, 7) if cell in PLANE_CELLS else (2, 3)
    stack = StackedBlocks(divisions, cell, element=element, nu=nu, state=state)
    found = stack.solve_uniaxial(slave, friction)
    assert_uniaxial(stack, found, nu)
    assert found.residuals.largest() < 1e-11
    if element == "hybrid":
        share = nu if stack.dim == 2 else nu / (1 + nu)
        _, pressure = split(stack.space, found.unknowns)
        assert pressure.x.array == pytest.approx(PRESSURE * share, rel=1e-9)
    fields = ContactFields.from_state(found, stack.body)
    for side in ("upper", "lower"):
        nodes = stack.side_nodes(side)
        for of in (fields.pressure, fields.tributary_pressure):
            assert values(of, nodes) == pytest.approx(PRESSURE, rel=1e-8)
        assert np.abs(values(fields.traction, nodes)).max() < 1e-9 * PRESSURE
        assert np.abs(values(fields.gap, nodes)).max() < 1e-12
        assert set(values(fields.status, nodes)) <= {STICK, HELD} or not friction


@pytest.mark.parametrize(("slave", "bend"), [("upper", 0.15), ("lower", 0.05)])
def test_patch_on_quadrilaterals_of_any_shape(slave, bend):
    """Flat faces that are no parallelograms, on which weights are no polynomials."""

    def moved(x):
        hill = bend * np.sin(np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])
        across = np.stack([np.cos(3 * x[:, 1] + 1), np.sin(2 * x[:, 0] + 0.3), 0 * hill], axis=1)
        return x + hill[:, None] * across

    stack = StackedBlocks((2, 3), "hexahedron", map_upper=moved)
    assert_uniaxial(stack, stack.solve_uniaxial(slave), near=1e-10)


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_patch_where_facets_are_covered_in_part(cell, slave):
    """The upper block ends inside of facets; what it leaves of the lower is pressed by loads."""
    end, h = (0.81, 0.1) if cell in PLANE_CELLS else (0.83, 1 / 6)
    stack = StackedBlocks(
        (5, 4) if cell in PLANE_CELLS else (3, 2), cell, map_upper=lambda x: x * [end, 1.0, 1.0]
    )
    load = stack.traction_load(-PRESSURE * np.eye(stack.dim)[stack.up])
    nodes, corners, _ = gather_trace(stack.space, stack.sides["lower"]).sub_facets
    pressed = -PRESSURE * weights_beyond(corners, end)
    np.add.at(load.array.reshape(-1, stack.dim)[:, stack.up], nodes, pressed)
    state = stack.solve_uniaxial(slave, 0.3 if cell == "hexahedron" else 0.0, load)
    assert_uniaxial(stack, state, near=1e-9)
    assert np.isinf(state.pairs[0].gap).any() == (slave == "lower")
    pressure = ContactFields.from_state(state, stack.body).pressure
    assert values(pressure, stack.side_nodes("upper")) == pytest.approx(PRESSURE, rel=1e-8)
    lower = np.flatnonzero(stack.side_nodes("lower"))
    x, found = stack.x[lower, 0], values(pressure, lower)
    away = x > end + h - 1e-9
    assert away.any()
    assert np.abs(found[away]).max() < 1e-12 * PRESSURE
    # of the weights of the last nodes that face anything a 200th does, in space far more
    barely = ~away & (x > end) & (cell == "triangle")
    assert np.isnan(found[barely]).all()
    assert barely.any() == (cell == "triangle")
    assert found[~away & ~barely] == pytest.approx(PRESSURE, rel=1e-8)


def weights_beyond(corners, end):
    """Integrals (s, k) of the hats of sub-facets (s, k, dim) along the axes over x > end."""
    ends = corners[:, [0, -1]]
    low, wide = ends[:, :, 0].min(axis=1), np.abs(ends[:, 1] - ends[:, 0])
    u = np.clip((end - low) / wide[:, 0], 0.0, 1.0)
    along = np.stack([(1 - u) ** 2 / 2, (1 - u**2) / 2], axis=1) * wide[:, :1]
    backwards = ends[:, 1, 0] < ends[:, 0, 0]
    along[backwards] = along[backwards, ::-1]
    return along if corners.shape[1] == 2 else np.tile(along, 2) * wide[:, 1:2] / 2


@pytest.mark.parametrize(
    ("cell", "slave", "element", "nu"),
    [
        ("triangle", "upper", "petrov_galerkin", 0.3),
        ("triangle", "lower", "hybrid", 0.5),
        ("tetrahedron", "upper", "hybrid", 0.5),
        ("tetrahedron", "lower", "petrov_galerkin", 0.3),
        ("hexahedron", "upper", "petrov_galerkin", 0.3),
        ("hexahedron", "lower", "hybrid", 0.5),
    ],
)
def test_forces_and_moments_balance_and_fields_have_them(cell, slave, element, nu):
    low, high = 0.13, 0.83
    divisions = (5, 4) if cell in PLANE_CELLS else (3, 2)
    stack = StackedBlocks(divisions, cell, upper_range=(low, high), element=element, nu=nu)
    state = stack.solve_shifted_top(slave)
    assert state.residuals.largest() < 1e-9
    assert balance(stack, state, stack.zero_load) < 1e-12
    fields, (pair,) = ContactFields.from_state(state, stack.body), state.pairs
    assert_friction_law(pair, lambda r, _: 0.2 * r, None)
    force = values(fields.force, slice(None))
    face = stack.side_nodes("upper") | stack.side_nodes("lower")
    left = left_over(stack, state, stack.zero_load)
    assert force[face] == pytest.approx(left[face], abs=1e-10 * np.abs(left[face]).max())
    assert not force[~face].any()
    for name in ("gap", "status", "slip"):
        found = getattr(fields, name).x.array.reshape(len(stack.x), -1)
        known = np.nan_to_num(getattr(pair, name).reshape(len(pair.node), -1), posinf=-1.0)
        assert np.array_equal(np.nan_to_num(found[pair.node], nan=-1.0), known)
    pressed = fields.pressure.x.array[pair.node]
    assert np.array_equal(
        pressed[np.isfinite(pressed)] > 0, pair.force_normal[np.isfinite(pressed)] > 0
    )


@pytest.mark.parametrize("motion", [Motion((0.0, 0.02)), Motion((0.0, None), (0.0, 0.01))])
def test_motion_brings_the_opposite_body_nearer(motion):
    stack = StackedBlocks((4, 5), nu=0.0)
    (state,) = stack.solve_contact(
        stack.make_pair("upper", 0.0, [motion]), stack.moved_top_supports((0.0, 0.0))
    )
    assert state.pairs[0].translation == pytest.approx([0.0, 0.02], rel=1e-9)
    assert state.pairs[0].force == pytest.approx([0.0, 0.01], rel=1e-9, abs=1e-12)


STACK = StackedBlocks((3, 2))
ON, BELOW = STACK.side_nodes("upper"), STACK.sides["lower"]


@pytest.mark.parametrize(
    ("nodes", "facets", "kind", "message"),
    [
        (ON, STACK.sides["upper"], ValueError, "belong to both sides"),
        (
            ON & (STACK.x[:, 0] > 0.9),
            BELOW,
            ValueError,
            "belong to no facet that is all in their pair",
        ),
        (on_plane(1, 2.0), BELOW, ValueError, "on the far side of its body"),
        (ON, lambda x: x[1] > 3, ValueError, "has no opposite facets"),
        (ON, lambda x: np.isclose(x[0], 0.0) & (x[1] < 1), ValueError, "do not overlap"),
        (ON, Plane((0, 0), (0, 1)), TypeError, "a surface is given in place of facets"),
    ],
)
def test_what_states_no_mortar_is_named(nodes, facets, kind, message):
    with pytest.raises(kind, match=message):
        STACK.solve_contact(
            ContactPair(nodes, DeformableSurface(facets)), STACK.moved_top_supports([0.0, -0.01])
        )


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_other_weights_are_refused(cell):
    """By them the patch test fails, by up to 60 % of the pressure."""
    refused = pytest.raises(ValueError, match="forces by piecewise-linear weights")
    for element in ("galerkin", "taylor_hood"):
        with refused:
            StackedBlocks((3, 2), cell, element=element).solve_uniaxial()
    if cell == "triangle":
        StackedBlocks((3, 2), cell, element="composite").solve_uniaxial()
        stack = StackedBlocks((3, 2), element="galerkin")
        sibling = Sibling.from_space(stack.space)
        stack.K = sibling.matrix(stack.K)
        supports = sibling.dirichlet([prescribe(stack.space, i, on_plane(1, 0.0)) for i in (0, 1)])
        with refused:
            stack.contact_problem(stack.make_pair(), supports)


def test_a_coarse_slave_is_warned_of(caplog):
    stack = StackedBlocks((3, 12))
    for slave, warned in (("upper", False), ("lower", True)):
        caplog.clear()
        stack.solve_contact(stack.make_pair(slave), stack.moved_top_supports([0.0, -0.01]))
        assert ("facets are 4.0 times as large as those they face" in caplog.text) == warned


@pytest.mark.parametrize(
    ("traction", "friction", "kind", "message"),
    [
        ((0.0, -PRESSURE), 0.0, FreeBody, "translation x of the body around"),
        ((0.4 * PRESSURE, -PRESSURE), 0.3, NoEquilibrium, "slides along"),
        ((0.0, PRESSURE), 0.3, NoEquilibrium, "lifts off pair 0"),
    ],
)
def test_a_body_held_by_nothing_is_named(traction, friction, kind, message):
    with pytest.raises(kind, match=message):
        STACK.solve_contact(
            STACK.make_pair("upper", friction),
            STACK.clamp(on_plane(1, 0.0)),
            STACK.traction_load(traction),
        )


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_friction_on_a_slave_that_is_moved_along_is_refused(cell):
    """The law is not stated there: exchanged, the other body feels it."""
    stack = StackedBlocks((3, 2), cell)
    up = stack.up
    moved = np.array([0.02] + [0.0] * (up - 1) + [-0.01])
    own = np.flatnonzero(stack.side_nodes("upper"))
    sides = [(i, lambda x: np.isin(np.arange(x.shape[1]), own), moved[i]) for i in range(up)]
    supports = stack.moved_top_supports(moved, sides)
    with pytest.raises(ValueError, match="would get no friction: exchange both sides"):
        stack.solve_contact(stack.make_pair("upper", 0.3), supports)
    stack.solve_contact(stack.make_pair("upper"), supports)
    (state,) = stack.solve_contact(stack.make_pair("lower", 0.3), supports)
    (pair,) = state.pairs
    assert pair.force[0] == pytest.approx(-0.3 * pair.force[up], rel=5e-3)
    assert pair.opposite_force.sum(axis=0) == pytest.approx(-pair.force, rel=1e-9, abs=1e-12)


def test_bodies_that_overlap_are_named():
    stack = StackedBlocks((3, 2), map_upper=lambda x: x - 0.01 * (2 - x[:, 1:2]) * [0, 1, 0])
    with pytest.raises(ValueError, match="lie inside the body that they face"):
        stack.solve_contact(stack.make_pair(), stack.moved_top_supports([0.0, 0.0]))


def hats(x, at_):
    """Piecewise-linear functions (n, m) of sorted places (m,) at points (n,)."""
    return np.stack([np.interp(x, at_, row) for row in np.eye(len(at_))], axis=1)


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_gap_slip_and_status_are_means_of_the_pairs(slave):
    """By sampling both sides' hats."""
    low, high = 0.13, 0.83
    stack = StackedBlocks((5, 4), upper_range=(low, high))
    state = stack.solve_shifted_top(slave, lambda x: 0.1 + 0.2 * x[0])
    (pair,) = state.pairs
    assert set(pair.status) >= {STICK, SLIP}
    fields, alone = (ContactFields.from_state(state, of) for of in (stack.body, stack.space))
    x = low + (high - low) * (np.arange(100_000) + 0.5) / 100_000
    own, theirs = hats(x, pair.position[:, 0]), hats(x, stack.x[pair.opposite_node, 0])
    weight = theirs.T @ own
    faced = weight.sum(axis=1) > 0
    mean = weight[faced] / weight[faced].sum(axis=1, keepdims=True)
    at_ = pair.opposite_node[faced]
    gap = np.where(np.isfinite(pair.gap), pair.gap, 0.0)
    for of in (fields, alone):
        assert values(of.gap, at_) == pytest.approx(mean @ gap, abs=1e-9)
        assert values(of.slip, at_) == pytest.approx(-mean @ pair.slip, abs=1e-9)
        shares = mean @ np.eye(3)[pair.status]
        assert np.array_equal(values(of.status, at_), shares.argmax(axis=1))
        away = pair.opposite_node[~faced]
        assert np.isnan(values(of.gap, away)).all()
        assert not values(of.slip, away).any()
        assert (values(of.status, away) == OPEN).all()


def block(low, high, divisions):
    return create_rectangle(MPI.COMM_SELF, [low, high], divisions, CellType.triangle)


def test_two_slaves_on_one_master_and_a_rigid_floor():
    """Blocks side by side, which meet above the inside of a facet; a plate of some thickness."""
    end = 0.47
    below = block((0.0, 0.0), (1.0, 1.0), (5, 4))
    above = join_meshes(
        block((0.0, 1.0), (end, 2.0), (3, 3)), block((end, 1.0), (1.0, 2.0), (4, 4))
    )
    body = ElasticBody(join_meshes(below, above), E=1.0, nu=0.0, thickness=0.4)
    theirs, own = split_facets_by_side(body, on_plane(1, 1.0), lambda x: x[:, 1] > 1)
    left, right = (
        np.intersect1d(
            own, split_facets_by_side(body, on_plane(1, 1.0), lambda x: x[:, 0] > end)[k]
        )
        for k in (0, 1)
    )
    nodes = [fem.locate_dofs_topological(body.space, 1, side) for side in (left, right)]
    master, floor = DeformableSurface(theirs), ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1)))
    pairs = [ContactPair(nodes[0], master), floor, ContactPair(nodes[1], master)]
    held = body.make_supports(*((0, on_plane(0, x)) for x in (0.0, end, 1.0)))
    (state,) = body.solve_contact(
        pairs, held, body.traction_load((0.0, -PRESSURE), on_plane(1, 2.0))
    )
    fields = ContactFields.from_state(state, body.body)
    on_master = fem.locate_dofs_topological(body.space, 1, theirs)
    for at_ in (*nodes, on_master, state.pairs[1].node):
        assert values(fields.pressure, at_) == pytest.approx(PRESSURE, rel=1e-9)
    assert fields.opposite[1] is None
    other = replace(state, pairs=(*state.pairs[:2], replace(state.pairs[2], opposite=nodes[0])))
    for of in (body.body, body.space):
        with pytest.raises(ValueError, match="other contact nodes than the fields"):
            ContactFields.from_state(state, of).fill(other)


def test_a_body_between_two_others_has_the_pressures_of_both_pairs():
    levels = [block((0.0, k), (1.0, k + 1.0), (n, 3)) for k, n in enumerate((4, 7, 5))]
    body = ElasticBody(join_meshes(join_meshes(levels[0], levels[1]), levels[2]), E=1.0)
    pairs, faces = [], []
    for height in (1.0, 2.0):
        below, above = split_facets_by_side(
            body, on_plane(1, height), lambda x, h=height: x[:, 1] > h
        )
        faces += [fem.locate_dofs_topological(body.space, 1, side) for side in (below, above)]
        pairs.append(ContactPair(faces[-1], DeformableSurface(below), 0.3))
    held = body.make_supports(*((i, on_plane(i, 0.0)) for i in range(2)))
    (state,) = body.solve_contact(
        pairs, held, body.traction_load((0.0, -PRESSURE), on_plane(1, 3.0))
    )
    fields = ContactFields.from_state(state, body.body)
    for nodes in faces:
        assert values(fields.pressure, nodes) == pytest.approx(PRESSURE, rel=1e-8)
        assert set(values(fields.status, nodes)) <= {STICK, HELD}


@pytest.mark.parametrize("element", ["petrov_galerkin", "hybrid"])
def test_pictures_of_the_opposite_side(element, tmp_path):
    mpl.use("Agg")
    stack = StackedBlocks((5, 4), upper_range=(0.13, 0.83), element=element)
    state = stack.solve_shifted_top()
    write(tmp_path / "two.bp", [state], stack.body)
    (pair,), fields = state.pairs, ContactFields.from_state(state, stack.body)
    drawn = [line.get_xydata() for line in plot(state, stack.body, along=0, opposite=True).lines]
    shear = values(fields.traction, pair.opposite_node)[:, 0]
    for expected in (values(fields.pressure, pair.opposite_node), shear):
        curve = np.column_stack([stack.x[pair.opposite_node, 0], expected])
        assert any(c.shape == curve.shape and np.allclose(c, curve, equal_nan=True) for c in drawn)
    solid = StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83), element=element)
    state = solid.solve_shifted_top()
    axes = plot(state, solid.body, opposite=True)
    (coloured,) = (c for c in axes.collections if hasattr(c, "_triangulation"))
    assert len(coloured.get_array()) == len(state.pairs[0].opposite_node)
