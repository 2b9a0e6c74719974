"""Steady conduction in a graded material by Trefftz's method, which uses no finite elements.

The method writes div(k grad u) = -Q with k = exp(g x) (1 + u) as Poisson's equation,

    laplace(u) = -g u_x - |grad u|^2 / (1 + u) - Q / k,

interpolates the right side of the last iterate by a polynomial at collocation points, evaluates the
particular solution for this polynomial, and fits harmonic polynomials to the boundary conditions by
collocation. These steps are repeated until the solution does not change.

The polynomial limits the accuracy. With a conductivity ratio of one hundred the temperature of the
wall decreases like exp(-4.6 x), and the square root in Kirchhoff's transformation has a branch
point nearby: the error of a polynomial of degree 10 in each coordinate is at least 1e-5. For v =
exp(g x / 2) (u + u^2 / 2) the equation is also Poisson's, with a linear right side,

    laplace(v) = (g / 2)^2 v - exp(-g x / 2) Q,

and v consists of slowly varying exponentials, which degree 10 approximates to 1e-9. The iteration
then contracts by (g / 2)^2 over the smallest eigenvalue of -laplace, which is pi^2 for the wall. It
therefore converges for conductivity ratios up to exp(2 pi) = 535.

The fragment of another article at the end of the paper's file seems to describe this method, which
E. Kita, Y. Ikeda and N. Kamiya published. As far as it is legible, it contains Poisson's equation
with an inhomogeneous term, the polynomial, its particular solution, harmonic functions and
collocation. The degrees and bases of polynomials, the points, the least-squares fit, the stopping
criterion, the unknown v and the problems were chosen for this study.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from study.benchmarks.v13_fluxes.graded_conduction import ConductionProblem

Array = npt.NDArray[np.float64]

CONVERGENCE_TOLERANCE = 1e-12
"""Largest change in an iteration, over the largest value, at which the iteration has converged."""
MAX_ITERATIONS = 500


@dataclass(frozen=True)
class TrefftzUnknown:
    """Unknown field of Trefftz's method: the temperature u, or v = exp(g x / 2) (u + u^2 / 2).

    Args:
        growth: Natural logarithm g of the conductivity ratio.
        transformed: Whether the unknown is v; otherwise it is u.
    """

    growth: float
    transformed: bool

    def evaluate_from_temperature(self, u: Array, x: Array) -> Array:
        """Return values (n,) of the unknown for temperatures u (n,) at coordinates x (n,)."""
        return np.exp(self.growth * x / 2) * (u + u**2 / 2) if self.transformed else u

    def temperature(self, f: Array, x: Array) -> Array:
        """Return temperatures (n,) for values f (n,) of the unknown at coordinates x (n,)."""
        if not self.transformed:
            return f
        return np.asarray(np.sqrt(1 + 2 * np.exp(-self.growth * x / 2) * f) - 1)

    def flux(self, f: Array, f_x: Array) -> Array:
        """Return the inward fluxes k u_x (n,) at x = 1.

        Args:
            f: Values (n,) of the unknown at x = 1.
            f_x: Derivatives (n,) of the unknown by x at x = 1.
        """
        g = self.growth
        if not self.transformed:
            return np.asarray(np.exp(g) * (1 + f) * f_x)
        return np.asarray(np.exp(g / 2) * (f_x - g / 2 * f))

    def evaluate_poisson_right_side(
        self, f: Array, f_x: Array, f_y: Array, x: Array, source_over_reference_conductivity: Array
    ) -> Array:
        """Return the Laplacian (n,) of the unknown, the right side of its Poisson equation.

        Args:
            f: Values (n,) of the unknown.
            f_x: Derivatives (n,) of the unknown by x.
            f_y: Derivatives (n,) of the unknown by y.
            x: Coordinates (n,).
            source_over_reference_conductivity: Heat sources Q (n,) divided by exp(g x).
        """
        g = self.growth
        if self.transformed:
            return np.asarray(
                (g / 2) ** 2 * f - np.exp(g * x / 2) * source_over_reference_conductivity
            )
        return np.asarray(
            -g * f_x - (f_x**2 + f_y**2 + source_over_reference_conductivity) / (1 + f)
        )


class TrefftzSolution:
    """Solution of a conduction problem as a sum of harmonic and particular polynomials.

    Args:
        problem: Conduction problem; its exact temperatures are used on the boundary only.
        degree: Degree in each coordinate of the polynomial that interpolates the Poisson equation's
            right side. Particular solutions and harmonic polynomials have the degree 2 degree + 2.
        transformed: Whether the unknown is v; otherwise it is the temperature.

    Attributes:
        n_iterations: Number of iterations.
        n_unknowns: Number of polynomial coefficients.
        boundary_misfit: Largest residual of the boundary conditions after the least-squares fit.

    Raises:
        ArithmeticError: If the iteration does not converge.
    """

    def __init__(self, problem: ConductionProblem, degree: int, transformed: bool = True) -> None:
        self._unknown, self._degree = TrefftzUnknown(problem.growth, transformed), degree
        nodes, side_nodes = (chebyshev.chebpts1(n) for n in (degree + 3, 2 * degree + 5))
        inside = np.array(np.meshgrid(nodes, nodes)).reshape(2, -1)
        ones = np.ones_like(side_nodes)
        ends = np.hstack([[-ones, side_nodes], [ones, side_nodes]])
        sides = np.hstack([[side_nodes, -ones], [side_nodes, ones]])
        end_values, side_values = (
            self._evaluate_exact_unknown(problem, points) for points in (ends, sides)
        )
        boundary_values = np.concatenate([end_values, side_values * (not problem.is_insulated)])
        x, y = _map_chebyshev_square_to_unit_square(inside)
        source = problem.source(x, y)
        interpolation = np.linalg.pinv(_evaluate_chebyshev_products(inside, degree))
        values, x_slopes, y_slopes = (
            self._evaluate_particular_and_harmonic_functions(inside, axis) for axis in (None, 0, 1)
        )
        boundary = np.vstack(
            [
                self._evaluate_particular_and_harmonic_functions(ends),
                self._evaluate_particular_and_harmonic_functions(
                    sides, 1 if problem.is_insulated else None
                ),
            ]
        )
        n_particular = (degree + 1) ** 2
        harmonic_fit = np.linalg.pinv(boundary[:, n_particular:])

        coefficients = np.zeros(values.shape[1])
        unknown: Array = np.full(len(x), end_values.mean())
        with np.errstate(over="ignore", invalid="ignore"):  # these occur on divergence
            for self.n_iterations in range(1, MAX_ITERATIONS + 1):
                # derivatives by coordinates of the unit square, as points are in [-1, 1]
                f_x, f_y = 2 * x_slopes @ coefficients, 2 * y_slopes @ coefficients
                right_side = self._unknown.evaluate_poisson_right_side(unknown, f_x, f_y, x, source)
                coefficients[:n_particular] = interpolation @ right_side / 4
                particular = boundary[:, :n_particular] @ coefficients[:n_particular]
                coefficients[n_particular:] = harmonic_fit @ (boundary_values - particular)
                previous, unknown = unknown, values @ coefficients
                change = float(np.abs(unknown - previous).max() / np.abs(unknown).max())
                if change < CONVERGENCE_TOLERANCE or not np.isfinite(change):
                    break
        if not change < CONVERGENCE_TOLERANCE:
            raise ArithmeticError(
                f"Trefftz's iteration has not converged: relative change {change:.0e} after "
                f"{self.n_iterations} iterations; choose a smaller ratio of conductivities"
            )
        self._coefficients, self.n_unknowns = coefficients, len(coefficients)
        self.boundary_misfit = float(np.abs(boundary @ coefficients - boundary_values).max())

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the temperatures (n,) at points with coordinates x (n,) and y (n,)."""
        f = (
            self._evaluate_particular_and_harmonic_functions(
                _map_unit_square_to_chebyshev_square(x, y)
            )
            @ self._coefficients
        )
        return self._unknown.temperature(f, x)

    def flux(self, y: Array) -> Array:
        """Return the inward fluxes k u_x (n,) at the points (1, y) with y (n,)."""
        points = _map_unit_square_to_chebyshev_square(np.ones_like(y), y)
        f, f_x = (
            self._evaluate_particular_and_harmonic_functions(points, axis) @ self._coefficients
            for axis in (None, 0)
        )
        return self._unknown.flux(f, 2 * f_x)

    def _evaluate_exact_unknown(self, problem: ConductionProblem, points: Array) -> Array:
        x, y = _map_chebyshev_square_to_unit_square(points)
        return self._unknown.evaluate_from_temperature(problem.temperature(x, y), x)

    def _evaluate_particular_and_harmonic_functions(
        self, points: Array, derivative_axis: int | None = None
    ) -> Array:
        """Evaluate the basis functions or their derivatives at points.

        The basis consists of the particular solutions for the products T_a(x) T_b(y) of Chebyshev
        polynomials, followed by harmonic polynomials.

        Args:
            points: Points (2, n) in the square from -1 to 1.
            derivative_axis: Coordinate by which the functions are differentiated; None for the
                functions themselves.

        Returns:
            Values (n, n_unknowns).
        """
        n, (x, y) = self._degree + 1, points
        identity = np.eye(n)

        # f(x) g(y) is the Laplacian of a finite sum: each term cancels u_yy of the preceding term
        def evaluate_term_of_particular_solutions(k: int) -> Array:
            x_factor = chebyshev.chebval(
                x, chebyshev.chebint(identity, 2 * k + 2 - (derivative_axis == 0))
            )
            y_factor = chebyshev.chebval(
                y, chebyshev.chebder(identity, 2 * k + (derivative_axis == 1))
            )
            return np.asarray((-1) ** k * np.einsum("ap,bp->pab", x_factor, y_factor))

        particular = np.sum(
            [evaluate_term_of_particular_solutions(k) for k in range(n // 2 + 1)], axis=0
        )
        particular = particular.reshape(len(x), -1)
        corner_radius = np.sqrt(2)  # scaling by it bounds powers by one
        z = (x + 1j * y)[:, None] / corner_radius
        m = np.arange(1, 2 * n + 1)
        powers = (
            z**m
            if derivative_axis is None
            else m * z ** (m - 1) * (1j if derivative_axis else 1) / corner_radius
        )
        constant = np.full((len(x), 1), derivative_axis is None)
        return np.hstack([particular, constant, powers.real, powers.imag])


def chebyshev_interpolation_error_of_unknown(
    problem: ConductionProblem, degree: int, transformed: bool = True
) -> float:
    """Return the largest error of Chebyshev interpolation of the exact unknown, over its maximum.

    Args:
        problem: Conduction problem whose exact solution is interpolated.
        degree: Degree of the polynomial in each coordinate.
        transformed: Whether the unknown is v; otherwise it is the temperature.
    """
    unknown = TrefftzUnknown(problem.growth, transformed)

    def evaluate_exact_unknown(points: Array) -> Array:
        x, y = _map_chebyshev_square_to_unit_square(points)
        return unknown.evaluate_from_temperature(problem.temperature(x, y), x)

    nodes, line = chebyshev.chebpts1(degree + 1), np.linspace(-1, 1, 6 * degree + 1)
    points, fine_points = (
        np.array(np.meshgrid(grid, grid)).reshape(2, -1) for grid in (nodes, line)
    )
    basis, fine_basis = (
        _evaluate_chebyshev_products(grid, degree) for grid in (points, fine_points)
    )
    exact = evaluate_exact_unknown(fine_points)
    interpolated = fine_basis @ np.linalg.solve(basis, evaluate_exact_unknown(points))
    return float(np.abs(interpolated - exact).max() / np.abs(exact).max())


def _evaluate_chebyshev_products(points: Array, degree: int) -> Array:
    """Return the products T_a(x) T_b(y), with a, b <= degree, as an array (n, (degree + 1)^2).

    Args:
        points: Points (2, n) in the square from -1 to 1.
        degree: Largest degree of each factor.
    """
    x_factor, y_factor = (chebyshev.chebvander(axis, degree) for axis in points)
    products = np.einsum("pa,pb->pab", x_factor, y_factor)
    return np.asarray(products.reshape(len(x_factor), -1))


def _map_unit_square_to_chebyshev_square(x: Array, y: Array) -> Array:
    """Map points x (n,), y (n,) of the unit square to points (2, n) of the square [-1, 1]^2."""
    return np.array([2 * x - 1, 2 * y - 1])


def _map_chebyshev_square_to_unit_square(points: Array) -> Array:
    return (points + 1) / 2
