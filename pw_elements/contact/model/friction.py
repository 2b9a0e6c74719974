"""Friction laws, which limit the tangential force, and the cone of forces that they admit.

A law limits the tangential force r_t of a node with normal force r_n >= 0 by

    |r_t| <= limit(r_n),    limit(0) = 0,

and gives the derivative of the limit. Coulomb's limit is mu r_n. All of these are nodal forces, not
stresses: a law for stresses has to multiply by the node's area, which its `parameter_at` may
return. The coefficient limit(r_n) / r_n must not rise with r_n, so that its value at zero, the
slope of the limit there, bounds it, and the cone with that slope contains all admissible forces.
This is checked at forces of many magnitudes before any computation, because those of a problem are
not known yet, and again at all forces that occur, where slopes are also compared with differences.
Laws are evaluated by `FrictionCone.limit` only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import arguments

# Normal forces at which coefficients are checked not to rise, and round-off of a coefficient,
# relative to its value at zero
_TEST_FORCES = 10.0 ** np.linspace(-12, 12, 24 * 16 + 1)
_COEFFICIENT_ROUND_OFF = 1e-9
# Step of differences over the normal force, and their error over the slope at zero
_RELATIVE_FORCE_STEP, _SLOPE_TOLERANCE = 1e-4, 1e-6


@runtime_checkable
class Friction(Protocol):
    """Friction law: a limit of the tangential force whose ratio to the normal one does not rise.

    Forces are those of nodes, not stresses: a limit of stress is one of force over a node's area.
    The iteration uses the slope as the derivative of the limit; it is compared with differences at
    all forces that occur.

    Any object with both methods is a law:

        class Worn:
            '''Coulomb's law with a coefficient that decreases to zero with the normal force.'''

            def parameter_at(self, x):
                return 50.0 + 10.0 * x[0]  # force at which the coefficient has halved

            def limit(self, half, force):
                fraction = half / (half + force)
                return 0.3 * fraction * force, 0.3 * fraction**2

        ContactPair(bottom, Plane((0, 0), (0, 1)), friction=Worn())
    """

    def parameter_at(self, x: Array) -> Array | float:
        """Return the law's parameter (n,) at each node, or one number for all.

        Args:
            x: positions as columns (3, n), of the nodes of all processes.
        """

    def limit(self, parameter: Array, force: Array) -> tuple[Array, Array]:
        """Return the largest tangential nodal force (n,) and its derivative (n,) by the normal one.

        Args:
            parameter: (n,), of these nodes, which may be those of another process.
            force: normal nodal forces (n,), not negative; not pressures.
        """


@dataclass(frozen=True)
class Coulomb:
    """Coulomb's law, |r_t| <= mu r_n, of nodal forces.

    A derived class may override `limit`, like any other law.

    Args:
        mu: the coefficient, or a function of positions as columns (3, n) that returns it for each
            node, (n,).
    """

    mu: float | Callable[[Array], Array]

    def parameter_at(self, x: Array) -> Array | float:
        """Return the coefficient (n,) at nodes, or one number for all.

        Args:
            x: positions as columns (3, n).
        """
        return self.mu(x) if callable(self.mu) else self.mu

    def limit(self, parameter: Array, force: Array) -> tuple[Array, Array]:
        """Return the largest tangential nodal force (n,) and its derivative (n,) by the normal one.

        Args:
            parameter: the coefficient (n,).
            force: normal nodal forces (n,), not pressures.
        """
        return parameter * force, parameter


@dataclass(frozen=True)
class FrictionCone:
    """Forces that the friction laws admit at contact points (m), pair after pair."""

    laws: Sequence[Friction]  # one per pair
    parameters: Sequence[Array]  # parameters of each law at the points of its pair
    errors: list[BaseException] | None = None  # errors of laws, raised later on all processes

    def limit(self, force: Array) -> tuple[Array, Array]:
        """Return the largest tangential forces (m,) with normal forces (m,), and their slopes (m,).

        If a law raises an error, and errors are collected, limits are NaN.
        """
        try:
            parts = np.split(
                force, np.cumsum([len(parameter) for parameter in self.parameters])[:-1]
            )
            pairs = zip(self.laws, self.parameters, parts, strict=True)
            limits_and_slopes = [
                self._evaluate_law(law, parameter, part) for law, parameter, part in pairs
            ]
        except BaseException as error:
            if self.errors is None:
                raise
            self.errors.append(error)
            return np.full(len(force), np.nan), np.zeros(len(force))
        limits, slopes = zip(*limits_and_slopes, strict=True)
        return np.concatenate(limits), np.concatenate(slopes)

    @staticmethod
    def _evaluate_law(law: Friction, parameter: Array, force: Array) -> tuple[Array, Array]:
        """Return limits and slopes of one law, checked if it is a user's."""
        limit, slope = law.limit(parameter, force)
        if type(law) is Coulomb:
            return limit, slope
        words = "it gives the limits and their slopes, (n,) each"
        results = ("the limit of friction", limit), ("its slope", slope)
        return tuple(  # type: ignore[return-value]
            arguments.check_function_values(name, values, force.shape, words)
            for name, values in results
        )

    @cached_property
    def has_user_law(self) -> bool:
        """Whether any law is a user's, which may raise errors and be wrong."""
        return any(type(law) is not Coulomb for law in self.laws)

    def raise_law_error(self) -> None:
        """Raise the last error of a law that has been collected, if there is one."""
        if self.errors:
            raise self.errors.pop()

    def coefficient(self, force: Array) -> Array:
        """Return the limit over normal forces (m,); at forces of zero, the slope of the limit."""
        limit, slope = self.limit(force)
        linear = (force <= 0) | (limit == slope * force)
        return np.where(linear, slope, limit / np.where(linear, 1.0, force))

    @cached_property
    def max_coefficient(self) -> Array:
        """Slopes (m,) of the limit at zero, which bound the coefficient."""
        return self.limit(np.zeros(sum(len(parameter) for parameter in self.parameters)))[1]

    def find_rising_coefficients(self) -> Mask:
        """Return the points (m,) whose coefficient rises with the normal force."""
        with np.errstate(all="ignore"):  # forces may be far outside the range of a law
            coefficients = [
                self.limit(np.full(len(self.max_coefficient), force))[0] / force
                for force in _TEST_FORCES
            ]
            changes = np.diff([self.max_coefficient, *coefficients], axis=0)
            rising = changes > _COEFFICIENT_ROUND_OFF * self.max_coefficient
        return np.asarray(rising.any(axis=0))

    def find_rising_coefficients_at(self, force: Array) -> Mask:
        """Return the points (m,) whose coefficient rises at normal forces, or exceeds that at zero.

        Args:
            force: (m,).
        """
        factors = (1 - _RELATIVE_FORCE_STEP, 1.0, 1 + _RELATIVE_FORCE_STEP)
        coefficients = [
            self.max_coefficient,
            *(self.coefficient(factor * force) for factor in factors),
        ]
        largest_change = np.diff(coefficients, axis=0).max(axis=0)
        rising = largest_change > _COEFFICIENT_ROUND_OFF * self.max_coefficient
        return np.asarray((force > 0) & rising)

    def compare_slopes(self, force: Array) -> tuple[Array, Array, Mask]:
        """Compare the slopes of the limit with differences at normal forces (m,).

        At a corner of the limit any slope between those of both sides is accepted.

        Returns:
            Slopes (m,), differences (m,), and the points (m,) at which they contradict each other.
        """
        pressed = force > 0
        force = np.where(pressed, force, 1.0)
        (limit, slope), step = self.limit(force), _RELATIVE_FORCE_STEP * force
        lower_limit, upper_limit = (self.limit(force + sign * step)[0] for sign in (-1, 1))
        one_sided = (limit - lower_limit) / step, (upper_limit - limit) / step
        smallest, largest = np.minimum(*one_sided), np.maximum(*one_sided)
        tolerance = _SLOPE_TOLERANCE * self.max_coefficient
        wrong = ~((slope >= smallest - tolerance) & (slope <= largest + tolerance))
        return slope, np.clip(slope, smallest, largest), pressed & wrong

    @cached_property
    def has_friction(self) -> Mask:
        """Points (m,) with any friction."""
        return self.max_coefficient > 0
