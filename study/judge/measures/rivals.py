"""Measures for section Q, which compares methods on one contact problem on the half plane.

On each mesh, the edge of the contact lies at different offsets within an element. Means are taken
over these offsets.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from study.run.store import MissingResult, Results, StoredResult

NEW_ELEMENT = "pw-T6"


def rival_mean(results: Results, method: str, edges: int, name: str) -> float:
    """Return the mean of a scalar of a method over the offsets of the contact's edge.

    Args:
        results: Stored results.
        method: Name of the method.
        edges: Number of element edges over the half width of the contact.
        name: Name of the scalar.
    """
    return float(
        np.mean(
            [
                stored.scalars[name]
                for stored in _half_plane_results(results, method=method, edges=edges)
            ]
        )
    )


def rival_ratio(
    results: Results, method: str, other: str, name: str, largest: bool = True
) -> float:
    """Return the largest or smallest ratio of the means of two methods over all meshes."""
    ratios = [
        rival_mean(results, method, edges, name) / rival_mean(results, other, edges, name)
        for edges in _list_contact_edge_counts(results)
    ]
    return max(ratios) if largest else min(ratios)


def smallest_rival_ratio(results: Results, name: str) -> float:
    """Return the smallest ratio of another method's mean to that of the new element, all meshes."""
    other_methods = {stored.parameters["method"] for stored in _half_plane_results(results)} - {
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
    for stored in _half_plane_results(results, method=method):
        other_curves = results.curves(stored.key.replace(f"/{method}-", f"/{other}-"))
        if not same_nodes or np.array_equal(
            _is_node_in_contact(stored.curves), _is_node_in_contact(other_curves)
        ):
            largest_value = np.abs(other_curves[name]).max()
            differences.append(
                np.abs(stored.curves[name] - other_curves[name]).max() / largest_value
            )
    return float(max(differences))


def n_meshes_with_same_contact(results: Results, method: str, other: str) -> float:
    """Return the number of meshes on which the same nodes are in contact with both methods."""
    curve_pairs = [
        (stored.curves, results.curves(stored.key.replace(f"/{method}-", f"/{other}-")))
        for stored in _half_plane_results(results, method=method)
    ]
    return float(
        sum(
            np.array_equal(_is_node_in_contact(curves), _is_node_in_contact(other_curves))
            for curves, other_curves in curve_pairs
        )
    )


def largest_sweep_error(results: Results, method: str, edges: int, parameter: float) -> float:
    """Return a method's largest L2 error over the offsets for one value of its parameter.

    Args:
        results: Stored results.
        method: Name of the method.
        edges: Number of element edges over the half width of the contact.
        parameter: Value of the method's parameter, such as a penalty factor.
    """
    return max(
        float(stored.curves["sweep_l2"][stored.curves["sweep"] == parameter][0])
        for stored in _half_plane_results(results, method=method, edges=edges)
    )


def _is_node_in_contact(curves: Mapping[str, np.ndarray]) -> np.ndarray:
    force = curves["node_force"]
    return np.asarray(force > 1e-6 * force.max())


def rival_extreme(
    results: Results, methods: Iterable[str], name: str, largest: bool = True
) -> float:
    """Return the largest or smallest value of a scalar over several methods and all meshes."""
    values = [stored.scalars[name] for stored in _half_plane_results(results, method=list(methods))]
    return max(values) if largest else min(values)


def _half_plane_results(results: Results, **parameters: object) -> list[StoredResult]:
    stored_results = results.where("Q", **{"problem": ["plane", "calculix"], **parameters})
    if not stored_results:
        raise MissingResult(f"no result of section Q has {parameters}: run ./run study Q")
    return stored_results


def _list_contact_edge_counts(results: Results) -> list[int]:
    return sorted({stored.parameters["edges"] for stored in _half_plane_results(results)})
