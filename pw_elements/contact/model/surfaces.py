"""Rigid surfaces: their gaps, normals and closest points.

A surface is any object with the two methods of `Surface`. Points are rows (n, dim), in contrast to
markers and friction functions, which take columns (3, n) as in DOLFINx; in axisymmetry the
coordinates are (r, z). The normal points from the rigid surface into the body, and the gap is
measured along the normal. It is negative inside the rigid surface.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from pw_elements.arrays import Array, Mask, RealVector
from pw_elements.checks import arguments, defer_errors_if_parallel

PointArray = Array

# Newton's method for closest points: limit of steps; and size of the final step relative to the
# largest coordinate, with a gradient function and with finite differences
_MAX_CLOSEST_POINT_NEWTON_STEPS = 30
_CLOSEST_POINT_TOLERANCE_PER_COORDINATE, _CLOSEST_POINT_TOLERANCE_PER_COORDINATE_BY_DIFFERENCES = (
    1e-12,
    1e-8,
)
# Step of first differences relative to the largest coordinate; step of second differences relative
# to the step of first differences
_DIFFERENCE_STEP_PER_MAX_COORDINATE, _SECOND_TO_FIRST_DIFFERENCE_STEP_RATIO = 1e-6, 100
# Largest error of a user's gradient relative to its size; round-off of function values divided by
# the machine epsilon
_RELATIVE_GRADIENT_TOLERANCE, _FUNCTION_ROUND_OFF_IN_EPS = 1e-5, 64
# Largest error of a user's normal and of its derivative, relative to the largest entry
_RELATIVE_NORMAL_DERIVATIVE_TOLERANCE = 1e-4
# Distance from the centre of a sphere, relative to its radius, up to which there is no closest
# point
_MIN_CENTRE_DISTANCE_PER_RADIUS = 1e-12
# Largest relative change of a gradient by finite differences when their step is halved. A warning
# is logged if the change is larger. With the default step the change is caused by round-off of the
# function; it is up to 1e-6 for a radius of 1e4 times the body's size
MAX_RELATIVE_GRADIENT_CHANGE_AT_HALF_STEP = 1e-5


def unit_vector(direction: RealVector) -> Array:
    """Return the unit vector (dim,) along a direction.

    Raises:
        ValueError: for a direction whose length is zero or not finite.
    """
    vector = np.asarray(direction, dtype=float)
    length = np.linalg.norm(vector)
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"direction {list(direction)}: needs a finite length")
    return vector / length


def check_direction(direction: RealVector) -> None:
    """Raise ValueError unless a direction is a vector of finite numbers that are not all zero."""
    arguments.check_vector("direction", direction)
    unit_vector(direction)


def normalise_rows(vectors: PointArray) -> PointArray:
    """Return the unit vectors (n, dim) along vectors (n, dim).

    Raises:
        ValueError: for a vector of length zero.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not length.all():
        raise ValueError("the normal of a surface is not defined at a contact node")
    return vectors / length


class Surface(Protocol):
    """Geometry of a rigid surface at its initial position."""

    def gap(self, x: PointArray) -> Array:
        """Return gaps (n,) at points x (n, dim).

        A gap is negative inside the surface, and infinite if the surface does not face the point.
        """

    def normal(self, x: PointArray) -> PointArray:
        """Return the unit directions (n, dim) in which the surface pushes points x (n, dim)."""


@runtime_checkable
class ClosestPointSurface(Surface, Protocol):
    """Surface that computes closest points and curvatures, for contact of deformed bodies."""

    def gap_normal_and_curvature(self, x: PointArray) -> tuple[Array, PointArray, Array]:
        """Return distances, normals and derivatives of normals at the points closest to x (n, dim).

        Where the surface does not face a point, the distance is infinite, the normal arbitrary and
        the derivative zero. Where there is no closest point, all values are NaN. The normal has to
        be the derivative of the distance. Where nodes touch the surface, the derivatives of the
        distance and of the normal are compared with finite differences.

        Returns:
            Distance (n,) of each point, negative inside the surface; unit normal (n, dim) at the
            closest point; and derivative (n, dim, dim) of the normal with respect to x.
        """


@dataclass(frozen=True)
class Plane:
    """Plane (a line in 2-D) through a point.

    Args:
        point: (dim,), any point on the plane.
        direction: (dim,), vector of any length that is normal to the plane and points from the
            rigid surface into the body.

    Raises:
        ValueError: for a direction that is zero.
    """

    point: RealVector
    direction: RealVector

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the point of a plane", self.point)
        check_direction(self.direction)

    def gap(self, x: PointArray) -> Array:
        """Return distances (n,) of points x (n, dim) from the plane.

        Distances are positive on the side to which `direction` points.
        """
        return (x - np.asarray(self.point)) @ unit_vector(self.direction)

    def normal(self, x: PointArray) -> PointArray:
        """Return the unit normal of the plane for each of the points x (n, dim)."""
        return np.tile(unit_vector(self.direction), (len(x), 1))

    def gap_normal_and_curvature(self, x: PointArray) -> tuple[Array, PointArray, Array]:
        """Return distances (n,), normals (n, dim) and derivatives (n, dim, dim) of the normals.

        Distances and normals are those at points x (n, dim). The derivatives are zero.
        """
        return self.gap(x), self.normal(x), np.zeros((*x.shape, x.shape[1]))


@dataclass(frozen=True)
class Parabola:
    """Parabola y = y_apex + s²/(2 radius), with s the distance from the axis through the apex.

    Here y is the last coordinate, and s is measured in the directions of all other coordinates. The
    surface is a parabola in 2-D, and a paraboloid in axisymmetry and 3-D. The rigid body is above
    the surface for a positive radius (a punch that presses downwards), and below it for a negative
    radius.

    The gap is measured along the axis, and the normal is parallel to the axis. This is Hertz's
    approximation for contact areas that are small compared to the radius, so that slopes are small.

    Args:
        apex: (dim,), position of the apex.
        radius: radius of curvature at the apex, positive or negative.

    Raises:
        ValueError: for a radius of zero.
    """

    apex: RealVector
    radius: float

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the apex of a parabola", self.apex)
        if arguments.check_finite_number("radius", self.radius) == 0:
            raise ValueError(f"radius = {self.radius}: a parabola needs a radius that is not zero")

    def gap(self, x: PointArray) -> Array:
        """Return distances (n,) of points x (n, dim) from the surface, measured along the axis."""
        s, radius = x - np.asarray(self.apex), self.radius
        return np.sign(radius) * (np.sum(s[:, :-1] ** 2, axis=1) / (2 * radius) - s[:, -1])

    def normal(self, x: PointArray) -> PointArray:
        """Return unit vectors (n, dim) along the axis, from the surface into the body.

        The vectors are equal at all points x (n, dim).
        """
        axis = np.zeros_like(x)
        axis[:, -1] = -np.sign(self.radius)
        return axis


@dataclass(frozen=True)
class Sphere:
    """Rigid sphere. It is a circle in 2-D, and its centre is on the axis in axisymmetry.

    Args:
        centre: (dim,), position of the centre.
        radius: radius of the sphere, positive.

    Raises:
        ValueError: for a radius that is not positive.
    """

    centre: RealVector
    radius: float

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the centre of a sphere", self.centre)
        arguments.check_positive("radius", self.radius)

    def gap(self, x: PointArray) -> Array:
        """Return distances (n,) of points x (n, dim) from the sphere, negative inside."""
        y, row = x - np.asarray(self.centre), np.arange(len(x))
        # measured from the nearest pole, since |y| - radius would lose digits of small gaps
        axis = np.abs(y).argmax(axis=1)
        side = np.where(y[row, axis] < 0, -1.0, 1.0)
        pole = np.asarray(self.centre)[axis] + side * self.radius
        y[row, axis], rise = 0.0, side * (x[row, axis] - pole)
        squares = np.sum(y**2, axis=1) + rise * (2 * self.radius + rise)
        return squares / (np.sqrt(squares + self.radius**2) + self.radius)

    def normal(self, x: PointArray) -> PointArray:
        """Return unit vectors (n, dim) from the centre towards points x (n, dim)."""
        return normalise_rows(x - np.asarray(self.centre))

    def gap_normal_and_curvature(self, x: PointArray) -> tuple[Array, PointArray, Array]:
        """Return distances (n,), normals (n, dim) and derivatives (n, dim, dim) of the normals.

        The values are evaluated at points x (n, dim). With the unit vector n from the centre to a
        point, the normal is n, and its derivative is (I - n n^T)/|x - centre|. All values are NaN
        at the centre, which has no closest point.
        """
        gap, from_centre = self.gap(x), x - np.asarray(self.centre)
        distance = np.linalg.norm(from_centre, axis=1)
        central = distance <= _MIN_CENTRE_DISTANCE_PER_RADIUS * self.radius
        gap[central] = distance[central] = np.nan
        normal = from_centre / distance[:, None]
        tangential = np.eye(x.shape[1]) - normal[:, :, None] * normal[:, None, :]
        return gap, normal, tangential / distance[:, None, None]


@dataclass(frozen=True)
class FlatPunch:
    """Flat face of finite width, which is a disc in 3-D. Only nodes within the width can touch it.

    Args:
        centre: (dim,), centre of the face.
        direction: (dim,), vector of any length that is normal to the face and points from the rigid
            surface into the body.
        half_width: distance from the centre to the edge. A node on the edge can touch the face.

    Raises:
        ValueError: for a direction that is zero, or a half width that is not positive.
    """

    centre: RealVector
    direction: RealVector
    half_width: float

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the centre of a punch", self.centre)
        check_direction(self.direction)
        arguments.check_positive("half_width", self.half_width)

    def gap(self, x: PointArray) -> Array:
        """Return distances (n,) of points x (n, dim) from the face, infinite outside its width."""
        s, n = x - np.asarray(self.centre), unit_vector(self.direction)
        gap = s @ n
        outside = np.linalg.norm(s - np.outer(gap, n), axis=1) > self.half_width * (1 + 1e-9)
        return np.where(outside, np.inf, gap)

    def normal(self, x: PointArray) -> PointArray:
        """Return the unit normal of the face for each of the points x (n, dim)."""
        return np.tile(unit_vector(self.direction), (len(x), 1))


@dataclass(frozen=True)
class SignedDistance:
    """Level-set surface, on which a function is zero.

    The function is positive on the side of the body, and negative inside the rigid surface. The gap
    is the function divided by the magnitude of its gradient. Close to the surface this is the
    distance, whatever the scale of the function. For a circle of radius R about the origin, for
    example, the function may be x² + y² - R².

    Args:
        function: function of points as rows (n, dim) that returns values (n,). They are zero on the
            surface, and infinite where the surface does not face a point.
        gradient: function of points as rows (n, dim) that returns gradients (n, dim). By default
            they are computed by central differences. A user's gradient is compared with finite
            differences wherever it is used.
        step: step of the differences, which should be a small part of the smallest radius of the
            surface. By default it is 1e-6 of the largest coordinate of the points, or of the mesh
            in contact computations. Contact computations log a warning where half the step changes
            the gradient by more than 1e-5 of its magnitude.

    Raises:
        TypeError: for a `function` or `gradient` that is not a function.
        ValueError: for a step that is not positive.
    """

    function: Callable[[PointArray], Array]
    gradient: Callable[[PointArray], PointArray] | None = None
    step: float | None = None

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name in ("function", "gradient"):
            function = getattr(self, name)
            is_default = name == "gradient" and function is None
            if not (arguments.is_user_function(function) or is_default):
                raise TypeError(f"{name} = {function!r}: has to be a function of points (n, dim)")
        if self.step is not None:
            arguments.check_positive("step", self.step)

    def gap(self, x: PointArray) -> Array:
        """Return first-order approximations (n,) of the distances of points x (n, dim)."""
        gap = self._evaluate_function(x)
        faced = np.isfinite(gap)
        gap[faced] /= np.linalg.norm(self._evaluate_gradient(x[faced]), axis=1)
        return gap

    def normal(self, x: PointArray) -> PointArray:
        """Return unit vectors (n, dim) along the gradient at points x (n, dim).

        The vectors are arbitrary at points that the surface does not face.
        """
        faced = np.isfinite(self._evaluate_function(x))
        self._check_user_gradient(x[faced])
        normal = np.tile(np.eye(x.shape[1])[-1], (len(x), 1))
        normal[faced] = normalise_rows(self._evaluate_gradient(x[faced]))
        return normal

    def gap_normal_and_curvature(self, x: PointArray) -> tuple[Array, PointArray, Array]:
        """Return distances (n,), normals (n, dim) and derivatives (n, dim, dim) of the normals.

        The values are evaluated at points x (n, dim). Newton's method solves p + l grad f(p) = x,
        f(p) = 0 for the closest point p of each point and a multiplier l, where f is the function.

        Second derivatives are differences of the gradient. Without a gradient function, they have
        half as many correct digits. Where the function is infinite, the surface does not face the
        point. Differences next to such points are one-sided.
        """
        n, dim = x.shape
        faced = ~np.isposinf(self._evaluate_function(x))
        gap, normal = np.full(n, np.inf), np.tile(np.eye(dim)[-1], (n, 1))
        curvature = np.zeros((n, dim, dim))
        if faced.any():
            gap[faced], normal[faced], curvature[faced] = (
                self._compute_distances_normals_and_curvatures(x[faced])
            )
        return gap, normal, curvature

    def _compute_distances_normals_and_curvatures(
        self, x: PointArray
    ) -> tuple[Array, PointArray, Array]:
        """Return distances, normals and derivatives of normals at points x (n, dim).

        The function has to be finite at the points. Results are NaN where Newton's method finds no
        closest point.
        """
        n, dim = x.shape
        self._check_user_gradient(x)
        identity, p = np.eye(dim), x.copy()
        gradient, zero_at_x = self._evaluate_gradient_and_replace_zeros(x)
        length = self._evaluate_function(x) / np.sum(gradient**2, axis=1)
        tolerance = _CLOSEST_POINT_TOLERANCE_PER_COORDINATE
        if self.gradient is None:
            tolerance = _CLOSEST_POINT_TOLERANCE_PER_COORDINATE_BY_DIFFERENCES
        tolerance *= np.abs(x).max(initial=0.0)
        for _ in range(_MAX_CLOSEST_POINT_NEWTON_STEPS):
            gradient, hessian = (
                self._evaluate_gradient_and_replace_zeros(p)[0],
                self._evaluate_hessian(p),
            )
            matrix = np.zeros((n, dim + 1, dim + 1))
            matrix[:, :dim, :dim] = identity + length[:, None, None] * hessian
            matrix[:, :dim, dim] = matrix[:, dim, :dim] = gradient
            residual = x - p - length[:, None] * gradient
            right = np.concatenate([residual, -self._evaluate_function(p)[:, None]], axis=1)
            finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
            matrix[~finite], right[~finite] = np.eye(dim + 1), np.nan
            step = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
            p[finite] += step[finite, :dim]
            length[finite] += step[finite, dim]
            converged = np.abs(step[:, :dim]).max(axis=1) <= tolerance
            if converged.all():
                break
        gradient, zero_at_p = self._evaluate_gradient_and_replace_zeros(p)
        converged &= ~(zero_at_x | zero_at_p)
        size = np.linalg.norm(gradient, axis=1)
        normal, gap = gradient / size[:, None], length * size
        tangential = identity - normal[:, :, None] * normal[:, None, :]
        curvature = tangential @ hessian @ tangential / size[:, None, None]
        normal[~converged] = gap[~converged] = np.nan
        return gap, normal, np.linalg.solve(identity + gap[:, None, None] * curvature, curvature)

    def _evaluate_function(self, x: PointArray) -> Array:
        """Return values (n,) of the function at points x (n, dim)."""
        layout = f"it takes points as rows (n, {x.shape[1]}) and gives (n,)"
        return arguments.check_user_function_values(
            "the function of a signed distance", self.function(x), (len(x),), layout
        )

    def _evaluate_gradient(self, x: PointArray) -> PointArray:
        """Return the gradient (n, dim) at points x, by differences if no function gives it."""
        if self.gradient is not None:
            layout = f"it takes points as rows and gives rows (n, {x.shape[1]})"
            gradient = self.gradient(x)
            return arguments.check_user_function_values(
                "the gradient of a signed distance", gradient, x.shape, layout
            )
        steps, values = (
            self._finite_difference_step(x) * np.eye(x.shape[1]),
            self._evaluate_function(x),
        )
        derivatives = [
            _difference_along_direction(self._evaluate_function, x, values, h) for h in steps
        ]
        return np.asarray(np.array(derivatives).T, dtype=float)

    def _check_user_gradient(self, x: PointArray) -> None:
        """Raise ValueError if finite differences contradict a user's gradient at points x (n, dim).

        At an edge of the surface, a component may have any value between its values on both sides.
        """
        if self.gradient is None or not len(x):
            return
        gradient, values = self._evaluate_gradient(x), self._evaluate_function(x)
        step = self._finite_difference_step(x)
        with np.errstate(all="ignore"):  # points may be outside the domain of the function
            one_sided = [
                [sign * (self._evaluate_function(x + sign * h) - values) / step for sign in (-1, 1)]
                for h in step * np.eye(x.shape[1])
            ]
        smallest, largest = np.sort(one_sided, axis=1).transpose(1, 2, 0)
        central = np.mean(one_sided, axis=1).T
        size = np.linalg.norm(central, axis=1)
        magnitude = np.abs(values) + size * np.abs(x).max(axis=1)
        round_off = _FUNCTION_ROUND_OFF_IN_EPS * np.finfo(float).eps * magnitude / step
        tolerance = (_RELATIVE_GRADIENT_TOLERANCE * size + round_off)[:, None]
        too_small, too_large = gradient < smallest - tolerance, gradient > largest + tolerance
        wrong = (too_small | too_large).any(axis=1)
        wrong &= np.isfinite(central).all(axis=1)
        if wrong.any():
            k = int(wrong.argmax())
            raise ValueError(
                f"the gradient of a signed distance is {gradient[k].tolist()} at {x[k].tolist()}, "
                f"but differences of its function give {central[k].tolist()}: correct the "
                "gradient, or leave it out"
            )

    def _finite_difference_step(self, x: PointArray) -> float:
        return self.step or _DIFFERENCE_STEP_PER_MAX_COORDINATE * (
            np.abs(x).max(initial=0.0) or 1.0
        )

    def _evaluate_gradient_and_replace_zeros(self, x: PointArray) -> tuple[PointArray, Mask]:
        """Return the gradient (n, dim), and a mask (n,) of the points x at which it vanishes.

        At these points, the gradient is replaced by a unit vector.
        """
        gradient = self._evaluate_gradient(x)
        is_zero = ~np.any(gradient != 0, axis=1)
        return np.where(is_zero[:, None], np.eye(x.shape[1])[-1], gradient), is_zero

    def _evaluate_hessian(self, x: PointArray) -> Array:
        """Return symmetrised second derivatives (n, dim, dim) of the function at points x."""
        factor = 1 if self.gradient is not None else _SECOND_TO_FIRST_DIFFERENCE_STEP_RATIO
        step = self._finite_difference_step(x) * factor
        steps, gradient = step * np.eye(x.shape[1]), self._evaluate_gradient(x)
        hessian = np.array(
            [_difference_along_direction(self._evaluate_gradient, x, gradient, h) for h in steps]
        )
        return np.asarray(hessian.transpose(1, 0, 2) + hessian.transpose(1, 2, 0)) / 2


# Surface types of the library that compute closest points; types that contain no user function; and
# those of the latter types that have a normal everywhere
BUILT_IN_SURFACE_TYPES_WITH_CLOSEST_POINTS = (Plane, Sphere, SignedDistance)
CLOSED_FORM_SURFACE_TYPES = (Plane, Parabola, Sphere, FlatPunch)
SURFACE_TYPES_WITH_NORMAL_EVERYWHERE = (Plane, Parabola, FlatPunch)


def describe_wrong_derivatives(surface: ClosestPointSurface, x: PointArray, step: float) -> str:
    """Return a description of a wrong derivative of a surface's gap or normal, or "" if none is.

    The normal is compared with finite differences of the distance, and the derivative of the normal
    with finite differences of the normal. At an edge of the surface, a derivative may have any
    value between its values on both sides.

    Args:
        surface: surface with closest points.
        x: (n, dim), points at which derivatives are checked.
        step: step of the differences.
    """
    gap, normal, curvature = surface.gap_normal_and_curvature(x)
    values = np.concatenate([gap[:, None], normal], axis=1)
    one_sided = np.empty((x.shape[1], 2, *values.shape))
    for axis, side in np.ndindex(one_sided.shape[:2]):
        sign = 2 * side - 1
        next_gap, next_normal, _ = surface.gap_normal_and_curvature(
            x + sign * step * np.eye(x.shape[1])[axis]
        )
        next_values = np.concatenate([next_gap[:, None], next_normal], axis=1)
        one_sided[axis, side] = sign * (next_values - values) / step
    # derivatives (n, 1 + dim, dim) of the distance and of the normal
    smallest, largest = np.sort(one_sided, axis=1).transpose(1, 2, 3, 0)
    central = one_sided.mean(axis=1).transpose(1, 2, 0)
    derivatives = np.concatenate([normal[:, None], curvature], axis=1)
    round_off = (
        _FUNCTION_ROUND_OFF_IN_EPS * np.finfo(float).eps * (1 + np.abs(x).max(axis=1)) / step
    )
    size = np.abs(central).max(axis=(1, 2)) + np.abs(derivatives).max(axis=(1, 2))
    tolerance = (_RELATIVE_NORMAL_DERIVATIVE_TOLERANCE * size + round_off)[:, None, None]
    wrong = (derivatives < smallest - tolerance) | (derivatives > largest + tolerance)
    wrong &= np.isfinite(central).all(axis=(1, 2))[:, None, None]
    if not wrong.any():
        return ""
    k = int(wrong.any(axis=(1, 2)).argmax())
    quantity = "normal" if wrong[k, 0].any() else "derivative of the normal"
    part = slice(0, 1) if wrong[k, 0].any() else slice(1, None)
    return (
        f"{quantity} {np.squeeze(derivatives[k, part]).tolist()} at {x[k].tolist()}, but "
        f"differences give {np.squeeze(central[k, part]).tolist()}"
    )


def _difference_along_direction(
    function: Callable[[PointArray], Array], x: PointArray, values_at_x: Array, step_vector: Array
) -> Array:
    """Return the derivative (n, ...) of a function in the direction of a step, by differences.

    Differences are central, or one-sided next to points at which the function is infinite.

    Args:
        function: function of points (n, dim) that returns values (n, ...).
        x: (n, dim), points.
        values_at_x: (n, ...), values of the function at x.
        step_vector: (dim,), step of the differences.
    """
    size = np.linalg.norm(step_vector)
    with np.errstate(invalid="ignore"):
        next_values, previous_values = function(x + step_vector), function(x - step_vector)
        central = (next_values - previous_values) / (2 * size)
        if np.isfinite(central).all():
            return central
        forward, backward = (
            (next_values - values_at_x) / size,
            (values_at_x - previous_values) / size,
        )
    one_sided = np.where(np.isfinite(forward), forward, backward)
    return np.where(np.isfinite(central), central, one_sided)


def measure_gradient_change_at_half_step(surface: SignedDistance, x: PointArray) -> float:
    """Return the largest relative change of the gradient when the step of differences is halved.

    The gradient is evaluated at first-order approximations of the points of the surface that are
    closest to x (n, dim). The result is zero for a surface with a gradient function.
    """
    faced = np.isfinite(surface._evaluate_function(x))
    if surface.gradient is not None or not faced.any():
        return 0.0
    point = x[faced]
    point = point - surface.gap(point)[:, None] * surface.normal(point)
    gradient = surface._evaluate_gradient(point)
    finer_surface = replace(surface, step=surface._finite_difference_step(point) / 2)
    finer_gradient = finer_surface._evaluate_gradient(point)
    change = np.linalg.norm(gradient - finer_gradient, axis=1)
    change = change / np.linalg.norm(finer_gradient, axis=1)
    return float(np.max(change, where=np.isfinite(change), initial=0.0))


def with_default_difference_step(surface: Surface, max_coordinate: float) -> Surface:
    """Return the surface with a step of differences that suits the largest coordinate of a body.

    Surfaces that have a step, or that need none, are returned unchanged.
    """
    if isinstance(surface, SignedDistance) and surface.step is None:
        return replace(surface, step=_DIFFERENCE_STEP_PER_MAX_COORDINATE * max_coordinate)
    return surface
