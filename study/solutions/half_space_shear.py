"""Mindlin's sphere: partial slip of two equal spheres, and the fields of their tractions.

R. D. Mindlin (1949), in K. L. Johnson, "Contact Mechanics" (1985). Tangential tractions along x
alone are exact for nu = 0; else the slip across x is neglected, as Johnson says in 7.2.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from study.solutions.half_space import Elastic, HertzSphere

Array = npt.NDArray[np.float64]

# Point forces along a radius and round the axis; at twice the radius and more their field is that
# of the traction to 1e-10
_ALONG, _ROUND = 16, 48


def hertz_force(body: Elastic, radius: float) -> float:
    """Force on a rigid sphere whose contact has the radius 1."""
    return 4 / 3 * body.plane_modulus / radius


@dataclass(frozen=True)
class MindlinSphere:
    """A sphere on its like, pressed and then pushed along x less than needed to slide.

    Args:
        normal: of one body, as a rigid sphere of the same contact would press it.
        friction: mu.
        share: Q/(mu P).
    """

    normal: HertzSphere
    friction: float
    share: float

    @property
    def stick(self) -> float:
        """Radius c = a (1 - Q/(mu P))^(1/3) of the disc that sticks."""
        return float(self.normal.half_width * np.cbrt(1 - self.share))

    @property
    def force(self) -> float:
        """Q."""
        return self.share * self.friction * self.normal.force

    @property
    def shift(self) -> float:
        """Of the far part of one body against the disc that sticks."""
        body, a = self.normal.body, self.normal.half_width
        whole = 3 * self.friction * self.normal.force * (2 - body.poissons_ratio)
        return float(whole / (16 * body.shear_modulus * a) * (1 - (self.stick / a) ** 2))

    def pressure(self, r: Array) -> Array:
        """Hertz's."""
        return np.asarray(self.normal.pressure(r))

    def shear(self, r: Array) -> Array:
        """The slipping mu p, less mu p0 c/a sqrt(1 - r²/c²) where it sticks."""
        c = self.stick
        held = c / self.normal.half_width * np.sqrt(np.maximum(0.0, 1 - (r / c) ** 2))
        return np.asarray(self.friction * (self.normal.pressure(r) - self.normal.peak * held))

    def displacement(self, x: Array, pushed: bool) -> Array:
        """Displacements (n, 3) of points (n, 3) in z < 0, away from the contact."""
        r = np.hypot(x[:, 0], x[:, 1])
        of_r = self.normal.displacement(np.column_stack([r, x[:, 2]]))
        along = x[:, :2] / np.maximum(r, 1e-12)[:, None]
        moved = np.column_stack([of_r[:, :1] * along, of_r[:, 1]])
        if pushed:
            whole, ratio = self.friction * self.normal.force, self.stick / self.normal.half_width
            moved += _pulled(self.normal.body, x, self.normal.half_width, whole)
            moved -= _pulled(self.normal.body, x, self.stick, whole * ratio**3)
        return moved


def _pulled(body: Elastic, x: Array, radius: float, force: float) -> Array:
    """Displacements (n, 3) by a traction along x that goes as sqrt(1 - r²/radius²)."""
    s, weight = np.polynomial.legendre.leggauss(_ALONG)
    rise = (1 + s) / 2  # sqrt(1 - r²/radius²)
    angle = 2 * np.pi * np.arange(_ROUND) / _ROUND
    distance = radius * np.sqrt(1 - rise**2)
    places = np.stack([np.outer(distance, np.cos(angle)), np.outer(distance, np.sin(angle))], 2)
    forces = np.repeat(3 * force * rise**2 * weight / 2 / _ROUND, _ROUND)
    return _cerruti(body, x, places.reshape(-1, 2), forces)


def _cerruti(body: Elastic, x: Array, places: Array, forces: Array) -> Array:
    """Displacements (n, 3) in z < 0 by point forces (m,) along x at places (m, 2) of z = 0.

    V. Cerruti (1882); Johnson's (3.76) to (3.78), whose z points into the body.
    """
    s, t = (x[:, axis, None] - places[:, axis] for axis in (0, 1))
    z = -x[:, 2, None]
    near = 1 / np.sqrt(s**2 + t**2 + z**2)  # powers of the distance would take most of the time
    below, rest = near / (1 + z * near), 1 - 2 * body.poissons_ratio
    falls = near * (near**2 - rest * below**2)
    u = near + rest * below + s**2 * falls
    v = s * t * falls
    w = s * near * (z * near**2 + rest * below)
    field = np.column_stack([u @ forces, v @ forces, -(w @ forces)])
    return np.asarray(field / (4 * np.pi * body.shear_modulus))
