"""Large sliding of standard quadratic elements with dual quadratic Lagrange multipliers.

This is the usual mortar method for large sliding of two bodies by A. Popp, B. Wohlmuth, M. Gee and
W. Wall (https://doi.org/10.1137/110848190), with curved sides, integration over segments, and a
consistent tangent. With the standard test functions N, their dual functions psi on each slave
facet, and A_j = integral of N_j, the gap of slave node j is

    n_j·(x_j - sum of P_jk x_k),      P_jk = integral of psi_j N_k / A_j,

and the fraction P_jk of its force acts on the master node k. A facet that only partly faces the
master is left out, because the dual functions on a part of a facet would give nodes without area.

The coordinate on a slave facet is t in [-1, 1], that on a master facet is s in [-1, 1]. Values with
derivatives are of the type `AutoDiffArray` (automatic differentiation).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from pw_elements import Direct, PetrovGalerkinProblem, Reduction
from pw_elements.arrays import Array, AutoDiffArray, Indices, stack_values_and_derivatives
from pw_elements.contact import ContactPair
from pw_elements.contact.interface import (
    BoundaryFacets,
    MortarMatrices,
    PlaneSlidingMortar,
    SlidingMortar,
)
from pw_elements.contact.interface.mortars.sliding import LinearisedMortar, sum_into_matrix
from pw_elements.contact.iteration import make_undeformed_state
from pw_elements.contact.model import ContactState
from pw_elements.contact.steps.finite import LargeStrainStepping

# Gauss-Legendre rule for products of two quadratic functions on curved facets
QUADRATURE_POINTS, QUADRATURE_WEIGHTS = np.polynomial.legendre.leggauss(4)
N_ROOT_ITERATIONS = 6
"""Number of Newton iterations for the coordinate of a projected point on a facet."""
MIN_COVERED_FRACTION = 1 - 1e-9
"""Fraction of a slave facet that must face the master; otherwise the facet is left out."""
MAX_COORDINATE = 3
"""Largest magnitude of a facet coordinate for which a projection is computed.

Facets with larger coordinates are not opposite.
"""


def _quadratic_shape_functions(t: Any) -> list[Any]:  # noqa: ANN401
    """Return the quadratic shape functions of the nodes at -1, 0 and 1, at coordinates t."""
    return [(t - 1) * t * 0.5, 1 - t * t, (t + 1) * t * 0.5]


def _interpolate_quadratically(nodes: Sequence[Any], t: Any) -> Any:  # noqa: ANN401
    """Interpolate a plane vector field quadratically between three nodes.

    Args:
        nodes: Vectors of the three nodes, each as a pair of components.
        t: Coordinates at which the field is interpolated.

    Returns:
        The two components at these coordinates.
    """
    N = _quadratic_shape_functions(t)
    return [sum((N[i] * nodes[i][axis] for i in (1, 2)), N[0] * nodes[0][axis]) for axis in (0, 1)]


def _cross_product(a: Any, b: Any) -> Any:  # noqa: ANN401
    return a[0] * b[1] - a[1] * b[0]


def _find_root_with_derivatives(
    f: Callable[[Any, Any], Any],
    parameter_values: Any,  # noqa: ANN401
    parameters_with_derivatives: Any,  # noqa: ANN401
    t: Array,
) -> AutoDiffArray:
    """Find the roots of a function by Newton's method, with their derivatives.

    The derivatives follow from the implicit-function theorem.

    Args:
        f: Function of parameters and a coordinate.
        parameter_values: Values of the parameters.
        parameters_with_derivatives: The same parameters with their derivatives.
        t: Start values (q,) of the coordinate.

    Returns:
        Coordinates (q,) at which f vanishes, with derivatives.
    """
    ones = np.ones((len(t), 1))
    for _ in range(N_ROOT_ITERATIONS):
        residual = f(parameter_values, AutoDiffArray(t, ones))
        step = residual.value / residual.derivative[:, 0]
        t = t - np.clip(np.nan_to_num(step), -1.0, 1.0)
    slope = f(parameter_values, AutoDiffArray(t, ones)).derivative
    return AutoDiffArray(t, -f(parameters_with_derivatives, t).derivative / slope)


class DualQuadraticMortar(PlaneSlidingMortar):
    """Mortar integrals of dual quadratic functions on two contact sides in the plane."""

    def __init__(self, slave: BoundaryFacets, master: BoundaryFacets) -> None:
        super().__init__(slave, master, False)
        self._slave_nodes = _join_facet_halves_to_three_nodes(self._slave_facets)
        self._master_nodes = _join_facet_halves_to_three_nodes(self._master_facets)

    def linearise(self, x: Array) -> LinearisedMortar:
        """Return mortar operators and their derivatives at given node positions.

        Args:
            x: Deformed positions (n, 2) of the contact nodes, slave nodes first.
        """
        n, m = len(x), self.n_slave_nodes
        halves = self._find_near_facing_facet_pairs(x)
        slave_facet, master_facet = np.unique(np.stack(halves) // 2, axis=1)
        nodes = np.column_stack(
            [self._facet_nodes_with_neighbours(slave_facet), self._master_nodes[master_facet]]
        )
        low, high = self._project_master_facet_ends_on_slave(x, nodes)
        length = np.maximum(0.0, np.minimum(high, 1.0) - np.maximum(low, -1.0)) / 2
        covered = np.bincount(slave_facet, length, minlength=len(self._slave_nodes))
        is_used = (length > 0) & (covered[slave_facet] > MIN_COVERED_FRACTION)
        nodes, low, high = nodes[is_used], low[is_used], high[is_used]
        positions = _positions_with_derivatives(x, nodes)
        values = [tuple(component.value for component in node) for node in positions]
        start, end = (
            _replace_by_constant_where(
                is_outside,
                facet_end,
                _find_root_with_derivatives(
                    _make_distance_of_master_node_to_normal(node),
                    values,
                    positions,
                    np.clip(t, -1, 1),
                ),
            )
            for node, t, is_outside, facet_end in (
                (7, low, low < -1, -1.0),
                (5, high, high > 1, 1.0),
            )
        )
        slave_nodes, master_nodes = nodes[:, 1:4], nodes[:, 5:]
        columns = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 16)
        dual_coefficients, _ = _dual_coefficients_and_function_integrals(positions[1:4])
        B: list[Any] = [[0.0] * 3 for _ in range(3)]
        for point, weight in zip(QUADRATURE_POINTS, QUADRATURE_WEIGHTS, strict=True):
            t = (start + end) * 0.5 + (end - start) * (0.5 * point)
            s = _find_root_with_derivatives(
                _distance_of_master_point_to_slave_normal,
                [*values, t.value],
                [*positions, t],
                -t.value,
            )
            tangent = _differentiate_quadratic_interpolation(positions[1:4], t)
            measure = (tangent[0] * tangent[0] + tangent[1] * tangent[1]) ** 0.5
            measure = measure * (end - start) * (0.5 * weight)
            N, M = _quadratic_shape_functions(t), _quadratic_shape_functions(s)
            for j in range(3):
                c = dual_coefficients[j]
                psi = (N[0] * c[0] + N[1] * c[1] + N[2] * c[2]) * measure
                B[j] = [B[j][k] + psi * M[k] for k in range(3)]
        stacked = stack_values_and_derivatives([entry for row in B for entry in row])
        coupling, d_coupling = (v.reshape(-1, 3, 3, *v.shape[2:]) for v in stacked)
        covered_facets = np.flatnonzero(covered > MIN_COVERED_FRACTION)
        area, d_area = self._integrate_slave_functions_over_facets(x, covered_facets)
        is_facing = area > 0
        inverse_area = 1 / (area + ~is_facing)
        master_fractions = sp.diags_array(inverse_area) @ sum_into_matrix(
            coupling, slave_nodes[:, :, None], master_nodes[:, None] - m, (m, n - m)
        )

        def differentiate_master_forces(slave_force: Array) -> sp.csr_array:
            scaled = slave_force * inverse_area[:, None]
            row = (2 * (master_nodes - m)[:, :, None] + np.arange(2))[..., None]
            direct = np.einsum("qjx,qjkc->qkxc", scaled[slave_nodes], d_coupling)
            by_area = -np.einsum(
                "qjx,qjk->qkxj",
                scaled[slave_nodes] * inverse_area[slave_nodes][..., None],
                coupling,
            )
            n_rows = 2 * (n - m)
            return sum_into_matrix(direct, row, columns[:, None, None], (n_rows, 2 * n)) + (
                sum_into_matrix(by_area, row, slave_nodes[:, None, None], (n_rows, m)) @ d_area
            )

        slave_part = sp.csr_array((is_facing.astype(float), (np.arange(m), np.arange(m))), (m, m))
        rows = sp.csr_array(sp.hstack([slave_part, -master_fractions]))

        def differentiate_distance_rows_times_positions(fixed_positions: Array) -> sp.csr_array:
            row = (2 * slave_nodes[:, :, None] + np.arange(2))[..., None]
            by_coupling = (
                -np.einsum("qjkc,qkx->qjxc", d_coupling, fixed_positions[master_nodes])
                * inverse_area[slave_nodes][:, :, None, None]
            )
            mean = master_fractions @ fixed_positions[m:] * inverse_area[:, None]
            node = np.arange(m)[:, None]
            return sum_into_matrix(by_coupling, row, columns[:, None, None], (2 * m, 2 * n)) + (
                sum_into_matrix(mean, 2 * node + np.arange(2), node, (2 * m, m)) @ d_area
            )

        d_distance = differentiate_distance_rows_times_positions(x) + sp.kron(rows, sp.eye_array(2))
        return LinearisedMortar(
            is_facing,
            self._differentiate_slave_normals(x),
            rows @ x,
            rows,
            master_fractions,
            sp.csr_array(sp.diags_array(area) @ master_fractions),
            area,
            differentiate_distance_rows_times_positions,
            d_distance,
            differentiate_master_forces,
        )

    def evaluate_mortar_matrices_independently(self, x: Array) -> MortarMatrices:
        """Return the mortar matrices that are used to check states.

        Unlike in the base class, they are evaluated by the same formulas as `linearise`.
        """
        mortar = self.linearise(x)
        return MortarMatrices(
            mortar.normals,
            mortar.areas,
            mortar.distance_rows,
            mortar.master_fractions,
            np.zeros(self.n_slave_nodes),
            self._master_facets,
        )

    def _facet_nodes_with_neighbours(self, facet: Indices) -> Indices:
        """Return the three nodes of slave facets and one adjacent node on each side.

        Args:
            facet: Indices (q,) of slave facets.

        Returns:
            Nodes (q, 5), ordered along the side.
        """
        a, m, b = self._slave_nodes[facet].T
        return np.stack([self._previous_node[a], a, m, b, self._next_node[b]], axis=1)

    def _project_master_facet_ends_on_slave(self, x: Array, nodes: Indices) -> tuple[Array, Array]:
        """Return slave coordinates at which slave normals pass through the master facet's ends.

        Args:
            x: Deformed positions (n, 2) of the contact nodes.
            nodes: Five nodes around a slave facet and three nodes of a master facet, (q, 8).

        Returns:
            Lower and upper slave coordinates (q,) of the segments.
        """
        values = [tuple(x[node].T) for node in nodes.T]
        a, b = x[nodes[:, 1]], x[nodes[:, 3]]
        ends = []
        for node in (7, 5):
            offset = x[nodes[:, node]] - (a + b) / 2
            t = 2 * np.sum(offset * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1)
            is_far = np.abs(t) > MAX_COORDINATE
            root = _find_root_with_derivatives(
                _make_distance_of_master_node_to_normal(node),
                values,
                _positions_with_derivatives(x, nodes),
                np.clip(t, -1.5, 1.5),
            )
            ends.append(np.where(is_far, t, root.value))
        return ends[0], ends[1]

    def _integrate_slave_functions_over_facets(
        self, x: Array, facets: Indices
    ) -> tuple[Array, sp.csr_array]:
        """Integrate the quadratic functions of the slave nodes over facets.

        Args:
            x: Deformed positions (n, 2) of the contact nodes.
            facets: Indices of the slave facets.

        Returns:
            Integrals (m,) of the slave nodes, and their derivatives (m, 2 n) by the positions.
        """
        m, nodes = self.n_slave_nodes, self._slave_nodes[facets]
        columns = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 6)
        _, integrals = _dual_coefficients_and_function_integrals(
            _positions_with_derivatives(x, nodes)
        )
        area, d_area = stack_values_and_derivatives(integrals)
        total = np.bincount(nodes.ravel(), area.ravel(), minlength=m).astype(float)
        return total, sum_into_matrix(d_area, nodes[:, :, None], columns[:, None], (m, x.size))


def _join_facet_halves_to_three_nodes(halves: Indices) -> Indices:
    """Join directed facet halves (2 f, 2) to the first, middle and last nodes (f, 3) of facets."""
    even, odd = halves[::2], halves[1::2]
    is_even_first = (even[:, 1] == odd[:, 0])[:, None]
    first, second = np.where(is_even_first, even, odd), np.where(is_even_first, odd, even)
    return np.column_stack([first, second[:, 1]])


def _positions_with_derivatives(x: Array, nodes: Indices) -> list[Any]:
    """Return node positions as values with derivatives by all positions in the same row.

    Args:
        x: Positions (n, 2) of all nodes.
        nodes: Nodes (q, k).

    Returns:
        For each of the k columns, two components with values (q,) and derivatives (q, 2 k).
    """
    k = nodes.shape[1]
    units = np.eye(2 * k).reshape(k, 2, 1, 2 * k) + np.zeros((len(nodes), 1))
    return [tuple(AutoDiffArray(x[nodes[:, i], a], units[i, a]) for a in (0, 1)) for i in range(k)]


def _replace_by_constant_where(
    is_fixed: Any,  # noqa: ANN401
    value: float,
    numbers: AutoDiffArray,
) -> AutoDiffArray:
    derivative = np.where(is_fixed[:, None], 0.0, numbers.derivative)
    return AutoDiffArray(np.where(is_fixed, value, numbers.value), derivative)


def _interpolate_averaged_nodal_normals(positions: Sequence[Any], t: Any) -> Any:  # noqa: ANN401
    """Interpolate nodal unit normals quadratically between the three nodes of a slave facet.

    The normal of a node is perpendicular to the chord between its two neighbours.

    Args:
        positions: Positions of the five nodes around the facet; further positions are ignored.
        t: Slave coordinates.
    """
    normals = []
    for low, high in ((0, 2), (1, 3), (2, 4)):
        x, y = (positions[high][axis] - positions[low][axis] for axis in (0, 1))
        inverse_length = (x * x + y * y) ** -0.5
        normals.append((-y * inverse_length, x * inverse_length))
    return _interpolate_quadratically(normals, t)


def _make_distance_of_master_node_to_normal(node: int) -> Callable[[Any, Any], Any]:
    """Make a function of t that vanishes where the slave normal at t passes through a master node.

    Args:
        node: Column of the master node in the list of positions.
    """

    def distance(positions: Any, t: Any) -> Any:  # noqa: ANN401
        point = _interpolate_quadratically(positions[1:4], t)
        offset = [point[axis] - positions[node][axis] for axis in (0, 1)]
        return _cross_product(offset, _interpolate_averaged_nodal_normals(positions, t))

    return distance


def _distance_of_master_point_to_slave_normal(parameters: Any, s: Any) -> Any:  # noqa: ANN401
    """Return a value that vanishes where the slave normal at t intersects the master facet.

    Args:
        parameters: Positions of the eight nodes of both facets, followed by the slave coordinate t.
        s: Master coordinates at which the function is evaluated.
    """
    *positions, t = parameters
    slave, master = (
        _interpolate_quadratically(positions[1:4], t),
        _interpolate_quadratically(positions[5:8], s),
    )
    offset = [master[axis] - slave[axis] for axis in (0, 1)]
    return _cross_product(offset, _interpolate_averaged_nodal_normals(positions, t))


def _differentiate_quadratic_interpolation(nodes: Sequence[Any], t: Any) -> list[Any]:  # noqa: ANN401
    dN = (t - 0.5, t * -2.0, t + 0.5)
    return [
        dN[0] * nodes[0][axis] + dN[1] * nodes[1][axis] + dN[2] * nodes[2][axis] for axis in (0, 1)
    ]


def _dual_coefficients_and_function_integrals(
    nodes: Sequence[Any],
) -> tuple[list[list[Any]], list[Any]]:
    """Return coefficients of dual functions on facets, and integrals of quadratic functions.

    Args:
        nodes: Positions of the three nodes of each facet.

    Returns:
        Coefficients (3, 3) of the dual functions with respect to the quadratic functions, and
        integrals (3,) of the quadratic functions; each entry is an array over facets (q,).
    """
    W: list[Any] = [[0.0] * 3 for _ in range(3)]
    for point, weight in zip(QUADRATURE_POINTS, QUADRATURE_WEIGHTS, strict=True):
        tangent, N = (
            _differentiate_quadratic_interpolation(nodes, float(point)),
            _quadratic_shape_functions(float(point)),
        )
        measure = (tangent[0] * tangent[0] + tangent[1] * tangent[1]) ** 0.5 * float(weight)
        for i in range(3):
            W[i] = [W[i][j] + measure * (N[i] * N[j]) for j in range(3)]
    integrals = [row[0] + row[1] + row[2] for row in W]
    adjugate = [[_cofactor_of_symmetric_matrix(W, i, j) for j in range(3)] for i in range(3)]
    determinant = sum((W[0][j] * adjugate[0][j] for j in (1, 2)), W[0][0] * adjugate[0][0])
    coefficients = [
        [integrals[j] * adjugate[j][i] / determinant for i in range(3)] for j in range(3)
    ]
    return coefficients, integrals


def _cofactor_of_symmetric_matrix(W: Any, i: int, j: int) -> Any:  # noqa: ANN401
    """Return the cofactor (i, j) of a symmetric 3 × 3 matrix."""
    (a, b), (c, d) = ([k % 3 for k in (index + 1, index + 2)] for index in (i, j))
    return W[a][c] * W[b][d] - W[a][d] * W[b][c]


class UncheckedMortarContactProblem:
    """Contact problem of pairs of bodies with any element and any mortars.

    It is used like `ContactProblem.of_residual`, which refuses standard elements, because their
    weight functions are not those of the library's mortars.

    Args:
        residual: Weak form of equilibrium.
        u: Unknown displacements.
        supports: Prescribed displacements.
        pairs: Contact pairs.
        mortars: Mortar of each pair's slave and master.
        callback: Function that is called after each iteration.

    Attributes:
        undeformed: Undeformed state.
    """

    def __init__(
        self,
        residual: Any,  # noqa: ANN401
        u: Any,  # noqa: ANN401
        supports: Any,  # noqa: ANN401
        pairs: Sequence[ContactPair],
        mortars: Sequence[SlidingMortar],
        callback: Callable[[Any], None],
    ) -> None:
        problem = PetrovGalerkinProblem(residual, u, supports, Direct())
        u.x.array[:] = 0.0
        problem.system.assemble_tangent()
        reduction = Reduction.dirichlet(u.function_space, supports)
        self._n_pairs = len(pairs)
        self._steps = LargeStrainStepping(
            problem,
            supports,
            reduction,
            pairs,
            max_iterations=25,
            callback=callback,
            solver=Direct(),
        )
        interface = self._steps.interface
        interface.mortars = dict(enumerate(mortars))
        self.undeformed = make_undeformed_state(interface, problem.system.tangent.createVecRight())

    def step(self, state: ContactState, load: Callable[[float], None]) -> ContactState:
        """Solve one increment and return the state at its end.

        Args:
            state: State at the start of the increment.
            load: Function that sets the loads for a load factor between 0 and 1.
        """
        return self._steps.step(state, load, [None] * self._n_pairs)
