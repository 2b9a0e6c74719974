"""What a contact computation says instead of a result."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pw_elements.algebra import SingularSystem

if TYPE_CHECKING:
    from pw_elements.contact.state import ContactState


class ContactFailed(RuntimeError):
    """An increment has no state to give: one of the three below.

    Attributes:
        states: of the increments before.
    """

    states: Sequence["ContactState"] = ()


class ContactNotConverged(ContactFailed):
    """No active set satisfies all contact conditions within the iterations allowed."""


class FreeBody(ContactFailed, SingularSystem):
    """A rigid motion is held neither by supports nor by contact: never, or no longer."""


class NotUnique(ContactFailed, SingularSystem):
    """The tangent of the contact problem is singular although no rigid motion is free."""


class DegenerateMesh(ValueError):
    """Cells without volume, turned inside out, or folded over their neighbours."""


def listed(points: npt.NDArray[np.float64], most: int = 6) -> str:
    """Positions (m, dim) as words, in order of their coordinates, round-off left out."""
    points = np.round(points, 12) + 0.0
    points = points[np.lexsort(np.round(points, 9).T[::-1])]
    words = ["(" + ", ".join(f"{c:.4g}" for c in point) + ")" for point in points[:most]]
    more = f" and {len(points) - most} more" if len(points) > most else ""
    return ", ".join(words) + more
