"""Errors of contact computations, and positions in words for their messages."""

from collections.abc import Sequence
from typing import Any

from pw_elements.linear_solver import SingularSystem
from pw_elements.mesh_checks import DegenerateMesh, listed

__all__ = [
    "ContactFailed",
    "ContactNotConverged",
    "DegenerateMesh",
    "FreeBody",
    "NotUnique",
    "listed",
]


class ContactFailed(RuntimeError):
    """An increment has no state: the reason is one of the classes below.

    Attributes:
        states: `ContactState`s of the increments before the one that failed.
    """

    states: Sequence[Any] = ()


class ContactNotConverged(ContactFailed):
    """No active set satisfies all contact conditions within the iterations allowed."""


class FreeBody(ContactFailed, SingularSystem):
    """A rigid motion is held neither by supports nor by contact: never, or no longer."""


class NotUnique(ContactFailed, SingularSystem):
    """The tangent of the contact problem is singular although no rigid motion is free."""


class SurfacePassed(ContactFailed):
    """A rigid surface has gone through the body, or pushes it outwards."""
