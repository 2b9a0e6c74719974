"""Test exact temperatures, Trefftz's method and moments of nodal forces in sections V13, V14."""

import numpy as np
import pytest

from study.benchmarks.v13_fluxes.graded_conduction import (
    GradedSquareWithHeatSource,
    GradedWallWithInsulatedSides,
)
from study.benchmarks.v13_fluxes.trefftz import (
    TrefftzSolution,
    chebyshev_interpolation_error_of_unknown,
)
from study.benchmarks.v14_rubber.moments import (
    moment_contributions_of_triangles,
    moments_about_origin,
)
from study.benchmarks.v14_rubber.page import DEGREE, RubberBlock

CONDUCTIVITY_RATIO = 20.0


def fourth_order_central_difference(f, x, axis, h=1e-4):
    step = np.zeros_like(x)
    step[axis] = h
    return (8 * (f(x + step) - f(x - step)) - f(x + 2 * step) + f(x - 2 * step)) / (12 * h)


@pytest.mark.parametrize(
    "problem",
    [
        GradedWallWithInsulatedSides(CONDUCTIVITY_RATIO),
        GradedSquareWithHeatSource(CONDUCTIVITY_RATIO),
    ],
)
def test_exact_temperatures_satisfy_the_equation_and_have_the_exact_flux(problem):
    x = np.random.default_rng(0).uniform(0.05, 0.95, (2, 20))

    def conductivity(p):
        return CONDUCTIVITY_RATIO ** p[0] * (1 + problem.temperature(*p))

    def flux(axis):
        return lambda p: (
            conductivity(p)
            * fourth_order_central_difference(lambda q: problem.temperature(*q), p, axis)
        )

    balance = sum(fourth_order_central_difference(flux(axis), x, axis, 1e-3) for axis in (0, 1))
    assert np.abs(balance / CONDUCTIVITY_RATIO ** x[0] + problem.source(*x)).max() < 1e-6
    points_on_right_side = np.array([np.ones(20), x[1]])
    assert flux(0)(points_on_right_side) == pytest.approx(problem.flux(x[1]), rel=1e-6)
    if problem.is_insulated:
        for end in (0.0, 1.0):
            assert np.abs(flux(1)(np.array([x[0], np.full(20, end)]))).max() < 1e-7


@pytest.mark.parametrize(
    ("problem", "degree", "transformed", "max_temperature_error"),
    [
        (GradedWallWithInsulatedSides, 10, True, 1e-10),
        (GradedSquareWithHeatSource, 10, True, 1e-10),
        (GradedWallWithInsulatedSides, 14, False, 1e-7),
        (GradedSquareWithHeatSource, 8, False, 1e-11),
    ],
)
def test_trefftz_is_accurate_with_exact_temperatures_on_the_boundary_only(
    problem, degree, transformed, max_temperature_error
):
    class BoundaryOnly(problem):
        """Problem whose exact temperature is NaN in the interior, to show that it is not used."""

        def temperature(self, x, y):
            is_inside = np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) < 0.5 - 1e-12
            return np.where(is_inside, np.nan, super().temperature(x, y))

    exact_problem = problem(CONDUCTIVITY_RATIO)
    solution = TrefftzSolution(BoundaryOnly(CONDUCTIVITY_RATIO), degree, transformed)
    x = np.random.default_rng(1).uniform(0, 1, (2, 50))
    assert (
        np.abs(solution.temperature(*x) - exact_problem.temperature(*x)).max()
        < max_temperature_error
    )
    assert solution.flux(x[1]) == pytest.approx(
        exact_problem.flux(x[1]), abs=300 * max_temperature_error
    )


@pytest.mark.parametrize("transformed", [True, False])
def test_trefftz_raises_if_its_iteration_does_not_converge(transformed):
    with pytest.raises(ArithmeticError, match="iteration has not converged"):
        TrefftzSolution(GradedWallWithInsulatedSides(1e4), 10, transformed)


def test_trefftz_iteration_count_follows_from_the_smallest_laplacian_eigenvalue():
    """Each iteration reduces the error by the factor (ln(ratio) / 2)^2 / pi^2.

    The denominator is the smallest eigenvalue of the negative Laplacian for functions that vanish
    at the ends and have no flux through the sides.
    """
    ratio = 100.0
    rate = (np.log(ratio) / 2) ** 2 / np.pi**2
    assert TrefftzSolution(GradedWallWithInsulatedSides(ratio), 10).n_iterations == pytest.approx(
        np.log(1e-12) / np.log(rate), abs=3
    )


def test_interpolation_error_vanishes_for_polynomials_of_sufficient_degree_only():
    class Cubic(GradedSquareWithHeatSource):
        def temperature(self, x, y):
            return x**3 * y

    assert chebyshev_interpolation_error_of_unknown(Cubic(1.0), 3, transformed=False) < 1e-14
    assert chebyshev_interpolation_error_of_unknown(Cubic(1.0), 2, transformed=False) > 1e-3


def test_moment_of_nodal_forces_is_the_sum_of_triangle_contributions():
    block = RubberBlock("pw-T6", 6)
    forces = block.move_punch_and_solve().reactions().array_r.reshape(-1, 2)
    contributions = moment_contributions_of_triangles(block.u, DEGREE[2]).sum()
    total = moments_about_origin(block.x + block.displacement, forces)[:, 2].sum()
    assert total == pytest.approx(contributions, abs=1e-14)
    assert abs(contributions) > 1e-5
