"""Steady conduction in a graded material by Trefftz's method, which shares nothing with elements.

It writes div(k grad u) = -Q with k = exp(g x) (1 + u) as Poisson's equation,

    laplace(u) = -g u_x - |grad u|^2 / (1 + u) - Q / k,

approximates the right side, at the last iterate, by a polynomial through collocation points, takes
the polynomial's own particular solution, and fits harmonic polynomials to the boundary conditions
by collocation; this is repeated until nothing changes.

Its accuracy is limited by the polynomial. Behind a hundredfold conductivity the temperature of the
wall falls like exp(-4.6 x), and Kirchhoff's square root has a branch point nearby: no polynomial of
degree 10 in either coordinate comes closer than 1e-5. For v = exp(g x / 2) (u + u^2 / 2) the
equation is Poisson's, too, with a right side that is linear,

    laplace(v) = (g / 2)^2 v - exp(-g x / 2) Q,

and v consists of gentle exponentials, which degree 10 approximates to 1e-9. The iteration then
contracts by (g / 2)^2 over the least eigenvalue of -laplace, pi^2 for the wall: up to ratios of
exp(2 pi) = 535.

The stray article at the end of the paper's file seems to do this (E. Kita, Y. Ikeda, N. Kamiya
published the method). Theirs, as far as it can be read: Poisson's equation with an inhomogeneous
term, the polynomial, its particular solution, Laplace's solutions, collocation. Ours, since the text
breaks off: degrees and bases of polynomials, the points, least squares, the stopping criterion, the
other unknown, the problems.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from study.benchmarks.v13_fluxes.graded_conduction import Conduction

Array = npt.NDArray[np.float64]

MAX_SETTLED_CHANGE = 1e-12
"""Change in an iteration, over the largest value, below which only round-off changes."""
MAX_ITERATIONS = 500


@dataclass(frozen=True)
class Unknown:
    """The field that is expanded: the temperature u or v = exp(g x / 2) (u + u^2 / 2).

    Args:
        growth: g.
        transformed: whether it is v.
    """

    growth: float
    transformed: bool

    def from_temperature(self, u: Array, x: Array) -> Array:
        """Return the unknown at temperatures."""
        return np.exp(self.growth * x / 2) * (u + u**2 / 2) if self.transformed else u

    def temperature(self, f: Array, x: Array) -> Array:
        """Return the temperatures of values of the unknown."""
        if not self.transformed:
            return f
        return np.asarray(np.sqrt(1 + 2 * np.exp(-self.growth * x / 2) * f) - 1)

    def flux(self, f: Array, f_x: Array) -> Array:
        """Return the flux k u_x at x = 1."""
        g = self.growth
        if not self.transformed:
            return np.asarray(np.exp(g) * (1 + f) * f_x)
        return np.asarray(np.exp(g / 2) * (f_x - g / 2 * f))

    def laplacian(self, f: Array, f_x: Array, f_y: Array, x: Array, source: Array) -> Array:
        """Return the right side of its Poisson's equation; `source` is Q over exp(g x)."""
        g = self.growth
        if self.transformed:
            return np.asarray((g / 2) ** 2 * f - np.exp(g * x / 2) * source)
        return np.asarray(-g * f_x - (f_x**2 + f_y**2 + source) / (1 + f))


class Trefftz:
    """The solution by harmonic and particular polynomials.

    Args:
        problem: whose exact temperatures are used on the boundary alone.
        degree: of the inhomogeneous term's polynomial, in each coordinate; harmonic polynomials
            have that of the particular solution, 2 degree + 2.
        transformed: whether the unknown is v, or the temperature itself.

    Attributes:
        n_iterations: number of iterations.
        n_unknowns: number of coefficients.
        boundary_misfit: largest error of the boundary conditions, which least squares leave.

    Raises:
        ArithmeticError: if the iteration does not settle.
    """

    def __init__(self, problem: Conduction, degree: int, transformed: bool = True) -> None:
        self._unknown, self._degree = Unknown(problem.growth, transformed), degree
        nodes, side_nodes = (chebyshev.chebpts1(n) for n in (degree + 3, 2 * degree + 5))
        inside = np.array(np.meshgrid(nodes, nodes)).reshape(2, -1)
        ones = np.ones_like(side_nodes)
        ends = np.hstack([[-ones, side_nodes], [ones, side_nodes]])
        sides = np.hstack([[side_nodes, -ones], [side_nodes, ones]])
        end_values, side_values = (self._exact_unknown(problem, points) for points in (ends, sides))
        boundary_values = np.concatenate([end_values, side_values * (not problem.insulated)])
        x, y = _to_unit_square(inside)
        source = problem.source(x, y)
        interpolation = np.linalg.pinv(_evaluate_products(inside, degree))
        values, x_slopes, y_slopes = (self._evaluate_basis(inside, axis) for axis in (None, 0, 1))
        boundary = np.vstack(
            [
                self._evaluate_basis(ends),
                self._evaluate_basis(sides, 1 if problem.insulated else None),
            ]
        )
        n_particular = (degree + 1) ** 2
        harmonic_fit = np.linalg.pinv(boundary[:, n_particular:])

        coefficients = np.zeros(values.shape[1])
        unknown: Array = np.full(len(x), end_values.mean())
        with np.errstate(over="ignore", invalid="ignore"):  # where it diverges
            for self.n_iterations in range(1, MAX_ITERATIONS + 1):
                # the square's side is 2 in these coordinates
                f_x, f_y = 2 * x_slopes @ coefficients, 2 * y_slopes @ coefficients
                right_side = self._unknown.laplacian(unknown, f_x, f_y, x, source)
                coefficients[:n_particular] = interpolation @ right_side / 4
                particular = boundary[:, :n_particular] @ coefficients[:n_particular]
                coefficients[n_particular:] = harmonic_fit @ (boundary_values - particular)
                previous, unknown = unknown, values @ coefficients
                change = float(np.abs(unknown - previous).max() / np.abs(unknown).max())
                if change < MAX_SETTLED_CHANGE or not np.isfinite(change):
                    break
        if not change < MAX_SETTLED_CHANGE:
            raise ArithmeticError(
                f"the iteration changes by {change:.0e} after {self.n_iterations} steps"
            )
        self._coefficients, self.n_unknowns = coefficients, len(coefficients)
        self.boundary_misfit = float(np.abs(boundary @ coefficients - boundary_values).max())

    def temperature(self, x: Array, y: Array) -> Array:
        """Return u at points (n,)."""
        f = self._evaluate_basis(_from_unit_square(x, y)) @ self._coefficients
        return self._unknown.temperature(f, x)

    def flux(self, y: Array) -> Array:
        """Return the flux k u_x that enters at x = 1."""
        points = _from_unit_square(np.ones_like(y), y)
        f, f_x = (self._evaluate_basis(points, axis) @ self._coefficients for axis in (None, 0))
        return self._unknown.flux(f, 2 * f_x)

    def _exact_unknown(self, problem: Conduction, points: Array) -> Array:
        x, y = _to_unit_square(points)
        return self._unknown.from_temperature(problem.temperature(x, y), x)

    def _evaluate_basis(self, points: Array, axis: int | None = None) -> Array:
        """Evaluate particular solutions of products T_a(x) T_b(y), then harmonic polynomials.

        Args:
            points: (2, n), in the square from -1 to 1.
            axis: coordinate by which they are differentiated; None for the functions themselves.
        """
        n, (x, y) = self._degree + 1, points
        identity = np.eye(n)

        # f(x) g(y) is the Laplacian of a finite sum: each term makes up for the last one's u_yy
        def particular_term(k: int) -> Array:
            x_factor = chebyshev.chebval(x, chebyshev.chebint(identity, 2 * k + 2 - (axis == 0)))
            y_factor = chebyshev.chebval(y, chebyshev.chebder(identity, 2 * k + (axis == 1)))
            return np.asarray((-1) ** k * np.einsum("ap,bp->pab", x_factor, y_factor))

        particular = np.sum([particular_term(k) for k in range(n // 2 + 1)], axis=0)
        particular = particular.reshape(len(x), -1)
        corner_radius = np.sqrt(2)  # scaled by it, powers are at most one
        z = (x + 1j * y)[:, None] / corner_radius
        m = np.arange(1, 2 * n + 1)
        powers = z**m if axis is None else m * z ** (m - 1) * (1j if axis else 1) / corner_radius
        constant = np.full((len(x), 1), axis is None)
        return np.hstack([particular, constant, powers.real, powers.imag])


def polynomial_error(problem: Conduction, degree: int, transformed: bool = True) -> float:
    """Return the error of the unknown's interpolation in Chebyshev points, over its maximum."""
    unknown = Unknown(problem.growth, transformed)

    def exact_unknown(points: Array) -> Array:
        x, y = _to_unit_square(points)
        return unknown.from_temperature(problem.temperature(x, y), x)

    nodes, line = chebyshev.chebpts1(degree + 1), np.linspace(-1, 1, 6 * degree + 1)
    points, fine_points = (
        np.array(np.meshgrid(grid, grid)).reshape(2, -1) for grid in (nodes, line)
    )
    basis, fine_basis = (_evaluate_products(grid, degree) for grid in (points, fine_points))
    exact = exact_unknown(fine_points)
    interpolated = fine_basis @ np.linalg.solve(basis, exact_unknown(points))
    return float(np.abs(interpolated - exact).max() / np.abs(exact).max())


def _evaluate_products(points: Array, degree: int) -> Array:
    """Return T_a(x) T_b(y), of at most the degree each, at points (2, n)."""
    x_factor, y_factor = (chebyshev.chebvander(axis, degree) for axis in points)
    products = np.einsum("pa,pb->pab", x_factor, y_factor)
    return np.asarray(products.reshape(len(x_factor), -1))


def _from_unit_square(x: Array, y: Array) -> Array:
    """Return points (2, n) of the square from -1 to 1, where Chebyshev polynomials are bounded."""
    return np.array([2 * x - 1, 2 * y - 1])


def _to_unit_square(points: Array) -> Array:
    return (points + 1) / 2
