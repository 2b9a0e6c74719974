"""Increments of load and motion, and the active-set iteration within each.

Small displacements: gap and normal belong to the *undeformed* body and the surface at its
present place (initial place + translation U), so that for the displacement a of a node

    g(a, U) = gap(x - U) + n(x - U)·a,

and the slip of an increment is the tangential part of (a - U) less that at its start.
Planes make this linear in U. For curved surfaces under force control it is linearised, the
active set found, and gap and n then taken at the U so found, until nothing changes.
"""

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction
from pw_elements.contact.checks import check_mesh
from pw_elements.contact.errors import ContactFailed
from pw_elements.contact.increment import Increment, ReferenceState
from pw_elements.contact.pairs import ContactNodes, ContactPair
from pw_elements.contact.rigid import RigidMotions
from pw_elements.contact.state import ContactState
from pw_elements.contact.system import ContactSystem

Free = tuple[tuple[int, int], ...]


def solve_contact(
    K: PETSc.Mat,
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    start: ContactState | Sequence[ContactState] = (),
    max_iterations: int = 50,
) -> list[ContactState]:
    """Displacements and contact forces at the end of each increment.

    Args:
        K: stiffness (n, n), all rows and columns free; unsymmetric ones are welcome.
        loads: load vector (n,) at the end of each increment.
        reduction: supports (or condensation) that keep the contact nodes' displacements, or
            prescribe some that are tangential.
        pairs: contact pairs; a node belongs to one of them.
        space: trial space of the displacements.
        start: states of the same increments, from a coarser mesh, say: each increment starts
            from the status of the nearest node. It is a guess, no history: slip counts from the
            undeformed body in the first increment, whatever it starts from. Without it the first
            increment starts from the nodes that touch, every other one from the previous one.
        max_iterations: linear systems per increment.

    Raises:
        ValueError: for input that states no contact problem (see `ContactNodes.collect`),
            loads that are not finite, motions or starts that are not one per increment, or no
            iterations.
        DegenerateMesh: for cells without volume or turned inside out.
        FreeBody: if a rigid motion is held by nothing, or no longer once the nodes that
            would pull have opened and those that cannot hold have slipped.
        NotUnique: if the tangent is singular otherwise: Coulomb's friction too large.
        ContactNotConverged: if the active sets repeat themselves, or no end is reached.
        The last three name the increment, counted from 0, and have the states before it as
            `states`.
    """
    loads = [loads] if isinstance(loads, PETSc.Vec) else list(loads)
    pairs = [pairs] if isinstance(pairs, ContactPair) else list(pairs)
    start = [start] if isinstance(start, ContactState) else list(start)
    if max_iterations < 1:
        raise ValueError(f"max_iterations = {max_iterations}: one at least")
    check_mesh(space.mesh)
    nodes = ContactNodes.collect(pairs, space, reduction)
    _check_increments(loads, pairs, space.mesh.geometry.dim, start)

    systems: dict[Free, tuple[ContactSystem, RigidMotions]] = {}
    past = ReferenceState.undeformed(nodes)
    states: list[ContactState] = []
    for k, load in enumerate(loads):
        prescribed, forces = _motions(nodes, k)
        free: Free = tuple((int(p), int(axis)) for p, axis in np.argwhere(np.isnan(prescribed)))
        if free not in systems:
            systems.clear()  # one factorisation is kept at a time
            system = ContactSystem(K, reduction, nodes, free)
            systems[free] = system, RigidMotions(system, space)
        totals = np.array([forces[at] for at in free])
        step = Increment(*systems[free], K, load, prescribed, totals, past, max_iterations)
        try:
            state, past = step.run(start[k] if start else None)
        except ContactFailed as error:
            named = type(error)(f"increment {k}: {error}")
            named.states = states
            raise named from error
        states.append(state)
    return states


def _motions(nodes: ContactNodes, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Prescribed translations (pairs, dim), NaN where free, and total forces (pairs, dim)."""
    dim = nodes.position.shape[1]
    rest = np.zeros(dim)
    motions = [pair.motions[k] if pair.motions else None for pair in nodes.pairs]
    prescribed = [rest if m is None else m.prescribed() for m in motions]
    return np.array(prescribed), np.array([rest if m is None else m.forces() for m in motions])


def _check_increments(
    loads: Sequence[PETSc.Vec],
    pairs: Sequence[ContactPair],
    dim: int,
    start: Sequence[ContactState],
) -> None:
    if not loads:
        raise ValueError("there is no load increment")
    for k, load in enumerate(loads):
        if not np.isfinite(load.norm(PETSc.NormType.INFINITY)):
            raise ValueError(f"the load of increment {k} is not finite")
    for k, pair in enumerate(pairs):
        if pair.motions and len(pair.motions) != len(loads):
            raise ValueError(
                f"contact pair {k} has {len(pair.motions)} motions for {len(loads)} increments"
            )
        if any(len(motion.translation) != dim for motion in pair.motions):
            raise ValueError(f"the motions of contact pair {k} are not {dim}-D")
    if start and len(start) != len(loads):
        raise ValueError(f"{len(start)} states to start from for {len(loads)} increments")
    if any(len(state.pairs) != len(pairs) for state in start):
        raise ValueError("a state to start from has another number of contact pairs")
