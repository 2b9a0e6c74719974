"""Symmetric sibling: the standard quadratic element in a basis that makes nodal forces even.

Let N be the shape functions of the standard element and T the matrix of `force_transfer`. The basis
functions of the sibling are T N. Its unknowns are coefficients a; the nodal displacements are
u = T^T a. See the guide's page on theory, "The symmetric sibling".
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction, is_finite
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    count_local_and_global_dofs,
    format_points,
    raise_errors_on_all_processes,
)
from pw_elements.elasticity.forces import transposed_force_transfer
from pw_elements.solvers import to_aij
from pw_elements.spaces import read_record

# Largest sum of the weights of unprescribed nodes in a coefficient that may be due to round-off
_MAX_ROUND_OFF_OF_FREE_NODE_WEIGHT_SUM = 1e-9


@dataclass(frozen=True)
class Sibling:
    """Standard quadratic element in a basis that makes its nodal forces even; it is symmetric.

    Let T be the matrix of `force_transfer`. The unknowns are coefficients a instead of the nodal
    displacements u = T^T a.

        sibling = Sibling.from_space(U)
        K, f = sibling.matrix(K_standard), sibling.load(f_standard)
        a = solve(K, f, sibling.dirichlet(conditions))
        u = sibling.displacement(a)
        M = lumped_mass(sibling.matrix(M_standard), U)

    Given the transformed mass matrix T M_standard T^T, `lumped_mass` computes its row sums, which
    are the integrals of density times basis function. For density 1, they are A/12 at vertices and
    A/4 at mid-side nodes of a triangle of area A, and V/40 at vertices and 3V/20 at mid-side nodes
    of a tetrahedron of volume V. A uniform body force therefore accelerates all nodes equally.

    Contact functions recognise a stiffness that `matrix` has returned. `solve_contact`,
    `ContactProblem` and `solve_impact` then apply the contact law to the coefficients, with the
    gaps T^-T g instead of the nodal gaps g. As a result, the nodes of closed edges lie exactly on
    the opposite surface. The displacements in the resulting states are coefficients.

    Args:
        space: quadratic Lagrange trial space, on any type of cell.
        basis: transposed transfer matrix T^T, (n, n).
        inverse: inverse T^-T, (n, n), of `basis`. The coefficient of a mid-side node is 4/3 of the
            node's displacement minus 1/6 of the displacement of each vertex.
    """

    space: fem.FunctionSpace
    basis: PETSc.Mat
    inverse: PETSc.Mat

    @classmethod
    @check_same_arguments_on_all_processes
    def from_space(cls, space: fem.FunctionSpace) -> "Sibling":
        """Create the sibling of a quadratic Lagrange space.

        Args:
            space: quadratic Lagrange trial space, on any type of cell.

        Raises:
            ValueError: for any other space, as in `force_transfer`.
        """
        return cls(
            space, transposed_force_transfer(space), transposed_force_transfer(space, inverse=True)
        )

    @check_same_arguments_on_all_processes
    def matrix(self, standard_matrix: PETSc.Mat) -> PETSc.Mat:
        """Transform a stiffness or mass matrix A of the standard element to T A T^T.

        T is the matrix of `force_transfer`.

        Args:
            standard_matrix: stiffness or mass matrix A (n, n) of the standard element.

        Raises:
            TypeError, ValueError: if A is not a matrix of the space, or was not assembled with the
                test functions of the standard element.
        """
        with raise_errors_on_all_processes(self.space.mesh.comm):
            arguments.check_assembled_square_matrix(
                "the matrix", standard_matrix, "the space", count_local_and_global_dofs(self.space)
            )
            self._check_made_by_standard_element("the matrix", standard_matrix)
        record = replace(read_record(standard_matrix), sibling=self)
        return record.attach(to_aij(standard_matrix).ptap(self.basis))

    @check_same_arguments_on_all_processes
    def load(self, standard_load: PETSc.Vec) -> PETSc.Vec:
        """Transform a load vector f, assembled with the standard element, to T f.

        T is the matrix of `force_transfer`. Other nodal forces are transformed in the same way.

        Args:
            standard_load: load vector or nodal forces f (n,) of the standard element.

        Raises:
            TypeError, ValueError: if f is not a finite vector of the space, or was not assembled
                with the test functions of the standard element.
        """
        self._check_finite_vector_of_standard_element("the load", standard_load)
        load = self.basis.createVecRight()
        self.basis.multTranspose(standard_load, load)
        return replace(read_record(standard_load), sibling=self).attach(load)

    @check_same_arguments_on_all_processes
    def displacement(self, coefficients: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal displacements u = T^T a, (n,), from coefficients a.

        T is the matrix of `force_transfer`.

        Args:
            coefficients: vector a (n,) of the sibling's unknowns.

        Raises:
            TypeError, ValueError: if a is not a finite vector of the space.
        """
        self._check_finite_vector_of_standard_element("the coefficients", coefficients)
        return self.basis * coefficients

    @check_same_arguments_on_all_processes
    def coefficients(self, displacement: PETSc.Vec) -> PETSc.Vec:
        """Compute the coefficients a = T^-T u, (n,), from nodal displacements or velocities u.

        T is the matrix of `force_transfer`.

        Args:
            displacement: vector u (n,) of nodal displacements or velocities.

        Raises:
            TypeError, ValueError: if u is not a finite vector of the space.
        """
        self._check_finite_vector_of_standard_element("the displacement", displacement)
        return self.inverse * displacement

    @check_same_arguments_on_all_processes
    def dirichlet(self, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]) -> Reduction:
        """Create the reduction that prescribes coefficients instead of displacements.

        Args:
            conditions: boundary conditions on displacements of the space.

        Raises:
            TypeError, ValueError: in the same cases as `Reduction.dirichlet`, and if the
                displacement of a node is prescribed but its coefficient also depends on a node
                whose displacement is not prescribed.
        """
        standard = Reduction.dirichlet(self.space, conditions)
        free = standard.right.getRowSum()
        free_part = (self.basis * free).array_r * (1 - free.array_r)
        dim, block = self.space.mesh.geometry.dim, self.space.dofmap.index_map_bs
        nodes = np.unique(
            np.flatnonzero(free_part > _MAX_ROUND_OFF_OF_FREE_NODE_WEIGHT_SUM) // block
        )
        x = self.space.tabulate_dof_coordinates()[nodes, :dim]
        x = np.concatenate(self.space.mesh.comm.allgather(x))
        if len(x):
            raise ValueError(
                f"the nodes at {format_points(x)} have a prescribed displacement, but not all "
                "nodes on which their coefficients depend: prescribe whole edges"
            )
        offset = self.inverse * standard.offset
        offset.setArray(offset.array_r * (1 - free.array_r))
        return replace(standard, offset=offset)

    def _check_finite_vector_of_standard_element(self, name: str, vector: PETSc.Vec) -> None:
        with raise_errors_on_all_processes(self.space.mesh.comm):
            arguments.check_petsc_vector(name, vector, "the space", self.space)
            self._check_made_by_standard_element(name, vector)
        if not is_finite(vector):
            raise ValueError(f"{name} is not finite")

    def _check_made_by_standard_element(self, name: str, tensor: PETSc.Mat | PETSc.Vec) -> None:
        """Raise ValueError on this process if an object does not belong to the standard element.

        Args:
            name: name of the object, used in error messages.
            tensor: matrix or vector to be checked.
        """
        record, element = read_record(tensor), self.space._cpp_object.element
        if record.test_space is not None and record.test_space.element != element:
            raise ValueError(
                f"{name} was made with other weight functions than the standard element's: the "
                "sibling transforms what Spaces.galerkin gives"
            )
        if record.sibling is not None:
            raise ValueError(f"{name} belongs to the sibling already")
