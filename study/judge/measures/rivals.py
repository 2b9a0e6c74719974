"""Section Q: methods on one problem, means over the offsets of the contact's edge."""

from collections.abc import Iterable

import numpy as np

from study.core.store import MissingResult, Results

NEW = "pw-T6"


def rival_mean(results: Results, method: str, edges: int, name: str) -> float:
    """Mean of a stored number of a method over the offsets."""
    found = [one.scalars[name] for one in _plane(results, method=method, edges=edges)]
    if not found:
        raise MissingResult(f"section Q has no {method} with {edges} edges")
    return float(np.mean(found))


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


def rivals_apart(results: Results, method: str, other: str, name: str) -> float:
    """Largest difference of two methods' curves over the second's largest size, over all meshes."""
    apart = []
    for one in _plane(results, method=method):
        ours = one.curves[name]
        key = one.key.replace(f"/{method}-", f"/{other}-")
        theirs = results.curves(key)[name]
        apart.append(np.abs(ours - theirs).max() / np.abs(theirs).max())
    return float(max(apart))


def rival_extreme(
    results: Results, methods: Iterable[str], name: str, largest: bool = True
) -> float:
    """Largest or smallest stored number among methods, on all meshes."""
    found = [one.scalars[name] for one in _plane(results, method=list(methods))]
    return max(found) if largest else min(found)


def _plane(results: Results, **parameters: object):  # noqa: ANN202
    return results.where("Q", problem="plane", **parameters)


def _edges(results: Results) -> list[int]:
    return sorted({one.parameters["edges"] for one in _plane(results)})
