"""How a contact traction is read from nodal forces: one rule for every element of the study.

A nodal force belongs to the integral of its node's own test function over the surface, the node's
weight, and is read over it. There is no reading at a node whose weight is zero: a corner of a
standard 10-node tetrahedron, a standard element's node on the axis of rotation.
"""

from dataclasses import replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import Body, SurfaceNodes
from pw_elements.spaces import Part

Array = npt.NDArray[np.float64]


def contact_surface(body: Body, where: Part, transfer: PETSc.Mat | None = None) -> SurfaceNodes:
    """Nodes of a surface with their weights; `.pressure(forces)` reads, NaN without a weight.

    Args:
        body: on one process.
        where: the surface, a part of the boundary as `SurfaceNodes.of` takes it.
        transfer: T (n, n) of `force_transfer`, if forces are transferred by it or the sibling's:
            their test functions are T times the standard ones, and so are the weights.
    """
    surface = SurfaceNodes.of(body, where)
    if transfer is None:
        return surface
    weights, of_node = transfer.createVecRight(), (-1, body.spaces.mesh.geometry.dim)
    weights.array.reshape(of_node)[surface.node, -1] = surface.own_area
    transferred = (transfer * weights).array_r.reshape(of_node)[surface.node, -1]
    return replace(surface, own_area=transferred)


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
