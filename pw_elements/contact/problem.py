"""A contact problem as the user states it: `ContactProblem`."""

from collections.abc import Collection, Sequence
from functools import partial
from pathlib import Path

from petsc4py import PETSc

from dolfinx import fem

from pw_elements.choice import by_chosen
from pw_elements.contact.inputs import (
    check_belongs,
    check_state,
    checked_path,
    checked_problem,
    checked_remedies,
    checked_step,
    solver_for,
)
from pw_elements.contact.pairs import ContactPair, Motion
from pw_elements.contact.progress import Callback, checked_callback
from pw_elements.contact.remedies import REMEDIES, Remedy
from pw_elements.contact.results import undeformed
from pw_elements.contact.state import ContactState
from pw_elements.contact.stepping import Stepping
from pw_elements.contact.storage import read_state, write_state
from pw_elements.iterative import Solver
from pw_elements.linear_solver import LinearSolver
from pw_elements.mesh_checks import check_mesh
from pw_elements.reduction import Reduction


class ContactProblem:
    """A body, its supports and contact pairs; `step` takes it from one state to the next.

        problem = ContactProblem(K, supports, [floor, punch], U)
        pressed = problem.step(problem.undeformed, load, [None, Motion((0, -0.1))])
        pushed = problem.step(pressed, load, [None, Motion((0.02, -0.1))])
        problem.save(pushed, "pushed.npz")

    States are never changed: you can continue from any of them, any number of times.

    Args:
        K: stiffness (n, n), all rows and columns free; it may be unsymmetric.
        reduction: supports (or condensation) that keep the contact nodes' displacements, or
            prescribe some that are tangential.
        pairs: contact pairs; a node belongs to one of them. Their `motions` are those of
            `solve_contact` and do not count here.
        space: trial space of the displacements, or of the hybrid element.
        solver: of the linear systems, as in `solve`; contact of hybrid bodies needs `Direct()`.
        max_iterations: linear systems of one iteration.
        callback: called with a `Progress` after each iteration and each increment, on each process
            that has one; an exception that it raises ends the computation.
        remedies: what is tried where the iteration fails: "condensed" iterates without
            active sets, on the contact points alone; "cutback" halves the increment, which with
            friction is another path (see `ContactState.substates`); and "search" examines all
            statuses of a few points in the plane.

    Raises:
        TypeError, ValueError: for arguments that do not make a contact problem.
        DegenerateMesh: for cells that are flat or inverted.
    """

    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: ContactPair | Sequence[ContactPair],
        space: fem.FunctionSpace,
        solver: Solver = None,
        max_iterations: int = 50,
        callback: Callback | None = None,
        remedies: Collection[Remedy] = REMEDIES,
    ) -> None:
        self.pairs = tuple(checked_problem(K, reduction, pairs, space, max_iterations, solver))
        check_mesh(space.mesh)
        self._K, self._space, self._asked, self._supports = K, space, solver, reduction.supports
        callback = checked_callback(space.mesh.comm, callback)
        each = checked_remedies(remedies, space)
        self._by = partial(
            Stepping, K, reduction, self.pairs, space, max_iterations, callback, each
        )
        self._stepping = self._by(solver_for(solver, reduction))
        self.undeformed: ContactState = undeformed(self._stepping.interface, K.createVecRight())

    def step(
        self,
        state: ContactState,
        load: PETSc.Vec,
        motions: Motion | Sequence[Motion | None] | None = (),
        guess: ContactState | None = None,
    ) -> ContactState:
        """The state at the end of one increment.

        Args:
            state: at its start, of this problem or one like it; slip counts from there.
            load: load vector (n,) at its end, in all.
            motions: of each pair's surface from its initial place, None for one that rests
                there; by default all rest. A single pair's need not be in a list.
            guess: state whose active set is the start, for example on a coarser mesh: each node
                takes the status of the nearest; an iterative solver takes its displacements, too
                (unless it was read from a file). It carries no history.

        Raises:
            ValueError: for a load that is not finite, a number of motions that is not that of
                the pairs, motions of another dimension, a state of other contact nodes, arguments
                that differ between processes, a surface that fails, or a prescribed normal
                displacement of a node in contact.
            FreeBody: if a rigid motion is held by nothing, even if every contact node stuck.
            NoEquilibrium: a `FreeBody`, if it is proved that no contact forces balance the loads.
            NoSolution: if a search of all statuses proves that the increment has no state.
            NotUnique: if the tangent is singular at a solution: the friction is too large, or the
                body is loose.
            NotFound: if no state has been found, though there may be one; `state` came nearest.
            SurfacePassed: if a rigid surface goes through the body, or pushes it outwards.
            SolverNotConverged: if an iterative solver fails, singular tangents among the reasons;
                "auto" then goes on with factors if there is memory for them, and stays with them.
        """
        moved = checked_step(self._K, self._space, self.undeformed, state, load, motions, guess)

        def stepped(solver: LinearSolver) -> ContactState:
            if solver is not self._stepping.solver:
                self._stepping = self._by(solver)
            return self._stepping.step(state, load, moved, guess)

        return by_chosen(self._stepping.solver, self._asked, self._supports, stepped)

    def save(self, state: ContactState, path: str | Path) -> None:
        """Writes a state to a file, completely or not at all: a NumPy archive without pickles.

        Args:
            state: of this problem.
            path: of the file, which is replaced if it exists; it holds all but `substates`.

        Raises:
            TypeError: for anything but a state and a path.
            ValueError: for a state of other contact nodes.
            OSError: if the file cannot be written.
        """
        check_state(state, self.undeformed, self._space)
        write_state(checked_path(path, self._space), state, self._space)

    def load(self, path: str | Path) -> ContactState:
        """Reads a state that `save` wrote for the same problem, on any number of processes.

        Args:
            path: of the file.

        Raises:
            TypeError: for anything but a path.
            ValueError: if the file holds no state, or one of another mesh or other pairs.
            OSError: if the file cannot be read.
        """
        state = read_state(checked_path(path, self._space), self._space)
        check_belongs(state, self.undeformed, "the file's state")
        return state
