"""Steady heat conduction in graded materials: problems with closed answers, and Trefftz's way.

Conductivity varies with position and temperature, k = exp(g x) (1 + u), in a unit square. Trefftz's
way shares nothing with finite elements: it writes div(k grad u) = -Q as Poisson's equation,

    laplace(u) = -g u_x - |grad u|^2 / (1 + u) - Q / k,

approximates the right side, of the last iterate, by a polynomial through collocation points, takes
the polynomial's own particular solution, and fits harmonic polynomials to the boundary conditions
by collocation; over again until nothing changes.

What limits it is the polynomial. Behind a hundredfold conductivity the wall's temperature falls as
exp(-4.6 x) does, and under Kirchhoff's root, which has a branch point nearby: no polynomial of
degree 10 in either coordinate comes nearer than 1e-5. Of v = exp(g x / 2) (u + u^2 / 2) the
equation is Poisson's, too, with a right side that is linear,

    laplace(v) = (g / 2)^2 v - exp(-g x / 2) Q,

and v is of gentle exponentials, but known to 1e-9 by degree 10. The iteration then contracts by
(g / 2)^2 over the least eigenvalue of -laplace, pi^2 for the wall: up to ratios of exp(2 pi) = 535.

As far as the stray article at the end of the paper's file can be read, this is what it does
(E. Kita, Y. Ikeda, N. Kamiya published the method). Theirs: Poisson's equation with an
inhomogeneous term, the polynomial, its particular solution, Laplace's solutions, collocation. Ours,
since the text breaks off: polynomials' degrees and bases, the points, least squares, when to stop,
the other unknown, problems.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

Array = npt.NDArray[np.float64]

# When nothing changes any more but round-off, over the temperature; and when it never will
_SETTLED, _STEPS = 1e-12, 500


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
        """Source Q over exp(g x)."""
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
        """Source Q over exp(g x)."""
        half = np.exp(y / 2) / 2
        u, u_x, u_y = half * np.cos(x), -half * np.sin(x), half * np.cos(x) / 2
        return np.asarray((1 + u) * (0.75 * u - self.growth * u_x) - (u_x**2 + u_y**2))


@dataclass(frozen=True)
class Unknown:
    """What is expanded: the temperature, or what its equation is linear in.

    Args:
        growth: g.
        transformed: whether it is v.
    """

    growth: float
    transformed: bool

    def of(self, u: Array, x: Array) -> Array:
        """The unknown at temperatures."""
        return np.exp(self.growth * x / 2) * (u + u**2 / 2) if self.transformed else u

    def temperature(self, f: Array, x: Array) -> Array:
        """Temperatures, of the unknown."""
        if not self.transformed:
            return f
        return np.asarray(np.sqrt(1 + 2 * np.exp(-self.growth * x / 2) * f) - 1)

    def flux(self, f: Array, f_x: Array) -> Array:
        """Flux k u_x at x = 1."""
        g = self.growth
        if not self.transformed:
            return np.asarray(np.exp(g) * (1 + f) * f_x)
        return np.asarray(np.exp(g / 2) * (f_x - g / 2 * f))

    def laplacian(self, f: Array, f_x: Array, f_y: Array, x: Array, source: Array) -> Array:
        """The right side of its Poisson's equation; `source` is Q over exp(g x)."""
        g = self.growth
        if self.transformed:
            return np.asarray((g / 2) ** 2 * f - np.exp(g * x / 2) * source)
        return np.asarray(-g * f_x - (f_x**2 + f_y**2 + source) / (1 + f))


class Trefftz:
    """The answer by harmonic and particular polynomials.

    Args:
        problem: whose exact temperatures are used on the boundary alone.
        degree: of the inhomogeneous term's polynomial, in each coordinate; harmonic polynomials
            have that of the particular solution, 2 degree + 2.
        transformed: whether the unknown is v, or the temperature itself.

    Attributes:
        steps: iterations it took.
        unknowns: number of coefficients.
        residual: misfit of the boundary conditions, by least squares, largest.

    Raises:
        ArithmeticError: if the iteration does not settle.
    """

    def __init__(self, problem: Conduction, degree: int, transformed: bool = True) -> None:
        self._unknown, self._degree = Unknown(problem.growth, transformed), degree
        of = self._unknown.of
        nodes, along = (chebyshev.chebpts1(n) for n in (degree + 3, 2 * degree + 5))
        inside = np.array(np.meshgrid(nodes, nodes)).reshape(2, -1)
        ones = np.ones_like(along)
        ends = np.hstack([[-ones, along], [ones, along]])
        sides = np.hstack([[along, -ones], [along, ones]])
        prescribed, beside = (
            of(problem.temperature(*_of_square(points)), _of_square(points)[0])
            for points in (ends, sides)
        )
        aim = np.concatenate([prescribed, beside * (not problem.insulated)])
        x, y = _of_square(inside)
        source = problem.source(x, y)
        fit = np.linalg.pinv(_products(inside, degree))
        values, along_x, along_y = (self._values(inside, axis) for axis in (None, 0, 1))
        boundary = np.vstack(
            [self._values(ends), self._values(sides, 1 if problem.insulated else None)]
        )
        count = (degree + 1) ** 2
        harmonic = np.linalg.pinv(boundary[:, count:])

        coefficients = np.zeros(values.shape[1])
        now: Array = np.full(len(x), prescribed.mean())
        with np.errstate(over="ignore", invalid="ignore"):  # where it diverges
            for self.steps in range(1, _STEPS + 1):
                # the square's side is 2 in these coordinates
                f_x, f_y = 2 * along_x @ coefficients, 2 * along_y @ coefficients
                term = self._unknown.laplacian(now, f_x, f_y, x, source)
                coefficients[:count] = fit @ term / 4
                coefficients[count:] = harmonic @ (aim - boundary[:, :count] @ coefficients[:count])
                before, now = now, values @ coefficients
                change = float(np.abs(now - before).max() / np.abs(now).max())
                if change < _SETTLED or not np.isfinite(change):
                    break
        if not change < _SETTLED:
            raise ArithmeticError(f"the iteration changes by {change:.0e} after {self.steps} steps")
        self._coefficients, self.unknowns = coefficients, len(coefficients)
        self.residual = float(np.abs(boundary @ coefficients - aim).max())

    def temperature(self, x: Array, y: Array) -> Array:
        """Its u at points (n,)."""
        return self._unknown.temperature(self._values(_to_square(x, y)) @ self._coefficients, x)

    def flux(self, y: Array) -> Array:
        """Its flux k u_x that enters at x = 1."""
        points = _to_square(np.ones_like(y), y)
        f, f_x = (self._values(points, axis) @ self._coefficients for axis in (None, 0))
        return self._unknown.flux(f, 2 * f_x)

    def _values(self, points: Array, axis: int | None = None) -> Array:
        """Particular solutions of products T_a(x) T_b(y), then harmonic ones, or derivatives."""
        n, (x, y) = self._degree + 1, points
        one = np.eye(n)

        # f(x) g(y) is the Laplacian of a finite sum: each term makes up for the last one's u_yy
        def term(k: int) -> Array:
            of_x = chebyshev.chebval(x, chebyshev.chebint(one, 2 * k + 2 - (axis == 0)))
            of_y = chebyshev.chebval(y, chebyshev.chebder(one, 2 * k + (axis == 1)))
            return np.asarray((-1) ** k * np.einsum("ap,bp->pab", of_x, of_y))

        particular = np.sum([term(k) for k in range(n // 2 + 1)], axis=0).reshape(len(x), -1)
        size = np.sqrt(2)  # of the corners, where powers of the rest stay one
        z = (x + 1j * y)[:, None] / size
        m = np.arange(1, 2 * n + 1)
        powers = z**m if axis is None else m * z ** (m - 1) * (1j if axis else 1) / size
        constant = np.full((len(x), 1), axis is None)
        return np.hstack([particular, constant, powers.real, powers.imag])


def polynomial_error(problem: Conduction, degree: int, transformed: bool = True) -> float:
    """Error of the unknown's interpolation in Chebyshev's points, over its largest value."""
    unknown = Unknown(problem.growth, transformed)

    def exact(x: Array, y: Array) -> Array:
        place = _of_square(np.array([x, y]))
        return unknown.of(problem.temperature(*place), place[0])

    nodes, line = chebyshev.chebpts1(degree + 1), np.linspace(-1, 1, 6 * degree + 1)
    points, checked = (np.array(np.meshgrid(on, on)).reshape(2, -1) for on in (nodes, line))
    basis = [_products(at, degree) for at in (points, checked)]
    known = exact(*checked)
    found = basis[1] @ np.linalg.solve(basis[0], exact(*points))
    return float(np.abs(found - known).max() / np.abs(known).max())


def _products(points: Array, degree: int) -> Array:
    """T_a(x) T_b(y), of at most the degree each, at points (2, n)."""
    of_x, of_y = (chebyshev.chebvander(axis, degree) for axis in points)
    return np.asarray(np.einsum("pa,pb->pab", of_x, of_y).reshape(len(of_x), -1))


def _to_square(x: Array, y: Array) -> Array:
    """Points (2, n) of the square from -1 to 1, where polynomials are tame."""
    return np.array([2 * x - 1, 2 * y - 1])


def _of_square(points: Array) -> Array:
    return (points + 1) / 2
