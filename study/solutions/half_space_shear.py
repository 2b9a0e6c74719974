"""Exact partial slip of two equal spheres (Mindlin), with displacements away from the contact.

Source: R. D. Mindlin (1949), in K. L. Johnson, "Contact Mechanics" (1985). Shear tractions are
along x; this is exact for nu = 0, otherwise slip along y is neglected (Johnson, section 7.2).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from study.solutions.half_space import ElasticHalfSpace, HertzSphere

Array = npt.NDArray[np.float64]

# Numbers of point forces along a radius and around the axis; at twice the radius and beyond, their
# field agrees with that of the traction to 1e-10
_N_RADIAL_FORCES, _N_ANGLES = 16, 48


def force_that_gives_contact_radius_1(body: ElasticHalfSpace, sphere_radius: float) -> float:
    """Return the force on a rigid sphere of a given radius for which the contact radius is 1."""
    return 4 / 3 * body.plane_strain_modulus / sphere_radius


@dataclass(frozen=True)
class MindlinSphere:
    """Contact of two equal spheres that are pressed, then loaded along x below the friction limit.

    Args:
        normal_contact: Frictionless contact of one sphere with a rigid one, with equal pressure.
        friction: Coefficient of friction mu.
        friction_utilisation: Tangential force divided by the friction limit, Q/(mu P).
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
        """Tangential force Q along x."""
        return self.friction_utilisation * self.friction * self.normal_contact.force

    @property
    def tangential_approach(self) -> float:
        """Tangential displacement of a sphere's distant points relative to the sticking disc."""
        body, a = self.normal_contact.body, self.normal_contact.half_width
        whole = 3 * self.friction * self.normal_contact.force * (2 - body.poissons_ratio)
        return float(whole / (16 * body.shear_modulus * a) * (1 - (self.stick_radius / a) ** 2))

    def pressure(self, r: Array) -> Array:
        """Return Hertz' contact pressure (m,) at distances r (m,) from the middle."""
        return np.asarray(self.normal_contact.pressure(r))

    def shear(self, r: Array) -> Array:
        """Return the shear traction mu p, reduced by mu p0 c/a sqrt(1 - r²/c²) for r < c."""
        c = self.stick_radius
        held = c / self.normal_contact.half_width * np.sqrt(np.maximum(0.0, 1 - (r / c) ** 2))
        return np.asarray(
            self.friction
            * (self.normal_contact.pressure(r) - self.normal_contact.peak_pressure * held)
        )

    def displacement(self, x: Array, includes_shear: bool) -> Array:
        """Return displacements (n, 3) of one body due to the contact tractions.

        Args:
            x: Points (n, 3) in z < 0, at least two contact radii from the middle of the contact.
            includes_shear: Whether shear tractions act besides the pressure.
        """
        r = np.hypot(x[:, 0], x[:, 1])
        normal_contact, c = self.normal_contact, self.stick_radius
        radial_and_axial = normal_contact.displacement(np.column_stack([r, x[:, 2]]))
        direction = x[:, :2] / np.maximum(r, 1e-12)[:, None]
        u = np.column_stack([radial_and_axial[:, :1] * direction, radial_and_axial[:, 1]])
        if includes_shear:
            body, a = normal_contact.body, normal_contact.half_width
            limit, ratio = self.friction * normal_contact.force, c / a
            u += _displacement_by_elliptic_shear_traction(body, x, a, limit)
            u -= _displacement_by_elliptic_shear_traction(body, x, c, limit * ratio**3)
        return u


def _displacement_by_elliptic_shear_traction(
    body: ElasticHalfSpace, x: Array, radius: float, force: float
) -> Array:
    """Return displacements (n, 3) due to a shear traction proportional to sqrt(1 - r²/radius²).

    Args:
        body: Half space z < 0.
        x: Points (n, 3) away from the loaded disc.
        radius: Radius of the disc on which the traction acts along x.
        force: Integral of the traction.
    """
    s, weight = np.polynomial.legendre.leggauss(_N_RADIAL_FORCES)
    height = (1 + s) / 2  # sqrt(1 - r²/radius²)
    angle = 2 * np.pi * np.arange(_N_ANGLES) / _N_ANGLES
    distance = radius * np.sqrt(1 - height**2)
    positions = np.stack([np.outer(distance, np.cos(angle)), np.outer(distance, np.sin(angle))], 2)
    forces = np.repeat(3 * force * height**2 * weight / 2 / _N_ANGLES, _N_ANGLES)
    return _displacement_by_tangential_point_forces(body, x, positions.reshape(-1, 2), forces)


def _displacement_by_tangential_point_forces(
    body: ElasticHalfSpace, x: Array, force_positions: Array, forces: Array
) -> Array:
    """Return displacements (n, 3) of the half space z < 0 due to point forces along x.

    Source: V. Cerruti (1882); Johnson, equations (3.76) to (3.78), where z points into the body.

    Args:
        body: Half space.
        x: Points (n, 3).
        force_positions: Points (m, 2) of the surface z = 0 at which the forces act.
        forces: Forces (m,) along x.
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
