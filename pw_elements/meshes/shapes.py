"""Structured rectangles, and meshes moved or curved by a map of points."""

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
PointMap = Callable[[Array], Array]  # of points as rows, (n, 3)


@check_same_arguments
def triangles(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    pattern: DiagonalPattern = "right",
) -> Mesh:
    """Meshes a rectangle with triangles.

    Args:
        comm: communicator.
        lower: corner (x, y).
        upper: the opposite corner, above and to the right.
        divisions: squares in each direction.
        pattern: how a square is cut into triangles; "crossed" gives four, the others two.

    Raises:
        ValueError: for an empty rectangle, no divisions, or an unknown pattern.
    """
    if not arguments.is_one_of(pattern, DIAGONAL_PATTERNS):
        raise ValueError(
            f"diagonal pattern {pattern!r}: the patterns are {', '.join(DIAGONAL_PATTERNS)}"
        )
    return _rectangle(comm, lower, upper, divisions, diagonal=DiagonalType[pattern])


@check_same_arguments
def quadrilaterals(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
) -> Mesh:
    """Meshes a rectangle with quadrilaterals.

    Args:
        comm: communicator.
        lower: corner (x, y).
        upper: the opposite corner, above and to the right.
        divisions: quadrilaterals in each direction.

    Raises:
        ValueError: for an empty rectangle or no divisions.
    """
    return _rectangle(comm, lower, upper, divisions, cell_type=CellType.quadrilateral)


@check_same_arguments
def move_nodes(mesh: Mesh, point_map: PointMap) -> Mesh:
    """Moves the mesh's nodes in place; straight sides stay straight.

    Args:
        mesh: the mesh.
        point_map: function of points as rows, (n, 3) to (n, 3), or to (n, dim) in dim dimensions.

    Raises:
        ValueError: if the image fails, has the wrong shape, or is not finite; nothing is moved
            then.
    """
    arguments.check_mesh_type(mesh)
    mesh.geometry.x[:, : mesh.geometry.dim] = _placed(mesh, point_map, mesh.geometry.x)
    return mesh


@check_same_arguments
def curved_mesh(mesh: Mesh, point_map: PointMap) -> Mesh:
    """New mesh of degree-2 geometry whose nodes, including mid-side ones, are mapped.

    Args:
        mesh: of straight sides.
        point_map: function of points as rows, (n, 3) to (n, 3), or to (n, dim) in dim dimensions.

    Raises:
        ValueError: if the image fails, has the wrong shape, or is not finite.
    """
    arguments.check_mesh_type(mesh)
    dimension = mesh.geometry.dim
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), 2, shape=(dimension,))
    nodes = fem.functionspace(mesh, element)
    index_map = nodes.dofmap.index_map
    cells_owned = mesh.topology.index_map(mesh.topology.dim).size_local
    # cells in the order of the old mesh's making, in which pairs of triangles follow each other
    order = np.argsort(mesh.topology.original_cell_index[:cells_owned])
    local = nodes.dofmap.list[order]
    cells = index_map.local_to_global(local.ravel().astype(np.int32)).reshape(local.shape)
    x = _placed(mesh, point_map, nodes.tabulate_dof_coordinates()[: index_map.size_local])
    return create_mesh(mesh.comm, cells=cells, x=np.ascontiguousarray(x), e=element)


def _placed(mesh: Mesh, image: PointMap, x: Array) -> Array:
    dim = mesh.geometry.dim
    with collective_errors(mesh.comm):
        if callable(image) and not arguments.is_user_function(image):
            raise TypeError(f"the image is {arguments.describe(image)}: give a function of points")
        given = np.asarray(call_user_function(mesh.comm, "the image of the mesh", image, x.copy()))
        shape = (len(x), dim if given.shape[1:] == (dim,) else 3)
        placed = arguments.check_function_values(
            "the image of the mesh", given, shape, f"rows (n, 3) to (n, 3) or (n, {dim})"
        )
        if not np.isfinite(placed).all():
            raise ValueError("the image of the mesh is not finite at a node")
    check_same_function(mesh.comm, "the image of the mesh", image, x)
    return placed[:, :dim]


def _rectangle(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    **kind: CellType | DiagonalType,
) -> Mesh:
    arguments.check_communicator(comm)
    if not np.all(
        arguments.check_vector("lower", lower, 2) < arguments.check_vector("upper", upper, 2)
    ):
        raise ValueError(f"a rectangle from {lower} to {upper} has no area")
    numbers = arguments.check_vector("divisions", divisions, 2)
    if numbers.min() < 1 or np.any(numbers % 1 != 0):
        raise ValueError(f"divisions {divisions}: at least one in each direction")
    return create_rectangle(comm, [lower, upper], [int(n) for n in numbers], **kind)
