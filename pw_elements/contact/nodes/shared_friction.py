"""Friction at nodes that belong to several pairs.

At a node on which several surfaces act, gaps that are zero may determine the slip, and several
sticking points share the friction along the free directions. The law does not determine these
forces. The rules that select one of the admissible forces are in docs/theory.md ("Nodes in several
pairs").

The module guarantees that nothing changes at nodes on which one surface acts.
"""

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array
from pw_elements.contact.interface import ContactInterface
from pw_elements.contact.nodes.nodes import (
    MIN_KEPT_FRICTION_WEIGHT,
    SLIP,
    STICK,
    ActiveSet,
    ContactNodes,
    combine_active_sets,
    make_sticking_active_set,
    shorten_vectors_to_max_length,
)
from pw_elements.contact.nodes.undeformed import IncrementStart, remove_normal_part

# Largest friction that the slip of a sticking point causes in the next iteration, relative to the
# friction limit
_MAX_FRICTION_OF_SLIP_PER_LIMIT = 10.0
# Singular value below which normals that act on a node count as linearly dependent
_MIN_SINGULAR_VALUE_OF_NORMALS = 1e-12


class FrictionAtSharedNodes:
    """Friction that points of nodes in several pairs keep as far as their slip allows it.

    Args:
        interface: contact points of all pairs.
        start: state at the start of the increment.
    """

    def __init__(self, interface: ContactInterface, start: IncrementStart) -> None:
        self._interface, self._shared, self._start = interface, interface.shared_nodes, start
        self._may_keep = self._shared.is_shared & interface.cone.has_friction
        self._friction = start.force
        self._weight: Array = np.full(len(start.force), MIN_KEPT_FRICTION_WEIGHT)

    def select_friction_to_keep(self, active: ActiveSet) -> tuple[Array, Array]:
        """Return the friction (m, dim) that points keep, and its weight (m,) in their equations.

        The weight is zero except at nodes on which several surfaces act in the active set.
        """
        is_kept = self._may_keep & self._shared.find_points_of_nodes_with_several(
            active.imposes_motion
        )
        return np.where(is_kept, self._weight, 0.0), self._friction

    def update(self, nodes: ContactNodes) -> None:
        """Set the friction that the next iteration keeps.

        It is the friction of the nodes, shortened to its limit; at open nodes, it is the friction
        at the start of the increment. Weights are so large that the friction due to the slip of
        this iterate does not exceed a multiple of the limit.
        """
        limit, _ = nodes.friction_limits_and_slopes
        slip_force = nodes.scale * np.linalg.norm(nodes.slip, axis=1)
        max_slip_force = _MAX_FRICTION_OF_SLIP_PER_LIMIT * limit
        is_excessive = slip_force > MIN_KEPT_FRICTION_WEIGHT * max_slip_force
        weight = np.divide(slip_force, max_slip_force, out=np.ones_like(limit), where=limit > 0)
        self._weight = np.where(is_excessive, np.minimum(weight, 1.0), MIN_KEPT_FRICTION_WEIGHT)
        friction = shorten_vectors_to_max_length(limit, nodes.force[:, 1:])
        vectors = np.einsum("nta,nt->na", nodes.frame[:, 1:], friction)
        is_closed = nodes.trial_pressure > 0
        self._friction = np.where(is_closed[:, None], vectors, self._start.force)

    def restore_friction_of_start(
        self, nodes: ContactNodes, force_tolerance: float
    ) -> ActiveSet | None:
        """Keep the friction from the start of the increment where the slip of a solution allows it.

        The points of a node that stick, or slip by nothing, share the change of friction since the
        start of the increment equally along all directions that are perpendicular to the normals of
        all surfaces that act on the node. Along all other directions, each point keeps its friction
        from the start. Nodes whose friction would then exceed its limit do not change. The call is
        collective.

        Args:
            nodes: contact nodes of a solution.
            force_tolerance: largest change of a force, and product of a slip and the stiffness of
                the law, that counts as zero.

        Returns:
            Active set in which all points with such friction stick; None if no friction changes.
        """
        active, normal = nodes.active_set, nodes.frame[:, 0]
        closed = active.imposes_motion
        has_no_slip = nodes.scale * np.linalg.norm(nodes.slip, axis=1) <= force_tolerance
        keeps = self._may_keep & self._shared.find_points_of_nodes_with_several(closed)
        keeps &= (active.status == STICK) | ((active.status == SLIP) & has_no_slip)
        limit, _ = nodes.friction_limits_and_slopes
        friction = np.einsum("nta,nt->na", nodes.frame[:, 1:], nodes.force[:, 1:])
        start = remove_normal_part(self._start.force, normal)
        restored = friction.copy()
        for points in self._shared.points_of_each_node:
            kept = points[keeps[points]]
            if not len(kept):
                continue
            _, sizes, directions = np.linalg.svd(normal[points[closed[points]]])
            free = directions[np.count_nonzero(sizes > _MIN_SINGULAR_VALUE_OF_NORMALS) :]
            change = np.mean(friction[kept] - start[kept], axis=0)
            values = start[kept] + free.T @ (free @ change)
            if (np.linalg.norm(values, axis=1) < limit[kept]).all():
                restored[kept] = values
            else:
                keeps[kept] = False
        is_changed = np.abs(restored - friction).max(initial=0.0) > force_tolerance
        if not self._interface.comm.allreduce(bool(is_changed), MPI.LOR):
            return None
        self._friction, self._weight = restored, np.full(len(limit), MIN_KEPT_FRICTION_WEIGHT)
        sticking = make_sticking_active_set(keeps, nodes.cone, nodes.slip.shape[1])
        return combine_active_sets(keeps, sticking, active)
