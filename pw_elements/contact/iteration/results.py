"""From a solution of the equations to a state: nodes in order, totals, residuals."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array
from pw_elements.contact.interface import DEFORMABLE, ROUND_OFF, Interface
from pw_elements.contact.iteration.law import HELD, OPEN
from pw_elements.contact.iteration.newton import Increment, Iterate
from pw_elements.contact.model import ContactState, PairState, Residuals, Scale, Smallness
from pw_elements.solvers import SolverReport


def contact_state(
    increment: Increment,
    now: Iterate,
    iterations: int,
    before: ContactState,
    report: SolverReport,
    smallness: Smallness | None,
    converged: bool = True,
    slides: bool = False,
) -> ContactState:
    system = increment.system
    own = orientations = frozenset(system.tangent.solver.orientations)
    if before.free == system.free:
        orientations |= before.orientations
    scale, residuals = _measured(increment, now, before.scale)
    if not increment.interface.cone.cannot_fail:
        increment.interface.check_laws()
    return ContactState(
        increment.interface.field.part(now.full),
        _pairs(increment, now),
        iterations,
        False if slides else len(orientations) <= 1 if own else None,
        residuals,
        report,
        before.increment + 1,
        system.free,
        orientations,
        scale,
        smallness,
        converged,
        unknowns=now.full,
    )


def undeformed(interface: Interface, unknowns: PETSc.Vec) -> ContactState:
    """The body before any load, `unknowns` being a vector (n,) of zeros."""
    zero = np.zeros_like(interface.position)
    pairs = pair_states(
        interface,
        np.zeros((interface.pairs, zero.shape[1])),
        zero,
        normal=interface.normals(None),
        gap=interface.gaps(None),
        friction=interface.cone.steepest,
    )
    return ContactState(interface.field.part(unknowns), pairs, unknowns=unknowns)


def _pairs(increment: Increment, now: Iterate) -> tuple[PairState, ...]:
    interface, past, contact = increment.interface, increment.past, now.contact
    active, normal, tangents = contact.at_rest, contact.frame[:, 0], contact.frame[:, 1:]
    held = (interface.faced == DEFORMABLE) & interface.cone.rough & ~tangents.any(axis=(1, 2))
    status = np.where(held & (active.status != OPEN), HELD, active.status).astype(np.int8)
    moved = now.displacement - past.displacement
    dim = moved.shape[1]
    moved = moved - (now.translations - past.translations)[interface.pair, :dim]
    along = moved - np.sum(moved * normal, axis=1)[:, None] * normal

    def vectors(values: Array) -> Array:
        return np.einsum("nab,na->nb", tangents, values)

    slip = np.where((status == HELD)[:, None], along, vectors(contact.slip))
    return pair_states(
        interface,
        now.translations,
        now.force,
        normal=normal,
        force_normal=contact.force[:, 0],
        force_tangential=vectors(contact.force[:, 1:]),
        torque=now.place.levers.forces(now.force)[:, dim:].sum(axis=1),
        gap=contact.gap,
        slip=slip * (status != OPEN)[:, None],
        friction=interface.cone.coefficient(contact.force[:, 0]),
        status=status,
        displacement=now.displacement,
        direction=vectors(active.direction),
        turning=active.turning,
    )


def pair_states(
    interface: Interface, translations: Array, force: Array, **points: npt.NDArray
) -> tuple[PairState, ...]:
    """States of all pairs, under forces (m, dim) of the surfaces on this process' points.

    `points` are what else `PairState` has of each of them, (m, ...); zero and open by default.
    """
    zero, dim = np.zeros_like(force), force.shape[1]
    at = {name: getattr(interface, name) for name in ("position", "node", "faced")}
    at |= dict.fromkeys(("force_tangential", "slip", "displacement", "direction"), zero)
    at |= dict.fromkeys(("force_normal", "turning", "torque"), zero[:, 0])
    at |= {"status": np.full(len(zero), OPEN, dtype=np.int8)} | points
    torque = at.pop("torque")
    return tuple(
        PairState(
            translation=translations[k, :dim].copy(),
            force=interface.in_order(k, force).sum(axis=0),
            rotation=np.array(translations[k, dim:].sum()),
            torque=np.array(interface.in_order(k, torque).sum()),
            opposite=interface.opposite[k].copy(),
            opposite_force=interface.on_opposite(k, force),
            **{name: interface.in_order(k, values) for name, values in at.items()},
        )
        for k in range(interface.pairs)
    )


def _measured(increment: Increment, now: Iterate, before: Scale) -> tuple[Scale, Residuals]:
    force = _largest(increment, np.linalg.norm(now.force, axis=1))
    pair = increment.interface.pair
    shifts = np.einsum("nak,nk->na", now.place.levers.carried, now.translations[pair])
    moved = np.concatenate([increment.system.moved(now.full), shifts])
    length = _largest(increment, np.linalg.norm(moved, axis=1))
    scale = before
    if force > increment.round_off(now):
        scale = Scale(max(force, before.force), max(length, before.length))
    extent = _largest(increment, np.abs(increment.interface.position))
    length = max(length, scale.length)
    length = length if length > ROUND_OFF * extent else extent
    force = scale.force or _largest(increment, increment.system.scale) * length
    found = increment.residuals(now, force, length)
    return scale, Residuals(**{name: _largest(increment, values) for name, values in found.items()})


def _largest(increment: Increment, values: Array) -> float:
    return float(increment.system.comm.allreduce(np.max(values, initial=0.0), MPI.MAX))
