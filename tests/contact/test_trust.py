"""No number that is far off, no refusal without cause."""

import logging

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_rectangle

from pw_elements import Body, Iterative, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import (
    HELD,
    STICK,
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    NotFound,
    Sphere,
    solve_contact,
)
from pw_elements.contact.rescue import Budget
from pw_elements.meshes import curved, triangles
from pw_elements.spaces import Assembled, exterior_facets
from tests.contact.cases import Block, at
from tests.contact.shells import BETWEEN, INNER, NU, OUTER, _rolled
from tests.contact.two_bodies import Stack, joined
from tests.oracle.random_contact import problem

# -- shrink fits -----------------------------------------------------------------------------------

DEPTH = 1e-3 * BETWEEN


def tubes(edges, interference):
    """Largest error of Lame's pressure on either side of a shrink fit, meshes of so many edges."""
    nominal = interference is not True

    def tube(low, high, n):
        flat = create_rectangle(MPI.COMM_SELF, [(low, 0.0), (high, 1.0)], (n // 2, n))
        return curved(flat, _rolled)

    bore = BETWEEN - (0.0 if nominal else DEPTH)
    mesh = joined(tube(INNER, BETWEEN, edges[0]), tube(bore, OUTER, edges[1]))
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, NU), "plane strain")
    space, K = body.spaces.trial, assemble_matrix(body.stiffness())
    facets = exterior_facets(mesh, lambda x: np.abs(np.hypot(x[0], x[1]) - BETWEEN) < 2 * DEPTH)
    behind = mesh.topology.connectivity(1, 2)
    x = space.tabulate_dof_coordinates()
    middle = np.hypot(*x[space.dofmap.list].mean(axis=1)[:, :2].T)
    inner = np.array([middle[behind.links(f)[0]] < BETWEEN for f in facets])
    nodes = fem.locate_dofs_topological(space, 1, facets[inner])
    surface = DeformableSurface(facets[~inner], coincident=nominal)
    pair = ContactPair(nodes, surface, interference=interference)
    held = Reduction.dirichlet(space, [prescribe(space, i, at(i, 0.0)) for i in range(2)])
    (state,) = solve_contact(K, K.createVecLeft(), held, pair, space)
    both = np.concatenate([state.pairs[0].node, state.pairs[0].opposite])
    pressure = ContactFields.of(state, body).pressure.x.array[both]
    a, b, c = INNER, BETWEEN, OUTER
    exact = DEPTH / (1 - NU**2) / (2 * b**3) * (b**2 - a**2) * (c**2 - b**2) / (c**2 - a**2)
    return np.abs(pressure / exact - 1).max()


@pytest.mark.parametrize("depth", [DEPTH, lambda x: DEPTH * np.hypot(x[0], x[1]) / BETWEEN])
def test_nominal_interference_has_lames_pressure_on_coarse_meshes(depth):
    assert tubes((5, 7), depth) < 0.01


def test_gaps_of_meshes_beside_an_interference_are_warned_of(caplog):
    assert tubes((5, 7), True) > 0.1
    (warning,) = caplog.messages
    assert "coincident=True" in warning
    caplog.clear()
    assert tubes((24, 24), True) < 0.04
    assert not caplog.messages


# -- what a stiffness and a surface are ------------------------------------------------------------


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "hexahedron"])
def test_a_surface_with_an_edge_is_refused(cell):
    stack = Stack((3, 2), cell)
    below, up = stack.x[:, stack.up] < 1 + 1e-9, np.isclose(stack.x[:, stack.up], 1.0)
    nodes = below & ~stack.nodes("upper") & (up | np.isclose(stack.x[:, 0], 1.0))
    pair = ContactPair(nodes, DeformableSurface(stack.sides["upper"]))
    with pytest.raises(ValueError, match=r"has an edge at .*1\)"):
        ContactProblem(stack.K, Reduction.dirichlet(stack.space, []), pair, stack.space)


def test_a_stiffness_by_hand_does_not_tell_whether_it_is_axisymmetric():
    stack = Stack((3, 2), state="axisymmetric")
    free, pair = Reduction.dirichlet(stack.space, []), stack.pair()
    with pytest.raises(ValueError, match="give DeformableSurface"):
        ContactProblem(Assembled().mark(stack.K.copy()), free, pair, stack.space)
    pair = ContactPair(pair.nodes, DeformableSurface(pair.surface.where, revolved=False))
    with pytest.raises(ValueError, match="the stiffness is one in axisymmetric"):
        ContactProblem(stack.K, free, pair, stack.space)


def test_a_stiffness_that_is_scaled_between_steps_is_noticed():
    block = Block(8)
    problem = ContactProblem(block.K, block.free, block.pair(0.3), block.space)
    problem.step(problem.undeformed, block.pressure)
    block.K.scale(3.0)
    state = problem.step(problem.undeformed, block.pressure)
    (fresh,) = solve_contact(block.K, block.pressure, block.free, block.pair(0.3), block.space)
    assert np.abs(state.displacement.array - fresh.displacement.array).max() < 1e-12
    assert state.residuals.largest() < 1e-9


# -- diagnostics -----------------------------------------------------------------------------------


def test_a_slave_node_on_the_axis_neither_sticks_nor_slips():
    """Its weighted slip has that of its neighbours, which their friction allows or not."""
    stack = Stack((4, 3), state="axisymmetric", ratio=30.0)
    held = [prescribe(stack.space, 0, at(0, 0.0)), prescribe(stack.space, 1, at(1, 0.0))]
    supports = Reduction.dirichlet(stack.space, held)
    pair = stack.pair(friction=5.0)
    (state,) = solve_contact(stack.K, stack.load((0.0, -0.01)), supports, pair, stack.space)
    (pair,) = state.pairs
    on_axis = np.isclose(pair.position[:, 0], 0.0)
    assert np.array_equal(pair.status == HELD, on_axis)
    moved = np.abs(state.displacement.array).max()
    assert np.abs(pair.displacement[on_axis, 0]).max() > 1e-6 * moved
    assert np.allclose(pair.slip[on_axis, 0], pair.displacement[on_axis, 0])
    assert np.abs(pair.displacement[pair.status == STICK, 0]).max() < 1e-9 * moved


def test_residuals_of_two_bodies_that_stick_are_round_off(caplog):
    """Lengths are over both bodies' displacements, not over what is next to nothing."""
    caplog.set_level(logging.INFO)
    stack = Stack((3, 2))
    supports = Reduction.dirichlet(
        stack.space, [prescribe(stack.space, i, at(1, 0.0)) for i in (0, 1)]
    )
    problem = stack.K, stack.load((0.0, -0.01)), supports, stack.pair(friction=10.0), stack.space
    (state,) = solve_contact(*problem, solver=Iterative())
    assert set(state.pairs[0].status) == {STICK}
    assert state.residuals.largest() < 1e-8


@pytest.mark.parametrize(("share", "unique"), [(0.9, True), (1.0, False)])
def test_a_block_drawn_by_all_its_friction_is_not_unique(share, unique):
    """It may slide as far as it likes."""
    block = Block(8)
    states = block.solve(0.3, share * 120.0, increments=1, smooth=0.0)
    assert states[-1].unique is unique


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_ball_without_force_just_touches(mu):
    """From a start in which it does, not from what it touched before: no remedy is needed."""
    mesh = triangles(MPI.COMM_SELF, (-2.0, 0.0), (2.0, 2.0), (9, 4))
    body = Body(Spaces.petrov_galerkin(mesh), Material(1000.0, 0.3), "plane strain")
    space, K = body.spaces.trial, assemble_matrix(body.stiffness())
    held = Reduction.dirichlet(space, [prescribe(space, i, at(1, 0.0)) for i in (0, 1)])
    motions = [Motion((0, None), (0, force)) for force in (-300.0, -20.0, 0.0)]
    pair = ContactPair(at(1, 2.0), Sphere((0.37, 7.0), 5.0), mu, motions)
    states = solve_contact(K, [K.createVecLeft()] * 3, held, pair, space, remedies=())
    assert states[-1].displacement.norm() < 1e-12 * states[0].displacement.norm()
    assert states[-1].pairs[0].gap.min() == pytest.approx(0.0, abs=1e-12)
    assert states[-1].residuals.largest() < 1e-9


def test_a_refusal_says_what_was_tried_and_how_far_it_got(caplog):
    """Each remedy is announced with its budget; half of the increment has been solved."""
    with caplog.at_level("INFO", "pw_elements.contact"), pytest.raises(NotFound) as refused:
        problem(110).solve()
    for remedy in ("without active sets", "in parts"):
        assert f"{remedy}, for what 150 linear systems take at most" in caplog.text
    share, state = refused.value.reached
    assert f"In parts {share} of it was reached" in str(refused.value)
    assert share == 0.5
    assert state.converged
    assert state.residuals.largest() < 1e-9


def test_a_remedy_costs_as_many_first_attempts_as_it_may(monkeypatch):
    """But for what is begun before its budget is used up."""
    budgets = {}
    take = Budget.take

    def noted(budget, systems):
        budgets.setdefault(id(budget), [budget, budget.left, 0.0])[2] += systems
        return take(budget, systems)

    monkeypatch.setattr(Budget, "take", noted)
    for multiple in (0.1, 3.0):
        budgets.clear()
        with pytest.raises(NotFound):
            problem(93).solve(remedies={"condensed": multiple, "cutback": multiple})
        assert all(taken <= 1.5 * most + 10 for _, most, taken in budgets.values())
        assert {most for _, most, _ in budgets.values()} == {50 * multiple}
