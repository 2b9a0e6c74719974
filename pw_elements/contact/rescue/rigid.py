"""Free rigid motions of a supported body, and the work of loads and contact forces in them.

A rigid motion is a vector of mode amplitudes. Modes are translations and rotations of the connected
pieces of a body, and free translations of rigid surfaces. Messages describe motions in words.

The module guarantees the same motions and descriptions on all processes. It assumes a body at small
strains: rotations are linearised about the undeformed positions.
"""

from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy  # loads scipy.optimize when it is first used
import scipy.sparse as sp
from scipy.linalg import qr

from pw_elements.arrays import Array, Indices
from pw_elements.checks import format_points
from pw_elements.contact.interface import find_reduced_column_of_each_unknown
from pw_elements.contact.model import FreeMotionIndices
from pw_elements.contact.nodes import (
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    ContactNodes,
    assemble_active_set_equations,
    combine_active_sets,
)
from pw_elements.contact.system import (
    ContactSystem,
    extract_local_rows,
    make_map_from_free_motions_to_points,
)
from pw_elements.solvers import ComponentRigidModes, destroy_objects, null_space_basis, qr_triangle

_AXIS_NAMES = "xyz"
# Largest component of a motion that counts as zero in descriptions and proofs, relative to the
# largest component of the motion
NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO = 1e-6
# Largest component of a basis motion that is due to round-off, relative to the largest component
_RELATIVE_BASIS_ROUND_OFF = 1e-12
# Largest ratio of amplitudes at which a mode of a preferred kind, instead of the mode with the
# largest amplitude, becomes the pivot of a motion
_MAX_AMPLITUDE_RATIO_FOR_PREFERRED_PIVOT = 1e3

# Largest stiffness of a motion that counts as zero in proofs, relative to the stiffness of an
# arbitrary motion
_ZERO_RELATIVE_STIFFNESS_IN_PROOFS = 1e-11
# Stiffness below which a motion counts as free, relative to the stiffness of an arbitrary motion
_MAX_RELATIVE_STIFFNESS_OF_FREE_MOTION = 1e-8
# Squared stiffness, relative to the larger of the number of modes and the sum of all squared
# stiffnesses, above which a motion is certainly not free: round-off of squares is below 1e-15
_MIN_RELATIVE_SQUARED_STIFFNESS_OF_HELD_MOTION = 1e-12


@dataclass(frozen=True)
class RigidMotionBasis:
    """Linearly independent rigid motions.

    Args:
        motions: amplitudes (k, modes) of the modes in each motion.
        pivot: index (k,), for each motion, of a mode that occurs in this motion only.
    """

    motions: Array
    pivot: Indices


class RigidModes:
    """Modes of rigid motion of the connected pieces of a body and of free surfaces.

    A motion (modes,) contains the amplitudes of one piece after another, as in
    `ComponentRigidModes`, followed by the free translations of the surfaces.

    Attributes:
        centre: mean position (pieces, dim) of the nodes of each piece.
        length: radius of gyration (pieces,) of each piece. The amplitude of a rotation is the angle
            times this length.
        free: indices (pair, axis) of each free translation of a surface.
        modes_per_piece: number of translations and rotations of one piece.
        n_piece_modes: number of modes of all pieces.
        n_modes: number of all modes.
        mover: number (modes,) of the piece that each mode moves. Each free translation of a surface
            has a number of its own, after those of the pieces.
    """

    def __init__(self, pieces: ComponentRigidModes, free: FreeMotionIndices, n_pairs: int) -> None:
        self.centre, self.length = pieces.centre, pieces.length
        self.free, self._n_pairs = free, n_pairs
        self.modes_per_piece = pieces.modes.shape[2]
        self.n_piece_modes = len(pieces.centre) * self.modes_per_piece
        self.n_modes = self.n_piece_modes + len(free)
        n_pieces = len(pieces.centre)
        piece = np.repeat(np.arange(n_pieces), self.modes_per_piece)
        self.mover: Indices = np.concatenate([piece, n_pieces + np.arange(len(free))])

    def split_into_pieces_and_surfaces(self, motion: Array) -> tuple[Array, Array, Array]:
        """Split a motion into motions of pieces and of surfaces.

        Args:
            motion: amplitudes (modes,).

        Returns:
            Translations (pieces, dim) of the pieces; rotations (pieces, 1 or 3) of the pieces, as
            angles times the radius of gyration (in three dimensions, as vectors along the axis of
            rotation); and translations (pairs, dim) of the surfaces.
        """
        dim = self.centre.shape[1]
        pieces = motion[: self.n_piece_modes].reshape(len(self.centre), -1)
        rotations = pieces[:, dim:]
        if dim == 3:  # modes are rotations in the planes xy, xz and yz
            rotations = rotations[:, ::-1] * [1.0, -1.0, 1.0]
        surfaces = np.zeros((self._n_pairs, dim))
        for pair_and_axis, value in zip(self.free, motion[self.n_piece_modes :], strict=True):
            surfaces[pair_and_axis] = value
        return pieces[:, :dim], rotations, surfaces

    def make_simplest_basis(self, motions: Array) -> RigidMotionBasis:
        """Return the basis of a space of motions (k, modes) with the simplest description.

        Each motion of the basis has a mode, a rotation if possible, that is zero in all other
        motions. A rotation is therefore not combined with translations that are free themselves,
        and translations are along axes.
        """
        is_rotation = np.arange(self.n_piece_modes) % self.modes_per_piece >= self.centre.shape[1]
        rank = np.concatenate([np.where(is_rotation, 0, 1), np.full(len(self.free), 2)])
        _, pivots = qr(
            motions / _MAX_AMPLITUDE_RATIO_FOR_PREFERRED_PIVOT**rank, mode="r", pivoting=True
        )
        pivot = np.array(sorted(pivots[: len(motions)], key=lambda k: (rank[k], k)), dtype=int)
        rows = np.asarray(np.linalg.solve(motions[:, pivot], motions), dtype=float)
        return RigidMotionBasis(
            np.where(np.abs(rows) <= _RELATIVE_BASIS_ROUND_OFF, 0.0, rows), pivot
        )

    def describe_motion(self, motion: Array) -> str:
        """Return a text that describes how each piece and surface moves in a motion (modes,)."""
        translation, rotation, surface = self.split_into_pieces_and_surfaces(motion)
        negligible, words = NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO * np.abs(motion).max(), []
        locations = [
            f" around {format_points(self.centre[k : k + 1])}" for k in range(len(self.centre))
        ]
        for k, location in enumerate(locations):
            body = f"the body{location if len(locations) > 1 else ''}"
            if np.abs(rotation[k]).max(initial=0.0) > negligible:
                words.append(
                    f"{self._describe_rotation_with_axis(k, translation[k], rotation[k])} of {body}"
                )
            elif np.abs(translation[k]).max() > negligible:
                words.append(f"translation {format_direction(translation[k])} of {body}")
        for k in range(len(surface)):
            if np.abs(surface[k]).max() > negligible:
                direction = format_direction(surface[k])
                words.append(f"translation {direction} of the surface of pair {k}")
        return " with ".join(words)

    def _describe_rotation_with_axis(self, piece: int, translation: Array, rotation: Array) -> str:
        """Return a text that describes the rotation of a piece with its pole or axis."""
        dim = len(translation)
        v, w = np.pad(translation, (0, 3 - dim)), np.pad(rotation, (3 - len(rotation), 0))
        pole = self.centre[piece] + self.length[piece] * np.cross(w, v)[:dim] / (w @ w)
        if dim == 2:
            return f"rotation about {format_points(pole[None])}"
        axis = format_direction(w * np.sign(w[np.argmax(np.abs(w))]))
        is_screw = abs(v @ w) > NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO * (w @ w)
        screw = " with a translation along it" if is_screw else ""
        return f"rotation about the axis along {axis} through {format_points(pole[None])}{screw}"


def format_direction(vector: Array) -> str:
    """Return a text for the direction of a vector (dim,), such as "-x".

    If the vector is not along an axis, the text contains its unit vector.
    """
    vector = vector / np.linalg.norm(vector)
    main = int(np.argmax(np.abs(vector)))
    if np.linalg.norm(np.delete(vector, main)) <= NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO:
        return ("-" if vector[main] < 0 else "") + _AXIS_NAMES[main]
    return format_points(vector[None])


class RigidMotions:
    """Rigid motions of the pieces of a supported body and of surfaces that are free to move.

    Args:
        system: contact system, which contains the supports and the contact points.
        K: stiffness (n, n) without supports.

    Attributes:
        modes: modes of rigid motion.
    """

    def __init__(self, system: ContactSystem, K: PETSc.Mat) -> None:
        self._system, self._K = system, K
        pieces = system.interface.rigid_modes_of_pieces
        self.modes = RigidModes(pieces, system.free_motions, system.interface.pairs)
        self._displacement_rows = system.interface.field.owned_unknowns.ravel()
        # triangle of a QR factorisation: motions in its null space are free under the supports
        self._support_rows = qr_triangle(
            self._assemble_resistance_to_modes(pieces, with_transposed_stiffness=False), system.comm
        )
        # relative motions (m dim, modes) of the contact nodes
        self._relative_motions = self._assemble_node_motions_relative_to_surfaces(
            pieces, conjugate_to_forces=False
        )
        if isinstance(self._support_rows, np.ndarray):  # if there are few modes
            self._relative_motions = self._relative_motions.toarray()

    def describe_free_rigid_motions(self, active: ActiveSet, frame: Array) -> list[str]:
        """Return a text for each rigid motion that remains free for an active set.

        Nodes with an interface law count as holding the body, whatever their status. `frame`
        (m, dim, dim) are the frames of the contact nodes.
        """
        if (laws := self._system.interface.laws) is not None:
            status = np.where(laws.has_law, STICK, active.status).astype(np.int8)
            active = replace(active, status=status)
        free = self._find_free_rigid_motions(active, frame)
        if not len(free):
            return []
        return [
            self.modes.describe_motion(motion)
            for motion in self.modes.make_simplest_basis(free).motions
        ]

    def can_slide_at_exhausted_friction(self, nodes: ContactNodes, force_tolerance: float) -> bool:
        """Return whether a body may keep sliding because friction has reached its limit.

        Friction counts as having reached its limit if it is less than the limit by no more than the
        force `force_tolerance`.
        """
        comm, shear, active = self._system.comm, nodes.force[:, 1:], nodes.active_set
        size, limit = np.linalg.norm(shear, axis=1), nodes.friction_limits_and_slopes[0]
        is_at_limit = nodes.cone.has_friction & (active.status != OPEN) & (size > force_tolerance)
        is_at_limit &= size >= limit - force_tolerance
        if not comm.allreduce(bool(is_at_limit.any()), MPI.LOR):
            return False
        direction = shear / np.where(is_at_limit, size, 1.0)[:, None]
        ones = np.ones(len(is_at_limit))
        sliding = replace(
            active,
            status=np.full_like(active.status, SLIP),
            direction=direction,
            friction_ratio=ones,
            limit_slope=ones,
            limit_intercept=ones,
        )
        free = self._find_free_rigid_motions(
            combine_active_sets(~is_at_limit, active, sliding), nodes.frame
        )
        motions = (self._relative_motions @ free.T).reshape(*nodes.frame.shape[:2], len(free))
        slip = np.einsum("nab,na,nbk->nk", nodes.frame[:, 1:], direction, motions)
        slip = slip[is_at_limit & (active.status == STICK)]
        extremes = comm.allgather([slip.max(initial=0.0), -slip.min(initial=0.0)])
        # one motion, or its reverse, has to oppose friction at all nodes that stick at the limit
        return len(free) > 1 or (
            len(free) == 1
            and np.max(extremes, axis=0).min() <= _MAX_RELATIVE_STIFFNESS_OF_FREE_MOTION
        )

    def describe_unstopped_motion_of_loose_pieces(
        self, nodes: ContactNodes, force_tolerance: float
    ) -> list[str]:
        """Return a list with the description of a motion of loose pieces that no surface stops.

        A loose piece has no contact forces; forces up to `force_tolerance` count as zero. A node
        that touches a surface without force stops only motions into this surface. The list is empty
        if all motions of loose pieces are stopped.
        """
        if self._supports_hold_all_motions:
            return []
        comm, (m, dim, _) = self._system.comm, nodes.frame.shape
        is_pressed = nodes.force[:, 0] > force_tolerance
        # rows of nodes without force become zero
        is_pressed_row = np.repeat(is_pressed.astype(float), dim)
        at_pressed = (
            is_pressed_row[:, None] * np.abs(self._relative_motions)
            if isinstance(self._relative_motions, np.ndarray)
            else sp.diags_array(is_pressed_row) @ abs(self._relative_motions)
        )
        is_held = comm.allreduce(np.asarray(at_pressed.sum(axis=0)).ravel(), MPI.SUM) > 0
        is_held[self.modes.n_piece_modes :] = True
        mover = self.modes.mover
        is_held = np.isin(mover, mover[is_held])
        if is_held.all():
            return []
        held_rows = np.eye(self.modes.n_modes)[is_held]
        is_dense = isinstance(self._support_rows, np.ndarray)
        free = null_space_basis(
            [self._support_rows, held_rows if is_dense else sp.csr_array(held_rows)],
            _MAX_RELATIVE_STIFFNESS_OF_FREE_MOTION,
        )
        if not len(free):
            return []
        motions = (self._relative_motions @ free.T).reshape(m, dim, len(free))
        is_touching = (
            np.isfinite(nodes.gap) & (nodes.scale * nodes.gap <= force_tolerance) & ~is_pressed
        )
        opening = np.einsum("na,nak->nk", nodes.frame[:, 0], motions)[is_touching]
        opening = np.concatenate(comm.allgather(opening))
        motion = comm.bcast(find_motion_closing_no_gap(opening) if comm.rank == 0 else None)
        return [] if motion is None else [self.modes.describe_motion(motion @ free)]

    def find_motions_without_strain_work(self) -> tuple[RigidMotionBasis, Array]:
        """Return the motions in which only loads and contact forces do work, whatever the strains.

        Returns:
            A basis of k motions, each of a single piece or surface, and the velocities (m, dim, k)
            of the contact nodes relative to their surfaces with which contact forces do work.
        """
        pieces, mover = self._system.interface.rigid_modes_of_pieces, self.modes.mover
        resistance = qr_triangle(
            self._assemble_resistance_to_modes(pieces, with_transposed_stiffness=True),
            self._system.comm,
        )
        by_mover = [
            resistance @ sp.diags_array((mover == k).astype(float)) for k in np.unique(mover)
        ]
        free = null_space_basis([resistance[:0], *by_mover], _ZERO_RELATIVE_STIFFNESS_IN_PROOFS)
        basis = self.modes.make_simplest_basis(free)
        works = (
            self._assemble_node_motions_relative_to_surfaces(pieces, conjugate_to_forces=True)
            @ basis.motions.T
        )
        return basis, works.reshape(*self._system.interface.position.shape, works.shape[1])

    def compute_work_and_absolute_work_in_modes(
        self, load: PETSc.Vec, free_motion_forces: Array
    ) -> tuple[Array, Array]:
        """Return the work (modes,) of loads in each mode, and the sum of magnitudes of its parts.

        Args:
            load: load vector (n_r,), reduced by the supports.
            free_motion_forces: prescribed forces (free,) of the free translations of surfaces.
        """
        column = self._reduced_columns_of_displacements()
        forces, is_kept = np.zeros(len(column)), column >= 0
        forces[is_kept] = load.array_r[column[is_kept] - load.getOwnershipRange()[0]]
        pieces = self._system.interface.rigid_modes_of_pieces
        motions = pieces.matrix_with_mode_columns(pieces.modes, len(self.modes.free))
        work_and_size = np.array([motions.T @ forces, abs(motions).T @ np.abs(forces)])
        self._system.comm.Allreduce(MPI.IN_PLACE, work_and_size, MPI.SUM)
        work_and_size[:, self.modes.n_piece_modes :] = (
            free_motion_forces,
            np.abs(free_motion_forces),
        )
        return work_and_size[0], work_and_size[1]

    def _find_free_rigid_motions(self, active: ActiveSet, frame: Array) -> Array:
        """Return the rigid motions (k, modes) that remain free for an active set.

        `frame` (m, dim, dim) are the frames of the contact nodes.
        """
        if self._supports_hold_all_motions:
            return np.zeros((0, self.modes.n_modes))
        m, dim = frame.shape[:2]
        constraints, motions = (
            assemble_active_set_equations(active, np.ones(m))[1] @ frame,
            self._relative_motions,
        )
        if isinstance(motions, np.ndarray):
            rows = constraints @ motions.reshape(m, dim, motions.shape[1])
            rows = rows.reshape(motions.shape)
            if self._do_contact_rows_hold_all_motions(rows):
                return np.zeros((0, self.modes.n_modes))
        else:
            blocks = sp.bsr_array((constraints, np.arange(m), np.arange(m + 1)), (m * dim,) * 2)
            rows = sp.csr_array(blocks @ motions)
        contact_rows = qr_triangle(rows, self._system.comm)
        return null_space_basis(
            [self._support_rows, contact_rows], _MAX_RELATIVE_STIFFNESS_OF_FREE_MOTION
        )

    @cached_property
    def _supports_hold_all_motions(self) -> bool:
        """Whether no motion is free even without contact; contact leaves no others free."""
        free = null_space_basis([self._support_rows], _MAX_RELATIVE_STIFFNESS_OF_FREE_MOTION)
        return len(free) == 0

    def _do_contact_rows_hold_all_motions(self, contact_rows: Array) -> bool:
        """Return whether supports and contact hold all motions beyond doubt; collective.

        This test takes a small part of the time of a factorisation of the rows. It squares small
        stiffnesses, so that motions which it does not find held may be held nevertheless.

        Args:
            contact_rows: forces or displacements (m dim, modes) at the contact nodes of this
                process that each mode causes.
        """
        squares = contact_rows.T @ contact_rows
        self._system.comm.Allreduce(MPI.IN_PLACE, squares, MPI.SUM)
        squares += self._support_rows.T @ self._support_rows
        scale = max(self.modes.n_modes, np.trace(squares))
        smallest = np.linalg.eigvalsh(squares)[0]
        return bool(smallest > _MIN_RELATIVE_SQUARED_STIFFNESS_OF_HELD_MOTION * scale)

    def _reduced_columns_of_displacements(self) -> Indices:
        """Return the index of the reduced unknown that equals each displacement of this process.

        The index is -1 for a prescribed displacement, and -2 for a combination of several unknowns.
        """
        return find_reduced_column_of_each_unknown(self._system.reduction.right)[
            self._displacement_rows
        ]

    def _assemble_resistance_to_modes(
        self, pieces: ComponentRigidModes, with_transposed_stiffness: bool
    ) -> sp.csr_array:
        """Return the forces, or the displacements at supports, that each mode causes.

        A row contains displacements where a support prescribes them, and otherwise forces. A mode
        of rigid motion may cause forces: in axisymmetry, for example, only the translation along
        the axis is free of strain.

        Args:
            pieces: connected pieces of the body with their rigid-body modes.
            with_transposed_stiffness: whether to use the transposed stiffness. It gives the motions
                in which no state of strain does work, which may be fewer if the stiffness is
                unsymmetric.

        Returns:
            Matrix (owned displacements, modes), whose null space contains the free motions.
        """
        is_free = self._reduced_columns_of_displacements() != -1
        return pieces.forces_and_support_displacements_of_modes(
            self._K,
            is_free,
            self._displacement_rows,
            with_transposed_stiffness,
            len(self.modes.free),
        )

    def _assemble_node_motions_relative_to_surfaces(
        self, pieces: ComponentRigidModes, conjugate_to_forces: bool
    ) -> sp.csr_array:
        """Return the motions (m dim, modes) of the contact nodes relative to their surfaces.

        Args:
            pieces: connected pieces of the body with their rigid-body modes.
            conjugate_to_forces: whether to return the motions with which contact forces do work.
                These are computed by the transposed force operator, and the motions that gaps and
                slips depend on by the motion operator.
        """
        system, modes = self._system, self.modes
        interface, comm, field = system.interface, system.comm, system.interface.field
        owned_motions = pieces.matrix_with_mode_columns(pieces.modes, len(modes.free))
        n_owned = len(self._displacement_rows)
        spread = sp.csr_array(
            (np.ones(n_owned), (self._displacement_rows, np.arange(n_owned))),
            (field.full_sizes[0], n_owned),
        )
        full = sp.csr_array(spread @ owned_motions)  # (unknowns, modes)
        pattern = (x.astype(PETSc.IntType) for x in (full.indptr, full.indices))
        sizes = field.full_sizes, (modes.n_modes if comm.rank == 0 else 0, modes.n_modes)
        motions = PETSc.Mat().createAIJ(sizes, csr=(*pattern, full.data), comm=comm)
        multiply = (
            interface.force.transposeMatMult if conjugate_to_forces else interface.motion.matMult
        )
        at_nodes = multiply(motions)
        dim, of_pieces = interface.position.shape[1], extract_local_rows(at_nodes, 0)
        destroy_objects(motions, at_nodes)
        of_surfaces = make_map_from_free_motions_to_points(
            modes.free, interface.pair, dim, n_empty_columns=modes.n_piece_modes
        )
        return sp.csr_array(of_pieces - of_surfaces)


def find_motion_closing_no_gap(opening_rates: Array) -> Array | None:
    """Return a combination (k,) of motions that closes no gap, or None if there is none.

    Args:
        opening_rates: rate (m, k) at which each gap opens in each motion.
    """
    k = opening_rates.shape[1]
    for direction in (*np.eye(k), *-np.eye(k)):
        best = scipy.optimize.linprog(
            -direction, A_ub=-opening_rates, b_ub=np.zeros(len(opening_rates)), bounds=(-1, 1)
        )
        if best.success and best.x @ direction > NEGLIGIBLE_TO_LARGEST_COMPONENT_RATIO:
            return np.asarray(best.x, dtype=float)
    return None
