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
"""Number of equidistant points between which sign changes of a function are sought."""
MIN_WAVE_NUMBER = 1e-8
"""Lower bound of wave numbers p in J_1(pa) / p, which avoids a division by zero."""

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AxisymmetricRodBetweenWalls:
    """Round rod with a free surface, between smooth rigid walls at its ends (u_z = 0, no shear).

    The modes are axisymmetric without torsion: u_r = U(r) cos kz, u_z = W(r) sin kz with k = n pi /
    L.

    Args:
        material: Elastic constants and density.
        radius: Radius a.
        length: Length L.
    """

    material: Material
    radius: float
    length: float

    def eigenvalues(self, count: int) -> list[float]:
        """Return the smallest eigenvalues, roots of Pochhammer and Chree's frequency equation.

        The search range is doubled until it contains enough roots.

        Args:
            count: Number of eigenvalues.
        """
        _, shear = squared_dilatational_and_shear_wave_speeds(
            self.material, StressState.AXISYMMETRIC
        )
        upper = 4 * shear * (np.pi / self.length) ** 2
        eigenvalues: list[float] = []
        while len(eigenvalues) < count:
            upper *= 2
            eigenvalues = self._all_eigenvalues_below(upper)
        return sorted(eigenvalues)[:count]

    def _all_eigenvalues_below(self, upper: float) -> list[float]:
        eigenvalues: list[float] = []
        for n in count_from_zero():
            roots = _find_roots_at_sign_changes(
                partial(self._evaluate_frequency_equation, n=n), upper
            )
            if n > 0 and not roots:  # the smallest root grows with the wave number
                return eigenvalues
            eigenvalues += roots
        return eigenvalues

    def _evaluate_frequency_equation(self, eigenvalue: Array, n: int) -> Array:
        """Return the left side of Pochhammer and Chree's equation without its trivial factors.

        The trivial factors are q and, for n = 0, also q J_1(qa), which belongs to modes with u_z
        only.

        Args:
            eigenvalue: Values (m,) of omega^2.
            n: Number of half waves along the rod.
        """
        dilatation, shear = squared_dilatational_and_shear_wave_speeds(
            self.material, StressState.AXISYMMETRIC
        )
        k_squared, a = (n * np.pi / self.length) ** 2, self.radius
        p_squared, q_squared = (eigenvalue / c - k_squared for c in (dilatation, shear))
        p_j1 = p_squared * _bessel_j1_over_wave_number_for_either_sign(p_squared, a)
        if n == 0:
            return 2 * p_j1 / a - q_squared * _bessel_j0_for_either_sign(p_squared, a)
        j1_q = _bessel_j1_over_wave_number_for_either_sign(q_squared, a)
        return (
            2 / a * (q_squared + k_squared) * p_j1 * j1_q
            - (q_squared - k_squared) ** 2 * _bessel_j0_for_either_sign(p_squared, a) * j1_q
            - 4 * k_squared * p_j1 * _bessel_j0_for_either_sign(q_squared, a)
        )


def eigenvalues_of_rectangle_between_walls(
    material: Material, state: StressState, sides: tuple[float, float], count: int
) -> list[float]:
    """Return the smallest eigenvalues of a plane rectangle between four smooth rigid walls.

    The displacements u = A sin(kx) cos(ly), v = B cos(kx) sin(ly) with k = m pi / a, l = n pi / b
    satisfy the boundary conditions. If (A, B) is parallel to (k, l), this is a dilatational wave,
    for which m or n may be zero. If (A, B) is normal to (k, l), this is a shear wave, which
    vanishes if m or n is zero.

    Args:
        material: Elastic constants and density.
        state: Stress state.
        sides: Side lengths a and b.
        count: Number of eigenvalues.
    """
    dilatation, shear = squared_dilatational_and_shear_wave_speeds(material, state)
    eigenvalues = []
    for m, n in product(range(count + 1), repeat=2):
        wave_number_squared = (m * np.pi / sides[0]) ** 2 + (n * np.pi / sides[1]) ** 2
        if m or n:
            eigenvalues.append(dilatation * wave_number_squared)
        if m and n:
            eigenvalues.append(shear * wave_number_squared)
    return sorted(eigenvalues)[:count]


def squared_dilatational_and_shear_wave_speeds(
    material: Material, state: StressState
) -> tuple[float, float]:
    """Return the squared speeds of dilatational and of shear waves."""
    E, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    if state is StressState.PLANE_STRESS:
        stiffness = E / (1 - nu**2)
    else:
        stiffness = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return stiffness / rho, E / (2 * (1 + nu)) / rho


def _bessel_j0_for_either_sign(p_squared: Array, radius: float) -> Array:
    """Return J_0(pa) for p^2 of either sign; for negative p^2 this is I_0(|p| a)."""
    x = np.sqrt(np.abs(p_squared)) * radius
    return np.where(p_squared >= 0, jv(0, x), iv(0, x))


def _bessel_j1_over_wave_number_for_either_sign(p_squared: Array, radius: float) -> Array:
    """Return J_1(pa) / p for p^2 of either sign; for negative p^2 this is I_1(|p| a) / |p|."""
    p = np.maximum(np.sqrt(np.abs(p_squared)), MIN_WAVE_NUMBER)
    return np.where(p_squared >= 0, jv(1, p * radius), iv(1, p * radius)) / p


def _find_roots_at_sign_changes(function: Callable[[Array], Array], upper: float) -> list[float]:
    """Return roots in (0, upper] at which a function changes its sign between grid points."""
    grid = upper * np.arange(1, N_SEARCH_POINTS + 1, dtype=np.float64) / N_SEARCH_POINTS
    values = function(grid)
    changes = np.flatnonzero(values[:-1] * values[1:] < 0)
    return [brentq(function, grid[i], grid[i + 1], xtol=1e-13 * upper, rtol=1e-14) for i in changes]
