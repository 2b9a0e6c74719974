"""The active-set iteration of one increment."""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pw_elements.algebra import SingularSystem
from pw_elements.contact.errors import ContactNotConverged, FreeBody, NotUnique
from pw_elements.contact.geometry import Geometry
from pw_elements.contact.history import History, mixed, same
from pw_elements.contact.law import (
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    Contact,
    equations,
)
from pw_elements.contact.pairs import ContactNodes
from pw_elements.contact.rigid import RigidMotions
from pw_elements.contact.state import ContactState, Residuals, pair_states
from pw_elements.contact.system import ContactSystem

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Violation of the law over the largest nodal contact force
_TOLERANCE = 1e-9
# What of the violation may be round-off: over stiffness x displacement, and over stiffness x
# coordinate, for a gap is a difference of coordinates
_ROUND_OFF = 1e-13
_EPSILON = 4 * float(np.finfo(float).eps)
# A gap of this part of the surface's extent counts as closed in a cold start
_TOUCHING = 1e-9
# How often nodes that had let go are asked to hold the body once more, in an increment
_RESCUES = 3


@dataclass(frozen=True)
class ReferenceState:
    """Contact nodes at the end of an increment: slip of the next one counts from here.

    Args:
        displacement: (n, dim).
        force: (n, dim).
        translations: of the surfaces, (pairs, dim).
        active: what the next increment starts from; None before the first.
        frame: (n, dim, dim), to which `active` refers.
    """

    displacement: Array
    force: Array
    translations: Array
    active: ActiveSet | None
    frame: Array

    @classmethod
    def undeformed(cls, nodes: ContactNodes) -> "ReferenceState":
        """Nothing has moved."""
        zero = np.zeros_like(nodes.position)
        n, dim = zero.shape
        return cls(zero, zero, np.zeros((len(nodes.pairs), dim)), None, np.zeros((n, dim, dim)))


@dataclass(frozen=True)
class Iterate:
    """A solution of one linear system, seen from the contact nodes."""

    reduced: PETSc.Vec
    full: PETSc.Vec
    translations: Array  # (pairs, dim)
    displacement: Array  # (n, dim)
    force: Array  # (n, dim), of the surfaces on the nodes
    unbalanced: float  # largest force on a free node that cannot be in contact
    contact: Contact


class Increment:
    """One increment: from a reference state to a state that satisfies all conditions."""

    def __init__(
        self,
        system: ContactSystem,
        rigid: RigidMotions,
        K: PETSc.Mat,
        load: PETSc.Vec,
        prescribed: Array,
        totals: Array,
        past: ReferenceState,
        max_iterations: int,
    ) -> None:
        self.system, self.rigid, self.nodes = system, rigid, system.nodes
        self.reduction = system.reduction.under(K, load)
        self.load = self.reduction.load(K, load)
        self.prescribed, self.totals, self.past = prescribed, totals, past
        self.max_iterations = max_iterations
        self.lost_holds: list[FreeBody] = []
        self.scale = system.stiffness_scale()

    def run(self, start: ContactState | None) -> tuple[ContactState, ReferenceState]:
        """Iterates to the end.

        Raises:
            FreeBody, NotUnique, ContactNotConverged: as `solve_contact` says.
        """
        try:
            return self._iterated(start)
        except ContactNotConverged:
            if self.lost_holds:  # and nothing that was tried instead held the body
                raise self.lost_holds[-1] from None
            raise

    def _iterated(self, start: ContactState | None) -> tuple[ContactState, ReferenceState]:
        translations = self._first_translations(start)
        self.nodes.check_supports(translations)
        past = self.past
        place = self._geometry(translations, past.displacement, past.force)
        active = self._first_active_set(start, place)
        history = History(self.system.comm)
        history.repeats(active)
        for iteration in range(1, self.max_iterations + 1):
            now = self._solve(active, place)
            if self._violation(now) <= 1:
                place, linear = self._geometry(now.translations, now.displacement, now.force), place
                now = self._seen(now.reduced, now.translations, place)
                if self._violation(now) <= 1:
                    self.nodes.check_supports(now.translations)
                    return self._finish(now, iteration)
                active = _turned(active, linear.frame, place.frame)
                history = History(self.system.comm)
            new = self._held(history.slowed(active, now.contact), active, now.contact)
            if not self.system.own_factors and same(new, active, self.system.comm):
                self.system.forget_factors()
                continue
            if history.repeats(new):
                new = self._held(history.slowed(active, now.contact), active, now.contact)
            active = new
        raise ContactNotConverged(
            f"no active set satisfies the contact conditions after {self.max_iterations} "
            f"iterations; the last one violates them {self._violation(now):.1e} times the "
            "tolerance: more iterations, smaller increments or a start from a coarser mesh may help"
        )

    # -- starts ----------------------------------------------------------------------------

    def _first_translations(self, start: ContactState | None) -> Array:
        guess = self.past.translations
        if start is not None:
            guess = np.array([pair.translation for pair in start.pairs])
        return np.where(np.isnan(self.prescribed), guess, self.prescribed)

    def _first_active_set(self, start: ContactState | None, place: Geometry) -> ActiveSet:
        if start is not None:
            first = self._transferred(start, place.frame)
        elif self.past.active is not None:
            first = _turned(self.past.active, self.past.frame, place.frame)
        else:
            first = self._touching(place)
        for candidate in (first, self._sticking(np.isfinite(place.gap))):
            motions = self._free_motions(candidate, place.frame)
            if not motions:
                return candidate
        raise FreeBody(
            f"{' and '.join(motions)}: held neither by supports nor by contact, even if every "
            "contact node touched and stuck; add a support, friction or contact nodes"
        )

    def _touching(self, place: Geometry) -> ActiveSet:
        """Nodes that the moved surface reaches; the nearest of each pair in any case."""
        gap, x = place.gap, self.nodes.gathered(self.nodes.position)
        near = _TOUCHING * np.ptp(x, axis=0).max()
        closed = gap <= near
        for k in range(len(self.nodes.pairs)):
            mine = self.nodes.pair == k
            nearest = self.system.comm.allreduce(gap[mine].min(initial=np.inf), MPI.MIN)
            closed |= mine & np.isfinite(gap) & (gap <= nearest + near)
        return self._sticking(closed)

    def _sticking(self, closed: Mask) -> ActiveSet:
        closed_status = np.where(self.nodes.friction > 0, STICK, SLIP)
        status = np.where(closed, closed_status, OPEN).astype(np.int8)
        n, dim = self.nodes.position.shape
        return ActiveSet(status, np.zeros((n, dim - 1)), np.zeros(n))

    def _transferred(self, start: ContactState, frame: Array) -> ActiveSet:
        """Status and direction of the nearest node of another mesh's state."""
        n, dim = self.nodes.position.shape
        status, force = np.zeros(n, dtype=np.int8), np.zeros((n, dim))
        for k, pair in enumerate(start.pairs):
            mine = self.nodes.pair == k
            if mine.any():
                nearest = cKDTree(pair.position).query(self.nodes.position[mine])[1]
                status[mine] = pair.status[nearest]
                force[mine] = pair.force_tangential[nearest]
        rough = self.nodes.friction > 0
        status[(status == STICK) & ~rough] = SLIP
        tangential = np.einsum("nab,nb->na", frame[:, 1:], force)
        size = np.linalg.norm(tangential, axis=1)
        directed = (status == SLIP) & rough & (size > 0)
        status[(status == SLIP) & rough & ~directed] = STICK
        direction = np.where(directed, 1 / np.where(directed, size, 1.0), 0.0)[:, None]
        return ActiveSet(status, direction * tangential, directed.astype(float))

    # -- one linear system -------------------------------------------------------------------

    def _geometry(self, translations: Array, displacement: Array, force: Array) -> Geometry:
        free = np.isnan(self.prescribed)
        past = self.past.displacement - self.nodes.shifts(self.past.translations)
        return Geometry.at(self.nodes, past, translations, free, displacement, force)

    def _solve(self, active: ActiveSet, place: Geometry) -> Iterate:
        """Solves for an active set and the geometry of a place."""
        E, C, D, constraint = place.equations(*equations(active, self.nodes.friction, self.scale))
        known = self.nodes.shifts(np.nan_to_num(self.prescribed))
        constraint += np.einsum("nij,nj->ni", D, known)
        try:
            reduced, free = self.system.solve(self.load, E, C, D, constraint, self.totals)
        except SingularSystem as error:
            raise NotUnique(
                f"{error}: no rigid motion is free, so the friction of the {self._count(active)} "
                "is too large for a unique answer"
            ) from error
        moved = self.prescribed.copy()
        moved[np.isnan(moved)] = free
        return self._seen(reduced, moved, place)

    def _seen(self, reduced: PETSc.Vec, translations: Array, place: Geometry) -> Iterate:
        """Gaps, slips and forces at the contact nodes."""
        nodes, system = self.nodes, self.system
        full = self.reduction.expand(reduced)
        dim = nodes.position.shape[1]
        displacement = full.array_r.reshape(-1, dim)[nodes.node]
        forces = self.load.duplicate()
        system.stiffness.mult(reduced, forces)
        forces.axpy(-1.0, self.load)
        force = system.at_nodes(forces.array_r)
        contact = Contact(
            place.frame,
            place.gaps(displacement, translations),
            place.slips(displacement, translations),
            place.forces(force, translations),
            nodes.friction,
            self.scale,
        )
        unbalanced = system.elsewhere(forces.array_r)
        return Iterate(reduced, full, translations, displacement, force, unbalanced, contact)

    def _violation(self, now: Iterate) -> float:
        """Largest violation of law and balance over what is allowed."""
        comm = self.system.comm
        wrong = np.nan_to_num(np.abs(now.contact.violation()), nan=np.inf).max(initial=0.0)
        largest = comm.allreduce(np.abs(now.force).max(initial=0.0), MPI.MAX)
        wrong = comm.allreduce(wrong, MPI.MAX)
        allowed = _TOLERANCE * largest + self._lost(now)
        return float(wrong / allowed) if wrong > 0 else 0.0

    def _lost(self, now: Iterate) -> float:
        """Force that may be nothing but round-off."""
        round_off = _ROUND_OFF * np.abs(now.displacement) + _EPSILON * np.abs(self.nodes.position)
        lost = (self.scale[:, None] * round_off).max(initial=0.0)
        return float(self.system.comm.allreduce(lost, MPI.MAX))

    # -- rigid motions -------------------------------------------------------------------------

    def _free_motions(self, active: ActiveSet, frame: Array) -> list[str]:
        one = np.ones_like(self.scale)
        B = equations(active, self.nodes.friction, one)[1]
        return self.rigid.free(np.einsum("nab,nbj->naj", B, frame))

    def _held(self, new: ActiveSet, old: ActiveSet, contact: Contact) -> ActiveSet:
        """The new set, less the changes by which the body would lose its last hold.

        Of the nodes that let go, those that violate the law least are kept for one more
        iteration, as many as it takes. If they do not suffice, nodes that slipped before stick,
        or an open pair lands: a body may let go at one end to be held by another.
        """
        motions = self._free_motions(new, contact.frame)
        if not motions:
            return new
        loosened = (new.status != old.status) & (old.status != OPEN) & (new.status != STICK)
        wrong = np.linalg.norm(contact.violation(), axis=1)
        ranked = np.sort(self.nodes.gathered(wrong[loosened]))[::-1]
        count = len(ranked) // 2
        while count > 0:
            kept = loosened & (wrong < ranked[count - 1])
            candidate = mixed(kept, old, new)
            if not self._free_motions(candidate, contact.frame):
                return candidate
            count //= 2
        lost_hold = FreeBody(
            f"{' and '.join(motions)}: the loads lift or drag the body off, nothing holds it once "
            f"the nodes that would have to pull are open and the others slip ({self._count(new)})"
        )
        if len(self.lost_holds) < _RESCUES:
            self.lost_holds.append(lost_hold)
            gripping = (new.status == SLIP) & ~loosened & (self.nodes.friction > 0)
            landing = self._landing(new, contact.gap)
            for touching in (gripping, gripping | landing):
                held = mixed(touching, self._sticking(touching), new)
                if not self._free_motions(held, contact.frame):
                    return held
        raise lost_hold

    def _landing(self, active: ActiveSet, gap: Array) -> Mask:
        """The nearest node of each pair that is open everywhere."""
        landing = np.zeros(len(gap), dtype=bool)
        for k in range(len(self.nodes.pairs)):
            mine = (self.nodes.pair == k) & np.isfinite(gap)
            closed = int(np.any(active.status[mine] != OPEN))
            nearest = self.system.comm.allreduce(gap[mine].min(initial=np.inf), MPI.MIN)
            if not self.system.comm.allreduce(closed, MPI.MAX):
                landing |= mine & (gap <= nearest)
        return landing

    def _count(self, active: ActiveSet) -> str:
        counts = [
            self.system.comm.allreduce(int(np.sum(active.status == kind)), MPI.SUM)
            for kind in (OPEN, STICK, SLIP)
        ]
        return "{} open, {} sticking, {} slipping contact nodes".format(*counts)

    # -- the end -----------------------------------------------------------------------------

    def _finish(self, now: Iterate, iterations: int) -> tuple[ContactState, ReferenceState]:
        active = now.contact.active_set()
        state = ContactState(
            now.full,
            pair_states(self.nodes, now.contact, active.status, now.force, now.translations),
            iterations,
            self.system.unique,
            self._residuals(now, active),
        )
        frame = now.contact.frame
        return state, ReferenceState(now.displacement, now.force, now.translations, active, frame)

    def _residuals(self, now: Iterate, active: ActiveSet) -> Residuals:
        comm, contact = self.system.comm, now.contact

        def largest(values: Array) -> float:
            return float(comm.allreduce(np.max(values, initial=0.0), MPI.MAX))

        tangential = contact.force[:, 1:]
        friction, slip = np.linalg.norm(tangential, axis=1), np.linalg.norm(contact.slip, axis=1)
        limit = self.nodes.friction * contact.force[:, 0]
        against = slip[:, None] * tangential + limit[:, None] * contact.slip
        force = largest(np.linalg.norm(now.force, axis=1))
        moved = np.concatenate([now.displacement, self.nodes.shifts(now.translations)])
        length = largest(np.linalg.norm(moved, axis=1))
        if force <= self._lost(now):
            force = 1.0
        if length <= _EPSILON * largest(np.abs(self.nodes.position)):
            length = 1.0
        pressed = contact.force[:, 0]
        apart = np.where(np.isfinite(contact.gap), contact.gap, 0.0) / length
        balance = np.abs(self.system.totals(now.force) - self.totals)
        return Residuals(
            equilibrium=largest(np.array([now.unbalanced])) / force,
            penetration=largest(-apart),
            tension=largest(-pressed) / force,
            complementarity=largest(np.minimum(pressed / force, apart)),
            cone=largest(friction - limit) / force,
            stick=largest(slip[active.status == STICK]) / length,
            direction=largest(np.linalg.norm(against, axis=1)[active.status == SLIP])
            / force
            / length,
            balance=largest(balance) / force,
        )


def _turned(active: ActiveSet, old: Array, new: Array) -> ActiveSet:
    """An active set that refers to one frame, in another."""
    turn = np.einsum("nai,nbi->nab", new[:, 1:], old[:, 1:])
    direction = np.einsum("nab,nb->na", turn, active.direction)
    return ActiveSet(active.status, direction, active.turning)
