"""Increment after increment: `solve_contact`."""

from collections.abc import Collection, Sequence

from petsc4py import PETSc

from dolfinx import fem

from pw_elements.contact.errors import ContactFailed
from pw_elements.contact.inputs import checked_increments
from pw_elements.contact.pairs import ContactPair
from pw_elements.contact.problem import ContactProblem
from pw_elements.contact.progress import Callback
from pw_elements.contact.remedies import REMEDIES, Remedy
from pw_elements.contact.state import ContactState
from pw_elements.iterative import Solver
from pw_elements.progress import bar, doing
from pw_elements.reduction import Reduction


def solve_contact(
    K: PETSc.Mat,
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    start: ContactState | Sequence[ContactState] = (),
    max_iterations: int = 50,
    solver: Solver = None,
    callback: Callback | None = None,
    remedies: Collection[Remedy] = REMEDIES,
) -> list[ContactState]:
    """Displacements and contact forces at the end of each increment.

    Args:
        K: stiffness (n, n), all rows and columns free; it may be unsymmetric.
        loads: load vector (n,) at the end of each increment.
        reduction: supports (or condensation) that keep the contact nodes' displacements, or
            prescribe some that are tangential.
        pairs: contact pairs; a node belongs to one of them.
        space: trial space of the displacements.
        start: states of the same increments, for example on a coarser mesh: each increment starts
            from the status of the nearest node. It is a guess and carries no history: slip counts
            from the undeformed body in the first increment (`ContactProblem.step` continues from a
            state). Without it the first starts from the nodes that touch, others from the one
            before.
        max_iterations: linear systems of one iteration.
        solver: of the linear systems, as in `solve`; contact of hybrid bodies needs `Direct()`.
        callback: called with a `Progress` after each iteration and each increment, on each process
            that has one; an exception that it raises ends the computation.
        remedies: as in `ContactProblem`.

    Raises:
        TypeError, ValueError: for arguments that do not make a contact problem; loads that are not
            finite, motions or starts that are not one per increment, or no iterations.
        DegenerateMesh: for cells that are flat or inverted.
        FreeBody, NoEquilibrium, NotUnique, NotFound, SurfacePassed: as `ContactProblem.step` says.
            They name the increment, counted from 0, and have the states before it as `states`.
    """
    problem = ContactProblem(K, reduction, pairs, space, solver, max_iterations, callback, remedies)
    increments = checked_increments(K, loads, problem.pairs, start, space)
    states = [problem.undeformed]
    for k, (load, motions, guess) in enumerate(increments):
        try:
            with doing(space.mesh.comm, bar(k, len(increments))):
                states.append(problem.step(states[-1], load, motions, guess))
        except ContactFailed as error:
            error.args = (f"increment {k}: {error}",)
            error.states = states[1:]
            raise
    return states[1:]
