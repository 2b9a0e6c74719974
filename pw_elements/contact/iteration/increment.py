"""The equations of one increment: equilibrium, kinematics and contact law.

The module solves the linear systems of Newton's method and evaluates the residuals. It guarantees
that the violation of an iterate covers all conditions of the law, all equations that supports do
not eliminate, and all force balances of surfaces. It assumes that arguments have been checked in
the functions called by users. The tangent of a linear equilibrium is constant, and the contact
system keeps its factors.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from pw_elements.algebra import reduce_load_and_update_offset
from pw_elements.arrays import Array
from pw_elements.contact.interface import RELATIVE_COORDINATE_ROUND_OFF, ContactInterface
from pw_elements.contact.iteration.increment_data import LinearisedIncrement, NewtonIterate
from pw_elements.contact.iteration.support_friction import FrictionAtSupportedNodes
from pw_elements.contact.model import NotUnique, Residuals, ResidualScale, SolutionNotFound
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    OPEN,
    ActiveSet,
    ContactKinematics,
    FrictionAtSharedNodes,
    IncrementStart,
    InterfaceLawNodes,
    LinearisedKinematics,
    TorqueMap,
    combine_active_sets,
    describe_status_counts,
    eliminate_known_motions,
    evaluate_laws_that_hold_free_surfaces,
)
from pw_elements.contact.system import (
    ContactSystem,
    ContactSystemSolution,
    Equilibrium,
    LinearSolveAccuracy,
)
from pw_elements.solvers import SingularSystem

# Round-off in the product of stiffness K and displacements a, relative to |K| |a|
RELATIVE_DISPLACEMENT_ROUND_OFF = 1e-13
# Relative change of the friction coefficient by which a singular tangent becomes regular; and
# largest relative difference, between the solutions with slightly less and slightly more friction,
# at which the solution counts as a continuous function of friction
_RELATIVE_FRICTION_PERTURBATION_IF_SINGULAR = 1e-6
_MAX_RELATIVE_CHANGE_BY_FRICTION_PERTURBATION = 1e-3
# Pressure of touching nodes at which interface laws are linearised first, as a length that is
# multiplied by the stiffness of the law, relative to the extent of the contact nodes
_INITIAL_PRESSURE_LENGTH_PER_EXTENT = 1e-6


@dataclass(frozen=True)
class LinearEquilibrium:
    """Equilibrium of a body at small strains, reduced by its supports.

    Args:
        stiffness: reduced stiffness (n_r, n_r), the constant tangent.
        load: reduced load (n_r,).
        right: matrix (n, n_r) that expands reduced displacements to all unknowns.
        prescribed_displacements: prescribed displacements (n,), which are added to the expanded
            displacements.
        max_row_sum: largest absolute row sum of the full stiffness.
    """

    stiffness: PETSc.Mat
    load: PETSc.Vec
    right: PETSc.Mat
    prescribed_displacements: PETSc.Vec
    max_row_sum: float = 0.0

    requires_accurate_last_linear_solve = True

    @classmethod
    def from_stiffness(
        cls,
        system: ContactSystem,
        K: PETSc.Mat,
        load: PETSc.Vec,
        prescribed_displacement_factor: float = 1.0,
    ) -> "LinearEquilibrium":
        """Return the equilibrium under a load, reduced by the supports.

        Args:
            system: contact system, which contains the reduction by the supports.
            K: stiffness (n, n).
            load: load vector (n,).
            prescribed_displacement_factor: factor of the prescribed displacements.
        """
        reduction = system.reduction
        if prescribed_displacement_factor != 1:
            reduction = replace(reduction, offset=prescribed_displacement_factor * reduction.offset)
        reduction, reduced_load = reduce_load_and_update_offset(reduction, K, load)
        max_row_sum = K.norm(PETSc.NormType.INFINITY)
        return cls(system.stiffness, reduced_load, reduction.right, reduction.offset, max_row_sum)

    def linearise_and_return_load(self, torque_map: TorqueMap) -> PETSc.Vec:  # noqa: ARG002
        return self.load

    def move_towards_and_return_step_length(
        self,
        reduced_unknowns: PETSc.Vec,  # noqa: ARG002
        max_step_length: float = 1.0,  # noqa: ARG002
    ) -> float:
        return 1.0

    def max_imbalance_to_tolerance_ratio(
        self,
        unbalanced_magnitudes: Array,
        tolerance_from_contact_forces: float,
        unknowns: PETSc.Vec,
    ) -> float:
        load, displacement = (v.norm(PETSc.NormType.INFINITY) for v in (self.load, unknowns))
        round_off = RELATIVE_DISPLACEMENT_ROUND_OFF * self.max_row_sum * displacement
        allowed = (
            tolerance_from_contact_forces + MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * load + round_off
        )
        max_unbalanced = float(unbalanced_magnitudes.max(initial=0.0))
        return max_unbalanced / allowed if max_unbalanced else 0.0

    def residual_without_contact(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:
        residual = self.load.duplicate()
        self.stiffness.mult(reduced_unknowns, residual)
        residual.axpy(-1.0, self.load)
        return residual

    def all_unknowns(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:
        unknowns = self.prescribed_displacements.duplicate()
        self.right.multAdd(reduced_unknowns, self.prescribed_displacements, unknowns)
        return unknowns


class IncrementEquations:
    """The equations of one increment.

    Args:
        system: contact system, which solves the linear equations.
        equilibrium: equilibrium of the body at the end of the increment.
        kinematics: kinematics of the contact points since the start of the increment.
        start: state at the start of the increment, from which slip is measured.
        prescribed: prescribed motions (pairs, k) of the surfaces, NaN where a motion is free.
        totals: prescribed forces and torques (free,) of the free motions.

    Attributes:
        best_state: iterate with the smallest violation so far; None before the first iteration.
    """

    def __init__(
        self,
        system: ContactSystem,
        equilibrium: Equilibrium,
        kinematics: ContactKinematics,
        start: IncrementStart,
        *,
        prescribed: Array,
        totals: Array,
    ) -> None:
        self.system, self.equilibrium, self.start = system, equilibrium, start
        self.interface: ContactInterface = system.interface
        self.kinematics = kinematics
        self.prescribed_motions, self.free_motion_forces = prescribed, totals
        self.best_state: NewtonIterate | None = None
        # forces (m, dim) of the last iterate, from which equilibrium does not follow at points that
        # are not the first one at their node
        self._point_forces: Array = start.force
        self._shared_friction: FrictionAtSharedNodes | None = None
        if self.interface.shared_nodes.exist:
            self._shared_friction = FrictionAtSharedNodes(self.interface, start)
        self._support_displacement = system.evaluate_relative_point_displacements(
            equilibrium.prescribed_displacements
        )

    def add_initial_interface_laws(
        self, active: ActiveSet, kinematics: LinearisedKinematics, v: Array, q: Array
    ) -> ActiveSet:
        """Return the active set with the interface laws linearised at the initial iterate.

        Nodes without a force that are closed in the active set get a small pressure, so that laws
        of contact take them as closed, too. Surfaces that move freely under a force are moved
        until a law resists.

        Args:
            active: active set.
            kinematics: kinematics linearised at the initial iterate.
            v: (m, p), motions of the points.
            q: (pairs, k), motions of the surfaces.
        """
        if self.interface.laws is None:
            return active
        scale, force = self.system.law_scale, self.start.force
        length = _INITIAL_PRESSURE_LENGTH_PER_EXTENT * self.interface.max_extent_of_points
        is_unloaded = (active.status != OPEN) & ~force.any(axis=1)
        pressure = np.where(is_unloaded, scale * length, 0.0)
        force = force + pressure[:, None] * kinematics.frame[:, 0]
        direction = np.zeros_like(q)
        for index, value in zip(self.system.free_motions, self.free_motion_forces, strict=True):
            direction[index] = value if index[1] < self.start.force.shape[1] else 0.0
        nodes = evaluate_laws_that_hold_free_surfaces(
            self.interface,
            lambda q: kinematics.evaluate_contact_nodes(
                v, q, force, cone=self.interface.cone, law_scale=scale
            ),
            q,
            direction,
            active,
            self.start.history,
            first_step=length,
        )
        active = combine_active_sets(nodes.at_law, nodes.active_set, active)
        return replace(active, interface_law=nodes.active_set.interface_law)

    @cached_property
    def support_friction(self) -> FrictionAtSupportedNodes:
        """Friction at nodes that supports hold along a surface with friction."""
        return FrictionAtSupportedNodes(
            self.system, self.start, self.prescribed_motions, self._support_displacement
        )

    def add_initial_support_friction(
        self, active: ActiveSet, kinematics: LinearisedKinematics
    ) -> ActiveSet:
        """Return the active set, completed by the support friction at the start of the increment.

        Support friction acts at nodes that supports hold along a surface with friction.
        """
        if not self.interface.holds_friction:
            return active
        return self.support_friction.fill_zero_friction_from_start(active, kinematics)

    def solve_linearised_system(
        self, active: ActiveSet, kinematics: LinearisedKinematics, accuracy: LinearSolveAccuracy
    ) -> NewtonIterate:
        """Solve the linear system of an active set; return the iterate with its residuals.

        Raises:
            SingularSystem: if the tangent is singular.
            NotConverged: if an iterative solver fails.
        """
        system = self.system
        load = self.equilibrium.linearise_and_return_load(kinematics.torque_map)
        is_free = np.isnan(self.prescribed_motions)
        known_q = np.where(is_free, 0.0, self.prescribed_motions)[self.interface.pair]
        known_v = system.evaluate_point_motions(self.equilibrium.prescribed_displacements)
        shared = self._shared_friction
        friction_to_keep = None if shared is None else shared.select_friction_to_keep(active)
        law = kinematics.linearise_law(active, system.law_scale, friction_to_keep)
        law = eliminate_known_motions(law, known_q, known_v)
        torque_map = kinematics.torque_map.eliminate_known_motions(
            known_q, self._support_displacement
        )
        totals: Array = self.free_motion_forces
        springs: Array = np.zeros(len(system.free_motions))
        if self.interface.holds_friction and system.free_motions:
            totals, springs = self.support_friction.subtract_friction_and_get_stiffness(
                totals, active, kinematics
            )
        linear_system = LinearisedIncrement(
            active,
            kinematics,
            law,
            totals,
            torque_map,
            springs,
            known_q,
            known_v,
            self._point_forces,
        )
        solution = system.solve(
            load,
            law,
            totals,
            torque_map=torque_map,
            accuracy=accuracy,
            friction_springs=springs,
        )
        return self.choose_next_iterate(linear_system, solution)

    def choose_next_iterate(
        self, linear_system: LinearisedIncrement, solution: ContactSystemSolution
    ) -> NewtonIterate:
        """Move to the solution of a linear system, or as far towards it as the body allows."""
        return self.move_and_evaluate(linear_system, solution)

    def move_and_evaluate(
        self,
        linear_system: LinearisedIncrement,
        solution: ContactSystemSolution,
        max_step_length: float = 1.0,
    ) -> NewtonIterate:
        """Move towards the solution of a linear system; return the new iterate with its residuals.

        Args:
            linear_system: the linear system.
            solution: its solution, to which a step of length 1 leads.
            max_step_length: largest length of the step.
        """
        equilibrium, kinematics = self.equilibrium, linear_system.kinematics
        q = self.prescribed_motions.copy()
        q[np.isnan(q)] = solution.free_motions
        step_length = equilibrium.move_towards_and_return_step_length(
            solution.reduced_unknowns, max_step_length
        )
        forces = linear_system.point_forces
        forces = forces + step_length * (solution.additional_forces - forces)
        if step_length < 1:
            q = kinematics.q0 + step_length * (q - kinematics.q0)
            self.system.set_initial_iterate(
                lambda: equilibrium.all_unknowns(solution.reduced_unknowns), q
            )
        state = self.evaluate_all_conditions(
            solution.reduced_unknowns,
            q,
            kinematics,
            additional_forces=forces,
            previous_support_friction=linear_system.active.support_friction,
            is_exact=solution.is_exact,
            is_final=solution.is_final or not equilibrium.requires_accurate_last_linear_solve,
        )
        return replace(state, step_length=step_length)

    def evaluate_all_conditions(
        self,
        reduced_unknowns: PETSc.Vec,
        surface_motions: Array,
        kinematics: LinearisedKinematics,
        *,
        additional_forces: Array,
        previous_support_friction: Array | None = None,
        is_exact: bool = True,
        is_final: bool = True,
    ) -> NewtonIterate:
        """Evaluate all conditions for given displacements and surface motions.

        Args:
            reduced_unknowns: displacements (n_r,), reduced by the supports.
            surface_motions: motions (pairs, k) of the surfaces.
            kinematics: kinematics of the linear system that was solved.
            additional_forces: forces (m, dim) of the points. Only those at points that are not the
                first one at their node are used; all others follow from equilibrium.
            previous_support_friction: support friction (m, dim - 1) of the previous iteration; by
                default, the support friction at the start of the increment.
            is_exact: whether solving the linear system again would not improve the accuracy.
            is_final: whether the linear system was solved to the final accuracy.
        """
        interface, system = self.interface, self.system
        unknowns = self.equilibrium.all_unknowns(reduced_unknowns)
        residual = self.equilibrium.residual_without_contact(reduced_unknowns)
        displacement = system.evaluate_relative_point_displacements(unknowns)
        displacement_size = system.compute_round_off_scale_of_motions(unknowns)
        force, unbalanced = system.split_residual_into_contact_and_unbalanced_forces(
            residual, additional_forces
        )
        self._point_forces = force
        kinematics, v = self.kinematics.kinematics_and_point_motions_at_iterate(
            kinematics, surface_motions, displacement, force
        )
        nodes = kinematics.evaluate_contact_nodes(
            v, surface_motions, force, cone=interface.cone, law_scale=system.law_scale
        )
        if interface.holds_friction:
            if previous_support_friction is None:
                previous_support_friction = self.support_friction.friction_at_increment_start(
                    kinematics
                )
            nodes, force = self.support_friction.add_friction_to_nodal_forces(
                nodes, kinematics, force, previous_support_friction
            )
        if self._shared_friction is not None:
            self._shared_friction.update(nodes)
        if interface.laws is not None:
            nodes = InterfaceLawNodes.from_nodes(
                nodes, interface.laws, self.start.history, interface.shared_nodes.is_shared
            )
        max_force, displacement_round_off, coordinate_round_off = (
            self._max_contact_force_and_round_off_forces(
                force, displacement_size, kinematics.torque_map
            )
        )
        state = NewtonIterate(
            reduced_unknowns=reduced_unknowns,
            unknowns=unknowns,
            q=surface_motions,
            displacement=displacement,
            force=force,
            unbalanced=unbalanced,
            nodes=nodes,
            kinematics=kinematics,
            displacement_size=displacement_size,
            allowance=MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * max_force
            + (displacement_round_off + coordinate_round_off),
            round_off=displacement_round_off + coordinate_round_off,
            violation=np.inf,
            is_solution=False,
            is_exact=is_exact,
            is_final=is_final,
        )
        allowed = MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * max_force + displacement_round_off
        violation = self.max_residual_to_tolerance_ratio(state, allowed, coordinate_round_off)
        return replace(state, violation=violation, is_solution=violation <= 1 and is_final)

    def reevaluate_with_kinematics_at_solution(self, state: NewtonIterate) -> NewtonIterate:
        """Return a solution, evaluated again with kinematics linearised at this solution.

        A state that is not a solution is returned unchanged. A solution is returned unchanged if
        the new kinematics violate a condition although the surfaces have moved by no more than the
        tolerance: the violation is then attributed to noise in the derivatives of the surfaces.
        """
        if not state.is_solution:
            return state
        kinematics = self.kinematics.relinearise_at_solution_if_needed(
            state.kinematics, state.q, state.displacement, state.force
        )
        if kinematics is state.kinematics:
            return state
        held_friction = np.where(kinematics.held_tangents, state.nodes.force[:, 1:], 0.0)
        relinearised = self.evaluate_all_conditions(
            state.reduced_unknowns,
            state.q,
            kinematics,
            additional_forces=state.force,
            previous_support_friction=held_friction,
            is_exact=state.is_exact,
            is_final=state.is_final,
        )
        if relinearised.violation > 1 and self._are_surfaces_at_linearisation_point(state):
            return state
        return relinearised

    def prefer_friction_of_start(self, state: NewtonIterate) -> NewtonIterate:
        """Return a solution that keeps friction from the start of the increment where it may.

        The law does not determine the friction of nodes that several pairs hold. The given solution
        is returned if friction from the start violates the law.
        """
        if self._shared_friction is None or state.step_length < 1:
            return state
        active = self._shared_friction.restore_friction_of_start(state.nodes, state.allowance)
        if active is None:
            return state
        try:
            restored = self.solve_linearised_system(active, state.kinematics, "final")
            restored = self.reevaluate_with_kinematics_at_solution(restored)
            if restored.is_solution:
                return restored
        except (SolutionNotFound, SingularSystem):
            pass  # the given solution remains
        self.equilibrium.move_towards_and_return_step_length(state.reduced_unknowns)
        return state

    def keep_if_smallest_violation(self, state: NewtonIterate) -> None:
        """Keep the state as `best_state` if its violation is the smallest so far."""
        if self.best_state is None or state.violation < self.best_state.violation:
            self.best_state = state

    def local_relative_residuals(
        self, state: NewtonIterate, reference_force: float, reference_length: Array | float
    ) -> dict[str, Array]:
        """Return the relative residuals at the contact nodes and in the equations of this process.

        The keys are the fields of `Residuals`. Forces are divided by `reference_force`. Lengths are
        divided by `reference_length`, which is a number or one length (m,) per contact node.
        """
        balance = self.system.compute_relative_balance_residuals(
            state.force,
            state.q,
            self.free_motion_forces,
            state.kinematics.torque_map,
            reference_force,
        )
        return state.nodes.relative_residuals(reference_force, reference_length) | {
            "equilibrium": np.asarray(state.unbalanced / reference_force, dtype=float),
            "balance": balance,
        }

    def largest_residuals(
        self, state: NewtonIterate, reference_force: float, reference_length: float
    ) -> Residuals:
        """Return the largest relative residuals on all processes; collective.

        The arguments are those of `local_relative_residuals`.
        """
        residuals = self.local_relative_residuals(state, reference_force, reference_length)
        largest = self.nonnegative_max_over_ranks(*residuals.values())
        return Residuals(**dict(zip(residuals, largest, strict=True)))

    def updated_scale_and_reference_force_and_length(
        self, state: NewtonIterate, start_scale: ResidualScale
    ) -> tuple[ResidualScale, float, float]:
        """Return the updated scale of the load history, and the reference force and length.

        Residuals are divided by the reference force or length. The call is collective.

        Args:
            state: iterate at the end of the increment.
            start_scale: scale at the start of the increment.
        """
        shifts = np.einsum(
            "nak,nk->na", state.kinematics.torque_map.V, state.q[self.interface.pair]
        )
        displacements = np.concatenate([state.displacement_size, shifts])
        force, length, extent, stiffness = self.nonnegative_max_over_ranks(
            np.linalg.norm(state.force, axis=1),
            np.linalg.norm(displacements, axis=1),
            np.abs(self.interface.position),
            self.system.law_scale,
        )
        scale = start_scale
        if force > state.round_off:
            scale = ResidualScale(max(force, start_scale.force), max(length, start_scale.length))
        length = max(length, scale.length)
        length = length if length > RELATIVE_COORDINATE_ROUND_OFF * extent else extent
        force = scale.force or stiffness * length
        return scale, force, length

    def nonnegative_max_over_ranks(self, *arrays: Array) -> list[float]:
        """Return the largest value of each array on all processes, or 0 if it is negative.

        The call is collective.
        """
        maxima = np.array([values.max(initial=0.0) for values in arrays])
        maxima_of_ranks = np.empty((self.system.comm.size, len(maxima)))
        self.system.comm.Allgather(maxima, maxima_of_ranks)
        return [float(value) for value in maxima_of_ranks.max(axis=0)]  # NaN if any value is NaN

    def max_residual_to_tolerance_ratio(
        self, state: NewtonIterate, force_tolerance: float, coordinate_round_off_force: float
    ) -> float:
        """Return the largest ratio of a residual to its tolerance on all processes; collective.

        All residuals are expressed as forces: lengths are multiplied by the stiffness of the law.

        Args:
            state: iterate.
            force_tolerance: tolerance of all residuals, a force.
            coordinate_round_off_force: force that corresponds to the round-off of coordinates. It
                is added to the tolerances of gaps and force balances. The additional tolerance for
                friction is computed from it by `ContactNodes.friction_round_off`.
        """
        nodes = state.nodes
        if self.interface.laws is not None:
            self.interface.laws.raise_kept_error()
        if self.interface.cone.has_user_law:
            self.interface.raise_law_errors_and_check_slopes(nodes.force[:, 0])
        residuals = self.local_relative_residuals(state, 1.0, 1 / nodes.scale)
        friction_round_off = nodes.friction_round_off(coordinate_round_off_force)
        worst = self.equilibrium.max_imbalance_to_tolerance_ratio(
            residuals.pop("equilibrium"),
            force_tolerance + coordinate_round_off_force,
            state.unknowns,
        )
        balance = residuals.pop("balance")
        of_friction = np.array([residuals.pop(name) for name in ("cone", "stick", "direction")])
        of_contact = np.array(list(residuals.values()))
        for values, round_off in (
            (of_friction, friction_round_off),
            (of_contact, coordinate_round_off_force),
            (balance, coordinate_round_off_force),
        ):
            limit = force_tolerance + round_off
            ratio = np.divide(values, limit, out=np.zeros_like(values), where=values != 0)
            max_ratio = float(ratio.max(initial=0.0))
            worst = max(worst, np.inf if np.isnan(max_ratio) else max_ratio)
        return float(self.system.comm.allreduce(worst, MPI.MAX))

    def _are_surfaces_at_linearisation_point(self, state: NewtonIterate) -> bool:
        """Return whether the surfaces have moved by less than the tolerance since linearisation."""
        change = np.abs(state.q - state.kinematics.q0).max()
        max_displacement = self.nonnegative_max_over_ranks(np.abs(state.displacement))[0]
        return bool(change <= MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * max_displacement)

    def _max_contact_force_and_round_off_forces(
        self, contact_force: Array, displacement_size: Array, torque_map: TorqueMap
    ) -> list[float]:
        """Return the largest contact force, and the round-off of displacements and of coordinates.

        Both round-offs are expressed as forces.
        """
        position, scale = self.interface.position, self.system.law_scale[:, None]
        arms = torque_map.V[:, :, position.shape[1] :].sum(axis=2)
        displacement_round_off = scale * (RELATIVE_DISPLACEMENT_ROUND_OFF * displacement_size)
        coordinate_round_off = scale * (
            RELATIVE_COORDINATE_ROUND_OFF * (np.abs(position) + np.abs(arms))
        )
        return self.nonnegative_max_over_ranks(
            np.abs(contact_force), displacement_round_off, coordinate_round_off
        )


class LinearIncrementEquations(IncrementEquations):
    """Equations of an increment at small strains, with a diagnosis of singular tangents.

    No rigid motion is free, so only friction can make the tangent singular.
    """

    equilibrium: LinearEquilibrium

    def solve_linearised_system(
        self, active: ActiveSet, kinematics: LinearisedKinematics, accuracy: LinearSolveAccuracy
    ) -> NewtonIterate:
        """Solve the linear system of an active set; return the iterate with its residuals.

        Raises:
            NotUnique: if the tangent is singular at a solution.
            SolutionNotFound: if the tangent is singular at another iterate.
            NotConverged: if an iterative solver fails.
        """
        try:
            return super().solve_linearised_system(active, kinematics, accuracy)
        except SingularSystem as error:
            solve = super().solve_linearised_system
            raise self._diagnose_singular_tangent(
                active, error, lambda perturbed: solve(perturbed, kinematics, accuracy)
            ) from error

    def _diagnose_singular_tangent(
        self,
        active: ActiveSet,
        error: SingularSystem,
        solve_perturbed_set: Callable[[ActiveSet], NewtonIterate],
    ) -> NotUnique | SolutionNotFound:
        """Return the error to raise for a singular tangent.

        With slightly less or slightly more friction, the tangent is regular. If the equations of
        the active set have solutions, the two perturbed solutions are close to each other.
        Otherwise they diverge in opposite directions.

        Args:
            active: active set with the singular tangent.
            error: error of the linear solver.
            solve_perturbed_set: function that solves the linear system of an active set.
        """
        counts, neighbours = describe_status_counts(active, self.system.comm), []
        for factor in (
            1 - _RELATIVE_FRICTION_PERTURBATION_IF_SINGULAR,
            1 + _RELATIVE_FRICTION_PERTURBATION_IF_SINGULAR,
        ):
            perturbed = replace(
                active,
                limit_slope=factor * active.limit_slope,
                limit_intercept=factor * active.limit_intercept,
            )
            try:
                neighbours.append(solve_perturbed_set(perturbed))
            except SingularSystem:
                break
        else:
            less, more = neighbours
            change = (less.unknowns - more.unknowns).norm()
            is_continuous = (
                change <= _MAX_RELATIVE_CHANGE_BY_FRICTION_PERTURBATION * less.unknowns.norm()
            )
            if (
                is_continuous
                and less.violation * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE
                <= _MAX_RELATIVE_CHANGE_BY_FRICTION_PERTURBATION
            ):
                self.best_state = less
                return NotUnique(
                    f"{error}: no rigid motion is free, so the friction of the {counts} is too "
                    "large for a unique answer"
                )
        return SolutionNotFound(
            f"{error}, though no rigid motion is free: with the friction of the {counts} the "
            "equations have no solution"
        )
