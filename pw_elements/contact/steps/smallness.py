"""Checks of a solved increment, which warn where another one would be better.

Displacements stay small, surfaces outside of the body, and the law's slip is that of the path of
material points (`PairState.path_slip`). The guide's page on theory says what is refused of rigid
surfaces, and why ("Contact").
"""

import logging

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks import collective_errors, format_points
from pw_elements.contact.interface import OUTWARDS, RIGID, Interface, compute_flat_facets
from pw_elements.contact.iteration import Increment, NewtonState
from pw_elements.contact.model import ContactState, PairState, Smallness, SurfacePassed
from pw_elements.contact.nodes import OPEN, IncrementStart
from pw_elements.progress import log_on_root

# Cells at a time
_CELLS_AT_ONCE = 4_000

# A body pushed beyond its far side has a strain of about one; below this that is not looked for
_CRUSHING_STRAIN = 0.5
# Round-off of places, over the largest
_NEAR = 1e-9
# Step along a surface's way, and depth that counts as swallowed, over the smallest facet
_WAY_STEP = 0.25
_SWALLOWED = 1e-3
# The way has this many steps at most
_MOST_WAY_STEPS = 10_000

# Largest difference of both slips over the larger one
MAX_DIFFERENCE = 0.1
# What differences do not count below, over the shortest facet around a node that another deformed
# body faces, whose slip is a mean over facets, and over the largest displacement elsewhere
_OF_FACET, _OF_DISPLACEMENT = 0.05, 1e-6

# Second-order terms are left out: strains e err by e/2 of themselves, a rotation w turns forces
# by w and makes strains of w^2/2. Half of the way to the next node, a node has another partner.
_SMALL = Smallness(strain=0.05, rotation=0.05, slip=0.5)


def gradient_at_vertices(u: fem.Function) -> fem.Expression:
    """Return the gradient of displacements at the vertices of cells.

    On straight simplices with quadratic displacements it is linear, and the norms of its parts are
    largest there.
    """
    return fem.Expression(ufl.grad(u), basix.geometry(u.function_space.mesh.basix_cell()))


def measure_largest_gradient(
    gradient: fem.Expression, u: fem.Function, displacement: PETSc.Vec
) -> tuple[float, float]:
    """Return the largest spectral norms of the symmetric and the antisymmetric part of a gradient.

    They are those of all cells of all processes. The latter is the largest angle of rotation in
    radians. Hoop strains are left out: whether the body is one of revolution is not known here.

    Args:
        gradient: of u, as of `gradient_at_vertices`.
        u: function that is set to the displacements.
        displacement: vector (n,) in the numbering of the space of u.
    """
    mesh = u.function_space.mesh
    u.x.array[: displacement.getLocalSize()] = displacement.array_r
    u.x.scatter_forward()
    dim, owned = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    strain, rotation = 0.0, 0.0
    for first in range(0, owned, _CELLS_AT_ONCE):
        cells = np.arange(first, min(first + _CELLS_AT_ONCE, owned), dtype=np.int32)
        values = np.reshape(gradient.eval(mesh, cells), (-1, dim, dim))
        transposed = np.swapaxes(values, 1, 2)
        symmetric, skew = (values + transposed) / 2, (values - transposed) / 2
        frobenius = np.linalg.norm(symmetric, axis=(1, 2))
        # the norm lies between this and this over sqrt(dim): few are to be looked at
        strain = max(strain, float(frobenius.max()) / np.sqrt(dim))
        principal = np.linalg.eigvalsh(symmetric[frobenius >= strain])
        strain = float(np.abs(principal).max(initial=strain))
        # two entries for each component of the axial vector, whose length is the norm
        turns = np.linalg.norm(skew, axis=(1, 2)) / np.sqrt(2)
        rotation = max(rotation, float(turns.max()))
    return mesh.comm.allreduce(strain, MPI.MAX), mesh.comm.allreduce(rotation, MPI.MAX)


def log_large(smallness: Smallness, before: Smallness, when: str, comm: MPI.Comm) -> None:
    """Logs what is no longer small, and was before."""
    left = [
        f"largest {name} {value:.3g} (above {limit:g})"
        for name, value in vars(smallness).items()
        if value > (limit := getattr(_SMALL, name)) >= getattr(before, name)
    ]
    if left:
        words = f"{when} leaves the range of small displacements: {', '.join(left)}"
        log_on_root(comm, logging.WARNING, words, ".contact")


class SmallnessCheck:
    def __init__(self, interface: Interface, space: fem.FunctionSpace) -> None:
        self._interface, self._comm = interface, interface.comm
        self._u = fem.Function(space)
        self._gradient = gradient_at_vertices(self._u)
        self._point, self._outward, size = _facets_around(interface.node, space)
        self._sizes = np.full(len(interface.node), np.inf)
        np.minimum.at(self._sizes, self._point, size)
        rows = [interface.pair == k for k in range(interface.pairs)]
        self.finest = [
            self._comm.allreduce(self._sizes[mine].min(initial=np.inf), MPI.MIN) for mine in rows
        ]
        self._rigid = [
            not self._comm.allreduce(bool(np.any(interface.faced[mine] != RIGID)), MPI.LOR)
            for mine in rows
        ]

    def before(self, increment: Increment) -> None:
        """Refuses, as `SurfacePassed`, motions that are prescribed to lead through the body."""
        start = increment.start
        known = np.isfinite(increment.prescribed)
        self._check_way(start, np.where(known, increment.prescribed, start.q))

    def after(self, increment: Increment, end: NewtonState, before: ContactState) -> Smallness:
        """How small the displacements of a solution are; logs what no longer is, once.

        Refuses, as `SurfacePassed`, surfaces that have gone through the body or push it outwards.
        """
        self._check_way(increment.start, end.q)
        interface, nodes = self._interface, end.nodes
        displacement = interface.field.extract(end.unknowns)
        strain, rotation = measure_largest_gradient(self._gradient, self._u, displacement)
        closed = nodes.active_set.status != OPEN
        cosine = self._cosines(nodes.frame[:, 0])
        for k in np.flatnonzero(self._rigid):
            mine = closed & (interface.pair == k)
            self._refuse(k, mine & (cosine > OUTWARDS), "pushes the body outwards at")
            if strain > _CRUSHING_STRAIN:
                through = mine & self._through(end)
                self._refuse(k, through, "is through the whole thickness of the body at")
        smallness = Smallness(strain, rotation, self._slip(increment, end))
        when = f"increment {before.increment}"
        log_large(smallness, before.smallness or Smallness(), when, self._comm)
        return smallness

    def _slip(self, increment: Increment, end: NewtonState) -> float:
        """Largest slip over the size of facets; of two bodies, that since the beginning."""
        interface, nodes = self._interface, end.nodes
        moved = end.displacement - end.q[interface.pair]
        was = increment.start.displacement - increment.start.q[interface.pair]
        moved = moved - np.where((interface.faced == RIGID)[:, None], was, 0.0)
        slip = np.linalg.norm(np.einsum("nab,nb->na", nodes.frame[:, 1:], moved), axis=1)
        closed = nodes.active_set.status != OPEN
        largest = np.max(slip / self._sizes, where=closed, initial=0.0)
        return float(self._comm.allreduce(largest, MPI.MAX))

    def _cosines(self, normal: Array) -> Array:
        """Least cosine (m,) between vectors (m, dim) and the outward normals around a point."""
        least = np.full(len(normal), np.inf)
        cosine = np.sum(normal[self._point] * self._outward, axis=1)
        np.minimum.at(least, self._point, cosine)
        return least

    def _check_way(self, start: IncrementStart, translations: Array) -> None:
        """Looks along the straight ways of the surfaces to translations (pairs, dim)."""
        for k, rigid in enumerate(self._rigid):
            way = translations[k] - start.q[k]
            if rigid and np.linalg.norm(way) > _WAY_STEP * self.finest[k]:
                wrong = self._swallowed(k, start, way)
                self._refuse(k, wrong, "passes through the body: it goes through the nodes at")

    def _swallowed(self, k: int, start: IncrementStart, way: Array) -> Mask:
        """Points (m,) that a pair's surface swallows from the wrong side on its way."""
        interface, mine = self._interface, self._interface.pair == k
        surface, size = interface.surfaces[k], self.finest[k]
        x, before = interface.position[mine] - start.q[k], start.displacement[mine]
        length = float(np.linalg.norm(way))
        step = max(_WAY_STEP * size, length / _MOST_WAY_STEPS)
        # no sample just where a surface has no normal, such as the centre of a sphere
        x = x + 1e-7 * size * np.sqrt(np.arange(2, 2 + x.shape[1]))

        share, wrong = np.zeros(len(x)), np.zeros(len(mine), dtype=bool)
        pushed = np.zeros_like(interface.position)
        count, other, ended = len(x), interface.first_nodes[k], False
        while not ended:
            with collective_errors(self._comm):
                place = x - share[:, None] * way if count else other
                gap, normal = surface.gap(place)[:count], surface.normal(place)[:count]
                depth = -(gap + np.sum(normal * before, axis=1))
                pushed[mine] = normal
                outwards = self._cosines(pushed)[mine] > OUTWARDS
                wrong[mine] |= outwards & (depth > _SWALLOWED * size)
                # outside, the surface is a gap away at least; half of it, if that is no distance
                stride = np.maximum(np.where(np.isfinite(gap), gap / 2, 0.0), step)
                last, share = share, np.minimum(share + stride / length, 1.0)
            ended = self._comm.allreduce(bool(last.min(initial=1.0) >= 1), MPI.LAND)
        return wrong

    def _through(self, end: NewtonState) -> Mask:
        """Which points (m,) are beyond the nodes that were the farthest along their normals."""
        interface, u = self._interface, self._u  # the latter has just been set
        dim, normal = interface.position.shape[1], end.nodes.frame[:, 0]
        x = u.function_space.tabulate_dof_coordinates()[:, :dim]
        moved, every = x + u.x.array.reshape(-1, dim), interface.gathered(normal)
        ends = np.array([(x @ n).max() for n in every])
        ends = np.max(self._comm.allgather(ends), axis=0) - _NEAR * np.abs(x).max()
        last = [
            (moved @ n).max(where=x @ n >= end, initial=-np.inf)
            for n, end in zip(every, ends, strict=True)
        ]
        first = sum(self._comm.allgather(len(normal))[: self._comm.rank])
        most = np.max(self._comm.allgather(last), axis=0)[first : first + len(normal)]
        own = np.sum(normal * (interface.position + end.displacement), axis=1)
        return own >= most - _NEAR * np.abs(most)

    def _refuse(self, k: int, wrong: Mask, what: str) -> None:
        places = self._interface.gathered(self._interface.position[wrong])
        if len(places):
            raise SurfacePassed(
                f"the surface of contact pair {k} {what} {format_points(places)}; contact is "
                "stated for small displacements and surfaces that come from outside: move it less "
                "far, or round the body in increments that stay clear of it"
            )


def _facets_around(node: Indices, space: fem.FunctionSpace) -> tuple[Indices, Array, Array]:
    """Facets (f,) around nodes (m,) of this process: the node's place, normals, and sizes.

    A facet counts once for each of its nodes, those of other processes too. Its size is the
    largest distance of two of them.
    """
    mesh, comm = space.mesh, space.mesh.comm
    mesh.topology.create_connectivity(mesh.topology.dim - 1, mesh.topology.dim)
    nodes, x, normal = compute_flat_facets(space, exterior_facet_indices(mesh.topology))
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    facet, place = np.nonzero(np.isin(number, np.concatenate(comm.allgather(node))))
    across = np.linalg.norm(x[facet][:, :, None] - x[facet][:, None], axis=3).max(axis=(1, 2))
    touched, outward, size = (
        np.concatenate(comm.allgather(part))
        for part in (number[facet, place], normal[facet], across)
    )
    mine = np.isin(touched, node)
    order = np.argsort(node)
    point = order[np.searchsorted(node, touched[mine], sorter=order)]
    return point, outward[mine], size[mine]


class SlipCheck:
    """Logs a warning where slips of rough nodes differ, once for each pair."""

    def __init__(self, interface: Interface) -> None:
        self._comm, self._warned = interface.comm, set[int]()
        self._facets = {
            k: (mortar.nodes[: mortar.n_slave_nodes], mortar.measure_shortest_facets())
            for k, mortar in interface.mortars.items()
        }

    def check(self, state: ContactState) -> None:
        for k, pair in enumerate(state.pairs):
            apart = measure_slip_difference(pair)
            allowed: Array | float = _OF_DISPLACEMENT * state.scale.length
            if k in self._facets:
                nodes, lengths = self._facets[k]
                allowed = _OF_FACET * lengths[np.searchsorted(nodes, pair.node)]
            sizes = [np.linalg.norm(slip, axis=1) for slip in (pair.slip, pair.path_slip)]
            rough = (pair.status != OPEN) & (pair.friction > 0)
            wrong = rough & (apart > np.maximum(MAX_DIFFERENCE * np.maximum(*sizes), allowed))
            if wrong.any() and k not in self._warned:
                self._warned.add(k)
                words = (
                    f"increment {state.increment - 1}, contact pair {k}: slip differs from that "
                    f"of the path by up to {apart[wrong].max():.3g}, more than "
                    f"{MAX_DIFFERENCE:.0%} of it, at {wrong.sum()} contact nodes first at "
                    f"{format_points(pair.position[wrong])}, where friction may be wrong: make "
                    "smaller increments and compare `PairState.slip` with `path_slip`"
                )
                log_on_root(self._comm, logging.WARNING, words, ".contact")


def measure_slip_difference(pair: PairState) -> Array:
    """Return the size (m,) of the difference of both slips of a pair's nodes."""
    return np.asarray(np.linalg.norm(pair.slip - pair.path_slip, axis=1))
