"""The law of one contact node: unilateral contact and friction on nodal forces, and linearised.

With p = r_n - c g, s = r_t - c v and the limit of friction l, the law is F = 0, where

    F_n = r_n - max(0, p),    F_t = r_t - projection of s on the disc |.| <= l(max(0, p)),

and Newton's method on F an active-set iteration. The guide's page on theory has the equations of
open, sticking and slipping nodes ("The law, linearised").
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Local, Mask
from pw_elements.contact.interface import Interface
from pw_elements.contact.model import Cone, projected

OPEN, STICK, SLIP = 0, 1, 2
# Of states alone: in rough contact with a deformable surface, and moved along it by supports
HELD = 3

# Of a solution: one on the way, one exact enough to be the last, or the last one once more
Accuracy: TypeAlias = Literal["rough", "final", "more"]
# Violation of the law over the largest nodal contact force
TOLERANCE = 1e-9

# Step of differences along free translations, over the extent of the contact nodes
_STEP = 1e-4
# Part of a tangent along held components from which on supports hold it
_ALONG = 0.5
# Passes in which friction along a support that is not along the surface finds its limit, and its
# change over the limit that ends them
_FRICTION_PASSES, _FRICTION_ROUND_OFF = 60, 1e-13


@dataclass(frozen=True)
class ActiveSet:
    """What is assumed of every contact node (n of this process) in one linear solve.

    All but the status is zero for nodes that do not slip, and without friction.
    """

    status: npt.NDArray[np.int8]  # (n,) OPEN, STICK or SLIP
    direction: Array  # (n, dim - 1), unit tangential force
    turning: Array  # (n,), l(p) / |s|
    slope: Array  # (n,), l'(p)
    level: Array  # (n,), l(p) - l'(p) p: nothing by Coulomb's law
    bend: Array  # (n,), l(p) / |v| of nodes that supports move along their surface
    # (n, dim - 1), of nodes that supports hold along a surface which is free to slide
    friction: Array  # along the tangents that are held, in the iteration before; else zero
    support_slip: Array  # the slip that goes with it

    @classmethod
    def of(
        cls,
        status: npt.NDArray[np.int8],
        direction: Array,
        turning: Array,
        cone: Cone,
        pressing: Array,
        bend: Array | None = None,
        friction: Array | None = None,
        support_slip: Array | None = None,
    ) -> "ActiveSet":
        """With the limits of friction linearised at p (n,)."""
        pressing = np.maximum(0.0, pressing)
        limit, slope = cone.limit(pressing)
        slips = np.any(direction != 0, axis=1)
        level = np.where(slips, limit - slope * pressing, 0.0)
        bend = np.zeros(len(status)) if bend is None else bend
        zero, slope = np.zeros_like(direction), np.where(slips, slope, 0.0)
        friction = zero if friction is None else friction
        support_slip = zero if support_slip is None else support_slip
        return cls(status, direction, turning, slope, level, bend, friction, support_slip)


@dataclass(frozen=True)
class Contact:
    """Quantities of the contact nodes (n of this process) in their frames."""

    frame: Array  # (n, dim, dim), rows: normal, tangents (zero where the law is not stated)
    gap: Array  # (n,), infinite where nothing faces the node
    slip: Array  # (n, dim - 1), of this increment
    force: Array  # (n, dim), components along the frame
    cone: Cone
    scale: Array  # (n,), c
    held: Mask  # (n, dim - 1), tangents along which supports hold the node, and friction acts
    dragged: Mask  # (n,), whether supports and surface make the node slip, whatever its forces
    coupled: Mask  # (n,), whether its slip along supports depends on a free motion of the surface

    @cached_property
    def rests(self) -> Mask:
        """Return which tangents (n, dim - 1) supports hold while the surface rests along them."""
        return self.held & ~(self.dragged | self.coupled)[:, None]

    @cached_property
    def pressing(self) -> Array:
        """p, (n,); minus infinity for nodes which nothing faces."""
        return self.force[:, 0] - self.scale * self.gap

    @cached_property
    def shearing(self) -> Array:
        """s, (n, dim - 1); without the friction on supports that tells nothing of slip."""
        trial = self.force[:, 1:] - self.scale[:, None] * self.slip
        return np.asarray(np.where(self.rests, 0.0, trial))

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """Limits of friction l(max(0, p)), (n,), and their slopes, (n,)."""
        return self.cone.limit(np.maximum(0.0, self.pressing))

    def admitted_friction(self, limit: Array) -> Array:
        """Tangential forces (n, dim - 1) of the law, under limits (n,), at these slips."""
        size = np.linalg.norm(self.slip, axis=1)
        against = -(limit / np.where(self.dragged, size, 1.0))[:, None] * self.slip
        friction = projected(self.shearing, limit)
        if self.rests.any():  # what the friction along free tangents leaves of the limit
            left = np.sqrt(np.maximum(0.0, limit**2 - np.sum(friction**2, axis=1)))
            friction += projected(np.where(self.rests, self.force[:, 1:], 0.0), left)
        return np.where(self.dragged[:, None], against, friction)

    @cached_property
    def at_rest(self) -> ActiveSet:
        """The linearisation of F here, whatever was assumed before."""
        return self.active_set()

    def active_set(self, before: ActiveSet | None = None) -> ActiveSet:
        """The linearisation of F here; with regard to the one before, if it is given."""
        p, s = self.pressing, self.shearing
        size, radius = np.linalg.norm(s, axis=1), self.limits[0]
        slipping = (p > 0) & (size >= radius)
        if before is not None:
            slipping &= ~(np.sum(s * before.direction, axis=1) < 0)
        dragged, iterated = self.dragged & (p > 0), self.held & self.coupled[:, None]
        slipping |= dragged
        speed = np.linalg.norm(self.slip, axis=1)
        s, size = np.where(dragged[:, None], -self.slip, s), np.where(dragged, speed, size)
        directed = slipping & self.cone.rough
        status = np.where(p > 0, STICK, OPEN)
        status[slipping] = SLIP
        direction = np.where(directed, 1 / np.where(directed, size, 1.0), 0.0)[:, None] * s
        turning = np.where(directed, radius / np.where(directed, size, 1.0), 0.0)
        return ActiveSet.of(
            status.astype(np.int8),
            direction,
            np.where(dragged, 0.0, turning),
            self.cone,
            p,
            np.where(dragged, turning, 0.0),
            *(np.where(iterated, part, 0.0) for part in (self.force[:, 1:], self.slip)),
        )

    def violation(self) -> Array:
        """F, (n, dim), forces: zero at a solution."""
        normal = self.force[:, :1] - np.maximum(0.0, self.pressing)[:, None]
        return np.hstack([normal, self.force[:, 1:] - self.admitted_friction(self.limits[0])])

    def residuals(self, force: float, length: Array | float) -> dict[str, Array]:
        """How far each condition is from holding, (n,), over a force and lengths (n,)."""
        pressed, tangential, gap = self.force[:, 0], self.force[:, 1:], self.gap
        limit, _ = self.cone.limit(np.maximum(0.0, pressed))
        sticks = (np.linalg.norm(self.shearing, axis=1) < limit) & ~self.dragged
        unlike = np.abs(tangential - self.admitted_friction(limit)).max(axis=1, initial=0.0)
        slipped = np.where(sticks, np.linalg.norm(self.slip, axis=1), 0.0)
        return {
            "penetration": np.maximum(0.0, -gap) / length,
            "tension": np.maximum(0.0, -pressed) / force,
            "complementarity": np.maximum(0.0, np.minimum(pressed / force, gap / length)),
            "cone": np.maximum(0.0, np.linalg.norm(tangential, axis=1) - limit) / force,
            "stick": slipped / length,
            "direction": np.where(sticks, 0.0, unlike) / force,
        }


def sticking(closed: Mask, cone: Cone, tangents: int) -> ActiveSet:
    """The set in which closed nodes (n,) stick, or slip where there is no friction."""
    n = len(closed)
    status = np.where(closed, np.where(cone.rough, STICK, SLIP), OPEN).astype(np.int8)
    zero = np.zeros((n, tangents))
    turning, slope, level, bend = np.zeros((4, n))
    return ActiveSet(status, zero, turning, slope, level, bend, zero, zero)


def mixed(keep: Mask, old: ActiveSet, new: ActiveSet) -> ActiveSet:
    """The old set where `keep` holds, the new one elsewhere."""
    pairs = zip(vars(old).values(), vars(new).values(), strict=True)
    return ActiveSet(*(np.where(keep, one.T, other.T).T for one, other in pairs))


def frames(normal: Array, stated: Mask) -> Array:
    """Normals and tangents (n, dim, dim); components not stated have to be tangential."""
    free = np.eye(normal.shape[1]) * stated[:, None, :]
    projector = free - normal[:, :, None] * normal[:, None, :]
    values, vectors = np.linalg.eigh(projector)  # eigenvalues 0 and 1, ascending
    tangents = np.swapaxes(vectors * (values > 0.5)[:, None, :], 1, 2)
    return np.concatenate([normal[:, None, :], tangents[:, 1:]], axis=1)


def along_supports(frame: Array, held: Mask) -> Array:
    """Fill the empty tangents of frames (n, dim, dim) along components (n, dim) that are held."""
    frame = frame.copy()
    for t in range(1, frame.shape[1]):
        empty = np.flatnonzero(held.any(axis=1) & ~frame[:, t].any(axis=1))
        rows = frame[empty]
        axes = np.eye(frame.shape[1]) - np.einsum("nka,nkb->nab", rows, rows)
        lengths = np.where(held[empty], np.linalg.norm(axes, axis=2), 0.0)
        chosen = axes[np.arange(len(empty)), lengths.argmax(axis=1)]
        frame[empty, t] = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return frame


def held_tangents(frame: Array, held: Mask) -> Mask:
    """Return which tangents (n, dim - 1) of frames lie along components (n, dim) that are held."""
    along = np.where(held[:, None], frame[:, 1:], 0.0)
    return np.asarray(np.linalg.norm(along, axis=2) > _ALONG)


def turned(active: ActiveSet, old: Array, new: Array) -> ActiveSet:
    """An active set that refers to frames (n, dim, dim), in new ones."""
    turn = np.einsum("nai,nbi->nab", new[:, 1:], old[:, 1:])
    names = "direction", "friction", "support_slip"
    parts = {name: np.einsum("nab,nb->na", turn, getattr(active, name)) for name in names}
    return replace(active, **parts)


def equations(active: ActiveSet, scale: Array) -> tuple[Array, Array, Array]:
    """Equations A force + B (gap; slip) = b of nodes in their frames: (n, dim, dim), b (n, dim)."""
    n, tangents = active.direction.shape
    A, B = np.zeros((n, tangents + 1, tangents + 1)), np.zeros((n, tangents + 1, tangents + 1))
    one = np.eye(tangents + 1)
    A[active.status == OPEN] = one

    stick = active.status == STICK
    B[stick] = scale[stick, None, None] * one

    slip = active.status == SLIP
    d, c = active.direction[slip], scale[slip]
    across = one[1:, 1:] - d[:, :, None] * d[:, None, :]
    turn = active.turning[slip, None, None] * across
    B[slip, 0, 0] = c
    A[slip, 1:, 0] = -active.slope[slip, None] * d
    A[slip, 1:, 1:] = one[1:, 1:] - turn
    B[slip, 1:, 1:] = c[:, None, None] * turn + active.bend[slip, None, None] * across
    return A, B, np.pad(active.level[:, None] * active.direction, ((0, 0), (1, 0)))


@dataclass(frozen=True)
class LinearisedLaw:
    """Linear equations E r + C G a - D U = c of the contact points (m) of this process."""

    E: Array  # (m, dim, dim), of forces in the nodes' coordinates
    C: Array  # (m, dim, dim), of motions
    D: Array  # (m, dim, k), of translations of surfaces, and of angles if they may turn
    c: Array  # (m, dim)

    def where(self, translations: Array, motion: Array) -> "LinearisedLaw":
        """The law of what is left free, parts (m, dim) of U and of G a being known."""
        known = np.einsum("nij,nj->ni", self.D, translations)
        known -= np.einsum("nij,nj->ni", self.C, motion)
        return replace(self, c=self.c + known)


@dataclass(frozen=True)
class Levers:
    """Forces V^T r of points (m) on their surfaces' k motions, linear where points are at a_0.

    Motions q are translations U and perhaps an angle, whose torque changes with the lever arms:

        V^T r - w·(a - U - at) e,    e = (0, 1), at = a_0 - U_0.
    """

    carried: Array  # V (m, dim, k), how surfaces carry points that they hold
    spun: Array  # w (m, dim), change of forces that turn with the surface, by the angle
    at: Array  # (m, dim)

    @classmethod
    def straight(cls, m: int, dim: int) -> "Levers":
        """Levers of surfaces that do not turn."""
        return cls(np.broadcast_to(np.eye(dim), (m, dim, dim)), *np.zeros((2, m, dim)))

    def forces(self, force: Array) -> Array:
        """V^T r (m, k) of forces (m, dim)."""
        return np.einsum("nak,na->nk", self.carried, force)

    def where(self, motions: Array, motion: Array) -> "Levers":
        """The levers of what is left free, parts of q (m, k) and of a (m, dim) being known."""
        return replace(self, at=self.at + motions[:, : motion.shape[1]] - motion)


@dataclass(frozen=True)
class Solved:
    """Unknowns of this process that a tangent's solver has found.

    Those of free translations are at the end of the last process'.
    """

    unknowns: Array
    exact: bool  # whether the same system, solved again, would give nothing better
    final: bool  # whether it is exact enough to be the last of an increment


@dataclass(frozen=True)
class Place:
    """Gap, slip and force components, linear about a place, where values are marked by 0.

    With motions v of the points and q of their surfaces,

        (gap; slip) = (gap_0; slip_0) + moved (v - v_0) + followed (q - q_0),
        force       = frame_0 r + turned (v - v_0) + spun (q - q_0).
    """

    pair: Local  # of the contact points (m)
    levers: Levers
    at: Array  # v_0, (m, p)
    translations: Array  # q_0, (pairs, k)
    frame: Array  # normals and tangents, (m, dim, dim)
    gap: Array  # (m,), infinite where nothing faces a node
    slip: Array  # (m, dim - 1)
    moved: Array  # (m, dim, p)
    followed: Array  # (m, dim, k)
    turned: Array  # (m, dim, p)
    spun: Array  # (m, dim, k)
    held: Mask  # (m, dim - 1), tangents along which supports hold a node, and friction acts

    @classmethod
    def undeformed(
        cls,
        interface: Interface,
        past: Array,
        translations: Array,
        free: Mask,
        displacement: Array,
        force: Array,
    ) -> "Place":
        """The place of an undeformed body, as displacements a and translations U move points.

        Planes make all linear. Where a curved surface is free to move, its normals turn with it,
        as is seen at translations, of which some are free, motions and forces (m, dim). Slip is
        that since `past` displacements less translations (m, dim).
        """
        step = _STEP * (interface.extent or 1.0)
        held = interface.held_components
        frame = frames(interface.normals(translations), interface.equation >= 0)
        frame = along_supports(frame, held)
        normal, tangents = frame[:, 0], frame[:, 1:]
        gap, loss = interface.gaps(translations), normal.copy()
        turn = np.zeros_like(frame)  # of the normal, (n, component, translation)
        for axis in np.flatnonzero(free.any(axis=0)):
            ahead, behind = translations.copy(), translations.copy()
            ahead[free[:, axis], axis] += step
            behind[free[:, axis], axis] -= step
            moved = free[interface.pair, axis]
            turned = (interface.normals(ahead) - interface.normals(behind)) / (2 * step)
            with np.errstate(invalid="ignore"):  # infinite gaps
                change = (interface.gaps(behind) - interface.gaps(ahead)) / (2 * step)
            smooth = moved & np.isfinite(change)
            turn[smooth, :, axis] = turned[smooth]
            loss[smooth, axis] = change[smooth] - np.sum(turned * displacement, axis=1)[smooth]
        # tangents turn so that they stay normal to it: dt = -(t·dn) n
        tilt = np.einsum("nta,nak->ntk", tangents, turn)
        start = past + translations[interface.pair]
        relative, pressed = (np.sum(normal * v, axis=1) for v in (displacement - start, force))
        slid = tangents + tilt * relative[:, None, None]
        by_turn = np.einsum("na,nak->nk", force, turn)[:, None], -tilt * pressed[:, None, None]
        return cls(
            interface.pair,
            Levers.straight(*force.shape),
            np.zeros_like(force),
            translations,
            frame,
            gap,
            -np.einsum("nta,na->nt", tangents, start),
            frame,
            -np.concatenate([loss[:, None], slid], axis=1),
            np.zeros_like(frame),
            np.concatenate(by_turn, axis=1),
            held_tangents(frame, held),
        )

    def contact(
        self, motions: Array, translations: Array, force: Array, cone: Cone, scale: Array
    ) -> Contact:
        """What is seen at motions (m, p) and (pairs, k), under forces (m, dim)."""
        moved, followed = motions - self.at, (translations - self.translations)[self.pair]

        def change(by_points: Array, by_surfaces: Array) -> Array:
            each = (by_points, moved), (by_surfaces, followed)
            return np.asarray(sum(np.einsum("nab,nb->na", slope, way) for slope, way in each))

        relative, components = change(self.moved, self.followed), change(self.turned, self.spun)
        components += np.einsum("nab,nb->na", self.frame, force)
        gap, slip = self.gap + relative[:, 0], self.slip + relative[:, 1:]
        no = np.zeros(len(gap), dtype=bool)
        return Contact(self.frame, gap, slip, components, cone, scale, self.held, no, no)

    def law(self, active: ActiveSet, scale: Array) -> LinearisedLaw:
        """The law of an active set, in the nodes' coordinates; its factors c are (m,)."""
        A, B, b = equations(active, scale)
        b = b - np.einsum("nab,nb->na", A[:, :, 1:], active.friction)
        stated = np.pad(~self.held, ((0, 0), (1, 0)), constant_values=True)
        to_nodes = np.swapaxes(self.frame * stated[:, :, None], 1, 2)
        C, D = A @ self.turned + B @ self.moved, -(A @ self.spun + B @ self.followed)
        gap = np.where(np.isfinite(self.gap), self.gap, 0.0)
        known = np.concatenate([gap[:, None], self.slip], axis=1)
        here = (B, -known), (C, self.at), (D, -self.translations[self.pair])
        c = b + sum(np.einsum("nab,nb->na", slope, way) for slope, way in here)
        of_force = A @ (self.frame * stated[:, :, None])
        E, C, D, c = (to_nodes @ part for part in (of_force, C, D, c[:, :, None]))
        return LinearisedLaw(E, C, D, c[:, :, 0])


def add_support_friction(
    contact: Contact,
    place: Place,
    force: Array,
    friction: Array,
    *,
    stiffness: Array,
    components: Mask,
) -> tuple[Contact, Array]:
    """Add to the forces of nodes the friction that the law gives along tangents that are held.

    A support that is not along the surface then bears part of the normal force, too, on which the
    limit of friction depends: the two are found by passes.

    Args:
        contact: the nodes, with the forces that their own equations tell.
        place: the kinematics.
        force: (m, dim), the same forces in global components.
        friction: (m, dim - 1), of the iteration before, along the tangents.
        stiffness: (m,), of friction against slip.
        components: (m, dim), which global components supports hold.

    Returns:
        The nodes with all forces, and these in global components (m, dim).
    """
    held, others = place.held, contact.force
    tangents = np.where(held[:, :, None], place.frame[:, 1:], 0.0)
    within = np.linalg.pinv(np.where(components[:, None], tangents, 0.0))
    equation_forces = np.einsum("nta,na->nt", tangents, force)
    tangential = np.where(held, friction, others[:, 1:])
    for _ in range(_FRICTION_PASSES):
        added = np.einsum("nat,nt->na", within, np.where(held, tangential - equation_forces, 0.0))
        normal = others[:, 0] + np.einsum("na,na->n", place.frame[:, 0], added)
        trial_force = np.column_stack([normal, np.where(held, friction, others[:, 1:])])
        trial = replace(contact, force=trial_force)
        limit = trial.limits[0]
        admitted = replace(trial, scale=stiffness).admitted_friction(limit)
        before, tangential = tangential, np.where(held, admitted, others[:, 1:])
        if not np.any(np.abs(tangential - before) > _FRICTION_ROUND_OFF * limit[:, None]):
            break
    added = np.einsum("nat,nt->na", within, np.where(held, tangential - equation_forces, 0.0))
    normal = others[:, 0] + np.einsum("na,na->n", place.frame[:, 0], added)
    return replace(contact, force=np.column_stack([normal, tangential])), force + added
