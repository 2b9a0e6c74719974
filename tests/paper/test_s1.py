"""Test the nodal contact forces of standard and new elements (abstract and section 1).

The paper states that with standard elements, contact forces at corner nodes "are around half of
those at midside nodes".
"""

import pytest

from tests.oracle.elements import tabulate_at_gauss_points


@pytest.mark.parametrize(("linear_weights", "corner_has_half"), [(False, True), (True, False)])
def test_only_standard_weights_give_a_corner_half_of_the_mid_side_force(
    linear_weights, corner_has_half
):
    """Under uniform pressure, a corner has half of the mid-side force with standard weights only.

    With the new weight functions, corner and mid-side forces are equal. The factor of two takes
    into account that a corner receives equal forces from its two adjacent edges.
    """
    functions = tabulate_at_gauss_points("L3", linear_weights, 4)
    corner_force, _, midside_force = functions.measure @ functions.weights
    assert 2 * corner_force / midside_force == pytest.approx(
        0.5 if corner_has_half else 1.0, abs=1e-14
    )
