"""Mortars of two deformed sides in the plane, and their derivatives by all positions.

Duals, forces and gaps are those of `mortar`, taken where the sides are now, with who faces whom
found anew. Sides are the polylines through all nodes, vertices and middles, for that is where the
weights are linear; so all sums over nodes below are exact, and a rigid motion changes nothing. With

    D_ji = integral of w_j w_i,   M_jk = integral of w_j w_k,   A_j = integral of w_j

over what the slave's facets have of the master's, the mean place of a node over the mean place of
what it faces is S x = (D x_1 - M x_2) / A, the gap -n·S x, and the slip since S was S_0

    v = t·(S_0 - S) x:

what was paired then has gone so far apart along the tangent t now. It vanishes where both bodies
move or stretch together, as current S times changes of x does not, and is of second order in the
way along curved sides. A node that faced nothing then is paired with the point closest to it.

Facets see each other along the slave's normals, interpolated between nodes, where a normal is that
of the chord between both neighbours: so integrals have continuous derivatives as nodes slide by
each other, but for the ends of the master.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.contact.interface.geometry import FACING, Trace, candidates

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# Of a cubic, such as two weights and a radius, along segments; directions are no polynomials
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
# Part of a facet that has to face the other side: of less the duals are lost in round-off
_COVERED = 1e-6


class Varying:
    """Numbers (n,) with their derivatives (n, k), sparse: differentiation in forward mode."""

    __array_ufunc__ = None  # arrays leave operations to this class

    def __init__(self, value: Array, slope: sp.csr_array) -> None:
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

    def __getitem__(self, rows: npt.NDArray | slice) -> "Varying":
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


def _times(slope: sp.csr_array, factor: Array | float) -> sp.csr_array:
    each = np.broadcast_to(factor, slope.shape[:1])
    data = slope.data * np.repeat(each, np.diff(slope.indptr))
    return sp.csr_array((data, slope.indices, slope.indptr), slope.shape)


def _cross(a: Vector, b: Vector) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> Any:  # noqa: ANN401
    return a[0] * b[0] + a[1] * b[1]


def _sums(index: Indices, n: int) -> sp.csr_array:
    """Matrix (n, len(index)) that adds entries up by their index."""
    ones, column = np.ones(len(index)), np.arange(len(index))
    return sp.csr_array(sp.coo_array((ones, (index, column)), (n, len(index))))


@dataclass(frozen=True)
class Segments:
    """What facets (q) have of each other."""

    slave: Indices  # (q,)
    master: Indices  # (q,)
    # (q,), of the slave's coordinates [-1, 1]: whether ends are those of its facet, not a node's of
    # the master, which are given by local numbers
    whole: tuple[Mask, Mask]
    node: tuple[Indices, Indices]


@dataclass(frozen=True)
class Meeting:
    """Slave nodes (m) and what they face, with derivatives by all positions (2 (m + k),).

    Args:
        faced: (m,), which nodes face anything.
        normal: out of the master, unit vectors.
        place: S x, components (m,) each; zero where nothing is faced.
        rows: S, (m, m + k).
        handed: entries of the master's parts (k) of forces at the slave's nodes, with
        entry: both their numbers.
    """

    faced: Mask
    normal: Vector
    place: Vector
    rows: sp.csr_array
    handed: Numbers
    entry: tuple[Indices, Indices]

    def parts(self) -> sp.csr_array:
        """Parts (m, k) of a force at each slave node that the master's get, in sum one."""
        m, k = len(self.faced), self.rows.shape[1] - len(self.faced)
        values = self.handed.value if isinstance(self.handed, Varying) else self.handed
        return sp.csr_array(sp.coo_array((values, self.entry), (m, k)))

    def turned(self, force: Array) -> sp.csr_array:
        """Derivative (2 k, 2 (m + k)) of the master's parts of fixed forces (m, 2)."""
        assert isinstance(self.handed, Varying)
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
        starts, ends = (_sums(end, len(self.nodes)) for end in self._one.T)
        # chords between both neighbours of each of the slave's nodes
        self._chords = sp.csr_array((starts + ends)[: self.slaves] @ (ends - starts).T)

    def meet(self, x: Array, slopes: bool = True) -> Meeting:
        """Where nodes are at positions (m + k, 2), with derivatives or without."""
        n, m = len(x), self.slaves
        z: Any = (x[:, 0].copy(), x[:, 1].copy())
        normal = self._normals(z)
        found = self._segments(z, normal)
        if slopes:
            one = sp.eye_array(2 * n, format="csr")
            z = tuple(Varying(x[:, axis], one[axis::2]) for axis in (0, 1))
            normal = self._normals(z)
        W, Q = self._integrals(z, normal, found)
        (a, b), (c, d) = self._one.T, self._other.T
        facets = (_sums(a, m), _sums(b, m))
        area = facets[0] @ (W[0] + W[1]) + facets[1] @ (W[1] + W[2])
        faced = _value(area) > 0
        over = (area + ~faced) ** -1.0
        e = found.slave
        pairs = [(a, a, W[0]), (a, b, W[1]), (b, a, W[1]), (b, b, W[2])]
        pairs += [
            (s[e], t[found.master], -Q[2 * i + j])
            for i, s in enumerate((a, b))
            for j, t in enumerate((c, d))
        ]
        place: list[Any] = [0.0, 0.0]
        for s, t, value in pairs:
            for axis in (0, 1):
                place[axis] = _sums(s, m) @ (value * z[axis][t]) + place[axis]
        values = np.concatenate([_value(v) * _value(over)[s] for s, _, v in pairs])
        where = np.concatenate([s for s, _, _ in pairs]), np.concatenate([t for _, t, _ in pairs])
        rows = sp.csr_array(sp.coo_array((values, where), (m, n)))
        sums = W[0] + W[1], W[1] + W[2]
        determinant = W[0] * W[2] - W[1] ** 2.0 + (_value(W[0]) == 0)
        own = [  # of a's traction at a and b, and of b's
            [W[2] * sums[0] / determinant * over[a], -W[1] * sums[0] / determinant * over[a]],
            [-W[1] * sums[1] / determinant * over[b], W[0] * sums[1] / determinant * over[b]],
        ]
        parts, slave, master = [], [], []
        for j, s in enumerate((a, b)):
            for k, t in enumerate((c, d)):
                parts.append(own[j][0][e] * Q[k] + own[j][1][e] * Q[2 + k])
                slave.append(s[e])
                master.append(t[found.master] - m)
        entry = np.concatenate(slave), np.concatenate(master)
        return Meeting(
            faced, normal, (place[0] * over, place[1] * over), rows, _joined(parts), entry
        )

    def start(self, x: Array) -> sp.csr_array:
        """S_0, (m, m + k), at positions (m + k, 2)."""
        met = self.meet(x, slopes=False)
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

    def _normals(self, z: Vector) -> Vector:
        """Unit normals out of the master."""
        across = -(self._chords @ z[1]) * self.kept[:, 0], self._chords @ z[0] * self.kept[:, 1]
        over = _dot(across, across) ** -0.5
        return across[0] * over, across[1] * over

    def _segments(self, z: Vector, normal: Vector) -> Segments:
        """By values alone."""
        x, n = np.stack(z, axis=1), np.stack(normal, axis=1)
        one, other = candidates(x[self._one], x[self._other])
        edge = np.diff(x[self._other], axis=1)[:, 0]
        out = edge[:, ::-1] * [1, -1] / np.linalg.norm(edge, axis=1, keepdims=True)
        facing = np.sum(n[self._one].mean(axis=1)[one] * out[other], axis=1) > -FACING
        one, other = one[facing], other[facing]
        with np.errstate(invalid="ignore", divide="ignore"):
            # master facets run against the slave's
            low, high = (self._seen(z, normal, one, self._other[other, k]) for k in (1, 0))
            low, high = np.nan_to_num(low, nan=-np.inf), np.nan_to_num(high, nan=np.inf)
        start, end = np.maximum(low, -1.0), np.minimum(high, 1.0)
        some = end > start
        length = np.where(some, end - start, 0.0) / 2
        covered = np.bincount(one, length, minlength=len(self._one))[one]
        some &= covered > _COVERED
        one, other = one[some], other[some]
        ends = self._other[other, 1], self._other[other, 0]
        return Segments(one, other, (low[some] < -1.0, high[some] > 1.0), ends)

    def _facets(self, z: Vector, facet: Indices) -> tuple[Vector, Vector]:
        """Middles and half chords of slave facets."""
        a, b = self._one[facet].T
        ends = [(part[a], part[b]) for part in z]
        return (
            ((ends[0][0] + ends[0][1]) * 0.5, (ends[1][0] + ends[1][1]) * 0.5),
            ((ends[0][1] - ends[0][0]) * 0.5, (ends[1][1] - ends[1][0]) * 0.5),
        )

    def _seen(self, z: Vector, normal: Vector, facet: Indices, node: Indices) -> Any:  # noqa: ANN401
        """Coordinates of slave facets, in [-1, 1], whose normals go through nodes."""
        (middle, half), (mean, change) = self._facets(z, facet), self._facets(normal, facet)
        away = middle[0] - z[0][node], middle[1] - z[1][node]
        c0, c2 = _cross(away, mean), _cross(half, change)
        c1 = _cross(half, mean) + _cross(away, change)
        sign = np.where(_value(c1) < 0, -1.0, 1.0)
        return c0 * -2.0 / (c1 + (c1**2.0 - c0 * c2 * 4.0) ** 0.5 * sign)

    def _integrals(self, z: Vector, normal: Vector, found: Segments) -> tuple[list[Any], list[Any]]:
        """Of products of weights: of facets' own, (f,) each, and with the master's, (q,) each."""
        facet, q = found.slave, len(found.slave)
        ends = [
            self._seen(z, normal, facet, np.where(whole, self._one[facet, 0], node)) * ~whole
            + whole * side
            for node, whole, side in zip(found.node, found.whole, (-1.0, 1.0), strict=True)
        ]
        each, count = np.repeat(np.arange(q), len(_PLACES)), np.tile(_PLACES, q)
        (middle, half), (mean, change) = self._facets(z, facet), self._facets(normal, facet)
        length = _dot(half, half) ** 0.5
        at = ((ends[0] + ends[1]) * 0.5)[each] + ((ends[1] - ends[0]) * 0.5)[each] * count
        measure = ((ends[1] - ends[0]) * 0.5 * length)[each] * np.tile(_WEIGHTS, q)
        place, direction = (
            (mid[0][each] + change[0][each] * at, mid[1][each] + change[1][each] * at)
            for mid, change in ((middle, half), (mean, change))
        )
        if self._revolved:
            measure = measure * place[0] * (2 * np.pi)
        c, d = self._other[found.master[each]].T
        apart = place[0] - z[0][c], place[1] - z[1][c]
        edge = z[0][d] - z[0][c], z[1][d] - z[1][c]
        along = _cross(apart, direction) / _cross(edge, direction)
        w = (1 - at) * 0.5, (1 + at) * 0.5
        to_facets, to_segments = _sums(facet[each], len(self._one)), _sums(each, q)
        own = [to_facets @ (measure * w[i] * w[j]) for i, j in ((0, 0), (0, 1), (1, 1))]
        theirs = [to_segments @ (measure * w_i * v) for w_i in w for v in (1 - along, along)]
        return own, theirs


def _value(numbers: Numbers) -> Any:  # noqa: ANN401
    return numbers.value if isinstance(numbers, Varying) else numbers


def _joined(parts: Sequence[Any]) -> Numbers:
    if not isinstance(parts[0], Varying):
        return np.concatenate(parts)
    slope = sp.csr_array(sp.vstack([part.slope for part in parts], "csr"))
    return Varying(np.concatenate([part.value for part in parts]), slope)


def _directed(trace: Trace) -> Indices:
    """Nodes (f, 2) of the sub-facets, by places among the trace's; what is outside on the right."""
    nodes, corners, outward = trace.parts
    edge = corners[:, 1] - corners[:, 0]
    right = np.sum(edge[:, ::-1] * [1, -1] * outward, axis=1) > 0
    place = np.searchsorted(trace.nodes, nodes)
    return np.where(right[:, None], place, place[:, ::-1])
