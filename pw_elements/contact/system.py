"""The linear system of one active set: E K + C, bordered by free surface translations.

K is reduced by the supports once. E combines the equations of each contact node, C adds its
constraints on displacements; all other rows stay as they are. The nonzero pattern is that
of all active sets, so the matrix is built once, and MUMPS analyses it once.
"""

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from pw_elements.algebra import Reduction
from pw_elements.contact.pairs import ContactNodes
from pw_elements.contact.rows import ContactRows
from pw_elements.contact.tangent import TangentSolver

Array = npt.NDArray[np.float64]

# What does not count as different
_SAME = 1e-12


class ContactSystem:
    """Equations of the reduced displacements and of the free translations.

    The free translations come last, on the last process. Their equations say that the
    contact forces of a pair add up to the given total in that direction.

    Args:
        K: free stiffness, (n, n).
        reduction: supports.
        nodes: contact nodes.
        free: (pair, component) of each free translation.

    Attributes:
        stiffness: L^T K R.
        matrix: of the last active set.
        own_factors: whether the last solution is by factors of its own matrix. With others its
            error is small against all displacements, but perhaps not against a single gap.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        nodes: ContactNodes,
        free: Sequence[tuple[int, int]],
    ) -> None:
        self.reduction, self.nodes, self.free = reduction, nodes, list(free)
        self.stiffness = reduction.matrix(K)
        self.comm: MPI.Comm = nodes.comm
        first, last = self.stiffness.getOwnershipRange()
        self._own = last - first
        self._holds_border = self.comm.rank == self.comm.size - 1
        self._row = np.where(nodes.column < 0, -1, nodes.column - first)
        outside = (self._row < -1) | (self._row >= self._own)
        if self.comm.allreduce(int(outside.any()), MPI.MAX):
            raise ValueError("the reduction moves a contact node to another process")
        local = self._rows_of_stiffness()
        self._contact = ContactRows(local, self._row, nodes.column, self._translation_columns())
        self._pointers = self._contact.compressed(first)
        self.matrix = self._assembled(local)
        self._tangent = TangentSolver(self.matrix)
        self._factorised: Array | None = None  # combinations (n, 3, dim, dim) at that time
        self.own_factors = False

    @property
    def unique(self) -> bool:
        """Whether all tangents factorised so far have determinants of one sign."""
        return len(self._tangent.orientations) <= 1

    def _rows_of_stiffness(self) -> sp.csr_matrix:
        """Owned rows, with empty columns for the free translations."""
        indptr, indices, data = self.stiffness.getValuesCSR()
        columns = self.stiffness.getSize()[1] + len(self.free)
        rows = sp.csr_matrix((data, indices, indptr), shape=(self._own, columns))
        rows.sort_indices()
        return rows

    def _translation_columns(self) -> npt.NDArray[np.int64]:
        """Column (n, dim) of the free translation of each node's surface, -1: prescribed."""
        columns = np.full(self._row.shape, -1, dtype=np.int64)
        for k, (pair, axis) in enumerate(self.free):
            columns[self.nodes.pair == pair, axis] = self.stiffness.getSize()[1] + k
        return columns

    def _assembled(self, K: sp.csr_matrix) -> PETSc.Mat:
        """The matrix with its final pattern; values of the contact rows are set later."""
        border = self._balance(K)
        contact = np.zeros(self._own, dtype=bool)
        contact[self._contact.row] = True
        counts = np.diff(K.indptr)
        counts[contact] = np.bincount(self._contact.row, minlength=self._own)[contact]
        counts = np.concatenate([counts, np.diff(border.indptr)])
        fixed = np.repeat(np.concatenate([~contact, np.ones(border.shape[0], bool)]), counts)
        kept = np.repeat(~contact, np.diff(K.indptr))

        indptr = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
        indices, data = np.empty(indptr[-1], dtype=PETSc.IntType), np.zeros(indptr[-1])
        indices[fixed] = np.concatenate([K.indices[kept], border.indices])
        indices[~fixed] = self._contact.column
        data[fixed] = np.concatenate([K.data[kept], border.data])
        sizes = (len(counts), K.shape[1])
        return PETSc.Mat().createAIJ((sizes, sizes), csr=(indptr, indices, data), comm=self.comm)

    def _balance(self, K: sp.csr_matrix) -> sp.csr_matrix:
        """Equations of the free translations: sums of a pair's rows, and a diagonal of zeros.

        There are none on all processes but the last.
        """
        select = sp.lil_matrix((len(self.free), self._own))
        for k, (pair, axis) in enumerate(self.free):
            row = self._row[self.nodes.pair == pair, axis]
            select[k, row[row >= 0]] = 1.0
        parts = self.comm.gather(sp.csr_matrix(select) @ K, root=self.comm.size - 1)
        if parts is None:
            return sp.csr_matrix((0, K.shape[1]))
        total = sum(parts[1:], start=parts[0]).tocoo()
        own = np.arange(len(self.free))
        row = np.concatenate([total.row, own])
        column = np.concatenate([total.col, K.shape[1] - len(own) + own])
        data = np.append(total.data, np.zeros(len(own)))
        balance = sp.csr_matrix((data, (row, column)), total.shape)
        balance.sort_indices()
        return balance

    def stiffness_scale(self) -> Array:
        """Mean stiffness diagonal (n,) of the free components of each contact node, or 1."""
        diagonal = self.at_nodes(self.stiffness.getDiagonal().array_r)
        count = np.sum(self._row >= 0, axis=1)
        return np.where(count > 0, diagonal.sum(axis=1) / np.maximum(count, 1), 1.0)

    def at_nodes(self, reduced: Array) -> Array:
        """Values (n, dim) of a reduced local array at the contact nodes; 0 where prescribed."""
        return np.where(self._row >= 0, reduced[self._row], 0.0)

    def elsewhere(self, reduced: Array) -> float:
        """Largest entry, on this process, of a reduced local array outside the contact nodes."""
        rest = np.abs(reduced)
        rest[self._row[self._row >= 0]] = 0.0
        return float(rest.max(initial=0.0))

    def solve(
        self,
        load: PETSc.Vec,
        E: Array,
        C: Array,
        D: Array,
        constraint: Array,
        totals: Array,
    ) -> tuple[PETSc.Vec, Array]:
        """Solves E r + C a - D U = constraint with r = K a - load at every contact node.

        Args:
            load: reduced load.
            E: (n, dim, dim), combines a node's forces.
            C: (n, dim, dim), combines its displacements.
            D: (n, dim, dim), combines the free translations of its surface.
            constraint: (n, dim), prescribed translations included.
            totals: total forces, one per free translation.

        Returns:
            Reduced displacements, and the free translations on every process.

        Raises:
            SingularSystem: if there is no unique solution.
        """
        pointers, columns, rows = self._pointers
        values = self._contact.values(E, C, D)
        self.matrix.setValuesIJV(pointers, columns, values, rowmap=rows)
        self.matrix.assemble()

        right = self.matrix.createVecRight()
        f = load.array_r
        local = right.array
        local[: len(f)] = f
        node, component = np.nonzero(self._row >= 0)
        mixed = np.einsum("nab,nb->na", E, self.at_nodes(f)) + constraint
        local[self._row[node, component]] = mixed[node, component]
        loads = self.totals(self.at_nodes(f))
        if self._holds_border:
            local[len(f) :] = totals + loads
        del local
        solution = self._solution(right, np.stack([E, C, D], axis=1))
        free = self.comm.bcast(
            solution.array_r[len(f) :] if self._holds_border else None, root=self.comm.size - 1
        )
        reduced = load.duplicate()
        reduced.setArray(solution.array_r[: len(f)])
        return reduced, np.array(free)

    def totals(self, forces: Array) -> Array:
        """Sums of nodal forces (n, dim) over all processes, one per free translation."""
        nodes = self.nodes
        sums = np.array([forces[nodes.pair == pair, axis].sum() for pair, axis in self.free])
        self.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return sums

    def _solution(self, right: PETSc.Vec, combinations: Array) -> PETSc.Vec:
        """Solution for the nodes' combinations (n, 3, dim, dim) that are in the matrix.

        A few rows that differ from those of the last factorisation are cheaper to correct.
        """
        if self._factorised is not None:  # no process differs in this
            size = np.abs(self._factorised).max(axis=(0, 2, 3), keepdims=True, initial=0.0)
            change = np.abs(combinations - self._factorised) > _SAME * size
            rows = self.comm.allreduce(int(np.sum(change.any(axis=(1, 3)))), MPI.SUM)
            solution = self._tangent.solve_as_changed(right, rows)
            if solution is not None:
                self.own_factors = False
                return solution
        solution = self._tangent.solve(right)
        self._factorised, self.own_factors = combinations, True
        return solution

    def forget_factors(self) -> None:
        """Has the next matrix factorised, whatever it is."""
        self._factorised = None
