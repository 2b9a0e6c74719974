"""Friction at nodes that supports hold along the surface.

There is no equation for it: the support bears whatever it is. But it acts on the surface and counts
for the limit of friction. The guide's page on theory has the rules ("The law, linearised").

The module guarantees that nodes without supports keep their forces, and assumes that the tangents
of a node are along or across the components that supports hold.
"""

from dataclasses import replace

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.nodes import (
    OPEN,
    STICK,
    TOLERANCE,
    ActiveSet,
    ContactNodes,
    IncrementStart,
    LinearisedKinematics,
)
from pw_elements.contact.system import ContactSystem

# Stiffness of friction on supports against a surface that is free to slide, over that of nodes:
# where all tangents are held, and where others are free, whose friction is solved for in turn
_STIFFNESS, _STIFFNESS_BESIDE_FREE_TANGENT = 1e3, 3.0
# Slip over a node's coordinates and displacement that is no more than round-off
_SLIP_ROUND_OFF = 1e-13
# Derivative of a slip by a free motion of the surface that counts as none
_MIN_COUPLING = 1e-9
# Passes in which friction along a support that is not along the surface finds its limit, and its
# change over the limit that ends them
_MAX_PASSES, _FRICTION_ROUND_OFF = 60, 1e-13


class SupportFriction:
    """Friction on supports in one increment.

    Where the slip of support and surface is known, it determines the friction. Where there is none
    friction stays what it was when the increment started, within its limit. Where the surface is
    free to slide, it is that of the iteration before less a stiffness times the slip: the method
    of multipliers, in which the slip of nodes that stick vanishes at the end.

    Args:
        system: of the contact nodes.
        start: of the increment.
        prescribed: motions of the surfaces (pairs, k), NaN where they are free.
        support_displacement: (m, dim), prescribed displacements of the points.
    """

    def __init__(
        self,
        system: ContactSystem,
        start: IncrementStart,
        prescribed: Array,
        support_displacement: Array,
    ) -> None:
        self._system, self._interface, self._start = system, system.interface, start
        self._free_motions: Mask = np.isnan(prescribed)[self._interface.pair]
        self._support_displacement = support_displacement

    def at_start(self, kinematics: LinearisedKinematics) -> Array:
        """Friction (m, dim - 1) at the increment's start, along tangents that supports hold."""
        along = np.einsum("nta,na->nt", kinematics.frame[:, 1:], self._start.force)
        return np.where(kinematics.held_tangents, along, 0.0)

    def start_set(self, active: ActiveSet, kinematics: LinearisedKinematics) -> ActiveSet:
        """Return an active set with the start's friction on supports where it has none."""
        known = active.support_friction
        return replace(
            active, support_friction=np.where(known == 0, self.at_start(kinematics), known)
        )

    def reduce_totals(
        self, totals: Array, active: ActiveSet, kinematics: LinearisedKinematics
    ) -> tuple[Array, Array]:
        """Return totals (free,) less the friction on supports, and the stiffness of the latter."""
        interface, system = self._interface, self._system
        dim, factor = interface.position.shape[1], _stiffness_factor(kinematics)
        held = interface.held_components
        to_support = self._support_displacement - kinematics.v0[:, :dim]
        to_support = np.where(held, to_support, 0.0)
        slip_by_v = kinematics.motion_by_v[:, 1:, :dim]
        slip = kinematics.slip + np.einsum("nta,na->nt", slip_by_v, to_support)
        closed = (active.status != OPEN)[:, None]
        coupled = self._coupled_tangents(kinematics).any(axis=1, keepdims=True)
        iterated = closed & kinematics.held_tangents & coupled
        sticks = (active.status == STICK)[:, None]
        # of slip that turns by l / |v|, which is c M / (1 - M)
        turning = system.law_scale * active.turning
        turning = turning / np.maximum(1 - active.turning, 1 / factor) + active.turning_by_slip
        turning = turning[:, None] * (1 - active.direction**2)
        stick_stiffness = (factor * system.law_scale)[:, None]
        stiffness = np.where(iterated, np.where(sticks, stick_stiffness, turning), 0.0)
        friction = np.where(closed, active.support_friction, 0.0)
        friction = friction - stiffness * (slip - np.where(sticks, 0.0, active.support_slip))
        tangential_V = np.einsum("nta,nak->ntk", kinematics.frame[:, 1:], kinematics.torque_map.V)
        total = system.sum_over_free_motions(np.einsum("ntk,nt->nk", tangential_V, friction))
        resistance = stiffness[:, :, None] * tangential_V * -kinematics.motion_by_q[:, 1:]
        springs = np.maximum(0.0, system.sum_over_free_motions(resistance.sum(axis=1)))
        return totals - total + springs * system.select_free_motions(kinematics.q0), springs

    def add_to_nodes(
        self,
        nodes: ContactNodes,
        kinematics: LinearisedKinematics,
        force: Array,
        friction: Array,
    ) -> tuple[ContactNodes, Array]:
        """Add friction on supports to the nodes and to forces (m, dim) of their own equations.

        `friction` (m, dim - 1) is that of the iteration before.
        """
        interface, scale, held = self._interface, self._system.law_scale, kinematics.held_tangents
        coupled_tangents = self._coupled_tangents(kinematics)
        is_coupled = np.asarray(coupled_tangents.any(axis=1))
        size = np.abs(interface.position) + np.abs(kinematics.v0[:, : force.shape[1]])
        size = size.sum(axis=1) + np.abs(kinematics.q0).sum(axis=1)[interface.pair]
        largest = np.abs(force).max(initial=0.0)
        largest = self._system.comm.allreduce(float(largest), MPI.MAX)
        no_slip = TOLERANCE * largest / scale + _SLIP_ROUND_OFF * size
        known_slip = np.where(held & ~coupled_tangents, nodes.slip, 0.0)
        is_dragged = np.linalg.norm(known_slip, axis=1) > no_slip
        nodes = replace(nodes, is_dragged=is_dragged, is_coupled=is_coupled)
        rests = nodes.resting_tangents
        nodes = replace(nodes, slip=np.where(rests, 0.0, nodes.slip))
        friction = np.where(rests, self.at_start(kinematics), friction)
        stiffness = np.where(is_coupled, _stiffness_factor(kinematics), 1.0) * scale
        return _add_friction(
            nodes,
            kinematics,
            force,
            friction,
            stiffness=stiffness,
            components=interface.held_components,
        )

    def _coupled_tangents(self, kinematics: LinearisedKinematics) -> Mask:
        """Return along which held tangents (m, dim - 1) slip depends on a surface's free motion."""
        depends = np.abs(kinematics.motion_by_q[:, 1:]) > _MIN_COUPLING
        depends = depends & self._free_motions[:, None]
        return np.asarray(depends.any(axis=2) & kinematics.held_tangents)


def _stiffness_factor(kinematics: LinearisedKinematics) -> Array:
    all_held = kinematics.held_tangents.all(axis=1)
    return np.where(all_held, _STIFFNESS, _STIFFNESS_BESIDE_FREE_TANGENT)


def _add_friction(
    nodes: ContactNodes,
    kinematics: LinearisedKinematics,
    force: Array,
    friction: Array,
    *,
    stiffness: Array,
    components: Mask,
) -> tuple[ContactNodes, Array]:
    """Add to the forces of nodes the friction that the law gives along tangents that are held.

    A support that is not along the surface then bears part of the normal force, too, on which the
    limit of friction depends: the two are found by passes.

    Args:
        nodes: with the forces that their own equations tell.
        kinematics: of the nodes.
        force: (m, dim), the same forces in global components.
        friction: (m, dim - 1), of the iteration before, along the tangents.
        stiffness: (m,), of friction against slip.
        components: (m, dim), which global components supports hold.

    Returns:
        The nodes with all forces, and these in global components (m, dim).
    """
    held, of_equations = kinematics.held_tangents, nodes.force
    tangents = np.where(held[:, :, None], kinematics.frame[:, 1:], 0.0)
    to_components = np.linalg.pinv(np.where(components[:, None], tangents, 0.0))
    known = np.einsum("nta,na->nt", tangents, force)

    def add(tangential: Array) -> tuple[Array, Array]:
        """Return forces (m, dim) on supports that make up tangential ones, and normal forces."""
        added = np.where(held, tangential - known, 0.0)
        added = np.einsum("nat,nt->na", to_components, added)
        return added, of_equations[:, 0] + np.einsum("na,na->n", kinematics.frame[:, 0], added)

    tangential = np.where(held, friction, of_equations[:, 1:])
    for _ in range(_MAX_PASSES):
        _, normal = add(tangential)
        trial_force = np.column_stack([normal, np.where(held, friction, of_equations[:, 1:])])
        trial = replace(nodes, force=trial_force)
        limit = trial.friction_limits[0]
        admitted = replace(trial, scale=stiffness).admitted_friction(limit)
        before, tangential = tangential, np.where(held, admitted, of_equations[:, 1:])
        if not np.any(np.abs(tangential - before) > _FRICTION_ROUND_OFF * limit[:, None]):
            break
    added, normal = add(tangential)
    return replace(nodes, force=np.column_stack([normal, tangential])), force + added
