"""Checks of the cells and the boundary of a mesh, made when a body is created.

The following defects are errors: flat cells; cells that are partly inside out (curved cells and
quadrilaterals that are not convex may be); two neighbours on the same side of a facet (folds);
facets with more than two cells; overlapping parts; and hanging nodes. Facets that coincide without
having common nodes are a crack, or the contact surfaces of two bodies. Both are legitimate and are
only logged, a crack as a warning.

The outward area vectors of the two cells at an inner facet have to cancel. If they do, the volumes
of the cells add up to the boundary integral of x·n / dim (position x, outward normal n), and this
sum need not be checked.

The guide's page on meshes lists defects that these checks cannot detect.
"""

import logging
from weakref import WeakKeyDictionary
from zlib import crc32

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem, geometry, la
from dolfinx.common import IndexMap
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements._compat import cell_geometry_nodes
from pw_elements.arrays import Array, Indices, Mask
from pw_elements.checks.joined import JoinedSpace, list_bodies
from pw_elements.progress import log_on_root

# Largest coordinate for which volumes do not overflow
MAX_COORDINATE = 1e100
# Smallest Jacobian determinant, relative to the dim-th power of the cell's size
_MIN_JACOBIAN_DETERMINANT_OVER_SIZE_POW_DIM = 1e-10
# Largest length of the sum of an inner facet's two area vectors, relative to the sum of their
# lengths. The ratio is 0, except for round-off, in valid meshes and 1 at a fold
_MAX_FACET_AREA_VECTOR_SUM_OVER_AREA_SUM = 1e-6
# Points whose distance is smaller than this multiple of a facet's size are regarded as coinciding
_COINCIDENCE_TOLERANCE_OVER_FACET_SIZE = 1e-6
# Number of cells whose Jacobians are held in memory at once
_CELLS_PER_BATCH = 20_000
# Arbitrary matrix. A ray along an axis of its orthonormal basis hardly ever hits an edge exactly
_ARBITRARY_MATRIX_FOR_RAY_AXES = np.sin(np.arange(9.0).reshape(3, 3) ** 2 + 1)

# Checksum of the coordinates of each mesh that has passed `check_mesh`
_coordinate_checksum_of_checked_mesh: WeakKeyDictionary[Mesh, int] = WeakKeyDictionary()


class DegenerateMesh(ValueError):
    """Mesh with flat, inverted, folded or overlapping cells, or with hanging nodes."""


def format_points(points: Array) -> str:
    """Format points (m, dim) as a text: sorted, with four digits, and only the first six points."""
    points = np.round(points, 12) + 0.0
    points = points[np.lexsort(np.round(points, 9).T[::-1])]
    formatted = ["(" + ", ".join(f"{c:.4g}" for c in point) + ")" for point in points[:6]]
    suffix = f" and {len(points) - 6} more" if len(points) > 6 else ""
    return ", ".join(formatted) + suffix


def check_mesh(mesh: Mesh) -> None:
    """Check the cells and boundary of a mesh, unless it has not changed since it was checked.

    Raises:
        DegenerateMesh: if there is a defect; the message names the centres of the cells or facets.
    """
    checksum = crc32(np.ascontiguousarray(mesh.geometry.x))
    if not mesh.comm.allreduce(_coordinate_checksum_of_checked_mesh.get(mesh) != checksum, MPI.LOR):
        return
    if mesh.topology.dim != mesh.geometry.dim:
        raise DegenerateMesh("the mesh is a surface or line in space, not a body")
    _check_coordinate_magnitudes(mesh)
    cells = _CellChecks(mesh)
    cells.check_shapes_and_facets()
    if mesh.topology.dim > 1:
        surface = _MeshBoundaryChecks(cells)
        surface.check_hanging_nodes()
        surface.check_overlapping_cells()
        surface.log_coincident_facets()
    _coordinate_checksum_of_checked_mesh[mesh] = checksum


def _check_coordinate_magnitudes(mesh: Mesh) -> None:
    largest = mesh.comm.allgather(float(np.abs(mesh.geometry.x).max(initial=0.0)))
    if not np.isfinite(largest).all():
        raise DegenerateMesh("a node of the mesh has coordinates that are not finite")
    if max(largest) > MAX_COORDINATE:
        raise DegenerateMesh(
            f"a node of the mesh has a coordinate of {max(largest):.3g}, and volumes overflow: "
            "choose another unit of length"
        )


def check_cell_shapes_and_facets(mesh: Mesh) -> None:
    """Check that no cell is flat, inverted or folded, and no facet has more than two cells.

    Raises:
        DegenerateMesh: if there is a defect; the message names the centres of the cells.
    """
    _check_coordinate_magnitudes(mesh)
    _CellChecks(mesh).check_shapes_and_facets()


class _CellChecks:
    """Checks of the cells of this process (without ghosts) and of their facets.

    Attributes:
        vertices: geometry nodes (n, corners) of the cells' corners.
        centres: mean (n, dim) of each cell's corners.
        facets: local numbers (sides, n) of the cells' facets.
        area: outward area vectors (dim, sides, n) of the facets. Their length is the area of the
            facet, or twice the area if the facet is a triangle.
        exterior: mask (sides, n) of the facets that belong to only one cell.
    """

    def __init__(self, mesh: Mesh) -> None:
        topology, dim = mesh.topology, mesh.topology.dim
        self.mesh, self.dim = mesh, dim
        self.element = mesh.ufl_domain().ufl_coordinate_element().basix_element
        nodes = cell_geometry_nodes(mesh)[: topology.index_map(dim).size_local]
        corner_dofs = [dofs[0] for dofs in self.element.entity_dofs[0]]
        self.vertices = nodes[:, corner_dofs].astype(np.int64)
        self._x = np.ascontiguousarray(mesh.geometry.x[:, :dim].T)[:, nodes.T]
        self.centres = self._x[:, corner_dofs].mean(axis=1).T

    def check_shapes_and_facets(self) -> None:
        cell_type, dim, n_cells = self.element.cell_type, self.dim, len(self.centres)
        corners = basix.geometry(cell_type)
        side_midpoints = np.array(
            [corners[c].mean(axis=0) for c in basix.topology(cell_type)[dim - 1]]
        )
        is_affine = self.element.degree == 1 and len(corners) == dim + 1
        inner_points = np.vstack([self.element.points, basix.make_quadrature(cell_type, 4)[0]])
        points = side_midpoints[:1] if is_affine else np.vstack([side_midpoints, inner_points])
        gradients = self.element.tabulate(1, points)[1:, :, :, 0]
        side_cofactors = np.empty((dim, dim, 1 if is_affine else len(side_midpoints), n_cells))
        is_flat, is_inverted = np.zeros((2, n_cells), dtype=bool)
        for start in range(0, n_cells, _CELLS_PER_BATCH):
            batch = slice(start, start + _CELLS_PER_BATCH)
            jacobian = np.einsum("jpn,inc->ijpc", gradients, self._x[:, :, batch], optimize=True)
            cofactor = _cofactor_matrices(jacobian)
            determinant = sum(jacobian[i, 0] * cofactor[i, 0] for i in range(dim))
            size = np.sqrt(np.sum(jacobian[:, :, 0] ** 2, axis=(0, 1)))
            is_flat[batch] = (
                np.abs(determinant).min(axis=0)
                <= _MIN_JACOBIAN_DETERMINANT_OVER_SIZE_POW_DIM * size**dim
            )
            is_inverted[batch] = determinant.min(axis=0) * determinant.max(axis=0) < 0
            side_cofactors[..., batch] = cofactor[:, :, : side_cofactors.shape[2]] * np.sign(
                determinant[0]
            )
        self._raise_if_any_cell(is_flat, "have no volume")
        self._raise_if_any_cell(is_inverted, "are turned inside out in a part of them")
        if dim > 1:
            self._set_facet_areas_and_check_folds(
                np.broadcast_to(side_cofactors, (dim, dim, len(side_midpoints), n_cells))
            )

    def _set_facet_areas_and_check_folds(self, side_cofactors: Array) -> None:
        """Set `facets`, `area` and `exterior`; check facets for folds and for more than two cells.

        Collective.

        Args:
            side_cofactors: cofactor matrices (dim, dim, sides, n) of the Jacobians at the midpoints
                of the sides.
        """
        topology, dim = self.mesh.topology, self.dim
        topology.create_connectivity(dim, dim - 1)
        n_sides = side_cofactors.shape[2]
        self.facets = topology.connectivity(dim, dim - 1).array.reshape(-1, n_sides)
        self.facets = self.facets[: len(self.centres)].T
        cell_type = self.element.cell_type
        normal, tangents = (
            basix.cell.facet_outward_normals(cell_type),
            basix.cell.facet_jacobians(cell_type),
        )
        reference_areas = np.sqrt(np.linalg.det(np.swapaxes(tangents, 1, 2) @ tangents))
        self.area = np.einsum("ijpc,pj->ipc", side_cofactors, normal * reference_areas[:, None])

        area = np.sqrt(sum(a**2 for a in self.area))
        index_map = topology.index_map(dim - 1)
        facet_vector = la.vector(index_map, dim + 2)
        facet_sums = facet_vector.array.reshape(-1, dim + 2)
        for column, values in enumerate((*self.area, area, np.ones_like(area))):
            facet_sums[:, column] = np.bincount(
                self.facets.ravel(), values.ravel(), len(facet_sums)
            )
        facet_vector.scatter_reverse(la.InsertMode.add)
        facet_vector.scatter_forward()
        n_cells = facet_sums[:, -1]
        self.exterior = (n_cells == 1)[self.facets]
        residual_area = np.sqrt(sum(facet_sums[:, column] ** 2 for column in range(dim)))
        is_folded = (
            (n_cells == 2)
            & (residual_area > _MAX_FACET_AREA_VECTOR_SUM_OVER_AREA_SUM * facet_sums[:, dim])
        )[self.facets].any(axis=0)
        self._raise_if_any_cell(
            (n_cells > 2)[self.facets].any(axis=0), "share a facet with two others"
        )
        self._raise_if_any_cell(is_folded, "lie on the same side of a facet as their neighbour")

    def _raise_if_any_cell(self, is_bad: Mask, description: str) -> None:
        centres = np.concatenate(self.mesh.comm.allgather(self.centres[is_bad]))
        if len(centres):
            raise DegenerateMesh(
                f"cells around {format_points(np.unique(centres, axis=0))} {description}"
            )


class _MeshBoundaryChecks:
    """Checks of the boundary of a mesh, distributed over the processes.

    Each process holds its own exterior facets, and those of other processes that are near, above or
    below its cells at the boundary. "Above" refers to the last axis of a rotated coordinate system,
    to which hardly any facet is parallel.

    Attributes:
        corner: coordinates (m, corners, dim) of the corners of the facets.
        vertex: global node numbers (m, corners) of the corners.
        area: outward area vectors (m, dim) of the facets.
    """

    def __init__(self, cells: _CellChecks) -> None:
        self._cells, mesh = cells, cells.mesh
        self._comm: MPI.Comm = mesh.comm
        side, self._cell = np.nonzero(cells.exterior)
        corners_of_side = np.array(basix.topology(cells.element.cell_type)[cells.dim - 1])
        vertices = np.take_along_axis(cells.vertices[self._cell], corners_of_side[side], axis=1)
        global_vertices = mesh.geometry.index_map().local_to_global(
            vertices.ravel().astype(np.int32)
        )
        corners = mesh.geometry.x[vertices, : cells.dim]
        self._rotation = np.linalg.qr(_ARBITRARY_MATRIX_FOR_RAY_AXES[: cells.dim, : cells.dim])[0]
        self._cell_centres = cells.centres[np.unique(self._cell)]
        projected = (corners @ self._rotation)[:, :, :-1]
        low, high = projected.min(axis=1), projected.max(axis=1)
        projected_centres = (self._cell_centres @ self._rotation)[:, :-1]
        lower = np.concatenate([low, projected_centres]).min(axis=0, initial=np.inf)
        upper = np.concatenate([high, projected_centres]).max(axis=0, initial=-np.inf)
        margin = 2 * _COINCIDENCE_TOLERANCE_OVER_FACET_SIZE * np.maximum(upper - lower, 0.0)
        self._facets_for_rank = [
            np.flatnonzero((high >= lower).all(axis=1) & (low <= upper).all(axis=1))
            for lower, upper in self._comm.allgather((lower - margin, upper + margin))
        ]
        self.corner = self._exchange_facet_values(corners)
        self.vertex = self._exchange_facet_values(global_vertices.reshape(vertices.shape))
        self.area = self._exchange_facet_values(cells.area[:, side, self._cell].T)
        self._owner = self._exchange_facet_values(np.full(len(corners), self._comm.rank))
        self._facet_centres = self.corner.mean(axis=1)
        self._radius = np.linalg.norm(self.corner - self._facet_centres[:, None], axis=2).max(
            axis=1
        )

    def _exchange_facet_values(self, own_values: npt.NDArray) -> npt.NDArray:
        """Send values (own facets, ...) to the processes that need them.

        Returns:
            Values (m, ...) of all facets that this process needs.
        """
        return np.concatenate(
            self._comm.alltoall([own_values[facets] for facets in self._facets_for_rank])
        )

    def _gather_from_all_processes(self, values: npt.NDArray) -> npt.NDArray:
        return np.concatenate(self._comm.allgather(values))

    def check_hanging_nodes(self) -> None:
        """Raise DegenerateMesh if the mesh has hanging nodes.

        Hanging nodes occur where smaller facets lie on a larger one and share its vertices. Two
        bodies in contact whose meshes do not match share no vertices and are accepted. Curved
        facets are not checked.
        """
        if len(
            centres := self._gather_from_all_processes(
                self._facet_centres[self._find_facets_with_hanging_nodes()]
            )
        ):
            raise DegenerateMesh(
                f"facets around {format_points(centres)} have hanging nodes: smaller facets of "
                "their neighbours lie on them, and the mesh is torn apart there"
            )

    def _find_facets_with_hanging_nodes(self) -> Indices:
        """Return the facets of this process on which smaller facets of neighbouring cells lie.

        Each corner of such a larger facet is also a corner of one of the smaller facets.
        """
        vertex, first_row = np.unique(self.vertex, return_index=True)
        x, is_owned = (
            self.corner.reshape(-1, self._cells.dim)[first_row],
            self._owner == self._comm.rank,
        )
        facet, vertex_index = _find_points_in_balls(
            cKDTree(x),
            self._facet_centres[is_owned],
            self._radius[is_owned] * (1 + _COINCIDENCE_TOLERANCE_OVER_FACET_SIZE),
        )
        facet = np.flatnonzero(is_owned)[facet]
        is_inside = self._are_points_on_facets(facet, x[vertex_index])
        is_own_corner = (self.vertex[facet] == vertex[vertex_index][:, None]).any(axis=1)
        suspects = np.unique(facet[is_inside & ~is_own_corner])
        if not len(suspects):
            return suspects
        ones = np.ones(self.vertex.size, dtype=np.int32)
        corner_index = np.searchsorted(vertex, self.vertex.ravel())
        row_starts = np.arange(0, self.vertex.size + 1, self.vertex.shape[1])
        corners_of_facets = sp.csr_matrix((ones, corner_index, row_starts))
        positions = facet[is_inside], vertex_index[is_inside]
        vertices_on_facet = sp.csr_matrix(
            (ones[:1].repeat(len(vertex_index[is_inside])), positions), corners_of_facets.shape
        )[suspects]
        lies_on = (vertices_on_facet @ corners_of_facets.T == self.vertex.shape[1]).tolil()
        lies_on[np.arange(len(suspects)), suspects] = False
        shared_corners = (lies_on.astype(np.int32) @ corners_of_facets).multiply(
            corners_of_facets[suspects]
        ) > 0
        return suspects[np.diff(shared_corners.tocsr().indptr) == self.vertex.shape[1]]

    def _are_points_on_facets(self, facets: Indices, points: Array) -> Mask:
        """Return a mask (n,) of the points (n, dim) that lie on facets (n,) or on their edges."""
        centres, double_area = (
            self._facet_centres[facets],
            np.linalg.norm(self.area[facets], axis=1),
        )
        height = np.abs(np.sum((points - centres) * self.area[facets], axis=1))
        to_corners = self.corner[facets] - points[:, None]
        if to_corners.shape[1] == 4:
            to_corners, double_area = to_corners[:, [0, 1, 3, 2]], 2 * double_area
        # for solid bodies: areas of the triangles between the point and each edge
        cross_products = (
            np.cross(to_corners, np.roll(to_corners, -1, axis=1))
            if points.shape[1] == 3
            else to_corners
        )
        fan_area = np.linalg.norm(cross_products, axis=2).sum(axis=1)
        return (
            height < _COINCIDENCE_TOLERANCE_OVER_FACET_SIZE * self._radius[facets] * double_area
        ) & (fan_area < (1 + _COINCIDENCE_TOLERANCE_OVER_FACET_SIZE) * double_area)

    def check_overlapping_cells(self) -> None:
        """Raise DegenerateMesh if the centre of a cell at the boundary also lies in another cell.

        In a valid mesh, an upward ray from the centre of a cell leaves the body exactly once more
        than it enters it. Where a ray leaves the body more often, the cells that contain the centre
        are searched for and counted.
        """
        cells, mesh, rotation, cell_centres = (
            self._cells,
            self._cells.mesh,
            self._rotation,
            self._cell_centres,
        )
        x, corners, upward_area = (
            cell_centres @ rotation,
            self.corner @ rotation,
            (self.area @ rotation)[:, -1],
        )
        if corners.shape[1] == 4:
            corners, upward_area = (
                np.concatenate([corners[:, :3], corners[:, 1:]]),
                np.tile(upward_area, 2),
            )
        projected, projected_points = corners[:, :, :-1], x[:, :-1]  # projected along the ray
        projected_centres = projected.mean(axis=1)
        radius = np.linalg.norm(projected - projected_centres[:, None], axis=2).max(axis=1)
        facet, point = _find_points_in_balls(cKDTree(projected_points), projected_centres, radius)
        inverse_edges = np.linalg.inv(np.swapaxes(projected[:, 1:] - projected[:, :1], 1, 2))
        barycentric = np.einsum(
            "nij,nj->ni", inverse_edges[facet], projected_points[point] - projected[facet, 0]
        )
        edge_heights = (corners[:, 1:, -1] - corners[:, :1, -1])[facet]
        height = corners[facet, 0, -1] + np.sum(barycentric * edge_heights, axis=1)
        is_above = (
            (barycentric >= 0).all(axis=1) & (barycentric.sum(axis=1) < 1) & (height > x[point, -1])
        )
        n_exits = np.bincount(point[is_above], np.sign(upward_area[facet[is_above]]), len(x))
        suspects = self._gather_from_all_processes(cell_centres[n_exits > 1.5])
        if not len(suspects):
            return
        points = np.zeros((len(suspects), 3))
        points[:, : cells.dim] = suspects
        own_cells = np.arange(len(cells.centres), dtype=np.int32)
        tree = geometry.bb_tree(mesh, cells.dim, entities=own_cells)
        candidates = geometry.compute_collisions_points(tree, points)
        candidates = geometry.compute_colliding_cells(mesh, candidates, points)
        n_cells = np.diff(candidates.offsets)
        mesh.comm.Allreduce(MPI.IN_PLACE, n_cells, MPI.SUM)
        if np.any(n_cells > 1):
            positions = np.unique(suspects[n_cells > 1], axis=0)
            raise DegenerateMesh(
                f"cells around {format_points(positions)} lie in other parts of the mesh"
            )

    def log_coincident_facets(self) -> None:
        """Log facets that coincide but have no common nodes (cracks or touching bodies)."""
        min_radius = self._comm.allreduce(self._radius.min(initial=np.inf), MPI.MIN)
        pairs = cKDTree(self._facet_centres).query_pairs(
            _COINCIDENCE_TOLERANCE_OVER_FACET_SIZE * min_radius, output_type="ndarray"
        )
        pairs = pairs[self._owner[pairs].min(axis=1) == self._comm.rank]
        if not self._comm.allreduce(len(pairs)):
            return
        cells, mesh = self._cells, self._cells.mesh
        component_of_node, _ = label_connected_components(
            mesh.comm, mesh.geometry.index_map(), cells.vertices
        )
        components = self._exchange_facet_values(component_of_node[cells.vertices[self._cell, 0]])[
            pairs
        ]
        is_crack = self._gather_from_all_processes(components[:, 0] == components[:, 1])
        centres = self._gather_from_all_processes(self._facet_centres[pairs[:, 0]])
        for selection, level, description in (
            (is_crack, logging.WARNING, "a crack in one piece of the mesh"),
            (~is_crack, logging.INFO, "two pieces of the mesh that touch"),
        ):
            if selection.any():
                where = format_points(centres[selection])
                message = f"facets coincide, but share no nodes: {description} at {where}"
                log_on_root(mesh.comm, level, message)


def _cofactor_matrices(jacobian: Array) -> Array:
    """Return the cofactor matrices (dim, dim, ...) of Jacobian matrices (dim, dim, ...)."""
    dim = len(jacobian)
    if dim == 1:
        return np.ones_like(jacobian)
    if dim == 2:
        (a, b), (c, d) = jacobian
        return np.array([[d, -c], [-b, a]])
    a, b, c = jacobian
    return np.array([np.cross(*rows, axis=0) for rows in ((b, c), (c, a), (a, b))])


def label_connected_components(
    comm: MPI.Comm, index_map: IndexMap, cells: npt.NDArray
) -> tuple[Indices, int]:
    """Find the connected components of a distributed mesh; collective.

    Args:
        comm: communicator of the mesh.
        index_map: index map of the nodes.
        cells: local nodes (n, k) of the cells of this process.

    Returns:
        Component number of each local node (including ghosts), and the number of components.
    """
    n_nodes = index_map.size_local + index_map.num_ghosts
    other_nodes = cells[:, 1:]  # a cell links its first node with the others
    local_component = _label_graph_components(
        n_nodes, np.repeat(cells[:, 0], other_nodes.shape[1]), other_nodes.ravel()
    )
    if comm.size == 1:
        return local_component, int(local_component.max()) + 1
    local_component += sum(comm.allgather(int(local_component.max(initial=-1)) + 1)[: comm.rank])
    # components of two processes belong together if they share a node: link the component of each
    # node on this process with its component on the process that owns the node
    owner_component = la.vector(index_map, 1)
    owner_component.array[:] = local_component
    owner_component.scatter_forward()
    links = np.unique(np.stack([local_component, owner_component.array.astype(np.int64)]), axis=1)
    component, owner_number = np.concatenate(comm.allgather(links), axis=1)
    global_component = _label_graph_components(
        int(max(component.max(), owner_number.max())) + 1, component, owner_number
    )
    return global_component[local_component], int(global_component.max()) + 1


def label_components_of_space(space: fem.FunctionSpace | JoinedSpace) -> tuple[Indices, int]:
    """Find the connected components of the cells of a space; collective.

    Returns:
        Component number of each local node (including ghosts), and the number of components.
    """
    numbers, count = [], 0
    bodies = list_bodies(space)
    for body in bodies:
        dofmap = body.space.dofmap
        component, n_components = label_connected_components(
            space.mesh.comm, dofmap.index_map, dofmap.list
        )
        numbers.append(component + count)
        count += n_components
    joined = space.join_nodal_values(numbers) if isinstance(space, JoinedSpace) else numbers[0]
    return joined, count


def _label_graph_components(n_nodes: int, edge_starts: Indices, edge_ends: Indices) -> Indices:
    graph = sp.coo_matrix((np.ones(len(edge_starts)), (edge_starts, edge_ends)), (n_nodes, n_nodes))
    return sp.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _find_points_in_balls(tree: cKDTree, centres: Array, radii: Array) -> tuple[Indices, Indices]:
    """Find all pairs of a ball and a point of the tree that lies in the ball.

    Args:
        tree: tree of the points.
        centres: centres (n, dim) of the balls.
        radii: radii (n,) of the balls.

    Returns:
        Index of the ball and index of the point of each pair.
    """
    points_in_ball = tree.query_ball_point(centres, radii)
    ball_index = np.repeat(np.arange(len(centres)), [len(points) for points in points_in_ball])
    return ball_index, np.array([p for points in points_in_ball for p in points], dtype=np.int64)
