"""Meshes that contain two bodies."""

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, create_mesh

from pw_elements._compat import cell_geometry_nodes

Array = npt.NDArray[np.float64]


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
