"""Rejection of increments that move two bodies, or a surface and a body, through each other.

The motions of supports and of prescribed rigid surfaces are known before an increment is solved. If
a surface is moved through supports, or supports of two bodies through each other, no state exists.
If two bodies have passed through each other in one step, their state is not a solution even if it
satisfies all contact conditions.

The module guarantees that errors are raised on all processes. It assumes that prescribed
displacements and placements are sampled so densely that no body is passed between two samples.
"""

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
from dolfinx import geometry
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import format_points, list_bodies, raise_errors_on_all_processes
from pw_elements.contact.interface import ContactInterface, MortarSlipReference
from pw_elements.contact.model import SolutionNotFound, SurfacePassed
from pw_elements.contact.nodes import RigidSurfaceMotion
from pw_elements.contact.rescue.placing import PiecesMovingWithSupports

# Relative to the extent of the contact side: smallest depth of a support that has passed through a
# rigid surface, smallest depth of a slave node that has passed through the master, and largest
# tangential offset at which supports of two bodies can meet
(
    _MAX_SUPPORT_DEPTH_PER_EXTENT,
    _MAX_SLAVE_NODE_DEPTH_PER_EXTENT,
    _MAX_OFFSET_OF_MEETING_SUPPORTS_PER_EXTENT,
) = 0.1, 0.25, 0.5
# Largest distance of a support from a rigid surface or another support that leaves no room for the
# body, relative to the same extent
_MIN_ROOM_FOR_BODY_PER_EXTENT = 1e-9
# Points between a support and a contact node at which it is tested whether they lie inside the
# body, as fractions of the distance
_FRACTIONS_BETWEEN_SUPPORT_AND_NODE = np.linspace(0.1, 0.9, 9)
# Largest number of supports that are tested on each process
_MAX_TESTED_SUPPORTS_PER_PROCESS = 100


def raise_if_tools_reach_or_pass_supports(
    interface: ContactInterface,
    surface_motion: RigidSurfaceMotion,
    positions: Array,
    is_supported: Mask,
    piece_of_node: Indices,
    surface_placements: Array,
    support_paths: Array,
) -> None:
    """Raise SurfacePassed if a rigid surface moves through, or up to, fully supported nodes.

    A surface that moves up to a support leaves no room for the body in between. The body is
    considered to be in between if the straight segment from the support to a contact node in front
    of it lies inside the body.

    Args:
        interface: contact nodes of all pairs.
        surface_motion: rigid motion of the rigid surfaces.
        positions: undeformed positions (n, dim) of the nodes of this process.
        is_supported: mask (n, dim) of displacement components that supports prescribe.
        piece_of_node: number (n,) of the connected piece of the body to which each node belongs.
        surface_placements: translations and angles (samples, pairs, dim + 1) of the surfaces, NaN
            where a motion is free.
        support_paths: prescribed displacements (samples, n, dim).

    Raises:
        SurfacePassed: if a surface reaches or passes supports; the message gives their positions.
    """
    is_fixed = is_supported.all(axis=1)
    for k, surface in enumerate(interface.surfaces):
        if k in interface.mortars or np.isnan(surface_placements[:, k]).any():
            continue
        in_surface_frame = np.array(
            [
                surface_motion.positions_in_surface_frame(
                    k, surface_placements[j, k], positions[is_fixed] + support_paths[j][is_fixed]
                )
                for j in range(len(surface_placements))
            ]
        )
        n_supports, substitute = int(is_fixed.sum()), interface.first_node_position_of_each_pair[k]
        with raise_errors_on_all_processes(interface.comm), np.errstate(all="ignore"):
            # the user's surface may communicate, so all processes have to call it
            answers = [surface.gap(x if n_supports else substitute) for x in in_surface_frame]
            gaps: Array = np.array([np.asarray(gap, dtype=float)[:n_supports] for gap in answers])
        gaps = np.where(np.isnan(gaps), np.inf, gaps)
        min_gap, extent = gaps.min(axis=0, initial=np.inf), _extent_of_smaller_side(interface, k)
        is_deep = min_gap < -_MAX_SUPPORT_DEPTH_PER_EXTENT * extent
        passed = interface.gather_values(positions[is_fixed][is_deep & (gaps[0] > 0)])
        if len(passed):
            raise SurfacePassed(
                f"the motion of the surface of contact pair {k} leads it through the supports at "
                f"{format_points(passed)}: it passes through the body; end the motion before"
            )
        min_room = _MIN_ROOM_FOR_BODY_PER_EXTENT * extent
        reached = np.flatnonzero((min_gap <= min_room) & (gaps[0] > min_room))
        if not len(interface.gather_values(reached)):
            continue
        reached = reached[np.argsort(min_gap[reached])[:_MAX_TESTED_SUPPORTS_PER_PROCESS]]
        pieces = PiecesMovingWithSupports.fit_rigid_motions_to_supports(
            positions, is_supported, piece_of_node, support_paths, interface.comm
        )
        sample = gaps[:, reached].argmin(axis=0)
        supports = positions[is_fixed][reached], in_surface_frame[sample, reached], sample
        crushing = _find_supports_with_body_in_front(
            interface, surface_motion, k, pieces, surface_placements[:, k], *supports
        )
        if len(crushing):
            raise SurfacePassed(
                f"the motion of the surface of contact pair {k} leads it up to the supports at "
                f"{format_points(crushing)}: no room is left for the body between both; end the "
                "motion before"
            )


def _find_supports_with_body_in_front(
    interface: ContactInterface,
    surface_motion: RigidSurfaceMotion,
    pair: int,
    pieces: PiecesMovingWithSupports,
    placements: Array,
    supports: Array,
    supports_in_surface_frame: Array,
    sample_at_contact: Indices,
) -> Array:
    """Return the undeformed positions of supports that have a part of the body in front of them.

    This part of the body lies between the support and a contact node.

    Args:
        interface: contact nodes of all pairs.
        surface_motion: rigid motion of the rigid surfaces.
        pair: number of the pair whose surface has reached the supports.
        pieces: rigid motion of each piece of the body with its supports.
        placements: translations and angle (samples, dim + 1) of the surface.
        supports: undeformed positions (s, dim) of the supports on this process.
        supports_in_surface_frame: positions (s, dim) of the supports in the frame of the surface
            when the surface reaches them.
        sample_at_contact: number (s,) of the sample at which the surface reaches each support.

    Returns:
        Positions (k, dim) of the supports of all processes.
    """
    comm, in_pair = interface.comm, interface.pair == pair
    x = interface.gather_values(interface.position[in_pair])
    piece_of_node = interface.gather_values(pieces.number[interface.local_node_indices[in_pair]])
    spacing = float(cKDTree(x).query(x, 2)[0][:, 1].max()) if len(x) > 1 else 0.0
    with raise_errors_on_all_processes(comm), np.errstate(all="ignore"):
        # the user's surface may communicate, so all processes have to call it
        answer = interface.surfaces[pair].normal(
            supports_in_surface_frame
            if len(supports_in_surface_frame)
            else interface.first_node_position_of_each_pair[pair]
        )
        normal = np.asarray(answer, dtype=float)[: len(supports_in_surface_frame)]
    node_paths, nodes, behind = pieces.compute_rigid_paths_of_points(x, piece_of_node), [], []
    for j in range(len(supports)):
        from_nodes = supports_in_surface_frame[j] - surface_motion.positions_in_surface_frame(
            pair, placements[sample_at_contact[j]], node_paths[sample_at_contact[j]]
        )
        depth = from_nodes @ normal[j]
        offset = np.linalg.norm(from_nodes - depth[:, None] * normal[j], axis=1)
        offset[(depth <= 0) | ~pieces.is_rigid[piece_of_node]] = np.inf
        nearest = int(offset.argmin())
        if offset[nearest] <= spacing:
            nodes.append(x[nearest])
            behind.append(supports[j])
    ends = [interface.gather_values(np.reshape(part, (-1, x.shape[1]))) for part in (behind, nodes)]
    between = (
        ends[0][:, None]
        + _FRACTIONS_BETWEEN_SUPPORT_AND_NODE[:, None] * (ends[1] - ends[0])[:, None]
    )
    is_inside = np.any(
        [
            _are_points_inside_mesh(body.space.mesh, between.reshape(-1, x.shape[1]))
            for body in list_bodies(interface.field.space)
        ],
        axis=0,
    )
    all_inside = is_inside.reshape(len(ends[0]), len(_FRACTIONS_BETWEEN_SUPPORT_AND_NODE)).all(
        axis=1
    )
    return np.asarray(ends[0][all_inside])


def _are_points_inside_mesh(mesh: Mesh, x: Array) -> Mask:
    """Return a mask (k,) of the points that lie inside the undeformed body; collective.

    All processes have to pass the same points `x` (k, dim).
    """
    points = np.zeros((len(x), 3))
    points[:, : x.shape[1]] = x
    tree = geometry.bb_tree(mesh, mesh.topology.dim)
    candidates = geometry.compute_collisions_points(tree, points)
    n_cells = np.diff(geometry.compute_colliding_cells(mesh, candidates, points).offsets)
    mesh.comm.Allreduce(MPI.IN_PLACE, n_cells, MPI.SUM)
    return np.asarray(n_cells > 0)


def raise_if_supports_meet_or_pass(
    interface: ContactInterface,
    references: Mapping[int, MortarSlipReference],
    positions: Array,
    is_supported: Mask,
    support_paths: Array,
) -> None:
    """Raise SurfacePassed if supports of two bodies in contact meet or pass each other.

    Args:
        interface: contact nodes of all pairs.
        references: for the number of each pair of two bodies, the state of both sides at the start
            of the increment.
        positions: undeformed positions (n, dim) of the nodes of this process.
        is_supported: mask (n, dim) of displacement components that supports prescribe.
        support_paths: prescribed displacements (samples, n, dim), the first sample at the start.

    Raises:
        SurfacePassed: if the normal distance between the supports of both bodies becomes zero or
            negative, to within round-off.
    """
    comm, is_fixed = interface.comm, is_supported.all(axis=1)
    for k, reference in references.items():
        if not reference.is_facing_master.any():
            continue
        slaves = reference.x[: len(reference.is_facing_master)][reference.is_facing_master]
        normal = reference.normals[reference.is_facing_master].mean(axis=0)
        normal /= max(float(np.linalg.norm(normal)), np.finfo(float).tiny)
        start = positions[is_fixed] + support_paths[0][is_fixed]
        is_above = (start - slaves.mean(axis=0)) @ normal > 0
        means = []
        for side in (is_above, ~is_above):
            total = comm.allreduce(
                np.sum((positions + support_paths)[:, is_fixed][:, side], axis=1), MPI.SUM
            )
            n_supports = comm.allreduce(int(side.sum()), MPI.SUM)
            means.append(total / max(n_supports, 1))
            if not n_supports:
                break
        else:
            separation = means[0] - means[1]  # (samples, dim)
            motion = separation - separation[0]
            offset = np.linalg.norm(motion - np.outer(motion @ normal, normal), axis=1)
            extent = _extent_of_smaller_side(interface, k)
            distance = np.where(
                offset < _MAX_OFFSET_OF_MEETING_SUPPORTS_PER_EXTENT * extent,
                separation @ normal,
                np.inf,
            )
            min_distance, min_room = float(distance.min()), _MIN_ROOM_FOR_BODY_PER_EXTENT * extent
            if min_distance < -min_room:
                raise SurfacePassed(
                    f"the supports of both bodies of contact pair {k} pass each other by "
                    f"{-min_distance:.3g}: the bodies are driven through each other; end the "
                    "motion before"
                )
            if min_distance <= min_room:
                raise SurfacePassed(
                    f"the supports of both bodies of contact pair {k} are led up to each other: no "
                    "room is left for the bodies between them; end the motion before"
                )


def raise_if_slave_nodes_pass_through_master(
    interface: ContactInterface,
    reference_and_positions_by_pair: Mapping[int, tuple[MortarSlipReference, Array]],
) -> None:
    """Raise SolutionNotFound if slave nodes pass through the master on straight paths; collective.

    A node counts if it gets deeper into the master than a fraction of the extent of the smaller
    side.

    Args:
        interface: contact nodes of all pairs.
        reference_and_positions_by_pair: for the number of each pair of two bodies, the state of
            both sides at the start of the path and the node positions (nodes, dim) at its end.
    """
    for k, (reference, x) in reference_and_positions_by_pair.items():
        mortar = interface.mortars[k]
        depth = mortar.measure_max_penetration_along_path(reference.x, x)
        is_passed = depth > _MAX_SLAVE_NODE_DEPTH_PER_EXTENT * _extent_of_smaller_side(interface, k)
        positions = mortar.x[: mortar.n_slave_nodes][is_passed]
        if len(positions):
            raise SolutionNotFound.with_positions(
                "contact nodes first at {} pass through the other side", positions
            )


def _extent_of_smaller_side(interface: ContactInterface, pair: int) -> float:
    """Return the largest extent of a pair's contact nodes along an axis.

    For two bodies, it is the extent of the smaller side.
    """
    sides = [interface.gather_pair_in_position_order(pair, interface.position)]
    if pair in interface.mortars:
        mortar = interface.mortars[pair]
        sides = [mortar.x[: mortar.n_slave_nodes], mortar.x[mortar.n_slave_nodes :]]
    return min(float(np.ptp(side, axis=0).max()) for side in sides)


def interpolate_placements_and_path(
    start_placements: Array, end_placements: Array, path: Array, n_intervals: int
) -> tuple[Array, Array]:
    """Return placements of surfaces and values along a path at equally spaced samples.

    Args:
        start_placements: translations and angles (pairs, dim + 1) of the surfaces at the start.
        end_placements: translations and angles (pairs, dim + 1) of the surfaces at the end.
        path: values (k, ...) at equally spaced points of the path.
        n_intervals: number of intervals between the samples.

    Returns:
        Placements (n_intervals + 1, pairs, dim + 1), and values (n_intervals + 1, ...) of the path.
    """
    fractions: Array = np.linspace(0, 1, n_intervals + 1, dtype=float)
    placements = np.array(
        [(1 - fraction) * start_placements + fraction * end_placements for fraction in fractions]
    )
    return placements, _interpolate_path(path, fractions)


def _interpolate_path(path: Array, fractions: Array) -> Array:
    """Return values (k, ...) that are linearly interpolated along a path.

    Args:
        path: values (samples + 1, ...) at equally spaced points.
        fractions: fractions (k,) of the path at which values are returned.
    """
    position = fractions * (len(path) - 1)
    lower = np.minimum(position.astype(int), len(path) - 2)
    weight = (position - lower).reshape(-1, *[1] * (path.ndim - 1))
    return np.asarray((1 - weight) * path[lower] + weight * path[lower + 1])
