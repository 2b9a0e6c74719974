"""Rectangles on graded mesh lines, and a body with its counterpart turned by half a circle."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, create_mesh

from pw_elements._compat import cell_nodes
from pw_elements.meshes import mapped, quadrilaterals, triangles

Array = npt.NDArray[np.float64]


def growing(smallest: float, length: float, growth: float) -> Array:
    """Mesh lines from 0 to the length, elements growing from about the smallest by a factor."""
    count = int(np.ceil(np.log1p(length / smallest * (growth - 1)) / np.log(growth)))
    lines = np.concatenate([[0.0], np.cumsum(growth ** np.arange(count))])
    return length * lines / lines[-1]


def rectangle(x_lines: Array, y_lines: Array, cell: str) -> Mesh:
    """Rectangle whose mesh lines are given, of "triangle" or "quadrilateral" cells."""
    divisions = (len(x_lines) - 1, len(y_lines) - 1)

    def placed(x: Array) -> Array:
        moved = x.copy()
        for axis, lines in enumerate((x_lines, y_lines)):
            moved[:, axis] = np.interp(x[:, axis], np.arange(len(lines)), lines)
        return moved

    corner, size = (0.0, 0.0), (float(divisions[0]), float(divisions[1]))
    if cell == "triangle":
        return mapped(triangles(MPI.COMM_SELF, corner, size, divisions, "left_right"), placed)
    return mapped(quadrilaterals(MPI.COMM_SELF, corner, size, divisions), placed)


def with_counterpart(lower: Mesh, distance: float) -> Mesh:
    """Both a body below y = 0 and the same turned by half a circle, a distance above it."""
    x = lower.geometry.x[:, :2]
    cells = cell_nodes(lower)
    return create_mesh(
        lower.comm,
        cells=np.concatenate([cells, cells + len(x)]).astype(np.int64),
        x=np.concatenate([x, np.array([0.0, distance]) - x]),
        e=lower.ufl_domain().ufl_coordinate_element(),
    )
