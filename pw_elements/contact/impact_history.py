"""Results of explicit dynamics: energies and contact forces over time, and states for files."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.impulses import NodalContact
from pw_elements.contact.interface import Interface
from pw_elements.contact.law import OPEN, SLIP, STICK
from pw_elements.contact.results import undeformed
from pw_elements.contact.state import ContactState, PairState, Residuals

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Energies:
    """Energies and work (s + 1,) at half steps, the first one half a step before the start.

    kinetic + strain changes by the work alone, to round-off.

    Args:
        kinetic: v' M v / 2.
        strain: u' K u / 2, of the displacements before and after: at a half step it may be
            slightly negative.
        load_work: of the loads, since the start.
        normal_work: of normal contact forces, since the start: what impacts take, and what moving
            surfaces do.
        friction_work: of friction, since the start.
    """

    kinetic: Array
    strain: Array
    load_work: Array
    normal_work: Array
    friction_work: Array

    @property
    def total(self) -> Array:
        """Kinetic and strain energy together."""
        return self.kinetic + self.strain

    @property
    def imbalance(self) -> float:
        """Largest difference of the change of energy and the work, over the largest of them."""
        work = self.load_work + self.normal_work + self.friction_work
        scale = max(np.abs(part).max() for part in vars(self).values())
        return float(np.abs(self.total - self.total[0] - work).max() / (scale or 1.0))


@dataclass(frozen=True)
class PairHistory:
    """Contact of one pair over s steps; its m nodes in the order of their positions.

    Args:
        position: (m, dim), undeformed.
        node: (m,), global numbers in the space, of this number of processes.
        force: (s, m, dim), of the surface on the body at each node, at the times of
            `ImpactHistory` but the last.
        translation: (s + 1, dim), of the surface from its initial place.
    """

    position: Array
    node: Indices
    force: Array
    translation: Array

    @property
    def total(self) -> Array:
        """Force (s, dim) of the surface on the body."""
        return np.asarray(self.force.sum(axis=1))

    @classmethod
    def of(cls, interface: Interface, k: int, force: Array, translation: Array) -> "PairHistory":
        """History of one pair.

        Args:
            interface: of all pairs.
            k: number of the pair.
            force: (s, m, dim), at this process' points.
            translation: (s + 1, pairs, dim), of the surfaces.
        """
        return cls(
            interface.in_order(k, interface.position),
            interface.in_order(k, interface.node),
            interface.in_order(k, np.swapaxes(force, 0, 1)).swapaxes(0, 1),
            translation[:, k],
        )


@dataclass(frozen=True)
class ImpactHistory:
    """Result of `solve_impact`.

    Args:
        step: of time.
        critical_step: the largest that is stable, without contact.
        time: (s + 1,), from 0 on.
        energies: at the half steps before these times.
        pairs: one per contact pair.
        displacement: (n,), at the last time; coefficients with the symmetric sibling.
        velocity: (n,), half a step before.
        frames: `ContactState`s with the displacements at `frame_times` and the contact forces
            that led there, for `ContactFields` and `write`. They are not states of equilibrium:
            residuals are NaN, and no static increment can continue from them. With the sibling
            displacements are true ones, gaps and slips those of the coefficients.
        frame_times: of the frames.
    """

    step: float
    critical_step: float
    time: Array
    energies: Energies
    pairs: tuple[PairHistory, ...]
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    frames: tuple[ContactState, ...]
    frame_times: tuple[float, ...]


def frame(
    interface: Interface,
    displacement: PETSc.Vec,
    moved: Array,
    contact: NodalContact,
    translations: Array,
    step: int,
) -> ContactState:
    """The state after a step: displacements (n,), those (m, dim) of this process' points."""
    slips = np.linalg.norm(contact.slip, axis=1) > 0
    status = np.where(contact.pressed > 0, np.where(slips, SLIP, STICK), OPEN).astype(np.int8)
    blank = undeformed(interface, displacement)

    def pair(k: int, before: PairState) -> PairState:
        def ordered(values: npt.NDArray) -> npt.NDArray:
            return interface.in_order(k, values)

        values = vars(before) | {
            "normal": ordered(contact.normal),
            "force_normal": ordered(contact.pressed),
            "force_tangential": ordered(contact.friction),
            "gap": ordered(contact.gap),
            "slip": ordered(np.where((status == OPEN)[:, None], 0.0, contact.slip)),
            "status": ordered(status),
            "translation": translations[k].copy(),
            "force": ordered(contact.force).sum(axis=0),
            "displacement": ordered(moved),
        }
        return PairState(**values)

    pairs = tuple(pair(k, before) for k, before in enumerate(blank.pairs))
    none = Residuals(*[np.nan] * 8)
    changes = {"pairs": pairs, "residuals": none, "increment": step, "converged": False}
    return ContactState(**(vars(blank) | changes))
