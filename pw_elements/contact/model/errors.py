"""Errors of contact computations, and positions in words for their messages."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.contact.model.state import ContactState
from pw_elements.solvers import SingularSystem

# Part of the largest friction that counts as all of it, next to a failure
_USED_UP = 0.9


@dataclass(frozen=True)
class RigidVelocity:
    """A rigid motion of each connected piece, and of the surfaces that are free to move.

    A node at x of piece k moves with translation[k] + rotation[k] × (x - centre[k]); in the plane
    rotation has one component, w, and w × (x, y) is (-w y, w x). The motion's size is arbitrary: of
    all translations, and rotations times the piece's radius of gyration, the largest is one.

    Args:
        centre: (pieces, dim), mean position of a piece's nodes; pieces are sorted by it.
        translation: (pieces, dim).
        rotation: (pieces, 1) in the plane, (pieces, 3) in space.
        surface: (pairs, dim), zero where a surface's translation is prescribed.
        power: of the loads and of the forces on the free surfaces, positive.
    """

    centre: Array
    translation: Array
    rotation: Array
    surface: Array
    power: float


@dataclass(frozen=True)
class MissingForce:
    """The least addition to the loads that makes equilibrium possible.

    The least is that with the smallest sum of the components' magnitudes, moments being divided by
    the piece's radius of gyration. Components that supports balance are zero.

    Args:
        force: (pieces, dim), on each connected piece.
        moment: (pieces, 1) in the plane, (pieces, 3) in space, about its `RigidVelocity.centre`.
        surface: (pairs, dim), on each free surface.
    """

    force: Array
    moment: Array
    surface: Array


class ContactFailed(RuntimeError):
    """An increment has no state; a class derived from this one says why.

    Attributes:
        states: `ContactState`s of the increments before the one that failed.
        state: the `ContactState` of this increment that came nearest to a solution, or None. It
            is not a solution (`converged` is False; its residuals say by how much), but shows where
            the iteration got stuck.
        reached: the largest share of this increment that was solved in parts, and the state there,
            or None. It is a solution, from which other increments can go on.
    """

    states: Sequence[ContactState] = ()
    state: ContactState | None = None
    reached: tuple[float, ContactState] | None = None


class FreeBody(ContactFailed, SingularSystem):
    """A rigid motion is held neither by supports nor by contact, even if every node stuck."""


class NoEquilibrium(FreeBody):
    """No contact forces that the law allows balance the loads: statics prove it.

    Attributes:
        velocity: `RigidVelocity` that no such force can brake, while the loads do work on it.
        missing: `MissingForce`, the least that would have to be added to the loads.
    """

    velocity: RigidVelocity
    missing: MissingForce


class NotUnique(ContactFailed, SingularSystem):
    """The tangent is singular at a solution: it is not unique, by friction or a loose body."""


class NotFound(ContactFailed):
    """The iteration found no solution; whether there is one is not known."""

    @classmethod
    def at(cls, words: str, places: Array) -> "NotFound":
        """With the coordinates of places (k, dim) for {} in the words.

        Args:
            words: with one {}.
            places: (k, dim), undeformed.
        """
        return cls(words.format(format_points(places)))


class Cycling(NotFound):
    """Active sets come back, and the law holds in none of them."""


class LostHold(NotFound):
    """A body or surface that contact alone holds would be let go."""


def exhausted_friction(state: ContactState) -> str:
    """Words that name the capacity of pairs whose friction is used up; none where it is not."""
    words = []
    for k, pair in enumerate(state.pairs):
        capacity = pair.friction_capacity
        carried = float(np.linalg.norm(pair.force_tangential, axis=1).sum())
        if capacity > 0 and carried >= _USED_UP * capacity:
            words.append(
                f"Friction of contact pair {k} is used up: beside the normal forces found, whose "
                f"sum is {pair.force_normal.sum():.4g}, its nodes carry {carried:.4g} of at most "
                f"{capacity:.4g} along the surface. More needs a larger coefficient or larger "
                "normal forces; smaller increments do not help"
            )
    return ". ".join(words)


class SurfacePassed(ContactFailed):
    """A rigid surface has gone through the body, or pushes it outwards."""
