"""Exact eigenvalues omega^2 of elastic bodies between smooth rigid walls."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count as numbers
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import iv, jv

from pw_elements import Material
from pw_elements.elasticity import StressState

# Points of the search for sign changes, between zero and the upper end
_POINTS = 4000
# Bessel functions of smaller arguments are their limits at zero
_TINY = 1e-8

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rod:
    """Round rod whose ends stand on smooth rigid walls: u_z = 0, no shear; its side is free.

    Modes of axial symmetry without torsion: u_r = U(r) cos kz, u_z = W(r) sin kz with k = n pi / L.

    Args:
        material: elastic constants and density, numbers.
        radius: a.
        length: L.
    """

    material: Material
    radius: float
    length: float

    def eigenvalues(self, count: int) -> list[float]:
        """The smallest ones, by the frequency equation of L. Pochhammer (1876) and C. Chree."""
        _, shear = wave_speeds_squared(self.material, StressState.AXISYMMETRIC)
        upper = 4 * shear * (np.pi / self.length) ** 2
        found: list[float] = []
        while len(found) < count:
            upper *= 2
            found = self._below(upper)
        return sorted(found)[:count]

    def _below(self, upper: float) -> list[float]:
        found: list[float] = []
        for n in numbers():
            roots = _roots(partial(self._frequency_equation, n=n), upper)
            if n > 0 and not roots:  # the smallest root grows with the wave number
                return found
            found += roots
        return found

    def _frequency_equation(self, eigenvalue: Array, n: int) -> Array:
        """Its left side over the trivial factors q (all n) and q J_1(qa) (n = 0: u_z alone)."""
        dilatation, shear = wave_speeds_squared(self.material, StressState.AXISYMMETRIC)
        k_squared, a = (n * np.pi / self.length) ** 2, self.radius
        p_squared, q_squared = (eigenvalue / c - k_squared for c in (dilatation, shear))
        p_j1 = p_squared * _j1_over_argument(p_squared, a)
        if n == 0:
            return 2 * p_j1 / a - q_squared * _j0(p_squared, a)
        j1_q = _j1_over_argument(q_squared, a)
        return (
            2 / a * (q_squared + k_squared) * p_j1 * j1_q
            - (q_squared - k_squared) ** 2 * _j0(p_squared, a) * j1_q
            - 4 * k_squared * p_j1 * _j0(q_squared, a)
        )


def rectangle_eigenvalues(
    material: Material, state: StressState, sides: tuple[float, float], count: int
) -> list[float]:
    """Smallest eigenvalues of a plane rectangle within four smooth rigid walls.

    u = A sin(kx) cos(ly), v = B cos(kx) sin(ly) with k = m pi / a, l = n pi / b meets them. It is
    a wave of dilatation with (A, B) along (k, l), for which one of m, n may vanish, or one of
    shear with (A, B) normal to it, which then would be at rest.
    """
    dilatation, shear = wave_speeds_squared(material, state)
    found = []
    for m, n in product(range(count + 1), repeat=2):
        squared = (m * np.pi / sides[0]) ** 2 + (n * np.pi / sides[1]) ** 2
        if m or n:
            found.append(dilatation * squared)
        if m and n:
            found.append(shear * squared)
    return sorted(found)[:count]


def wave_speeds_squared(material: Material, state: StressState) -> tuple[float, float]:
    """Squares of the speeds of plane waves of dilatation and of shear."""
    E, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    if state is StressState.PLANE_STRESS:
        stiffness = E / (1 - nu**2)
    else:
        stiffness = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return stiffness / rho, E / (2 * (1 + nu)) / rho


def _j0(squared: Array, a: float) -> Array:
    """J_0(pa) for squares of p of either sign."""
    x = np.sqrt(np.abs(squared)) * a
    return np.where(squared >= 0, jv(0, x), iv(0, x))


def _j1_over_argument(squared: Array, a: float) -> Array:
    """J_1(pa) / p for squares of p of either sign."""
    p = np.maximum(np.sqrt(np.abs(squared)), _TINY)
    return np.where(squared >= 0, jv(1, p * a), iv(1, p * a)) / p


def _roots(function: Callable[[Array], Array], upper: float) -> list[float]:
    """All roots in (0, upper] that change the function's sign."""
    grid = upper * np.arange(1, _POINTS + 1, dtype=np.float64) / _POINTS
    values = function(grid)
    changes = np.flatnonzero(values[:-1] * values[1:] < 0)
    return [brentq(function, grid[i], grid[i + 1], xtol=1e-13 * upper, rtol=1e-14) for i in changes]
