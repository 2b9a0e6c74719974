"""Contact at large strains: closest points, derivatives, known answers, restart, refusals."""

import numpy as np
import pytest

from pw_elements.contact import Plane, SignedDistance, Sphere


def _ellipse(x):
    return x[:, 0] ** 2 / 4 + x[:, 1] ** 2 - 1


def _ellipse_slope(x):
    return np.stack([x[:, 0] / 2, 2 * x[:, 1]], axis=1)


SURFACES = {
    "plane": Plane((0.1, 0.2), (0.3, 1.0)),
    "circle": Sphere((0.1, -0.2), 1.3),
    "sphere": Sphere((0.1, -0.2, 0.3), 1.3),
    "ellipse": SignedDistance(_ellipse, _ellipse_slope),
    "differences": SignedDistance(_ellipse),
    "circle by its square": SignedDistance(
        lambda x: np.sum((x - [0.1, -0.2]) ** 2, axis=1) - 1.69, lambda x: 2 * (x - [0.1, -0.2])
    ),
}


@pytest.mark.parametrize("name", SURFACES)
def test_closest_points_and_their_derivatives(name):
    """Gap and normal are those of the closest point, and derivatives those of differences."""
    surface, rng = SURFACES[name], np.random.default_rng(4)
    dim = 3 if name == "sphere" else 2
    away = rng.normal(size=(40, dim))
    x = away / np.linalg.norm(away, axis=1, keepdims=True) * rng.uniform(1.2, 2.2, (40, 1))
    x *= [2.0, *[1.0] * (dim - 1)]
    gap, normal, bend = surface.closest(x)
    on = x - gap[:, None] * normal
    assert np.abs(surface.gap(on)).max() < 1e-9
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-12
    along = np.linspace(0, 2 * np.pi, 20001)
    if "ellipse" in name or name == "differences":
        rim = np.stack([2 * np.cos(along), np.sin(along)], axis=1)
        least = np.linalg.norm(x[:, None] - rim, axis=2).min(axis=1)
        assert np.abs(gap - least).max() < 1e-6
    step, close = (1e-2, 1e-3) if name == "differences" else (1e-5, 1e-8)
    for axis, h in enumerate(step * np.eye(dim)):
        ahead, behind = surface.closest(x + h), surface.closest(x - h)
        assert np.abs((ahead[0] - behind[0]) / (2 * step) - normal[:, axis]).max() < close
        assert np.abs((ahead[1] - behind[1]) / (2 * step) - bend[:, :, axis]).max() < close
