"""The elements: quadratic trial functions and piecewise-linear weight functions.

Weight functions are built from the four principles of section 3 of the paper:
1) a weight function lives on the sub-cells around its node only, 2) it is linear on each
of them, 3) it is continuous, 4) it is 1 at its node and 0 at all others.
Principles 2 and 3 name a space, Basix's macro polynomials of degree 1; principle 4 names
its basis, point evaluation at the nodes of the quadratic element; principle 1 then follows.
On tetrahedra the weights are the mean over the three cuts of the octahedron inside: they are linear
on twelve tetrahedra, see the guide's page on theory ("The element").
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

_CELL = CellType.tetrahedron
# Points nearer to a side than this, of cells of size one, lie on it
_ON_SIDE = 1e-10

CELLS = ("interval", "triangle", "quadrilateral", "tetrahedron", "hexahedron")


def twelve_cell_rule(degree: int) -> tuple[Array, Array]:
    """Quadrature points (12 n, 3) and weights (12 n,) of the reference tetrahedron.

    All points lie within the twelve cells. Basix's default rules of degree 4, 5 and 7 have some on
    a cell's sides, where slopes are two-valued.
    """
    points, weights = basix.make_quadrature(_CELL, degree)
    if not _within(points).all():
        points, weights = basix.make_quadrature(_CELL, degree, rule=QuadratureType.xiao_gimbutas)
    hats = np.column_stack([1 - points.sum(axis=1), points])
    corners, _, _ = _twelve_cells()
    size = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    return (hats @ corners).reshape(-1, 3), np.outer(size, weights).ravel()


def vertex_rule() -> tuple[Array, Array]:
    """Vertices (4, 3) and weights (4,) that integrate linear functions times slopes of weights.

    There `TwelveCellElement` has the slopes' means, each weighted with its vertex' linear function.
    """
    return basix.geometry(_CELL), np.full(4, 1 / 24)


class TwelveCellElement(basix.ufl._BasixElement):
    """The one-cut element as the mean of the three cuts; points of FFCx's own rules are refused."""

    def __repr__(self) -> str:
        return f"{super().__repr__()}, mean of the three cuts"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TwelveCellElement) and super().__eq__(other)

    def __hash__(self) -> int:
        return super().__hash__()

    def tabulate(self, nderivs: int, points: Array) -> Array:
        """Values and derivatives at points (n, 3): (derivatives, n, 10).

        Slopes on a side between two of the twelve cells are those of one of them, and at the points
        of `vertex_rule` means. Points of rules that are not equally many in each of the twelve
        cells are a ValueError.
        """
        _, inverse, nodal = _twelve_cells()
        hats = np.einsum("cij,qi->cqj", inverse, np.column_stack([np.ones(len(points)), points]))
        depth = hats.min(axis=2)
        _check_points(nderivs, points, depth)
        cell, own = depth.argmax(axis=0), np.arange(len(points))
        table = np.zeros((math.comb(nderivs + 3, 3), len(points), nodal.shape[2]))
        table[0] = np.einsum("qj,qjn->qn", hats[cell, own], nodal[cell])
        if nderivs > 0:
            slopes = np.einsum("cij,cjn->icn", inverse[:, 1:], nodal)
            table[1:4] = slopes[:, cell]
            if np.array_equal(points, vertex_rule()[0]):
                middles, sizes = twelve_cell_rule(1)
                hats = 24 * sizes * np.vstack([1 - middles.sum(axis=1), middles.T])
                table[1:4] = np.einsum("qc,icn->iqn", hats, slopes)
        return table


def _check_points(nderivs: int, points: Array, depth: Array) -> None:
    """Depth (12, n): least barycentric coordinate of the points in each of the twelve cells."""
    within = _within(points)
    # values may be asked for anywhere, by an interpolation say, but for the rules that FFCx takes:
    # those of the cell and of the one-cut cell
    rules = [] if nderivs else _rules().get(len(points), [])
    taken = any(np.allclose(points, rule, atol=_ON_SIDE) for rule in rules)
    if not (within.any() if nderivs else taken):
        return
    inner = depth[:, within] > _ON_SIDE
    counts = inner.sum(axis=1)
    if np.any(counts != counts[0]) or counts.sum() != within.sum():
        raise ValueError(
            "piecewise-linear functions on tetrahedra are linear on twelve sub-cells, and these "
            "points are not equally many in each: an integral would be wrong. Assemble with "
            "pw_elements.assemble_matrix or assemble_vector, or integrate over "
            "pw_elements.cell_measure(space, degree)"
        )


def _within(points: Array) -> Mask:
    """Which points (n, 3) are neither on a side of the reference tetrahedron nor outside."""
    return np.minimum(points.min(axis=1), 1 - points.sum(axis=1)) > _ON_SIDE


@functools.cache
def _rules() -> dict[int, list[Array]]:
    rules: dict[int, list[Array]] = {}
    schemes = (QuadratureType.default, QuadratureType.gauss_jacobi)
    polysets = (PolysetType.standard, PolysetType.macroedge)
    for scheme, polyset, degree in itertools.product(schemes, polysets, range(31)):
        points, _ = basix.make_quadrature(_CELL, degree, rule=scheme, polyset_type=polyset)
        rules.setdefault(len(points), []).append(points)
    return rules


@functools.cache
def _twelve_cells() -> tuple[Array, Array, Array]:
    """Corners (12, 4, 3), maps (12, 4, 4) from (1, x) to barycentric coordinates; weights there.

    The ten weights are (12, 4, 10); node 10 is the octahedron's centre.
    """
    edges = [frozenset(edge) for edge in basix.topology(_CELL)[1]]
    middle = {edge: 4 + number for number, edge in enumerate(edges)}
    centre, cells = 10, []
    for v in range(4):
        others = [w for w in range(4) if w != v]
        around = tuple(middle[frozenset((v, w))] for w in others)
        opposite = tuple(middle[frozenset(pair)] for pair in itertools.combinations(others, 2))
        cells += [(v, *around), (centre, *around), (centre, *opposite)]
    nodes = basix.create_element(ElementFamily.P, _CELL, 2).points
    corners = np.vstack([nodes, nodes[4:].mean(axis=0)])[np.array(cells)]
    weights = np.vstack([np.eye(10), np.repeat([0.0, 1 / 6], (4, 6))])[np.array(cells)]
    return corners, np.linalg.inv(np.concatenate([np.ones((12, 4, 1)), corners], axis=2)), weights


@functools.cache
def macro_element(cell: str, shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Piecewise-linear weight functions on the cell halved once, Eq. (15) to Eq. (20).

    On tetrahedra they are the mean over the three ways to cut the octahedron inside, linear on
    twelve sub-cells, and do not depend on the order of the vertices. Integrals need a quadrature
    rule for these: `assemble_matrix` and `assemble_vector` choose it themselves; DOLFINx's own
    assembly needs `cell_measure`, without which it raises an error. `Function.eval` and DOLFINx's
    interpolation use the one-cut element, which has the same values at nodes and on faces.

    Quadrilaterals and hexahedra are bilinear or trilinear on their parts. The nodes and their order
    are those of the quadratic Lagrange element; the value shape is () or (d,).
    """
    kind = _cell(cell)
    quadratic = basix.create_element(ElementFamily.P, kind, 2, LagrangeVariant.gll_warped)
    space, x, M = np.eye(quadratic.dim), quadratic.x, quadratic.M  # all that is linear on sub-cells
    identity, smooth, macro = MapType.identity, SobolevSpace.H1, PolysetType.macroedge
    element = basix.ufl.custom_element(
        kind, [], space, x, M, 0, identity, smooth, False, 1, 1, polyset_type=macro
    )
    if cell == "tetrahedron":
        element = TwelveCellElement(element._element)
    elif cell != "triangle":
        element = _HalvedTensorElement(element._element)
    return basix.ufl.blocked_element(element, shape=shape) if shape else element


@functools.cache
def quadratic_element(cell: str, shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Quadratic Lagrange shape functions, the trial functions of the paper's elements."""
    _cell(cell)
    return basix.ufl.element("Lagrange", cell, 2, shape=shape or None)


class _HalvedTensorElement(basix.ufl._BasixElement):
    """Macro element on an interval, quadrilateral or hexahedron, tabulated as products of hats.

    Basix 0.9 tabulates wrong macro derivatives on these cells: in each upper half it subtracts
    in unsigned arithmetic, and a slope of -6 comes out as 1e20. Values and simplices are right.
    FFCx tabulates through this class.
    """

    def __repr__(self) -> str:
        # part of a form's signature: what was compiled with the wrong slopes is not found again
        return f"{super().__repr__()}, by sub-cells"

    def tabulate(self, nderivs: int, points: Array) -> Array:
        """Values and derivatives at points (n, dim): (derivatives, n, nodes)."""
        dim, twice = points.shape[1], np.rint(2 * self._element.points).astype(int)
        upper = (points >= 0.5).astype(int)[:, None]
        # along each axis: hat functions of the ends and the middle, and their slopes by halves
        hats = np.maximum(1 - np.abs(2 * points[:, None] - twice), 0.0)
        slopes = np.array([[-2.0, 2.0, 0.0], [0.0, -2.0, 2.0]])[upper, twice]
        along = [hats, slopes, *np.zeros((nderivs, *hats.shape))]
        table = np.zeros((math.comb(nderivs + dim, dim), *hats.shape[:2]))
        for derivative in itertools.product(range(nderivs + 1), repeat=dim):
            if sum(derivative) <= nderivs:
                factors = [along[k][:, :, axis] for axis, k in enumerate(derivative)]
                table[basix.index(*derivative)] = np.prod(factors, axis=0)
        return table


def _cell(name: str) -> CellType:
    if name not in CELLS:
        raise ValueError(f"no quadratic element on a {name!r}; the cells are {', '.join(CELLS)}")
    return CellType[name]
