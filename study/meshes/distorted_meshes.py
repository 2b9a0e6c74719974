"""Unit squares and cubes of the hybrid elements' cells, no two of them alike."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, create_unit_cube, create_unit_square

from pw_elements.meshes import move_nodes
from study.meshes.mesh_families import on_cube, on_square

Array = npt.NDArray[np.float64]


CELLS = {
    "T6": CellType.triangle,
    "Q9": CellType.quadrilateral,
    "T10": CellType.tetrahedron,
    "H27": CellType.hexahedron,
}
"""By the ends of elements' names."""


def unit_mesh(element: str, side: float) -> Mesh:
    """Of cells with such a side: triangles and tetrahedra by Gmsh, others moved."""
    if element.endswith("T10"):
        return on_cube(element, side)
    if element.endswith("H27"):
        return moved_mesh(element, round(1 / side))
    return on_square(element, side)


def moved_mesh(element: str, n: int) -> Mesh:
    """Structured, n cells a side, whose nodes inside are moved: alike at all n."""
    cell = CELLS[element.rsplit("-", 1)[1]]
    if cell in (CellType.triangle, CellType.quadrilateral):
        return move_nodes(create_unit_square(MPI.COMM_SELF, n, n, cell), _moved)
    return move_nodes(create_unit_cube(MPI.COMM_SELF, n, n, n, cell), _moved)


def _moved(x: Array) -> Array:
    """Smooth map (n, 3) of the unit square or cube to itself."""
    dim = 3 if x[:, 2].any() else 2
    bubble = np.prod(np.sin(np.pi * x[:, :dim]), axis=1, keepdims=True)
    moved = x.copy()
    moved[:, :dim] += 0.12 * bubble * np.cos(2 * np.roll(x, 1, axis=1) + (0.0, 1.0, 2.0))[:, :dim]
    return moved
