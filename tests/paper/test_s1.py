"""Abstract and section 1: what standard elements do to contact forces, and what is proposed.

Printed: contact forces at corner nodes "are around half of those at midside nodes".
"""

import pytest

from tests.oracle.elements import tabulate_at_gauss_points


@pytest.mark.parametrize(("linear_weights", "corner_has_half"), [(False, True), (True, False)])
def test_only_standard_weights_give_a_corner_half_of_the_mid_side_force(
    linear_weights, corner_has_half
):
    """Under a uniform pressure; a corner has the shares of two edges."""
    functions = tabulate_at_gauss_points("L3", linear_weights, 4)
    corner_force, _, midside_force = functions.measure @ functions.weights
    assert 2 * corner_force / midside_force == pytest.approx(
        0.5 if corner_has_half else 1.0, abs=1e-14
    )
