"""Partial slip of two equal spheres (Mindlin), and displacements that their tractions cause.

R. D. Mindlin (1949), in K. L. Johnson, "Contact Mechanics" (1985). Tangential tractions along x
alone are exact for nu = 0; otherwise the slip across x is neglected (Johnson, section 7.2).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from study.solutions.half_space import ElasticHalfSpace, HertzSphere

Array = npt.NDArray[np.float64]

# Numbers of point forces along a radius and around the axis; at twice the radius and beyond, their
# field agrees with that of the traction to 1e-10
_N_RADIAL_FORCES, _N_ANGLES = 16, 48


def force_of_unit_hertz_contact(body: ElasticHalfSpace, radius: float) -> float:
    """Return the force on a rigid sphere of this radius whose contact radius is 1."""
    return 4 / 3 * body.plane_modulus / radius


@dataclass(frozen=True)
class MindlinSphere:
    """Two equal spheres, pressed and then loaded along x by less than the limit of friction.

    Args:
        normal_contact: Contact of one of the bodies with a rigid sphere and the same pressure.
        friction: Coefficient of friction mu.
        friction_utilisation: Tangential force over its limit, Q/(mu P).
    """

    normal_contact: HertzSphere
    friction: float
    friction_utilisation: float

    @property
    def stick_radius(self) -> float:
        """Radius c = a (1 - Q/(mu P))^(1/3) of the disc that sticks."""
        return float(self.normal_contact.half_width * np.cbrt(1 - self.friction_utilisation))

    @property
    def tangential_force(self) -> float:
        """Tangential force Q."""
        return self.friction_utilisation * self.friction * self.normal_contact.force

    @property
    def tangential_approach(self) -> float:
        """Tangential displacement of a body's far part relative to the disc that sticks."""
        body, a = self.normal_contact.body, self.normal_contact.half_width
        whole = 3 * self.friction * self.normal_contact.force * (2 - body.poissons_ratio)
        return float(whole / (16 * body.shear_modulus * a) * (1 - (self.stick_radius / a) ** 2))

    def pressure(self, r: Array) -> Array:
        """Return Hertz' pressure."""
        return np.asarray(self.normal_contact.pressure(r))

    def shear(self, r: Array) -> Array:
        """Return the shear mu p, reduced by mu p0 c/a sqrt(1 - r²/c²) where the contact sticks."""
        c = self.stick_radius
        held = c / self.normal_contact.half_width * np.sqrt(np.maximum(0.0, 1 - (r / c) ** 2))
        return np.asarray(
            self.friction
            * (self.normal_contact.pressure(r) - self.normal_contact.peak_pressure * held)
        )

    def displacement(self, x: Array, is_sheared: bool) -> Array:
        """Return displacements (n, 3) of points (n, 3) in z < 0, away from the contact."""
        r = np.hypot(x[:, 0], x[:, 1])
        normal_contact, c = self.normal_contact, self.stick_radius
        radial_and_axial = normal_contact.displacement(np.column_stack([r, x[:, 2]]))
        direction = x[:, :2] / np.maximum(r, 1e-12)[:, None]
        u = np.column_stack([radial_and_axial[:, :1] * direction, radial_and_axial[:, 1]])
        if is_sheared:
            body, a = normal_contact.body, normal_contact.half_width
            limit, ratio = self.friction * normal_contact.force, c / a
            u += _displacement_by_shear(body, x, a, limit)
            u -= _displacement_by_shear(body, x, c, limit * ratio**3)
        return u


def _displacement_by_shear(body: ElasticHalfSpace, x: Array, radius: float, force: float) -> Array:
    """Return displacements (n, 3) by a traction along x proportional to sqrt(1 - r²/radius²)."""
    s, weight = np.polynomial.legendre.leggauss(_N_RADIAL_FORCES)
    height = (1 + s) / 2  # sqrt(1 - r²/radius²)
    angle = 2 * np.pi * np.arange(_N_ANGLES) / _N_ANGLES
    distance = radius * np.sqrt(1 - height**2)
    positions = np.stack([np.outer(distance, np.cos(angle)), np.outer(distance, np.sin(angle))], 2)
    forces = np.repeat(3 * force * height**2 * weight / 2 / _N_ANGLES, _N_ANGLES)
    return _cerruti_displacement(body, x, positions.reshape(-1, 2), forces)


def _cerruti_displacement(
    body: ElasticHalfSpace, x: Array, force_positions: Array, forces: Array
) -> Array:
    """Return displacements (n, 3) in z < 0 due to forces (m,) along x at points (m, 2) of z = 0.

    This is V. Cerruti's solution (1882), Johnson's (3.76) to (3.78), whose z points into the body.
    """
    s, t = (x[:, axis, None] - force_positions[:, axis] for axis in (0, 1))
    z = -x[:, 2, None]
    inverse_r = 1 / np.sqrt(s**2 + t**2 + z**2)  # faster than powers of r
    inverse_r_plus_z = inverse_r / (1 + z * inverse_r)
    factor = 1 - 2 * body.poissons_ratio
    common = inverse_r * (inverse_r**2 - factor * inverse_r_plus_z**2)
    u = inverse_r + factor * inverse_r_plus_z + s**2 * common
    v = s * t * common
    w = s * inverse_r * (z * inverse_r**2 + factor * inverse_r_plus_z)
    field = np.column_stack([u @ forces, v @ forces, -(w @ forces)])
    return np.asarray(field / (4 * np.pi * body.shear_modulus))
