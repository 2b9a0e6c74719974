"""Data of an increment: its targets, its linear systems and its iterates.

A target contains the loads and surface motions at the end of an increment or of a substep.

The module guarantees that the targets of substeps lie on the straight path from the start of the
increment to its end. It assumes that motions and forces have been checked in the functions called
by users.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import ContactInterface
from pw_elements.contact.model import (
    ContactState,
    FreeMotionIndices,
    Motion,
)
from pw_elements.contact.nodes import (
    ActiveSet,
    ContactNodes,
    LinearisedContactLaw,
    LinearisedKinematics,
    TorqueMap,
)


@dataclass(frozen=True)
class TargetLoadsAndMotions:
    """Loads and motions at the end of an increment or of a substep.

    Args:
        load: total load vector (n,), or None if the residual includes the loads.
        q: motions (pairs, k) of the surfaces, NaN where a motion is free. If surfaces may rotate,
            the last component is the angle.
        forces: total forces and torques (pairs, k) of the surfaces, used where the motion is free.
        load_factor: applied fraction of the prescribed displacements and of the interference.
    """

    load: PETSc.Vec | None
    q: Array
    forces: Array
    load_factor: float = 1.0

    @classmethod
    def from_load_and_motions(
        cls,
        load: PETSc.Vec | None,
        motions: Sequence[Motion | None],
        n_motions_per_surface: int,
    ) -> "TargetLoadsAndMotions":
        """Return the target for the user's loads and motions.

        Args:
            load: total load vector (n,), or None if the residual includes the loads.
            motions: motion of each pair's surface; None for a surface in its initial position.
            n_motions_per_surface: number of components of the motion of each surface: its
                translations and, if surfaces may rotate, its angle.
        """
        q, forces = np.zeros((2, len(motions), n_motions_per_surface))
        for k, motion in enumerate(motions):
            if motion is not None:
                q[k], forces[k] = (
                    motion.translation_and_rotation()[:n_motions_per_surface],
                    motion.force_and_torque()[:n_motions_per_surface],
                )
        return cls(load, q, forces)

    @classmethod
    def from_state(
        cls, state: ContactState, q: Array, load: PETSc.Vec | None = None
    ) -> "TargetLoadsAndMotions":
        """Return the target that a state already satisfies, with all motions prescribed.

        Args:
            state: the state.
            q: motions (pairs, k) of the surfaces in this state.
            load: total load vector (n,), or None if the residual includes the loads.
        """
        forces = np.array([[*pair.force, pair.torque] for pair in state.pairs])
        load_factor = 1.0 if state.increment else 0.0
        return cls(load, q, forces[:, : q.shape[1]], load_factor)

    def with_free_motions(self, free_motions: FreeMotionIndices) -> "TargetLoadsAndMotions":
        """Return a copy in which the given motions are free (NaN) and follow from the forces."""
        q = self.q.copy()
        for index in free_motions:
            q[index] = np.nan
        return replace(self, q=q)

    @cached_property
    def free_motions(self) -> FreeMotionIndices:
        """Indices (pair, component) of all free motions."""
        return tuple(
            (int(pair), int(component)) for pair, component in np.argwhere(np.isnan(self.q))
        )

    @cached_property
    def unloaded_free_surfaces(self) -> Mask:
        """Mask (pairs,) of surfaces that are free to move and have no prescribed force."""
        is_free = np.isnan(self.q)
        return is_free.any(axis=1) & ~(is_free & (self.forces != 0)).any(axis=1)

    @cached_property
    def free_motion_forces(self) -> Array:
        """Prescribed forces and torques (free,) of the free motions."""
        return np.array([self.forces[index] for index in self.free_motions])


def make_target_in_equilibrium_with_state(
    state: ContactState, K: PETSc.Mat, interface: ContactInterface
) -> TargetLoadsAndMotions:
    """Return the target that a state satisfies, with a load vector that includes reactions.

    The load is the stiffness K (n, n) times the displacements, minus the contact forces. It
    therefore includes the reactions of supports, which do no work.
    """
    points = interface.force.createVecRight()
    (force,) = interface.extract_local_pair_state_values(state.pairs, "force_vector")
    points.setArray(np.where(interface.equation >= 0, force, 0.0))
    load = K.createVecLeft()
    K.mult(state.unknowns, load)
    load.axpy(-1.0, interface.force * points)
    return TargetLoadsAndMotions.from_state(state, state.translations, load)


def interpolate_targets(
    start: TargetLoadsAndMotions, end: TargetLoadsAndMotions, fraction: float
) -> TargetLoadsAndMotions:
    """Return the target at a fraction of the straight path from start to end."""
    if fraction == 1:
        return end
    load = None
    if start.load is not None:
        load = start.load.copy()
        load.scale(1 - fraction)
        load.axpy(fraction, end.load)
    return TargetLoadsAndMotions(
        load,
        (1 - fraction) * start.q + fraction * end.q,
        (1 - fraction) * start.forces + fraction * end.forces,
        (1 - fraction) * start.load_factor + fraction * end.load_factor,
    )


@dataclass(frozen=True)
class LinearisedIncrement:
    """Linear system of Newton's method for an active set, without the load.

    Args:
        active: active set.
        kinematics: kinematics at the point of linearisation.
        law: linearised law, without the known motions.
        totals: prescribed forces and torques (free,) of the free motions, less support friction.
        torque_map: map from motions of the surfaces to velocities of the contact nodes.
        springs: stiffness (free,) that support friction adds to the free motions.
        known_q: known parts (m, k) of the motions of each point's surface.
        known_v: known parts (m, p) of the motions of the points.
        point_forces: forces (m, dim) of the points at the point of linearisation.
    """

    active: ActiveSet
    kinematics: LinearisedKinematics
    law: LinearisedContactLaw
    totals: Array
    torque_map: TorqueMap
    springs: Array
    known_q: Array
    known_v: Array
    point_forces: Array


@dataclass(frozen=True)
class NewtonIterate:
    """Iterate of Newton's method: the solution of one linear system with all its residuals.

    Args:
        reduced_unknowns: displacements (n_r,), reduced by the supports.
        unknowns: all unknowns (n,).
        q: motions (pairs, k) of the surfaces.
        displacement: displacements (m, dim) of the contact points, relative to opposite nodes if
            there are any.
        force: forces (m, dim) of the surfaces on the contact points.
        unbalanced: magnitudes (n_r,) of the unbalanced forces in the equations of this process.
        nodes: gaps, slips and forces in the frames of the contact nodes.
        kinematics: kinematics from which gaps and slips were evaluated.
        displacement_size: sums (m, dim) of the magnitudes of the displacements of each point and of
            its opposite nodes.
        allowance: tolerance of all conditions, expressed as a force.
        round_off: part of the allowance that accounts for round-off.
        violation: largest ratio of a residual to its tolerance.
        is_solution: whether all conditions hold and the linear system was solved to the final
            accuracy.
        is_exact: whether solving the linear system again would not improve the accuracy.
        is_final: whether the linear system was solved to the final accuracy.
        step_length: length of the Newton step to this iterate, as a fraction of the full step to
            the linear solution.
    """

    reduced_unknowns: PETSc.Vec
    unknowns: PETSc.Vec
    q: Array
    displacement: Array
    force: Array
    unbalanced: Array
    nodes: ContactNodes
    kinematics: LinearisedKinematics
    displacement_size: Array
    allowance: float
    round_off: float
    violation: float
    is_solution: bool
    is_exact: bool
    is_final: bool
    step_length: float = 1.0
