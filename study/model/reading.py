"""How a contact traction is read from nodal forces: one rule for every element of the study.

A nodal force belongs to the integral of its node's own test function over the surface, the node's
weight, and is read over it. There is no reading at a node whose weight is zero: a corner of a
standard 10-node tetrahedron, a standard element's node on the axis of rotation.
"""

from dataclasses import replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import SurfaceNodes

Array = npt.NDArray[np.float64]


def transferred(surface: SurfaceNodes, transfer: PETSc.Mat) -> SurfaceNodes:
    """The nodes with weights of forces that `force_transfer`'s T, or the sibling, has given them.

    Their test functions are T times the standard ones, and so are the weights.

    Args:
        surface: of the standard element, on one process.
        transfer: T (n, n).
    """
    weights, of_node = transfer.createVecRight(), (-1, surface.position.shape[1])
    weights.array.reshape(of_node)[surface.node, -1] = surface.weight_area
    own = (transfer * weights).array_r.reshape(of_node)[surface.node, -1]
    return replace(surface, weight_area=own)


def compared(error: Array, other: Array) -> dict[str, float]:
    """Sizes of an element's errors where another has a value, too, and where it has none.

    Args:
        error: (m,), NaN where the element has no value.
        other: (m,), of the other element at the same nodes, NaN where it has no value.

    Returns:
        `common_median`, `common_rms`, `common_max` and `common_nodes`, and the same with `alone_`
        of the nodes at which only the first has a value, if there are any.
    """
    known, sizes = ~np.isnan(error), {}
    for name, nodes in (("common", known & ~np.isnan(other)), ("alone", known & np.isnan(other))):
        size = np.abs(error[nodes])
        if len(size):
            sizes[f"{name}_median"] = float(np.median(size))
            sizes[f"{name}_rms"] = float(np.sqrt(np.mean(size**2)))
            sizes[f"{name}_max"] = float(size.max())
            sizes[f"{name}_nodes"] = float(len(size))
    return sizes
