"""Equilibrium of a body with its contact forces, and its linear form at small strains."""

from dataclasses import dataclass, replace
from typing import Protocol

from petsc4py import PETSc

from pw_elements.algebra import reduce_load_and_update_offset
from pw_elements.arrays import Array
from pw_elements.contact.nodes import MAX_CONTACT_VIOLATION_PER_NODAL_FORCE, TorqueMap
from pw_elements.contact.system.system import ContactSystem

# Round-off in the product of stiffness K and displacements a, relative to |K| |a|
RELATIVE_DISPLACEMENT_ROUND_OFF = 1e-13


class Equilibrium(Protocol):
    """Equilibrium of a body with its contact forces r, linearised as K a = f + H r.

    Here K is the tangent, a are the displacements and f is the load. H is the force operator, which
    distributes the contact forces to the equations of equilibrium.

    Attributes:
        prescribed_displacements: prescribed displacements (n,) at the end of the increment, zero
            elsewhere.
        requires_accurate_last_linear_solve: whether the last linear system has to be solved to the
            final accuracy. This is not necessary if forces are evaluated from the displacements.
    """

    @property
    def prescribed_displacements(self) -> PETSc.Vec: ...

    @property
    def requires_accurate_last_linear_solve(self) -> bool: ...

    def linearise_and_return_load(self, torque_map: TorqueMap) -> PETSc.Vec:
        """Linearise at the current iterate and return the load (n_r,), reduced by the supports.

        A new tangent is passed to the contact system together with the torque map.
        """

    def move_towards_and_return_step_length(
        self, reduced_unknowns: PETSc.Vec, max_step_length: float = 1.0
    ) -> float:
        """Move from the last linearisation point towards a linear solution; return the step length.

        Args:
            reduced_unknowns: linear solution (n_r,), reduced by the supports. A step of length 1
                leads to it.
            max_step_length: largest length of the step.
        """

    def residual_without_contact(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:
        """Return the reduced residual (n_r,), which has to be balanced by contact forces alone.

        `reduced_unknowns` are the displacements (n_r,), reduced by the supports.
        """

    def all_unknowns(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:
        """Return all unknowns (n,) for the unknowns (n_r,) that the supports leave free."""

    def max_imbalance_to_tolerance_ratio(
        self,
        unbalanced_magnitudes: Array,
        tolerance_from_contact_forces: float,
        unknowns: PETSc.Vec,
    ) -> float:
        """Return the largest ratio of an unbalanced force to its tolerance on this process.

        Args:
            unbalanced_magnitudes: magnitudes (n_r,) of the unbalanced forces in the equations
                of this process.
            tolerance_from_contact_forces: part of the tolerance that is derived from the contact
                forces; it is a force.
            unknowns: all unknowns (n,).
        """


@dataclass(frozen=True)
class LinearEquilibrium:
    """Equilibrium of a body at small strains, reduced by its supports.

    Args:
        stiffness: reduced stiffness (n_r, n_r), the constant tangent.
        load: reduced load (n_r,).
        right: matrix (n, n_r) that expands reduced displacements to all unknowns.
        prescribed_displacements: prescribed displacements (n,), which are added to the expanded
            displacements.
        max_row_sum: largest absolute row sum of the full stiffness.
    """

    stiffness: PETSc.Mat
    load: PETSc.Vec
    right: PETSc.Mat
    prescribed_displacements: PETSc.Vec
    max_row_sum: float = 0.0

    requires_accurate_last_linear_solve = True

    @classmethod
    def from_stiffness(
        cls,
        system: ContactSystem,
        K: PETSc.Mat,
        load: PETSc.Vec,
        prescribed_displacement_factor: float = 1.0,
    ) -> "LinearEquilibrium":
        """Return the equilibrium under a load, reduced by the supports.

        Args:
            system: contact system, which contains the reduction by the supports.
            K: stiffness (n, n).
            load: load vector (n,).
            prescribed_displacement_factor: factor of the prescribed displacements.
        """
        reduction = system.reduction
        if prescribed_displacement_factor != 1:
            reduction = replace(reduction, offset=prescribed_displacement_factor * reduction.offset)
        reduction, reduced_load = reduce_load_and_update_offset(reduction, K, load)
        max_row_sum = K.norm(PETSc.NormType.INFINITY)
        return cls(system.stiffness, reduced_load, reduction.right, reduction.offset, max_row_sum)

    def linearise_and_return_load(self, torque_map: TorqueMap) -> PETSc.Vec:  # noqa: ARG002
        return self.load

    def move_towards_and_return_step_length(
        self,
        reduced_unknowns: PETSc.Vec,  # noqa: ARG002
        max_step_length: float = 1.0,  # noqa: ARG002
    ) -> float:
        return 1.0

    def max_imbalance_to_tolerance_ratio(
        self,
        unbalanced_magnitudes: Array,
        tolerance_from_contact_forces: float,
        unknowns: PETSc.Vec,
    ) -> float:
        load, displacement = (v.norm(PETSc.NormType.INFINITY) for v in (self.load, unknowns))
        round_off = RELATIVE_DISPLACEMENT_ROUND_OFF * self.max_row_sum * displacement
        allowed = (
            tolerance_from_contact_forces + MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * load + round_off
        )
        max_unbalanced = float(unbalanced_magnitudes.max(initial=0.0))
        return max_unbalanced / allowed if max_unbalanced else 0.0

    def residual_without_contact(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:
        residual = self.load.duplicate()
        self.stiffness.mult(reduced_unknowns, residual)
        residual.axpy(-1.0, self.load)
        return residual

    def all_unknowns(self, reduced_unknowns: PETSc.Vec) -> PETSc.Vec:
        unknowns = self.prescribed_displacements.duplicate()
        self.right.multAdd(reduced_unknowns, self.prescribed_displacements, unknowns)
        return unknowns
