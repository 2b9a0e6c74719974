"""Friction laws, which limit tangential forces, and the cone of contact forces that they admit.

A law limits the tangential force r_t of a node with normal force r_n >= 0 by

    |r_t| <= limit(r_n),    limit(0) = 0,

and gives the derivative of the limit. Coulomb's limit is mu r_n. All of these forces are nodal
forces, not stresses. A law that limits the shear stress has to multiply its limit by the node's
area, which its `parameter_at` may return.

The coefficient limit(r_n) / r_n must not rise with r_n. Its value at zero, which is the slope of
the limit there, then bounds the coefficient, and the cone with this slope contains all admissible
forces. Coefficients are checked at forces of many magnitudes before any computation, because the
forces of a problem are not known yet. They are checked again at all forces that occur, where the
slopes of limits are also compared with finite differences. Only
`FrictionCone.friction_limits_and_slopes` evaluates laws.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import arguments

# Normal forces at which it is checked that coefficients do not rise; and round-off of a
# coefficient, relative to the coefficient at zero force
_COEFFICIENT_CHECK_NORMAL_FORCES = 10.0 ** np.linspace(-12, 12, 24 * 16 + 1)
_RELATIVE_FRICTION_COEFFICIENT_ROUND_OFF = 1e-9
# Step of finite differences relative to the normal force, and largest error of the differences
# relative to the slope of the limit at zero force
_RELATIVE_NORMAL_FORCE_STEP, _SLOPE_TOLERANCE_PER_SLOPE_AT_ZERO = 1e-4, 1e-6


@runtime_checkable
class Friction(Protocol):
    """Friction law: limit of the tangential force as a function of the normal force.

    The ratio of the limit to the normal force must not rise with the normal force. Forces are nodal
    forces, not stresses: a limit of the shear stress has to be multiplied by the node's area. The
    iteration uses the slope that `limit` returns, which is compared with finite differences at all
    forces that occur.

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
        """Return the law's parameter (n,) at each node, or one number for all nodes.

        Args:
            x: positions of the nodes of all processes, as columns (3, n).
        """

    def limit(self, parameter: Array, normal_force: Array) -> tuple[Array, Array]:
        """Return the limits (n,) of the tangential nodal forces, and the slopes (n,) of the limits.

        A slope is the derivative of the limit with respect to the normal force.

        Args:
            parameter: (n,), the law's parameter at each node. The nodes may belong to another
                process.
            normal_force: (n,), normal nodal forces, not pressures; they are not negative.
        """


@dataclass(frozen=True)
class Coulomb:
    """Coulomb's law |r_t| <= mu r_n for tangential and normal nodal forces r_t and r_n.

    A derived class may override `limit`; it is then treated like any other law.

    Args:
        mu: the coefficient of friction, or a function that takes positions as columns (3, n) and
            returns the coefficient (n,) at each of them.
    """

    mu: float | Callable[[Array], Array]

    def parameter_at(self, x: Array) -> Array | float:
        """Return the coefficient (n,) of friction at each node, or one number for all nodes.

        Args:
            x: positions of the nodes, as columns (3, n).
        """
        return self.mu(x) if callable(self.mu) else self.mu

    def limit(self, parameter: Array, normal_force: Array) -> tuple[Array, Array]:
        """Return the limits (n,) of the tangential nodal forces, and the slopes (n,) of the limits.

        A slope is the derivative of the limit with respect to the normal force.

        Args:
            parameter: (n,), coefficient of friction at each node.
            normal_force: (n,), normal nodal forces, not pressures.
        """
        return parameter * normal_force, parameter


@dataclass(frozen=True)
class FrictionCone:
    """Forces that the friction laws admit at the m contact points, which are sorted by pair.

    If `errors` is a list, exceptions that laws raise are collected in it, and can then be raised on
    all processes by `raise_collected_law_error`. If it is None, they are raised at once.
    """

    laws: Sequence[Friction]  # one per pair
    parameters: Sequence[Array]  # parameters of each law at the points of its pair
    errors: list[BaseException] | None = None

    def friction_limits_and_slopes(self, normal_force: Array) -> tuple[Array, Array]:
        """Return the limits (m,) of tangential forces at normal forces (m,), and their slopes (m,).

        A slope is the derivative of the limit with respect to the normal force. If a law raises an
        error and `errors` is a list, the error is added to `errors`, and all limits are NaN.
        """
        try:
            limits_and_slopes = [
                self._evaluate_law(law, parameter, normal_force[rows])
                for law, parameter, rows in zip(
                    self.laws, self.parameters, self._rows_of_each_law, strict=True
                )
            ]
        except BaseException as error:
            if self.errors is None:
                raise
            self.errors.append(error)
            return np.full(len(normal_force), np.nan), np.zeros(len(normal_force))
        limits, slopes = zip(*limits_and_slopes, strict=True)
        return np.concatenate(limits), np.concatenate(slopes)

    @cached_property
    def _rows_of_each_law(self) -> list[slice]:
        ends = np.cumsum([0, *(len(parameter) for parameter in self.parameters)])
        return [slice(*pair_rows) for pair_rows in pairwise(ends)]

    @staticmethod
    def _evaluate_law(law: Friction, parameter: Array, normal_force: Array) -> tuple[Array, Array]:
        """Return the limits and slopes of one law; check the arrays that a user's law returns."""
        limit, slope = law.limit(parameter, normal_force)
        if type(law) is Coulomb:
            return limit, slope
        words = "it gives the limits and their slopes, (n,) each"
        results = ("the limit of friction", limit), ("its slope", slope)
        return tuple(  # type: ignore[return-value]
            arguments.check_user_function_values(name, values, normal_force.shape, words)
            for name, values in results
        )

    @cached_property
    def has_user_law(self) -> bool:
        """Whether any law has been written by the user and may therefore be wrong."""
        return any(type(law) is not Coulomb for law in self.laws)

    def raise_collected_law_error(self) -> None:
        """Raise the last error of a law in `errors`, if there is one."""
        if self.errors:
            raise self.errors.pop()

    def coefficient(self, normal_force: Array) -> Array:
        """Return the coefficients (m,) of friction, the limits divided by the normal forces (m,).

        Where the normal force is zero or negative, the coefficient is the slope of the limit.
        """
        limit, slope = self.friction_limits_and_slopes(normal_force)
        linear = (normal_force <= 0) | (limit == slope * normal_force)
        return np.where(linear, slope, limit / np.where(linear, 1.0, normal_force))

    @cached_property
    def max_coefficient(self) -> Array:
        """Slopes (m,) of the limits at zero normal force, which bound the coefficients."""
        return self.friction_limits_and_slopes(
            np.zeros(sum(len(parameter) for parameter in self.parameters))
        )[1]

    def find_coefficients_rising_with_force(self) -> Mask:
        """Return a mask (m,) of the points at which the coefficient rises with the normal force."""
        if not self.has_user_law:  # Coulomb's coefficient is constant
            return np.zeros(len(self.max_coefficient), dtype=bool)
        with np.errstate(all="ignore"):  # forces may be far outside the range of a law
            coefficients = [
                self.friction_limits_and_slopes(np.full(len(self.max_coefficient), force))[0]
                / force
                for force in _COEFFICIENT_CHECK_NORMAL_FORCES
            ]
            changes = np.diff([self.max_coefficient, *coefficients], axis=0)
            rising = changes > _RELATIVE_FRICTION_COEFFICIENT_ROUND_OFF * self.max_coefficient
        return np.asarray(rising.any(axis=0))

    def find_coefficients_rising_near_force(self, normal_force: Array) -> Mask:
        """Return a mask (m,) of points whose coefficient rises near their normal force.

        The mask includes points whose coefficient exceeds the coefficient at zero force.

        Args:
            normal_force: (m,), normal forces.
        """
        factors = (1 - _RELATIVE_NORMAL_FORCE_STEP, 1.0, 1 + _RELATIVE_NORMAL_FORCE_STEP)
        coefficients = [
            self.max_coefficient,
            *(self.coefficient(factor * normal_force) for factor in factors),
        ]
        largest_change = np.diff(coefficients, axis=0).max(axis=0)
        rising = largest_change > _RELATIVE_FRICTION_COEFFICIENT_ROUND_OFF * self.max_coefficient
        return np.asarray((normal_force > 0) & rising)

    def compare_slopes_with_finite_differences(
        self, normal_force: Array
    ) -> tuple[Array, Array, Mask]:
        """Compare the slopes of the limits with finite differences at normal forces (m,).

        At a corner of a limit any slope between the two one-sided slopes is accepted.

        Returns:
            The slopes (m,) that the laws give; the closest slopes (m,) that the finite differences
            allow; and a mask (m,) of the points at which the two contradict each other.
        """
        pressed = normal_force > 0
        normal_force = np.where(pressed, normal_force, 1.0)
        (limit, slope), step = (
            self.friction_limits_and_slopes(normal_force),
            _RELATIVE_NORMAL_FORCE_STEP * normal_force,
        )
        lower_limit, upper_limit = (
            self.friction_limits_and_slopes(normal_force + sign * step)[0] for sign in (-1, 1)
        )
        one_sided = (limit - lower_limit) / step, (upper_limit - limit) / step
        smallest, largest = np.minimum(*one_sided), np.maximum(*one_sided)
        tolerance = _SLOPE_TOLERANCE_PER_SLOPE_AT_ZERO * self.max_coefficient
        wrong = ~((slope >= smallest - tolerance) & (slope <= largest + tolerance))
        return slope, np.clip(slope, smallest, largest), pressed & wrong

    @cached_property
    def has_friction(self) -> Mask:
        """Mask (m,) of the points that have friction."""
        return self.max_coefficient > 0
