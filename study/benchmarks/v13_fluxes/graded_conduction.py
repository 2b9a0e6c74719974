"""Exact solutions of steady heat conduction in a graded material.

The conductivity of a unit square varies with position and temperature, k = exp(g x) (1 + u).
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class ConductionProblem(Protocol):
    """Conduction in the unit square with prescribed temperatures at x = 0 and x = 1."""

    @property
    def growth(self) -> float:
        """Logarithm g of the conductivity at x = 1 over that at x = 0, at equal temperatures."""
        ...

    @property
    def is_insulated(self) -> bool:
        """Whether the sides y = 0 and y = 1 are insulated; otherwise temperatures are prescribed."""
        ...

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the exact temperature u."""
        ...

    def flux(self, y: Array) -> Array:
        """Return the exact flux k u_x that enters at x = 1."""
        ...

    def source(self, x: Array, y: Array) -> Array:
        """Return the heat source Q over exp(g x)."""
        ...


@dataclass(frozen=True)
class GradedMaterial:
    """Material whose conductivity grows exponentially with x.

    Args:
        ratio: Conductivity at x = 1 over that at x = 0, at equal temperatures.
    """

    ratio: float

    @property
    def growth(self) -> float:
        """Logarithm g of the ratio."""
        return float(np.log(self.ratio))


class GradedWall(GradedMaterial):
    """A wall without a heat source, between the surfaces x = 0 and 1; y = 0 and 1 are insulated.

    With Kirchhoff's t = u + u^2 / 2 the equation is div(exp(g x) grad t) = 0, which
    t = t_0(x) + t_1(x) cos(pi y) solves with exponentials t_0 and t_1.
    """

    is_insulated: ClassVar[bool] = True

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the exact temperature u from Kirchhoff's t."""
        g, s = self.growth, self._decay_rate
        mean = 0.25 + 0.5 * np.expm1(-g * x) / np.expm1(-g)
        wave = np.exp(-g * (x - 1) / 2) * np.sinh(s * x) / np.sinh(s)
        return np.asarray(np.sqrt(1 + 2 * (mean + 0.25 * wave * np.cos(np.pi * y))) - 1)

    def flux(self, y: Array) -> Array:
        """Return the exact flux k u_x that enters at x = 1."""
        g, s = self.growth, self._decay_rate
        mean = 0.5 * g * np.exp(-g) / -np.expm1(-g)
        return np.asarray(np.exp(g) * (mean + 0.25 * np.cos(np.pi * y) * (s / np.tanh(s) - g / 2)))

    def source(self, x: Array, y: Array) -> Array:  # noqa: ARG002
        """Return zeros, as there is no heat source."""
        return np.zeros_like(x)

    @property
    def _decay_rate(self) -> float:
        return float(np.hypot(np.pi, self.growth / 2))


class SourcedSquare(GradedMaterial):
    """A square with the heat source for u = cos(x) exp(y/2) / 2, prescribed on all sides."""

    is_insulated: ClassVar[bool] = False

    def temperature(self, x: Array, y: Array) -> Array:
        """Return the exact temperature u."""
        return np.asarray(np.cos(x) * np.exp(y / 2) / 2)

    def flux(self, y: Array) -> Array:
        """Return the exact flux k u_x that enters at x = 1."""
        half = np.exp(y / 2) / 2
        return np.asarray(-self.ratio * (1 + np.cos(1) * half) * np.sin(1) * half)

    def source(self, x: Array, y: Array) -> Array:
        """Return the heat source Q over exp(g x)."""
        half = np.exp(y / 2) / 2
        u, u_x, u_y = half * np.cos(x), -half * np.sin(x), half * np.cos(x) / 2
        return np.asarray((1 + u) * (0.75 * u - self.growth * u_x) - (u_x**2 + u_y**2))
