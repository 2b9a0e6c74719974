"""Conditions of a state, computed anew from displacements, form, surfaces and law.

The iteration accepts a state by what it knows of it: frames, slips and forces of its own linear
equations. Here nothing of that is used. A state that violates a condition by more than the
tolerance and what may be round-off is refused, however it was found.

With R = K u - f, or the residual F(u), the force of a point is what R has at its node, and R - H r
has to vanish in all free equations. Gap and normal are what the surface says of the place of a
node, and slip is the way of that place along the surface since the increment's start, as the
guide's page on theory has it ("Contact", "Large strains"). Of bodies at large sliding all of these
and H are measured from positions by `interface.facing`, not by the kernel of the iteration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.algebra import Reduction
from pw_elements.arrays import Array, Mask
from pw_elements.contact.interface import (
    ROUND_OFF,
    Interface,
    MortarMatrices,
    measure_gap_and_slip,
)
from pw_elements.contact.iteration import DISPLACEMENT_ROUND_OFF
from pw_elements.contact.model import ContactPair, ContactState, NotFound, Residuals
from pw_elements.contact.nodes import TOLERANCE

# Shift of points by which the noise of a surface's function is seen, over the largest coordinate
_NOISE_SHIFT = 1e-12
# Sine of an angle, in which arc and chord do not differ
_SMALL_ANGLE = 1e-8


@dataclass(frozen=True)
class Sizes:
    """What residuals and allowances are relative to, and the stiffnesses by which forces are lost.

    Args:
        force: see `Residuals`.
        length: see `Residuals`.
        stiffness: (m,), of the contact points of this process.
        equilibrium: what may be round-off, a force, in equations of other nodes than the pairs'.
    """

    force: float
    length: float
    stiffness: Array
    equilibrium: float


@dataclass(frozen=True)
class Places:
    """Contact points (m) of this process as a surface sees them at the end of an increment.

    Args:
        gap: (m,), infinite where nothing faces a point.
        normal: (m, dim).
        slip: (m, dim), since the increment's start, along the surface.
        noise: (m,), of the normal, which differences of a surface's function leave.
        force_operator: H, (n, m dim), forces on all unknowns from those on the points.
        parts_error: (m,), round-off of what others get of a point's force, over that force.
    """

    gap: Array
    normal: Array
    slip: Array
    noise: Array
    force_operator: PETSc.Mat
    parts_error: Array


def places_undeformed(
    interface: Interface, before: ContactState, state: ContactState, left_inside: float
) -> Places:
    """Contact points against surfaces that are met at the undeformed body.

    Args:
        interface: the contact points.
        before: state at the increment's start.
        state: state at its end.
        left_inside: share of the interference that is not yet resolved.
    """
    pair, at = interface.pair, state.translations
    motions = [_at_points(interface, one.unknowns) for one in (before, state)]
    shifts = [one.translations[pair] for one in (before, state)]
    normal = interface.normals(at)
    with np.errstate(invalid="ignore"):  # infinite gaps
        gap = interface.gaps(at) + np.sum(normal * motions[1], axis=1)
    relative = (motions[1] - shifts[1]) - (motions[0] - shifts[0])
    slip = relative - np.sum(relative * normal, axis=1)[:, None] * normal
    shift = _NOISE_SHIFT * (interface.extent or 1.0)
    noise = np.abs(interface.normals(at + shift) - normal).max(axis=1, initial=0.0)
    gap = gap + left_inside * interface.interference
    return Places(gap, normal, slip, noise, interface.force, np.zeros(len(gap)))


def places_deformed(
    interface: Interface, pairs: Sequence[ContactPair], before: ContactState, state: ContactState
) -> Places:
    """Contact points at the deformed body, against rigid surfaces that move and turn, or bodies."""
    motions = [_at_points(interface, one.unknowns) for one in (before, state)]
    dim = motions[0].shape[1]
    pivots, spins = (
        np.array(part) for part in zip(*(p.pivot_and_spin(dim) for p in pairs), strict=True)
    )
    pivot, J = pivots[interface.pair], spins[interface.pair]
    within, turns = [], []
    for motion, one in zip(motions, (before, state), strict=True):
        placement = one.placements[interface.pair]
        cos, sin = (f(placement[:, -1])[:, None, None] for f in (np.cos, np.sin))
        turn = np.eye(dim) + sin * J + (1 - cos) * J @ J
        arm = interface.position + motion - placement[:, :-1] - pivot
        within.append(pivot + np.einsum("nba,nb->na", turn, arm) - interface.position)
        turns.append(turn)
    (gap_0, normal_0, _), (gap, normal, _) = (interface.closest(y) for y in within)
    shift = _NOISE_SHIFT * (interface.extent or 1.0)
    noise = np.abs(interface.closest(within[1] + shift)[1] - normal).max(axis=1, initial=0.0)
    # what faces nothing at one end slips as along the surface at the other
    faced = np.isfinite(gap_0) & np.isfinite(gap)
    normal_0 = np.where(faced[:, None], normal_0, normal)
    points = [
        y - np.where(np.isfinite(g), g, 0.0)[:, None] * n
        for y, g, n in zip(within, (gap_0, gap), (normal_0, normal), strict=True)
    ]
    chord = points[1] - points[0]
    angle = _angle_along(normal_0, normal)
    if dim == 2:
        # a node that is touched stays on its side of the tool, which may turn more than once
        seen = [
            np.einsum("nab,nb->na", R, n) for R, n in zip(turns, (normal_0, normal), strict=True)
        ]
        turned = (state.placements - before.placements)[interface.pair, -1]
        angle = np.where(J.any(axis=(1, 2)), _angle_along(*seen) - turned, angle)
    bent = np.abs(np.sin(angle)) > _SMALL_ANGLE
    # arc over the chord's tangential part; unknown after half turns, which have no such part
    unknown = np.where(np.abs(angle) < 1.0, 1.0, np.nan)
    arc = np.where(bent, angle / np.where(bent, np.sin(angle), 1.0), unknown)
    slip = arc[:, None] * (chord - np.sum(chord * normal, axis=1)[:, None] * normal)
    slip, normal = (np.einsum("nab,nb->na", turns[1], part) for part in (slip, normal))
    places = Places(gap, normal, slip, noise, interface.force, np.zeros(len(gap)))
    return _measure_bodies(interface, before, state, places) if interface.mortars else places


def _angle_along(start: Array, end: Array) -> Array:
    """Angles (m,) from unit vectors (m, dim) to others, signed in the plane."""
    cosine = np.sum(start * end, axis=1)
    if start.shape[1] == 2:
        return np.asarray(np.arctan2(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0], cosine))
    sine = np.linalg.norm(end - cosine[:, None] * start, axis=1)
    return np.asarray(np.arctan2(sine, cosine))


def _measure_bodies(
    interface: Interface, before: ContactState, state: ContactState, places: Places
) -> Places:
    """Fill in the points of pairs of bodies at large sliding, whose forces the others get."""
    dim, n_points = interface.position.shape[1], len(interface.node)
    # what is subtracted from the unit forces of the points: (value, point, node) of each pair
    received = []
    for k, mortar in interface.mortars.items():
        own = np.flatnonzero(interface.pair == k)
        among = np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], interface.node[own])
        x, parts = list[Array](), list[MortarMatrices]()
        for one in (before, state):
            moved = interface.at_nodes(mortar.nodes, one.unknowns)
            moved[mortar.n_slave_nodes :] += one.translations[k]
            x.append(mortar.x + moved)
            parts.append(mortar.evaluate_for_verification(x[-1]))
        gap, slip = measure_gap_and_slip(parts[0], parts[1], x[0], x[1])
        places.gap[own], places.slip[own] = gap[among], slip[among]
        places.normal[own], places.noise[own] = parts[1].normals[among], 0.0
        places.parts_error[own] = parts[1].fraction_error[among]
        shares = sp.coo_array(parts[1].master_fractions[among])
        received.append(
            (shares.data, own[shares.row], mortar.nodes[mortar.n_slave_nodes + shares.col])
        )
    value, point, node = (np.concatenate(each) for each in zip(*received, strict=True))
    shape = n_points, interface.field.sizes[1] // dim
    unit = sp.csr_matrix((np.ones(n_points), (np.arange(n_points), interface.node)), shape)
    nodal = unit - sp.csr_matrix((value, (point, node)), shape)
    rows = interface.rows(sp.csr_matrix(sp.kron(nodal, sp.eye_array(dim))))
    return replace(places, force_operator=rows.transpose(PETSc.Mat()))


def check_stiffness_sign(K: PETSc.Mat, interface: Interface, remedy: str) -> None:
    """Raise ValueError, on all processes, if contact nodes give way against forces on them.

    Args:
        K: stiffness (n, n) of the undeformed body.
        interface: the contact points.
        remedy: what the user is to give instead.
    """
    first = interface.field.space.dofmap.index_map.local_range[0]
    diagonal = K.getDiagonal().array_r[interface.field.owned_unknowns[interface.node - first]]
    total = interface.comm.allreduce(float(diagonal.sum()), MPI.SUM)
    count = interface.comm.allreduce(diagonal.size, MPI.SUM)
    if total < 0:
        raise ValueError(
            f"contact nodes have a negative stiffness, {total / count:.3g} in the mean: the sign "
            f"is the wrong one; {remedy}"
        )


def torque_of(
    interface: Interface, pairs: Sequence[ContactPair], state: ContactState
) -> Callable[[Array], Array]:
    """Function of forces (m, dim) on the points that gives torques (m,) about present pivots."""
    motion = _at_points(interface, state.unknowns)
    pivots, spins = zip(*(pair.pivot_and_spin(motion.shape[1]) for pair in pairs), strict=True)
    placement, of = state.placements[interface.pair], interface.pair
    arm = interface.position + motion - placement[:, :-1] - np.array(pivots)[of]
    velocity = np.einsum("nab,nb->na", np.array(spins)[of], arm)
    return lambda force: np.asarray(np.sum(velocity * force, axis=1))


def verify_state(
    state: ContactState,
    places: Places,
    unbalanced: PETSc.Vec,
    interface: Interface,
    reduction: Reduction,
    sizes: Sizes,
    totals: Array,
    lever: Callable[[Array], Array] | None = None,
) -> ContactState:
    """Return the state with residuals and allowances that were computed anew.

    Arguments are those of `measure_residuals`.

    Raises:
        NotFound: on all processes, if a condition is violated by more than the tolerance and its
            allowance.
    """
    residuals, allowance = measure_residuals(
        state, places, unbalanced, interface, reduction, sizes, totals, lever
    )
    for name, value in vars(residuals).items():
        most = TOLERANCE + getattr(allowance, name)
        if not value <= most:
            raise NotFound(
                f"the state found violates {name} by {value:.2g}, computed anew from its "
                f"displacements; {most:.2g} is allowed, so that it is no solution"
            )
    return replace(state, residuals=residuals, allowance=allowance)


def measure_residuals(
    state: ContactState,
    places: Places,
    unbalanced: PETSc.Vec,
    interface: Interface,
    reduction: Reduction,
    sizes: Sizes,
    totals: Array,
    lever: Callable[[Array], Array] | None = None,
) -> tuple[Residuals, Residuals]:
    """Residuals of a state, and the allowances for round-off and noise beside the tolerance.

    Args:
        state: of a converged iteration.
        places: of its contact points.
        unbalanced: K u - f or F(u), (n,), in free numbering.
        interface: the contact points.
        reduction: supports and condensation.
        sizes: of forces and lengths.
        totals: forces and torques given on the state's free motions.
        lever: gives torques (m,) of forces (m, dim); None where nothing turns.
    """
    comm = interface.comm
    stated = interface.equation >= 0
    (reported,) = interface.local(state.pairs, "force_vector")
    nodal = interface.field.extract(unbalanced).array_r.reshape(-1, reported.shape[1])
    first = interface.field.space.dofmap.index_map.local_range[0]
    # what a support holds is its reaction; friction at such a point is known from the state alone
    force = np.where(stated, nodal[interface.node - first], reported)
    values, allowed = _law(state, places, force, stated | (reported != 0), interface, sizes)
    others = _unbalanced_elsewhere(
        unbalanced, places.force_operator, np.where(stated, force, 0.0), interface, reduction
    )
    values["equilibrium"] = np.atleast_1d(others / sizes.force)
    lost = float(comm.allreduce(allowed["tension"].max(initial=0.0), MPI.MAX))
    handed_on = _largest(comm, places.parts_error * np.linalg.norm(force, axis=1))
    allowed["equilibrium"] = np.atleast_1d(lost + (sizes.equilibrium + handed_on) / sizes.force)
    values["balance"], allowed["balance"] = _balance(
        state, force, interface, sizes, totals, lever, lost
    )
    residuals, allowance = (
        Residuals(**{name: _largest(comm, parts[name]) for name in vars(Residuals())})
        for parts in (values, allowed)
    )
    return residuals, allowance


def _law(
    state: ContactState,
    places: Places,
    force: Array,
    taking_part: Mask,
    interface: Interface,
    sizes: Sizes,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Residuals (m,) of contact and friction, and what of them may be round-off."""
    F, L, c = sizes.force, sizes.length, sizes.stiffness
    pressed = np.sum(force * places.normal, axis=1)
    along = np.where(taking_part, force - pressed[:, None] * places.normal, 0.0)
    slip = np.where(taking_part, places.slip, 0.0)
    sheared, slid = np.linalg.norm(along, axis=1), np.linalg.norm(slip, axis=1)
    limit, slope = interface.cone.limit(np.maximum(0.0, pressed))
    against = np.linalg.norm(slid[:, None] * along + limit[:, None] * slip, axis=1)
    values = {
        "penetration": np.maximum(0.0, -places.gap) / L,
        "tension": np.maximum(0.0, -pressed) / F,
        "complementarity": np.maximum(0.0, np.minimum(pressed / F, places.gap / L)),
        "cone": np.maximum(0.0, sheared - limit) / F,
        "stick": np.maximum(0.0, np.minimum((limit - sheared) / F, slid / L)),
        "direction": against / F / np.maximum(L, slid),
    }
    moved = np.linalg.norm(_at_points(interface, state.unknowns), axis=1)
    pair = interface.pair
    moved = moved + np.linalg.norm(state.translations, axis=1)[pair]
    where = np.linalg.norm(interface.position, axis=1)
    lost_length = DISPLACEMENT_ROUND_OFF * moved + ROUND_OFF * where
    lost_length = lost_length + places.noise * moved
    size = np.linalg.norm(force, axis=1)
    lost_force = c * lost_length + places.noise * size
    lost_force = np.full(len(c), _largest(interface.comm, lost_force)) / F
    # forces are exact to the tolerance, and so are lengths but for the stiffness between them
    lost_length = lost_length / L + np.divide(TOLERANCE * F, c * L, where=c > 0, out=0 * c)
    friction = (1 + slope) * lost_force
    allowed = dict.fromkeys(("penetration", "complementarity", "stick"), lost_length)
    allowed |= {"tension": lost_force, "cone": friction + slope * TOLERANCE}
    allowed["complementarity"] = np.maximum(lost_length, lost_force)
    allowed["stick"] = np.maximum(lost_length, friction + slope * TOLERANCE)
    reach = np.minimum(1.0, (slid + lost_length * L) / L)
    allowed["direction"] = 2 * (friction + slope * TOLERANCE) * reach + 2 * lost_length * limit / F
    return values, allowed


def _balance(
    state: ContactState,
    force: Array,
    interface: Interface,
    sizes: Sizes,
    totals: Array,
    lever: Callable[[Array], Array] | None,
    lost: float,
) -> tuple[Array, Array]:
    """Residuals of the balances of free motions, and what of them may be round-off."""
    comm, dim = interface.comm, force.shape[1]
    values, allowed = np.zeros(len(state.free_motions)), np.zeros(len(state.free_motions))
    for number, ((pair, axis), total) in enumerate(zip(state.free_motions, totals, strict=True)):
        mine = interface.pair == pair
        if axis < dim:
            parts, arms = force[mine, axis], np.ones(mine.sum())
        else:
            assert lever is not None
            parts = lever(force)[mine]
            units = [lever(np.tile(unit, (len(force), 1)))[mine] for unit in np.eye(dim)]
            arms = np.linalg.norm(units, axis=0)
        found = comm.allreduce(float(parts.sum()), MPI.SUM)
        arm = max(_largest(comm, arms), np.finfo(float).tiny)
        count = comm.allreduce(int(np.sum(mine)), MPI.SUM)
        values[number] = abs(found - total) / (sizes.force * arm)
        allowed[number] = lost * np.sqrt(count)
    return values, allowed


def _unbalanced_elsewhere(
    unbalanced: PETSc.Vec,
    operator: PETSc.Mat,
    force: Array,
    interface: Interface,
    reduction: Reduction,
) -> float:
    """Largest force in free equations of displacements that is no contact force."""
    points = operator.createVecRight()
    points.setArray(force.ravel())
    rest = unbalanced.copy()
    rest.axpy(-1.0, operator * points)
    displacements = rest.duplicate()
    displacements.setArray(0.0)
    own = interface.field.owned_unknowns.ravel()
    displacements.array[own] = rest.array_r[own]
    free = reduction.left.createVecRight()
    reduction.left.multTranspose(displacements, free)
    return float(free.norm(PETSc.NormType.INFINITY))


def _at_points(interface: Interface, unknowns: PETSc.Vec) -> Array:
    """Motions (m, dim) of the contact points."""
    return np.array((interface.motion * unknowns).array_r.reshape(interface.position.shape))


def _largest(comm: MPI.Comm, values: Array) -> float:
    values = np.where(np.isnan(values), np.inf, values)
    return float(comm.allreduce(values.max(initial=0.0), MPI.MAX))
