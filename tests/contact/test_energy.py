"""Work, stored energy and friction over a whole history: what is left is the sums' step error."""

import pytest

from tests.contact.energy_balance import measure_energy_balance


@pytest.mark.parametrize("element", ["galerkin", "pw"])
def test_what_energy_sums_leave_falls_with_the_step(element):
    """Sums with end forces are of first order; trapezoidal ones leave a hundredth of that.

    With piecewise-linear weights nodal forces do work on interpolated displacements; the rest of
    that is below 3e-4 of the work here, at a quarter of the radius, for any step.
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
        assert max(abs(one.remainder) for one in (coarse, fine, finest)) < 3e-4
