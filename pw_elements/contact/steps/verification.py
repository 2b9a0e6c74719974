"""Verification of a state by an independent evaluation of all conditions.

The iteration accepts a state on the basis of the frames, slips and forces in its own linear
equations. This module uses none of these: it evaluates all conditions from the displacements, the
form or stiffness, the surfaces and the friction law. It rejects a state that violates a condition
by more than the tolerance plus an allowance for round-off, whichever method has found the state.

The residual forces are R = K u - f, with the stiffness K, the displacements u and the load f, or
the residual F(u) of a nonlinear body. The contact force r of a node is the value of R at the node.
The force operator H distributes contact forces to all unknowns, and R - H r has to vanish in all
free equations. Gap and normal are those of the surface at the position of the node. Slip is the
motion of this position along the surface since the start of the increment, as defined on the
guide's page on theory ("Contact", "Large strains"). For bodies at large sliding, gap, normal, slip
and H are measured from positions by `interface.facing`, and not by the kernel of the iteration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.algebra import Reduction
from pw_elements.arrays import Array, LocalIndices, Mask
from pw_elements.contact.interface import (
    RELATIVE_COORDINATE_ROUND_OFF,
    ContactInterface,
    MortarMatrices,
    measure_gap_and_slip,
)
from pw_elements.contact.iteration import RELATIVE_DISPLACEMENT_ROUND_OFF
from pw_elements.contact.model import ContactPair, ContactState, Residuals, SolutionNotFound
from pw_elements.contact.nodes import (
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    make_frames,
    stiffness_ratio,
)

# Shift of points, relative to the extent of the nodes, that reveals noise in a surface's function
_NOISE_PROBE_SHIFT_PER_EXTENT = 1e-12
# Sine of an angle below which the lengths of arc and chord are equal to round-off
_MIN_SINE_WHERE_ARC_EXCEEDS_CHORD = 1e-8


@dataclass(frozen=True)
class VerificationScales:
    """Scales of residuals, and quantities from which allowances for round-off are computed.

    Args:
        force: scale of forces, see `Residuals`.
        length: scale of lengths, see `Residuals`.
        stiffness: stiffnesses (m,) of the contact nodes of this process. A round-off error of a
            length, multiplied by the stiffness, is the resulting error of a force.
        equilibrium: round-off error of the forces in the equations of all other nodes.
    """

    force: float
    length: float
    stiffness: Array
    equilibrium: float


@dataclass(frozen=True)
class MeasuredKinematics:
    """Kinematics of the m contact nodes of this process at the end of an increment.

    Args:
        gap: gaps (m,); infinite at nodes that face nothing.
        normal: unit normals (m, dim) of the surfaces.
        slip: slips (m, dim) along the surface since the start of the increment.
        motion_size: sums (m,) of the magnitudes of the motions of node and surface.
        noise: errors (m,) of the normals that are due to noise in a surface's function.
        force_operator: matrix H (n, m dim) that takes forces on the contact nodes to forces on all
            unknowns.
        transfer_error: round-off errors (m,) of the transfer of a node's force to the opposite
            body, relative to the force.
        start_history: history (m, n_history) of interface laws at the start of the increment; None
            if no pair has an interface law.
    """

    gap: Array
    normal: Array
    slip: Array
    motion_size: Array
    noise: Array
    force_operator: PETSc.Mat
    transfer_error: Array
    start_history: Array | None = None


def measure_small_strain_kinematics(
    interface: ContactInterface,
    start_state: ContactState,
    state: ContactState,
    remaining_interference_fraction: float,
) -> MeasuredKinematics:
    """Return gaps, normals and slips relative to surfaces, linearised at the undeformed body.

    Args:
        interface: the contact nodes.
        start_state: state at the start of the increment.
        state: state at the end of the increment.
        remaining_interference_fraction: fraction of the interference that is not yet applied.
    """
    translations = [end.translations for end in (start_state, state)]
    motions = [_contact_node_motions(interface, end.unknowns) for end in (start_state, state)]
    gap, normal = interface.evaluate_undeformed_gaps_and_normals(translations[1])
    with np.errstate(invalid="ignore"):  # gaps may be infinite
        gap = gap + np.sum(normal * motions[1], axis=1)
    shifts = [translation[interface.pair] for translation in translations]
    relative_motion = (motions[1] - shifts[1]) - (motions[0] - shifts[0])
    slip = relative_motion - np.sum(relative_motion * normal, axis=1)[:, None] * normal
    shift = _NOISE_PROBE_SHIFT_PER_EXTENT * (interface.max_extent_of_points or 1.0)
    noise = np.abs(interface.evaluate_undeformed_normals(translations[1] + shift) - normal).max(
        axis=1, initial=0.0
    )
    gap = gap + remaining_interference_fraction * interface.initial_interference
    motion_size = np.linalg.norm(motions[1], axis=1) + np.linalg.norm(shifts[1], axis=1)
    return MeasuredKinematics(
        gap,
        normal,
        slip,
        motion_size,
        noise,
        interface.force,
        np.zeros(len(gap)),
        _start_history(interface, start_state),
    )


def _start_history(interface: ContactInterface, start_state: ContactState) -> Array | None:
    if interface.laws is None:
        return None
    return interface.extract_local_pair_state_values(start_state.pairs, "law_history")[0]


def measure_large_strain_kinematics(
    interface: ContactInterface,
    pairs: Sequence[ContactPair],
    start_state: ContactState,
    state: ContactState,
) -> MeasuredKinematics:
    """Return gaps, normals and slips of a deformed body relative to rigid surfaces or other bodies.

    Args:
        interface: the contact nodes.
        pairs: the contact pairs, with the pivots of their surfaces.
        start_state: state at the start of the increment.
        state: state at the end of the increment.
    """
    motions = [_contact_node_motions(interface, end.unknowns) for end in (start_state, state)]
    dim = motions[0].shape[1]
    pivots, spins = (
        np.array(part) for part in zip(*(p.pivot_and_spin_matrix(dim) for p in pairs), strict=True)
    )
    pivot, J = pivots[interface.pair], spins[interface.pair]
    in_surface_frame, rotations = [], []
    for motion, end in zip(motions, (start_state, state), strict=True):
        placement = end.translations_and_rotations[interface.pair]
        cos, sin = (function(placement[:, -1])[:, None, None] for function in (np.cos, np.sin))
        rotation = np.eye(dim) + sin * J + (1 - cos) * J @ J
        arm = interface.position + motion - placement[:, :-1] - pivot
        in_surface_frame.append(pivot + np.einsum("nba,nb->na", rotation, arm) - interface.position)
        rotations.append(rotation)
    (gap_0, normal_0, _), (gap, normal, _) = (
        interface.evaluate_gaps_normals_and_curvatures(x) for x in in_surface_frame
    )
    shift = _NOISE_PROBE_SHIFT_PER_EXTENT * (interface.max_extent_of_points or 1.0)
    noise = np.abs(
        interface.evaluate_gaps_normals_and_curvatures(in_surface_frame[1] + shift)[1] - normal
    ).max(axis=1, initial=0.0)
    # a node that faces nothing before or after the increment slips along the surface that it faces
    # at the other time
    is_faced = np.isfinite(gap_0) & np.isfinite(gap)
    normal_0 = np.where(is_faced[:, None], normal_0, normal)
    closest_points = [
        x - np.where(np.isfinite(g), g, 0.0)[:, None] * n
        for x, g, n in zip(in_surface_frame, (gap_0, gap), (normal_0, normal), strict=True)
    ]
    chord = closest_points[1] - closest_points[0]
    angle = _angles_between_unit_vectors(normal_0, normal)
    if dim == 2:
        # a node in contact stays on its side of the surface, even if the surface turns repeatedly
        normals_in_space = [
            np.einsum("nab,nb->na", rotation, n)
            for rotation, n in zip(rotations, (normal_0, normal), strict=True)
        ]
        surface_rotation = (
            state.translations_and_rotations - start_state.translations_and_rotations
        )[interface.pair, -1]
        angle = np.where(
            J.any(axis=(1, 2)),
            _angles_between_unit_vectors(*normals_in_space) - surface_rotation,
            angle,
        )
    is_curved = np.abs(np.sin(angle)) > _MIN_SINE_WHERE_ARC_EXCEEDS_CHORD
    # ratio of the length of the arc to that of the tangential part of the chord; this part vanishes
    # after half a turn
    ratio_of_chord = np.where(np.abs(angle) < 1.0, 1.0, np.nan)
    arc_ratio = np.where(is_curved, angle / np.where(is_curved, np.sin(angle), 1.0), ratio_of_chord)
    slip = arc_ratio[:, None] * (chord - np.sum(chord * normal, axis=1)[:, None] * normal)
    slip, normal = (np.einsum("nab,nb->na", rotations[1], part) for part in (slip, normal))
    surface_motion = state.translations[interface.pair]
    motion_size = np.linalg.norm(motions[1], axis=1) + np.linalg.norm(surface_motion, axis=1)
    measured = MeasuredKinematics(
        gap,
        normal,
        slip,
        motion_size,
        noise,
        interface.force,
        np.zeros(len(gap)),
        _start_history(interface, start_state),
    )
    return (
        _measure_kinematics_of_sliding_bodies(interface, start_state, state, measured)
        if interface.mortars
        else measured
    )


def _angles_between_unit_vectors(start: Array, end: Array) -> Array:
    """Return angles (m,) between unit vectors (m, dim).

    In the plane, angles from `start` to `end` are signed, counter-clockwise positive.
    """
    cosine = np.sum(start * end, axis=1)
    if start.shape[1] == 2:
        return np.asarray(np.arctan2(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0], cosine))
    sine = np.linalg.norm(end - cosine[:, None] * start, axis=1)
    return np.asarray(np.arctan2(sine, cosine))


def _measure_kinematics_of_sliding_bodies(
    interface: ContactInterface,
    start_state: ContactState,
    state: ContactState,
    rigid_surface_kinematics: MeasuredKinematics,
) -> MeasuredKinematics:
    """Return kinematics with measured values for all nodes of pairs of sliding bodies.

    The force operator of the result also distributes forces to the opposite bodies.

    Args:
        interface: the contact nodes.
        start_state: state at the start of the increment.
        state: state at the end of the increment.
        rigid_surface_kinematics: kinematics of all other nodes, which are changed in place.
    """
    dim, n_nodes = interface.position.shape[1], len(interface.node)
    # fractions of unit forces that master nodes receive: values, contact nodes and global nodes
    entries = []
    for k, mortar in interface.mortars.items():
        points = np.flatnonzero(interface.pair == k)
        slave_number = np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], interface.node[points])
        x, parts = list[Array](), list[MortarMatrices]()
        for end in (start_state, state):
            displacement = interface.extract_displacements_at_nodes(mortar.nodes, end.unknowns)
            displacement[mortar.n_slave_nodes :] += end.translations[k]
            x.append(mortar.x + displacement)
            parts.append(mortar.evaluate_mortar_matrices_independently(x[-1]))
        gap, slip = measure_gap_and_slip(parts[0], parts[1], x[0], x[1])
        rigid_surface_kinematics.gap[points], rigid_surface_kinematics.slip[points] = (
            gap[slave_number],
            slip[slave_number],
        )
        rigid_surface_kinematics.normal[points], rigid_surface_kinematics.noise[points] = (
            parts[1].normals[slave_number],
            0.0,
        )
        rigid_surface_kinematics.transfer_error[points] = parts[1].fraction_error[slave_number]
        master_parts = sp.coo_array(parts[1].master_fractions[slave_number])
        entries.append(
            (
                master_parts.data,
                points[master_parts.row],
                mortar.nodes[mortar.n_slave_nodes + master_parts.col],
            )
        )
    value, row, column = (np.concatenate(part) for part in zip(*entries, strict=True))
    shape = n_nodes, interface.field.local_and_global_size[1] // dim
    unit_forces = sp.csr_matrix((np.ones(n_nodes), (np.arange(n_nodes), interface.node)), shape)
    nodal_forces = unit_forces - sp.csr_matrix((value, (row, column)), shape)
    rows = interface.assemble_matrix_over_all_unknowns(
        sp.csr_matrix(sp.kron(nodal_forces, sp.eye_array(dim)))
    )
    return replace(rigid_surface_kinematics, force_operator=rows.transpose(PETSc.Mat()))


def check_stiffness_sign(K: PETSc.Mat, interface: ContactInterface, remedy: str) -> None:
    """Raise ValueError, on all processes, if contact nodes have a negative mean stiffness.

    Args:
        K: stiffness (n, n) of the undeformed body.
        interface: the contact nodes.
        remedy: advice on how to correct the input, for the error message.
    """
    first_node = interface.field.space.dofmap.index_map.local_range[0]
    diagonal = K.getDiagonal().array_r[interface.field.owned_unknowns[interface.node - first_node]]
    total = interface.comm.allreduce(float(diagonal.sum()), MPI.SUM)
    n_entries = interface.comm.allreduce(diagonal.size, MPI.SUM)
    if total < 0:
        raise ValueError(
            f"contact nodes have a negative mean stiffness, {total / n_entries:.3g}: the sign is "
            f"wrong; {remedy}"
        )


def make_nodal_torque_function(
    interface: ContactInterface, pairs: Sequence[ContactPair], state: ContactState
) -> Callable[[Array], Array]:
    """Return a function that computes torques (m,) from forces (m, dim) at the contact nodes.

    The torque of a node's force is about the current pivot of the surface that the node faces.
    """
    motion = _contact_node_motions(interface, state.unknowns)
    pivots, spins = zip(
        *(pair.pivot_and_spin_matrix(motion.shape[1]) for pair in pairs), strict=True
    )
    placement, pair = state.translations_and_rotations[interface.pair], interface.pair
    arm = interface.position + motion - placement[:, :-1] - np.array(pivots)[pair]
    velocity = np.einsum("nab,nb->na", np.array(spins)[pair], arm)
    return lambda force: np.asarray(np.sum(velocity * force, axis=1))


def verify_state(
    state: ContactState,
    kinematics: MeasuredKinematics,
    residual_without_contact: PETSc.Vec,
    interface: ContactInterface,
    *,
    reduction: Reduction,
    scales: VerificationScales,
    free_motion_forces: Array,
    compute_torques: Callable[[Array], Array] | None = None,
) -> ContactState:
    """Return the state with residuals and allowances that are computed independently.

    The arguments are those of `measure_residuals_and_allowances`.

    Raises:
        SolutionNotFound: on all processes, if a condition is violated by more than the tolerance
            plus its allowance.
    """
    residuals, allowance = measure_residuals_and_allowances(
        state,
        kinematics,
        residual_without_contact,
        interface,
        reduction=reduction,
        scales=scales,
        free_motion_forces=free_motion_forces,
        compute_torques=compute_torques,
    )
    for name, value in vars(residuals).items():
        limit = MAX_CONTACT_VIOLATION_PER_NODAL_FORCE + getattr(allowance, name)
        if not value <= limit:
            raise SolutionNotFound(
                f"the state found violates {name} by {value:.2g}, computed anew from its "
                f"displacements; {limit:.2g} is allowed: it is not a solution"
            )
    return replace(state, residuals=residuals, allowance=allowance)


def measure_residuals_and_allowances(
    state: ContactState,
    kinematics: MeasuredKinematics,
    residual_without_contact: PETSc.Vec,
    interface: ContactInterface,
    *,
    reduction: Reduction,
    scales: VerificationScales,
    free_motion_forces: Array,
    compute_torques: Callable[[Array], Array] | None = None,
) -> tuple[Residuals, Residuals]:
    """Return the residuals of a state, and the allowances for round-off and noise.

    Args:
        state: state that the iteration has found.
        kinematics: kinematics of the state's contact nodes, measured anew.
        residual_without_contact: residual forces (n,) of all unknowns without contact: the
            stiffness times the displacements minus the load, or the residual.
        interface: the contact nodes.
        reduction: supports and condensation.
        scales: scales of forces and lengths.
        free_motion_forces: prescribed total forces and torques of the surfaces' free motions.
        compute_torques: function that computes torques (m,) from forces (m, dim); None if no
            surface turns.
    """
    comm = interface.comm
    has_equation = interface.equation >= 0
    (state_force,) = interface.extract_local_pair_state_values(state.pairs, "force_vector")
    displacements = interface.field.owned_unknowns
    nodal_force = residual_without_contact.array_r[displacements]
    first_node = interface.field.space.dofmap.index_map.local_range[0]
    # a supported component of the residual is a reaction; friction there is taken from the state
    node_force = np.where(has_equation, nodal_force[interface.node - first_node], state_force)
    # at a node with several points, the forces of all except the first are taken from the state
    additional_force = np.where(has_equation, state_force, 0.0)
    force = interface.shared_nodes.subtract_additional_forces(node_force, additional_force)
    force = np.where(has_equation, force, state_force)
    values, allowances = _measure_law_residuals_and_allowances(
        kinematics, force, has_equation | (state_force != 0), interface, scales
    )
    unbalanced_elsewhere = _max_unbalanced_force(
        residual_without_contact,
        kinematics.force_operator,
        np.where(has_equation, force, 0.0),
        displacements.ravel(),
        reduction,
    )
    if interface.laws is None:
        values["law"], allowances["law"] = np.zeros((2, 0))
    else:
        values, allowances = _add_interface_law_residuals(
            values, allowances, kinematics, force, interface, scales
        )
    values["equilibrium"] = np.atleast_1d(unbalanced_elsewhere / scales.force)
    force_round_off = float(comm.allreduce(allowances["tension"].max(initial=0.0), MPI.MAX))
    (transfer_round_off,) = _max_over_ranks_or_inf_if_nan(
        comm, kinematics.transfer_error * np.linalg.norm(force, axis=1)
    )
    allowances["equilibrium"] = np.atleast_1d(
        force_round_off + (scales.equilibrium + transfer_round_off) / scales.force
    )
    values["balance"], allowances["balance"] = _measure_balance_residuals_and_allowances(
        state,
        force,
        interface,
        scales,
        free_motion_forces=free_motion_forces,
        compute_torques=compute_torques,
        force_round_off=force_round_off,
    )
    names = list(vars(Residuals()))
    largest = _max_over_ranks_or_inf_if_nan(
        comm, *(by_name[name] for by_name in (values, allowances) for name in names)
    )
    residuals, allowance = (
        Residuals(**dict(zip(names, numbers, strict=True)))
        for numbers in (largest[: len(names)], largest[len(names) :])
    )
    return residuals, allowance


def _measure_law_residuals_and_allowances(
    kinematics: MeasuredKinematics,
    force: Array,
    friction_acts: Mask,
    interface: ContactInterface,
    scales: VerificationScales,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return residuals (m,) of contact and friction by name, and their allowances for round-off.

    Args:
        kinematics: kinematics of the contact nodes.
        force: forces (m, dim) on the contact nodes.
        friction_acts: mask (m, dim) of components in which friction acts.
        interface: the contact nodes.
        scales: scales of forces and lengths.
    """
    F, L, c = scales.force, scales.length, scales.stiffness
    normal_force = np.sum(force * kinematics.normal, axis=1)
    friction = np.where(friction_acts, force - normal_force[:, None] * kinematics.normal, 0.0)
    slip = np.where(friction_acts, kinematics.slip, 0.0)
    friction_size, slip_size = np.linalg.norm(friction, axis=1), np.linalg.norm(slip, axis=1)
    limit, slope = interface.cone.friction_limits_and_slopes(np.maximum(0.0, normal_force))
    direction_error = np.linalg.norm(slip_size[:, None] * friction + limit[:, None] * slip, axis=1)
    values = {
        "penetration": np.maximum(0.0, -kinematics.gap) / L,
        "tension": np.maximum(0.0, -normal_force) / F,
        "complementarity": np.maximum(0.0, np.minimum(normal_force / F, kinematics.gap / L)),
        "cone": np.maximum(0.0, friction_size - limit) / F,
        "stick": np.maximum(0.0, np.minimum((limit - friction_size) / F, slip_size / L)),
        "direction": direction_error / F / np.maximum(L, slip_size),
    }
    motion_size = kinematics.motion_size
    coordinate_size = np.linalg.norm(interface.position, axis=1)
    length_round_off = (
        RELATIVE_DISPLACEMENT_ROUND_OFF * motion_size
        + RELATIVE_COORDINATE_ROUND_OFF * coordinate_size
    )
    length_round_off = length_round_off + kinematics.noise * motion_size
    force_size = np.linalg.norm(force, axis=1)
    force_round_off = c * length_round_off + kinematics.noise * force_size
    force_round_off = (
        np.full(len(c), _max_over_ranks_or_inf_if_nan(interface.comm, force_round_off)[0]) / F
    )
    # forces are exact to the tolerance; lengths, to the tolerance of forces divided by stiffness
    length_round_off = length_round_off / L + np.divide(
        MAX_CONTACT_VIOLATION_PER_NODAL_FORCE * F, c * L, where=c > 0, out=0 * c
    )
    friction_round_off = (1 + slope) * force_round_off
    allowances = dict.fromkeys(("penetration", "complementarity", "stick"), length_round_off)
    allowances |= {
        "tension": force_round_off,
        "cone": friction_round_off + slope * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    }
    allowances["complementarity"] = np.maximum(length_round_off, force_round_off)
    allowances["stick"] = np.maximum(
        length_round_off, friction_round_off + slope * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE
    )
    slip_ratio = np.minimum(1.0, (slip_size + length_round_off * L) / L)
    allowances["direction"] = (
        2 * (friction_round_off + slope * MAX_CONTACT_VIOLATION_PER_NODAL_FORCE) * slip_ratio
        + 2 * length_round_off * limit / F
    )
    return values, allowances


def _add_interface_law_residuals(
    values: dict[str, Array],
    allowances: dict[str, Array],
    kinematics: MeasuredKinematics,
    force: Array,
    interface: ContactInterface,
    scales: VerificationScales,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return residuals and allowances by name, with those of interface laws at nodes that have one.

    The arguments `values` and `allowances` are those of unilateral contact at all nodes.
    """
    assert interface.laws is not None
    assert kinematics.start_history is not None
    frame = make_frames(kinematics.normal, interface.equation >= 0)
    components = np.einsum("nab,nb->na", frame, force)
    at_law, response = interface.laws.evaluate(
        frame,
        kinematics.gap,
        np.einsum("nta,na->nt", frame[:, 1:], kinematics.slip),
        components,
        kinematics.start_history,
        scales.stiffness,
    )
    violation = np.linalg.norm(components - response.force, axis=1)
    violation /= stiffness_ratio(response, scales.stiffness) * scales.force
    length_round_off = allowances["penetration"] * scales.length * scales.stiffness / scales.force
    force_gain = 1 + np.abs(response.by_force).sum(axis=(1, 2))
    law_allowances = 2 * force_gain * (allowances["tension"] + length_round_off)
    values = {name: np.where(at_law, 0.0, value) for name, value in values.items()}
    values["law"] = np.where(at_law, violation, 0.0)
    return values, allowances | {"law": np.where(at_law, law_allowances, 0.0)}


def _measure_balance_residuals_and_allowances(
    state: ContactState,
    force: Array,
    interface: ContactInterface,
    scales: VerificationScales,
    *,
    free_motion_forces: Array,
    compute_torques: Callable[[Array], Array] | None,
    force_round_off: float,
) -> tuple[Array, Array]:
    """Return residuals and allowances (free,) of the force and torque balances of free motions."""
    comm, dim = interface.comm, force.shape[1]
    values, allowances = np.zeros(len(state.free_motions)), np.zeros(len(state.free_motions))
    for number, ((pair, axis), total) in enumerate(
        zip(state.free_motions, free_motion_forces, strict=True)
    ):
        in_pair = interface.pair == pair
        if axis < dim:
            forces, arms = force[in_pair, axis], np.ones(in_pair.sum())
        else:
            assert compute_torques is not None
            forces = compute_torques(force)[in_pair]
            unit_torques = [
                compute_torques(np.tile(unit, (len(force), 1)))[in_pair] for unit in np.eye(dim)
            ]
            arms = np.linalg.norm(unit_torques, axis=0)
        sum_of_forces = comm.allreduce(float(forces.sum()), MPI.SUM)
        arm = max(*_max_over_ranks_or_inf_if_nan(comm, arms), np.finfo(float).tiny)
        n_nodes = comm.allreduce(int(np.sum(in_pair)), MPI.SUM)
        values[number] = abs(sum_of_forces - total) / (scales.force * arm)
        allowances[number] = force_round_off * np.sqrt(n_nodes)
    return values, allowances


def _max_unbalanced_force(
    residual_without_contact: PETSc.Vec,
    force_operator: PETSc.Mat,
    contact_force: Array,
    displacement_indices: LocalIndices,
    reduction: Reduction,
) -> float:
    """Return the largest force in a free equation that contact forces do not balance.

    Args:
        residual_without_contact: residual forces (n,) without contact.
        force_operator: matrix H (n, m dim) that takes contact forces to forces on all unknowns.
        contact_force: contact forces (m, dim).
        displacement_indices: numbers of the displacements among the unknowns of this process.
        reduction: supports and condensation.
    """
    node_forces = force_operator.createVecRight()
    node_forces.setArray(contact_force.ravel())
    remainder = residual_without_contact.copy()
    remainder.axpy(-1.0, force_operator * node_forces)
    node_remainder = remainder.duplicate()
    node_remainder.setArray(0.0)
    node_remainder.array[displacement_indices] = remainder.array_r[displacement_indices]
    reduced = reduction.left.createVecRight()
    reduction.left.multTranspose(node_remainder, reduced)
    return float(reduced.norm(PETSc.NormType.INFINITY))


def _contact_node_motions(interface: ContactInterface, unknowns: PETSc.Vec) -> Array:
    """Return motions (m, dim) of the contact nodes, computed from the unknowns (n,)."""
    return np.array((interface.motion * unknowns).array_r.reshape(interface.position.shape))


def _max_over_ranks_or_inf_if_nan(comm: MPI.Comm, *arrays: Array) -> list[float]:
    """Return the largest value of each array on all processes, at least 0, or infinity for NaN."""
    largest = np.array([values.max(initial=0.0) for values in arrays])  # NaN if a value is NaN
    largest[np.isnan(largest)] = np.inf
    comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    return [float(value) for value in largest]
