"""Mortar interfaces: two deformable bodies whose meshes need not match.

Body 1 (slave) and body 2 (master) are parts of one mesh. With w the piecewise-linear weights of
both, N the quadratic trial functions, and psi the duals of the slave's weights,

    integral of psi_j w_i over the slave's face = delta_ij A_j,     A_j = integral of w_j,

the contact pressure is p = sum p_j psi_j and the law is stated node by node on r_j = A_j p_j, a
force, and on the mean gap

    g_j = integral of w_j n_j·(x_1 + u_1 - x_2 - u_2) / A_j,        n_j out of the master.

Equilibrium tests the contact traction with the weights: r_j enters the equations of slave node j
and, less sums of M_jk / A_j with M_jk = integral of psi_j w_k, those of the master's nodes k. So H
has the unit in a point's own equation, as for matching nodes; and forces, gaps and slips have the
scales of nodal ones, A_j being the node's own area.

What is exact: H hands on the force, for sum w_k = 1, and the moment of a closed gap, for the
weights reproduce positions on straight sub-facets; across a gap g friction t leaves a moment g t.
An even pressure arrives as it is, whatever the meshes, since sum psi_j = 1. Gaps are weighted
with w and not psi, for w is not negative. On every sub-facet the duals are D M^-1 w, with M the
matrix of the weights over the part of the sub-facet that faces the master and D its row sums: so
all of this holds where a facet is covered in part, too. Integrals are exact for polynomials on
flat faces; curved ones are seen as their chords between nodes.
"""

from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices

from pw_elements.contact.interface import Points
from pw_elements.contact.nodes import BodyNodes
from pw_elements.contact.pairs import DeformableSurface
from pw_elements.contact.segments import segments
from pw_elements.mechanics import exterior_facets

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Nodes of the sub-facets of a facet, whose vertices come first, then the middles of its edges
_PARTS = {2: ((0, 2), (2, 1)), 3: ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5))}
_EDGES = {2: ((0, 1),), 3: ((1, 2), (0, 2), (0, 1))}
_SIMPLEX = {2: basix.CellType.interval, 3: basix.CellType.triangle}
# Cosine up to which a normal is turned into a symmetry plane
_NEARLY = 0.9
# Of products of weights, quadratic functions and, in axisymmetry, the radius
_DEGREE = 4


@dataclass(frozen=True)
class Trace:
    """A part of the boundary, gathered from all processes: facets (f) with k nodes each.

    Args:
        node: (f, k), global numbers, vertices first, then the middles of edges.
        x: (f, k, dim).
        outward: (f, dim), unit normals of the facets, seen as flat.
    """

    node: Indices
    x: Array
    outward: Array

    @property
    def dim(self) -> int:
        """Of space, which is the number of vertices of a facet."""
        return int(self.x.shape[2])

    @property
    def parts(self) -> tuple[Indices, Array, Array]:
        """Nodes (s, dim) of the sub-facets, their corners (s, dim, dim), and normals (s, dim)."""
        local = np.array(_PARTS[self.dim])
        corners = self.x[:, local].reshape(-1, self.dim, self.dim)
        outward = np.repeat(self.outward, len(local), axis=0)
        normal = _across(corners)
        normal *= np.sign(np.sum(normal * outward, axis=1))[:, None]
        return self.node[:, local].reshape(-1, self.dim), corners, normal

    def functions(self, part: Indices, place: Array) -> tuple[Indices, Array]:
        """Nodes (q, k) and quadratic functions (q, k) at places (q, dim) of sub-facets (q,)."""
        local = np.array(_PARTS[self.dim])
        facet, which = np.divmod(part, len(local))
        corner = np.eye(self.dim)
        edges = np.array(_EDGES[self.dim])
        corner = np.concatenate([corner, corner[edges].mean(axis=1)])[local]
        L = np.einsum("qa,qab->qb", place, corner[which])
        middle = 4 * L[:, edges[:, 0]] * L[:, edges[:, 1]]
        return self.node[facet], np.concatenate([L * (2 * L - 1), middle], axis=1)

    def positions(self, part: Indices, values: Array) -> Array:
        """Positions (q, dim) by quadratic functions (q, k)."""
        return np.einsum("qk,qkd->qd", values, self.x[part // len(_PARTS[self.dim])])


@dataclass(frozen=True)
class InitialGap:
    """The gap (m,) at a mortar's own points, which change with the master's rigid motion alone."""

    position: Array
    initial: Array
    direction: Array

    def gap(self, x: Array) -> Array:
        """Gap (m,) of the points (m, dim), as they were or shifted all alike."""
        return self.initial + np.sum(self.direction * (x - self.position), axis=1)

    def normal(self, x: Array) -> Array:  # noqa: ARG002
        """Averaged normals (m, dim), out of the master, wherever the points are."""
        return self.direction


def mortar_points(
    number: int,
    master: DeformableSurface,
    node: npt.NDArray[np.int32],
    friction: Array,
    body: BodyNodes,
) -> tuple[Points, InitialGap]:
    """Points at the owned nodes of a pair whose opposite is another part of the boundary.

    Points that face nothing have an infinite gap.

    Args:
        number: of the pair, for messages.
        master: the opposite part.
        node: (m,), owned nodes of the pair.
        friction: (m,).
        body: whose nodes they are.

    Raises:
        ValueError: if a node belongs to no facet whose nodes are all in the pair, both parts share
            a node, or no part of the pair's facets faces the opposite part; on hexahedra.
    """
    space = body.space
    own = node + np.int64(space.dofmap.index_map.local_range[0])
    one = gathered_trace(space, _facets_of(space, node))
    other = gathered_trace(space, exterior_facets(space.mesh, master.where))
    body.refuse(node[~np.isin(own, one.node)], "belong to no facet that is all in their pair")
    body.refuse(node[np.isin(own, other.node)], "belong to both sides of their pair")
    overlap = Overlap.of(one, other, own, master.revolved)
    if space.mesh.comm.allreduce(len(overlap.measure), MPI.SUM) == 0:
        raise ValueError(
            f"contact pair {number}: no part of its facets faces the opposite part; the outward "
            "normals of both have to point to each other"
        )
    m, dim = len(node), body.x.shape[1]
    nodes = body.rows.getSize() // dim
    area = overlap.per_point(np.ones(len(overlap.measure)), m)
    faced = area > 0
    scale = sp.diags_array(1 / np.where(faced, area, 1.0))
    unit = sp.csr_array((np.ones(m), (np.arange(m), own)), (m, nodes))
    alone = sp.diags_array(np.where(faced, 0.0, 1.0)) @ unit
    (at1, N1), (at2, N2), (at3, w2) = overlap.functions
    motion = overlap.integrals(overlap.weight, at1, N1, (m, nodes))
    motion -= overlap.integrals(overlap.weight, at2, N2, (m, nodes))
    force = unit - scale @ overlap.integrals(overlap.dual, at3, w2, (m, nodes))
    into = -_averaged(one)[np.searchsorted(np.unique(one.node), own)]
    into = _in_symmetry_planes(into, body.column[node] >= 0)
    apart = np.stack([overlap.per_point(x, m) for x in overlap.apart.T], axis=1)
    gap = np.where(faced, np.sum(into * apart, axis=1) * scale.diagonal(), np.inf)
    axes = sp.eye_array(dim)
    points = Points(
        body.x[node],
        friction,
        body.column[node],
        sp.csr_matrix(sp.kron(scale @ motion + alone, axes)),
        sp.csr_matrix(sp.kron(force, axes)),
        body.beside[node],
        body.outward[node],
    )
    return points, InitialGap(body.x[node], gap, into)


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) of what the slave's sub-facets at own points have of the master.

    Args:
        point: (q, dim), numbers of the points that the sub-facet's corners are, -1 for others'.
        weight: (q, dim), their weights.
        dual: (q, dim), the duals of these.
        measure: (q,), lengths or areas.
        apart: (q, dim), from the master to the slave.
        functions: nodes (q, k) and values (q, k) of the slave's and the master's quadratic
            functions, and of the master's weights.
    """

    point: Indices
    weight: Array
    dual: Array
    measure: Array
    apart: Array
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def of(cls, one: Trace, other: Trace, own: Indices, revolved: bool) -> "Overlap":
        """Of both traces, for the points of global numbers `own` (m,)."""
        (nodes, corners, _), (their_nodes, their_corners, outward) = one.parts, other.parts
        order = np.argsort(own)
        place = np.searchsorted(own, nodes, sorter=order)
        point = order[np.minimum(place, len(own) - 1)] if len(own) else np.zeros_like(nodes)
        point = np.where(np.isin(nodes, own), point, -1)
        mine = np.flatnonzero((point >= 0).any(axis=1))
        normal = _averaged(one)[np.searchsorted(np.unique(one.node), nodes[mine])].mean(axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        found = segments(corners[mine], their_corners, normal, outward)

        points, weights = basix.make_quadrature(_SIMPLEX[one.dim], _DEGREE)
        rule = np.column_stack([1 - points.sum(axis=1), points])
        weights = weights / weights.sum()
        slave, master = (np.repeat(k, len(weights)) for k in (mine[found.slave], found.master))
        w1, w2 = (
            np.einsum("ga,qab->qgb", rule, corner).reshape(-1, one.dim)
            for corner in (found.on_slave, found.on_master)
        )
        size = np.repeat(found.share * _sizes(corners[mine])[found.slave], len(weights))
        measure = size * np.tile(weights, len(found.share))
        (at1, N1), (at2, N2) = one.functions(slave, w1), other.functions(master, w2)
        x1, x2 = one.positions(slave, N1), other.positions(master, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _duals(slave, w1, measure)
        functions = ((at1, N1), (at2, N2), (their_nodes[master], w2))
        return cls(point[slave], w1, dual, measure, x1 - x2, functions)

    def per_point(self, values: Array, m: int) -> Array:
        """Integrals (m,) of weights times values (q,)."""
        part = (self.weight * (self.measure * values)[:, None])[self.point >= 0]
        return np.asarray(np.bincount(self.point[self.point >= 0], part, minlength=m), dtype=float)

    def integrals(
        self, tested: Array, column: Indices, values: Array, shape: tuple[int, int]
    ) -> sp.csr_array:
        """Matrix of integrals of functions `tested` (q, dim) of the points times others (q, k)."""
        part = np.einsum("q,qa,qk->qak", self.measure, tested, values)
        row = np.broadcast_to(self.point[:, :, None], part.shape)
        known = row >= 0
        place = (row[known], np.broadcast_to(column[:, None], part.shape)[known])
        return sp.csr_array(sp.coo_array((part[known], place), shape))


def gathered_trace(space: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> Trace:
    """Exterior facets (local numbers) of all processes.

    Raises:
        ValueError: if they have no sub-facets that are simplices.
    """
    mesh, layout = space.mesh, space.dofmap.dof_layout
    dim = mesh.topology.dim
    cell_type = space.element.basix_element.cell_type
    if cell_type.name == "hexahedron":
        raise ValueError("contact of two deformable bodies is not there for hexahedra yet")
    sub = basix.topology(cell_type)
    mesh.topology.create_connectivity(dim, dim - 1)
    cell_facets = mesh.topology.connectivity(dim, dim - 1)
    facet_cells = mesh.topology.connectivity(dim - 1, dim)
    local = []
    for vertices in sub[dim - 1]:
        edges = [sorted((vertices[a], vertices[b])) for a, b in _EDGES[dim]]
        middle = [layout.entity_dofs(1, [sorted(e) for e in sub[1]].index(e))[0] for e in edges]
        local.append([layout.entity_dofs(0, v)[0] for v in vertices] + middle)
    nodes = np.empty((len(facets), len(local[0])), dtype=np.int32)
    inside = np.empty((len(facets), dim))
    x = space.tabulate_dof_coordinates()[:, :dim]
    for k, facet in enumerate(facets):
        cell = facet_cells.links(facet)[0]
        which = int(np.flatnonzero(cell_facets.links(cell) == facet)[0])
        dofs = space.dofmap.cell_dofs(cell)
        nodes[k], inside[k] = dofs[local[which]], x[dofs].mean(axis=0)
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    flat = _across(x[nodes[:, :dim]])
    flat *= np.sign(np.sum(flat * (x[nodes[:, 0]] - inside), axis=1))[:, None]
    parts = zip(*mesh.comm.allgather((number, x[nodes], flat)), strict=True)
    return Trace(*(np.concatenate(part) for part in parts))


def _facets_of(space: fem.FunctionSpace, node: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Exterior facets of owned cells all of whose nodes are among the owned ones (m,) of a pair."""
    mesh, facet = space.mesh, space.mesh.topology.dim - 1
    mesh.topology.create_connectivity(facet, facet + 1)
    mesh.topology.create_connectivity(facet + 1, facet)
    chosen = la.vector(space.dofmap.index_map, 1)
    chosen.array[:] = 0.0
    chosen.array[node] = 1.0
    chosen.scatter_forward()
    facets = exterior_facet_indices(mesh.topology)
    cells = mesh.topology.connectivity(facet, facet + 1)
    of_cell = mesh.topology.connectivity(facet + 1, facet)
    closure = [
        space.dofmap.dof_layout.entity_closure_dofs(facet, k)
        for k in range(len(of_cell.links(0)) if of_cell.num_nodes else 0)
    ]
    kept = []
    for f in facets:
        cell = cells.links(f)[0]
        which = int(np.flatnonzero(of_cell.links(cell) == f)[0])
        kept.append(chosen.array[space.dofmap.cell_dofs(cell)[closure[which]]].all())
    return facets[np.array(kept, dtype=bool)].astype(np.int32)


def _duals(part: Indices, weight: Array, measure: Array) -> Array:
    """D M^-1 w, (q, dim), at quadrature points of sub-facets (q,)."""
    if not len(part):
        return weight
    parts, of = np.unique(part, return_inverse=True)
    n = weight.shape[1]
    M = np.zeros((len(parts), n, n))
    np.add.at(M, of, np.einsum("q,qa,qb->qab", measure, weight, weight))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[of], inverse[of], weight))


def _averaged(trace: Trace) -> Array:
    """Unit normals (n, dim) of the trace's nodes in the order of their numbers."""
    nodes, corners, normal = trace.parts
    which, of = np.unique(nodes, return_inverse=True)
    sums = np.zeros((len(which), trace.dim))
    weighted = normal * _sizes(corners)[:, None]
    np.add.at(sums, of.reshape(nodes.shape), weighted[:, None, :])
    return np.asarray(sums / np.linalg.norm(sums, axis=1, keepdims=True))


def _in_symmetry_planes(normal: Array, free: npt.NDArray[np.bool_]) -> Array:
    """Normals (n, dim) without components that are prescribed, if these are small.

    On a symmetry plane the facets of one side alone are averaged.
    """
    inside = np.where(free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    near = length > _NEARLY
    return np.asarray(np.where(near, inside / np.where(near, length, 1.0), normal))


def _across(corners: Array) -> Array:
    """Unit normals (n, dim) of intervals or triangles, of either sign."""
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        normal = np.asarray(edges[:, 0, ::-1] * [1.0, -1.0])
    else:
        normal = np.asarray(np.cross(edges[:, 0], edges[:, 1]))
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def _sizes(corners: Array) -> Array:
    """Lengths or areas (n,)."""
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        return np.asarray(np.linalg.norm(edges[:, 0], axis=1))
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)
