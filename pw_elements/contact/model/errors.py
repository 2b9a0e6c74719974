"""Errors of contact computations, and descriptions of states for their messages."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.contact.model.state import ContactState
from pw_elements.solvers import NotConverged, SingularSystem

# Smallest ratio of the friction in a failed increment to its limit at which friction counts as
# exhausted
_EXHAUSTED_FRACTION_OF_FRICTION_LIMIT = 0.9


@dataclass(frozen=True)
class RigidVelocity:
    """Rigid velocity of each connected piece of the body, and of each surface that is free to move.

    The velocity of a node at x of piece k is translation[k] + rotation[k] × (x - centre[k]); in the
    plane the rotation has one component w, and w × (x, y) is (-w y, w x). The velocity is scaled so
    that the largest of all translations, and of rotations times the radius of gyration of their
    piece, is one.

    Args:
        centre: (pieces, dim), mean position of the nodes of each piece. The pieces are sorted by
            this position.
        translation: (pieces, dim), velocities of the centres.
        rotation: (pieces, 1) in the plane, (pieces, 3) in space, angular velocities.
        surface: (pairs, dim), velocities of surfaces; zero for prescribed translations.
        power: power of the loads and of the forces on the free surfaces at this velocity; it is
            positive.
    """

    centre: Array
    translation: Array
    rotation: Array
    surface: Array
    power: float


@dataclass(frozen=True)
class LoadMissingForEquilibrium:
    """Smallest addition to the loads that makes equilibrium possible.

    It minimises the sum of the magnitudes of all components, in which moments are divided by the
    radius of gyration of their piece. Components that supports can balance are zero.

    Args:
        force: (pieces, dim), force on each connected piece of the body.
        moment: (pieces, 1) in the plane, (pieces, 3) in space, moment on each piece about the
            piece's `RigidVelocity.centre`.
        surface: (pairs, dim), force on each surface that is free to move.
    """

    force: Array
    moment: Array
    surface: Array


class ContactFailed(RuntimeError):
    """No state has been found for an increment. Derived classes give the reason.

    Attributes:
        states: states at the ends of the preceding increments, if `solve_contact` has failed.
        state: the iterate of the failed increment that is nearest to a solution, or None. It shows
            where the iteration failed, but is not a solution: its `converged` is False, and its
            `residuals` show how large the errors are.
        last_substate: fraction of the increment and state at the end of the last substep that was
            solved, or None if there is none. The state is a solution from which other increments
            can start.
    """

    states: Sequence[ContactState] = ()
    state: ContactState | None = None
    last_substate: tuple[float, ContactState] | None = None

    @classmethod
    def with_positions(cls, message: str, positions: Array) -> Self:
        """Return the error with positions of nodes in its message.

        Args:
            message: text with one placeholder {} for the positions.
            positions: (k, dim), undeformed positions of the nodes.
        """
        return cls(message.format(format_points(positions)))


class FreeBody(ContactFailed, SingularSystem):
    """A rigid motion would be free even if all contact nodes were closed and sticking.

    Neither supports nor contact prevent this motion.
    """


class NoEquilibrium(FreeBody):
    """Statics proves that no admissible contact forces balance the loads.

    Contact forces are admissible if they push, and if their friction is within its limit.

    Attributes:
        velocity: rigid velocity at which the power of the loads is positive and cannot be balanced
            by any admissible contact forces.
        missing: smallest addition to the loads that makes equilibrium possible.
    """

    velocity: RigidVelocity
    missing: LoadMissingForEquilibrium


class NotUnique(ContactFailed, SingularSystem):
    """The tangent stiffness is singular at a solution, so the solution is not unique.

    The cause is either large friction or a loose body.
    """


class SolutionNotFound(ContactFailed):
    """The iteration found no solution. It is not known whether a solution exists."""


class ActiveSetCycling(SolutionNotFound):
    """The iteration repeats a sequence of active sets, none of which gives a solution."""


class LinearSolverFailed(SolutionNotFound, NotConverged):
    """The iteration ended because the linear solver did not reach its tolerance."""


class LastContactLost(SolutionNotFound):
    """The next active set would release a body or a surface that only contact holds in place."""


def describe_exhausted_friction(
    failed_state: ContactState, start_state: ContactState | None = None
) -> str:
    """Return a message about all pairs of a state whose friction is exhausted.

    The message is empty if there is no such pair. In a state that is not a solution, normal forces
    grow with the load that friction cannot carry, so that the limit of friction would be too high.
    The message therefore states the limit at the start of the increment, unless that exceeds the
    friction in the failed state or the pair bore no force.

    Args:
        failed_state: the last state found, in which friction is exhausted.
        start_state: state at the start of the increment, if `failed_state` is not a solution.
    """
    words = []
    for k, pair in enumerate(failed_state.pairs):
        carried = float(np.linalg.norm(pair.force_tangential, axis=1).sum())
        capacity = pair.friction_capacity
        if not (capacity > 0 and carried >= _EXHAUSTED_FRACTION_OF_FRICTION_LIMIT * capacity):
            continue
        verb, when, normal_forces = "carry", "", pair.force_normal
        if start_state is not None:
            verb, when = "would have to carry", " in the nearest state"
            start_pair = start_state.pairs[k]
            if 0 < start_pair.friction_capacity <= carried:
                when, normal_forces = " at the start of the increment", start_pair.force_normal
                capacity = start_pair.friction_capacity
        words.append(
            f"Friction of contact pair {k} is exhausted: its nodes {verb} {carried:.4g} of at most "
            f"{capacity:.4g} along the surface, with normal forces whose sum is "
            f"{normal_forces.sum():.4g}{when}. A larger friction force needs a larger "
            "coefficient or larger normal forces; smaller increments do not help"
        )
    return ". ".join(words)


class SurfacePassed(ContactFailed):
    """A rigid surface passes through the body, or pushes the boundary of the body outwards.

    The error is also raised if the supports of two bodies meet or pass each other.
    """
