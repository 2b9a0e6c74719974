"""Measures for any section: stored numbers, their extremes and ratios, and curves."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from study.judge.measures.stored_cases import Selection, select_results
from study.run.store import Results, StoredResult

# Keys of two cases
CasePair: TypeAlias = tuple[str, str]


def scalar(results: Results, key: str, name: str) -> float:
    """Return a stored scalar unchanged."""
    return results.scalar(key, name)


def largest(results: Results, section: str, cases: Selection, name: str) -> float:
    """Return the largest absolute value of a scalar over matching cases; see `Selection`."""
    return max(_absolute_values_of_scalar(results, section, cases, name))


def smallest(results: Results, section: str, cases: Selection, name: str) -> float:
    """Return the smallest absolute value of a scalar over matching cases."""
    return min(_absolute_values_of_scalar(results, section, cases, name))


def minimum(results: Results, section: str, cases: Selection, name: str) -> float:
    """Return the smallest value of a scalar over matching cases, considering its sign."""
    return min(stored.scalars[name] for stored in select_results(results, section, cases))


def ratio(results: Results, key: str, other: str, name: str) -> float:
    """Return the ratio of a scalar of one case to that of another case."""
    return results.scalar(key, name) / results.scalar(other, name)


def growth_exponent(results: Results, key: str, other: str, name: str, over: str) -> float:
    """Return the exponent p of a power law `name` ~ `over`^p through two cases.

    Args:
        results: Stored results.
        key: Key of the first case.
        other: Key of the second case.
        name: Name of the scalar that grows.
        over: Name of the scalar on which it depends.
    """
    ratios = ratio(results, other, key, name), ratio(results, other, key, over)
    return float(np.log(ratios[0]) / np.log(ratios[1]))


def excess_ratio(results: Results, fine: CasePair, coarse: CasePair, name: str) -> float:
    """Return how the relative difference of a scalar between two cases changes by refinement.

    The difference between the two cases of `fine` is divided by that between the cases of `coarse`.
    """
    fine_difference, coarse_difference = (
        ratio(results, *cases, name) - 1 for cases in (fine, coarse)
    )
    return fine_difference / coarse_difference


def change_ratio(results: Results, cases: Sequence[str], name: str) -> float:
    """Return the ratio of successive changes of a scalar, from the first to the third case.

    It is |third - second| / |second - first|.
    """
    first, second, third = (results.scalar(case, name) for case in cases)
    return abs((third - second) / (second - first))


def scalar_ratio(results: Results, key: str, name: str, other: str) -> float:
    """Return the ratio of two scalars of the same case."""
    return results.scalar(key, name) / results.scalar(key, other)


def scalar_difference(results: Results, key: str, name: str, other: str) -> float:
    """Return the difference of two scalars of the same case."""
    return results.scalar(key, name) - results.scalar(key, other)


def relative_difference(
    results: Results, section: str, cases: Selection, name: str, other: str
) -> float:
    """Return the largest relative difference between two scalars of a case over matching cases."""
    return max(
        abs(stored.scalars[name] / stored.scalars[other] - 1)
        for stored in select_results(results, section, cases)
    )


def lowest_order(results: Results, section: str, cases: Selection, name: str) -> float:
    """Return the lowest observed order of an error in series of cases that differ only in the mesh.

    The order of a series is computed from its coarsest and finest mesh.
    """
    meshes_by_case: dict[str, list[StoredResult]] = {}
    for stored in select_results(results, section, cases):
        meshes_by_case.setdefault(stored.case.rsplit("-", 1)[0], []).append(stored)
    orders = []
    for meshes in meshes_by_case.values():
        sizes = [stored.scalars["h"] for stored in meshes]
        end_meshes = meshes[int(np.argmax(sizes))], meshes[int(np.argmin(sizes))]
        coarse, fine = (stored.scalars for stored in end_meshes)
        orders.append(np.log(coarse[name] / fine[name]) / np.log(coarse["h"] / fine["h"]))
    return float(min(orders))


def largest_deviation_from(
    results: Results, section: str, cases: Selection, name: str, value: float
) -> float:
    """Return the largest distance of a scalar from a value over matching cases."""
    return max(
        abs(stored.scalars[name] - value) for stored in select_results(results, section, cases)
    )


def _absolute_values_of_scalar(
    results: Results, section: str, cases: Selection, name: str
) -> list[float]:
    return [abs(stored.scalars[name]) for stored in select_results(results, section, cases)]


def curve_at(results: Results, key: str, name: str, x: float) -> float:
    """Return the value of a curve at x, interpolated linearly between nodes."""
    curves = results.curves(key)
    return float(np.interp(x, curves["x"], curves[name]))


def curve_ratio_at(results: Results, key: str, other: str, name: str, x: float) -> float:
    """Return the value of one case's curve at x over that of another case's curve; see `curve_at`.

    Args:
        results: Stored results.
        key: Key of the first case.
        other: Key of the second case, by whose value is divided.
        name: Name of both curves.
        x: Coordinate.
    """
    return curve_at(results, key, name, x) / curve_at(results, other, name, x)


def curve_difference(results: Results, key: str, name: str, other: str, other_name: str) -> float:
    """Return the largest difference of two curves at the same nodes.

    It is relative to the largest absolute value of the second curve.
    """
    first_curve, second_curve = results.curves(key)[name], results.curves(other)[other_name]
    return float(np.abs(first_curve - second_curve).max() / np.abs(second_curve).max())


def n_cells(results: Results, key: str) -> float:
    """Return the number of cells of the mesh."""
    return float(len(results.curves(key)["cells"]))


def n_elements(results: Results, key: str) -> float:
    """Return the number of elements; two triangles that form a quadrilateral count as one."""
    nodes_per_cell = results.curves(key)["cells"].shape[1]
    is_triangle_pair = nodes_per_cell == 6 and "Q8" in results[key].parameters["element"]
    return n_cells(results, key) / (2 if is_triangle_pair else 1)
