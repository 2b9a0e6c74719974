"""Sections V4 to V7: problems with friction whose answers are known, on coarse meshes."""

import numpy as np
import pytest

from study.verification import friction, v4_spence, v6_greco

OPEN, STICK, SLIP = 0, 1, 2
T6 = ("galerkin-T6", "pw-T6")


@pytest.mark.parametrize("element", T6)
def test_greco_plate_has_the_published_displacements_and_three_zones(element):
    result = v6_greco.plate(element, 16)
    u = [result.scalars[f"u_{i}"] for i in range(1, 6)]
    assert u == pytest.approx(friction.GRECO_PUBLISHED, rel=0.05)
    assert u == pytest.approx(friction.GRECO_PROTOTYPE, rel=2e-3)
    x, status = result.curves["x"], result.curves["status"]
    assert list(status[np.flatnonzero(np.diff(status, prepend=-1))]) == [OPEN, SLIP, STICK]
    assert x[status == OPEN].max() == pytest.approx(3.3e-3, abs=1.25e-3)
    assert x[status == STICK].min() == pytest.approx(29.8e-3, abs=1.25e-3)
    total = v6_greco.PRESSURE_TOP * v6_greco.SIDE
    assert result.scalars["force_normal"] == pytest.approx(total, rel=1e-10)
    assert result.scalars["residual"] < 1e-10


def test_partial_slip_formulas_balance_the_forces():
    known = friction.Cattaneo(half_width=2.0, force=3.0, friction=0.3, share=0.6)
    x = np.linspace(-2, 2, 200_001)
    assert np.trapezoid(known.pressure(x), x) == pytest.approx(3.0, rel=1e-6)
    assert np.trapezoid(known.shear(x), x) == pytest.approx(0.6 * 0.3 * 3.0, rel=1e-6)
    slipping = np.abs(x) > known.stick
    assert known.shear(x)[slipping] == pytest.approx(0.3 * known.pressure(x)[slipping])
    assert np.all(known.shear(x)[~slipping] <= 0.3 * known.pressure(x)[~slipping])


@pytest.mark.parametrize(("material", "known"), friction.SPENCE.items())
def test_stick_radius_below_a_flat_punch(material, known):
    scalars = v4_spence.stick_radius("pw-T6", *material, elements=32).scalars
    reach = scalars["stick_between"] / 2 + friction.SPENCE_ACCURACY
    assert abs(scalars["stick"] - known) < reach
    assert scalars["pass_change"] < 1e-6
    assert scalars["force_normal"] == pytest.approx(v4_spence.FORCE / 2, rel=1e-9)
