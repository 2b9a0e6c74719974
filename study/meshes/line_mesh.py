"""Rectangles meshed along given lines, as graded meshes are."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements.meshes import DiagonalPattern, move_nodes, quadrilaterals, triangles

Array = npt.NDArray[np.float64]


def on_lines(
    comm: MPI.Comm, x_lines: Array, y_lines: Array, cell: str, pattern: DiagonalPattern = "right"
) -> Mesh:
    """Mesh along increasing lines x = constant (m,) and y = constant (n,).

    Args:
        comm: communicator.
        x_lines: coordinates of the lines x = constant.
        y_lines: coordinates of the lines y = constant.
        cell: "triangle" or "quadrilateral".
        pattern: how rectangles are cut into triangles.
    """
    divisions = (len(x_lines) - 1, len(y_lines) - 1)
    corners = (0.0, 0.0), (float(divisions[0]), float(divisions[1]))

    def placed(x: Array) -> Array:
        moved = x.copy()
        for axis, lines in enumerate((x_lines, y_lines)):
            moved[:, axis] = np.interp(x[:, axis], np.arange(len(lines)), lines)
        return moved

    if cell == "triangle":
        return move_nodes(triangles(comm, *corners, divisions, pattern), placed)
    return move_nodes(quadrilaterals(comm, *corners, divisions), placed)
