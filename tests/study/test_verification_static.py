"""Contact against known solutions: patch test, Hertz, flat punches."""

import numpy as np
import pytest
from scipy.integrate import quad

from study.verification import v1_contact_patch, v2_hertz, v3_flat_punch
from study.verification.half_space import (
    BondedLine,
    Elastic,
    FlatLine,
    FlatRound,
    HertzLine,
    HertzSphere,
)
from study.verification.indentation import ELEMENTS, OUTER, growing

BODY = Elastic(1000.0, 0.3)
KNOWN = [
    HertzLine(BODY, 10.0, 20.0),
    HertzSphere(BODY, 10.0, 20.0),
    FlatLine(BODY, 1.0, 3.0),
    BondedLine(BODY, 1.0, 3.0),
    FlatRound(BODY, 1.0, 3.0),
]
ROUND = (HertzSphere, FlatRound)


def stress(known, x):
    """Stresses xx, yy, xy and hoop at points (n, 2), by central differences of displacements."""
    h = 1e-4 * known.half_width
    by_x, by_y = (
        (known.displacement(x + step) - known.displacement(x - step)) / (2 * h)
        for step in (np.array([h, 0.0]), np.array([0.0, h]))
    )
    hoop = known.displacement(x)[:, 0] / x[:, 0] if isinstance(known, ROUND) else 0.0
    nu, shear = BODY.poissons_ratio, BODY.shear_modulus
    volume = 2 * shear * nu / (1 - 2 * nu) * (by_x[:, 0] + by_y[:, 1] + hoop)
    direct = [volume + 2 * shear * strain for strain in (by_x[:, 0], by_y[:, 1], hoop)]
    return np.array([direct[0], direct[1], shear * (by_x[:, 1] + by_y[:, 0]), direct[2]])


@pytest.mark.parametrize("known", KNOWN, ids=lambda k: type(k).__name__)
class TestExactFields:
    def test_body_is_in_equilibrium(self, known):
        a = known.half_width
        x = np.array([[2.3, -0.4], [1.1, -2.2], [3.0, -3.0]]) * a
        h = 1e-2 * a
        by_x, by_y = (
            (stress(known, x + step) - stress(known, x - step)) / (2 * h)
            for step in (np.array([h, 0.0]), np.array([0.0, h]))
        )
        s, r = stress(known, x), x[:, 0] if isinstance(known, ROUND) else np.inf
        residual = [by_x[0] + by_y[2] + (s[0] - s[3]) / r, by_x[2] + by_y[1] + s[2] / r]
        assert np.abs(residual).max() < 1e-3 * np.abs(by_x).max()

    def test_surface_beside_the_contact_is_free(self, known):
        a = known.half_width
        near = stress(known, np.array([[2.5 * a, -2e-4 * a]]))
        inside = stress(known, np.array([[2.5 * a, -2.5 * a]]))
        assert np.abs(near[[1, 2]]).max() < 1e-3 * np.abs(inside[:3]).max()

    def test_stresses_carry_the_force(self, known):
        side, n = 3 * known.half_width, 400
        s = (np.arange(n) + 0.5) * side / n
        below = stress(known, np.stack([s, np.full(n, -side)], axis=1))[1]
        beside = stress(known, np.stack([np.full(n, side), -s], axis=1))[2]
        around = 2 * np.pi * np.array([s, np.full(n, side)]) if isinstance(known, ROUND) else 2.0
        width, height = around * np.ones((2, n))
        carried = (-below @ width + beside @ height) * side / n
        assert carried == pytest.approx(known.force, rel=1e-4)

    def test_force_is_the_integral_of_the_pressure(self, known):
        end = 0.7 * known.half_width

        def density(x):
            around = 2 * np.pi * x if isinstance(known, ROUND) else 1.0
            return around * known.pressure(np.array([x]))[0]

        assert known.force_within(np.array([end]))[0] == pytest.approx(quad(density, 0, end)[0])
        whole = known.force if isinstance(known, ROUND) else known.force / 2
        assert known.force_within(np.array([known.half_width]))[0] == pytest.approx(whole)


def test_numbers_of_nafems_r0094_1():
    compliance = (1 - 0.3**2) * (1 / 210e3 + 1 / 70e3)
    known = HertzLine(Elastic((1 - 0.3**2) / compliance, 0.3), 50.0, 35e3)
    assert known.half_width == pytest.approx(6.215, abs=5e-4)
    assert known.peak == pytest.approx(3585.4, abs=0.05)


@pytest.mark.parametrize("element", v1_contact_patch.ELEMENTS)
@pytest.mark.parametrize(
    ("mesh", "state"),
    [("straight", "plane strain"), ("distorted", "plane strain"), ("distorted", "axisymmetric")],
)
def test_patch_is_exact(element, mesh, state):
    scalars = v1_contact_patch.patch(element, mesh, state).scalars
    assert scalars["error_pressure_own"] < 1e-11
    assert scalars["error_force"] < 1e-11
    assert scalars["error_displacement"] < 1e-11
    assert scalars["iterations"] == 1
    standard = element.startswith("galerkin")
    assert scalars["weightless"] == (standard and state == "axisymmetric")
    if not standard:
        assert scalars["error_pressure_tributary"] < 1e-11
    elif state == "plane strain":
        assert scalars["error_pressure_tributary"] == pytest.approx(1 / 3, abs=1e-11)
    if mesh == "straight":
        assert scalars["sawtooth"] == pytest.approx(2.0 if standard else 1.0, abs=1e-10)


def test_patch_on_curved_sides():
    for element in ("galerkin-T6", "pw-T6", "pw-Q8", "pw-Q9"):
        assert v1_contact_patch.patch(element, "curved").scalars["error_displacement"] < 1e-11
    assert v1_contact_patch.patch("galerkin-Q8", "curved").scalars["error_pressure_own"] > 1e-4
    assert v1_contact_patch.patch("composite-T6", "curved").scalars["error_displacement"] > 1e-4


@pytest.fixture
def coarse(monkeypatch):
    """Three levels, two places of the contact's edge."""
    for module in (v2_hertz, v3_flat_punch):
        monkeypatch.setattr(module, "LEVELS", (4, 8, 16))
    monkeypatch.setattr(v2_hertz, "PLACES", (0.125, 0.625))


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("run", [v2_hertz.cylinder, v2_hertz.sphere])
@pytest.mark.parametrize("element", ELEMENTS)
def test_hertz(run, element):
    scalars = run(element).scalars
    assert scalars["error_pressure_own"] < 0.012
    assert 0.8 < scalars["order_pressure_own"] < 1.2
    assert scalars["error_approach"] < 4e-4
    assert scalars["off_edge"] <= 1.0
    assert scalars["residual"] < 1e-9
    assert scalars["force_normal"] == pytest.approx(
        v2_hertz.FORCE if run is v2_hertz.sphere else v2_hertz.FORCE / 2, rel=1e-9
    )
    if element.startswith("galerkin"):
        assert scalars["error_pressure_tributary"] == pytest.approx(1 / 3, abs=0.01)
    else:
        same = scalars["error_pressure_own"]
        assert scalars["error_pressure_tributary"] == pytest.approx(same, rel=1e-9)
    if element == "composite-T6":
        assert scalars["order_pressure_own_inner"] < 1.2
    else:
        assert scalars["error_pressure_own_inner"] < 2e-3
        assert scalars["order_pressure_own_inner"] > 1.3


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("kind", v3_flat_punch.KINDS)
@pytest.mark.parametrize("element", ELEMENTS)
def test_flat_punches(kind, element):
    even = v3_flat_punch.punch(element, kind).scalars
    graded = v3_flat_punch.punch(element, kind, graded=True).scalars
    assert 0.7 < even["order_pressure_own_inner"] < 1.4
    assert 1.2 < graded["order_pressure_own_inner"] < 1.8
    assert graded["error_pressure_own_inner"] < 6e-3
    assert graded["error_approach"] < 5e-3
    standard = element.startswith("galerkin")
    assert even["open_inside"] == (standard and kind == "round")
    if kind == "bonded":
        assert graded["error_force_tangential"] < 2e-3


@pytest.mark.usefixtures("coarse")
def test_transferred_forces_below_a_smooth_punch_are_the_new_ones():
    standard, new = (v3_flat_punch.punch(e, "smooth").curves for e in ("galerkin-T6", "pw-T6"))
    assert np.abs(standard["force_n_T"] - new["force_n"]).max() < 1e-11 * new["force_n"].max()
    assert np.abs(standard["force_n"] - new["force_n"]).max() > 0.1 * new["force_n"].max()


@pytest.mark.usefixtures("coarse")
def test_exact_far_field_makes_the_size_of_the_body_irrelevant():
    free, twice, held = (
        v2_hertz.cylinder("pw-T6", **size).scalars["error_peak"]
        for size in ({}, {"outer": 2 * OUTER}, {"far_field": False})
    )
    assert twice == pytest.approx(free, abs=5e-5)
    assert held > 0.01 > 10 * free


def test_growing_lines_start_with_the_smallest():
    lines = growing(0.1, 4.0)
    steps = np.diff(lines)
    assert steps[0] == pytest.approx(0.1)
    assert lines[-1] == pytest.approx(4.0)
    assert np.all((steps[1:] / steps[:-1] > 1) & (steps[1:] / steps[:-1] < 1.3001))
