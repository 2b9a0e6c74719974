"""Sub-facets of a side in space, and the second differences of its curved facets.

A facet with six nodes has four sub-triangles, and one with nine nodes four sub-quadrilaterals. The
corners of a sub-facet are listed in the order along its rim, anticlockwise if seen from outside of
the body.

A quadratic function on a facet differs from its interpolation on a sub-facet by bubble functions
times second differences B of the nodal values. On a triangle with the weight functions w_a, the
difference is

    -1/2 sum over edges of w_a w_b B_ab,

where B_ab is the second difference of f along the edge ab. The edges of all four triangles of a
facet are parallel to the edges of the facet, so that B_ab = f_p - 2 f_m + f_q with the ends p, q
and the middle m of the parallel edge. On a quadrilateral with the coordinates u and v between -1/2
and 1/2 it is

    -1/2 (1/4 - u^2) ((1/2 - v) B_01 + (1/2 + v) B_32)
    -1/2 (1/4 - v^2) ((1/2 + u) B_12 + (1/2 - u) B_03) + 1/4 (1/4 - u^2) (1/4 - v^2) B_uv.

Here an edge ab is part of a row of three nodes p, m, q of the facet, and B_ab = f_p - 2 f_m + f_q;
B_uv is the second difference, across the rows, of their second differences.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices
from pw_elements.contact.interface.mortars.boundary_facets import BoundaryFacets
from pw_elements.contact.interface.mortars.overlap import RIM_CORNER_ORDER_BY_CORNER_COUNT
from pw_elements.contact.interface.mortars.sliding import sum_into_matrix

# Order of the corners along the rim as seen from the other side, by number of corners
_REVERSED_RIM_ORDER_BY_CORNER_COUNT = {3: [0, 2, 1], 4: [0, 2, 3, 1]}
# Corners at the ends of the edge that belongs to each bubble function of an edge
BUBBLE_EDGE_ENDS_BY_CORNER_COUNT = {
    3: np.array([[1, 2], [2, 0], [0, 1]]),
    4: np.array([[0, 1], [1, 2], [2, 3], [3, 0]]),
}
# Ends and middle of the rows of nodes along which second differences are taken, by the number of
# nodes of a facet: the edges of a triangle, and rows of a quadrilateral in both directions
_ROWS_BY_FACET_NODE_COUNT = {
    6: ((1, 3, 2), (0, 4, 2), (0, 5, 1)),
    9: ((0, 4, 1), (5, 8, 6), (2, 7, 3), (0, 5, 2), (4, 8, 7), (1, 6, 3)),
}
# Connections of two nodes of a triangular facet that are parallel to each of its edges
_PARALLEL_CONNECTIONS_OF_TRIANGLE = (
    ((1, 3), (3, 2), (4, 5)),
    ((0, 4), (4, 2), (3, 5)),
    ((0, 5), (5, 1), (3, 4)),
)
_SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0])


@dataclass(frozen=True)
class SubFacets:
    """Sub-facets of one side, with f sub-facets, c facets, and n nodes.

    Args:
        corners: (f, k), corners as indices of the side's nodes, in the order along the rim.
        local_corners: (f, k), the same corners as local nodes of their facets.
        facet_nodes: (c, a), nodes of the facets. Facet i has the sub-facets 4 i to 4 i + 3.
        bubbles: (f, b), numbers of the second differences that belong to the bubble functions of
            each sub-facet: those of the edges in the order of `BUBBLE_EDGE_ENDS_BY_CORNER_COUNT`
            and, on quadrilaterals, the mixed one.
        second_differences: matrix that turns nodal values (n,) into second differences.
    """

    corners: Indices
    local_corners: Indices
    facet_nodes: Indices
    bubbles: Indices
    second_differences: sp.csr_array


def list_sub_facets(boundary_facets: BoundaryFacets) -> SubFacets:
    """Return the sub-facets of a side, oriented outwards."""
    nodes, corners, outward = boundary_facets.sub_facet_nodes_corners_and_normals
    k, n_facets = nodes.shape[1], len(boundary_facets.facet_nodes)
    rim, reversed_rim = (
        orders[k]
        for orders in (RIM_CORNER_ORDER_BY_CORNER_COUNT, _REVERSED_RIM_ORDER_BY_CORNER_COUNT)
    )
    normal = compute_area_vectors(corners[:, rim])
    is_outward = (np.sum(normal * outward, axis=1) > 0)[:, None]
    index = np.searchsorted(boundary_facets.nodes, nodes)
    local = np.tile(boundary_facets.local_sub_facet_nodes, (n_facets, 1))
    index, local = (
        np.where(is_outward, numbers[:, rim], numbers[:, reversed_rim])
        for numbers in (index, local)
    )
    facet_nodes = np.searchsorted(boundary_facets.nodes, boundary_facets.facet_nodes)
    coefficients, bubbles = _number_local_second_differences(facet_nodes.shape[1], local)
    number = len(coefficients) * np.arange(n_facets)
    second_differences = sum_into_matrix(
        np.broadcast_to(coefficients, (n_facets, *coefficients.shape)),
        (number[:, None] + np.arange(len(coefficients)))[:, :, None],
        facet_nodes[:, None],
        (len(coefficients) * n_facets, len(boundary_facets.nodes)),
    )
    n_parts = len(boundary_facets.local_sub_facet_nodes)
    return SubFacets(
        index,
        local,
        facet_nodes,
        np.repeat(number, n_parts)[:, None] + bubbles,
        second_differences,
    )


def _number_local_second_differences(n_nodes: int, local_corners: Indices) -> tuple[Array, Indices]:
    """Return the second differences of a facet, and their numbers for each sub-facet.

    Args:
        n_nodes: number a of nodes of a facet.
        local_corners: (f, k), corners of the sub-facets as local nodes of their facets.

    Returns:
        Coefficients (d, a) of the nodal values in each second difference, and their local numbers
        (f, b) for the bubble functions of each sub-facet.
    """
    rows = _ROWS_BY_FACET_NODE_COUNT[n_nodes]
    coefficients: Array = np.zeros((len(rows), n_nodes))
    for number, nodes in enumerate(rows):
        coefficients[number, list(nodes)] = _SECOND_DIFFERENCE
    connections = (
        _PARALLEL_CONNECTIONS_OF_TRIANGLE
        if n_nodes == 6
        else [(nodes[:2], nodes[1:]) for nodes in rows]
    )
    row_of_connection = {
        frozenset(nodes): number for number, pairs in enumerate(connections) for nodes in pairs
    }
    edge_ends = BUBBLE_EDGE_ENDS_BY_CORNER_COUNT[local_corners.shape[1]]
    bubbles = np.array(
        [
            [row_of_connection[frozenset(corners[ends].tolist())] for ends in edge_ends]
            for corners in local_corners
        ]
    )
    if n_nodes == 9:
        coefficients = np.vstack([coefficients, _SECOND_DIFFERENCE @ coefficients[:3]])
        bubbles = np.column_stack([bubbles, np.full(len(bubbles), len(rows))])
    return coefficients, bubbles


def compute_area_vectors(corners: Array) -> Array:
    """Return twice the area vectors (n, 3) of sub-facets with corners (n, k, 3).

    The corners run anticlockwise around the vectors. The vector of a quadrilateral is the integral
    of its normal, for bilinear interpolation between the corners.
    """
    first, second = _select_spanning_edges(corners)
    return np.asarray(np.cross(first, second), dtype=float)


def compute_neighbour_connections(corners: Array) -> Array:
    """Return the vectors (n, k, 3) from the corner before each corner to the corner after it.

    Twice the area vector changes by v x connection if the corner moves by v.
    """
    return np.asarray(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1))


def compute_spanning_edges(corners: Array) -> Array:
    """Return two vectors (n, 3, 2) in the plane of each sub-facet, side by side."""
    return np.stack(_select_spanning_edges(corners), axis=2)


def _select_spanning_edges(corners: Array) -> tuple[Array, Array]:
    """Return two edges (n, 3) of triangles, or the diagonals (n, 3) of quadrilaterals."""
    if corners.shape[1] == 3:
        return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
