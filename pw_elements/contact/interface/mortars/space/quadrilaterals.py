"""Integrals over overlaps of sub-facets of which one at least is a quadrilateral, with derivatives.

An overlap is divided into triangles from its first corner, on which a quadrature rule is applied.
On a quadrilateral, functions are polynomials of coordinates u between -1/2 and 1/2, which follow
from the position in closed form (`invert_bilinear_mappings`). For parallelograms, whose twist q is
zero, all integrands are polynomials, and the rule is exact. The derivatives are those of the
quadrature, by points, weights and functions.
"""

import basix
import numpy as np

from pw_elements.arrays import Array, Indices
from pw_elements.contact.interface.mortars.overlap import (
    compute_inverse_frames_and_twists,
    invert_bilinear_mappings,
)
from pw_elements.contact.interface.mortars.sliding import number_unique_products
from pw_elements.contact.interface.mortars.space.integrals import OverlapIntegrals
from pw_elements.contact.interface.mortars.space.projection import (
    CORNER_COORDINATES_BY_CORNER_COUNT,
    Polygons,
    ProjectedFacets,
)
from pw_elements.contact.interface.mortars.space.sub_facets import (
    BUBBLE_EDGE_ENDS_BY_CORNER_COUNT,
)

# Degree of the rule on triangles, by the largest component of the twists q of both sub-facets up to
# which it is applied. Degree 6 is exact for parallelograms. Errors grow if a corner of a square
# moves towards the diagonal between its neighbours: relative to the largest integral, they are 1e-9
# at 0.3 of its original distance, 1e-6 at 0.1, and 4e-5 next to the diagonal
_QUADRATURE_DEGREES_BY_LARGEST_TWIST = ((1e-9, 6), (0.1, 10), (0.35, 14), (np.inf, 20))
# Number of triangles that are integrated at once, to limit memory
_MAX_TRIANGLES_AT_ONCE = 2_000


def integrate_over_quadrilateral_overlaps(
    projected: ProjectedFacets, polygons: Polygons
) -> OverlapIntegrals:
    """Integrate over overlaps of sub-facets of the slave with sub-facets of the master.

    Args:
        projected: pairs of sub-facets.
        polygons: their overlaps.
    """
    q, k = projected.slave.shape[:2]
    n_master, n_variables = projected.master.shape[1], projected.n_variables
    n_slave_functions = _count_functions(k)
    n_functions = n_slave_functions + _count_functions(n_master)
    products = np.zeros((q, k, n_functions))
    rates = np.zeros((q, k, n_functions, n_variables))
    rule_of_pair = _select_rules(projected)
    for rule, (_, degree) in enumerate(_QUADRATURE_DEGREES_BY_LARGEST_TWIST):
        for corner in range(1, polygons.corner.shape[1] - 1):
            pairs = np.flatnonzero((rule_of_pair == rule) & (polygons.count > corner + 1))
            for start in range(0, len(pairs), _MAX_TRIANGLES_AT_ONCE):
                part = pairs[start : start + _MAX_TRIANGLES_AT_ONCE]
                triangle = polygons.select(part)
                corners = [0, corner, corner + 1]
                values = _integrate_over_triangles(
                    projected.select(part),
                    triangle.corner[:, corners],
                    triangle.rate[:, corners],
                    degree,
                )
                products[part] += values[0]
                rates[part] += values[1]
    i, j = np.triu_indices(k)
    assert np.array_equal(number_unique_products(k)[i, j], np.arange(len(i)))
    mixed = slice(n_slave_functions, n_slave_functions + n_master)
    bubbles = np.r_[k:n_slave_functions, mixed.stop : n_functions]
    # distances are those of the slave less those of the master
    sign = np.where(bubbles < n_slave_functions, 1.0, -1.0)
    return OverlapIntegrals(
        products[:, i, j],
        rates[:, i, j],
        products[:, :, mixed],
        rates[:, :, mixed],
        products[:, :, bubbles] * sign,
        rates[:, :, bubbles] * sign[:, None],
    )


def _select_rules(projected: ProjectedFacets) -> Indices:
    """Return the number (q,) of the quadrature rule for each pair of sub-facets."""
    twist = np.zeros(len(projected.master))
    for corners in (projected.slave, projected.master):
        if corners.shape[1] == 4:
            _, q = compute_inverse_frames_and_twists(corners)
            twist = np.maximum(twist, np.abs(q).max(axis=(1, 2)))
    limits = [limit for limit, _ in _QUADRATURE_DEGREES_BY_LARGEST_TWIST]
    return np.searchsorted(limits, twist)


def _integrate_over_triangles(
    projected: ProjectedFacets, corner: Array, rate: Array, degree: int
) -> tuple[Array, Array]:
    """Integrate products of weight functions of the slave and all functions over triangles.

    Args:
        projected: pairs (t) of sub-facets.
        corner: (t, 3, 2), corners of a triangle for each pair.
        rate: (t, 3, 2, z), their derivatives.
        degree: degree of the quadrature rule.

    Returns:
        Integrals (t, k, f) and their derivatives (t, k, f, z). The functions are the weight and
        bubble functions of the slave, followed by those of the master.
    """
    points, weights = basix.make_quadrature(basix.CellType.triangle, degree)
    barycentric = np.column_stack([1 - points.sum(axis=1), points])
    t, k, n_variables = len(corner), projected.slave.shape[1], projected.n_variables
    n_master = projected.master.shape[1]
    s = barycentric @ corner
    s_rate = (barycentric @ rate.reshape(t, 3, -1)).reshape(t, len(points), 2, n_variables)
    slave = _evaluate_functions(projected.slave, s)
    master = _evaluate_functions(projected.master, s)
    # motions of the points of sub-facets with constant coordinates u
    slave_motion, master_motion = np.zeros((2, *s_rate.shape))
    if k == 4:
        u = slave[0]
        for axis in (0, 1):
            slave_motion[:, :, axis, 2 * n_master + axis] = u.prod(axis=2)
    for axis in (0, 1):
        master_motion[:, :, axis, axis : 2 * n_master : 2] = master[2][:, :, :n_master]
    functions, function_rates = [], []
    for (_, inverse, values, slopes), motion in ((slave, slave_motion), (master, master_motion)):
        u_rate = inverse @ (s_rate - motion)
        functions.append(values)
        function_rates.append(slopes @ u_rate)
    values, rates = (np.concatenate(parts, axis=2) for parts in (functions, function_rates))
    n_functions = values.shape[2]
    weighted = weights[:, None] * values
    products = np.swapaxes(weighted[:, :, :k], 1, 2) @ values  # (t, k, f)
    product_rates = (
        np.swapaxes(weighted[:, :, :k], 1, 2) @ rates.reshape(t, len(points), -1)
    ).reshape(t, k, n_functions, n_variables)
    product_rates += (
        (np.swapaxes(weighted, 1, 2) @ rates[:, :, :k].reshape(t, len(points), -1))
        .reshape(t, n_functions, k, n_variables)
        .swapaxes(1, 2)
    )
    (first, second), (first_rate, second_rate) = (
        (values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]) for values in (corner, rate)
    )
    double_area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    double_area_rate = (
        first_rate[:, 0] * second[:, 1, None]
        + first[:, 0, None] * second_rate[:, 1]
        - first_rate[:, 1] * second[:, 0, None]
        - first[:, 1, None] * second_rate[:, 0]
    )
    product_rates *= double_area[:, None, None, None]
    product_rates += products[..., None] * double_area_rate[:, None, None]
    return products * double_area[:, None, None], product_rates


def _count_functions(n_corners: int) -> int:
    """Return the number of weight and bubble functions of a sub-facet."""
    return n_corners + {3: 3, 4: 5}[n_corners]


def _evaluate_functions(corners: Array, points: Array) -> tuple[Array, Array, Array, Array]:
    """Evaluate the weight and bubble functions of sub-facets in the plane.

    The bubble functions contain the factors of the second differences (see `sub_facets`).

    Args:
        corners: (t, k, 2), corners of the sub-facets.
        points: (t, g, 2), points.

    Returns:
        Coordinates u (t, g, 2) of the points; derivatives (t, g, 2, 2) of u with respect to the
        position; values (t, g, f) of the functions, and their derivatives (t, g, f, 2) with respect
        to u.
    """
    k = corners.shape[1]
    u = _invert_mappings(corners, points)
    weights, slopes = (_evaluate_triangle_weights if k == 3 else _evaluate_bilinear_weights)(u)
    jacobian = np.swapaxes(corners, 1, 2)[:, None] @ slopes
    values, value_slopes = [weights], [slopes]
    if k == 3:
        for i, j in BUBBLE_EDGE_ENDS_BY_CORNER_COUNT[3]:
            first, second = weights[..., i], weights[..., j]
            values.append(-0.5 * (first * second)[..., None])
            by_u = first[..., None] * slopes[..., j, :] + second[..., None] * slopes[..., i, :]
            value_slopes.append(-0.5 * by_u[..., None, :])
    else:
        bubble = 0.25 - u**2
        for edge in range(4):
            along = edge % 2  # axis of the edge
            across = 1 - along
            sign = -1.0 if edge in (0, 3) else 1.0  # side of the edge
            linear = 0.5 + sign * u[..., across]
            values.append(-0.5 * (bubble[..., along] * linear)[..., None])
            by_u = np.empty_like(u)
            by_u[..., along] = u[..., along] * linear
            by_u[..., across] = -0.5 * sign * bubble[..., along]
            value_slopes.append(by_u[..., None, :])
        values.append(0.25 * bubble.prod(axis=-1)[..., None])
        value_slopes.append((-0.5 * u * bubble[..., ::-1])[..., None, :])
    return (
        u,
        np.asarray(np.linalg.inv(jacobian), dtype=float),
        np.concatenate(values, axis=2),
        np.concatenate(value_slopes, axis=2),
    )


def evaluate_weights_at_points(corners: Array, points: Array) -> Array:
    """Return the bilinear functions (t, g, 4) of quadrilaterals at points of the plane.

    Args:
        corners: (t, 4, 2), corners of the quadrilaterals.
        points: (t, g, 2), points.
    """
    return _evaluate_bilinear_weights(_invert_mappings(corners, points))[0]


def _invert_mappings(corners: Array, points: Array) -> Array:
    """Return the coordinates u (t, g, 2) of points (t, g, 2) of sub-facets with corners (t, k, 2).

    The coordinates of triangles are those with respect to the edges from their first corner.
    """
    if corners.shape[1] == 3:
        basis = corners[:, 1:] - corners[:, :1]
        return np.asarray((points - corners[:, :1]) @ np.linalg.inv(basis))
    return invert_bilinear_mappings(corners, points)


def _evaluate_triangle_weights(u: Array) -> tuple[Array, Array]:
    """Return the linear functions (t, g, 3) at coordinates u (t, g, 2), and derivatives."""
    values = np.concatenate([1 - u.sum(axis=2, keepdims=True), u], axis=2)
    slopes = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    return values, np.broadcast_to(slopes, (*u.shape[:2], 3, 2))


def _evaluate_bilinear_weights(u: Array) -> tuple[Array, Array]:
    """Return the bilinear functions (t, g, 4) at coordinates u (t, g, 2), and derivatives."""
    sign = 2 * CORNER_COORDINATES_BY_CORNER_COUNT[4]
    factor = 0.5 + sign * u[:, :, None]  # (t, g, 4, 2)
    return factor.prod(axis=3), sign * factor[..., ::-1]
