"""Increments of load and motion: `ContactProblem.step`, and `solve_contact`, a loop over it.

Small displacements: gap and normal belong to the *undeformed* body and the surface at its
present place (initial place + translation U), so that for the displacement a of a node

    g(a, U) = gap(x - U) + n(x - U)·a,

and the slip of an increment is the tangential part of (a - U) less that at its start.
Planes make this linear in U. For curved surfaces under force control it is linearised, the
active set found, and gap and n then taken at the U so found, until nothing changes.

Other loops over time join here. One that cuts increments back calls `step` again from the same
state, which nothing changes. An explicit one needs no `step`: from `nodal_interface` it takes
the gaps, normals, friction and G, and it corrects the nodes' predicted motion by the law.
"""

from collections.abc import Sequence
from pathlib import Path

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction, is_finite
from pw_elements.contact.checks import check_mesh, solver_for
from pw_elements.contact.errors import ContactFailed, ContactNotConverged
from pw_elements.contact.globalisation import LastHold, Policy
from pw_elements.contact.interface import Interface
from pw_elements.contact.newton import Increment, Reference, newton
from pw_elements.contact.nodal import nodal_interface
from pw_elements.contact.pairs import ContactPair, Motion
from pw_elements.contact.results import contact_state, undeformed
from pw_elements.contact.starts import first_active_set, first_displacement
from pw_elements.contact.state import ContactState, Free
from pw_elements.contact.statics import RigidMotions
from pw_elements.contact.storage import read_state, write_state
from pw_elements.contact.system import ContactSystem
from pw_elements.iterative import Solver

# Largest difference of the positions of nodes that are the same, over the largest coordinate
_SAME = 1e-9


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
        space: trial space of the displacements.
        solver: of the linear systems, as `solve` takes it; matching nodes need `Direct()`.
        max_iterations: linear systems per increment.

    Raises:
        ValueError: for input that states no contact problem (see `nodal.nodal_interface`).
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
    ) -> None:
        if max_iterations < 1:
            raise ValueError(f"max_iterations = {max_iterations}: one at least")
        check_mesh(space.mesh)
        pairs = [pairs] if isinstance(pairs, ContactPair) else list(pairs)
        self._solver, reduction = solver_for(solver, reduction, pairs)
        self._K, self._reduction, self._space, self._most = K, reduction, space, max_iterations
        self._interface = nodal_interface(pairs, space, reduction)
        self._system: ContactSystem | None = None
        self._rigid: RigidMotions | None = None
        self.undeformed: ContactState = undeformed(self._interface, K.createVecRight())

    def step(
        self,
        state: ContactState,
        load: PETSc.Vec,
        motions: Sequence[Motion | None] = (),
        guess: ContactState | None = None,
    ) -> ContactState:
        """The state at the end of one increment.

        Args:
            state: at its start, of this problem or one like it; slip counts from there.
            load: load vector (n,) at its end, in all.
            motions: of each pair's surface from its initial place, None for one that rests
                there; all rest unless given.
            guess: state from whose active set to start, of a coarser mesh, say: each node takes
                the status of the nearest; an iterative solver takes its displacements, too (unless
                it was read from a file). It is no history.

        Raises:
            ValueError: for a load that is not finite, a number of motions that is not that of
                the pairs, motions of another dimension, a state of other contact nodes, or a
                prescribed normal displacement of a node in contact.
            FreeBody: if a rigid motion is held by nothing, or no longer once the nodes that
                would pull have opened and those that cannot hold have slipped.
            NotUnique: if the tangent is singular otherwise: Coulomb's friction too large.
            ContactNotConverged: if the active sets repeat themselves, or no end is reached.
            SolverNotConverged: if an iterative solver fails, singular tangents among the reasons.
        """
        interface = self._interface
        self._check(state, load, motions, guess)
        prescribed, forces = _translations(motions, interface.pairs, interface.position.shape[1])
        free: Free = tuple((int(p), int(axis)) for p, axis in np.argwhere(np.isnan(prescribed)))
        system, rigid = self._bound(free)
        before = system.report
        totals = np.array([forces[at] for at in free])
        past = _reference(state, interface)
        increment = Increment(system, self._K, load, prescribed, totals, past)
        hold = LastHold(rigid.left_free, interface.pair, interface.pairs, interface.comm)
        policy = Policy(hold, interface.comm)

        first = _surfaces(guess or state)
        translations = np.where(np.isnan(prescribed), first, prescribed)
        system.start(lambda: first_displacement(state, guess, self._space), translations)
        interface.check_supports(translations)
        place = increment.kinematics(translations, past.displacement, past.force)
        active = first_active_set(place, state, guess, rigid.left_free)
        try:
            now, iterations = newton(increment, active, place, policy, self._most)
        except ContactNotConverged:
            if policy.lost:  # and nothing that was tried instead held the body
                raise policy.lost[-1] from None
            raise
        interface.check_supports(now.translations)
        now.full.setAttr("space", self._space)  # for who starts from it on another mesh
        return contact_state(increment, now, iterations, state, system.report.since(before))

    def save(self, state: ContactState, path: str | Path) -> None:
        """Writes a state to a file, whole or not at all: a NumPy archive without pickles.

        Raises:
            OSError: if the file cannot be written.
        """
        write_state(Path(path), state, self._space)

    def load(self, path: str | Path) -> ContactState:
        """Reads a state that `save` wrote for the same problem, on any number of processes.

        Raises:
            ValueError: if the file holds no state, or one of another mesh or other pairs.
            OSError: if the file cannot be read.
        """
        state = read_state(Path(path), self._space)
        self._check_state(state, "the file's state")
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

    def _check(
        self,
        state: ContactState,
        load: PETSc.Vec,
        motions: Sequence[Motion | None],
        guess: ContactState | None,
    ) -> None:
        dim = self._interface.position.shape[1]
        if not is_finite(load):
            raise ValueError("the load is not finite")
        if motions and len(motions) != self._interface.pairs:
            raise ValueError(f"{len(motions)} motions for {self._interface.pairs} contact pairs")
        for k, motion in enumerate(motions):
            if motion is not None and len(motion.translation) != dim:
                raise ValueError(f"the motion of contact pair {k} is not {dim}-D")
        if guess is not None and len(guess.pairs) != self._interface.pairs:
            raise ValueError("the state to start from has another number of contact pairs")
        self._check_state(state, "the state")

    def _check_state(self, state: ContactState, what: str) -> None:
        own = self.undeformed.pairs
        alike = len(state.pairs) == len(own) and all(
            pair.position.shape == mine.position.shape
            and np.abs(pair.position - mine.position).max() <= _SAME * np.abs(mine.position).max()
            for pair, mine in zip(state.pairs, own, strict=True)
        )
        if not alike:
            raise ValueError(f"{what} belongs to other contact nodes than this problem's")


def solve_contact(
    K: PETSc.Mat,
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    start: ContactState | Sequence[ContactState] = (),
    max_iterations: int = 50,
    solver: Solver = None,
) -> list[ContactState]:
    """Displacements and contact forces at the end of each increment.

    Args:
        K: stiffness (n, n), all rows and columns free; unsymmetric ones are welcome.
        loads: load vector (n,) at the end of each increment.
        reduction: supports (or condensation) that keep the contact nodes' displacements, or
            prescribe some that are tangential.
        pairs: contact pairs; a node belongs to one of them.
        space: trial space of the displacements.
        start: states of the same increments, from a coarser mesh, say: each increment starts
            from the status of the nearest node. It is a guess, no history: slip counts from the
            undeformed body in the first increment, whatever it starts from (`ContactProblem.step`
            goes on from a state). Without it the first increment starts from the nodes that
            touch, every other one from the previous one.
        max_iterations: linear systems per increment.
        solver: of the linear systems, as `solve` takes it; matching nodes need `Direct()`.

    Raises:
        ValueError: for input that states no contact problem (see `nodal.nodal_interface`),
            loads that are not finite, motions or starts that are not one per increment, or no
            iterations.
        DegenerateMesh: for cells without volume or turned inside out.
        FreeBody, NotUnique, ContactNotConverged: as `ContactProblem.step` says. They name the
            increment, counted from 0, and have the states before it as `states`.
    """
    loads = [loads] if isinstance(loads, PETSc.Vec) else list(loads)
    pairs = [pairs] if isinstance(pairs, ContactPair) else list(pairs)
    start = [start] if isinstance(start, ContactState) else list(start)
    problem = ContactProblem(K, reduction, pairs, space, solver, max_iterations)
    _check_increments(loads, pairs, space.mesh.geometry.dim, start)
    states = [problem.undeformed]
    for k, load in enumerate(loads):
        motions = [pair.motions[k] if pair.motions else None for pair in pairs]
        try:
            states.append(problem.step(states[-1], load, motions, start[k] if start else None))
        except ContactFailed as error:
            named = type(error)(f"increment {k}: {error}")
            named.states = states[1:]
            raise named from error
    return states[1:]


def _translations(
    motions: Sequence[Motion | None], pairs: int, dim: int
) -> tuple[np.ndarray, np.ndarray]:
    """Prescribed translations (pairs, dim), NaN where free, and total forces (pairs, dim)."""
    rest = np.zeros(dim)
    each = list(motions) or [None] * pairs
    prescribed = [rest if m is None else m.prescribed() for m in each]
    return np.array(prescribed), np.array([rest if m is None else m.forces() for m in each])


def _surfaces(state: ContactState) -> np.ndarray:
    """Translations (pairs, dim)."""
    return np.array([pair.translation for pair in state.pairs])


def _reference(state: ContactState, interface: Interface) -> Reference:
    """What an increment from a state has to know of it, on this process."""
    forces = [p.force_normal[:, None] * p.normal + p.force_tangential for p in state.pairs]
    moved = interface.local([pair.displacement for pair in state.pairs])
    return Reference(moved, interface.local(forces), _surfaces(state))


def _check_increments(
    loads: Sequence[PETSc.Vec],
    pairs: Sequence[ContactPair],
    dim: int,
    start: Sequence[ContactState],
) -> None:
    if not loads:
        raise ValueError("there is no load increment")
    for k, load in enumerate(loads):
        if not is_finite(load):
            raise ValueError(f"the load of increment {k} is not finite")
    for k, pair in enumerate(pairs):
        if pair.motions and len(pair.motions) != len(loads):
            raise ValueError(
                f"contact pair {k} has {len(pair.motions)} motions for {len(loads)} increments"
            )
        if any(len(motion.translation) != dim for motion in pair.motions):
            raise ValueError(f"the motions of contact pair {k} are not {dim}-D")
    if start and len(start) != len(loads):
        raise ValueError(f"{len(start)} states to start from for {len(loads)} increments")
    if any(len(state.pairs) != len(pairs) for state in start):
        raise ValueError("a state to start from has another number of contact pairs")
