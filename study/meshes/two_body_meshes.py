"""Meshes that contain two bodies."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, create_mesh, locate_entities_boundary

from pw_elements._compat import cell_geometry_nodes
from pw_elements.meshes import curved_mesh
from study.meshes.mesh_lines import bend_end_of_block, mesh_lines_of_block_under_ball
from study.meshes.solid_meshes import mesh_box_along_lines

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


def add_rotated_body(lower: Mesh, distance: float) -> Mesh:
    """Return a mesh of two bodies: a given one below y = 0, and a copy of it rotated by 180° above.

    Their surfaces are `distance` apart.
    """
    x = lower.geometry.x[:, :2]
    cells = cell_geometry_nodes(lower)
    return create_mesh(
        lower.comm,
        cells=np.concatenate([cells, cells + len(x)]).astype(np.int64),
        x=np.concatenate([x, np.array([0.0, distance]) - x]),
        e=lower.ufl_domain().ufl_coordinate_element(),
    )


def join_lower_and_upper_mesh(lower: Mesh, upper: Mesh) -> tuple[Mesh, npt.NDArray[np.bool_]]:
    """Join two meshes on one process; return the mesh and a mask (cells,) of the lower cells."""
    dim, lower_cells = lower.geometry.dim, cell_geometry_nodes(lower)
    x = np.concatenate([lower.geometry.x, upper.geometry.x])[:, :dim]
    upper_cells = cell_geometry_nodes(upper) + len(lower.geometry.x)
    cells = np.concatenate([lower_cells, upper_cells]).astype(np.int64)
    element = lower.ufl_domain().ufl_coordinate_element()
    mesh = create_mesh(lower.comm, cells=cells, x=np.ascontiguousarray(x), e=element)
    return mesh, np.asarray(mesh.topology.original_cell_index) < len(lower_cells)


def mesh_two_blocks_in_space(
    cell: str,
    lower_lines: Sequence[Array],
    upper_lines: Sequence[Array],
    curvatures: tuple[float, float],
    gap: float,
    extent: float = np.inf,
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh a block below and a block above z = 0, whose sides there are paraboloids.

    Args:
        cell: "tetrahedron" or "hexahedron".
        lower_lines: Mesh lines of the lower block along each axis.
        upper_lines: Mesh lines of the upper block.
        curvatures: Curvatures of the lower block's upper side and of the upper block's lower side.
        gap: Distance by which the upper block is moved upwards.
        extent: Largest size of the coordinates x and y of the slave.

    Returns:
        Mesh, and the facets of the slave (of the upper block) and of the master.
    """

    def height(curvature: float, x: Array, y: Array) -> Array:
        return np.asarray(curvature / 2 * (x**2 + y**2))

    blocks = [
        curved_mesh(
            mesh_box_along_lines(cell, *lines),
            partial(bend_end_of_block, curvature=curvature),
        )
        for lines, curvature in zip((lower_lines, upper_lines), curvatures, strict=True)
    ]
    blocks[1].geometry.x[:, 2] += gap
    mesh, _ = join_lower_and_upper_mesh(*blocks)

    def find_facets(curvature: float, distance: float, extent: float) -> Indices:
        def is_on_side(x: Array) -> Mask:
            is_at_height = np.abs(x[2] - height(curvature, *x[:2]) - distance) < 1e-9
            return np.asarray(is_at_height & (np.abs(x[:2]).max(axis=0) < extent + 1e-9))

        return locate_entities_boundary(mesh, 2, is_on_side).astype(np.int64)

    return mesh, (find_facets(curvatures[1], gap, extent), find_facets(curvatures[0], 0.0, np.inf))


def mesh_ball_on_block(
    elements_per_radius: float, ball_over_block_elements: float, radius: float, gap: float
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh a part of a ball above a block; lengths are relative to the contact radius.

    Args:
        elements_per_radius: Number of the ball's elements along the contact radius.
        ball_over_block_elements: This number over that of the block.
        radius: Radius of the ball.
        gap: Initial gap.

    Returns:
        Mesh, and the facets of the slave (of the ball) and of the master.
    """
    across, depth, extent = mesh_lines_of_block_under_ball(elements_per_radius)
    block_across, block_depth, _ = mesh_lines_of_block_under_ball(
        elements_per_radius / ball_over_block_elements
    )
    lower_lines = block_across, block_across, -block_depth[::-1]
    upper_lines = across, across, depth
    return mesh_two_blocks_in_space(
        "tetrahedron", lower_lines, upper_lines, (0.0, 1 / radius), gap, extent
    )
