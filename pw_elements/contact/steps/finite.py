"""Increments at large strains and large sliding, of any residual.

An increment that fails is halved; its parts grow again where they succeed. Closed nodes stick at
its start, and move along with their surface.

Slip is seen from the two ends of a part alone, so that a part must not contain whole turns: an
increment in which a tool turns, or supports move, by more than an eighth of a turn starts in parts.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from time import perf_counter
from typing import TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import (
    PetrovGalerkinProblem,
    Reduction,
    evaluate_conditions,
    full_size_reduction,
    scale_pressures,
)
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import (
    arguments,
    call_user_function,
    collective_errors,
    connected_components,
)
from pw_elements.contact.interface import ROUND_OFF, build_interface
from pw_elements.contact.iteration import (
    CellGuard,
    DeformedSetUpdate,
    FiniteEquilibrium,
    Increment,
    NewtonState,
    SlidingEquilibrium,
    make_contact_state,
    reference_sizes,
    solve_increment,
)
from pw_elements.contact.model import (
    ContactPair,
    ContactState,
    Cycling,
    FreeMotions,
    Motion,
    NotFound,
    ResidualScale,
    describe_exhausted_friction,
)
from pw_elements.contact.nodes import (
    OPEN,
    TOLERANCE,
    DeformedKinematics,
    MortarKinematics,
    RigidSurfaceMotion,
    RigidSurfacesOnly,
    make_increment_start,
    make_sticking_set,
)
from pw_elements.contact.output import Callback, Reporter, ResidualCoefficients, ResidualProbe
from pw_elements.contact.rescue import (
    SupportedPieces,
    combine_substeps,
    ends_all_contact,
    find_passed_nodes,
    refuse_supports_through_each_other,
    refuse_tools_through_supports,
    sample_placements,
    solve_in_substeps,
)
from pw_elements.contact.steps.sensitivity import HistoryPart, LinearisedEnd
from pw_elements.contact.steps.smallness import SlipCheck
from pw_elements.contact.steps.stepping import (
    IncrementTarget,
    interpolate,
)
from pw_elements.contact.steps.verification import (
    ReferenceSizes,
    check_stiffness_sign,
    make_torque_function,
    measure_deformed,
    verify_state,
)
from pw_elements.contact.system import ContactSystem
from pw_elements.elasticity import HYBRID_SPACES_REMEDY, TangentRatioMonitor
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import LinearSolver, NotConverged, is_matrix_free
from pw_elements.spaces import is_hybrid

Loading: TypeAlias = Callable[[float], None]

# Smallest part of an increment, or of the parts in which it starts
_SMALLEST = 1 / 64
# Largest angle of a tool in one part. Twice as much would be a right angle, at which a node that
# slides round a tool counts as one that has jumped
MAX_TURN = np.pi / 4
# Largest path over distance of a prescribed displacement in one part: that of an arc of a right
# angle. Samples of the path per increment, and the distance over the largest one that counts
_MAX_DETOUR, _PATH_SAMPLES, _MAX_PATH_SAMPLES, _MIN_PATH = np.pi / np.sqrt(8), 16, 256, 1e-3
# Fewest samples of the ways of supports and surfaces that must not pass each other, and samples of
# those that leave each other
_WAY_SAMPLES, _LEAVING_SAMPLES = 64, 128
# Linear systems that a state without contact may take, from where supports put the body
_MAX_CLEAR_ITERATIONS = 10
# What the logarithm of a number of parts may be off by round-off
_LOG_ROUND_OFF = 1e-9


class FiniteStepping:
    """The increments of a `ContactProblem` of a residual; the space is of the displacements.

    The reduction is of the conditions, whose values change; `update` brings the history up to date.
    """

    def __init__(
        self,
        problem: PetrovGalerkinProblem,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        reduction: Reduction,
        pairs: Sequence[ContactPair],
        max_iterations: int,
        callback: Callback | None,
        solver: LinearSolver,
        history: Sequence[fem.Function] = (),
        update: Callable[[], None] | None = None,
    ) -> None:
        self.solver, self._conditions, self._max_iterations = solver, conditions, max_iterations
        self._body, self._callback = problem.system, callback
        self.form, self.u, self._constants = problem.form, problem.u, problem.form.constants()
        reduction = full_size_reduction(reduction) if is_matrix_free(solver) else reduction
        self._reduction = scale_pressures(reduction, problem.system.tangent)
        self._whole = problem.u.function_space
        self.interface = build_interface(pairs, self._whole, self._reduction, large_sliding=True)
        remedy = "give -F, the forces of stresses less those of loads"
        check_stiffness_sign(problem.system.tangent, self.interface, remedy)
        if self.interface.mortars and is_matrix_free(solver):
            raise ValueError(
                "Iterative() does not serve two bodies at large sliding, whose stiffness changes "
                "its pattern: use Direct()"
            )
        self.space = self.interface.field.space
        self._surfaces = RigidSurfaceMotion(self.interface, pairs)
        self._pairs = list(pairs)
        self._guard, self._slips = CellGuard(problem.u, problem.form), SlipCheck(self.interface)
        self.history, self._update = list(history), update
        self.coefficients = ResidualCoefficients.from_form(self.form, self.u, self.history)
        self._system: ContactSystem | None = None
        self._watch: TangentRatioMonitor | None = None
        (weights,) = self.form.arguments()
        standard = weights.ufl_element() == self._whole.ufl_element()
        if not (standard or is_hybrid(self._whole)):
            self._watch = TangentRatioMonitor(self.form, self.u)

    def step(
        self, state: ContactState, load: Loading | None, motions: Sequence[Motion | None]
    ) -> ContactState:
        start_time, interface = perf_counter(), self.interface
        start = IncrementTarget.from_state(state, turning=True)
        end = IncrementTarget.from_motions(None, motions, interface, turning=True)
        if any(pair in interface.mortars for pair, _ in end.free):
            raise ValueError(
                "the surface of a deformed body is not free to move besides its displacements: "
                "give it a translation, or the body supports and loads"
            )
        with report_activity(interface.comm, f"contact increment {state.increment}"):
            reporter = Reporter(interface.comm, state.increment, self._callback)
            system = self._system_for(end.free)
            before = system.n_solved, system.report
            if self._watch is not None and not state.increment:  # others are looked at in the end
                self._restore(state)
                self._watch.is_beyond_limit()
            path = self._trace_supports(state, load)
            self._refuse_passing(state, start, end, path)
            begin = self._place_clear(state, load, start, end, path)
            pieces = self._count_pieces(start, end, path)
            if pieces > 1:
                words = f"in {pieces} parts, as slip is not seen from its ends alone"
                log_on_root(interface.comm, logging.INFO, words, ".contact")

            def part(
                now: ContactState,
                share: float,
                patient: bool = False,
                begin: PETSc.Vec | None = None,
            ) -> ContactState:
                self._restore(now)
                self._apply(load, share)
                if not state.increment and now is state:
                    forces = self._body.assemble_residual().norm(PETSc.NormType.INFINITY)
                    arguments.check_magnitude("the load of the undeformed body", forces)
                try:
                    target = interpolate(start, end, share)
                    solution = self._solve_part(now, target, system, reporter, patient, begin)
                except NotConverged as failed:
                    raise NotFound(str(failed)) from failed
                return replace(solution, history=self._updated())

            parts: list[tuple[float, ContactState]] = []
            if begin is not None:
                log_on_root(
                    interface.comm, logging.INFO, "without contact, as all is clear", ".contact"
                )
                clear = partial(part, begin=begin)
                parts, failure = solve_in_substeps(clear, state, (1.0, 1.0, 1.0))
            sizes = (1 / pieces, _SMALLEST / pieces, 2.0)
            if not parts:
                parts, failure = solve_in_substeps(part, state, sizes)
            if failure is not None and isinstance(failure[1], Cycling):
                # from the start: a state beyond a snap may be out of reach of small parts
                again = partial(part, patient=True)
                patient_parts, patient_failure = solve_in_substeps(again, state, sizes)
                if patient_failure is None:
                    parts, failure = patient_parts, None
            if failure is not None:
                done, now = parts[-1] if parts else (0.0, state)
                self._restore(now)
                self._apply(load, done)
                share, failed = failure
                where = f"from {done:.4g} to {share:.4g} of the increment"
                words = f"{failed}; {where}, which cannot be halved further"
                if self._watch is not None and self._watch.is_beyond_limit():
                    words += f". The body is nearly incompressible: {HYBRID_SPACES_REMEDY}"
                by_friction = bool(end.free) or not self._held_axes().all()
                if by_friction and (used_up := describe_exhausted_friction(now)):
                    words += f". {used_up}"
                error = NotFound(words)
                error.last_substate = (done, now) if parts else None
                raise error from failed
        n_solved, report = system.n_solved - before[0], system.report.since(before[1])
        solution = replace(combine_substeps(parts), iterations=n_solved, report=report)
        self._slips.log_differences(solution)
        reporter.report_increment(solution, perf_counter() - start_time)
        return solution

    def _count_pieces(self, start: IncrementTarget, end: IncrementTarget, path: Array) -> int:
        """Return a power of two: of parts in which slip can be seen from the ends."""
        angles = np.nan_to_num(end.q - start.q)[:, -1]
        turns = float(np.abs(angles).max(initial=0.0)) / MAX_TURN
        straight = _count_straight_pieces(path, self.interface.comm)
        return max(_round_up_to_power_of_two(turns), straight)

    def _trace_supports(self, state: ContactState, load: Loading | None) -> Array:
        """Return prescribed displacements (samples + 1, nodes, dim) on the way to the end."""
        if load is None:
            return self._sample_supports(state, None, 1)
        samples = _PATH_SAMPLES
        path = self._sample_supports(state, load, samples)
        while (
            2 * _count_straight_pieces(path, self.interface.comm) > samples
            and samples < _MAX_PATH_SAMPLES
        ):
            samples *= 4
            path = self._sample_supports(state, load, samples)
        return path

    def _refuse_passing(
        self, state: ContactState, start: IncrementTarget, end: IncrementTarget, path: Array
    ) -> None:
        """Raise SurfacePassed if supports and surfaces are led through each other."""
        interface, q = self.interface, state.placements
        nodes = self._positions, self._held, self._piece
        ways, path = sample_placements(start.q, end.q, path, max(len(path) - 1, _WAY_SAMPLES))
        refuse_tools_through_supports(interface, self._surfaces, *nodes, ways, path)
        if interface.mortars:
            mortars = MortarKinematics(interface, state.unknowns, q, q)
            refuse_supports_through_each_other(interface, mortars.references, *nodes[:2], path)

    def _place_clear(
        self,
        state: ContactState,
        load: Loading | None,
        start: IncrementTarget,
        end: IncrementTarget,
        path: Array,
    ) -> PETSc.Vec | None:
        """Return unknowns (n,) of a body that supports carry along to where all is clear.

        None where it has not been in contact, does not end clear, or has a history on the way.
        """
        interface, comm = self.interface, self.interface.comm
        closed = interface.local(state.pairs, "status")[0] != OPEN
        if self.history or self._update or not comm.allreduce(bool(closed.any()), MPI.LOR):
            return None
        nodes = self._positions, self._held, self._piece
        path = path[[0, -1]]
        for samples in (1, _LEAVING_SAMPLES):  # the ends alone tell most
            if samples > 1:
                path = self._sample_supports(state, load, samples)
            ways, _ = sample_placements(start.q, end.q, path, samples)
            pieces = SupportedPieces.fit(*nodes, path, comm)
            if not ends_all_contact(interface, self._surfaces, pieces, ways, state.unknowns):
                return None
        begin, owned = state.unknowns.duplicate(), interface.field.owned_unknowns
        moved = pieces.move(self._positions, self._piece)[-1] - self._positions
        begin.setArray(interface.field.embed(moved.ravel()))
        begin.array[owned] = np.where(self._held, path[-1], begin.array_r[owned])
        return begin

    def _sample_supports(self, state: ContactState, load: Loading | None, samples: int) -> Array:
        """Return prescribed displacements (samples + 1, nodes, dim), zero where they are free."""
        field, dim = self.interface.field, self.interface.position.shape[1]
        free, _ = evaluate_conditions(self._whole, self._conditions)
        start = state.unknowns.copy()
        start.array[free] = 0.0
        path = [start]
        for k in range(1, samples + 1):
            self._apply(load, k / samples)
            path.append(self.prescribed_displacements())
        return np.array([field.extract(values).array_r.reshape(-1, dim).copy() for values in path])

    def _held_axes(self) -> Mask:
        """Along which axes (dim,) supports hold any node: friction alone may have to elsewhere."""
        held: Mask = np.any(self._held, axis=0)
        self.interface.comm.Allreduce(MPI.IN_PLACE, held, MPI.LOR)
        return held

    @property
    def _held(self) -> Mask:
        """Components (owned nodes, dim) that supports prescribe."""
        free, _ = evaluate_conditions(self._whole, self._conditions)
        return np.asarray(~free[self.interface.field.owned_unknowns])

    @property
    def _positions(self) -> Array:
        """Undeformed positions (owned nodes, dim)."""
        owned, dim = self.interface.field.owned_unknowns.shape
        return np.asarray(self.space.tabulate_dof_coordinates()[:owned, :dim])

    @cached_property
    def _piece(self) -> Indices:
        """Number (owned nodes,) of the connected piece that each node belongs to."""
        dofmap = self.space.dofmap
        number, _ = connected_components(self.interface.comm, dofmap.index_map, dofmap.list)
        return number[: len(self._positions)]

    def release(self) -> None:
        if self._system is not None:
            self._system.tangent.release()
            self._system = None

    def _solve_part(
        self,
        state: ContactState,
        target: IncrementTarget,
        system: ContactSystem,
        reporter: Reporter,
        keep_cycling_sets: bool,
        begin: PETSc.Vec | None = None,
    ) -> ContactState:
        """Return the state at a target, in one piece.

        From unknowns (n,) to `begin` with, where the body is clear of everything, it is a state
        without contact.
        """
        interface = self.interface
        unknowns = state.unknowns if begin is None else begin
        increment, kinematics = self._start_increment(state, target, system, unknowns)
        start = increment.start
        q = np.where(np.isnan(target.q), start.q, target.q)
        system.start(lambda: unknowns, q)
        max_iterations = self._max_iterations
        if begin is None:
            closed = interface.local(state.pairs, "status")[0] != OPEN
            displacement = kinematics.carry_closed(q, start.displacement, closed)
            linearised = kinematics.linearise(q, displacement, start.force)
            closed |= linearised.gap < 0
        else:
            max_iterations = min(max_iterations, _MAX_CLEAR_ITERATIONS)
            no_force = np.zeros_like(start.force)
            linearised = kinematics.linearise(q, system.point_displacements(begin), no_force)
            closed = np.zeros(len(interface.pair), dtype=bool)
        n_signs = len(system.tangent.solver.determinant_signs)
        end = solve_increment(
            increment,
            make_sticking_set(closed, interface.cone, linearised.frame.shape[1] - 1),
            linearised,
            DeformedSetUpdate(interface, keep_cycling_sets),
            max_iterations=max_iterations,
            after_iteration=reporter.report_iteration,
        )
        reporter.violation = end.violation
        self._check_end(increment, kinematics, end, target, starts_clear=begin is not None)
        signs = self._check_stability(system, n_signs, state)
        sizes = reference_sizes(increment, end, state.scale)
        solution = make_contact_state(
            increment, end, state, sizes=sizes, iterations=0, report=system.report, smallness=None
        )
        solution = self._verify(solution, state, target, sizes)
        return replace(solution, unique=None, determinant_signs=frozenset(signs[-1:]))

    def _check_end(
        self,
        increment: Increment,
        kinematics: DeformedKinematics,
        end: NewtonState,
        target: IncrementTarget,
        *,
        starts_clear: bool,
    ) -> None:
        """Raise NotFound for a solution in which nodes or surfaces have jumped.

        Nodes of a body that has been put clear of everything may have, but nothing may touch it.
        """
        interface, pressed = self.interface, end.nodes.trial_pressure > 0
        kinematics.check_surfaces(end.kinematics, pressed)
        interface.check_supports_between(increment.equilibrium.offset, target.q, pressed)
        if starts_clear and len(interface.gathered(interface.position[pressed])):
            raise NotFound("the body is in contact where supports put it clear of everything")
        jumped = interface.gathered(
            interface.position[kinematics.find_jumped(end.kinematics, pressed)]
        )
        if len(jumped) and not starts_clear:
            words = "jumped to another sheet of their surface, or slid round by a right angle"
            raise NotFound.with_positions(f"contact nodes first at {{}} have {words}", jumped)
        for k, (reference, x) in kinematics.sides.items():
            passed = find_passed_nodes(interface, k, reference.x, x)
            if len(passed):
                raise NotFound.with_positions(
                    "contact nodes first at {} pass through the other side", passed
                )
        angle = np.abs(end.q - increment.start.q)[:, -1]
        if (angle[np.isnan(target.q[:, -1])] > MAX_TURN).any():
            raise NotFound(
                f"a surface that is free to turn has turned by {angle.max():.3g}: slip is seen up "
                f"to {MAX_TURN:.3g}, an eighth of a turn, in one part"
            )

    def _check_stability(
        self, system: ContactSystem, n_signs: int, state: ContactState
    ) -> Sequence[int]:
        """Return the signs of the determinants of this part's tangents.

        Raises:
            NotFound: for a tangent whose determinant has another sign than the state's before.
        """
        of_solver = system.tangent.solver.determinant_signs[n_signs:]
        signs = of_solver or system.tangent.determinant_signs()
        if self._watch is not None and self._watch.is_beyond_limit():
            signs = ()  # they change without any instability
        is_comparable = bool(of_solver) and state.free_motions == system.free
        before = state.determinant_signs if is_comparable else frozenset[int]()
        if signs and signs[-1] not in (before or signs[:1]):
            raise NotFound("the state found is unstable: its tangent's determinant has turned sign")
        return of_solver

    def _verify(
        self,
        solution: ContactState,
        before: ContactState,
        target: IncrementTarget,
        sizes: tuple[ResidualScale, float, float],
    ) -> ContactState:
        """Return the state with residuals that the form, surfaces and law alone give."""
        _, force, length = sizes
        self._body.set_unknowns(solution.unknowns)
        unbalanced = self._body.assemble_residual()
        assert self._system is not None
        scale, comm = self._system.scale, self.interface.comm
        largest = self.interface.field.extract(unbalanced).norm(PETSc.NormType.INFINITY)
        stiffness = comm.allreduce(scale.max(initial=0.0), MPI.MAX)
        round_off = TOLERANCE * largest + ROUND_OFF * stiffness * self._guard.extent
        return verify_state(
            solution,
            measure_deformed(self.interface, self._pairs, before, solution),
            unbalanced,
            self.interface,
            self._reduction,
            ReferenceSizes(force, length, scale, round_off),
            target.totals,
            make_torque_function(self.interface, self._pairs, solution),
        )

    def _start_increment(
        self, state: ContactState, target: IncrementTarget, system: ContactSystem, at: PETSc.Vec
    ) -> tuple[Increment, DeformedKinematics]:
        """Return the equations from a state to a target, the body being at all unknowns (n,)."""
        interface = self.interface
        start = make_increment_start(state, interface, state.placements)
        reduction = replace(self._reduction, offset=self.prescribed_displacements())
        of_body = self._body, system, reduction, self._guard, at
        if interface.mortars:
            mortars = MortarKinematics(interface, state.unknowns, start.q, target.q)
            equilibrium: FiniteEquilibrium = SlidingEquilibrium(*of_body, mortars=mortars)
            kinematics = DeformedKinematics(interface, self._surfaces, start, mortars)
        else:
            equilibrium = FiniteEquilibrium(*of_body)
            kinematics = DeformedKinematics(interface, self._surfaces, start, RigidSurfacesOnly())
        increment = Increment(
            system, equilibrium, kinematics, start, prescribed=target.q, totals=target.totals
        )
        return increment, kinematics

    def identify(self) -> tuple[Indices, ResidualProbe]:
        """Return -1 for each unknown (n,) of this process that is prescribed, and the residual."""
        free, _ = evaluate_conditions(self._whole, self._conditions)
        return np.where(free, 0, -1), ResidualProbe(self._body, self.coefficients)

    @property
    def stiffness(self) -> PETSc.Mat:
        """Return the last tangent (n, n)."""
        return self._body.tangent

    def prescribed_displacements(self) -> PETSc.Vec:
        return evaluate_conditions(self._whole, self._conditions)[1]

    def contains(self, constant: fem.Constant) -> bool:
        """Whether the residual or one of its Dirichlet conditions depends on a constant."""
        values = [getattr(condition.g, "value", None) for condition in self._each_condition]
        # DOLFINx hands on C++ objects of constants, but their values are one array
        prescribing = any(v is not None and np.shares_memory(v, constant.value) for v in values)
        return prescribing or any(constant is other for other in self._constants)

    @property
    def _each_condition(self) -> Sequence[fem.DirichletBC]:
        single = isinstance(self._conditions, fem.DirichletBC)
        return [self._conditions] if single else self._conditions

    def linearise(self, part: HistoryPart) -> LinearisedEnd:
        """Return the equations at a part's end, and leave u, constants and conditions there."""
        self._apply(part.load, part.load_factor)
        free = part.part_end.free_motions
        system = self._system_for(free)
        target = IncrementTarget.from_state(part.part_end, turning=True).with_free(free)
        unknowns = part.part_end.unknowns
        increment, kinematics = self._start_increment(part.part_start, target, system, unknowns)
        states, dim = (part.part_start, part.part_end), self.interface.position.shape[1]
        turned = any(pair.rotation for state in states for pair in state.pairs)
        if turned or any(axis == dim for _, axis in free):
            raise ValueError("has a surface that has turned, of which no derivatives are given")
        end = make_increment_start(part.part_end, self.interface, part.part_end.placements)
        linearised = kinematics.linearise(end.q, end.displacement, end.force)
        solution = increment.evaluate(unknowns, end.q, linearised)
        increment.equilibrium.linearise(linearised.torque_map)
        slip_by_start = kinematics.slip_by_start(linearised)
        return LinearisedEnd(
            increment, solution, self._body.tangent, self._reduction, slip_by_start
        )

    def _system_for(self, free: FreeMotions) -> ContactSystem:
        """Return the system for these free motions; the last one is kept."""
        if self._system is None or self._system.free != free:
            self.release()
            no_vector = np.zeros_like(self.interface.position)
            rest = np.zeros((self.interface.pairs, no_vector.shape[1] + 1))
            self._system = ContactSystem(
                self._body.tangent,
                self._reduction,
                self.interface,
                free,
                self.solver,
                self._surfaces.torque_map(rest, no_vector, no_vector),
            )
        return self._system

    def _restore(self, state: ContactState) -> None:
        self._body.set_unknowns(state.unknowns)
        for function, values in zip(self.history, state.history, strict=False):
            function.x.array[:] = values

    def _apply(self, load: Loading | None, share: float) -> None:
        with collective_errors(self.interface.comm) as same:
            if load is not None:
                with self.coefficients.record_changes():
                    call_user_function(self.interface.comm, "the load", load, share)
            same["the constants and conditions"] = self._constants, self._conditions

    def _updated(self) -> tuple[Array, ...]:
        if self._update is not None:
            with collective_errors(self.interface.comm):
                call_user_function(self.interface.comm, "the update of the history", self._update)
                for k, function in enumerate(self.history):
                    if not np.isfinite(function.x.array).all():
                        raise ValueError(
                            f"the update of the history has set function {k} to values that are "
                            "not finite"
                        )
        return tuple(function.x.array.copy() for function in self.history)


def _round_up_to_power_of_two(number: float) -> int:
    """Return the least power of two, 1 at least, that is no smaller but for round-off."""
    return 2 ** max(0, int(np.ceil(np.log2(max(number, 1.0)) - _LOG_ROUND_OFF)))


def _count_straight_pieces(path: Array, comm: MPI.Comm) -> int:
    """Return a power of two: of equal pieces of a path (samples + 1, nodes, dim) that hardly bend.

    In each the paths of nodes are longer than the distances of their ends by `_MAX_DETOUR` at most.
    """
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=2)
    longest = comm.allreduce(lengths.sum(axis=0).max(initial=0.0), MPI.MAX)
    samples = pieces = len(lengths)
    while pieces > 1:
        size = 2 * samples // pieces
        along = lengths.reshape(samples // size, size, lengths.shape[1]).sum(axis=1)
        straight = np.linalg.norm(path[size::size] - path[:-1:size], axis=2)
        bent = (along > _MAX_DETOUR * straight) & (along > _MIN_PATH * longest)
        if comm.allreduce(bool(bent.any()), MPI.LOR):
            break
        pieces //= 2
    return pieces
