"""Work, stored energy and friction over a whole history: what is left is the sums' step error."""

import pytest

from tests.contact.energy_balance import energy_balance


@pytest.mark.parametrize("element", ["galerkin", "pw"])
def test_what_energy_sums_leave_falls_with_the_step(element):
    """Sums with end forces are of first order; trapezoidal ones leave a hundredth of that.

    With piecewise-linear weights nodal forces do work on interpolated displacements; the rest of
    that is below 3e-4 of the work here, at a quarter of the radius, for any step.
    """
    coarse, fine, finest = (energy_balance(element, n) for n in (4, 8, 16))
    assert finest.spent > 0.15
    assert abs(finest.stored) < 1e-12
    assert coarse.of_end_forces / fine.of_end_forces == pytest.approx(2, rel=0.05)
    assert fine.of_end_forces / finest.of_end_forces == pytest.approx(2, rel=0.02)
    if element == "galerkin":
        assert abs(coarse.remainder) > 2 * abs(fine.remainder) > 4 * abs(finest.remainder)
        assert abs(coarse.remainder) < 1e-3
    else:
        assert max(abs(one.remainder) for one in (coarse, fine, finest)) < 3e-4
