"""Unit squares and cubes of the hybrid elements' cells, no two of them alike."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, create_unit_cube

from pw_elements.meshes import mapped
from study.verification.c_mesh_families import on_cube, on_square

Array = npt.NDArray[np.float64]


def unit_mesh(element: str, side: float) -> Mesh:
    """Of cells with such a side: triangles and tetrahedra by Gmsh, others moved."""
    if element.endswith("T10"):
        return on_cube(element, side)
    if element.endswith("H27"):
        n = round(1 / side)
        return mapped(create_unit_cube(MPI.COMM_SELF, n, n, n, CellType.hexahedron), _moved)
    return on_square(element, side)


def _moved(x: Array) -> Array:
    """Smooth map (n, 3) of the unit cube to itself."""
    bubble = np.prod(np.sin(np.pi * x), axis=1)[:, None]
    return np.asarray(x + 0.12 * bubble * np.cos(2 * np.roll(x, 1, axis=1) + (0.0, 1.0, 2.0)))
