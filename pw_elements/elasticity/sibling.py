"""The symmetric sibling: the standard quadratic element in a basis whose nodal forces are even.

With T of `force_transfer`, the basis has functions T N, and unknowns are coefficients a of
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

# A sum of positive shares below this, over one, is none
_NO_SHARE = 1e-9


@dataclass(frozen=True)
class Sibling:
    """The standard element of a space in the basis that T defines: symmetric, with even forces.

        sibling = Sibling.from_space(U)
        K, f = sibling.matrix(K_standard), sibling.load(f_standard)
        a = solve(K, f, sibling.dirichlet(conditions))
        u = sibling.displacement(a)
        M = lumped_mass(sibling.matrix(M_standard), U)

    The row sums of T M T^T, which `lumped_mass` takes, are integrals of density times the basis'
    own functions (A/12 and A/4 on a triangle, V/40 and 3V/20 on a tetrahedron), so that under a
    uniform body force all nodes are accelerated alike.

    Contact recognises the K that `matrix` makes: `solve_contact`, `ContactProblem` and
    `solve_impact` then state the law for the coefficients, with the gaps T^-T g, so that the nodes
    of closed edges lie exactly on the surface. Displacements in their states are coefficients, too.

    Args:
        space: quadratic Lagrange trial space, of any cell.
        basis: T^T, (n, n).
        inverse: T^-T, (n, n); of a mid-side node, 4/3 of its own displacement less 1/6 of either
            vertex'.
    """

    space: fem.FunctionSpace
    basis: PETSc.Mat
    inverse: PETSc.Mat

    @classmethod
    @check_same_arguments
    def from_space(cls, space: fem.FunctionSpace) -> "Sibling":
        """The sibling of a quadratic Lagrange space.

        Args:
            space: quadratic Lagrange trial space, of any cell.

        Raises:
            ValueError: for another space, see `force_transfer`.
        """
        return cls(space, transposed_transfer(space), transposed_transfer(space, inverse=True))

    @check_same_arguments
    def matrix(self, standard: PETSc.Mat) -> PETSc.Mat:
        """T A T^T of the standard element's stiffness or mass A (n, n).

        Args:
            standard: A, (n, n), of the standard element.

        Raises:
            TypeError, ValueError: if it is not a matrix of the space, or has another test space.
        """
        with collective_errors(self.space.mesh.comm):
            arguments.check_matrix("the matrix", standard, "the space", vector_sizes(self.space))
            self._check("the matrix", standard)
        known = replace(AssemblyRecord.read(standard), sibling=self)
        return known.attach(to_aij(standard).ptap(self.basis))

    @check_same_arguments
    def load(self, standard: PETSc.Vec) -> PETSc.Vec:
        """T f of the standard element's load, or of any nodal forces, f (n,).

        Args:
            standard: f, (n,), of the standard element.

        Raises:
            TypeError, ValueError: if it is not a finite vector of the space, or has another test
                space.
        """
        self._check_vector("the load", standard)
        load = self.basis.createVecRight()
        self.basis.multTranspose(standard, load)
        return replace(AssemblyRecord.read(standard), sibling=self).attach(load)

    @check_same_arguments
    def displacement(self, coefficients: PETSc.Vec) -> PETSc.Vec:
        """Displacements u = T^T a, (n,).

        Args:
            coefficients: a, (n,).

        Raises:
            TypeError, ValueError: if it is not a finite vector of the space.
        """
        self._check_vector("the coefficients", coefficients)
        return self.basis * coefficients

    @check_same_arguments
    def coefficients(self, displacement: PETSc.Vec) -> PETSc.Vec:
        """Coefficients a = T^-T u, (n,), of displacements or velocities.

        Args:
            displacement: u, (n,), or a velocity.

        Raises:
            TypeError, ValueError: if it is not a finite vector of the space.
        """
        self._check_vector("the displacement", displacement)
        return self.inverse * displacement

    @check_same_arguments
    def dirichlet(self, conditions: fem.DirichletBC | Sequence[fem.DirichletBC]) -> Reduction:
        """Supports that prescribe coefficients in place of displacements.

        Args:
            conditions: on displacements, made on the space.

        Raises:
            TypeError, ValueError: as `Reduction.dirichlet`, and for a node that is prescribed while
                a vertex (or mid-side) next to it, on which its coefficient depends, is not.
        """
        standard = Reduction.dirichlet(self.space, conditions)
        free = standard.right.getRowSum()
        lacking = (self.basis * free).array_r * (1 - free.array_r) > _NO_SHARE
        dim, block = self.space.mesh.geometry.dim, self.space.dofmap.index_map_bs
        nodes = np.unique(np.flatnonzero(lacking) // block)
        places = self.space.tabulate_dof_coordinates()[nodes, :dim]
        places = np.concatenate(self.space.mesh.comm.allgather(places))
        if len(places):
            raise ValueError(
                f"the nodes at {format_points(places)} have a prescribed displacement, but not all "
                "nodes on which their coefficients depend: prescribe whole edges"
            )
        offset = self.inverse * standard.offset
        offset.setArray(offset.array_r * (1 - free.array_r))
        return replace(standard, offset=offset)

    def _check_vector(self, name: str, vector: PETSc.Vec) -> None:
        with collective_errors(self.space.mesh.comm):
            arguments.check_petsc_vector(name, vector, "the space", self.space)
            self._check(name, vector)
        if not is_finite(vector):
            raise ValueError(f"{name} is not finite")

    def _check(self, name: str, thing: PETSc.Mat | PETSc.Vec) -> None:
        """Raises ValueError for what is not the standard element's; local."""
        known = AssemblyRecord.read(thing)
        if (
            known.test_space is not None
            and known.test_space.element != self.space._cpp_object.element
        ):
            raise ValueError(
                f"{name} was made with other weight functions than the standard element's: the "
                "sibling transforms what Spaces.galerkin gives"
            )
        if known.sibling is not None:
            raise ValueError(f"{name} belongs to the sibling already")
