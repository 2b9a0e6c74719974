"""Contact against known solutions: patch test, Hertz, flat punches."""

import numpy as np
import pytest
from scipy.integrate import quad

from study.verification.half_space import (
    BondedLine,
    Elastic,
    FlatLine,
    FlatRound,
    HertzLine,
    HertzSphere,
)

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
