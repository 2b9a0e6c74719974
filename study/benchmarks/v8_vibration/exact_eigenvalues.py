"""Exact eigenvalues omega^2 of elastic bodies between smooth rigid walls."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count as count_from_zero
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import iv, jv

from pw_elements import Material
from pw_elements.elasticity import StressState

N_SEARCH_POINTS = 4000
"""Number of points of an interval between which changes of sign are sought."""
MIN_WAVE_NUMBER = 1e-8
"""Smaller wave numbers p are replaced by this one in J_1(pa) / p, to avoid a division by zero."""

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rod:
    """Round rod between smooth rigid walls at its ends (u_z = 0, no shear); its side is free.

    Modes of axial symmetry without torsion: u_r = U(r) cos kz, u_z = W(r) sin kz with k = n pi / L.

    Args:
        material: Elastic constants and density.
        radius: Radius a.
        length: Length L.
    """

    material: Material
    radius: float
    length: float

    def eigenvalues(self, count: int) -> list[float]:
        """Return the smallest eigenvalues, roots of Pochhammer's (1876) and Chree's equation.

        The search range is doubled until it contains `count` roots.
        """
        _, shear = squared_wave_speeds(self.material, StressState.AXISYMMETRIC)
        upper = 4 * shear * (np.pi / self.length) ** 2
        eigenvalues: list[float] = []
        while len(eigenvalues) < count:
            upper *= 2
            eigenvalues = self._eigenvalues_below(upper)
        return sorted(eigenvalues)[:count]

    def _eigenvalues_below(self, upper: float) -> list[float]:
        eigenvalues: list[float] = []
        for n in count_from_zero():
            roots = _find_roots(partial(self._evaluate_frequency_equation, n=n), upper)
            if n > 0 and not roots:  # the smallest root grows with the wave number
                return eigenvalues
            eigenvalues += roots
        return eigenvalues

    def _evaluate_frequency_equation(self, eigenvalue: Array, n: int) -> Array:
        """Return the frequency equation's left side without its trivial factors.

        These factors are q and, for n = 0, also q J_1(qa), which belongs to modes with u_z only.

        Args:
            eigenvalue: Values of omega^2.
            n: Number of half waves along the rod.
        """
        dilatation, shear = squared_wave_speeds(self.material, StressState.AXISYMMETRIC)
        k_squared, a = (n * np.pi / self.length) ** 2, self.radius
        p_squared, q_squared = (eigenvalue / c - k_squared for c in (dilatation, shear))
        p_j1 = p_squared * _bessel_j1_over_wave_number(p_squared, a)
        if n == 0:
            return 2 * p_j1 / a - q_squared * _bessel_j0(p_squared, a)
        j1_q = _bessel_j1_over_wave_number(q_squared, a)
        return (
            2 / a * (q_squared + k_squared) * p_j1 * j1_q
            - (q_squared - k_squared) ** 2 * _bessel_j0(p_squared, a) * j1_q
            - 4 * k_squared * p_j1 * _bessel_j0(q_squared, a)
        )


def rectangle_eigenvalues(
    material: Material, state: StressState, sides: tuple[float, float], count: int
) -> list[float]:
    """Return the smallest eigenvalues of a plane rectangle within four smooth rigid walls.

    u = A sin(kx) cos(ly), v = B cos(kx) sin(ly) with k = m pi / a, l = n pi / b satisfies the
    boundary conditions. With (A, B) parallel to (k, l) it is a dilatational wave, for which m or n
    may be zero; with (A, B) normal to (k, l) it is a shear wave, which vanishes if m or n is zero.
    """
    dilatation, shear = squared_wave_speeds(material, state)
    eigenvalues = []
    for m, n in product(range(count + 1), repeat=2):
        wave_number_squared = (m * np.pi / sides[0]) ** 2 + (n * np.pi / sides[1]) ** 2
        if m or n:
            eigenvalues.append(dilatation * wave_number_squared)
        if m and n:
            eigenvalues.append(shear * wave_number_squared)
    return sorted(eigenvalues)[:count]


def squared_wave_speeds(material: Material, state: StressState) -> tuple[float, float]:
    """Return the squared speeds of dilatational and shear waves."""
    E, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    if state is StressState.PLANE_STRESS:
        stiffness = E / (1 - nu**2)
    else:
        stiffness = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return stiffness / rho, E / (2 * (1 + nu)) / rho


def _bessel_j0(p_squared: Array, a: float) -> Array:
    """Return J_0(pa) for p^2 of either sign."""
    x = np.sqrt(np.abs(p_squared)) * a
    return np.where(p_squared >= 0, jv(0, x), iv(0, x))


def _bessel_j1_over_wave_number(p_squared: Array, a: float) -> Array:
    """Return J_1(pa) / p for p^2 of either sign."""
    p = np.maximum(np.sqrt(np.abs(p_squared)), MIN_WAVE_NUMBER)
    return np.where(p_squared >= 0, jv(1, p * a), iv(1, p * a)) / p


def _find_roots(function: Callable[[Array], Array], upper: float) -> list[float]:
    """Return all roots in (0, upper] at which the function changes its sign."""
    grid = upper * np.arange(1, N_SEARCH_POINTS + 1, dtype=np.float64) / N_SEARCH_POINTS
    values = function(grid)
    changes = np.flatnonzero(values[:-1] * values[1:] < 0)
    return [brentq(function, grid[i], grid[i + 1], xtol=1e-13 * upper, rtol=1e-14) for i in changes]
