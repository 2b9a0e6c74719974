"""The contact nodes: active set, law, and kinematics linearised about a state.

With the trial pressure p = r_n - c g, the trial friction s = r_t - c v and the limit of friction l,
the law is F = 0, where

    F_n = r_n - max(0, p),    F_t = r_t - projection of s on the disc |.| <= l(max(0, p)),

and Newton's method on F is an active-set iteration. The guide's page on theory has the equations of
open, sticking and slipping nodes ("The law, linearised"). Motions of the points are v = G a, those
of a surface q = (U, angle).

The module guarantees that the equations of an active set hold at a solution of F and have first
derivatives of all that the law needs. It assumes that limits of friction are concave in the normal
force, as `Interface.check` verifies, and frames whose first row is a unit normal.
"""

from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.contact.model import FrictionCone

OPEN, STICK, SLIP = 0, 1, 2
# Of states alone: in rough contact with a deformable surface, and moved along it by supports
HELD = 3

# Directions, slopes and friction that differ by less belong to the same active set
_SAME_SET_TOLERANCE = 1e-10
# Violation of the law over the largest nodal contact force
TOLERANCE = 1e-9
# Part of a tangent along held components from which on supports hold it
_MIN_HELD_PART = 0.5


@dataclass(frozen=True)
class ActiveSet:
    """Status and linearised friction of every contact node (m of this process) in a linear system.

    All arrays but the status are zero at nodes that do not slip, and without friction.

    Args:
        status: (m,) of OPEN, STICK or SLIP.
        direction: (m, dim - 1), unit vector of the friction force along the tangents.
        turning: (m,), l(p) / |s|, by which the direction follows the trial force s.
        slope: (m,), l'(p) of the limit of friction.
        intercept: (m,), l(p) - l'(p) p, zero by Coulomb's law.
        turning_by_slip: (m,), l(p) / |v| of nodes that supports move along their surface.
        support_friction: (m, dim - 1), friction along tangents that supports hold, of the iteration
            before, at nodes whose surface is free to slide.
        support_slip: (m, dim - 1), the slip that goes with it.
    """

    status: npt.NDArray[np.int8]
    direction: Array
    turning: Array
    slope: Array
    intercept: Array
    turning_by_slip: Array
    support_friction: Array
    support_slip: Array


def linearise_friction_limits(
    pressure: Array, limits: tuple[Array, Array], direction: Array
) -> tuple[Array, Array]:
    """Return slope and intercept (m,) of an active set, at pressures max(0, p) (m,).

    Limits of friction and their slopes are (m,) each; `direction` is that of the active set.
    """
    (limit, slope), slips = limits, np.any(direction != 0, axis=1)
    return np.where(slips, slope, 0.0), np.where(slips, limit - slope * pressure, 0.0)


def make_sticking_set(closed: Mask, cone: FrictionCone, n_tangents: int) -> ActiveSet:
    """Return the set in which closed nodes (m,) stick, or slip where there is no friction."""
    m = len(closed)
    status = np.where(closed, np.where(cone.has_friction, STICK, SLIP), OPEN).astype(np.int8)
    no_vector = np.zeros((m, n_tangents))
    turning, slope, intercept, turning_by_slip = np.zeros((4, m))
    return ActiveSet(
        status, no_vector, turning, slope, intercept, turning_by_slip, no_vector, no_vector
    )


def select_nodes(where: Mask, chosen: ActiveSet, other: ActiveSet) -> ActiveSet:
    """Return the `chosen` set at the nodes (m,) `where` it holds, the `other` set elsewhere."""
    pairs = zip(vars(chosen).values(), vars(other).values(), strict=True)
    return ActiveSet(*(np.where(where, one.T, two.T).T for one, two in pairs))


def rotate_to_frames(active: ActiveSet, old_frame: Array, frame: Array) -> ActiveSet:
    """Return an active set whose vectors refer to new frames (m, dim, dim)."""
    rotation = np.einsum("nai,nbi->nab", frame[:, 1:], old_frame[:, 1:])
    names = "direction", "support_friction", "support_slip"
    vectors = {name: np.einsum("nab,nb->na", rotation, getattr(active, name)) for name in names}
    return replace(active, **vectors)


def find_differences(a: ActiveSet, b: ActiveSet) -> Mask:
    """Return at which nodes (m,) two active sets differ."""
    direction = np.abs(a.direction - b.direction).max(axis=1) > _SAME_SET_TOLERANCE
    slope = np.abs(a.slope - b.slope) > _SAME_SET_TOLERANCE
    change = np.abs(a.support_friction - b.support_friction)
    friction = change > _SAME_SET_TOLERANCE * np.abs(a.support_friction)
    return np.asarray((a.status != b.status) | direction | slope | friction.any(axis=1))


def is_same_set(a: ActiveSet, b: ActiveSet, comm: MPI.Comm) -> bool:
    """Return whether two active sets are alike on all processes."""
    return not comm.allreduce(int(np.any(find_differences(a, b))), MPI.MAX)


def count_statuses(active: ActiveSet, comm: MPI.Comm) -> str:
    """Return how many nodes of all processes are open, stick and slip, in words."""
    counts = [comm.allreduce(int(np.sum(active.status == s)), MPI.SUM) for s in (OPEN, STICK, SLIP)]
    return "{} open, {} sticking, {} slipping contact nodes".format(*counts)


@dataclass(frozen=True)
class ContactNodes:
    """Gap, slip and force of the contact nodes (m of this process) in their frames.

    Args:
        frame: (m, dim, dim), rows: normal, tangents (zero where the law is not stated).
        gap: (m,), infinite where nothing faces the node.
        slip: (m, dim - 1), of this increment.
        force: (m, dim), components along the frame.
        cone: the laws of friction.
        scale: (m,), c.
        held_tangents: (m, dim - 1), along which supports hold the node, and friction acts.
        is_dragged: (m,), whether supports and surface make the node slip, whatever its forces.
        is_coupled: (m,), whether its slip along supports depends on a free motion of the surface.
    """

    frame: Array
    gap: Array
    slip: Array
    force: Array
    cone: FrictionCone
    scale: Array
    held_tangents: Mask
    is_dragged: Mask
    is_coupled: Mask

    @cached_property
    def resting_tangents(self) -> Mask:
        """Tangents (m, dim - 1) that supports hold while the surface rests along them."""
        return self.held_tangents & ~(self.is_dragged | self.is_coupled)[:, None]

    @cached_property
    def trial_pressure(self) -> Array:
        """p, (m,); minus infinity for nodes which nothing faces."""
        return self.force[:, 0] - self.scale * self.gap

    @cached_property
    def trial_friction(self) -> Array:
        """s, (m, dim - 1); without friction on supports that tells nothing of slip."""
        trial = self.force[:, 1:] - self.scale[:, None] * self.slip
        return np.asarray(np.where(self.resting_tangents, 0.0, trial))

    @cached_property
    def friction_limits(self) -> tuple[Array, Array]:
        """Limits of friction l(max(0, p)), (m,), and their slopes, (m,)."""
        return self.cone.limit(np.maximum(0.0, self.trial_pressure))

    def admitted_friction(self, limit: Array) -> Array:
        """Tangential forces (m, dim - 1) of the law, under limits (m,), at these slips."""
        slip_size = np.linalg.norm(self.slip, axis=1)
        against_slip = -(limit / np.where(self.is_dragged, slip_size, 1.0))[:, None] * self.slip
        friction = shorten_to(limit, self.trial_friction)
        if self.resting_tangents.any():  # what friction along free tangents leaves of the limit
            left = np.sqrt(np.maximum(0.0, limit**2 - np.sum(friction**2, axis=1)))
            friction += shorten_to(left, np.where(self.resting_tangents, self.force[:, 1:], 0.0))
        return np.where(self.is_dragged[:, None], against_slip, friction)

    @cached_property
    def active_set(self) -> ActiveSet:
        """The linearisation of F here, whatever set came before."""
        return self._linearise(np.zeros_like(self.slip))

    def next_active_set(self, before: ActiveSet) -> ActiveSet:
        """Return the linearisation of F here; nodes whose slip turned back since `before` stick."""
        return self._linearise(before.direction)

    def _linearise(self, direction_before: Array) -> ActiveSet:
        p, s, limit = self.trial_pressure, self.trial_friction, self.friction_limits[0]
        size = np.linalg.norm(s, axis=1)
        slipping = (p > 0) & (size >= limit)
        slipping &= ~(np.sum(s * direction_before, axis=1) < 0)
        dragged = self.is_dragged & (p > 0)
        slipping |= dragged
        slip_size = np.linalg.norm(self.slip, axis=1)
        s = np.where(dragged[:, None], -self.slip, s)
        size = np.where(dragged, slip_size, size)
        has_direction = slipping & self.cone.has_friction
        status = np.where(p > 0, STICK, OPEN)
        status[slipping] = SLIP
        divisor = np.where(has_direction, size, 1.0)
        turning = np.where(has_direction, limit / divisor, 0.0)
        of_iteration_before = self.held_tangents & self.is_coupled[:, None]
        direction = np.where(has_direction, 1 / divisor, 0.0)[:, None] * s
        slope, intercept = linearise_friction_limits(
            np.maximum(0.0, p), self.friction_limits, direction
        )
        return ActiveSet(
            status.astype(np.int8),
            direction,
            np.where(dragged, 0.0, turning),
            slope,
            intercept,
            turning_by_slip=np.where(dragged, turning, 0.0),
            support_friction=np.where(of_iteration_before, self.force[:, 1:], 0.0),
            support_slip=np.where(of_iteration_before, self.slip, 0.0),
        )

    def violation(self) -> Array:
        """F, (m, dim), forces: zero at a solution."""
        normal = self.force[:, :1] - np.maximum(0.0, self.trial_pressure)[:, None]
        tangential = self.force[:, 1:] - self.admitted_friction(self.friction_limits[0])
        return np.hstack([normal, tangential])

    def friction_round_off(self, of_coordinates: float) -> Array:
        """Return what of friction (m,) may be round-off, given that of nodes' coordinates.

        Slips have no coordinates, but friction's limit has the gap at nodes that are pressed by
        more than this round-off.
        """
        gap = np.where(np.isfinite(self.gap), np.abs(self.gap), 0.0)
        of_limit = self.friction_limits[1] * self.scale * gap
        return np.where(self.force[:, 0] > of_coordinates, of_limit, of_coordinates)

    def residuals(self, force: float, length: Array | float) -> dict[str, Array]:
        """Return how far each condition is from holding, (m,), over a force and lengths (m,)."""
        normal, tangential, gap = self.force[:, 0], self.force[:, 1:], self.gap
        limit, _ = self.cone.limit(np.maximum(0.0, normal))
        sticks = (np.linalg.norm(self.trial_friction, axis=1) < limit) & ~self.is_dragged
        difference = np.abs(tangential - self.admitted_friction(limit)).max(axis=1, initial=0.0)
        slip_size = np.where(sticks, np.linalg.norm(self.slip, axis=1), 0.0)
        return {
            "penetration": np.maximum(0.0, -gap) / length,
            "tension": np.maximum(0.0, -normal) / force,
            "complementarity": np.maximum(0.0, np.minimum(normal / force, gap / length)),
            "cone": np.maximum(0.0, np.linalg.norm(tangential, axis=1) - limit) / force,
            "stick": slip_size / length,
            "direction": np.where(sticks, 0.0, difference) / force,
        }


def shorten_to(limit: Array, vectors: Array) -> Array:
    """Return vectors (m, dim - 1), of which those longer than a limit (m,) are shortened to it."""
    size = np.linalg.norm(vectors, axis=1)
    is_longer = size > limit
    factor = np.where(is_longer, limit / np.where(is_longer, size, 1.0), 1.0)
    return np.asarray(factor[:, None] * vectors)


def assemble_node_equations(active: ActiveSet, scale: Array) -> tuple[Array, Array, Array]:
    """Return A, B (m, dim, dim) and b (m, dim) of A force + B (gap; slip) = b in nodes' frames."""
    m, n_tangents = active.direction.shape
    A, B = np.zeros((2, m, n_tangents + 1, n_tangents + 1))
    identity = np.eye(n_tangents + 1)
    A[active.status == OPEN] = identity

    stick = active.status == STICK
    B[stick] = scale[stick, None, None] * identity

    slip = active.status == SLIP
    d, c = active.direction[slip], scale[slip]
    across = identity[1:, 1:] - d[:, :, None] * d[:, None, :]
    M = active.turning[slip, None, None] * across
    B[slip, 0, 0] = c
    A[slip, 1:, 0] = -active.slope[slip, None] * d
    A[slip, 1:, 1:] = identity[1:, 1:] - M
    B[slip, 1:, 1:] = c[:, None, None] * M + active.turning_by_slip[slip, None, None] * across
    return A, B, np.pad(active.intercept[:, None] * active.direction, ((0, 0), (1, 0)))


@dataclass(frozen=True)
class LinearisedLaw:
    """Linear equations E r + C G a - D q = c of the contact points (m) of this process.

    Args:
        E: (m, dim, dim), of forces in global components.
        C: (m, dim, p), of motions v = G a.
        D: (m, dim, k), of the surfaces' motions q: translations, and angles if they may turn.
        c: (m, dim).
    """

    E: Array
    C: Array
    D: Array
    c: Array


def eliminate_known_motions(law: LinearisedLaw, q: Array, v: Array) -> LinearisedLaw:
    """Return the law of what is free, known parts (m, k) of q and (m, p) of v being given."""
    known = np.einsum("nij,nj->ni", law.D, q)
    known -= np.einsum("nij,nj->ni", law.C, v)
    return replace(law, c=law.c + known)


@dataclass(frozen=True)
class TorqueMap:
    """Resultants V^T r of point forces (m, dim) on the k motions q of their surfaces.

    The torque of a surface that may turn changes with the lever arms: linear about displacements
    a_0 and translations U_0, the resultants are

        V^T r - w·(a - U - d_0) e,    e = (0, 1), d_0 = a_0 - U_0.

    Args:
        V: (m, dim, k), displacements of points that are carried along, by q.
        w: (m, dim), change of forces that turn with the surface, by the angle.
        d0: (m, dim), displacements relative to the translation.
    """

    V: Array
    w: Array
    d0: Array

    @classmethod
    def of_translations(cls, m: int, dim: int) -> "TorqueMap":
        """Return the map of surfaces that do not turn."""
        return cls(np.broadcast_to(np.eye(dim), (m, dim, dim)), *np.zeros((2, m, dim)))

    def resultants(self, force: Array) -> Array:
        """V^T r, (m, k), of forces (m, dim)."""
        return np.einsum("nak,na->nk", self.V, force)

    def eliminate_known(self, q: Array, v: Array) -> "TorqueMap":
        """Return the map of what is free, known parts (m, k) of q and (m, dim) of a being given."""
        return replace(self, d0=self.d0 + q[:, : v.shape[1]] - v)


@dataclass(frozen=True)
class LinearisedKinematics:
    """First-order expansion of gap, slip and nodal force about motions v_0 and q_0.

        (gap; slip) = (gap_0; slip_0) + motion_by_v (v - v_0) + motion_by_q (q - q_0),
        force       = frame_0 r       + force_by_v (v - v_0)  + force_by_q (q - q_0).

    Args:
        pair: (m,), number of the pair of each point.
        torque_map: of the surfaces.
        v0: (m, p).
        q0: (pairs, k).
        frame: (m, dim, dim), normals and tangents.
        gap: (m,), infinite where nothing faces a point.
        slip: (m, dim - 1).
        motion_by_v: (m, dim, p), and the others: derivatives.
        motion_by_q: (m, dim, k).
        force_by_v: (m, dim, p).
        force_by_q: (m, dim, k).
        held_tangents: (m, dim - 1), along which supports hold a point, and friction acts.
    """

    pair: LocalIndices
    torque_map: TorqueMap
    v0: Array
    q0: Array
    frame: Array
    gap: Array
    slip: Array
    motion_by_v: Array
    motion_by_q: Array
    force_by_v: Array
    force_by_q: Array
    held_tangents: Mask

    def evaluate_nodes(
        self, v: Array, q: Array, force: Array, *, cone: FrictionCone, scale: Array
    ) -> ContactNodes:
        """Return the nodes at motions v (m, p) and q (pairs, k), under forces r (m, dim)."""
        dv, dq = v - self.v0, (q - self.q0)[self.pair]

        def expand(by_v: Array, by_q: Array) -> Array:
            return np.asarray(np.einsum("nab,nb->na", by_v, dv) + np.einsum("nab,nb->na", by_q, dq))

        motion = expand(self.motion_by_v, self.motion_by_q)
        components = expand(self.force_by_v, self.force_by_q)
        components += np.einsum("nab,nb->na", self.frame, force)
        no = np.zeros(len(self.gap), dtype=bool)
        return ContactNodes(
            frame=self.frame,
            gap=self.gap + motion[:, 0],
            slip=self.slip + motion[:, 1:],
            force=components,
            cone=cone,
            scale=scale,
            held_tangents=self.held_tangents,
            is_dragged=no,
            is_coupled=no,
        )

    def linearise_law(self, active: ActiveSet, scale: Array) -> LinearisedLaw:
        """Return the law of an active set, in global components; c of the law is `scale` (m,)."""
        A, B, b = assemble_node_equations(active, scale)
        b = b - np.einsum("nab,nb->na", A[:, :, 1:], active.support_friction)
        is_stated = np.pad(~self.held_tangents, ((0, 0), (1, 0)), constant_values=True)
        stated_frame = self.frame * is_stated[:, :, None]
        C = A @ self.force_by_v + B @ self.motion_by_v
        D = -(A @ self.force_by_q + B @ self.motion_by_q)
        gap = np.where(np.isfinite(self.gap), self.gap, 0.0)
        motion = np.concatenate([gap[:, None], self.slip], axis=1)
        known = np.einsum("nab,nb->na", C, self.v0) - np.einsum("nab,nb->na", B, motion)
        c = b + (known - np.einsum("nab,nb->na", D, self.q0[self.pair]))
        to_global = np.swapaxes(stated_frame, 1, 2)
        E, C, D, c = (to_global @ part for part in (A @ stated_frame, C, D, c[:, :, None]))
        return LinearisedLaw(E, C, D, c[:, :, 0])


def make_frames(normal: Array, stated: Mask) -> Array:
    """Return normals and tangents (m, dim, dim); components not stated have to be tangential."""
    free = np.eye(normal.shape[1]) * stated[:, None, :]
    projector = free - normal[:, :, None] * normal[:, None, :]
    values, vectors = np.linalg.eigh(projector)  # eigenvalues 0 and 1, ascending
    tangents = np.swapaxes(vectors * (values > 0.5)[:, None, :], 1, 2)
    return np.concatenate([normal[:, None, :], tangents[:, 1:]], axis=1)


def add_tangents_along_supports(frame: Array, held: Mask) -> Array:
    """Fill the empty tangents of frames (m, dim, dim) along components (m, dim) that are held."""
    frame = frame.copy()
    for t in range(1, frame.shape[1]):
        empty = np.flatnonzero(held.any(axis=1) & ~frame[:, t].any(axis=1))
        rows = frame[empty]
        axes = np.eye(frame.shape[1]) - np.einsum("nka,nkb->nab", rows, rows)
        lengths = np.where(held[empty], np.linalg.norm(axes, axis=2), 0.0)
        chosen = axes[np.arange(len(empty)), lengths.argmax(axis=1)]
        frame[empty, t] = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return frame


def find_held_tangents(frame: Array, held: Mask) -> Mask:
    """Return which tangents (m, dim - 1) of frames lie along components (m, dim) that are held."""
    along = np.where(held[:, None], frame[:, 1:], 0.0)
    return np.asarray(np.linalg.norm(along, axis=2) > _MIN_HELD_PART)
