"""Increments of load and motion: `ContactProblem.step`; `history.solve_contact` is a loop over it.

Small displacements: gap and normal belong to the *undeformed* body and the surface at its
present place (initial place + translation U), so that for the displacement a of a node

    g(a, U) = gap(x - U) + n(x - U)·a,

and the slip of an increment is the tangential part of (a - U) less that at its start.
Planes make this linear in U. For curved surfaces under force control it is linearised, the
active set found, and gap and n then taken at the U so found, until nothing changes. Other loops
over time join here: `step` changes no state. `explicit.solve_impact` needs no `step`.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cached_property, partial
from time import perf_counter
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.contact.condensed import Condensation
from pw_elements.contact.cutback import Target, held_by, homogeneous, in_parts
from pw_elements.contact.errors import ContactFailed, NoSolution, NotFound, NotUnique
from pw_elements.contact.globalisation import Policy
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.newton import Increment, Iterate, Reference, newton
from pw_elements.contact.nodal import nodal_interface
from pw_elements.contact.pairs import ContactPair, Motion
from pw_elements.contact.progress import Callback, Reporter
from pw_elements.contact.refusals import no_equilibrium, refusal
from pw_elements.contact.remedies import Remedy, otherwise
from pw_elements.contact.results import contact_state
from pw_elements.contact.search import search
from pw_elements.contact.starts import first_active_set, first_unknowns
from pw_elements.contact.state import ContactState, Free
from pw_elements.contact.statics import RigidMotions
from pw_elements.contact.system import ContactSystem
from pw_elements.contact.watch import Watch
from pw_elements.iterative import Iterative
from pw_elements.linear_solver import LinearSolver, SolverNotConverged, SolverReport
from pw_elements.progress import doing
from pw_elements.reduction import Reduction

# Linear systems, and what they took
Spent: TypeAlias = tuple[int, SolverReport]
_NOTHING: Spent = (0, SolverReport("nothing", 0))


class Stepping:
    """The increments of a `ContactProblem` by one linear solver.

    Args:
        K: stiffness (n, n), free.
        reduction: supports, or condensation.
        pairs: contact pairs.
        space: trial space.
        max_iterations: linear systems of one iteration.
        callback: the user's function, if there is one.
        remedies: what is tried where the iteration fails, as far as the solver lets it.
        solver: of the linear systems.

    Attributes:
        interface: contact points.
        space: of the displacements.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: Sequence[ContactPair],
        space: fem.FunctionSpace,
        max_iterations: int,
        callback: Callback | None,
        remedies: Collection[Remedy],
        solver: LinearSolver,
    ) -> None:
        self.solver = solver
        iterative = isinstance(solver, Iterative)
        self._K = K
        self._reduction = (reduction.masked() if iterative else reduction).equilibrated(K)
        self._most, self._callback = max_iterations, callback
        # others condense the body
        self._remedies = [one for one in remedies if one == "cutback" or not iterative]
        self.interface = nodal_interface(pairs, space, self._reduction, K.getAttr("sibling"))
        self._whole, self.space = space, self.interface.field.space
        self._watch = Watch(self.interface, self.space)
        self._system: tuple[ContactSystem, RigidMotions] | None = None

    def step(
        self,
        state: ContactState,
        load: PETSc.Vec,
        moved: Sequence[Motion | None],
        guess: ContactState | None = None,
    ) -> ContactState:
        """The state at the end of one increment, as `ContactProblem.step` gives it."""
        begun = perf_counter()
        end = Target.of(load, moved, self.interface)
        reporter = Reporter(self.interface.comm, state.increment, self._callback)
        with doing(self.interface.comm, f"contact increment {state.increment}"):
            before = self._spent(end.free)
            try:
                found = self._solved(state, end, guess, reporter)
            except NotFound as failure:
                joined = self._cut(state, end, reporter) or self._searched(state, end, failure)
                if joined is None:
                    raise
                iterations, report = self._spent(end.free, before)
                found = replace(joined, iterations=iterations, report=report)
        reporter.ended(found, perf_counter() - begun)
        return found

    def _cut(self, state: ContactState, end: Target, reporter: Reporter) -> ContactState | None:
        """The state at a target, in parts; None if it is not found that way."""
        if "cutback" not in self._remedies or homogeneous(state):
            return None
        start = held_by(state, self._K, self.interface)
        return in_parts(lambda s, t: self._solved(s, t, None, reporter), state, start, end)

    def _searched(self, state: ContactState, end: Target, failure: NotFound) -> ContactState | None:
        """The state at a target, after a search of all statuses; None if it does not find it."""
        if "search" not in self._remedies:
            return None
        increment, place, policy = self._begun(state, end)
        before = self._spent(end.free)
        try:
            now = search(increment, lambda: self._condensed, place, policy, self._most)
        except NotUnique as unique:
            raise refusal(unique, increment, state, self._spent(end.free, before), ()) from None
        except NoSolution as proved:
            proved.state = failure.state
            raise
        return None if now is None else self._ended(increment, now, state, before)

    def _solved(
        self,
        state: ContactState,
        target: Target,
        guess: ContactState | None = None,
        reporter: Reporter | None = None,
    ) -> ContactState:
        """The state at a target, in one piece."""
        increment, place, policy = self._begun(state, target, guess)
        before, rigid = self._spent(target.free), self._bound(target.free)[1]
        active = first_active_set(place, state, guess, rigid.left_free)
        told = reporter.iterated if reporter and reporter.wanted else None
        try:
            now = newton(increment, active, place, policy(), self._most, told)
        except (ContactFailed, SolverNotConverged) as failure:
            proof, unproved = no_equilibrium(increment, place, rigid)
            if proof is not None:
                raise proof from None
            if isinstance(failure, SolverNotConverged):
                raise
            found, last = None, failure
            if "condensed" in self._remedies:
                found, last = otherwise(
                    failure, increment, lambda: self._condensed, place, policy, self._most
                )
            if found is None:
                spent = self._spent(target.free, before)
                raise refusal(last, increment, state, spent, unproved) from None
            now = found
        if reporter:
            reporter.violation = increment.violation(now)
        return self._ended(increment, now, state, before)

    def _begun(
        self, state: ContactState, target: Target, guess: ContactState | None = None
    ) -> tuple[Increment, Kinematics, Callable[[], Policy]]:
        """The equations from a state to a target, where they start, and a policy's maker."""
        interface, prescribed = self.interface, target.translations
        system, rigid = self._bound(target.free)
        past = Reference.of(state, interface)
        increment = Increment(
            system, self._K, target.load, prescribed, target.totals, past, target.stated
        )
        policy = partial(Policy.of, rigid.left_free, interface)
        translations = np.where(np.isnan(prescribed), (guess or state).translations, prescribed)
        system.start(lambda: first_unknowns(state, guess, self._whole), translations)
        interface.check_supports(translations)
        self._watch.before(increment)
        place = increment.kinematics(translations, past.displacement, past.force)
        return increment, place, policy

    def _ended(
        self, increment: Increment, now: Iterate, state: ContactState, before: Spent
    ) -> ContactState:
        """The state that a solution is."""
        self.interface.check_supports(now.translations)
        smallness = self._watch.after(increment, now, state)
        iterations, report = self._spent(increment.system.free, before)
        now.full.setAttr("space", self._whole)  # for who starts from it on another mesh
        return contact_state(increment, now, iterations, state, report, smallness)

    def _spent(self, free: Free, before: Spent = _NOTHING) -> Spent:
        """Linear systems of iterations since before, and what they and condensing took."""
        system, _ = self._bound(free)
        report = system.report
        if "_condensed" in vars(self):
            report = self._condensed.report.after(report)
        return system.solved - before[0], report.since(before[1])

    @cached_property
    def _condensed(self) -> Condensation:
        return Condensation(self._K, self._reduction, self.interface, self.solver)

    def release(self) -> None:
        """Frees what the solver holds, on all processes; the next step makes it anew."""
        if self._system is not None:
            self._system[0].release()
            self._system = None

    def _bound(self, free: Free) -> tuple[ContactSystem, RigidMotions]:
        """System and rigid motions for these free translations; one factorisation is kept."""
        if self._system is None or self._system[0].free != free:
            self.release()
            system = ContactSystem(self._K, self._reduction, self.interface, free, self.solver)
            self._system = system, RigidMotions(system, self.space)
        return self._system
