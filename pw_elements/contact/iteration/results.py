"""From a solution of the equations to a state: nodes in order, totals, residuals."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.contact.interface import ROUND_OFF, Interface
from pw_elements.contact.iteration.law import OPEN, SLIP, STICK, ActiveSet
from pw_elements.contact.iteration.newton import Increment, Iterate
from pw_elements.contact.model import ContactState, PairState, Residuals, Scale, Smallness
from pw_elements.solvers import SolverReport

Array = npt.NDArray[np.float64]


def contact_state(
    increment: Increment,
    now: Iterate,
    iterations: int,
    before: ContactState,
    report: SolverReport,
    smallness: Smallness,
    converged: bool = True,
) -> ContactState:
    active, system = now.contact.active_set(), increment.system
    own = orientations = system.tangent.solver.orientations
    if before.free == system.free:
        orientations |= before.orientations
    scale, residuals = _measured(increment, now, before.scale)
    return ContactState(
        increment.interface.field.part(now.full),
        tuple(_pair(k, increment.interface, now, active) for k in range(increment.interface.pairs)),
        iterations,
        len(orientations) <= 1 if own else None,
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
    normal, gap = interface.normals(None), interface.gaps(None)
    pairs = []
    for k in range(interface.pairs):
        position = interface.in_order(k, interface.position)
        zero, none = np.zeros_like(position), np.zeros(len(position))
        pairs.append(
            PairState(
                position=position,
                normal=interface.in_order(k, normal),
                force_normal=none,
                force_tangential=zero,
                gap=interface.in_order(k, gap),
                slip=zero,
                friction=interface.in_order(k, interface.cone.steepest),
                status=np.full(len(position), OPEN, dtype=np.int8),
                translation=np.zeros(position.shape[1]),
                force=np.zeros(position.shape[1]),
                displacement=zero,
                direction=zero,
                turning=none,
                node=interface.in_order(k, interface.node),
                faced=interface.in_order(k, interface.faced),
                opposite=interface.opposite[k].copy(),
                opposite_force=np.zeros((len(interface.opposite[k]), position.shape[1])),
            )
        )
    residuals = Residuals(*np.zeros(8).tolist())
    report = SolverReport("nothing", 0)
    return ContactState(
        interface.field.part(unknowns),
        tuple(pairs),
        0,
        None,
        residuals,
        report,
        0,
        (),
        frozenset(),
        Scale(),
        Smallness(),
        unknowns=unknowns,
    )


def _pair(k: int, interface: Interface, now: Iterate, active: ActiveSet) -> PairState:
    contact = now.contact
    normal, tangents = contact.frame[:, 0], contact.frame[:, 1:]
    slip = np.einsum("nab,na->nb", tangents, contact.slip)
    slip[active.status == OPEN] = 0.0

    def ordered(values: npt.NDArray) -> npt.NDArray:
        return interface.in_order(k, values)

    return PairState(
        position=ordered(interface.position),
        normal=ordered(normal),
        force_normal=ordered(contact.force[:, 0]),
        force_tangential=ordered(np.einsum("nab,na->nb", tangents, contact.force[:, 1:])),
        gap=ordered(contact.gap),
        slip=ordered(slip),
        friction=ordered(interface.cone.coefficient(contact.force[:, 0])),
        status=ordered(active.status),
        translation=now.translations[k].copy(),
        force=ordered(now.force).sum(axis=0),
        displacement=ordered(now.displacement),
        direction=ordered(np.einsum("nab,na->nb", tangents, active.direction)),
        turning=ordered(active.turning),
        node=ordered(interface.node),
        faced=ordered(interface.faced),
        opposite=interface.opposite[k].copy(),
        opposite_force=interface.on_opposite(k, now.force),
    )


def _measured(increment: Increment, now: Iterate, before: Scale) -> tuple[Scale, Residuals]:
    force = _largest(increment, np.linalg.norm(now.force, axis=1))
    moved = np.concatenate([now.displacement, increment.interface.shifts(now.translations)])
    length = _largest(increment, np.linalg.norm(moved, axis=1))
    scale = before
    if force > increment.round_off(now):
        scale = Scale(max(force, before.force), max(length, before.length))
    return scale, _residuals(increment, now, scale.force, max(length, scale.length))


def _largest(increment: Increment, values: Array) -> float:
    return float(increment.system.comm.allreduce(np.max(values, initial=0.0), MPI.MAX))


def _residuals(increment: Increment, now: Iterate, force: float, length: float) -> Residuals:
    system, interface, contact = increment.system, increment.interface, now.contact
    active = contact.active_set()

    def largest(values: Array) -> float:
        return _largest(increment, values)

    extent = largest(np.abs(interface.position))
    length = length if length > ROUND_OFF * extent else extent
    force = force or largest(system.scale) * length
    tangential = contact.force[:, 1:]
    friction, slip = np.linalg.norm(tangential, axis=1), np.linalg.norm(contact.slip, axis=1)
    limit, _ = interface.cone.limit(contact.force[:, 0])
    against = slip[:, None] * tangential + limit[:, None] * contact.slip
    pressed = contact.force[:, 0]
    apart = np.where(np.isfinite(contact.gap), contact.gap, 0.0) / length
    balance = np.abs(system.totals(now.force) - increment.totals)
    return Residuals(
        equilibrium=largest(np.array([now.unbalanced])) / force,
        penetration=largest(-apart),
        tension=largest(-pressed) / force,
        complementarity=largest(np.minimum(pressed / force, apart)),
        cone=largest(friction - limit) / force,
        stick=largest(slip[active.status == STICK]) / length,
        direction=largest(np.linalg.norm(against, axis=1)[active.status == SLIP]) / force / length,
        balance=largest(balance) / force,
    )
