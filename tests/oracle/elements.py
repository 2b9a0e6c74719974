"""Reference elements: quadratic shape functions, piecewise-linear weights, Gauss rules.

Nodes have Basix's order: vertices, mid-side nodes, centre. Mid-side nodes of simplices are sorted
by the opposite vertex or edge. The vertices of quadrilaterals are 00 10 01 11, and their mid-side
nodes are those below, on the left, on the right and above. The octahedron inside a tetrahedron is
divided into eight sub-cells around its centre. At the centre, weights have the mean of their values
at the mid-side nodes.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class ReferenceElement:
    """A reference element: nodes in doubled coordinates, monomials, sub-cells and facets."""

    simplex: bool
    nodes: tuple
    exponents: tuple
    sub_cells: tuple = ()
    facets: tuple = ()
    facet: str = ""
    centre: tuple = ()


_TRIANGLE_NODES_TIMES_2 = ((0, 0), (2, 0), (0, 2), (1, 1), (0, 1), (1, 0))
_SQUARE_NODES_TIMES_2 = ((0, 0), (2, 0), (0, 2), (2, 2), (1, 0), (0, 1), (2, 1), (1, 2), (1, 1))
_TETRAHEDRON_NODES_TIMES_2 = (
    *((0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)),
    *((0, 1, 1), (1, 0, 1), (1, 1, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)),
)
_NODE_NUMBERS_OF_SQUARE_SIDES = ((0, 1, 4), (0, 2, 5), (1, 3, 6), (2, 3, 7))

REFERENCE_ELEMENTS = {
    "L3": ReferenceElement(True, ((0,), (2,), (1,)), ((0,), (1,), (2,)), ((0, 2), (2, 1))),
    "T6": ReferenceElement(
        True,
        _TRIANGLE_NODES_TIMES_2,
        _TRIANGLE_NODES_TIMES_2,  # the nodes equal the exponents of the monomials up to degree 2
        ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
        ((1, 2, 3), (0, 2, 4), (0, 1, 5)),
        "L3",
    ),
    "Q8": ReferenceElement(
        False,
        _SQUARE_NODES_TIMES_2[:8],
        tuple(p for p in product(range(3), repeat=2) if p != (2, 2)),
        (),
        _NODE_NUMBERS_OF_SQUARE_SIDES,
        "L3",
    ),
    "Q9": ReferenceElement(
        False,
        _SQUARE_NODES_TIMES_2,
        tuple(product(range(3), repeat=2)),
        ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
        _NODE_NUMBERS_OF_SQUARE_SIDES,
        "L3",
    ),
    "T10": ReferenceElement(
        True,
        _TETRAHEDRON_NODES_TIMES_2,
        _TETRAHEDRON_NODES_TIMES_2,
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
    """Values and gradients of n functions at q points of a quadrature rule in d dimensions.

    The functions are the shape functions and weights on the reference element. `measure` has the
    weights of the rule.
    """

    shapes: np.ndarray  # (q, n)
    slopes: np.ndarray  # (q, n, d)
    weights: np.ndarray  # (q, n)
    weight_slopes: np.ndarray  # (q, n, d)
    measure: np.ndarray  # (q,)


@cache
def tabulate_at_gauss_points(
    element_name: str, linear_weights: bool, points_per_direction: int
) -> FunctionTable:
    """Tabulate an element's functions at Gauss points, `points_per_direction` in each direction.

    The rule is applied to the whole element if weights are quadratic, and to each sub-cell if they
    are piecewise linear.
    """
    element = REFERENCE_ELEMENTS[element_name]
    return tabulate_at_points(
        element_name,
        linear_weights,
        *gauss_points_and_weights(element.simplex, len(element.nodes[0]), points_per_direction),
    )


def tabulate_at_points(
    element_name: str, linear_weights: bool, points: np.ndarray, quadrature_weights: np.ndarray
) -> FunctionTable:
    """Tabulate an element's functions at the points (q, d) of a rule with weights (q,).

    The rule is applied to the whole element, or to each sub-cell if weights are piecewise linear.
    """
    element = REFERENCE_ELEMENTS[element_name]
    if not linear_weights:
        values, slopes = shape_functions_and_gradients(element_name, points)
        return FunctionTable(values, slopes, values, slopes, quadrature_weights)
    nodes, nodal = np.array(element.nodes) / 2, np.eye(len(element.nodes))
    if element.centre:
        centre = list(element.centre)
        nodes, nodal = (np.vstack([a, a[centre].mean(axis=0)]) for a in (nodes, nodal))
    vertex_values, vertex_slopes = _vertex_shape_functions_and_gradients(element.simplex, points)
    tables = []
    for sub_cell in map(list, element.sub_cells):
        jacobian = np.einsum("ka,qkb->qab", nodes[sub_cell], vertex_slopes)
        weights = vertex_values @ nodal[sub_cell]
        weight_slopes = np.einsum(
            "qka,kn->qna", vertex_slopes @ np.linalg.inv(jacobian), nodal[sub_cell]
        )
        values_and_slopes = shape_functions_and_gradients(
            element_name, vertex_values @ nodes[sub_cell]
        )
        determinant = np.abs(np.linalg.det(jacobian))
        tables.append(
            (*values_and_slopes, weights, weight_slopes, quadrature_weights * determinant)
        )
    return FunctionTable(*(np.concatenate(arrays) for arrays in zip(*tables, strict=True)))


def shape_functions_and_gradients(
    element_name: str, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return quadratic shape functions (q, n) at points (q, d), and their gradients (q, n, d)."""
    element = REFERENCE_ELEMENTS[element_name]
    powers = np.array(element.exponents)
    at_nodes, _ = _monomials_and_gradients(np.array(element.nodes) / 2, powers)
    values, slopes = _monomials_and_gradients(points, powers)
    inverse = np.linalg.inv(at_nodes)
    return values @ inverse, np.einsum("qmd,mn->qnd", slopes, inverse)


def gauss_points_and_weights(
    is_simplex: bool, dimension: int, points_per_direction: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (q, d) and weights (q,) of a Gauss rule.

    On simplices it is a collapsed rule. With n points per direction, it is exact for polynomials of
    degree 2 n - 1 on lines, squares and cubes, and of degree 2 n - d on simplices of dimension d.
    """
    t, w = np.polynomial.legendre.leggauss(points_per_direction)
    t, w = (t + 1) / 2, w / 2
    points = np.array(list(product(t, repeat=dimension)))
    weights = np.array([np.prod(ws) for ws in product(w, repeat=dimension)])
    if is_simplex:
        remaining = np.ones(len(points))  # 1 minus the coordinates set so far
        for axis in range(dimension):
            weights = weights * remaining ** (axis > 0)
            points[:, axis] *= remaining
            remaining = remaining - points[:, axis]
    return points, weights


def _monomials_and_gradients(
    points: np.ndarray, exponents: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return values (q, m) and gradients (q, m, d) of m monomials at points (q, d)."""
    factors = points[:, None, :] ** exponents
    slopes = np.empty_like(factors)
    for axis in range(points.shape[1]):
        other_factors = np.delete(factors, axis, axis=2).prod(axis=2)
        power = exponents[:, axis]
        slopes[:, :, axis] = (
            other_factors * power * points[:, None, axis] ** np.maximum(power - 1, 0)
        )
    return factors.prod(axis=2), slopes


def _vertex_shape_functions_and_gradients(
    is_simplex: bool, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the k vertex functions (q, k) and their gradients (q, k, d) at points (q, d).

    They are linear on simplices and bilinear on squares.
    """
    if is_simplex:
        slopes = np.vstack([-np.ones(points.shape[1]), np.eye(points.shape[1])])
        return np.column_stack([1 - points.sum(axis=1), points]), np.tile(
            slopes, (len(points), 1, 1)
        )
    (s, t), ones = points.T, np.ones(len(points))
    values = np.column_stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
    s_slopes = np.column_stack([t - 1, 1 - t, -t, t])
    t_slopes = np.column_stack([s - 1, -s, ones - s, s])
    return values, np.stack([s_slopes, t_slopes], axis=2)
