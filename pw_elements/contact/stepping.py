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
from pathlib import Path
from time import perf_counter
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.contact.condensed import Condensation
from pw_elements.contact.cutback import Target, held_by, homogeneous, in_parts
from pw_elements.contact.errors import ContactFailed, NoSolution, NotFound, NotUnique
from pw_elements.contact.globalisation import Policy
from pw_elements.contact.inputs import (
    check_belongs,
    check_state,
    checked_path,
    checked_problem,
    checked_remedies,
    checked_step,
    solver_for,
)
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.newton import Increment, Iterate, Reference, newton
from pw_elements.contact.nodal import nodal_interface
from pw_elements.contact.pairs import ContactPair, Motion
from pw_elements.contact.progress import Callback, Reporter, checked_callback
from pw_elements.contact.refusals import no_equilibrium, refusal
from pw_elements.contact.remedies import REMEDIES, Remedy, otherwise
from pw_elements.contact.results import contact_state, undeformed
from pw_elements.contact.search import search
from pw_elements.contact.starts import first_active_set, first_unknowns
from pw_elements.contact.state import ContactState, Free
from pw_elements.contact.statics import RigidMotions
from pw_elements.contact.storage import read_state, write_state
from pw_elements.contact.system import ContactSystem
from pw_elements.contact.watch import Watch
from pw_elements.iterative import Solver
from pw_elements.linear_solver import SolverReport
from pw_elements.mesh_checks import check_mesh
from pw_elements.progress import doing
from pw_elements.reduction import Reduction

# Linear systems, and what they took
Spent: TypeAlias = tuple[int, SolverReport]
_NOTHING: Spent = (0, SolverReport("nothing", 0))


class ContactProblem:
    """A body, its supports and contact pairs; `step` takes it from one state to the next.

        problem = ContactProblem(K, supports, [floor, punch], U)
        pressed = problem.step(problem.undeformed, load, [None, Motion((0, -0.1))])
        pushed = problem.step(pressed, load, [None, Motion((0.02, -0.1))])
        problem.save(pushed, "pushed.npz")

    States are never changed: any of them can be gone on from, any number of times.

    Args:
        K: stiffness (n, n), all rows and columns free; unsymmetric ones are welcome.
        reduction: supports (or condensation) that keep the contact nodes' displacements, or
            prescribe some that are tangential.
        pairs: contact pairs; a node belongs to one of them. Their `motions` are those of
            `solve_contact` and do not count here.
        space: trial space of the displacements, or of the hybrid element.
        solver: of the linear systems, as `solve` takes it.
        max_iterations: linear systems of one iteration.
        callback: called with a `Progress` after each iteration and each increment, on each process
            that has one; what it raises ends the computation.
        remedies: what is tried where the iteration fails: "condensed" does without active sets,
            on the contact points alone (see `remedies`), "cutback" halves the increment (see
            `cutback` and `ContactState.substates`), which with friction is another path, and
            "search" looks through all statuses of few points in the plane (see `search`).

    Raises:
        TypeError, ValueError: for input that states no contact problem, see `given.Problem` and
            `nodal.nodal_interface`.
        DegenerateMesh: for cells without volume or turned inside out.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: ContactPair | Sequence[ContactPair],
        space: fem.FunctionSpace,
        solver: Solver = None,
        max_iterations: int = 50,
        callback: Callback | None = None,
        remedies: Collection[Remedy] = REMEDIES,
    ) -> None:
        self.pairs = tuple(checked_problem(K, reduction, pairs, space, max_iterations, solver))
        check_mesh(space.mesh)
        self._solver, reduction = solver_for(solver, reduction)
        self._K, self._reduction = K, reduction.equilibrated(K)
        self._most = max_iterations
        self._callback = checked_callback(space.mesh.comm, callback)
        self._remedies = checked_remedies(remedies, space, self._solver)
        sibling = K.getAttr("sibling")
        self._interface = nodal_interface(self.pairs, space, self._reduction, sibling)
        self._whole, self._space = space, self._interface.field.space
        self._watch = Watch(self._interface, self._space)
        self._system: ContactSystem | None = None
        self._rigid: RigidMotions | None = None
        self.undeformed: ContactState = undeformed(self._interface, K.createVecRight())

    def step(
        self,
        state: ContactState,
        load: PETSc.Vec,
        motions: Motion | Sequence[Motion | None] | None = (),
        guess: ContactState | None = None,
    ) -> ContactState:
        """The state at the end of one increment.

        Args:
            state: at its start, of this problem or one like it; slip counts from there.
            load: load vector (n,) at its end, in all.
            motions: of each pair's surface from its initial place, None for one that rests
                there; all rest unless given. A single pair's needs no list.
            guess: state from whose active set to start, of a coarser mesh, say: each node takes
                the status of the nearest; an iterative solver takes its displacements, too (unless
                it was read from a file). It is no history.

        Raises:
            ValueError: for a load that is not finite, a number of motions that is not that of
                the pairs, motions of another dimension, a state of other contact nodes, arguments
                that differ between processes, a surface that fails, or a prescribed normal
                displacement of a node in contact.
            FreeBody: if a rigid motion is held by nothing, even if every contact node stuck.
            NoEquilibrium: a `FreeBody`, if it is proved that no contact forces balance the loads.
            NoSolution: if a search of all statuses proves that the increment has no state.
            NotUnique: if the tangent is singular at a solution: friction too large, or body loose.
            NotFound: if none has been found, whether there is one or not; `state` came nearest.
            SurfacePassed: if a rigid surface goes through the body, or pushes it outwards.
            SolverNotConverged: if an iterative solver fails, singular tangents among the reasons.
        """
        moved = checked_step(self._K, self._space, self.undeformed, state, load, motions, guess)
        begun = perf_counter()
        end = Target.of(load, moved, self._interface)
        reporter = Reporter(self._interface.comm, state.increment, self._callback)
        with doing(self._interface.comm, f"contact increment {state.increment}"):
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
        start = held_by(state, self._K, self._interface)
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
        except ContactFailed as failure:
            proof, unproved = no_equilibrium(increment, place, rigid)
            if proof is not None:
                raise proof from None
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
        interface, prescribed = self._interface, target.translations
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
        self._interface.check_supports(now.translations)
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
        return Condensation(self._K, self._reduction, self._interface, self._solver)

    def save(self, state: ContactState, path: str | Path) -> None:
        """Writes a state to a file, whole or not at all: a NumPy archive without pickles.

        Everything that the next increment needs is there; `substates` are left out.

        Raises:
            TypeError: for what is no state or path.
            ValueError: for a state of other contact nodes.
            OSError: if the file cannot be written.
        """
        check_state(state, self.undeformed, self._space)
        write_state(checked_path(path, self._space), state, self._whole)

    def load(self, path: str | Path) -> ContactState:
        """Reads a state that `save` wrote for the same problem, on any number of processes.

        Raises:
            TypeError: for what is no path.
            ValueError: if the file holds no state, or one of another mesh or other pairs.
            OSError: if the file cannot be read.
        """
        state = read_state(checked_path(path, self._space), self._whole)
        check_belongs(state, self.undeformed, "the file's state")
        return state

    def _bound(self, free: Free) -> tuple[ContactSystem, RigidMotions]:
        """System and rigid motions for these free translations; one factorisation is kept."""
        if self._system is None or self._rigid is None or self._system.free != free:
            self._system = None
            self._system = ContactSystem(
                self._K, self._reduction, self._interface, free, self._solver
            )
            self._rigid = RigidMotions(self._system, self._space)
        return self._system, self._rigid
