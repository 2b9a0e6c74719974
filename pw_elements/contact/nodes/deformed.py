"""Gap, slip and frame of a deformed body at rigid surfaces that move and turn.

The guide's page on theory has the kinematics ("Large strains"). The module guarantees derivatives
of gap, slip and force by motions of points and surfaces, and assumes surfaces that know their
closest points, as `ContactProblem.of_residual` checks.
"""

from collections.abc import Sequence
from typing import ClassVar, Protocol

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import N_PATH_PIECES, RIGID, Interface, SlidingReference
from pw_elements.contact.model import ContactPair
from pw_elements.contact.nodes.nodes import (
    LinearisedKinematics,
    TorqueMap,
    add_tangents_along_supports,
    find_held_tangents,
    make_frames,
)
from pw_elements.contact.nodes.undeformed import IncrementStart

# Below this s the arc's factor is as exact by its series as by its formula
_SMALL_S = 1e-3
# s of normals at a right angle, beyond which a point has jumped; the largest s that `_arc` is given
_RIGHT_ANGLE_S, _MAX_S = np.sqrt(0.5), 0.99
# Shares of a point's path at which it is looked for inside the surface
_PATH_SAMPLES = np.linspace(0.05, 0.95, 19)


class RigidSurfaceMotion:
    """Motion of the surfaces of all pairs by q, (pairs, dim + 1): translations, then the angle."""

    def __init__(self, interface: Interface, pairs: Sequence[ContactPair]) -> None:
        self._pair, dim = interface.pair, interface.position.shape[1]
        self._pivots = [pair.pivot_and_spin(dim) for pair in pairs]
        pivots, spins = zip(*self._pivots, strict=True)
        self._from_pivot = interface.position - np.array(pivots)[self._pair]
        self._spin = np.array(spins)[self._pair]  # J v = w x v, (m, dim, dim)

    def rotation_change(self, q: Array) -> Array:
        """R - I, (m, dim, dim)."""
        angle, J = q[self._pair, -1, None, None], self._spin
        return np.asarray(np.sin(angle) * J + 2 * np.sin(angle / 2) ** 2 * J @ J)

    def motion_in_surface_frame(self, q: Array, displacement: Array) -> Array:
        """Y - X, (m, dim), of points with displacements a (m, dim) in their surface's frame."""
        relative = displacement - q[self._pair, :-1]
        turned = np.einsum("nba,nb->na", self.rotation_change(q), relative + self._from_pivot)
        return relative + turned

    def positions_in_surface_frame(self, pair: int, q: Array, x: Array) -> Array:
        """Return positions (n, dim) of any points in the frame of a pair's surface at its start."""
        dim = x.shape[1]
        pivot, J = self._pivots[pair]
        angle = q[dim]
        R = np.eye(dim) + np.sin(angle) * J + 2 * np.sin(angle / 2) ** 2 * J @ J
        return np.asarray(pivot + (x - q[:dim] - pivot) @ R)

    def displacement_of(self, q: Array, motion: Array) -> Array:
        """Displacements (m, dim) of points with motions y - X (m, dim) in their surface's frame."""
        turned = np.einsum("nab,nb->na", self.rotation_change(q), motion + self._from_pivot)
        return motion + turned + q[self._pair, :-1]

    def torque_map(self, q: Array, displacement: Array, force: Array) -> TorqueMap:
        """Return the map of points with displacements a (m, dim) under forces (m, dim)."""
        relative, J = displacement - q[self._pair, :-1], self._spin
        arm = np.einsum("nab,nb->na", J, self._from_pivot + relative)
        identity = np.broadcast_to(np.eye(J.shape[1]), J.shape)
        V = np.concatenate([identity, arm[:, :, None]], axis=2)
        return TorqueMap(V, np.einsum("nab,nb->na", J, force), relative)


class PairKinematics(Protocol):
    """Kinematics of some of the pairs, beside those of rigid surfaces."""

    def fill_pairs(self, kinematics: LinearisedKinematics, force: Array) -> LinearisedKinematics:
        """Return kinematics with the points of these pairs filled in, under forces (m, dim)."""

    def fill_path_slip(self, slip: Array) -> Array:
        """Return slips (m, dim) along the path with those of these pairs filled in."""

    @property
    def sides(self) -> dict[int, tuple[SlidingReference, Array]]:
        """Reference state and positions (nodes, dim) of both sides of each of these pairs."""


class RigidSurfacesOnly:
    """No pairs besides those of rigid surfaces."""

    sides: ClassVar[dict[int, tuple[SlidingReference, Array]]] = {}

    def fill_pairs(self, kinematics: LinearisedKinematics, force: Array) -> LinearisedKinematics:  # noqa: ARG002
        return kinematics

    def fill_path_slip(self, slip: Array) -> Array:
        return slip


class DeformedKinematics:
    """Kinematics of a deformed body since an increment's start, linearised at each iterate.

    Args:
        interface: the contact points.
        surfaces: their motion.
        start: of the increment.
        deformable_pairs: the pairs of two bodies.
    """

    def __init__(
        self,
        interface: Interface,
        surfaces: RigidSurfaceMotion,
        start: IncrementStart,
        deformable_pairs: PairKinematics,
    ) -> None:
        self._interface, self._surfaces = interface, surfaces
        self._start, self._deformable_pairs = start, deformable_pairs
        self._motion0 = surfaces.motion_in_surface_frame(start.q, start.displacement)
        gap, self._normal0, self._curvature0 = interface.closest(self._motion0)
        # slip of what faces nothing at first counts from where it is then, as along its surface
        self._faced0 = np.isfinite(gap)
        self._gap0 = np.where(self._faced0, gap, 0.0)
        self._point0 = interface.position + self._motion0 - self._gap0[:, None] * self._normal0

    @property
    def sides(self) -> dict[int, tuple[SlidingReference, Array]]:
        """Reference state and positions (nodes, dim) of both sides of each pair of bodies."""
        return self._deformable_pairs.sides

    def carry_closed(self, q: Array, displacement: Array, closed: Mask) -> Array:
        """Return displacements (m, dim) where `closed` points (m,) move with their surfaces."""
        carried = self._surfaces.displacement_of(q, self._motion0)
        return np.where(closed[:, None], carried, displacement)

    def evaluate_iterate(
        self,
        before: LinearisedKinematics,  # noqa: ARG002
        q: Array,
        displacement: Array,
        force: Array,
    ) -> tuple[LinearisedKinematics, Array]:
        kinematics = self.linearise(q, displacement, force)
        return kinematics, kinematics.v0

    def evaluate_solution(
        self,
        before: LinearisedKinematics,
        q: Array,  # noqa: ARG002
        displacement: Array,  # noqa: ARG002
        force: Array,  # noqa: ARG002
    ) -> LinearisedKinematics:
        return before

    def linearise(self, q: Array, displacement: Array, force: Array) -> LinearisedKinematics:
        """Linearise at motions q (pairs, dim + 1), displacements and forces (m, dim)."""
        interface, surfaces = self._interface, self._surfaces
        motion = surfaces.motion_in_surface_frame(q, displacement)
        R = np.eye(force.shape[1]) + surfaces.rotation_change(q)
        gap, normal, curvature = interface.closest(motion)
        held = interface.held_components
        frame = make_frames(np.einsum("nab,nb->na", R, normal), interface.equation >= 0)
        frame = add_tangents_along_supports(frame, held)
        torque_map = surfaces.torque_map(q, displacement, force)
        force = np.where(held, 0.0, force)
        tangents = frame[:, 1:] @ R
        tangent_change = tangents @ curvature  # t·N
        depth = np.where(np.isfinite(gap), gap, 0.0)  # of what faces nothing and bears no force
        chord = interface.position + motion - depth[:, None] * normal - self._point0
        normal0 = self._normals_at_start(normal, gap)
        s = np.linalg.norm(normal - normal0, axis=1) / 2
        factor, factor_slope = _arc(np.minimum(s, _MAX_S))
        tangential_chord = np.einsum("nta,na->nt", tangents, chord)
        normal_chord = np.sum(normal * chord, axis=1)
        s_change = np.einsum("na,nab->nb", normal0, curvature) / 4
        slip_by_v = factor[:, None, None] * (
            tangents - (depth + normal_chord)[:, None, None] * tangent_change
        )
        slip_by_v -= (factor_slope[:, None] * tangential_chord)[:, :, None] * s_change[:, None]
        normal_force, R_inverse = np.sum(frame[:, 0] * force, axis=1), np.swapaxes(R, 1, 2)
        normal_force_by_v = np.einsum("na,nab->nb", force, R @ curvature)[:, None]
        tangential_force_by_v = -normal_force[:, None, None] * tangent_change
        motion_by_v = np.concatenate([normal[:, None], slip_by_v], axis=1) @ R_inverse
        force_by_v = np.concatenate([normal_force_by_v, tangential_force_by_v], axis=1) @ R_inverse
        is_rigid = (interface.faced == RIGID)[:, None, None]
        motion_by_q, force_by_q = (
            np.where(is_rigid, -part @ torque_map.V, 0.0) for part in (motion_by_v, force_by_v)
        )
        force_by_q[:, :, -1] -= np.einsum("nab,nb->na", frame, torque_map.w)
        kinematics = LinearisedKinematics(
            pair=interface.pair,
            torque_map=torque_map,
            v0=displacement,
            q0=q,
            frame=frame,
            gap=gap,
            slip=factor[:, None] * tangential_chord,
            motion_by_v=motion_by_v,
            motion_by_q=motion_by_q,
            force_by_v=force_by_v,
            force_by_q=force_by_q,
            held_tangents=find_held_tangents(frame, held),
        )
        return self._deformable_pairs.fill_pairs(kinematics, force)

    def check_surfaces(self, kinematics: LinearisedKinematics, pressed: Mask) -> None:
        """Raise ValueError where differences contradict a surface at `pressed` (m,) nodes."""
        self._interface.check_closest(self._motion_at(kinematics), pressed)

    def slip_by_start(self, kinematics: LinearisedKinematics) -> Array:
        """Derivatives (m, dim - 1, dim) of the slip by the motions at the increment's start."""
        normal, tangents = kinematics.frame[:, 0], kinematics.frame[:, 1:]
        normal0 = self._normals_at_start(normal, kinematics.gap)
        s = np.linalg.norm(normal - normal0, axis=1) / 2
        factor, factor_slope = _arc(np.minimum(s, _MAX_S))
        across = self._normal0[:, :, None] * self._normal0[:, None, :]
        point_by_v = np.eye(normal.shape[1]) - np.where(self._faced0[:, None, None], across, 0.0)
        point_by_v -= self._gap0[:, None, None] * self._curvature0  # of the closest point there
        s_change = np.einsum("na,nab->nb", normal, self._curvature0) / 4
        by_factor = (factor_slope / factor)[:, None, None] * kinematics.slip[:, :, None]
        return -factor[:, None, None] * (tangents @ point_by_v) - by_factor * s_change[:, None]

    def integrate_slip(self, q: Array, displacement: Array, normal: Array) -> Array:
        """Return slip (m, dim) on the straight path to q (pairs, dim + 1) and displacements.

        In the frame of a surface, closest points go along it in `N_PATH_PIECES` chords. Vectors in
        its tangent plane turn as the normal does, about an axis at right angles to it.
        """
        interface, surfaces, start = self._interface, self._surfaces, self._start
        normal, point, slip = self._normal0, self._point0, np.zeros_like(displacement)
        for share in np.arange(1, N_PATH_PIECES + 1) / N_PATH_PIECES:
            motion = surfaces.motion_in_surface_frame(
                (1 - share) * start.q + share * q,
                (1 - share) * start.displacement + share * displacement,
            )
            gap, next_normal, _ = interface.look_for_closest(motion)
            is_faced = np.isfinite(gap)[:, None]  # others are left out
            next_normal = np.where(is_faced, next_normal, normal)
            depth = np.where(is_faced[:, 0], gap, 0.0)
            on_surface = interface.position + motion - depth[:, None] * next_normal
            next_point = np.where(is_faced, on_surface, point)
            middle = normal + next_normal
            middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), _SMALL_S)
            chord = next_point - point
            chord -= np.sum(chord * middle, axis=1, keepdims=True) * middle
            slip = _turn_with_normal(slip, normal, next_normal)
            slip += _turn_with_normal(chord, middle, next_normal)
            normal, point = next_normal, next_point
        slip += np.einsum("nab,nb->na", surfaces.rotation_change(q), slip)
        return self._deformable_pairs.fill_path_slip(slip)

    def find_jumped(self, kinematics: LinearisedKinematics, pressed: Mask) -> Mask:
        """Return points (m,) with normals turned by a right angle, pressed or past the surface."""
        interface = self._interface
        end = self._motion_at(kinematics)
        gap, normal, _ = interface.closest(end)
        normal_change = np.linalg.norm(normal - self._normals_at_start(normal, gap), axis=1)
        jumped = normal_change > 2 * _RIGHT_ANGLE_S
        if len(interface.gathered(jumped[jumped])):
            for share in _PATH_SAMPLES:
                motion = (1 - share) * self._motion0 + share * end
                pressed = pressed | (interface.closest(motion)[0] < 0)
        return jumped & pressed

    def _motion_at(self, kinematics: LinearisedKinematics) -> Array:
        """Y - X, (m, dim), where kinematics have been linearised."""
        displacement = kinematics.v0[:, : self._motion0.shape[1]]
        return self._surfaces.motion_in_surface_frame(kinematics.q0, displacement)

    def _normals_at_start(self, normal: Array, gap: Array) -> Array:
        """Normals (m, dim) at the start, those given where nothing faces a point then or now."""
        return np.where((self._faced0 & np.isfinite(gap))[:, None], self._normal0, normal)


def _turn_with_normal(vectors: Array, normal: Array, next_normal: Array) -> Array:
    """Return tangential vectors (m, dim), turned as unit normals turn from one to the next."""
    cosine = 1 + np.sum(normal * next_normal, axis=1, keepdims=True)
    ahead = np.sum(vectors * next_normal, axis=1, keepdims=True)
    return vectors - ahead / np.maximum(cosine, _SMALL_S) * (normal + next_normal)


def _arc(s: Array) -> tuple[Array, Array]:
    """Return arcs over the chords' tangential parts (m,), and their derivatives by s over s."""
    large = np.where(s < _SMALL_S, 0.5, s)
    w, angle = np.sqrt(1 - large**2), np.arcsin(large)
    slope = (large - angle * (1 - 2 * large**2) / w) / (large**3 * w**2)
    small = s < _SMALL_S
    return (
        np.where(small, 1 + 2 * s**2 / 3, angle / (large * w)),
        np.where(small, 4 / 3 + 32 * s**2 / 15, slope),
    )
