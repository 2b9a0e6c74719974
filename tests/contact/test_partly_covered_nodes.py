"""Interface laws at nodes whose area faces the other body only in part."""

from dataclasses import replace

import numpy as np
import pytest

from pw_elements.contact.interface import build_interface
from pw_elements.contact.model import ElasticInterface
from pw_elements.spaces import read_record
from tests.contact.cases import on_plane
from tests.contact.test_friction import FOR_DIRECT_AND_ITERATIVE_SOLVER
from tests.contact.two_bodies import StackedBlocks
from tests.parallel import assert_same_on_processes

COVERED = 0.77  # no multiple of the size of an element
FULL = (0.0, 1.0)


def integrate_hat_functions(x, end):
    """Return the integrals (n,) from 0 to `end` of the piecewise-linear functions of points x."""
    order = np.argsort(x)
    points = np.unique([*x, end])
    points = points[points <= end]
    integrals = np.zeros(len(x))
    for k in range(len(x)):
        values = np.interp(points, x[order], np.eye(len(x))[k])
        integrals[order[k]] = np.trapezoid(values, points)
    return integrals


@FOR_DIRECT_AND_ITERATIVE_SOLVER
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_layer_under_an_overhang_has_a_uniform_traction(solver, cell):
    """Tractions on the covered parts of both faces move a free block as a rigid body."""
    stack = StackedBlocks((4, 3), cell, lower_range=(0.0, COVERED), upper_range=FULL)
    law, traction = ElasticInterface(0.5, 0.2), np.array([2e-4, -1e-3])
    load = stack.zero_load
    forces = load.array.reshape(-1, 2)
    for side, sign in (("upper", 1.0), ("lower", -1.0)):
        (nodes,) = np.nonzero(stack.side_node_mask(side))
        areas = integrate_hat_functions(stack.x[nodes, 0], COVERED)
        forces[nodes] += sign * areas[:, None] * traction
    load.array[:] = forces.ravel()
    base = stack.make_clamping_supports(on_plane(1, 0.0))
    pair = replace(stack.make_pair("upper"), interface_law=law)
    problem = stack.contact_problem(pair, base, solver=solver)
    state = problem.step(problem.undeformed, load)
    (result,) = state.pairs
    faces = np.isfinite(result.gap)
    assert 0 < np.count_nonzero(~faces) < len(faces)
    areas = integrate_hat_functions(result.position[:, 0], COVERED)
    np.testing.assert_allclose(result.gap[faces], traction[1] / 0.5, rtol=1e-9)
    np.testing.assert_allclose(result.slip[faces, 0], traction[0] / 0.2, rtol=1e-9)
    np.testing.assert_allclose(result.force, -COVERED * traction, rtol=1e-9)
    np.testing.assert_allclose(
        result.force_vector, -areas[:, None] * traction, atol=1e-9 * np.abs(traction).max()
    )
    assert state.residuals.law < 1e-9


@pytest.mark.parametrize(
    ("cell", "state", "area"),
    [
        ("tetrahedron", "solid", COVERED**2),
        ("triangle", "axisymmetric", np.pi * COVERED**2),
        ("quadrilateral", "axisymmetric", np.pi * COVERED**2),
    ],
)
def test_force_of_a_soft_layer_is_stiffness_times_facing_area(cell, state, area):
    """A layer that is much softer than the bodies has a uniform gap."""
    stack = StackedBlocks((3, 2), cell, (0.0, COVERED), FULL, state=state)
    stiffness, lift = 1e-7, 0.01
    pair = replace(stack.make_pair("upper"), interface_law=ElasticInterface(stiffness, 0.0))
    if state == "axisymmetric":
        pair = replace(pair, surface=replace(pair.surface, revolved=True))
    translation = lift * np.eye(stack.dim)[stack.up]
    supports = stack.fixed_base_moved_top_supports(translation)
    problem = stack.contact_problem(pair, supports)
    (result,) = problem.step(problem.undeformed).pairs
    exact = -stiffness * lift * area * np.eye(stack.dim)[stack.up]
    np.testing.assert_allclose(result.force, exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_covered_nodes_have_their_whole_area(cell, slave):
    stack = StackedBlocks((3, 4), cell)
    supports = stack.make_clamping_supports(on_plane(stack.up, 0.0))
    pair, record = stack.make_pair(slave), read_record(stack.K)
    interface = build_interface([pair], stack.space, supports, record)
    np.testing.assert_array_equal(interface.facing_fraction, 1.0)


def solve_overhang(comm):
    """Return results of a block on a layer that faces a part of its lower side only."""
    stack = StackedBlocks((4, 3), "triangle", (0.0, COVERED), FULL, comm=comm)
    pair = replace(stack.make_pair("upper"), interface_law=ElasticInterface(0.5, 0.2))
    supports = stack.fixed_base_moved_top_supports([0.001, -0.002])
    problem = stack.contact_problem(pair, supports)
    (result,) = problem.step(problem.undeformed).pairs
    return {"force": result.force_vector, "slip": result.slip}


def test_several_processes_give_the_same_forces():
    assert_same_on_processes(solve_overhang)
