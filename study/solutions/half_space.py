"""Exact pressures and displacements of elastic half planes and half spaces y < 0 in contact.

Displacements are sums of the fields of sources, which converge fast away from the contact. The
sources are line forces on the surface in the plane (Flamant), and points at imaginary depths on the
axis in axisymmetry (Boussinesq). Pressures are those of K. L. Johnson, "Contact Mechanics" (1985).

Points are arrays (n, 2) of x (in axisymmetry r) and y; displacements have the same shape. In the
plane, displacements are defined up to a rigid-body translation, which is chosen such that the term
P log(distance) of the vertical displacement v vanishes at distance one.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating[Any]]

# Number of sources of a field, with which all displacements at twice the half width are exact to
# round-off
_N_SOURCES = 64
# Range of the variable log((b + x)/(b - x)) of a bonded punch, for the same accuracy
_MAX_LOGARITHMIC_COORDINATE = 80.0


@dataclass(frozen=True)
class ElasticHalfSpace:
    """Isotropic elastic half plane in plane strain, or isotropic elastic half space.

    Args:
        youngs_modulus: Young's modulus E.
        poissons_ratio: Poisson's ratio nu.
    """

    youngs_modulus: float
    poissons_ratio: float

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    @property
    def plane_strain_modulus(self) -> float:
        """Plane-strain modulus E* = E/(1 - nu²)."""
        return self.youngs_modulus / (1 - self.poissons_ratio**2)

    @property
    def kolosov_constant(self) -> float:
        """Kolosov's constant kappa = 3 - 4 nu of plane strain."""
        return 3 - 4 * self.poissons_ratio

    def displacement_by_line_forces(
        self, x: Array, force_positions: Array, normal_forces: Array, tangential_forces: Array
    ) -> Array:
        """Return displacements (n, 2) of points (n, 2) due to line forces on the half plane.

        Args:
            x: Points away from the forces.
            force_positions: Positions x (m,) of the forces on the surface.
            normal_forces: Forces per length (m,) along -y.
            tangential_forces: Forces per length (m,) along +x.
        """
        y = x[:, 1, None]
        z = x[:, 0, None] + 1j * y - force_positions
        kappa = self.kolosov_constant
        normal, normal_integral = 1j * normal_forces / (np.pi * z), 1j * normal_forces / np.pi
        shear, shear_integral = (
            -1j * tangential_forces / (np.pi * z),
            -1j * tangential_forces / np.pi,
        )
        logarithm = np.log(1j * z)  # branch cut above the body
        normal_integral, shear_integral = normal_integral * logarithm, shear_integral * logarithm
        u = (kappa - 1) / 2 * normal_integral.real - y * normal.imag
        u += (kappa + 1) / 2 * shear_integral.imag + y * shear.real
        v = (kappa + 1) / 2 * normal_integral.imag - y * normal.real
        v -= (kappa - 1) / 2 * shear_integral.real + y * shear.imag
        return np.stack([u.sum(axis=1), v.sum(axis=1)], axis=1) / (2 * self.shear_modulus)

    def approach_of_line_contact(self, force: float, mean_logarithm_of_distance: float) -> float:
        """Return the indentation depth of a frictionless line contact on the half plane.

        Args:
            force: Normal force per length.
            mean_logarithm_of_distance: Mean of log(distance from the middle) over the contact,
                weighted by the pressure.
        """
        return float(-2 * force * mean_logarithm_of_distance / (np.pi * self.plane_strain_modulus))

    def displacement_by_imaginary_axial_sources(
        self, x: Array, imaginary_depths: Array, forces: Array
    ) -> Array:
        """Return displacements (n, 2) of points (n, 2) due to axial sources at imaginary depths.

        The sources represent an axisymmetric pressure. Their potential is the sum of
        force / sqrt(r² + (z + i t)²) with z = -y and the imaginary depth t; it equals the surface
        integral of pressure / distance.

        Args:
            x: Points (r, y) away from the contact.
            imaginary_depths: Depths t (m,), in pairs of opposite signs with equal forces.
            forces: Forces (m,) of the sources.
        """
        r, z = x[:, 0, None], -x[:, 1, None]
        w = z + 1j * imaginary_depths
        R = np.sqrt(r**2 + w**2)
        nu = self.poissons_ratio
        radial = -(1 - 2 * nu) * r / (R * (R + w)) + z * r / R**3
        depth = 2 * (1 - nu) / R + z * w / R**3
        u = np.stack([radial.real @ forces, -depth.real @ forces], axis=1)
        return u / (4 * np.pi * self.shear_modulus)


class ExactIndentation(Protocol):
    """Contact of a rigid indenter with a half plane or half space whose exact solution is known."""

    @property
    def body(self) -> ElasticHalfSpace:
        """Elastic half plane or half space that is indented."""
        ...

    @property
    def half_width(self) -> float:
        """Half width or radius of the contact."""
        ...

    @property
    def force(self) -> float:
        """Total normal force; in the plane, force per length."""
        ...

    @property
    def has_bounded_pressure(self) -> bool:
        """Whether the pressure is zero, and not infinite, at the edge of the contact."""
        ...

    def pressure(self, x: Array) -> Array:
        """Return the contact pressure (m,) at distances x >= 0 (m,) from the middle."""
        ...

    def force_within(self, x: Array) -> Array:
        """Return the normal force (m,) between 0 and x in the plane, or on the disc r <= x."""
        ...

    def displacement(self, x: Array) -> Array:
        """Return displacements (n, 2) of points (n, 2) at least two half widths from the middle."""
        ...

    @property
    def approach(self) -> float:
        """Indentation depth of the indenter's lowest point below the undeformed surface."""
        ...


def axisymmetric_displacement_in_space(
    contact: ExactIndentation, x: Array
) -> npt.NDArray[np.float64]:
    """Return displacements (n, 3) of points of the half space z < 0 due to an axisymmetric contact.

    Args:
        contact: Axisymmetric contact around the axis x = y = 0.
        x: Points (n, 3) at least two contact radii from the middle of the contact.
    """
    r = np.hypot(x[:, 0], x[:, 1])
    u = contact.displacement(np.column_stack([r, x[:, 2]]))
    radial = u[:, :1] * x[:, :2] / np.maximum(r, 1e-12)[:, None]
    return np.asarray(np.column_stack([radial, u[:, 1]]), dtype=np.float64)


def displacement_of_pressed_half_spaces(
    contact: "HertzSphere", x: Array, gap: float
) -> npt.NDArray[np.float64]:
    """Return displacements (n, 3) of a body below z = 0 and of one above z = gap, pressed together.

    The upper body approaches; otherwise its displacements are those of the lower body, mirrored.

    Args:
        contact: Contact of the lower body with a rigid sphere, which deforms it equally.
        x: Points (n, 3) of both bodies at least two contact radii from the middle of the contact.
        gap: Initial distance of the bodies.
    """
    is_upper = x[:, 2] > gap / 2
    z = np.where(is_upper, -(x[:, 2] - gap), x[:, 2])
    u = axisymmetric_displacement_in_space(contact, np.column_stack([x[:, :2], np.minimum(z, 0.0)]))
    u[is_upper, 2] = -u[is_upper, 2] - (gap + 2 * contact.approach)
    return u


@dataclass(frozen=True)
class HertzLine:
    """Contact of a half plane with a rigid parabola of radius R under a force P per length."""

    body: ElasticHalfSpace
    radius: float
    force: float
    has_bounded_pressure: ClassVar[bool] = True

    @property
    def half_width(self) -> float:
        """Half width a = sqrt(4 P R/(pi E*))."""
        return float(
            np.sqrt(4 * self.force * self.radius / (np.pi * self.body.plane_strain_modulus))
        )

    @property
    def peak_pressure(self) -> float:
        """Peak pressure p0 = 2 P/(pi a)."""
        return 2 * self.force / (np.pi * self.half_width)

    def pressure(self, x: Array) -> Array:
        """Return the pressure p0 sqrt(1 - x²/a²)."""
        return self.peak_pressure * np.sqrt(np.maximum(0.0, 1 - (x / self.half_width) ** 2))

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure from 0 to x."""
        s = np.clip(x / self.half_width, 0.0, 1.0)
        return self.force / np.pi * (s * np.sqrt(1 - s**2) + np.arcsin(s))

    def displacement(self, x: Array) -> Array:
        """Return displacements by Gauss-Chebyshev quadrature of the second kind."""
        theta = np.arange(1, _N_SOURCES + 1) * np.pi / (_N_SOURCES + 1)
        forces = self.force * 2 / (_N_SOURCES + 1) * np.sin(theta) ** 2
        s = self.half_width * np.cos(theta)
        return self.body.displacement_by_line_forces(x, s, forces, np.zeros_like(forces))

    @property
    def approach(self) -> float:
        """Indentation depth; the pressure-weighted mean of log(distance) is log(a/2) - 1/2."""
        return self.body.approach_of_line_contact(self.force, np.log(self.half_width / 2) - 0.5)


@dataclass(frozen=True)
class HertzSphere:
    """Contact of a half space with a rigid paraboloid of radius R under a force P."""

    body: ElasticHalfSpace
    radius: float
    force: float
    has_bounded_pressure: ClassVar[bool] = True

    @property
    def half_width(self) -> float:
        """Radius a = (3 P R/(4 E*))^(1/3) of the contact."""
        return float(np.cbrt(0.75 * self.force * self.radius / self.body.plane_strain_modulus))

    @property
    def peak_pressure(self) -> float:
        """Peak pressure p0 = 3 P/(2 pi a²)."""
        return 1.5 * self.force / (np.pi * self.half_width**2)

    def pressure(self, x: Array) -> Array:
        """Return the pressure p0 sqrt(1 - r²/a²)."""
        return self.peak_pressure * np.sqrt(np.maximum(0.0, 1 - (x / self.half_width) ** 2))

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure over the disc of radius x."""
        s = np.clip(x / self.half_width, 0.0, 1.0)
        return self.force * (1 - (1 - s**2) ** 1.5)

    def displacement(self, x: Array) -> Array:
        """Return displacements due to axial sources of the density 3 P (a² - t²)/(4 a³) over t."""
        t, weight = np.polynomial.legendre.leggauss(_N_SOURCES)
        strength = self.force * 0.75 * (1 - t**2) * weight
        return self.body.displacement_by_imaginary_axial_sources(x, self.half_width * t, strength)

    @property
    def approach(self) -> float:
        """Indentation depth a²/R."""
        return self.half_width**2 / self.radius


@dataclass(frozen=True)
class FlatLinePunch:
    """Frictionless flat punch of half width b, pressed with P per length (M. Sadowsky, 1928)."""

    body: ElasticHalfSpace
    half_width: float
    force: float
    has_bounded_pressure: ClassVar[bool] = False

    def pressure(self, x: Array) -> Array:
        """Return the pressure P/(pi sqrt(b² - x²))."""
        with np.errstate(divide="ignore"):
            return self.force / (np.pi * np.sqrt(self.half_width**2 - x**2))

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure from 0 to x."""
        return self.force / np.pi * np.arcsin(np.clip(x / self.half_width, 0.0, 1.0))

    def displacement(self, x: Array) -> Array:
        """Return displacements by Gauss-Chebyshev quadrature of the first kind."""
        s = self.half_width * np.cos((np.arange(_N_SOURCES) + 0.5) * np.pi / _N_SOURCES)
        forces = np.full(_N_SOURCES, self.force / _N_SOURCES)
        return self.body.displacement_by_line_forces(x, s, forces, np.zeros(_N_SOURCES))

    @property
    def approach(self) -> float:
        """Indentation depth; the pressure-weighted mean of log(distance) is log(b/2)."""
        return self.body.approach_of_line_contact(self.force, np.log(self.half_width / 2))


@dataclass(frozen=True)
class FlatRoundPunch:
    """Frictionless flat punch of radius b, pressed with P on a half space (J. Boussinesq, 1885)."""

    body: ElasticHalfSpace
    half_width: float
    force: float
    has_bounded_pressure: ClassVar[bool] = False

    def pressure(self, x: Array) -> Array:
        """Return the pressure P/(2 pi b sqrt(b² - r²))."""
        b = self.half_width
        with np.errstate(divide="ignore"):
            return self.force / (2 * np.pi * b * np.sqrt(b**2 - x**2))

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure over the disc of radius x."""
        s = np.clip(x / self.half_width, 0.0, 1.0)
        return self.force * (1 - np.sqrt(1 - s**2))

    def displacement(self, x: Array) -> Array:
        """Return displacements due to axial sources of the uniform density P/(2 b)."""
        t, weight = np.polynomial.legendre.leggauss(_N_SOURCES)
        return self.body.displacement_by_imaginary_axial_sources(
            x, self.half_width * t, self.force * weight / 2
        )

    @property
    def approach(self) -> float:
        """Indentation depth P/(2 E* b)."""
        return self.force / (2 * self.body.plane_strain_modulus * self.half_width)


@dataclass(frozen=True)
class BondedLinePunch:
    """Flat punch of half width b that is bonded to a half plane and pressed with P per length.

    Pressure and shear traction are the frictionless pressure P/(pi sqrt(b² - x²)) times
    cosh(pi eta) cos(eta s) and cosh(pi eta) sin(eta s), respectively, with the oscillation exponent
    eta = log(3 - 4 nu)/(2 pi) and the logarithmic coordinate s = log((b + x)/(b - x)).
    """

    body: ElasticHalfSpace
    half_width: float
    force: float
    has_bounded_pressure: ClassVar[bool] = False

    @property
    def oscillation_exponent(self) -> float:
        """Exponent eta = log(3 - 4 nu)/(2 pi) of the oscillation of the tractions at the edge."""
        return float(np.log(self.body.kolosov_constant) / (2 * np.pi))

    def pressure(self, x: Array) -> Array:
        """Return the pressure (m,) at distances x < b."""
        return self._traction_without_oscillating_factor(x) * np.cos(
            self.oscillation_exponent * self._logarithmic_coordinate(x)
        )

    def shear(self, x: Array) -> Array:
        """Return the shear traction on the body at x < b, positive away from the middle."""
        return self._traction_without_oscillating_factor(x) * np.sin(
            self.oscillation_exponent * self._logarithmic_coordinate(x)
        )

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure from 0 to x."""
        return self._integrate_traction_from_middle(x, np.cos)

    def shear_force_from_middle_to(self, x: Array) -> Array:
        """Return the integral of the shear traction from 0 to x."""
        return self._integrate_traction_from_middle(x, np.sin)

    def displacement(self, x: Array) -> Array:
        """Return displacements, integrated over the coordinate s by the trapezoidal rule."""
        s = np.linspace(
            -_MAX_LOGARITHMIC_COORDINATE, _MAX_LOGARITHMIC_COORDINATE, 16 * _N_SOURCES + 1
        )
        forces = (s[1] - s[0]) * self._traction_per_logarithmic_coordinate(s)
        pressing, pulling = (forces * f(self.oscillation_exponent * s) for f in (np.cos, np.sin))
        return self.body.displacement_by_line_forces(
            x, self.half_width * np.tanh(s / 2), pressing, pulling
        )

    @property
    def approach(self) -> float:
        """Indentation depth, computed by numerical quadrature."""
        from scipy.integrate import quad

        eta, kappa = self.oscillation_exponent, self.body.kolosov_constant

        def weighted_logarithm_of_distance(s: float) -> float:
            logarithm_of_distance = np.log(self.half_width * np.tanh(s / 2))
            return float(
                2
                * self._traction_per_logarithmic_coordinate(s)
                * np.cos(eta * s)
                * logarithm_of_distance
            )

        pressing = quad(
            weighted_logarithm_of_distance,
            0.0,
            _MAX_LOGARITHMIC_COORDINATE,
            points=[1e-3, 0.1, 1.0],
            limit=200,
        )[0]
        pulling = float(self.shear_force_from_middle_to(np.array([self.half_width]))[0])
        v = (kappa + 1) / 2 * pressing / np.pi + (kappa - 1) / 2 * pulling
        return -v / (2 * self.body.shear_modulus)

    def _traction_without_oscillating_factor(self, x: Array) -> Array:
        amplitude = self.force * np.cosh(np.pi * self.oscillation_exponent)
        with np.errstate(divide="ignore"):
            return amplitude / (np.pi * np.sqrt(self.half_width**2 - x**2))

    def _logarithmic_coordinate(self, x: Array) -> Array:
        with np.errstate(divide="ignore"):
            return 2 * np.arctanh(x / self.half_width)

    def _traction_per_logarithmic_coordinate(self, s: Array | float) -> Array:
        """Return the traction without its oscillating factor, times dx/ds, at coordinates s."""
        amplitude = self.force * np.cosh(np.pi * self.oscillation_exponent)
        return np.asarray(amplitude / (2 * np.pi * np.cosh(np.asarray(s) / 2)))

    def _integrate_traction_from_middle(self, x: Array, oscillating_function: np.ufunc) -> Array:
        from scipy.integrate import quad

        def oscillating_traction(s: float) -> float:
            return float(
                self._traction_per_logarithmic_coordinate(s)
                * oscillating_function(self.oscillation_exponent * s)
            )

        ends = np.minimum(
            self._logarithmic_coordinate(np.minimum(x, self.half_width)),
            _MAX_LOGARITHMIC_COORDINATE,
        )
        return np.array([quad(oscillating_traction, 0.0, end, limit=200)[0] for end in ends])


@dataclass(frozen=True)
class _QuarticIndenter:
    """Contact with a rigid quartic indenter y = A x⁴ (in axisymmetry y = A r⁴).

    Args:
        body: Half plane or half space.
        coefficient: Coefficient A, in units of 1/length³.
        half_width: Half width or radius of the contact.
    """

    body: ElasticHalfSpace
    coefficient: float
    half_width: float
    has_bounded_pressure: ClassVar[bool] = True

    def _pressure(self, x: Array, factor: float) -> Array:
        """Return factor E* A (a² + 2 x²) sqrt(a² - x²) within the contact, and 0 outside."""
        square = np.maximum(0.0, self.half_width**2 - x**2)
        stiffness = factor * self.body.plane_strain_modulus * self.coefficient
        pressure: Array = stiffness * (self.half_width**2 + 2 * x**2) * np.sqrt(square)
        return pressure


class QuarticIndenterOnHalfPlane(_QuarticIndenter):
    """Contact of a quartic indenter with a half plane (I. Y. Shtaerman); forces are per length."""

    @property
    def force(self) -> float:
        """Force P = 3 pi/4 E* A a⁴ per length."""
        stiffness = self.body.plane_strain_modulus * self.coefficient
        return float(0.75 * np.pi * stiffness * self.half_width**4)

    def pressure(self, x: Array) -> Array:
        """Return the pressure E* A (a² + 2 x²) sqrt(a² - x²)."""
        return self._pressure(x, 1.0)

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure from 0 to x."""
        s = np.clip(x / self.half_width, 0.0, 1.0)
        angle, root = np.arcsin(s), np.sqrt(1 - s**2)
        first = (s * root + angle) / 2
        second = (s * (2 * s**2 - 1) * root + angle) / 8
        force: Array = self.force / (0.75 * np.pi) * (first + 2 * second)
        return force

    def displacement(self, x: Array) -> Array:
        """Return displacements by Gauss-Chebyshev quadrature of the second kind."""
        angle = np.arange(1, _N_SOURCES + 1) * np.pi / (_N_SOURCES + 1)
        position = self.half_width * np.cos(angle)
        lengths = self.half_width * np.sin(angle) * np.pi / (_N_SOURCES + 1)
        forces = self.pressure(position) * lengths
        return self.body.displacement_by_line_forces(x, position, forces, np.zeros_like(forces))

    @property
    def approach(self) -> float:
        """Indentation depth; the pressure-weighted mean of log(distance) is log(a/2) - 1/4."""
        return self.body.approach_of_line_contact(self.force, np.log(self.half_width / 2) - 0.25)


class QuarticIndenterOnHalfSpace(_QuarticIndenter):
    """Contact of a quartic indenter with a half space (I. N. Sneddon, 1965)."""

    @property
    def force(self) -> float:
        """Force P = 64/15 E* A a⁵."""
        return float(
            64 / 15 * self.body.plane_strain_modulus * self.coefficient * self.half_width**5
        )

    def pressure(self, x: Array) -> Array:
        """Return the pressure 32/(9 pi) E* A (a² + 2 r²) sqrt(a² - r²)."""
        return self._pressure(x, 32 / (9 * np.pi))

    def force_within(self, x: Array) -> Array:
        """Return the integral of the pressure over the disc of radius x."""
        cosine = np.sqrt(1 - np.clip(x / self.half_width, 0.0, 1.0) ** 2)
        force: Array = self.force * (1 - 5 / 3 * cosine**3 + 2 / 3 * cosine**5)
        return force

    def displacement(self, x: Array) -> Array:
        """Return displacements due to axial sources of a density proportional to a⁴ - t⁴."""
        t, weights = np.polynomial.legendre.leggauss(_N_SOURCES)
        strength = self.force * (1 - t**4) * weights / 1.6
        return self.body.displacement_by_imaginary_axial_sources(x, self.half_width * t, strength)

    @property
    def approach(self) -> float:
        """Indentation depth 8/3 A a⁴."""
        return 8 / 3 * self.coefficient * self.half_width**4
