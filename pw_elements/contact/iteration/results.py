"""Construction of contact states from the last iterate on all processes.

The module guarantees that the pair states and scalars of a contact state are the same on all
processes. It assumes an iterate that was returned by `IncrementEquations.evaluate_all_conditions`.
"""

import logging
from dataclasses import replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array
from pw_elements.contact.interface import (
    FACED_INDEX_OF_DEFORMABLE_SURFACE,
    FACED_INDEX_OF_RIGID_SURFACE,
    RELATIVE_COORDINATE_ROUND_OFF,
    ContactInterface,
)
from pw_elements.contact.iteration.increment import IncrementEquations
from pw_elements.contact.iteration.increment_data import NewtonIterate
from pw_elements.contact.model import (
    ContactState,
    PairState,
    ResidualScale,
    SmallDisplacementMeasures,
    SolutionNotFound,
)
from pw_elements.contact.nodes import HELD, OPEN, remove_normal_part
from pw_elements.contact.system import ContactSystem
from pw_elements.progress import log_on_root
from pw_elements.solvers import SolverReport

# Largest slip in a direction that a support holds, relative to the largest motion of a node, that
# counts as none
_MAX_UNSEEN_SLIP_PER_MOTION = 1e-9


def make_contact_state(
    increment: IncrementEquations,
    state: NewtonIterate,
    start_state: ContactState,
    *,
    scale: ResidualScale,
    iterations: int,
    report: SolverReport,
    smallness: SmallDisplacementMeasures | None,
    can_slide_at_same_forces: bool = False,
) -> ContactState:
    """Return the contact state of an iterate, without its residuals; collective.

    Args:
        increment: equations of the increment.
        state: iterate.
        start_state: contact state at the start of the increment.
        scale: scale of the load history at the end of the increment, from
            `IncrementEquations.updated_scale_and_reference_force_and_length`.
        iterations: number of linear systems solved.
        report: report of the linear solver.
        smallness: measures of how small the displacements are; None at large strains.
        can_slide_at_same_forces: whether the body may slide any distance while all forces stay the
            same.
    """
    system = increment.system
    signs = frozenset(system.tangent.solver.determinant_signs)
    all_signs = (
        signs | start_state.determinant_signs
        if start_state.free_motions == system.free_motions
        else signs
    )
    is_unique = len(all_signs) <= 1 if signs else None
    if increment.interface.cone.has_user_law:
        increment.interface.raise_law_errors_and_check_slopes()
    result = ContactState(
        displacement=increment.interface.field.extract(state.unknowns),
        pairs=_make_pair_states_of_iterate(increment, state),
        iterations=iterations,
        unique=False if can_slide_at_same_forces else is_unique,
        report=report,
        increment=start_state.increment + 1,
        free_motions=system.free_motions,
        determinant_signs=all_signs,
        scale=scale,
        smallness=smallness,
        unknowns=state.unknowns,
    )
    if increment.interface.shared_nodes.exist:
        n_undetermined = sum(int(mask.sum()) for mask in result.find_undetermined_friction())
        if n_undetermined:
            log_on_root(
                increment.interface.comm,
                logging.INFO,
                f"at nodes in several pairs, {n_undetermined} forces have a part of friction that "
                "is not determined: their sums and all displacements are. "
                "ContactState.find_undetermined_friction shows the nodes",
                ".contact",
            )
    return result


def check_interface_laws_at_solution(increment: IncrementEquations, state: NewtonIterate) -> None:
    """Check derivatives, softening and slips of interface laws at a solution; collective.

    Raises:
        ValueError: if differences contradict a derivative, or if a node with a law slips on a rigid
            surface in a direction in which a support holds it: laws give no force there.
        SolutionNotFound: if a node has softened too much in one step.
    """
    laws, nodes = increment.interface.laws, state.nodes
    if laws is None:
        return
    interface, start = increment.interface, increment.start
    dim = state.displacement.shape[1]
    motion = state.displacement - start.displacement
    motion = motion - (state.q - start.q)[interface.pair, :dim]
    unseen = motion - np.einsum("nab,nac,nc->nb", nodes.frame, nodes.frame, motion)
    scale = max(
        increment.nonnegative_max_over_ranks(
            state.displacement_size,
            np.abs(motion),
            RELATIVE_COORDINATE_ROUND_OFF * np.abs(interface.position),
        )
    )
    is_held = laws.has_law & (interface.faced == FACED_INDEX_OF_RIGID_SURFACE)
    interface.raise_error_for_invalid_points(
        is_held & (np.abs(unseen).max(axis=1) > _MAX_UNSEEN_SLIP_PER_MOTION * scale),
        "slip in a direction in which a support holds them, and in which their interface law gives "
        "no force: let the pair end before them, or hold other nodes",
    )
    laws.raise_if_softened_too_fast(start.history, nodes.updated_law_history(start.history))
    laws.check_derivatives_at_state(
        nodes.frame, nodes.gap, nodes.slip, nodes.force, increment.start.history, nodes.scale
    )


def check_determinant_sign_if_laws_soften(
    system: ContactSystem, solution: ContactState, start_state: ContactState
) -> ContactState:
    """Return a solution with the sign of its last determinant, if a law may soften.

    Softening alone does not change the sign, unless the interface softens faster than the body
    unloads. Without softening laws, and with solvers without determinants, the solution is returned
    unchanged.

    Args:
        system: contact system.
        solution: state at the end of the increment.
        start_state: state at the start of the increment.

    Raises:
        SolutionNotFound: if the sign has changed since the undeformed state.
    """
    laws, signs = system.interface.laws, system.tangent.solver.determinant_signs
    if laws is None or not laws.may_soften or not signs:
        return solution
    is_comparable = start_state.free_motions == system.free_motions
    stable_signs = start_state.determinant_signs if is_comparable else frozenset[int]()
    if signs[-1] not in (stable_signs or signs[:1]):
        raise SolutionNotFound(
            "the solution is unstable: the determinant of its tangent has changed its sign"
        )
    return replace(solution, determinant_signs=frozenset(signs[-1:]))


def make_undeformed_state(interface: ContactInterface, zero_unknowns: PETSc.Vec) -> ContactState:
    """Return the state of the undeformed body; `zero_unknowns` is a zero vector (n,)."""
    no_vector = np.zeros_like(interface.position)
    gap, normal = interface.evaluate_undeformed_gaps_and_normals(None)
    history = {} if interface.laws is None else {"law_history": interface.laws.initial_history}
    pairs = make_pair_states(
        interface,
        np.zeros((interface.pairs, no_vector.shape[1])),
        no_vector,
        interface.force,
        normal=normal,
        gap=gap,
        friction=interface.cone.max_coefficient,
        **history,
    )
    return ContactState(interface.field.extract(zero_unknowns), pairs, unknowns=zero_unknowns)


def _make_pair_states_of_iterate(
    increment: IncrementEquations, state: NewtonIterate
) -> tuple[PairState, ...]:
    interface, start, nodes = increment.interface, increment.start, state.nodes
    active, normal, tangents = nodes.active_set, nodes.frame[:, 0], nodes.frame[:, 1:]
    has_no_tangent = ~tangents.any(axis=(1, 2))
    is_held = (
        (interface.faced == FACED_INDEX_OF_DEFORMABLE_SURFACE)
        & interface.cone.has_friction
        & has_no_tangent
    )
    status = np.where(is_held & (active.status != OPEN), HELD, active.status).astype(np.int8)
    dim = state.displacement.shape[1]
    motion = state.displacement - start.displacement
    motion = motion - (state.q - start.q)[interface.pair, :dim]

    def convert_tangential_to_global(tangential_components: Array) -> Array:
        return np.einsum("nab,na->nb", tangents, tangential_components)

    path_slip = increment.kinematics.compute_slip_along_straight_path(
        state.q, state.displacement, normal
    )
    held_slip = remove_normal_part(motion, normal)
    resultants = state.kinematics.torque_map.compute_force_and_torque_of_each_point(state.force)
    friction = interface.cone.coefficient(nodes.force[:, 0])
    slip = np.where((status == HELD)[:, None], held_slip, convert_tangential_to_global(nodes.slip))
    is_closed = (status != OPEN)[:, None]
    return make_pair_states(
        interface,
        state.q,
        state.force,
        increment.system.force_operator,
        normal=normal,
        force_normal=nodes.force[:, 0],
        force_tangential=convert_tangential_to_global(nodes.force[:, 1:]),
        torque=resultants[:, dim:].sum(axis=1),
        gap=nodes.gap,
        slip=slip * is_closed,
        path_slip=path_slip * is_closed,
        friction=friction,
        status=status,
        displacement=state.displacement,
        direction=convert_tangential_to_global(active.direction),
        friction_ratio=active.friction_ratio,
        law_history=nodes.updated_law_history(start.history),
    )


def make_pair_states(
    interface: ContactInterface,
    surface_motions: Array,
    contact_forces: Array,
    force_operator: PETSc.Mat,
    **nodal_values: npt.NDArray,
) -> tuple[PairState, ...]:
    """Return the states of all pairs; collective.

    Args:
        interface: contact points of all pairs.
        surface_motions: motions (pairs, k) of the surfaces.
        contact_forces: forces (m, dim) of the surfaces on the points of this process.
        force_operator: matrix (n, m dim) that distributes contact forces to the equations.
        nodal_values: arrays (m, ...) of the other attributes of `PairState` at the points of this
            process. Omitted attributes are zero, except the status, which is open.
    """
    no_vector, dim = np.zeros_like(contact_forces), contact_forces.shape[1]
    values = {"position": interface.position, "node": interface.node}
    values["faced_node"] = interface.faced
    values |= dict.fromkeys(
        ("force_tangential", "slip", "path_slip", "displacement", "direction"), no_vector
    )
    values |= dict.fromkeys(("force_normal", "friction_ratio", "torque"), no_vector[:, 0])
    values["law_history"] = np.zeros((len(no_vector), 0))
    values |= {"status": np.full(len(no_vector), OPEN, dtype=np.int8)} | nodal_values
    opposite_force = interface.compute_forces_on_opposite_nodes(contact_forces, force_operator)
    pair_values = interface.gather_all_pairs_in_position_order(values | {"total": contact_forces})
    return tuple(
        PairState(
            translation=surface_motions[k, :dim].copy(),
            force=arrays.pop("total").sum(axis=0),
            rotation=np.array(surface_motions[k, dim:].sum()),
            torque=np.array(arrays.pop("torque").sum()),
            opposite_node=interface.opposite[k].copy(),
            opposite_force=opposite_force[k],
            **arrays,
        )
        for k, arrays in enumerate(pair_values)
    )
