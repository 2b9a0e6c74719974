"""Gap, slip and frame of a deformed body at rigid surfaces that translate and rotate.

The theory page derives the kinematics ("Large strains"). The module guarantees first derivatives of
gap, slip and force with respect to the motions of points and surfaces. It assumes surfaces with a
method `gap_normal_and_curvature`, which `ContactProblem.of_residual` checks.
"""

from collections.abc import Sequence
from typing import ClassVar, Protocol

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import (
    FACED_INDEX_OF_RIGID_SURFACE,
    N_SLIP_PATH_PIECES,
    ContactInterface,
    MortarSlipReference,
    check_user_surface_derivatives,
    rotate_with_normal,
)
from pw_elements.contact.model import ContactPair
from pw_elements.contact.nodes.frames import (
    add_tangents_along_supports,
    find_held_tangents,
    make_frames,
)
from pw_elements.contact.nodes.nodes import (
    LinearisedKinematics,
    TorqueMap,
)
from pw_elements.contact.nodes.undeformed import IncrementStart

# In the following, s is half the length of the difference between two unit normals.
# Largest s at which the ratio of arc to chord is computed by its series
_MAX_HALF_NORMAL_CHANGE_FOR_SERIES = 1e-3
# Smallest divisor when vectors are normalised
_MIN_NORMALISATION_DIVISOR = 1e-3
# s of perpendicular normals, above which a point has jumped; largest argument of
# `_arc_to_chord_ratios_and_slopes`
_HALF_NORMAL_CHANGE_AT_RIGHT_ANGLE, _MAX_HALF_NORMAL_CHANGE = np.sqrt(0.5), 0.99
# Fractions of a point's path at which penetration of the surface is checked
_PENETRATION_CHECK_PATH_FRACTIONS = np.linspace(0.05, 0.95, 19)


class RigidSurfaceMotion:
    """Rigid motion of the surfaces of all pairs.

    The motions q (pairs, dim + 1) of the surfaces are their translations and angles.

    Args:
        interface: contact points (m) of all pairs.
        pairs: contact pairs, which define pivots and axes of rotation.
    """

    def __init__(self, interface: ContactInterface, pairs: Sequence[ContactPair]) -> None:
        self._pair, dim = interface.pair, interface.position.shape[1]
        self._pivots = [pair.pivot_and_spin_matrix(dim) for pair in pairs]
        pivots, spins = zip(*self._pivots, strict=True)
        self._from_pivot = interface.position - np.array(pivots)[self._pair]
        self._spin = np.array(spins)[self._pair]  # J v = w x v with the axis w, (m, dim, dim)

    def rotation_minus_identity(self, q: Array) -> Array:
        """Return R - I (m, dim, dim), where R is the rotation matrix of each point's surface."""
        angle, J = q[self._pair, -1, None, None], self._spin
        return np.asarray(np.sin(angle) * J + 2 * np.sin(angle / 2) ** 2 * J @ J)

    def motion_in_surface_frame(self, q: Array, displacement: Array) -> Array:
        """Return the motions (m, dim) of points in the frames of their surfaces.

        A motion is the difference between a point's position in the moving frame of its surface and
        its undeformed position.

        Args:
            q: (pairs, dim + 1), motions of the surfaces.
            displacement: (m, dim), displacements of the points.
        """
        relative = displacement - q[self._pair, :-1]
        from_pivot = relative + self._from_pivot
        return relative + np.einsum("nba,nb->na", self.rotation_minus_identity(q), from_pivot)

    def positions_in_surface_frame(self, pair_index: int, q: Array, x: Array) -> Array:
        """Return the positions of points x (n, dim) in the moving frame of a pair's rigid surface.

        Args:
            pair_index: index of the pair.
            q: (dim + 1,), motion of the surface of this pair.
            x: (n, dim), positions of the points in the fixed frame.
        """
        dim = x.shape[1]
        pivot, J = self._pivots[pair_index]
        angle = q[dim]
        R = np.eye(dim) + np.sin(angle) * J + 2 * np.sin(angle / 2) ** 2 * J @ J
        return np.asarray(pivot + (x - q[:dim] - pivot) @ R)

    def displacement_from_surface_frame(self, q: Array, motion: Array) -> Array:
        """Return the displacements (m, dim) of points with given motions in surface frames.

        This is the inverse of `motion_in_surface_frame`.

        Args:
            q: (pairs, dim + 1), motions of the surfaces.
            motion: (m, dim), motions of the points in the frames of their surfaces.
        """
        from_pivot = motion + self._from_pivot
        rotation = np.einsum("nab,nb->na", self.rotation_minus_identity(q), from_pivot)
        return motion + rotation + q[self._pair, :-1]

    def linearise_torque_map(self, q: Array, displacement: Array, force: Array) -> TorqueMap:
        """Return the map from point forces to surface forces and torques, linearised at a state.

        Args:
            q: (pairs, dim + 1), motions of the surfaces.
            displacement: (m, dim), displacements of the points.
            force: (m, dim), forces on the points.
        """
        relative, J = displacement - q[self._pair, :-1], self._spin
        arm = np.einsum("nab,nb->na", J, self._from_pivot + relative)
        identity = np.broadcast_to(np.eye(J.shape[1]), J.shape)
        V = np.concatenate([identity, arm[:, :, None]], axis=2)
        return TorqueMap(V, np.einsum("nab,nb->na", J, force), relative)


class DeformablePairKinematics(Protocol):
    """Kinematics of the pairs of two bodies. All other pairs have rigid surfaces."""

    def fill_in_deformable_pairs(
        self, kinematics: LinearisedKinematics, force: Array
    ) -> LinearisedKinematics:
        """Return a copy of `kinematics` with the values of pairs of two bodies filled in.

        These values are linearised at the contact forces `force` (m, dim) on the points.
        """

    def fill_in_path_slip_of_deformable_pairs(self, slip: Array) -> Array:
        """Return path slips (m, dim) with the values of pairs of two bodies filled in."""

    @property
    def slip_references_and_positions(self) -> dict[int, tuple[MortarSlipReference, Array]]:
        """For each pair of two bodies, by index: slip reference and node positions (nodes, dim)."""


class NoDeformablePairs:
    """`DeformablePairKinematics` for problems without pairs of two bodies."""

    slip_references_and_positions: ClassVar[dict[int, tuple[MortarSlipReference, Array]]] = {}

    def fill_in_deformable_pairs(
        self,
        kinematics: LinearisedKinematics,
        force: Array,  # noqa: ARG002
    ) -> LinearisedKinematics:
        return kinematics

    def fill_in_path_slip_of_deformable_pairs(self, slip: Array) -> Array:
        return slip


class LargeStrainKinematics:
    """Kinematics at large strains since the start of an increment, linearised at each iterate.

    Args:
        interface: contact points (m) of all pairs.
        surfaces: rigid motion of the surfaces.
        start: state at the start of the increment.
        deformable_pairs: kinematics of the pairs of two bodies.
    """

    def __init__(
        self,
        interface: ContactInterface,
        surfaces: RigidSurfaceMotion,
        start: IncrementStart,
        deformable_pairs: DeformablePairKinematics,
    ) -> None:
        self._interface, self._surfaces = interface, surfaces
        self._start, self._deformable_pairs = start, deformable_pairs
        self._motion0 = surfaces.motion_in_surface_frame(start.q, start.displacement)
        gap, self._normal0, self._curvature0 = interface.evaluate_gaps_normals_and_curvatures(
            self._motion0
        )
        # slip of points that no surface faces at the start is measured from their start position
        self._faced0 = np.isfinite(gap)
        self._gap0 = np.where(self._faced0, gap, 0.0)
        self._point0 = interface.position + self._motion0 - self._gap0[:, None] * self._normal0

    @property
    def slip_references_and_positions(self) -> dict[int, tuple[MortarSlipReference, Array]]:
        """For each pair of two bodies, by index: slip reference and node positions (nodes, dim)."""
        return self._deformable_pairs.slip_references_and_positions

    def move_closed_points_with_surfaces(
        self, q: Array, displacement: Array, closed: Mask
    ) -> Array:
        """Return displacements (m, dim) with closed points moved rigidly with their surfaces.

        Args:
            q: (pairs, dim + 1), motions of the surfaces.
            displacement: (m, dim), displacements of all other points.
            closed: (m,), mask of the closed points.
        """
        rigid = self._surfaces.displacement_from_surface_frame(q, self._motion0)
        return np.where(closed[:, None], rigid, displacement)

    def kinematics_and_point_motions_at_iterate(
        self,
        previous: LinearisedKinematics,  # noqa: ARG002
        q: Array,
        displacement: Array,
        force: Array,
    ) -> tuple[LinearisedKinematics, Array]:
        kinematics = self.linearise(q, displacement, force)
        return kinematics, kinematics.v0

    def relinearise_at_solution_if_needed(
        self,
        previous: LinearisedKinematics,
        q: Array,  # noqa: ARG002
        displacement: Array,  # noqa: ARG002
        force: Array,  # noqa: ARG002
    ) -> LinearisedKinematics:
        return previous

    def linearise(self, q: Array, displacement: Array, force: Array) -> LinearisedKinematics:
        """Return the kinematics linearised at a state.

        Args:
            q: (pairs, dim + 1), motions of the surfaces.
            displacement: (m, dim), displacements of the points.
            force: (m, dim), forces on the points.
        """
        interface, surfaces = self._interface, self._surfaces
        motion = surfaces.motion_in_surface_frame(q, displacement)
        R = np.eye(force.shape[1]) + surfaces.rotation_minus_identity(q)
        gap, normal, curvature = interface.evaluate_gaps_normals_and_curvatures(motion)
        held_components = interface.held_components
        frame = make_frames(np.einsum("nab,nb->na", R, normal), interface.equation >= 0)
        frame = add_tangents_along_supports(frame, held_components)
        torque_map = surfaces.linearise_torque_map(q, displacement, force)
        force = np.where(held_components, 0.0, force)
        tangents = frame[:, 1:] @ R
        tangent_change = tangents @ curvature  # t·N with the derivative N of the normal
        finite_gap = np.where(np.isfinite(gap), gap, 0.0)
        chord = interface.position + motion - finite_gap[:, None] * normal - self._point0
        normal0 = self._start_normals_or_current_if_not_faced(normal, gap)
        s = np.linalg.norm(normal - normal0, axis=1) / 2
        factor, factor_slope = _arc_to_chord_ratios_and_slopes(
            np.minimum(s, _MAX_HALF_NORMAL_CHANGE)
        )
        tangential_chord = np.einsum("nta,na->nt", tangents, chord)
        normal_chord = np.sum(normal * chord, axis=1)
        s_change = np.einsum("na,nab->nb", normal0, curvature) / 4
        slip_by_v = factor[:, None, None] * (
            tangents - (finite_gap + normal_chord)[:, None, None] * tangent_change
        )
        slip_by_v -= (factor_slope[:, None] * tangential_chord)[:, :, None] * s_change[:, None]
        normal_force, R_inverse = np.sum(frame[:, 0] * force, axis=1), np.swapaxes(R, 1, 2)
        normal_force_by_v = np.einsum("na,nab->nb", force, R @ curvature)[:, None]
        tangential_force_by_v = -normal_force[:, None, None] * tangent_change
        motion_by_v = np.concatenate([normal[:, None], slip_by_v], axis=1) @ R_inverse
        force_by_v = np.concatenate([normal_force_by_v, tangential_force_by_v], axis=1) @ R_inverse
        is_rigid = (interface.faced == FACED_INDEX_OF_RIGID_SURFACE)[:, None, None]
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
            held_tangents=find_held_tangents(frame, held_components),
        )
        return self._deformable_pairs.fill_in_deformable_pairs(kinematics, force)

    def check_surface_derivatives(self, kinematics: LinearisedKinematics, pressed: Mask) -> None:
        """Raise ValueError if finite differences contradict a surface's derivatives.

        They are compared at the points that the mask `pressed` (m,) selects.
        """
        check_user_surface_derivatives(
            self._interface, self._surface_frame_motion(kinematics), pressed
        )

    def differentiate_slip_by_start_displacement(self, kinematics: LinearisedKinematics) -> Array:
        """Return the derivatives of slips with respect to displacements at the increment's start.

        The result is an array (m, dim - 1, dim).
        """
        normal, tangents = kinematics.frame[:, 0], kinematics.frame[:, 1:]
        normal0 = self._start_normals_or_current_if_not_faced(normal, kinematics.gap)
        s = np.linalg.norm(normal - normal0, axis=1) / 2
        factor, factor_slope = _arc_to_chord_ratios_and_slopes(
            np.minimum(s, _MAX_HALF_NORMAL_CHANGE)
        )
        n_n = self._normal0[:, :, None] * self._normal0[:, None, :]
        # derivative of the closest point at the start of the increment
        point_by_v = np.eye(normal.shape[1]) - np.where(self._faced0[:, None, None], n_n, 0.0)
        point_by_v -= self._gap0[:, None, None] * self._curvature0
        s_change = np.einsum("na,nab->nb", normal, self._curvature0) / 4
        by_factor = (factor_slope / factor)[:, None, None] * kinematics.slip[:, :, None]
        return -factor[:, None, None] * (tangents @ point_by_v) - by_factor * s_change[:, None]

    def compute_slip_along_straight_path(
        self, q: Array, displacement: Array, normal: Array
    ) -> Array:
        """Return the slip (m, dim) along the straight path from the start of the increment.

        In the frame of a surface, the closest point of each contact point is followed along
        `N_SLIP_PATH_PIECES` chords. Tangential vectors are rotated with the normal.

        Args:
            q: (pairs, dim + 1), motions of the surfaces at the end.
            displacement: (m, dim), displacements of the points at the end.
            normal: not used here; an argument of all `ContactKinematics`.
        """
        interface, surfaces, start = self._interface, self._surfaces, self._start
        normal, point, slip = self._normal0, self._point0, np.zeros_like(displacement)
        for fraction in np.arange(1, N_SLIP_PATH_PIECES + 1) / N_SLIP_PATH_PIECES:
            motion = surfaces.motion_in_surface_frame(
                (1 - fraction) * start.q + fraction * q,
                (1 - fraction) * start.displacement + fraction * displacement,
            )
            gap, next_normal, _ = interface.evaluate_gaps_normals_and_curvatures_or_nan(motion)
            is_faced = np.isfinite(gap)[:, None]  # points that no surface faces do not slip
            next_normal = np.where(is_faced, next_normal, normal)
            finite_gap = np.where(is_faced[:, 0], gap, 0.0)
            on_surface = interface.position + motion - finite_gap[:, None] * next_normal
            next_point = np.where(is_faced, on_surface, point)
            mean_normal = normal + next_normal
            norm = np.linalg.norm(mean_normal, axis=1, keepdims=True)
            mean_normal /= np.maximum(norm, _MIN_NORMALISATION_DIVISOR)
            chord = next_point - point
            chord -= np.sum(chord * mean_normal, axis=1, keepdims=True) * mean_normal
            slip = rotate_with_normal(slip, normal, next_normal)
            slip += rotate_with_normal(chord, mean_normal, next_normal)
            normal, point = next_normal, next_point
        slip += np.einsum("nab,nb->na", surfaces.rotation_minus_identity(q), slip)
        return self._deformable_pairs.fill_in_path_slip_of_deformable_pairs(slip)

    def find_points_jumped_to_another_surface_part(
        self, kinematics: LinearisedKinematics, pressed: Mask
    ) -> Mask:
        """Return a mask (m,) of points that have jumped to another part of their surface.

        The normal at such a point has rotated by more than a right angle since the start of the
        increment. In addition, the point either is pressed at the state of `kinematics`, or has
        penetrated the surface on the straight path from the start.

        Args:
            kinematics: kinematics linearised at the state that is checked.
            pressed: (m,), mask of points with a contact force.
        """
        interface = self._interface
        end = self._surface_frame_motion(kinematics)
        gap, normal, _ = interface.evaluate_gaps_normals_and_curvatures(end)
        normal_change = np.linalg.norm(
            normal - self._start_normals_or_current_if_not_faced(normal, gap), axis=1
        )
        jumped = normal_change > 2 * _HALF_NORMAL_CHANGE_AT_RIGHT_ANGLE
        if len(interface.gather_values(jumped[jumped])):
            for fraction in _PENETRATION_CHECK_PATH_FRACTIONS:
                motion = (1 - fraction) * self._motion0 + fraction * end
                pressed = pressed | (interface.evaluate_gaps_normals_and_curvatures(motion)[0] < 0)
        return jumped & pressed

    def _surface_frame_motion(self, kinematics: LinearisedKinematics) -> Array:
        """Return the points' motions (m, dim) in surface frames at the state of `kinematics`."""
        displacement = kinematics.v0[:, : self._motion0.shape[1]]
        return self._surfaces.motion_in_surface_frame(kinematics.q0, displacement)

    def _start_normals_or_current_if_not_faced(
        self, current_normal: Array, current_gap: Array
    ) -> Array:
        """Return normals (m, dim) at the start of the increment, or current normals instead.

        The result is `current_normal` at points that no surface faced at the start, and at points
        that no surface faces now, where `current_gap` is infinite.
        """
        return np.where(
            (self._faced0 & np.isfinite(current_gap))[:, None], self._normal0, current_normal
        )


def _arc_to_chord_ratios_and_slopes(half_normal_change: Array) -> tuple[Array, Array]:
    """Return ratios (m,) of arcs to the tangential parts of their chords, and slopes (m,).

    Let s be half the length of the difference between the unit normals at both ends of an arc. The
    ratio is arcsin(s) / (s sqrt(1 - s^2)), and the slope is its derivative with respect to s,
    divided by s.
    """
    large = np.where(
        half_normal_change < _MAX_HALF_NORMAL_CHANGE_FOR_SERIES, 0.5, half_normal_change
    )
    w, angle = np.sqrt(1 - large**2), np.arcsin(large)
    slope = (large - angle * (1 - 2 * large**2) / w) / (large**3 * w**2)
    small = half_normal_change < _MAX_HALF_NORMAL_CHANGE_FOR_SERIES
    return (
        np.where(small, 1 + 2 * half_normal_change**2 / 3, angle / (large * w)),
        np.where(small, 4 / 3 + 32 * half_normal_change**2 / 15, slope),
    )
