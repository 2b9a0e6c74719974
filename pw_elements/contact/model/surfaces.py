"""Rigid surfaces: the gap to them and the direction in which they push.

A surface is anything with the two methods of `Surface`. Points are rows (n, dim), other than in
markers and friction functions, which take DOLFINx's columns (3, n); in axisymmetry the coordinates
are (r, z). The normal points from the rigid surface into the body, and the gap is counted along
it: negative inside the rigid.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pw_elements.checks import field, number, positive, vector

Points = npt.NDArray[np.float64]


def unit(direction: Sequence[float]) -> npt.NDArray[np.float64]:
    """The unit vector (dim,) along a direction.

    Raises:
        ValueError: if it is no vector of a finite length.
    """
    along = vector("direction", direction)
    length = np.linalg.norm(along)
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"direction {list(direction)}: needs a finite length")
    return along / length


def normalised(vectors: Points) -> Points:
    """Unit vectors (n, dim) along vectors.

    Raises:
        ValueError: if one has no length.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not length.all():
        raise ValueError("the normal of a surface is not defined at a contact node")
    return vectors / length


def quarter_turned(vectors: Points) -> Points:
    """Unit vectors a quarter turn to the left, (n, 2)."""
    return normalised(np.column_stack((-vectors[:, 1], vectors[:, 0])))


class Surface(Protocol):
    """Geometry of a rigid surface at its initial place."""

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
        """Distance (n,) of points x (n, dim); negative inside, infinite where nothing faces x."""
        ...

    def normal(self, x: Points) -> Points:
        """Unit vectors (n, dim) in which the surface pushes points x (n, dim), near it or not."""
        ...


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

    def __post_init__(self) -> None:
        vector("the point of a plane", self.point)
        unit(self.direction)

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
        """Distance (n,) of points x (n, dim), positive on the side that the direction points to."""
        return (x - np.asarray(self.point)) @ unit(self.direction)

    def normal(self, x: Points) -> Points:
        """The unit direction (n, dim), at any points x (n, dim)."""
        return np.tile(unit(self.direction), (len(x), 1))


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

    def __post_init__(self) -> None:
        vector("the apex of a parabola", self.apex)
        if number("radius", self.radius) == 0:
            raise ValueError(f"radius = {self.radius}: a parabola needs one that is not zero")

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
        """Distance (n,) of points x (n, dim) along the axis."""
        s = x - np.asarray(self.apex)
        return (np.sum(s[:, :-1] ** 2, axis=1) / (2 * self.radius) - s[:, -1]) * np.sign(
            self.radius
        )

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

    def __post_init__(self) -> None:
        vector("the centre of a sphere", self.centre)
        positive("radius", self.radius)

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
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

    def __post_init__(self) -> None:
        vector("the centre of a punch", self.centre)
        unit(self.direction)
        positive("half_width", self.half_width)

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
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
        gradient: of points as rows, (n, dim) to (n, dim), by default central differences.
        step: of the differences, a small part of the smallest radius of the surface.

    Raises:
        TypeError: for anything but functions.
        ValueError: for a step that is not positive.
    """

    function: Callable[[Points], npt.NDArray[np.float64]]
    gradient: Callable[[Points], Points] | None = None
    step: float = 1e-6

    def __post_init__(self) -> None:
        for name in ("function", "gradient"):
            given = getattr(self, name)
            if not (callable(given) or (name == "gradient" and given is None)):
                raise TypeError(f"{name} = {given!r}: has to be a function of points (n, dim)")
        positive("step", self.step)

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
        """Distance (n,) of points x (n, dim), at first order."""
        gap = self._values(x)
        faced = np.isfinite(gap)
        gap[faced] /= np.linalg.norm(self._slope(x[faced]), axis=1)
        return gap

    def normal(self, x: Points) -> Points:
        """The gradient's unit vectors (n, dim) at points x (n, dim); any where nothing faces x."""
        faced = np.isfinite(self._values(x))
        normal = np.tile(np.eye(x.shape[1])[-1], (len(x), 1))
        normal[faced] = normalised(self._slope(x[faced]))
        return normal

    def _values(self, x: Points) -> npt.NDArray[np.float64]:
        layout = f"it takes points as rows (n, {x.shape[1]}) and gives (n,)"
        return field("the function of a signed distance", self.function(x), (len(x),), layout)

    def _slope(self, x: Points) -> Points:
        """Gradient (n, dim)."""
        if self.gradient is not None:
            layout = f"it takes points as rows and gives rows (n, {x.shape[1]})"
            given = self.gradient(x)
            return field("the gradient of a signed distance", given, x.shape, layout)
        steps = self.step * np.eye(x.shape[1])
        differences = [self._values(x + h) - self._values(x - h) for h in steps]
        return np.asarray(np.array(differences).T / (2 * self.step), dtype=float)


@dataclass(frozen=True)
class Polyline:
    """Polygonal line in the plane, whose first and last segment extend to infinity.

    The body lies to the left when one walks from the first point to the last. Corners that
    protrude into the body are sharp (the normal at a point nearest to the corner is the
    line that joins them) or rounded from within; re-entrant ones stay sharp.

    Args:
        points: (m, 2), two at least.
        radius: of the rounding; it has to fit the shorter segment at each corner.

    Raises:
        ValueError: for fewer than two points, repeated points, or a radius that is negative
            or too large for a segment.
    """

    points: Sequence[Sequence[float]]
    radius: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.points, Sequence | np.ndarray):
            raise ValueError(f"points = {self.points!r}: a polyline needs a sequence of them")
        points = np.array([vector("a point of a polyline", point) for point in self.points])
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ValueError("a polyline needs two points (x, y) at least")
        if not np.linalg.norm(np.diff(points, axis=0), axis=1).all():
            raise ValueError("two successive points of the polyline are the same")
        if number("radius", self.radius) < 0:
            raise ValueError(f"radius = {self.radius}: cannot be negative")
        if np.any(np.sum(np.diff(self._inset(), axis=0) * np.diff(points, axis=0), axis=1) <= 0):
            raise ValueError(f"radius = {self.radius}: leaves nothing of a segment")

    def gap(self, x: Points) -> npt.NDArray[np.float64]:
        """Distance (n,) of points x (n, 2) from the (rounded) line."""
        return self._nearest(x)[0]

    def normal(self, x: Points) -> Points:
        """Unit vectors (n, 2) from the nearest point of the (rounded) line to points x (n, 2)."""
        return self._nearest(x)[1]

    def _inset(self) -> Points:
        """The line moved into the rigid by the radius, corners where its segments meet."""
        points = np.asarray(self.points, dtype=float)
        normals = quarter_turned(np.diff(points, axis=0))
        inset = points.copy()
        inset[0] -= self.radius * normals[0]
        inset[-1] -= self.radius * normals[-1]
        both = normals[:-1] + normals[1:]
        inset[1:-1] -= 2 * self.radius * both / np.sum(both**2, axis=1, keepdims=True)
        return inset

    def _nearest(self, x: Points) -> tuple[npt.NDArray[np.float64], Points]:
        line = self._inset()
        normals = quarter_turned(span := np.diff(line, axis=0))
        turns_right = np.sum(span[1:] * normals[:-1], axis=1) < 0
        s = np.einsum("nkd,kd->nk", x[:, None] - line[:-1], span) / np.sum(span**2, axis=1)
        low, high = np.zeros(len(span)), np.ones(len(span))
        low[0], high[-1] = -np.inf, np.inf
        clamped = np.clip(s, low, high)
        away = x[:, None] - line[:-1] - clamped[..., None] * span
        nearest = np.argmin(np.linalg.norm(away, axis=2), axis=1)
        row = np.arange(len(x))
        away, s, clamped = away[row, nearest], s[row, nearest], clamped[row, nearest]

        distance = np.linalg.norm(away, axis=1)
        sign = np.sign(np.sum(away * normals[nearest], axis=1))
        direction = normals[nearest]
        corner = (s != clamped) & (distance > 0)
        if corner.any():  # nearest to a corner, outside of one that sticks out
            before = nearest[corner] - (s[corner] < 0)
            sign[corner] = np.where(turns_right[before], 1.0, -1.0)
            direction[corner] = sign[corner, None] * away[corner] / distance[corner, None]
        return sign * distance - self.radius, direction
