"""Results on both sides of a pair of deformable surfaces."""

from dataclasses import replace

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import (
    Body,
    Iterative,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Plane,
    plot,
    solve_contact,
)
from pw_elements.contact.interface import gathered_trace
from pw_elements.spaces import Assembled, exterior_facets
from tests.contact.cases import at
from tests.contact.test_mortar import PLANE, PRESSURE, moved_top, pressed, weights_beyond
from tests.contact.two_bodies import Stack, joined

CELLS = ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]


def values(function, nodes):
    """(m,) or (m, dim)."""
    block = function.function_space.dofmap.index_map_bs
    rows = function.x.array.reshape(-1, block)[nodes]
    return rows[:, 0] if block == 1 else rows


def skewed(stack, friction, slave="upper", solver=None):
    """Pressed and pushed by an amount that leaves nodes of each status."""
    supports = moved_top(stack, ([0.01, -0.02] if stack.dim == 2 else [0.01, -0.02, -0.02]))
    problem = ContactProblem(
        stack.K, supports, stack.pair(slave, friction), stack.space, solver=solver
    )
    return problem, problem.step(problem.undeformed, stack.K.createVecLeft())


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("element", ["petrov_galerkin", "hybrid"])
def test_even_pressure_is_even_on_both_sides(element, cell, slave):
    stack = Stack((4, 7) if cell in PLANE else (2, 3), cell, element=element)
    state, _ = pressed(stack, slave, 0.3)
    fields = ContactFields.of(state, stack.body)
    for side in ("upper", "lower"):
        nodes = stack.nodes(side)
        for pressure in (fields.pressure, fields.tributary_pressure):
            assert values(pressure, nodes) == pytest.approx(PRESSURE, rel=1e-9)
        assert np.abs(values(fields.traction, nodes)).max() < 1e-9 * PRESSURE
        assert np.abs(values(fields.gap, nodes)).max() < 1e-12
        assert set(values(fields.status, nodes)) <= {STICK, HELD}


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_even_pressure_is_even_where_facets_are_covered_in_part(cell, slave):
    """The upper block ends inside of facets; what it leaves of the lower is pressed by loads."""
    end = 0.81 if cell in PLANE else 0.83
    stack = Stack((5, 4) if cell in PLANE else (3, 2), cell, shape=lambda x: x * [end, 1.0, 1.0])
    up, dim = stack.up, stack.dim
    load = stack.load(-PRESSURE * np.eye(dim)[up])
    nodes, corners, _ = gathered_trace(stack.space, stack.sides["lower"]).parts
    np.add.at(load.array.reshape(-1, dim)[:, up], nodes, -PRESSURE * weights_beyond(corners, end))
    held = [prescribe(stack.space, i, at(i, 0.0)) for i in range(dim)]
    supports = Reduction.dirichlet(stack.space, held)
    (state,) = solve_contact(stack.K, load, supports, stack.pair(slave), stack.space)
    fields = ContactFields.of(state, stack.body)
    assert values(fields.pressure, stack.nodes("upper")) == pytest.approx(PRESSURE, rel=1e-8)
    lower, h = np.flatnonzero(stack.nodes("lower")), 0.1 if cell in PLANE else 1 / 6
    x, found = stack.x[lower, 0], values(fields.pressure, lower)
    away = x > end + h - 1e-9
    assert away.any()
    assert np.abs(found[away]).max() < 1e-12 * PRESSURE
    # of the weights of the last nodes that face anything a 200th does, in space far more
    barely = ~away & (x > end) & (cell == "triangle")
    assert np.isnan(found[barely]).all()
    assert barely.any() == (cell == "triangle")
    assert found[~away & ~barely] == pytest.approx(PRESSURE, rel=1e-8)


@pytest.mark.parametrize(("end", "reach"), [(0.95, 0.05), (0.9, 0.1), (0.83, 0.03)])
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
    load = stack.K.createVecLeft()
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
    (state,) = solve_contact(stack.K, load, supports, stack.pair("lower"), stack.space)
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


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_pressures_times_areas_are_the_forces_on_both_sides(cell, slave):
    """Of an uneven contact with friction; areas by clipping the weights at the ends."""
    low, high = 0.13, 0.83
    stack = Stack((5, 4) if cell in PLANE else (3, 2), cell, upper=(low, high))
    _, state = skewed(stack, 0.2, slave)
    (pair,) = state.pairs
    fields = ContactFields.of(state, stack.body)
    up, other = stack.up, {"upper": "lower", "lower": "upper"}[slave]
    for side, nodes, force in (
        (slave, pair.node, pair.force_vector),
        (other, pair.opposite, pair.opposite_force),
    ):
        of, corners, _ = gathered_trace(stack.space, stack.sides[side]).parts
        hats = weights_beyond(corners, low) - weights_beyond(corners, high)
        if stack.dim == 3 and side == "lower":  # cut along both axes
            inside = (corners[:, :, 1].min(axis=1) > low) & (corners[:, :, 1].max(axis=1) < high)
            known = np.setdiff1d(nodes, of[~inside])
        else:
            known = nodes
        area = np.zeros(len(stack.x))
        np.add.at(area, of, hats)
        p, t = (values(f, known) for f in (fields.pressure, fields.traction))
        counts = np.isfinite(p)
        assert counts.sum() > 3
        pushed = np.zeros((len(stack.x), stack.dim))
        pushed[nodes] = force
        up_or_down = 1.0 if side == "upper" else -1.0
        found = t[counts] + up_or_down * p[counts, None] * np.eye(stack.dim)[up]
        expected = pushed[known][counts]
        assert found * area[known][counts, None] == pytest.approx(
            expected, abs=1e-10 * np.abs(expected).max()
        )


def hats(x, at_):
    """Piecewise-linear functions (n, m) of sorted places (m,) at points (n,)."""
    return np.stack([np.interp(x, at_, row) for row in np.eye(len(at_))], axis=1)


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_gap_slip_and_status_are_means_of_the_pairs(slave):
    """By sampling both sides' hats."""
    low, high = 0.13, 0.83
    stack = Stack((5, 4), upper=(low, high))
    _, state = skewed(stack, lambda x: 0.1 + 0.2 * x[0], slave)
    (pair,) = state.pairs
    assert set(pair.status) >= {STICK, SLIP}
    fields, alone = (ContactFields.of(state, of) for of in (stack.body, stack.space))
    x = low + (high - low) * (np.arange(400_000) + 0.5) / 400_000
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


@pytest.mark.parametrize("cell", CELLS)
def test_a_gap_that_varies_linearly_is_met_on_the_opposite_side(cell):
    """Before any motion; nodes on the rim have the value at the middle of their weights."""
    wedge = 0.01

    def lifted(x):
        return x + (0.02 + wedge * x[:, :1]) * (2 - x[:, [up]]) * np.eye(3)[up]

    up = 1 if cell in PLANE else 2
    stack = Stack((4, 7) if cell in PLANE else (2, 3), cell, shape=lifted)
    problem = ContactProblem(stack.K, moved_top(stack, np.zeros(up + 1)), stack.pair(), stack.space)
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


def test_two_slaves_on_one_master_and_a_rigid_floor():
    """Blocks side by side, which meet above the inside of a facet; a plate of some thickness."""

    def block(low, high, divisions):
        return create_rectangle(MPI.COMM_SELF, [low, high], divisions, CellType.triangle)

    end, thickness = 0.47, 0.4
    below = block((0.0, 0.0), (1.0, 1.0), (5, 4))
    above = joined(block((0.0, 1.0), (end, 2.0), (3, 3)), block((end, 1.0), (1.0, 2.0), (4, 4)))
    mesh = joined(below, above)
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.0), "plane strain", thickness)
    space, K = body.spaces.trial, assemble_matrix(body.stiffness())
    middle = space.tabulate_dof_coordinates()[space.dofmap.list].mean(axis=1)
    cells = {
        "below": middle[:, 1] < 1,
        "left": (middle[:, 1] > 1) & (middle[:, 0] < end),
        "right": (middle[:, 1] > 1) & (middle[:, 0] > end),
    }
    facets = exterior_facets(mesh, at(1, 1.0))
    behind = np.array([mesh.topology.connectivity(1, 2).links(f)[0] for f in facets])
    sides = {name: facets[inside[behind]] for name, inside in cells.items()}
    nodes = {
        name: np.unique(gathered_trace(space, of).node).astype(np.int32)
        for name, of in sides.items()
    }
    master = DeformableSurface(sides["below"])
    floor = ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)))
    pairs = [ContactPair(nodes["left"], master), floor, ContactPair(nodes["right"], master)]
    top = boundary_measure(mesh, at(1, 2.0))
    load = assemble_vector(body.surface_load((0.0, -PRESSURE), top))
    held = [prescribe(space, 0, at(0, x)) for x in (0.0, end, 1.0)]
    (state,) = solve_contact(K, load, Reduction.dirichlet(space, held), pairs, space)
    fields = ContactFields.of(state, body)
    for at_ in (*nodes.values(), state.pairs[1].node):
        assert values(fields.pressure, at_) == pytest.approx(PRESSURE, rel=1e-9)
    assert fields.opposite[1] is None
    other = replace(
        state, pairs=(*state.pairs[:2], replace(state.pairs[2], opposite=nodes["left"]))
    )
    for of in (body, space):
        with pytest.raises(ValueError, match="other contact nodes than the fields"):
            ContactFields.of(state, of).fill(other)


def test_a_body_between_two_others_has_the_pressures_of_both_pairs():
    """Slave below and master above, with friction that holds bodies 2 and 3."""
    levels = [
        create_rectangle(MPI.COMM_SELF, [(0.0, k), (1.0, k + 1.0)], (n, 3), CellType.triangle)
        for k, n in enumerate((4, 7, 5))
    ]
    mesh = joined(joined(levels[0], levels[1]), levels[2])
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), "plane strain")
    space, K = body.spaces.trial, assemble_matrix(body.stiffness())
    middle = space.tabulate_dof_coordinates()[space.dofmap.list].mean(axis=1)[:, 1]
    faces = {}
    for height in (1.0, 2.0):
        facets = exterior_facets(mesh, at(1, height))
        behind = mesh.topology.connectivity(1, 2)
        above = np.array([middle[behind.links(f)[0]] > height for f in facets])
        faces[height] = facets[~above], facets[above]
    sides = [[np.unique(gathered_trace(space, f).node) for f in faces[h]] for h in (1.0, 2.0)]
    pairs = [
        ContactPair(sides[k][1].astype(np.int32), DeformableSurface(faces[k + 1.0][0]), 0.3)
        for k in range(2)
    ]
    top = boundary_measure(mesh, at(1, 3.0))
    load = assemble_vector(body.surface_load((0.0, -PRESSURE), top))
    held = [prescribe(space, i, at(i, 0.0)) for i in range(2)]
    (state,) = solve_contact(K, load, Reduction.dirichlet(space, held), pairs, space)
    fields = ContactFields.of(state, body)
    for nodes in (nodes for of in sides for nodes in of):
        assert values(fields.pressure, nodes) == pytest.approx(PRESSURE, rel=1e-8)
        assert set(values(fields.status, nodes)) <= {STICK, HELD}


def test_a_body_held_by_two_pairs_alone_by_both_solvers():
    """It lies on a rigid floor, and another one is pressed on it and pushed."""
    stack = Stack((3, 2), "tetrahedron", upper=(0.13, 0.83))
    moved = 0.004, 0.004, -0.02
    held = [prescribe(stack.space, i, at(2, 2.0), by) for i, by in enumerate(moved)]
    floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.4)
    pairs, supports = [stack.pair("upper", 0.2), floor], Reduction.dirichlet(stack.space, held)
    load = stack.K.createVecLeft()
    pressures = []
    for solver in (None, Iterative()):
        (state,) = solve_contact(stack.K, load, supports, pairs, stack.space, solver=solver)
        upper, lower = state.pairs
        assert upper.force == pytest.approx(lower.force, rel=1e-8)
        pressures.append(ContactFields.of(state, stack.body).pressure.x.array)
    assert pressures[1] == pytest.approx(
        pressures[0], abs=1e-8 * np.nanmax(pressures[0]), nan_ok=True
    )


def test_areas_that_are_not_revolved_are_named():
    stack = Stack((4, 7), state="axisymmetric")
    pair = stack.pair()
    flat = replace(pair, surface=replace(pair.surface, revolved=False))
    supports = moved_top(stack, [0.0, -0.01])
    Assembled().mark(stack.K)  # as if made by hand
    (state,) = solve_contact(stack.K, stack.K.createVecLeft(), supports, flat, stack.space)
    ContactFields.of(state, stack.space)
    with pytest.raises(ValueError, match="to be revolved=True in axisymmetry"):
        ContactFields.of(state, stack.body)


def test_files_and_other_solvers_give_the_same(tmp_path):
    stack = Stack((3, 2), "tetrahedron", upper=(0.13, 0.83))
    problem, state = skewed(stack, 0.2)
    problem.save(state, tmp_path / "state.npz")
    _, iterated = skewed(stack, 0.2, solver=Iterative())
    fields = ContactFields.of(state, stack.body)
    for of, tolerance in ((problem.load(tmp_path / "state.npz"), 1e-12), (iterated, 1e-6)):
        again = ContactFields.of(of, stack.body)
        for one, other in zip(fields.functions(), again.functions(), strict=True):
            found, known = one.x.array, other.x.array
            assert np.array_equal(np.isnan(found), np.isnan(known)), one.name
            scale = max(np.nanmax(np.abs(found)), 1e-3)
            assert np.nanmax(np.abs(found - known)) < tolerance * scale, one.name


def test_pictures_of_the_opposite_side():
    from matplotlib import pyplot

    mpl.use("Agg")
    stack = Stack((5, 4), upper=(0.13, 0.83))
    _, state = skewed(stack, 0.2)
    (pair,) = state.pairs
    fields = ContactFields.of(state, stack.body)
    drawn = [line.get_xydata() for line in plot(state, stack.body, along=0, opposite=True).lines]
    x, p = stack.x[pair.opposite, 0], values(fields.pressure, pair.opposite)
    shear = values(fields.traction, pair.opposite)[:, 0]
    for expected in (p, shear):
        curve = np.column_stack([x, expected])
        assert any(c.shape == curve.shape and np.allclose(c, curve, equal_nan=True) for c in drawn)
    solid = Stack((3, 2), "tetrahedron", upper=(0.13, 0.83))
    _, state = skewed(solid, 0.2)
    axes = plot(state, solid.body, opposite=True)
    (coloured,) = (c for c in axes.collections if hasattr(c, "_triangulation"))
    assert len(coloured.get_array()) == len(state.pairs[0].opposite)
    pyplot.close("all")
