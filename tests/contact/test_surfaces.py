"""Rigid surfaces: gaps, normals and closest points, and the refusal of wrong gradients."""

from decimal import Decimal, getcontext

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
)
from pw_elements.contact.model import measure_gradient_change_at_half_step
from pw_elements.meshes import triangles
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.polyline import PolylineSurface

RNG = np.random.default_rng(5)

# corners from left to right, with the body above: a step up, which has a re-entrant and a
# protruding corner, and a tip
STEP_AND_TIP_CORNERS = [(-2.0, 0.0), (0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (2.0, -1.0)]

SURFACES_BY_NAME = {
    "plane": Plane((1.0, 2.0), (1.0, -3.0)),
    "plane in space": Plane((1.0, 2.0, 3.0), (1.0, -3.0, 2.0)),
    "circle": Sphere((0.5, -0.2), 0.3),
    "sphere": Sphere((0.5, -0.2, 1.0), 0.3),
    "flat punch": FlatPunch((0.0, 1.0), (0.0, -2.0), 10.0),
    "line": PolylineSurface(STEP_AND_TIP_CORNERS),
    "rounded line": PolylineSurface(STEP_AND_TIP_CORNERS, 0.2),
    "signed distance": SignedDistance(lambda x: np.hypot(x[:, 0], x[:, 1]) - 1),
}


@pytest.mark.parametrize("name", SURFACES_BY_NAME)
def test_the_normal_is_the_gradient_of_the_gap(name):
    surface = SURFACES_BY_NAME[name]
    dim = 3 if "sp" in name and "signed" not in name else 2
    x = RNG.uniform(-3, 3, (200, dim))
    normal = surface.normal(x)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1)
    h = 1e-5
    gradient = np.stack(
        [(surface.gap(x + h * e) - surface.gap(x - h * e)) / (2 * h) for e in np.eye(dim)], axis=1
    )
    is_smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1) < 1e-4  # not across the medial axis
    assert is_smooth.mean() > 0.98
    assert normal[is_smooth] == pytest.approx(gradient[is_smooth], abs=1e-4)


@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e6])
def test_normals_by_differences_are_accurate_in_any_unit(radius):
    """Normals computed by differences of a distance function are accurate in any unit of length.

    A fixed step would be as large as a small circle, and would be lost in the round-off of a large
    one.
    """
    circle = SignedDistance(lambda x: np.hypot(x[:, 0], x[:, 1]) - radius)
    angle = np.linspace(0.0, 6.0, 20)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    assert circle.normal(radius * normal) == pytest.approx(normal, abs=1e-9)


def test_a_parabola_measures_gaps_along_its_axis():
    x = np.array([[1.0, 0.5], [2.0, 0.0]])
    for radius, side in ((4.0, 1.0), (-4.0, -1.0)):
        gap = Parabola((0.0, 1.0), radius).gap(x)
        assert gap == pytest.approx(side * (1 + x[:, 0] ** 2 / (2 * radius) - x[:, 1]))
        assert Parabola((0.0, 1.0), radius).normal(x) == pytest.approx(
            np.tile([0.0, -side], (2, 1))
        )
    bowl = Parabola((0.0, 0.0, 0.0), 2.0)
    assert bowl.gap(np.array([[1.0, 2.0, -1.0]])) == pytest.approx(5 / 4 + 1)


def test_a_flat_punch_faces_nothing_beyond_its_edge():
    punch = FlatPunch((1.0, 2.0, 0.0), (0, 0, -1), 0.5)
    x = np.array([[1.5, 2.0, -0.1], [1.51, 2.0, -0.1], [1.3, 2.3, 0.0], [1.4, 2.4, 0.0]])
    assert punch.gap(x) == pytest.approx([0.1, np.inf, 0.0, np.inf])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_small_gaps_to_large_spheres_keep_their_digits(dim, side):
    """Small gaps to a large sphere are computed without loss of digits.

    The reference is computed with fifty digits. In double precision, |y| - R would lose almost all
    digits, where y is the position relative to the centre and R the radius.
    """
    radius = 2.0**20
    ball = Sphere([*[0.5] * (dim - 1), side * radius], radius)
    rng = np.random.default_rng(3)
    x = 0.5 + rng.uniform(-1, 1, (20, dim))
    x[:, -1] = rng.uniform(-1e-6, 1e-6, 20)
    getcontext().prec = 50
    for point, gap in zip(x, ball.gap(x), strict=True):
        y = [Decimal(a) - Decimal(c) for a, c in zip(point, ball.centre, strict=True)]
        exact = sum((a * a for a in y), Decimal(0)).sqrt() - Decimal(radius)
        assert abs(Decimal(gap) - exact) < Decimal("1e-21")


@pytest.mark.parametrize("component", [0, 1])
def test_a_gradient_that_contradicts_its_function_is_refused_where_it_is_used(component):
    def circle_level_set(x):
        return x[:, 0] ** 2 + (x[:, 1] - 3.0) ** 2 - 1.0

    def gradient(x, factor=1.0):
        slope = np.stack([2 * x[:, 0], 2 * (x[:, 1] - 3.0)], axis=1)
        slope[:, component] *= factor
        return slope

    x = np.array([[0.1, 2.0], [-0.4, 1.7]])
    exact, wrong_surface = (
        SignedDistance(circle_level_set, lambda x, factor=factor: gradient(x, factor))
        for factor in (1.0, 1.001)
    )
    for method in ("normal", "gap_normal_and_curvature"):
        getattr(exact, method)(x)
        with pytest.raises(ValueError, match="differences of its function give"):
            getattr(wrong_surface, method)(x)


def test_an_edge_of_a_function_does_not_contradict_its_gradient():
    """A user's gradient is accepted at an edge of the distance function.

    The function has a corner at x = 0, where the gradients on both sides are valid.
    """
    roof = SignedDistance(
        lambda x: x[:, 1] + np.abs(x[:, 0]),
        lambda x: np.stack([np.where(x[:, 0] < 0, -1.0, 1.0), np.ones(len(x))], axis=1),
    )
    assert roof.normal(np.array([[0.0, 1.0], [0.2, 1.0], [-0.2, 1.0]]))[:, 1].min() > 0.7


@pytest.mark.parametrize("dim", [2, 3])
def test_the_centre_of_a_sphere_has_no_closest_point(dim):
    x = np.array([[0.5] * dim, [0.5] * (dim - 1) + [1.0]])
    gap, normal, normal_gradient = Sphere([0.5] * dim, 2.0).gap_normal_and_curvature(x)
    assert np.isnan(gap).tolist() == [True, False]
    assert all(np.isnan(values[0]).all() for values in (normal, normal_gradient))
    assert all(np.isfinite(values[1]).all() for values in (normal, normal_gradient))


def test_a_step_of_differences_that_is_too_large_is_logged(caplog):
    """A warning is logged if the step of the differences that give the normals is too large.

    The contact force is compared with the force for exact normals. Differences of the distance from
    a circle have an error of (step / radius)^2 / 6 at most points.
    """
    body = ElasticBody(triangles(MPI.COMM_SELF, (-1.0, 0.0), (1.0, 1.0), (4, 2)))
    supports = body.make_clamping_supports(on_plane(1, 0.0))

    def distance(x):
        return np.hypot(x[:, 0], x[:, 1] - 4.0) - 3.0

    def gradient(x):
        from_centre = x - [0.0, 4.0]
        return from_centre / np.linalg.norm(from_centre, axis=1, keepdims=True)

    def force_and_warning(surface):
        caplog.clear()
        problem = body.contact_problem(ContactPair(on_plane(1, 1.0), surface), supports)
        state = problem.step(problem.undeformed, motions=Motion((0.0, -0.1)))
        return state.pairs[0].force[1], "halving the step of differences" in caplog.text

    exact_force, is_logged = force_and_warning(SignedDistance(distance, gradient, step=1.0))
    assert not is_logged
    for step in (1.0, 0.1):
        approximate, is_logged = force_and_warning(SignedDistance(distance, step=step))
        assert approximate != pytest.approx(exact_force, rel=1e-6)
        assert is_logged
        assert f"{step:.3g}" in caplog.text
        assert "Give a smaller step" in caplog.text
    for step in (1e-3, None):
        approximate, is_logged = force_and_warning(SignedDistance(distance, step=step))
        assert approximate == pytest.approx(exact_force, rel=1e-6)
        assert not is_logged
    x = RNG.uniform(-1, 1, (20, 2))
    flat = SignedDistance(lambda x: np.hypot(x[:, 0], x[:, 1] - 1e4 - 1) - 1e4, step=1e-6)
    assert measure_gradient_change_at_half_step(flat, x) < 1e-5


def test_closest_points_are_infinitely_far_where_nothing_is_faced():
    """Where a signed distance is infinite, the closest point is infinitely far away.

    Elsewhere, gaps, normals and curvatures agree with those of a full circle. Near the edge of the
    surface, they are computed by one-sided differences instead of central ones.
    """

    def half_circle_distance(x):
        return np.where(x[:, 0] <= 0.5, np.hypot(x[:, 0], x[:, 1]) - 1.0, np.inf)

    circle = SignedDistance(lambda x: np.hypot(x[:, 0], x[:, 1]) - 1.0)
    x = np.array([[0.1, 1.2], [-0.7, 0.9], [0.5, np.sqrt(0.75)], [0.500001, 1.0], [2.0, 0.0]])
    values, expected = (
        SignedDistance(half_circle_distance).gap_normal_and_curvature(x),
        circle.gap_normal_and_curvature(x),
    )
    assert np.array_equal(np.isposinf(values[0]), [False, False, False, True, True])
    is_faced = np.isfinite(values[0])
    assert values[0][is_faced] == pytest.approx(expected[0][is_faced], abs=1e-8)
    assert values[1][is_faced] == pytest.approx(expected[1][is_faced], abs=1e-5)
    assert values[2][:2] == pytest.approx(expected[2][:2], abs=1e-3)
    assert not values[2][~is_faced].any()
    assert np.linalg.norm(values[1][~is_faced], axis=1) == pytest.approx(1)
