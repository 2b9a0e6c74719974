"""Section Q: methods on one problem, means over the offsets of the contact's edge."""

from collections.abc import Iterable, Mapping

import numpy as np

from study.run.store import MissingResult, Results, StoredResult

NEW = "pw-T6"


def rival_mean(results: Results, method: str, edges: int, name: str) -> float:
    """Mean of a stored number of a method over the offsets."""
    return float(
        np.mean([one.scalars[name] for one in _plane(results, method=method, edges=edges)])
    )


def rival_ratio(
    results: Results, method: str, other: str, name: str, largest: bool = True
) -> float:
    """Largest or smallest ratio of two methods' means over the meshes."""
    ratios = [
        rival_mean(results, method, n, name) / rival_mean(results, other, n, name)
        for n in _edges(results)
    ]
    return max(ratios) if largest else min(ratios)


def best_rival(results: Results, name: str) -> float:
    """Smallest ratio of any other method's mean to the new element's, over the meshes."""
    others = {one.parameters["method"] for one in _plane(results)} - {NEW}
    return min(rival_ratio(results, other, NEW, name, largest=False) for other in others)


def rivals_apart(
    results: Results, method: str, other: str, name: str, same_nodes: bool = False
) -> float:
    """Largest difference of two methods' curves over the second's largest size, over all meshes.

    With `same_nodes` only where both have the same nodes in contact.
    """
    apart = []
    for one in _plane(results, method=method):
        theirs = results.curves(one.key.replace(f"/{method}-", f"/{other}-"))
        if not same_nodes or np.array_equal(_closed(one.curves), _closed(theirs)):
            size = np.abs(theirs[name]).max()
            apart.append(np.abs(one.curves[name] - theirs[name]).max() / size)
    return float(max(apart))


def same_contacts(results: Results, method: str, other: str) -> float:
    """On how many meshes two methods have the same nodes in contact."""
    pairs = [
        (one.curves, results.curves(one.key.replace(f"/{method}-", f"/{other}-")))
        for one in _plane(results, method=method)
    ]
    return float(sum(np.array_equal(_closed(a), _closed(b)) for a, b in pairs))


def sweep_at(results: Results, method: str, edges: int, parameter: float) -> float:
    """Largest L2 error of a method with a parameter of its sweep, over the offsets."""
    return max(
        float(one.curves["sweep_l2"][one.curves["sweep"] == parameter][0])
        for one in _plane(results, method=method, edges=edges)
    )


def _closed(curves: Mapping[str, np.ndarray]) -> np.ndarray:
    force = curves["node_force"]
    return np.asarray(force > 1e-6 * force.max())


def rival_extreme(
    results: Results, methods: Iterable[str], name: str, largest: bool = True
) -> float:
    """Largest or smallest stored number among methods, on all meshes."""
    found = [one.scalars[name] for one in _plane(results, method=list(methods))]
    return max(found) if largest else min(found)


def _plane(results: Results, **parameters: object) -> list[StoredResult]:
    found = results.where("Q", **{"problem": ["plane", "calculix"], **parameters})
    if not found:
        raise MissingResult(f"no result of section Q has {parameters}: run ./run study Q")
    return found


def _edges(results: Results) -> list[int]:
    return sorted({one.parameters["edges"] for one in _plane(results)})
