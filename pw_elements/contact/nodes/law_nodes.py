"""Contact nodes with an interface law, whose equations are r - R(gap, slip, r) = 0.

The module guarantees that the equations of all other nodes are those of `ContactNodes`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import ContactInterface
from pw_elements.contact.model import InterfaceLawEvaluation, InterfaceResponse, SolutionNotFound
from pw_elements.contact.nodes.nodes import (
    MIN_KEPT_FRICTION_WEIGHT,
    OPEN,
    STICK,
    ActiveSet,
    ContactNodes,
    LinearisedInterfaceLaw,
)

# Largest entry of a row of 1 - dR/dr at which the law imposes a gap and leaves the force open
_MAX_FORCE_COEFFICIENT_OF_IMPOSED_GAP = 1e-8


@dataclass(frozen=True)
class InterfaceLawNodes(ContactNodes):
    """Contact nodes, some of which have an interface law.

    Args:
        at_law: (m,), mask of the nodes at which a law has been evaluated.
        response: responses of the laws at the m nodes, with the new history (m, n_history).
        is_shared: (m,), mask of the points whose node belongs to several pairs.
    """

    at_law: Mask
    response: InterfaceResponse
    is_shared: Mask

    @classmethod
    def from_nodes(
        cls,
        nodes: ContactNodes,
        laws: InterfaceLawEvaluation,
        start_history: Array,
        is_shared: Mask,
    ) -> "InterfaceLawNodes":
        """Return nodes at which the interface laws have been evaluated.

        Args:
            nodes: gaps, slips and forces of the nodes.
            laws: interface laws.
            start_history: (m, n_history), history at the start of the increment.
            is_shared: (m,), mask of the points whose node belongs to several pairs.
        """
        at_law, response = laws.evaluate(
            nodes.frame, nodes.gap, nodes.slip, nodes.force, start_history, nodes.scale
        )
        values = {field.name: getattr(nodes, field.name) for field in fields(ContactNodes)}
        return cls(**values, at_law=at_law, response=response, is_shared=is_shared)

    @cached_property
    def trial_pressure(self) -> Array:
        """Trial pressures (m,); at nodes with a law, the normal forces."""
        trial = self.force[:, 0] - self.scale * self.gap
        return np.where(self.at_law, self.force[:, 0], trial)

    def _determine_active_set(self, previous_friction_direction: Array) -> ActiveSet:
        active = super()._determine_active_set(previous_friction_direction)
        at_law, response = self.at_law, self.response
        has_force = response.force.any(axis=1)
        status = np.where(at_law, np.where(has_force, STICK, OPEN), active.status)
        numbers = {
            name: np.where(at_law.reshape(-1, *[1] * (values.ndim - 1)), 0.0, values)
            for name, values in vars(active).items()
            if name not in ("status", "interface_law")
        }
        motion = np.concatenate([self.gap[:, None], self.slip], axis=1)
        motion = np.where(at_law[:, None], motion, 0.0)
        # at nodes in several pairs, the force in the law is (1 - w) r + w R_0: see theory.md
        weight = np.where(self.is_shared, MIN_KEPT_FRICTION_WEIGHT, 0.0)[:, None]
        intercept = (
            response.force
            - np.einsum("nab,nb->na", response.by_motion, motion)
            - np.einsum("nab,nb->na", response.by_force, self.force - weight * response.force)
        )
        law = LinearisedInterfaceLaw(
            at_law,
            np.where(at_law[:, None], intercept, 0.0),
            response.by_motion,
            (1 - weight[:, :, None]) * response.by_force,
        )
        return replace(active, status=status.astype(np.int8), interface_law=law, **numbers)

    def updated_law_history(self, start_history: Array) -> Array:  # noqa: ARG002
        """Return the history (m, n_history) of interface laws at the end of the increment."""
        return self.response.history

    def find_touching_points(self, force_tolerance: float) -> Mask:
        """Return a mask (m,) of the points at which a surface touches, or a law imposes the gap.

        The argument is that of `ContactNodes.find_touching_points`.
        """
        coefficients = np.eye(self.frame.shape[1])[0] - self.response.by_force[:, 0]
        imposes_gap = np.abs(coefficients).max(axis=1) <= _MAX_FORCE_COEFFICIENT_OF_IMPOSED_GAP
        return np.where(self.at_law, imposes_gap, super().find_touching_points(force_tolerance))

    def law_violation(self) -> Array:
        """Return the violation (m, dim) of the contact and interface laws as forces."""
        violation = self.force - self.response.force
        return np.where(self.at_law[:, None], violation, super().law_violation())

    def relative_residuals(
        self, reference_force: float, reference_length: Array | float
    ) -> dict[str, Array]:
        """Return the relative violations (m,) of all conditions, by fields of `Residuals`.

        The arguments are those of `ContactNodes.relative_residuals`.
        """
        residuals = super().relative_residuals(reference_force, reference_length)
        residuals = {name: np.where(self.at_law, 0.0, values) for name, values in residuals.items()}
        violation = np.linalg.norm(self.force - self.response.force, axis=1)
        violation /= stiffness_ratio(self.response, self.scale)
        return residuals | {"law": np.where(self.at_law, violation, 0.0) / reference_force}


def stiffness_ratio(response: InterfaceResponse, law_scale: Array) -> Array:
    """Return factors (m,) >= 1 by which violations of interface laws are divided.

    The force of a stiff law is known to the round-off of lengths times its stiffness. The factor is
    the stiffness of the law divided by `law_scale` (m,), a stiffness of the body.
    """
    stiffness = np.abs(response.by_motion).max(axis=(1, 2), initial=0.0)
    return np.asarray(np.maximum(1.0, stiffness / law_scale))


def evaluate_laws_that_hold_free_surfaces(
    interface: ContactInterface,
    evaluate_contact_nodes: Callable[[Array], ContactNodes],
    q: Array,
    force: Array,
    active: ActiveSet,
    start_history: Array,
    first_step: float,
) -> InterfaceLawNodes:
    """Return nodes at which the laws are linearised first, such that they hold free surfaces.

    The force balance of a free surface has no unknown where its laws have no stiffness, for example
    if wear has opened all nodes. Such surfaces are therefore moved along their forces, by steps
    that double, until the law of a node resists. The call is collective.

    Args:
        interface: contact points of all pairs.
        evaluate_contact_nodes: function that returns the contact nodes for the motions (pairs, k)
            of the surfaces.
        q: motions (pairs, k) of the surfaces at the initial iterate.
        force: prescribed forces (pairs, k) of the free translations, zero for all other motions.
        active: active set at nodes without a law.
        start_history: (m, n_history), history at the start of the increment.
        first_step: length of the first step.

    Raises:
        SolutionNotFound: if the force of a free surface presses it on no node.
    """
    laws = interface.laws
    assert laws is not None, "the caller has tested it"
    size = np.linalg.norm(force, axis=1, keepdims=True)
    direction = np.divide(force, size, out=np.zeros_like(force), where=size > 0)
    gap = evaluate_contact_nodes(q).gap
    largest_gap = float(np.abs(gap[np.isfinite(gap)]).max(initial=0.0))
    max_step = interface.max_extent_of_points + interface.comm.allreduce(largest_gap, MPI.MAX)
    step = first_step
    while True:
        nodes = InterfaceLawNodes.from_nodes(
            evaluate_contact_nodes(q), laws, start_history, interface.shared_nodes.is_shared
        )
        laws.raise_kept_error()
        resists = np.where(
            nodes.at_law, nodes.response.by_motion.any(axis=(1, 2)), active.status != OPEN
        )
        n_resisting = np.bincount(interface.pair[resists], minlength=interface.pairs)
        interface.comm.Allreduce(MPI.IN_PLACE, n_resisting, MPI.SUM)
        is_loose = (n_resisting == 0) & (size[:, 0] > 0)
        if not is_loose.any():
            return nodes
        if step > max_step:
            raise SolutionNotFound(
                f"the surface of contact pair {int(np.argmax(is_loose))} is free to move, and its "
                "force presses it on no node: let the force point to the body, or prescribe the "
                "motion"
            )
        q = q + np.where(is_loose[:, None], step * direction, 0.0)
        step *= 2
