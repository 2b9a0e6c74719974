"""Measures for section Q, which compares methods on one problem.

Means are taken over the offsets of the contact's edge within an element.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from study.run.store import MissingResult, Results, StoredResult

NEW_ELEMENT = "pw-T6"


def rival_mean(results: Results, method: str, edges: int, name: str) -> float:
    """Return the mean of a scalar of a method over the offsets."""
    return float(
        np.mean(
            [stored.scalars[name] for stored in _plane_results(results, method=method, edges=edges)]
        )
    )


def rival_ratio(
    results: Results, method: str, other: str, name: str, largest: bool = True
) -> float:
    """Return the largest or smallest ratio of two methods' means over all meshes."""
    ratios = [
        rival_mean(results, method, edges, name) / rival_mean(results, other, edges, name)
        for edges in _list_edge_counts(results)
    ]
    return max(ratios) if largest else min(ratios)


def smallest_rival_ratio(results: Results, name: str) -> float:
    """Return the smallest ratio of any other method's mean to that of the new element."""
    other_methods = {stored.parameters["method"] for stored in _plane_results(results)} - {
        NEW_ELEMENT
    }
    return min(
        rival_ratio(results, other, NEW_ELEMENT, name, largest=False) for other in other_methods
    )


def largest_rival_difference(
    results: Results, method: str, other: str, name: str, same_nodes: bool = False
) -> float:
    """Return the largest difference between curves of two methods over all meshes.

    It is relative to the largest absolute value of the second method's curve. If `same_nodes` is
    true, only meshes on which both methods have the same nodes in contact are considered.
    """
    differences = []
    for stored in _plane_results(results, method=method):
        other_curves = results.curves(stored.key.replace(f"/{method}-", f"/{other}-"))
        if not same_nodes or np.array_equal(_is_closed(stored.curves), _is_closed(other_curves)):
            largest_value = np.abs(other_curves[name]).max()
            differences.append(
                np.abs(stored.curves[name] - other_curves[name]).max() / largest_value
            )
    return float(max(differences))


def n_meshes_with_same_contact(results: Results, method: str, other: str) -> float:
    """Return on how many meshes two methods have the same nodes in contact."""
    curve_pairs = [
        (stored.curves, results.curves(stored.key.replace(f"/{method}-", f"/{other}-")))
        for stored in _plane_results(results, method=method)
    ]
    return float(
        sum(
            np.array_equal(_is_closed(curves), _is_closed(other_curves))
            for curves, other_curves in curve_pairs
        )
    )


def largest_sweep_error(results: Results, method: str, edges: int, parameter: float) -> float:
    """Return a method's largest L2 error over the offsets for one parameter of its sweep."""
    return max(
        float(stored.curves["sweep_l2"][stored.curves["sweep"] == parameter][0])
        for stored in _plane_results(results, method=method, edges=edges)
    )


def _is_closed(curves: Mapping[str, np.ndarray]) -> np.ndarray:
    force = curves["node_force"]
    return np.asarray(force > 1e-6 * force.max())


def rival_extreme(
    results: Results, methods: Iterable[str], name: str, largest: bool = True
) -> float:
    """Return the largest or smallest value of a scalar over several methods and all meshes."""
    values = [stored.scalars[name] for stored in _plane_results(results, method=list(methods))]
    return max(values) if largest else min(values)


def _plane_results(results: Results, **parameters: object) -> list[StoredResult]:
    stored_results = results.where("Q", **{"problem": ["plane", "calculix"], **parameters})
    if not stored_results:
        raise MissingResult(f"no result of section Q has {parameters}: run ./run study Q")
    return stored_results


def _list_edge_counts(results: Results) -> list[int]:
    return sorted({stored.parameters["edges"] for stored in _plane_results(results)})
