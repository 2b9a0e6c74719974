"""Symmetric sibling: the standard quadratic element in a basis whose nodal forces are even.

With T of `force_transfer`, the basis functions are T N, and the unknowns are coefficients a of the
displacements u = T^T a: see the guide's page on theory ("The symmetric sibling").
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction, is_finite
from pw_elements.checks import (
    arguments,
    check_same_arguments,
    collective_errors,
    format_points,
    vector_sizes,
)
from pw_elements.elasticity.forces import transposed_transfer
from pw_elements.solvers import to_aij
from pw_elements.spaces import AssemblyRecord

# Sum of a node's positive coefficients at unprescribed nodes that is round-off
_COEFFICIENT_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Sibling:
    """Standard element of a space in the basis that T defines: symmetric, with even forces.

        sibling = Sibling.from_space(U)
        K, f = sibling.matrix(K_standard), sibling.load(f_standard)
        a = solve(K, f, sibling.dirichlet(conditions))
        u = sibling.displacement(a)
        M = lumped_mass(sibling.matrix(M_standard), U)

    The row sums of T M T^T, which `lumped_mass` takes, are integrals of density times basis
    function (A/12 and A/4 on a triangle, V/40 and 3V/20 on a tetrahedron), so that a uniform body
    force accelerates all nodes alike.

    Contact recognises the K that `matrix` returns: `solve_contact`, `ContactProblem` and
    `solve_impact` then apply the law to the coefficients, with the gaps T^-T g, so that the nodes
    of closed edges lie exactly on the surface. Displacements in their states are coefficients, too.

    Args:
        space: quadratic Lagrange trial space, on any cell.
        basis: T^T, (n, n).
        inverse: T^-T, (n, n); it gives a mid-side node 4/3 of the node's displacement less 1/6 of
            each vertex' displacement.
    """

    space: fem.FunctionSpace
    basis: PETSc.Mat
    inverse: PETSc.Mat

    @classmethod
    @check_same_arguments
    def from_space(cls, space: fem.FunctionSpace) -> "Sibling":
        """Create the sibling of a quadratic Lagrange space.

        Args:
            space: quadratic Lagrange trial space, on any cell.

        Raises:
            ValueError: for another space, see `force_transfer`.
        """
        return cls(space, transposed_transfer(space), transposed_transfer(space, inverse=True))

    @check_same_arguments
    def matrix(self, standard: PETSc.Mat) -> PETSc.Mat:
        """Transform the standard element's stiffness or mass A (n, n) to T A T^T.

        Args:
            standard: A, (n, n), of the standard element.

        Raises:
            TypeError, ValueError: if A is not a matrix of the space, or has another test space.
        """
        with collective_errors(self.space.mesh.comm):
            arguments.check_matrix("the matrix", standard, "the space", vector_sizes(self.space))
            self._check_standard("the matrix", standard)
        record = replace(AssemblyRecord.read(standard), sibling=self)
        return record.attach(to_aij(standard).ptap(self.basis))

    @check_same_arguments
    def load(self, standard: PETSc.Vec) -> PETSc.Vec:
        """Transform the standard element's load, or other nodal forces, f (n,) to T f.

        Args:
            standard: f, (n,), of the standard element.

        Raises:
            TypeError, ValueError: if f is not a finite vector of the space, or has another test
                space.
        """
        self._check_vector("the load", standard)
        load = self.basis.createVecRight()
        self.basis.multTranspose(standard, load)
        return replace(AssemblyRecord.read(standard), sibling=self).attach(load)

    @check_same_arguments
    def displacement(self, coefficients: PETSc.Vec) -> PETSc.Vec:
        """Compute the displacements u = T^T a, (n,).

        Args:
            coefficients: a, (n,).

        Raises:
            TypeError, ValueError: if a is not a finite vector of the space.
        """
        self._check_vector("the coefficients", coefficients)
        return self.basis * coefficients

    @check_same_arguments
    def coefficients(self, displacement: PETSc.Vec) -> PETSc.Vec:
        """Compute the coefficients a = T^-T u, (n,), of displacements or velocities.

        Args:
            displacement: u, (n,), or a velocity.

        Raises:
            TypeError, ValueError: if u is not a finite vector of the space.
        """
        self._check_vector("the displacement", displacement)
        return self.inverse * displacement

    @check_same_arguments
    def dirichlet(self, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]) -> Reduction:
        """Create the reduction that prescribes coefficients in place of displacements.

        Args:
            conditions: on displacements, made on the space.

        Raises:
            TypeError, ValueError: in the same cases as `Reduction.dirichlet`, and if a node is
                prescribed, but not a neighbour on whose displacement its coefficient depends.
        """
        standard = Reduction.dirichlet(self.space, conditions)
        free = standard.right.getRowSum()
        free_part = (self.basis * free).array_r * (1 - free.array_r)
        dim, block = self.space.mesh.geometry.dim, self.space.dofmap.index_map_bs
        nodes = np.unique(np.flatnonzero(free_part > _COEFFICIENT_ROUND_OFF) // block)
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

    def _check_vector(self, name: str, vector: PETSc.Vec) -> None:
        with collective_errors(self.space.mesh.comm):
            arguments.check_petsc_vector(name, vector, "the space", self.space)
            self._check_standard(name, vector)
        if not is_finite(vector):
            raise ValueError(f"{name} is not finite")

    def _check_standard(self, name: str, tensor: PETSc.Mat | PETSc.Vec) -> None:
        """Raise ValueError unless a matrix or vector belongs to the standard element; local."""
        record, element = AssemblyRecord.read(tensor), self.space._cpp_object.element
        if record.test_space is not None and record.test_space.element != element:
            raise ValueError(
                f"{name} was made with other weight functions than the standard element's: the "
                "sibling transforms what Spaces.galerkin gives"
            )
        if record.sibling is not None:
            raise ValueError(f"{name} belongs to the sibling already")
