"""Mortar interfaces: two deformable bodies whose meshes need not match.

The guide's page on theory says what is computed, and what is exact ("Two bodies"): multipliers
are expanded in the duals psi of the slave's weights w, node j gets the force r_j = A_j t_j, and
the master's nodes k get - M_jk r_j / A_j, with M_jk = integral of psi_j w_k. H has the unit in a
point's own equation, as for matching nodes; it is not G^T, for tractions are weighted with duals
and gaps with weights (B. Wohlmuth, https://doi.org/10.1137/S0036142999350929).

Sub-facets of two surfaces face each other in segments of lines or polygons of planes. A sub-facet
is an interval, a triangle or a quadrilateral, given by its corners and seen as flat. The master's
are projected on the slave's, along a direction of the latter; overlaps are cut into simplices, in
coordinates along the slave's edges, so that a rule for a simplex integrates polynomials on both
surfaces exactly. Corners of quadrilaterals are in the order of the tensor product; their weights
are bilinear in places that are no polynomials of coordinates, unless they are parallelograms.
"""

from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI

import basix
import numpy as np
import scipy.sparse as sp
from dolfinx import fem
from scipy.spatial import cKDTree

from pw_elements.arrays import Array, Indices, LocalIndices
from pw_elements.elasticity import locate_facets_in_cells

# Nodes of the sub-facets of a facet of so many nodes: vertices first, then the middles of edges,
# and a quadrilateral's own
_PARTS = {
    3: ((0, 2), (2, 1)),
    6: ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
    9: ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
}
# Corners of the simplices that make up a sub-facet with so many
_SIMPLICES = {2: ([0, 1],), 3: ([0, 1, 2],), 4: ([0, 1, 3], [0, 3, 2])}
# Sub-facets of so many corners
_CELLS = {2: basix.CellType.interval, 3: basix.CellType.triangle, 4: basix.CellType.quadrilateral}
# Cosine between the normals of facets that meet, below which they have an edge between them
_EDGE = float(np.cos(np.pi / 4)) - 1e-9

# Overlaps of less than this part of the slave's sub-facet are none
_NO_OVERLAP = 1e-12
# Sub-facets whose normals have a larger cosine stand across each other, or look the same way
FACING = -1e-2
# Corners of a sub-facet of a surface, by their number, one after the other along its rim
_RIM = {3: [0, 1, 2], 4: [0, 1, 3, 2]}
# Steps of Newton's method, which ends earlier where they change no place in a cell by more
_NEWTON_STEPS = 25
_STILL = 1e-14
# Of products of weights, quadratic functions and, in axisymmetry, the radius, on sub-facets of so
# many corners; and where quadrilaterals are no parallelograms, so that nothing is a polynomial
_DEGREE = {2: 4, 3: 4, 4: 6}
_TWISTED_DEGREE = 10
# Difference of opposite sides of parallelograms, over their size
_PARALLEL = 1e-9


@dataclass(frozen=True)
class Trace:
    """A part of the boundary, gathered from all processes: facets (f) with k nodes each."""

    node: Indices  # (f, k), global; vertices first, then the middles of edges
    x: Array  # (f, k, dim)
    outward: Array  # (f, dim), unit normals of the facets, seen as flat

    @property
    def dim(self) -> int:
        """Dimension of the space that the surface lies in."""
        return int(self.x.shape[2])

    @cached_property
    def _element(self) -> basix.finite_element.FiniteElement:
        return basix.create_element(basix.ElementFamily.P, _CELLS[self._local.shape[1]], 2)

    @cached_property
    def _local(self) -> Indices:
        """Nodes (parts, k) of the sub-facets of a facet."""
        return np.array(_PARTS[self.node.shape[1]])

    @cached_property
    def parts(self) -> tuple[Indices, Array, Array]:
        """Nodes (s, k) of the sub-facets, their corners (s, k, dim), and normals (s, dim)."""
        parts, k = self._local.shape
        corners = self.x[:, self._local].reshape(-1, k, self.dim)
        outward = np.repeat(self.outward, parts, axis=0)
        normal = across(corners)
        normal *= np.sign(np.sum(normal * outward, axis=1))[:, None]
        return self.node[:, self._local].reshape(-1, k), corners, normal

    def functions(self, part: Indices, place: Array) -> tuple[Indices, Array]:
        """Nodes (q, n) and quadratic functions (q, n) at weights (q, k) of sub-facets (q,)."""
        facet, which = np.divmod(part, len(self._local))
        at = np.einsum("qa,qab->qb", place, self._element.points[self._local][which])
        values = np.zeros((len(part), self.node.shape[1]))
        if len(part):  # Basix takes no empty arrays
            values = self._element.tabulate(0, at)[0, :, :, 0]
        return self.node[facet], values

    def positions(self, part: Indices, values: Array) -> Array:
        """Positions (q, dim) by quadratic functions (q, k)."""
        return np.einsum("qk,qkd->qd", values, self.x[part // len(self._local)])

    @cached_property
    def nodes(self) -> Indices:
        """Numbers (n,) of the nodes, sorted."""
        return np.unique(self.node)

    def moved(self, x: Array) -> "Trace":
        """The same surface with its nodes at positions (n, dim)."""
        return replace(self, x=x[np.searchsorted(self.nodes, self.node)])

    def normals(self, nodes: Indices) -> Array:
        """Unit normals (..., dim) of nodes (...), means over the sub-facets around by sizes."""
        around, corners, normal = self.parts
        of = np.searchsorted(self.nodes, around)
        sums = np.zeros((len(self.nodes), self.dim))
        np.add.at(sums, of, (normal * sizes(corners)[:, None])[:, None, :])
        sums /= np.linalg.norm(sums, axis=1, keepdims=True)
        return sums[np.searchsorted(self.nodes, nodes)]

    def edges(self) -> Array:
        """Positions (n, dim) where facets meet whose own normals differ by more than 45 degrees."""
        k, element = self.node.shape[1], self._element
        slopes = element.tabulate(1, element.points)[1:, :, :, 0]
        along = np.einsum("dqk,fkx->fqdx", slopes, self.x).reshape(-1, self.dim - 1, self.dim)
        normal = across(np.concatenate([np.zeros_like(along[:, :1]), along], axis=1))
        normal *= np.sign(np.sum(normal * np.repeat(self.outward, k, axis=0), axis=1))[:, None]
        # where two facets meet at most: nodes in the plane, the middles of edges in space
        meets = np.concatenate(element.entity_dofs[self.dim - 2]).astype(np.int64)
        normal = normal.reshape(-1, k, self.dim)[:, meets].reshape(-1, self.dim)
        node, x = self.node[:, meets].ravel(), self.x[:, meets].reshape(-1, self.dim)
        order = np.argsort(node, kind="stable")
        one, other = order[:-1], order[1:]
        sharp = (node[one] == node[other]) & (np.sum(normal[one] * normal[other], axis=1) < _EDGE)
        return np.asarray(x[one[sharp]])

    def positions_of_nodes(self) -> Array:
        """Positions (n, dim) of the nodes."""
        _, first = np.unique(self.node, return_index=True)
        return self.x.reshape(-1, self.dim)[first]


def gathered_trace(space: fem.FunctionSpace, facets: LocalIndices) -> Trace:
    """Exterior facets (local numbers) of all processes."""
    nodes, x, outward = flat_facets(space, facets)
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    parts = zip(*space.mesh.comm.allgather((number, x, outward)), strict=True)
    return Trace(*(np.concatenate(part) for part in parts))


def flat_facets(
    space: fem.FunctionSpace, facets: LocalIndices
) -> tuple[LocalIndices, Array, Array]:
    """Nodes (f, k) of exterior facets, their positions, and outward unit normals as if flat."""
    dim, (cells, places) = space.mesh.topology.dim, locate_facets_in_cells(space, facets)
    behind = space.dofmap.list[cells]
    nodes = np.take_along_axis(behind, places, axis=1)
    x = space.tabulate_dof_coordinates()[:, :dim]
    inside = x[behind].mean(axis=1)
    flat = across(x[nodes[:, :dim]])
    flat *= np.sign(np.sum(flat * (x[nodes[:, 0]] - inside), axis=1))[:, None]
    return nodes, x[nodes], flat


def across(corners: Array) -> Array:
    """Unit normals (n, dim) of intervals, triangles or quadrilaterals, of either sign."""
    edges = _spanning(corners)
    if corners.shape[2] == 2:
        normal = np.asarray(edges[:, 0, ::-1] * [1.0, -1.0])
    else:
        normal = np.asarray(np.cross(edges[:, 0], edges[:, 1]))
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def sizes(corners: Array) -> Array:
    """Lengths or areas (n,), of quadrilaterals those of their projection along the normal."""
    if corners.shape[1] == 4:
        one, other = np.swapaxes(_spanning(corners), 0, 1)
        return np.asarray(np.linalg.norm(np.cross(one, other), axis=1) / 2)
    return stretches(corners) / (corners.shape[1] - 1)


def _spanning(corners: Array) -> Array:
    """Edges from the first corner, or a quadrilateral's diagonals."""
    if corners.shape[1] == 4:
        return np.asarray(corners[:, [3, 2]] - corners[:, :2])
    return np.asarray(corners[:, 1:] - corners[:, :1])


@dataclass(frozen=True)
class Segments:
    """Overlaps (q), simplices of dimension d, in coordinates along the slave's first edges."""

    slave: Indices  # (q,), number of the slave's sub-facet
    master: Indices  # (q,)
    corners: Array  # (q, d + 1, d)
    on_slave: Array  # (q, k, d), corners of the slave's sub-facet
    on_master: Array  # (q, k, d), of the master's, projected
    size: Array  # (q,), lengths or areas in these coordinates


def segments(slave: Array, master: Array, along: Array, outward: Array) -> Segments:
    """Overlaps of two surfaces, given by the corners (s, k, dim) of their sub-facets.

    They are projected along unit directions (s, dim) out of the slave's body; `outward` (m, dim)
    are the master's unit normals.
    """
    one, other = _candidates(slave, master, along)
    facing = np.sum(along[one] * outward[other], axis=1) < FACING
    one, other = one[facing], other[facing]
    edges = slave[:, 1 : slave.shape[2]] - slave[:, :1]
    basis = np.concatenate([edges, along[:, None]], axis=1)[one]
    on_slave, on_master = (  # the last coordinate is along the projection
        _along(basis, part - slave[one, :1])[..., :-1] for part in (slave[one], master[other])
    )
    pair, corners = (_of_lines if slave.shape[2] == 2 else _of_polygons)(on_slave, on_master)
    size, own = sizes(corners), on_slave[pair]
    some = size > _NO_OVERLAP * sum(sizes(own[:, part]) for part in _SIMPLICES[own.shape[1]])
    pair, corners, size = pair[some], corners[some], size[some]
    return Segments(one[pair], other[pair], corners, on_slave[pair], on_master[pair], size)


def weights(corners: Array, places: Array) -> Array:
    """Linear or bilinear functions (q, g, k) of corners (q, k, d), at places (q, g, d)."""
    k, d = corners.shape[1:]
    edges = corners[:, 1 : d + 1] - corners[:, :1]
    inner = _along(edges, places - corners[:, :1])
    if k == d + 1:
        return np.concatenate([1 - inner.sum(axis=2, keepdims=True), inner], axis=2)
    apart = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    twist = _along(edges, apart[:, None])
    u, v = inner[..., 0].copy(), inner[..., 1].copy()
    for _ in range(_NEWTON_STEPS):  # u + twist_0 u v and v + twist_1 u v are known
        wrong = [at + twist[..., i] * u * v - inner[..., i] for i, at in enumerate((u, v))]
        a, b = 1 + twist[..., 0] * v, twist[..., 0] * u
        c, e = twist[..., 1] * v, 1 + twist[..., 1] * u
        determinant = a * e - b * c
        step = (
            (e * wrong[0] - b * wrong[1]) / determinant,
            (a * wrong[1] - c * wrong[0]) / determinant,
        )
        u, v = u - step[0], v - step[1]
        if np.abs(step).max(initial=0.0) < _STILL:
            break
    return np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=2)


def _along(edges: Array, away: Array) -> Array:
    """Coordinates (q, g, d) of vectors (q, g, d) along edges, the rows of (q, d, d)."""
    return np.swapaxes(np.linalg.solve(*(np.swapaxes(x, 1, 2) for x in (edges, away))), 1, 2)


def stretches(corners: Array, weight: Array | None = None) -> Array:
    """Lengths or areas (q,) per unit of the reference cell, of cells (q, k, dim) at weights.

    Simplices have the same everywhere.
    """
    edges = corners[:, 1:3] - corners[:, :1]
    if corners.shape[1] == 2:
        return np.asarray(np.linalg.norm(edges[:, 0], axis=1))
    if weight is not None and corners.shape[1] == 4:
        other = corners[:, 3:] - corners[:, [2, 1]]
        across = np.stack([weight[:, 2:].sum(axis=1), weight[:, 1::2].sum(axis=1)], axis=1)
        edges = edges + across[:, :, None] * (other - edges)
    if corners.shape[2] == 2:
        return np.asarray(np.abs(np.linalg.det(edges)))
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))


def _candidates(slave: Array, master: Array, along: Array) -> tuple[Indices, Indices]:
    """Pairs that may overlap: the master's box meets the slave's, which is as long as its reach.

    Slaves' boxes are turned along their directions. The master's, along the axes and in the order
    of a k-d tree, are joined two by two, up to a box of all: from there pairs descend together.
    """
    if not len(slave) or not len(master):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    middle, theirs = slave.mean(axis=1), master.mean(axis=1)
    tree = cKDTree(theirs)
    away = slave - middle[:, None]
    sizes, largest = (
        np.linalg.norm(x, axis=2).max(axis=1) for x in (away, master - theirs[:, None])
    )
    reach = sizes + largest.max() + tree.query(middle)[0]
    axes = np.linalg.svd(along[:, None])[2]  # of each slave's box, the first one along
    half = np.abs(away @ np.swapaxes(axes, 1, 2)).max(axis=1)
    half[:, 0] = reach
    boxes = [np.stack([end(master[tree.indices], axis=1) for end in (np.min, np.max)])]
    while (n := boxes[-1].shape[1]) > 1:
        pairs = np.arange(0, n, 2)
        low, high = boxes[-1]
        ends = np.minimum.reduceat(low, pairs), np.maximum.reduceat(high, pairs)
        boxes.append(np.stack(ends))
    one: Indices = np.arange(len(slave))
    other: Indices = np.zeros(len(slave), dtype=np.int64)
    for level, (low, high) in enumerate(reversed(boxes)):
        if level:
            one, other = np.repeat(one, 2), (2 * other[:, None] + np.arange(2)).ravel()
            one, other = one[other < len(low)], other[other < len(low)]
        centre, extent = (low + high) / 2, (high - low) / 2
        for k in range(slave.shape[2]):
            axis = axes[one, k]
            apart = np.abs(np.sum(axis * (centre[other] - middle[one]), axis=1))
            meets = apart <= half[one, k] + np.sum(np.abs(axis) * extent[other], axis=1)
            one, other = one[meets], other[meets]
    other = tree.indices[other]
    near = np.linalg.norm(theirs[other] - middle[one], axis=1) <= reach[one]
    return one[near], other[near]


def _of_lines(slave: Array, master: Array) -> tuple[Indices, Array]:  # noqa: ARG001
    """Pairs (q,) that overlap, and their corners (q, 2, 1)."""
    low, high = (np.clip(end(master[:, :, 0], axis=1), 0.0, 1.0) for end in (np.min, np.max))
    pair = np.flatnonzero(high > low)
    return pair, np.stack([low, high], axis=1)[pair, :, None]


def _of_polygons(slave: Array, master: Array) -> tuple[Indices, Array]:
    """Pairs (q,) that overlap, a triangle each, and their corners (q, 3, 2).

    The master's polygon is cut off at each side of the slave's in turn (Sutherland and Hodgman,
    https://doi.org/10.1145/360767.360802); what is left is a polygon, cut into a fan.
    """
    n, k = master.shape[:2]
    rim = slave[:, _RIM[k]]
    polygon: Array = np.zeros((n, 2 * k + 1, 2))
    polygon[:, :k] = master[:, _RIM[k]]
    count: Indices = np.full(n, k)
    for side in range(k):
        start, end = rim[:, side], rim[:, (side + 1) % k]
        inwards = np.stack([start[:, 1] - end[:, 1], end[:, 0] - start[:, 0]], axis=1)
        height = np.einsum("nd,nmd->nm", inwards, polygon - start[:, None])
        polygon, count = _cut(polygon, count, height)
    fans = [np.flatnonzero(count > j + 2) for j in range(2 * k - 1)]
    pair = np.concatenate(fans)
    cut = [polygon[some][:, [0, j + 1, j + 2]] for j, some in enumerate(fans)]
    return pair, np.concatenate(cut)


def _cut(polygon: Array, count: Indices, height: Array) -> tuple[Array, Indices]:
    """Polygons (n, most, 2) of `count` (n,) corners, less what has a negative height (n, most)."""
    n, most, _ = polygon.shape
    kept, size = np.zeros_like(polygon), np.zeros(n, dtype=np.int64)
    row = np.arange(n)
    for k in range(most):
        there = k < count
        following = np.where(k + 1 < count, k + 1, 0)
        start, end = polygon[:, k], polygon[row, following]
        a, b = height[:, k], height[row, following]
        inside = there & (a >= 0)
        kept[row[inside], size[inside]] = start[inside]
        size += inside
        crossed = there & ((a >= 0) != (b >= 0))
        t = (a / np.where(crossed, a - b, 1.0))[:, None]
        kept[row[crossed], size[crossed]] = (start + t * (end - start))[crossed]
        size += crossed
    return kept, size


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) of what the slave's sub-facets at own points have of the master."""

    point: Indices  # (q, k), of the sub-facet's corners, -1 for those of other processes
    weight: Array  # (q, k)
    dual: Array  # (q, k)
    measure: Array  # (q,), lengths or areas
    size: Array  # (q,), of the slave's sub-facet
    ratio: Array  # (q,), size of the slave's sub-facet over the master's
    apart: Array  # (q, dim), from the master to the slave
    # nodes (q, n) and values (q, n) of both quadratic functions, and of the master's weights
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def of(cls, one: Trace, other: Trace, own: Indices, revolved: bool) -> "Overlap":
        """Makes the overlap of both traces, for points of global numbers `own` (m,)."""
        (nodes, corners, _), (their_nodes, their_corners, outward) = one.parts, other.parts
        mine = np.flatnonzero(np.isin(nodes, own).any(axis=1))
        along = one.normals(nodes[mine]).mean(axis=1)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        found = segments(corners[mine], their_corners, along, outward)
        order = np.argsort(own)
        place = np.searchsorted(own, nodes, sorter=order)
        point = order[np.minimum(place, len(own) - 1)] if len(own) else np.zeros_like(nodes)
        point = np.where(np.isin(nodes, own), point, -1)
        degree = _DEGREE[corners.shape[1]]
        if _twisted(found.on_slave) or _twisted(found.on_master):
            degree = _TWISTED_DEGREE
        points, rule = basix.make_quadrature(_CELLS[one.dim], degree)
        barycentric = np.column_stack([1 - points.sum(axis=1), points])
        rule = rule / rule.sum()
        slave, master = (np.repeat(k, len(rule)) for k in (mine[found.slave], found.master))
        places = np.einsum("ga,qad->qgd", barycentric, found.corners)
        w1, w2 = (
            weights(on, places).reshape(len(slave), on.shape[1])
            for on in (found.on_slave, found.on_master)
        )
        seen = np.repeat(found.on_slave, len(rule), axis=0)
        stretch = stretches(corners[slave], w1) / stretches(seen, w1)
        size, theirs = sizes(corners)[slave], sizes(their_corners)[master]
        measure = stretch * np.outer(found.size, rule).ravel()
        (at1, N1), (at2, N2) = one.functions(slave, w1), other.functions(master, w2)
        x1, x2 = one.positions(slave, N1), other.positions(master, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _duals(slave, w1, measure)
        functions = ((at1, N1), (at2, N2), (their_nodes[master], w2))
        return cls(point[slave], w1, dual, measure, size, size / theirs, x1 - x2, functions)

    def mean_edge(self, size: Array, comm: MPI.Comm) -> float:
        """Mean of lengths, or of roots of areas, (q,), of all processes."""
        edges = size ** (1 / (self.apart.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def per_point(self, values: Array, m: int) -> Array:
        """Integrals (m,) of weights times values (q,), or (q, k) for each of the corners."""
        values = np.atleast_2d(values.T).T
        part = (self.weight * (self.measure[:, None] * values))[self.point >= 0]
        return np.asarray(np.bincount(self.point[self.point >= 0], part, minlength=m), dtype=float)

    def integrals(
        self, tested: Array, column: Indices, values: Array, shape: tuple[int, int]
    ) -> sp.csr_array:
        """Matrix of integrals of functions `tested` (q, k) of the points times others (q, n)."""
        part = np.einsum("q,qa,qk->qak", self.measure, tested, values)
        row = np.broadcast_to(self.point[:, :, None], part.shape)
        known = row >= 0
        place = (row[known], np.broadcast_to(column[:, None], part.shape)[known])
        return sp.csr_array(sp.coo_array((part[known], place), shape))


def whole_areas(trace: Trace, revolved: bool) -> Array:
    """Integrals (n,) of the weights of a trace's nodes over all of it, seen as an overlap's are."""
    nodes, corners, _ = trace.parts
    k = corners.shape[1]
    points, rule = basix.make_quadrature(_CELLS[k], _DEGREE[k])
    hats = basix.create_element(basix.ElementFamily.P, _CELLS[k], 1).tabulate(0, points)[0, :, :, 0]
    part, w = np.repeat(np.arange(len(corners)), len(rule)), np.tile(hats, (len(corners), 1))
    measure = stretches(corners[part], w) * np.tile(rule, len(corners))
    if revolved:
        _, N = trace.functions(part, w)
        measure = measure * 2 * np.pi * trace.positions(part, N)[:, 0]
    place = np.searchsorted(trace.nodes, nodes[part])
    return np.asarray(np.bincount(place.ravel(), (w * measure[:, None]).ravel()), dtype=float)


def _twisted(corners: Array) -> bool:
    """Whether any cells (q, k, d) are quadrilaterals, but no parallelograms."""
    if corners.shape[1] < 4:
        return False
    apart = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    return bool(np.abs(apart).max(initial=0.0) > _PARALLEL)


def _duals(part: Indices, weight: Array, measure: Array) -> Array:
    """D M^-1 w, (q, k), at quadrature points of sub-facets (q,)."""
    if not len(part):
        return weight
    parts, of = np.unique(part, return_inverse=True)
    n = weight.shape[1]
    M = np.zeros((len(parts), n, n))
    np.add.at(M, of, np.einsum("q,qa,qb->qab", measure, weight, weight))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[of], inverse[of], weight))
