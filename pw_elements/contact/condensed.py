"""An increment as its contact points alone see it: dense, small, and the same on every process.

The body's stiffness is condensed to the contact points (a Schur complement): with w the motion of
the points' free components, the forces are r = S w + r_0. S is found by moving one component at
a time, by one factorisation of the matrix in which all points are held; a body that floats is held
then, too, so that it has a stiffness S where it has no compliance. With the free translations U,
all that the law speaks of is linear in z = (w; U).
"""

import warnings
from dataclasses import dataclass
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgWarning, solve

from pw_elements.contact.interface import Interface
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.law import ActiveSet, Contact, equations
from pw_elements.contact.newton import Increment
from pw_elements.contact.state import Free
from pw_elements.contact.system import ContactSystem
from pw_elements.linear_solver import LinearSolver, SolverReport
from pw_elements.reduction import Reduction

Array = npt.NDArray[np.float64]

# Violation of the law and of balances over the largest contact force
_TOLERANCE = 1e-9
# Singular values that count as none, over the largest
_SINGULAR = 1e-12
# Smallest part of a step that a line search tries, and decrease that it asks for
_SHORTEST = 1e-6
_DECREASE = 1e-4


class Condensation:
    """Stiffness S of a body, condensed to its contact points.

    Args:
        K: free stiffness, (n, n).
        reduction: supports.
        interface: contact points.
        solver: of the linear systems.

    Attributes:
        stiffness: (p, p) of the p stated components of all points, in `gathered` order.

    Raises:
        SingularSystem: if not even the contact points hold the body.
    """

    def __init__(
        self, K: PETSc.Mat, reduction: Reduction, interface: Interface, solver: LinearSolver
    ) -> None:
        self._interface = interface
        self._system = ContactSystem(K, reduction, interface, (), solver)
        own = np.arange(len(interface.pair))
        first = sum(interface.comm.allgather(len(own))[: interface.comm.rank])
        number = gathered(interface, first + own)
        stated = gathered(interface, interface.equation >= 0)
        load = self._system.stiffness.createVecLeft()
        columns = []
        for point, axis in np.argwhere(stated):
            moved = np.zeros_like(interface.position)
            moved[own[first + own == number[point]], axis] = 1.0
            columns.append(self._forces(load, moved)[stated])
        self.stiffness = np.stack(columns, axis=1)

    @property
    def report(self) -> SolverReport:
        """What it took."""
        return self._system.report

    def at_rest(self, load: PETSc.Vec, supported: Array) -> Array:
        """Forces (points, dim) under a reduced load while the points rest.

        `supported` (m, dim) is what supports make of the motion.
        """
        return self._forces(load, -supported)

    def displaced(self, load: PETSc.Vec, moved: Array) -> PETSc.Vec:
        """Reduced displacements under a reduced load, the points' motion (m, dim) being given.

        Without what supports make of it.
        """
        system, dim = self._system, moved.shape[1]
        none = np.zeros((len(moved), dim, dim))
        held = system.scale[:, None, None] * np.eye(dim)
        constraint = system.scale[:, None] * moved
        return system.solve(load, none, held, none, constraint, np.zeros(0))[0]

    def _forces(self, load: PETSc.Vec, moved: Array) -> Array:
        force, _ = self._system.forces(self.displaced(load, moved), load)
        return gathered(self._interface, force)


def gathered(interface: Interface, values: npt.NDArray) -> npt.NDArray:
    """Values (m, ...) at the points of all processes: pair after pair, by position."""
    return np.concatenate([interface.in_order(k, values) for k in range(interface.pairs)])


def scattered(interface: Interface, values: npt.NDArray) -> npt.NDArray:
    """This process' rows (m, ...) of `gathered` values."""
    counts = [len(interface.in_order(k, interface.friction)) for k in range(interface.pairs)]
    return interface.local(np.split(values, np.cumsum(counts)[:-1]))


@dataclass(frozen=True)
class Affine:
    """A linear function of z, and its value at zero."""

    slope: Array
    value: Array

    def at(self, z: Array) -> Array:
        """Its value."""
        return self.slope @ z + self.value


class CondensedIncrement:
    """Forces, gaps and slips of all contact points as functions of z = (w; U).

    Args:
        increment: the equations.
        condensation: of the body.
        place: where the kinematics are linearised.

    Attributes:
        force: components (points, dim) along the frames.
        gap: (points,), zero where nothing faces a point.
        slip: (points, dim - 1).
        balance: of the free translations, total force less what is prescribed.
        start: z at the increment's start.
    """

    def __init__(self, increment: Increment, condensation: Condensation, place: Kinematics) -> None:
        interface = increment.interface
        self._interface = interface
        self.free: Free = increment.system.free
        self.condensation = condensation

        def all_of(values: npt.NDArray) -> npt.NDArray:
            return gathered(interface, values)

        self.frame, gap = all_of(place.frame), all_of(place.gap)
        self.friction = all_of(interface.friction)
        self.scale = all_of(increment.system.scale)
        self.faced = np.isfinite(gap)
        self._stated = all_of(interface.equation >= 0)
        points, dim = self._stated.shape
        self._prescribed = increment.prescribed
        pair = all_of(interface.pair)
        supported = np.where(self._stated, 0.0, all_of(increment.supported))
        moved, followed = self._motions(pair, supported)
        loss, tangents = all_of(place.loss), self.frame[:, 1:]
        since = Affine(followed.slope, followed.value - place.translations[pair])
        turning = all_of(place.turned_force)
        turned_slip = all_of(place.turned_slip)

        slope = np.zeros((points * dim, moved.slope.shape[-1]))
        slope[np.ix_(self._places, np.arange(self.unknowns))] = condensation.stiffness
        rest = np.where(self._stated, condensation.at_rest(increment.load, increment.supported), 0)
        self._nodal = Affine(slope.reshape(points, dim, -1), rest)
        self.force = _sum(_through(self.frame, self._nodal), _through(turning, since))
        normal = self.frame[:, None, 0]
        towards = _sum(_through(normal, moved), _through(-loss[:, None], since))
        self.gap = Affine(towards.slope[:, 0], towards.value[:, 0] + np.where(self.faced, gap, 0.0))
        relative = Affine(
            moved.slope - followed.slope, moved.value - followed.value - all_of(place.past)
        )
        self.slip = _sum(_through(tangents, relative), _through(turned_slip, since))
        sums = np.array([(pair == k)[:, None] * (np.arange(dim) == axis) for k, axis in self.free])
        sums = sums.reshape(len(self.free), points * dim).astype(float)
        self.sums = sums[:, self._places]
        self.balance = Affine(sums @ slope, sums @ rest.ravel() - increment.totals)
        past = all_of(increment.past.displacement).ravel()[self._places]
        self.start = np.append(past, [increment.past.translations[at] for at in self.free])

    @cached_property
    def _places(self) -> npt.NDArray[np.intp]:
        """Numbers of the stated components among all."""
        return np.flatnonzero(self._stated.ravel())

    @property
    def unknowns(self) -> int:
        """Number of motions w."""
        return len(self._places)

    def contact(self, z: Array) -> Contact:
        """Gaps, slips and forces."""
        gap = np.where(self.faced, self.gap.at(z), np.inf)
        return Contact(
            self.frame, gap, self.slip.at(z), self.force.at(z), self.friction, self.scale
        )

    def step(self, active: ActiveSet, z: Array) -> Array:
        """The way from z to the solution of an active set; the shortest if there are many."""
        A, B = equations(active, self.friction, self.scale)
        slope = np.concatenate([self.gap.slope[:, None], self.slip.slope], axis=1)
        value = np.concatenate([self.gap.value[:, None], self.slip.value], axis=1)
        law = _sum(_through(A, self.force), _through(B, Affine(slope, value)))
        law = self.in_components(law)
        matrix = np.vstack([law.slope, self.balance.slope])
        right = -np.append(law.at(z), self.balance.at(z))
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)  # singular but for round-off
            try:
                return np.asarray(solve(matrix, right))
            except (np.linalg.LinAlgError, LinAlgWarning):
                return np.asarray(np.linalg.lstsq(matrix, right, rcond=_SINGULAR)[0])

    def in_components(self, framed: Affine) -> Affine:
        """What is stated of each point along its frame, in the stated components: (p, ...)."""
        turned = _through(np.swapaxes(self.frame, 1, 2), framed)
        slope = turned.slope.reshape(turned.value.size, turned.slope.shape[-1])[self._places]
        return Affine(slope, turned.value.ravel()[self._places])

    def residual(self, z: Array) -> Array:
        """Violation of the law and of the balances; zero at a solution."""
        wrong = np.einsum("nab,na->nb", self.frame, self.contact(z).violation())
        return np.append(wrong.ravel()[self._places], self.balance.at(z))

    def solved_by(self, z: Array) -> bool:
        """Whether all conditions hold."""
        return self.error(z) <= _TOLERANCE

    def error(self, z: Array) -> float:
        """Largest violation of the law and of the balances over the largest force."""
        largest = np.abs(self._nodal.at(z)).max(initial=0.0)
        wrong = np.abs(self.residual(z)).max(initial=0.0)
        return float(wrong / largest) if wrong > 0 else 0.0

    def newton(self, z: Array, most: int, damped: bool) -> Array | None:
        """Semismooth Newton from z, damped by a line search on the residual; None if it fails."""
        for _ in range(most):
            if self.solved_by(z):
                return z
            step = self.step(self.contact(z).active_set(), z)
            if not np.isfinite(step).all():
                return None
            part, wrong = 1.0, np.linalg.norm(self.residual(z))
            while damped and not (
                np.linalg.norm(self.residual(z + part * step)) <= (1 - _DECREASE * part) * wrong
            ):
                part /= 2
                if part < _SHORTEST:
                    return None
            z = z + part * step
        return None

    def split(self, z: Array) -> tuple[Array, Array, Array]:
        """Translations (pairs, dim), motions and forces (m, dim) of this process."""
        translations = self._prescribed.copy()
        translations[np.isnan(translations)] = z[self.unknowns :]
        moved = self._moved.at(z)
        interface = self._interface
        return (
            translations,
            scattered(interface, moved),
            scattered(interface, self._nodal.at(z)),
        )

    def _motions(self, pair: npt.NDArray[np.int32], supported: Array) -> tuple[Affine, Affine]:
        """Motions of the points, and of their surfaces: (points, dim)."""
        points, dim = supported.shape
        size = self.unknowns + len(self.free)
        moved = np.zeros((points * dim, size))
        moved[self._places, np.arange(self.unknowns)] = 1.0
        followed = np.zeros((points, dim, size))
        for k, (number, axis) in enumerate(self.free):
            followed[pair == number, axis, self.unknowns + k] = 1.0
        self._moved = Affine(moved.reshape(points, dim, size), supported)
        return self._moved, Affine(followed, np.nan_to_num(self._prescribed)[pair])


def _through(matrices: Array, of: Affine) -> Affine:
    """Each point's matrix (points, a, b) times its b values."""
    return Affine(matrices @ of.slope, np.einsum("nab,nb->na", matrices, of.value))


def _sum(one: Affine, other: Affine) -> Affine:
    return Affine(one.slope + other.slope, one.value + other.value)
