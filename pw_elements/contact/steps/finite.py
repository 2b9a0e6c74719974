"""Solution of increments at large strains and large sliding, for any residual.

An increment that fails is halved, and the substeps grow again after successes. In the initial
iterate, closed nodes stick and move with their surface.

Slip is computed from the positions at both ends of a substep, so a substep must not contain whole
turns. If a rigid surface rotates by more than an eighth of a turn, or if supports move along
a strongly curved path, the increment starts with several substeps.

The module guarantees that states are never changed, and that each returned state has been
verified. It assumes arguments that have been checked by `steps.checks`.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import (
    JoinedProblem,
    PetrovGalerkinProblem,
    Reduction,
    full_size_masking_reduction,
    scale_pressures_to_displacements,
)
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import arguments, call_user_function, raise_errors_on_all_processes
from pw_elements.contact.interface import (
    RELATIVE_COORDINATE_ROUND_OFF,
    ContactInterface,
    build_interface,
    make_interface_laws,
)
from pw_elements.contact.iteration import (
    CellInversionCheck,
    IncrementEquations,
    LargeStrainActiveSetUpdate,
    LargeStrainEquilibrium,
    LineSearchIncrementEquations,
    NewtonIterate,
    SlidingBodiesEquilibrium,
    TargetLoadsAndMotions,
    UpdateKeepingCyclingSetsUntilSolved,
    check_interface_laws_at_solution,
    close_nearest_nodes_of_free_surfaces,
    interpolate_targets,
    make_contact_state,
    open_points_with_dependent_normals,
    raise_if_force_shares_are_not_unique,
    solve_increment,
)
from pw_elements.contact.model import (
    SNAP_BACK_EXPLANATION,
    ActiveSetCycling,
    ContactPair,
    ContactState,
    FreeMotionIndices,
    LinearSolverFailed,
    Motion,
    ResidualScale,
    SolutionNotFound,
    describe_exhausted_friction,
)
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    OPEN,
    LargeStrainKinematics,
    MortarKinematics,
    NoDeformablePairs,
    RigidSurfaceMotion,
    make_increment_start,
    make_sticking_active_set,
    read_interface_fields,
)
from pw_elements.contact.output import (
    ProgressCallback,
    ProgressReporter,
    ResidualCoefficients,
    ResidualFingerprint,
)
from pw_elements.contact.rescue import (
    BodySupports,
    LoadFractionSetter,
    combine_substeps_with_summed_slip,
    count_equal_nearly_straight_segments,
    find_rigidly_moved_contact_free_start,
    interpolate_placements_and_path,
    raise_if_slave_nodes_pass_through_master,
    raise_if_supports_meet_or_pass,
    raise_if_tools_reach_or_pass_supports,
    round_up_to_power_of_two,
    solve_in_substeps,
    warn_if_slip_and_path_slip_differ,
)
from pw_elements.contact.steps.sensitivity import EquationsLinearisedAtEnd, IncrementOrSubstep
from pw_elements.contact.steps.verification import (
    VerificationScales,
    check_stiffness_sign,
    make_nodal_torque_function,
    measure_large_strain_kinematics,
    verify_state,
)
from pw_elements.contact.system import (
    ContactSystem,
    measure_cost,
)
from pw_elements.elasticity import (
    SINGULAR_STIFFNESS_WARNING_AND_REMEDY,
    TangentBulkShearMonitor,
    is_axisymmetric_residual,
)
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import LinearSolver, NotConverged, SingularSystem, has_separate_supports
from pw_elements.spaces import is_hybrid

_FREE_SURFACE_REMEDY = (
    "A surface that is free to move may have lost all its nodes: its force has to press it on them"
)
# Smallest substep, as a fraction of the first substep
_MIN_SUBSTEP_PER_FIRST_SUBSTEP = 1 / 64
# Largest rotation of a rigid surface in one substep. At twice this angle, a node that slides around
# the surface would be mistaken for a node that has jumped to another place
MAX_SURFACE_RADIANS_PER_SUBSTEP = np.pi / 4
# Smallest number of samples in the check that supports and surfaces do not pass each other
_MIN_SAMPLES_TO_DETECT_SURFACE_PASSING = 64
# Largest number of linear systems solved for a state without contact
_MAX_ITERATIONS_WITHOUT_CONTACT = 10


class LargeStrainStepping:
    """Solver of the increments of a `ContactProblem` that is defined by a residual.

    Args:
        problem: residual and unknown function.
        conditions: Dirichlet conditions, whose values may change.
        reduction: reduction by the conditions.
        pairs: contact pairs.
        max_iterations: largest number of linear systems solved in one attempt.
        callback: user's function that is called after each iteration and each increment.
        solver: solver of the linear systems.
        history: functions in the residual that belong to the state, such as plastic strains.
        update: function that sets the history functions after each substep.

    Attributes:
        space: space of the displacements alone.
        coefficients: constants and functions of the residual.
    """

    def __init__(
        self,
        problem: PetrovGalerkinProblem | JoinedProblem,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        reduction: Reduction,
        pairs: Sequence[ContactPair],
        *,
        max_iterations: int,
        callback: ProgressCallback | None,
        solver: LinearSolver,
        history: Sequence[fem.Function] = (),
        update: Callable[[], None] | None = None,
    ) -> None:
        self.solver, self._conditions, self._max_iterations = solver, conditions, max_iterations
        self._residual_system, self.bodies, self._callback = problem.system, problem.parts, callback
        reduction = (
            full_size_masking_reduction(reduction) if has_separate_supports(solver) else reduction
        )
        self._reduction = scale_pressures_to_displacements(reduction, problem.system.tangent)
        self._whole_space = problem.u.function_space
        self.interface = build_interface(
            pairs, self._whole_space, self._reduction, large_sliding=True
        )
        self.interface.laws = make_interface_laws(
            pairs,
            self.interface,
            is_galerkin=all(body.is_galerkin for body in self.bodies),
            is_axisymmetric=any(is_axisymmetric_residual(b.form, b.u) for b in self.bodies),
        )
        remedy = "give -F, the forces of stresses less those of loads"
        check_stiffness_sign(problem.system.tangent, self.interface, remedy)
        self.space = self.interface.field.space
        self._supports = BodySupports(
            self.interface, self._whole_space, conditions, self._apply_load
        )
        self._surfaces = RigidSurfaceMotion(self.interface, pairs)
        self._pairs = list(pairs)
        self._cell_guard = CellInversionCheck([(body.u, body.form) for body in self.bodies])
        self._pairs_with_slip_warning: set[int] = set()
        self.history, self._history_update = list(history), update
        self.coefficients = ResidualCoefficients.from_problems(self.bodies, self.history)
        self._system: ContactSystem | None = None
        self._ratio_monitors = [
            TangentBulkShearMonitor(body.form, body.u)
            for body in self.bodies
            if not (body.is_galerkin or is_hybrid(self._whole_space))
        ]

    def step(
        self, state: ContactState, load: LoadFractionSetter | None, motions: Sequence[Motion | None]
    ) -> ContactState:
        """Return the state at the end of one increment, with errors as in `ContactProblem.step`."""
        start_time, interface = perf_counter(), self.interface
        start = TargetLoadsAndMotions.from_state(state, state.translations_and_rotations)
        end = TargetLoadsAndMotions.from_load_and_motions(
            None, motions, n_motions_per_surface=start.q.shape[1]
        )
        if any(pair in interface.mortars for pair, _ in end.free_motions):
            raise ValueError(
                "the surface of a deformed body cannot have free motions in addition to its "
                "displacements: give it a translation, or give the body supports and loads"
            )
        with report_activity(interface.comm, f"contact increment {state.increment}"):
            read_interface_fields(interface, state)
            reporter = ProgressReporter(interface.comm, state.increment, self._callback)
            system = self._cached_contact_system_for(end.free_motions)
            cost_before = measure_cost([system])
            # for later states, the tangent has been checked at the end of the preceding increment
            if not state.increment:
                self._set_unknowns_and_history(state)
                self._is_nearly_incompressible()
            support_path = self._supports.sample_path_adaptively(state, load)
            self._raise_if_surfaces_pass_supports(state, start, end, support_path)
            start_unknowns = None
            if not (self.history or self._history_update):
                start_unknowns = find_rigidly_moved_contact_free_start(
                    interface,
                    self._surfaces,
                    self._supports,
                    state,
                    load,
                    q_at_start_and_end=(start.q, end.q),
                    support_path=support_path,
                )
            n_initial_substeps = self._count_initial_substeps(start, end, support_path)
            if n_initial_substeps > 1:
                message = (
                    f"starts with {n_initial_substeps} substeps, in which slip follows from the "
                    "ends alone"
                )
                log_on_root(interface.comm, logging.INFO, message, ".contact")

            def solve_substep(
                current: ContactState,
                fraction: float,
                make_update: Callable[
                    [ContactInterface], LargeStrainActiveSetUpdate
                ] = LargeStrainActiveSetUpdate,
                start_unknowns: PETSc.Vec | None = None,
            ) -> ContactState:
                self._set_unknowns_and_history(current)
                self._apply_load(load, fraction)
                if not state.increment and current is state:
                    residual = self._residual_system.assemble_residual()
                    largest_force = residual.norm(PETSc.NormType.INFINITY)
                    arguments.check_magnitude("the load of the undeformed body", largest_force)
                try:
                    target = interpolate_targets(start, end, fraction)
                    solution = self._solve_substep(
                        current, target, system, reporter, make_update, start_unknowns
                    )
                except NotConverged as error:
                    raise LinearSolverFailed(str(error)) from error
                return replace(solution, history=self._update_and_copy_history_values())

            substeps: list[tuple[float, ContactState]] = []
            if start_unknowns is not None:
                log_on_root(interface.comm, logging.INFO, "attempt without contact", ".contact")
                solve_clear_substep = partial(solve_substep, start_unknowns=start_unknowns)
                substeps, failure = solve_in_substeps(solve_clear_substep, state, (1.0, 1.0, 1.0))
            sizes = (
                1 / n_initial_substeps,
                _MIN_SUBSTEP_PER_FIRST_SUBSTEP / n_initial_substeps,
                2.0,
            )
            if not substeps:
                substeps, failure = solve_in_substeps(solve_substep, state, sizes)
            if (
                failure is not None
                and isinstance(failure[1], ActiveSetCycling)
                and not interface.mortars
            ):
                # repeat from the start: a state after a snap-through may require large substeps
                solve_with_kept_sets = partial(
                    solve_substep, make_update=UpdateKeepingCyclingSetsUntilSolved
                )
                retried_substeps, retry_failure = solve_in_substeps(
                    solve_with_kept_sets, state, sizes
                )
                if retry_failure is None:
                    substeps, failure = retried_substeps, None
            if failure is not None:
                reached_fraction, current = substeps[-1] if substeps else (0.0, state)
                self._set_unknowns_and_history(current)
                self._apply_load(load, reached_fraction)
                fraction, error = failure
                interval = f"from {reached_fraction:.4g} to {fraction:.4g} of the increment"
                message = f"{error}; {interval}, which cannot be halved further"
                if self._is_nearly_incompressible():
                    message += (
                        ". The body is nearly incompressible: "
                        f"{SINGULAR_STIFFNESS_WARNING_AND_REMEDY}"
                    )
                friction_may_fail = (
                    bool(end.free_motions) or not self._supports.supported_axes().all()
                )
                if friction_may_fail and (friction_message := describe_exhausted_friction(current)):
                    message += f". {friction_message}"
                if end.free_motions and isinstance(error, SingularSystem):
                    message += f". {_FREE_SURFACE_REMEDY}"
                if interface.laws is not None and interface.laws.may_soften:
                    message += f". {SNAP_BACK_EXPLANATION}"
                by_solver = isinstance(error, LinearSolverFailed)
                not_found = (LinearSolverFailed if by_solver else SolutionNotFound)(message)
                not_found.last_substate = (reached_fraction, current) if substeps else None
                raise not_found from error
        n_solves, report = measure_cost([system], cost_before)
        solution = replace(
            combine_substeps_with_summed_slip(substeps), iterations=n_solves, report=report
        )
        warn_if_slip_and_path_slip_differ(solution, self.interface, self._pairs_with_slip_warning)
        reporter.report_increment(solution, perf_counter() - start_time)
        return solution

    def _count_initial_substeps(
        self, start: TargetLoadsAndMotions, end: TargetLoadsAndMotions, support_path: Array
    ) -> int:
        """Return the number of substeps, a power of two, that is sufficient to compute slip."""
        angles = np.nan_to_num(end.q - start.q)[:, -1]
        rotations = float(np.abs(angles).max(initial=0.0)) / MAX_SURFACE_RADIANS_PER_SUBSTEP
        n_straight = count_equal_nearly_straight_segments(support_path, self.interface.comm)
        return max(round_up_to_power_of_two(rotations), n_straight)

    def _raise_if_surfaces_pass_supports(
        self,
        state: ContactState,
        start: TargetLoadsAndMotions,
        end: TargetLoadsAndMotions,
        support_path: Array,
    ) -> None:
        """Raise SurfacePassed if supports and surfaces, or supports of two bodies, pass each other.

        Args:
            state: state at the start of the increment.
            start: motions at the start of the increment.
            end: motions at the end of the increment.
            support_path: prescribed displacements (samples + 1, nodes, dim).
        """
        interface, supports, q = self.interface, self._supports, state.translations_and_rotations
        node_data = supports.node_positions, supports.is_supported, supports.connected_piece_of_node
        surface_path, support_path = interpolate_placements_and_path(
            start.q,
            end.q,
            support_path,
            max(len(support_path) - 1, _MIN_SAMPLES_TO_DETECT_SURFACE_PASSING),
        )
        raise_if_tools_reach_or_pass_supports(
            interface, self._surfaces, *node_data, surface_path, support_path
        )
        if interface.mortars:
            mortars = MortarKinematics(interface, state.unknowns, q, q)
            raise_if_supports_meet_or_pass(
                interface, mortars.slip_references, *node_data[:2], support_path
            )

    def release(self) -> None:
        if self._system is not None:
            self._system.tangent.release()
            self._system = None

    def _solve_substep(
        self,
        state: ContactState,
        target: TargetLoadsAndMotions,
        system: ContactSystem,
        reporter: ProgressReporter,
        make_update: Callable[[ContactInterface], LargeStrainActiveSetUpdate],
        start_unknowns: PETSc.Vec | None = None,
    ) -> ContactState:
        """Solve from a state to a target in one step and return the state at the target.

        Args:
            state: state at the start.
            target: loads and motions at the end.
            system: contact system for the free motions of the target.
            reporter: reporter of progress.
            make_update: function that returns the rule for the next active set.
            start_unknowns: initial iterate (n,) of an attempt without contact, which fails if a
                node is in contact at the end. If None, the iteration starts from `state`.
        """
        interface = self.interface
        unknowns = state.unknowns if start_unknowns is None else start_unknowns
        increment, kinematics = self._make_equations_and_kinematics(state, target, system, unknowns)
        start = increment.start
        q = np.where(np.isnan(target.q), start.q, target.q)
        system.set_initial_iterate(lambda: unknowns, q)
        max_iterations = self._max_iterations
        if start_unknowns is None:
            is_closed = interface.extract_local_pair_state_values(state.pairs, "status")[0] != OPEN
            displacement = kinematics.move_closed_points_with_surfaces(
                q, start.displacement, is_closed
            )
            linearised = kinematics.linearise(q, displacement, start.force)
            is_closed |= linearised.gap < 0
            is_free = np.asarray(np.isnan(target.q).any(axis=1))
            is_closed = close_nearest_nodes_of_free_surfaces(
                interface, linearised.gap, is_closed, is_free
            )
        else:
            max_iterations = min(max_iterations, _MAX_ITERATIONS_WITHOUT_CONTACT)
            no_force = np.zeros_like(start.force)
            linearised = kinematics.linearise(
                q, system.evaluate_relative_point_displacements(start_unknowns), no_force
            )
            is_closed = np.zeros(len(interface.pair), dtype=bool)
        n_signs = len(system.tangent.solver.determinant_signs)
        active = make_sticking_active_set(is_closed, interface.cone, linearised.frame.shape[1] - 1)
        active = increment.add_initial_interface_laws(active, linearised, linearised.v0, q)
        end = solve_increment(
            increment,
            open_points_with_dependent_normals(
                interface, active, linearised.frame[:, 0], -linearised.gap
            ),
            linearised,
            make_update(interface),
            max_iterations=max_iterations,
            after_iteration=reporter.report_iteration,
        )
        reporter.violation = end.violation
        is_pressed = end.nodes.trial_pressure > 0
        kinematics.check_surface_derivatives(end.kinematics, is_pressed)
        interface.check_supports_move_both_sides_equally(
            increment.equilibrium.prescribed_displacements, target.q, is_pressed
        )
        if start_unknowns is None:
            self._raise_if_pressed_nodes_jumped(kinematics, end, is_pressed)
        else:
            self._raise_if_any_node_is_pressed(is_pressed)
        raise_if_force_shares_are_not_unique(interface, end.nodes, end.allowance)
        raise_if_slave_nodes_pass_through_master(
            interface, kinematics.slip_references_and_positions
        )
        self._raise_if_free_surface_turns_too_far(start.q, end.q, target.q)
        check_interface_laws_at_solution(increment, end)
        signs = self._check_and_return_determinant_signs(system, n_signs, state)
        sizes = increment.updated_scale_and_reference_force_and_length(end, state.scale)
        solution = make_contact_state(
            increment,
            end,
            state,
            scale=sizes[0],
            iterations=0,
            report=system.tangent.solver.report,
            smallness=None,
        )
        solution = self._recompute_and_verify_residuals(solution, state, target, sizes)
        return replace(solution, unique=None, determinant_signs=frozenset(signs[-1:]))

    def _raise_if_pressed_nodes_jumped(
        self, kinematics: LargeStrainKinematics, end: NewtonIterate, is_pressed: Mask
    ) -> None:
        """Raise SolutionNotFound if pressed nodes have jumped to another part of their surface."""
        is_jumped = kinematics.find_points_jumped_to_another_surface_part(
            end.kinematics, is_pressed
        )
        positions = self.interface.gather_values(self.interface.position[is_jumped])
        if len(positions):
            message = "jumped to another sheet of their surface, or slid round by a right angle"
            raise SolutionNotFound.with_positions(
                f"contact nodes first at {{}} have {message}", positions
            )

    def _raise_if_any_node_is_pressed(self, is_pressed: Mask) -> None:
        """Raise SolutionNotFound if any node is in contact."""
        if len(self.interface.gather_values(self.interface.position[is_pressed])):
            raise SolutionNotFound(
                "the body is in contact after supports have moved it out of contact"
            )

    @staticmethod
    def _raise_if_free_surface_turns_too_far(start_q: Array, end_q: Array, target_q: Array) -> None:
        """Raise SolutionNotFound if a surface that is free to turn has turned too far.

        Args:
            start_q: motions (pairs, dim + 1) of the surfaces at the start.
            end_q: motions (pairs, dim + 1) of the surfaces in the solution.
            target_q: prescribed motions (pairs, dim + 1) of the surfaces, NaN where they are free.
        """
        angle = np.abs(end_q - start_q)[:, -1]
        if (angle[np.isnan(target_q[:, -1])] > MAX_SURFACE_RADIANS_PER_SUBSTEP).any():
            raise SolutionNotFound(
                f"a surface that is free to turn has turned by {angle.max():.3g}: slip is resolved "
                f"up to {MAX_SURFACE_RADIANS_PER_SUBSTEP:.3g}, an eighth of a turn, in one substep"
            )

    def _check_and_return_determinant_signs(
        self, system: ContactSystem, n_earlier_signs: int, state: ContactState
    ) -> Sequence[int]:
        """Return the signs of the determinants of this substep's tangents.

        The result is empty if the solver computes no determinants.

        Args:
            system: contact system.
            n_earlier_signs: number of signs that the solver has recorded before this substep.
            state: state at the start of the substep.

        Raises:
            SolutionNotFound: if the determinant of the last tangent has changed its sign.
        """
        solver_signs = system.tangent.solver.determinant_signs[n_earlier_signs:]
        signs = solver_signs or system.tangent.estimate_determinant_signs()
        if self._is_nearly_incompressible():
            signs = ()  # in nearly incompressible bodies, stable states may have either sign
        is_comparable = bool(solver_signs) and state.free_motions == system.free_motions
        accepted_signs = state.determinant_signs if is_comparable else frozenset[int]()
        if signs and signs[-1] not in (accepted_signs or signs[:1]):
            raise SolutionNotFound(
                "the solution is unstable: the determinant of its tangent has changed its sign"
            )
        return solver_signs

    def _is_nearly_incompressible(self) -> bool:
        """Return whether the bulk stiffness of a body's tangent is too large; collective."""
        return max((m.is_beyond_limit() for m in self._ratio_monitors), default=False)

    def _recompute_and_verify_residuals(
        self,
        solution: ContactState,
        start_state: ContactState,
        target: TargetLoadsAndMotions,
        sizes: tuple[ResidualScale, float, float],
    ) -> ContactState:
        """Return the solution with residuals computed from form, surfaces and law alone."""
        _, force, length = sizes
        self._residual_system.set_unknowns(solution.unknowns)
        unbalanced = self._residual_system.assemble_residual()
        assert self._system is not None
        law_scale, comm = self._system.law_scale, self.interface.comm
        largest_residual = self.interface.field.extract(unbalanced).norm(PETSc.NormType.INFINITY)
        stiffness = comm.allreduce(law_scale.max(initial=0.0), MPI.MAX)
        round_off = (
            MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * largest_residual
            + RELATIVE_COORDINATE_ROUND_OFF * stiffness * self._cell_guard.extent
        )
        return verify_state(
            solution,
            measure_large_strain_kinematics(self.interface, self._pairs, start_state, solution),
            unbalanced,
            self.interface,
            reduction=self._reduction,
            scales=VerificationScales(force, length, law_scale, round_off),
            free_motion_forces=target.free_motion_forces,
            compute_torques=make_nodal_torque_function(self.interface, self._pairs, solution),
        )

    def _make_equations_and_kinematics(
        self,
        state: ContactState,
        target: TargetLoadsAndMotions,
        system: ContactSystem,
        initial_unknowns: PETSc.Vec,
    ) -> tuple[IncrementEquations, LargeStrainKinematics]:
        """Return equations and kinematics of a step that starts from an initial iterate (n,)."""
        interface = self.interface
        start = make_increment_start(state, interface, state.translations_and_rotations)
        reduction = replace(self._reduction, offset=self._supports.prescribed_displacements())
        body_data = self._residual_system, system, reduction, self._cell_guard, initial_unknowns
        if interface.mortars:
            mortars = MortarKinematics(interface, state.unknowns, start.q, target.q)
            equilibrium: LargeStrainEquilibrium = SlidingBodiesEquilibrium(
                *body_data, mortars=mortars
            )
            kinematics = LargeStrainKinematics(interface, self._surfaces, start, mortars)
        else:
            equilibrium = LargeStrainEquilibrium(*body_data)
            kinematics = LargeStrainKinematics(
                interface, self._surfaces, start, NoDeformablePairs()
            )
        has_memory = bool(self.history or self._history_update)
        equations = LineSearchIncrementEquations if has_memory else IncrementEquations
        increment = equations(
            system,
            equilibrium,
            kinematics,
            start,
            prescribed=target.q,
            totals=target.free_motion_forces,
        )
        return increment, kinematics

    def support_markers_and_residual_fingerprint(self) -> tuple[Indices, ResidualFingerprint]:
        """Return data by which saved states are recognised as states of the same problem.

        Returns:
            Markers (n,) of the unknowns of this process, -1 for prescribed unknowns and 0 for all
            others; and the fingerprint of the residual and its coefficients.
        """
        free = self._supports.free_unknowns
        return np.where(free, 0, -1), ResidualFingerprint(self._residual_system, self.coefficients)

    @property
    def last_tangent(self) -> PETSc.Mat:
        """Tangent (n, n) of the last linearisation."""
        return self._residual_system.tangent

    def prescribed_displacements(self) -> PETSc.Vec:
        return self._supports.prescribed_displacements()

    def has_constant_in_residual_or_conditions(self, constant: fem.Constant) -> bool:
        """Return whether the residual or one of its Dirichlet conditions depends on a constant."""
        values = [getattr(condition.g, "value", None) for condition in self._dirichlet_conditions]
        # DOLFINx stores constants as C++ objects, which share the array of values
        is_prescribed = any(v is not None and np.shares_memory(v, constant.value) for v in values)
        return is_prescribed or any(constant is c for c in self.coefficients.constants)

    @property
    def _dirichlet_conditions(self) -> Sequence[fem.DirichletBC]:
        is_single = isinstance(self._conditions, fem.DirichletBC)
        return [self._conditions] if is_single else self._conditions

    def linearise_at_part_end(self, part: IncrementOrSubstep) -> EquationsLinearisedAtEnd:
        """Return the equations linearised at the end of a substep.

        The unknown function, the constants and the conditions are set to their values at the end of
        the substep.
        """
        self._apply_load(part.load, part.fraction)
        free_motions = part.part_end.free_motions
        system = self._cached_contact_system_for(free_motions)
        target = TargetLoadsAndMotions.from_state(
            part.part_end, part.part_end.translations_and_rotations
        )
        target = target.with_free_motions(free_motions)
        unknowns = part.part_end.unknowns
        increment, kinematics = self._make_equations_and_kinematics(
            part.part_start, target, system, unknowns
        )
        states, dim = (part.part_start, part.part_end), self.interface.position.shape[1]
        has_rotated = any(pair.rotation for state in states for pair in state.pairs)
        if has_rotated or any(axis == dim for _, axis in free_motions):
            raise ValueError("has a surface that has turned, of which no derivatives are given")
        end = make_increment_start(
            part.part_end, self.interface, part.part_end.translations_and_rotations
        )
        linearised = kinematics.linearise(end.q, end.displacement, end.force)
        solution = increment.evaluate_all_conditions(
            unknowns, end.q, linearised, additional_forces=end.force
        )
        increment.equilibrium.linearise_and_return_load(linearised.torque_map)
        slip_by_start = kinematics.differentiate_slip_by_start_displacement(linearised)
        return EquationsLinearisedAtEnd(
            increment, solution, self._residual_system.tangent, self._reduction, slip_by_start
        )

    def _cached_contact_system_for(self, free_motions: FreeMotionIndices) -> ContactSystem:
        """Return the contact system for given free motions; only the last system is cached."""
        if self._system is None or self._system.free_motions != free_motions:
            self.release()
            zero_vectors = np.zeros_like(self.interface.position)
            zero_motions = np.zeros((self.interface.pairs, zero_vectors.shape[1] + 1))
            self._system = ContactSystem(
                self._residual_system.tangent,
                self._reduction,
                self.interface,
                free_motions,
                self.solver,
                self._surfaces.linearise_torque_map(zero_motions, zero_vectors, zero_vectors),
            )
        return self._system

    def _set_unknowns_and_history(self, state: ContactState) -> None:
        self._residual_system.set_unknowns(state.unknowns)
        for function, values in zip(self.history, state.history, strict=False):
            function.x.array[:] = values

    def _apply_load(self, load: LoadFractionSetter | None, fraction: float) -> None:
        with raise_errors_on_all_processes(self.interface.comm) as same:
            if load is not None:
                with self.coefficients.record_changes_by_load():
                    call_user_function(self.interface.comm, "the load", load, fraction)
            same["the constants and conditions"] = self.coefficients.constants, self._conditions

    def _update_and_copy_history_values(self) -> tuple[Array, ...]:
        comm = self.interface.comm
        if self._history_update is not None:
            with raise_errors_on_all_processes(comm):
                call_user_function(comm, "the update of the history", self._history_update)
                for k, function in enumerate(self.history):
                    if not np.isfinite(function.x.array).all():
                        raise ValueError(
                            f"the update of the history has set function {k} to values that are "
                            "not finite"
                        )
        return tuple(function.x.array.copy() for function in self.history)
