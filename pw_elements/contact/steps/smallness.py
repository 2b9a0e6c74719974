"""The smallness check of an increment: displacements stay small, surfaces outside of the body.

Once a surface has gone through the body the law means nothing. It takes gap and normal at the
undeformed body, and nothing in it says that a surface comes from outside: one that has gone too
far pulls, or is out of reach on the other side of the body, and all conditions hold. So three
things are refused of rigid surfaces:

- nodes that a surface swallows, on its straight way to its place, from where it would push them
  outwards: against the outward normals of all facets around;
- nodes in contact that are pushed outwards;
- nodes in contact that have been pushed as far as the other side of the body: the chord from
  the node through the body, along the push, has no length left. The body as a whole may move and
  bend however far with the surface.
"""

import logging
from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI
from petsc4py import PETSc

import basix
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices

from pw_elements.arrays import Array, Indices, Local, Mask
from pw_elements.checks import collective, listed
from pw_elements.contact.interface import RIGID, SIMPLICES, Interface, flat_facets
from pw_elements.contact.iteration import OPEN, Increment, Iterate, Reference
from pw_elements.contact.model import ContactState, Smallness, SurfacePassed
from pw_elements.progress import told
from pw_elements.spaces import as_function

# Cells at a time
_CELLS_AT_ONCE = 4_000


# Least cosine between a ray and the outward normal of a facet that lies across it
_ACROSS = 0.6
# Round-off of places, relative
_NEAR = 1e-9


# Cosine from which on a push counts as outwards, and below minus which as inwards
_OUTWARDS = 0.1
# Step along a surface's way, and depth that counts as swallowed, over the smallest facet
_WAY_STEP = 0.25
_SWALLOWED = 1e-3
# The way has this many steps at most
_MOST_WAY_STEPS = 10_000
# A chord without length has a mean strain of -1; no strain is as large at fewer than this
_CRUSHING_STRAIN = 0.5
# What is left of a chord without length, by round-off
_NO_CHORD = 1e-9
# Number of nodes in contact, those pushed farthest, whose chords are looked at
_MOST_CHORDS = 50

# Second-order terms are left out: strains e err by e/2 of themselves, a rotation w turns forces
# by w and makes strains of w^2/2. Half of the way to the next node, a node has another partner.
_SMALL = Smallness(strain=0.05, rotation=0.05, slip=0.5)

# Forces of meshes' own gaps, over all that press interfering bodies apart, that are much
_NOISE = 0.1
_OF_MESHES = (
    "contact pair %d: gaps that meshes leave within facets, times stiffness, are %.2g of the "
    "forces that press the bodies apart, and pressures are off by as much: use finer meshes, or "
    "DeformableSurface(..., coincident=True) and the depth as interference"
)


class Gradients:
    """Gradients of displacements u at the vertices of all cells, and within where they curve.

    On straight simplices with quadratic displacements they are linear, and the norms of their
    parts are largest at vertices. Elsewhere quadrature points of degree 4 are taken, too.
    """

    def __init__(self, space: fem.FunctionSpace) -> None:
        self._mesh, self.u = space.mesh, fem.Function(space)
        shape = space.mesh.ufl_domain().ufl_coordinate_element().basix_element
        element = space.element.basix_element
        points = basix.geometry(shape.cell_type)
        straight = shape.degree == 1 and len(points) == len(points[0]) + 1
        if not (straight and element.family is basix.ElementFamily.P and element.degree <= 2):
            points = np.vstack([points, basix.make_quadrature(shape.cell_type, 4)[0]])
        self._gradient = fem.Expression(ufl.grad(self.u), points)

    def largest(self, displacement: PETSc.Vec) -> tuple[float, float]:
        """Largest spectral norms of the symmetric and the antisymmetric part, of all processes.

        The latter is the largest angle of rotation in radians. Hoop strains are left out: whether
        the body is one of revolution is not known here.
        """
        mesh = self._mesh
        dim, owned = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
        as_function(self.u.function_space, displacement, out=self.u)
        strain, rotation = 0.0, 0.0
        for first in range(0, owned, _CELLS_AT_ONCE):
            cells = np.arange(first, min(first + _CELLS_AT_ONCE, owned), dtype=np.int32)
            gradient = np.reshape(self._gradient.eval(mesh, cells), (-1, dim, dim))
            strain = _largest_symmetric(gradient, strain)
            skew = (gradient - np.swapaxes(gradient, 1, 2)) / 2
            # two entries for each component of the axial vector, whose length is the norm
            squares = np.einsum("pij,pij->p", skew, skew) / 2
            rotation = max(rotation, float(np.sqrt(squares.max(initial=0.0))))
        return mesh.comm.allreduce(strain, MPI.MAX), mesh.comm.allreduce(rotation, MPI.MAX)


def _largest_symmetric(gradient: Array, least: float) -> float:
    """Largest spectral norm of the symmetric parts of (n, dim, dim), and of a number."""
    symmetric = (gradient + np.swapaxes(gradient, 1, 2)) / 2
    frobenius = np.sqrt(np.einsum("pij,pij->p", symmetric, symmetric))
    # the norm lies between this and this over sqrt(dim): few are to be looked at
    least = max(least, float(frobenius.max(initial=0.0)) / np.sqrt(gradient.shape[1]))
    values = np.linalg.eigvalsh(symmetric[frobenius >= least])
    return float(np.abs(values).max(initial=least))


@dataclass(frozen=True)
class Exterior:
    """Exterior facets (f of them) of this process, seen as flat."""

    nodes: Local  # (f, k), local numbers
    vertices: Local  # (f, l), of those at the corners
    corner: Array  # (f, l, dim)
    outward: Array  # (f, dim), unit normals

    @classmethod
    def of(cls, space: fem.FunctionSpace) -> "Exterior":
        """Collects the exterior facets of a space's mesh."""
        mesh, dim = space.mesh, space.mesh.topology.dim
        mesh.topology.create_connectivity(dim - 1, dim)
        nodes, x, outward = flat_facets(space, exterior_facet_indices(mesh.topology))
        corners = len(basix.topology(mesh.basix_cell())[dim - 1][0])
        return cls(nodes, nodes[:, :corners], x[:, :corners], outward)

    @property
    def size(self) -> Array:
        """Largest distance (f,) of two corners."""
        ends = combinations(range(self.corner.shape[1]), 2)
        sides = [self.corner[:, a] - self.corner[:, b] for a, b in ends]
        return np.asarray(np.max([np.linalg.norm(side, axis=1) for side in sides], axis=0))

    def exit(self, origin: Array, direction: Array, moved: Array) -> tuple[float, Array]:
        """Where a ray leaves the body through a facet of this process that lies across it.

        The ray starts on the boundary, its unit direction (dim,) leads into the body; corners are
        `moved` by (f, l, dim). The distance is infinite if there is no such facet, and comes with
        the displacement (dim,) there.
        """
        distance, there = np.inf, np.zeros(len(origin))
        across = self.outward @ direction > _ACROSS
        least = _NEAR * np.abs(self.corner).max(initial=0.0)
        for corners in SIMPLICES[self.corner.shape[1]]:
            x, u = self.corner[across][:, corners], moved[across][:, corners]
            edges = np.swapaxes(x[:, 1:] - x[:, :1], 1, 2)
            rays = np.broadcast_to(-direction[:, None], (len(x), len(origin), 1))
            matrix = np.concatenate([edges, rays], axis=2)
            found = np.linalg.solve(matrix, (origin - x[:, 0])[:, :, None])[:, :, 0]
            share, t = found[:, :-1], found[:, -1]
            inside = (share >= -_NEAR).all(axis=1) & (share.sum(axis=1) <= 1 + _NEAR)
            t = np.where(inside & (t > least), t, np.inf)
            if len(t) and t.min() < distance:
                k = int(np.argmin(t))
                distance = float(t[k])
                there = u[k, 0] + share[k] @ (u[k, 1:] - u[k, 0])
        return distance, there


class SmallnessCheck:
    """Checks that displacements stay small and surfaces outside of the body."""

    def __init__(self, interface: Interface, space: fem.FunctionSpace) -> None:
        self._interface, self._comm = interface, interface.comm
        self._exterior, self._gradients = Exterior.of(space), Gradients(space)
        self._point, self._outward, size = _facets_around(interface.node, space, self._exterior)
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
        past = increment.past
        known = np.isfinite(increment.prescribed)
        self._check_way(past, np.where(known, increment.prescribed, past.translations))

    def after(self, increment: Increment, now: Iterate, before: ContactState) -> Smallness:
        """How small the displacements of a solution are; logs what no longer is, once.

        Refuses, as `SurfacePassed`, surfaces that have gone through the body or push it outwards.
        """
        self._check_way(increment.past, now.translations)
        strain, rotation = self._gradients.largest(self._interface.field.part(now.full))
        self._check_contact(now, strain)
        smallness = Smallness(strain, rotation, self._slip(increment, now))
        self._warn_of_noise(increment, now)
        return self._told(
            smallness, before.smallness or Smallness(), f"increment {before.increment}"
        )

    def of_motion(self, state: ContactState, step: int, before: Smallness) -> Smallness:
        """How small displacements in a frame of dynamics are; logs what no longer is, once.

        Slip is that of nodes in contact from where they were first, where normals differ there.
        """
        strain, rotation = self._gradients.largest(state.displacement)
        largest = 0.0
        for k, (pair, surface) in enumerate(
            zip(state.pairs, self._interface.surfaces, strict=True)
        ):
            moved = pair.displacement - pair.translation
            closed = pair.status != OPEN
            along = moved - np.sum(moved * pair.normal, axis=1)[:, None] * pair.normal
            if closed.any():
                turned = surface.normal((pair.position + moved)[closed]) - pair.normal[closed]
                far = np.linalg.norm(along[closed], axis=1)[np.abs(turned).max(axis=1) > _NEAR]
                largest = max(largest, float(far.max(initial=0.0) / self.finest[k]))
        return self._told(Smallness(strain, rotation, largest), before, f"step {step}")

    def _told(self, smallness: Smallness, before: Smallness, when: str) -> Smallness:
        left = [
            f"largest {name} {value:.3g} (above {limit:g})"
            for name, value in vars(smallness).items()
            if value > (limit := getattr(_SMALL, name)) >= getattr(before, name)
        ]
        if left:
            words = f"{when} leaves the range of small displacements: {', '.join(left)}"
            told(self._comm, logging.WARNING, words, ".contact")
        return smallness

    def _warn_of_noise(self, increment: Increment, now: Iterate) -> None:
        """Logs it where forces by which meshes' own gaps are pressed out are much of all."""
        interface, force = self._interface, now.contact.force[:, 0]
        noise = increment.system.scale * interface.noise
        for k in range(interface.pairs):
            mine = (interface.pair == k) & (force > 0)
            sums = np.array([np.sum(noise[mine] ** 2), np.sum(force[mine]), np.sum(mine)])
            squares, pressed, count = self._comm.allreduce(sums, MPI.SUM)
            ratio = np.sqrt(squares * count) / pressed if pressed > 0 else 0.0
            if ratio > _NOISE:
                told(self._comm, logging.WARNING, _OF_MESHES % (k, ratio), ".contact")

    def _slip(self, increment: Increment, now: Iterate) -> float:
        """Largest slip over the size of facets; of two bodies, that since the beginning."""
        interface, contact, past = self._interface, now.contact, increment.past
        moved = now.displacement - now.translations[interface.pair]
        was = past.displacement - past.translations[interface.pair]
        moved = moved - np.where((interface.faced == RIGID)[:, None], was, 0.0)
        slip = np.linalg.norm(np.einsum("nab,nb->na", contact.frame[:, 1:], moved), axis=1)
        closed = contact.active_set().status != OPEN
        largest = np.max(slip / self._sizes, where=closed, initial=0.0)
        return float(self._comm.allreduce(largest, MPI.MAX))

    def _cosines(self, normal: Array) -> Array:
        """Least cosine (m,) between vectors (m, dim) and the outward normals around a point."""
        least = np.full(len(normal), np.inf)
        cosine = np.sum(normal[self._point] * self._outward, axis=1)
        np.minimum.at(least, self._point, cosine)
        return least

    def _check_way(self, past: Reference, translations: Array) -> None:
        """Looks along the straight ways of the surfaces to translations (pairs, dim)."""
        for k, rigid in enumerate(self._rigid):
            way = translations[k] - past.translations[k]
            if rigid and np.linalg.norm(way) > _WAY_STEP * self.finest[k]:
                mine = self._interface.pair == k
                wrong = np.zeros(len(mine), dtype=bool)
                wrong[mine] = self._swallowed(k, past, way)
                self._refuse(k, wrong, "passes through the body: it goes through the nodes at")

    def _check_contact(self, now: Iterate, strain: float) -> None:
        """Looks at the points in contact; `strain` is the body's largest."""
        closed = now.contact.active_set().status != OPEN
        closed &= np.array(self._rigid)[self._interface.pair]
        cosine = self._cosines(now.contact.frame[:, 0])
        for k in range(self._interface.pairs):
            mine = closed & (self._interface.pair == k)
            self._refuse(k, mine & (cosine > _OUTWARDS), "pushes the body outwards at")
            if strain > _CRUSHING_STRAIN:
                through = self._through(now, mine & (cosine < -_OUTWARDS))
                self._refuse(k, through, "is through the whole thickness of the body at")

    def _swallowed(self, k: int, past: Reference, way: Array) -> Mask:
        """Points (m,) of a pair that its surface swallows from the wrong side on its way."""
        interface, mine = self._interface, self._interface.pair == k
        surface, size = interface.surfaces[k], self.finest[k]
        x, before = interface.position[mine] - past.translations[k], past.displacement[mine]
        length = float(np.linalg.norm(way))
        step = max(_WAY_STEP * size, length / _MOST_WAY_STEPS)
        # no sample just where a surface has no normal, such as the centre of a sphere
        x = x + 1e-7 * size * np.sqrt(np.arange(2, 2 + x.shape[1]))

        share, wrong = np.zeros(len(x)), np.zeros(len(x), dtype=bool)
        pushed = np.zeros_like(interface.position)
        with collective(self._comm):
            while len(x):
                place = x - share[:, None] * way
                gap, normal = surface.gap(place), surface.normal(place)
                depth = -(gap + np.sum(normal * before, axis=1))
                pushed[mine] = normal
                outwards = self._cosines(pushed)[mine] > _OUTWARDS
                wrong |= outwards & (depth > _SWALLOWED * size)
                if share.min() >= 1:
                    break
                # outside, the surface is a gap away at least; half of it, if that is no distance
                stride = np.maximum(np.where(np.isfinite(gap), gap / 2, 0.0), step)
                share = np.minimum(share + stride / length, 1.0)
        return wrong

    def _through(self, now: Iterate, chosen: Mask) -> Mask:
        """Which of the chosen points (m,), or of the farthest pushed of them, are through."""
        interface, comm = self._interface, self._comm
        normal, a = now.contact.frame[:, 0], now.displacement
        points = np.flatnonzero(chosen)
        pushed = np.sum(normal * a, axis=1)[points]
        size = comm.allreduce(np.abs(pushed).max(initial=0.0), MPI.MAX) or 1.0
        keys = np.column_stack([interface.position[points], -np.round(pushed / size, 9)])
        every = interface.gathered(keys)
        first = sum(comm.allgather(len(points))[: comm.rank])
        # where many are alike, the first by position
        far = np.sort(np.lexsort(every.T)[:_MOST_CHORDS])
        farthest = points[far[(far >= first) & (far < first + len(points))] - first]
        u = self._gradients.u.x.array  # of this solution, whose strain has just been asked for
        moved = u.reshape(-1, normal.shape[1])[self._exterior.vertices]
        origins, directions = (
            interface.gathered(values[farthest]) for values in (interface.position, normal)
        )
        found = [self._exterior.exit(x, n, moved) for x, n in zip(origins, directions, strict=True)]
        # of all processes, the nearest way out
        ends = comm.allgather([(t, tuple(there)) for t, there in found])
        nearest = [min(each) for each in zip(*ends, strict=True)]
        first = sum(comm.allgather(len(farthest))[: comm.rank])
        through = np.zeros(len(chosen), dtype=bool)
        for point, (length, there) in zip(farthest, nearest[first:], strict=False):
            left = length + normal[point] @ (np.array(there) - a[point])
            through[point] = left <= _NO_CHORD * length < np.inf
        return through

    def _refuse(self, k: int, wrong: Mask, what: str) -> None:
        places = self._interface.gathered(self._interface.position[wrong])
        if len(places):
            raise SurfacePassed(
                f"the surface of contact pair {k} {what} {listed(places)}; contact is stated for "
                "small displacements and surfaces that come from outside: move it less far, or "
                "round the body in increments that stay clear of it"
            )


def _facets_around(
    node: Indices, space: fem.FunctionSpace, exterior: Exterior
) -> tuple[Indices, Array, Array]:
    """Facets (f,) around nodes (m,) of this process: the node's place, normals, and sizes.

    A facet counts once for each of its nodes, those of other processes too.
    """
    index_map, comm = space.dofmap.index_map, space.mesh.comm
    number = index_map.local_to_global(exterior.nodes.ravel()).reshape(exterior.nodes.shape)
    facet, place = np.nonzero(np.isin(number, np.concatenate(comm.allgather(node))))
    touched = number[facet, place]
    touched, outward, size = (
        np.concatenate(comm.allgather(part))
        for part in (touched, exterior.outward[facet], exterior.size[facet])
    )
    mine = np.isin(touched, node)
    order = np.argsort(node)
    point = order[np.searchsorted(node, touched[mine], sorter=order)]
    return point, outward[mine], size[mine]
