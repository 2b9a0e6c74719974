"""Nodes within 8-node quadrilaterals, to be condensed (Fig. 3 of the paper)."""

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

# Relative difference of lengths that makes a longest side of a triangle
_LONGER = 1e-6


def mid_diagonal_nodes(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Local numbers (ghosts too) of the mid-side nodes within pairs of 6-node triangles.

    Two triangles are a pair if they share the longest side of both, as the two of a rectangle
    do. It stays so on graded meshes and under moderate maps.

    Raises:
        ValueError: if the space is not quadratic on triangles, or a triangle has no partner.
    """
    element = space.element.basix_element
    if element.cell_type is not basix.CellType.triangle or element.dim != 6:
        raise ValueError("pairs of triangles make 8-node quadrilaterals from 6-node triangles only")
    mesh = space.mesh
    cells = space.dofmap.list[: mesh.topology.index_map(2).size_local]
    corners = space.tabulate_dof_coordinates()[cells[:, :3]]
    sides = [
        corners[:, end] - corners[:, start]
        for start, end in basix.topology(basix.CellType.triangle)[1]
    ]
    length = np.linalg.norm(sides, axis=2).T
    longest = length.argmax(axis=1)
    others = np.sort(length, axis=1)[:, 1]
    clear = length.max(axis=1) > (1 + _LONGER) * others
    middle = np.array([dofs[0] for dofs in element.entity_dofs[1]])[longest]
    nodes = cells[np.arange(len(cells)), middle]

    sharing = la.vector(space.dofmap.index_map)
    np.add.at(sharing.array, nodes, 1.0)
    sharing.scatter_reverse(la.InsertMode.add)
    sharing.scatter_forward()
    single = np.count_nonzero(~clear | (sharing.array[nodes] != 2))
    single = mesh.comm.allreduce(int(single), MPI.SUM)
    if single:
        raise ValueError(
            f"{single} triangles have no partner across their longest side: 8-node quadrilaterals "
            'need pairs of triangles, as the patterns "right" and "left" have them'
        )
    return np.flatnonzero(sharing.array == 2).astype(np.int32)


def centre_nodes(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Local numbers (ghosts too) of the centre nodes of 9-node quadrilaterals.

    Raises:
        ValueError: if the space is not quadratic on quadrilaterals.
    """
    element = space.element.basix_element
    if element.cell_type is not basix.CellType.quadrilateral or element.dim != 9:
        raise ValueError("only 9-node quadrilaterals have centre nodes")
    return np.unique(space.dofmap.list[:, element.entity_dofs[2][0][0]])
