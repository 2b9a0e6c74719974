"""Rigid surfaces: the gap to them and the direction in which they push.

A surface is anything with the two methods of `Surface`. Points are rows (n, dim), other than in
markers and friction functions, which take DOLFINx's columns (3, n); in axisymmetry the coordinates
are (r, z). The normal points from the rigid surface into the body, and the gap is counted along
it: negative inside the rigid.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import arguments, defer_errors_if_parallel

Points = Array

# Newton's method for closest points: most steps, and the size of the last one over the largest
# coordinate, with a gradient function and with differences
_PROJECTIONS = 30
_PROJECTED, _PROJECTED_BY_DIFFERENCES = 1e-12, 1e-8
# Step of first differences over the largest coordinate; step of second ones over that of first ones
_STEP, _COARSER = 1e-6, 100
# Difference of a given gradient, over its size, that passes, and round-off of values in eps
_GRADIENT, _LOST_DIGITS = 1e-5, 64
# The same of a normal and its derivative, over the largest entry
_DERIVATIVE = 1e-4
# Distance from the centre over a sphere's radius at which there is no closest point
_AT_CENTRE = 1e-12
# Relative change of a gradient by differences, if the step is halved, above which the step is told:
# that of the default step is round-off of the function, up to 1e-6 of a radius of 1e4 bodies
MAX_STEP_ERROR = 1e-5


def unit(direction: Sequence[float]) -> Array:
    """The unit vector (dim,) along a direction; a ValueError if that has no finite length."""
    along = np.asarray(direction, dtype=float)
    length = np.linalg.norm(along)
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"direction {list(direction)}: needs a finite length")
    return along / length


def check_direction(direction: Sequence[float]) -> None:
    """Raise ValueError for a direction that is no vector of finite numbers, or has no length."""
    arguments.check_vector("direction", direction)
    unit(direction)


def normalised(vectors: Points) -> Points:
    """Unit vectors (n, dim) along vectors; a ValueError if one has no length."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not length.all():
        raise ValueError("the normal of a surface is not defined at a contact node")
    return vectors / length


class Surface(Protocol):
    """Geometry of a rigid surface at its initial place."""

    def gap(self, x: Points) -> Array:
        """Distance (n,) of points x (n, dim); negative inside, infinite where nothing faces x."""

    def normal(self, x: Points) -> Points:
        """Unit vectors (n, dim) in which the surface pushes points x (n, dim), near it or not."""


@runtime_checkable
class RigidBody(Surface, Protocol):
    """A surface that deformed bodies may touch: it knows the closest point, and its curvature."""

    def closest(self, x: Points) -> tuple[Array, Points, Array]:
        """What points x (n, dim) have of their closest points on the surface.

        Returns:
            Distance (n,), negative inside, normal (n, dim), and its derivative by x (n, dim, dim);
            Infinite distance, any normal and a derivative of zero where nothing faces x; NaN where
            there is no closest point. Where nodes touch, the normal has to be the distance's
            derivative, and both are compared with differences.
        """


@dataclass(frozen=True)
class Plane:
    """Plane, in 2-D a line, through a point.

    Args:
        point: (dim,), any on the plane.
        direction: (dim,) from the rigid surface into the body, of any length.

    Raises:
        ValueError: for a direction of no length.
    """

    point: Sequence[float]
    direction: Sequence[float]

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the point of a plane", self.point)
        check_direction(self.direction)

    def gap(self, x: Points) -> Array:
        """Distance (n,) of points x (n, dim), positive on the side that the direction points to."""
        return (x - np.asarray(self.point)) @ unit(self.direction)

    def normal(self, x: Points) -> Points:
        """The unit direction (n, dim), at any points x (n, dim)."""
        return np.tile(unit(self.direction), (len(x), 1))

    def closest(self, x: Points) -> tuple[Array, Points, Array]:
        """Distance of points x (n, dim), normal and its derivative, which is zero."""
        return self.gap(x), self.normal(x), np.zeros((*x.shape, x.shape[1]))


@dataclass(frozen=True)
class Parabola:
    """Parabola y = y_apex + s²/(2 radius), s the distance from the axis through the apex.

    y is the last coordinate and s that of all others: a parabola in 2-D, a paraboloid in
    axisymmetry and 3-D. The rigid body is above the curve for a positive radius (a
    punch that presses downwards), and below it for a negative one.

    The gap is measured along the axis and the normal is the axis: Hertz's approximation for
    contacts that are small compared to the radius, where slopes are small, too.

    Args:
        apex: (dim,).
        radius: of curvature at the apex.

    Raises:
        ValueError: for a radius of zero.
    """

    apex: Sequence[float]
    radius: float

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the apex of a parabola", self.apex)
        if arguments.check_number("radius", self.radius) == 0:
            raise ValueError(f"radius = {self.radius}: a parabola needs one that is not zero")

    def gap(self, x: Points) -> Array:
        """Distance (n,) of points x (n, dim) along the axis."""
        s, radius = x - np.asarray(self.apex), self.radius
        return np.sign(radius) * (np.sum(s[:, :-1] ** 2, axis=1) / (2 * radius) - s[:, -1])

    def normal(self, x: Points) -> Points:
        """The axis (n, dim), from the rigid surface into the body, at any points x (n, dim)."""
        axis = np.zeros_like(x)
        axis[:, -1] = -np.sign(self.radius)
        return axis


@dataclass(frozen=True)
class Sphere:
    """Sphere, in 2-D a circle, in axisymmetry a sphere on the axis; its inside is rigid.

    Args:
        centre: (dim,).
        radius: positive.

    Raises:
        ValueError: for a radius that is not positive.
    """

    centre: Sequence[float]
    radius: float

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the centre of a sphere", self.centre)
        arguments.check_positive("radius", self.radius)

    def gap(self, x: Points) -> Array:
        """Distance (n,) of points x (n, dim) from the sphere."""
        y, row = x - np.asarray(self.centre), np.arange(len(x))
        # counted from the pole next to x, for |y| - R would lose the digits of a small gap
        axis = np.abs(y).argmax(axis=1)
        side = np.where(y[row, axis] < 0, -1.0, 1.0)
        pole = np.asarray(self.centre)[axis] + side * self.radius
        y[row, axis], rise = 0.0, side * (x[row, axis] - pole)
        squares = np.sum(y**2, axis=1) + rise * (2 * self.radius + rise)
        return squares / (np.sqrt(squares + self.radius**2) + self.radius)

    def normal(self, x: Points) -> Points:
        """Unit vectors (n, dim) away from the centre, at points x (n, dim)."""
        return normalised(x - np.asarray(self.centre))

    def closest(self, x: Points) -> tuple[Array, Points, Array]:
        """Distance of points x (n, dim), normal n, and (I - n n^T)/(distance from the centre).

        All are NaN at the centre, of which no point of the sphere is the closest.
        """
        gap, away = self.gap(x), x - np.asarray(self.centre)
        distance = np.linalg.norm(away, axis=1)
        central = distance <= _AT_CENTRE * self.radius
        gap[central] = distance[central] = np.nan
        normal = away / distance[:, None]
        across = np.eye(x.shape[1]) - normal[:, :, None] * normal[:, None, :]
        return gap, normal, across / distance[:, None, None]


@dataclass(frozen=True)
class FlatPunch:
    """Flat face of finite width, a disc in 3-D; only nodes below it can touch.

    Args:
        centre: (dim,) of the face.
        direction: (dim,) from the rigid surface into the body, of any length.
        half_width: distance from centre to edge; a node on the edge touches.

    Raises:
        ValueError: for a direction of no length, or a half width that is not positive.
    """

    centre: Sequence[float]
    direction: Sequence[float]
    half_width: float

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        arguments.check_vector("the centre of a punch", self.centre)
        check_direction(self.direction)
        arguments.check_positive("half_width", self.half_width)

    def gap(self, x: Points) -> Array:
        """Distance (n,) of points x (n, dim) from the face; infinite beside it."""
        s, n = x - np.asarray(self.centre), unit(self.direction)
        gap = s @ n
        beside = np.linalg.norm(s - np.outer(gap, n), axis=1) > self.half_width * (1 + 1e-9)
        return np.where(beside, np.inf, gap)

    def normal(self, x: Points) -> Points:
        """The unit direction (n, dim), at any points x (n, dim)."""
        return np.tile(unit(self.direction), (len(x), 1))


@dataclass(frozen=True)
class SignedDistance:
    """Surface given as a function of points: positive in the body, negative in the rigid surface.

    The gap is the function divided by the size of its gradient, which near the surface is the
    distance whatever the function's scale: x² + y² - R² will do for a circle.

    Args:
        function: of points as rows, (n, dim) to (n,), zero on the surface; infinite where nothing
            faces x.
        gradient: of points as rows, (n, dim) to (n, dim), by default central differences, with
            which a given one is compared where it is used.
        step: of the differences, a small part of the smallest radius of the surface; by default
            1e-6 of the largest coordinate, in contact that of the mesh. Contact warns where half
            the step changes the gradient by more than 1e-5.

    Raises:
        TypeError: for anything but functions.
        ValueError: for a step that is not positive.
    """

    function: Callable[[Points], Array]
    gradient: Callable[[Points], Points] | None = None
    step: float | None = None

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name in ("function", "gradient"):
            given = getattr(self, name)
            if not (arguments.is_user_function(given) or (name == "gradient" and given is None)):
                raise TypeError(f"{name} = {given!r}: has to be a function of points (n, dim)")
        if self.step is not None:
            arguments.check_positive("step", self.step)

    def gap(self, x: Points) -> Array:
        """Distance (n,) of points x (n, dim), at first order."""
        gap = self._values(x)
        faced = np.isfinite(gap)
        gap[faced] /= np.linalg.norm(self._slope(x[faced]), axis=1)
        return gap

    def normal(self, x: Points) -> Points:
        """The gradient's unit vectors (n, dim) at points x (n, dim); any where nothing faces x."""
        faced = np.isfinite(self._values(x))
        self._check_gradient(x[faced])
        normal = np.tile(np.eye(x.shape[1])[-1], (len(x), 1))
        normal[faced] = normalised(self._slope(x[faced]))
        return normal

    def closest(self, x: Points) -> tuple[Array, Points, Array]:
        """Distance of points x (n, dim), normal and its derivative, as `RigidBody` says.

        By Newton's method on p + l grad f(p) = x, f(p) = 0, with p the closest point.

        The Hessian is made of differences of the gradient; without a gradient function it has half
        of the digits. Where the function is infinite nothing faces x; next to such points
        differences are one-sided.
        """
        n, dim = x.shape
        faced = ~np.isposinf(self._values(x))
        gap, normal = np.full(n, np.inf), np.tile(np.eye(dim)[-1], (n, 1))
        shape = np.zeros((n, dim, dim))
        if faced.any():
            gap[faced], normal[faced], shape[faced] = self._closest(x[faced])
        return gap, normal, shape

    def _closest(self, x: Points) -> tuple[Array, Points, Array]:
        n, dim = x.shape
        self._check_gradient(x)
        one, p = np.eye(dim), x.copy()
        slope, flat = self._directed(x)
        length = self._values(x) / np.sum(slope**2, axis=1)
        small = _PROJECTED_BY_DIFFERENCES if self.gradient is None else _PROJECTED
        small *= np.abs(x).max(initial=0.0)
        for _ in range(_PROJECTIONS):
            slope, bend = self._directed(p)[0], self._bend(p)
            system = np.zeros((n, dim + 1, dim + 1))
            system[:, :dim, :dim] = one + length[:, None, None] * bend
            system[:, :dim, dim] = system[:, dim, :dim] = slope
            wrong = x - p - length[:, None] * slope
            right = np.concatenate([wrong, -self._values(p)[:, None]], axis=1)
            known = np.isfinite(system).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
            system[~known], right[~known] = np.eye(dim + 1), np.nan
            step = np.linalg.solve(system, right[:, :, None])[:, :, 0]
            p[known] += step[known, :dim]
            length[known] += step[known, dim]
            found = np.abs(step[:, :dim]).max(axis=1) <= small
            if found.all():
                break
        slope, flat_there = self._directed(p)
        found &= ~(flat | flat_there)
        size = np.linalg.norm(slope, axis=1)
        normal, gap = slope / size[:, None], length * size
        across = one - normal[:, :, None] * normal[:, None, :]
        shape = across @ bend @ across / size[:, None, None]
        normal[~found] = gap[~found] = np.nan
        return gap, normal, np.linalg.solve(one + gap[:, None, None] * shape, shape)

    def _values(self, x: Points) -> Array:
        layout = f"it takes points as rows (n, {x.shape[1]}) and gives (n,)"
        return arguments.check_function_values(
            "the function of a signed distance", self.function(x), (len(x),), layout
        )

    def _slope(self, x: Points) -> Points:
        """Gradient (n, dim) of the function."""
        if self.gradient is not None:
            layout = f"it takes points as rows and gives rows (n, {x.shape[1]})"
            given = self.gradient(x)
            return arguments.check_function_values(
                "the gradient of a signed distance", given, x.shape, layout
            )
        steps, here = self._step(x) * np.eye(x.shape[1]), self._values(x)
        slopes = [_differences(self._values, x, here, h) for h in steps]
        return np.asarray(np.array(slopes).T, dtype=float)

    def _check_gradient(self, x: Points) -> None:
        """Raise ValueError if the given gradient is none of the function at points x (n, dim).

        At an edge any component between those of both sides will do.
        """
        if self.gradient is None or not len(x):
            return
        given, here, step = self._slope(x), self._values(x), self._step(x)
        with np.errstate(all="ignore"):  # beyond where the function is stated
            sides = [
                [sign * (self._values(x + sign * h) - here) / step for sign in (-1, 1)]
                for h in step * np.eye(x.shape[1])
            ]
        (least, most), mean = np.sort(sides, axis=1).transpose(1, 2, 0), np.mean(sides, axis=1).T
        size = np.linalg.norm(mean, axis=1)
        lost = np.abs(here) + size * np.abs(x).max(axis=1)
        allowed = (_GRADIENT * size + _LOST_DIGITS * np.finfo(float).eps * lost / step)[:, None]
        unlike = ((given < least - allowed) | (given > most + allowed)).any(axis=1)
        unlike &= np.isfinite(mean).all(axis=1)
        if unlike.any():
            k = int(unlike.argmax())
            raise ValueError(
                f"the gradient of a signed distance is {given[k].tolist()} at {x[k].tolist()}, but "
                f"differences of its function give {mean[k].tolist()}: correct the gradient, or "
                "leave it out"
            )

    def _step(self, x: Points) -> float:
        return self.step or _STEP * (np.abs(x).max(initial=0.0) or 1.0)

    def _directed(self, x: Points) -> tuple[Points, Mask]:
        """Gradient (n, dim), any direction where it vanishes, and where (n,) that is."""
        slope = self._slope(x)
        flat = ~np.any(slope != 0, axis=1)
        return np.where(flat[:, None], np.eye(x.shape[1])[-1], slope), flat

    def _bend(self, x: Points) -> Array:
        """Second derivatives (n, dim, dim) of the function."""
        step = self._step(x) * (1 if self.gradient is not None else _COARSER)
        steps, here = step * np.eye(x.shape[1]), self._slope(x)
        bend = np.array([_differences(self._slope, x, here, h) for h in steps])
        return np.asarray(bend.transpose(1, 0, 2) + bend.transpose(1, 2, 0)) / 2


# Surfaces whose closest points are the library's own, those of which nothing is a user's, and
# those of these that have a normal everywhere
KNOWN_BODIES = (Plane, Sphere, SignedDistance)
CLOSED_FORMS = (Plane, Parabola, Sphere, FlatPunch)
DEFINED_EVERYWHERE = (Plane, Parabola, FlatPunch)


def wrong_derivatives(surface: RigidBody, x: Points, step: float) -> str:
    """Say what differences contradict of a surface's closest points at points x (n, dim), or "".

    A normal is the derivative of the distance, and has one itself; at an edge any derivative
    between those of both sides will do.
    """
    gap, normal, bend = surface.closest(x)
    here = np.concatenate([gap[:, None], normal], axis=1)
    sides = np.empty((x.shape[1], 2, *here.shape))
    for axis, side in np.ndindex(sides.shape[:2]):
        sign = 2 * side - 1
        moved = surface.closest(x + sign * step * np.eye(x.shape[1])[axis])
        there = np.concatenate([moved[0][:, None], moved[1]], axis=1)
        sides[axis, side] = sign * (there - here) / step
    # (n, 1 + dim, dim), of the distance and of the normal
    (least, most), mean = np.sort(sides, axis=1).transpose(1, 2, 3, 0), sides.mean(axis=1)
    given, mean = np.concatenate([normal[:, None], bend], axis=1), mean.transpose(1, 2, 0)
    lost = _LOST_DIGITS * np.finfo(float).eps * (1 + np.abs(x).max(axis=1)) / step
    size = np.abs(mean).max(axis=(1, 2)) + np.abs(given).max(axis=(1, 2))
    allowed = (_DERIVATIVE * size + lost)[:, None, None]
    unlike = (given < least - allowed) | (given > most + allowed)
    unlike &= np.isfinite(mean).all(axis=(1, 2))[:, None, None]
    if not unlike.any():
        return ""
    k = int(unlike.any(axis=(1, 2)).argmax())
    what = "normal" if unlike[k, 0].any() else "derivative of the normal"
    part = slice(0, 1) if unlike[k, 0].any() else slice(1, None)
    return (
        f"{what} {np.squeeze(given[k, part]).tolist()} at {x[k].tolist()}, but differences give "
        f"{np.squeeze(mean[k, part]).tolist()}"
    )


def _differences(function: Callable[[Points], Array], x: Points, here: Array, h: Array) -> Array:
    """Return the derivative (n, ...) along h (dim,), from the finite side next to infinity."""
    size = np.linalg.norm(h)
    with np.errstate(invalid="ignore"):
        after, before = function(x + h), function(x - h)
        central = (after - before) / (2 * size)
        if np.isfinite(central).all():
            return central
        forward, backward = (after - here) / size, (here - before) / size
    one_sided = np.where(np.isfinite(forward), forward, backward)
    return np.where(np.isfinite(central), central, one_sided)


def step_error(surface: SignedDistance, x: Points) -> float:
    """Return the largest relative change of the gradient if the step of differences is halved.

    It is that at the surface, at the first-order closest points of points x (n, dim); zero with a
    gradient function.
    """
    faced = np.isfinite(surface._values(x))
    if surface.gradient is not None or not faced.any():
        return 0.0
    at = x[faced]
    at = at - surface.gap(at)[:, None] * surface.normal(at)
    slope = surface._slope(at)
    finer = replace(surface, step=surface._step(at) / 2)._slope(at)
    change = np.linalg.norm(slope - finer, axis=1) / np.linalg.norm(finer, axis=1)
    return float(np.max(change, where=np.isfinite(change), initial=0.0))


def with_step(surface: Surface, largest: float) -> Surface:
    """A surface, its step being the default one of a body with a largest coordinate."""
    if isinstance(surface, SignedDistance) and surface.step is None:
        return replace(surface, step=_STEP * largest)
    return surface
