"""Finite elements of the quadratic trial functions and the piecewise-linear weight functions.

Weight functions obey the four principles in section 3 of the paper that `pw_elements` cites: a
weight function 1) is zero outside the sub-cells around its node, 2) is linear on each sub-cell,
3) is continuous, 4) is 1 at its node and 0 at all other nodes. Principles 2 and 3 define a function
space, Basix's macro polynomials of degree 1. Principle 4 defines the basis of this space: it is
dual to point evaluation at the nodes of the quadratic element. Principle 1 then follows.

Halving the edges of a tetrahedron leaves an octahedron in its middle, which can be cut into four
sub-cells in three ways. The weight functions are the mean over these three cuts and are linear on
twelve sub-cells, see the guide's page on theory ("The element").
"""

import functools
import itertools
import math

import basix
import basix.ufl
import numpy as np
from basix import (
    CellType,
    ElementFamily,
    LagrangeVariant,
    MapType,
    PolysetType,
    QuadratureType,
    SobolevSpace,
)

from pw_elements.arrays import Array, Mask

_TETRAHEDRON = CellType.tetrahedron
# Points of the reference cell whose distance from a side is smaller are regarded as lying on it
_SIDE_TOLERANCE_IN_REFERENCE_CELL = 1e-10

SUPPORTED_CELL_NAMES = ("interval", "triangle", "quadrilateral", "tetrahedron", "hexahedron")


def tetrahedron_twelve_cell_quadrature(degree: int) -> tuple[Array, Array]:
    """Return quadrature points (12 n, 3) and weights (12 n,) on the reference tetrahedron.

    The rule has n points in the interior of each of the twelve sub-cells. Basix's default rules of
    degree 4, 5 and 7 have points on sides, where slopes have two values; rules of another scheme
    are used instead.

    Args:
        degree: degree up to which polynomials are integrated exactly on each sub-cell.
    """
    points, weights = basix.make_quadrature(_TETRAHEDRON, degree)
    if not _is_inside_reference_tetrahedron(points).all():
        scheme = QuadratureType.xiao_gimbutas
        points, weights = basix.make_quadrature(_TETRAHEDRON, degree, rule=scheme)
    barycentric = np.column_stack([1 - points.sum(axis=1), points])
    corners, _, _ = _twelve_cell_geometry_and_weight_functions()
    determinant = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    return (barycentric @ corners).reshape(-1, 3), np.outer(determinant, weights).ravel()


def tetrahedron_vertex_quadrature() -> tuple[Array, Array]:
    """Return the points (4, 3) and weights (4,) of the vertex rule on the reference tetrahedron.

    The rule is exact for linear functions times slopes of weight functions: at a vertex,
    `TwelveCellTetrahedron` tabulates the mean slope, weighted with the linear function that is 1 at
    this vertex and 0 at the others.
    """
    return basix.geometry(_TETRAHEDRON), np.full(4, 1 / 24)


class TwelveCellTetrahedron(basix.ufl._BasixElement):
    """Piecewise-linear element on tetrahedra: the mean of the elements of three cuts of the cell.

    Points of FFCx's own quadrature rules are refused, because these rules do not have equally many
    points in each of the twelve sub-cells.
    """

    def __repr__(self) -> str:
        return f"{super().__repr__()}, mean of the three cuts"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TwelveCellTetrahedron) and super().__eq__(other)

    def __hash__(self) -> int:
        return super().__hash__()

    def tabulate(self, nderivs: int, points: Array) -> Array:
        """Tabulate shape functions and their derivatives at points (n, 3).

        On a side between two sub-cells, the slope in one of them is tabulated. At the points of
        `tetrahedron_vertex_quadrature`, slopes are weighted means.

        Returns:
            Values and derivatives (derivatives, n, 10).

        Raises:
            ValueError: if the sub-cells do not contain equally many quadrature points.
        """
        _, inverse, nodal = _twelve_cell_geometry_and_weight_functions()
        barycentric = np.einsum(
            "cij,qi->cqj", inverse, np.column_stack([np.ones(len(points)), points])
        )
        depth = barycentric.min(axis=2)
        _refuse_points_unequally_many_in_sub_cells(nderivs, points, depth)
        cell, point = depth.argmax(axis=0), np.arange(len(points))
        table = np.zeros((math.comb(nderivs + 3, 3), len(points), nodal.shape[2]))
        table[0] = np.einsum("qj,qjn->qn", barycentric[cell, point], nodal[cell])
        if nderivs > 0:
            slopes = np.einsum("cij,cjn->icn", inverse[:, 1:], nodal)
            table[1:4] = slopes[:, cell]
            if np.array_equal(points, tetrahedron_vertex_quadrature()[0]):
                centres, volumes = tetrahedron_twelve_cell_quadrature(1)
                hats = 24 * volumes * np.vstack([1 - centres.sum(axis=1), centres.T])
                table[1:4] = np.einsum("qc,icn->iqn", hats, slopes)
        return table


def _refuse_points_unequally_many_in_sub_cells(
    derivative_order: int, points: Array, least_barycentric: Array
) -> None:
    """Raise ValueError for quadrature points that would integrate the element wrongly.

    Args:
        derivative_order: order of the derivatives to be tabulated.
        points: quadrature points (n, 3).
        least_barycentric: least barycentric coordinate (12, n) of each point with respect to each
            sub-cell.
    """
    is_inside = _is_inside_reference_tetrahedron(points)
    # values may be tabulated at any points (for interpolation, for example), except at the points
    # of FFCx's rules for the whole tetrahedron and for a single cut
    rules = [] if derivative_order else _ffcx_tetrahedron_points_by_count().get(len(points), [])
    is_rule = any(
        np.allclose(points, rule, atol=_SIDE_TOLERANCE_IN_REFERENCE_CELL) for rule in rules
    )
    if not (is_inside.any() if derivative_order else is_rule):
        return
    is_in_cell = least_barycentric[:, is_inside] > _SIDE_TOLERANCE_IN_REFERENCE_CELL
    counts = is_in_cell.sum(axis=1)
    if np.any(counts != counts[0]) or counts.sum() != is_inside.sum():
        raise ValueError(
            "piecewise-linear functions on tetrahedra are linear on twelve sub-cells, and these "
            "points are not equally many in each: an integral would be wrong. Assemble with "
            "pw_elements.assemble_matrix or assemble_vector, or integrate over "
            "pw_elements.cell_measure(space, degree)"
        )


def _is_inside_reference_tetrahedron(points: Array) -> Mask:
    """Return a mask (n,) of points (n, 3) that lie in the interior of the reference tetrahedron."""
    return (
        np.minimum(points.min(axis=1), 1 - points.sum(axis=1)) > _SIDE_TOLERANCE_IN_REFERENCE_CELL
    )


@functools.cache
def _ffcx_tetrahedron_points_by_count() -> dict[int, list[Array]]:
    """Return the points (n, 3) of FFCx's quadrature rules on tetrahedra, keyed by the value of n.

    The rules for the whole tetrahedron and for the tetrahedron with a single cut are included.
    """
    rules: dict[int, list[Array]] = {}
    schemes = (QuadratureType.default, QuadratureType.gauss_jacobi)
    polysets = (PolysetType.standard, PolysetType.macroedge)
    for scheme, polyset, degree in itertools.product(schemes, polysets, range(31)):
        points, _ = basix.make_quadrature(_TETRAHEDRON, degree, rule=scheme, polyset_type=polyset)
        rules.setdefault(len(points), []).append(points)
    return rules


@functools.cache
def _twelve_cell_geometry_and_weight_functions() -> tuple[Array, Array, Array]:
    """Return geometry and weight functions of the twelve sub-cells of the reference tetrahedron.

    Returns:
        Corners (12, 4, 3) of the sub-cells, matrices (12, 4, 4) that map (1, x) to barycentric
        coordinates, and values (12, 4, 10) of the ten weight functions at the corners.
    """
    edges = [frozenset(edge) for edge in basix.topology(_TETRAHEDRON)[1]]
    middle = {edge: 4 + number for number, edge in enumerate(edges)}
    centre, cells = 10, []
    for v in range(4):
        vertices = [w for w in range(4) if w != v]
        adjacent = tuple(middle[frozenset((v, w))] for w in vertices)
        opposite = tuple(middle[frozenset(pair)] for pair in itertools.combinations(vertices, 2))
        cells += [(v, *adjacent), (centre, *adjacent), (centre, *opposite)]
    nodes = basix.create_element(ElementFamily.P, _TETRAHEDRON, 2).points
    corners = np.vstack([nodes, nodes[4:].mean(axis=0)])[np.array(cells)]
    weights = np.vstack([np.eye(10), np.repeat([0.0, 1 / 6], (4, 6))])[np.array(cells)]
    return corners, np.linalg.inv(np.concatenate([np.ones((12, 4, 1)), corners], axis=2)), weights


@functools.cache
def piecewise_linear_sub_cell_element(
    cell: str, value_shape: tuple[int, ...] = ()
) -> basix.ufl._ElementBase:
    """Create the element of piecewise-linear weight functions, Eq. (15) to Eq. (20).

    The functions are linear on the sub-cells that result from halving the edges of the cell; on
    quadrilaterals and hexahedra they are bilinear or trilinear. The nodes have the order of the
    quadratic Lagrange element.

    On tetrahedra the functions are the mean over the three ways of cutting the octahedron that
    remains in the middle. They are linear on twelve sub-cells and do not depend on the order of the
    vertices. Integrals of these functions need a special quadrature rule, which `assemble_matrix`
    and `assemble_vector` choose. DOLFINx's own assembly functions need the measure `cell_measure`
    and raise an error without it. `Function.eval` and DOLFINx's interpolation use the element with
    a single cut, which has the same values at nodes and on faces.

    Args:
        cell: DOLFINx' name of the cell type, such as "triangle".
        value_shape: shape of the function values, () or (d,).

    Raises:
        ValueError: if the cell is not an interval, triangle, quadrilateral, tetrahedron or
            hexahedron.
    """
    kind = _supported_cell_type(cell)
    quadratic = basix.create_element(ElementFamily.P, kind, 2, LagrangeVariant.gll_warped)
    # space of all functions that are linear on sub-cells
    space, x, M = np.eye(quadratic.dim), quadratic.x, quadratic.M
    identity, smooth, macro = MapType.identity, SobolevSpace.H1, PolysetType.macroedge
    element = basix.ufl.custom_element(
        kind, [], space, x, M, 0, identity, smooth, False, 1, 1, polyset_type=macro
    )
    if cell == "tetrahedron":
        element = TwelveCellTetrahedron(element._element)
    elif cell != "triangle":
        element = _TensorHatFunctionElement(element._element)
    return basix.ufl.blocked_element(element, shape=value_shape) if value_shape else element


@functools.cache
def quadratic_element(cell: str, value_shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Create the quadratic Lagrange element, whose functions are the paper's trial functions."""
    _supported_cell_type(cell)
    return basix.ufl.element("Lagrange", cell, 2, shape=value_shape or None)


class _TensorHatFunctionElement(basix.ufl._BasixElement):
    """Macro element on intervals, quadrilaterals and hexahedra, with products of hat functions.

    FFCx tabulates through this class, because Basix 0.9 computes wrong derivatives of macro
    elements on these cells: in each upper half it subtracts in unsigned arithmetic, and a slope of
    -6 becomes 1e20. The values that Basix computes, and its derivatives on simplices, are correct.
    """

    def __repr__(self) -> str:
        # it is part of a form's signature: cached forms with Basix's wrong slopes are not reused
        return f"{super().__repr__()}, by sub-cells"

    def tabulate(self, nderivs: int, points: Array) -> Array:
        """Tabulate shape functions and derivatives (derivatives, n, nodes) at points (n, dim)."""
        dim = points.shape[1]
        half_index = np.rint(2 * self._element.points).astype(int)  # 0, 1, 2: end, middle, end
        is_upper = (points >= 0.5).astype(int)[:, None]
        # along each axis: hat functions of the ends and the middle, and their slopes in each half
        hats = np.maximum(1 - np.abs(2 * points[:, None] - half_index), 0.0)
        slopes = np.array([[-2.0, 2.0, 0.0], [0.0, -2.0, 2.0]])[is_upper, half_index]
        derivatives = [hats, slopes, *np.zeros((nderivs, *hats.shape))]
        table = np.zeros((math.comb(nderivs + dim, dim), *hats.shape[:2]))
        for orders in itertools.product(range(nderivs + 1), repeat=dim):
            if sum(orders) <= nderivs:
                factors = [derivatives[k][:, :, axis] for axis, k in enumerate(orders)]
                table[basix.index(*orders)] = np.prod(factors, axis=0)
        return table


def _supported_cell_type(name: str) -> CellType:
    if name not in SUPPORTED_CELL_NAMES:
        raise ValueError(
            f"no quadratic element on a {name!r}; the cells are {', '.join(SUPPORTED_CELL_NAMES)}"
        )
    return CellType[name]
