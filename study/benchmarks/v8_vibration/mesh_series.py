"""Meshes of section V8, and the comparison of values on a series of meshes with exact ones."""

from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, create_box

from pw_elements.meshes import move_nodes, quadrilaterals, triangles
from study.model.discretisation import Discretisation, mesh_nodes_and_cells
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]
MeshSolution = tuple[Array, dict[str, float], Discretisation]
"""Values (n,) on one mesh, measures of the quality of the modes, and the discretised body."""

MAX_NODE_SHIFT = 0.05
"""Largest displacement of a node, which bends inner mesh lines, over the side of the mesh."""


def mesh_rectangle_with_bent_inner_lines(
    sizes: tuple[float, float], divisions: tuple[int, int], cell: str, inner_radius: float = 0.0
) -> Mesh:
    """Mesh a rectangle whose inner mesh lines are curved.

    The rectangle is inner_radius <= x <= inner_radius + a, 0 <= y <= b.

    Args:
        sizes: Side lengths a and b.
        divisions: Numbers of squares along both sides.
        cell: Cell type, "triangle" or "quadrilateral".
        inner_radius: Smallest x.
    """

    def bend_inner_lines(x: Array) -> Array:
        s, t = np.pi * (x[:, 0] - inner_radius) / sizes[0], np.pi * x[:, 1] / sizes[1]
        position = x.copy()
        position[:, 0] += MAX_NODE_SHIFT * sizes[0] * np.sin(s) * np.cos(t)
        position[:, 1] -= MAX_NODE_SHIFT * sizes[1] * np.cos(s) * np.sin(t)
        return position

    build = triangles if cell == "triangle" else quadrilaterals
    corners = (inner_radius, 0.0), (inner_radius + sizes[0], sizes[1])
    return move_nodes(build(MPI.COMM_SELF, *corners, divisions), bend_inner_lines)


def mesh_solid_box(_: str) -> Mesh:
    """Mesh a box of side lengths 1, 2 and 1 with tetrahedra, for all elements."""
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 2, 1)], (2, 4, 2), CellType.tetrahedron)


def compare_values_on_mesh_series_with_exact(
    solve_on_mesh: Callable[[int], MeshSolution],
    squares: Sequence[int],
    names: Sequence[str],
    exact: Sequence[float],
) -> Result:
    """Compare computed values with exact ones on a series of meshes.

    Scalars of the finest mesh are each value by its name, and with the suffixes `_exact`, `_error`
    (relative) and `_order` (convergence order in the element size between the last two meshes). The
    scalar `error` is the largest absolute relative error, and `order` the lowest order. `residual`
    and `imaginary` are the largest values of all meshes. Curves are `squares` (m,), `errors` (m,
    n), `imaginaries` (m,), and the nodes and cells of the finest mesh.

    Args:
        solve_on_mesh: Function that returns the values on a mesh with a given number of squares.
        squares: Numbers of squares (m,), from coarse to fine.
        names: Names of the values (n,).
        exact: Exact values (n,).
    """
    values, qualities = [], []
    for n in squares:
        mesh_values, quality, body = solve_on_mesh(n)
        values.append(mesh_values)
        qualities.append(quality)
    errors = np.array(values) / np.array(exact) - 1
    orders = np.log2(np.abs(errors[-2] / errors[-1])) / np.log2(squares[-1] / squares[-2])
    scalars = {name: max(quality[name] for quality in qualities) for name in qualities[0]}
    scalars |= {"error": np.abs(errors[-1]).max(), "order": orders.min()}
    for i, name in enumerate(names):
        scalars |= {
            name: values[-1][i],
            f"{name}_exact": exact[i],
            f"{name}_error": errors[-1, i],
            f"{name}_order": orders[i],
        }
    scalars = {name: float(value) for name, value in scalars.items()}
    curves = {"squares": np.array(squares), "errors": errors, **mesh_nodes_and_cells(body.space)}
    if "imaginary" in scalars:
        curves["imaginaries"] = np.array([quality["imaginary"] for quality in qualities])
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=body.K.getSize()[0])
