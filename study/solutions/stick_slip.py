"""Contact problems with friction whose answers are known: the known numbers and formulas."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# NAFEMS CGS-4, sliding wedge: slope, weight and pushing force in N, and for each mu the
# stiffness in N/m of the springs that let it slide by 1 m
WEDGE_SLOPE, WEDGE_WEIGHT, WEDGE_PUSH = 0.1, 3058.0, 1500.0
WEDGE_SPRINGS = {0.0: 1194.0, 0.1: 882.0, 0.2: 563.9}
WEDGE_SLIDING = 1.0


def wedge_ratio(slope: float, friction: float) -> float:
    """F/G at which a weight G on an incline begins to slide up under a horizontal force F."""
    return (slope + friction) / (1 - friction * slope)


@dataclass(frozen=True)
class Cattaneo:
    """Parabola on a half plane of equal bodies or nu = 1/2: normal and tangential part apart.

    C. Cattaneo (1938), R. D. Mindlin (1949), in K. L. Johnson, "Contact Mechanics" (1985).

    Args:
        half_width: a, of the contact.
        force: P, per length.
        friction: mu.
        share: Q / (mu P), of the friction that the tangential force uses up.
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
        """p0 = 2 P/(pi a)."""
        return 2 * self.force / (np.pi * self.half_width)

    def pressure(self, x: Array) -> Array:
        """p0 sqrt(1 - x²/a²)."""
        return self.peak * _ellipse(x / self.half_width)

    def shear(self, x: Array) -> Array:
        """The slipping mu p less mu p0 c/a sqrt(1 - x²/c²) where it sticks."""
        ratio = self.stick / self.half_width
        held = ratio * self.peak * _ellipse(x / self.stick)
        return self.friction * (self.pressure(x) - held)


def _ellipse(s: npt.NDArray[np.floating]) -> Array:
    return np.asarray(np.sqrt(np.maximum(0.0, 1 - s**2)))
