"""Piecewise-linear weights on tetrahedra: the mean over the three cuts of the octahedron inside.

Mid-sides cut a tetrahedron into four corner ones and an octahedron, which one of three diagonals
cuts into four more. Which one is arbitrary, and nodal forces would depend on it. All three meet in
the octahedron's centre: the mean of the three sets of weights is linear on *twelve* tetrahedra,
the corner ones and one between the centre and each face of the octahedron, and its value in the
centre is the mean of the mid-sides'. Faces, and with them all traces, do not know the cut.
"""

import functools
import itertools
import math

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from basix import CellType, ElementFamily, PolysetType, QuadratureType

Array = npt.NDArray[np.float64]

_CELL = CellType.tetrahedron
# Points nearer to a side than this, of cells of size one, lie on it
_ON_SIDE = 1e-10


def twelve_cell_rule(degree: int) -> tuple[Array, Array]:
    """Quadrature points (12 n, 3) and weights (12 n,) of the reference tetrahedron.

    All points lie within the twelve cells. Basix's default rules of degree 4, 5 and 7 have some
    on a cell's sides, where slopes are two-valued.

    Args:
        degree: of the polynomials that are integrated exactly on each of the cells.
    """
    points, weights = basix.make_quadrature(_CELL, degree)
    if not _within(points).all():
        points, weights = basix.make_quadrature(_CELL, degree, rule=QuadratureType.xiao_gimbutas)
    hats = np.column_stack([1 - points.sum(axis=1), points])
    corners = _corners()
    size = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    return (hats @ corners).reshape(-1, 3), np.outer(size, weights).ravel()


class TwelveCellElement(basix.ufl._BasixElement):
    """The one-cut element, tabulated as the mean of the three cuts; FFCx tabulates through it.

    FFCx by itself would integrate over the eight cells of one cut, which is wrong here: points
    of such rules are refused.
    """

    def __repr__(self) -> str:
        return f"{super().__repr__()}, mean of the three cuts"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TwelveCellElement) and super().__eq__(other)

    def __hash__(self) -> int:
        return super().__hash__()

    def tabulate(self, nderivs: int, points: Array) -> Array:
        """Values and derivatives at points (n, 3): (derivatives, n, 10).

        Slopes on a side between two of the twelve cells are those of one of them.

        Raises:
            ValueError: for slopes at points within the tetrahedron that are not equally many
                in each of the twelve cells, and for values at the points of Basix's rules.
        """
        inverse, nodal = _barycentric_maps(), _corner_values()
        hats = np.einsum("cij,qi->cqj", inverse, np.column_stack([np.ones(len(points)), points]))
        depth = hats.min(axis=2)
        _check_points(nderivs, points, depth)
        cell, own = depth.argmax(axis=0), np.arange(len(points))
        table = np.zeros((math.comb(nderivs + 3, 3), len(points), nodal.shape[2]))
        table[0] = np.einsum("qj,qjn->qn", hats[cell, own], nodal[cell])
        if nderivs > 0:
            table[1:4] = np.einsum("cij,cjn->icn", inverse[:, 1:], nodal)[:, cell]
        return table


def _check_points(nderivs: int, points: Array, depth: Array) -> None:
    """Depth (12, n): least barycentric coordinate of the points in each of the twelve cells."""
    within = _within(points)
    # values may be asked for anywhere, by an interpolation say
    if not (within.any() if nderivs else _is_rule(points)):
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


def _within(points: Array) -> npt.NDArray[np.bool_]:
    """Which points (n, 3) are neither on a side of the reference tetrahedron nor outside."""
    return np.minimum(points.min(axis=1), 1 - points.sum(axis=1)) > _ON_SIDE


def _is_rule(points: Array) -> bool:
    """Whether these are the points of a rule that FFCx takes, of the cell or of the one-cut one."""
    return any(np.allclose(points, rule, atol=_ON_SIDE) for rule in _rules().get(len(points), []))


@functools.cache
def _rules() -> dict[int, list[Array]]:
    """Points of Basix's rules by their number."""
    rules: dict[int, list[Array]] = {}
    schemes = (QuadratureType.default, QuadratureType.gauss_jacobi)
    polysets = (PolysetType.standard, PolysetType.macroedge)
    for scheme, polyset, degree in itertools.product(schemes, polysets, range(31)):
        points, _ = basix.make_quadrature(_CELL, degree, rule=scheme, polyset_type=polyset)
        rules.setdefault(len(points), []).append(points)
    return rules


@functools.cache
def _cells() -> tuple[tuple[int, ...], ...]:
    """Nodes of the twelve cells; 10 is the octahedron's centre."""
    edges = [frozenset(edge) for edge in basix.topology(_CELL)[1]]
    middle = {edge: 4 + number for number, edge in enumerate(edges)}
    centre, cells = 10, []
    for v in range(4):
        others = [w for w in range(4) if w != v]
        around = tuple(middle[frozenset((v, w))] for w in others)
        opposite = tuple(middle[frozenset(pair)] for pair in itertools.combinations(others, 2))
        cells += [(v, *around), (centre, *around), (centre, *opposite)]
    return tuple(cells)


@functools.cache
def _corners() -> Array:
    """Corners (12, 4, 3) of the twelve cells."""
    nodes = basix.create_element(ElementFamily.P, _CELL, 2).points
    centre = nodes[4:].mean(axis=0)
    return np.vstack([nodes, centre])[np.array(_cells())]


@functools.cache
def _corner_values() -> Array:
    """Weights (12, 4, 10) of the ten nodes in the corners of the twelve cells."""
    centre = np.repeat([0.0, 1 / 6], (4, 6))
    return np.vstack([np.eye(10), centre])[np.array(_cells())]


@functools.cache
def _barycentric_maps() -> Array:
    """Matrices (12, 4, 4) from (1, x) to a cell's barycentric coordinates."""
    corners = _corners()
    return np.linalg.inv(np.concatenate([np.ones((12, 4, 1)), corners], axis=2))
