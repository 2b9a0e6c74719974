"""Measures for numerical uncertainty: observed orders, and the GCI compared with known errors."""

import math
from collections.abc import Sequence

from study.judge.grid_convergence import GridConvergence, grid_convergence
from study.run.store import Results

Keys = Sequence[str]
BEAM_DIVISIONS = ((4, 1), (8, 2), (16, 4), (32, 8), (64, 16))
"""Mesh divisions of the beam under uniform load, whose critical stresses are known."""
BEAM_ELEMENTS = ("galerkin-T6", "galerkin-Q8", "pwsym-T6")
"""Elements with different critical stresses; those of pw-T6 equal those of galerkin-T6."""


def observed_order(results: Results, keys: Keys, name: str, refinements: Sequence[float]) -> float:
    """Return the observed order of a scalar on three meshes; NaN if it does not converge.

    Args:
        results: stored results.
        keys: keys (3,) of the cases.
        name: name of the scalar.
        refinements: divisions of a side, divided by those of the coarse mesh, (3,).
    """
    order = _grid_convergence_of_scalar(results, keys, name, refinements).order
    return math.nan if order is None else order


def error_over_index(
    results: Results, keys: Keys, reference: Keys, name: str, refinements: Sequence[float]
) -> float:
    """Return the error on the finest mesh, divided by the GCI; NaN if a series is not asymptotic.

    Args:
        results: stored results.
        keys: keys (3,) of the cases.
        reference: keys (3,) of cases on other meshes, whose extrapolated value is taken as exact.
        name: name of the scalar.
        refinements: divisions of a side, divided by those of the coarse mesh, (3,).
    """
    convergence, reference_convergence = (
        _grid_convergence_of_scalar(results, series, name, refinements)
        for series in (keys, reference)
    )
    if convergence.index is None or reference_convergence.extrapolated is None:
        return math.nan
    error = reference_convergence.extrapolated / convergence.values[-1] - 1
    return abs(error) / convergence.index


def _grid_convergence_of_scalar(
    results: Results, keys: Keys, name: str, refinements: Sequence[float]
) -> GridConvergence:
    values = [results.scalar(key, name) for key in keys]
    return grid_convergence(values, [1 / refinement for refinement in refinements])


def beam_convergence_and_exact_stresses(results: Results) -> list[tuple[GridConvergence, float]]:
    """Return the convergence of critical stresses under uniform load, and their exact values.

    There is a series for each mode, geometric stiffness, element of `BEAM_ELEMENTS` and three
    successive meshes.
    """
    series = []
    for element in BEAM_ELEMENTS:
        for form, suffix in (("G", ""), ("J", "-J")):
            for mode in (1, 2):
                exact = results.scalar("7.6/exact", f"{form}_{mode}")
                stresses = [
                    results.scalar(f"7.6/{element}{suffix}-uniform-{nx}x{ny}", f"sigma_cr_{mode}")
                    for nx, ny in BEAM_DIVISIONS
                ]
                for first in range(len(stresses) - 2):
                    sizes = [1 / nx for nx, _ in BEAM_DIVISIONS[first : first + 3]]
                    convergence = grid_convergence(stresses[first : first + 3], sizes)
                    series.append((convergence, exact))
    return series


def asymptotic_beam_series(results: Results) -> float:
    """Return the number of `beam_convergence_and_exact_stresses` in the asymptotic range."""
    return float(
        sum(
            convergence.index is not None
            for convergence, _ in beam_convergence_and_exact_stresses(results)
        )
    )


def share_within_index(results: Results) -> float:
    """Return the fraction of the asymptotic series in which the GCI bounds the true error.

    The series are those of `beam_convergence_and_exact_stresses`.
    """
    is_error_within_gci = [
        abs(exact / convergence.values[-1] - 1) <= convergence.index
        for convergence, exact in beam_convergence_and_exact_stresses(results)
        if convergence.index is not None
    ]
    return sum(is_error_within_gci) / len(is_error_within_gci)
