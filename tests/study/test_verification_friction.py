"""Sections V4 to V7: problems with friction whose answers are known, on coarse meshes."""

import numpy as np
import pytest

from study.verification import friction, v4_spence, v5_cattaneo, v6_greco, v7_wedge

OPEN, STICK, SLIP = 0, 1, 2
T6 = ("galerkin-T6", "pw-T6")
ANGLE = float(np.tan(np.deg2rad(20)))


@pytest.mark.parametrize("element", v6_greco.ELEMENTS)
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


@pytest.fixture(scope="module")
def slipped():
    return {
        (element, n): v5_cattaneo.partial_slip(element, n)
        for element in (*T6, "composite-T6")
        for n in (10, 20)
    }


def test_partial_slip_finds_the_sticking_zone(slipped):
    for (_, n), result in slipped.items():
        half_distance = v5_cattaneo.ZONE / n / 4
        assert abs(result.scalars["stick"] - np.sqrt(0.5)) < half_distance
        assert abs(result.scalars["stick_centre"]) < 1e-9
        pressed, pulled = (result.scalars[f"force_{of}"] for of in ("normal", "tangential"))
        assert pressed == pytest.approx(v5_cattaneo.FORCE, rel=1e-9)
        assert pulled == pytest.approx(0.5 * 0.4 * v5_cattaneo.FORCE, rel=1e-9)


def test_partial_slip_pressure_converges_as_the_element_allows(slipped):
    for element, low, high in (("galerkin-T6", 1.7, 3.3), ("pw-T6", 1.7, 2.7)):
        coarse, fine = (slipped[element, n].scalars["error_pressure"] for n in (10, 20))
        assert fine < 1e-3
        assert low < np.log2(coarse / fine) < high
    coarse, fine = (slipped["composite-T6", n].scalars["error_pressure"] for n in (10, 20))
    assert 0.7 < np.log2(coarse / fine) < 1.3


def test_partial_slip_without_the_far_field_is_wrong(slipped):
    held = v5_cattaneo.partial_slip("pw-T6", 20, far_field=False).scalars
    assert held["error_pressure"] > 10 * slipped["pw-T6", 20].scalars["error_pressure"]


@pytest.mark.parametrize(("material", "known"), friction.SPENCE.items())
def test_stick_radius_below_a_flat_punch(material, known):
    scalars = v4_spence.stick_radius("pw-T6", *material, elements=32).scalars
    reach = scalars["stick_between"] / 2 + friction.SPENCE_ACCURACY
    assert abs(scalars["stick"] - known) < reach
    assert scalars["pass_change"] < 1e-6
    assert scalars["force_normal"] == pytest.approx(v4_spence.FORCE / 2, rel=1e-9)


def test_stick_radius_is_the_same_for_all_elements():
    radii = [
        v4_spence.stick_radius(element, 0.25, ANGLE, elements=16).scalars["stick"]
        for element in v4_spence.ELEMENTS
    ]
    assert np.ptp(radii) < 1e-12


def test_flat_punch_in_one_step_and_in_many():
    one, many = (
        v4_spence.stick_radius("pw-T6", 0.25, ANGLE, elements=16, increments=n).curves["force_t"]
        for n in (1, 7)
    )
    assert one == pytest.approx(many, abs=1e-11 * np.abs(many).max())


def test_flat_punch_in_plane_stress_is_one_in_plane_strain():
    stress = v4_spence.stick_radius("pw-T6", 0.25, ANGLE, elements=16, state="plane stress")
    strain = v4_spence.stick_radius("pw-T6", 0.20, ANGLE, elements=16)
    for name in ("force_n", "force_t"):
        scale = np.abs(strain.curves[name]).max()
        assert stress.curves[name] == pytest.approx(strain.curves[name], abs=1e-9 * scale)


def test_flat_punch_on_a_held_body_sticks_farther():
    held = v4_spence.stick_radius("pw-T6", 0.25, ANGLE, elements=16, far_field=False)
    assert held.scalars["stick"] > 0.8


@pytest.mark.parametrize("element", v7_wedge.ELEMENTS)
@pytest.mark.parametrize("mu", friction.WEDGE_SPRINGS)
def test_wedge_slides_as_statics_says(element, mu):
    result = v7_wedge.sliding(element, mu, (8, 2))
    scalars = result.scalars
    assert scalars["ratio"] == pytest.approx((0.1 + mu) / (1 - 0.1 * mu), rel=1e-9)
    assert scalars["sliding"] == pytest.approx(scalars["sliding_known"], rel=1e-7)
    assert scalars["sliding"] == pytest.approx(friction.WEDGE_SLIDING, abs=5e-4)
    assert np.all(result.curves["status"] == SLIP)
    limit = mu * result.curves["force_n"]
    assert result.curves["force_t"] == pytest.approx(limit, abs=1e-8 * scalars["force_normal"])


@pytest.mark.parametrize("element", T6)
def test_wedge_without_springs_begins_to_slide_at_the_known_push(element):
    scalars = v7_wedge.limit(element, 0.2, (4, 1)).scalars
    assert scalars["holds"] < scalars["ratio_known"] < scalars["slides"]
    assert scalars["slides"] - scalars["holds"] < 1e-6
