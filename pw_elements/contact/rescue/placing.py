"""Places of bodies that move rigidly with their supports, and tools and bodies that leave them.

Where supports carry all pieces of a body along, and everything is clear of its opposite side at the
end of a motion, the body has no contact there, whatever friction has done on the way.
"""

from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import collective_errors
from pw_elements.contact.interface import OUTWARDS, ROUND_OFF, Interface
from pw_elements.contact.nodes import RigidSurfaceMotion
from pw_elements.spaces import gather_from_owners

# Distance of supports from the rigid motion that fits them best, over their piece's extent, that is
# none; and the least spread of supports, over the largest, that determines a rotation
_RIGID_DISTANCE, _MIN_SPREAD = 1e-9, 1e-6
# Depth on the way, over that at the start, up to which what leaves is not led deeper; and the
# longest step between samples over the extent of the contact nodes, between which nothing is missed
_MAX_DEPTH_GROWTH, _MAX_STEP = 1.25, 0.1


@dataclass(frozen=True)
class SupportedPieces:
    """Connected pieces of a body as they move rigidly with their supports, at samples of a path.

    Args:
        number: (nodes,), the piece of each node of this process.
        pivot: (pieces, dim), mean of the supports, undeformed.
        place: (samples, pieces, dim), where it is.
        rotation: (samples, pieces, dim, dim).
        rigid: (pieces,), whether supports determine the motion and agree with it at all samples.
    """

    number: Indices
    pivot: Array
    place: Array
    rotation: Array
    rigid: Mask

    @classmethod
    def fit(
        cls, positions: Array, held: Mask, number: Indices, paths: Array, comm: MPI.Comm
    ) -> "SupportedPieces":
        """Fit rigid motions to the nodes that are held in all components.

        Args:
            positions: (n, dim), undeformed, of nodes of this process.
            held: (n, dim), components that supports prescribe.
            number: (n,), the piece that each node belongs to.
            paths: (samples, n, dim), prescribed displacements.
            comm: of the mesh.
        """
        dim = positions.shape[1]
        count = comm.allreduce(int(number.max(initial=-1)) + 1, MPI.MAX)
        fixed = held.all(axis=1)
        x, piece = positions[fixed], number[fixed]

        def total(values: Array) -> Array:
            sums = np.zeros((count, *values.shape[1:]))
            np.add.at(sums, piece, values)
            comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
            return sums

        nodes = np.maximum(total(np.ones(len(x))), 1.0)[:, None]
        pivot = total(x) / nodes
        arm = x - pivot[piece]
        spread = np.linalg.svd(total(arm[:, :, None] * arm[:, None]), compute_uv=False)
        # in the plane two different supports determine a rotation, in space three
        rigid = (spread[:, 0] > 0) & (spread[:, dim - 2] > _MIN_SPREAD**2 * spread[:, 0])
        places, rotations = [], []
        for path in paths:
            at = x + path[fixed]
            place = total(at) / nodes
            left, _, right = np.linalg.svd(total((at - place[piece])[:, :, None] * arm[:, None]))
            left[:, :, -1] *= np.sign(np.linalg.det(left @ right))[:, None]
            places.append(place)
            rotations.append(left @ right)
        pieces = cls(number, pivot, np.array(places), np.array(rotations), rigid)
        supported = held.any(axis=1)
        x, of_piece = positions[supported], number[supported]
        away = np.abs(pieces.move(x, of_piece) - x - paths[:, supported])
        farthest = np.zeros(count)
        away = np.where(held[supported], away, 0.0).max(axis=(0, 2), initial=0.0)
        np.maximum.at(farthest, of_piece, away)
        comm.Allreduce(MPI.IN_PLACE, farthest, MPI.MAX)
        longest = comm.allreduce(float(np.abs(paths).max(initial=0.0)), MPI.MAX)
        extent = np.sqrt(spread[:, 0] / nodes[:, 0]) + longest
        return replace(pieces, rigid=rigid & (farthest <= _RIGID_DISTANCE * extent))

    def move(self, x: Array, piece: Indices) -> Array:
        """Return places (samples, k, dim) of points x (k, dim) of these pieces (k,)."""
        arm = x - self.pivot[piece]
        return np.asarray(
            self.place[:, piece] + np.einsum("skab,kb->ska", self.rotation[:, piece], arm)
        )


@dataclass(frozen=True)
class _Way:
    """A pair's nodes and opposite side at samples of a way, bodies being where supports put them.

    Args:
        depth: (samples,), of the nodes that are deepest in the opposite side; zero outside of it.
        clearance: least distance of both sides at the end; infinite where nothing is faced.
        deformation: largest distance of the start's nodes from where supports put them.
        step: longest step of a node as the opposite side sees it.
        extent: of the nodes, or of the smaller side of two bodies.
        outside: whether the opposite side has the body in front of it all the way, not behind it.
    """

    depth: Array
    clearance: float
    deformation: float
    step: float
    extent: float
    outside: bool


def ends_clear(
    interface: Interface,
    motion: RigidSurfaceMotion,
    pieces: SupportedPieces,
    ways: Array,
    unknowns: PETSc.Vec,
) -> bool:
    """Return whether a motion leads what is pressed together apart, past all elastic deformation.

    This is so if bodies without deformation, which supports carry along, overlap their opposite
    sides at the start, get no deeper into them on the way, nor behind them, and end farther away
    from them than any node is displaced by deformation at the start.

    Args:
        interface: the contact points (m).
        motion: of rigid surfaces.
        pieces: at the samples.
        ways: (samples, pairs, dim + 1), placements of the opposite sides; NaN where they are free.
        unknowns: (n,), of the state at the start.
    """
    if np.isnan(ways).any() or not pieces.rigid.all():
        return False
    each = []
    for k in range(interface.pairs):
        if k in interface.mortars:
            each.append(_follow_bodies(interface, pieces, k, ways[:, k, :-1], unknowns))
        else:
            each.append(_follow_tool(interface, motion, pieces, k, ways[:, k], unknowns))
    depth = np.max([way.depth for way in each], axis=0)
    deformation = max(way.deformation for way in each)
    return bool(
        depth[0] > ROUND_OFF * interface.extent
        and depth.max() <= _MAX_DEPTH_GROWTH * depth[0]
        and all(way.clearance > deformation and way.outside for way in each)
        and (len(ways) == 2 or all(way.step <= _MAX_STEP * way.extent for way in each))
    )


def _follow_tool(
    interface: Interface,
    motion: RigidSurfaceMotion,
    pieces: SupportedPieces,
    pair: int,
    way: Array,
    unknowns: PETSc.Vec,
) -> _Way:
    """Follow a pair's nodes past a rigid surface at placements (samples, dim + 1)."""
    comm, mine, surface = interface.comm, interface.pair == pair, interface.surfaces[pair]
    x = interface.position[mine]
    piece = pieces.number[interface.own_nodes[mine]]
    moved = pieces.move(x, piece)
    ahead = pieces.move(x + interface.outward[mine], piece)
    seen, beyond = (
        np.array([motion.positions_in_surface_frame(pair, way[j], y[j]) for j in range(len(way))])
        for y in (moved, ahead)
    )
    gap, normal = np.full(seen.shape[:2], np.inf), np.zeros(seen.shape)
    with collective_errors(comm), np.errstate(all="ignore"):
        if len(x):
            points = seen.reshape(-1, x.shape[1])
            gap = np.asarray(surface.gap(points), dtype=float).reshape(gap.shape)
            normal = np.asarray(surface.normal(points), dtype=float).reshape(seen.shape)
    depth = np.where(np.isnan(gap), np.inf, -gap).max(axis=1, initial=0.0)
    comm.Allreduce(MPI.IN_PLACE, depth, MPI.MAX)
    outward = beyond - seen
    pushed = np.sum(normal * outward, axis=2)
    faces = pushed <= OUTWARDS * np.linalg.norm(outward, axis=2)
    now = interface.at_points(unknowns)[mine] + x
    return _Way(
        depth,
        comm.allreduce(gap[-1].min(initial=np.inf), MPI.MIN),
        comm.allreduce(_farthest(now - moved[0]), MPI.MAX),
        comm.allreduce(_farthest(np.diff(seen, axis=0)), MPI.MAX),
        interface.extent,
        comm.allreduce(bool(np.all(faces | (gap >= 0))), MPI.LAND),
    )


def _follow_bodies(
    interface: Interface, pieces: SupportedPieces, pair: int, way: Array, unknowns: PETSc.Vec
) -> _Way:
    """Follow both sides of a pair of bodies, the opposite one being translated (samples, dim)."""
    mortar = interface.mortars[pair]
    slaves, x = mortar.n_slave_nodes, mortar.x
    owned = interface.field.space.dofmap.index_map.size_local
    piece = gather_from_owners(interface.field.space, mortar.nodes, pieces.number[:owned])
    moved = pieces.move(x, piece)
    now = x + interface.at_nodes(mortar.nodes, unknowns)
    deformation = _farthest(now - moved[0])
    moved[:, slaves:] += way[:, None]
    extent = min(float(np.ptp(side, axis=0).max()) for side in (x[:slaves], x[slaves:]))
    seen = moved[:, :slaves] - moved[:, slaves:].mean(axis=1, keepdims=True)
    depth, clearance = np.zeros(len(way)), np.inf
    for j in range(len(moved)):
        y: Array = moved[j]
        facing = mortar.evaluate_for_verification(y)
        gap = facing.measure_gaps(y)
        depth[j] = max(0.0, -gap.min(initial=np.inf))
        if j == len(moved) - 1:
            distance = cKDTree(y[slaves:]).query(y[:slaves])[0].min()
            clearance = min(
                gap.min(initial=np.inf), distance - mortar.measure_shortest_facets().max()
            )
    step = _farthest(np.diff(seen, axis=0))
    return _Way(depth, clearance, deformation, step, extent, outside=True)


def _farthest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max(initial=0.0))
