"""Nodal forces: their redistribution matrix T and their reading at nodes."""

from dataclasses import dataclass

from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.mechanics import Marker

# Shares of a mid-side node's Galerkin force that stay with it and go to either vertex
_STAYS, _GOES = 3 / 4, 1 / 8


def force_transfer(space: fem.FunctionSpace) -> PETSc.Mat:
    """T, (n, n): nodal forces of the standard T6 to those of the piecewise-linear weights.

    On straight-sided triangles with constant D and t, in plane stress or strain, K_PW = T K_G
    and f_PW = T f_G exactly, since piecewise-linear and quadratic weight functions see the
    same averages of a linear stress field. T is the 1/8 basis transformation of
    B. Wohlmuth's quadratic mortar spaces, applied to equations. It knows no counterpart in 3-D.

    Raises:
        ValueError: if the space is not quadratic on triangles.
    """
    element = space.element.basix_element
    if element.cell_type is not basix.CellType.triangle or element.dim != 6:
        raise ValueError("the force transfer T exists for quadratic triangles only")
    block = space.dofmap.index_map_bs
    index_map = space.dofmap.index_map
    owned = (index_map.size_local * block, index_map.size_global * block)
    T = PETSc.Mat().createAIJ((owned, owned), nnz=(32, 32), comm=space.mesh.comm)
    T.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)

    ends = basix.topology(basix.CellType.triangle)[1]
    vertex, midside = (element.entity_dofs[d] for d in (0, 1))
    for cell in space.dofmap.list:
        nodes = index_map.local_to_global(cell).astype(PETSc.IntType)
        for component in range(block):
            dofs = nodes * block + component
            for corner in vertex:
                T.setValue(dofs[corner[0]], dofs[corner[0]], 1.0)
            for edge, (start, end) in zip(midside, ends, strict=True):
                middle = dofs[edge[0]]
                T.setValue(middle, middle, _STAYS)
                for end_vertex in (start, end):
                    T.setValue(dofs[vertex[end_vertex][0]], middle, _GOES)
    T.assemble()
    return T


@dataclass(frozen=True)
class BoundaryForces:
    """Nodal forces along a boundary line, ordered by position.

    Args:
        position: (m, 3) node coordinates.
        force: (m, components).
    """

    position: npt.NDArray[np.float64]
    force: npt.NDArray[np.float64]


def forces_along(
    space: fem.FunctionSpace, forces: PETSc.Vec, where: Marker, axis: int = 0
) -> BoundaryForces:
    """Nodal forces at the nodes a marker holds on, sorted along a coordinate axis.

    Every process gets the whole line.
    """
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    nodes = fem.locate_dofs_geometrical(space, where)
    nodes = nodes[nodes < index_map.size_local]
    comm = space.mesh.comm
    position = comm.allgather(space.tabulate_dof_coordinates()[nodes])
    force = comm.allgather(forces.array_r.reshape(-1, block)[nodes])
    position, force = np.concatenate(position), np.concatenate(force)
    order = np.argsort(position[:, axis])
    return BoundaryForces(position[order], force[order])
