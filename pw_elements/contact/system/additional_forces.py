"""Forces at nodes with several contact points, as unknowns of the contact system.

A node that belongs to several pairs has one contact point for each of them. Its equations give the
sum of the forces r of its points. The forces of all points except the first one are therefore
unknowns of the system, and the laws of these points are its equations:

    r = F a - L f    at points whose node has no other point,
    r = s            at additional points, with the unknowns s,
    r = F a - L f - sum of s    at first points.

The unknowns and equations of each process follow those of its displacements. An assembled matrix
contains them; for a Krylov method they are eliminated node by node (`AdditionalForceElimination`).
"""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.contact.interface import SharedNodes
from pw_elements.contact.nodes import LinearisedContactLaw
from pw_elements.contact.system.assembled import extract_local_rows
from pw_elements.solvers import SingularSystem

# Singular value, relative to the largest one of its node, below which the law does not determine
# the forces of the points of a node
_MIN_RELATIVE_SINGULAR_VALUE = 1e-12
# Smallest singular value of the sum of force and motion coefficients at which the equations of a
# node are divided by this sum
_MIN_SINGULAR_VALUE_TO_NORMALISE = 1e-6


class AdditionalForces:
    """Numbers and matrices of the unknown forces at additional points.

    Args:
        shared_nodes: contact points (m) grouped by node.
        equations: local numbers (m, dim) of the equations of the points' nodes, -1 for components
            without an equation.
        stiffness: reduced stiffness (n, n).

    Attributes:
        n_local: number of unknown forces of this process.
        law_equations: local numbers (m, dim) of the rows in which the laws of the points stand, -1
            for components without an equation.
        first_row: global number of this process' first row.
    """

    def __init__(self, shared_nodes: SharedNodes, equations: Indices, stiffness: PETSc.Mat) -> None:
        comm: MPI.Comm = stiffness.comm.tompi4py()
        self._shared, self._has_equation = shared_nodes, equations >= 0
        self._ranges = np.asarray(stiffness.getOwnershipRanges(), dtype=np.int64)
        is_unknown = self._has_equation & shared_nodes.is_additional[:, None]
        self._components = np.flatnonzero(is_unknown)
        self.n_local = len(self._components)
        counts = comm.allgather(self.n_local)
        self._starts = np.cumsum([0, *counts])
        self._first_unknown = self._starts[comm.rank]
        self.first_row = int(self._ranges[comm.rank] + self._first_unknown)
        self._n_displacements = int(self._ranges[comm.rank + 1] - self._ranges[comm.rank])
        self.law_equations: Indices = equations.copy()
        self.law_equations.ravel()[self._components] = self._n_displacements + np.arange(
            self.n_local
        )
        self._comm = comm

    def convert_to_columns(self, equations: Indices) -> Indices:
        """Return the columns of this process' equations, given by global numbers without forces."""
        return np.where(equations < 0, equations, equations + self._first_unknown)

    def extend_rows(
        self, rows: sp.csr_matrix, force_rows: sp.csr_matrix, opposite_force: PETSc.Mat | None
    ) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Return the rows of the equations and of the points' forces with the unknown forces.

        Args:
            rows: rows (n, n + free) of this process' equations. Empty rows for the equations of the
                unknown forces are appended.
            force_rows: rows (m dim, n + free) of the forces F a, empty at additional points.
            opposite_force: matrix (m dim, n) of the forces on opposite nodes, with opposite sign;
                None if there are none.
        """
        forces_of_points = self._make_map_to_point_forces()
        columns = None
        if opposite_force is not None:
            columns = extract_local_rows(opposite_force.transposeMatMult(forces_of_points), 0)
        rows = self.insert_columns(rows, columns)
        empty = sp.csr_matrix((self.n_local, rows.shape[1]))
        force_columns = extract_local_rows(forces_of_points, 0)
        return sp.vstack([rows, empty], "csr"), self.insert_columns(force_rows, force_columns)

    def _make_map_to_point_forces(self) -> PETSc.Mat:
        """Return the matrix (m dim, s) that takes the unknown forces to forces of the points."""
        (m, dim), unknown = self._has_equation.shape, self._first_unknown + np.arange(self.n_local)
        point, axis = np.divmod(self._components, dim)
        rows = np.concatenate([self._components, dim * self._shared.first_point[point] + axis])
        values = np.repeat([1.0, -1.0], self.n_local)
        matrix = sp.csr_matrix((values, (rows, np.tile(unknown, 2))), (m * dim, self._starts[-1]))
        csr = matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data
        sizes = ((m * dim, PETSc.DETERMINE), (self.n_local, self._starts[-1]))
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=self._comm)

    def insert_columns(
        self, rows: sp.csr_matrix, force_columns: sp.csr_matrix | None = None
    ) -> sp.csr_matrix:
        """Return rows (k, n + free) with the columns (k, s) of the unknown forces inserted.

        Args:
            rows: rows with columns for the n displacements, and for free motions.
            force_columns: columns of the unknown forces; zero if they are not given.
        """
        entries, n = rows.tocoo(), self._ranges[-1]
        rank = np.searchsorted(self._ranges[1:], np.minimum(entries.col, n - 1), side="right")
        shift = np.where(entries.col < n, self._starts[rank], self._starts[-1])
        row, column, value = [entries.row], [entries.col + shift], [entries.data]
        if force_columns is not None:
            forces = force_columns.tocoo()
            owner = np.searchsorted(self._starts[1:], forces.col, side="right")
            row.append(forces.row)
            column.append(self._ranges[owner + 1] + forces.col)
            value.append(forces.data)
        indices = np.concatenate(row), np.concatenate(column)
        shape = rows.shape[0], rows.shape[1] + int(self._starts[-1])
        widened = sp.csr_matrix((np.concatenate(value), indices), shape)
        widened.sort_indices()
        return widened

    def append_to_right_hand_side(self, rhs: Array) -> Array:
        """Return a right-hand side with zeros for the equations of the unknown forces."""
        return np.append(rhs, np.zeros(self.n_local))

    def expand_solution(self, unknowns: Array) -> Array:
        """Return the forces (m, dim) of the additional points; zero at all other points.

        Args:
            unknowns: displacements of this process, followed by its unknown forces.
        """
        force = np.zeros(self._has_equation.shape)
        first = self._n_displacements
        force.ravel()[self._components] = unknowns[first : first + self.n_local]
        return force

    def subtract_from_node_forces(self, node_force: Array, point_force: Array) -> Array:
        """Return the force (m, dim) of each point.

        Args:
            node_force: (m, dim), forces of the nodes at their first points, zero at all others.
            point_force: (m, dim), forces of the points; only those at additional points are used.
        """
        known = np.where(self._has_equation, point_force, 0.0)
        return self._shared.subtract_additional_forces(node_force, known)


@dataclass(frozen=True)
class _NodesOfOneKind:
    """Nodes with the same number k of points and the same d components with equations.

    Args:
        points: (g, k), indices of the points of each node; the first one has the node's equations.
        components: (d,), numbers of the components with equations.
    """

    points: Indices
    components: Indices

    def gather(self, values: Array) -> Array:
        """Return the values (g, k d) of all points of each node, given the values (m, dim)."""
        selected = values[self.points[:, :, None], self.components]
        return selected.reshape(len(self.points), -1)

    def gather_blocks(self, blocks: Array) -> Array:
        """Return the blocks (g, k, d, d) of all points of each node, given all (m, dim, dim)."""
        rows, columns = self.components[:, None], self.components
        return np.asarray(blocks[self.points[:, :, None, None], rows, columns])


@dataclass(frozen=True)
class _EliminatedForces:
    """Matrices that eliminate the additional forces s of g nodes with k points each.

    The laws of the points of a node are S s + (terms without s) = right-hand side.

    Args:
        nodes: the nodes.
        reduction: (g, d, k d), matrix R with R S = 0 that leaves d equations of the node.
        inverse: (g, (k - 1) d, k d), pseudo-inverse of S.
        lift: (g, k d, d), matrix with the property that R lift is the identity and inverse lift is
            zero.
    """

    nodes: _NodesOfOneKind
    reduction: Array
    inverse: Array
    lift: Array


class AdditionalForceElimination:
    """Elimination of the additional forces from the law of an active set.

    The law of all points of a node is

        E_i r_i + C_i v_i - D_i q = c_i,    r_1 = F - sum of s_i,    r_i = s_i (i > 1),

    with the sum F of the forces of its points. The left null space of the coefficients of s leaves
    as many equations as the node has components. They are scaled like the law of a single point, so
    that the sum of the coefficients of F and of v, divided by `law_scale`, is the identity. The
    other equations give s. Both are exact, and need no communication.

    Args:
        shared_nodes: contact points (m) grouped by node.
        has_equation: mask (m, dim) of the components with an equation.
        law_scale: stiffness (m,) that converts lengths into forces in the law.
        comm: communicator of the points.

    Attributes:
        row_sign: product of the signs of the determinants of all nodes' row transformations.
    """

    def __init__(
        self, shared_nodes: SharedNodes, has_equation: Mask, law_scale: Array, comm: MPI.Comm
    ) -> None:
        self._shared, self._law_scale, self._comm = shared_nodes, law_scale, comm
        points_by_kind: dict[tuple[int, ...], list[Indices]] = {}
        for points in shared_nodes.points_of_each_node:
            kind = (len(points), *has_equation[points[0]].tolist())
            points_by_kind.setdefault(kind, []).append(points)
        self._kinds = [
            _NodesOfOneKind(np.array(points), np.flatnonzero(kind[1:]))
            for kind, points in points_by_kind.items()
        ]
        self._eliminated: list[_EliminatedForces] = []
        self.row_sign = 1

    def set_law(self, law: LinearisedContactLaw) -> Array:
        """Set the linearised law of an active set; collective.

        Args:
            law: linearised law, in which the motions are the displacements (m, dim) of the points.

        Returns:
            Coefficients (m, dim, dim) of the forces in the law, in which the equations of each node
            with several points are those that remain. They stand at its first point and are zero at
            the others.

        Raises:
            SingularSystem: if the law does not determine the forces of all points.
        """
        parts = [self._eliminate(nodes, law) for nodes in self._kinds]
        self._eliminated = [part for part, _, _ in parts if part is not None]
        is_singular = len(self._eliminated) < len(parts)
        if self._comm.allreduce(is_singular, MPI.LOR):
            raise SingularSystem("the forces of nodes in several pairs are not determined")
        sign = int(np.prod([sign for _, _, sign in parts], initial=1.0))
        self.row_sign = self._comm.allreduce(sign, MPI.PROD)
        E = law.E.copy()
        E[self._shared.is_additional] = 0.0
        for nodes, (_, reduced_E, _) in zip(self._kinds, parts, strict=True):
            first = nodes.points[:, 0, None, None]
            E[first, nodes.components[:, None], nodes.components] = reduced_E
        return E

    def _eliminate(
        self, nodes: _NodesOfOneKind, law: LinearisedContactLaw
    ) -> tuple[_EliminatedForces | None, Array, float]:
        """Return the elimination, the coefficients (g, d, d) of F, and the product of the signs.

        The elimination is None if the law does not determine the forces.
        """
        E, C = nodes.gather_blocks(law.E), nodes.gather_blocks(law.C)
        (g, k, d, _), n_forces = E.shape, (E.shape[1] - 1) * E.shape[2]
        if d == 0:
            empty = np.zeros((g, 0, 0))
            return _EliminatedForces(nodes, empty, empty, empty), empty, 1.0
        blocks = np.zeros((g, k, d, k - 1, d))
        blocks[:, 0] = -E[:, 0, :, None, :]
        for point in range(1, k):
            blocks[:, point, :, point - 1] = E[:, point]
        left, sizes, right = np.linalg.svd(blocks.reshape(g, k * d, n_forces))
        if not (sizes[:, -1] > _MIN_RELATIVE_SINGULAR_VALUE * sizes[:, 0]).all():
            return None, np.zeros((g, d, d)), 1.0
        inverse = np.einsum("gji,gj,gkj->gik", right, 1 / sizes, left[:, :, :n_forces])
        lift = left[:, :, n_forces:]
        reduction = np.swapaxes(lift, 1, 2)
        reduced_E = reduction[:, :, :d] @ E[:, 0]
        reduced_C = reduction @ C.reshape(g, k * d, d)
        scale = self._law_scale[nodes.points[:, 0], None, None]
        total = reduced_E + reduced_C / scale
        is_regular = (
            np.linalg.svd(total, compute_uv=False)[:, -1] > _MIN_SINGULAR_VALUE_TO_NORMALISE
        )
        total = np.where(is_regular[:, None, None], total, np.eye(d))
        reduction, lift = np.linalg.solve(total, reduction), lift @ total
        transform = np.concatenate([reduction, inverse], axis=1)
        sign = float(np.prod(np.linalg.slogdet(transform)[0]))
        eliminated = _EliminatedForces(nodes, reduction, inverse, lift)
        return eliminated, np.asarray(np.linalg.solve(total, reduced_E)), sign

    def reduce_law_values(self, law_values: Array) -> Array:
        """Return the values (m, dim) of the remaining equations, given those of all points."""
        values = np.where(self._shared.is_additional[:, None], 0.0, law_values)
        for part in self._eliminated:
            reduced = np.einsum("gij,gj->gi", part.reduction, part.nodes.gather(law_values))
            values[part.nodes.points[:, :1], part.nodes.components] = reduced
        return values

    def lift_law_values(self, reduced_values: Array) -> Array:
        """Return values (m, dim) of all points with the given remaining values, and s = 0."""
        values = reduced_values.copy()
        for part in self._eliminated:
            points, components = part.nodes.points, part.nodes.components
            first = reduced_values[points[:, :1], components]
            lifted = np.einsum("gij,gj->gi", part.lift, first)
            shape = len(points), points.shape[1], len(components)
            values[points[:, :, None], components] = lifted.reshape(shape)
        return values

    def compute_force_changes(self, law_values: Array) -> Array:
        """Return the changes (m, dim) of the points' forces by which the laws get given values."""
        force = np.zeros_like(law_values)
        for part in self._eliminated:
            points, components = part.nodes.points, part.nodes.components
            s = np.einsum("gij,gj->gi", part.inverse, part.nodes.gather(law_values))
            s = s.reshape(len(points), points.shape[1] - 1, len(components))
            force[points[:, 1:, None], components] = s
            force[points[:, :1], components] = -s.sum(axis=1)
        return force

    def transpose_force_changes(self, weights: Array) -> Array:
        """Return weights (m, dim) of the law values, given those of the force changes.

        It is the transpose of `compute_force_changes`.
        """
        values = np.zeros_like(weights)
        for part in self._eliminated:
            points, components = part.nodes.points, part.nodes.components
            at_points = weights[points[:, :, None], components]
            s_weights = (at_points[:, 1:] - at_points[:, :1]).reshape(len(points), -1)
            law_weights = np.einsum("gij,gi->gj", part.inverse, s_weights)
            shape = len(points), points.shape[1], len(components)
            values[points[:, :, None], components] = law_weights.reshape(shape)
        return values
