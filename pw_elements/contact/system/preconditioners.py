"""Preconditioners of the contact system, and choice of nodes that anchor free bodies.

The module guarantees the same preconditioner on any number of processes. It assumes contact points
as described by `ContactPointOperators`.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.arrays import Array
from pw_elements.contact.nodes import LinearisedContactLaw
from pw_elements.contact.system.additional_forces import AdditionalForceElimination
from pw_elements.contact.system.unassembled import (
    ContactPointOperators,
    masked_row_mean_or_one,
)
from pw_elements.solvers import (
    ComponentRigidModes,
    add_scaled,
    block_diagonal_matrix,
    destroy_objects,
)

# Smallest number of sticking nodes that hold a connected component without additional anchors
_MIN_STICKING_NODES_WITHOUT_ANCHORS = 6


class SpringPreconditioner:
    """Preconditioner of the contact system of two bodies, as the Python context of a `PETSc.PC`.

    In the preconditioner, springs between the bodies replace contact. The inner preconditioner
    approximates the inverse for the bodies with these springs. Contact forces are computed from the
    law, with an approximate compliance of the contact points (docs/theory.md, "Large systems").

    Args:
        inner: preconditioner of the displacements.
        points: contact points, whose unknowns are displacements alone.
        K: stiffness (n, n) of the displacements.
        elimination: elimination of the additional forces of nodes with several points, or None.
    """

    def __init__(
        self,
        inner: PETSc.PC,
        points: ContactPointOperators,
        K: PETSc.Mat,
        elimination: AdditionalForceElimination | None,
    ) -> None:
        self._inner, self._K, self._elimination = inner, K, elimination
        self._remaining = K.createVecRight()
        self.set_points(points)
        self._ksp = PETSc.KSP().create(K.comm)
        self._ksp.setType("preonly")
        self._ksp.getPC().setType("lu")
        self._ksp.getPC().setFactorSolverType("mumps")

    def set_points(self, points: ContactPointOperators) -> None:
        """Set the operators of the contact points, whose unknowns are displacements alone."""
        self._points = points
        forces_over_stiffness = points.force.copy()
        forces_over_stiffness.diagonalScale(R=1 / self._K.getDiagonal())
        displacements_by_force = forces_over_stiffness.transpose()
        # relative displacements (m dim, m dim), and motions (m p, m dim), due to the point forces
        self._compliance = points.relative_displacement.matMult(displacements_by_force)
        self._motion_compliance = (
            self._compliance
            if points.motion is points.relative_displacement
            else points.motion.matMult(displacements_by_force)
        )
        self._has_equation = has_equation = points.equations >= 0
        point_compliance = self._compliance.getDiagonal().array_r.reshape(has_equation.shape)
        self._spring_stiffness = (
            1 / masked_row_mean_or_one(point_compliance, has_equation)[:, None, None]
        )
        self._law_values, self._force = self._compliance.createVecs()
        self._relative_displacement = self._law_values.duplicate()

    def compute_length_to_force_factors(self, law: LinearisedContactLaw) -> Array:
        """Return the factors (m, dim) that convert rows of the law from lengths to forces.

        The factors depend on the stiffness of the springs between the bodies.
        """
        dim = law.E.shape[1]  # further motions are rotations
        law_size = (
            np.linalg.norm(law.E, axis=2)
            + np.linalg.norm(law.C[:, :, :dim], axis=2) / self._spring_stiffness[:, 0]
        )
        return np.asarray(1 / np.where(law_size > 0, law_size, 1.0))

    def factorise_law_and_assemble_springs(
        self, law: LinearisedContactLaw, held_projectors: Array, anchored_projectors: Array
    ) -> PETSc.Mat:
        """Set up the law of an active set, and return the stiffness (n, n) of the springs.

        Motions in the law are replaced by compliance times force, and the matrix of the resulting
        equations for the forces is set up for factorisation.

        Args:
            law: linearised law of the active set.
            held_projectors: projectors (m, dim, dim) onto the directions that the active set holds.
            anchored_projectors: projectors (m, dim, dim) onto the directions in which springs act:
                the held directions and, at anchor nodes, all directions.
        """
        points, identity = self._points, np.eye(held_projectors.shape[1])
        has_both_equations = self._has_equation[:, :, None] & self._has_equation[:, None, :]
        self._held_stiffness: Array = self._spring_stiffness * held_projectors * has_both_equations
        E = np.where(has_both_equations, law.E, identity)
        is_included = (
            has_both_equations if law.C.shape == law.E.shape else self._has_equation[:, :, None]
        )
        C = np.where(is_included, law.C, 0.0)
        force_law = self._multiply_block_diagonal(C, self._motion_compliance)
        point_sizes = points.force.getSizes()[0]
        add_scaled(force_law, 1.0, block_diagonal_matrix(E, point_sizes, self._K.comm))
        self._ksp.setOperators(force_law)
        point_springs = self._multiply_block_diagonal(
            self._spring_stiffness * anchored_projectors * has_both_equations,
            points.relative_displacement,
        )
        return points.force.transposeMatMult(point_springs)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        points, has_equation, rows = self._points, self._has_equation, self._points.rows
        law_values = np.where(rows >= 0, x.array_r[rows], 0.0)
        if self._elimination is not None:
            law_values = self._elimination.lift_law_values(law_values)
        self._law_values.array[:] = law_values.ravel()
        self._ksp.solve(self._law_values, self._force)
        self._compliance.mult(self._force, self._relative_displacement)
        displacement = self._relative_displacement.array_r.reshape(has_equation.shape)
        self._force.array[:] += np.einsum("nab,nb->na", self._held_stiffness, displacement).ravel()
        x.copy(self._remaining)
        self._remaining.array[points.equations[has_equation]] = 0.0
        points.force.multTransposeAdd(self._force, self._remaining, self._remaining)
        self._inner.apply(self._remaining, y)

    def release(self) -> None:
        destroy_objects(self._ksp)

    def _multiply_block_diagonal(self, blocks: Array, matrix: PETSc.Mat) -> PETSc.Mat:
        """Return the product of a block-diagonal matrix and another matrix.

        The diagonal blocks are `blocks` (m, dim, k), and the matrix is (m k, ...).
        """
        sizes = self._points.force.getSizes()[0], matrix.getSizes()[0]
        return block_diagonal_matrix(blocks, sizes[0], matrix.comm, sizes[1]).matMult(matrix)


class BorderedPreconditioner:
    """Preconditioner of a system with free translations, as the Python context of a `PETSc.PC`.

    The free translations of surfaces border the matrix with a few rows and columns. They are
    eliminated by their Schur complement.

    Args:
        inner: preconditioner of the system without border.
        n_translations: number of free translations.
        comm: communicator of the system.
        vector_like: any vector of the system without border, from which the layout is taken.
    """

    def __init__(
        self, inner: PETSc.PC, n_translations: int, comm: MPI.Comm, vector_like: PETSc.Vec
    ) -> None:
        self._inner, self._comm = inner, comm
        self._balance_rows: list[Array] = []
        self._inner_input, self._inner_output = vector_like.duplicate(), vector_like.duplicate()
        self._inner_columns: list[Array] = []
        self._schur = np.eye(n_translations)

    def update_schur_complement(
        self, border_columns: list[Array], balance_rows: list[Array], border_block: Array
    ) -> None:
        """Compute the Schur complement of the free translations.

        Args:
            border_columns: for each free translation, the part (n,) that this process owns of its
                matrix column.
            balance_rows: for each free translation, the part (n,) that this process owns of the
                matrix row of its force balance.
            border_block: coefficients (translations, translations) of the free translations in
                their force balances.
        """
        self._balance_rows = balance_rows
        self._inner_columns = [
            self._apply_inner_preconditioner(column) for column in border_columns
        ]
        self._schur = (
            border_block
            - np.array([self._multiply_balance_rows(column) for column in self._inner_columns]).T
        )

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        values, n = x.array_r, self._inner_input.getLocalSize()
        balance = self._comm.bcast(values[n:].copy(), self._comm.size - 1)
        result = self._apply_inner_preconditioner(values[:n])
        U = np.linalg.lstsq(self._schur, balance - self._multiply_balance_rows(result))[0]
        for translation, column in zip(U, self._inner_columns, strict=True):
            result -= translation * column
        y.array[:n] = result
        y.array[n:] = U[: len(values) - n]

    def _apply_inner_preconditioner(self, values: Array) -> Array:
        """Apply the inner preconditioner to a vector (n,), and return the result (n,)."""
        self._inner_input.array[:] = values
        self._inner.apply(self._inner_input, self._inner_output)
        return np.array(self._inner_output.array_r)

    def _multiply_balance_rows(self, values: Array) -> Array:
        """Return the products (translations,) of the force-balance rows with a vector (n,)."""
        totals = np.array([row @ values for row in self._balance_rows])
        self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
        return totals


class AnchorNodes:
    """Contact nodes that hold otherwise free bodies in the preconditioner.

    In each connected component of the mesh, up to `dim` distant nodes are chosen from the contact
    points that can hold the body.
    """

    def __init__(self, space: fem.FunctionSpace, points: ContactPointOperators) -> None:
        self._comm: MPI.Comm = space.mesh.comm
        components = ComponentRigidModes.from_space(space)
        self._component, self._n_components = (
            components.component_of_node[points.node],
            len(components.centre),
        )
        self._x = space.tabulate_dof_coordinates()[points.node, : space.mesh.geometry.dim]
        self.choose_nodes(points)

    def choose_nodes(self, points: ContactPointOperators) -> None:
        """Choose the anchor nodes from the points that can hold the body at present."""
        is_candidate = points.can_hold_body & ~points.shared_nodes.is_additional
        component = np.where(is_candidate, self._component, -1)
        all_x, all_components = (
            np.concatenate(self._comm.allgather(part)) for part in (self._x, component)
        )
        chosen = np.zeros(len(all_x), dtype=bool)
        for k in range(self._n_components):
            candidates = np.flatnonzero(all_components == k)
            chosen[candidates[_pick_distant_points(all_x[candidates])]] = True
        first_point = sum(self._comm.allgather(len(component))[: self._comm.rank])
        self._is_anchor = chosen[first_point : first_point + len(component)]

    def extend_projectors_at_anchors(self, held_projectors: Array) -> Array:
        """Return projectors onto held directions, extended to all directions at anchor nodes.

        Anchor nodes are used only in connected components with few sticking nodes.

        Args:
            held_projectors: projectors (m, dim, dim) onto the directions that the active set holds.
        """
        dim = held_projectors.shape[1]
        sticks = np.einsum("naa->n", held_projectors) > dim - 0.5
        count = np.bincount(self._component[sticks], minlength=self._n_components)
        self._comm.Allreduce(MPI.IN_PLACE, count, MPI.SUM)
        needs_anchor = (
            self._is_anchor & (count < _MIN_STICKING_NODES_WITHOUT_ANCHORS)[self._component]
        )
        return np.where(needs_anchor[:, None, None], np.eye(dim), held_projectors)


def _pick_distant_points(x: Array) -> list[int]:
    """Choose up to `dim` of the points x (n, dim) that are far from each other.

    The first point is the one farthest from the mean position. Each following point is the one
    farthest from the affine hull of the points already chosen. The result has their numbers.
    """
    if not len(x):
        return []
    chosen = [int(np.argmax(np.linalg.norm(x - x.mean(axis=0), axis=1)))]
    remainder = x - x[chosen[0]]
    for _ in range(x.shape[1] - 1):
        farthest = int(np.argmax(np.linalg.norm(remainder, axis=1)))
        distance = np.linalg.norm(remainder[farthest])
        if distance == 0:
            break
        chosen.append(farthest)
        remainder = (
            remainder - np.outer(remainder @ remainder[farthest], remainder[farthest]) / distance**2
        )
    return chosen
