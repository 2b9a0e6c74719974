"""The active-set (semismooth Newton) iteration of one increment, and the state that it ends in."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import DEFORMABLE, ROUND_OFF, Interface
from pw_elements.contact.iteration.law import (
    HELD,
    OPEN,
    STICK,
    TOLERANCE,
    Accuracy,
    ActiveSet,
    Contact,
    Place,
    add_support_friction,
    turned,
)
from pw_elements.contact.iteration.policy import Patience, Policy, counted, same
from pw_elements.contact.iteration.system import ContactSystem
from pw_elements.contact.model import (
    ContactFailed,
    ContactState,
    NoEquilibrium,
    NotFound,
    NotUnique,
    PairState,
    Residuals,
    Scale,
    Smallness,
)
from pw_elements.solvers import SingularSystem, SolverReport

# What of the violation may be round-off over stiffness x displacement; over stiffness x coordinate
# it is `ROUND_OFF`, for a gap is a difference of coordinates
_LOST = 1e-13
# Stiffness of friction on supports against a surface that is free to slide, over that of nodes:
# where all tangents are held, and where others are free, whose friction is solved for in turn
_FRICTION_STIFFNESS, _FRICTION_STIFFNESS_BESIDE = 1e3, 3.0
# Slip over a node's coordinates and displacement that is no more than round-off
_NO_SLIP = 1e-13
# Derivative of a slip by a free motion of the surface that counts as none
_INDEPENDENT = 1e-9
# Iterations, more than most increments take
_DOUBTFUL = 12
# Relative change of friction beside a singular tangent, and of a solution that goes on there
_FRICTION_CHANGE = 1e-6
_SOLUTION_CHANGE = 1e-3


@dataclass(frozen=True)
class Iterate:
    """A solution of one linear system, seen from the contact points."""

    reduced: PETSc.Vec  # displacements
    full: PETSc.Vec  # all unknowns (n,)
    translations: Array  # of the surfaces, (pairs, dim)
    displacement: Array  # motion of the points, (m, dim)
    force: Array  # of the surfaces on the points, (m, dim)
    unbalanced: Array  # size of what is no contact force in each equation of this process
    contact: Contact  # gaps, slips and forces in the frames
    place: Place  # of linearisation, through which it is seen
    exact: bool  # whether the same system, solved again, would give nothing better
    final: bool  # whether it was solved exactly enough for an end


@dataclass(frozen=True)
class Reference:
    """Where an increment starts: slip counts from here."""

    displacement: Array  # motion of the points, (m, dim)
    force: Array  # on the points, (m, dim)
    translations: Array  # of the surfaces, (pairs, dim)

    @classmethod
    def of(cls, state: ContactState, interface: Interface) -> "Reference":
        """What an increment from a state has to know of it, on this process."""
        moved = interface.local([pair.displacement for pair in state.pairs])
        forces = interface.local([pair.force_vector for pair in state.pairs])
        return cls(moved, forces, state.translations)


class Equilibrium(Protocol):
    """Equilibrium of a body with its contact forces, K a = f + H r where it is linearised."""

    @property
    def load(self) -> PETSc.Vec: ...  # f, reduced

    @property
    def offset(self) -> PETSc.Vec: ...  # (n,), with what supports prescribe

    def take(self, reduced: PETSc.Vec) -> float:
        """Goes to a solution of the linear equations, or the share of the way that it gives."""

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """Forces that no load balances there, reduced: where nothing touches they vanish."""

    def expanded(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """All unknowns (n,) there."""

    def violation(self, unbalanced: Array, contact: float, full: PETSc.Vec) -> float:
        """What no contact force balances over what is allowed, of which contact is a part."""


@dataclass(frozen=True)
class LinearEquilibrium:
    """Equilibrium K a = f + H r of a body under small strains, reduced by its supports."""

    stiffness: PETSc.Mat  # K, reduced: the tangent at any a
    load: PETSc.Vec  # f, reduced
    right: PETSc.Mat  # R, (n, n_r), and
    offset: PETSc.Vec  # a_0, (n,), of all unknowns R a_r + a_0
    largest: float = 0.0  # sum of the magnitudes in a row of K

    @classmethod
    def of(
        cls, system: ContactSystem, K: PETSc.Mat, load: PETSc.Vec, stated: float = 1.0
    ) -> "LinearEquilibrium":
        """With a free stiffness (n, n), a load (n,), and a share of what supports prescribe."""
        reduction = system.reduction
        if stated != 1:
            reduction = replace(reduction, offset=stated * reduction.offset)
        reduction = reduction.under(K, load)
        reduced = reduction.load(K, load)
        largest = K.norm(PETSc.NormType.INFINITY)
        return cls(system.stiffness, reduced, reduction.right, reduction.offset, largest)

    def take(self, reduced: PETSc.Vec) -> float:  # noqa: ARG002
        return 1.0

    def violation(self, unbalanced: Array, contact: float, full: PETSc.Vec) -> float:
        """The rest are the loads' tolerance, and round-off over stiffness x displacement."""
        load, moved = (each.norm(PETSc.NormType.INFINITY) for each in (self.load, full))
        allowed = contact + TOLERANCE * load + _LOST * self.largest * moved
        largest = float(unbalanced.max(initial=0.0))
        return largest / allowed if largest else 0.0

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:
        residual = self.load.duplicate()
        self.stiffness.mult(reduced, residual)
        residual.axpy(-1.0, self.load)
        return residual

    def expanded(self, reduced: PETSc.Vec) -> PETSc.Vec:
        full = self.offset.duplicate()
        self.right.multAdd(reduced, self.offset, full)
        return full


class Kinematics(Protocol):
    """Gap, slip and frames of the deformed body, and slip along the path to it."""

    def __call__(self, places: Array, displacement: Array, force: Array) -> Place:
        """Linearise at placements (pairs, dim + 1), motions and forces (m, dim)."""

    def integrate_slip(self, places: Array, displacement: Array) -> Array:
        """Return slip (m, dim) on the straight path there from the start of the increment."""


class Increment:
    """The equations of one increment."""

    def __init__(
        self,
        system: ContactSystem,
        equilibrium: Equilibrium,  # at the end
        # translations of the surfaces (pairs, dim), NaN where they are free; and angles, as all
        # translations have them (pairs, dim + 1) where the body is deformed
        prescribed: Array,
        totals: Array,  # forces of the free translations, and torques
        past: Reference,
        stated: float = 1.0,  # share of what supports and interference prescribe
        # kinematics of the deformed body, taken anew in each iteration; else of the undeformed one
        deformed: Kinematics | None = None,
    ) -> None:
        self.system, self.past = system, past
        self.interface: Interface = system.interface
        self.prescribed, self.totals, self._stated = prescribed, totals, stated
        # whether every solution is to be exact enough to be the last
        self.equilibrium, self.precise = equilibrium, system.tangent.precise
        self.deformed = deformed
        # what came nearest to a solution so far, and its violation of the law
        self.nearest: tuple[Iterate, float] | None = None
        self.supported = self.system.motions(equilibrium.offset)  # the points' motion, (m, dim)

    def kinematics(
        self, translations: Array, displacement: Array, force: Array, every: bool = False
    ) -> Place:
        """Linearisation at translations (pairs, dim), motions and forces (m, dim).

        It is one in `every` translation or in the free ones.
        """
        free: Mask = np.isnan(self.prescribed) | every
        past = self.past.displacement - self.past.translations[self.interface.pair]
        force = np.where(self.interface.held_components, 0.0, force)
        place = Place.undeformed(self.interface, past, translations, free, displacement, force)
        if self._stated == 1:
            return place
        # points inside their surface are pressed out of it little by little
        return replace(place, gap=place.gap + (1 - self._stated) * self.interface.interference)

    def solve(self, active: ActiveSet, place: Place, more: bool = False) -> Iterate:
        """Solves for an active set and the kinematics of a place, once `more` if need be.

        Raises:
            NotUnique: if the tangent is singular at a solution.
            NotFound: if it is singular elsewhere.
        """
        try:
            return self._solved(active, place, more)
        except SingularSystem as error:
            if self.deformed is not None:
                raise
            raise self._singular(active, place, error) from error

    def _solved(self, active: ActiveSet, place: Place, more: bool = False) -> Iterate:
        known = np.nan_to_num(self.prescribed)[self.interface.pair]
        if self.deformed is not None:
            self.system.levers = place.levers.where(known, self.supported)
        load, law = self.equilibrium.load, place.law(active, self.system.scale)
        law = law.where(known, self.system.followed(self.equilibrium.offset))
        accuracy: Accuracy = "more" if more else "final" if self.precise else "rough"
        totals, springs = self._totals_with_supports(active, place)
        found = self.system.solve(load, law, totals, accuracy, springs)
        moved = self.prescribed.copy()
        moved[np.isnan(moved)] = found.translations
        share = self.equilibrium.take(found.reduced)
        if share < 1:
            moved = place.translations + share * (moved - place.translations)
            self.system.start(lambda: self.equilibrium.expanded(found.reduced), moved)
        return self.seen(
            found.reduced, moved, place, found.exact, found.final, friction=active.friction
        )

    def _totals_with_supports(self, active: ActiveSet, place: Place) -> tuple[Array, Array | None]:
        """Return totals (free,) less the friction on supports, and the stiffness of the latter.

        Friction on supports is no unknown of the linear system. Where a surface is free to slide
        over nodes that supports hold, it is that of the iteration before, and nodes that stick
        add a stiffness: the method of multipliers, in which their slip vanishes at the end.
        """
        interface, system = self.interface, self.system
        if not (interface.holds_friction and system.free):
            return self.totals, None
        dim, factor = interface.position.shape[1], _friction_stiffness(place)
        stiffness = (factor * system.scale)[:, None]
        held = interface.held_components
        moved = np.where(held, self.supported - place.at[:, :dim], 0.0)
        slip = place.slip + np.einsum("nta,na->nt", place.moved[:, 1:, :dim], moved)
        closed = (active.status != OPEN)[:, None]
        iterated = closed & place.held & self._coupled(place).any(axis=1, keepdims=True)
        sticks = (active.status == STICK)[:, None]
        # of slip that turns by l / |v|, which is c M / (1 - M)
        turns = system.scale * active.turning
        turns = turns / np.maximum(1 - active.turning, 1 / factor) + active.bend
        turns = turns[:, None] * (1 - active.direction**2)
        rise = np.where(iterated, np.where(sticks, stiffness, turns), 0.0)
        friction = np.where(closed, active.friction, 0.0)
        friction = friction - rise * (slip - np.where(sticks, 0.0, active.support_slip))
        carried = np.einsum("nta,nak->ntk", place.frame[:, 1:], place.levers.carried)
        total = system.totals(np.einsum("ntk,nt->nk", carried, friction))
        resisting = rise[:, :, None] * carried * -place.followed[:, 1:]
        springs = np.maximum(0.0, system.totals(resisting.sum(axis=1)))
        reached = np.array([place.translations[at] for at in system.free])
        return self.totals - total + springs * reached, springs

    def _coupled(self, place: Place) -> Mask:
        """Return along which held tangents (m, dim - 1) slip depends on a surface's free motion."""
        free = np.isnan(self.prescribed)[self.interface.pair]
        depends = (np.abs(place.followed[:, 1:]) > _INDEPENDENT) & free[:, None]
        return np.asarray(depends.any(axis=2) & place.held)

    def past_friction(self, place: Place) -> Array:
        """Friction (m, dim - 1) at the increment's start, along tangents that supports hold."""
        along = np.einsum("nta,na->nt", place.frame[:, 1:], self.past.force)
        return np.where(place.held, along, 0.0)

    def _with_supports(
        self, contact: Contact, place: Place, force: Array, friction: Array
    ) -> tuple[Contact, Array]:
        """Add the friction on supports to forces (m, dim) that the points' equations tell.

        The slip of the support and the surface determines it. Where there is none it stays what it
        was when the increment started, within its limit; where the surface is free to slide, what
        it was in the iteration before, `friction` (m, dim - 1), less a stiffness times the slip.
        """
        interface, scale, held = self.interface, self.system.scale, place.held
        components = interface.held_components
        tangents_coupled = self._coupled(place)
        coupled = np.asarray(tangents_coupled.any(axis=1))
        size = np.abs(interface.position) + np.abs(place.at[:, : force.shape[1]])
        size = size.sum(axis=1) + np.abs(place.translations).sum(axis=1)[interface.pair]
        nothing = TOLERANCE * _largest(self, np.abs(force)) / scale + _NO_SLIP * size
        speed = np.linalg.norm(np.where(held & ~tangents_coupled, contact.slip, 0.0), axis=1)
        contact = replace(contact, dragged=speed > nothing, coupled=coupled)
        rests = contact.rests
        contact = replace(contact, slip=np.where(rests, 0.0, contact.slip))
        friction = np.where(rests, self.past_friction(place), friction)
        stiffness = np.where(coupled, _friction_stiffness(place), 1.0) * scale
        return add_support_friction(
            contact, place, force, friction, stiffness=stiffness, components=components
        )

    def _singular(
        self, active: ActiveSet, place: Place, error: SingularSystem
    ) -> NotUnique | NotFound:
        """What a singular tangent shows, all rigid motions being held.

        With a little more or less friction it is regular. If the equations of the set have
        solutions, they have about the same one then; else one runs away, to either side.
        """
        where, beside = counted(active, self.system.comm), []
        for share in (1 - _FRICTION_CHANGE, 1 + _FRICTION_CHANGE):
            try:
                less_or_more = replace(
                    active, slope=share * active.slope, level=share * active.level
                )
                beside.append(self._solved(less_or_more, place))
            except SingularSystem:
                break
        else:
            less, more = beside
            apart, wrong = (less.full - more.full).norm(), self.violation(less) * TOLERANCE
            if apart <= _SOLUTION_CHANGE * less.full.norm() and wrong <= _SOLUTION_CHANGE:
                self.nearest = less, self.violation(less)
                return NotUnique(
                    f"{error}: no rigid motion is free, so the friction of the {where} is too "
                    "large for a unique answer"
                )
        return NotFound(
            f"{error}, though no rigid motion is free: with the friction of the {where} the "
            "equations have no solution"
        )

    def seen(
        self,
        reduced: PETSc.Vec,
        translations: Array,
        place: Place,
        exact: bool = True,
        final: bool = True,
        friction: Array | None = None,
    ) -> Iterate:
        """Gaps, slips and forces at the contact points; for the rest see `Iterate`.

        `friction` (m, dim - 1) is that on supports before, by default at the increment's start.
        """
        full = self.equilibrium.expanded(reduced)
        displacement = self.system.motions(full)
        force, unbalanced = self.system.forces(self.equilibrium.residual(reduced))
        if self.deformed is not None:
            place = self.deformed(translations, displacement, force)
        motions = displacement if self.deformed is None else place.at
        seen = motions, translations, force, self.interface.cone, self.system.scale
        contact = place.contact(*seen)
        if self.interface.holds_friction:
            friction = self.past_friction(place) if friction is None else friction
            contact, force = self._with_supports(contact, place, force, friction)
        return Iterate(
            reduced,
            full,
            translations,
            displacement,
            force,
            unbalanced,
            contact,
            place,
            exact,
            final,
        )

    def residuals(self, now: Iterate, force: float, length: Array | float) -> dict[str, Array]:
        """The fields of `Residuals` on this process, over a force and lengths (m,)."""
        unbalanced = self.system.totals(now.place.levers.forces(now.force)) - self.totals
        unbalanced += self.system.springs * [now.translations[at] for at in self.system.free]
        return now.contact.residuals(force, length) | {
            "equilibrium": np.asarray(now.unbalanced / force, dtype=float),
            "balance": np.abs(unbalanced) / (force * self.system.arms(now.place.levers)),
        }

    def violation(self, now: Iterate) -> float:
        """Largest of the residuals over what is allowed, lengths being forces of the nodes.

        Coordinates' round-off is allowed for in gaps and balances, and in friction at points which
        are not pressed by more: slips have no coordinates, but friction's limit has the gap.
        """
        comm, contact = self.system.comm, now.contact
        if self.interface.cone.has_user_law:
            self.interface.check_laws(contact.force[:, 0])
        moved, placed = self._lost(now)
        allowed = TOLERANCE * _largest(self, np.abs(now.force)) + moved
        gap = np.where(np.isfinite(contact.gap), np.abs(contact.gap), 0.0)
        loose = contact.limits[1] * contact.scale * gap
        loose = np.where(contact.force[:, 0] > placed, loose, placed)
        wrong = self.residuals(now, 1.0, 1 / contact.scale)
        worst = self.equilibrium.violation(wrong.pop("equilibrium"), allowed + placed, now.full)
        for name, values in wrong.items():
            lost = loose if name in ("cone", "stick", "direction") else placed
            share = np.divide(values, allowed + lost, out=np.zeros_like(values), where=values != 0)
            largest = float(share.max(initial=0.0))
            worst = max(worst, np.inf if np.isnan(largest) else largest)
        return float(comm.allreduce(worst, MPI.MAX))

    def settled(self, now: Iterate) -> bool:
        """Whether the surfaces are where they were linearised, to the tolerance of the law."""
        moved = np.abs(now.translations - now.place.translations).max()
        largest = np.abs(now.displacement).max(initial=0.0)
        return bool(moved <= TOLERANCE * self.system.comm.allreduce(largest, MPI.MAX))

    def allowed(self, now: Iterate) -> float:
        """Force by which the law may be violated."""
        return TOLERANCE * _largest(self, np.abs(now.force)) + self.round_off(now)

    def round_off(self, now: Iterate) -> float:
        return sum(self._lost(now))

    def _lost(self, now: Iterate) -> tuple[float, float]:
        """Forces that may be nothing but round-off: of displacements, and of coordinates."""
        position = self.interface.position
        arms = now.place.levers.carried[:, :, position.shape[1] :].sum(axis=2)  # from pivots
        lengths = (
            _LOST * self.system.moved(now.full),
            ROUND_OFF * (np.abs(position) + np.abs(arms)),
        )
        forces = [(self.system.scale[:, None] * part).max(initial=0.0) for part in lengths]
        moved, placed = np.max(self.system.comm.allgather(forces), axis=0)
        return float(moved), float(placed)


def newton(
    increment: Increment,
    active: ActiveSet,
    place: Place,
    policy: Policy,
    most: int,
    told: Callable[[int, ActiveSet, float], None] | None = None,
    doubt: Callable[[], None] | None = None,
    patient: bool = False,
) -> Iterate:
    """Iterates from an active set and a place of linearisation until all conditions hold.

    Planes make gap and slip linear. For curved surfaces under force control they are linearised
    anew where the active set has been found, until nothing changes; where the body is deformed, in
    each iteration.

    `told`, if it is given, is called with each iteration's number, active set and violation,
    `doubt` once, after more iterations than most increments take: it may raise a NoEquilibrium.

    A deformed body's equations are solved for a set before it changes, once sets have come back, if
    the iteration is `patient`.

    If it fails with an iterative solver, whose solutions are inexact on the way, it is tried once
    more with exact ones.

    Raises:
        NotUnique, NotFound: as `solve_contact` says.
    """
    try:
        return _iterated(increment, active, place, policy, most, told, doubt, patient)
    except ContactFailed as failure:
        proved = isinstance(failure, NoEquilibrium)
        if increment.precise or increment.deformed is not None or proved:
            raise
        increment.precise = True
        return _iterated(increment, active, place, policy, most, told, doubt, patient)


def _iterated(
    increment: Increment,
    active: ActiveSet,
    place: Place,
    policy: Policy,
    most: int,
    told: Callable[[int, ActiveSet, float], None] | None,
    doubt: Callable[[], None] | None,
    patient: bool,
) -> Iterate:
    system = increment.system
    if increment.interface.holds_friction:
        past = increment.past_friction(place)
        active = replace(active, friction=np.where(active.friction == 0, past, active.friction))
    policy.restart(active)
    patience, last = Patience(system.comm), increment.past.displacement
    more = False
    for iteration in range(1, most + 1):
        now = increment.solve(active, place, more)
        violation = increment.violation(now)
        if told:
            told(iteration, active, violation)
        if doubt and violation > 1 and iteration == _DOUBTFUL:
            doubt()
        if now.place is not place:
            if violation <= 1:
                return now
            active, place = turned(active, place.frame, now.place.frame), now.place
            policy.restart()  # Newton's method may stay with a set
            change = _largest(increment, np.abs(now.displacement - last))
            last = now.displacement
            kept = patience.keeps(active, change / (_largest(increment, np.abs(last)) or 1.0))
            if patient and kept:
                continue
        elif violation <= 1:
            if more := not now.final:  # equilibrium may lag behind
                continue
            old, place = place, increment.kinematics(now.translations, now.displacement, now.force)
            seen = increment.seen(
                now.reduced,
                now.translations,
                place,
                now.exact,
                now.final,
                friction=np.where(place.held, now.contact.force[:, 1:], 0.0),
            )
            violation = increment.violation(seen)
            if violation <= 1:
                return seen
            if increment.settled(now):  # a surface's function has noise, as differences have
                return now
            now = seen
            active = turned(active, old.frame, place.frame)
            policy.restart()
        if increment.nearest is None or violation < increment.nearest[1]:
            increment.nearest = now, violation
        wanted = policy.wanted(active, now.contact)
        # corrected factors leave single gaps open
        if more := not now.exact and same(wanted, active, system.comm):
            continue
        active = policy.taken(wanted, active, now.contact)
    words = f"no active set satisfies the contact conditions after {most} iterations"
    raise patience.make_error(f"{words} (max_iterations)", increment.interface)


def contact_state(
    increment: Increment,
    now: Iterate,
    iterations: int,
    before: ContactState,
    report: SolverReport,
    smallness: Smallness | None,
    converged: bool = True,
    slides: bool = False,
) -> ContactState:
    system = increment.system
    own = orientations = frozenset(system.tangent.solver.orientations)
    if before.free == system.free:
        orientations |= before.orientations
    scale, residuals = _measured(increment, now, before.scale)
    if increment.interface.cone.has_user_law:
        increment.interface.check_laws()
    return ContactState(
        increment.interface.field.part(now.full),
        _pairs(increment, now),
        iterations,
        False if slides else len(orientations) <= 1 if own else None,
        residuals,
        report=report,
        increment=before.increment + 1,
        free=system.free,
        orientations=orientations,
        scale=scale,
        smallness=smallness,
        converged=converged,
        unknowns=now.full,
    )


def undeformed(interface: Interface, unknowns: PETSc.Vec) -> ContactState:
    """The body before any load, `unknowns` being a vector (n,) of zeros."""
    zero = np.zeros_like(interface.position)
    pairs = pair_states(
        interface,
        np.zeros((interface.pairs, zero.shape[1])),
        zero,
        normal=interface.normals(None),
        gap=interface.gaps(None),
        friction=interface.cone.steepest,
    )
    return ContactState(interface.field.part(unknowns), pairs, unknowns=unknowns)


def _pairs(increment: Increment, now: Iterate) -> tuple[PairState, ...]:
    interface, past, contact = increment.interface, increment.past, now.contact
    active, normal, tangents = contact.at_rest, contact.frame[:, 0], contact.frame[:, 1:]
    held = (interface.faced == DEFORMABLE) & interface.cone.rough & ~tangents.any(axis=(1, 2))
    status = np.where(held & (active.status != OPEN), HELD, active.status).astype(np.int8)
    moved = now.displacement - past.displacement
    dim = moved.shape[1]
    moved = moved - (now.translations - past.translations)[interface.pair, :dim]
    along = moved - np.sum(moved * normal, axis=1)[:, None] * normal

    def vectors(values: Array) -> Array:
        return np.einsum("nab,na->nb", tangents, values)

    slip = np.where((status == HELD)[:, None], along, vectors(contact.slip))
    if increment.deformed is not None:
        along = increment.deformed.integrate_slip(now.translations, now.displacement)
    return pair_states(
        interface,
        now.translations,
        now.force,
        normal=normal,
        force_normal=contact.force[:, 0],
        force_tangential=vectors(contact.force[:, 1:]),
        torque=now.place.levers.forces(now.force)[:, dim:].sum(axis=1),
        gap=contact.gap,
        slip=slip * (status != OPEN)[:, None],
        path_slip=along * (status != OPEN)[:, None],
        friction=interface.cone.coefficient(contact.force[:, 0]),
        status=status,
        displacement=now.displacement,
        direction=vectors(active.direction),
        turning=active.turning,
    )


def pair_states(
    interface: Interface, translations: Array, force: Array, **points: npt.NDArray
) -> tuple[PairState, ...]:
    """States of all pairs, under forces (m, dim) of the surfaces on this process' points.

    `points` are what else `PairState` has of each of them, (m, ...); zero and open by default.
    """
    zero, dim = np.zeros_like(force), force.shape[1]
    at = {name: getattr(interface, name) for name in ("position", "node", "faced")}
    at |= dict.fromkeys(
        ("force_tangential", "slip", "path_slip", "displacement", "direction"), zero
    )
    at |= dict.fromkeys(("force_normal", "turning", "torque"), zero[:, 0])
    at |= {"status": np.full(len(zero), OPEN, dtype=np.int8)} | points
    torque = at.pop("torque")
    return tuple(
        PairState(
            translation=translations[k, :dim].copy(),
            force=interface.in_order(k, force).sum(axis=0),
            rotation=np.array(translations[k, dim:].sum()),
            torque=np.array(interface.in_order(k, torque).sum()),
            opposite=interface.opposite[k].copy(),
            opposite_force=interface.on_opposite(k, force),
            **{name: interface.in_order(k, values) for name, values in at.items()},
        )
        for k in range(interface.pairs)
    )


def _measured(increment: Increment, now: Iterate, before: Scale) -> tuple[Scale, Residuals]:
    scale, force, length = reference_sizes(increment, now, before)
    found = increment.residuals(now, force, length)
    return scale, Residuals(**{name: _largest(increment, values) for name, values in found.items()})


def reference_sizes(
    increment: Increment, now: Iterate, before: Scale
) -> tuple[Scale, float, float]:
    """Scale of the history up to here, and the force and length that `Residuals` are over."""
    force = _largest(increment, np.linalg.norm(now.force, axis=1))
    pair = increment.interface.pair
    shifts = np.einsum("nak,nk->na", now.place.levers.carried, now.translations[pair])
    moved = np.concatenate([increment.system.moved(now.full), shifts])
    length = _largest(increment, np.linalg.norm(moved, axis=1))
    scale = before
    if force > increment.round_off(now):
        scale = Scale(max(force, before.force), max(length, before.length))
    extent = _largest(increment, np.abs(increment.interface.position))
    length = max(length, scale.length)
    length = length if length > ROUND_OFF * extent else extent
    force = scale.force or _largest(increment, increment.system.scale) * length
    return scale, force, length


def _friction_stiffness(place: Place) -> Array:
    every = place.held.all(axis=1)
    return np.where(every, _FRICTION_STIFFNESS, _FRICTION_STIFFNESS_BESIDE)


def _largest(increment: Increment, values: Array) -> float:
    return float(increment.system.comm.allreduce(np.max(values, initial=0.0), MPI.MAX))
