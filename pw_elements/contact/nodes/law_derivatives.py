"""Fields of interface laws at the start of increments, and derivatives of forces by fields.

The module guarantees that a state whose fields have changed since is refused. It assumes that the
state was computed by the problem that owns the interface.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from pw_elements.contact.interface import ContactInterface, make_distributed_matrix
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes.frames import make_frames
from pw_elements.contact.nodes.sliding import MortarKinematics

# Largest difference between forces of a state and those of the law at its motions, relative to the
# largest force; the tolerance of states is smaller, even for laws much stiffer than the body
_MAX_RELATIVE_FORCE_CHANGE = 1e-6
# Smallest singular value of 1 - dR/dr at which the law gives the force as a function of motions
_MIN_SINGULAR_VALUE_OF_EXPLICIT_LAW = 1e-8


def assemble_motion_and_force_operators(
    interface: ContactInterface, state: ContactState
) -> tuple[PETSc.Mat, PETSc.Mat]:
    """Return the operators of a state for averages and for forces; collective.

    The first one (m dim, n) turns unknowns into displacements of the points relative to the other
    side, and the second one (n, m dim) forces on the points into nodal forces.
    """
    if not interface.mortars:
        return interface.motion, interface.force
    q = state.translations_and_rotations
    kinematics = MortarKinematics(interface, state.unknowns, q, q)
    force = kinematics.linearise_mortars_and_assemble_force_operator(state.unknowns)
    return force.transpose(PETSc.Mat()), force


def read_interface_fields(interface: ContactInterface, state: ContactState) -> None:
    """Read the present values of fields for an increment that starts from a state; collective.

    At large sliding, the other side is averaged over the part that nodes face in this state.
    """
    laws = interface.laws
    if laws is not None and any(fields is not None for fields in laws.fields):
        laws.read_fields(assemble_motion_and_force_operators(interface, state)[0])


def assemble_force_derivatives_by_fields(
    interface: ContactInterface, start: ContactState, state: ContactState, pair_index: int
) -> dict[str, PETSc.Mat]:
    """Return the derivatives (n, n_T) of the nodal contact forces by each field; collective.

    Displacements and motions of surfaces are constant. The arguments and errors are those of
    `ContactProblem.differentiate_forces_by_fields`.
    """
    laws, comm = interface.laws, interface.comm
    fields = None if laws is None else laws.fields[pair_index]
    if laws is None or fields is None:
        raise ValueError(
            f"contact pair {pair_index} has no interface_fields: give them to the ContactPair"
        )
    if state.substates:
        _, start = state.substates[-1]
    normal, gap, slip, force_normal, force_tangential = interface.extract_local_pair_state_values(
        state.pairs, "normal", "gap", "slip", "force_normal", "force_tangential"
    )
    for _, substate in state.substates:
        slip = slip - interface.extract_local_pair_state_values(substate.pairs, "slip")[0]
    (history,) = interface.extract_local_pair_state_values(start.pairs, "law_history")
    motion, _ = assemble_motion_and_force_operators(interface, start)
    laws.read_fields(motion)
    frame = make_frames(normal, interface.equation >= 0)
    force = np.einsum("nab,nb->na", frame, force_normal[:, None] * normal + force_tangential)
    m, dim = force.shape
    at_law, response = laws.evaluate(
        frame, gap, np.einsum("nta,na->nt", frame[:, 1:], slip), force, history, np.ones(m)
    )
    laws.raise_kept_error()
    at_law &= interface.pair == pair_index
    implicit = np.eye(dim) - response.by_force
    singular_values = np.linalg.svd(implicit, compute_uv=False)
    interface.raise_error_for_invalid_points(
        at_law & (singular_values[:, -1] < _MIN_SINGULAR_VALUE_OF_EXPLICIT_LAW),
        "have an interface law that gives no force as a function of gap and slip, like closed "
        "contact or a tie: derivatives at constant displacements exist for laws with a finite "
        "stiffness only",
    )
    implicit[~at_law] = np.eye(dim)
    sizes = np.array([np.abs(part[at_law]).max(initial=0.0) for part in (force, response.force)])
    comm.Allreduce(MPI.IN_PLACE, sizes, MPI.MAX)
    differs = np.abs(force - response.force).max(axis=1) > _MAX_RELATIVE_FORCE_CHANGE * sizes.max()
    interface.raise_error_for_invalid_points(
        at_law & differs,
        "have a force that the interface law does not give at the present interface fields: the "
        "fields have changed since the state was computed, or the increment started from another "
        "state. Restore the fields, or step again",
    )
    assert response.by_fields is not None
    by_fields = np.linalg.solve(implicit, np.where(at_law[:, None, None], response.by_fields, 0.0))
    by_fields = np.einsum("nba,nbk->nak", frame, by_fields)
    by_fields = np.where((interface.equation >= 0)[:, :, None], by_fields, 0.0)
    _, to_nodal_forces = assemble_motion_and_force_operators(interface, state)
    n_names, derivatives = len(fields.names), {}
    for k, name in enumerate(fields.names):
        total = None
        for side, values in enumerate(fields.differentiate_values(k, motion)):
            begin, _ = values.getOwnershipRange()
            column = begin + np.repeat(np.arange(m), dim)
            entries = by_fields[:, :, k + side * n_names].ravel()
            rows = sp.csr_matrix(
                (entries, column, np.arange(m * dim + 1)), (m * dim, values.getSize()[0])
            )
            point_forces = make_distributed_matrix(rows, values.getSizes()[0], comm)
            part = to_nodal_forces.matMult(point_forces.matMult(values))
            if total is None:
                total = part
            else:
                total.axpy(1.0, part)
        derivatives[name] = total
    return derivatives
