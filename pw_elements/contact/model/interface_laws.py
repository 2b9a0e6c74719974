"""Interface laws of the library: elastic layers, ties, contact with friction and wear, cohesion."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pw_elements.arrays import Array
from pw_elements.checks import arguments, defer_errors_if_parallel
from pw_elements.contact.model.laws import InterfaceResponse, InterfaceValues


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[:, :, None] * b[:, None, :])


def _divide_or_zero(numerator: Array, denominator: Array) -> Array:
    """Return quotients (m,), which are zero where the denominator is zero."""
    return np.divide(numerator, denominator, out=np.zeros_like(denominator), where=denominator != 0)


def _unit_vectors(vectors: Array) -> tuple[Array, Array]:
    """Return the lengths (m,) of vectors (m, k), and unit vectors; zero for zero vectors."""
    size = np.linalg.norm(vectors, axis=1)
    return size, vectors / np.where(size > 0, size, 1.0)[:, None]


@dataclass(frozen=True)
class ElasticInterface:
    """Thin elastic layer between body and surface, which resists compression and tension.

    The nodal force is the weight of the node times the traction

        p = -normal_stiffness g,    t = -tangential_stiffness v

    with the gap g and the slip v since the undeformed state. The layer is free of stress at zero
    gap.

    Args:
        normal_stiffness: pressure per length of the gap.
        tangential_stiffness: shear stress per length of the slip.

    Raises:
        ValueError: for a stiffness that is negative or not finite.
    """

    normal_stiffness: float
    tangential_stiffness: float

    n_history = 0

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if arguments.check_finite_number(name, value) < 0:
                raise ValueError(f"{name} is {value}: it must not be negative")

    def initial_history(self, gap: Array, weight: Array) -> Array:  # noqa: ARG002
        """Return an array (m, 0): the layer has no history.

        Args:
            gap: (m,), gaps before any motion.
            weight: (m,), weights of the nodes.
        """
        return np.zeros((len(gap), 0))

    def evaluate(self, values: InterfaceValues) -> InterfaceResponse:
        """Return forces, derivatives and history at some nodes.

        Args:
            values: gaps, slips, forces, history and weights of the nodes.
        """
        m, dim = values.force.shape
        stiffness = np.full(dim, float(self.tangential_stiffness))
        stiffness[0] = self.normal_stiffness
        by_motion = -values.weight[:, None, None] * np.diag(stiffness)
        motion = np.column_stack([values.gap, values.slip])
        force = np.einsum("nab,nb->na", by_motion, motion)
        return InterfaceResponse(force, by_motion, np.zeros((m, dim, dim)), values.history)


@dataclass(frozen=True)
class Tie:
    """Permanent connection: gap and slip keep their values of the undeformed state.

    The gap of the undeformed state is not closed but kept, so that non-matching meshes of one
    curved interface are tied without stress. The force may be of either sign.
    """

    n_history = 1

    def initial_history(self, gap: Array, weight: Array) -> Array:  # noqa: ARG002
        """Return the initial gaps (m, 1), which the tie keeps.

        Args:
            gap: (m,), gaps before any motion.
            weight: (m,), weights of the nodes.
        """
        return np.asarray(gap[:, None])

    def evaluate(self, values: InterfaceValues) -> InterfaceResponse:
        """Return forces, derivatives and history at some nodes.

        Args:
            values: gaps, slips, forces, history and weights of the nodes.
        """
        m, dim = values.force.shape
        identity = np.broadcast_to(np.eye(dim), (m, dim, dim))
        motion = np.column_stack([values.gap - values.history[:, 0], values.slip])
        force = values.force - values.stiffness[:, None] * motion
        return InterfaceResponse(
            force, -values.stiffness[:, None, None] * identity, identity, values.history
        )


@dataclass(frozen=True)
class UnilateralContact:
    """Unilateral contact with friction whose coefficient may change, and with wear.

    Without further arguments it is the contact with Coulomb friction of pairs without an interface
    law. With the pressure p = r_n / weight and the path s, which is the sum of the slips of all
    increments, friction obeys |r_t| <= mu(p, s) r_n. Slip is measured in each increment.

    With a `regularisation_length` e, friction is the smooth function of the slip increment v

        r_t = -mu(p, s) r_n v / sqrt(|v|^2 + e^2)

    in place of Coulomb's law, so that nodes always slip a little (P. Wriggers, Computational
    Contact Mechanics, 2nd edition, Springer 2006, chapter 5, regularised Coulomb laws).

    With a `wear_coefficient` k, Archard's law removes material (J. F. Archard, Contact and rubbing
    of flat surfaces, Journal of Applied Physics 24, 1953): the worn depth h grows in each increment
    by k p |v|, with p and v at its end, so that the worn volume is k times the normal force times
    the path. Gaps of the next increment are larger by h.

    Args:
        friction: coefficient mu, or a function of pressures (m,) and paths (m,) that returns the
            coefficients (m,) and their derivatives (m,) by pressure and by path.
        regularisation_length: length e of the regularisation; None for Coulomb's law.
        wear_coefficient: worn depth k per pressure and path.

    Raises:
        TypeError, ValueError: for a coefficient or length that is negative or not finite.
    """

    friction: float | Callable[[Array, Array], tuple[Array, Array, Array]] = 0.0
    regularisation_length: float | None = None
    wear_coefficient: float = 0.0

    n_history = 2

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        numbers = {"the wear coefficient": self.wear_coefficient}
        if not callable(self.friction):
            numbers["the friction"] = self.friction
        for name, value in numbers.items():
            if arguments.check_finite_number(name, value) < 0:
                raise ValueError(f"{name} is {value}: it must not be negative")
        if self.regularisation_length is not None:
            arguments.check_positive("the regularisation length", self.regularisation_length)

    def initial_history(self, gap: Array, weight: Array) -> Array:  # noqa: ARG002
        """Return path and worn depth (m, 2), which are zero.

        Args:
            gap: (m,), gaps before any motion.
            weight: (m,), weights of the nodes.
        """
        return np.zeros((len(gap), 2))

    def evaluate(self, values: InterfaceValues) -> InterfaceResponse:
        """Return forces, derivatives and new history (path and worn depth) at some nodes.

        Args:
            values: gaps, slips, forces, history and weights of the nodes.
        """
        (m, dim), c, w = values.force.shape, values.stiffness, values.weight
        start_path, worn_depth = values.history.T
        trial_pressure = values.force[:, 0] - c * (values.gap + worn_depth)
        is_closed = trial_pressure > 0
        normal_force = np.where(is_closed, trial_pressure, 0.0)
        slip_size, slip_direction = _unit_vectors(values.slip_increment)
        path = start_path + np.where(is_closed, slip_size, 0.0)
        limit, by_normal, by_path = self._limit_and_derivatives(normal_force, path, w)
        force, by_motion, by_force = np.zeros((m, dim)), *np.zeros((2, m, dim, dim))
        force[:, 0] = normal_force
        by_force[is_closed, 0, 0], by_motion[is_closed, 0, 0] = 1.0, -c[is_closed]
        if self.regularisation_length is None:
            trial = values.force[:, 1:] - c[:, None] * values.slip_increment
            size, direction = _unit_vectors(trial)
            slips = (size > limit) | (limit <= 0)
            ratio = np.where(slips, _divide_or_zero(np.maximum(limit, 0.0), size), 1.0)
            projector = np.eye(dim - 1) - np.where(slips, 1.0, 0.0)[:, None, None] * _outer(
                direction, direction
            )
            by_trial = ratio[:, None, None] * projector
            force[:, 1:] = ratio[:, None] * trial
            by_force[:, 1:, 1:] = by_trial
            by_motion[:, 1:, 1:] = -c[:, None, None] * by_trial
            by_limit = np.where(slips, 1.0, 0.0)[:, None] * direction
        else:
            smooth_size = np.sqrt(slip_size**2 + self.regularisation_length**2)
            by_limit = -values.slip_increment / smooth_size[:, None]
            force[:, 1:] = limit[:, None] * by_limit
            by_motion[:, 1:, 1:] = (limit / smooth_size)[:, None, None] * (
                _outer(by_limit, by_limit) - np.eye(dim - 1)
            )
        by_force[:, 1:, 0] = by_normal[:, None] * by_limit
        by_motion[:, 1:, 0] = -(c * by_normal)[:, None] * by_limit
        by_motion[:, 1:, 1:] += _outer(by_path[:, None] * by_limit, slip_direction)
        for part in (force, by_motion, by_force):
            part[~is_closed] = 0.0
        wear = self.wear_coefficient * _divide_or_zero(normal_force, w) * (path - start_path)
        history = np.column_stack([path, worn_depth + wear])
        return InterfaceResponse(force, by_motion, by_force, history)

    def _limit_and_derivatives(
        self, normal_force: Array, path: Array, weight: Array
    ) -> tuple[Array, Array, Array]:
        """Return friction limits (m,), and their derivatives by normal force and by path."""
        if not callable(self.friction):
            return (
                self.friction * normal_force,
                np.full_like(path, self.friction),
                np.zeros_like(path),
            )
        pressure = _divide_or_zero(normal_force, weight)
        mu, by_pressure, by_path = (
            arguments.check_user_function_values(
                "the friction", values, path.shape, "it gives (m,) for pressures and paths (m,)"
            )
            for values in self.friction(pressure, path)
        )
        return mu * normal_force, mu + by_pressure * pressure, by_path * normal_force


@dataclass(frozen=True)
class CohesiveContact:
    """Cohesion that is damaged by opening and slip, with unilateral contact under compression.

    With the gap g > 0, the slip v since the undeformed state, and the effective opening
    d = sqrt(g^2 + |v|^2), the tractions that the surface exerts are

        p = -(1 - D) K g,    t = -(1 - D) K v.

    The damage D follows from the largest effective opening d_max that has occurred, such that the
    traction falls linearly from the strength, at d_0 = strength / stiffness, to zero at
    d_f = 2 toughness / strength:

        1 - D = d_0 (d_f - d_max) / (d_max (d_f - d_0))    for d_0 < d_max < d_f.

    The area under the curve is the toughness. A gap of the undeformed state counts as an opening
    that has occurred, so that there is no bond where it is larger than d_f. Pressed nodes do not
    penetrate the surface, without a penalty; they keep their damaged shear stiffness. Friction is
    not included.

    Args:
        stiffness: initial stiffness K, a traction per length.
        strength: largest traction.
        toughness: energy per area of complete separation. It must be larger than
            strength^2 / (2 stiffness).

    Raises:
        ValueError: for values that are not positive, or a toughness that is too small.
    """

    stiffness: float
    strength: float
    toughness: float

    n_history = 1

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            arguments.check_positive(f"the {name} of a cohesive law", value)
        least = self.strength**2 / (2 * self.stiffness)
        if self.toughness <= least:
            raise ValueError(
                f"the toughness of a cohesive law is {self.toughness:.6g}: it has to exceed the "
                f"elastic energy at the strength, strength^2 / (2 stiffness) = {least:.6g}"
            )

    @property
    def elastic_limit(self) -> float:
        """Opening d_0 at which damage begins."""
        return self.strength / self.stiffness

    @property
    def final_opening(self) -> float:
        """Opening d_f at which the traction has fallen to zero."""
        return 2 * self.toughness / self.strength

    def softened_fraction(self, history: Array) -> Array:
        """Return the part (m,) of the softening branch that nodes have passed, from 0 to 1.

        Args:
            history: (m, 1), largest effective openings.
        """
        d_0, d_f = self.elastic_limit, self.final_opening
        return np.clip((history[:, 0] - d_0) / (d_f - d_0), 0.0, 1.0)

    def initial_history(self, gap: Array, weight: Array) -> Array:  # noqa: ARG002
        """Return the largest effective openings (m, 1), which are the initial gaps.

        Args:
            gap: (m,), gaps before any motion.
            weight: (m,), weights of the nodes.
        """
        return np.maximum(gap, 0.0)[:, None]

    def evaluate(self, values: InterfaceValues) -> InterfaceResponse:
        """Return forces, derivatives and new history at some nodes.

        Args:
            values: gaps, slips, forces, history and weights of the nodes.
        """
        (m, dim), d_0, d_f = values.force.shape, self.elastic_limit, self.final_opening
        trial_pressure = values.force[:, 0] - values.stiffness * values.gap
        is_pressed = trial_pressure > 0
        opening = np.column_stack([np.where(is_pressed, 0.0, values.gap), values.slip])
        size, direction = _unit_vectors(opening)
        old_largest = values.history[:, 0]
        largest = np.maximum(old_largest, size)
        divisor = np.where(largest > 0, largest, 1.0)
        softening = d_0 * (d_f - largest) / (divisor * (d_f - d_0))
        soundness = np.where(largest <= d_0, 1.0, np.maximum(0.0, softening))
        softens = (size > old_largest) & (largest > d_0) & (largest < d_f)
        soundness_slope = np.where(softens, -d_0 * d_f / (divisor**2 * (d_f - d_0)), 0.0)
        k = values.weight * self.stiffness
        force = -(k * soundness)[:, None] * opening
        by_motion = -(k * soundness)[:, None, None] * np.eye(dim)
        by_motion = by_motion - _outer((k * soundness_slope)[:, None] * opening, direction)
        by_force = np.zeros((m, dim, dim))
        by_motion[is_pressed, :, 0] = by_motion[is_pressed, 0, :] = 0.0
        force[is_pressed, 0] = trial_pressure[is_pressed]
        by_force[is_pressed, 0, 0] = 1.0
        by_motion[is_pressed, 0, 0] = -values.stiffness[is_pressed]
        return InterfaceResponse(force, by_motion, by_force, largest[:, None])
