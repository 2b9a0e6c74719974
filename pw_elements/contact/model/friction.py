"""Friction: laws that limit the tangential force, and the cone of forces that they admit.

A law says how large the tangential force of a node may be beside its normal force r_n >= 0,

    |r_t| <= limit(r_n),    limit(0) = 0,

and which slope the limit has. Coulomb's is mu r_n. All of these are nodal forces, no stresses: a
law for stresses multiplies by the node's area, which its `at` may return. The coefficient
limit(r_n) / r_n must never rise with r_n: so the slope at zero bounds it, and the cone of that
slope holds all admitted forces. Laws are asked for it at forces of many sizes before any
computation, for those of a problem are not known then, and again at all forces that occur, where
slopes are compared with differences, too. Only `Cone.limit` asks a law, whichever it is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import arguments

# Normal forces at which laws are asked whether they rise, and what of a coefficient is round-off
_FORCES = 10.0 ** np.linspace(-12, 12, 24 * 16 + 1)
_ROUND_OFF = 1e-9
# Step of differences over a normal force, and their error over the steepest slope
_STEP, _DIFFERENCE = 1e-4, 1e-6


@runtime_checkable
class Friction(Protocol):
    """A law of friction: limit of the tangential force, whose ratio to the normal one never rises.

    Forces are those of nodes, not stresses: a cap of a stress is one of force over a node's area.
    The iteration takes the slope for the limit's derivative; it is compared with differences at all
    forces that occur.

    Any object with both methods is one:

        class Worn:
            '''Coulomb's law, with a coefficient that falls to nothing with the normal force.'''

            def at(self, x):
                return 50.0 + 10.0 * x[0]  # the force at which it has halved

            def limit(self, half, force):
                share = half / (half + force)
                return 0.3 * share * force, 0.3 * share**2

        ContactPair(bottom, Plane((0, 0), (0, 1)), friction=Worn())
    """

    def at(self, x: Array) -> Array | float:
        """The law's parameter (n,) at each node, or one number for all.

        Args:
            x: positions as columns (3, n), of the nodes of all processes.
        """

    def limit(self, at: Array, force: Array) -> tuple[Array, Array]:
        """Return the largest tangential nodal force (n,) beside a normal one, and its slope (n,).

        Args:
            at: what `at` gave for these nodes (n,), which may be those of another process.
            force: normal nodal forces (n,), none of them negative; no pressures.
        """


@dataclass(frozen=True)
class Coulomb:
    """Coulomb's law, |r_t| <= mu r_n, of nodal forces.

    A class derived from it may override `limit`, as any law states it.

    Args:
        mu: the coefficient, or a function of positions as columns (3, n) that returns it for each
            node, (n,).
    """

    mu: float | Callable[[Array], Array]

    def at(self, x: Array) -> Array | float:
        """The coefficient (n,) of nodes.

        Args:
            x: positions as columns (3, n).
        """
        return self.mu(x) if callable(self.mu) else self.mu

    def limit(self, at: Array, force: Array) -> tuple[Array, Array]:
        """Return the largest tangential nodal force (n,) beside a normal one, and its slope (n,).

        Args:
            at: the coefficient (n,).
            force: normal nodal forces (n,), no pressures.
        """
        return at * force, at


@dataclass(frozen=True)
class Cone:
    """Forces that the laws of friction admit at contact points (m), pair after pair."""

    laws: Sequence[Friction]  # one per pair
    at: Sequence[Array]  # what each of them says of the pair's points
    failed: list[BaseException] | None = None  # what they raised, to be told under a guard

    def limit(self, force: Array) -> tuple[Array, Array]:
        """Largest tangential forces (m,) beside normal forces (m,), and their slopes (m,).

        Where a law fails, and this is kept, limits are NaN.
        """
        try:
            parts = np.split(force, np.cumsum([len(at) for at in self.at])[:-1])
            pairs = zip(self.laws, self.at, parts, strict=True)
            each = [self._of(law, at, part) for law, at, part in pairs]
        except BaseException as error:
            if self.failed is None:
                raise
            self.failed.append(error)
            return np.full(len(force), np.nan), np.zeros(len(force))
        limits, slopes = zip(*each, strict=True)
        return np.concatenate(limits), np.concatenate(slopes)

    @staticmethod
    def _of(law: Friction, at: Array, force: Array) -> tuple[Array, Array]:
        limit, slope = law.limit(at, force)
        if type(law) is Coulomb:
            return limit, slope
        words = "it gives the limits and their slopes, (n,) each"
        names = ("the limit of friction", limit), ("its slope", slope)
        return tuple(
            arguments.check_function_values(name, one, force.shape, words) for name, one in names
        )  # type: ignore[return-value]

    @cached_property
    def has_user_law(self) -> bool:
        """Return whether any law is a user's, which may raise errors and be wrong."""
        return any(type(law) is not Coulomb for law in self.laws)

    def tell(self) -> None:
        if self.failed:
            raise self.failed.pop()

    def coefficient(self, force: Array) -> Array:
        """The limit over normal forces (m,); its slope at zero where there is none."""
        limit, slope = self.limit(force)
        linear = (force <= 0) | (limit == slope * force)
        return np.where(linear, slope, limit / np.where(linear, 1.0, force))

    @cached_property
    def steepest(self) -> Array:
        """Slope (m,) at zero, which bounds the coefficient."""
        return self.limit(np.zeros(sum(len(at) for at in self.at)))[1]

    def rises(self) -> Mask:
        """Which points (m,) have a coefficient that rises with the normal force."""
        with np.errstate(all="ignore"):  # far from what a law may have been made for
            limits = [self.limit(np.full(len(self.steepest), one))[0] / one for one in _FORCES]
            larger = np.diff([self.steepest, *limits], axis=0) > _ROUND_OFF * self.steepest
        return np.asarray(larger.any(axis=0))

    def rises_at(self, force: Array) -> Mask:
        """Return at which points (m,) the coefficient rises there, or is more than at zero."""
        steps = (1 - _STEP, 1.0, 1 + _STEP)
        coefficients = [self.steepest, *(self.coefficient(step * force) for step in steps)]
        larger = np.diff(coefficients, axis=0).max(axis=0) > _ROUND_OFF * self.steepest
        return np.asarray((force > 0) & larger)

    def slopes(self, force: Array) -> tuple[Array, Array, Mask]:
        """Return slopes (m,), differences of the limit instead, and where (m,) they are unlike.

        At a corner of the limit any slope between those on both sides will do.
        """
        pressed = force > 0
        force = np.where(pressed, force, 1.0)
        (limit, slope), step = self.limit(force), _STEP * force
        below, above = (self.limit(force + sign * step)[0] for sign in (-1, 1))
        sides = (limit - below) / step, (above - limit) / step
        least, most = np.minimum(*sides), np.maximum(*sides)
        allowed = _DIFFERENCE * self.steepest
        unlike = ~((slope >= least - allowed) & (slope <= most + allowed))
        return slope, np.clip(slope, least, most), pressed & unlike

    @cached_property
    def rough(self) -> Mask:
        """Which points (m,) have any friction."""
        return self.steepest > 0
