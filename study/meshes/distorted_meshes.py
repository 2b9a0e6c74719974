"""Meshes of the unit square and cube for hybrid elements, without congruent cells."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, create_unit_cube, create_unit_square

from pw_elements.meshes import move_nodes
from study.meshes.mesh_families import on_cube, on_square

Array = npt.NDArray[np.float64]


CELL_TYPE_BY_ELEMENT_SUFFIX = {
    "T6": CellType.triangle,
    "Q9": CellType.quadrilateral,
    "T10": CellType.tetrahedron,
    "H27": CellType.hexahedron,
}
"""Cell types by the suffixes of the names of elements."""


def mesh_unit_square_or_cube(element: str, cell_size: float) -> Mesh:
    """Mesh the unit square or cube with cells that suit an element, none of which are congruent.

    Triangles and tetrahedra are made by Gmsh; other meshes are distorted grids.
    """
    if element.endswith("T10"):
        return on_cube(element, cell_size)
    if element.endswith("H27"):
        return mesh_distorted_unit_grid(element, round(1 / cell_size))
    return on_square(element, cell_size)


def mesh_distorted_unit_grid(element: str, n_cells_per_side: int) -> Mesh:
    """Return a grid of the unit square or cube with n cells per side, distorted by a smooth map.

    The map does not depend on n.
    """
    cell = CELL_TYPE_BY_ELEMENT_SUFFIX[element.rsplit("-", 1)[1]]
    if cell in (CellType.triangle, CellType.quadrilateral):
        return move_nodes(
            create_unit_square(MPI.COMM_SELF, n_cells_per_side, n_cells_per_side, cell),
            _displace_inner_points,
        )
    return move_nodes(
        create_unit_cube(MPI.COMM_SELF, n_cells_per_side, n_cells_per_side, n_cells_per_side, cell),
        _displace_inner_points,
    )


def _displace_inner_points(x: Array) -> Array:
    """Map points (n, 3) of the unit square or cube smoothly; the boundary stays fixed."""
    dim = 3 if x[:, 2].any() else 2
    bubble = np.prod(np.sin(np.pi * x[:, :dim]), axis=1, keepdims=True)
    moved = x.copy()
    moved[:, :dim] += 0.12 * bubble * np.cos(2 * np.roll(x, 1, axis=1) + (0.0, 1.0, 2.0))[:, :dim]
    return moved
