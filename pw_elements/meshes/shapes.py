"""Create structured meshes of rectangles, and move the nodes of meshes."""

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
    check_same_arguments_on_all_processes,
    check_same_function,
    raise_errors_on_all_processes,
)

DiagonalPattern = Literal["right", "left", "right_left", "left_right", "crossed"]
DIAGONAL_PATTERNS: tuple[DiagonalPattern, ...] = get_args(DiagonalPattern)
PointMap = Callable[[Array], Array]  # function from points (n, 3) to points (n, 3) or (n, dim)


@check_same_arguments_on_all_processes
def triangles(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    pattern: DiagonalPattern = "right",
) -> Mesh:
    """Mesh a rectangle with triangles.

    Args:
        comm: communicator of the mesh.
        lower: lower left corner (x, y) of the rectangle.
        upper: upper right corner (x, y) of the rectangle.
        divisions: numbers of small rectangles in x and in y.
        pattern: direction of the diagonals that divide each small rectangle into two triangles, or
            "crossed" for four triangles.

    Raises:
        ValueError: if the rectangle has no area, a number of divisions is less than one, or the
            pattern is unknown.
    """
    if not arguments.is_one_of(pattern, DIAGONAL_PATTERNS):
        raise ValueError(
            f"diagonal pattern {pattern!r}: the patterns are {', '.join(DIAGONAL_PATTERNS)}"
        )
    return _make_rectangle_mesh(comm, lower, upper, divisions, diagonal=DiagonalType[pattern])


@check_same_arguments_on_all_processes
def quadrilaterals(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
) -> Mesh:
    """Mesh a rectangle with quadrilaterals.

    Args:
        comm: communicator of the mesh.
        lower: lower left corner (x, y) of the rectangle.
        upper: upper right corner (x, y) of the rectangle.
        divisions: numbers of quadrilaterals in x and in y.

    Raises:
        ValueError: if the rectangle has no area, or a number of divisions is less than one.
    """
    return _make_rectangle_mesh(comm, lower, upper, divisions, cell_type=CellType.quadrilateral)


@check_same_arguments_on_all_processes
def move_nodes(mesh: Mesh, point_map: PointMap) -> Mesh:
    """Move the nodes of a mesh in place by a function, and return the mesh.

    The degree of the geometry is not changed: straight sides of cells stay straight.

    Args:
        mesh: mesh to be changed.
        point_map: function from points (n, 3) to their new positions (n, 3) or (n, dim), where dim
            is the dimension of the mesh.

    Raises:
        ValueError: if the function raises an error, or its result has the wrong shape or is not
            finite. The mesh is unchanged in these cases.
    """
    arguments.check_double_precision_mesh(mesh)
    mesh.geometry.x[:, : mesh.geometry.dim] = _evaluate_point_map(mesh, point_map, mesh.geometry.x)
    return mesh


@check_same_arguments_on_all_processes
def curved_mesh(mesh: Mesh, point_map: PointMap) -> Mesh:
    """Create a mesh with curved sides (degree 2) by moving vertices and mid-side nodes of a mesh.

    Args:
        mesh: mesh with straight sides, which is not changed.
        point_map: function from points (n, 3) to their new positions (n, 3) or (n, dim), where dim
            is the dimension of the mesh.

    Raises:
        ValueError: if the function raises an error, or its result has the wrong shape or is not
            finite.
    """
    arguments.check_double_precision_mesh(mesh)
    dimension = mesh.geometry.dim
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), 2, shape=(dimension,))
    nodes = fem.functionspace(mesh, element)
    index_map = nodes.dofmap.index_map
    cells_owned = mesh.topology.index_map(mesh.topology.dim).size_local
    # cells in the order in which the mesh was created: triangles of a rectangle are adjacent
    order = np.argsort(mesh.topology.original_cell_index[:cells_owned])
    local = nodes.dofmap.list[order]
    cells = index_map.local_to_global(local.ravel().astype(np.int32)).reshape(local.shape)
    x = _evaluate_point_map(
        mesh, point_map, nodes.tabulate_dof_coordinates()[: index_map.size_local]
    )
    return create_mesh(mesh.comm, cells=cells, x=np.ascontiguousarray(x), e=element)


def _evaluate_point_map(mesh: Mesh, point_map: PointMap, x: Array) -> Array:
    """Return the new positions (n, dim) of points x (n, 3); raise errors on all processes."""
    dim = mesh.geometry.dim
    with raise_errors_on_all_processes(mesh.comm):
        if callable(point_map) and not arguments.is_user_function(point_map):
            raise TypeError(
                f"the image is {arguments.describe_value_or_type(point_map)}: give a function of "
                "points"
            )
        returned = np.asarray(
            call_user_function(mesh.comm, "the image of the mesh", point_map, x.copy())
        )
        shape = (len(x), dim if returned.shape[1:] == (dim,) else 3)
        image_points = arguments.check_user_function_values(
            "the image of the mesh", returned, shape, f"rows (n, 3) to (n, 3) or (n, {dim})"
        )
        if not np.isfinite(image_points).all():
            raise ValueError("the image of the mesh is not finite at a node")
    check_same_function(mesh.comm, "the image of the mesh", point_map, x)
    return image_points[:, :dim]


def _make_rectangle_mesh(
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
