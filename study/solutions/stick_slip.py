"""Exact partial slip in a plane Hertz contact: solution of Cattaneo and Mindlin."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from study.solutions.half_space import ElasticHalfSpace

Array = npt.NDArray[np.float64]

_N_SOURCES = 64
"""Number of line forces that represent an elliptic traction."""


@dataclass(frozen=True)
class CattaneoPartialSlip:
    """Plane Hertz contact under a normal and then a tangential force below the friction limit.

    The bodies are equal, or one is rigid and the other has nu = 1/2, so that pressure and shear do
    not influence each other. Sources: C. Cattaneo (1938), R. D. Mindlin (1949), in K. L. Johnson,
    "Contact Mechanics" (1985).

    Args:
        half_width: Half width a of the contact.
        force: Normal force P per length.
        friction: Coefficient of friction mu.
        friction_utilisation: Tangential force divided by the friction limit, Q/(mu P).
    """

    half_width: float
    force: float
    friction: float
    friction_utilisation: float

    @property
    def stick_half_width(self) -> float:
        """Half width c = a sqrt(1 - Q/(mu P)) of the sticking zone."""
        return float(self.half_width * np.sqrt(1 - self.friction_utilisation))

    @property
    def peak_pressure(self) -> float:
        """Peak pressure p0 = 2 P/(pi a) in the middle of the contact."""
        return 2 * self.force / (np.pi * self.half_width)

    def pressure(self, x: Array) -> Array:
        """Return the pressure p0 sqrt(1 - x²/a²) at positions x (m,)."""
        return self.peak_pressure * _semi_elliptic_profile(x / self.half_width)

    def shear(self, x: Array) -> Array:
        """Return the shear traction mu p, reduced by mu p0 c/a sqrt(1 - x²/c²) for |x| < c."""
        ratio = self.stick_half_width / self.half_width
        sticking = ratio * self.peak_pressure * _semi_elliptic_profile(x / self.stick_half_width)
        return self.friction * (self.pressure(x) - sticking)

    def displacement(self, body: ElasticHalfSpace, x: Array) -> Array:
        """Return displacements (n, 2) of the lower half plane under pressure and shear.

        Args:
            body: Half plane.
            x: Points (n, 2) at least two half widths from the middle of the contact.
        """
        theta = np.arange(1, _N_SOURCES + 1) * np.pi / (_N_SOURCES + 1)
        s, weight = np.cos(theta), 2 / (_N_SOURCES + 1) * np.sin(theta) ** 2
        normal, zero = self.force * weight, np.zeros(_N_SOURCES)
        shear = self.friction * normal if self.friction_utilisation else zero
        field = body.displacement_by_line_forces(x, self.half_width * s, normal, shear)
        if self.friction_utilisation:
            sticking = (1 - self.friction_utilisation) * self.friction * normal
            field = field - body.displacement_by_line_forces(
                x, self.stick_half_width * s, zero, sticking
            )
        return np.asarray(field, dtype=np.float64)


def _semi_elliptic_profile(s: npt.NDArray[np.floating]) -> Array:
    return np.asarray(np.sqrt(np.maximum(0.0, 1 - s**2)))
