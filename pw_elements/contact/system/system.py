"""The linear system of one active set, in which the contact law replaces equations of nodes.

The rows are derived in docs/theory.md ("The linear system"). If surfaces may rotate, their motions
include angles, and a `TorqueMap` sums forces and torques.

The module guarantees that the assembled matrix has one sparsity pattern for all active sets, which
is built before the iteration. `KrylovTangent` assembles no matrix. The module assumes that the
equations of a contact point contain no forces of points at other nodes.
"""

from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements._compat import matrix_with_single_entry_rows
from pw_elements.algebra import (
    Reduction,
    has_free_constant_pressure,
    matrix_free_constrained_operator,
    reduce_matrix,
)
from pw_elements.arrays import Array
from pw_elements.contact.interface import ContactInterface
from pw_elements.contact.model import EMPTY_SOLVER_REPORT, FreeMotionIndices
from pw_elements.contact.nodes import LinearisedContactLaw, TorqueMap
from pw_elements.contact.system.additional_forces import AdditionalForces
from pw_elements.contact.system.assembled import (
    AssembledTangent,
    ContactLawRows,
    CsrArrays,
    extract_entries_at_own_equations,
    extract_local_rows,
    gather_balance_rows_on_last_rank,
    make_map_from_free_motions_to_points,
    replace_contact_rows_and_append_balance_rows,
    split_force_operator_at_own_equations,
)
from pw_elements.contact.system.interfaces import ContactTangent
from pw_elements.contact.system.krylov import KrylovTangent
from pw_elements.contact.system.solution import (
    ContactSystemSolution,
    LinearSolveAccuracy,
)
from pw_elements.contact.system.unassembled import ContactPointOperators, masked_row_mean_or_one
from pw_elements.solvers import (
    LinearSolver,
    SolverReport,
    StiffnessWithAddedMatrix,
    add_scaled,
    has_separate_supports,
    matrix_from_python_context,
)

# Number of linear systems solved, and the report of the linear solver
SolveCountAndReport: TypeAlias = tuple[int, SolverReport]
NO_COST: SolveCountAndReport = (0, EMPTY_SOLVER_REPORT)


class ContactSystem:
    """Linear equations of a body in contact, with the law of an active set at the contact points.

    The unknowns are the displacements, reduced by the supports, and the free motions of surfaces.
    The free motions (translations and angles) come last, on the last process. Their equations are
    balances of force and torque.

    Args:
        K: stiffness (n, n).
        reduction: reduction by the supports.
        interface: contact points of all pairs.
        free_motions: pair index and component index of each free motion.
        solver: solver of the linear systems.
        torque_map: map from motions of the surfaces to velocities of the contact nodes.

    Attributes:
        law_scale: stiffness (m,) that converts lengths into forces in the law. It is the mean
            diagonal stiffness of a point's free components, or 1 if there are none.
        springs: stiffness (free,) of the springs of the free motions, see
            `solve_with_softening_springs`.
        stiffness: reduced stiffness.
        force_operator: matrix (n, m dim) that distributes contact forces to the equations.
        n_solves: number of linear systems solved.
        tangent: matrix of the contact system and its solver.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        interface: ContactInterface,
        free_motions: FreeMotionIndices,
        solver: LinearSolver,
        torque_map: TorqueMap,
    ) -> None:
        self.reduction, self.interface, self.free_motions = reduction, interface, free_motions
        self.springs: Array = np.zeros(len(free_motions))
        self._torque_map = torque_map
        self.comm: MPI.Comm = interface.comm
        self.n_solves = 0
        # stiffness that is never assembled, with that of forces that move with the bodies
        self._matrix_free_stiffness = K
        self._stiffness_with_added_matrix = StiffnessWithAddedMatrix(K)
        if has_separate_supports(solver):
            if interface.mortars:
                self._matrix_free_stiffness = matrix_from_python_context(
                    K.getSizes(), self._stiffness_with_added_matrix, K.comm
                )
            self.stiffness = matrix_free_constrained_operator(
                reduction, self._matrix_free_stiffness
            )
        else:
            self.stiffness = reduction.matrix(K)
        self._motion_sizes = interface.motion.copy()
        motion_csr = interface.motion.getValuesCSR()
        self._motion_sizes.setValuesCSR(*motion_csr[:2], np.abs(motion_csr[2]))
        self._motion_sizes.assemble()
        first_row, end_row = self.stiffness.getOwnershipRange()
        has_equation = interface.equation >= 0
        self._equations = np.where(has_equation, interface.equation - first_row, -1)
        # forces that are unknowns, if nodes belong to several pairs
        self._additional: AdditionalForces | None = None
        self._additional_solution: Array = np.zeros(self._equations.shape)
        if interface.shared_nodes.exist:
            self._additional = AdditionalForces(
                interface.shared_nodes, self._equations, self.stiffness
            )
            self._equations = self._additional.law_equations
        n_rows = end_row - first_row
        # local numbers of the equations that the law replaces
        self._replaced = self._equations[(self._equations >= 0) & (self._equations < n_rows)]
        self.set_force_operator(interface.force)
        self.tangent: ContactTangent
        self._krylov_tangent: KrylovTangent | None = None
        self._motion = interface.motion
        reduced_motion = extract_local_rows(
            interface.motion.matMult(reduction.right), len(free_motions)
        )
        motion_diagonal = extract_entries_at_own_equations(reduced_motion, interface.equation)
        if has_separate_supports(solver):
            if any(axis == interface.position.shape[1] for _, axis in free_motions):
                raise ValueError(
                    "Iterative() does not support surfaces that are free to turn: use Direct()"
                )
            assert reduction.supports is not None, "checks of arguments reject other reductions"
            self._node_equations = np.where(has_equation, interface.equation - first_row, -1)
            stiffness = K.getDiagonal().array_r[self._node_equations] * self._force_factor
            stiffness = stiffness[interface.shared_nodes.first_point]
            self.law_scale = masked_row_mean_or_one(stiffness / motion_diagonal, has_equation)
            owned_matrices = [self.stiffness]
            if interface.mortars:
                owned_matrices.append(self._matrix_free_stiffness)
            self.tangent = self._krylov_tangent = KrylovTangent(
                K,
                reduction.supports,
                self._make_contact_point_operators(interface.motion),
                solver,
                owned_matrices,
            )
            return
        self._reduced_motion = self._insert_additional_columns(reduced_motion)
        self._borders = make_map_from_free_motions_to_points(
            free_motions,
            interface.pair,
            torque_map.V.shape[2],
            n_empty_columns=self._reduced_motion.shape[1] - len(free_motions),
        )
        local_forces, contact_rows, csr = (
            self._assemble_contact_force_rows_contact_rows_and_matrix()
        )
        columns = interface.equation
        if self._additional is not None:
            columns = self._additional.convert_to_columns(columns)
        force_diagonal = extract_entries_at_own_equations(local_forces, columns)
        force_diagonal = force_diagonal[interface.shared_nodes.first_point]
        self.law_scale = masked_row_mean_or_one(force_diagonal / motion_diagonal, has_equation)
        sizes = len(csr[0]) - 1, local_forces.shape[1]
        matrix = PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=self.comm)
        has_enclosed_pressure = partial(
            has_free_constant_pressure, self.stiffness, reduction, self._replaced
        )
        n_borders = len(csr[0]) - 1 - n_rows
        if self._additional is not None:
            first_row = self._additional.first_row
            n_borders -= self._additional.n_local
        self.tangent = AssembledTangent(
            matrix, contact_rows, first_row, n_borders, solver, has_enclosed_pressure
        )

    def _make_contact_point_operators(
        self, relative_displacement: PETSc.Mat
    ) -> ContactPointOperators:
        """Return the operators of the contact points for a solver that assembles no matrix.

        `relative_displacement` (m dim, n) gives the displacements of the points relative to the
        opposite surfaces.
        """
        return ContactPointOperators.from_interface(
            self.interface,
            self._motion,
            relative_displacement,
            self._reduced_force,
            self._opposite_force,
            self._node_equations,
            self._equations,
            self._force_factor,
            self.law_scale,
            self.free_motions,
        )

    def with_interface(self, interface: ContactInterface) -> "ContactSystem":
        """Return the system with an interface that differs in friction only.

        Matrices, factors and tangent are shared.
        """
        changed = copy(self)
        changed.interface = interface
        return changed

    def _assemble_contact_force_rows_contact_rows_and_matrix(
        self,
    ) -> tuple[sp.csr_matrix, ContactLawRows, CsrArrays]:
        """Return the force rows, the rows of the contact points, and arrays of the whole matrix.

        The force rows are the matrix (m dim, n) that turns displacements into contact forces.
        """
        K, is_additional = self.stiffness, self.interface.shared_nodes.is_additional
        equation = np.where(is_additional[:, None], -1, self.interface.equation).ravel()
        sizes = self._reduced_force.getSizes()
        L = matrix_with_single_entry_rows(equation, sizes, self.comm, self._force_factor.ravel())
        forces = L.matMult(K)
        if self._opposite_force is not None:
            eliminated = self._opposite_force.transposeMatMult(forces)
            add_scaled(eliminated, 1.0, K, destroy_term=False)
            K = eliminated
        eliminated, local_forces = (
            extract_local_rows(matrix, len(self.free_motions)) for matrix in (K, forces)
        )
        if self._additional is not None:
            eliminated, local_forces = self._additional.extend_rows(
                eliminated, local_forces, self._opposite_force
            )
        rows = ContactLawRows(local_forces, self._reduced_motion, self._borders, self._equations)
        border = gather_balance_rows_on_last_rank(
            self._assemble_force_balance_contributions(local_forces), self.springs, self.comm
        )
        return (
            local_forces,
            rows,
            replace_contact_rows_and_append_balance_rows(eliminated, rows, border),
        )

    def _assemble_force_balance_contributions(self, force_rows: sp.csr_matrix) -> sp.coo_matrix:
        """Return contributions (free, n) of this process' points to the balances of free motions.

        Explicit zeros are kept, because the sparsity pattern must not depend on values.

        Args:
            force_rows: matrix (m dim, n) that turns displacements into contact forces.
        """
        (m, dim), torque_map = self._equations.shape, self._torque_map
        row, column, value = ([np.empty(0, dtype)] for dtype in (np.int64, np.int64, float))
        for motion_number, (pair, axis) in enumerate(self.free_motions):
            pair_points = np.flatnonzero(self.interface.pair == pair)
            operators: list[tuple[sp.csr_matrix, int, Array]] = [
                (force_rows, axis, np.ones((m, 1)))
            ]
            if axis == dim:
                factors = torque_map.V[:, :, axis], -torque_map.w, torque_map.w
                sources = force_rows, self._reduced_motion, self._borders
                operators = [
                    (rows, 0, factor) for rows, factor in zip(sources, factors, strict=True)
                ]
            for rows, first_axis, point_factors in operators:
                rows_per_point, factor = rows.shape[0] // max(m, 1), point_factors[pair_points]
                row_number = (
                    first_axis + pair_points[:, None] * rows_per_point + np.arange(factor.shape[1])
                )
                entries = rows[row_number.ravel()].tocoo()
                row.append(np.full(entries.nnz, motion_number))
                column.append(entries.col)
                value.append(factor.ravel()[entries.row] * entries.data)
        indices = np.concatenate(row), np.concatenate(column)
        shape = len(self.free_motions), force_rows.shape[1]
        return sp.coo_matrix((np.concatenate(value), indices), shape)

    def set_force_operator(self, force_operator: PETSc.Mat) -> None:
        """Set the force operator (n, m dim), which distributes contact forces to the equations."""
        self.force_operator = force_operator
        self._reduced_force = force_operator.transposeMatMult(
            self.reduction.left
        )  # (m dim, equations)
        self._force_factor, self._opposite_force = split_force_operator_at_own_equations(
            self._reduced_force, self.interface.equation
        )

    def update_stiffness(self, K: PETSc.Mat, torque_map: TorqueMap) -> None:
        """Update the matrix for a new stiffness (n, n) and torque map.

        The sparsity pattern and `law_scale` do not change.
        """
        self._torque_map = torque_map

        def assemble() -> tuple[ContactLawRows, CsrArrays]:
            self.stiffness = reduce_matrix(self.reduction, K)
            return self._assemble_contact_force_rows_contact_rows_and_matrix()[1:]

        self.tangent.update_stiffness(assemble, pattern_changed=False)

    def update_stiffness_and_motion_operator(
        self,
        body_stiffness: PETSc.Mat,
        added_stiffness: PETSc.Mat,
        torque_map: TorqueMap,
        motion_operator: PETSc.Mat,
    ) -> PETSc.Mat:
        """Update the matrix for a new stiffness, torque map and motion operator.

        Args:
            body_stiffness: stiffness (n, n) of the bodies alone.
            added_stiffness: stiffness (n, n) of forces that move with the bodies. It may be changed
                in place.
            torque_map: map from motions of the surfaces to velocities of the contact nodes.
            motion_operator: motion operator (m p, n), with p motions per contact point. Its
                sparsity pattern and that of the added stiffness may change.

        Returns:
            The sum (n, n) of both stiffnesses, which an iterative solver does not assemble.
        """
        self._torque_map, self._motion = torque_map, motion_operator
        if self._krylov_tangent is not None:
            self._stiffness_with_added_matrix.added = added_stiffness
            self._krylov_tangent.update_stiffness_and_points(
                self._make_contact_point_operators(self.force_operator.transpose(PETSc.Mat())),
                added_stiffness,
            )
            return self._matrix_free_stiffness
        K = added_stiffness
        add_scaled(K, 1.0, body_stiffness, destroy_term=False)

        def assemble() -> tuple[ContactLawRows, CsrArrays]:
            self.stiffness = reduce_matrix(self.reduction, K)
            self._reduced_motion = self._insert_additional_columns(
                extract_local_rows(
                    motion_operator.matMult(self.reduction.right), len(self.free_motions)
                )
            )
            return self._assemble_contact_force_rows_contact_rows_and_matrix()[1:]

        self.tangent.update_stiffness(assemble, pattern_changed=True)
        return K

    def _insert_additional_columns(self, rows: sp.csr_matrix) -> sp.csr_matrix:
        return rows if self._additional is None else self._additional.insert_columns(rows)

    def update_stiffness_and_free_motion_springs(self, K: PETSc.Mat, springs: Array) -> None:
        """Update the matrix for a new stiffness (n, n) and new springs (free,) of free motions."""
        self.springs = springs
        self.update_stiffness(K, self._torque_map)

    def set_initial_iterate(self, get_unknowns: Callable[[], PETSc.Vec], q: Array) -> None:
        """Set the initial iterate of an iterative solver.

        Args:
            get_unknowns: function that returns all unknowns (n,).
            q: motions (pairs, k) of the surfaces.
        """

        def unknowns_divided_by_reduction_diagonal() -> Array:
            scale = self.reduction.right.getDiagonal().array_r
            return np.divide(get_unknowns().array_r, scale, out=0 * scale, where=scale != 0)

        self.tangent.set_initial_iterate(
            unknowns_divided_by_reduction_diagonal, self.select_free_motions(q)
        )

    def select_free_motions(self, q: Array) -> Array:
        """Return the free components (free,) of the surfaces' motions q (pairs, k)."""
        return np.array([q[index] for index in self.free_motions])

    def solve(
        self,
        load: PETSc.Vec,
        law: LinearisedContactLaw,
        free_motion_loads: Array,
        *,
        torque_map: TorqueMap,
        accuracy: LinearSolveAccuracy = "final",
        friction_springs: Array | float = 0.0,
    ) -> ContactSystemSolution:
        """Solve equilibrium under a load, with the linearised law at every contact point.

        Args:
            load: load vector (n_r,), reduced by the supports.
            law: linearised law, in which only the free motions of surfaces are unknown. All other
                motions of surfaces are contained in its right-hand side.
            free_motion_loads: prescribed forces and torques (free,) of the free motions.
            torque_map: map from motions of the surfaces to velocities of the contact nodes.
            accuracy: accuracy of the solution, used only by iterative solvers.
            friction_springs: stiffness (free,) that support friction adds to the free motions.
        """
        self.n_solves += 1
        solution = self.solve_with_last_matrix(
            load,
            law,
            free_motion_loads,
            torque_map=torque_map,
            accuracy=accuracy,
            friction_springs=friction_springs,
        )
        self._additional_solution = solution.additional_forces
        return solution

    def solve_with_last_matrix(
        self,
        load: PETSc.Vec,
        law: LinearisedContactLaw,
        free_motion_loads: Array,
        *,
        torque_map: TorqueMap,
        accuracy: LinearSolveAccuracy,
        friction_springs: Array | float,
    ) -> ContactSystemSolution:
        """Solve the last linear system again, for another load or right-hand side of the law.

        The arguments are those of `solve`. The solution is not counted, because it needs no factors
        of its own.
        """
        if self.free_motions:
            self.tangent.set_free_motion_springs(
                np.broadcast_to(friction_springs, len(self.free_motions))
            )
        rhs, balance_rhs = self.assemble_right_hand_sides(load, law, free_motion_loads, torque_map)
        solution = self.tangent.solve(rhs, balance_rhs, law, accuracy)
        reduced_unknowns = load.duplicate()
        reduced_unknowns.setArray(solution.unknowns[: load.getLocalSize()])
        additional_forces = self._additional_solution
        if self._additional is not None:
            additional_forces = self._additional.expand_solution(solution.unknowns)
        motions, last_rank = np.zeros(len(self.free_motions)), self.comm.size - 1
        if self.comm.rank == last_rank:
            motions[:] = solution.unknowns[len(rhs) :]
        self.comm.Bcast(motions, last_rank)
        return ContactSystemSolution(
            reduced_unknowns,
            motions,
            additional_forces,
            solution.is_exact,
            solution.is_final,
        )

    def assemble_right_hand_sides(
        self,
        load: PETSc.Vec,
        law: LinearisedContactLaw,
        free_motion_loads: Array,
        torque_map: TorqueMap,
    ) -> tuple[Array, Array]:
        """Return right-hand sides (n,) of this process' equations and (free,) of all free motions.

        Args:
            load: load vector (n_r,), reduced by the supports.
            law: linearised law.
            free_motion_loads: prescribed forces and torques (free,) of the free motions.
            torque_map: map from motions of the surfaces to velocities of the contact nodes.
        """
        point_load = self._extract_nodal_forces(load)
        rhs = self._eliminate_forces_at_opposite_nodes(load, point_load)
        if self._additional is not None:
            rhs = self._additional.append_to_right_hand_side(rhs)
        has_equation = self._equations >= 0
        law_right = np.einsum("nab,nb->na", law.E, point_load) + law.c
        rhs[self._equations[has_equation]] = law_right[has_equation]
        if not self.free_motions:
            return rhs, free_motion_loads
        balance = torque_map.compute_force_and_torque_of_each_point(point_load)
        balance[:, -1] -= np.sum(torque_map.w * torque_map.d0, axis=1)
        return rhs, free_motion_loads + self.sum_forces_by_free_motion(balance)

    def convert_force_weights_to_equation_weights(self, force_weights: Array) -> PETSc.Vec:
        """Return weights of the reduced equations that give a weighted sum of contact forces.

        Let r (m, dim) be the nodal contact forces. The sum of stiffness times displacements,
        weighted with the result, equals the sum of r weighted with `force_weights` (m, dim).
        """
        has_equation, weights = self._equations >= 0, self.reduction.left.createVecRight()
        weights.array[self._equations[has_equation]] = (force_weights * self._force_factor)[
            has_equation
        ]
        return weights

    def extract_own_equation_values(self, equation_values: Array) -> Array:
        """Return the values (m, dim) at the contact points' own equations.

        The array `equation_values` (n,) has one value for each equation of this process. The result
        is 0 for components without an equation.
        """
        return np.where(self._equations >= 0, equation_values[self._equations], 0.0)

    def split_residual_into_contact_and_unbalanced_forces(
        self, residual: PETSc.Vec, additional_forces: Array | None = None
    ) -> tuple[Array, Array]:
        """Split the residual into contact forces and unbalanced forces.

        Args:
            residual: stiffness times displacements minus load, (n_r,), reduced by the supports.
            additional_forces: forces (m, dim) of the points, of which only those at points that are
                not the first one at their node are used. By default, the last solution of `solve`.

        Returns:
            Nodal contact forces (m, dim), and magnitudes (n_r,) of the unbalanced forces in this
            process' equations.
        """
        forces = self._extract_nodal_forces(residual)
        if self._additional is not None:
            if additional_forces is None:
                additional_forces = self._additional_solution
            forces = self._additional.subtract_from_node_forces(forces, additional_forces)
        unbalanced = np.abs(self._eliminate_forces_at_opposite_nodes(residual, forces))
        unbalanced[self._replaced] = 0.0
        return forces, unbalanced

    def evaluate_relative_point_displacements(self, unknowns: PETSc.Vec) -> Array:
        """Return the displacements (m, dim) of the contact points relative to the opposite side.

        They are the product of the undeformed bodies' motion operator and all `unknowns` (n,).
        """
        return np.array((self.interface.motion * unknowns).array_r.reshape(self._equations.shape))

    def evaluate_point_motions(self, unknowns: PETSc.Vec) -> Array:
        """Return the p motions (m, p) of each contact point in the law, for all unknowns (n,)."""
        m, dim = self._equations.shape
        n_motions = dim * self._motion.getSize()[0] // self.interface.motion.getSize()[0]
        return np.array((self._motion * unknowns).array_r.reshape(m, n_motions))

    def compute_round_off_scale_of_motions(self, unknowns: PETSc.Vec) -> Array:
        """Return magnitudes (m, dim) to which the round-off of the points' motions is proportional.

        They are the products of the absolute values of the motion operator and of all unknowns
        (n,).
        """
        magnitude = unknowns.copy()
        magnitude.abs()
        return np.array((self._motion_sizes * magnitude).array_r.reshape(self._equations.shape))

    def sum_forces_by_free_motion(self, point_forces: Array) -> Array:
        """Return the sum of the contact points' forces for each free motion (free,); collective.

        The forces `point_forces` (m, k) of this process' points are components along the k motions
        of their surfaces.
        """
        pair = self.interface.pair
        sums = np.array([point_forces[pair == k, axis].sum() for k, axis in self.free_motions])
        self.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return sums

    def compute_relative_balance_residuals(
        self,
        point_forces: Array,
        q: Array,
        free_motion_loads: Array,
        torque_map: TorqueMap,
        reference_force: float,
    ) -> Array:
        """Return the unbalanced forces and torques (free,) of the free motions, divided by a force.

        Torques are also divided by the longest lever arm.

        Args:
            point_forces: forces (m, dim) of the surfaces on the contact points.
            q: motions (pairs, k) of the surfaces.
            free_motion_loads: prescribed forces and torques (free,) of the free motions.
            torque_map: map from motions of the surfaces to velocities of the contact nodes.
            reference_force: force by which the unbalanced forces are divided.
        """
        if not self.free_motions:
            return np.zeros(0)
        unbalanced = (
            self.sum_forces_by_free_motion(
                torque_map.compute_force_and_torque_of_each_point(point_forces)
            )
            - free_motion_loads
        )
        unbalanced += self.springs * self.select_free_motions(q)
        return np.asarray(
            np.abs(unbalanced) / (reference_force * self._longest_lever_arms(torque_map))
        )

    def _longest_lever_arms(self, torque_map: TorqueMap) -> Array:
        """Return the longest lever arm (free,) of each free motion; 1 for translations."""
        dim = torque_map.V.shape[1]
        if all(axis < dim for _, axis in self.free_motions):
            return np.ones(len(self.free_motions))
        arm = np.linalg.norm(torque_map.V, axis=1)
        pair, tiny = self.interface.pair, np.finfo(float).tiny
        longest = np.array(
            [arm[pair == k, axis].max(initial=tiny) for k, axis in self.free_motions]
        )
        self.comm.Allreduce(MPI.IN_PLACE, longest, MPI.MAX)
        return longest

    def _extract_nodal_forces(self, equation_values: PETSc.Vec) -> Array:
        """Return the nodal forces (m, dim) of the contact points in a vector of equation values.

        The vector has one value, such as a load or residual, for each reduced equation. The result
        is 0 for components that have no equation because supports prescribe them. At a node with
        several points, the first point has the whole force, and all others have none.
        """
        values = equation_values.array_r
        if self._additional is not None:
            values = self._additional.append_to_right_hand_side(values)
        return self.extract_own_equation_values(values) * self._force_factor

    def _eliminate_forces_at_opposite_nodes(
        self, equation_values: PETSc.Vec, point_forces: Array
    ) -> Array:
        """Return the values (n,) of this process' equations without forces at opposite nodes.

        Contact forces are not eliminated from the contact points' own equations, because the law
        replaces these rows.

        Args:
            equation_values: values of the reduced equations.
            point_forces: forces (m, dim) of the contact points in the same vector.
        """
        local: Array = equation_values.array_r.copy()
        if self._opposite_force is None:
            return local
        forces, opposite = self._opposite_force.createVecLeft(), equation_values.duplicate()
        forces.setArray(point_forces)
        self._opposite_force.multTranspose(forces, opposite)
        return local + opposite.array_r


def measure_cost(
    systems: Sequence[ContactSystem], before: SolveCountAndReport = NO_COST
) -> SolveCountAndReport:
    """Return the cost of all solutions with the given contact systems.

    The cost `before` is subtracted. The report names the method of the last system.
    """
    n_solves, factorisations, krylov_iterations = 0, 0, 0
    for system in systems:
        report = system.tangent.solver.report
        n_solves += system.n_solves
        factorisations += report.factorisations
        krylov_iterations += report.krylov_iterations
    n_solves_before, earlier = before
    return n_solves - n_solves_before, SolverReport(
        report.method,
        factorisations - earlier.factorisations,
        krylov_iterations - earlier.krylov_iterations,
    )
