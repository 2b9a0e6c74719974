"""Steady heat conduction in graded materials: problems with closed answers, and Trefftz's way.

Conductivity varies with position and temperature, k = exp(g x) (1 + u), in a unit square. Trefftz's
way shares nothing with finite elements: it writes div(k grad u) = -Q as Poisson's equation,

    laplace(u) = -(grad(k) . grad(u) + Q) / k,

approximates the right side, of the last iterate, by a polynomial through collocation points, takes
the polynomial's own particular solution, and fits harmonic polynomials to the boundary conditions
by collocation; over again until nothing changes.

As far as the stray article at the end of the paper's file can be read, this is what it does
(E. Kita, Y. Ikeda, N. Kamiya published the method). Theirs: Poisson's equation with an
inhomogeneous term, the polynomial, its particular solution, Laplace's solutions, collocation. Ours,
since the text breaks off: polynomials' degrees, the points, least squares, when to stop, problems.
"""

from dataclasses import dataclass
from math import factorial
from typing import Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# When nothing changes any more but round-off, over the temperature; and when it never will
_SETTLED, _STEPS = 1e-11, 500


class Conduction(Protocol):
    """A problem on the unit square whose temperatures at x = 0 and 1 are prescribed."""

    @property
    def growth(self) -> float:
        """Logarithm g of the ratio of conductivities at x = 1 and 0, at one temperature."""
        ...

    @property
    def insulated(self) -> bool:
        """Whether no heat passes y = 0 and 1, where temperatures are prescribed otherwise."""
        ...

    def temperature(self, x: Array, y: Array) -> Array:
        """Exact u."""
        ...

    def flux(self, y: Array) -> Array:
        """Exact flux k u_x that enters at x = 1."""
        ...

    def source(self, x: Array, y: Array) -> Array:
        """Source Q over the conductivity."""
        ...


@dataclass(frozen=True)
class Graded:
    """A wall between two surfaces without a source, y = 0 and 1 insulated.

    With Kirchhoff's t = u + u^2 / 2 the equation is div(exp(g x) grad t) = 0, which exponentials
    solve.

    Args:
        ratio: conductivity at x = 1 over that at x = 0, at one temperature.
    """

    ratio: float
    insulated: bool = True

    @property
    def growth(self) -> float:
        """Logarithm of the ratio."""
        return float(np.log(self.ratio))

    def temperature(self, x: Array, y: Array) -> Array:
        """Exact u, of Kirchhoff's t."""
        g, s = self.growth, self._rate
        even = 0.25 + 0.5 * np.expm1(-g * x) / np.expm1(-g)
        wave = np.exp(-g * (x - 1) / 2) * np.sinh(s * x) / np.sinh(s)
        return np.asarray(np.sqrt(1 + 2 * (even + 0.25 * wave * np.cos(np.pi * y))) - 1)

    def flux(self, y: Array) -> Array:
        """Exact flux k u_x that enters at x = 1."""
        g, s = self.growth, self._rate
        even = 0.5 * g * np.exp(-g) / -np.expm1(-g)
        return np.asarray(np.exp(g) * (even + 0.25 * np.cos(np.pi * y) * (s / np.tanh(s) - g / 2)))

    def source(self, x: Array, y: Array) -> Array:  # noqa: ARG002
        """None."""
        return np.zeros_like(x)

    @property
    def _rate(self) -> float:
        return float(np.hypot(np.pi, self.growth / 2))


@dataclass(frozen=True)
class Sourced:
    """The temperature u = cos(x) exp(y/2) / 2, by the source that it takes; prescribed all around.

    Args:
        ratio: conductivity at x = 1 over that at x = 0, at one temperature.
    """

    ratio: float
    insulated: bool = False

    @property
    def growth(self) -> float:
        """Logarithm of the ratio."""
        return float(np.log(self.ratio))

    def temperature(self, x: Array, y: Array) -> Array:
        """Exact u."""
        return np.asarray(np.cos(x) * np.exp(y / 2) / 2)

    def flux(self, y: Array) -> Array:
        """Exact flux k u_x that enters at x = 1."""
        half = np.exp(y / 2) / 2
        return np.asarray(-self.ratio * (1 + np.cos(1) * half) * np.sin(1) * half)

    def source(self, x: Array, y: Array) -> Array:
        """Source Q over the conductivity."""
        half = np.exp(y / 2) / 2
        u, u_x, u_y = half * np.cos(x), -half * np.sin(x), half * np.cos(x) / 2
        return np.asarray(0.75 * u - self.growth * u_x - (u_x**2 + u_y**2) / (1 + u))


class Trefftz:
    """The answer by harmonic and particular polynomials.

    Args:
        problem: whose exact temperatures are used on the boundary alone.
        degree: of the inhomogeneous term's polynomial; the solution's is two higher.

    Attributes:
        steps: iterations it took.
        residual: misfit of the boundary conditions, by least squares, largest.

    Raises:
        ArithmeticError: if the iteration does not settle.
    """

    def __init__(self, problem: Conduction, degree: int) -> None:
        self._problem, self._degree = problem, degree
        self._powers = [(a, n - a) for n in range(degree + 1) for a in range(n + 1)]
        nodes = np.cos(np.pi * (np.arange(degree + 3) + 0.5) / (degree + 3))
        inside = np.array(np.meshgrid(nodes, nodes)).reshape(2, -1)
        ones, along = np.ones_like(nodes), nodes
        ends = np.hstack([[-ones, along], [ones, along]])
        sides = np.hstack([[along, -ones], [along, ones]])
        source = problem.source(*_of_square(inside))
        prescribed = problem.temperature(*_of_square(ends))
        beside = problem.temperature(*_of_square(sides)) * (not problem.insulated)
        aim = np.concatenate([prescribed, beside])
        fit = np.linalg.pinv(self._monomials(inside))
        basis = [self._values(points) for points in (inside, ends)]
        gradient = [self._values(points, axis) for points, axis in ((inside, 0), (inside, 1))]
        count = len(self._powers)
        boundary = np.vstack([basis[1], self._values(sides, 1 if problem.insulated else None)])
        harmonic = np.linalg.pinv(boundary[:, count:])

        coefficients = np.zeros(basis[0].shape[1])
        before: Array = np.full(inside.shape[1], prescribed.mean())
        with np.errstate(over="ignore", invalid="ignore"):  # where it diverges
            for self.steps in range(1, _STEPS + 1):
                u, u_x, u_y = before, *(2 * part @ coefficients for part in gradient)
                term = -problem.growth * u_x - (u_x**2 + u_y**2) / (1 + u) - source
                coefficients[:count] = fit @ term / 4  # the square's side is 2 in these coordinates
                coefficients[count:] = harmonic @ (aim - boundary[:, :count] @ coefficients[:count])
                now = basis[0] @ coefficients
                change = float(np.abs(now - before).max() / np.abs(now).max())
                before = now
                if change < _SETTLED or not np.isfinite(change):
                    break
        if not change < _SETTLED:
            raise ArithmeticError(f"the iteration changes by {change:.0e} after {self.steps} steps")
        self._coefficients = coefficients
        self.residual = float(np.abs(boundary @ coefficients - aim).max())

    def temperature(self, x: Array, y: Array) -> Array:
        """Its u at points (n,)."""
        return np.asarray(self._values(_to_square(x, y)) @ self._coefficients)

    def flux(self, y: Array) -> Array:
        """Its flux k u_x that enters at x = 1."""
        points = _to_square(np.ones_like(y), y)
        u = self._values(points) @ self._coefficients
        slope = 2 * self._values(points, 0) @ self._coefficients
        return np.asarray(np.exp(self._problem.growth) * (1 + u) * slope)

    def _monomials(self, points: Array) -> Array:
        """(points, powers)."""
        return np.column_stack([points[0] ** a * points[1] ** b for a, b in self._powers])

    def _values(self, points: Array, axis: int | None = None) -> Array:
        """Particular solutions of monomials, then harmonic ones, or their derivatives."""
        columns = []
        for a, b in self._powers:
            # x^a y^b is the Laplacian of a finite sum: each term makes up for the last one's u_yy
            terms = [
                (
                    (-1) ** k
                    * factorial(a)
                    * factorial(b)
                    / (factorial(a + 2 * k + 2) * factorial(b - 2 * k)),
                    a + 2 * k + 2,
                    b - 2 * k,
                )
                for k in range(b // 2 + 1)
            ]
            columns.append(sum(c * _monomial(points, p, q, axis) for c, p, q in terms))
        z = points[0] + 1j * points[1]
        columns.append(np.ones_like(points[0]) if axis is None else np.zeros_like(points[0]))
        for n in range(1, self._degree + 3):
            power = z**n if axis is None else n * z ** (n - 1) * (1j if axis else 1)
            columns += [power.real, power.imag]
        return np.column_stack(columns)


def _monomial(points: Array, p: int, q: int, axis: int | None) -> Array:
    x, y = points
    if axis == 0:
        return np.asarray(p * x ** max(p - 1, 0) * y**q)
    if axis == 1:
        return np.asarray(q * x**p * y ** max(q - 1, 0))
    return np.asarray(x**p * y**q)


def _to_square(x: Array, y: Array) -> Array:
    """Points (2, n) of the square from -1 to 1, where powers are tame."""
    return np.array([2 * x - 1, 2 * y - 1])


def _of_square(points: Array) -> Array:
    return (points + 1) / 2
