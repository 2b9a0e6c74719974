"""Increments of load and motion: `ContactProblem.step`; `solve_contact` is a loop over it.

Gap and normal belong to the undeformed body and the surface at its present place, as the guide's
page on theory says ("Contact"). Other loops over time join here: `step` changes no state.

An increment may be made in parts, on the straight way from a state to what is asked for. History is
true on that way: slip and friction follow each part. So a step that is cut may end in
another state than the whole one would, had it been found, and says so by `ContactState.substates`.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from time import perf_counter
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction, full_size_reduction, scale_pressures
from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import Interface, build_interface
from pw_elements.contact.iteration import (
    DISPLACEMENT_ROUND_OFF,
    ActiveSetUpdate,
    LinearEquilibrium,
    LinearIncrement,
    NewtonState,
    choose_first_set,
    make_contact_state,
    reference_sizes,
    resume_active_set,
    solve_increment,
)
from pw_elements.contact.model import (
    NO_SOLVER_REPORT,
    ContactFailed,
    ContactPair,
    ContactState,
    FreeMotions,
    Motion,
    NoEquilibrium,
    NotFound,
    ResidualScale,
)
from pw_elements.contact.nodes import (
    TOLERANCE,
    ActiveSet,
    IncrementStart,
    LinearisedKinematics,
    TorqueMap,
    UndeformedKinematics,
    make_increment_start,
)
from pw_elements.contact.output import Callback, Reporter
from pw_elements.contact.rescue import (
    RigidMotions,
    combine_substeps,
    prove_no_equilibrium,
    refuse_loose_body,
    rescue_increment,
    solve_in_substeps,
    solve_with_springs,
)
from pw_elements.contact.steps.sensitivity import HistoryPart, LinearisedEnd
from pw_elements.contact.steps.smallness import SlipCheck, SmallnessCheck
from pw_elements.contact.steps.verification import (
    ReferenceSizes,
    check_stiffness_sign,
    measure_undeformed,
    verify_state,
)
from pw_elements.contact.system import Accuracy, ContactSystem
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import (
    LinearSolver,
    NotConverged,
    SolverReport,
    add_scaled,
    is_matrix_free,
    to_aij,
)
from pw_elements.spaces import AssemblyRecord

# Smallest part of an increment
_MIN_SUBSTEP = 1 / 16

# What is tried if the iteration fails: springs at the points, and smaller increments. Either may
# solve MAX_COST_RATIO times as many linear systems as the first attempt, which counts as at least
# _MIN_ATTEMPT_SOLVES of them up to _SMALL_PROBLEM_DOFS unknowns, and less beyond
Remedy: TypeAlias = Literal["springs", "cutback"]
REMEDIES: tuple[Remedy, ...] = ("springs", "cutback")
MAX_COST_RATIO = 3.0
_MIN_ATTEMPT_SOLVES, _SMALL_PROBLEM_DOFS = 50, 2000
# Iterations, more than most increments take, after which a proof of infeasibility is tried
_ITERATIONS_BEFORE_PROOF = 12

# Number of linear systems, and the report of their solver
Cost: TypeAlias = tuple[int, SolverReport]


@dataclass(frozen=True)
class IncrementTarget:
    """Loads and motions at the end of an increment, or of a part of one.

    Args:
        load: f (n,), in all; None of a residual, which holds it.
        q: motions of the surfaces (pairs, k), NaN where they are free; with the angle last where
            they may turn.
        forces: (pairs, k), total forces of the surfaces, of the motions that are free.
        load_factor: share of prescribed displacements and of interference that is applied.
    """

    load: PETSc.Vec | None
    q: Array
    forces: Array
    load_factor: float = 1.0

    @classmethod
    def from_motions(
        cls,
        load: PETSc.Vec | None,
        motions: Sequence[Motion | None],
        interface: Interface,
        turning: bool = False,
    ) -> "IncrementTarget":
        """Build from the user's motions; None means zero translation; with angles if `turning`."""
        n_motions = interface.position.shape[1] + turning
        q, forces = np.zeros((2, interface.pairs, n_motions))
        for k, motion in enumerate(motions):
            if motion is not None:
                q[k], forces[k] = (
                    motion.translation_and_rotation()[:n_motions],
                    motion.force_and_torque()[:n_motions],
                )
        return cls(load, q, forces)

    @classmethod
    def from_state(
        cls, state: ContactState, load: PETSc.Vec | None = None, turning: bool = False
    ) -> "IncrementTarget":
        """Return the target that a state already satisfies, with no free motion."""
        q = state.placements if turning else state.translations
        forces = np.array([[*pair.force, pair.torque] for pair in state.pairs])
        load_factor = 1.0 if state.increment else 0.0
        return cls(load, q, forces[:, : q.shape[1]], load_factor)

    def with_free(self, free: FreeMotions) -> "IncrementTarget":
        """Return a copy with the given motions free (NaN): they follow from the forces."""
        q = self.q.copy()
        for index in free:
            q[index] = np.nan
        return replace(self, q=q)

    @cached_property
    def free(self) -> FreeMotions:
        """(pair, component) of each free motion."""
        return tuple((int(p), int(axis)) for p, axis in np.argwhere(np.isnan(self.q)))

    @property
    def unloaded_free_surfaces(self) -> Mask:
        """Whether each pair's surface (pairs,) is free and pushed by nothing: it just touches."""
        free = np.isnan(self.q)
        return free.any(axis=1) & ~(free & (self.forces != 0)).any(axis=1)

    @property
    def totals(self) -> Array:
        """Forces (free,) on the free motions."""
        return np.array([self.forces[index] for index in self.free])


def make_balanced_target(
    state: ContactState, K: PETSc.Mat, interface: Interface
) -> IncrementTarget:
    """Return the target of a state with the load f = K a - H r that balances it.

    Forces of supports count as load; they do no work.
    """
    points = interface.force.createVecRight()
    (force,) = interface.local(state.pairs, "force_vector")
    points.setArray(np.where(interface.equation >= 0, force, 0.0))
    load = K.createVecLeft()
    K.mult(state.unknowns, load)
    load.axpy(-1.0, interface.force * points)
    return IncrementTarget.from_state(state, load)


def interpolate(start: IncrementTarget, end: IncrementTarget, share: float) -> IncrementTarget:
    """Return the target at a share of the way from start to end."""
    if share == 1:
        return end
    load = None
    if start.load is not None:
        load = start.load.copy()
        load.scale(1 - share)
        load.axpy(share, end.load)
    return IncrementTarget(
        load,
        (1 - share) * start.q + share * end.q,
        (1 - share) * start.forces + share * end.forces,
        (1 - share) * start.load_factor + share * end.load_factor,
    )


class Stepping:
    """The increments of a `ContactProblem` at small strains by one linear solver.

    Args:
        K: stiffness (n, n).
        reduction: by the supports.
        pairs: contact pairs.
        space: trial space.
        max_iterations: the most linear systems solved in one attempt.
        callback: of the user.
        remedies: what is tried where the iteration fails, as far as the solver lets it, and the
            cost that each may have over the first attempt.
        solver: of linear systems.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: Sequence[ContactPair],
        space: fem.FunctionSpace,
        *,
        max_iterations: int,
        callback: Callback | None,
        remedies: Mapping[Remedy, float],
        solver: LinearSolver,
    ) -> None:
        self.solver = solver
        iterative = is_matrix_free(solver)
        self._K = K
        self._reduction = scale_pressures(
            full_size_reduction(reduction) if iterative else reduction, K
        )
        self._max_iterations, self._callback = max_iterations, callback
        # springs are in an assembled matrix
        self._remedies = {k: m for k, m in remedies.items() if k == "cutback" or not iterative}
        self._n_first_attempt = 0  # linear systems of an increment's first attempt
        self.interface = build_interface(pairs, space, self._reduction, AssemblyRecord.read(K))
        check_stiffness_sign(K, self.interface, "give -K, by which forces oppose displacements")
        self.space = self.interface.field.space
        self._smallness, self._slips = (
            SmallnessCheck(self.interface, self.space),
            SlipCheck(self.interface),
        )
        self._system: tuple[ContactSystem, RigidMotions] | None = None
        self._system_with_springs: ContactSystem | None = None

    def step(
        self, state: ContactState, load: PETSc.Vec, motions: Sequence[Motion | None]
    ) -> ContactState:
        """Return the state at the end of one increment; errors as of `ContactProblem.step`."""
        start_time = perf_counter()
        end = IncrementTarget.from_motions(load, motions, self.interface)
        comm, what = self.interface.comm, f"contact increment {state.increment}"
        with report_activity(comm, what):
            reporter = Reporter(comm, state.increment, self._callback)
            before = self._cost(end.free)
            try:
                solution = self._solve_part(state, end, reporter, before)
            except NotFound as failure:
                parts = self._cut_back(state, end, reporter)
                if not parts:
                    raise
                iterations, report = self._cost(end.free, before)
                solution = replace(combine_substeps(parts), iterations=iterations, report=report)
                reached, _ = parts[-1]
                if reached < 1:
                    failure.last_substate = reached, solution
                    failure.args = (f"{failure}. In parts {reached:.3g} of it was reached",)
                    raise
        self._slips.log_differences(solution)
        reporter.report_increment(solution, perf_counter() - start_time)
        return solution

    def _cut_back(
        self, state: ContactState, end: IncrementTarget, reporter: Reporter
    ) -> list[tuple[float, ContactState]]:
        """Return ends (share, state) of the parts that are found on the way to a target."""
        if "cutback" not in self._remedies:
            return []
        start = make_balanced_target(state, self._K, self.interface)
        left = self._budget("cutback", end.free)
        comm = self.interface.comm
        words = f"in parts, at the cost of at most {left():.0f} linear systems"
        log_on_root(comm, logging.INFO, words, ".contact")

        def solve_part(current: ContactState, share: float) -> ContactState:
            target = interpolate(start, end, share)
            return self._solve_part(current, target, reporter, self._cost(target.free), left)

        sizes = (0.5, _MIN_SUBSTEP, 1.0)
        parts, _ = solve_in_substeps(solve_part, state, sizes, lambda: left() > 0)
        reached = parts[-1][0] if parts else 0.0
        words = f"{reached:.4g} of the increment has been solved in {len(parts)} parts"
        log_on_root(comm, logging.INFO, words, ".contact")
        return parts

    def _budget(self, remedy: Remedy, free: FreeMotions) -> Callable[[], float]:
        """Return a function that says how many linear systems a remedy may still solve."""
        usual = _MIN_ATTEMPT_SOLVES * min(1.0, _SMALL_PROBLEM_DOFS / self._K.getSize()[0]) ** 1.5
        ratio = self._remedies.get(remedy, 0.0)
        end = self._cost(free)[0] + ratio * max(self._n_first_attempt, usual)
        return lambda: end - self._cost(free)[0]

    def _solve_part(
        self,
        state: ContactState,
        target: IncrementTarget,
        reporter: Reporter,
        before: Cost,
        left: Callable[[], float] | None = None,
    ) -> ContactState:
        """Return the state at a target, in one piece, after a cost `before`.

        A part of an increment may take as many linear systems as are `left`.
        """
        increment, kinematics = self._start_increment(state, target)
        linearised = self._linearise_start(increment, kinematics, state, target)
        rigid = self._system_for(target.free)[1]
        active = choose_first_set(
            self.interface,
            linearised,
            state,
            rigid.describe_free_motions,
            target.unloaded_free_surfaces,
        )
        max_iterations = self._max_iterations
        if left is not None:
            max_iterations = int(max(1, min(max_iterations, left())))

        @cache
        def prove() -> NoEquilibrium | None:
            load = self._equilibrium(target).load
            return prove_no_equilibrium(increment, load, linearised, rigid)

        def after_iteration(iteration: int, active: ActiveSet, violation: float) -> None:
            reporter.report_iteration(iteration, active, violation)
            is_late = violation > 1 and iteration == _ITERATIONS_BEFORE_PROOF
            if is_late and (proof := prove()):
                raise proof

        def iterate(accuracy: Accuracy) -> NewtonState:
            return solve_increment(
                increment,
                active,
                linearised,
                self._make_update(rigid, accuracy),
                max_iterations=max_iterations,
                after_iteration=after_iteration,
            )

        try:
            end = self._iterate_with_final_accuracy_if_needed(increment, iterate)
        except (ContactFailed, NotConverged) as failure:
            if left is None:
                self._n_first_attempt = self._cost(target.free, before)[0]
                left = self._budget("springs", target.free)
            springs = partial(
                solve_with_springs,
                increment,
                partial(self._increment_with_springs, target, increment.start),
                kinematics,
                start=(active, linearised, state.unknowns),
                make_update=partial(self._make_update, rigid, "rough"),
                max_iterations=self._max_iterations,
                remaining_systems=left,
            )
            end = rescue_increment(
                failure,
                increment,
                prove,
                springs if "springs" in self._remedies else None,
                state,
                lambda: self._cost(target.free, before),
            )
        reporter.violation = end.violation
        return self._finish(increment, end, state, target, before)

    @staticmethod
    def _iterate_with_final_accuracy_if_needed(
        increment: LinearIncrement, iterate: Callable[[Accuracy], NewtonState]
    ) -> NewtonState:
        """Iterate with rough solutions on the way; if that fails, with exact ones."""
        try:
            return iterate("rough")
        except ContactFailed as failure:
            if increment.system.tangent.solves_exactly or isinstance(failure, NoEquilibrium):
                raise
            return iterate("final")

    def _finish(
        self,
        increment: LinearIncrement,
        end: NewtonState,
        state: ContactState,
        target: IncrementTarget,
        before: Cost,
    ) -> ContactState:
        """Check the last iterate of an increment, and return its state."""
        frame, gap = end.kinematics.frame, end.kinematics.gap
        self.interface.check_supports(frame[:, 0], gap)
        offset, pressed = increment.equilibrium.offset, end.nodes.trial_pressure > 0
        self.interface.check_supports_between(offset, target.q, pressed)
        rigid = self._system_for(target.free)[1]
        refuse_loose_body(increment, end, rigid, state, lambda: self._cost(target.free, before))
        smallness = self._smallness.check_solution(increment, end, state)
        iterations, report = self._cost(target.free, before)
        sizes = reference_sizes(increment, end, state.scale)
        solution = make_contact_state(
            increment,
            end,
            state,
            sizes=sizes,
            iterations=iterations,
            report=report,
            smallness=smallness,
            slides=rigid.is_friction_exhausted(end.nodes, end.allowance),
        )
        return self._verify(solution, state, target, sizes)

    def _verify(
        self,
        solution: ContactState,
        before: ContactState,
        target: IncrementTarget,
        sizes: tuple[ResidualScale, float, float],
    ) -> ContactState:
        """Return the state with residuals that K, the load, surfaces and law alone give."""
        _, force, length = sizes
        unbalanced = self._K.createVecLeft()
        self._K.mult(solution.unknowns, unbalanced)
        assert target.load is not None
        unbalanced.axpy(-1.0, target.load)
        largest = PETSc.NormType.INFINITY
        round_off = DISPLACEMENT_ROUND_OFF * self._K.norm(largest) * solution.unknowns.norm(largest)
        stiffness = self._system_for(target.free)[0].scale
        return verify_state(
            solution,
            measure_undeformed(self.interface, before, solution, 1 - target.load_factor),
            unbalanced,
            self.interface,
            self._reduction,
            ReferenceSizes(
                force, length, stiffness, TOLERANCE * target.load.norm(largest) + round_off
            ),
            target.totals,
        )

    def _increment_with_springs(
        self,
        target: IncrementTarget,
        start: IncrementStart,
        share: float,
        unknowns: PETSc.Vec,
        q: Array,
    ) -> LinearIncrement:
        """Return the increment with springs of a share of the points' stiffness.

        They end where all unknowns (n,) and the surfaces' translations q (pairs, dim) are given.
        """
        interface, free, field = self.interface, target.free, self.interface.field
        stated, stiffness = interface.equation >= 0, share * self._system_for(free)[0].scale
        node = interface.node - field.space.dofmap.index_map.local_range[0]
        diagonal, load = self._K.createVecs()
        diagonal.array[field.owned_unknowns[node][stated]] = np.repeat(
            stiffness, stated.sum(axis=1)
        )
        of_pair = np.bincount(interface.pair, stiffness, interface.pairs).astype(float)
        interface.comm.Allreduce(MPI.IN_PLACE, of_pair, MPI.SUM)
        springs = PETSc.Mat().createAIJ(self._K.getSizes(), nnz=1, comm=self._K.comm)
        springs.setDiagonal(diagonal)
        springs.assemble()
        K = to_aij(self._K).copy()
        add_scaled(K, 1.0, springs)
        if self._system_with_springs is None:
            self._system_with_springs = self._make_system(K, free)
        system = self._system_with_springs
        system.renew_with_springs(K, np.array([of_pair[pair] for pair, _ in free]))
        load.pointwiseMult(diagonal, unknowns)
        load.axpy(1.0, target.load)
        return LinearIncrement(
            system,
            LinearEquilibrium.from_stiffness(system, K, load, target.load_factor),
            UndeformedKinematics(interface, start, target.q, target.load_factor),
            start,
            prescribed=target.q,
            totals=target.totals + system.springs * system.select_free(q),
        )

    def linearise(self, part: HistoryPart) -> LinearisedEnd:
        """Return the equations at the end of a part of an increment."""
        state, interface = part.part_end, self.interface
        target = make_balanced_target(state, self._K, interface).with_free(state.free_motions)
        load_factor = 1.0 if part.increment_start.increment else part.load_factor
        target = replace(target, load_factor=load_factor)
        increment, kinematics = self._start_increment(part.part_start, target)
        end = make_increment_start(state, interface, state.translations)
        linearised = kinematics.linearise_by_all_translations(end.q, end.displacement, end.force)
        solution = increment.solve(
            resume_active_set(interface, linearised, state), linearised, "final"
        )
        slip_by_start = -linearised.frame[:, 1:]
        return LinearisedEnd(increment, solution, self._K, self._reduction, slip_by_start)

    def _start_increment(
        self, state: ContactState, target: IncrementTarget
    ) -> tuple[LinearIncrement, UndeformedKinematics]:
        """Return the equations from a state to a target, and the kinematics in them."""
        start = make_increment_start(state, self.interface, state.translations)
        kinematics = UndeformedKinematics(self.interface, start, target.q, target.load_factor)
        increment = LinearIncrement(
            self._system_for(target.free)[0],
            self._equilibrium(target),
            kinematics,
            start,
            prescribed=target.q,
            totals=target.totals,
        )
        return increment, kinematics

    def _linearise_start(
        self,
        increment: LinearIncrement,
        kinematics: UndeformedKinematics,
        state: ContactState,
        target: IncrementTarget,
    ) -> LinearisedKinematics:
        """Return the kinematics where the iteration begins, and check motions up to there."""
        unloaded = target.unloaded_free_surfaces[:, None]
        q = np.where(unloaded, 0.0, increment.start.q)
        q = np.where(np.isnan(target.q), q, target.q)
        increment.system.start(lambda: state.unknowns, q)
        self.interface.check_supports(self.interface.normals(q), self.interface.gaps(q))
        self._smallness.refuse_prescribed_passing(increment)
        return kinematics.linearise(q, increment.start.displacement, increment.start.force)

    def _equilibrium(self, target: IncrementTarget) -> LinearEquilibrium:
        system = self._system_for(target.free)[0]
        return LinearEquilibrium.from_stiffness(system, self._K, target.load, target.load_factor)

    def _make_update(self, rigid: RigidMotions, accuracy: Accuracy) -> ActiveSetUpdate:
        return ActiveSetUpdate(rigid.describe_free_motions, self.interface, accuracy)

    def _cost(self, free: FreeMotions, before: Cost = (0, NO_SOLVER_REPORT)) -> Cost:
        """Return the linear systems since before, with springs and without, and their report."""
        system, _ = self._system_for(free)
        n_solved, report = system.n_solved, system.report
        if self._system_with_springs is not None:
            n_solved += self._system_with_springs.n_solved
            report = self._system_with_springs.report.plus(report)
        return n_solved - before[0], report.since(before[1])

    def release(self) -> None:
        """Free the memory of the solver."""
        if self._system is not None:
            self._system[0].tangent.release()
            self._system = self._system_with_springs = None

    def _system_for(self, free: FreeMotions) -> tuple[ContactSystem, RigidMotions]:
        """Return system and rigid motions for these free motions; the last ones are kept."""
        if self._system is None or self._system[0].free != free:
            self.release()
            system = self._make_system(self._K, free)
            self._system = system, RigidMotions(system, self._K, self.space)
        return self._system

    def _make_system(self, K: PETSc.Mat, free: FreeMotions) -> ContactSystem:
        interface = self.interface
        torque_map = TorqueMap.of_translations(*interface.position.shape)
        return ContactSystem(K, self._reduction, interface, free, self.solver, torque_map)
