"""Forces at nodes with several contact points, as unknowns of the contact system.

A node that belongs to several pairs has one contact point for each of them. Its equations give the
sum of the forces r of its points. The forces of all points except the first one are therefore
unknowns of the system, and the laws of these points are its equations:

    r = F a - L f    at points whose node has no other point,
    r = s            at additional points, with the unknowns s,
    r = F a - L f - sum of s    at first points.

The unknowns and equations of each process follow those of its displacements.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.arrays import Array, Indices
from pw_elements.contact.interface import SharedNodes
from pw_elements.contact.system.assembled import extract_local_rows


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
