"""Energy balance of a whole history; its remainder is the error of summing over increments."""

import pytest

from tests.contact.energy_balance import measure_energy_balance


@pytest.mark.parametrize("element", ["galerkin", "pw"])
def test_the_remainder_of_energy_sums_decreases_with_the_increment(element):
    """The energy that is not accounted for decreases with the size of the increments.

    It is of first order if work is computed with the forces at the ends of increments, and about a
    hundredth of that with the trapezoidal rule. With piecewise-linear weights, nodal forces do work
    on interpolated displacements. This leaves a remainder below 3e-4 of the work for increments of
    any size, if the size of cells is a quarter of the radius.
    """
    coarse, fine, finest = (measure_energy_balance(element, n) for n in (4, 8, 16))
    assert finest.friction_work > 0.15
    assert abs(finest.stored_energy) < 1e-12
    assert coarse.end_force_remainder / fine.end_force_remainder == pytest.approx(2, rel=0.05)
    assert fine.end_force_remainder / finest.end_force_remainder == pytest.approx(2, rel=0.02)
    if element == "galerkin":
        assert abs(coarse.remainder) > 2 * abs(fine.remainder) > 4 * abs(finest.remainder)
        assert abs(coarse.remainder) < 1e-3
    else:
        assert max(abs(balance.remainder) for balance in (coarse, fine, finest)) < 3e-4
