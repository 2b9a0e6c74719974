"""Errors of contact computations, and positions in words for their messages."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pw_elements.linear_solver import SingularSystem


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


class DegenerateMesh(ValueError):
    """Cells without volume, turned inside out, or folded over their neighbours."""


def listed(points: npt.NDArray[np.float64], most: int = 6) -> str:
    """Positions (m, dim) as words, in order of their coordinates, round-off left out."""
    points = np.round(points, 12) + 0.0
    points = points[np.lexsort(np.round(points, 9).T[::-1])]
    words = ["(" + ", ".join(f"{c:.4g}" for c in point) + ")" for point in points[:most]]
    more = f" and {len(points) - most} more" if len(points) > most else ""
    return ", ".join(words) + more
