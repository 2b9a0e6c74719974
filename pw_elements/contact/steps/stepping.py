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
from functools import cache, partial
from time import perf_counter
from typing import Literal, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra import Reduction, equilibrated, masked
from pw_elements.arrays import Array, Mask
from pw_elements.checks import collective
from pw_elements.contact.interface import Interface, NoContactStated, nodal_interface
from pw_elements.contact.iteration import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    TOLERANCE,
    ActiveSet,
    ContactSystem,
    Increment,
    LinearEquilibrium,
    Place,
    Policy,
    Reference,
    contact_state,
    initial_active_set,
    newton,
    reference_sizes,
    resumed,
)
from pw_elements.contact.model import (
    NOTHING_DONE,
    ContactFailed,
    ContactPair,
    ContactState,
    Free,
    Motion,
    NotFound,
    Scale,
)
from pw_elements.contact.rescue import (
    RigidMotions,
    by_springs,
    check_loose,
    no_equilibrium,
    rescue,
)
from pw_elements.contact.steps.sensitivity import Linearised, Part
from pw_elements.contact.steps.slip import SlipCheck
from pw_elements.contact.steps.smallness import SmallnessCheck
from pw_elements.contact.steps.verification import (
    DISPLACEMENT_ROUND_OFF,
    Sizes,
    check_stiffness_sign,
    places_undeformed,
    verify_state,
)
from pw_elements.progress import doing, told
from pw_elements.solvers import (
    LinearSolver,
    NotConverged,
    SingularSystem,
    SolverReport,
    add,
    is_matrix_free,
    unblocked,
)
from pw_elements.spaces import Assembled

# Smallest part of an increment
_SMALLEST = 1 / 16

# What is tried if the iteration fails: springs at the points, and smaller increments. Either may
# solve MULTIPLE times as many linear systems as the first attempt, which counts as at least _USUAL
# of them up to _FEW unknowns, and less beyond
Remedy: TypeAlias = Literal["springs", "cutback"]
REMEDIES: tuple[Remedy, ...] = ("springs", "cutback")
MULTIPLE = 3.0
_USUAL, _FEW = 50, 2000

# Linear systems, and what they took
Spent: TypeAlias = tuple[int, SolverReport]


@dataclass(frozen=True)
class Target:
    """What is prescribed at the end of an increment, or of a part of one."""

    load: PETSc.Vec | None  # f (n,), in all; None of a residual, which holds it
    # of the surfaces (pairs, k), NaN where they are free; with the angle last where they may turn
    translations: Array
    forces: Array  # total forces of the surfaces (pairs, k), of those that are free
    stated: float = 1.0  # share of the displacements that supports and interference prescribe

    @classmethod
    def of(
        cls,
        load: PETSc.Vec | None,
        motions: Sequence[Motion | None],
        interface: Interface,
        turning: bool = False,
    ) -> "Target":
        """As the user states it; surfaces without a motion rest, and may be `turning`."""
        dim = interface.position.shape[1]
        rest, k = Motion([0.0] * dim), dim + turning
        each = [m or rest for m in motions] or [rest] * interface.pairs
        prescribed, forces = zip(*((m.prescribed()[:k], m.forces()[:k]) for m in each), strict=True)
        return cls(load, np.array(prescribed), np.array(forces))

    @classmethod
    def reached(
        cls, state: ContactState, load: PETSc.Vec | None = None, turning: bool = False
    ) -> "Target":
        """Where a state is, nothing being free; nothing is stated of an undeformed body."""
        translations = state.placements if turning else state.translations
        forces = np.array([[*pair.force, pair.torque] for pair in state.pairs])
        stated = 1.0 if state.increment else 0.0
        return cls(load, translations, forces[:, : translations.shape[1]], stated)

    def leaving(self, free: Free) -> "Target":
        """The same with free motions, which follow from the forces."""
        translations = self.translations.copy()
        for at in free:
            translations[at] = np.nan
        return replace(self, translations=translations)

    @property
    def free(self) -> Free:
        """(pair, component) of each free translation."""
        return tuple((int(p), int(axis)) for p, axis in np.argwhere(np.isnan(self.translations)))

    @property
    def idle(self) -> Mask:
        """Whether each pair's surface (pairs,) is free and pushed by nothing: it just touches."""
        free = np.isnan(self.translations)
        return free.any(axis=1) & ~(free & (self.forces != 0)).any(axis=1)

    @property
    def totals(self) -> Array:
        return np.array([self.forces[at] for at in self.free])


def held_by(state: ContactState, K: PETSc.Mat, interface: Interface) -> Target:
    """What a state is in equilibrium with; forces of supports count as load, they do no work.

    It follows from displacements and contact forces alone, f = K a - H r.
    """
    points = interface.force.createVecRight()
    points.setArray(np.where(interface.equation >= 0, Reference.of(state, interface).force, 0.0))
    load = K.createVecLeft()
    K.mult(state.unknowns, load)
    load.axpy(-1.0, interface.force * points)
    return Target.reached(state, load)


def between(start: Target, end: Target, share: float) -> Target:
    """A share of the way from one to the other."""
    if share == 1:
        return end
    load = None
    if start.load is not None:
        load = start.load.copy()
        load.scale(1 - share)
        load.axpy(share, end.load)
    return Target(
        load,
        (1 - share) * start.translations + share * end.translations,
        (1 - share) * start.forces + share * end.forces,
        (1 - share) * start.stated + share * end.stated,
    )


def divided(
    step: Callable[[ContactState, float], ContactState],
    state: ContactState,
    sizes: tuple[float, float, float],
    may_go_on: Callable[[], bool] = lambda: True,
) -> tuple[list[tuple[float, ContactState]], tuple[float, Exception] | None]:
    """Ends (share, state) of an increment's parts, and where and how the last one failed.

    `sizes` are the first part's, which is the largest, the smallest one's, and the factor of one
    after a success.
    """
    largest, smallest, growth = sizes
    size = largest
    done, now, failure = 0.0, state, None
    parts: list[tuple[float, ContactState]] = []
    while done < 1 and size >= smallest and may_go_on():
        share = min(1.0, done + size)
        try:
            now = replace(step(now, share), increment=state.increment + 1)
        except (ContactFailed, NoContactStated, SingularSystem) as failed:
            words = f"not from {done:.4g} to {share:.4g} of the increment: {failed}"
            told(state.displacement.comm, logging.INFO, words, ".contact")
            size, failure = (share - done) / 2, (share, failed)
            continue
        done, size, failure = share, min(growth * size, largest), None
        parts.append((share, now))
    return parts, failure


def joined(parts: Sequence[tuple[float, ContactState]]) -> ContactState:
    """The last part, with the slips of all."""
    last, pairs = parts[-1][1], []
    for k, pair in enumerate(last.pairs):
        closed = (pair.status != OPEN)[:, None]
        slips = {
            name: closed * np.sum([getattr(part.pairs[k], name) for _, part in parts], axis=0)
            for name in ("slip", "path_slip")
        }
        pairs.append(replace(pair, **slips))
    return replace(last, pairs=tuple(pairs), substates=tuple(parts[:-1]))


@dataclass(frozen=True)
class Progress:
    """How far a contact computation is: after an iteration, or at the end of an increment.

    Args:
        increment: number of increments before this one: they count from 0, as in the errors of
            `solve_contact`.
        iteration: number of linear systems solved in this increment.
        violation: largest violation of the laws of contact and friction, over its tolerance.
        open: number of open nodes of all pairs; after an iteration, as it was assumed.
        stick: number of sticking ones.
        slip: number of slipping ones.
        state: at the end of the increment; None after an iteration.
    """

    increment: int
    iteration: int
    violation: float
    open: int
    stick: int
    slip: int
    state: ContactState | None = None

    def __str__(self) -> str:
        return f"{self.open} open, {self.stick} stick, {self.slip} slip"


Callback: TypeAlias = Callable[[Progress], object]


class Reporter:
    """Logs one increment and calls the user's callback; all processes make and use it together."""

    def __init__(self, comm: MPI.Comm, increment: int, callback: Callback | None) -> None:
        self._comm, self._increment, self._callback = comm, increment, callback
        told_of = logging.getLogger("pw_elements.contact").isEnabledFor(logging.DEBUG)
        logged = comm.rank == 0 and told_of
        self.violation = 0.0  # of the last solution, as in `Progress`
        # what tells of an iteration, if anybody wants to know
        wanted = comm.allreduce(bool(callback or logged), MPI.LOR)
        self.iteration = self._iterated if wanted else None

    def _iterated(self, iteration: int, active: ActiveSet, violation: float) -> None:
        counts = self._comm.allreduce(np.bincount(active.status, minlength=HELD + 1))
        now = self._progress(iteration, violation, counts)
        words = f"iteration {iteration}: {now}, violation / tolerance {violation:.1e}"
        self._tell(logging.DEBUG, words, now)

    def ended(self, state: ContactState, seconds: float) -> None:
        status = np.concatenate([pair.status for pair in state.pairs])
        counts, report = np.bincount(status, minlength=HELD + 1), state.report
        now = self._progress(state.iterations, self.violation, counts, state)
        words = (
            f"{now.iteration} iterations, {now}, residual {state.residuals.largest():.1e}, "
            f"{report.method}, {report.factorisations} factorisations, {seconds:.2f} s"
        )
        self._tell(logging.INFO, words, now)

    def _progress(
        self,
        iteration: int,
        violation: float,
        counts: npt.NDArray[np.intp],
        state: ContactState | None = None,
    ) -> Progress:
        sticking = int(counts[STICK] + counts[HELD])
        each = int(counts[OPEN]), sticking, int(counts[SLIP])
        return Progress(self._increment, iteration, violation, *each, state)

    def _tell(self, level: int, words: str, now: Progress) -> None:
        """Logs, and calls the user's function: what it raises on one process is raised on all."""
        told(self._comm, level, f"increment {self._increment}: {words}", ".contact")
        with collective(self._comm):
            if self._callback is not None:
                self._callback(now)


class Stepping:
    """The increments of a `ContactProblem` by one linear solver.

    Remedies are what is tried where the iteration fails, as far as the solver lets it, and what
    each may take over the first attempt; the space is that of the displacements.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: Sequence[ContactPair],
        space: fem.FunctionSpace,
        max_iterations: int,
        callback: Callback | None,
        remedies: Mapping[Remedy, float],
        solver: LinearSolver,
    ) -> None:
        self.solver = solver
        iterative = is_matrix_free(solver)
        self._K = K
        self._reduction = equilibrated(masked(reduction) if iterative else reduction, K)
        self._most, self._callback = max_iterations, callback
        # springs are in an assembled matrix
        self._remedies = {k: m for k, m in remedies.items() if k == "cutback" or not iterative}
        self._first = 0  # linear systems of an increment's first attempt
        self.interface = nodal_interface(pairs, space, self._reduction, Assembled.of(K))
        check_stiffness_sign(K, self.interface, "give -K, by which forces oppose displacements")
        self.space = self.interface.field.space
        self._watch = SmallnessCheck(self.interface, self.space)
        self._slips = SlipCheck(self.interface)
        self._system: tuple[ContactSystem, RigidMotions] | None = None
        self._soft: ContactSystem | None = None  # with springs

    def step(
        self, state: ContactState, load: PETSc.Vec, moved: Sequence[Motion | None]
    ) -> ContactState:
        begun = perf_counter()
        end = Target.of(load, moved, self.interface)
        comm, what = self.interface.comm, f"contact increment {state.increment}"
        with doing(comm, what):
            reporter = Reporter(comm, state.increment, self._callback)
            before = self._spent(end.free)
            try:
                found = self._solved(state, end, reporter)
            except NotFound as failure:
                parts = self._cut(state, end, reporter)
                if not parts:
                    raise
                iterations, report = self._spent(end.free, before)
                found = replace(joined(parts), iterations=iterations, report=report)
                done, _ = parts[-1]
                if done < 1:
                    failure.reached = done, found
                    failure.args = (f"{failure}. In parts {done:.3g} of it was reached",)
                    raise
        self._slips.check(found)
        reporter.ended(found, perf_counter() - begun)
        return found

    def _cut(
        self, state: ContactState, end: Target, reporter: Reporter
    ) -> list[tuple[float, ContactState]]:
        """Ends (share, state) of the parts that are found on the way to a target."""
        if "cutback" not in self._remedies:
            return []
        start, left = held_by(state, self._K, self.interface), self._left("cutback", end.free)
        comm = self.interface.comm
        words = f"in parts, for what {left():.0f} linear systems take at most"
        told(comm, logging.INFO, words, ".contact")

        def part(now: ContactState, share: float) -> ContactState:
            return self._solved(now, between(start, end, share), reporter, left)

        parts, _ = divided(part, state, (0.5, _SMALLEST, 1.0), lambda: left() > 0)
        done = parts[-1][0] if parts else 0.0
        words = f"{done:.4g} of the increment has been solved in {len(parts)} parts"
        told(comm, logging.INFO, words, ".contact")
        return parts

    def _left(self, remedy: Remedy, free: Free) -> Callable[[], float]:
        """What tells how many linear systems a remedy may still solve."""
        usual = _USUAL * min(1.0, _FEW / self._K.getSize()[0]) ** 1.5
        end = self._spent(free)[0] + self._remedies.get(remedy, 0.0) * max(self._first, usual)
        return lambda: end - self._spent(free)[0]

    def _solved(
        self,
        state: ContactState,
        target: Target,
        reporter: Reporter,
        left: Callable[[], float] | None = None,
    ) -> ContactState:
        """The state at a target, in one piece; of a part, by what systems are `left`."""
        increment, place, policy = self._begun(state, target)
        before, rigid = self._spent(target.free), self._bound(target.free)[1]
        active = initial_active_set(self.interface, place, state, rigid.left_free, target.idle)
        proved = cache(partial(no_equilibrium, increment, place, rigid))

        def doubt() -> None:
            if proof := proved():
                raise proof

        most = self._most if left is None else int(max(1, min(self._most, left())))
        try:
            now = newton(increment, active, place, policy(), most, reporter.iteration, doubt)
        except (ContactFailed, NotConverged) as failure:
            if left is None:
                self._first = self._spent(target.free, before)[0]
                left = self._left("springs", target.free)
            held = partial(self._sprung, target, increment.past), active, place, state.unknowns
            springs = partial(by_springs, increment, *held, policy, self._most, left)
            now = rescue(
                failure,
                increment,
                proved,
                springs if "springs" in self._remedies else None,
                state,
                lambda: self._spent(target.free, before),
            )
        if reporter.iteration:
            reporter.violation = increment.violation(now)
        self.interface.check_supports(now.translations)
        given = increment.equilibrium.offset, target.translations, now.contact.pressing > 0
        self.interface.check_supports_between(*given)
        check_loose(increment, now, rigid, state, lambda: self._spent(target.free, before))
        smallness = self._watch.after(increment, now, state)
        iterations, report = self._spent(target.free, before)
        slides = rigid.slides(now.contact, increment.allowed(now))
        found = contact_state(increment, now, iterations, state, report, smallness, slides=slides)
        return self._verified(found, state, target, reference_sizes(increment, now, state.scale))

    def _verified(
        self,
        found: ContactState,
        before: ContactState,
        target: Target,
        sizes: tuple[Scale, float, float],
    ) -> ContactState:
        """The state at a target with residuals that K, the load, surfaces and law alone give."""
        _, force, length = sizes
        unbalanced = self._K.createVecLeft()
        self._K.mult(found.unknowns, unbalanced)
        assert target.load is not None
        unbalanced.axpy(-1.0, target.load)
        largest = PETSc.NormType.INFINITY
        lost = TOLERANCE * target.load.norm(largest)
        lost += DISPLACEMENT_ROUND_OFF * self._K.norm(largest) * found.unknowns.norm(largest)
        stiffness = self._bound(target.free)[0].scale
        return verify_state(
            found,
            places_undeformed(self.interface, before, found, 1 - target.stated),
            unbalanced,
            self.interface,
            self._reduction,
            Sizes(force, length, stiffness, lost),
            target.totals,
        )

    def _sprung(
        self,
        target: Target,
        past: Reference,
        share: float,
        unknowns: PETSc.Vec,
        translations: Array,
    ) -> Increment:
        """The equations to a target with springs, as `by_springs` wants them."""
        interface, free, field = self.interface, target.free, self.interface.field
        stated, stiffness = interface.equation >= 0, share * self._bound(free)[0].scale
        node = interface.node - field.space.dofmap.index_map.local_range[0]
        springs, pull = self._K.createVecs()
        springs.array[field.owned[node][stated]] = np.repeat(stiffness, stated.sum(axis=1))
        each = np.bincount(interface.pair, stiffness, interface.pairs).astype(float)  # of none
        interface.comm.Allreduce(MPI.IN_PLACE, each, MPI.SUM)
        held = PETSc.Mat().createAIJ(self._K.getSizes(), nnz=1, comm=self._K.comm)
        held.setDiagonal(springs)
        held.assemble()
        K = unblocked(self._K).copy()
        add(K, 1.0, held)
        if self._soft is None:
            self._soft = ContactSystem(K, self._reduction, interface, free, self.solver)
        self._soft.springs = np.array([each[pair] for pair, _ in free])
        self._soft.renew(K)
        pull.pointwiseMult(springs, unknowns)
        pull.axpy(1.0, target.load)
        equilibrium = LinearEquilibrium.of(self._soft, K, pull, target.stated)
        totals = target.totals + self._soft.springs * [translations[at] for at in free]
        return Increment(self._soft, equilibrium, target.translations, totals, past, target.stated)

    def linearised(self, part: Part) -> Linearised:
        state, interface = part.state, self.interface
        goal = held_by(state, self._K, interface).leaving(state.free)
        system, _ = self._bound(state.free)
        stated = 1.0 if part.start.increment else part.share
        equilibrium = LinearEquilibrium.of(system, self._K, goal.load, stated)
        past, end = Reference.of(part.before, interface), Reference.of(state, interface)
        increment = Increment(system, equilibrium, goal.translations, goal.totals, past, stated)
        place = increment.kinematics(end.translations, end.displacement, end.force, every=True)
        now = increment.solve(resumed(interface, place, state), place)
        return Linearised(increment, now, self._K, self._reduction, -place.frame[:, 1:])

    def _begun(
        self, state: ContactState, target: Target
    ) -> tuple[Increment, Place, Callable[[], Policy]]:
        """The equations from a state to a target, where they start, and a policy's maker."""
        interface, prescribed = self.interface, target.translations
        system, rigid = self._bound(target.free)
        past = Reference.of(state, interface)
        equilibrium = LinearEquilibrium.of(system, self._K, target.load, target.stated)
        increment = Increment(system, equilibrium, prescribed, target.totals, past, target.stated)
        policy = partial(Policy, rigid.left_free, interface)
        begin = np.where(target.idle[:, None], 0.0, state.translations)
        translations = np.where(np.isnan(prescribed), begin, prescribed)
        system.start(lambda: state.unknowns, translations)
        interface.check_supports(translations)
        self._watch.before(increment)
        place = increment.kinematics(translations, past.displacement, past.force)
        return increment, place, policy

    def _spent(self, free: Free, before: Spent = (0, NOTHING_DONE)) -> Spent:
        """Linear systems since before, with springs and without, and what they took."""
        system, _ = self._bound(free)
        solved, report = system.solved, system.report
        if self._soft is not None:
            solved, report = solved + self._soft.solved, self._soft.report.after(report)
        return solved - before[0], report.since(before[1])

    def release(self) -> None:
        if self._system is not None:
            self._system[0].tangent.release()
            self._system = self._soft = None

    def _bound(self, free: Free) -> tuple[ContactSystem, RigidMotions]:
        """System and rigid motions for these free translations; one factorisation is kept."""
        if self._system is None or self._system[0].free != free:
            self.release()
            system = ContactSystem(self._K, self._reduction, self.interface, free, self.solver)
            self._system = system, RigidMotions(system, self._K, self.space)
        return self._system
