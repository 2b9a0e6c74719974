"""Scalar fields, such as a temperature, of which interface laws are functions.

A field has a value at each contact point, and a second one on the other side if that is a body. The
second value is the first one less the averaged jump of the field across the interface, which the
pair computes in the same way as gaps and slips from displacements. Thus a field that is linear and
continuous has equal values on both sides.

The module guarantees values that do not depend on the number of processes. It assumes that fields
have been checked by `ContactPair`.
"""

from collections.abc import Mapping

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from dolfinx import fem
from dolfinx.fem.petsc import interpolation_matrix

from pw_elements._compat import matrix_with_single_entry_rows
from pw_elements.arrays import Array, Indices
from pw_elements.contact.interface.operators import ContactInterface
from pw_elements.spaces import scalar_component_space


class InterfaceFields:
    """Fields of one pair, with their values at the m contact points of this process.

    Args:
        fields: scalar functions, by name.
        interface: contact points of all pairs.
        faces_body: whether the pair faces a body, so that fields have values on both sides.

    Attributes:
        names: names of the fields.
        values: (m, n_fields), values at all contact points of this process: one column for each
            field, followed by one column for each field on the other side if the pair faces a body.
            Only the rows of the pair's own points are meant.
    """

    def __init__(
        self, fields: Mapping[str, fem.Function], interface: ContactInterface, *, faces_body: bool
    ) -> None:
        self.names = list(fields)
        self._functions, self._interface = list(fields.values()), interface
        self._faces_body = faces_body
        nodes = scalar_component_space(interface.field.space)
        self._interpolations = []
        for function in self._functions:
            matrix = interpolation_matrix(function.function_space, nodes)
            matrix.assemble()
            self._interpolations.append(matrix)
        self.read(None)

    @property
    def n_fields(self) -> int:
        """Number of columns of `values`."""
        return len(self.names) * (1 + self._faces_body)

    def read(self, motion: PETSc.Mat | None) -> None:
        """Read the present values of the fields; collective.

        Args:
            motion: matrix (m dim, n) that turns unknowns into displacements of the points relative
                to the other side. If it is None, the other side gets the values of the own side.
        """
        own_columns, other_columns = [], []
        for function, interpolation in zip(self._functions, self._interpolations, strict=True):
            at_nodes = interpolation.createVecRight()
            at_nodes.setArray(function.x.array[: at_nodes.getLocalSize()])
            nodal_values = interpolation * at_nodes
            own = nodal_values.array_r[self._interface.local_node_indices]
            own_columns.append(own)
            if not self._faces_body:
                continue
            other = own.copy()
            if motion is not None:
                unknowns = self._first_component_of_unknowns() * nodal_values
                dim = self._interface.position.shape[1]
                other -= (motion * unknowns).array_r.reshape(-1, dim)[:, 0]
            other_columns.append(other)
        self.values: Array = np.column_stack(own_columns + other_columns)

    def differentiate_values(self, field_index: int, motion: PETSc.Mat) -> list[PETSc.Mat]:
        """Return the derivatives of a field's columns in `values`; collective.

        Each is a matrix (m, n_T) that turns the field's n_T unknowns into its values at the points
        of all pairs, first on the own side, and then on the other side if that is a body.

        Args:
            field_index: index of the field in `names`.
            motion: matrix (m dim, n) as in `read`.
        """
        interface, interpolation = self._interface, self._interpolations[field_index]
        (m, dim), index_map = interface.position.shape, interface.field.space.dofmap.index_map
        own_nodes = self._make_selection(
            interface.node, (index_map.size_local, index_map.size_global)
        )
        own = own_nodes.matMult(interpolation)
        if not self._faces_body:
            return [own]
        first_row, _ = motion.getOwnershipRange()
        first_components = self._make_selection(
            first_row + dim * np.arange(m), motion.getSizes()[0]
        )
        nodal = self._first_component_of_unknowns().matMult(interpolation)
        other = own.copy()
        other.axpy(-1.0, first_components.matMult(motion.matMult(nodal)))
        return [own, other]

    def _first_component_of_unknowns(self) -> PETSc.Mat:
        """Return the matrix (n, nodes) that makes nodal values the first displacement component."""
        interface = self._interface
        index_map, dim = interface.field.space.dofmap.index_map, interface.position.shape[1]
        n, begin = index_map.size_local, index_map.local_range[0]
        rows = sp.csr_matrix(
            (np.ones(n), (dim * np.arange(n), begin + np.arange(n))),
            (n * dim, index_map.size_global),
        )
        matrix = make_distributed_matrix(rows, (n, index_map.size_global), interface.comm)
        field = interface.field
        return (
            matrix if field.is_whole_space else field.extraction_matrix().transposeMatMult(matrix)
        )

    def _make_selection(self, columns: Indices, column_sizes: tuple[int, int]) -> PETSc.Mat:
        """Return the matrix whose rows on this process have a one in the given `columns` (k,)."""
        return matrix_with_single_entry_rows(
            columns, ((len(columns), PETSc.DETERMINE), column_sizes), self._interface.comm
        )


def make_distributed_matrix(
    rows: sp.csr_matrix, column_sizes: tuple[int, int], comm: MPI.Comm
) -> PETSc.Mat:
    """Return the distributed matrix with the given rows on this process; collective.

    Args:
        rows: rows of this process, with global column numbers.
        column_sizes: numbers of columns that belong to this process, and of all columns.
        comm: communicator of the processes.
    """
    csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data)
    sizes = ((rows.shape[0], PETSc.DETERMINE), column_sizes)
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)
