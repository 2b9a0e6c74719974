"""Exact solutions of steady heat conduction in a graded material.

In the unit square, the conductivity varies with position and temperature u: k = exp(g x) (1 + u).
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class ConductionProblem(Protocol):
    """Conduction problem in the unit square with prescribed temperatures at x = 0 and x = 1."""

    @property
    def growth(self) -> float:
        """Natural logarithm g of the conductivity ratio of x = 1 and x = 0 at equal temperature."""
        ...

    @property
    def is_insulated(self) -> bool:
        """Whether the sides y = 0 and y = 1 are insulated, instead of having known temperatures."""
        ...

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the exact temperatures u (n,) at points with coordinates x (n,) and y (n,)."""
        ...

    def flux(self, y: Array) -> Array:
        """Return the exact inward fluxes k u_x (n,) at the points (1, y) with y (n,)."""
        ...

    def source(self, x: Array, y: Array) -> Array:
        """Return the heat sources Q (n,) divided by exp(g x), at coordinates x (n,) and y (n,)."""
        ...


@dataclass(frozen=True)
class GradedMaterial:
    """Material whose conductivity at a given temperature grows exponentially with x.

    Args:
        conductivity_ratio: Ratio of the conductivities at x = 1 and x = 0 at equal temperature.
    """

    conductivity_ratio: float

    @property
    def growth(self) -> float:
        """Natural logarithm g of the conductivity ratio."""
        return float(np.log(self.conductivity_ratio))


class GradedWallWithInsulatedSides(GradedMaterial):
    """Wall between the surfaces x = 0 and x = 1, without a heat source and with insulated sides.

    With Kirchhoff's variable t = u + u^2 / 2 the equation is div(exp(g x) grad t) = 0. It is solved
    by t = t_0(x) + t_1(x) cos(pi y), where t_0 and t_1 are sums of exponential functions of x.
    """

    is_insulated: ClassVar[bool] = True

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the exact temperatures u (n,), computed from Kirchhoff's variable t."""
        g, s = self.growth, self._cosine_mode_exponent
        mean = 0.25 + 0.5 * np.expm1(-g * x) / np.expm1(-g)
        wave = np.exp(-g * (x - 1) / 2) * np.sinh(s * x) / np.sinh(s)
        return np.asarray(np.sqrt(1 + 2 * (mean + 0.25 * wave * np.cos(np.pi * y))) - 1)

    def flux(self, y: Array) -> Array:
        """Return the exact inward fluxes k u_x (n,) at the points (1, y) with y (n,)."""
        g, s = self.growth, self._cosine_mode_exponent
        mean = 0.5 * g * np.exp(-g) / -np.expm1(-g)
        return np.asarray(np.exp(g) * (mean + 0.25 * np.cos(np.pi * y) * (s / np.tanh(s) - g / 2)))

    def source(self, x: Array, y: Array) -> Array:  # noqa: ARG002
        """Return zeros (n,), because the wall has no heat source."""
        return np.zeros_like(x)

    @property
    def _cosine_mode_exponent(self) -> float:
        return float(np.hypot(np.pi, self.growth / 2))


class GradedSquareWithHeatSource(GradedMaterial):
    """Square whose heat source is such that u = cos(x) exp(y/2) / 2 is the exact temperature.

    This temperature is prescribed on all sides.
    """

    is_insulated: ClassVar[bool] = False

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the exact temperatures u (n,) at points with coordinates x (n,) and y (n,)."""
        return np.asarray(np.cos(x) * np.exp(y / 2) / 2)

    def flux(self, y: Array) -> Array:
        """Return the exact inward fluxes k u_x (n,) at the points (1, y) with y (n,)."""
        half = np.exp(y / 2) / 2
        return np.asarray(-self.conductivity_ratio * (1 + np.cos(1) * half) * np.sin(1) * half)

    def source(self, x: Array, y: Array) -> Array:
        """Return the heat sources Q (n,) divided by exp(g x), at coordinates x (n,) and y (n,)."""
        half = np.exp(y / 2) / 2
        u, u_x, u_y = half * np.cos(x), -half * np.sin(x), half * np.cos(x) / 2
        return np.asarray((1 + u) * (0.75 * u - self.growth * u_x) - (u_x**2 + u_y**2))
