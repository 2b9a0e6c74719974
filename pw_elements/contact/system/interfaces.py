"""Interfaces of the equilibrium of a body, and of the matrix of the contact system."""

from collections.abc import Callable
from typing import Protocol

from petsc4py import PETSc

from pw_elements.arrays import Array
from pw_elements.contact.nodes import LinearisedContactLaw, TorqueMap
from pw_elements.contact.system.assembled import ContactLawRows, CsrArrays
from pw_elements.contact.system.solution import LinearSolveAccuracy, LocalTangentSolution
from pw_elements.solvers import PreparedSolver


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


class ContactTangent(Protocol):
    """The matrix of the contact system and its solver.

    Attributes:
        solves_exactly: whether the accuracy of all solutions is limited by round-off alone.
        solver: prepared solver of the linear systems.
    """

    solves_exactly: bool
    solver: PreparedSolver

    def set_initial_iterate(self, get_unknowns: Callable[[], Array], free_motions: Array) -> None:
        """Set the initial iterate of an iterative solver.

        Args:
            get_unknowns: function that returns the unknowns (n,) of this process.
            free_motions: free motions (free,) of the surfaces.
        """

    def set_free_motion_springs(self, springs: Array) -> None:
        """Set the stiffness (free,) that support friction adds to each free motion."""

    def update_stiffness(
        self, assemble_rows: Callable[[], tuple[ContactLawRows, CsrArrays]], pattern_changed: bool
    ) -> None:
        """Update the matrix after the stiffness has changed.

        Args:
            assemble_rows: function that returns the rows of the contact points and the arrays of
                the whole matrix.
            pattern_changed: whether the sparsity pattern has changed.
        """

    def solve(
        self,
        rhs: Array,
        balance_rhs: Array,
        law: LinearisedContactLaw,
        accuracy: LinearSolveAccuracy,
    ) -> LocalTangentSolution:
        """Solve the linear system with the linearised law of an active set.

        Args:
            rhs: right-hand side (n,) of this process, which may be scaled in place.
            balance_rhs: right-hand side (free,) of the force balances of free motions.
            law: linearised law.
            accuracy: accuracy of the solution, used only by iterative solvers.

        Raises:
            SingularSystem: if there is no unique solution.
            NotConverged: if an iterative solver fails.
        """

    def estimate_determinant_signs(self) -> tuple[int, ...]:
        """Return the signs of determinants, estimated without factors.

        The last sign belongs to the present matrix; the first one is the sign that it should have.
        The result is empty if the solver makes no such estimates.
        """

    def is_constant_pressure_held_by_contact_only(self) -> bool:
        """Return whether a constant pressure in an incompressible body acts on contact points only.

        If it does, the displacements determine the pressure only up to a constant.
        """

    def release(self) -> None:
        """Free the memory of the solver."""
