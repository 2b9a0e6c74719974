"""A contact problem as the user states it, checked, and solved increment after increment."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from pw_elements.algebra import PetrovGalerkinProblem, Reduction, check_load
from pw_elements.arrays import Array, Indices
from pw_elements.checks import arguments, check_mesh, check_same_arguments, collective_errors
from pw_elements.contact.interface import find_reduced_columns
from pw_elements.contact.iteration import make_undeformed_state
from pw_elements.contact.model import (
    ContactFailed,
    ContactPair,
    ContactState,
    Motion,
)
from pw_elements.contact.output import (
    Callback,
    Fingerprint,
    check_changed_parts,
    fingerprint_problem,
    fingerprint_stiffness,
    read_state,
    write_state,
)
from pw_elements.contact.steps.checks import (
    Remedies,
    check_belongs,
    check_contact_arguments,
    check_deformed,
    check_each,
    check_function,
    check_motions,
    check_remedies,
    list_per_pair,
)
from pw_elements.contact.steps.finite import FiniteStepping, Loading
from pw_elements.contact.steps.sensitivity import (
    Derivatives,
    Output,
    Parameter,
    check_constants,
    check_loads,
    check_outputs,
    check_parameters,
    iterate_history_parts,
)
from pw_elements.contact.steps.stepping import REMEDIES, Stepping
from pw_elements.progress import report_activity
from pw_elements.solvers import (
    Direct,
    LinearSolver,
    Solver,
    choose_solver,
    collect_garbage,
    compute_with_fallback,
    is_matrix_free,
)


class ContactProblem:
    """A body, its supports and contact pairs; `step` takes it from one state to the next.

        problem = ContactProblem(K, supports, [floor, punch], U)
        pressed = problem.step(problem.undeformed, load, [None, Motion((0, -0.1))])
        pushed = problem.step(pressed, load, [None, Motion((0.02, -0.1))])
        problem.save(pushed, "pushed.npz")

    States are never changed: you can continue from any of them, any number of times.

    Args:
        K: stiffness (n, n), all rows and columns free; it may be unsymmetric.
        reduction: supports (or condensation); contact nodes stay, and have no prescribed
            displacement but tangential ones.
        pairs: contact pairs; a node belongs to one of them. Their `motions` are those of
            `solve_contact` and do not count here.
        space: trial space of the displacements, or of the hybrid element.
        solver: of the linear systems, as in `solve`.
        max_iterations: the most linear systems solved in one attempt at an increment.
        callback: called with a `Progress` after each iteration and each increment, on each process
            that has one; an exception that it raises ends the computation.
        remedies: what is tried if the iteration fails: "springs" (not by `Iterative()`) hold the
            contact points and get softer and softer; "cutback" solves the increment in parts, with
            friction another path (see `ContactState.substates`). Each may solve three times as many
            linear systems as the first attempt; {"springs": 3, "cutback": 10} allows more.

    Raises:
        TypeError, ValueError: for arguments that do not make a contact problem.
        DegenerateMesh: for cells that are flat or inverted.
    """

    _has_residual = False
    _histories: Sequence[fem.FunctionSpace] = ()  # spaces of the functions that belong to a state

    @check_same_arguments
    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: ContactPair | Sequence[ContactPair],
        space: fem.FunctionSpace,
        solver: Solver = None,
        max_iterations: int = 50,
        callback: Callback | None = None,
        remedies: Remedies = REMEDIES,
    ) -> None:
        self.pairs = check_contact_arguments(
            K, reduction, pairs, space, max_iterations, solver, callback
        )
        check_mesh(space.mesh)
        self._K, self._space, self._reduction = K, space, reduction
        self._asked, self._supports = solver, reduction.supports
        each = check_remedies(remedies)
        self._by = partial(
            Stepping,
            K,
            reduction,
            self.pairs,
            space,
            max_iterations=max_iterations,
            callback=callback,
            remedies=each,
        )
        self._seen = K.stateGet()
        self._stepping: Stepping = self._by(
            solver=choose_solver(solver, self._supports, contact_stiffness=K)
        )
        self.undeformed: ContactState = make_undeformed_state(
            self._stepping.interface, K.createVecRight()
        )

    @classmethod
    @check_same_arguments
    def of_residual(
        cls,
        residual: ufl.Form,
        u: fem.Function,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        pairs: ContactPair | Sequence[ContactPair],
        solver: Solver = None,
        max_iterations: int = 25,
        callback: Callback | None = None,
        history: Sequence[fem.Function] = (),
        update: Callable[[], None] | None = None,
    ) -> "ContactProblem":
        """Large strains and large sliding of a body that any residual states.

            F = ufl.inner(stress(u), ufl.grad(ufl.TestFunction(spaces.test))) * dx
            roller = ContactPair(top, Sphere((0, 1.0), 1.0), friction=0.3)
            problem = ContactProblem.of_residual(F, u, held, roller)
            pressed = problem.step(problem.undeformed, motions=Motion((0, -0.25)))
            pushed = problem.step(pressed, motions=Motion((0.3, -0.25)))

        Gap, normal and slip are those of the deformed body: gap and normal by the closest point of
        a rigid surface, slip by the arc that it has gone there (exact on planes, circles and
        spheres, of second order on others). Nodal contact forces are the residual's entries. An
        increment that fails is halved, and its parts grow again (see `ContactState.substates`).

        Args:
            residual: F, as in `PetrovGalerkinProblem`, without what surfaces exert.
            u: unknown function in the trial space, which may be hybrid; steps set it.
            conditions: Dirichlet conditions; constants and functions in them may change.
            pairs: with rigid surfaces that know their `closest` points, `Plane`, `Sphere` or
                `SignedDistance`, which may turn about a `pivot`; or, in the plane and in
                axisymmetry, with a `DeformableSurface` whose `revolved` is given. Who faces whom is
                found anew in each iteration; slip along curved sides is of second order.
            solver: of linear systems, as in `solve`, but by default `Direct()`. Two bodies, and
                surfaces that are free to turn, need it; it tells by determinants that a state is
                unstable, `Iterative()` by negative eigenvalues.
            max_iterations: the most linear systems solved in one attempt.
            callback: as in `ContactProblem`.
            history: functions in the residual that belong to the state, such as plastic strains: a
                step starts from its state's values, and files hold them.
            update: sets these functions after each solved part of an increment; u is its solution.

        Raises:
            TypeError, ValueError: for arguments that do not make a contact problem.
            DegenerateMesh: for cells that are flat or inverted.
        """
        return _ResidualProblem(
            residual,
            u,
            conditions,
            pairs,
            solver=solver,
            max_iterations=max_iterations,
            callback=callback,
            history=history,
            update=update,
        )

    @check_same_arguments
    def step(
        self,
        state: ContactState,
        load: PETSc.Vec | Loading | None = None,
        motions: Motion | Sequence[Motion | None] | None = (),
    ) -> ContactState:
        """The state at the end of one increment.

        Args:
            state: at the start, of a problem with the same contact nodes; slip counts from there.
            load: total load vector (n,) at the end; by default zero. With a residual it is a
                function of the share (0, 1] of the increment, which sets what changes in it:
                constants and functions of loads and of conditions.
            motions: of each pair's surface, from its initial place to the end of the increment;
                None for one that rests there, as by default all do. A single one needs no list.

        Raises:
            ValueError: for a load that is not finite, a number of motions that is not that of
                the pairs, motions of another dimension, a state of other contact nodes, arguments
                that differ between processes, a surface that fails, or a prescribed normal
                displacement of a node in contact.
            FreeBody: if a rigid motion is held by nothing, even if every contact node stuck.
            NoEquilibrium: a `FreeBody`, if it is proved that no contact forces balance the loads.
            NotUnique: if the tangent is singular at a solution: the friction is too large, or the
                body is loose.
            NotFound: if no state has been found, though there may be one; `state` came nearest.
            SurfacePassed: if a rigid surface goes through the body, or pushes it outwards. With a
                residual: if a surface is led through supports, or those of two bodies through each
                other; nothing is solved then.
            NotConverged: if an iterative solver fails, perhaps for a singular tangent; "auto" then
                goes on with factors if there is memory for them, and stays with them. With a
                residual smaller parts are tried instead, and NotFound is raised in the end.
        """
        check_belongs(state, self.undeformed, "the state")
        if not state.converged:
            raise ValueError("the state at the start is no solution: go on from the one before")
        moved = list_per_pair("motions", () if motions is None else motions, len(self.pairs))
        check_motions(moved, self.pairs, self._space.mesh.geometry.dim)
        return self._step(state, load, moved)

    def _step(
        self,
        state: ContactState,
        load: Any,  # noqa: ANN401
        motions: Sequence[Motion | None],
    ) -> ContactState:
        """Check the load, and solve."""
        load = self._K.createVecRight() if load is None else load
        check_load("the load", load, self._K)
        self._renew()

        def step_by(solver: LinearSolver) -> ContactState:
            if solver is not self._stepping.solver:
                self.release()
                self._stepping = self._by(solver=solver)
            return self._stepping.step(state, load, motions)

        return compute_with_fallback(self._stepping.solver, self._asked, self._supports, step_by)

    def _renew(self) -> None:
        """Rebuild all if K has changed since the last factorisation."""
        if self._K.stateGet() != self._seen:
            self.release()
            self._stepping, self._seen = self._by(solver=self._stepping.solver), self._K.stateGet()

    @check_same_arguments
    def sensitivity(
        self,
        states: Sequence[ContactState],
        outputs: Sequence[Output],
        parameters: Sequence[Parameter],
        loads: Sequence[Loading | None] = (),
        weights: npt.ArrayLike | None = None,
    ) -> Array:
        """Derivatives of the results of a history of states with respect to parameters.

            states = [problem.undeformed]
            for place in path:
                states.append(problem.step(states[-1], motions=Motion(place)))
            outputs, friction = [("force", 0, 0), ("force", 0, 1)], ("friction", 0)
            forces_by = problem.sensitivity(states, outputs, [shear_modulus, friction])

        They are those of the discrete solution as long as no contact node changes its status, by
        the tangents at the ends of all increments and of their `substates`: in one pass forwards
        for all parameters, or, if the outputs are weighted, in one backwards (adjoint).

        Args:
            states: the first is fixed, each other one is the end of a step from the one before.
            outputs: of each state: a functional of u (a form); a vector (n,) of weights of all
                unknowns; or a component of a pair's total force, ("force", pair, axis), or of its
                translation, ("translation", pair, axis).
            parameters: each a scalar `fem.Constant` of residual, conditions or functionals, the
                same in all steps; ("friction", pair), Coulomb's coefficient; or a quantity that
                varies, with its derivative by the parameter in every state, the first included:
                (constant, rates), ("motion", pair, rates (states, dim)) of translations or, where
                these are free, forces, (vector, rates (states,)) of nodal loads. Between states
                rates are linear in the share.
            loads: the `load` of each step, for a residual only; none by default.
            weights: (states - 1, outputs), of each output of each state but the first.

        Returns:
            Derivatives (states - 1, outputs, parameters); of the weighted sum (parameters,).

        Raises:
            TypeError, ValueError: for arguments that make no derivatives, numbers that are not
                real and finite, a constant that no form and no condition contains, loads of a
                problem with a stiffness, a problem with `history`, two bodies at large sliding, an
                iterative solver, states that are not ends of such steps, and contact nodes that are
                about to change their status.
        """
        if self._histories:
            raise ValueError(
                "the residual has a history that `update` changes in its own way: there are no "
                "derivatives of that"
            )
        states = check_each(states, ContactState, "a state")
        for state in states:
            check_belongs(state, self.undeformed, "a state")
        steps = len(states) - 1
        if steps < 1:
            raise ValueError(
                f"{len(states)} states: give the states at the start and at the end of each step"
            )
        check_loads(loads, steps, self._has_residual)
        self._renew()
        increments, known = self._increments, (self._space, self._has_residual)
        if is_matrix_free(increments.solver) or increments.interface.mortars:
            raise ValueError(
                "there are no derivatives of two bodies at large sliding, nor by an iterative "
                "solver: use Direct()"
            )
        out = check_outputs(outputs, len(self.pairs), *known)
        by = check_parameters(parameters, len(states), self.pairs, *known)
        self._check_constants(by, out)
        given = None
        if weights is not None:
            given = arguments.check_real_array("weights", weights, (steps, len(out)))
        parts = list(iterate_history_parts(states, loads or [None] * steps))
        made = increments.interface, increments.linearise, self._residual
        derivatives = Derivatives(*made, parts, out, by)
        return derivatives.compute_direct() if given is None else derivatives.compute_adjoint(given)

    @check_same_arguments
    def release(self) -> None:
        """Frees what the solver holds, on all processes; the next step makes it anew."""
        self._increments.release()

    @property
    def _increments(self) -> Stepping | FiniteStepping:
        return self._stepping

    @property
    def _residual(self) -> FiniteStepping | None:
        return None

    @property
    def _stiffness(self) -> PETSc.Mat:
        return self._K

    def _check_constants(self, parameters: Sequence[Any], outputs: Sequence[Any]) -> None:
        """Raise ValueError for constants on which nothing depends: a residual's can be told."""

    def _identify(self) -> Fingerprint:
        """Return what tells the problem from others, on any number of processes; collective."""
        parts = self._identify_interface(find_reduced_columns(self._reduction.right))
        return Fingerprint(parts | fingerprint_stiffness(self._K, self._space), None)

    def _identify_interface(self, column: Indices) -> dict[str, Any]:
        """Return the parts that all problems have; columns (n,) are -1 where supports hold."""
        interface, states = self._increments.interface, self.undeformed.pairs
        return fingerprint_problem(interface, self.pairs, states, column, self._space)

    @check_same_arguments
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
        check_belongs(state, self.undeformed, "the state")
        write_state(path, state, self._space, self._histories, self._identify())

    @check_same_arguments
    def load(
        self, path: str | Path, changed: Sequence[str | fem.Constant | fem.Function] = ()
    ) -> ContactState:
        """Reads a state that `save` wrote for the same problem, on any number of processes.

        The problem is the same if it has the mesh, the supported unknowns, the contact nodes, and
        the surfaces, laws of friction and stiffness or residual that give the same numbers at fixed
        places. Loads, prescribed values and motions may be others. Constants and functions of a
        residual have to have the values that they had, unless a load of a step has changed them.

        Args:
            path: of the file.
            changed: what is another one on purpose: "supports", "surface", "friction", "pivot",
                "interference", "stiffness", "residual", "constants" (all constants and functions of
                a residual), or single ones of these.

        Raises:
            TypeError: for anything but a path, and a list of what has changed.
            ValueError: if the file holds no state, one that has been changed since, one whose
                values cannot be those of a state, or one of another problem: the error says in
                which part, and by how much.
            OSError: if the file cannot be read.
        """
        check_changed_parts(changed)
        histories, identity = self._histories, self._identify()
        known = self.undeformed, self.pairs, self._stiffness
        return read_state(path, self._space, histories, identity, *known, changed)


class _ResidualProblem(ContactProblem):
    """A `ContactProblem` of a residual: what `ContactProblem.of_residual` makes."""

    _has_residual = True

    def __init__(
        self,
        residual: ufl.Form,
        u: fem.Function,
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        pairs: ContactPair | Sequence[ContactPair],
        *,
        solver: Solver,
        max_iterations: int,
        callback: Callback | None,
        history: Sequence[fem.Function],
        update: Callable[[], None] | None,
    ) -> None:
        problem = PetrovGalerkinProblem(residual, u, conditions)
        space = u.function_space
        check_function("update", update, "it has to be a function")
        with collective_errors(space.mesh.comm) as same:
            same["the history"] = [
                getattr(one, "function_space", None) for one in arguments.as_list(history)
            ]
            functions = check_each(history, fem.Function, "a function of the history")
            if not all(np.isfinite(one.x.array).all() for one in functions):
                raise ValueError("a function of the history has values that are not finite")
        reduction = Reduction.dirichlet(space, conditions)
        taken = choose_solver(Direct() if solver is None else solver, reduction.supports)
        problem.system.blocked = is_matrix_free(taken)
        u.x.array[:] = 0.0
        problem.system.assemble_tangent()
        K = problem.system.tangent
        self.pairs = check_contact_arguments(
            K, reduction, pairs, space, max_iterations, solver, callback
        )
        check_deformed(self.pairs, space)
        check_mesh(space.mesh)
        self._space = space
        self._histories = [function.function_space for function in functions]
        self._finite = FiniteStepping(
            problem,
            conditions,
            reduction,
            self.pairs,
            max_iterations,
            callback,
            taken,
            functions,
            update,
        )
        start = make_undeformed_state(self._finite.interface, K.createVecRight())
        values = tuple(function.x.array.copy() for function in functions)
        self.undeformed = replace(start, history=values, smallness=None)

    def _step(
        self,
        state: ContactState,
        load: Any,  # noqa: ANN401
        motions: Sequence[Motion | None],
    ) -> ContactState:
        remedy = "give a function of the share (0, 1] of the increment, which sets what changes"
        check_function("the load of a residual", load, remedy)
        return self._finite.step(state, load, motions)

    def _renew(self) -> None:
        """Do nothing: the tangent is new in each iteration."""

    @property
    def _increments(self) -> Stepping | FiniteStepping:
        return self._finite

    @property
    def _residual(self) -> FiniteStepping | None:
        return self._finite

    @property
    def _stiffness(self) -> PETSc.Mat:
        return self._finite.stiffness

    def _check_constants(self, parameters: Sequence[Any], outputs: Sequence[Any]) -> None:
        check_constants(parameters, outputs, self._finite)

    def _identify(self) -> Fingerprint:
        column, residual = self._finite.identify()
        return Fingerprint(self._identify_interface(column), residual)


@check_same_arguments
def solve_contact(
    K: PETSc.Mat,
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    max_iterations: int = 50,
    solver: Solver = None,
    callback: Callback | None = None,
    remedies: Remedies = REMEDIES,
) -> list[ContactState]:
    """Solves contact at small displacements: a `ContactState` at the end of each increment.

    Args:
        K: stiffness (n, n), all rows and columns free; it may be unsymmetric.
        loads: total load vector (n,) at the end of each increment; a single one needs no list.
        reduction: supports (or condensation); contact nodes stay, and have no prescribed
            displacement but tangential ones.
        pairs: contact pairs; a node belongs to one of them.
        space: trial space of the displacements, or of the hybrid element.
        max_iterations: the most linear systems solved in one attempt at an increment.
        solver: of the linear systems, as in `solve`.
        callback: called with a `Progress` after each iteration and each increment, on each process
            that has one; an exception that it raises ends the computation.
        remedies: as in `ContactProblem`.

    Raises:
        TypeError, ValueError: for arguments that do not make a contact problem; loads that are not
            finite, motions that are not one per increment, or no iterations.
        DegenerateMesh: for cells that are flat or inverted.
        FreeBody, NoEquilibrium, NotUnique, NotFound, SurfacePassed: as `ContactProblem.step` says.
            They name the increment, counted from 0, and have the states before it as `states`.
    """
    problem = ContactProblem(K, reduction, pairs, space, solver, max_iterations, callback, remedies)
    given = check_each([loads] if isinstance(loads, PETSc.Vec) else loads, PETSc.Vec, "a load")
    if not given:
        raise ValueError("there is no load increment")
    for k, load in enumerate(given):
        check_load(f"the load of increment {k}", load, K)
    motions = [
        check_each(pair.motions, Motion, "a motion") or [None] * len(given)
        for pair in problem.pairs
    ]
    for k, of_pair in enumerate(motions):
        if len(of_pair) != len(given):
            raise ValueError(
                f"contact pair {k} has {len(of_pair)} motions for {len(given)} increments"
            )
    moves = list(map(list, zip(*motions, strict=True)))
    for moved in moves:
        check_motions(moved, problem.pairs, space.mesh.geometry.dim)
    states = [problem.undeformed]
    for k, (load, moved) in enumerate(zip(given, moves, strict=True)):
        try:
            with report_activity(space.mesh.comm, f"{k} of {len(given)} increments done"):
                states.append(problem.step(states[-1], load, moved))
        except ContactFailed as error:
            error.args = (f"increment {k}: {error}",)
            error.states = states[1:]
            raise
    found = states[1:]
    problem.release()  # another problem needs the memory
    del problem, states
    collect_garbage(K)
    return found
