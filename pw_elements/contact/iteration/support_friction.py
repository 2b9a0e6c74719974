"""Support friction: friction at a node along a direction in which a support holds the node.

No equation determines this force, because the support can balance any value. The force nevertheless
acts on the surface and counts towards the friction limit. The rules are in docs/theory.md ("The
law, linearised").

The module guarantees that the forces of nodes without supports do not change. It assumes that each
tangent of a node is either parallel or perpendicular to the supported components.
"""

from dataclasses import replace

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    OPEN,
    STICK,
    ActiveSet,
    ContactNodes,
    IncrementStart,
    LinearisedKinematics,
)
from pw_elements.contact.system import ContactSystem

# Stiffness of support friction against a surface that is free to slide, divided by the stiffness of
# the node's contact law. The first value applies if supports hold all tangents of the node, the
# second value if one of its tangents is free
_FRICTION_TO_LAW_STIFFNESS_IF_FULLY_HELD, _FRICTION_TO_LAW_STIFFNESS_IF_PARTLY_HELD = 1e3, 3.0
# Round-off in the slip, relative to the sum of a node's coordinates and displacement
_SLIP_ROUND_OFF_RELATIVE_TO_COORDINATES = 1e-13
# Largest derivative of a slip with respect to a free motion of the surface that counts as zero
_MAX_ZERO_SLIP_DERIVATIVE = 1e-9
# Support friction along a support that is not parallel to the surface: largest number of
# fixed-point iterations, and their tolerance relative to the friction limit
_MAX_FIXED_POINT_ITERATIONS, _FIXED_POINT_TOLERANCE_PER_FRICTION_LIMIT = 60, 1e-13


class FrictionAtSupportedNodes:
    """Support friction in one increment: friction at nodes that supports hold along a surface.

    A prescribed slip between support and surface determines the friction. If the prescribed slip is
    zero, friction keeps its value at the start of the increment, or is reduced to its limit. If the
    surface is free to slide, the new friction is the friction of the previous iteration minus a
    stiffness times the slip (method of multipliers). The slip of sticking nodes then converges to
    zero.

    Args:
        system: contact system, which solves the linear equations.
        start: state at the start of the increment.
        prescribed_motions: prescribed motions (pairs, k) of the surfaces, NaN where a motion is
            free.
        support_displacement: prescribed displacements (m, dim) of the contact points.
    """

    def __init__(
        self,
        system: ContactSystem,
        start: IncrementStart,
        prescribed_motions: Array,
        support_displacement: Array,
    ) -> None:
        self._system, self._interface, self._start = system, system.interface, start
        self._free_motions: Mask = np.isnan(prescribed_motions)[self._interface.pair]
        self._support_displacement = support_displacement

    def friction_at_increment_start(self, kinematics: LinearisedKinematics) -> Array:
        """Return the support friction (m, dim - 1) at the start of the increment."""
        friction = np.einsum("nta,na->nt", kinematics.frame[:, 1:], self._start.force)
        return np.where(kinematics.held_tangents, friction, 0.0)

    def fill_zero_friction_from_start(
        self, active: ActiveSet, kinematics: LinearisedKinematics
    ) -> ActiveSet:
        """Return the active set with initial values of support friction.

        Where the support friction of the active set is zero, it is replaced by the support friction
        at the start of the increment.
        """
        friction = active.support_friction
        friction = np.where(friction == 0, self.friction_at_increment_start(kinematics), friction)
        return replace(active, support_friction=friction)

    def subtract_friction_and_get_stiffness(
        self, free_motion_forces: Array, active: ActiveSet, kinematics: LinearisedKinematics
    ) -> tuple[Array, Array]:
        """Return the forces of free motions minus the support friction, and the friction stiffness.

        Support friction depends linearly on the free motions of the surfaces.

        Args:
            free_motion_forces: prescribed forces and torques (free,) of the free motions.
            active: active set.
            kinematics: linearised kinematics.

        Returns:
            The forces and torques (free,) minus the constant part of the support friction, and the
            stiffness (free,) of the support friction against each free motion.
        """
        interface, system = self._interface, self._system
        dim, factor = interface.position.shape[1], _friction_stiffness_per_law_stiffness(kinematics)
        support_step = self._support_displacement - kinematics.v0[:, :dim]
        support_step = np.where(interface.held_components, support_step, 0.0)
        slip_by_v = kinematics.motion_by_v[:, 1:, :dim]
        slip = kinematics.slip + np.einsum("nta,na->nt", slip_by_v, support_step)
        closed = (active.status != OPEN)[:, None]
        coupled = self._find_held_tangents_of_free_surfaces(kinematics).any(axis=1, keepdims=True)
        iterated = closed & kinematics.held_tangents & coupled
        sticks = (active.status == STICK)[:, None]
        # Against a change of the direction of slip, friction has the stiffness l / |v| with the
        # limit l and the slip v; it equals c M / (1 - M) with the law's stiffness c and the
        # friction ratio M
        slip_stiffness = system.law_scale * active.friction_ratio
        slip_stiffness = slip_stiffness / np.maximum(1 - active.friction_ratio, 1 / factor)
        slip_stiffness = slip_stiffness + active.friction_per_slip
        slip_stiffness = slip_stiffness[:, None] * (1 - active.direction**2)
        stick_stiffness = (factor * system.law_scale)[:, None]
        stiffness = np.where(iterated, np.where(sticks, stick_stiffness, slip_stiffness), 0.0)
        friction = np.where(closed, active.support_friction, 0.0)
        friction = friction - stiffness * (slip - np.where(sticks, 0.0, active.support_slip))
        tangential_V = np.einsum("nta,nak->ntk", kinematics.frame[:, 1:], kinematics.torque_map.V)
        total = system.sum_forces_by_free_motion(np.einsum("ntk,nt->nk", tangential_V, friction))
        resistance = stiffness[:, :, None] * tangential_V * -kinematics.motion_by_q[:, 1:]
        springs = np.maximum(0.0, system.sum_forces_by_free_motion(resistance.sum(axis=1)))
        return free_motion_forces - total + springs * system.select_free_motions(
            kinematics.q0
        ), springs

    def add_friction_to_nodal_forces(
        self,
        nodes: ContactNodes,
        kinematics: LinearisedKinematics,
        global_force: Array,
        previous_friction: Array,
    ) -> tuple[ContactNodes, Array]:
        """Return nodes and global force components (m, dim) that include support friction.

        Args:
            nodes: contact nodes with forces from the equations that supports do not eliminate.
            kinematics: kinematics of the nodes.
            global_force: the same forces (m, dim) in global components.
            previous_friction: support friction (m, dim - 1) of the previous iteration.
        """
        interface, scale = self._interface, self._system.law_scale
        coupled_tangents = self._find_held_tangents_of_free_surfaces(kinematics)
        is_coupled_to_surface = np.asarray(coupled_tangents.any(axis=1))
        size = np.abs(interface.position) + np.abs(kinematics.v0[:, : global_force.shape[1]])
        size = size.sum(axis=1) + np.abs(kinematics.q0).sum(axis=1)[interface.pair]
        largest_force = np.abs(global_force).max(initial=0.0)
        largest_force = self._system.comm.allreduce(float(largest_force), MPI.MAX)
        min_slip = (
            MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * largest_force / scale
            + _SLIP_ROUND_OFF_RELATIVE_TO_COORDINATES * size
        )
        is_prescribed = kinematics.held_tangents & ~coupled_tangents
        prescribed_slip = np.where(is_prescribed, nodes.slip, 0.0)
        has_prescribed_slip = np.linalg.norm(prescribed_slip, axis=1) > min_slip
        nodes = replace(
            nodes,
            has_prescribed_slip=has_prescribed_slip,
            is_coupled_to_surface=is_coupled_to_surface,
        )
        is_resting = nodes.held_tangents_without_motion
        nodes = replace(nodes, slip=np.where(is_resting, 0.0, nodes.slip))
        previous_friction = np.where(
            is_resting, self.friction_at_increment_start(kinematics), previous_friction
        )
        stiffness = (
            np.where(is_coupled_to_surface, _friction_stiffness_per_law_stiffness(kinematics), 1.0)
            * scale
        )
        return _add_support_friction_by_fixed_point(
            nodes,
            kinematics,
            global_force,
            previous_friction,
            friction_stiffness=stiffness,
            supported_components=interface.held_components,
        )

    def _find_held_tangents_of_free_surfaces(self, kinematics: LinearisedKinematics) -> Mask:
        """Return a mask (m, dim - 1) of held tangents along which the surface is free to move.

        A tangent is held if supports prevent the node from moving along it.
        """
        depends = np.abs(kinematics.motion_by_q[:, 1:]) > _MAX_ZERO_SLIP_DERIVATIVE
        depends = depends & self._free_motions[:, None]
        return np.asarray(depends.any(axis=2) & kinematics.held_tangents)


def _friction_stiffness_per_law_stiffness(kinematics: LinearisedKinematics) -> Array:
    all_held = kinematics.held_tangents.all(axis=1)
    return np.where(
        all_held,
        _FRICTION_TO_LAW_STIFFNESS_IF_FULLY_HELD,
        _FRICTION_TO_LAW_STIFFNESS_IF_PARTLY_HELD,
    )


def _add_support_friction_by_fixed_point(
    nodes: ContactNodes,
    kinematics: LinearisedKinematics,
    global_force: Array,
    previous_friction: Array,
    *,
    friction_stiffness: Array,
    supported_components: Mask,
) -> tuple[ContactNodes, Array]:
    """Add support friction to the forces of the nodes, along the tangents that supports hold.

    If a support is not parallel to the surface, it carries a part of the normal force, on which the
    friction limit depends. Friction and normal force are determined by fixed-point iteration.

    Args:
        nodes: contact nodes with forces from the equations that supports do not eliminate.
        kinematics: kinematics of the nodes.
        global_force: the same forces (m, dim) in global components.
        previous_friction: support friction (m, dim - 1) of the previous iteration.
        friction_stiffness: stiffness (m,) of the friction against slip.
        supported_components: whether supports hold each global component (m, dim).

    Returns:
        The nodes with all forces, and the same forces (m, dim) in global components.
    """
    is_held, equation_force = kinematics.held_tangents, nodes.force
    tangents = np.where(is_held[:, :, None], kinematics.frame[:, 1:], 0.0)
    to_components = np.linalg.pinv(np.where(supported_components[:, None], tangents, 0.0))
    held_force = np.einsum("nta,na->nt", tangents, global_force)

    def compute_support_and_normal_forces(tangential_forces: Array) -> tuple[Array, Array]:
        """Return support forces (m, dim), and normal forces (m,) that include their normal parts.

        `tangential_forces` are the tangential forces (m, dim - 1).
        """
        missing = np.where(is_held, tangential_forces - held_force, 0.0)
        support_force = np.einsum("nat,nt->na", to_components, missing)
        normal_part = np.einsum("na,na->n", kinematics.frame[:, 0], support_force)
        return support_force, equation_force[:, 0] + normal_part

    tangential = np.where(is_held, previous_friction, equation_force[:, 1:])
    for _ in range(_MAX_FIXED_POINT_ITERATIONS):
        _, normal = compute_support_and_normal_forces(tangential)
        trial_force = np.column_stack(
            [normal, np.where(is_held, previous_friction, equation_force[:, 1:])]
        )
        trial = replace(nodes, force=trial_force)
        limit = trial.friction_limits_and_slopes[0]
        admissible = replace(trial, scale=friction_stiffness).admissible_friction(limit)
        previous, tangential = tangential, np.where(is_held, admissible, equation_force[:, 1:])
        if not np.any(
            np.abs(tangential - previous)
            > _FIXED_POINT_TOLERANCE_PER_FRICTION_LIMIT * limit[:, None]
        ):
            break
    support_force, normal = compute_support_and_normal_forces(tangential)
    return replace(nodes, force=np.column_stack([normal, tangential])), global_force + support_force
