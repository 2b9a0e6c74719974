"""Measures that suit any section: stored numbers, their extremes and ratios, curves."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from study.judge.measures.stored_cases import Selection, matching
from study.run.store import Results, StoredResult

# Keys of two cases
Pair: TypeAlias = tuple[str, str]


def scalar(results: Results, key: str, name: str) -> float:
    """A stored number as it is."""
    return results.scalar(key, name)


def largest(results: Results, section: str, cases: Selection, name: str) -> float:
    """Largest size of a stored number among cases, by parameters or an expression for names."""
    return max(_sizes(results, section, cases, name))


def smallest(results: Results, section: str, cases: Selection, name: str) -> float:
    """Smallest size of it."""
    return min(_sizes(results, section, cases, name))


def least(results: Results, section: str, cases: Selection, name: str) -> float:
    """Least of it, with its sign."""
    return min(stored.scalars[name] for stored in matching(results, section, cases))


def ratio(results: Results, key: str, other: str, name: str) -> float:
    """A stored number of one case over that of another one."""
    return results.scalar(key, name) / results.scalar(other, name)


def growth(results: Results, key: str, other: str, name: str, over: str) -> float:
    """Exponent by which a stored number grows with another one, from one case to a larger one."""
    values = ratio(results, other, key, name), ratio(results, other, key, over)
    return float(np.log(values[0]) / np.log(values[1]))


def excess_ratio(results: Results, fine: Pair, coarse: Pair, name: str) -> float:
    """Relative difference of a stored number of two cases over that of two others."""
    of_fine, of_coarse = (ratio(results, *pair, name) - 1 for pair in (fine, coarse))
    return of_fine / of_coarse


def change_ratio(results: Results, cases: Sequence[str], name: str) -> float:
    """Size of the change of a stored number from the second to the third case over the first's."""
    first, second, third = (results.scalar(case, name) for case in cases)
    return abs((third - second) / (second - first))


def ratio_of(results: Results, key: str, name: str, other: str) -> float:
    """A stored number of a case over another one of the same case."""
    return results.scalar(key, name) / results.scalar(key, other)


def difference_of(results: Results, key: str, name: str, other: str) -> float:
    """A stored number of a case less another one of the same case."""
    return results.scalar(key, name) - results.scalar(key, other)


def relative_difference(
    results: Results, section: str, cases: Selection, name: str, other: str
) -> float:
    """Largest relative difference of two stored numbers of a case, over matching cases."""
    return max(
        abs(stored.scalars[name] / stored.scalars[other] - 1)
        for stored in matching(results, section, cases)
    )


def lowest_order(results: Results, section: str, cases: Selection, name: str) -> float:
    """Lowest order of an error, from the coarsest to the finest mesh of cases alike but for `n`."""
    series: dict[str, list[StoredResult]] = {}
    for stored in matching(results, section, cases):
        series.setdefault(stored.case.rsplit("-", 1)[0], []).append(stored)
    orders = []
    for meshes in series.values():
        size = [stored.scalars["h"] for stored in meshes]
        ends = meshes[int(np.argmax(size))], meshes[int(np.argmin(size))]
        coarse, fine = (stored.scalars for stored in ends)
        orders.append(np.log(coarse[name] / fine[name]) / np.log(coarse["h"] / fine["h"]))
    return float(min(orders))


def largest_from(
    results: Results, section: str, cases: Selection, name: str, value: float
) -> float:
    """Largest distance of a stored number from a value, over matching cases."""
    return max(abs(s.scalars[name] - value) for s in matching(results, section, cases))


def _sizes(results: Results, section: str, cases: Selection, name: str) -> list[float]:
    return [abs(stored.scalars[name]) for stored in matching(results, section, cases)]


def curve_at(results: Results, key: str, name: str, x: float) -> float:
    """A curve along the contact surface at x, linear between nodes."""
    curves = results.curves(key)
    return float(np.interp(x, curves["x"], curves[name]))


def curve_difference(results: Results, key: str, name: str, other: str, other_name: str) -> float:
    """Largest difference of two curves over the same nodes, over the second one's largest size."""
    ours, theirs = results.curves(key)[name], results.curves(other)[other_name]
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def cells(results: Results, key: str) -> float:
    """Number of cells of the mesh."""
    return float(len(results.curves(key)["cells"]))


def elements(results: Results, key: str) -> float:
    """Number of elements: of quadrilaterals that are made of two triangles, pairs."""
    nodes = results.curves(key)["cells"].shape[1]
    paired = nodes == 6 and "Q8" in results[key].parameters["element"]
    return cells(results, key) / (2 if paired else 1)
