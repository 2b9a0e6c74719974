"""Section V11: the methods that are compared for two bodies."""

import numpy as np
import pytest

from pw_elements.contact.interface import OverlapQuadrature, gather_boundary_facets
from study.benchmarks.v11_two_bodies.methods import (
    dual_quadratic_functions,
    integrate_multiplier_coupling,
)
from study.benchmarks.v11_two_bodies.problems import hertz
from tests.contact.two_bodies import StackedBlocks


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_duals_of_quadratics_are_biorthogonal(cell):
    """In space those of the transformed functions."""
    stack = StackedBlocks((2, 3), cell)
    one, other = (
        gather_boundary_facets(stack.space, stack.sides[side]) for side in ("upper", "lower")
    )
    overlap = OverlapQuadrature.from_slave_and_master(one, other, one.nodes, revolved=False)
    at, N = overlap.functions[0]
    psi = dual_quadratic_functions(at, N, overlap.measure, one.space_dim)
    assert psi.sum(axis=1) == pytest.approx(np.ones(len(psi)))
    tested = N.copy()
    if one.space_dim == 3:
        tested *= 3 / 4
        for vertex, edges in enumerate(((4, 5), (3, 5), (3, 4))):
            tested[:, vertex] = N[:, vertex] + N[:, edges].sum(axis=1) / 8
    rows = np.searchsorted(one.nodes, at)
    M = np.zeros((len(one.nodes), len(one.nodes)))
    parts = np.einsum("q,qa,qb->qab", overlap.measure, psi, tested)
    np.add.at(M, (rows[:, :, None], rows[:, None, :]), parts)
    off = M - np.diag(np.diag(M))
    assert np.abs(off).max() < 1e-12 * np.abs(M).max()


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_with_gaps_by_duals_a_multiplier_presses_its_own_node_alone(cell):
    """By the integral of its weight; and the master as much."""
    stack = StackedBlocks((2, 3), cell)
    one, other = (
        gather_boundary_facets(stack.space, stack.sides[side]) for side in ("upper", "lower")
    )
    found = integrate_multiplier_coupling("pw-dual-gap", one, other, len(stack.x), 1.0)
    forces = found.forces.toarray()
    assert forces[:, one.nodes] == pytest.approx(np.diag(found.weight), abs=1e-12)
    assert found.weight.sum() == pytest.approx(1.0)
    assert forces.sum(axis=1) == pytest.approx(0.0, abs=1e-12)
    # gaps of a rigid motion of the slave away from the master
    moved = np.zeros(len(stack.x))
    moved[one.nodes] = 1.0
    assert found.rows @ moved == pytest.approx(found.weight)


def test_on_matching_meshes_duals_are_node_to_segment():
    """A dual's node then faces one of the master's."""
    found = [
        hertz(method, 4, 1.0).scalars["pressure_l2"] for method in ("p2-dual", "node-to-segment")
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-6)
