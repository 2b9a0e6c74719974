"""Two deformable bodies on meshes that do not match."""

import numpy as np
import pytest

from pw_elements import Sibling, prescribe, reactions, split
from pw_elements.contact import (
    HELD,
    STICK,
    ContactFields,
    ContactPair,
    DeformableSurface,
    FreeBody,
    Motion,
    NoEquilibrium,
    Plane,
)
from pw_elements.contact.interface import gathered_trace, geometry
from pw_elements.contact.interface.geometry import segments
from pw_elements.spaces import SubSpace
from tests.contact.cases import at
from tests.contact.two_bodies import PLANE, PRESSURE, Stack


def values(function, nodes):
    """(m,) or (m, dim)."""
    block = function.function_space.dofmap.index_map_bs
    rows = function.x.array.reshape(-1, block)[nodes]
    return rows[:, 0] if block == 1 else rows


def left_over(stack, state, load):
    """Forces (n, dim) that contact and supports have to carry."""
    field = SubSpace.displacements(stack.space)
    return field.part(reactions(stack.K, state.unknowns, load)).array.reshape(-1, stack.dim)


def balance(stack, state, load):
    """Total force and moment of the contact forces on both bodies, over the force."""
    face = stack.nodes("upper") | stack.nodes("lower")
    force, x = left_over(stack, state, load)[face], stack.x[face]
    moment = np.cross(x, force) if stack.dim == 3 else x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    total = np.abs(force).sum()
    return max(np.abs(force.sum(axis=0)).max(), np.abs(moment.sum(axis=0)).max()) / total


def assert_uniaxial(stack, state, nu=0.3, near=1e-11):
    exact = stack.uniaxial(nu)
    moved = state.displacement.array.reshape(exact.shape)
    assert moved == pytest.approx(exact, abs=near * np.abs(exact).max())


@pytest.mark.parametrize(
    ("cell", "slave", "friction", "element", "nu", "state"),
    [
        *(
            (cell, slave, 0.3, "petrov_galerkin", 0.3, None)
            for cell in (*PLANE, "tetrahedron", "hexahedron")
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
    """Uniaxial stress passes exactly, and pressures are even on both sides."""
    divisions = (4, 7) if cell in PLANE else (2, 3)
    stack = Stack(divisions, cell, element=element, nu=nu, state=state)
    found = stack.pressed(slave, friction)
    assert_uniaxial(stack, found, nu)
    assert found.residuals.largest() < 1e-11
    if element == "hybrid":
        share = nu if stack.dim == 2 else nu / (1 + nu)
        _, pressure = split(stack.space, found.unknowns)
        assert pressure.x.array == pytest.approx(PRESSURE * share, rel=1e-9)
    fields = ContactFields.of(found, stack.body)
    for side in ("upper", "lower"):
        nodes = stack.nodes(side)
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

    stack = Stack((2, 3), "hexahedron", shape=moved)
    assert_uniaxial(stack, stack.pressed(slave), near=1e-10)


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_patch_where_facets_are_covered_in_part(cell, slave):
    """The upper block ends inside of facets; what it leaves of the lower is pressed by loads."""
    end, h = (0.81, 0.1) if cell in PLANE else (0.83, 1 / 6)
    stack = Stack((5, 4) if cell in PLANE else (3, 2), cell, shape=lambda x: x * [end, 1.0, 1.0])
    load = stack.load(-PRESSURE * np.eye(stack.dim)[stack.up])
    nodes, corners, _ = gathered_trace(stack.space, stack.sides["lower"]).parts
    pressed = -PRESSURE * weights_beyond(corners, end)
    np.add.at(load.array.reshape(-1, stack.dim)[:, stack.up], nodes, pressed)
    state = stack.pressed(slave, 0.3 if cell == "hexahedron" else 0.0, load)
    assert_uniaxial(stack, state, near=1e-9)
    assert np.isinf(state.pairs[0].gap).any() == (slave == "lower")
    pressure = ContactFields.of(state, stack.body).pressure
    assert values(pressure, stack.nodes("upper")) == pytest.approx(PRESSURE, rel=1e-8)
    lower = np.flatnonzero(stack.nodes("lower"))
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
    """Of an uneven contact with friction, on parts of facets; areas by clipping the weights."""
    low, high = 0.13, 0.83
    divisions = (5, 4) if cell in PLANE else (3, 2)
    stack = Stack(divisions, cell, upper=(low, high), element=element, nu=nu)
    state = stack.askew(slave)
    assert state.residuals.largest() < 1e-9
    assert balance(stack, state, stack.nothing) < 1e-12
    fields, (pair,) = ContactFields.of(state, stack.body), state.pairs
    force = values(fields.force, slice(None))
    face = stack.nodes("upper") | stack.nodes("lower")
    left = left_over(stack, state, stack.nothing)
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

    other = {"upper": "lower", "lower": "upper"}[slave]
    for side, nodes, forces in (
        (slave, pair.node, pair.force_vector),
        (other, pair.opposite, pair.opposite_force),
    ):
        of, corners, _ = gathered_trace(stack.displacements, stack.sides[side]).parts
        hats = weights_beyond(corners, low) - weights_beyond(corners, high)
        known = nodes
        if stack.dim == 3 and side == "lower":  # cut along both axes
            inside = (corners[:, :, 1].min(axis=1) > low) & (corners[:, :, 1].max(axis=1) < high)
            known = np.setdiff1d(nodes, of[~inside])
        area, pushed = np.zeros(len(stack.x)), np.zeros(stack.x.shape)
        np.add.at(area, of, hats)
        pushed[nodes] = forces
        p, t = (values(f, known) for f in (fields.pressure, fields.traction))
        counts = np.isfinite(p)
        assert counts.sum() > 3
        up_or_down = 1.0 if side == "upper" else -1.0
        found = t[counts] + up_or_down * p[counts, None] * np.eye(stack.dim)[stack.up]
        expected = pushed[known][counts]
        near = 1e-10 * np.abs(expected).max()
        assert found * area[known][counts, None] == pytest.approx(expected, abs=near)


@pytest.mark.parametrize("motion", [Motion((0.0, 0.02)), Motion((0.0, None), (0.0, 0.01))])
def test_motion_brings_the_opposite_body_nearer(motion):
    """Given and, under a force, free."""
    stack = Stack((4, 5), nu=0.0)
    (state,) = stack.contact(stack.pair("upper", 0.0, [motion]), stack.moved_top((0.0, 0.0)))
    assert state.pairs[0].translation == pytest.approx([0.0, 0.02], rel=1e-9)
    assert state.pairs[0].force == pytest.approx([0.0, 0.01], rel=1e-9, abs=1e-12)


def flat(x, y):
    return 0 * x * y


def grid(x, y, height):
    """Triangles (n, 3, 3) between lines of a grid, and their normals upwards."""
    at = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    at = np.concatenate([at, height(*np.moveaxis(at, -1, 0))[..., None]], axis=-1)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    corners = np.stack([[a, b, c], [a, c, d]], axis=3).reshape(3, -1, 2, 3)
    corners = np.swapaxes(corners, 0, 1).swapaxes(1, 2).reshape(-1, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normal / np.linalg.norm(normal, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("rim", "height"),
    [
        (0.0, flat),
        (20.0, flat),
        (3.0, lambda x, y: 0.1 * np.sin(3 * x) * np.cos(2 * y)),
        (0.0, lambda x, y: x**2 + y**2),  # far from a plane
    ],
)
def test_search_finds_all_that_overlaps_among_few(rim, height, monkeypatch):
    """As among all pairs; that a rim of wide cells costs no candidates is conftest's to see."""
    rng = np.random.default_rng(1)
    lines = np.sort(rng.uniform(0, 1, (2, 25)), axis=1)
    wide = np.linspace(0, 1, 20)
    wide = np.concatenate([[-rim], wide, [1 + rim]]) if rim else wide
    master, up = grid(wide, wide, flat)
    slave, normal = grid(*lines, lambda x, y: height(x, y) + 1e-3)
    found = segments(slave, master, -normal, up)
    every = np.indices((len(slave), len(master))).reshape(2, -1)
    reach = np.linalg.norm(slave[:, None].mean(axis=2) - master.mean(axis=1), axis=2)
    size = np.linalg.norm(master - master.mean(axis=1, keepdims=True), axis=2).max()
    near = (reach <= reach.min(axis=1, keepdims=True) + size).ravel()
    monkeypatch.setattr(geometry, "_candidates", lambda *_: every[:, near])
    all_of_them = segments(slave, master, -normal, up)
    ours, theirs = ({*zip(x.slave, x.master, strict=True)} for x in (found, all_of_them))
    assert theirs <= ours
    assert len(theirs) > len(slave) / 3


def apart(corners):
    """By how much a quadrilateral is no parallelogram."""
    return corners[3] - corners[2] - corners[1] + corners[0]


def test_segments_have_the_area_of_what_faces():
    """Against a polygon clipped by hand, and by sampling bilinear maps."""
    slave = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    master = np.array([[[0.25, 0.25, 0.1], [1.25, 0.25, 0.1], [0.25, 1.25, 0.1]]])
    up, down = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]])
    found = segments(slave, master, up, down)
    assert found.share.sum() == pytest.approx(0.25)  # of a triangle with legs 1/2
    assert segments(slave, master, up, up).share.sum() == 0  # both look the same way

    rng = np.random.default_rng(3)
    for _ in range(20):
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


STACK = Stack((3, 2))
ON, BELOW = STACK.nodes("upper"), STACK.sides["lower"]


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
        (at(1, 2.0), BELOW, ValueError, "which looks the same way"),
        (ON, lambda x: x[1] > 3, ValueError, "has no opposite facets"),
        (ON, lambda x: np.isclose(x[0], 0.0) & (x[1] < 1), ValueError, "do not overlap"),
        (ON, Plane((0, 0), (0, 1)), TypeError, "a surface is given in place of facets"),
    ],
)
def test_what_states_no_mortar_is_named(nodes, facets, kind, message):
    with pytest.raises(kind, match=message):
        STACK.contact(ContactPair(nodes, DeformableSurface(facets)), STACK.moved_top([0.0, -0.01]))


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_other_weights_are_refused(cell):
    """By them the patch test fails, by up to 60 % of the pressure."""
    refused = pytest.raises(ValueError, match="forces of piecewise-linear weights")
    for element in ("galerkin", "taylor_hood"):
        with refused:
            Stack((3, 2), cell, element=element).pressed()
    if cell == "triangle":
        Stack((3, 2), cell, element="composite").pressed()
        stack = Stack((3, 2), element="galerkin")
        sibling = Sibling.of(stack.space)
        stack.K = sibling.matrix(stack.K)
        supports = sibling.dirichlet([prescribe(stack.space, i, at(1, 0.0)) for i in (0, 1)])
        with refused:
            stack.problem(stack.pair(), supports)


def test_a_coarse_slave_is_warned_of(caplog):
    stack = Stack((3, 12))
    for slave, warned in (("upper", False), ("lower", True)):
        caplog.clear()
        stack.contact(stack.pair(slave), stack.moved_top([0.0, -0.01]))
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
        STACK.contact(
            STACK.pair("upper", friction), STACK.clamped(at(1, 0.0)), STACK.load(traction)
        )


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_friction_on_a_slave_that_is_moved_along_is_refused(cell):
    """The law is not stated there: exchanged, the other body feels it."""
    stack = Stack((3, 2), cell)
    up = stack.up
    moved = np.array([0.02] + [0.0] * (up - 1) + [-0.01])
    own = np.flatnonzero(stack.nodes("upper"))
    sides = [(i, lambda x: np.isin(np.arange(x.shape[1]), own), moved[i]) for i in range(up)]
    supports = stack.moved_top(moved, sides)
    with pytest.raises(ValueError, match="would get no friction: exchange both sides"):
        stack.contact(stack.pair("upper", 0.3), supports)
    stack.contact(stack.pair("upper"), supports)
    (state,) = stack.contact(stack.pair("lower", 0.3), supports)
    (pair,) = state.pairs
    assert pair.force[0] == pytest.approx(-0.3 * pair.force[up], rel=5e-3)
    assert pair.opposite_force.sum(axis=0) == pytest.approx(-pair.force, rel=1e-9, abs=1e-12)


def test_bodies_that_overlap_are_named():
    stack = Stack((3, 2), shape=lambda x: x - 0.01 * (2 - x[:, 1:2]) * [0, 1, 0])
    with pytest.raises(ValueError, match="lie inside the body that they face"):
        stack.contact(stack.pair(), stack.moved_top([0.0, 0.0]))
