"""Increments in parts: loads and motions on the straight way from a state to what is asked for.

History is true on that way: slip and friction follow each part. So a step that is cut may end in
another state than the whole one would, had it been found, and says so by `ContactState.substates`.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.errors import ContactFailed
from pw_elements.contact.interface import Interface, NoContactStated
from pw_elements.contact.newton import Reference
from pw_elements.contact.pairs import Motion
from pw_elements.contact.state import ContactState, Free

Array = npt.NDArray[np.float64]

log = logging.getLogger("pw_elements.contact")

# Smallest part of an increment
_SMALLEST = 1 / 16
# What counts as no gap, over the extent of the contact nodes
_TOUCHING = 1e-9


@dataclass(frozen=True)
class Target:
    """What is prescribed at the end of an increment, or of a part of one.

    Args:
        load: f (n,), in all.
        translations: of the surfaces (pairs, dim), NaN where they are free.
        forces: total forces of the surfaces (pairs, dim), of those that are free.
        stated: share of the displacements that supports and interference prescribe.
    """

    load: PETSc.Vec
    translations: Array
    forces: Array
    stated: float = 1.0

    @classmethod
    def of(
        cls, load: PETSc.Vec, motions: Sequence[Motion | None], interface: Interface
    ) -> "Target":
        """As the user states it; surfaces without a motion rest."""
        rest = np.zeros(interface.position.shape[1])
        each = list(motions) or [None] * interface.pairs
        return cls(
            load,
            np.array([rest if m is None else m.prescribed() for m in each]),
            np.array([rest if m is None else m.forces() for m in each]),
        )

    @property
    def free(self) -> Free:
        """(pair, component) of each free translation."""
        return tuple((int(p), int(axis)) for p, axis in np.argwhere(np.isnan(self.translations)))

    @property
    def totals(self) -> Array:
        """Forces of the free translations."""
        return np.array([self.forces[at] for at in self.free])


def held_by(state: ContactState, K: PETSc.Mat, interface: Interface) -> Target:
    """What a state is in equilibrium with; forces of supports count as load, they do no work.

    It follows from displacements and contact forces alone, f = K a - H r.
    """
    points = interface.force.createVecRight()
    points.setArray(np.where(interface.equation >= 0, Reference.of(state, interface).force, 0.0))
    load = K.createVecLeft()
    K.mult(state.unknowns, load)
    load.axpy(-1.0, interface.force * points)
    return Target(
        load,
        state.translations,
        np.array([pair.force for pair in state.pairs]),
        1.0 if state.increment else 0.0,
    )


def between(start: Target, end: Target, share: float) -> Target:
    """A share of the way from one to the other."""
    if share == 1:
        return end
    load = start.load.copy()
    load.scale(1 - share)
    load.axpy(share, end.load)
    return Target(
        load,
        (1 - share) * start.translations + share * end.translations,
        (1 - share) * start.forces + share * end.forces,
        (1 - share) * start.stated + share * end.stated,
    )


def homogeneous(state: ContactState) -> bool:
    """Whether every part of a step from a state is like the whole, so that cutting it is idle.

    That is so without forces and gaps: the undeformed body on surfaces that it touches all over.
    """
    if state.increment:
        return False
    extent = max(float(np.ptp(pair.position, axis=0).max()) for pair in state.pairs)
    return all(
        np.all(np.abs(pair.gap[np.isfinite(pair.gap)]) <= _TOUCHING * extent)
        for pair in state.pairs
    )


def in_parts(
    step: Callable[[ContactState, Target], ContactState],
    state: ContactState,
    start: Target,
    end: Target,
) -> ContactState | None:
    """The state at the end of a step that fails as a whole, or None if its parts fail, too.

    Args:
        step: from a state to a target.
        state: at the start.
        start: what it is in equilibrium with.
        end: what is asked for.
    """
    parts: list[tuple[float, ContactState]] = []
    done, size, now = 0.0, 0.5, state
    while done < 1:
        share = min(1.0, done + size)
        try:
            now = replace(step(now, between(start, end, share)), increment=state.increment + 1)
        except (ContactFailed, NoContactStated) as failed:
            if now.displacement.comm.rank == 0:
                log.info("not from %.4g to %.4g of the increment: %s", done, share, failed)
            size /= 2
            if size < _SMALLEST:
                return None
            continue
        done = share
        parts.append((share, now))
    if now.displacement.comm.rank == 0:
        log.info("the increment has been solved in %d parts", len(parts))
    return _joined([part for _, part in parts], tuple(parts[:-1]))


def _joined(
    parts: Sequence[ContactState], substates: tuple[tuple[float, ContactState], ...]
) -> ContactState:
    """The last part, with the slip of all."""
    last = parts[-1]
    pairs = tuple(
        replace(
            pair,
            slip=np.where(
                (pair.status == 0)[:, None], 0.0, sum(part.pairs[k].slip for part in parts)
            ),
        )
        for k, pair in enumerate(last.pairs)
    )
    return replace(last, pairs=pairs, substates=substates)
