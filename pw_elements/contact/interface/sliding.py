"""Mortars of two deformed sides in the plane, and their derivatives by all positions.

Duals, forces and gaps are those of `mortar`, taken where the sides are now, with who faces whom
found anew; the guide's page on theory says why so ("Large strains"). With

    D_ji = integral of w_j w_i,   M_jk = integral of w_j w_k,   A_j = integral of w_j

over what the slave's facets have of the master's, the mean place of a node over the mean place of
what it faces is S x = (D x_1 - M x_2) / A, the gap n·S x, the slip since S was S_0 t·(S_0 - S) x.
A node that faced nothing then has no S_0: its slip since positions were x_0 and the tangent t_0
is t·S x - t_0·S x_0, of what is paired now.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface.facing import FacedParts, MortarSides, measure_facing
from pw_elements.contact.interface.mortar import MAX_FACING_COSINE, Trace

# Of a cubic, such as two weights and a radius, along segments; directions are no polynomials
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)
# Pieces of the straight path on which slip is integrated
PATH_PIECES = 8
# Part of a facet that has to face the other side: of less the duals are lost in round-off
_MIN_COVERED_FRACTION = 1e-6


class AutoDiffArray:
    """Numbers (n,) and derivatives (n, k): automatic differentiation in forward mode."""

    __array_ufunc__ = None  # arrays leave operations to this class

    def __init__(self, value: Array, derivative: Array) -> None:
        self.value, self.derivative = value, derivative

    def __add__(self, other: "Numbers") -> "AutoDiffArray":
        if isinstance(other, AutoDiffArray):
            return AutoDiffArray(self.value + other.value, self.derivative + other.derivative)
        return AutoDiffArray(self.value + other, self.derivative)

    def __mul__(self, other: "Numbers") -> "AutoDiffArray":
        if isinstance(other, AutoDiffArray):
            slope = self.derivative * other.value[:, None] + other.derivative * self.value[:, None]
            return AutoDiffArray(self.value * other.value, slope)
        return AutoDiffArray(self.value * other, (self.derivative.T * other).T)

    def __pow__(self, power: float) -> "AutoDiffArray":
        rise = power * self.value ** (power - 1)
        return AutoDiffArray(self.value**power, self.derivative * rise[:, None])

    def __getitem__(self, rows: Indices) -> "AutoDiffArray":
        return AutoDiffArray(self.value[rows], self.derivative[rows])

    def __neg__(self) -> "AutoDiffArray":
        return self * -1.0

    def __sub__(self, other: "Numbers") -> "AutoDiffArray":
        return self + -other

    def __rsub__(self, other: "Numbers") -> "AutoDiffArray":
        return -self + other

    def __truediv__(self, other: "Numbers") -> "AutoDiffArray":
        return self * other**-1.0

    __radd__, __rmul__ = __add__, __mul__


# what formulas take: with derivatives or without
Numbers: TypeAlias = AutoDiffArray | Array | float
Vector: TypeAlias = tuple[Any, Any]  # of numbers


def _cross(a: Vector, b: Vector) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> Any:  # noqa: ANN401
    return a[0] * b[0] + a[1] * b[1]


def stack_values_and_derivatives(numbers: Sequence[AutoDiffArray]) -> tuple[Array, Array]:
    """Values (q, j) and derivatives (q, j, k) of numbers (q,) with derivatives (q, k)."""
    parts = ([v.value for v in numbers], [v.derivative for v in numbers])
    return np.stack(parts[0], axis=1), np.stack(parts[1], axis=1)


def sum_into_matrix(
    values: Array, row: Indices, column: Indices, shape: tuple[int, int]
) -> sp.csr_array:
    """Sums of values by their places, which are of the values' shape or broadcast to it."""
    where = tuple(np.broadcast_to(place, values.shape).ravel() for place in (row, column))
    return sp.csr_array(sp.coo_array((values.ravel(), where), shape))


@dataclass(frozen=True)
class SlidingReference:
    """State of both sides at the start of an increment, from which slip counts.

    Args:
        rows: S_0, (m, n); zero for nodes that faced nothing.
        faced: (m,), which nodes faced anything.
        x: x_0, (n, 2), positions.
        tangents: t_0, (m, 2), unit vectors.
    """

    rows: sp.csr_array
    faced: Mask
    x: Array
    tangents: Array


@dataclass(frozen=True)
class Meeting:
    """Slave nodes (m), what they face, and derivatives by all positions, n = m + k nodes.

    Args:
        faced: (m,), which nodes face anything.
        normals: (m, 2), out of the master, unit vectors.
        places: S x, (m, 2); zero where nothing is faced.
        rows: S, (m, n).
        parts: (m, k), of a force at each slave node those that the master's get, in sum one.
        areas: A, (m,).
        angles: (m, 2 n), derivative of the normals' angles.
        differentiate_rows: gives the derivative (2 m, 2 n) of S y for fixed y (n, 2).
        changes: (2 m, 2 n), derivative of S x.
        turned: gives the derivative (2 k, 2 n) of the master's parts of fixed forces (m, 2).
    """

    faced: Mask
    normals: Array
    places: Array
    rows: sp.csr_array
    parts: sp.csr_array
    areas: Array
    angles: sp.csr_array
    differentiate_rows: Callable[[Array], sp.csr_array]
    changes: sp.csr_array
    turned: Callable[[Array], sp.csr_array]

    @property
    def tangents(self) -> Array:
        """Unit vectors (m, 2), normals turned to the left."""
        return np.stack([-self.normals[:, 1], self.normals[:, 0]], axis=1)

    @property
    def gaps(self) -> Array:
        """n·S x, (m,); zero where nothing is faced."""
        return np.asarray(np.sum(self.normals * self.places, axis=1))

    def motions(self, reference: SlidingReference, x: Array) -> tuple[Array, list[sp.csr_array]]:
        """Return slip (m,) since `reference`, and derivatives of the motions of the nodes.

        These are (m, 2 n) each, of gap, slip and the normals' angle.
        """
        n, t, m = self.normals, self.tangents, len(self.faced)
        entering = self.faced & ~reference.faced
        # with what was paired at the start, and with what is paired now
        apart = np.where(entering[:, None], self.places, reference.rows @ x - self.places)
        slip = np.sum(t * apart, axis=1)

        def along(direction: Array) -> sp.csr_array:
            node = np.arange(m)[:, None]
            return sum_into_matrix(direction, node, 2 * node + np.arange(2), (m, 2 * m))

        gap_rate = along(n) @ self.changes
        gap_rate += sp.diags_array(np.sum(t * self.places, axis=1)) @ self.angles
        sign = np.where(entering, 1.0, -1.0)[:, None]
        slip_rate = along(sign * t) @ self.changes
        slip_rate += along(t) @ sp.csr_array(sp.kron(reference.rows, sp.eye_array(2)))
        slip_rate -= sp.diags_array(np.sum(n * apart, axis=1)) @ self.angles
        if entering.any():
            slip -= np.where(
                entering, np.sum(reference.tangents * (self.rows @ reference.x), axis=1), 0.0
            )
            start_tangents = np.where(entering[:, None], reference.tangents, 0.0)
            slip_rate -= along(start_tangents) @ self.differentiate_rows(reference.x)
        return slip, [gap_rate, slip_rate, self.angles]


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
        self.x = np.concatenate([one.node_positions(), other.node_positions()])
        self.slaves, self._revolved = len(one.nodes), revolved
        self._slave_facets = _orient_facets(one)
        self._master_facets = _orient_facets(other) + self.slaves
        self.kept = np.ones((self.slaves, 2), dtype=bool)
        a, b = self._slave_facets.T
        # nodes before and behind, which are themselves at ends
        self._previous_node, self._next_node = (np.arange(self.slaves) for _ in range(2))
        self._previous_node[b], self._next_node[a] = a, b

    @property
    def sides(self) -> MortarSides:
        """Facets and directions that no state changes."""
        return MortarSides(self._slave_facets, self._master_facets, self.kept, self._revolved)

    def measure_facing(self, x: Array) -> FacedParts:
        """Return what checks of states need at positions (n, 2), by code of its own."""
        return measure_facing(self.sides, x)

    def meet(self, x: Array) -> Meeting:
        """Where nodes are at positions (n, 2)."""
        n, m, f = len(x), self.slaves, len(self._slave_facets)
        one, nodes, (W, dW), (Q, dQ) = self._integrate_segments(x)
        own, theirs = nodes[:, 1:3], nodes[:, 4:]
        local = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 12)  # columns of derivatives
        # integrals W_aa, W_ab and W_bb of each facet, and what of them is in its ends' areas
        whole = np.zeros((f, 3))
        np.add.at(whole, one, W)
        lumped = np.array([[1, 1, 0], [0, 1, 1]])
        integral = 3 * np.arange(f)[:, None] + np.arange(3)
        areas_of = sum_into_matrix(
            np.tile(lumped, (f, 1, 1)),
            self._slave_facets[:, :, None],
            integral[:, None],
            (m, 3 * f),
        )
        areas = areas_of @ whole.ravel()
        faced = areas > 0
        over = 1 / (areas + ~faced)
        rise = sum_into_matrix(dW, integral[one][:, :, None], local[:, None], (3 * f, 2 * n))
        # duals over areas, which depend on five numbers each: a's at a and b, and b's
        given = np.column_stack([whole[one], areas[own]])
        units = np.tile(np.eye(5)[:, None], (len(given), 1))
        aa, ab, bb, A, B = (AutoDiffArray(given[:, v], units[v]) for v in range(5))
        determinant = aa * bb - ab**2.0
        a_over, b_over = (aa + ab) / (determinant * A), (ab + bb) / (determinant * B)
        duals, bent = (
            each.reshape(-1, 2, 2, *each.shape[2:])
            for each in stack_values_and_derivatives(
                [bb * a_over, -ab * a_over, -ab * b_over, aa * b_over]
            )
        )
        parts = sum_into_matrix(duals @ Q, own[:, :, None], theirs[:, None] - m, (m, n - m))

        def turned(force: Array) -> sp.csr_array:
            row = (2 * (theirs - m)[:, :, None] + np.arange(2))[..., None]
            direct = np.einsum("qjx,qji,qikc->qkxc", force[own], duals, dQ)
            through = np.einsum("qjx,qjiv,qik->qkxv", force[own], bent, Q)
            variable = np.concatenate([integral[one], 3 * f + own], axis=1)[:, None, None]
            rises = sp.vstack([rise, areas_of @ rise])
            by_variable = sum_into_matrix(through, row, variable, (2 * (n - m), 3 * f + m))
            return sum_into_matrix(direct, row, local[:, None, None], (2 * (n - m), 2 * n)) + (
                by_variable @ rises
            )

        D, dD = (v[:, [[0, 1], [1, 2]]] for v in (W, dW))
        rows = sp.diags_array(over) @ (
            sum_into_matrix(D, own[:, :, None], own[:, None], (m, n))
            - sum_into_matrix(Q, own[:, :, None], theirs[:, None], (m, n))
        )
        places = rows @ x

        def differentiate_rows(y: Array) -> sp.csr_array:
            # (q, 2, 2, 2), of i from j's mean
            away = y[own][:, None] - (rows @ y)[own][:, :, None]
            changed = np.einsum("qjic,qjix->qjxc", dD, away)
            changed -= np.einsum("qjkc,qkx->qjxc", dQ, y[theirs])
            row = (2 * own[:, :, None] + np.arange(2))[..., None]
            changed = changed * over[own][:, :, None, None]
            return sum_into_matrix(changed, row, local[:, None, None], (2 * m, 2 * n))

        changes = differentiate_rows(x) + sp.kron(rows, sp.eye_array(2))
        normals, angles = self._average_normals(x)
        return Meeting(
            faced,
            normals,
            places,
            rows,
            parts,
            areas,
            angles,
            differentiate_rows,
            changes,
            turned,
        )

    def _average_normals(self, x: Array) -> tuple[Array, sp.csr_array]:
        """Unit normals (m, 2), and the derivative (m, 2 n) of their angles."""
        chord = x[self._next_node] - x[self._previous_node]
        across = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
        node = np.arange(self.slaves)[:, None]
        turn = across / np.sum(chord**2, axis=1, keepdims=True)
        turn[~self.kept.all(axis=1)] = 0.0
        ends = np.stack([self._next_node, self._previous_node], axis=1)
        column = 2 * ends[:, :, None] + np.arange(2)
        signed = turn[:, None] * np.array([1, -1])[:, None]
        shape = len(chord), x.size
        normals = np.stack(self._unit_normal(tuple(across.T), slice(None)), axis=1)
        return normals, sum_into_matrix(signed, node[:, :, None], column, shape)

    def _integrate_segments(self, x: Array) -> tuple[Indices, Indices, tuple, tuple]:
        """Segments (q): slaves' facets, six nodes each, and integrals with their derivatives.

        Nodes are those before, at and behind the slave's facet, and at the master's. Integrals are
        W_aa, W_ab, W_bb, (q, 3), and Q, (q, 2, 2), derivatives (..., 12) by the nodes' positions.
        """
        one, other = self._find_near_facets(x)
        (a, b), (c, d) = self._slave_facets[one].T, self._master_facets[other].T
        nodes = np.stack([self._previous_node[a], a, b, self._next_node[b], c, d], axis=1)
        corners: Any = [(x[node, 0], x[node, 1]) for node in nodes.T]
        low, high = self._find_facing_limits(corners, nodes)
        length = np.maximum(0.0, np.minimum(high, 1.0) - np.maximum(low, -1.0)) / 2
        covered = np.bincount(one, length, minlength=len(self._slave_facets))[one]
        some = (length > 0) & (covered > _MIN_COVERED_FRACTION)
        one, nodes = one[some], nodes[some]
        units: Any = np.eye(12).reshape(6, 2, 1, 12) + np.zeros((len(one), 1))
        corners = [
            tuple(AutoDiffArray(x[node, axis], unit[axis]) for axis in (0, 1))
            for node, unit in zip(nodes.T, units, strict=True)
        ]
        W, Q = self._integrate_products(corners, nodes, (low[some] < -1, high[some] > 1))
        value, slope = stack_values_and_derivatives(Q)
        return (
            one,
            nodes,
            stack_values_and_derivatives(W),
            (value.reshape(-1, 2, 2), slope.reshape(-1, 2, 2, 12)),
        )

    def make_reference(self, x: Array) -> SlidingReference:
        """Return what slip counts from, at positions (m + k, 2)."""
        met = self.meet(x)
        return SlidingReference(met.rows, met.faced, x, met.tangents)

    def integrate_slip(self, start: Array, end: Array) -> Array:
        """Return slip (m, 2) on the straight path from positions (n, 2) to others.

        On each piece of the path a slave node moves along what is closest to it at the end of the
        piece: t·(x_j - x_p) there, less the same at the beginning of the piece.
        """
        slip, before, tangents = np.zeros(self.slaves), start, self._average_tangents(start)
        for share in np.arange(1, PATH_PIECES + 1) / PATH_PIECES:
            now = (1 - share) * start + share * end
            ends, parts = self._find_closest_points(now)
            turned = self._average_tangents(now)
            for x, along, sign in ((now, turned, 1.0), (before, tangents, -1.0)):
                closest = np.einsum("jk,jkx->jx", parts, x[ends])
                slip += sign * np.sum(along * (x[: self.slaves] - closest), axis=1)
            before, tangents = now, turned
        return slip[:, None] * tangents

    def measure_depth(self, start: Array, end: Array) -> Array:
        """Return how deep (m,) slave nodes that begin outside get into the master's side.

        On the straight path between positions (n, 2), in `2 PATH_PIECES` pieces. What is next to
        an end of the master is on neither side.
        """
        rims = np.setdiff1d(*self._master_facets.T), np.setdiff1d(*self._master_facets.T[::-1])
        deepest, outside = np.zeros(self.slaves), np.zeros(self.slaves, dtype=bool)
        for piece, share in enumerate(np.linspace(0, 1, 2 * PATH_PIECES + 1)):
            x = (1 - share) * start + share * end
            ends, parts = self._find_closest_points(x)
            edge = x[ends[:, 1]] - x[ends[:, 0]]
            away = x[: self.slaves] - np.einsum("jk,jkx->jx", parts, x[ends])
            height = np.sum(edge[:, ::-1] * [1, -1] * away, axis=1)
            height /= np.linalg.norm(edge, axis=1)
            at_rim = (np.isin(ends, np.concatenate(rims)) & (parts == 1)).any(axis=1)
            if piece == 0:
                outside = height > -self.measure_facets()
            deepest = np.maximum(deepest, np.where(at_rim, 0.0, -height))
        return np.where(outside, deepest, 0.0)

    def measure_facets(self) -> Array:
        """Return the length (m,) of the shortest facet at each slave node, undeformed."""
        shortest = np.full(self.slaves, np.inf)
        edges = np.diff(self.x[self._slave_facets], axis=1)[:, 0]
        for end in self._slave_facets.T:
            np.minimum.at(shortest, end, np.linalg.norm(edges, axis=1))
        return shortest

    def _average_tangents(self, x: Array) -> Array:
        normals = self._average_normals(x)[0]
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)

    def _find_closest_points(self, x: Array) -> tuple[Indices, Array]:
        """Return the master's nodes (m, 2) and their parts (m, 2) in the slave's closest points."""
        first, edge = (
            x[self._master_facets[:, 0]],
            x[self._master_facets[:, 1]] - x[self._master_facets[:, 0]],
        )
        away = x[: self.slaves, None] - first
        along = np.clip(np.sum(away * edge, axis=2) / np.sum(edge**2, axis=1), 0.0, 1.0)
        nearest = np.linalg.norm(away - along[..., None] * edge, axis=2).argmin(axis=1)
        share = along[np.arange(self.slaves), nearest]
        return self._master_facets[nearest], np.stack([1 - share, share], axis=1)

    def _unit_normal(self, across: Vector, node: Any) -> Vector:  # noqa: ANN401
        kept = across[0] * self.kept[node, 0], across[1] * self.kept[node, 1]
        over = _dot(kept, kept) ** -0.5
        return kept[0] * over, kept[1] * over

    def _find_near_facets(self, x: Array) -> tuple[Indices, Indices]:
        """Facets that may see each other, for they are near and look at each other.

        Middles are at most by half of both lengths (the master's longest) farther apart than the
        nearest ones. No distance depends on axes, so that turned bodies find the same.
        """
        (own, half), (middles, halves) = (
            (ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2)
            for ends in (x[self._slave_facets], x[self._master_facets])
        )
        tree = cKDTree(middles)
        found = tree.query_ball_point(own, half + halves.max() + tree.query(own)[0])
        one = np.repeat(np.arange(len(own)), [len(near) for near in found])
        other = np.concatenate([np.asarray(near, dtype=np.int64) for near in found])
        (a, b), edge = self._slave_facets.T, np.diff(x[self._master_facets], axis=1)[:, 0]
        n, _ = self._average_normals(x)
        out = edge[:, ::-1] * [1, -1] / np.linalg.norm(edge, axis=1, keepdims=True)
        facing = np.sum((n[a] + n[b])[one] * out[other], axis=1) > -2 * MAX_FACING_COSINE
        return one[facing], other[facing]

    def _middles_and_halves(self, corners: Sequence[Vector], nodes: Indices) -> tuple[Vector, ...]:
        """Middles and halves of chords and of normals along them."""
        before, a, b, behind = corners[:4]
        normals = [
            self._unit_normal((low[1] - high[1], high[0] - low[0]), nodes[:, k])
            for k, (low, high) in ((1, (before, b)), (2, (a, behind)))
        ]
        return tuple(
            ((low[0] + sign * high[0]) * 0.5 * sign, (low[1] + sign * high[1]) * 0.5 * sign)
            for low, high in ((a, b), normals)
            for sign in (1.0, -1.0)
        )

    def _find_facing_limits(self, corners: Sequence[Vector], nodes: Indices) -> tuple[Array, Array]:
        """Return what of [-1, 1] on the slave's facets (q,) faces the master's, low and high.

        They may be beyond -1 and 1. On the side of a master's node p on which its facet is,
        f(s) = (x(s) - p) x n(s) is positive for the lower limit and negative for the upper one. A
        facet that is seen only beyond the point where normals meet, f falling with s, is not faced.
        """
        limits = []
        for outside, (c0, c1, c2) in zip(
            (-1.0, 1.0), self._limit_quadratics(corners, nodes), strict=True
        ):
            root = _smaller_root(c0, c1, c2)
            changes = np.abs(root) <= 1  # false for none
            inside = np.where(c0 * outside < 0, outside * np.inf, -outside * np.inf)
            limits.append(np.where(changes, np.where(c1 > 0, root, -outside * np.inf), inside))
        return limits[0], limits[1]

    def _limit_quadratics(
        self, corners: Sequence[Vector], nodes: Indices
    ) -> list[tuple[Any, Any, Any]]:
        """Return c_0, c_1, c_2 of f(s) = (x(s) - p) x n(s), for the master's second and first node.

        x and n are on the slave's facets and their normals: both run against each other.
        """
        middle, half, mean, change = self._middles_and_halves(corners, nodes)
        coefficients = []
        for node in (corners[5], corners[4]):
            away = middle[0] - node[0], middle[1] - node[1]
            c1 = _cross(half, mean) + _cross(away, change)
            coefficients.append((_cross(away, mean), c1, _cross(half, change)))
        return coefficients

    def _integrate_products(
        self, corners: Sequence[Vector], nodes: Indices, whole: tuple[Mask, Mask]
    ) -> tuple[list[Any], list[Any]]:
        """Integrals (q,) of two of the slave's weights, and of one with one of the master's.

        Where a segment reaches as far as its facet, `whole` (q,) tells it of each end.
        """
        q, ends = len(nodes), list[Any]()
        middle, half, mean, change = self._middles_and_halves(corners, nodes)
        quadratics = self._limit_quadratics(corners, nodes)
        for coefficients, all_, side in zip(quadratics, whole, (-1.0, 1.0), strict=True):
            ends.append(_set_constant_where(all_, side, _smaller_root(*coefficients)))
        each, t = np.repeat(np.arange(q), len(_GAUSS_POINTS)), np.tile(_GAUSS_POINTS, q)
        extent = (ends[1] - ends[0]) * 0.5
        at = ((ends[0] + ends[1]) * 0.5)[each] + extent[each] * t
        measure = (extent * _dot(half, half) ** 0.5)[each] * np.tile(_GAUSS_WEIGHTS, q)
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
        w = (1 - at) * 0.5, (1 + at) * 0.5

        def integral(v: AutoDiffArray) -> AutoDiffArray:
            parts = (
                values.reshape(q, len(_GAUSS_POINTS), *values.shape[1:])
                for values in vars(v).values()
            )
            return AutoDiffArray(*(part.sum(axis=1) for part in parts))

        own = [integral(measure * w[i] * w[j]) for i, j in ((0, 0), (0, 1), (1, 1))]
        return own, [integral(measure * w_i * v) for w_i in w for v in (1 - along, along)]


def _smaller_root(c0: Any, c1: Any, c2: Any) -> Any:  # noqa: ANN401
    """Return the root of c_0 + c_1 s + c_2 s^2 that is nearer to zero, NaN where there is none."""
    sign = np.where(getattr(c1, "value", c1) < 0, -1.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return c0 * -2.0 / (c1 + (c1**2.0 - c0 * c2 * 4.0) ** 0.5 * sign)


def _set_constant_where(fixed: Mask, value: float, numbers: AutoDiffArray) -> AutoDiffArray:
    """A value where it is fixed, and numbers elsewhere, which may be none where it is."""
    slope = np.where(fixed[:, None], 0.0, numbers.derivative)
    return AutoDiffArray(np.where(fixed, value, numbers.value), slope)


def _orient_facets(trace: Trace) -> Indices:
    """Nodes (f, 2) of the sub-facets, by places among the trace's; what is outside on the right."""
    nodes, corners, outward = trace.sub_facets
    edge = corners[:, 1] - corners[:, 0]
    right = np.sum(edge[:, ::-1] * [1, -1] * outward, axis=1) > 0
    place = np.searchsorted(trace.nodes, nodes)
    return np.where(right[:, None], place, place[:, ::-1])
