"""Mortar interfaces: two deformable bodies whose meshes need not match.

The theory page describes the method ("Two bodies"). Multipliers are expanded in the duals psi of
the slave's weight functions w: slave node j receives the force r_j = A_j t_j, and master node k
receives -M_jk r_j / A_j, with M_jk = integral of psi_j w_k. H has a unit entry in the equation of
each contact point, as for matching nodes. H is not G^T, because tractions are weighted with duals
and gaps with weight functions (B. Wohlmuth, https://doi.org/10.1137/S0036142999350929).

Sub-facets of the two surfaces overlap in intervals or polygons. A sub-facet is an interval, a
triangle or a quadrilateral, defined by its corners and treated as flat. Sub-facets of the master
are projected onto those of the slave along a direction of the latter. Overlaps are split into
simplices, in coordinates along the edges of the slave's sub-facet, so that a quadrature rule for a
simplex integrates polynomials on both surfaces exactly. Corners of quadrilaterals are in tensor
product order; their weight functions are bilinear in reference coordinates, which are polynomials
of the coordinates used here only on parallelograms.
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

# Nodes of each sub-facet of a facet, by the number of the facet's nodes: vertices come first, then
# the middles of edges, then the centre of a quadrilateral
_SUB_FACET_NODES = {
    3: ((0, 2), (2, 1)),
    6: ((0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)),
    9: ((0, 4, 5, 8), (4, 1, 8, 6), (5, 8, 2, 7), (8, 6, 7, 3)),
}
# Corners of the simplices that make up a sub-facet, by its number of corners
_SIMPLEX_CORNERS = {2: ([0, 1],), 3: ([0, 1, 2],), 4: ([0, 1, 3], [0, 3, 2])}
# Cell type of a sub-facet, by its number of corners
_SUB_FACET_CELL_TYPES = {
    2: basix.CellType.interval,
    3: basix.CellType.triangle,
    4: basix.CellType.quadrilateral,
}
# Cosine of the angle between the normals of adjacent facets below which their edge is sharp
_MAX_SHARP_EDGE_COSINE = float(np.cos(np.pi / 4)) - 1e-9

# Smallest overlap, relative to the size of the slave's sub-facet
_MIN_OVERLAP_FRACTION = 1e-12
# Largest cosine between the normals of sub-facets that face each other
MAX_FACING_COSINE = -1e-2
# Corners of a sub-facet in the order along its rim, by their number
_CORNERS_ALONG_RIM = {3: [0, 1, 2], 4: [0, 1, 3, 2]}
# Newton's method for reference coordinates in a quadrilateral: limit of steps, and largest change
# of a coordinate in the final step
_MAX_NEWTON_STEPS = 25
_NEWTON_TOLERANCE = 1e-14
# Polynomial degree of products of weights, quadratic functions and, in axisymmetry, the radius, by
# the number of corners of a sub-facet; and the degree of the rule where quadrilaterals are not
# parallelograms, so that the integrand is not a polynomial
_QUADRATURE_DEGREES = {2: 4, 3: 4, 4: 6}
_NON_PARALLELOGRAM_DEGREE = 10
# Largest difference of opposite sides of a parallelogram, relative to its size
_PARALLELOGRAM_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Trace:
    """A part of the boundary, gathered from all processes: facets (f) with k nodes each."""

    facet_nodes: Indices  # (f, k), global; vertices first, then the middles of edges
    facet_x: Array  # (f, k, dim), positions of these nodes
    facet_normals: Array  # (f, dim), outward unit normals of the facets, treated as flat

    @property
    def dim(self) -> int:
        """Dimension of the space that contains the surface."""
        return int(self.facet_x.shape[2])

    @cached_property
    def _element(self) -> basix.finite_element.FiniteElement:
        return basix.create_element(
            basix.ElementFamily.P, _SUB_FACET_CELL_TYPES[self._sub_facet_nodes.shape[1]], 2
        )

    @cached_property
    def _sub_facet_nodes(self) -> Indices:
        """Nodes (sub-facets, k) of the sub-facets of one facet."""
        return np.array(_SUB_FACET_NODES[self.facet_nodes.shape[1]])

    @cached_property
    def sub_facets(self) -> tuple[Indices, Array, Array]:
        """Nodes (s, k) of all sub-facets, their corners (s, k, dim) and unit normals (s, dim)."""
        count, k = self._sub_facet_nodes.shape
        corners = self.facet_x[:, self._sub_facet_nodes].reshape(-1, k, self.dim)
        outward = np.repeat(self.facet_normals, count, axis=0)
        normal = compute_cell_normals(corners)
        normal *= np.sign(np.sum(normal * outward, axis=1))[:, None]
        return self.facet_nodes[:, self._sub_facet_nodes].reshape(-1, k), corners, normal

    def evaluate_trial_functions(
        self, sub_facet: Indices, corner_weights: Array
    ) -> tuple[Indices, Array]:
        """Return nodes (q, n) and values (q, n) of the quadratic trial functions at points.

        Args:
            sub_facet: (q,), number of the sub-facet that contains each point.
            corner_weights: (q, k), values of the functions of its corners at the point.
        """
        facet, part = np.divmod(sub_facet, len(self._sub_facet_nodes))
        corner_coordinates = self._element.points[self._sub_facet_nodes][part]
        coordinates = np.einsum("qa,qab->qb", corner_weights, corner_coordinates)
        values = np.zeros((len(sub_facet), self.facet_nodes.shape[1]))
        if len(sub_facet):  # Basix does not accept empty arrays
            values = self._element.tabulate(0, coordinates)[0, :, :, 0]
        return self.facet_nodes[facet], values

    def interpolate_positions(self, sub_facet: Indices, values: Array) -> Array:
        """Return positions (q, dim) of points with these values (q, n) of trial functions."""
        facet_x = self.facet_x[sub_facet // len(self._sub_facet_nodes)]
        return np.einsum("qk,qkd->qd", values, facet_x)

    @cached_property
    def nodes(self) -> Indices:
        """Global numbers (n,) of the nodes, sorted."""
        return np.unique(self.facet_nodes)

    def with_positions(self, x: Array) -> "Trace":
        """Return a copy with the nodes at positions x (n, dim)."""
        return replace(self, facet_x=x[np.searchsorted(self.nodes, self.facet_nodes)])

    def average_normals(self, nodes: Indices) -> Array:
        """Return unit normals (..., dim) at nodes (...): means of sub-facets weighted by size."""
        sub_facet_nodes, corners, normal = self.sub_facets
        position = np.searchsorted(self.nodes, sub_facet_nodes)
        sums = np.zeros((len(self.nodes), self.dim))
        np.add.at(sums, position, (normal * compute_cell_sizes(corners)[:, None])[:, None, :])
        sums /= np.linalg.norm(sums, axis=1, keepdims=True)
        return sums[np.searchsorted(self.nodes, nodes)]

    def find_sharp_edges(self) -> Array:
        """Return positions (n, dim) where normals of adjacent facets differ by over 45 degrees."""
        k, element = self.facet_nodes.shape[1], self._element
        slopes = element.tabulate(1, element.points)[1:, :, :, 0]
        tangents = np.einsum("dqk,fkx->fqdx", slopes, self.facet_x)
        tangents = tangents.reshape(-1, self.dim - 1, self.dim)
        normal = compute_cell_normals(
            np.concatenate([np.zeros_like(tangents[:, :1]), tangents], axis=1)
        )
        normal *= np.sign(np.sum(normal * np.repeat(self.facet_normals, k, axis=0), axis=1))[
            :, None
        ]
        # local nodes at which at most two facets meet: end nodes in the plane, mid-side nodes in
        # space
        shared = np.concatenate(element.entity_dofs[self.dim - 2]).astype(np.int64)
        normal = normal.reshape(-1, k, self.dim)[:, shared].reshape(-1, self.dim)
        node = self.facet_nodes[:, shared].ravel()
        x = self.facet_x[:, shared].reshape(-1, self.dim)
        order = np.argsort(node, kind="stable")
        facet, neighbour = order[:-1], order[1:]
        cosine = np.sum(normal[facet] * normal[neighbour], axis=1)
        sharp = (node[facet] == node[neighbour]) & (cosine < _MAX_SHARP_EDGE_COSINE)
        return np.asarray(x[facet[sharp]])

    def node_positions(self) -> Array:
        """Return positions (n, dim) of the nodes."""
        _, index = np.unique(self.facet_nodes, return_index=True)
        return self.facet_x.reshape(-1, self.dim)[index]


def gather_trace(space: fem.FunctionSpace, facets: LocalIndices) -> Trace:
    """Return the trace of exterior facets (local numbers) of all processes; collective."""
    nodes, x, outward = compute_flat_facets(space, facets)
    number = space.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
    parts = zip(*space.mesh.comm.allgather((number, x, outward)), strict=True)
    return Trace(*(np.concatenate(part) for part in parts))


def compute_flat_facets(
    space: fem.FunctionSpace, facets: LocalIndices
) -> tuple[LocalIndices, Array, Array]:
    """Return nodes (f, k) of exterior facets, their positions, and outward unit normals (f, dim).

    Normals are those of facets treated as flat.
    """
    dim, (cells, local_nodes) = space.mesh.topology.dim, locate_facets_in_cells(space, facets)
    cell_nodes = space.dofmap.list[cells]
    nodes = np.take_along_axis(cell_nodes, local_nodes, axis=1)
    x = space.tabulate_dof_coordinates()[:, :dim]
    cell_middle = x[cell_nodes].mean(axis=1)
    normal = compute_cell_normals(x[nodes[:, :dim]])
    normal *= np.sign(np.sum(normal * (x[nodes[:, 0]] - cell_middle), axis=1))[:, None]
    return nodes, x[nodes], normal


def compute_cell_normals(corners: Array) -> Array:
    """Return unit normals (n, dim) of cells with corners (n, k, dim); the sign is arbitrary.

    Cells are intervals in the plane, triangles or quadrilaterals in space.
    """
    vectors = _spanning_vectors(corners)
    if corners.shape[2] == 2:
        normal = np.asarray(vectors[:, 0, ::-1] * [1.0, -1.0])
    else:
        normal = np.asarray(np.cross(vectors[:, 0], vectors[:, 1]))
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def compute_cell_sizes(corners: Array) -> Array:
    """Return lengths or areas (n,) of cells with corners (n, k, dim).

    The area of a quadrilateral is that of its projection along its normal.
    """
    if corners.shape[1] == 4:
        u, v = np.swapaxes(_spanning_vectors(corners), 0, 1)
        return np.asarray(np.linalg.norm(np.cross(u, v), axis=1) / 2)
    return compute_jacobian_factors(corners) / (corners.shape[1] - 1)


def _spanning_vectors(corners: Array) -> Array:
    """Return the edges from the first corner of simplices, or the diagonals of quadrilaterals."""
    if corners.shape[1] == 4:
        return np.asarray(corners[:, [3, 2]] - corners[:, :2])
    return np.asarray(corners[:, 1:] - corners[:, :1])


@dataclass(frozen=True)
class OverlapSimplices:
    """Simplices (q) of dimension d that make up the overlaps of sub-facets.

    Coordinates are along the first edges of the slave's sub-facet.
    """

    slave_sub_facet: Indices  # (q,)
    master_sub_facet: Indices  # (q,)
    corners: Array  # (q, d + 1, d)
    slave_corners: Array  # (q, k, d), of the slave's sub-facet
    master_corners: Array  # (q, k, d), of the master's sub-facet, projected
    size: Array  # (q,), lengths or areas in these coordinates


def find_overlaps(
    slave: Array, master: Array, directions: Array, outward: Array
) -> OverlapSimplices:
    """Return the overlaps of two surfaces, projected along directions of the slave.

    Args:
        slave: (s, k, dim), corners of the slave's sub-facets.
        master: (m, k, dim), corners of the master's sub-facets.
        directions: (s, dim), unit vectors out of the slave's body.
        outward: (m, dim), unit normals of the master.
    """
    slave_index, master_index = _find_candidate_pairs(slave, master, directions)
    cosine = np.sum(directions[slave_index] * outward[master_index], axis=1)
    facing = cosine < MAX_FACING_COSINE
    slave_index, master_index = slave_index[facing], master_index[facing]
    edges = slave[:, 1 : slave.shape[2]] - slave[:, :1]
    basis = np.concatenate([edges, directions[:, None]], axis=1)[slave_index]
    slave_corners, master_corners = (  # without the last coordinate, along the projection
        _coordinates_along_edges(basis, corners - slave[slave_index, :1])[..., :-1]
        for corners in (slave[slave_index], master[master_index])
    )
    pair, corners = (_intersect_intervals if slave.shape[2] == 2 else _intersect_polygons)(
        slave_corners, master_corners
    )
    size, whole = compute_cell_sizes(corners), slave_corners[pair]
    keep = size > _MIN_OVERLAP_FRACTION * sum(
        compute_cell_sizes(whole[:, simplex]) for simplex in _SIMPLEX_CORNERS[whole.shape[1]]
    )
    pair, corners, size = pair[keep], corners[keep], size[keep]
    return OverlapSimplices(
        slave_index[pair],
        master_index[pair],
        corners,
        slave_corners[pair],
        master_corners[pair],
        size,
    )


def evaluate_corner_functions(corners: Array, points: Array) -> Array:
    """Return values (q, g, k) of the functions of corners (q, k, d) at points (q, g, d).

    They are linear on intervals and triangles, bilinear on quadrilaterals, where Newton's method
    finds the reference coordinates of the points.
    """
    k, d = corners.shape[1:]
    edges = corners[:, 1 : d + 1] - corners[:, :1]
    coordinates = _coordinates_along_edges(edges, points - corners[:, :1])
    if k == d + 1:
        vertex_function = 1 - coordinates.sum(axis=2, keepdims=True)
        return np.concatenate([vertex_function, coordinates], axis=2)
    difference = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    twist = _coordinates_along_edges(edges, difference[:, None])
    u, v = coordinates[..., 0].copy(), coordinates[..., 1].copy()
    for _ in range(_MAX_NEWTON_STEPS):  # u + twist_0 u v and v + twist_1 u v are the coordinates
        residual = [
            value + twist[..., i] * u * v - coordinates[..., i] for i, value in enumerate((u, v))
        ]
        a, b = 1 + twist[..., 0] * v, twist[..., 0] * u
        c, e = twist[..., 1] * v, 1 + twist[..., 1] * u
        determinant = a * e - b * c
        step = (
            (e * residual[0] - b * residual[1]) / determinant,
            (a * residual[1] - c * residual[0]) / determinant,
        )
        u, v = u - step[0], v - step[1]
        if np.abs(step).max(initial=0.0) < _NEWTON_TOLERANCE:
            break
    return np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=2)


def _coordinates_along_edges(edges: Array, vectors: Array) -> Array:
    """Return coordinates (q, g, d) of vectors (q, g, d) in the basis of edges (q, d, d), rows."""
    return np.swapaxes(np.linalg.solve(*(np.swapaxes(x, 1, 2) for x in (edges, vectors))), 1, 2)


def compute_jacobian_factors(corners: Array, corner_weights: Array | None = None) -> Array:
    """Return lengths or areas (q,) per unit of the reference cell.

    Args:
        corners: (q, k, dim), of cells.
        corner_weights: (q, k), values of the corners' functions at a point of each cell; needed on
            quadrilaterals, as the factor is constant on simplices.
    """
    edges = corners[:, 1:3] - corners[:, :1]
    if corners.shape[1] == 2:
        return np.asarray(np.linalg.norm(edges[:, 0], axis=1))
    if corner_weights is not None and corners.shape[1] == 4:
        opposite_edges = corners[:, 3:] - corners[:, [2, 1]]
        v_and_u = np.stack(
            [corner_weights[:, 2:].sum(axis=1), corner_weights[:, 1::2].sum(axis=1)], axis=1
        )
        edges = edges + v_and_u[:, :, None] * (opposite_edges - edges)
    if corners.shape[2] == 2:
        return np.asarray(np.abs(np.linalg.det(edges)))
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))


def _find_candidate_pairs(
    slave: Array, master: Array, directions: Array
) -> tuple[Indices, Indices]:
    """Return numbers (q,) of sub-facets of slave and master whose bounding boxes intersect.

    The slave's boxes are aligned with their directions, along which they extend as far as the
    search radius. The master's boxes are aligned with the axes; in the order of a k-d tree they are
    merged two by two, up to one box of all, from which the search descends for all slaves at once.
    """
    if not len(slave) or not len(master):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    slave_middle, master_middle = slave.mean(axis=1), master.mean(axis=1)
    tree = cKDTree(master_middle)
    from_middle = slave - slave_middle[:, None]
    slave_radius, master_radius = (
        np.linalg.norm(x, axis=2).max(axis=1)
        for x in (from_middle, master - master_middle[:, None])
    )
    search_radius = slave_radius + master_radius.max() + tree.query(slave_middle)[0]
    axes = np.linalg.svd(directions[:, None])[2]  # of the slave's boxes; the first is the direction
    half_width = np.abs(from_middle @ np.swapaxes(axes, 1, 2)).max(axis=1)
    half_width[:, 0] = search_radius
    boxes = [np.stack([end(master[tree.indices], axis=1) for end in (np.min, np.max)])]
    while (n := boxes[-1].shape[1]) > 1:
        pairs = np.arange(0, n, 2)
        low, high = boxes[-1]
        merged = np.minimum.reduceat(low, pairs), np.maximum.reduceat(high, pairs)
        boxes.append(np.stack(merged))
    slave_index: Indices = np.arange(len(slave))
    box: Indices = np.zeros(len(slave), dtype=np.int64)
    for level, (low, high) in enumerate(reversed(boxes)):
        if level:
            slave_index, box = np.repeat(slave_index, 2), (2 * box[:, None] + np.arange(2)).ravel()
            slave_index, box = slave_index[box < len(low)], box[box < len(low)]
        centre, extent = (low + high) / 2, (high - low) / 2
        for k in range(slave.shape[2]):
            axis = axes[slave_index, k]
            distance = np.abs(np.sum(axis * (centre[box] - slave_middle[slave_index]), axis=1))
            reach = half_width[slave_index, k] + np.sum(np.abs(axis) * extent[box], axis=1)
            intersects = distance <= reach
            slave_index, box = slave_index[intersects], box[intersects]
    master_index = tree.indices[box]
    distance = np.linalg.norm(master_middle[master_index] - slave_middle[slave_index], axis=1)
    near = distance <= search_radius[slave_index]
    return slave_index[near], master_index[near]


def _intersect_intervals(slave: Array, master: Array) -> tuple[Indices, Array]:  # noqa: ARG001
    """Return the pairs (q,) that overlap, and the ends (q, 2, 1) of their overlaps.

    The slave's intervals are [0, 1] in these coordinates, and are not used.
    """
    low, high = (np.clip(end(master[:, :, 0], axis=1), 0.0, 1.0) for end in (np.min, np.max))
    pair = np.flatnonzero(high > low)
    return pair, np.stack([low, high], axis=1)[pair, :, None]


def _intersect_polygons(slave: Array, master: Array) -> tuple[Indices, Array]:
    """Return triangles that make up the overlaps: their pairs (q,) and corners (q, 3, 2).

    The master's polygon is clipped at each side of the slave's in turn (Sutherland and Hodgman,
    https://doi.org/10.1145/360767.360802), and the remaining polygon is split into a fan.
    """
    n, k = master.shape[:2]
    rim = slave[:, _CORNERS_ALONG_RIM[k]]
    polygon: Array = np.zeros((n, 2 * k + 1, 2))
    polygon[:, :k] = master[:, _CORNERS_ALONG_RIM[k]]
    count: Indices = np.full(n, k)
    for side in range(k):
        start, end = rim[:, side], rim[:, (side + 1) % k]
        inwards = np.stack([start[:, 1] - end[:, 1], end[:, 0] - start[:, 0]], axis=1)
        height = np.einsum("nd,nmd->nm", inwards, polygon - start[:, None])
        polygon, count = _clip_polygons(polygon, count, height)
    fans = [np.flatnonzero(count > j + 2) for j in range(2 * k - 1)]
    pair = np.concatenate(fans)
    triangles = [polygon[indices][:, [0, j + 1, j + 2]] for j, indices in enumerate(fans)]
    return pair, np.concatenate(triangles)


def _clip_polygons(polygon: Array, count: Indices, height: Array) -> tuple[Array, Indices]:
    """Remove the parts of polygons that have a negative height, linear between corners.

    Args:
        polygon: (n, max_count, 2), corners.
        count: (n,), number of corners of each polygon.
        height: (n, max_count), at the corners.

    Returns:
        Corners and their numbers of the clipped polygons.
    """
    n, max_count, _ = polygon.shape
    clipped, size = np.zeros_like(polygon), np.zeros(n, dtype=np.int64)
    row = np.arange(n)
    for k in range(max_count):
        exists = k < count
        following = np.where(k + 1 < count, k + 1, 0)
        start, end = polygon[:, k], polygon[row, following]
        a, b = height[:, k], height[row, following]
        inside = exists & (a >= 0)
        clipped[row[inside], size[inside]] = start[inside]
        size += inside
        crossed = exists & ((a >= 0) != (b >= 0))
        t = (a / np.where(crossed, a - b, 1.0))[:, None]
        clipped[row[crossed], size[crossed]] = (start + t * (end - start))[crossed]
        size += crossed
    return clipped, size


@dataclass(frozen=True)
class Overlap:
    """Quadrature points (q) on the overlaps of the slave's sub-facets with the master.

    Only sub-facets at contact points of this process are included.
    """

    point: Indices  # (q, k), contact point at each corner, -1 for those of other processes
    weight: Array  # (q, k), weight functions of the corners
    dual: Array  # (q, k), dual functions of the corners
    measure: Array  # (q,), quadrature weights times lengths or areas
    slave_size: Array  # (q,), length or area of the slave's sub-facet
    size_ratio: Array  # (q,), size of the slave's sub-facet over that of the master's
    separation: Array  # (q, dim), vector from the master to the slave
    # nodes (q, n) and values (q, n) of the slave's and the master's quadratic functions, and of the
    # master's weight functions
    functions: tuple[tuple[Indices, Array], ...]

    @classmethod
    def from_traces(cls, slave: Trace, master: Trace, owned: Indices, revolved: bool) -> "Overlap":
        """Find the overlap of two traces.

        Args:
            slave: trace of the slave.
            master: trace of the master.
            owned: (m,), global numbers of the slave's nodes that are points of this process.
            revolved: whether areas are those of the whole circumference.
        """
        slave_nodes, slave_corners, _ = slave.sub_facets
        master_nodes, master_corners, outward = master.sub_facets
        local = np.flatnonzero(np.isin(slave_nodes, owned).any(axis=1))
        directions = slave.average_normals(slave_nodes[local]).mean(axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        simplices = find_overlaps(slave_corners[local], master_corners, directions, outward)
        order = np.argsort(owned)
        index = np.searchsorted(owned, slave_nodes, sorter=order)
        point = (
            order[np.minimum(index, len(owned) - 1)] if len(owned) else np.zeros_like(slave_nodes)
        )
        point = np.where(np.isin(slave_nodes, owned), point, -1)
        degree = _QUADRATURE_DEGREES[slave_corners.shape[1]]
        if _has_non_parallelogram(simplices.slave_corners) or _has_non_parallelogram(
            simplices.master_corners
        ):
            degree = _NON_PARALLELOGRAM_DEGREE
        points, rule = basix.make_quadrature(_SUB_FACET_CELL_TYPES[slave.dim], degree)
        barycentric = np.column_stack([1 - points.sum(axis=1), points])
        rule = rule / rule.sum()
        slave_index, master_index = (
            np.repeat(k, len(rule))
            for k in (local[simplices.slave_sub_facet], simplices.master_sub_facet)
        )
        coordinates = np.einsum("ga,qad->qgd", barycentric, simplices.corners)
        w1, w2 = (
            evaluate_corner_functions(corners, coordinates).reshape(
                len(slave_index), corners.shape[1]
            )
            for corners in (simplices.slave_corners, simplices.master_corners)
        )
        flat_corners = np.repeat(simplices.slave_corners, len(rule), axis=0)
        area_ratio = compute_jacobian_factors(
            slave_corners[slave_index], w1
        ) / compute_jacobian_factors(flat_corners, w1)
        slave_size = compute_cell_sizes(slave_corners)[slave_index]
        master_size = compute_cell_sizes(master_corners)[master_index]
        measure = area_ratio * np.outer(simplices.size, rule).ravel()
        nodes1, N1 = slave.evaluate_trial_functions(slave_index, w1)
        nodes2, N2 = master.evaluate_trial_functions(master_index, w2)
        x1 = slave.interpolate_positions(slave_index, N1)
        x2 = master.interpolate_positions(master_index, N2)
        if revolved:
            measure = measure * 2 * np.pi * x1[:, 0]
        dual = _evaluate_duals(slave_index, w1, measure)
        functions = ((nodes1, N1), (nodes2, N2), (master_nodes[master_index], w2))
        return cls(
            point[slave_index],
            w1,
            dual,
            measure,
            slave_size,
            slave_size / master_size,
            x1 - x2,
            functions,
        )

    def mean_edge(self, size: Array, comm: MPI.Comm) -> float:
        """Return the mean of lengths (q,), or of roots of areas (q,), over all processes."""
        edges = size ** (1 / (self.separation.shape[1] - 1))
        total = comm.allreduce(np.array([self.measure @ edges, self.measure.sum()]), MPI.SUM)
        return float(total[0] / total[1])

    def integrate_per_point(self, values: Array, m: int) -> Array:
        """Integrate weight functions of m contact points times values; return (m,).

        Args:
            values: (q,), or (q, k) with one value for each corner.
            m: number of contact points of this process.
        """
        values = np.atleast_2d(values.T).T
        owned = self.point >= 0
        products = (self.weight * (self.measure[:, None] * values))[owned]
        return np.asarray(np.bincount(self.point[owned], products, minlength=m), dtype=float)

    def assemble_integrals(
        self, tested: Array, column: Indices, values: Array, shape: tuple[int, int]
    ) -> sp.csr_array:
        """Assemble the matrix of integrals of two sets of functions.

        Args:
            tested: (q, k), functions of the contact points, which are the rows.
            column: (q, n), column of each of the other functions.
            values: (q, n), of the other functions.
            shape: of the matrix.
        """
        products = np.einsum("q,qa,qk->qak", self.measure, tested, values)
        row = np.broadcast_to(self.point[:, :, None], products.shape)
        owned = row >= 0
        indices = (row[owned], np.broadcast_to(column[:, None], products.shape)[owned])
        return sp.csr_array(sp.coo_array((products[owned], indices), shape))


def compute_tributary_areas(trace: Trace, revolved: bool) -> Array:
    """Integrate the weight function of each node over a whole trace; return (n,).

    Sub-facets are treated as those of an `Overlap`. `revolved` integrates over the circumference.
    """
    nodes, corners, _ = trace.sub_facets
    k = corners.shape[1]
    cell_type = _SUB_FACET_CELL_TYPES[k]
    points, rule = basix.make_quadrature(cell_type, _QUADRATURE_DEGREES[k])
    element = basix.create_element(basix.ElementFamily.P, cell_type, 1)
    values = element.tabulate(0, points)[0, :, :, 0]
    sub_facet, w = np.repeat(np.arange(len(corners)), len(rule)), np.tile(values, (len(corners), 1))
    measure = compute_jacobian_factors(corners[sub_facet], w) * np.tile(rule, len(corners))
    if revolved:
        _, N = trace.evaluate_trial_functions(sub_facet, w)
        measure = measure * 2 * np.pi * trace.interpolate_positions(sub_facet, N)[:, 0]
    index = np.searchsorted(trace.nodes, nodes[sub_facet])
    return np.asarray(np.bincount(index.ravel(), (w * measure[:, None]).ravel()), dtype=float)


def _has_non_parallelogram(corners: Array) -> bool:
    """Return whether any of the cells (q, k, d) is a quadrilateral but no parallelogram."""
    if corners.shape[1] < 4:
        return False
    difference = corners[:, 3] - corners[:, 2] - corners[:, 1] + corners[:, 0]
    return bool(np.abs(difference).max(initial=0.0) > _PARALLELOGRAM_TOLERANCE)


def _evaluate_duals(sub_facet: Indices, weight: Array, measure: Array) -> Array:
    """Return dual functions D M^-1 w, (q, k), at quadrature points.

    Args:
        sub_facet: (q,), that contains each point; M and D are integrated over its points.
        weight: (q, k), w.
        measure: (q,).
    """
    if not len(sub_facet):
        return weight
    unique, index = np.unique(sub_facet, return_inverse=True)
    n = weight.shape[1]
    M = np.zeros((len(unique), n, n))
    np.add.at(M, index, np.einsum("q,qa,qb->qab", measure, weight, weight))
    D = M.sum(axis=2)
    inverse = np.linalg.inv(M)
    return np.asarray(np.einsum("qa,qab,qb->qa", D[index], inverse[index], weight))
