"""Contact tractions from nodal forces, by the same rule for all elements of the study.

Each nodal force is divided by the weight of its node, which is the integral of the node's own test
function over the surface. The traction is undefined at nodes whose weight is zero, which are the
corners of standard 10-node tetrahedra and nodes of standard elements on the axis of rotation.
"""

from dataclasses import replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import SurfaceNodes

Array = npt.NDArray[np.float64]


def multiply_nodal_weights_by_T(surface: SurfaceNodes, transfer: PETSc.Mat) -> SurfaceNodes:
    """Return the surface nodes with weights T w, where w are the weights of the standard element.

    These weights apply to forces that were transferred by the matrix T of `force_transfer`, and to
    forces of the sibling, whose test functions are T times the standard ones.

    Args:
        surface: Surface nodes of the standard element, on one process.
        transfer: T (n, n).
    """
    weights, nodal_shape = transfer.createVecRight(), (-1, surface.position.shape[1])
    weights.array.reshape(nodal_shape)[surface.node, -1] = surface.weight_area
    transferred = (transfer * weights).array_r.reshape(nodal_shape)[surface.node, -1]
    return replace(surface, weight_area=transferred)


def error_norms_on_common_and_other_nodes(error: Array, other_values: Array) -> dict[str, float]:
    """Return norms of an element's errors at nodes where another element has values, or has none.

    Args:
        error: Errors (m,), NaN where the element has no value.
        other_values: Values (m,) of the other element at the same nodes, NaN where it has none.

    Returns:
        `common_median`, `common_rms`, `common_max` and `common_nodes` for nodes at which both
        elements have values; the same with the prefix `alone_` for nodes at which only the first
        element has a value. Groups without nodes are omitted.
    """
    has_error, has_other = ~np.isnan(error), ~np.isnan(other_values)
    norms = {}
    for name, nodes in (("common", has_error & has_other), ("alone", has_error & ~has_other)):
        magnitude = np.abs(error[nodes])
        if len(magnitude):
            norms[f"{name}_median"] = float(np.median(magnitude))
            norms[f"{name}_rms"] = float(np.sqrt(np.mean(magnitude**2)))
            norms[f"{name}_max"] = float(magnitude.max())
            norms[f"{name}_nodes"] = float(len(magnitude))
    return norms
