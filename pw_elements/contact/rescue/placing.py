"""Rigid motion of bodies with their supports, and detection of motions that end all contact.

If all pieces of a body move rigidly with their supports, and at the end of the motion all contact
nodes are clear of their opposite sides, the body has no contact in this position. It does not
matter which friction forces acted before.

The module guarantees the same results on all processes. It assumes that no node is farther from its
rigidly moved position than the largest elastic displacement at the start.
"""

from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import raise_errors_on_all_processes
from pw_elements.contact.interface import (
    MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL,
    RELATIVE_COORDINATE_ROUND_OFF,
    ContactInterface,
)
from pw_elements.contact.nodes import RigidSurfaceMotion
from pw_elements.spaces import gather_nodal_values

# Largest distance of supports from their best-fitting rigid motion, relative to the piece's extent
_MAX_RIGID_FIT_ERROR_PER_EXTENT = 1e-9
# Smallest spread of supports that determines a rotation, relative to their largest spread
_MIN_SUPPORT_SPREAD_RATIO_FOR_ROTATION = 1e-6
# Largest penetration depth during a motion that separates two sides, divided by the depth at the
# start
_MAX_PENETRATION_RATIO_TO_START = 1.25
# Largest motion of a node between two samples at which no contact is missed, relative to the extent
# of the contact nodes
_MAX_SAMPLE_STEP_PER_EXTENT = 0.1


@dataclass(frozen=True)
class PiecesMovingWithSupports:
    """Rigid motions of the connected pieces of a body with their supports, at samples of a path.

    Args:
        number: number (nodes,) of the piece to which each node of this process belongs.
        pivot: mean undeformed position (pieces, dim) of the supports of each piece.
        pivot_path: positions (samples, pieces, dim) of the pivots.
        rotation: rotation matrices (samples, pieces, dim, dim).
        is_rigid: mask (pieces,) of the pieces whose supports determine a rigid motion and follow it
            at all samples.
    """

    number: Indices
    pivot: Array
    pivot_path: Array
    rotation: Array
    is_rigid: Mask

    @classmethod
    def fit_rigid_motions_to_supports(
        cls,
        positions: Array,
        is_supported: Mask,
        piece_of_node: Indices,
        support_paths: Array,
        comm: MPI.Comm,
    ) -> "PiecesMovingWithSupports":
        """Return the rigid motions that best fit the fully supported nodes of each piece.

        Args:
            positions: undeformed positions (n, dim) of the nodes of this process.
            is_supported: mask (n, dim) of displacement components that supports prescribe.
            piece_of_node: number (n,) of the piece to which each node belongs.
            support_paths: prescribed displacements (samples, n, dim).
            comm: communicator of the mesh.
        """
        dim = positions.shape[1]
        n_pieces = comm.allreduce(int(piece_of_node.max(initial=-1)) + 1, MPI.MAX)
        is_fixed = is_supported.all(axis=1)
        x, piece_of_x = positions[is_fixed], piece_of_node[is_fixed]

        def sum_by_piece(values: Array) -> Array:
            sums = np.zeros((n_pieces, *values.shape[1:]))
            np.add.at(sums, piece_of_x, values)
            comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
            return sums

        n_nodes = np.maximum(sum_by_piece(np.ones(len(x))), 1.0)[:, None]
        pivot = sum_by_piece(x) / n_nodes
        arm = x - pivot[piece_of_x]
        spread = np.linalg.svd(sum_by_piece(arm[:, :, None] * arm[:, None]), compute_uv=False)
        # two supports determine a rotation in two dimensions, three supports in three dimensions
        is_rigid = (spread[:, 0] > 0) & (
            spread[:, dim - 2] > _MIN_SUPPORT_SPREAD_RATIO_FOR_ROTATION**2 * spread[:, 0]
        )
        pivot_path, rotations = [], []
        for displacement in support_paths:
            moved_x = x + displacement[is_fixed]
            moved_pivot = sum_by_piece(moved_x) / n_nodes
            moved_arm = moved_x - moved_pivot[piece_of_x]
            left, _, right = np.linalg.svd(sum_by_piece(moved_arm[:, :, None] * arm[:, None]))
            left[:, :, -1] *= np.sign(np.linalg.det(left @ right))[:, None]
            pivot_path.append(moved_pivot)
            rotations.append(left @ right)
        pieces = cls(piece_of_node, pivot, np.array(pivot_path), np.array(rotations), is_rigid)
        has_support = is_supported.any(axis=1)
        supported_x, supported_piece = positions[has_support], piece_of_node[has_support]
        displacement = support_paths[:, has_support]
        misfit = np.abs(
            pieces.compute_rigid_paths_of_points(supported_x, supported_piece)
            - supported_x
            - displacement
        )
        max_misfit = np.zeros(n_pieces)
        misfit = np.where(is_supported[has_support], misfit, 0.0).max(axis=(0, 2), initial=0.0)
        np.maximum.at(max_misfit, supported_piece, misfit)
        comm.Allreduce(MPI.IN_PLACE, max_misfit, MPI.MAX)
        max_displacement = comm.allreduce(float(np.abs(support_paths).max(initial=0.0)), MPI.MAX)
        extent = np.sqrt(spread[:, 0] / n_nodes[:, 0]) + max_displacement
        return replace(
            pieces, is_rigid=is_rigid & (max_misfit <= _MAX_RIGID_FIT_ERROR_PER_EXTENT * extent)
        )

    def compute_rigid_paths_of_points(self, x: Array, piece_of_point: Indices) -> Array:
        """Return the positions (samples, k, dim) of points that move rigidly with their pieces.

        Args:
            x: undeformed positions (k, dim) of the points.
            piece_of_point: number (k,) of the piece to which each point belongs.
        """
        arm = x - self.pivot[piece_of_point]
        return np.asarray(
            self.pivot_path[:, piece_of_point]
            + np.einsum("skab,kb->ska", self.rotation[:, piece_of_point], arm)
        )


@dataclass(frozen=True)
class _SeparationAlongRigidPath:
    """Distances between the two sides of a pair along a path.

    The bodies move rigidly with their supports.

    Args:
        depth: largest depth (samples,) of a node in the opposite side, zero if all are outside.
        clearance: smallest distance between both sides at the end, infinite if no node faces the
            opposite side.
        deformation: largest distance of a deformed node from its rigidly moved position at the
            start.
        max_step: longest motion of a node between samples, relative to the opposite side.
        extent: extent of the contact nodes; for two bodies, of the smaller side.
        is_outside: whether no node is behind the opposite side at any sample.
    """

    depth: Array
    clearance: float
    deformation: float
    max_step: float
    extent: float
    is_outside: bool


def does_rigid_motion_end_all_contact(
    interface: ContactInterface,
    surface_motion: RigidSurfaceMotion,
    pieces: PiecesMovingWithSupports,
    placements: Array,
    unknowns: PETSc.Vec,
) -> bool:
    """Return whether a motion separates all pairs by more than the elastic deformation.

    The undeformed bodies are moved rigidly with their supports. The motion separates all pairs
    under three conditions. At the start, the rigidly moved bodies overlap the opposite sides.
    During the motion, they neither get much deeper into the opposite sides nor behind them. At the
    end, their distance from the opposite sides exceeds the largest displacement that deformation
    has caused at the start.

    Args:
        interface: contact nodes of all pairs.
        surface_motion: rigid motion of the rigid surfaces.
        pieces: rigid motion of the pieces of the bodies at the samples.
        placements: translations and angles (samples, pairs, dim + 1) of the opposite sides, NaN
            where a motion is free.
        unknowns: all unknowns (n,) of the state at the start.
    """
    if np.isnan(placements).any() or not pieces.is_rigid.all():
        return False
    separations = []
    for k in range(interface.pairs):
        if k in interface.mortars:
            separations.append(
                _measure_two_body_separation(interface, pieces, k, placements[:, k, :-1], unknowns)
            )
        else:
            separations.append(
                _measure_tool_separation(
                    interface, surface_motion, pieces, k, placements[:, k], unknowns
                )
            )
    depth = np.max([pair.depth for pair in separations], axis=0)
    deformation = max(pair.deformation for pair in separations)
    return bool(
        depth[0] > RELATIVE_COORDINATE_ROUND_OFF * interface.max_extent_of_points
        and depth.max() <= _MAX_PENETRATION_RATIO_TO_START * depth[0]
        and all(pair.clearance > deformation and pair.is_outside for pair in separations)
        and (
            len(placements) == 2
            or all(
                pair.max_step <= _MAX_SAMPLE_STEP_PER_EXTENT * pair.extent for pair in separations
            )
        )
    )


def _measure_tool_separation(
    interface: ContactInterface,
    surface_motion: RigidSurfaceMotion,
    pieces: PiecesMovingWithSupports,
    pair: int,
    placements: Array,
    unknowns: PETSc.Vec,
) -> _SeparationAlongRigidPath:
    """Return the distances between the contact nodes of a pair and its rigid surface.

    Args:
        interface: contact nodes of all pairs.
        surface_motion: rigid motion of the rigid surfaces.
        pieces: rigid motion of the pieces of the body at the samples.
        pair: number of the pair.
        placements: translations and angle (samples, dim + 1) of the surface.
        unknowns: all unknowns (n,) of the state at the start.
    """
    comm, in_pair, surface = interface.comm, interface.pair == pair, interface.surfaces[pair]
    x = interface.position[in_pair]
    piece = pieces.number[interface.local_node_indices[in_pair]]
    node_paths = pieces.compute_rigid_paths_of_points(x, piece)
    normal_ends = pieces.compute_rigid_paths_of_points(x + interface.outward[in_pair], piece)
    in_surface_frame, ends_in_surface_frame = (
        np.array(
            [
                surface_motion.positions_in_surface_frame(pair, placements[j], path[j])
                for j in range(len(placements))
            ]
        )
        for path in (node_paths, normal_ends)
    )
    gap, normal = np.full(in_surface_frame.shape[:2], np.inf), np.zeros(in_surface_frame.shape)
    with raise_errors_on_all_processes(comm), np.errstate(all="ignore"):
        if len(x):
            points = in_surface_frame.reshape(-1, x.shape[1])
            gap = np.asarray(surface.gap(points), dtype=float).reshape(gap.shape)
            normal = np.asarray(surface.normal(points), dtype=float).reshape(normal.shape)
    depth = np.where(np.isnan(gap), np.inf, -gap).max(axis=1, initial=0.0)
    comm.Allreduce(MPI.IN_PLACE, depth, MPI.MAX)
    outward = ends_in_surface_frame - in_surface_frame
    normal_part = np.sum(normal * outward, axis=2)
    is_pushed_inwards = (
        normal_part
        <= MIN_COSINE_OF_OUTWARD_PUSHING_SURFACE_NORMAL * np.linalg.norm(outward, axis=2)
    )
    deformed = interface.extract_displacements_at_points(unknowns)[in_pair] + x
    return _SeparationAlongRigidPath(
        depth,
        comm.allreduce(gap[-1].min(initial=np.inf), MPI.MIN),
        comm.allreduce(_max_vector_length(deformed - node_paths[0]), MPI.MAX),
        comm.allreduce(_max_vector_length(np.diff(in_surface_frame, axis=0)), MPI.MAX),
        interface.max_extent_of_points,
        comm.allreduce(bool(np.all(is_pushed_inwards | (gap >= 0))), MPI.LAND),
    )


def _measure_two_body_separation(
    interface: ContactInterface,
    pieces: PiecesMovingWithSupports,
    pair: int,
    translations: Array,
    unknowns: PETSc.Vec,
) -> _SeparationAlongRigidPath:
    """Return the distances between the two bodies of a pair.

    Args:
        interface: contact nodes of all pairs.
        pieces: rigid motion of the pieces of the bodies at the samples.
        pair: number of the pair.
        translations: translations (samples, dim) of the master.
        unknowns: all unknowns (n,) of the state at the start.
    """
    mortar = interface.mortars[pair]
    slaves, x = mortar.n_slave_nodes, mortar.x
    owned = interface.field.space.dofmap.index_map.size_local
    piece = gather_nodal_values(interface.field.space, mortar.nodes, pieces.number[:owned])
    node_paths = pieces.compute_rigid_paths_of_points(x, piece)
    deformed = x + interface.extract_displacements_at_nodes(mortar.nodes, unknowns)
    deformation = _max_vector_length(deformed - node_paths[0])
    node_paths[:, slaves:] += translations[:, None]
    extent = min(float(np.ptp(side, axis=0).max()) for side in (x[:slaves], x[slaves:]))
    relative_paths = node_paths[:, :slaves] - node_paths[:, slaves:].mean(axis=1, keepdims=True)
    depth, clearance = np.zeros(len(translations)), np.inf
    for j in range(len(node_paths)):
        positions: Array = node_paths[j]
        facing = mortar.evaluate_mortar_matrices_independently(positions)
        gap = facing.measure_gaps(positions)
        depth[j] = max(0.0, -gap.min(initial=np.inf))
        if j == len(node_paths) - 1:
            distance = cKDTree(positions[slaves:]).query(positions[:slaves])[0].min()
            clearance = min(
                gap.min(initial=np.inf),
                distance - mortar.measure_shortest_facet_at_slave_nodes().max(),
            )
    max_step = _max_vector_length(np.diff(relative_paths, axis=0))
    return _SeparationAlongRigidPath(
        depth, clearance, deformation, max_step, extent, is_outside=True
    )


def _max_vector_length(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max(initial=0.0))
