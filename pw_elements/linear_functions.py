"""Linear functions on the mesh of a space: their values at its nodes, and rigid motions."""

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def linear_space(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, Indices]:
    """Linear functions on a space's mesh, and the local node of the space at each owned vertex."""
    mesh = space.mesh
    shape = space.ufl_element().reference_value_shape
    linear = fem.functionspace(mesh, ("Lagrange", 1, tuple(shape)))
    corner = [dofs[0] for dofs in space.element.basix_element.entity_dofs[0]]
    owned = linear.dofmap.index_map.size_local
    node = np.empty(owned + linear.dofmap.index_map.num_ghosts, dtype=np.int64)
    node[linear.dofmap.list] = space.dofmap.list[:, corner]
    return linear, node[:owned]


def linear_interpolation(space: fem.FunctionSpace) -> tuple[fem.FunctionSpace, PETSc.Mat]:
    """Linear functions on a space's mesh, and the matrix of their values at its nodes."""
    linear, _ = linear_space(space)
    sizes = (
        each.dofmap.index_map.size_local * each.dofmap.index_map_bs for each in (space, linear)
    )
    return linear, interpolation_matrix(linear, space, *(np.ones(n, dtype=bool) for n in sizes))


def interpolation_matrix(
    linear: fem.FunctionSpace,
    space: fem.FunctionSpace,
    free: npt.NDArray[np.bool_],
    at_vertices: npt.NDArray[np.bool_],
) -> PETSc.Mat:
    """Values at free nodes from those at free vertices; DOLFINx's has a cell's zeros, too."""
    element, corners = space.element.basix_element, linear.element.basix_element
    values = corners.tabulate(0, np.asarray(element.points))[0, :, :, 0]
    weights: Array = np.round(np.asarray(element.interpolation_matrix) @ values, 12)
    cells, block = space.dofmap.list, space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local
    index_map = linear.dofmap.index_map
    entry = np.empty(owned + space.dofmap.index_map.num_ghosts, dtype=np.int64)
    entry[cells] = np.arange(cells.size).reshape(cells.shape)
    cell, place = np.divmod(entry[:owned], cells.shape[1])
    vertices = linear.dofmap.list[cell]
    columns = index_map.local_to_global(vertices.ravel()).reshape(vertices.shape)
    columns = columns.astype(PETSc.IntType)
    order = np.argsort(columns, axis=1)
    columns = np.take_along_axis(columns, order, axis=1)
    weight = np.take_along_axis(weights[place], order, axis=1)
    shape = (owned, block, columns.shape[1])
    some = np.broadcast_to((weight != 0)[:, None], shape)
    components = np.arange(block, dtype=PETSc.IntType)[:, None]
    indices = (columns[:, None] * block + components)[some]
    data = np.broadcast_to(weight[:, None], shape)[some]
    indptr = np.zeros(owned * block + 1, dtype=PETSc.IntType)
    np.cumsum(some.sum(axis=2).ravel(), out=indptr[1:])
    sizes = tuple(
        (m.size_local * block, m.size_global * block) for m in (space.dofmap.index_map, index_map)
    )
    P = PETSc.Mat().createAIJ(sizes, csr=(indptr, indices, data), comm=space.mesh.comm)
    coarse, fine = P.createVecs()
    fine.setArray(free.astype(float))
    coarse.setArray(at_vertices.astype(float))
    P.diagonalScale(fine, coarse)
    return P


def near_null_space(linear: fem.FunctionSpace) -> PETSc.NullSpace | None:
    """Rigid motions; None for fields that are no displacements, of which constants are known."""
    block, dim = linear.dofmap.index_map_bs, linear.mesh.geometry.dim
    if block != dim or dim == 1:
        return None
    index_map = linear.dofmap.index_map
    sizes = (index_map.size_local * block, index_map.size_global * block)
    places = PETSc.Vec().createMPI(sizes, bsize=block, comm=linear.mesh.comm)
    places.setArray(linear.tabulate_dof_coordinates()[: index_map.size_local, :dim].ravel())
    return PETSc.NullSpace().createRigidBody(places)
