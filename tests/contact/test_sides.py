"""Results on both sides of a pair of deformable surfaces."""

from dataclasses import replace

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import Iterative, Reduction
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    DeformableSurface,
    Plane,
    plot,
    write,
)
from pw_elements.contact.interface import gathered_trace
from tests.contact.cases import Elastic, at
from tests.contact.test_mortar import values
from tests.contact.two_bodies import PLANE, PRESSURE, Stack, joined, two_sides


@pytest.mark.parametrize(("end", "reach"), [(0.95, 0.05), (0.83, 0.03)])
def test_a_linear_pressure_is_met_on_both_sides(end, reach):
    """Of an exact displacement; the upper block ends so far beyond a node of the slave.

    Of the next node's weight a quarter, a half and a twentieth face it. What it leaves is pressed
    by loads, integrals of the weights by Gauss' rule.
    """
    stack = Stack((5, 4), shape=lambda x: x * [end, 1.0, 1.0])
    modulus, ratio = 1 / (1 - 0.3**2), 0.3 / 0.7

    def exact(x):
        p = PRESSURE * (1 + x[0])
        across = ratio * PRESSURE * (x[0] + x[0] ** 2 / 2) + PRESSURE * x[1] ** 2 / 2
        return np.array([across, -p * x[1]]) / modulus

    def outside(x):
        left = np.isclose(x[0], 0) & ~np.isclose(x[1], 1)
        return np.isclose(x[1], 0.0) | np.isclose(x[1], 2.0) | left

    u = fem.Function(stack.space)
    u.interpolate(exact)
    dofs = fem.locate_dofs_geometrical(stack.space, outside)
    load = stack.nothing
    forces = load.array.reshape(-1, 2)
    points, weights = np.polynomial.legendre.leggauss(3)
    nodes, corners, _ = gathered_trace(stack.space, stack.sides["lower"]).parts
    for part, ends in zip(nodes, corners[:, :, 0], strict=True):
        low, high = np.maximum(np.sort(ends), end)
        x = (low + high) / 2 + points * (high - low) / 2
        second = (x - ends[0]) / (ends[1] - ends[0])
        pressed = weights * (high - low) / 2 * PRESSURE * (1 + x)
        forces[part, 1] -= [pressed @ (1 - second), pressed @ second]
    supports = Reduction.dirichlet(stack.space, [fem.dirichletbc(u, dofs)])
    (state,) = stack.contact(stack.pair("lower"), supports, load)
    pressure = ContactFields.of(state, stack.body).pressure
    for side in ("lower", "upper"):
        at_ = np.flatnonzero(stack.nodes(side))
        x, found = stack.x[at_, 0], values(pressure, at_)
        whole = (x > 1e-9) & (x < end - 0.1 - 1e-9)  # the middle of their weights is there
        assert found[whole] == pytest.approx(PRESSURE * (1 + x[whole]), rel=2e-3)
        if side == "lower":
            faced = np.argmax(np.where(x < end + 0.1 - 1e-9, x, -1))
            if reach < 0.04:
                assert np.isnan(found[faced])
            else:
                middle = x[faced] - 0.1 + 2 / 3 * reach
                assert found[faced] == pytest.approx(PRESSURE * (1 + middle), rel=5e-3)


def hats(x, at_):
    """Piecewise-linear functions (n, m) of sorted places (m,) at points (n,)."""
    return np.stack([np.interp(x, at_, row) for row in np.eye(len(at_))], axis=1)


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_gap_slip_and_status_are_means_of_the_pairs(slave):
    """By sampling both sides' hats."""
    low, high = 0.13, 0.83
    stack = Stack((5, 4), upper=(low, high))
    state = stack.askew(slave, lambda x: 0.1 + 0.2 * x[0])
    (pair,) = state.pairs
    assert set(pair.status) >= {STICK, SLIP}
    fields, alone = (ContactFields.of(state, of) for of in (stack.body, stack.space))
    x = low + (high - low) * (np.arange(100_000) + 0.5) / 100_000
    own, theirs = hats(x, pair.position[:, 0]), hats(x, stack.x[pair.opposite, 0])
    weight = theirs.T @ own
    faced = weight.sum(axis=1) > 0
    mean = weight[faced] / weight[faced].sum(axis=1, keepdims=True)
    at_ = pair.opposite[faced]
    gap = np.where(np.isfinite(pair.gap), pair.gap, 0.0)
    for of in (fields, alone):
        assert values(of.gap, at_) == pytest.approx(mean @ gap, abs=1e-9)
        assert values(of.slip, at_) == pytest.approx(-mean @ pair.slip, abs=1e-9)
        shares = mean @ np.eye(3)[pair.status]
        assert np.array_equal(values(of.status, at_), shares.argmax(axis=1))
        away = pair.opposite[~faced]
        assert np.isnan(values(of.gap, away)).all()
        assert not values(of.slip, away).any()
        assert (values(of.status, away) == OPEN).all()


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_a_gap_that_varies_linearly_is_met_on_the_opposite_side(cell):
    """Before any motion; nodes on the rim have the value at the middle of their weights."""
    wedge = 0.01

    def lifted(x):
        return x + (0.02 + wedge * x[:, :1]) * (2 - x[:, [up]]) * np.eye(3)[up]

    up = 1 if cell in PLANE else 2
    stack = Stack((4, 7) if cell in PLANE else (2, 3), cell, shape=lifted)
    problem = stack.problem(stack.pair(), stack.moved_top(np.zeros(up + 1)))
    fields = ContactFields.of(problem.undeformed, stack.body)
    lower = np.flatnonzero(stack.nodes("lower"))
    x = stack.x[lower]
    inner = (x[:, :up] > 0.2).all(axis=1) & (x[:, :up] < 0.8).all(axis=1)
    found = values(fields.gap, lower[inner])
    # along the normal of the wedge
    exact = (0.02 + wedge * x[inner, 0]) / np.sqrt(1 + wedge**2)
    assert found == pytest.approx(exact, rel=2e-3)
    assert not values(fields.status, lower).any()
    assert not values(fields.pressure, lower).any()


def block(low, high, divisions):
    return create_rectangle(MPI.COMM_SELF, [low, high], divisions, CellType.triangle)


def test_two_slaves_on_one_master_and_a_rigid_floor():
    """Blocks side by side, which meet above the inside of a facet; a plate of some thickness."""
    end = 0.47
    below = block((0.0, 0.0), (1.0, 1.0), (5, 4))
    above = joined(block((0.0, 1.0), (end, 2.0), (3, 3)), block((end, 1.0), (1.0, 2.0), (4, 4)))
    body = Elastic(joined(below, above), E=1.0, nu=0.0, thickness=0.4)
    theirs, own = two_sides(body, at(1, 1.0), lambda x: x[:, 1] > 1)
    left, right = (
        np.intersect1d(own, two_sides(body, at(1, 1.0), lambda x: x[:, 0] > end)[k]) for k in (0, 1)
    )
    nodes = [fem.locate_dofs_topological(body.space, 1, side) for side in (left, right)]
    master, floor = DeformableSurface(theirs), ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)))
    pairs = [ContactPair(nodes[0], master), floor, ContactPair(nodes[1], master)]
    held = body.held(*((0, at(0, x)) for x in (0.0, end, 1.0)))
    (state,) = body.contact(pairs, held, body.load((0.0, -PRESSURE), at(1, 2.0)))
    fields = ContactFields.of(state, body.body)
    on_master = fem.locate_dofs_topological(body.space, 1, theirs)
    for at_ in (*nodes, on_master, state.pairs[1].node):
        assert values(fields.pressure, at_) == pytest.approx(PRESSURE, rel=1e-9)
    assert fields.opposite[1] is None
    other = replace(state, pairs=(*state.pairs[:2], replace(state.pairs[2], opposite=nodes[0])))
    for of in (body.body, body.space):
        with pytest.raises(ValueError, match="other contact nodes than the fields"):
            ContactFields.of(state, of).fill(other)


def test_a_body_between_two_others_has_the_pressures_of_both_pairs():
    """Slave below and master above, with friction that holds bodies 2 and 3."""
    levels = [block((0.0, k), (1.0, k + 1.0), (n, 3)) for k, n in enumerate((4, 7, 5))]
    body = Elastic(joined(joined(levels[0], levels[1]), levels[2]), E=1.0)
    pairs, faces = [], []
    for height in (1.0, 2.0):
        below, above = two_sides(body, at(1, height), lambda x, h=height: x[:, 1] > h)
        faces += [fem.locate_dofs_topological(body.space, 1, side) for side in (below, above)]
        pairs.append(ContactPair(faces[-1], DeformableSurface(below), 0.3))
    held = body.held(*((i, at(i, 0.0)) for i in range(2)))
    (state,) = body.contact(pairs, held, body.load((0.0, -PRESSURE), at(1, 3.0)))
    fields = ContactFields.of(state, body.body)
    for nodes in faces:
        assert values(fields.pressure, nodes) == pytest.approx(PRESSURE, rel=1e-8)
        assert (values(fields.status, nodes) == STICK).all()


def test_areas_that_are_not_revolved_are_named():
    stack = Stack((4, 7), state="axisymmetric")
    pair = stack.pair()
    flat = replace(pair, surface=replace(pair.surface, revolved=False))
    (state,) = stack.contact(flat, stack.moved_top([0.0, -0.01]))
    ContactFields.of(state, stack.space)
    with pytest.raises(ValueError, match="to be revolved=True in axisymmetry"):
        ContactFields.of(state, stack.body)
    with pytest.raises(TypeError, match="revolved"):
        DeformableSurface(stack.sides["lower"], "axis")


def test_files_and_other_solvers_give_the_same(tmp_path):
    stack = Stack((3, 2), "tetrahedron", upper=(0.13, 0.83))
    state, iterated = stack.askew(), stack.askew(solver=Iterative())
    problem = stack.problem(stack.pair("upper", 0.2))
    problem.save(state, tmp_path / "state.npz")
    kept = problem.load(tmp_path / "state.npz")
    for name, of in vars(state.pairs[0]).items():
        assert np.array_equal(of, getattr(kept.pairs[0], name)), name
    fields = ContactFields.of(state, stack.body)
    for of, tolerance in ((kept, 1e-12), (iterated, 1e-6)):
        again = ContactFields.of(of, stack.body)
        for one, other in zip(fields.functions(), again.functions(), strict=True):
            found, known = one.x.array, other.x.array
            assert np.array_equal(np.isnan(found), np.isnan(known)), one.name
            scale = max(np.nanmax(np.abs(found)), 1e-3)
            assert np.nanmax(np.abs(found - known)) < tolerance * scale, one.name


@pytest.mark.parametrize("element", ["petrov_galerkin", "hybrid"])
def test_pictures_of_the_opposite_side(element, tmp_path):
    mpl.use("Agg")
    stack = Stack((5, 4), upper=(0.13, 0.83), element=element)
    state = stack.askew()
    write(tmp_path / "two.bp", [state], stack.body)
    (pair,), fields = state.pairs, ContactFields.of(state, stack.body)
    drawn = [line.get_xydata() for line in plot(state, stack.body, along=0, opposite=True).lines]
    shear = values(fields.traction, pair.opposite)[:, 0]
    for expected in (values(fields.pressure, pair.opposite), shear):
        curve = np.column_stack([stack.x[pair.opposite, 0], expected])
        assert any(c.shape == curve.shape and np.allclose(c, curve, equal_nan=True) for c in drawn)
    solid = Stack((3, 2), "tetrahedron", upper=(0.13, 0.83), element=element)
    state = solid.askew()
    axes = plot(state, solid.body, opposite=True)
    (coloured,) = (c for c in axes.collections if hasattr(c, "_triangulation"))
    assert len(coloured.get_array()) == len(state.pairs[0].opposite)
