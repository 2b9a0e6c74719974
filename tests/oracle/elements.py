"""Reference elements: quadratic shape functions, piecewise-linear weights, Gauss rules.

Nodes have Basix's order: vertices first; mid-sides of simplices in the order of the opposite vertex
or edge; those of quadrilaterals, whose vertices are 00 10 01 11, below, left, right, above; the
centre last. The octahedron inside a tetrahedron has a centre, where weights are the mean of those
of the mid-sides, and eight sub-cells around it.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Element:
    """Nodes (doubled coordinates), monomials, sub-cells and facets of a reference element."""

    simplex: bool
    nodes: tuple
    exponents: tuple
    sub_cells: tuple = ()
    facets: tuple = ()
    facet: str = ""
    centre: tuple = ()


_TRIANGLE = ((0, 0), (2, 0), (0, 2), (1, 1), (0, 1), (1, 0))
_SQUARE = ((0, 0), (2, 0), (0, 2), (2, 2), (1, 0), (0, 1), (2, 1), (1, 2), (1, 1))
_TETRAHEDRON = (
    *((0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)),
    *((0, 1, 1), (1, 0, 1), (1, 1, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)),
)
_SIDES_OF_SQUARE = ((0, 1, 4), (0, 2, 5), (1, 3, 6), (2, 3, 7))

ELEMENTS = {
    "L3": Element(True, ((0,), (2,), (1,)), ((0,), (1,), (2,)), ((0, 2), (2, 1))),
    "T6": Element(
        True,
        _TRIANGLE,
        _TRIANGLE,  # equal to the exponents of the monomials up to degree 2
        ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
        ((1, 2, 3), (0, 2, 4), (0, 1, 5)),
        "L3",
    ),
    "Q8": Element(
        False,
        _SQUARE[:8],
        tuple(p for p in product(range(3), repeat=2) if p != (2, 2)),
        (),
        _SIDES_OF_SQUARE,
        "L3",
    ),
    "Q9": Element(
        False,
        _SQUARE,
        tuple(product(range(3), repeat=2)),
        ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
        _SIDES_OF_SQUARE,
        "L3",
    ),
    "T10": Element(
        True,
        _TETRAHEDRON,
        _TETRAHEDRON,
        (
            *((0, 9, 8, 7), (9, 1, 6, 5), (8, 6, 2, 4), (7, 5, 4, 3)),
            *((10, 9, 8, 7), (10, 9, 6, 5), (10, 8, 6, 4), (10, 7, 5, 4)),  # next to the corners
            *((10, 4, 5, 6), (10, 4, 7, 8), (10, 5, 7, 9), (10, 6, 8, 9)),  # below the facets
        ),
        ((1, 2, 3, 4, 5, 6), (0, 2, 3, 4, 7, 8), (0, 1, 3, 5, 7, 9), (0, 1, 2, 6, 8, 9)),
        "T6",
        centre=(4, 5, 6, 7, 8, 9),
    ),
}


class FunctionTable(NamedTuple):
    """Functions and their gradients at the q points of a rule on the reference element."""

    shapes: np.ndarray  # (q, n)
    slopes: np.ndarray  # (q, n, d)
    weights: np.ndarray  # (q, n)
    weight_slopes: np.ndarray  # (q, n, d)
    measure: np.ndarray  # (q,)


@cache
def tabulate_at_gauss_points(name: str, linear_weights: bool, n_gauss: int) -> FunctionTable:
    """Tabulate an element's functions at Gauss points, `n_gauss` in each direction.

    The rule covers the whole element with quadratic weights, each sub-cell with piecewise-linear
    ones.
    """
    element = ELEMENTS[name]
    return tabulate_at_points(
        name, linear_weights, *gauss_rule(element.simplex, len(element.nodes[0]), n_gauss)
    )


def tabulate_at_points(
    name: str, linear_weights: bool, points: np.ndarray, measure: np.ndarray
) -> FunctionTable:
    """Tabulate an element's functions at points (q, d) of a rule on a cell, or on each sub-cell."""
    element = ELEMENTS[name]
    if not linear_weights:
        values, slopes = shape_functions(name, points)
        return FunctionTable(values, slopes, values, slopes, measure)
    nodes, nodal = np.array(element.nodes) / 2, np.eye(len(element.nodes))
    if element.centre:
        centre = list(element.centre)
        nodes, nodal = (np.vstack([a, a[centre].mean(axis=0)]) for a in (nodes, nodal))
    vertex_values, vertex_slopes = _vertex_functions(element.simplex, points)
    tables = []
    for sub_cell in map(list, element.sub_cells):
        jacobian = np.einsum("ka,qkb->qab", nodes[sub_cell], vertex_slopes)
        weights = vertex_values @ nodal[sub_cell]
        weight_slopes = np.einsum(
            "qka,kn->qna", vertex_slopes @ np.linalg.inv(jacobian), nodal[sub_cell]
        )
        values_and_slopes = shape_functions(name, vertex_values @ nodes[sub_cell])
        determinant = np.abs(np.linalg.det(jacobian))
        tables.append((*values_and_slopes, weights, weight_slopes, measure * determinant))
    return FunctionTable(*(np.concatenate(arrays) for arrays in zip(*tables, strict=True)))


def shape_functions(name: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return quadratic shape functions (q, n) at points (q, d), and their gradients (q, n, d)."""
    element = ELEMENTS[name]
    powers = np.array(element.exponents)
    at_nodes, _ = _monomials(np.array(element.nodes) / 2, powers)
    values, slopes = _monomials(points, powers)
    inverse = np.linalg.inv(at_nodes)
    return values @ inverse, np.einsum("qmd,mn->qnd", slopes, inverse)


def gauss_rule(simplex: bool, dimension: int, n_points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (q, d) and weights (q,) of a Gauss rule, a collapsed one on simplices.

    It is exact for polynomials of degree 2 n_points - 1 on tensor products, 2 n_points - d on
    simplices.
    """
    t, w = np.polynomial.legendre.leggauss(n_points)
    t, w = (t + 1) / 2, w / 2
    points = np.array(list(product(t, repeat=dimension)))
    weights = np.array([np.prod(ws) for ws in product(w, repeat=dimension)])
    if simplex:
        remaining = np.ones(len(points))  # 1 - x - y ... of the coordinates so far
        for axis in range(dimension):
            weights = weights * remaining ** (axis > 0)
            points[:, axis] *= remaining
            remaining = remaining - points[:, axis]
    return points, weights


def _monomials(points: np.ndarray, powers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values (q, m) and gradients (q, m, d) of monomials at points (q, d)."""
    factors = points[:, None, :] ** powers
    slopes = np.empty_like(factors)
    for axis in range(points.shape[1]):
        other_factors = np.delete(factors, axis, axis=2).prod(axis=2)
        power = powers[:, axis]
        slopes[:, :, axis] = (
            other_factors * power * points[:, None, axis] ** np.maximum(power - 1, 0)
        )
    return factors.prod(axis=2), slopes


def _vertex_functions(simplex: bool, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return functions (q, k), linear on simplices or bilinear, and their gradients (q, k, d)."""
    if simplex:
        slopes = np.vstack([-np.ones(x.shape[1]), np.eye(x.shape[1])])
        return np.column_stack([1 - x.sum(axis=1), x]), np.tile(slopes, (len(x), 1, 1))
    (s, t), ones = x.T, np.ones(len(x))
    values = np.column_stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
    s_slopes = np.column_stack([t - 1, 1 - t, -t, t])
    t_slopes = np.column_stack([s - 1, -s, ones - s, s])
    return values, np.stack([s_slopes, t_slopes], axis=2)
