"""Solution of the increments of `ContactProblem.step` at small strains.

Gap and normal are evaluated between the undeformed body and the surface in its current position
(docs/theory.md, "Contact").

An increment that fails is solved in substeps, whose loads and motions lie on the straight path from
the start of the increment to its end. Slip and friction follow the substeps, so the final state may
differ from the state after a single step. `ContactState.substates` contains the
intermediate states.

The module guarantees that states are never changed, and that each returned state has been
verified. It assumes arguments that have been checked by `steps.checks`.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, partial
from time import perf_counter
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import (
    Reduction,
    full_size_masking_reduction,
    scale_pressures_to_displacements,
)
from pw_elements.arrays import Array
from pw_elements.contact.interface import (
    build_interface,
    build_interface_with_other_friction,
    describe_weight_functions,
    make_interface_laws,
)
from pw_elements.contact.iteration import (
    RELATIVE_DISPLACEMENT_ROUND_OFF,
    ActiveSetUpdate,
    LinearEquilibrium,
    LinearIncrementEquations,
    NewtonIterate,
    TargetLoadsAndMotions,
    check_determinant_sign_if_laws_soften,
    check_interface_laws_at_solution,
    choose_first_active_set,
    interpolate_targets,
    make_contact_state,
    make_target_in_equilibrium_with_state,
    raise_if_force_shares_are_not_unique,
    recover_active_set_of_state,
    solve_increment,
)
from pw_elements.contact.model import (
    SNAP_BACK_EXPLANATION,
    ContactFailed,
    ContactPair,
    ContactState,
    FreeMotionIndices,
    Motion,
    NoEquilibrium,
    ResidualScale,
    SolutionNotFound,
)
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    ActiveSet,
    IncrementStart,
    LinearisedKinematics,
    SmallStrainKinematics,
    TorqueMap,
    make_increment_start,
    read_interface_fields,
)
from pw_elements.contact.output import ProgressCallback, ProgressReporter
from pw_elements.contact.rescue import (
    RigidMotions,
    SmallDisplacementAndSurfacePassingCheck,
    combine_substeps_with_summed_slip,
    prove_no_equilibrium,
    raise_if_body_is_loose,
    rescue_increment,
    solve_in_substeps,
    solve_with_softening_springs,
    warn_if_slip_and_path_slip_differ,
)
from pw_elements.contact.steps.sensitivity import EquationsLinearisedAtEnd, IncrementOrSubstep
from pw_elements.contact.steps.verification import (
    VerificationScales,
    check_stiffness_sign,
    measure_small_strain_kinematics,
    verify_state,
)
from pw_elements.contact.system import (
    NO_COST,
    ContactSystem,
    LinearSolveAccuracy,
    SolveCountAndReport,
    measure_cost,
)
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import (
    LinearSolver,
    NotConverged,
    add_scaled,
    has_separate_supports,
    to_aij,
)
from pw_elements.spaces import read_record

# Smallest substep, as a fraction of the increment
_MIN_SUBSTEP_FRACTION_OF_INCREMENT = 1 / 16

# Remedies for an iteration that fails: springs at the contact points, and substeps. Each remedy may
# solve MAX_REMEDY_COST_PER_FIRST_ATTEMPT times as many linear systems as the first attempt. The
# first attempt counts as at least _MIN_SOLVES_COUNTED_FOR_FIRST_ATTEMPT systems. This minimum is
# reduced if there are more than _MAX_DOFS_OF_SMALL_PROBLEM unknowns
RemedyName: TypeAlias = Literal["springs", "cutback"]
REMEDIES_FOR_FAILED_ITERATION: tuple[RemedyName, ...] = ("springs", "cutback")
MAX_REMEDY_COST_PER_FIRST_ATTEMPT = 3.0
_MIN_SOLVES_COUNTED_FOR_FIRST_ATTEMPT, _MAX_DOFS_OF_SMALL_PROBLEM = 50, 2000
# Number of iterations after which a proof is attempted that there is no equilibrium. Most
# increments take fewer iterations
_ITERATIONS_BEFORE_NO_EQUILIBRIUM_PROOF = 12
_WRONG_STIFFNESS_SIGN_REMEDY = "give -K, by which forces oppose displacements"


@dataclass
class _CachedSystems:
    """Last contact systems with their factors, shared by problems that differ in friction only.

    Args:
        system: contact system, for one choice of free motions.
        rigid: rigid motions of the same system.
        with_springs: contact system with springs at the contact points.
    """

    system: ContactSystem | None = None
    rigid: RigidMotions | None = None
    with_springs: ContactSystem | None = None


class SmallStrainStepping:
    """Solver of the increments of a `ContactProblem` at small strains, with one linear solver.

    Args:
        K: stiffness (n, n).
        reduction: reduction by the supports.
        pairs: contact pairs.
        space: trial space of the displacements, or of the hybrid element.
        max_iterations: largest number of linear systems solved in one attempt.
        callback: user's function that is called after each iteration and each increment.
        remedies: methods that are tried if the iteration fails, with the largest cost of each
            method relative to the first attempt. Matrix-free solvers do not support "springs".
        solver: solver of the linear systems.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: Sequence[ContactPair],
        space: fem.FunctionSpace,
        *,
        max_iterations: int,
        callback: ProgressCallback | None,
        remedies: Mapping[RemedyName, float],
        solver: LinearSolver,
    ) -> None:
        self.solver = solver
        uses_krylov = has_separate_supports(solver)
        self._K = K
        self._reduction = scale_pressures_to_displacements(
            full_size_masking_reduction(reduction) if uses_krylov else reduction, K
        )
        self._max_iterations, self._callback = max_iterations, callback
        # springs require an assembled matrix, and the law of unilateral contact
        allows_springs = not uses_krylov and all(pair.interface_law is None for pair in pairs)
        self._remedies = {k: m for k, m in remedies.items() if k == "cutback" or allows_springs}
        self._n_first_attempt_solves = 0  # linear systems in the increment's first attempt
        self.interface = build_interface(pairs, space, self._reduction, read_record(K))
        self.interface.laws = make_interface_laws(
            pairs, self.interface, **describe_weight_functions(K, pairs, space)
        )
        check_stiffness_sign(K, self.interface, _WRONG_STIFFNESS_SIGN_REMEDY)
        self.space = self.interface.field.space
        self._smallness_check = SmallDisplacementAndSurfacePassingCheck(self.interface, self.space)
        self._pairs_with_slip_warning: set[int] = set()
        self._systems = _CachedSystems()

    def with_friction(self, pairs: Sequence[ContactPair]) -> "SmallStrainStepping | None":
        """Return a solver with other friction that shares systems and factors; collective.

        The result is None if the interface of two bodies has to be built anew.

        Args:
            pairs: pairs that differ from those of this solver in their friction only.
        """
        interface = build_interface_with_other_friction(self.interface, pairs)
        if interface is None:
            return None
        changed = copy(self)
        changed.interface = interface
        changed._pairs_with_slip_warning = set()
        return changed

    def with_stiffness(self, K: PETSc.Mat) -> "SmallStrainStepping | None":
        """Return a solver with another stiffness that shares the interface; collective.

        The result is None if the interface has to be built anew, because it depends on scaled
        pressures, or because the stiffness has been assembled in another way.

        Args:
            K: stiffness (n, n) with the rows and columns of this solver's stiffness.
        """
        record, own_record = read_record(K), read_record(self._K)
        is_assembled_alike = record.form is None or (
            record.stress_states == own_record.stress_states
            and record.sibling is own_record.sibling
        )
        if not (self.interface.field.is_whole_space and is_assembled_alike):
            return None
        changed = copy(self)
        changed._K, changed._systems = K, _CachedSystems()
        changed._pairs_with_slip_warning = set()
        check_stiffness_sign(K, self.interface, _WRONG_STIFFNESS_SIGN_REMEDY)
        return changed

    def step(
        self, state: ContactState, load: PETSc.Vec, motions: Sequence[Motion | None]
    ) -> ContactState:
        """Return the state at the end of one increment.

        Arguments and errors are the same as those of `ContactProblem.step`.
        """
        start_time = perf_counter()
        end = TargetLoadsAndMotions.from_load_and_motions(
            load, motions, n_motions_per_surface=self.interface.position.shape[1]
        )
        free_motions = end.free_motions
        comm = self.interface.comm
        with report_activity(comm, f"contact increment {state.increment}"):
            read_interface_fields(self.interface, state)
            reporter = ProgressReporter(comm, state.increment, self._callback)
            cost_before = self._measure_cost_since(free_motions)
            try:
                solution = self._solve_substep(state, end, reporter, cost_before)
            except SolutionNotFound as failure:
                if self.interface.laws is not None and self.interface.laws.may_soften:
                    failure.args = (f"{failure}. {SNAP_BACK_EXPLANATION}",)
                substeps = self._solve_in_substeps(state, end, reporter)
                if not substeps:
                    raise
                iterations, report = self._measure_cost_since(free_motions, cost_before)
                solution = replace(
                    combine_substeps_with_summed_slip(substeps),
                    iterations=iterations,
                    report=report,
                )
                reached_fraction, _ = substeps[-1]
                if reached_fraction < 1:
                    failure.last_substate = reached_fraction, solution
                    failure.args = (
                        f"{failure}. Substeps reached {reached_fraction:.3g} of the increment",
                    )
                    raise
        warn_if_slip_and_path_slip_differ(solution, self.interface, self._pairs_with_slip_warning)
        reporter.report_increment(solution, perf_counter() - start_time)
        return solution

    def _solve_in_substeps(
        self, state: ContactState, end: TargetLoadsAndMotions, reporter: ProgressReporter
    ) -> list[tuple[float, ContactState]]:
        """Solve an increment in substeps, if the remedies include "cutback".

        Args:
            state: state at the start of the increment.
            end: loads and motions at the end of the increment.
            reporter: reporter of progress.

        Returns:
            Fraction of the increment and state at the end of each substep. The list ends before the
            end of the increment if the smallest substep fails or if too many linear systems have
            been solved. It is empty without the remedy "cutback".
        """
        if "cutback" not in self._remedies:
            return []
        start = make_target_in_equilibrium_with_state(state, self._K, self.interface)
        remaining_solves = self._make_remaining_solves_counter("cutback", end.free_motions)
        comm = self.interface.comm
        message = f"in parts, at the cost of at most {remaining_solves():.0f} linear systems"
        log_on_root(comm, logging.INFO, message, ".contact")

        def solve_substep(current: ContactState, fraction: float) -> ContactState:
            target = interpolate_targets(start, end, fraction)
            return self._solve_substep(
                current,
                target,
                reporter,
                self._measure_cost_since(target.free_motions),
                remaining_solves,
            )

        sizes = (0.5, _MIN_SUBSTEP_FRACTION_OF_INCREMENT, 1.0)
        substeps, _ = solve_in_substeps(solve_substep, state, sizes, lambda: remaining_solves() > 0)
        reached_fraction = substeps[-1][0] if substeps else 0.0
        message = (
            f"{reached_fraction:.4g} of the increment has been solved in {len(substeps)} substeps"
        )
        log_on_root(comm, logging.INFO, message, ".contact")
        return substeps

    def _make_remaining_solves_counter(
        self, remedy: RemedyName, free_motions: FreeMotionIndices
    ) -> Callable[[], float]:
        """Return a function that returns how many linear systems a remedy may still solve."""
        min_solves = (
            _MIN_SOLVES_COUNTED_FOR_FIRST_ATTEMPT
            * min(1.0, _MAX_DOFS_OF_SMALL_PROBLEM / self._K.getSize()[0]) ** 1.5
        )
        ratio = self._remedies.get(remedy, 0.0)
        solve_limit = self._measure_cost_since(free_motions)[0] + ratio * max(
            self._n_first_attempt_solves, min_solves
        )
        return lambda: solve_limit - self._measure_cost_since(free_motions)[0]

    def _solve_substep(
        self,
        state: ContactState,
        target: TargetLoadsAndMotions,
        reporter: ProgressReporter,
        cost_before: SolveCountAndReport,
        remaining_solves: Callable[[], float] | None = None,
    ) -> ContactState:
        """Solve from a state to a target in one step and return the state at the target.

        Args:
            state: state at the start.
            target: loads and motions at the end.
            reporter: reporter of progress.
            cost_before: cost at the start of the increment or substep.
            remaining_solves: function that returns the number of linear systems that substeps may
                still solve; None if the step is the whole increment.
        """
        _, rigid = self._cached_system_and_rigid_motions(target.free_motions)
        increment, kinematics = self._make_equations_and_kinematics(state, target)
        linearised = self._check_and_linearise_initial_kinematics(
            increment, kinematics, state, target
        )
        active = choose_first_active_set(
            self.interface,
            linearised,
            state,
            rigid.describe_free_rigid_motions,
            target,
        )
        active = increment.add_initial_interface_laws(
            active, linearised, increment.start.displacement, increment.start.q
        )
        max_iterations = self._max_iterations
        if remaining_solves is not None:
            max_iterations = int(max(1, min(max_iterations, remaining_solves())))

        @cache
        def find_proof() -> NoEquilibrium | None:
            if self.interface.laws is not None:
                return None  # the proof assumes forces of unilateral contact
            load = self._make_equilibrium(target).load
            return prove_no_equilibrium(increment, load, linearised, rigid)

        def report_and_prove_no_equilibrium_if_late(
            iteration: int, active: ActiveSet, violation: float
        ) -> None:
            reporter.report_iteration(iteration, active, violation)
            is_late = violation > 1 and iteration == _ITERATIONS_BEFORE_NO_EQUILIBRIUM_PROOF
            if is_late and (proof := find_proof()):
                raise proof

        def iterate(accuracy: LinearSolveAccuracy) -> NewtonIterate:
            return solve_increment(
                increment,
                active,
                linearised,
                self._make_active_set_update(rigid, accuracy),
                max_iterations=max_iterations,
                after_iteration=report_and_prove_no_equilibrium_if_late,
            )

        try:
            end = self._iterate_with_accuracy_fallback(increment, iterate)
        except (ContactFailed, NotConverged) as failure:
            if remaining_solves is None:
                self._n_first_attempt_solves = self._measure_cost_since(
                    target.free_motions, cost_before
                )[0]
                remaining_solves = self._make_remaining_solves_counter(
                    "springs", target.free_motions
                )
            springs = partial(
                solve_with_softening_springs,
                increment,
                partial(self._make_increment_with_springs, target, increment.start),
                kinematics,
                start=(active, linearised, state.unknowns),
                make_update=partial(self._make_active_set_update, rigid, "rough"),
                max_iterations=self._max_iterations,
                remaining_systems=remaining_solves,
            )
            end = rescue_increment(
                failure,
                increment,
                find_proof,
                springs if "springs" in self._remedies else None,
                state,
                lambda: self._measure_cost_since(target.free_motions, cost_before),
            )
        reporter.violation = end.violation
        return self._check_iterate_and_make_state(increment, end, rigid, state, target, cost_before)

    @staticmethod
    def _iterate_with_accuracy_fallback(
        increment: LinearIncrementEquations, iterate: Callable[[LinearSolveAccuracy], NewtonIterate]
    ) -> NewtonIterate:
        """Return the solution of an increment, with accurate linear solutions only if necessary.

        The iteration starts with rough linear solutions. If it fails, it is repeated with accurate
        linear solutions.
        """
        try:
            return iterate("rough")
        except ContactFailed as failure:
            if increment.system.tangent.solves_exactly or isinstance(failure, NoEquilibrium):
                raise
            return iterate("final")

    def _check_iterate_and_make_state(
        self,
        increment: LinearIncrementEquations,
        end: NewtonIterate,
        rigid: RigidMotions,
        state: ContactState,
        target: TargetLoadsAndMotions,
        cost_before: SolveCountAndReport,
    ) -> ContactState:
        """Check the last iterate of an increment and return the verified state.

        Args:
            increment: equations of the increment.
            end: last iterate.
            rigid: rigid motions of the body and of free surfaces.
            state: state at the start of the increment.
            target: loads and motions at the end of the increment.
            cost_before: cost at the start of the increment.
        """
        frame, gap = end.kinematics.frame, end.kinematics.gap
        self.interface.check_gaps_normals_and_supports(gap, frame[:, 0])
        offset, is_pressed = (
            increment.equilibrium.prescribed_displacements,
            end.nodes.trial_pressure > 0,
        )
        self.interface.check_supports_move_both_sides_equally(offset, target.q, is_pressed)
        if self.interface.laws is None:  # laws also hold a body by tension
            raise_if_body_is_loose(
                increment,
                end,
                rigid,
                state,
                lambda: self._measure_cost_since(target.free_motions, cost_before),
            )
        raise_if_force_shares_are_not_unique(self.interface, end.nodes, end.allowance)
        check_interface_laws_at_solution(increment, end)
        slides = rigid.can_slide_at_exhausted_friction(end.nodes, end.allowance)
        smallness = self._smallness_check.check_passing_and_measure_smallness(increment, end, state)
        iterations, report = self._measure_cost_since(target.free_motions, cost_before)
        sizes = increment.updated_scale_and_reference_force_and_length(end, state.scale)
        solution = make_contact_state(
            increment,
            end,
            state,
            scale=sizes[0],
            iterations=iterations,
            report=report,
            smallness=smallness,
            can_slide_at_same_forces=slides,
        )
        solution = self._recompute_and_verify_residuals(solution, state, target, sizes)
        return check_determinant_sign_if_laws_soften(increment.system, solution, state)

    def _recompute_and_verify_residuals(
        self,
        solution: ContactState,
        start_state: ContactState,
        target: TargetLoadsAndMotions,
        sizes: tuple[ResidualScale, float, float],
    ) -> ContactState:
        """Return the solution with residuals that are evaluated independently of the iteration.

        They are computed from the stiffness, the load, the surfaces and the contact law alone.
        """
        _, force, length = sizes
        unbalanced = self._K.createVecLeft()
        self._K.mult(solution.unknowns, unbalanced)
        assert target.load is not None
        unbalanced.axpy(-1.0, target.load)
        largest = PETSc.NormType.INFINITY
        round_off = (
            RELATIVE_DISPLACEMENT_ROUND_OFF
            * self._K.norm(largest)
            * solution.unknowns.norm(largest)
        )
        stiffness = self._cached_system_and_rigid_motions(target.free_motions)[0].law_scale
        return verify_state(
            solution,
            measure_small_strain_kinematics(
                self.interface, start_state, solution, 1 - target.load_factor
            ),
            unbalanced,
            self.interface,
            reduction=self._reduction,
            scales=VerificationScales(
                force,
                length,
                stiffness,
                MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * target.load.norm(largest) + round_off,
            ),
            free_motion_forces=target.free_motion_forces,
        )

    def _make_increment_with_springs(
        self,
        target: TargetLoadsAndMotions,
        start: IncrementStart,
        spring_to_law_stiffness_ratio: float,
        unstressed_unknowns: PETSc.Vec,
        unstressed_translations: Array,
    ) -> LinearIncrementEquations:
        """Return the increment with springs at the contact points and the free surfaces.

        Args:
            target: loads and motions at the end of the increment.
            start: state at the start of the increment.
            spring_to_law_stiffness_ratio: stiffness of the springs, divided by the stiffness of the
                contact law.
            unstressed_unknowns: unknowns (n,) at which the springs of the contact points are
                unstressed.
            unstressed_translations: translations (pairs, dim) at which the springs of the surfaces
                are unstressed.
        """
        interface, free_motions, field = self.interface, target.free_motions, self.interface.field
        has_equation, stiffness = (
            interface.equation >= 0,
            spring_to_law_stiffness_ratio
            * self._cached_system_and_rigid_motions(free_motions)[0].law_scale,
        )
        node = interface.node - field.space.dofmap.index_map.local_range[0]
        diagonal, load = self._K.createVecs()
        diagonal.array[field.owned_unknowns[node][has_equation]] = np.repeat(
            stiffness, has_equation.sum(axis=1)
        )
        pair_stiffness = np.bincount(interface.pair, stiffness, interface.pairs).astype(float)
        interface.comm.Allreduce(MPI.IN_PLACE, pair_stiffness, MPI.SUM)
        springs = PETSc.Mat().createAIJ(self._K.getSizes(), nnz=1, comm=self._K.comm)
        springs.setDiagonal(diagonal)
        springs.assemble()
        K = to_aij(self._K).copy()
        add_scaled(K, 1.0, springs)
        systems = self._systems
        if systems.with_springs is None:
            systems.with_springs = self._make_contact_system(K, free_motions)
        elif systems.with_springs.interface is not interface:
            systems.with_springs = systems.with_springs.with_interface(interface)
        system = systems.with_springs
        system.update_stiffness_and_free_motion_springs(
            K, np.array([pair_stiffness[pair] for pair, _ in free_motions])
        )
        load.pointwiseMult(diagonal, unstressed_unknowns)
        load.axpy(1.0, target.load)
        return LinearIncrementEquations(
            system,
            LinearEquilibrium.from_stiffness(system, K, load, target.load_factor),
            SmallStrainKinematics(interface, start, target.q, target.load_factor),
            start,
            prescribed=target.q,
            totals=target.free_motion_forces
            + system.springs * system.select_free_motions(unstressed_translations),
        )

    def linearise_at_part_end(self, part: IncrementOrSubstep) -> EquationsLinearisedAtEnd:
        """Return the equations linearised at the end of a substep."""
        state, interface = part.part_end, self.interface
        target = make_target_in_equilibrium_with_state(state, self._K, interface).with_free_motions(
            state.free_motions
        )
        load_factor = 1.0 if part.increment_start.increment else part.fraction
        target = replace(target, load_factor=load_factor)
        increment, kinematics = self._make_equations_and_kinematics(part.part_start, target)
        end = make_increment_start(state, interface, state.translations)
        linearised = kinematics.linearise_with_all_translations_free(
            end.q, end.displacement, end.force
        )
        solution = increment.solve_linearised_system(
            recover_active_set_of_state(interface, linearised, state), linearised, "final"
        )
        slip_by_start = -linearised.frame[:, 1:]
        return EquationsLinearisedAtEnd(
            increment, solution, self._K, self._reduction, slip_by_start
        )

    def _make_equations_and_kinematics(
        self, state: ContactState, target: TargetLoadsAndMotions
    ) -> tuple[LinearIncrementEquations, SmallStrainKinematics]:
        """Return the equations of the step from a state to a target, and the kinematics."""
        start = make_increment_start(state, self.interface, state.translations)
        kinematics = SmallStrainKinematics(self.interface, start, target.q, target.load_factor)
        increment = LinearIncrementEquations(
            self._cached_system_and_rigid_motions(target.free_motions)[0],
            self._make_equilibrium(target),
            kinematics,
            start,
            prescribed=target.q,
            totals=target.free_motion_forces,
        )
        return increment, kinematics

    def _check_and_linearise_initial_kinematics(
        self,
        increment: LinearIncrementEquations,
        kinematics: SmallStrainKinematics,
        state: ContactState,
        target: TargetLoadsAndMotions,
    ) -> LinearisedKinematics:
        """Check the motions up to the initial iterate, and return kinematics linearised there.

        Args:
            increment: equations of the increment.
            kinematics: kinematics of the contact points.
            state: state at the start of the increment.
            target: loads and motions at the end of the increment.
        """
        unloaded = target.unloaded_free_surfaces[:, None]
        q = np.where(unloaded, 0.0, increment.start.q)
        q = np.where(np.isnan(target.q), q, target.q)
        increment.system.set_initial_iterate(lambda: state.unknowns, q)
        self.interface.check_gaps_normals_and_supports(
            *self.interface.evaluate_undeformed_gaps_and_normals(q)
        )
        self._smallness_check.raise_if_prescribed_motion_passes_body(increment)
        return kinematics.linearise(q, increment.start.displacement, increment.start.force)

    def _make_equilibrium(self, target: TargetLoadsAndMotions) -> LinearEquilibrium:
        system = self._cached_system_and_rigid_motions(target.free_motions)[0]
        return LinearEquilibrium.from_stiffness(system, self._K, target.load, target.load_factor)

    def _make_active_set_update(
        self, rigid: RigidMotions, accuracy: LinearSolveAccuracy
    ) -> ActiveSetUpdate:
        return ActiveSetUpdate(rigid.describe_free_rigid_motions, self.interface, accuracy)

    def _measure_cost_since(
        self, free_motions: FreeMotionIndices, cost_before: SolveCountAndReport = NO_COST
    ) -> SolveCountAndReport:
        """Return the total cost since `cost_before` of the systems with and without springs."""
        system, _ = self._cached_system_and_rigid_motions(free_motions)
        with_springs = self._systems.with_springs
        systems = [system] if with_springs is None else [system, with_springs]
        return measure_cost(systems, cost_before)

    def release(self) -> None:
        """Free the memory of the solver."""
        systems = self._systems
        if systems.system is not None:
            systems.system.tangent.release()
            systems.system = systems.rigid = systems.with_springs = None

    def _cached_system_and_rigid_motions(
        self, free_motions: FreeMotionIndices
    ) -> tuple[ContactSystem, RigidMotions]:
        """Return the contact system and rigid motions for given free motions of the surfaces.

        Only the last result is cached, for calls with the same free motions.
        """
        systems = self._systems
        system, rigid = systems.system, systems.rigid
        if system is None or rigid is None or system.free_motions != free_motions:
            self.release()
            system = self._make_contact_system(self._K, free_motions)
            rigid = RigidMotions(system, self._K)
        elif system.interface is not self.interface:
            system = system.with_interface(self.interface)
        systems.system, systems.rigid = system, rigid
        return system, rigid

    def _make_contact_system(self, K: PETSc.Mat, free_motions: FreeMotionIndices) -> ContactSystem:
        interface = self.interface
        torque_map = TorqueMap.without_rotation(*interface.position.shape)
        return ContactSystem(K, self._reduction, interface, free_motions, self.solver, torque_map)
