"""Exact and textbook buckling stresses of a simply supported strip in plane stress."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq

Form = Literal["G", "J", "deflection"]
"""Form of the geometric stiffness, see `Strip.elasticity`."""
SHEAR_FACTOR = 5 / 6
"""Shear correction factor of a rectangular section."""


@dataclass(frozen=True)
class Strip:
    """Strip of length L and height h under uniform axial stress, with v = 0 and no shear at its ends.

    Args:
        youngs_modulus: Young's modulus E.
        poissons_ratio: Poisson's ratio nu.
        slenderness: Ratio L / h, the only dimension on which the stresses depend.
    """

    youngs_modulus: float
    poissons_ratio: float
    slenderness: float

    @property
    def shear_modulus(self) -> float:
        """Return the shear modulus E / (2 (1 + nu))."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    def euler(self, n: int) -> float:
        """Return Euler's stress of mode n, Eq. (27)."""
        return (n * np.pi / self.slenderness) ** 2 * self.youngs_modulus / 12

    def engesser(self, n: int) -> float:
        """Return Engesser's stress, with the shear force normal to the deformed axis."""
        return self.euler(n) / (1 + self.euler(n) / (SHEAR_FACTOR * self.shear_modulus))

    def haringx(self, n: int) -> float:
        """Return Haringx' stress, with the shear force in the deformed cross-section."""
        rigidity = SHEAR_FACTOR * self.shear_modulus
        return rigidity / 2 * (np.sqrt(1 + 4 * self.euler(n) / rigidity) - 1)

    def elasticity(self, n: int, form: Form) -> float:
        """Return the exact plane-stress value: the smallest root of the free-surface determinant.

        Args:
            n: Mode.
            form: Geometric stiffness of the continuum: "G" is the gradient form of Eq. (25) and
                Eq. (26), "J" that of an objective stress rate; "deflection" has only the slope of
                the deflection.
        """
        return _find_smallest_root(lambda s: self._determinant(s, n, form), 1.2 * self.euler(n))

    def rayleigh_lamb_modulus(self, n: int) -> float:
        """Return the "G" value by the Rayleigh-Lamb equation with rho omega² replaced by s k²."""
        E, nu, G = self.youngs_modulus, self.poissons_ratio, self.shear_modulus
        k, b = n * np.pi / self.slenderness, 0.5

        def residual(s: float) -> float:
            p, q = k * np.sqrt(1 - s * (1 - nu**2) / E), k * np.sqrt(1 - s / G)
            return 4 * k**2 * p * q * np.tanh(q * b) - (k**2 + q**2) ** 2 * np.tanh(p * b)

        return _find_smallest_root(residual, 1.2 * self.euler(n))

    def _determinant(self, s: float, n: int, form: Form) -> float:
        """Return the free-surface determinant for u = U(y) cos kx, v = V(y) sin kx, U odd and V even.

        Energy: axial u_x² + lateral v_y² + 2 coupling u_x v_y + shear (u_y + v_x)² - s v_x².
        """
        E, nu = self.youngs_modulus, self.poissons_ratio
        lateral = E / (1 - nu**2)
        coupling = nu * lateral
        axial = lateral + {"G": -s, "J": s, "deflection": 0.0}[form]
        shear = self.shear_modulus + (s / 2 if form == "J" else 0.0)
        k, b = n * np.pi / self.slenderness, 0.5
        # (shear r² - axial k²)(lateral r² - (shear - s) k²) + (coupling + shear)² k² r² = 0
        middle = (coupling + shear) ** 2 - shear * (shear - s) - axial * lateral
        squared_exponents = np.roots([shear * lateral, middle * k**2, axial * (shear - s) * k**4])
        r = np.sqrt(squared_exponents.astype(complex))
        ratio = -(shear * r**2 - axial * k**2) / ((coupling + shear) * k * r)  # ratio V / U
        shear_stress = r + k * ratio
        normal_stress = (lateral * ratio * r - coupling * k) * np.tanh(r * b)
        determinant = shear_stress[0] * normal_stress[1] - shear_stress[1] * normal_stress[0]
        # The division removes the dependence on the order of the two exponents, and the zero where
        # they coincide at s = 0
        return float((determinant / (r[0] - r[1])).real)


def _find_smallest_root(function: Callable[[float], float], upper: float) -> float:
    """Return the first sign change above zero; at zero the function has a trivial root.

    Raises:
        ValueError: If there is no sign change below the upper bound.
    """
    grid = np.linspace(upper / 500, upper, 500)
    values = [function(s) for s in grid]
    for low, high, low_value, high_value in zip(grid, grid[1:], values, values[1:], strict=False):
        if low_value * high_value < 0:
            return float(brentq(function, low, high, xtol=1e-12 * high, rtol=1e-14))
    raise ValueError(f"no sign change between 0 and {upper:g}; raise the upper bound")
