"""The linear system of one active set as a matrix-free operator, solved by a Krylov method.

The operator is the `MatrixFreeContactOperator`. The preconditioner is multigrid for the stiffness,
in which the directions that the active set fixes are held as if by supports. For two bodies it is
replaced by the `SpringPreconditioner` (docs/theory.md, "Large systems"). If they slide far, the
operators of the contact points and a stiffness of their forces change at each iterate. The few free
translations of surfaces are eliminated by the Schur complement of the preconditioner. In hybrid
bodies only the displacements, the first block of the `BlockTriangularPreconditioner`, are held.

The module guarantees that the residual divided by the contact forces is as small as the requested
accuracy, or as small as round-off permits. It assumes that no surface is free to rotate.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.nodes import MAX_CONTACT_VIOLATION_PER_NODAL_FORCE, LinearisedContactLaw
from pw_elements.contact.system.preconditioners import (
    AnchorNodes,
    BorderedPreconditioner,
    SpringPreconditioner,
)
from pw_elements.contact.system.solution import LinearSolveAccuracy, LocalTangentSolution
from pw_elements.contact.system.unassembled import (
    ContactPointOperators,
    MatrixFreeContactOperator,
)
from pw_elements.solvers import (
    PreparedSolver,
    SeparateSupportsSolver,
    SingularSystem,
    Supports,
    as_krylov_solver,
    collect_garbage,
    destroy_objects,
    has_free_rigid_motion,
    matrix_from_python_context,
    solve_with_ksp,
)

# Residual of an intermediate solution divided by the previous residual. For a constant tangent, a
# smaller ratio would save no Newton step. For a changing tangent, a larger ratio may lead to
# another branch of solutions
_FORCING_TERM_FOR_CONSTANT_TANGENT = 0.1
_FORCING_TERM_FOR_CHANGING_TANGENT = 0.02
# Inverse of the smallest value of `SpringPreconditioner.compute_length_to_force_factors` for bodies
# of equal stiffness. The values are smaller if one body is softer. Forces then depend less on gaps,
# and the residual has to be smaller
_INVERSE_LENGTH_TO_FORCE_FACTOR_OF_EQUAL_BODIES = 5.0
# The final residual, divided by the largest nodal contact force, may exceed neither the solver's
# tolerance nor _MAX_FINAL_RESIDUAL_PER_CONTACT_FORCE. For a changing tangent (large strains) it may
# not exceed _MAX_RESIDUAL_PER_FORCE_FOR_CHANGING_TANGENT either, so that runs that are resumed from
# a saved state differ by less than 1e-12. With the accuracy "tightened", the limit is multiplied by
# _TOLERANCE_TIGHTENING_FACTOR
_MAX_FINAL_RESIDUAL_PER_CONTACT_FORCE = MAX_CONTACT_VIOLATION_PER_NODAL_FORCE / 10
_MAX_RESIDUAL_PER_FORCE_FOR_CHANGING_TANGENT = 1e-12
_TOLERANCE_TIGHTENING_FACTOR = 0.1
# Relative residual at which eigenvalues are computed
_RELATIVE_RESIDUAL_FOR_EIGENVALUES = 1e-4
# Smallest ratio of contact forces to residual at which the contact forces are meaningful
_MIN_MEANINGFUL_FORCE_PER_RESIDUAL = 1e-3
# A solution whose residual is near round-off has stalled if the residual is not below
# _MIN_STALLED_RESIDUAL_PER_TARGET times its target, or not below the previous residual. Any other
# solution has stalled if the residual is not below _MIN_STALLED_RESIDUAL_PER_PREVIOUS times the
# previous one
_MIN_STALLED_RESIDUAL_PER_TARGET = 2.0
_MIN_STALLED_RESIDUAL_PER_PREVIOUS = 0.1
# Largest excess cost of one solution with old multigrid levels, divided by the number of operations
# that make new levels. The ratio exceeds 1 because the operations of the set-up are slower
_MAX_EXCESS_COST_PER_MULTIGRID_SETUP = 3.0
# Bounds of the singular values of the law's force coefficients, which are 0 for a held direction
# and 1 for a free direction. If the singular value of a direction is below the first bound, the law
# contains no force in this direction. If it is below the second bound, the preconditioner holds the
# direction
_MAX_SINGULAR_VALUE_OF_FIXED_DIRECTION = 1e-9
_MAX_SINGULAR_VALUE_OF_HELD_DIRECTION = 0.5


class KrylovTangent:
    """Matrix-free operator of the contact system and its Krylov solver.

    Unknowns are numbered as in the stiffness, and prescribed unknowns are zero. The free
    translations of surfaces come last, on the last process.

    Args:
        K: stiffness (n, n).
        supports: supports of the body.
        points: contact points.
        matrix_free_solver: solver of the linear systems.
        owned_matrices: matrices that `release` destroys.
    """

    solves_exactly = False

    def __init__(
        self,
        K: PETSc.Mat,
        supports: Supports,
        points: ContactPointOperators,
        matrix_free_solver: SeparateSupportsSolver,
        owned_matrices: Sequence[PETSc.Mat],
    ) -> None:
        self._owned_matrices, self._supports = owned_matrices, supports
        self._points = points
        self._comm: MPI.Comm = K.comm.tompi4py()
        self.solver: PreparedSolver = matrix_free_solver.prepare(K, supports=supports)
        self._krylov = krylov = as_krylov_solver(self.solver, K, supports)
        block_preconditioner = self._block_preconditioner = krylov.block_preconditioner
        self._multigrid = krylov.multigrid
        stiffness = (
            block_preconditioner.scaled_matrix
            if block_preconditioner
            else self._multigrid.block_matrix
        )
        self._matrix_free_operator = MatrixFreeContactOperator(stiffness, supports.free, points)
        n_local, n_global = K.getSizes()[0]
        self._n_unknowns = n_local
        is_last_rank = self._comm.rank == self._comm.size - 1
        sizes = (n_local + points.n_translations * is_last_rank, n_global + points.n_translations)
        self._operator = matrix_from_python_context(
            (sizes, sizes), self._matrix_free_operator, K.comm
        )
        inner = krylov.ksp.getPC()
        self._spring_preconditioner: SpringPreconditioner | None = None
        self._bordered_preconditioner: BorderedPreconditioner | None = None
        if points.has_two_bodies:
            displacement_pc = (
                block_preconditioner.displacement_pc if block_preconditioner else inner
            )
            self._spring_preconditioner = SpringPreconditioner(
                displacement_pc,
                self._restrict_points_to_displacements(points),
                krylov.displacement_block[0],
                self._matrix_free_operator.elimination,
            )
            spring_pc = PETSc.PC().createPython(self._spring_preconditioner, comm=K.comm)
            spring_pc.setOperators(self._multigrid.operator)
            if block_preconditioner:
                block_preconditioner.displacement_pc = spring_pc
            else:
                inner = spring_pc
        if points.n_translations:
            self._balance_rows = self._sum_forces_that_balance_translations()
            self._bordered_preconditioner = BorderedPreconditioner(
                inner, points.n_translations, self._comm, K.createVecRight()
            )
        outer = self._bordered_preconditioner or (
            None if block_preconditioner else self._spring_preconditioner
        )
        self._ksp = krylov.create_flexible_ksp(self._operator, outer)
        # no anchor nodes are needed if supports hold all connected components
        displacement_stiffness, displacement_supports = krylov.displacement_block
        has_free_motion = has_free_rigid_motion(displacement_stiffness, displacement_supports)
        self._anchor_nodes = (
            AnchorNodes(displacement_supports.space, points) if has_free_motion else None
        )
        self._solution = self._operator.createVecRight()
        self._is_final = self._has_enclosed_pressure = False
        self._final_tolerance = self._tolerance = min(
            krylov.tolerance, _MAX_FINAL_RESIDUAL_PER_CONTACT_FORCE
        )
        self._stiffness_changed = False
        self._solution_size = self._previous_residual = 0.0
        # floating-point operations to make multigrid levels, and operations wasted since then
        # because the levels are old
        self._setup_operations = self._wasted_operations = 0.0
        # operations with new levels, per decimal digit of the residual and per iteration
        self._operations_per_digit: float | None = None
        self._operations_per_iteration = 1.0
        self._max_iterations: int = self._ksp.getTolerances()[3]

    def set_initial_iterate(self, get_unknowns: Callable[[], Array], free_motions: Array) -> None:
        initial_unknowns, local_solution = get_unknowns(), self._solution.array
        local_solution[: len(initial_unknowns)] = initial_unknowns
        local_solution[len(initial_unknowns) :] = free_motions[
            : len(local_solution) - len(initial_unknowns)
        ]
        self._solution_size, self._previous_residual = self._solution.norm(), 0.0

    def set_free_motion_springs(self, springs: Array) -> None:
        self._matrix_free_operator.springs = springs

    def update_stiffness(self, *_: object, **__: object) -> None:
        """Make new multigrid levels if the old ones have become too expensive.

        They have if they have wasted as many operations as the set-up of new levels needs. The
        arguments are ignored, because the stiffness has been changed in place.
        """
        self._stiffness_changed = True
        if self._wasted_operations >= self._setup_operations:
            self._krylov.preconditioner.update_for_changed_matrix()
            self._operations_per_digit = None

    def update_stiffness_and_points(
        self, points: ContactPointOperators, added_stiffness: PETSc.Mat
    ) -> None:
        """Update the operators of the contact points after the stiffness has changed.

        Args:
            points: operators of the same contact points.
            added_stiffness: matrix (n, n) that is added to the stiffness, but is not contained in
                the multigrid levels.
        """
        self._points = points
        self._matrix_free_operator.set_points(points, added_stiffness)
        assert self._spring_preconditioner is not None, "only two bodies slide on each other"
        self._spring_preconditioner.set_points(self._restrict_points_to_displacements(points))
        self._multigrid.announce_changed_spring_pattern()
        if points.n_translations:
            self._balance_rows = self._sum_forces_that_balance_translations()
        if self._anchor_nodes is not None:
            self._anchor_nodes.choose_nodes(points)
        self.update_stiffness()

    def _restrict_points_to_displacements(
        self, points: ContactPointOperators
    ) -> ContactPointOperators:
        if self._block_preconditioner is None:
            return points
        return points.restrict_to_displacements(self._block_preconditioner.displacements)

    def _sum_forces_that_balance_translations(self) -> list[Array]:
        """Return the row (n,) of the sum of contact forces along each free translation."""
        points = self._points
        return [
            self._matrix_free_operator.sum_force_rows(points.free_translation == j)
            * self._supports.free
            for j in range(points.n_translations)
        ]

    def estimate_determinant_signs(self) -> tuple[int, ...]:
        """Return estimated signs of the determinants of preconditioner and preconditioned tangent.

        The sign of the preconditioner is taken as 1. Most eigenvalues of the preconditioned tangent
        are near one. An eigenvalue that has changed its sign is an outlier, which Arnoldi's method
        usually finds first. The result is not a proof, since the start vector is arbitrary. It is
        empty if the solver computes no eigenvalues.
        """
        if self._krylov.uses_external_method:
            return ()
        start_vector, image = self._operator.createVecs()
        first_row, end_row = start_vector.getOwnershipRange()
        start_vector.setArray(np.cos(np.arange(first_row, end_row, dtype=float)))
        sign = -1
        for re_estimate in (False, True):
            if re_estimate:  # a smoother with wrong eigenvalue bounds may have changed the sign
                self._multigrid.re_estimate_smoother_eigenvalues()
            self._ksp.setTolerances(
                rtol=_RELATIVE_RESIDUAL_FOR_EIGENVALUES, atol=0.0, max_it=self._max_iterations
            )
            self._ksp.solve(start_vector, image)
            values = self._ksp.computeEigenvalues()
            if not len(values):  # only GMRES provides eigenvalues
                return ()
            sign = (-1) ** int(np.sum((values.imag == 0) & (values.real < 0)))
            if sign > 0:
                break
        if (elimination := self._matrix_free_operator.elimination) is not None:
            sign *= elimination.row_sign
        return 1, sign

    def is_constant_pressure_held_by_contact_only(self) -> bool:
        return self._has_enclosed_pressure

    def solve(
        self,
        rhs: Array,
        balance_rhs: Array,
        law: LinearisedContactLaw,
        accuracy: LinearSolveAccuracy,
    ) -> LocalTangentSolution:
        law = replace(law, D=law.D[:, :, : law.E.shape[1]])  # the border has no rotations
        tighten = accuracy == "tightened" and self._is_final
        final_tolerance = (
            min(self._final_tolerance, _MAX_RESIDUAL_PER_FORCE_FOR_CHANGING_TANGENT)
            if self._stiffness_changed
            else self._final_tolerance
        )
        self._tolerance = (
            self._tolerance * _TOLERANCE_TIGHTENING_FACTOR if tighten else final_tolerance
        )
        points, operator = self._points, self._matrix_free_operator
        law_right = np.where(points.equations >= 0, rhs[points.law_equations], 0.0)
        law, forcing_term = self._scale_law_and_rhs_and_choose_forcing_term(law, law_right)
        force_coefficients = operator.set_law(law)
        rhs, balance_rhs = self._eliminate_additional_forces(rhs, balance_rhs, law_right)
        combined_rhs, x = self._operator.createVecLeft(), self._solution
        combined_rhs.setArray(np.append(rhs, balance_rhs[: combined_rhs.getLocalSize() - len(rhs)]))
        fixed_projectors = self._prepare_preconditioner_and_fixed_projectors(
            law, force_coefficients
        )
        if self._spring_preconditioner is None:
            self._move_nodes_to_positions_fixed_by_law(combined_rhs, x, fixed_projectors)
        # the initial iterate may be needed again only if the levels may be old
        initial = x.copy() if self._stiffness_changed else x
        remaining_rhs = combined_rhs.duplicate()
        residual = self._update_residual_and_return_norm(combined_rhs, remaining_rhs)
        if self._previous_residual:
            forcing_term = min(forcing_term, 0.9 * (residual / self._previous_residual) ** 2)
        self._previous_residual = residual
        intermediate_residual = forcing_term * residual if accuracy == "rough" else 0.0
        outcome = self._iterate_until_target_or_stall(
            combined_rhs, remaining_rhs, residual, intermediate_residual, forcing_term
        )
        if outcome is None:  # the old levels are too inaccurate
            self._wasted_operations = np.inf
            self.update_stiffness()
            self._prepare_preconditioner_and_fixed_projectors(law, force_coefficients)
            initial.copy(x)
            residual = self._update_residual_and_return_norm(combined_rhs, remaining_rhs)
            outcome = self._iterate_until_target_or_stall(
                combined_rhs, remaining_rhs, residual, intermediate_residual, forcing_term
            )
            assert outcome is not None, "new levels always give an outcome"
        residual, is_stalled = outcome
        self._is_final = bool(
            residual <= self._final_tolerance * self._largest_contact_force() or is_stalled
        )
        self._free_krylov_vectors()
        collect_garbage(combined_rhs)
        is_unknown = points.shared_nodes.is_additional[:, None] & (points.equations >= 0)
        n, additional_forces = self._n_unknowns, operator.force[is_unknown]
        unknowns = np.concatenate([x.array_r[:n], additional_forces, x.array_r[n:]])
        return LocalTangentSolution(unknowns, is_exact=is_stalled, is_final=self._is_final)

    def _eliminate_additional_forces(
        self, rhs: Array, balance_rhs: Array, law_right: Array
    ) -> tuple[Array, Array]:
        """Return the right-hand sides of the system without the additional forces; collective.

        Args:
            rhs: right-hand side of this process' equations and of its additional forces.
            balance_rhs: right-hand side (free,) of the force balances of free motions.
            law_right: right-hand side (m, dim) of the laws of all points, which are scaled.
        """
        points, operator, rows = self._points, self._matrix_free_operator, self._points.rows
        rhs = rhs[: self._n_unknowns].copy()
        law_right = operator.reduce_right_hand_side(law_right)
        if operator.elimination is not None:
            force = operator.force_of_right_hand_side
            rhs -= points.distribute_to_opposite_nodes(force)
            totals = np.zeros(points.n_translations)
            is_moved = points.free_translation >= 0
            np.add.at(totals, points.free_translation[is_moved], force[is_moved])
            self._comm.Allreduce(MPI.IN_PLACE, totals, MPI.SUM)
            balance_rhs = balance_rhs - totals
        rhs[rows[rows >= 0]] = law_right[rows >= 0]
        return rhs, balance_rhs

    def _scale_law_and_rhs_and_choose_forcing_term(
        self, law: LinearisedContactLaw, law_right: Array
    ) -> tuple[LinearisedContactLaw, float]:
        """Scale the rows of a law from lengths to forces, and choose the forcing term.

        Lengths are multiplied by the stiffness of the springs in the `SpringPreconditioner`. The
        law is not scaled if there are no pairs of two bodies.

        Args:
            law: linearised law.
            law_right: right-hand side (m, dim) of the laws, which is scaled in place.

        Returns:
            The scaled law, and the forcing term: the residual of an intermediate solution divided
            by the previous residual.
        """
        forcing_term = (
            _FORCING_TERM_FOR_CHANGING_TANGENT
            if self._stiffness_changed
            else _FORCING_TERM_FOR_CONSTANT_TANGENT
        )
        if self._spring_preconditioner is None:
            return law, forcing_term
        factors = self._spring_preconditioner.compute_length_to_force_factors(law)
        law_right *= factors
        E, C, D = (factors[:, :, None] * matrix for matrix in (law.E, law.C, law.D))
        smallest_factor = self._comm.allreduce(factors.min(initial=1.0), MPI.MIN)
        forcing_term *= min(1.0, _INVERSE_LENGTH_TO_FORCE_FACTOR_OF_EQUAL_BODIES * smallest_factor)
        return replace(law, E=E, C=C, D=D, c=factors * law.c), forcing_term

    def _prepare_preconditioner_and_fixed_projectors(
        self, law: LinearisedContactLaw, force_coefficients: Array
    ) -> Array:
        """Set up the preconditioner for a linearised law.

        Args:
            law: linearised law.
            force_coefficients: coefficients (m, dim, dim) of the forces in the equations at each
                point's `rows`.

        Returns:
            Projectors (m, dim, dim) onto the directions whose motion the law fixes.

        Raises:
            SingularSystem: if the pressure of an incompressible body is determined only up to a
                constant.
        """
        operations_before = self._count_floating_point_operations()
        fixed_projectors = self._constrain_multigrid_and_return_fixed_projectors(
            law, force_coefficients
        )
        if self._block_preconditioner and self._block_preconditioner.has_free_constant_pressure(
            self._operator
        ):
            self._has_enclosed_pressure = True
            raise SingularSystem("the pressure is determined only up to a constant")
        self._krylov.ksp.getPC().setUp()
        if self._bordered_preconditioner is not None:
            border_columns = [
                self._make_free_translation_column(j, law.D)
                for j in range(self._points.n_translations)
            ]
            self._bordered_preconditioner.update_schur_complement(
                border_columns, *self._make_balance_rows_and_border_block(law)
            )
        if self._operations_per_digit is None:
            self._setup_operations = self._count_floating_point_operations() - operations_before
            self._wasted_operations = 0.0
        return fixed_projectors

    def _iterate_until_target_or_stall(
        self,
        combined_rhs: PETSc.Vec,
        residual_vector: PETSc.Vec,
        residual_norm: float,
        intermediate_target: float,
        forcing_term: float,
    ) -> tuple[float, bool] | None:
        """Iterate until the residual reaches its target or stalls.

        Args:
            combined_rhs: right-hand side of all equations.
            residual_vector: `combined_rhs` minus the product of the matrix with the iterate. It is
                updated in place.
            residual_norm: norm of `residual_vector`.
            intermediate_target: target for the residual of an intermediate solution, 0 for a
                final solution.
            forcing_term: residual of an intermediate solution divided by the previous residual.

        Returns:
            The norm of the residual, and whether it has stalled at round-off. The result is None if
            the multigrid levels are old and new ones are likely to be cheaper.

        Raises:
            NotConverged: if the method fails with new levels.
        """
        x, correction = self._solution, residual_vector.duplicate()
        operations_before = self._count_floating_point_operations()
        operations_per_digit = self._operations_per_digit if self._stiffness_changed else None
        initial_residual, is_stalled, round_off, n_iterations = residual_norm, False, 0.0, 0
        while not is_stalled and not residual_norm <= (
            target := self._stopping_residual(residual_norm, intermediate_target, forcing_term)
        ):
            max_iterations = self._max_iterations
            if operations_per_digit is not None:
                n_digits = np.log10(initial_residual / target)
                affordable_operations = (
                    _MAX_EXCESS_COST_PER_MULTIGRID_SETUP * self._setup_operations
                    + operations_per_digit * n_digits
                )
                max_iterations = min(
                    max_iterations, 1 + int(affordable_operations / self._operations_per_iteration)
                )
            self._ksp.setTolerances(rtol=0.0, atol=target, max_it=max_iterations)
            # options are checked in the first solution; external methods check them in each one
            if self._solution_size and not self._krylov.uses_external_method:
                self._ksp.solve(residual_vector, correction)
            else:
                solve_with_ksp(self._ksp, residual_vector, correction, self._krylov.options)
            n_iterations += self._ksp.getIterationNumber()
            x.axpy(1.0, correction)
            previous_residual, residual_norm = (
                residual_norm,
                self._update_residual_and_return_norm(combined_rhs, residual_vector),
            )
            self._solution_size = max(self._solution_size, x.norm())
            round_off = target
            if not residual_norm <= target:  # the norm of the stiffness takes time
                round_off += (
                    self._krylov.residual_round_off(self._solution_size)
                    + self._points.force_round_off
                )
            # a residual of NaN, due to a failed factorisation, counts as stalled
            is_stalled = not residual_norm < (
                min(previous_residual, _MIN_STALLED_RESIDUAL_PER_TARGET * target)
                if residual_norm <= round_off
                else _MIN_STALLED_RESIDUAL_PER_PREVIOUS * previous_residual
            )
            if (
                operations_per_digit is not None
                and not residual_norm <= round_off
                and (is_stalled or n_iterations >= max_iterations)
            ):
                return None
        if is_stalled and not residual_norm <= round_off:
            raise self._krylov.make_not_converged_error(
                residual_norm / max(combined_rhs.norm(), self._largest_contact_force())
            )
        digits = np.log10(max(initial_residual, 1e-300) / max(residual_norm, 1e-300))
        operations = self._count_floating_point_operations() - operations_before
        if self._operations_per_digit is None:
            self._operations_per_digit, self._operations_per_iteration = (
                operations / max(digits, 1),
                operations / max(n_iterations, 1) or 1.0,
            )
        else:
            self._wasted_operations = max(
                0.0, self._wasted_operations + operations - self._operations_per_digit * digits
            )
        return residual_norm, is_stalled

    def _free_krylov_vectors(self) -> None:
        """Free the vectors of the Krylov method without resetting the preconditioner."""
        preconditioner, empty_preconditioner = (
            self._ksp.getPC(),
            PETSc.PC().create(self._operator.comm),
        )
        self._ksp.setPC(empty_preconditioner)  # otherwise `reset` would reset the levels
        self._ksp.reset()
        self._ksp.setPC(preconditioner)
        destroy_objects(empty_preconditioner)

    def release(self) -> None:
        if self._spring_preconditioner is not None:
            self._spring_preconditioner.release()
        destroy_objects(self._ksp, self._operator, *self._owned_matrices)
        self._krylov.release()
        if self.solver is not self._krylov:
            self.solver.release()

    def _stopping_residual(
        self, residual_norm: float, intermediate_target: float, forcing_term: float
    ) -> float:
        """Return the residual at which the iteration stops.

        It is at least the tolerance times the largest contact force. The target of an intermediate
        solution is at most the forcing term times the norm of the contact forces, because the
        initial residual may be much larger: the active set may have moved nodes that the rest of
        the body has not followed yet.

        Args:
            residual_norm: residual of the current iterate.
            intermediate_target: target for the residual of an intermediate solution, 0 for a
                final solution.
            forcing_term: residual of an intermediate solution divided by the previous residual.
        """
        squared_force = self._comm.allreduce(
            float(np.sum(self._matrix_free_operator.force**2)), MPI.SUM
        )
        if squared_force > (_MIN_MEANINGFUL_FORCE_PER_RESIDUAL * residual_norm) ** 2:
            intermediate_target = min(intermediate_target, forcing_term * squared_force**0.5)
        largest = self._largest_contact_force()
        # an intermediate solution that would almost be a final one is solved to the final tolerance
        intermediate_target = (
            intermediate_target
            if intermediate_target > MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * largest
            else 0.0
        )
        return max(intermediate_target, self._tolerance * largest)

    def _update_residual_and_return_norm(
        self, combined_rhs: PETSc.Vec, residual_vector: PETSc.Vec
    ) -> float:
        """Set `residual_vector` to the residual of the present iterate, and return its norm."""
        self._operator.mult(self._solution, residual_vector)
        residual_vector.aypx(-1.0, combined_rhs)
        return float(residual_vector.norm())

    def _count_floating_point_operations(self) -> float:
        """Return the number of floating-point operations of all processes so far; collective."""
        return float(self._comm.allreduce(PETSc.Log.getFlops(), MPI.SUM))

    def _largest_contact_force(self) -> float:
        force = float(np.abs(self._matrix_free_operator.force).max(initial=0.0))
        return float(self._comm.allreduce(force, MPI.MAX))

    def _constrain_multigrid_and_return_fixed_projectors(
        self, law: LinearisedContactLaw, force_coefficients: Array
    ) -> Array:
        """Make the multigrid preconditioner hold the directions that the active set fixes.

        Args:
            law: linearised law.
            force_coefficients: coefficients (m, dim, dim) of the forces in the equations at each
                point's `rows`.

        Returns:
            Projectors (m, dim, dim) onto the directions whose motion the law fixes.
        """
        # springs act at all points; supports hold nodes, whose equations are at the first points
        coefficients, points = law.E, self._points
        selected: Mask = np.ones(len(points.node), dtype=bool)
        if self._spring_preconditioner is None:
            coefficients, selected = force_coefficients, ~points.shared_nodes.is_additional
        left_vectors, singular_values, _ = np.linalg.svd(coefficients)
        singular_values[~selected] = 1.0
        held_projectors, fixed_projectors = (
            np.einsum(
                "nak,nk,nbk->nab",
                left_vectors,
                (singular_values < bound).astype(float),
                left_vectors,
            )
            for bound in (
                _MAX_SINGULAR_VALUE_OF_HELD_DIRECTION,
                _MAX_SINGULAR_VALUE_OF_FIXED_DIRECTION,
            )
        )
        anchored_projectors = held_projectors
        if self._anchor_nodes is not None:
            anchored_projectors = self._anchor_nodes.extend_projectors_at_anchors(held_projectors)
        springs = (
            self._spring_preconditioner.factorise_law_and_assemble_springs(
                law, held_projectors, anchored_projectors
            )
            if self._spring_preconditioner
            else None
        )
        self._multigrid.set_constrained_directions(
            points.node[selected],
            anchored_projectors[selected],
            points.law_scale[selected],
            springs,
        )
        return fixed_projectors

    def _move_nodes_to_positions_fixed_by_law(
        self, combined_rhs: PETSc.Vec, iterate: PETSc.Vec, fixed_projectors: Array
    ) -> None:
        """Move nodes along the fixed directions to the positions that the law prescribes.

        The iteration does not change these positions.

        Args:
            combined_rhs: right-hand side of all equations.
            iterate: initial iterate, which is changed in place.
            fixed_projectors: projectors (m, dim, dim) onto the directions that the law fixes.
        """
        points, rows = self._points, self._points.rows
        violation = np.where(
            rows >= 0,
            combined_rhs.array_r[rows]
            - self._matrix_free_operator.evaluate_motion_terms_of_law(iterate),
            0.0,
        )
        step = np.einsum("nab,nb->na", fixed_projectors, violation) / points.law_scale[:, None]
        iterate.array[rows[rows >= 0]] += step[rows >= 0]

    def _make_balance_rows_and_border_block(
        self, law: LinearisedContactLaw
    ) -> tuple[list[Array], Array]:
        """Return the force-balance rows of the free translations and their block; collective.

        The rows are the parts (n,) that this process owns. The forces of nodes with several points
        depend on the law.
        """
        points, elimination = self._points, self._matrix_free_operator.elimination
        springs = np.diag(self._matrix_free_operator.springs)
        if elimination is None:
            return self._balance_rows, springs
        rows, block = [], np.zeros_like(springs)
        for j, balance_row in enumerate(self._balance_rows):
            weights = (points.free_translation == j).astype(float)
            law_weights = -elimination.transpose_force_changes(weights)
            force_weights = np.einsum("nab,na->nb", law.E, law_weights)
            row = self._matrix_free_operator.sum_force_rows(force_weights)
            motion_weights, by_motion = points.motion.createVecs()[::-1]
            motion_weights.setArray(np.einsum("nab,na->nb", law.C, law_weights))
            points.motion.multTranspose(motion_weights, by_motion)
            rows.append(balance_row + (row + by_motion.array_r) * self._supports.free)
            by_translation = -np.einsum("nab,na->nb", law.D, law_weights)
            is_moved = points.free_translation >= 0
            np.add.at(block[j], points.free_translation[is_moved], by_translation[is_moved])
        self._comm.Allreduce(MPI.IN_PLACE, block, MPI.SUM)
        return rows, springs + block

    def _make_free_translation_column(self, translation_number: int, D: Array) -> Array:
        """Return the part (n,) that this process owns of the matrix column of one translation.

        Args:
            translation_number: number of the free translation.
            D: coefficients (m, dim, k) of the surface motions in the law.
        """
        points, rows = self._points, self._points.rows
        law_values = -np.einsum(
            "nab,nb->na", D, (points.free_translation == translation_number).astype(float)
        )
        column = np.zeros(self._n_unknowns)
        if (elimination := self._matrix_free_operator.elimination) is not None:
            force = -elimination.compute_force_changes(law_values)
            column = points.distribute_to_opposite_nodes(force) * self._supports.free
            law_values = elimination.reduce_law_values(law_values)
        column[rows[rows >= 0]] = law_values[rows >= 0]
        return column
