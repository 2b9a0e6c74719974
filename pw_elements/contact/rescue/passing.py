"""Refusal of increments that drive bodies, or a tool and a body, through each other.

Supports and prescribed tools have known ways. Where one is led through the other no state is worth
looking for; and where two bodies have passed each other in one step, what is found is none.
"""

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
from dolfinx import geometry
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import collective_errors, format_points
from pw_elements.contact.interface import Interface, SlidingReference
from pw_elements.contact.model import SurfacePassed
from pw_elements.contact.nodes import RigidSurfaceMotion
from pw_elements.contact.rescue.placing import SupportedPieces

# Depth of a support within a tool, and of a side within another one, over the extent of the side,
# by which it has been driven through; and the offset along the side up to which it still meets it
_SUPPORT_DEPTH, _DEPTH, _OFFSET = 0.1, 0.25, 0.5
# Distance of a support from a tool, or from another one, over the same extent, that is none; places
# on the way from a support to a contact node that are looked for within the body; and supports that
# are looked at on each process
_NO_ROOM, _BETWEEN, _MOST_REACHED = 1e-9, np.linspace(0.1, 0.9, 9), 100


def refuse_tools_through_supports(
    interface: Interface,
    motion: RigidSurfaceMotion,
    positions: Array,
    held: Mask,
    number: Indices,
    ways: Array,
    paths: Array,
) -> None:
    """Raise SurfacePassed if a rigid surface is led through nodes that are held, or up to them.

    What is led up to a support leaves no room for the body that lies between both. It does where
    the straight way from the support to a contact node in front of it is in the body.

    Args:
        interface: the contact points.
        motion: of their surfaces.
        positions: (n, dim), undeformed, of nodes of this process.
        held: (n, dim), components that supports prescribe.
        number: (n,), the connected piece that each node belongs to.
        ways: (samples, pairs, dim + 1), placements of the surfaces; NaN where they are free.
        paths: (samples, n, dim), prescribed displacements.
    """
    fixed = held.all(axis=1)
    for k, surface in enumerate(interface.surfaces):
        if k in interface.mortars or np.isnan(ways[:, k]).any():
            continue
        seen = np.array(
            [
                motion.positions_in_surface_frame(k, ways[j, k], positions[fixed] + paths[j][fixed])
                for j in range(len(ways))
            ]
        )
        count, other = int(fixed.sum()), interface.first_nodes[k]
        with collective_errors(interface.comm), np.errstate(all="ignore"):
            asked = [surface.gap(x if count else other) for x in seen]
            gaps: Array = np.array([np.asarray(one, dtype=float)[:count] for one in asked])
        gaps = np.where(np.isnan(gaps), np.inf, gaps)
        least, extent = gaps.min(axis=0, initial=np.inf), _extent(interface, k)
        deep = least < -_SUPPORT_DEPTH * extent
        places = interface.gathered(positions[fixed][deep & (gaps[0] > 0)])
        if len(places):
            raise SurfacePassed(
                f"the motion of the surface of contact pair {k} leads it through the supports at "
                f"{format_points(places)}: it passes through the body; end it before"
            )
        room = _NO_ROOM * extent
        reached = np.flatnonzero((least <= room) & (gaps[0] > room))
        if not len(interface.gathered(reached)):
            continue
        reached = reached[np.argsort(least[reached])[:_MOST_REACHED]]
        pieces = SupportedPieces.fit(positions, held, number, paths, interface.comm)
        sample = gaps[:, reached].argmin(axis=0)
        supports = positions[fixed][reached], seen[sample, reached], sample
        places = _find_crushed(interface, motion, k, pieces, ways[:, k], *supports)
        if len(places):
            raise SurfacePassed(
                f"the motion of the surface of contact pair {k} leads it up to the supports at "
                f"{format_points(places)}: no room is left for the body between both; end it before"
            )


def _find_crushed(
    interface: Interface,
    motion: RigidSurfaceMotion,
    pair: int,
    pieces: SupportedPieces,
    way: Array,
    supports: Array,
    seen: Array,
    sample: Indices,
) -> Array:
    """Return undeformed positions (k, dim), of all processes, of supports behind contact nodes.

    Args:
        interface: the contact points.
        motion: of their surfaces.
        pair: whose surface has reached the supports.
        pieces: of the body, as supports carry them along.
        way: (samples, dim + 1), placements of the surface.
        supports: (s, dim), undeformed positions, of this process.
        seen: (s, dim), the supports in the frame of the surface, where they are reached.
        sample: (s,), when that is.
    """
    comm, mine = interface.comm, interface.pair == pair
    x = interface.gathered(interface.position[mine])
    of_node = interface.gathered(pieces.number[interface.own_nodes[mine]])
    spacing = float(cKDTree(x).query(x, 2)[0][:, 1].max()) if len(x) > 1 else 0.0
    with collective_errors(comm), np.errstate(all="ignore"):
        # a user's surface may communicate: all processes ask it
        asked = interface.surfaces[pair].normal(seen if len(seen) else interface.first_nodes[pair])
        normal = np.asarray(asked, dtype=float)[: len(seen)]
    moved, nodes, behind = pieces.move(x, of_node), [], []
    for j in range(len(supports)):
        away = seen[j] - motion.positions_in_surface_frame(pair, way[sample[j]], moved[sample[j]])
        depth = away @ normal[j]
        beside = np.linalg.norm(away - depth[:, None] * normal[j], axis=1)
        beside[(depth <= 0) | ~pieces.rigid[of_node]] = np.inf
        nearest = int(beside.argmin())
        if beside[nearest] <= spacing:
            nodes.append(x[nearest])
            behind.append(supports[j])
    ends = [interface.gathered(np.reshape(part, (-1, x.shape[1]))) for part in (behind, nodes)]
    between = ends[0][:, None] + _BETWEEN[:, None] * (ends[1] - ends[0])[:, None]
    inside = _lie_inside(interface.field.space.mesh, between.reshape(-1, x.shape[1]))
    return np.asarray(ends[0][inside.reshape(len(ends[0]), len(_BETWEEN)).all(axis=1)])


def _lie_inside(mesh: Mesh, x: Array) -> Mask:
    """Return which places (k, dim), the same on all processes, are in an undeformed body."""
    points = np.zeros((len(x), 3))
    points[:, : x.shape[1]] = x
    tree = geometry.bb_tree(mesh, mesh.topology.dim)
    cells = geometry.compute_collisions_points(tree, points)
    number = np.diff(geometry.compute_colliding_cells(mesh, cells, points).offsets)
    mesh.comm.Allreduce(MPI.IN_PLACE, number, MPI.SUM)
    return np.asarray(number > 0)


def refuse_supports_through_each_other(
    interface: Interface,
    references: Mapping[int, SlidingReference],
    positions: Array,
    held: Mask,
    paths: Array,
) -> None:
    """Raise SurfacePassed if supports of two bodies, which face each other, meet or change sides.

    Args:
        interface: the contact points.
        references: of pairs of bodies, at the start.
        positions: (n, dim), undeformed, of nodes of this process.
        held: (n, dim), components that supports prescribe.
        paths: (samples, n, dim), prescribed displacements, the first ones at the start.
    """
    comm, fixed = interface.comm, held.all(axis=1)
    for k, reference in references.items():
        if not reference.faced.any():
            continue
        slaves = reference.x[: len(reference.faced)][reference.faced]
        tangent = reference.tangents[reference.faced].mean(axis=0)
        tangent /= max(float(np.linalg.norm(tangent)), np.finfo(float).tiny)
        normal = np.array([tangent[1], -tangent[0]])
        start = positions[fixed] + paths[0][fixed]
        above = (start - slaves.mean(axis=0)) @ normal > 0
        means = []
        for side in (above, ~above):
            total = comm.allreduce(np.sum((positions + paths)[:, fixed][:, side], axis=1), MPI.SUM)
            count = comm.allreduce(int(side.sum()), MPI.SUM)
            means.append(total / max(count, 1))
            if not count:
                break
        else:
            apart = means[0] - means[1]  # (samples, dim)
            offset = np.abs((apart - apart[0]) @ tangent)
            extent = _extent(interface, k)
            distance = np.where(offset < _OFFSET * extent, apart @ normal, np.inf)
            least, room = float(distance.min()), _NO_ROOM * extent
            if least < -room:
                raise SurfacePassed(
                    f"the supports of both bodies of contact pair {k} pass each other by "
                    f"{-least:.3g}: the bodies are driven through each other; end the motion before"
                )
            if least <= room:
                raise SurfacePassed(
                    f"the supports of both bodies of contact pair {k} are led up to each other: no "
                    "room is left for the bodies between them; end the motion before"
                )


def find_passed(interface: Interface, pair: int, start: Array, end: Array) -> Array:
    """Return undeformed positions (p, dim) of slave nodes that go through the master's side.

    On the straight path between positions (n, dim) of both sides, deeper than part of their extent.
    """
    mortar = interface.mortars[pair]
    depth = mortar.measure_penetration(start, end)
    return np.asarray(mortar.x[: mortar.n_slave_nodes][depth > _DEPTH * _extent(interface, pair)])


def _extent(interface: Interface, pair: int) -> float:
    """Return the largest extent of a pair's contact nodes, or of the smaller side of two bodies."""
    sides = [interface.in_order(pair, interface.position)]
    if pair in interface.mortars:
        mortar = interface.mortars[pair]
        sides = [mortar.x[: mortar.n_slave_nodes], mortar.x[mortar.n_slave_nodes :]]
    return min(float(np.ptp(side, axis=0).max()) for side in sides)


def sample_ways(q_start: Array, q_end: Array, path: Array, samples: int) -> tuple[Array, Array]:
    """Return placements (samples + 1, pairs, dim + 1) of surfaces, and of a path."""
    shares: Array = np.linspace(0, 1, samples + 1, dtype=float)
    ways = np.array([(1 - s) * q_start + s * q_end for s in shares])
    return ways, _interpolate(path, shares)


def _interpolate(path: Array, shares: Array) -> Array:
    """Return values (k, ...) at shares (k,) of a path (samples + 1, ...) by straight pieces."""
    place = shares * (len(path) - 1)
    before = np.minimum(place.astype(int), len(path) - 2)
    after = (place - before).reshape(-1, *[1] * (path.ndim - 1))
    return np.asarray((1 - after) * path[before] + after * path[before + 1])
