"""Contact nodes: active set, contact law, and kinematics linearised about a state.

Let r_n and r_t be the normal and tangential force on a node, g its gap, v its slip, l the friction
limit and c a stiffness. With the trial pressure p = r_n - c g and the trial friction s = r_t - c v,
the contact law is F = 0 with

    F_n = r_n - max(0, p),    F_t = r_t - projection of s on the disc |.| <= l(max(0, p)).

Newton's method applied to F is an active-set iteration. The theory page derives the equations of
open, sticking and slipping nodes ("The law, linearised"). In the linearised kinematics, v denotes
the motions of the contact points, which follow from the displacements a by the motion operator G:
v = G a. The motions q = (U, angle) of a surface are its translation U and its angle.

The module guarantees that the equations of an active set hold at a solution of F = 0 and contain
the first derivatives of F. It assumes that the ratio of the friction limit to the normal force does
not rise with the force, which `ContactInterface.check_laws_supports_and_initial_gaps` verifies. It
also assumes that the first row of each frame is a unit normal.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.contact.model import FrictionCone

OPEN, STICK, SLIP = 0, 1, 2
# Status that occurs only in states: contact with friction on a deformable surface, along which
# supports prescribe the motion of the node
HELD = 3

# Largest difference between equal active sets: absolute for directions and slopes, relative for
# support friction
_EQUAL_ACTIVE_SETS_TOLERANCE = 1e-10
# Largest violation of the contact conditions, relative to the largest nodal contact force
MAX_CONTACT_VIOLATION_PER_NODAL_FORCE = 1e-9
# Smallest weight of a friction force, relative to the product of slip and law scale, in the
# equations of sticking points whose slip may be determined by the gaps of other points
MIN_KEPT_FRICTION_WEIGHT = 1e-3


@dataclass(frozen=True)
class LinearisedInterfaceLaw:
    """Interface laws r = R(g, v, r), linearised as r - by_force r - by_motion (g; v) = intercept.

    All arrays except the mask are zero at nodes without a law. Components are in the frames.

    Args:
        at_law: (m,), mask of the nodes with a law.
        intercept: (m, dim), right-hand side.
        by_motion: (m, dim, dim), derivatives of R by gap and slip.
        by_force: (m, dim, dim), derivatives of R by the force.
    """

    at_law: Mask
    intercept: Array
    by_motion: Array
    by_force: Array

    def replace_outside(
        self, is_inside: Mask, elsewhere: "LinearisedInterfaceLaw"
    ) -> "LinearisedInterfaceLaw":
        """Return the law with the values of `elsewhere` where the mask `is_inside` is false."""
        pairs = zip(vars(self).values(), vars(elsewhere).values(), strict=True)
        return LinearisedInterfaceLaw(
            *(np.where(is_inside.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs)
        )

    def rotate(self, tangent_rotation: Array) -> "LinearisedInterfaceLaw":
        """Return the law in frames whose tangents are rotated by (m, dim - 1, dim - 1)."""
        Q = np.zeros_like(self.by_motion)
        Q[:, 0, 0], Q[:, 1:, 1:] = 1.0, tangent_rotation
        inverse = np.swapaxes(Q, 1, 2)
        return LinearisedInterfaceLaw(
            self.at_law,
            np.einsum("nab,nb->na", Q, self.intercept),
            Q @ self.by_motion @ inverse,
            Q @ self.by_force @ inverse,
        )


@dataclass(frozen=True)
class ActiveSet:
    """Status and linearised friction of this process' m contact nodes in one linear system.

    All arrays except the status are zero at nodes that do not slip or have no friction. Interface
    laws have equations of their own, which replace those of the status. Below, p is
    the trial pressure, s the trial friction, v the slip, and l(p) the friction limit with the slope
    l'(p). The held tangents of a node are the tangents along which supports hold it. Support
    friction is the friction along held tangents.

    Args:
        status: (m,), OPEN, STICK or SLIP.
        direction: (m, dim - 1), unit vectors along the friction forces, in components along the
            tangents.
        friction_ratio: (m,), l(p) / |s|, a factor in the derivative of friction with respect to s.
        limit_slope: (m,), l'(p).
        limit_intercept: (m,), l(p) - l'(p) p, which is zero for Coulomb's law.
        friction_per_slip: (m,), l(p) / |v| at nodes that supports move along their surface.
        support_friction: (m, dim - 1), support friction in the previous iteration at nodes whose
            surface is free to slide.
        support_slip: (m, dim - 1), slip along held tangents in the previous iteration.
        interface_law: linearised interface laws; None if no pair has one. At nodes with a law, the
            status only tells whether there is a force.
    """

    status: npt.NDArray[np.int8]
    direction: Array
    friction_ratio: Array
    limit_slope: Array
    limit_intercept: Array
    friction_per_slip: Array
    support_friction: Array
    support_slip: Array
    interface_law: LinearisedInterfaceLaw | None = None

    @property
    def imposes_motion(self) -> Mask:
        """Mask (m,) of points that prescribe a motion: closed ones, and those of implicit laws.

        An explicit law gives the force as a function of gap and slip, and prescribes no motion.
        """
        law = self.interface_law
        if law is None:
            return self.status != OPEN
        return np.where(law.at_law, law.by_force.any(axis=(1, 2)), self.status != OPEN)


def linearise_friction_limits(
    trial_pressure: Array, limits_and_slopes: tuple[Array, Array], friction_direction: Array
) -> tuple[Array, Array]:
    """Return slopes l'(p) and intercepts l(p) - l'(p) p of friction limits l at pressures p.

    Both are arrays (m,) with zeros at nodes that do not slip.

    Args:
        trial_pressure: (m,), trial pressures p, with zero in place of negative values.
        limits_and_slopes: friction limits l(p) and slopes l'(p), (m,) each.
        friction_direction: (m, dim - 1), directions of friction in the active set, zero at nodes
            that do not slip.
    """
    (limit, slope), slips = limits_and_slopes, np.any(friction_direction != 0, axis=1)
    return np.where(slips, slope, 0.0), np.where(slips, limit - slope * trial_pressure, 0.0)


def make_sticking_active_set(closed: Mask, cone: FrictionCone, n_tangents: int) -> ActiveSet:
    """Return the active set in which closed nodes stick, or slip if they have no friction.

    Args:
        closed: (m,), mask of closed nodes. All other nodes are open.
        cone: friction laws of the nodes.
        n_tangents: number of tangents of each node.
    """
    m = len(closed)
    status = np.where(closed, np.where(cone.has_friction, STICK, SLIP), OPEN).astype(np.int8)
    no_vector = np.zeros((m, n_tangents))
    friction_ratio, slope, intercept, friction_per_slip = np.zeros((4, m))
    return ActiveSet(
        status,
        no_vector,
        friction_ratio,
        slope,
        intercept,
        friction_per_slip,
        no_vector,
        no_vector,
    )


def combine_active_sets(is_inside: Mask, inside: ActiveSet, elsewhere: ActiveSet) -> ActiveSet:
    """Return an active set with the values of two active sets at different nodes.

    The values are those of `inside` where the mask `is_inside` (m,) is true, and those of
    `elsewhere` at all other nodes.
    """
    names = [name for name in vars(inside) if name != "interface_law"]
    values: dict[str, Any] = {
        name: np.where(is_inside, getattr(inside, name).T, getattr(elsewhere, name).T).T
        for name in names
    }
    if inside.interface_law is not None and elsewhere.interface_law is not None:
        values["interface_law"] = inside.interface_law.replace_outside(
            is_inside, elsewhere.interface_law
        )
    return ActiveSet(**values)


def rotate_active_set(active: ActiveSet, old_frame: Array, new_frame: Array) -> ActiveSet:
    """Return the active set with its vectors transformed from old to new frames.

    The frames `old_frame` and `new_frame` are arrays (m, dim, dim).
    """
    rotation = np.einsum("nai,nbi->nab", new_frame[:, 1:], old_frame[:, 1:])
    names = "direction", "support_friction", "support_slip"
    vectors = {name: np.einsum("nab,nb->na", rotation, getattr(active, name)) for name in names}
    law = active.interface_law
    return replace(active, interface_law=None if law is None else law.rotate(rotation), **vectors)


def find_differing_nodes(a: ActiveSet, b: ActiveSet) -> Mask:
    """Return a mask (m,) of the nodes at which two active sets differ."""
    direction = np.abs(a.direction - b.direction).max(axis=1) > _EQUAL_ACTIVE_SETS_TOLERANCE
    slope = np.abs(a.limit_slope - b.limit_slope) > _EQUAL_ACTIVE_SETS_TOLERANCE
    change = np.abs(a.support_friction - b.support_friction)
    friction = change > _EQUAL_ACTIVE_SETS_TOLERANCE * np.abs(a.support_friction)
    differs = (a.status != b.status) | direction | slope | friction.any(axis=1)
    if a.interface_law is not None and b.interface_law is not None:
        laws = a.interface_law.intercept, b.interface_law.intercept
        law_change = np.abs(laws[0] - laws[1])
        differs |= (law_change > _EQUAL_ACTIVE_SETS_TOLERANCE * np.abs(laws[0])).any(axis=1)
    return np.asarray(differs)


def is_same_set(a: ActiveSet, b: ActiveSet, comm: MPI.Comm) -> bool:
    """Return whether two active sets agree at all nodes of all processes; collective."""
    return not comm.allreduce(int(np.any(find_differing_nodes(a, b))), MPI.MAX)


def describe_status_counts(active: ActiveSet, comm: MPI.Comm) -> str:
    """Return a phrase with the numbers of open, sticking and slipping nodes; collective."""
    counts = [comm.allreduce(int(np.sum(active.status == s)), MPI.SUM) for s in (OPEN, STICK, SLIP)]
    return "{} open, {} sticking, {} slipping contact nodes".format(*counts)


@dataclass(frozen=True)
class ContactNodes:
    """Gap, slip and force of this process' m contact nodes, in frames at the nodes.

    The contact law is formulated with trial forces. The trial pressure is r_n - c g, and the trial
    friction r_t - c v, with the normal force r_n, the gap g, the friction r_t, the slip v and a
    factor c.

    Args:
        frame: (m, dim, dim), rows are the normal and the tangents. Tangents along which the law
            does not apply are zero.
        gap: (m,), gaps, infinite where no surface faces the node.
        slip: (m, dim - 1), slips since the start of the increment.
        force: (m, dim), components of the nodal forces in the frames.
        cone: friction laws of the nodes.
        scale: (m,), factor c of the law, a force per length.
        held_tangents: (m, dim - 1), mask of the tangents with friction along which supports hold
            the node.
        has_prescribed_slip: (m,), whether supports and prescribed motions of the surface make the
            node slip.
        is_coupled_to_surface: (m,), whether the slip along a held tangent depends on a free motion
            of the surface.
    """

    frame: Array
    gap: Array
    slip: Array
    force: Array
    cone: FrictionCone
    scale: Array
    held_tangents: Mask
    has_prescribed_slip: Mask
    is_coupled_to_surface: Mask

    @cached_property
    def held_tangents_without_motion(self) -> Mask:
        """Mask (m, dim - 1) of held tangents along which neither the node nor its surface moves."""
        return (
            self.held_tangents & ~(self.has_prescribed_slip | self.is_coupled_to_surface)[:, None]
        )

    @cached_property
    def trial_pressure(self) -> Array:
        """Trial pressures (m,) as forces; minus infinity where no surface faces the node."""
        return self.force[:, 0] - self.scale * self.gap

    @cached_property
    def trial_friction(self) -> Array:
        """Trial friction (m, dim - 1); zero along `held_tangents_without_motion`."""
        trial = self.force[:, 1:] - self.scale[:, None] * self.slip
        return np.asarray(np.where(self.held_tangents_without_motion, 0.0, trial))

    @cached_property
    def friction_limits_and_slopes(self) -> tuple[Array, Array]:
        """Friction limits and their slopes, (m,) each, at the trial pressures.

        Negative trial pressures are replaced by zero.
        """
        return self.cone.friction_limits_and_slopes(np.maximum(0.0, self.trial_pressure))

    def admissible_friction(self, friction_limit: Array) -> Array:
        """Return the friction (m, dim - 1) that the law gives for friction limits (m,).

        At nodes with prescribed slip, friction has the magnitude of the limit and opposes the slip.
        At all other nodes it is the trial friction, shortened to the limit where it is larger.
        Friction along `held_tangents_without_motion` is the present one, shortened to the part of
        the limit that the friction along all other tangents leaves.
        """
        slip_size = np.linalg.norm(self.slip, axis=1)
        against_slip = (
            -(friction_limit / np.where(self.has_prescribed_slip, slip_size, 1.0))[:, None]
            * self.slip
        )
        friction = shorten_vectors_to_max_length(friction_limit, self.trial_friction)
        if self.held_tangents_without_motion.any():
            remaining_limit = np.sqrt(
                np.maximum(0.0, friction_limit**2 - np.sum(friction**2, axis=1))
            )
            support_friction = np.where(self.held_tangents_without_motion, self.force[:, 1:], 0.0)
            friction += shorten_vectors_to_max_length(remaining_limit, support_friction)
        return np.where(self.has_prescribed_slip[:, None], against_slip, friction)

    @cached_property
    def active_set(self) -> ActiveSet:
        """Active set determined from gaps, slips and forces, without a previous active set."""
        return self._determine_active_set(np.zeros_like(self.slip))

    def next_active_set(self, previous: ActiveSet) -> ActiveSet:
        """Return the active set for the present gaps, slips and forces, and a previous active set.

        Nodes whose trial friction has reversed relative to the previous active set stick.
        """
        return self._determine_active_set(previous.direction)

    def _determine_active_set(self, previous_friction_direction: Array) -> ActiveSet:
        p, s, limit = self.trial_pressure, self.trial_friction, self.friction_limits_and_slopes[0]
        size = np.linalg.norm(s, axis=1)
        slipping = (p > 0) & (size >= limit)
        slipping &= ~(np.sum(s * previous_friction_direction, axis=1) < 0)
        is_moved_by_support = self.has_prescribed_slip & (p > 0)
        slipping |= is_moved_by_support
        slip_size = np.linalg.norm(self.slip, axis=1)
        s = np.where(is_moved_by_support[:, None], -self.slip, s)
        size = np.where(is_moved_by_support, slip_size, size)
        has_direction = slipping & self.cone.has_friction
        status = np.where(p > 0, STICK, OPEN)
        status[slipping] = SLIP
        divisor = np.where(has_direction, size, 1.0)
        ratio = np.where(has_direction, limit / divisor, 0.0)
        is_iterated = self.held_tangents & self.is_coupled_to_surface[:, None]
        direction = np.where(has_direction, 1 / divisor, 0.0)[:, None] * s
        slope, intercept = linearise_friction_limits(
            np.maximum(0.0, p), self.friction_limits_and_slopes, direction
        )
        return ActiveSet(
            status.astype(np.int8),
            direction,
            np.where(is_moved_by_support, 0.0, ratio),
            slope,
            intercept,
            friction_per_slip=np.where(is_moved_by_support, ratio, 0.0),
            support_friction=np.where(is_iterated, self.force[:, 1:], 0.0),
            support_slip=np.where(is_iterated, self.slip, 0.0),
        )

    def find_touching_points(self, force_tolerance: float) -> Mask:
        """Return a mask (m,) of the points that touch their surfaces.

        Args:
            force_tolerance: largest product of a gap and the stiffness of the law, and largest
                force, that counts as zero.
        """
        return np.asarray(self.trial_pressure >= -force_tolerance)

    def updated_law_history(self, start_history: Array) -> Array:
        """Return the history (m, n_history) of interface laws at the end of the increment.

        Without interface laws it is `start_history` (m, n_history), that at the start.
        """
        return start_history

    def law_violation(self) -> Array:
        """Return the violation (m, dim) of the contact law as forces, which are zero at a solution.

        The normal component is the normal force minus the positive part of the trial pressure. The
        tangential components are the friction minus `admissible_friction`.
        """
        normal = self.force[:, :1] - np.maximum(0.0, self.trial_pressure)[:, None]
        tangential = self.force[:, 1:] - self.admissible_friction(
            self.friction_limits_and_slopes[0]
        )
        return np.hstack([normal, tangential])

    def friction_round_off(self, coordinate_round_off_force: float) -> Array:
        """Return the round-off (m,) of friction caused by the round-off of coordinates.

        Slips do not depend on coordinates, but the friction limit depends on the gap. At nodes
        whose normal force exceeds `coordinate_round_off_force`, the result is the effect of the gap
        on the limit. At other nodes it is `coordinate_round_off_force`.

        Args:
            coordinate_round_off_force: round-off of coordinates, converted to a force.
        """
        gap = np.where(np.isfinite(self.gap), np.abs(self.gap), 0.0)
        limit_round_off = self.friction_limits_and_slopes[1] * self.scale * gap
        is_pressed = self.force[:, 0] > coordinate_round_off_force
        return np.where(is_pressed, limit_round_off, coordinate_round_off_force)

    def relative_residuals(
        self, reference_force: float, reference_length: Array | float
    ) -> dict[str, Array]:
        """Return the relative violations (m,) of contact conditions, by fields of `Residuals`.

        Args:
            reference_force: force by which forces are divided.
            reference_length: length by which lengths are divided; one number, or (m,).
        """
        normal, tangential, gap = self.force[:, 0], self.force[:, 1:], self.gap
        limit, _ = self.cone.friction_limits_and_slopes(np.maximum(0.0, normal))
        sticks = (np.linalg.norm(self.trial_friction, axis=1) < limit) & ~self.has_prescribed_slip
        difference = np.abs(tangential - self.admissible_friction(limit)).max(axis=1, initial=0.0)
        slip_size = np.where(sticks, np.linalg.norm(self.slip, axis=1), 0.0)
        return {
            "penetration": np.maximum(0.0, -gap) / reference_length,
            "tension": np.maximum(0.0, -normal) / reference_force,
            "complementarity": np.maximum(
                0.0, np.minimum(normal / reference_force, gap / reference_length)
            ),
            "cone": np.maximum(0.0, np.linalg.norm(tangential, axis=1) - limit) / reference_force,
            "stick": slip_size / reference_length,
            "direction": np.where(sticks, 0.0, difference) / reference_force,
        }


def shorten_vectors_to_max_length(max_length: Array, vectors: Array) -> Array:
    """Return vectors (m, dim - 1), shortened where they are longer than `max_length` (m,)."""
    size = np.linalg.norm(vectors, axis=1)
    is_longer = size > max_length
    factor = np.where(is_longer, max_length / np.where(is_longer, size, 1.0), 1.0)
    return np.asarray(factor[:, None] * vectors)


def assemble_active_set_equations(
    active: ActiveSet, law_scale: Array
) -> tuple[Array, Array, Array]:
    """Return the linear equations A r + B (g; v) = b of an active set in the frames of the nodes.

    The unknowns of each node are its force r, gap g and slip v.

    Args:
        active: active set.
        law_scale: (m,), factor c of gaps and slips in the contact law, a force per length.

    Returns:
        A (m, dim, dim), B (m, dim, dim) and b (m, dim).
    """
    m, n_tangents = active.direction.shape
    A, B = np.zeros((2, m, n_tangents + 1, n_tangents + 1))
    b = np.zeros((m, n_tangents + 1))
    identity = np.eye(n_tangents + 1)
    A[active.status == OPEN] = identity

    stick = active.status == STICK
    B[stick] = law_scale[stick, None, None] * identity

    slip = active.status == SLIP
    d, c = active.direction[slip], law_scale[slip]
    projector = identity[1:, 1:] - d[:, :, None] * d[:, None, :]
    M = active.friction_ratio[slip, None, None] * projector
    B[slip, 0, 0] = c
    A[slip, 1:, 0] = -active.limit_slope[slip, None] * d
    A[slip, 1:, 1:] = identity[1:, 1:] - M
    B[slip, 1:, 1:] = c[:, None, None] * M + active.friction_per_slip[slip, None, None] * projector
    b[:, 1:] = active.limit_intercept[:, None] * active.direction
    if (law := active.interface_law) is not None:
        A[law.at_law] = identity - law.by_force[law.at_law]
        B[law.at_law] = -law.by_motion[law.at_law]
        b[law.at_law] = law.intercept[law.at_law]
    return A, B, b


def keep_friction_of_previous_iteration(
    active: ActiveSet, law_scale: Array, weight: Array, friction: Array
) -> tuple[Array, Array, Array]:
    """Return the linear equations of an active set that determine friction where slip does not.

    At a node that belongs to several pairs, gaps that are zero may determine the slip. The equation
    of sticking points, c v = 0, is then redundant and their friction is not determined. It is
    replaced by c v + w (r_t - s) = 0 with the friction s of the previous iteration and a small
    weight w (method of multipliers). If slip is free, it tends to zero in the iteration. If it is
    not, friction is kept where there is no slip, and grows against slip until the node slips. At
    slipping points, the friction ratio M is limited for the same reason.

    Args:
        active: active set.
        law_scale: (m,), factor c of gaps and slips in the contact law, a force per length.
        weight: (m,), weights w; the equations of points with the weight 0 do not change.
        friction: (m, dim - 1), friction s of the previous iteration.

    Returns:
        A (m, dim, dim), B (m, dim, dim) and b (m, dim) of `assemble_active_set_equations`.
    """
    is_kept, max_ratio = weight > 0, 1 - MIN_KEPT_FRICTION_WEIGHT
    ratio = np.where(is_kept, np.minimum(active.friction_ratio, max_ratio), active.friction_ratio)
    A, B, b = assemble_active_set_equations(replace(active, friction_ratio=ratio), law_scale)
    sticks = is_kept & (active.status == STICK)
    A[sticks, 1:, 1:] = weight[sticks, None, None] * np.eye(friction.shape[1])
    b[sticks, 1:] = weight[sticks, None] * friction[sticks]
    return A, B, b


@dataclass(frozen=True)
class LinearisedContactLaw:
    """Linearised contact law E r + C v - D q = c of the contact points (m) of this process.

    The unknowns are the contact forces r, the motions v of the points and the motions q of their
    surfaces.

    Args:
        E: (m, dim, dim), coefficients of the forces in global components.
        C: (m, dim, p), coefficients of the p motions of each point.
        D: (m, dim, k), coefficients of the k motions of each point's surface, which are
            translations and, if surfaces may rotate, an angle.
        c: (m, dim), right-hand side.
    """

    E: Array
    C: Array
    D: Array
    c: Array


def eliminate_known_motions(
    law: LinearisedContactLaw, known_q: Array, known_v: Array
) -> LinearisedContactLaw:
    """Return the law with the known parts of the motions moved to the right-hand side.

    Args:
        law: law for the whole motions.
        known_q: (m, k), known parts of the motions of each point's surface.
        known_v: (m, p), known parts of the motions of the points.
    """
    change = np.einsum("nij,nj->ni", law.D, known_q)
    change -= np.einsum("nij,nj->ni", law.C, known_v)
    return replace(law, c=law.c + change)


@dataclass(frozen=True)
class TorqueMap:
    """Map from point forces r (m, dim) to forces and torques on the surfaces.

    The torque on a surface that may rotate changes with the lever arms. For displacements a of the
    points and translations U of the surfaces, forces and torques linearised about a_0 and U_0 are

        V^T r - w·(a - U - d_0) e,    d_0 = a_0 - U_0,

    where e is the unit vector of the torque's component.

    Args:
        V: (m, dim, k), derivative of the displacements of points that move with their surface, with
            respect to the motions of the surface.
        w: (m, dim), derivative of forces that rotate with the surface, with respect to the angle.
        d0: (m, dim), displacements a_0 - U_0 relative to the translation of the surface.
    """

    V: Array
    w: Array
    d0: Array

    @classmethod
    def without_rotation(cls, n_points: int, dim: int) -> "TorqueMap":
        """Return the map for points on surfaces that do not rotate, in `dim` dimensions."""
        return cls(
            np.broadcast_to(np.eye(dim), (n_points, dim, dim)), *np.zeros((2, n_points, dim))
        )

    def compute_force_and_torque_of_each_point(self, point_forces: Array) -> Array:
        """Return the forces and torques (m, k) on surfaces due to forces (m, dim) on the points."""
        return np.einsum("nak,na->nk", self.V, point_forces)

    def eliminate_known_motions(self, known_q: Array, known_v: Array) -> "TorqueMap":
        """Return the map for the unknown parts of motions, given the known parts.

        Args:
            known_q: (m, k), known parts of the motions of each point's surface.
            known_v: (m, dim), known parts of the displacements of the points.
        """
        return replace(self, d0=self.d0 + known_q[:, : known_v.shape[1]] - known_v)


@dataclass(frozen=True)
class LinearisedKinematics:
    """First-order expansion of gap, slip and contact force about a state.

    For motions v of the points, motions q of the surfaces and contact forces r, with the index 0
    for values at the state,

        (gap; slip) = (gap_0; slip_0) + motion_by_v (v - v_0) + motion_by_q (q - q_0),
        force       = frame_0 r       + force_by_v (v - v_0)  + force_by_q (q - q_0).

    Args:
        pair: (m,), index of the contact pair of each point.
        torque_map: map from point forces to forces and torques on the surfaces.
        v0: (m, p), motions of the points at the state.
        q0: (pairs, k), motions of the surfaces at the state.
        frame: (m, dim, dim), normals and tangents at the state, as rows.
        gap: (m,), gaps at the state, infinite where no surface faces a point.
        slip: (m, dim - 1), slips at the state.
        motion_by_v: (m, dim, p), derivative of gap and slip with respect to v.
        motion_by_q: (m, dim, k), derivative of gap and slip with respect to q.
        force_by_v: (m, dim, p), derivative of the force components with respect to v.
        force_by_q: (m, dim, k), derivative of the force components with respect to q.
        held_tangents: (m, dim - 1), mask of the tangents with friction along which supports hold a
            point.
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

    def evaluate_contact_nodes(
        self, v: Array, q: Array, force: Array, *, cone: FrictionCone, law_scale: Array
    ) -> ContactNodes:
        """Return gap, slip and force of the contact nodes at given motions and forces.

        Args:
            v: (m, p), motions of the points.
            q: (pairs, k), motions of the surfaces.
            force: (m, dim), contact forces in global components.
            cone: friction laws of the points.
            law_scale: (m,), factor c of gaps and slips in the contact law, a force per length.
        """
        dv, dq = v - self.v0, (q - self.q0)[self.pair]

        def first_order_change(derivative_by_v: Array, derivative_by_q: Array) -> Array:
            return np.asarray(
                np.einsum("nab,nb->na", derivative_by_v, dv)
                + np.einsum("nab,nb->na", derivative_by_q, dq)
            )

        motion = first_order_change(self.motion_by_v, self.motion_by_q)
        components = first_order_change(self.force_by_v, self.force_by_q)
        components += np.einsum("nab,nb->na", self.frame, force)
        no_nodes = np.zeros(len(self.gap), dtype=bool)
        return ContactNodes(
            frame=self.frame,
            gap=self.gap + motion[:, 0],
            slip=self.slip + motion[:, 1:],
            force=components,
            cone=cone,
            scale=law_scale,
            held_tangents=self.held_tangents,
            has_prescribed_slip=no_nodes,
            is_coupled_to_surface=no_nodes,
        )

    def linearise_law(
        self,
        active: ActiveSet,
        law_scale: Array,
        friction_to_keep: tuple[Array, Array] | None = None,
    ) -> LinearisedContactLaw:
        """Return the linearised law of an active set in global components.

        Args:
            active: active set.
            law_scale: (m,), factor c of gaps and slips in the contact law, a force per length.
            friction_to_keep: weights (m,) with which the friction of the previous iteration is kept
                as far as slip allows, and this friction (m, dim), see
                `keep_friction_of_previous_iteration`. None if there are no such points.
        """
        if friction_to_keep is None:
            A, B, b = assemble_active_set_equations(active, law_scale)
        else:
            weight, friction = friction_to_keep
            components = np.einsum("nta,na->nt", self.frame[:, 1:], friction)
            A, B, b = keep_friction_of_previous_iteration(active, law_scale, weight, components)
        b = b - np.einsum("nab,nb->na", A[:, :, 1:], active.support_friction)
        stated_frame = self.frame.copy()
        stated_frame[:, 1:][self.held_tangents] = 0.0
        C = A @ self.force_by_v + B @ self.motion_by_v
        D = -(A @ self.force_by_q + B @ self.motion_by_q)
        gap = np.where(np.isfinite(self.gap), self.gap, 0.0)
        motion = np.concatenate([gap[:, None], self.slip], axis=1)
        offset = np.einsum("nab,nb->na", C, self.v0) - np.einsum("nab,nb->na", B, motion)
        c = b + (offset - np.einsum("nab,nb->na", D, self.q0[self.pair]))
        to_global = np.swapaxes(stated_frame, 1, 2)
        E, C, D, c = (to_global @ part for part in (A @ stated_frame, C, D, c[:, :, None]))
        return LinearisedContactLaw(E, C, D, c[:, :, 0])
