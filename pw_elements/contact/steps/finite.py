"""Increments at large strains and large sliding against rigid surfaces, of any residual.

An increment that fails is halved; its parts grow again where they succeed. Closed nodes stick at
its start, and move along with their surface.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra import PetrovGalerkinProblem, Reduction, prescribed
from pw_elements.checks import answer, collective
from pw_elements.contact.interface import nodal_interface
from pw_elements.contact.iteration import (
    OPEN,
    CellGuard,
    ContactSystem,
    DeformedKinematics,
    DeformedPlace,
    FiniteEquilibrium,
    Increment,
    Policy,
    Reference,
    Sliding,
    contact_state,
    newton,
    sticking,
)
from pw_elements.contact.model import (
    ContactFailed,
    ContactPair,
    ContactState,
    Free,
    Motion,
    NotFound,
)
from pw_elements.contact.steps.stepping import Callback, Reporter, joined
from pw_elements.progress import doing
from pw_elements.solvers import LinearSolver, SingularSystem, SolverReport

Array = npt.NDArray[np.float64]
Loading: TypeAlias = Callable[[float], None]

log = logging.getLogger("pw_elements.contact")

# Smallest part of an increment
_SMALLEST = 1 / 64


class FiniteStepping:
    """The increments of a `ContactProblem` of a residual.

    Args:
        problem: residual, tangent and unknown.
        conditions: that support it.
        reduction: the same, whose values change.
        pairs: contact pairs.
        max_iterations: linear systems of one attempt.
        callback: the user's function, if there is one.
        solver: of the linear systems, by factors.
        history: functions that belong to the state.
        update: called when they are to be brought up to date.

    Attributes:
        interface: contact points.
        space: of the displacements.
        history: as stated.
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
        self.solver, self._conditions, self._most = solver, conditions, max_iterations
        self._body, self._callback = problem.system, callback
        self._reduction = reduction.equilibrated(problem.system.matrix)
        self._whole = problem.u.function_space
        self.interface = nodal_interface(pairs, self._whole, self._reduction, deformed=True)
        self.space = self.interface.field.space
        self._guard = CellGuard(problem.u, problem.form)
        self.history, self._update = list(history), update
        self._system: ContactSystem | None = None

    def step(
        self, state: ContactState, load: Loading | None, moved: Sequence[Motion | None]
    ) -> ContactState:
        """The state at the end of one increment, as `ContactProblem.step` gives it."""
        begun, comm = perf_counter(), self.interface.comm
        way = self._way(state, moved)
        with doing(comm, f"contact increment {state.increment}") as more:
            reporter = Reporter(comm, state.increment, self._callback, more)
            found = self._in_parts(state, load, way, reporter)
        reporter.ended(found, perf_counter() - begun)
        return found

    def release(self) -> None:
        """Frees what the solver holds, on all processes; the next step makes it anew."""
        if self._system is not None:
            self._system.tangent.release()
            self._system = None

    def _way(
        self, state: ContactState, moved: Sequence[Motion | None]
    ) -> Callable[[float], tuple[Array, Array]]:
        """Translations and forces (pairs, dim) at a share of an increment, NaN where free."""
        rest = np.zeros(self.interface.position.shape[1])
        ends = np.array([rest if m is None else m.prescribed() for m in moved])
        total = np.array([rest if m is None else m.forces() for m in moved])
        place, force = state.translations, np.array([pair.force for pair in state.pairs])

        def at(share: float) -> tuple[Array, Array]:
            return (1 - share) * place + share * ends, (1 - share) * force + share * total

        return at

    def _in_parts(
        self,
        state: ContactState,
        load: Loading | None,
        way: Callable[[float], tuple[Array, Array]],
        reporter: Reporter,
    ) -> ContactState:
        parts: list[tuple[float, ContactState]] = []
        done, size, now, iterations = 0.0, 1.0, state, 0
        report = SolverReport("nothing", 0)
        while done < 1:
            share = min(1.0, done + size)
            try:
                self._restore(now)
                self._apply(load, share)
                system = self._bound(np.isnan(way(share)[0]))
                before = system.solved, system.report
                try:
                    found = self._solved(now, way(share), system, reporter)
                finally:
                    iterations += system.solved - before[0]
                    report = system.report.since(before[1]).after(report)
            except (ContactFailed, SingularSystem) as failed:
                if self.interface.comm.rank == 0:
                    log.info("not from %.4g to %.4g of the increment: %s", done, share, failed)
                size = (share - done) / 2
                if size < _SMALLEST:
                    self._restore(now)
                    self._apply(load, done)
                    part = f"from {done:.4g} to {share:.4g} of the increment"
                    error = NotFound(f"{failed}; {part}, which cannot be halved further")
                    error.reached = (done, now) if parts else None
                    raise error from failed
                continue
            done, size = share, 2 * size
            now = replace(found, increment=state.increment + 1, history=self._updated())
            parts.append((share, now))
        last = joined([part for _, part in parts], tuple(parts[:-1]))
        return replace(last, iterations=iterations, report=report)

    def _solved(
        self,
        state: ContactState,
        goal: tuple[Array, Array],
        system: ContactSystem,
        reporter: Reporter,
    ) -> ContactState:
        """The state at translations and forces, in one piece."""
        interface, (translations, forces) = self.interface, goal
        reduction = replace(self._reduction, offset=prescribed(self._whole, self._conditions)[1])
        past, sliding = Reference.of(state, interface), None
        if interface.mortars:
            sliding = Sliding(interface, state.unknowns, past.translations, translations)
        start = state.unknowns, sliding
        equilibrium = FiniteEquilibrium(self._body, system, reduction, self._guard, *start)
        kinematics = DeformedKinematics(interface, past, sliding)
        totals = np.array([forces[at] for at in system.free])
        increment = Increment(system, equilibrium, translations, totals, past, deformed=kinematics)
        moved = np.where(np.isnan(translations), state.translations, translations)
        way = (moved - state.translations)[interface.pair]
        closed = interface.local([pair.status for pair in state.pairs]) != OPEN
        along = past.displacement + np.where(closed[:, None], way, 0.0)
        place: DeformedPlace = kinematics(moved, along, past.force)
        first = sticking(closed | (place.gap < 0), interface.cone, place.frame.shape[1] - 1)
        told = reporter.iterated if reporter.wanted else None
        policy = Policy.of(lambda *_: [], interface)
        met = len(system.tangent.solver.orientations)
        now = newton(increment, first, place, policy, self._most, told)
        reporter.violation = increment.violation(now)
        end = now.place
        assert isinstance(end, DeformedPlace)
        pressed = end.jumped & (now.contact.pressing > 0)
        jumped = interface.gathered(interface.position[pressed | kinematics.passed(end)])
        if len(jumped):
            words = "jumped to another sheet of their surface, or slid round by a right angle"
            raise NotFound.at(f"contact nodes first at {{}} have {words}", jumped)
        signs = system.tangent.solver.orientations[met:]
        before = state.orientations if state.free == system.free else frozenset()
        if signs and signs[-1] not in (before or signs[:1]):
            raise NotFound("the state found is unstable: its tangent's determinant has turned sign")
        now.full.setAttr("space", self._whole)
        found = contact_state(increment, now, 0, state, system.report, None)
        return replace(found, unique=None, orientations=frozenset(signs[-1:]))

    def _bound(self, free: npt.NDArray[np.bool_]) -> ContactSystem:
        """The system for these free translations (pairs, dim); one factorisation is kept."""
        each: Free = tuple((int(p), int(axis)) for p, axis in np.argwhere(free))
        if self._system is None or self._system.free != each:
            self.release()
            self._system = ContactSystem(
                self._body.matrix, self._reduction, self.interface, each, self.solver
            )
        return self._system

    def _restore(self, state: ContactState) -> None:
        """Unknown and history of a state."""
        self._body.take(state.unknowns)
        for function, values in zip(self.history, state.history, strict=False):
            function.x.array[:] = values

    def _apply(self, load: Loading | None, share: float) -> None:
        if load is not None:
            with collective(self.interface.comm):
                answer(self.interface.comm, "the load", load, share)

    def _updated(self) -> tuple[Array, ...]:
        """The history at the end of an increment, brought up to date."""
        if self._update is not None:
            with collective(self.interface.comm):
                answer(self.interface.comm, "the update of the history", self._update)
        return tuple(function.x.array.copy() for function in self.history)
