"""Inner nodes of 8- and 9-node quadrilaterals, which are condensed (paper, Fig. 3)."""

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

# Relative difference by which the longest side of a triangle must exceed the others
_LONGEST_SIDE_TOLERANCE = 1e-6
# Largest sum of the angles of two triangles at a corner of a convex quadrilateral, divided by pi
_MAX_CORNER_ANGLE_OVER_PI = 1 - 1e-6
# Vertices of each side of a triangle
_SIDE_VERTICES = ((1, 2), (0, 2), (0, 1))


def mid_diagonal_nodes(space: fem.FunctionSpace) -> Indices:
    """Return the local numbers of the mid-side nodes inside pairs of 6-node triangles.

    Ghosts are included. Cells 2k and 2k + 1 of the original numbering form a pair. In meshes made
    by `meshes.triangles`, these are the two triangles of a square, even after the nodes are moved.
    If these pairs do not form convex quadrilaterals, triangles that share their longest sides are
    paired instead.

    Raises:
        ValueError: if the space is not quadratic on triangles, or a triangle has no partner.
    """
    element = space.element.basix_element
    if element.cell_type is not basix.CellType.triangle or element.dim != 6:
        raise ValueError("pairs of triangles make 8-node quadrilaterals from 6-node triangles only")
    mesh = space.mesh
    cells = space.dofmap.list[: mesh.topology.index_map(2).size_local]
    corners = space.tabulate_dof_coordinates()[cells[:, :3]]
    middles = cells[:, [dofs[0] for dofs in element.entity_dofs[1]]]
    for side in (
        _sides_shared_by_cells_2k_and_2k_plus_1(space, cells, middles),
        _unique_longest_sides(corners),
    ):
        mid_side_nodes = np.take_along_axis(middles, np.maximum(side, 0)[:, None], axis=1)[:, 0]
        n_triangles = _sum_at_nodes_over_processes(
            space, mid_side_nodes, (side >= 0).astype(float)[:, None]
        )[:, 0]
        n_unpaired = mesh.comm.allreduce(
            int(np.sum((side < 0) | (n_triangles[mid_side_nodes] != 2))), MPI.SUM
        )
        if n_unpaired == 0:
            return np.flatnonzero(n_triangles == 2).astype(np.int32)
    raise ValueError(
        f"{n_unpaired} triangles have no partner across their longest side: 8-node quadrilaterals "
        'need pairs of triangles, as the patterns "right" and "left" have them'
    )


def _sides_shared_by_cells_2k_and_2k_plus_1(
    space: fem.FunctionSpace, cells: Indices, middles: Indices
) -> Indices:
    """Return the local number (cells,) of the side that each cell shares with its partner, or -1.

    Cells 2k and 2k + 1 of the original numbering are partners. The value is -1 if the two cells
    share no side or do not form a convex quadrilateral, e.g. in meshes with the pattern "crossed".
    """
    pair = space.mesh.topology.original_cell_index[: len(cells)] // 2
    powers = np.repeat(pair.astype(float)[:, None] ** [0, 1, 2], 3, axis=0)
    count, total, squares = _sum_at_nodes_over_processes(space, middles.ravel(), powers)[middles].T
    shared = ((count == 2) & (2 * squares == total**2)).T  # (k - l)^2 = 0
    side = np.where(shared.sum(axis=1) == 1, shared.argmax(axis=1), -1)

    corners = space.tabulate_dof_coordinates()[cells[:, :3]]
    vertices = space.dofmap.index_map.local_to_global(cells[:, :3].ravel()).reshape(-1, 3)
    cell_numbers = np.arange(len(cells))
    ends = np.array(_SIDE_VERTICES)[side]
    ends = np.take_along_axis(ends, np.argsort(np.take_along_axis(vertices, ends, 1), axis=1), 1)
    angles = _triangle_angles(corners)[cell_numbers[:, None], ends] * (side >= 0)[:, None]
    middle = middles[cell_numbers, side]
    convex = (
        _sum_at_nodes_over_processes(space, middle, angles)[middle]
        < _MAX_CORNER_ANGLE_OVER_PI * np.pi
    ).all(axis=1)
    return np.where(convex, side, -1)


def _unique_longest_sides(corners: Array) -> Indices:
    """Return the local number (cells,) of the longest side of triangles (cells, 3, 3).

    It is -1 if the longest side is not unique.
    """
    length = np.linalg.norm([corners[:, a] - corners[:, b] for a, b in _SIDE_VERTICES], axis=2).T
    is_unique = length.max(axis=1) > (1 + _LONGEST_SIDE_TOLERANCE) * np.sort(length, axis=1)[:, 1]
    return np.where(is_unique, length.argmax(axis=1), -1)


def _triangle_angles(corners: Array) -> Array:
    """Return the angles (n, 3) of triangles with corners (n, 3, 3)."""
    to_next, to_previous = (np.roll(corners, -k, axis=1) - corners for k in (1, 2))
    cosine = np.sum(to_next * to_previous, axis=2)
    cosine /= np.linalg.norm(to_next, axis=2) * np.linalg.norm(to_previous, axis=2)
    return np.arccos(np.clip(cosine, -1, 1))


def _sum_at_nodes_over_processes(space: fem.FunctionSpace, nodes: Indices, values: Array) -> Array:
    """Return the sums (local nodes, m), over all processes, of values (n, m) at nodes (n,)."""
    sums = la.vector(space.dofmap.index_map, values.shape[1])
    np.add.at(sums.array.reshape(-1, values.shape[1]), nodes, values)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    return sums.array.reshape(-1, values.shape[1])


def centre_nodes(space: fem.FunctionSpace) -> Indices:
    """Return the local numbers, including ghosts, of the centre nodes of 9-node quadrilaterals.

    Raises:
        ValueError: if the space is not quadratic on quadrilaterals.
    """
    element = space.element.basix_element
    if element.cell_type is not basix.CellType.quadrilateral or element.dim != 9:
        raise ValueError("only 9-node quadrilaterals have centre nodes")
    return np.unique(space.dofmap.list[:, element.entity_dofs[2][0][0]])
