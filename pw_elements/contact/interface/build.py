"""Builders of interfaces: against rigid surfaces, between matching nodes, and of mortars."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices
from scipy.spatial import cKDTree

from pw_elements._compat import cell_nodes
from pw_elements.algebra import Reduction
from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import arguments, call_user_function, collective_errors, format_points
from pw_elements.contact.interface.mortar import Overlap, Trace, gathered_trace
from pw_elements.contact.interface.operators import (
    DEFORMABLE,
    RIGID,
    InitialGap,
    Interface,
    Points,
    extents,
    gather_points,
)
from pw_elements.contact.interface.probes import compare_pairs
from pw_elements.contact.interface.sliding import SlidingMortar
from pw_elements.contact.model import (
    MAX_STEP_ERROR,
    Cone,
    ContactPair,
    DeformableSurface,
    MatchingNodes,
    SignedDistance,
    Surface,
    step_error,
    with_step,
)
from pw_elements.elasticity import (
    StressState,
    facet_nodes,
    facets_with_all_nodes,
    order_by_position,
)
from pw_elements.progress import log_on_root
from pw_elements.spaces import (
    AssemblyRecord,
    Part,
    SubSpace,
    assemble_vector,
    gather_from_owners,
    is_hybrid,
    locate_exterior_facets,
    locate_nodes,
)

# Attributes of surfaces that are vectors (dim,)
_VECTORS = ("point", "direction", "apex", "centre")
# Cells at a time, to save memory
_CELLS_AT_ONCE = 20_000
# Largest distance of a node from where its counterpart should be, over the body's diagonal
_MATCHING = 1e-6
# Distance from the axis of revolution, over the body's diagonal, up to which a node lies on it
_ON_AXIS = 1e-10
# Cosine up to which a normal is turned into a symmetry plane
_NEARLY = 0.9
# Gap of sides that coincide, over the slave's mean sub-facet: that of an octant of a sphere is 0.01
# with two quadratic facets a side
_COINCIDE = 0.05
# Mesh gaps per edge length, over interference per body diagonal, above which a warning is logged:
# they change pressures by a tenth
_NOISE = 0.03
_OF_MESHES = (
    "contact pair %d: gaps that meshes leave within facets are much of its interference, and "
    "pressures are off by a tenth or more: use finer meshes, or DeformableSurface(..., "
    "coincident=True) and the depth as interference"
)
# Mean edge of the slave over the master's where they face each other; a warning is logged above
_COARSE = 3.0


class BodyNodes:
    """Where the nodes of a body are, and which unknowns and equations they have.

    Attributes:
        given: space of all unknowns.
        field: the displacements among them.
        x: (nodes, dim), ghosts too.
        column: (owned nodes, dim), as of `free_columns`.
        outward: (owned nodes, dim), normals integrated with the shape functions.
        beside: (nodes, dim), mean midpoint of the cells around.
        diagonal: length of the bounding box's.
        on_axis: (nodes, dim), which components are radial ones of nodes on an axis of revolution.
    """

    def __init__(self, given: fem.FunctionSpace, reduction: Reduction) -> None:
        self.given, self.field = given, SubSpace.displacements(given)
        self.space = self.field.space
        mesh = self.space.mesh
        dim = mesh.geometry.dim
        self.x: Array = self.space.tabulate_dof_coordinates()[:, :dim]
        self.column: Indices = free_columns(reduction.right)[self.field.owned_unknowns]
        v = ufl.TestFunction(self.space)
        normal = assemble_vector(ufl.inner(ufl.FacetNormal(mesh), v) * ufl.ds)
        # a view would keep the vector on the one process whose error holds these nodes
        self.outward = np.array(normal.array_r).reshape(-1, dim)
        self.beside = midpoints_around(self.space)
        self.diagonal = float(np.linalg.norm(extents(mesh.comm, mesh.geometry.x)))
        self.on_axis: Mask = np.zeros(self.x.shape, dtype=bool)

    def find_axis(self, known: AssemblyRecord | None) -> None:
        """Mark radial components on the axis, if the stiffness is known to be axisymmetric."""
        if known is not None and StressState.AXISYMMETRIC.value in known.stress_states:
            self.on_axis[:, 0] = np.abs(self.x[:, 0]) <= _ON_AXIS * self.diagonal

    def owned(self, whose: str, nodes: Part) -> LocalIndices:
        given = locate_nodes(self.given, whose, nodes)
        return given[given < self.space.dofmap.index_map.size_local]

    def refuse(self, node: LocalIndices, what: str) -> None:
        """Raises a ValueError that names the positions of nodes, if there are any."""
        places = np.concatenate(self.space.mesh.comm.allgather(self.x[node]))
        if len(places):
            raise ValueError(f"contact nodes at {format_points(places)} {what}")


def nodal_interface(
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
    reduction: Reduction,
    known: AssemblyRecord | None = None,
    deformed: bool = False,
) -> Interface:
    """Contact points of pairs, and checks of what can be checked before any computation.

    Bodies that are `deformed` find each other anew where they are.
    What is `known` of the stiffness tells whether areas are those of a circumference, and whether
    the unknowns are a sibling's coefficients; gaps are theirs then.
    """
    dim = space.mesh.geometry.dim
    if not is_hybrid(space) and space.dofmap.index_map_bs != dim:
        raise ValueError("contact is stated on displacements: the space has to be a vector's")
    if not pairs:
        raise ValueError("there is no contact pair")
    shapes: list[Surface] = [
        p.surface.shape if isinstance(p.surface, MatchingNodes) else p.surface  # type: ignore[misc]
        for p in pairs
    ]
    largest = space.mesh.comm.allreduce(np.abs(space.mesh.geometry.x).max(initial=0.0), MPI.MAX)
    shapes = [with_step(shape, largest) for shape in shapes]
    for k, (shape, pair) in enumerate(zip(shapes, pairs, strict=True)):
        vectors = {f"the {name} of its surface": getattr(shape, name, None) for name in _VECTORS}
        for name, vector in {**vectors, "its pivot": pair.pivot}.items():
            if vector is not None and (size := np.size(vector)) != dim:
                raise ValueError(f"contact pair {k}: {name} has {size} components in {dim}-D")
        if pair.pivot is not None and not deformed:
            raise ValueError(
                f"contact pair {k} has a pivot, but surfaces turn at large sliding only: state a "
                "residual, ContactProblem.of_residual"
            )
    body = BodyNodes(space, reduction)
    names = [f"contact pair {k}" for k in range(len(pairs))]
    found = [body.owned(name, pair.nodes) for name, pair in zip(names, pairs, strict=True)]
    for name, node in zip(names, found, strict=True):
        _tell_of_lone(name, node, body)
    cones, comm = [], space.mesh.comm
    for name, pair, node in zip(names, pairs, found, strict=True):
        at = _at_nodes(comm, f"the friction of {name}", pair.law.at, body.x[node])
        cones.append(Cone([pair.law], [at]))
    body.find_axis(known)
    points, faced = [], []
    mortars: dict[int, SlidingMortar] = {}
    for k, (pair, node, cone) in enumerate(zip(pairs, found, cones, strict=True)):
        if isinstance(pair.surface, DeformableSurface):
            revolved = _revolved(k, pair.surface, known or AssemblyRecord(), dim)
            if deformed:
                of_pair, shapes[k], mortars[k] = sliding_points(k, pair, node, cone, body, revolved)
            else:
                depth = _depth(comm, k, pair, body.x[node])
                of_pair, shapes[k] = mortar_points(k, pair, node, cone, body, revolved, depth)
        elif isinstance(pair.surface, MatchingNodes):
            faced.append(body.owned(f"contact pair {k}, opposite side", pair.surface.nodes))
            opposite = opposite_nodes(k, pair.surface, node, faced[-1], cone.rough, body)
            of_pair = _points(body, node, cone, opposite)
        else:
            of_pair = _points(body, node, cone, None)
        points.append(of_pair)
    interfering = [pair.interference is not False for pair in pairs]
    inverse = None if known is None or known.sibling is None else known.sibling.inverse
    interface = Interface(points, shapes, body.field, interfering, inverse, mortars)
    _check_nodes(body, np.concatenate([*found, *faced]))
    interface.check(body.diagonal)
    compare_pairs(interface, pairs, shapes)
    _warn_of_coarse_steps(interface)
    return interface


def _warn_of_coarse_steps(interface: Interface) -> None:
    """Log signed distances whose step of differences is too large for their curvature."""
    comm = interface.comm
    for k, surface in enumerate(interface.surfaces):
        if not isinstance(surface, SignedDistance):
            continue
        x = interface.gathered(interface.position[interface.pair == k])
        with collective_errors(comm):
            error = call_user_function(
                comm, f"the surface of contact pair {k}", step_error, surface, x
            )
        if error > MAX_STEP_ERROR:
            words = (
                f"contact pair {k}: half the step of differences, {surface.step:.3g}, changes the "
                f"gradient of its SignedDistance by {error:.1e} of its size, and gaps and normals "
                "likewise. Give a smaller step (a small part of the smallest radius), none, or "
                "the gradient"
            )
            log_on_root(comm, logging.WARNING, words, ".contact")


def _tell_of_lone(name: str, node: LocalIndices, body: BodyNodes) -> None:
    """Logs nodes that have no pressure, which files and pictures refuse when all is solved."""
    comm, own = body.space.mesh.comm, body.space.dofmap.index_map
    every = np.concatenate(comm.allgather(own.local_to_global(node)))
    on_facets = facet_nodes(body.space, facets_with_all_nodes(body.space, every))
    on_facets = np.concatenate(comm.allgather(own.local_to_global(np.unique(on_facets))))
    lone = body.x[node[~np.isin(own.local_to_global(node), on_facets)]]
    places = np.concatenate(comm.allgather(lone))
    if len(places):
        words = (
            f"{name}: its nodes at {format_points(places)} belong to no facet that has all "
            "of its nodes in the pair: they may bear forces, but have no pressure, and "
            "ContactFields, write and plot will refuse the states. Let the pair end at vertices"
        )
        log_on_root(comm, logging.WARNING, words, ".contact")


def _check_nodes(body: BodyNodes, node: LocalIndices) -> None:
    unique, times = np.unique(node, return_counts=True)
    body.refuse(unique[times > 1], "belong to two contact pairs: leave a facet between them")
    mesh = body.space.mesh
    facet = mesh.topology.dim - 1
    mesh.topology.create_connectivity(facet, mesh.topology.dim)
    facets = exterior_facet_indices(mesh.topology)
    on_boundary = fem.locate_dofs_topological(body.space, facet, facets)
    body.refuse(node[~np.isin(node, on_boundary)], "lie inside of the body, not on its boundary")
    with collective_errors(mesh.comm):
        if np.any(body.column[node] < -1):
            raise ValueError(
                "the reduction combines the displacements of a contact node with others: it may "
                "prescribe them or keep them"
            )


def _depth(comm: MPI.Comm, number: int, pair: ContactPair, x: Array) -> Array | None:
    """The nominal interference (n,) at positions (n, dim); None where sides do not coincide."""
    depth = pair.interference
    if not getattr(pair.surface, "coincident", False):
        return None
    if not arguments.is_user_function(depth):
        return np.full(len(x), float(depth))  # type: ignore[arg-type]
    return _at_nodes(comm, f"the interference of contact pair {number}", depth, x)


def _at_nodes(
    comm: MPI.Comm, whose: str, function: Callable[[Array], Array | float], x: Array
) -> Array:
    """Return what a user's function says at positions (n, dim); collective.

    Each process asks for the points of all, so that all call the function equally often.
    """
    every, own = gather_points(comm, x)
    points = np.zeros((3, len(every)))
    points[: x.shape[1]] = every.T
    layout = "it takes points as columns (3, n) and gives (n,)"
    with collective_errors(comm):
        given = call_user_function(comm, whose, function, points) if len(every) else points[0]
        if arguments.is_number(given):  # the same everywhere
            given = np.full(len(every), given, dtype=float)
        return arguments.check_function_values(whose, given, (len(every),), layout)[own]


def _revolved(number: int, master: DeformableSurface, known: AssemblyRecord, dim: int) -> bool:
    """Whether areas are those of a circumference, by what is known of the stiffness if it is."""
    axisymmetric = StressState.AXISYMMETRIC.value in known.stress_states
    if dim == 2 and not known.stress_states and master.revolved is None:
        raise ValueError(
            f"contact pair {number}: the stiffness does not tell whether it is axisymmetric, as "
            "that of a Body does; give DeformableSurface(..., revolved=True or False)"
        )
    if known.stress_states and master.revolved not in (None, axisymmetric):
        raise ValueError(
            f"contact pair {number}: its surface is said to be revolved={master.revolved}, but the "
            f"stiffness is one in {' and '.join(sorted(known.stress_states))}"
        )
    return bool(axisymmetric or master.revolved)


def midpoints_around(space: fem.FunctionSpace) -> Array:
    """Mean of the midpoints of the cells around each node, ghosts too: (nodes, dim)."""
    mesh = space.mesh
    dim, owned = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    sums = la.vector(space.dofmap.index_map, dim + 1)
    sums.array[:] = 0.0
    for first in range(0, owned, _CELLS_AT_ONCE):
        some = slice(first, min(first + _CELLS_AT_ONCE, owned))
        middle = mesh.geometry.x[cell_nodes(mesh)[some], :dim].mean(axis=1)
        parts = np.concatenate([middle, np.ones((len(middle), 1))], axis=1)
        cells = space.dofmap.list[some]
        every = np.repeat(parts, cells.shape[1], axis=0)
        np.add.at(sums.array.reshape(-1, dim + 1), cells.ravel(), every)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    values = sums.array.reshape(-1, dim + 1)
    return np.asarray(values[:, :dim] / values[:, dim:])


def free_columns(right: PETSc.Mat) -> Indices:
    """Column of each owned row of R that is a row of the identity.

    Empty rows (prescribed values) get -1, combinations -2.
    """
    indptr, indices, data = right.getValuesCSR()
    count = np.diff(indptr)
    column = np.where(count == 0, -1, -2).astype(np.int64)
    single = np.flatnonzero(count == 1)
    kept = single[data[indptr[single]] == 1.0]
    column[kept] = indices[indptr[kept]]
    return column


def _points(body: BodyNodes, node: LocalIndices, cone: Cone, opposite: Indices | None) -> Points:
    """Points at owned nodes; `opposite` has the global numbers of the nodes that they face."""
    dim = body.x.shape[1]
    own = (node + body.space.dofmap.index_map.local_range[0]).astype(np.int64)
    ends = [(own, 1.0)] + ([] if opposite is None else [(opposite, -1.0)])
    dofs = [(end[:, None] * dim + np.arange(dim)).ravel() for end, _ in ends]
    value = np.repeat([sign for _, sign in ends], len(node) * dim)
    row = np.tile(np.arange(len(node) * dim), len(ends))
    shape = (len(node) * dim, body.field.sizes[1])
    motion = sp.csr_matrix((value, (row, np.concatenate(dofs))), shape)
    return Points(
        body.x[node],
        cone,
        body.column[node],
        motion,
        motion,
        body.beside[node],
        body.outward[node],
        own,
        np.full_like(own, RIGID) if opposite is None else opposite,
        body.on_axis[node],
        np.full(body.x[node].shape, -1, dtype=np.int64),
    )


def opposite_nodes(
    number: int,
    matching: MatchingNodes,
    node: LocalIndices,
    theirs: LocalIndices,
    rough: Mask,
    body: BodyNodes,
) -> Indices:
    """Global number (m,) of the node of the opposite side that each of a pair's nodes faces.

    `theirs` are nodes of the opposite side that this process owns, `rough` (m,) tells where there
    is friction: it would be lost where a displacement is prescribed on the pair's own side only.
    """
    comm, dim = body.space.mesh.comm, body.x.shape[1]
    offset = np.zeros(dim) if matching.offset is None else np.asarray(matching.offset, dtype=float)
    if offset.shape != (dim,):
        raise ValueError(f"contact pair {number}: its offset {offset.tolist()} is not {dim}-D")
    first = body.space.dofmap.index_map.local_range[0]
    known, place, held = (
        np.concatenate(comm.allgather(values))
        for values in (theirs + np.int64(first), body.x[theirs], body.column[theirs] == -1)
    )
    if not len(known):
        raise ValueError(f"contact pair {number} has no opposite nodes: their marker holds nowhere")
    distance, nearest = cKDTree(place).query(body.x[node] + offset)
    body.refuse(node[distance > _MATCHING * body.diagonal], "face no node of the opposite side")
    times = np.bincount(nearest, minlength=len(known))
    comm.Allreduce(MPI.IN_PLACE, times, MPI.SUM)
    body.refuse(node[times[nearest] > 1], "face the same node of the opposite side")
    alone = ((body.column[node] == -1) & ~held[nearest]).any(axis=1)
    body.refuse(
        node[alone & rough],
        "have a prescribed displacement that their counterparts have not: exchange both sides",
    )
    return np.asarray(known[nearest])


def check_weights(K: PETSc.Mat, space: fem.FunctionSpace) -> None:
    """Raises ValueError for a stiffness (n, n) that is known to be tested with other weights.

    They are told by their values a quarter along an edge, where quadratic ones are down to -1/8.
    """
    assembled = AssemblyRecord.read(K)
    if (test := assembled.test_space) is None:
        return
    element = (test.sub([0]) if is_hybrid(space) else test).element.basix_element
    quarter = np.eye(1, space.mesh.topology.dim) / 4
    if assembled.sibling is not None or element.tabulate(0, quarter).min() < -0.1:
        raise ValueError(
            "a deformable surface hands on forces of piecewise-linear weights, with which the "
            "stiffness is not made: take Spaces.petrov_galerkin or Spaces.hybrid"
        )


def _sides(
    number: int, pair: ContactPair, node: LocalIndices, body: BodyNodes
) -> tuple[Indices, Trace, Trace]:
    """Global numbers of a pair's owned nodes (m,), and both sides of it, with what they must be."""
    space, master, who = body.space, pair.surface, f"contact pair {number}"
    assert isinstance(master, DeformableSurface)
    own = node + np.int64(space.dofmap.index_map.local_range[0])
    every = np.concatenate(space.mesh.comm.allgather(own))
    if not len(every):
        raise ValueError(f"{who} has no nodes: its marker holds nowhere")
    one = gathered_trace(space, facets_with_all_nodes(space, every))
    other = gathered_trace(space, locate_exterior_facets(space.mesh, master.where))
    if not len(other.node):
        raise ValueError(f"{who} has no opposite facets: their marker holds nowhere")
    body.refuse(node[~np.isin(own, one.node)], "belong to no facet that is all in their pair")
    body.refuse(node[np.isin(own, other.node)], "belong to both sides of their pair")
    if len(places := one.edges()):
        raise ValueError(
            f"{who} has an edge at {format_points(places)}, where its normal would belong to "
            "neither side: state each side as a pair of its own, one with the nodes of the edge"
        )
    return own, one, other


_APART = (
    "contact pair %d: no part of its facets faces the opposite part: one of both is on the far "
    "side of its body, or they do not overlap"
)


def sliding_points(
    number: int, pair: ContactPair, node: LocalIndices, cone: Cone, body: BodyNodes, revolved: bool
) -> tuple[Points, InitialGap, SlidingMortar]:
    """Points at the owned nodes (m,) of a pair of bodies that slide, as they are at first."""
    own, one, other = _sides(number, pair, node, body)
    mortar = SlidingMortar(one, other, revolved)
    met = mortar.meet(mortar.x)
    if not met.faced.any():
        raise ValueError(_APART % number)
    free = ~_prescribed(one.nodes, body)
    near = np.linalg.norm(met.normals * free, axis=1) > _NEARLY  # as `_in_symmetry_planes`
    mortar.kept[near] = free[near]
    met = mortar.meet(mortar.x)
    among = np.searchsorted(one.nodes, own)
    gap = np.where(met.faced, met.gaps, np.inf)[among]
    points = replace(_points(body, node, cone, None), **_facing(own, node, other, body))
    return points, InitialGap(body.x[node], gap, met.normals[among]), mortar


def _facing(own: Indices, node: LocalIndices, other: Trace, body: BodyNodes) -> dict[str, Any]:
    x = other.positions_of_nodes()
    order, held = order_by_position(x), _prescribed(other.nodes, body)
    counterpart = np.full(body.x[node].shape, -1, dtype=np.int64)
    for axis in range(x.shape[1]):
        some = np.flatnonzero(held[:, axis])
        if len(some):
            nearest = cKDTree(x[some]).query(body.x[node])[1]
            counterpart[:, axis] = other.nodes[some[nearest]]
    return {
        "faced": np.full_like(own, DEFORMABLE),
        "opposite": other.nodes[order],
        "counterpart": counterpart,
    }


def mortar_points(
    number: int,
    pair: ContactPair,
    node: LocalIndices,
    cone: Cone,
    body: BodyNodes,
    revolved: bool,
    depth: Array | None,
) -> tuple[Points, InitialGap]:
    """Points at the owned nodes (m,) of a pair whose opposite is another part of the boundary.

    Points that face nothing have an infinite gap. `depth` (m,) is the nominal interference of sides
    that coincide, None of others; `revolved` tells whether areas are those of a circumference.
    """
    comm = body.space.mesh.comm
    own, one, other = _sides(number, pair, node, body)
    overlap = Overlap.of(one, other, own, revolved)
    if comm.allreduce(len(overlap.measure), MPI.SUM) == 0:
        raise ValueError(_APART % number)
    coarseness = overlap.mean_edge(overlap.ratio, comm)
    if coarseness > _COARSE:
        words = (
            f"contact pair {number}: its facets are {coarseness:.1f} times as large as those they "
            "face; let the finer mesh be the pair's, or the opposite body's forces may have either "
            "sign"
        )
        log_on_root(comm, logging.WARNING, words, ".contact")
    m, dim = len(node), body.x.shape[1]
    shape = m, body.field.sizes[1] // dim
    area = overlap.per_point(np.ones(len(overlap.measure)), m)
    faced = area > 0
    scale = sp.diags_array(1 / np.where(faced, area, 1.0))
    unit = sp.csr_array((np.ones(m), (np.arange(m), own)), shape)
    alone = sp.diags_array(np.where(faced, 0.0, 1.0)) @ unit
    (at1, N1), (at2, N2), (at3, w2) = overlap.functions
    motion = overlap.integrals(overlap.weight, at1, N1, shape)
    motion -= overlap.integrals(overlap.weight, at2, N2, shape)
    force = unit - scale @ overlap.integrals(overlap.dual, at3, w2, shape)
    meets = overlap.integrals(overlap.weight, at3, w2, shape)[:, other.nodes] > 0
    lone = (body.column[node] == -1) & ~(meets @ _prescribed(other.nodes, body))
    body.refuse(
        node[faced & cone.rough & lone.any(axis=1)],
        "have a prescribed displacement that none of the nodes which they face has, so that these "
        "would get no friction: exchange both sides",
    )
    into = _in_symmetry_planes(-one.normals(own), body.column[node] >= 0)
    apart = np.stack([overlap.per_point(x, m) for x in overlap.apart.T], axis=1)
    gap = np.where(faced, np.sum(into * apart, axis=1) * scale.diagonal(), np.inf)
    edge = overlap.mean_edge(overlap.size, comm)
    if depth is not None:
        body.refuse(
            node[faced & (np.abs(gap) > _COINCIDE * edge)],
            "lie away from the opposite side, farther than meshes of one surface do (coincident)",
        )
        gap = np.where(faced, -depth, np.inf)
    elif pair.interference:
        along = np.einsum("qki,qi->qk", into[overlap.point], overlap.apart)
        squares = overlap.per_point(along**2, m) * scale.diagonal()
        _tell_of_noise(number, squares, gap, body, edge)
    axes = sp.eye_array(dim)
    points = replace(
        _points(body, node, cone, None),
        motion=sp.csr_matrix(sp.kron(scale @ motion + alone, axes)),
        force=sp.csr_matrix(sp.kron(force, axes)),
        **_facing(own, node, other, body),
    )
    return points, InitialGap(body.x[node], gap, into)


def _tell_of_noise(number: int, squares: Array, gap: Array, body: BodyNodes, edge: float) -> None:
    """Logs it where gaps that meshes leave within facets are much of an interference.

    `squares` (m,) are the mean squares of distances, of which the mean `gap` (m,) is a part.
    """
    comm, pressed = body.space.mesh.comm, gap < 0
    left = (squares - gap**2)[pressed].clip(0)
    sums = np.array([np.sum(left), np.sum(gap[pressed]), len(left)])
    total, depth, count = comm.allreduce(sums, MPI.SUM)
    if np.sqrt(total * count) * body.diagonal > -_NOISE * edge * depth:
        log_on_root(comm, logging.WARNING, _OF_MESHES % number, ".contact")


def _prescribed(node: Indices, body: BodyNodes) -> Mask:
    """Which displacements (n, dim) of global nodes are, of whichever process."""
    return gather_from_owners(body.space, node, (body.column == -1).astype(np.int8)) > 0


def _in_symmetry_planes(normal: Array, free: Mask) -> Array:
    """Normals (n, dim) without components that are prescribed, if these are small.

    On a symmetry plane the facets of one side alone are averaged.
    """
    inside = np.where(free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    near = length > _NEARLY
    return np.asarray(np.where(near, inside / np.where(near, length, 1.0), normal))
