"""Structured meshes of rectangles, and maps of the nodes of a mesh."""

from collections.abc import Callable
from typing import Literal, get_args

from mpi4py import MPI

import basix.ufl
import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, DiagonalType, Mesh, create_mesh, create_rectangle

from pw_elements.arrays import Array
from pw_elements.checks import (
    arguments,
    call_user_function,
    check_same_arguments,
    check_same_function,
    collective_errors,
)

DiagonalPattern = Literal["right", "left", "right_left", "left_right", "crossed"]
DIAGONAL_PATTERNS: tuple[DiagonalPattern, ...] = get_args(DiagonalPattern)
PointMap = Callable[[Array], Array]  # from points (n, 3) to points (n, 3) or (n, dim)


@check_same_arguments
def triangles(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    pattern: DiagonalPattern = "right",
) -> Mesh:
    """Mesh a rectangle with triangles.

    Args:
        comm: communicator.
        lower: corner (x, y).
        upper: the opposite corner, above and to the right.
        divisions: numbers of squares in x and y.
        pattern: direction of the diagonals that cut each square into two triangles, or "crossed"
            for four triangles.

    Raises:
        ValueError: for an empty rectangle, no divisions, or an unknown pattern.
    """
    if not arguments.is_one_of(pattern, DIAGONAL_PATTERNS):
        raise ValueError(
            f"diagonal pattern {pattern!r}: the patterns are {', '.join(DIAGONAL_PATTERNS)}"
        )
    return _make_rectangle(comm, lower, upper, divisions, diagonal=DiagonalType[pattern])


@check_same_arguments
def quadrilaterals(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
) -> Mesh:
    """Mesh a rectangle with quadrilaterals.

    Args:
        comm: communicator.
        lower: corner (x, y).
        upper: the opposite corner, above and to the right.
        divisions: numbers of quadrilaterals in x and y.

    Raises:
        ValueError: for an empty rectangle or no divisions.
    """
    return _make_rectangle(comm, lower, upper, divisions, cell_type=CellType.quadrilateral)


@check_same_arguments
def move_nodes(mesh: Mesh, point_map: PointMap) -> Mesh:
    """Move the nodes of a mesh in place, and return it; straight sides stay straight.

    Args:
        mesh: the mesh.
        point_map: function from points (n, 3) to points (n, 3), or (n, dim) in dim dimensions.

    Raises:
        ValueError: if the function fails, or its result has the wrong shape or is not finite; the
            mesh is unchanged then.
    """
    arguments.check_mesh_type(mesh)
    mesh.geometry.x[:, : mesh.geometry.dim] = _image_points(mesh, point_map, mesh.geometry.x)
    return mesh


@check_same_arguments
def curved_mesh(mesh: Mesh, point_map: PointMap) -> Mesh:
    """Return a new mesh of degree-2 geometry, with all nodes (mid-side nodes, too) moved by a map.

    Args:
        mesh: mesh with straight sides.
        point_map: function from points (n, 3) to points (n, 3), or (n, dim) in dim dimensions.

    Raises:
        ValueError: if the function fails, or its result has the wrong shape or is not finite.
    """
    arguments.check_mesh_type(mesh)
    dimension = mesh.geometry.dim
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), 2, shape=(dimension,))
    nodes = fem.functionspace(mesh, element)
    index_map = nodes.dofmap.index_map
    cells_owned = mesh.topology.index_map(mesh.topology.dim).size_local
    # cells in the order in which the mesh was created, with triangles of a square side by side
    order = np.argsort(mesh.topology.original_cell_index[:cells_owned])
    local = nodes.dofmap.list[order]
    cells = index_map.local_to_global(local.ravel().astype(np.int32)).reshape(local.shape)
    x = _image_points(mesh, point_map, nodes.tabulate_dof_coordinates()[: index_map.size_local])
    return create_mesh(mesh.comm, cells=cells, x=np.ascontiguousarray(x), e=element)


def _image_points(mesh: Mesh, point_map: PointMap, x: Array) -> Array:
    """Return the images (n, dim) of points x (n, 3); check them on all processes."""
    dim = mesh.geometry.dim
    with collective_errors(mesh.comm):
        if callable(point_map) and not arguments.is_user_function(point_map):
            raise TypeError(
                f"the image is {arguments.describe(point_map)}: give a function of points"
            )
        returned = np.asarray(
            call_user_function(mesh.comm, "the image of the mesh", point_map, x.copy())
        )
        shape = (len(x), dim if returned.shape[1:] == (dim,) else 3)
        image_points = arguments.check_function_values(
            "the image of the mesh", returned, shape, f"rows (n, 3) to (n, 3) or (n, {dim})"
        )
        if not np.isfinite(image_points).all():
            raise ValueError("the image of the mesh is not finite at a node")
    check_same_function(mesh.comm, "the image of the mesh", point_map, x)
    return image_points[:, :dim]


def _make_rectangle(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    **options: CellType | DiagonalType,
) -> Mesh:
    arguments.check_communicator(comm)
    if not np.all(
        arguments.check_vector("lower", lower, 2) < arguments.check_vector("upper", upper, 2)
    ):
        raise ValueError(f"a rectangle from {lower} to {upper} has no area")
    n_cells = arguments.check_vector("divisions", divisions, 2)
    if n_cells.min() < 1 or np.any(n_cells % 1 != 0):
        raise ValueError(f"divisions {divisions}: at least one in each direction")
    return create_rectangle(comm, [lower, upper], [int(n) for n in n_cells], **options)
