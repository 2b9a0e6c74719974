"""Exact integrals over overlaps of two triangles, with derivatives.

The integrands are polynomials in the coordinates of the slave's triangle, so that all integrals
follow from the moments of the overlap.
"""

import numpy as np

from pw_elements.arrays import Array
from pw_elements.contact.interface.mortars.space.integrals import OverlapIntegrals
from pw_elements.contact.interface.mortars.space.projection import Polygons
from pw_elements.contact.interface.mortars.space.sub_facets import (
    BUBBLE_EDGE_ENDS_BY_CORNER_COUNT,
)

# Three-point Gauss rule on [0, 1], exact for the polynomials that are integrated along edges
_GAUSS_POINTS = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
# Weight functions of a triangle's corners, as coefficients of 1, s_1 and s_2
_WEIGHT_FUNCTION_COEFFICIENTS = np.array([[1.0, -1.0, -1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
# Exponents of s_1 and s_2 in the monomials of degree 0 to 3
_MONOMIAL_EXPONENTS = np.array([[d - j, j] for d in range(4) for j in range(d + 1)])


def _select_products_of_linear_monomials() -> Array:
    """Return the array (3, 3, 3, 10) of monomials that are the product of three of 1, s_1, s_2."""
    exponents, selection = _MONOMIAL_EXPONENTS, np.zeros((3, 3, 3, len(_MONOMIAL_EXPONENTS)))
    for a, b, c in np.ndindex(3, 3, 3):
        total = exponents[a] + exponents[b] + exponents[c]
        selection[a, b, c, (exponents == total).all(axis=1)] = 1.0
    return selection


_CUBIC_MONOMIALS = _select_products_of_linear_monomials()
_CONSTANT = np.array([1.0, 0.0, 0.0])  # the monomial 1 among 1, s_1 and s_2


def integrate_over_triangle_overlaps(master: Array, polygons: Polygons) -> OverlapIntegrals:
    """Integrate over overlaps of triangles of the slave with triangles of the master.

    Args:
        master: (q, 3, 2), corners of the master's triangles in coordinates of the slave.
        polygons: overlaps.
    """
    moments, moment_rates = _integrate_monomials(polygons)
    i, j = np.triu_indices(3)
    W, ends = _WEIGHT_FUNCTION_COEFFICIENTS, BUBBLE_EDGE_ENDS_BY_CORNER_COUNT[3]
    by_moments = np.einsum("ia,ib,abcv,c->iv", W[i], W[j], _CUBIC_MONOMIALS, _CONSTANT)
    D, dD = moments @ by_moments.T, by_moments @ moment_rates
    slave_bubble_products = np.einsum(
        "ia,eb,ec,abcv->iev", W, W[ends[:, 0]], W[ends[:, 1]], _CUBIC_MONOMIALS
    )
    slave_bubble = np.einsum("iev,qv->qie", slave_bubble_products, moments)
    slave_bubble_rate = np.einsum("iev,qvz->qiez", slave_bubble_products, moment_rates)
    # integrals of a weight function of the slave times products of two monomials
    by_monomials = np.einsum("ia,abcv->ibcv", W, _CUBIC_MONOMIALS).reshape(27, -1)
    A = (moments @ by_monomials.T).reshape(-1, 3, 3, 3)
    dA = (by_monomials @ moment_rates).reshape(-1, 3, 3, 3, 6)
    c, dc = _find_weight_functions_of_projected_triangles(master)
    M = A[:, :, :, 0] @ np.swapaxes(c, 1, 2)
    dM = np.einsum("qib,qkbz->qikz", A[:, :, :, 0], dc)
    dM += np.einsum("qkb,qibz->qikz", c, dA[:, :, :, 0])
    first, second = c[:, ends[:, 0]], c[:, ends[:, 1]]
    A_second = np.einsum("qibc,qec->qieb", A, second)
    master_bubble = np.einsum("qieb,qeb->qie", A_second, first)
    master_bubble_rate = np.einsum("qieb,qebz->qiez", A_second, dc[:, ends[:, 0]])
    master_bubble_rate += np.einsum(
        "qiec,qecz->qiez", np.einsum("qibc,qeb->qiec", A, first), dc[:, ends[:, 1]]
    )
    outer = first[:, :, :, None] * second[:, :, None]
    master_bubble_rate += outer.reshape(-1, 1, 3, 9) @ dA.reshape(-1, 3, 9, 6)
    bubble = np.concatenate([-slave_bubble, master_bubble], axis=2) / 2
    bubble_rate = np.concatenate([-slave_bubble_rate, master_bubble_rate], axis=2) / 2
    return OverlapIntegrals(D, dD, M, dM, bubble, bubble_rate)


def _integrate_monomials(polygons: Polygons) -> tuple[Array, Array]:
    """Integrate the monomials of s_1 and s_2 up to degree 3 over polygons.

    Returns:
        The integrals (q, 10) and their derivatives (q, 10, 6).
    """
    corner, rate, count = polygons.corner, polygons.rate, polygons.count
    q, max_count, n_monomials = len(corner), corner.shape[1], len(_MONOMIAL_EXPONENTS)
    moments, moment_rates = np.zeros((q, n_monomials)), np.zeros((q, n_monomials, 6))
    row = np.arange(q)
    degree = _MONOMIAL_EXPONENTS.sum(axis=1)
    for k in range(max_count):
        following = np.where(k + 1 < count, k + 1, 0)
        exists = (k < count).astype(float)
        start, end = corner[:, k], corner[row, following]
        start_rate, end_rate = rate[:, k], rate[row, following]
        edge = end - start
        cross = exists * (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])
        # a motion v of the edge's ends sweeps the area v x edge
        sweeps = [
            exists[:, None] * (v[:, 0] * edge[:, 1, None] - v[:, 1] * edge[:, 0, None])
            for v in (start_rate, end_rate)
        ]
        for t, weight in zip(_GAUSS_POINTS, _GAUSS_WEIGHTS, strict=True):
            point = start + t * edge
            values = np.prod(point[:, None] ** _MONOMIAL_EXPONENTS, axis=2)
            # by the divergence theorem for homogeneous functions
            moments += weight * values * cross[:, None] / (degree + 2)
            sweep = (1 - t) * sweeps[0] + t * sweeps[1]
            moment_rates += weight * values[:, :, None] * sweep[:, None]
    return moments, moment_rates


def _find_weight_functions_of_projected_triangles(p: Array) -> tuple[Array, Array]:
    """Return the weight functions of triangles with the corners p (q, 3, 2), and derivatives.

    Returns:
        Coefficients (q, 3, 3) of 1, s_1 and s_2 for each corner, and their derivatives
        (q, 3, 3, 6) with respect to p.
    """
    values = np.concatenate([np.ones((len(p), 3, 1)), p], axis=2)  # monomials at each corner
    inverse = np.linalg.inv(values)  # (q, monomial, corner)
    rates = np.zeros((len(p), 3, 3, 6))
    for corner in range(3):
        for axis in range(2):
            # d(inverse) = -inverse d(values) inverse; d(values) has one entry
            change = -inverse[:, :, corner, None] * inverse[:, None, 1 + axis]
            rates[..., 2 * corner + axis] = np.swapaxes(change, 1, 2)
    return np.swapaxes(inverse, 1, 2), rates
