"""Structured rectangles in the patterns of the examples, and their smooth images."""

from collections.abc import Callable
from typing import Literal

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import CellType, DiagonalType, Mesh, create_mesh, create_rectangle

Pattern = Literal["right", "left", "right_left", "left_right", "crossed"]
PATTERNS: tuple[Pattern, ...] = ("right", "left", "right_left", "left_right", "crossed")
Map = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]


def triangles(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
    pattern: Pattern = "right",
) -> Mesh:
    """Rectangle of triangles; `pattern` says how a square is cut, "crossed" gives four.

    Raises:
        ValueError: for an empty rectangle, no divisions, or an unknown pattern.
    """
    _check(lower, upper, divisions)
    if pattern not in PATTERNS:
        raise ValueError(f"diagonal pattern {pattern!r}: the patterns are {', '.join(PATTERNS)}")
    return create_rectangle(comm, [lower, upper], divisions, diagonal=DiagonalType[pattern])


def quadrilaterals(
    comm: MPI.Comm,
    lower: tuple[float, float],
    upper: tuple[float, float],
    divisions: tuple[int, int],
) -> Mesh:
    """Rectangle of quadrilaterals.

    Raises:
        ValueError: for an empty rectangle or no divisions.
    """
    _check(lower, upper, divisions)
    return create_rectangle(comm, [lower, upper], divisions, CellType.quadrilateral)


def on_lines(
    comm: MPI.Comm,
    x_lines: npt.NDArray[np.float64],
    y_lines: npt.NDArray[np.float64],
    cell: str,
    pattern: Pattern = "right",
) -> Mesh:
    """Rectangle whose mesh lines are given.

    Args:
        comm: communicator.
        x_lines: increasing coordinates (m,) of the lines x = constant.
        y_lines: the same (n,) of the lines y = constant.
        cell: "triangle" or "quadrilateral".
        pattern: how rectangles are cut in triangles.

    Raises:
        ValueError: if lines do not increase, or the pattern is unknown.
    """
    if not (np.all(np.diff(x_lines) > 0) and np.all(np.diff(y_lines) > 0)):
        raise ValueError("mesh lines have to increase")
    divisions = (len(x_lines) - 1, len(y_lines) - 1)
    corners = (0.0, 0.0), (float(divisions[0]), float(divisions[1]))

    def placed(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        moved = x.copy()
        for axis, lines in enumerate((x_lines, y_lines)):
            moved[:, axis] = np.interp(x[:, axis], np.arange(len(lines)), lines)
        return moved

    if cell == "triangle":
        return mapped(triangles(comm, *corners, divisions, pattern), placed)
    return mapped(quadrilaterals(comm, *corners, divisions), placed)


def mapped(mesh: Mesh, image: Map) -> Mesh:
    """Moves the mesh's nodes, (n, 3) to (n, 3), in place; straight sides stay straight."""
    mesh.geometry.x[:] = image(mesh.geometry.x)
    return mesh


def curved(mesh: Mesh, image: Map) -> Mesh:
    """New mesh of degree-2 geometry whose nodes, mid-side ones too, are images (n, 3)."""
    dimension = mesh.geometry.dim
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), 2, shape=(dimension,))
    nodes = fem.functionspace(mesh, element)
    index_map = nodes.dofmap.index_map
    cells_owned = mesh.topology.index_map(mesh.topology.dim).size_local
    # cells in the order of the old mesh's making, in which pairs of triangles follow each other
    order = np.argsort(mesh.topology.original_cell_index[:cells_owned])
    local = nodes.dofmap.list[order]
    cells = index_map.local_to_global(local.ravel().astype(np.int32)).reshape(local.shape)
    x = image(nodes.tabulate_dof_coordinates()[: index_map.size_local])[:, :dimension]
    return create_mesh(mesh.comm, cells=cells, x=np.ascontiguousarray(x), e=element)


def _check(
    lower: tuple[float, float], upper: tuple[float, float], divisions: tuple[int, int]
) -> None:
    if not all(a < b for a, b in zip(lower, upper, strict=True)):
        raise ValueError(f"a rectangle from {lower} to {upper} has no area")
    if min(divisions) < 1:
        raise ValueError(f"divisions {divisions}: at least one in each direction")
