"""Partial slip of a parabola on a half plane: Cattaneo's and Mindlin's solution."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Cattaneo:
    """Contact of equal bodies, or on a half plane with nu = 1/2, under normal force and shear.

    Pressure and shear do not influence each other. C. Cattaneo (1938), R. D. Mindlin (1949), in
    K. L. Johnson, "Contact Mechanics" (1985).

    Args:
        half_width: a, of the contact.
        force: P, per length.
        friction: mu.
        share: Q/(mu P), of the friction that the tangential force uses up.
    """

    half_width: float
    force: float
    friction: float
    share: float

    @property
    def stick(self) -> float:
        """Half width c = a sqrt(1 - Q/(mu P)) of the zone that sticks."""
        return float(self.half_width * np.sqrt(1 - self.share))

    @property
    def peak(self) -> float:
        """Pressure p0 = 2 P/(pi a) in the middle."""
        return 2 * self.force / (np.pi * self.half_width)

    def pressure(self, x: Array) -> Array:
        """Return p0 sqrt(1 - x²/a²)."""
        return self.peak * _semi_ellipse(x / self.half_width)

    def shear(self, x: Array) -> Array:
        """Return mu p, less mu p0 c/a sqrt(1 - x²/c²) where the contact sticks."""
        ratio = self.stick / self.half_width
        sticking = ratio * self.peak * _semi_ellipse(x / self.stick)
        return self.friction * (self.pressure(x) - sticking)


def _semi_ellipse(s: npt.NDArray[np.floating]) -> Array:
    return np.asarray(np.sqrt(np.maximum(0.0, 1 - s**2)))
