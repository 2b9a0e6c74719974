"""Standard quadratic elements that slide on each other, by dual quadratic multipliers.

What large sliding of two bodies is elsewhere: A. Popp, B. Wohlmuth, M. Gee and W. Wall,
https://doi.org/10.1137/110848190, with sides that are curved, segments, and a consistent tangent.
Standard test functions N, their duals psi on each facet, and A_j = integral of N_j give the node j

    n_j·(x_j - sum of P_jk x_k),      P_jk = integral of psi_j N_k / A_j

as its gap, and P_jk of its force to the master's node k. A facet of which a part faces nothing is
left out: duals of a part have nodes without area.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from pw_elements import Direct, PetrovGalerkinProblem, Reduction
from pw_elements.arrays import Array, AutoDiffArray, Indices, stack_values_and_derivatives
from pw_elements.contact import ContactPair
from pw_elements.contact.interface import MortarMatrices, SlidingMortar, Trace
from pw_elements.contact.interface.sliding import LinearisedMortar, sum_into_matrix
from pw_elements.contact.iteration import make_undeformed_state
from pw_elements.contact.model import ContactState
from pw_elements.contact.steps.finite import LargeStrainStepping

# Of products of two quadratic functions on curved facets
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_STEPS = 6  # of Newton's method for a place on a facet
_WHOLE = 1 - 1e-9  # part of a facet that faces the other side


def _functions(t: Any) -> list[Any]:  # noqa: ANN401
    """At the beginning, in the middle and at the end of [-1, 1]."""
    return [(t - 1) * t * 0.5, 1 - t * t, (t + 1) * t * 0.5]


def _at(nodes: Sequence[Any], t: Any) -> Any:  # noqa: ANN401
    """Components of what three nodes have, at places t."""
    N = _functions(t)
    return [sum((N[i] * nodes[i][axis] for i in (1, 2)), N[0] * nodes[0][axis]) for axis in (0, 1)]


def _cross(a: Any, b: Any) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _root(f: Callable[[Any, Any], Any], fixed: Any, varying: Any, t: Array) -> AutoDiffArray:  # noqa: ANN401
    """The place t (q,) at which f vanishes, by Newton's method, and its derivatives."""
    one = np.ones((len(t), 1))
    for _ in range(_STEPS):
        found = f(fixed, AutoDiffArray(t, one))
        step = found.value / found.derivative[:, 0]
        t = t - np.clip(np.nan_to_num(step), -1.0, 1.0)
    slope = f(fixed, AutoDiffArray(t, one)).derivative
    return AutoDiffArray(t, -f(varying, t).derivative / slope)


class DualQuadratic(SlidingMortar):
    """Two sides in the plane, as `SlidingMortar`, of quadratic functions."""

    def __init__(self, one: Trace, other: Trace) -> None:
        super().__init__(one, other, False)
        self._facets, self._theirs = _facets(self._slave_facets), _facets(self._master_facets)

    def linearise(self, x: Array) -> LinearisedMortar:
        """Where nodes are at positions (n, 2)."""
        n, m = len(x), self.n_slave_nodes
        halves = self._find_near_facets(x)
        one, other = np.unique(np.stack(halves) // 2, axis=1)
        nodes = np.column_stack([self._around(one), self._theirs[other]])
        fixed, low, high = self._reached(x, nodes)
        length = np.maximum(0.0, np.minimum(high, 1.0) - np.maximum(low, -1.0)) / 2
        covered = np.bincount(one, length, minlength=len(self._facets))
        some = (length > 0) & (covered[one] > _WHOLE)
        one, nodes, low, high = one[some], nodes[some], low[some], high[some]
        corners = _varying(x, nodes)
        fixed = [tuple(part.value for part in node) for node in corners]
        begin, end = (
            _where(beyond, side, _root(_through(of), fixed, corners, np.clip(t, -1, 1)))
            for of, t, beyond, side in ((7, low, low < -1, -1.0), (5, high, high > 1, 1.0))
        )
        own, theirs = nodes[:, 1:4], nodes[:, 5:]
        local = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 16)
        dual, _ = _duals(corners[1:4])
        B: list[Any] = [[0.0] * 3 for _ in range(3)]
        for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
            t = (begin + end) * 0.5 + (end - begin) * (0.5 * place)
            at = _root(_across, [*fixed, t.value], [*corners, t], -t.value)
            along = _tangent(corners[1:4], t)
            measure = (along[0] * along[0] + along[1] * along[1]) ** 0.5
            measure = measure * (end - begin) * (0.5 * weight)
            N, M = _functions(t), _functions(at)
            for j in range(3):
                psi = (N[0] * dual[j][0] + N[1] * dual[j][1] + N[2] * dual[j][2]) * measure
                B[j] = [B[j][k] + psi * M[k] for k in range(3)]
        shares = stack_values_and_derivatives([v for row in B for v in row])
        pieces, dB = (v.reshape(-1, 3, 3, *v.shape[2:]) for v in shares)
        whole = np.flatnonzero(covered > _WHOLE)
        area, dA = self._areas(x, whole)
        faced = area > 0
        over = 1 / (area + ~faced)
        scale = sp.diags_array(over)
        parts = scale @ sum_into_matrix(pieces, own[:, :, None], theirs[:, None] - m, (m, n - m))

        def turned(force: Array) -> sp.csr_array:
            scaled = force * over[:, None]
            row = (2 * (theirs - m)[:, :, None] + np.arange(2))[..., None]
            direct = np.einsum("qjx,qjkc->qkxc", scaled[own], dB)
            by_area = -np.einsum("qjx,qjk->qkxj", scaled[own] * over[own][..., None], pieces)
            shape = 2 * (n - m)
            return sum_into_matrix(direct, row, local[:, None, None], (shape, 2 * n)) + (
                sum_into_matrix(by_area, row, own[:, None, None], (shape, m)) @ dA
            )

        unit = sp.csr_array((faced.astype(float), (np.arange(m), np.arange(m))), (m, m))
        rows = sp.csr_array(sp.hstack([unit, -parts]))

        def differentiate_rows(y: Array) -> sp.csr_array:
            row = (2 * own[:, :, None] + np.arange(2))[..., None]
            changed = -np.einsum("qjkc,qkx->qjxc", dB, y[theirs]) * over[own][:, :, None, None]
            mean, node = parts @ y[m:] * over[:, None], np.arange(m)[:, None]
            return sum_into_matrix(changed, row, local[:, None, None], (2 * m, 2 * n)) + (
                sum_into_matrix(mean, 2 * node + np.arange(2), node, (2 * m, m)) @ dA
            )

        changes = differentiate_rows(x) + sp.kron(rows, sp.eye_array(2))
        normals, angles = self._average_normals(x)
        return LinearisedMortar(
            faced,
            normals,
            rows @ x,
            rows,
            parts,
            area,
            angles,
            differentiate_rows,
            changes,
            turned,
        )

    def evaluate_for_verification(self, x: Array) -> MortarMatrices:
        """Return what checks of states need; of this method there are no other formulas."""
        met = self.linearise(x)
        return MortarMatrices(
            met.normals,
            met.areas,
            met.distance_rows,
            met.master_fractions,
            np.zeros(self.n_slave_nodes),
        )

    def _around(self, facet: Indices) -> Indices:
        """Nodes (q, 5) before, of and behind facets (q,)."""
        a, m, b = self._facets[facet].T
        return np.stack([self._previous_node[a], a, m, b, self._next_node[b]], axis=1)

    def _reached(self, x: Array, nodes: Indices) -> tuple[Any, Array, Array]:
        """Places on the slave's facets whose normals go through ends of the master's."""
        fixed = [tuple(x[node].T) for node in nodes.T]
        a, b = x[nodes[:, 1]], x[nodes[:, 3]]
        found = []
        for of in (7, 5):
            away = x[nodes[:, of]] - (a + b) / 2
            t = 2 * np.sum(away * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1)
            far = np.abs(t) > 3  # of facets that are beside each other, the side tells enough
            root = _root(_through(of), fixed, _varying(x, nodes), np.clip(t, -1.5, 1.5)).value
            found.append(np.where(far, t, root))
        return fixed, found[0], found[1]

    def _areas(self, x: Array, whole: Indices) -> tuple[Array, sp.csr_array]:
        """Integrals (m,) of the slave's functions over whole facets, and their derivative."""
        m, nodes = self.n_slave_nodes, self._facets[whole]
        local = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 6)
        _, lumped = _duals(_varying(x, nodes))
        area, slope = stack_values_and_derivatives(lumped)
        total = np.bincount(nodes.ravel(), area.ravel(), minlength=m).astype(float)
        return total, sum_into_matrix(slope, nodes[:, :, None], local[:, None], (m, x.size))


def _facets(halves: Indices) -> Indices:
    """Nodes (f, 3) of facets, beginning, middle and end, of halves (2 f, 2) with a direction."""
    first, second = halves[::2], halves[1::2]
    before = (first[:, 1] == second[:, 0])[:, None]
    one, other = np.where(before, first, second), np.where(before, second, first)
    return np.column_stack([one, other[:, 1]])


def _varying(x: Array, nodes: Indices) -> list[Any]:
    """Positions of nodes (q, k) with their derivatives by all of a row's."""
    k = nodes.shape[1]
    units = np.eye(2 * k).reshape(k, 2, 1, 2 * k) + np.zeros((len(nodes), 1))
    return [tuple(AutoDiffArray(x[nodes[:, i], a], units[i, a]) for a in (0, 1)) for i in range(k)]


def _where(fixed: Any, value: float, numbers: AutoDiffArray) -> AutoDiffArray:  # noqa: ANN401
    slope = np.where(fixed[:, None], 0.0, numbers.derivative)
    return AutoDiffArray(np.where(fixed, value, numbers.value), slope)


def _normals_along(corners: Sequence[Any], t: Any) -> Any:  # noqa: ANN401
    """Directions between unit normals of chords, at places of a facet with its neighbours."""
    normals = []
    for low, high in ((0, 2), (1, 3), (2, 4)):
        x, y = (corners[high][axis] - corners[low][axis] for axis in (0, 1))
        over = (x * x + y * y) ** -0.5
        normals.append((-y * over, x * over))
    return _at(normals, t)


def _through(of: int) -> Callable[[Any, Any], Any]:
    """What vanishes where a facet's normal goes through a node of the master."""

    def off(corners: Any, t: Any) -> Any:  # noqa: ANN401
        place = _at(corners[1:4], t)
        away = [place[axis] - corners[of][axis] for axis in (0, 1)]
        return _cross(away, _normals_along(corners, t))

    return off


def _across(corners: Any, at: Any) -> Any:  # noqa: ANN401
    """What vanishes at the place of the master on the normal of the slave's place, the last."""
    *nodes, t = corners
    place, theirs = _at(nodes[1:4], t), _at(nodes[5:8], at)
    away = [theirs[axis] - place[axis] for axis in (0, 1)]
    return _cross(away, _normals_along(nodes, t))


def _tangent(nodes: Sequence[Any], t: Any) -> list[Any]:  # noqa: ANN401
    slopes = (t - 0.5, t * -2.0, t + 0.5)
    return [
        slopes[0] * nodes[0][axis] + slopes[1] * nodes[1][axis] + slopes[2] * nodes[2][axis]
        for axis in (0, 1)
    ]


def _duals(nodes: Sequence[Any]) -> tuple[list[list[Any]], list[Any]]:
    """What duals take of each function on facets (q,), and integrals of the functions."""
    W: list[Any] = [[0.0] * 3 for _ in range(3)]
    for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
        along, N = _tangent(nodes, float(place)), _functions(float(place))
        measure = (along[0] * along[0] + along[1] * along[1]) ** 0.5 * float(weight)
        for i in range(3):
            W[i] = [W[i][j] + measure * (N[i] * N[j]) for j in range(3)]
    lumped = [row[0] + row[1] + row[2] for row in W]
    minors = [[_minor(W, i, j) for j in range(3)] for i in range(3)]
    determinant = sum((W[0][j] * minors[0][j] for j in (1, 2)), W[0][0] * minors[0][0])
    return [[lumped[j] * minors[j][i] / determinant for i in range(3)] for j in range(3)], lumped


def _minor(W: Any, i: int, j: int) -> Any:  # noqa: ANN401
    """Entry of the adjugate of a symmetric matrix, with its sign."""
    (a, b), (c, d) = ([k % 3 for k in (of + 1, of + 2)] for of in (i, j))
    return W[a][c] * W[b][d] - W[a][d] * W[b][c]


class DualQuadraticProblem:
    """Standard elements in place of `ContactProblem.of_residual`, for one pair of bodies."""

    def __init__(
        self,
        residual: Any,  # noqa: ANN401
        u: Any,  # noqa: ANN401
        conditions: Any,  # noqa: ANN401
        pair: ContactPair,
        sides: tuple[Trace, Trace],
        told: Callable[[Any], None],
    ) -> None:
        problem = PetrovGalerkinProblem(residual, u, conditions, Direct())
        u.x.array[:] = 0.0
        problem.system.assemble_tangent()
        reduction = Reduction.dirichlet(u.function_space, conditions)
        self._steps = LargeStrainStepping(
            problem,
            conditions,
            reduction,
            [pair],
            max_iterations=25,
            callback=told,
            solver=Direct(),
        )
        interface = self._steps.interface
        interface.mortars = {0: DualQuadratic(*sides)}
        self.undeformed = make_undeformed_state(interface, problem.system.tangent.createVecRight())

    def step(self, state: ContactState, load: Callable[[float], None]) -> ContactState:
        """The state at the end of an increment."""
        return self._steps.step(state, load, [None])
