"""Interface of the equilibrium of a body with its contact forces."""

from typing import Protocol

from petsc4py import PETSc

from pw_elements.arrays import Array
from pw_elements.contact.nodes import TorqueMap


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
