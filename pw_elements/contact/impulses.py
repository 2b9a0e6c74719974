"""The law of contact nodes in a step of explicit dynamics, where masses are diagonal."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NodalContact:
    """Contact in one step, at the points (m) of this process.

    Args:
        pressed: (m,), normal force.
        friction: (m, dim), the rest of the force.
        gap: (m,), at the end of the step.
        normal: (m, dim).
        slip: (m, dim), of the step.
    """

    pressed: Array
    friction: Array
    gap: Array
    normal: Array
    slip: Array

    @property
    def force(self) -> Array:
        """Of the surface on the body, (m, dim)."""
        return self.pressed[:, None] * self.normal + self.friction


def nodal_contact(
    motion: Array,
    gap: Array,
    normal: Array,
    shift: Array,
    held: npt.NDArray[np.bool_],
    mass: Array,
    friction: Array,
    step: float,
) -> NodalContact:
    """The law at points (m): forces by which a step ends with no penetration, and Coulomb's slip.

    Args:
        motion: (m, dim), of the points in the step if there were no contact.
        gap: (m,), at its start, to the surfaces as they are at its end.
        normal: (m, dim), of these.
        shift: (m, dim), of the surfaces in the step.
        held: (m, dim), components that supports prescribe, which friction leaves alone.
        mass: (m,).
        friction: (m,), Coulomb's mu.
        step: of time.
    """
    stiffness = mass / step**2
    reached = gap + np.sum(normal * motion, axis=1)
    pressed = np.where(reached < 0, -stiffness * reached, 0.0)
    slip = np.where(held, 0.0, motion - shift)
    slip = slip - np.sum(slip * normal, axis=1)[:, None] * normal
    sticking = stiffness * np.linalg.norm(slip, axis=1)
    share = np.minimum(1.0, friction * pressed / np.where(sticking > 0, sticking, 1.0))[:, None]
    return NodalContact(
        pressed,
        -share * stiffness[:, None] * slip,
        np.maximum(reached, 0.0),
        normal,
        np.where(share < 1, (1 - share) * slip, 0.0),
    )
