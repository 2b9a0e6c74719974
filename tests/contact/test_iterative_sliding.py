"""Two bodies at large sliding, solved by `Iterative()`: comparison with factors."""

import numpy as np
import pytest
from dolfinx.mesh import CellType

from pw_elements import Direct, Iterative
from pw_elements.contact import SLIP
from tests.contact.blocks_in_space import BLOCK_PATH, BlocksInSpace
from tests.contact.sliding import make_die_on_block, slide_along_path

# Largest difference of displacements and slips from those by factors, relative to the largest
# displacement
MAX_DIFFERENCE_FROM_FACTORS = 1e-9
# The same for forces, each of which satisfies the contact law to 1e-9 of the largest force
MAX_FORCE_DIFFERENCE_FROM_FACTORS = 2e-9


def slide_die(**options):
    return slide_along_path(make_die_on_block(**options))


def slide_blocks(path=BLOCK_PATH, **options):
    return BlocksInSpace(**options).slide(path)


# increments of less than a cell, which need no substeps; where substeps differ, friction does
SHORT_PATH = [(0.0, 0.0, -0.06), (0.03, 0.0, -0.06), (0.06, 0.02, -0.06)]
HYBRID = {"element": "hybrid", "compressibility": 1e-3}
HEXAHEDRA = {"cell": CellType.hexahedron}
SLIDING_CASES = {
    "plane": (slide_die, {}),
    "lower slave in the plane": (slide_die, {"upper_is_slave": False}),
    "tetrahedra": (slide_blocks, {}),
    "lower slave": (slide_blocks, {"upper_is_slave": False, "path": SHORT_PATH}),
    "hexahedra": (slide_blocks, HEXAHEDRA),
    "hybrid tetrahedra": (slide_blocks, HYBRID),
    "hybrid hexahedra": (slide_blocks, HYBRID | HEXAHEDRA),
}


def assert_equal_states(states, expected_states):
    """Check displacements, forces, slips and statuses of states against those by factors."""
    for state, expected in zip(states, expected_states, strict=True):
        u, expected_u = (s.displacement.array_r for s in (state, expected))
        max_difference = MAX_DIFFERENCE_FROM_FACTORS * np.abs(expected_u).max()
        assert np.abs(u - expected_u).max() < max_difference
        (pair,), (expected_pair,) = state.pairs, expected.pairs
        for name in ("force_vector", "opposite_force"):
            value, expected_value = getattr(pair, name), getattr(expected_pair, name)
            difference = np.abs(value - expected_value).max()
            assert difference < MAX_FORCE_DIFFERENCE_FROM_FACTORS * np.abs(expected_value).max()
        assert np.abs(pair.slip - expected_pair.slip).max() < max_difference
        assert np.array_equal(pair.status, expected_pair.status)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("name", SLIDING_CASES)
def test_sliding_bodies_are_those_by_factors(name, friction):
    slide, options = SLIDING_CASES[name]
    states, expected = (
        slide(friction=friction, solver=solver, **options) for solver in (Iterative(), Direct())
    )
    assert_equal_states(states, expected)
    assert all(state.report.krylov_iterations for state in states)
    assert not any(state.report.factorisations for state in states)
    assert (states[-1].pairs[0].status == SLIP).sum() > 3
