"""Graded meshes of rectangles along given lines."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements.meshes import DiagonalPattern, move_nodes, quadrilaterals, triangles

Array = npt.NDArray[np.float64]


def mesh_along_lines(
    comm: MPI.Comm, x_lines: Array, y_lines: Array, cell: str, pattern: DiagonalPattern = "right"
) -> Mesh:
    """Mesh a rectangle along increasing lines x = constant (m,) and y = constant (n,).

    Args:
        comm: MPI communicator.
        x_lines: Coordinates of the lines x = constant.
        y_lines: Coordinates of the lines y = constant.
        cell: "triangle" or "quadrilateral".
        pattern: Pattern of the diagonals that divide rectangles into triangles.
    """
    divisions = (len(x_lines) - 1, len(y_lines) - 1)
    corners = (0.0, 0.0), (float(divisions[0]), float(divisions[1]))

    def map_to_lines(x: Array) -> Array:
        mapped = x.copy()
        for axis, lines in enumerate((x_lines, y_lines)):
            mapped[:, axis] = np.interp(x[:, axis], np.arange(len(lines)), lines)
        return mapped

    if cell == "triangle":
        return move_nodes(triangles(comm, *corners, divisions, pattern), map_to_lines)
    return move_nodes(quadrilaterals(comm, *corners, divisions), map_to_lines)
