"""Two bodies in one mesh."""

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, create_mesh

from pw_elements._compat import cell_geometry_nodes

Array = npt.NDArray[np.float64]


def with_counterpart(lower: Mesh, distance: float) -> Mesh:
    """Both a body below y = 0 and the same turned by half a circle, a distance above it."""
    x = lower.geometry.x[:, :2]
    cells = cell_geometry_nodes(lower)
    return create_mesh(
        lower.comm,
        cells=np.concatenate([cells, cells + len(x)]).astype(np.int64),
        x=np.concatenate([x, np.array([0.0, distance]) - x]),
        e=lower.ufl_domain().ufl_coordinate_element(),
    )


def joined(lower: Mesh, upper: Mesh) -> tuple[Mesh, npt.NDArray[np.bool_]]:
    """One mesh of two, and which of its cells are the lower one's; on one process."""
    dim, below = lower.geometry.dim, cell_geometry_nodes(lower)
    x = np.concatenate([lower.geometry.x, upper.geometry.x])[:, :dim]
    cells = np.concatenate([below, cell_geometry_nodes(upper) + len(lower.geometry.x)]).astype(
        np.int64
    )
    element = lower.ufl_domain().ufl_coordinate_element()
    mesh = create_mesh(lower.comm, cells=cells, x=np.ascontiguousarray(x), e=element)
    return mesh, np.asarray(mesh.topology.original_cell_index) < len(below)
