"""Test the other methods for contact of two bodies that section V11 compares."""

import numpy as np
import pytest

from pw_elements.contact.interface import OverlapQuadrature, gather_boundary_facets
from study.benchmarks.v11_two_bodies.methods import (
    evaluate_dual_quadratic_functions,
    integrate_mortar_coupling_of_multipliers,
)
from study.benchmarks.v11_two_bodies.problems import hertz
from tests.contact.two_bodies import StackedBlocks


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_dual_quadratic_functions_are_biorthogonal(cell):
    """The integral of a dual function times a quadratic function of another node vanishes.

    On tetrahedra, the dual functions are biorthogonal to a transformed basis, in which mid-side
    functions are multiplied by 3/4, and 1/8 of the two adjacent mid-side functions is added to each
    vertex function.
    """
    stack = StackedBlocks((2, 3), cell)
    slave, master = (
        gather_boundary_facets(stack.space, stack.sides[side]) for side in ("upper", "lower")
    )
    overlap = OverlapQuadrature.from_slave_and_master(slave, master, slave.nodes, revolved=False)
    node, N = overlap.functions[0]
    psi = evaluate_dual_quadratic_functions(node, N, overlap.measure, slave.space_dim)
    assert psi.sum(axis=1) == pytest.approx(np.ones(len(psi)))
    biorthogonal_functions = N.copy()
    if slave.space_dim == 3:
        biorthogonal_functions *= 3 / 4
        for vertex, edges in enumerate(((4, 5), (3, 5), (3, 4))):
            biorthogonal_functions[:, vertex] = N[:, vertex] + N[:, edges].sum(axis=1) / 8
    rows = np.searchsorted(slave.nodes, node)
    M = np.zeros((len(slave.nodes), len(slave.nodes)))
    integrated_products = np.einsum("q,qa,qb->qab", overlap.measure, psi, biorthogonal_functions)
    np.add.at(M, (rows[:, :, None], rows[:, None, :]), integrated_products)
    off_diagonal = M - np.diag(np.diag(M))
    assert np.abs(off_diagonal).max() < 1e-12 * np.abs(M).max()


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_a_dual_multiplier_acts_on_its_own_slave_node_only(cell):
    """A unit dual multiplier exerts a force on its own slave node only.

    This force equals the integral of the node's weight function, and the total force on the master
    is equal and opposite. Each row of `forces` holds the nodal forces of a unit multiplier.
    """
    stack = StackedBlocks((2, 3), cell)
    slave, master = (
        gather_boundary_facets(stack.space, stack.sides[side]) for side in ("upper", "lower")
    )
    coupling = integrate_mortar_coupling_of_multipliers(
        "pw-dual-gap", slave, master, len(stack.x), 1.0
    )
    forces = coupling.forces.toarray()
    assert forces[:, slave.nodes] == pytest.approx(np.diag(coupling.weight), abs=1e-12)
    assert coupling.weight.sum() == pytest.approx(1.0)
    assert forces.sum(axis=1) == pytest.approx(0.0, abs=1e-12)
    # weighted gaps under a unit translation of the slave away from the master
    unit_motion = np.zeros(len(stack.x))
    unit_motion[slave.nodes] = 1.0
    assert coupling.rows @ unit_motion == pytest.approx(coupling.weight)


def test_dual_multipliers_equal_node_to_segment_on_matching_meshes():
    """Dual multipliers and node-to-segment contact have equal errors on matching meshes.

    Each slave node of these meshes faces a master node, which makes the two methods equivalent.
    """
    errors = [
        hertz(method, 4, 1.0).scalars["pressure_l2"] for method in ("p2-dual", "node-to-segment")
    ]
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)
