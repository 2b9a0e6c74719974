"""Mortars of two deformed sides in the plane, and their derivatives by all positions.

Duals, forces and gaps are those of `mortar`, taken where the sides are now, with who faces whom
found anew. Sides are the polylines through all nodes, vertices and middles, for that is where the
weights are linear; so all sums over nodes below are exact, and a rigid motion changes nothing. With

    D_ji = integral of w_j w_i,   M_jk = integral of w_j w_k,   A_j = integral of w_j

over what the slave's facets have of the master's, the mean place of a node over the mean place of
what it faces is S x = (D x_1 - M x_2) / A, the gap n·S x, and the slip since S was S_0

    v = t·(S_0 - S) x:

what was paired then has gone so far apart along the tangent t now. It vanishes where both bodies
move or stretch together, as current S times changes of x does not, and is of second order in the
way along curved sides. A node that faced nothing then is paired with the point closest to it.

Facets see each other along the slave's normals, interpolated between nodes, where a normal is that
of the chord between both neighbours: so integrals have continuous derivatives as nodes slide by
each other, but for the ends of the master.

Duals are negative in places, so that single nodes of the master draw at the edge of contact, by a
few per cent of the peak where the master is as fine as the slave or finer, hardly where it is
coarser: section V17 of the study. With w in their place nothing draws, and an even pressure arrives
as well; but then a force acts at the mean place of its weight, not at its node, and the moments of
both sides, which duals nearly keep, are apart. Where the master is the coarser side, the slave sees
its kinks.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.geometry import FACING, Trace

# Of a cubic, such as two weights and a radius, along segments; directions are no polynomials
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
# Part of a facet that has to face the other side: of less the duals are lost in round-off
_COVERED = 1e-6


class Varying:
    """Numbers (n,) and derivatives (n, k), sparse or not: differentiation in forward mode."""

    __array_ufunc__ = None  # arrays leave operations to this class

    def __init__(self, value: Array, slope: Any) -> None:  # noqa: ANN401
        self.value, self.slope = value, slope

    def __add__(self, other: "Numbers") -> "Varying":
        if isinstance(other, Varying):
            return Varying(self.value + other.value, self.slope + other.slope)
        return Varying(self.value + other, self.slope)

    def __mul__(self, other: "Numbers") -> "Varying":
        if isinstance(other, Varying):
            slope = _times(self.slope, other.value) + _times(other.slope, self.value)
            return Varying(self.value * other.value, slope)
        return Varying(self.value * other, _times(self.slope, other))

    def __pow__(self, power: float) -> "Varying":
        return Varying(self.value**power, _times(self.slope, power * self.value ** (power - 1)))

    def __getitem__(self, rows: Indices | slice) -> "Varying":
        return Varying(self.value[rows], self.slope[rows])

    def __rmatmul__(self, matrix: sp.csr_array) -> "Varying":
        return Varying(matrix @ self.value, matrix @ self.slope)

    def __neg__(self) -> "Varying":
        return self * -1.0

    def __sub__(self, other: "Numbers") -> "Varying":
        return self + -other

    def __rsub__(self, other: "Numbers") -> "Varying":
        return -self + other

    def __truediv__(self, other: "Numbers") -> "Varying":
        return self * other**-1.0

    __radd__, __rmul__ = __add__, __mul__


# what formulas take: with derivatives or without
Numbers: TypeAlias = Varying | Array | float
Vector: TypeAlias = tuple[Any, Any]  # of numbers


def of_positions(x: Array) -> tuple[Varying, ...]:
    """Components of positions (n, dim), with derivatives by all of them."""
    dim, one = x.shape[1], sp.eye_array(x.size, format="csr")
    return tuple(Varying(x[:, axis].copy(), one[axis::dim]) for axis in range(dim))


def _times(slope: Any, factor: Array | float) -> Any:  # noqa: ANN401
    each = np.broadcast_to(factor, slope.shape[:1])
    if isinstance(slope, np.ndarray):
        return slope * each[:, None]
    scaled = copy(slope)  # of the same pattern, which needs no check
    scaled.data = slope.data * np.repeat(each, np.diff(slope.indptr))
    return scaled


def _cross(a: Vector, b: Vector) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> Any:  # noqa: ANN401
    return a[0] * b[0] + a[1] * b[1]


def _sums(index: Indices, n: int) -> sp.csr_array:
    """Matrix (n, len(index)) that adds entries up by their index."""
    ones, column = np.ones(len(index)), np.arange(len(index))
    return sp.csr_array(sp.coo_array((ones, (index, column)), (n, len(index))))


@dataclass(frozen=True)
class Meeting:
    """Slave nodes (m) and what they face, with derivatives by all positions (2 (m + k),).

    Args:
        faced: (m,), which nodes face anything.
        normal: out of the master, unit vectors of numbers (m,).
        place: S x, components (m,) each; zero where nothing is faced.
        rows: S, (m, m + k).
        handed: entries of the master's parts (k) of forces at the slave's nodes, with
        entry: both their numbers.
    """

    faced: Mask
    normal: Vector
    place: Vector
    rows: sp.csr_array
    handed: Varying
    entry: tuple[Indices, Indices]

    @property
    def normals(self) -> Array:
        """Their values (m, 2)."""
        return np.stack([part.value for part in self.normal], axis=1)

    @property
    def gap(self) -> Varying:
        """n·S x, (m,); zero where nothing is faced."""
        return _dot(self.normal, self.place)

    def parts(self) -> sp.csr_array:
        """Parts (m, k) of a force at each slave node that the master's get, in sum one."""
        m, k = len(self.faced), self.rows.shape[1] - len(self.faced)
        return sp.csr_array(sp.coo_array((self.handed.value, self.entry), (m, k)))

    def turned(self, force: Array) -> sp.csr_array:
        """Derivative (2 k, 2 (m + k)) of the master's parts of fixed forces (m, 2)."""
        (slave, master), k = self.entry, self.rows.shape[1] - len(self.faced)
        to_nodes = _sums(master, k)
        each = [to_nodes @ _times(self.handed.slope, part[slave]) for part in force.T]
        order = np.arange(2 * k).reshape(2, k).T.ravel()
        return sp.csr_array(sp.vstack(each, "csr")[order])


class SlidingMortar:
    """Two sides in the plane.

    Args:
        one, other: slave and master.
        revolved: whether areas are those of the circumference.

    Attributes:
        kept: (m, 2), components that normals of the slave's nodes may have; all by default.
        nodes: (m + k,), global numbers of the slave's nodes, then of the master's.
        slaves: m.
        x: (m + k, 2), undeformed positions.
    """

    def __init__(self, one: Trace, other: Trace, revolved: bool) -> None:
        self.nodes = np.concatenate([one.nodes, other.nodes])
        self.x = np.concatenate([one.positions_of_nodes(), other.positions_of_nodes()])
        self.slaves, self._revolved = len(one.nodes), revolved
        self._one = _directed(one)
        self._other = _directed(other) + self.slaves
        self.kept = np.ones((self.slaves, 2), dtype=bool)
        a, b = self._one.T
        # nodes before and behind, which are themselves at ends
        self._before, self._behind = (np.arange(self.slaves) for _ in range(2))
        self._before[b], self._behind[a] = a, b

    def meet(self, x: Array) -> Meeting:
        """Where nodes are at positions (m + k, 2)."""
        n, m = len(x), self.slaves
        one, other = self._pairs(x)
        (a, b), (c, d) = self._one[one].T, self._other[other].T
        nodes = np.stack([self._before[a], a, b, self._behind[b], c, d], axis=1)
        corners: Any = [(x[node, 0], x[node, 1]) for node in nodes.T]
        ends = self._ends(corners, nodes)
        low, high = np.nan_to_num(ends[0], nan=-np.inf), np.nan_to_num(ends[1], nan=np.inf)
        length = np.maximum(0.0, np.minimum(high, 1.0) - np.maximum(low, -1.0)) / 2
        covered = np.bincount(one, length, minlength=len(self._one))[one]
        some = (length > 0) & (covered > _COVERED)
        one, other, nodes = one[some], other[some], nodes[some]
        units: Any = np.eye(12).reshape(6, 2, 1, 12) + np.zeros((len(one), 1))
        corners = [
            tuple(Varying(x[node, axis], unit[axis]) for axis in (0, 1))
            for node, unit in zip(nodes.T, units, strict=True)
        ]
        # derivatives by positions of six nodes each become those by all
        columns = (2 * nodes[:, :, None] + np.arange(2)).ravel()
        pattern = columns, np.arange(0, 12 * len(one) + 1, 12)
        W, Q = (
            [
                Varying(v.value, sp.csr_array((v.slope.ravel(), *pattern), (len(one), 2 * n)))
                for v in each
            ]
            for each in self._integrals(corners, nodes, (low[some] < -1, high[some] > 1))
        )
        to_facets: Any = _sums(one, len(self._one))
        z = of_positions(x)
        W = [to_facets @ v for v in W]
        chord = [part[self._behind] - part[self._before] for part in z]
        normal = self._unit((-chord[1], chord[0]), slice(None))
        (a, b), (c, d) = self._one.T, self._other[other].T
        facets = (_sums(a, m), _sums(b, m))
        area = facets[0] @ (W[0] + W[1]) + facets[1] @ (W[1] + W[2])
        faced = area.value > 0
        over = (area + ~faced) ** -1.0
        pairs = [(a, a, W[0]), (a, b, W[1]), (b, a, W[1]), (b, b, W[2])]
        pairs += [
            (s[one], t, -Q[2 * i + j]) for i, s in enumerate((a, b)) for j, t in enumerate((c, d))
        ]
        place: list[Any] = [0.0, 0.0]
        for s, t, value in pairs:
            for axis in (0, 1):
                place[axis] = _sums(s, m) @ (value * z[axis][t]) + place[axis]
        values = np.concatenate([v.value * over.value[s] for s, _, v in pairs])
        where = np.concatenate([s for s, _, _ in pairs]), np.concatenate([t for _, t, _ in pairs])
        rows = sp.csr_array(sp.coo_array((values, where), (m, n)))
        sums = W[0] + W[1], W[1] + W[2]
        determinant = W[0] * W[2] - W[1] ** 2.0 + (W[0].value == 0)
        a_over, b_over = sums[0] / determinant * over[a], sums[1] / determinant * over[b]
        # of a's traction at a and b, and of b's
        own = [[W[2] * a_over, -W[1] * a_over], [-W[1] * b_over, W[0] * b_over]]
        parts, slave, master = [], [], []
        for j, s in enumerate((a, b)):
            for k, t in enumerate((c, d)):
                parts.append(own[j][0][one] * Q[k] + own[j][1][one] * Q[2 + k])
                slave.append(s[one])
                master.append(t - m)
        entry = np.concatenate(slave), np.concatenate(master)
        return Meeting(
            faced, normal, (place[0] * over, place[1] * over), rows, _joined(parts), entry
        )

    def start(self, x: Array) -> sp.csr_array:
        """S_0, (m, m + k), at positions (m + k, 2)."""
        met = self.meet(x)
        lone = np.flatnonzero(~met.faced)
        first, edge = x[self._other[:, 0]], x[self._other[:, 1]] - x[self._other[:, 0]]
        away = x[lone][:, None] - first
        along = np.clip(np.sum(away * edge, axis=2) / np.sum(edge**2, axis=1), 0.0, 1.0)
        nearest = np.linalg.norm(away - along[..., None] * edge, axis=2).argmin(axis=1)
        share = np.take_along_axis(along, nearest[:, None], axis=1)[:, 0]
        ends = self._other[nearest]
        column = np.concatenate([lone, ends[:, 0], ends[:, 1]])
        value = np.concatenate([np.ones(len(lone)), share - 1, -share])
        return met.rows + sp.csr_array((value, (np.tile(lone, 3), column)), met.rows.shape)

    def _unit(self, across: Vector, node: Any) -> Vector:  # noqa: ANN401
        """Unit normals at slave nodes."""
        kept = across[0] * self.kept[node, 0], across[1] * self.kept[node, 1]
        over = _dot(kept, kept) ** -0.5
        return kept[0] * over, kept[1] * over

    def _pairs(self, x: Array) -> tuple[Indices, Indices]:
        """Facets that may see each other, for they are near and look at each other.

        Middles are at most by half of both lengths (the master's longest) farther apart than the
        nearest ones. No distance depends on axes, so that turned bodies find the same.
        """
        (own, half), (middles, halves) = (
            (ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2)
            for ends in (x[self._one], x[self._other])
        )
        tree = cKDTree(middles)
        found = tree.query_ball_point(own, half + halves.max() + tree.query(own)[0])
        one = np.repeat(np.arange(len(own)), [len(near) for near in found])
        other = np.concatenate([np.asarray(near, dtype=np.int64) for near in found])
        (a, b), edge = self._one.T, np.diff(x[self._other], axis=1)[:, 0]
        chords = x[self._behind] - x[self._before]
        n = np.stack(self._unit((-chords[:, 1], chords[:, 0]), slice(None)), axis=1)
        out = edge[:, ::-1] * [1, -1] / np.linalg.norm(edge, axis=1, keepdims=True)
        facing = np.sum((n[a] + n[b])[one] * out[other], axis=1) > -2 * FACING
        return one[facing], other[facing]

    def _frame(self, corners: Sequence[Vector], nodes: Indices) -> tuple[Vector, ...]:
        """Middles and halves of chords and of normals along them."""
        before, a, b, behind = corners[:4]
        normals = [
            self._unit((low[1] - high[1], high[0] - low[0]), nodes[:, k])
            for k, (low, high) in ((1, (before, b)), (2, (a, behind)))
        ]
        return tuple(
            ((low[0] + sign * high[0]) * 0.5 * sign, (low[1] + sign * high[1]) * 0.5 * sign)
            for low, high in ((a, b), normals)
            for sign in (1.0, -1.0)
        )

    def _ends(self, corners: Sequence[Vector], nodes: Indices) -> list[Any]:
        """Coordinates in [-1, 1] of the slave's facets whose normals go through the master's nodes.

        They run against each other.
        """
        middle, half, mean, change = self._frame(corners, nodes)
        found = []
        for node in (corners[5], corners[4]):
            away = middle[0] - node[0], middle[1] - node[1]
            c0, c2 = _cross(away, mean), _cross(half, change)
            c1 = _cross(half, mean) + _cross(away, change)
            sign = np.where(getattr(c1, "value", c1) < 0, -1.0, 1.0)
            with np.errstate(invalid="ignore", divide="ignore"):
                found.append(c0 * -2.0 / (c1 + (c1**2.0 - c0 * c2 * 4.0) ** 0.5 * sign))
        return found

    def _integrals(
        self, corners: Sequence[Vector], nodes: Indices, whole: tuple[Mask, Mask]
    ) -> tuple[list[Any], list[Any]]:
        """Integrals (q,) of two of the slave's weights, and of one with one of the master's.

        Where a segment reaches as far as its facet, `whole` (q,) tells it of each end.
        """
        q, ends = len(nodes), list[Any]()
        middle, half, mean, change = self._frame(corners, nodes)
        for end, all_, side in zip(self._ends(corners, nodes), whole, (-1.0, 1.0), strict=True):
            ends.append(_where(all_, side, end))
        each, t = np.repeat(np.arange(q), len(_PLACES)), np.tile(_PLACES, q)
        extent = (ends[1] - ends[0]) * 0.5
        at = ((ends[0] + ends[1]) * 0.5)[each] + extent[each] * t
        measure = (extent * _dot(half, half) ** 0.5)[each] * np.tile(_WEIGHTS, q)
        place, direction = (
            (mid[0][each] + way[0][each] * at, mid[1][each] + way[1][each] * at)
            for mid, way in ((middle, half), (mean, change))
        )
        if self._revolved:
            measure = measure * place[0] * (2 * np.pi)
        c, d = corners[4:]
        apart = place[0] - c[0][each], place[1] - c[1][each]
        edge = (d[0] - c[0])[each], (d[1] - c[1])[each]
        along = _cross(apart, direction) / _cross(edge, direction)
        w, sums = ((1 - at) * 0.5, (1 + at) * 0.5), _sums(each, q)
        own = [sums @ (measure * w[i] * w[j]) for i, j in ((0, 0), (0, 1), (1, 1))]
        return own, [sums @ (measure * w_i * v) for w_i in w for v in (1 - along, along)]


def _where(fixed: Mask, value: float, numbers: Varying) -> Varying:
    """A value where it is fixed, and numbers elsewhere, which may be none where it is."""
    slope = np.where(fixed[:, None], 0.0, numbers.slope)
    return Varying(np.where(fixed, value, numbers.value), slope)


def _joined(parts: Sequence[Varying]) -> Varying:
    slope = sp.csr_array(sp.vstack([part.slope for part in parts], "csr"))
    return Varying(np.concatenate([part.value for part in parts]), slope)


def _directed(trace: Trace) -> Indices:
    """Nodes (f, 2) of the sub-facets, by places among the trace's; what is outside on the right."""
    nodes, corners, outward = trace.parts
    edge = corners[:, 1] - corners[:, 0]
    right = np.sum(edge[:, ::-1] * [1, -1] * outward, axis=1) > 0
    place = np.searchsorted(trace.nodes, nodes)
    return np.where(right[:, None], place, place[:, ::-1])
