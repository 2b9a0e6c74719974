"""Gap, slip and frame at small strains, evaluated at the undeformed positions of the points.

Against planes the kinematics are linear in displacements and translations. If a curved surface is
free to move, its normals change with its translation. Derivatives with respect to the translation
are then finite differences.

The module guarantees kinematics that depend on displacements linearly. It assumes surfaces that do
not rotate, and displacements that are small compared to the radii of the surfaces.
"""

from dataclasses import dataclass, field
from typing import Protocol

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import RELATIVE_COORDINATE_ROUND_OFF, ContactInterface
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes.frames import (
    add_tangents_along_supports,
    find_held_tangents,
    make_frames,
)
from pw_elements.contact.nodes.nodes import (
    LinearisedKinematics,
    TorqueMap,
)

# Step of finite differences along free translations, relative to the extent of the contact nodes
_TRANSLATION_DIFFERENCE_STEP_PER_CONTACT_EXTENT = 1e-4


@dataclass(frozen=True)
class IncrementStart:
    """State at the start of an increment, from which slip is measured.

    Args:
        displacement: displacements (m, dim) of the points.
        force: forces (m, dim) on the points.
        q: motions (pairs, k) of the surfaces, which are translations and, if surfaces may rotate,
            angles.
        history: history (m, n_history) of interface laws; (m, 0) if no pair has one.
    """

    displacement: Array
    force: Array
    q: Array
    history: Array = field(default_factory=lambda: np.empty((0, 0)))


def make_increment_start(
    state: ContactState, interface: ContactInterface, q: Array
) -> IncrementStart:
    """Return the start of an increment, with the values of a state at the points of this process.

    Args:
        state: state at the start of the increment.
        interface: contact points of all pairs.
        q: motions (pairs, k) of the surfaces in this state.
    """
    displacement, force, history = interface.extract_local_pair_state_values(
        state.pairs, "displacement", "force_vector", "law_history"
    )
    return IncrementStart(displacement, force, q, history)


class ContactKinematics(Protocol):
    """Gap, slip and frame of the contact points in one increment."""

    def kinematics_and_point_motions_at_iterate(
        self, previous: LinearisedKinematics, q: Array, displacement: Array, force: Array
    ) -> tuple[LinearisedKinematics, Array]:
        """Return the kinematics for the evaluation of an iterate, and the point motions v (m, p).

        Args:
            previous: kinematics of the linear system whose solution is the iterate.
            q: motions (pairs, k) of the surfaces.
            displacement: displacements (m, dim) of the points.
            force: forces (m, dim) on the points.
        """

    def relinearise_at_solution_if_needed(
        self, previous: LinearisedKinematics, q: Array, displacement: Array, force: Array
    ) -> LinearisedKinematics:
        """Return kinematics that are linearised at a solution.

        The arguments are those of `kinematics_and_point_motions_at_iterate`. At small strains, the
        kinematics are linearised again if there is support friction, or if the gaps or normals of a
        surface that is free to move have changed otherwise than linearly. In all other cases
        `previous` is returned, because it is already valid at the solution.
        """

    def compute_slip_along_straight_path(
        self, q: Array, displacement: Array, normal: Array
    ) -> Array:
        """Return the slip (m, dim) along the straight path from the start of the increment.

        Args:
            q: motions (pairs, k) of the surfaces at the end.
            displacement: displacements (m, dim) of the points at the end.
            normal: normals (m, dim) at the end.
        """


class SmallStrainKinematics:
    """Kinematics at small strains, evaluated at the undeformed positions of the points.

    They are linearised again only if an iterate satisfies the contact law, and if normals or slips
    may have changed with it.

    Args:
        interface: contact points (m) of all pairs.
        start: state at the start of the increment.
        prescribed_translations: prescribed translations (pairs, dim), NaN where they are free.
        load_factor: fraction of the pairs' interference that is applied.
    """

    def __init__(
        self,
        interface: ContactInterface,
        start: IncrementStart,
        prescribed_translations: Array,
        load_factor: float,
    ) -> None:
        self._interface, self._start, self._load_factor = interface, start, load_factor
        self._free: Mask = np.isnan(prescribed_translations)

    def kinematics_and_point_motions_at_iterate(
        self,
        previous: LinearisedKinematics,
        q: Array,  # noqa: ARG002
        displacement: Array,
        force: Array,  # noqa: ARG002
    ) -> tuple[LinearisedKinematics, Array]:
        return previous, displacement

    def relinearise_at_solution_if_needed(
        self,
        previous: LinearisedKinematics,
        q: Array,
        displacement: Array,
        force: Array,
    ) -> LinearisedKinematics:
        if self._interface.holds_friction:
            return self.linearise(q, displacement, force)
        if not self._free.any() or self._are_gaps_and_normals_valid_at(q, previous):
            return previous
        return self.linearise(q, displacement, force)

    def _are_gaps_and_normals_valid_at(self, q: Array, linearised: LinearisedKinematics) -> bool:
        """Return whether linearised gaps and normals equal those at motions q; collective.

        They do for surfaces such as planes. Gaps may differ by the round-off of coordinates.
        """
        interface, comm = self._interface, self._interface.comm
        gap, normal = interface.evaluate_undeformed_gaps_and_normals(q)
        gap = self._add_interference_not_yet_applied(gap)
        change = np.einsum(
            "nk,nk->n", linearised.motion_by_q[:, 0], (q - linearised.q0)[interface.pair]
        )
        round_off = RELATIVE_COORDINATE_ROUND_OFF * interface.max_extent_of_points
        with np.errstate(invalid="ignore"):  # gaps may be infinite
            is_gap_equal = np.abs(linearised.gap + change - gap) <= round_off
        is_gap_equal |= linearised.gap == gap
        is_valid = is_gap_equal.all() and np.array_equal(linearised.frame[:, 0], normal)
        return bool(comm.allreduce(bool(is_valid), MPI.LAND))

    def _add_interference_not_yet_applied(self, gap: Array) -> Array:
        if self._load_factor == 1:
            return gap
        return gap + (1 - self._load_factor) * self._interface.initial_interference

    def compute_slip_along_straight_path(
        self, q: Array, displacement: Array, normal: Array
    ) -> Array:
        return remove_normal_part(self._relative_motion_since_start(q, displacement), normal)

    def linearise(
        self, translations: Array, displacement: Array, force: Array
    ) -> LinearisedKinematics:
        """Return the kinematics linearised at a state.

        Derivatives with respect to prescribed translations neglect the change of normals.

        Args:
            translations: (pairs, dim), translations of the surfaces.
            displacement: (m, dim), displacements of the points.
            force: (m, dim), forces on the points.
        """
        return self._linearise_with_free_translations(self._free, translations, displacement, force)

    def linearise_with_all_translations_free(
        self, translations: Array, displacement: Array, force: Array
    ) -> LinearisedKinematics:
        """Return the kinematics linearised at a state, as if all translations were free.

        In contrast to `linearise`, the change of normals with prescribed translations is included.
        The arguments are those of `linearise`.
        """
        return self._linearise_with_free_translations(
            np.ones_like(self._free), translations, displacement, force
        )

    def _relative_motion_since_start(self, q: Array, displacement: Array) -> Array:
        start, pair = self._start, self._interface.pair
        return displacement - start.displacement - (q - start.q)[pair]

    def _linearise_with_free_translations(
        self, is_free_translation: Mask, translations: Array, displacement: Array, force: Array
    ) -> LinearisedKinematics:
        interface, held_components = self._interface, self._interface.held_components
        force = np.where(held_components, 0.0, force)
        step = _TRANSLATION_DIFFERENCE_STEP_PER_CONTACT_EXTENT * (
            interface.max_extent_of_points or 1.0
        )
        gap, normal = interface.evaluate_undeformed_gaps_and_normals(translations)
        frame = make_frames(normal, interface.equation >= 0)
        frame = add_tangents_along_supports(frame, held_components)
        tangents, gap_loss = frame[:, 1:], normal.copy()
        gap = self._add_interference_not_yet_applied(gap)
        normal_by_q = np.zeros_like(frame)  # (m, component, component of translation)
        for axis in np.flatnonzero(is_free_translation.any(axis=0)):
            forward, backward = translations.copy(), translations.copy()
            forward[is_free_translation[:, axis], axis] += step
            backward[is_free_translation[:, axis], axis] -= step
            is_moved = is_free_translation[interface.pair, axis]
            (forward_gap, forward_normal), (backward_gap, backward_normal) = (
                interface.evaluate_undeformed_gaps_and_normals(moved)
                for moved in (forward, backward)
            )
            change = (forward_normal - backward_normal) / (2 * step)
            with np.errstate(invalid="ignore"):  # gaps may be infinite
                loss = (backward_gap - forward_gap) / (2 * step)
            smooth = is_moved & np.isfinite(loss)
            normal_by_q[smooth, :, axis] = change[smooth]
            gap_loss[smooth, axis] = loss[smooth] - np.sum(change * displacement, axis=1)[smooth]
        # tangents rotate with the normal: dt = -(t·dn) n
        tilt = np.einsum("nta,nak->ntk", tangents, normal_by_q)
        relative = self._start.displacement - self._start.q[interface.pair]
        origin = relative + translations[interface.pair]
        normal_motion = np.sum(normal * (displacement - origin), axis=1)
        normal_force = np.sum(normal * force, axis=1)
        slip_loss = tangents + tilt * normal_motion[:, None, None]
        normal_force_by_q = np.einsum("na,nak->nk", force, normal_by_q)[:, None]
        return LinearisedKinematics(
            pair=interface.pair,
            torque_map=TorqueMap.without_rotation(*force.shape),
            v0=np.zeros_like(force),
            q0=translations,
            frame=frame,
            gap=gap,
            slip=-np.einsum("nta,na->nt", tangents, origin),
            motion_by_v=frame,
            motion_by_q=-np.concatenate([gap_loss[:, None], slip_loss], axis=1),
            force_by_v=np.zeros_like(frame),
            force_by_q=np.concatenate(
                [normal_force_by_q, -tilt * normal_force[:, None, None]], axis=1
            ),
            held_tangents=find_held_tangents(frame, held_components),
        )


def remove_normal_part(vectors: Array, normal: Array) -> Array:
    """Return vectors (m, dim) without their components along unit normals (m, dim)."""
    return vectors - np.sum(vectors * normal, axis=1)[:, None] * normal
