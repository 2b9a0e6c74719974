"""What DOLFINx 0.9 and its successors name differently."""

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh


def cell_nodes(mesh: Mesh) -> npt.NDArray[np.int32]:
    """Numbers (cells, nodes) of the geometry's nodes in each cell, ghosts included."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
