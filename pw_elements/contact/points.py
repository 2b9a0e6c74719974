"""The contact points of one pair, as builders make them for an interface.

A mortar interface joins by another builder of `Points`: G has the weighted gap integrals in its
rows, H the integrals of the multipliers' duals against the weights of both bodies. What the rest
relies on is that each component of a point's force has one equation, `Points.equation`, in which
no other force appears, so that the force can be read from it; and that G's unit times H's is a
stiffness over K's, by which the law's scale is found. Law, kinematics and loop see points only.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# What the point faces in place of a node of a body: nothing that moves by itself, or many nodes
RIGID, DEFORMABLE = -1, -2


@dataclass(frozen=True)
class Points:
    """The contact points (m) of one pair that belong to this process.

    Args:
        position: (m, dim), undeformed.
        friction: (m,), Coulomb's mu.
        equation: (m, dim), number of the reduced equation that holds this component of the
            point's force and of no other; -1 where none does: the law is not stated there. It
            is owned by this process.
        motion: (m dim, n), rows of G, for the displacements alone.
        force: (m dim, n), columns of H, transposed, likewise.
        beside: (m, dim), mean of the midpoints of the cells around: tells points apart that
            coincide, such as those of two bodies that touch.
        outward: (m, dim), direction of the body's outward normal; zero where there is none.
        node: (m,), global number of the node that the point is, or whose force it has.
        faced: (m,), global number of the node that it faces; `RIGID` or `DEFORMABLE` where it
            faces a surface.
        opposite: (k,), global numbers of the nodes of a deformable surface, of all processes, in
            the order of `by_position`.
    """

    position: Array
    friction: Array
    equation: Indices
    motion: sp.csr_matrix
    force: sp.csr_matrix
    beside: Array
    outward: Array
    node: Indices
    faced: Indices
    opposite: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))
