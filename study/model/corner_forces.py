"""Ratio of the contact forces at corner nodes to those at mid-side nodes.

The ratio is one under a uniform pressure if nodal forces are even.
"""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

N_END_NODES = 3
"""Number of nodes at each end of the contact that are excluded from the ratio of forces."""


def corner_over_midside_on_face(position: Array, force: Array, cells: int) -> float:
    """Return the ratio of mean normal forces at corner and at mid-side nodes of the block's base.

    Nodes within one cell of the rim are left out.

    Args:
        position: Coordinates (m, 3) of the nodes of the base.
        force: Normal forces (m,).
        cells: Number of cells along the height of the block.
    """
    index = position[:, :2] * cells  # whole numbers at corners
    is_inner = ((index > 1.25) & (index < np.array([2.0, 1.0]) * cells - 1.25)).all(axis=1)
    is_corner = np.isclose(index, np.round(index)).all(axis=1)
    return float(force[is_inner & is_corner].mean() / force[is_inner & ~is_corner].mean())


def corner_over_midside_on_line(force: Array, is_corner: Mask) -> float:
    """Return the median ratio of the mean of two adjacent corner forces to the mid-side force.

    Args:
        force: Normal forces (m,) of the nodes in contact, in the order of their positions.
        is_corner: Mask (m,) of the corner nodes.
    """
    inner = np.arange(N_END_NODES, len(force) - N_END_NODES)
    midside = inner[~is_corner[inner]]
    return float(np.median((force[midside - 1] + force[midside + 1]) / (2 * force[midside])))
