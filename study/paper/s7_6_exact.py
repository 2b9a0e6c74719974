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
class CompressedStrip:
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
        """Shear modulus E / (2 (1 + nu))."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    def euler_stress(self, n: int) -> float:
        """Return Euler's critical stress of mode n, Eq. (27)."""
        return (n * np.pi / self.slenderness) ** 2 * self.youngs_modulus / 12

    def engesser_stress(self, n: int) -> float:
        """Return Engesser's critical stress of mode n.

        The shear force is normal to the deformed axis.
        """
        return self.euler_stress(n) / (
            1 + self.euler_stress(n) / (SHEAR_FACTOR * self.shear_modulus)
        )

    def haringx_stress(self, n: int) -> float:
        """Return Haringx' critical stress of mode n.

        The shear force lies in the deformed cross-section.
        """
        rigidity = SHEAR_FACTOR * self.shear_modulus
        return rigidity / 2 * (np.sqrt(1 + 4 * self.euler_stress(n) / rigidity) - 1)

    def exact_critical_stress(self, n: int, form: Form) -> float:
        """Return the exact critical stress of plane elasticity for mode n.

        It is the smallest root of the determinant of the conditions on the stress-free sides.

        Args:
            n: Number of half waves along the strip.
            form: Geometric stiffness of the continuum: "G" is the gradient form of Eq. (25) and
                Eq. (26), "J" that of an objective stress rate; "deflection" has only the slope of
                the deflection.
        """
        return _find_smallest_root(
            lambda s: self._determinant(s, n, form), 1.2 * self.euler_stress(n)
        )

    def critical_stress_by_rayleigh_lamb(self, n: int) -> float:
        """Return the critical stress of form "G" for mode n by the Rayleigh-Lamb equation.

        In that equation, rho omega² is replaced by s k², with the stress s and the wave number k.
        """
        E, nu, G = self.youngs_modulus, self.poissons_ratio, self.shear_modulus
        k, b = n * np.pi / self.slenderness, 0.5

        def rayleigh_lamb_residual(s: float) -> float:
            p, q = k * np.sqrt(1 - s * (1 - nu**2) / E), k * np.sqrt(1 - s / G)
            return 4 * k**2 * p * q * np.tanh(q * b) - (k**2 + q**2) ** 2 * np.tanh(p * b)

        return _find_smallest_root(rayleigh_lamb_residual, 1.2 * self.euler_stress(n))

    def _determinant(self, s: float, n: int, form: Form) -> float:
        """Return the determinant of the conditions on the stress-free sides at an axial stress s.

        The fields are u = U(y) cos kx and v = V(y) sin kx with odd U and even V. The energy density
        is axial u_x² + lateral v_y² + 2 coupling u_x v_y + shear (u_y + v_x)² - s v_x².
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


def _find_smallest_root(function: Callable[[float], float], upper_bound: float) -> float:
    """Return the smallest positive root of a function that also has a trivial root at zero.

    Args:
        function: Function that changes its sign at the root.
        upper_bound: Upper bound of the root.

    Raises:
        ValueError: If there is no sign change below the upper bound.
    """
    grid = np.linspace(upper_bound / 500, upper_bound, 500)
    values = [function(s) for s in grid]
    for low, high, low_value, high_value in zip(grid, grid[1:], values, values[1:], strict=False):
        if low_value * high_value < 0:
            return float(brentq(function, low, high, xtol=1e-12 * high, rtol=1e-14))
    raise ValueError(f"no sign change between 0 and {upper_bound:g}; raise the upper bound")
