"""Errors of contact computations, and descriptions for their messages."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.contact.model.state import ContactState
from pw_elements.solvers import SingularSystem

# Fraction of the largest friction from which on friction counts as exhausted after a failure
_EXHAUSTED_FRACTION = 0.9


@dataclass(frozen=True)
class RigidVelocity:
    """Rigid velocity of each connected piece of the body, and of the surfaces that are free.

    The velocity of a node at x of piece k is translation[k] + rotation[k] × (x - centre[k]); in the
    plane the rotation has one component w, and w × (x, y) is (-w y, w x). The velocity is scaled so
    that the largest of all translations, and of rotations times the radius of gyration of their
    piece, is one.

    Args:
        centre: (pieces, dim), mean position of a piece's nodes, by which pieces are sorted.
        translation: (pieces, dim), velocities of the centres.
        rotation: (pieces, 1) in the plane, (pieces, 3) in space, angular velocities.
        surface: (pairs, dim), velocities of surfaces; zero for prescribed translations.
        power: of the loads and of the forces on the free surfaces, positive.
    """

    centre: Array
    translation: Array
    rotation: Array
    surface: Array
    power: float


@dataclass(frozen=True)
class MissingForce:
    """Smallest addition to the loads that makes equilibrium possible.

    It has the smallest sum of the magnitudes of all components, where moments are divided by the
    radius of gyration of their piece. Components that supports balance are zero.

    Args:
        force: (pieces, dim), on each connected piece.
        moment: (pieces, 1) in the plane, (pieces, 3) in space, on each piece about its
            `RigidVelocity.centre`.
        surface: (pairs, dim), force on each free surface.
    """

    force: Array
    moment: Array
    surface: Array


class ContactFailed(RuntimeError):
    """No state was computed for an increment; derived classes tell the reason.

    Attributes:
        states: states of the increments before the failed one.
        state: the iterate of the failed increment that is nearest to a solution, or None. It is not
            a solution (`converged` is False, and `residuals` tell by how much), but shows where the
            iteration failed.
        last_substate: load factor and state at the end of the last substep that was solved, or
            None. The state is a solution from which other increments can start.
    """

    states: Sequence[ContactState] = ()
    state: ContactState | None = None
    last_substate: tuple[float, ContactState] | None = None


class FreeBody(ContactFailed, SingularSystem):
    """A rigid motion is prevented neither by supports nor by contact, even if all nodes stuck."""


class NoEquilibrium(FreeBody):
    """No contact forces that the law admits balance the loads, as statics prove.

    Attributes:
        velocity: rigid velocity on which the loads do work that no admissible force takes up.
        missing: smallest addition to the loads that makes equilibrium possible.
    """

    velocity: RigidVelocity
    missing: MissingForce


class NotUnique(ContactFailed, SingularSystem):
    """The tangent is singular at a solution, which is not unique: by friction or a loose body."""


class NotFound(ContactFailed):
    """The iteration found no solution; it is not known whether there is one."""

    @classmethod
    def with_positions(cls, message: str, positions: Array) -> "NotFound":
        """Create the error with positions in its message.

        Args:
            message: with one {}, which the positions replace.
            positions: (k, dim), undeformed.
        """
        return cls(message.format(format_points(positions)))


class Cycling(NotFound):
    """The iteration repeats active sets, none of which gives a solution."""


class LastContactLost(NotFound):
    """The next active set would release a body or surface that only contact holds."""


def describe_exhausted_friction(state: ContactState) -> str:
    """Return a message on the pairs of a state whose friction is exhausted, empty if none is."""
    words = []
    for k, pair in enumerate(state.pairs):
        capacity = pair.friction_capacity
        carried = float(np.linalg.norm(pair.force_tangential, axis=1).sum())
        if capacity > 0 and carried >= _EXHAUSTED_FRACTION * capacity:
            words.append(
                f"Friction of contact pair {k} is exhausted: with normal forces whose sum is "
                f"{pair.force_normal.sum():.4g}, its nodes carry {carried:.4g} of at most "
                f"{capacity:.4g} along the surface. A larger friction force needs a larger "
                "coefficient or larger normal forces; smaller increments do not help"
            )
    return ". ".join(words)


class SurfacePassed(ContactFailed):
    """A rigid surface has passed through the body, or pushes it outwards."""
