"""Contact problems: public classes that check arguments and solve increments.

The module guarantees that the arguments of each increment are checked once, that states are never
changed, and that an error on one process is raised on all processes.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from petsc4py import PETSc

import numpy.typing as npt
import ufl
from dolfinx import fem

from pw_elements.algebra import Reduction, check_load, make_residual_problem
from pw_elements.arrays import Array, Indices
from pw_elements.checks import arguments, check_mesh, check_same_arguments_on_all_processes
from pw_elements.contact.interface import find_reduced_column_of_each_unknown
from pw_elements.contact.iteration import make_undeformed_state
from pw_elements.contact.model import (
    ContactPair,
    ContactState,
    DeformableSurface,
    HistoryVariables,
    Motion,
    check_and_list_history_functions,
    make_update_from_expressions,
)
from pw_elements.contact.nodes import assemble_force_derivatives_by_fields
from pw_elements.contact.output import (
    ProblemFingerprint,
    ProgressCallback,
    check_parts_declared_as_changed,
    fingerprint_mesh_supports_and_pairs,
    fingerprint_stiffness,
    read_state,
    write_state,
)
from pw_elements.contact.rescue import LoadFractionSetter
from pw_elements.contact.steps.checks import (
    FrictionOfPair,
    RemedyNamesOrCostRatios,
    check_and_list_motions,
    check_and_list_parameters_with_rates,
    check_and_list_successive_states,
    check_bodies_of_residuals,
    check_constants_are_used,
    check_contact_arguments,
    check_derivatives_are_known,
    check_function_or_none,
    check_large_strain_surfaces,
    check_loads_fit_problem,
    check_outputs,
    check_solver_of_bodies,
    check_start_state,
    check_state_fits_problem,
    check_stiffness_of_changed_problem,
    list_pairs_with_friction,
    list_remedy_max_cost_ratios,
)
from pw_elements.contact.steps.finite import LargeStrainStepping
from pw_elements.contact.steps.sensitivity import (
    OutputDerivatives,
    SensitivityOutput,
    SensitivityParameter,
    iterate_increments_and_substeps,
)
from pw_elements.contact.steps.stepping import REMEDIES_FOR_FAILED_ITERATION, SmallStrainStepping
from pw_elements.elasticity import is_axisymmetric_residual, is_axisymmetric_stiffness
from pw_elements.solvers import (
    Direct,
    LinearSolver,
    SolverOrAuto,
    choose_solver,
    compute_with_direct_fallback,
    has_separate_supports,
)


class ContactProblem:
    """A body with supports and contact pairs.

    The method `step` solves one increment and returns the next state:

        problem = ContactProblem(K, supports, [floor, punch], U)
        pressed = problem.step(problem.undeformed, load, [None, Motion((0, -0.1))])
        pushed = problem.step(pressed, load, [None, Motion((0.02, -0.1))])
        problem.save(pushed, "pushed.npz")

    States are never changed, so you can continue from any state, any number of times.

    Args:
        K: stiffness (n, n) without supports. It may be unsymmetric.
        reduction: supports (or condensation). It must not eliminate contact nodes, but supports may
            prescribe their tangential displacements.
        pairs: contact pairs. A node may belong to several pairs whose normals differ there, or
            that have an interface law. The `motions` of pairs are ignored here; only
            `solve_contact` uses them.
        space: trial space of the displacements, or of the hybrid element.
        solver: solver of the linear systems, as in `solve`.
        max_iterations: largest number of linear systems solved in one attempt at an increment.
        callback: function that is called with a `Progress` after each iteration and each increment.
            It may be given on some of the processes only. If it raises an exception, the
            computation ends.
        remedies: methods that are tried if the iteration fails. "springs" hold the contact points
            and are softened in stages; they are not available with `Iterative()`. "cutback" solves
            the increment in substeps, so that friction follows another path (see
            `ContactState.substates`). Each method may solve three times as many linear systems as
            the first attempt. A dictionary sets other ratios, for example {"springs": 3,
            "cutback": 10}.

    Raises:
        TypeError, ValueError: for arguments that do not define a contact problem.
        DegenerateMesh: for cells that are flat or inverted.
    """

    _has_residual = False
    # spaces of the history functions, which belong to a state
    _history_spaces: Sequence[fem.FunctionSpace] = ()

    @check_same_arguments_on_all_processes
    def __init__(
        self,
        K: PETSc.Mat,
        reduction: Reduction,
        pairs: ContactPair | Sequence[ContactPair],
        space: fem.FunctionSpace,
        solver: SolverOrAuto = None,
        max_iterations: int = 50,
        callback: ProgressCallback | None = None,
        remedies: RemedyNamesOrCostRatios = REMEDIES_FOR_FAILED_ITERATION,
    ) -> None:
        self.pairs = check_contact_arguments(
            K, reduction, pairs, space, max_iterations, solver, callback
        )
        check_mesh(space.mesh)
        self._K, self._space, self._reduction = K, space, reduction
        self._is_axisymmetric = is_axisymmetric_stiffness(K)
        self._requested_solver, self._supports = solver, reduction.supports
        self._stepping_options: dict[str, Any] = {
            "max_iterations": max_iterations,
            "callback": callback,
            "remedies": list_remedy_max_cost_ratios(remedies),
        }
        self._stiffness_state = K.stateGet()
        chosen_solver = choose_solver(solver, self._supports, compute_contact_stiffness=lambda: K)
        self._small_strain_stepping = self._make_small_strain_stepping(chosen_solver)
        self.undeformed: ContactState = make_undeformed_state(
            self._small_strain_stepping.interface, K.createVecRight()
        )

    @classmethod
    @check_same_arguments_on_all_processes
    def of_residual(
        cls,
        residual: ufl.Form | Sequence[ufl.Form],
        u: fem.Function | Sequence[fem.Function],
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        pairs: ContactPair | Sequence[ContactPair],
        solver: SolverOrAuto = None,
        max_iterations: int = 25,
        callback: ProgressCallback | None = None,
        history: HistoryVariables = (),
        update: Callable[[], None] | None = None,
    ) -> "ContactProblem":
        """Return a contact problem with large strains and large sliding, for any residual.

            F = ufl.inner(stress(u), ufl.grad(ufl.TestFunction(spaces.test))) * dx
            roller = ContactPair(top, Sphere((0, 1.0), 1.0), friction=0.3)
            problem = ContactProblem.of_residual(F, u, held, roller)
            pressed = problem.step(problem.undeformed, motions=Motion((0, -0.25)))
            pushed = problem.step(pressed, motions=Motion((0.3, -0.25)))

        Gap, normal and slip are evaluated on the deformed body. Gap and normal follow from the
        closest point of a rigid surface. Slip is the length of the arc along which the closest
        point moves; it is exact on planes, circles and spheres, and second-order accurate on other
        surfaces. Nodal contact forces are entries of the residual. An increment that fails is
        halved, and the substeps grow again after successes (see `ContactState.substates`).

        Bodies with a mesh each, for example of tetrahedra and of hexahedra, are given as lists:

            pair = ContactPair((punch, nodes), DeformableSurface((block, facets)))
            problem = ContactProblem.of_residual([F_punch, F_block], [u_punch, u_block], held, pair)

        Args:
            residual: residual without the contact forces, as in `PetrovGalerkinProblem`, or a list.
            u: unknown function in the trial space, which may be hybrid, or a list. Each step
                changes its values.
            conditions: Dirichlet conditions. Constants and functions in them may change.
            pairs: contact pairs. A rigid surface must have a method `gap_normal_and_curvature`
                (`Plane`, `Sphere` or `SignedDistance`), and it may rotate about a `pivot`. In plane
                and axisymmetric problems, the surface may be a `DeformableSurface` whose `revolved`
                is given. Its facing facets are then determined in each iteration, and slip along
                curved sides is second-order accurate.
            solver: solver of the linear systems, as in `solve`, by default `Direct()`. Surfaces
                that are free to rotate require `Direct()`. Unstable states are detected by
                determinants with `Direct()`, and by negative eigenvalues with `Iterative()`.
            max_iterations: largest number of linear systems solved in one attempt.
            callback: function that is called after each iteration and each increment, as in
                `ContactProblem`.
            history: functions in the residual that belong to the state, such as plastic strains,
                or a mapping from these functions to UFL expressions of their new values:
                `{plastic_strain: new_plastic_strain}`. Spaces for them are created by
                `history_space`. Each step starts from the values in its initial state. After each
                solved substep all expressions are evaluated before any function changes. Saved
                files contain the values.
            update: function that sets the history functions after each solved substep, when `u` is
                the solution. It replaces the expressions, for laws that UFL cannot express.

        Raises:
            TypeError, ValueError: for arguments that do not define a contact problem.
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

    @check_same_arguments_on_all_processes
    def with_changes(
        self,
        friction: FrictionOfPair | Sequence[FrictionOfPair | None] | None = None,
        stiffness: PETSc.Mat | None = None,
    ) -> "ContactProblem":
        """Return the same problem with other friction or another stiffness.

            rough = problem.with_changes(friction=0.5)
            pressed = rough.step(rough.undeformed, load, motions)
            soft = problem.with_changes(stiffness=K * 0.1)  # 0.1 times the modulus

        This problem is not changed. Spaces, contact geometry and compiled forms are shared. A
        problem with other friction also shares the factors of the stiffness. Solve each problem
        from its own `undeformed` state: friction depends on the load path.

        Args:
            friction: friction of each pair, as in `ContactPair`. A single value needs no list if
                there is one pair. None keeps the pair's friction.
            stiffness: another stiffness (n, n) of the same body. A problem with a residual has
                constants instead, whose values may change before any step.

        Raises:
            TypeError, ValueError: for arguments that do not define a contact problem, such as
                negative friction, or a stiffness of a problem with a residual.
        """
        pairs = list_pairs_with_friction(self.pairs, friction, self._space.mesh.comm)
        if stiffness is None:
            self._rebuild_if_stiffness_changed()
        else:
            check_stiffness_of_changed_problem(
                stiffness, self._K, self._reduction, self._space, self._has_residual
            )
        changed = copy(self)
        changed.pairs = pairs
        changed._change_stepping(stiffness, has_other_friction=friction is not None)
        return changed

    def _change_stepping(self, stiffness: PETSc.Mat | None, has_other_friction: bool) -> None:
        """Change the solver of the increments to the pairs of this problem and a stiffness."""
        stepping: SmallStrainStepping | None = self._small_strain_stepping
        solver = self._small_strain_stepping.solver
        if stiffness is not None:
            self._K, self._stiffness_state = stiffness, stiffness.stateGet()
            stepping = self._small_strain_stepping.with_stiffness(stiffness)
        if stepping is not None and has_other_friction:
            stepping = stepping.with_friction(self.pairs)
        self._small_strain_stepping = stepping or self._make_small_strain_stepping(solver)
        if has_other_friction:
            self.undeformed = make_undeformed_state(
                self._small_strain_stepping.interface, self._K.createVecRight()
            )

    @check_same_arguments_on_all_processes
    def step(
        self,
        state: ContactState,
        load: PETSc.Vec | LoadFractionSetter | None = None,
        motions: Motion | Sequence[Motion | None] | None = (),
    ) -> ContactState:
        """Return the state at the end of one increment.

        Args:
            state: state at the start of the increment, from which slip is measured. It must have
                the same contact nodes as this problem.
            load: total load vector (n,) at the end, by default zero. For a problem with a residual,
                it is a function of the fraction (0, 1] of the increment that sets the constants and
                functions in loads and conditions.
            motions: motion of each pair's surface, measured from its initial position to its
                position at the end. None means the initial position, which is the default for all
                surfaces. A single motion needs no list.

        Raises:
            ValueError: for a load that is not finite, a number of motions other than the number of
                pairs, motions of the wrong dimension, a motion that is free radially in
                axisymmetry, a state with other contact nodes, arguments that differ between
                processes, a surface without valid gaps or normals, or a prescribed normal
                displacement of a node in contact. A problem with a residual is known to be
                axisymmetric if the residual contains forms of a `Body`, or u_r / r.
            FreeBody: if a rigid motion would be free even if every contact node were sticking.
            NoEquilibrium: if it is proved that no contact forces balance the loads. This error is a
                `FreeBody`.
            NotUnique: if the tangent is singular at a solution, because friction is too large or
                the body is loose.
            SolutionNotFound: if no solution has been found, although one may exist. The attribute
                `state` is the closest approximation.
            SurfacePassed: if a rigid surface passes through the body, or pushes the body outwards.
                With a residual, also if a surface is moved through supports, or supports of two
                bodies are moved through each other; the error is then raised before anything is
                solved.
            NotConverged: if an iterative solver fails, perhaps because the tangent is singular. The
                solver "auto" first switches to a direct solver if there is enough memory. With a
                residual, smaller substeps are tried, and finally `SolutionNotFound` is raised
                instead.
        """
        check_start_state(state, self.undeformed)
        motion_list = check_and_list_motions(
            motions, self.pairs, self._space.mesh.geometry.dim, self._is_axisymmetric
        )
        checked_load = self._check_load(load)
        self._rebuild_if_stiffness_changed()

        def step_with(solver: LinearSolver) -> ContactState:
            if solver is not self._current_stepping.solver:
                self.release()
                self._change_solver(solver)
            return self._current_stepping.step(state, checked_load, motion_list)

        return compute_with_direct_fallback(
            self._current_stepping.solver, self._requested_solver, self._supports, step_with
        )

    def _check_load(self, load: Any) -> Any:  # noqa: ANN401
        load = self._K.createVecRight() if load is None else load
        check_load("the load", load, self._K)
        return load

    def _change_solver(self, solver: LinearSolver) -> None:
        self._small_strain_stepping = self._make_small_strain_stepping(solver)

    def _make_small_strain_stepping(self, solver: LinearSolver) -> SmallStrainStepping:
        return SmallStrainStepping(
            self._K,
            self._reduction,
            self.pairs,
            self._space,
            solver=solver,
            **self._stepping_options,
        )

    def _rebuild_if_stiffness_changed(self) -> None:
        """Rebuild the contact systems if the stiffness has changed since its factorisation."""
        if self._K.stateGet() != self._stiffness_state:
            self.release()
            self._small_strain_stepping, self._stiffness_state = (
                self._make_small_strain_stepping(self._small_strain_stepping.solver),
                self._K.stateGet(),
            )

    @check_same_arguments_on_all_processes
    def sensitivity(
        self,
        states: Sequence[ContactState],
        outputs: Sequence[SensitivityOutput],
        parameters: Sequence[SensitivityParameter],
        loads: Sequence[LoadFractionSetter | None] = (),
        weights: npt.ArrayLike | None = None,
    ) -> Array:
        """Return the derivatives of outputs in a history of states with respect to parameters.

            states = [problem.undeformed]
            for translation in path:
                states.append(problem.step(states[-1], motions=Motion(translation)))
            outputs, friction = [("force", 0, 0), ("force", 0, 1)], ("friction", 0)
            derivatives = problem.sensitivity(states, outputs, [shear_modulus, friction])

        The derivatives are exact for the discrete solution as long as no contact node changes its
        status. They follow from the tangents at the ends of all increments and their `substates`.
        One forward pass gives the derivatives with respect to all parameters. For weighted outputs,
        one backward (adjoint) pass is made instead.

        Args:
            states: states of the history. The first state is fixed, and each following state is the
                end of a step from the preceding state.
            outputs: quantities that are differentiated in each state. An output is a functional of
                the unknown function (a form); a vector (n,) of weights of all unknowns; a component
                of a pair's total force, ("force", pair, axis); or a component of the translation of
                its surface, ("translation", pair, axis).
            parameters: quantities with respect to which outputs are differentiated. A parameter
                that is the same in all steps is a scalar `fem.Constant` in the residual, conditions
                or functionals, or Coulomb's friction coefficient, ("friction", pair). For a
                quantity that varies with a parameter, give its derivatives with respect to the
                parameter (rates) in all states, including the first: (constant, rates (states,));
                (vector, rates (states,)) for nodal loads; or ("motion", pair, rates (states, dim))
                for the translation of a surface, or for its force where the translation is free.
                Rates are interpolated linearly between states.
            loads: function that was passed to each step as `load`, or None. It is given only for a
                problem with a residual; by default there are no loads.
            weights: weight (states - 1, outputs) of each output in each state except the first.

        Returns:
            Derivatives (states - 1, outputs, parameters); with weights, derivatives (parameters,)
            of the weighted sum of the outputs.

        Raises:
            TypeError, ValueError: for invalid outputs or parameters; numbers that are not real and
                finite; a constant that no form and no condition contains; loads in a problem with a
                stiffness; a problem with `history`; two bodies at large sliding; an iterative
                solver; states that are not the ends of successive steps; and contact nodes that are
                about to change their status.
        """
        check_derivatives_are_known(self._history_spaces, self._space, self.pairs)
        states = check_and_list_successive_states(states, self.undeformed)
        n_steps = len(states) - 1
        check_loads_fit_problem(loads, n_steps, self._has_residual)
        self._rebuild_if_stiffness_changed()
        stepping, space_and_kind = self._current_stepping, (self._space, self._has_residual)
        if has_separate_supports(stepping.solver) or stepping.interface.mortars:
            raise ValueError(
                "there are no derivatives of two bodies at large sliding, nor by an iterative "
                "solver: use Direct()"
            )
        output_list = check_outputs(outputs, len(self.pairs), *space_and_kind)
        parameter_list = check_and_list_parameters_with_rates(
            parameters, len(states), self.pairs, *space_and_kind
        )
        if self._large_strain_stepping_or_none is not None:
            check_constants_are_used(
                parameter_list, output_list, self._large_strain_stepping_or_none
            )
        parts = list(iterate_increments_and_substeps(states, loads or [None] * n_steps))
        derivatives = OutputDerivatives(
            stepping.interface,
            stepping.linearise_at_part_end,
            self._large_strain_stepping_or_none,
            parts,
            output_list,
            parameter_list,
        )
        if weights is None:
            return derivatives.compute_all_by_direct_mode()
        weight_shape = n_steps, len(output_list)
        return derivatives.compute_gradient_by_adjoint_mode(
            arguments.check_real_array("weights", weights, weight_shape)
        )

    @check_same_arguments_on_all_processes
    def differentiate_forces_by_fields(
        self, start: ContactState, state: ContactState, pair: int = 0
    ) -> dict[str, PETSc.Mat]:
        """Return derivatives of nodal contact forces by the nodal values of interface fields.

        They are matrices (n, n_T) by the names of the pair's fields, with the rows of the unknowns,
        on both sides, and the columns of the field's space. Displacements are constant: under a
        small change dT, the body moves as under the additional load D dT.

        Args:
            start: state from which the increment started.
            state: state at its end.
            pair: number of the contact pair.

        Raises:
            ValueError: if the pair has no fields, if these have changed since the state was
                computed, or if the law gives no force as a function of gap and slip.
        """
        check_state_fits_problem(start, self.undeformed, "the start")
        check_state_fits_problem(state, self.undeformed, "the state")
        interface = self._current_stepping.interface
        if arguments.check_integer("pair", pair, 0) >= len(self.pairs):
            raise ValueError(f"there is no contact pair {pair}: there are {len(self.pairs)}")
        return assemble_force_derivatives_by_fields(interface, start, state, pair)

    @check_same_arguments_on_all_processes
    def release(self) -> None:
        """Free the memory of the solver on all processes.

        The next step sets up the solver again.
        """
        self._current_stepping.release()

    @property
    def _current_stepping(self) -> SmallStrainStepping | LargeStrainStepping:
        return self._small_strain_stepping

    @property
    def _large_strain_stepping_or_none(self) -> LargeStrainStepping | None:
        return None

    @property
    def _stiffness_or_tangent(self) -> PETSc.Mat:
        return self._K

    def _make_fingerprint(self) -> ProblemFingerprint:
        """Return the fingerprint that identifies the problem in saved states; collective.

        The fingerprint does not depend on the number of processes.
        """
        parts = self._fingerprint_mesh_supports_and_pairs(
            find_reduced_column_of_each_unknown(self._reduction.right)
        )
        return ProblemFingerprint(parts | fingerprint_stiffness(self._K, self._space), None)

    def _fingerprint_mesh_supports_and_pairs(self, column_of_unknown: Indices) -> dict[str, Any]:
        """Return the parts of the fingerprint that do not depend on the kind of problem.

        Args:
            column_of_unknown: array (n,) of this process, with -1 for prescribed unknowns, -2 for
                unknowns that follow from others, and other numbers for free unknowns.
        """
        interface, states = self._current_stepping.interface, self.undeformed.pairs
        return fingerprint_mesh_supports_and_pairs(
            interface, self.pairs, states, column_of_unknown, self._space
        )

    @check_same_arguments_on_all_processes
    def save(self, state: ContactState, path: str | Path) -> None:
        """Write a state to a file, which is a NumPy archive without pickled objects.

        If writing fails, no incomplete file is left.

        Args:
            state: state of this problem. Its `substates` are not written.
            path: path of the file, which is replaced if it exists.

        Raises:
            TypeError: if the arguments are not a state and a path.
            ValueError: for a state with other contact nodes.
            OSError: if the file cannot be written.
        """
        check_state_fits_problem(state, self.undeformed, "the state")
        write_state(path, state, self._space, self._history_spaces, self._make_fingerprint())

    @check_same_arguments_on_all_processes
    def load(
        self, path: str | Path, changed: Sequence[str | fem.Constant | fem.Function] = ()
    ) -> ContactState:
        """Read a state that `save` has written for the same problem.

        The number of processes may differ. The problem is the same if mesh, supported unknowns and
        contact nodes are the same, and if surfaces, friction laws and stiffness or residual give
        the same numbers at fixed points. Loads, prescribed values and motions may differ. Constants
        and functions in a residual must have the same values, unless the load of a step has changed
        them.

        Args:
            path: path of the file.
            changed: parts of the problem that differ on purpose: "supports", "surface", "friction",
                "pivot", "interference", "stiffness", "residual", "constants" (all constants and
                functions in a residual), or single constants and functions.

        Raises:
            TypeError: if the arguments are not a path and a list of changed parts.
            ValueError: if the file contains no state, a state that has been modified or has invalid
                values, or a state of another problem. In the last case, the message names the part
                that differs and the difference.
            OSError: if the file cannot be read.
        """
        check_parts_declared_as_changed(changed)
        spaces, identity = (self._space, self._history_spaces), self._make_fingerprint()
        return read_state(
            path,
            *spaces,
            identity,
            self.undeformed,
            self.pairs,
            self._stiffness_or_tangent,
            changed,
        )


class _ResidualProblem(ContactProblem):
    """Contact problem that is defined by a residual, returned by `ContactProblem.of_residual`."""

    _has_residual = True

    def __init__(
        self,
        residual: ufl.Form | Sequence[ufl.Form],
        u: fem.Function | Sequence[fem.Function],
        conditions: fem.DirichletBC | Sequence[fem.DirichletBC],
        pairs: ContactPair | Sequence[ContactPair],
        *,
        solver: SolverOrAuto,
        max_iterations: int,
        callback: ProgressCallback | None,
        history: HistoryVariables,
        update: Callable[[], None] | None,
    ) -> None:
        self._make_residual_problem = partial(make_residual_problem, residual, u, conditions)
        problem = self._residual_problem = self._make_residual_problem()
        space = problem.u.function_space
        functions = check_and_list_history_functions(history, update, space.mesh.comm)
        if isinstance(history, Mapping):
            update = make_update_from_expressions(history)
        check_solver_of_bodies(solver, len(problem.parts))
        reduction = Reduction.dirichlet(space, conditions)
        self._supports = reduction.supports
        self._requested_solver = Direct() if solver is None else solver
        chosen_solver = choose_solver(
            self._requested_solver,
            self._supports,
            compute_contact_stiffness=self._assemble_undeformed_tangent,
        )
        problem.system.blocked = has_separate_supports(chosen_solver)
        self._K = K = self._assemble_undeformed_tangent()
        self.pairs = check_contact_arguments(
            K, reduction, pairs, space, max_iterations, solver, callback
        )
        self._is_axisymmetric = any(is_axisymmetric_residual(p.form, p.u) for p in problem.parts)
        self._is_axisymmetric |= any(
            isinstance(pair.surface, DeformableSurface) and bool(pair.surface.revolved)
            for pair in self.pairs
        )
        check_large_strain_surfaces(self.pairs, space, self._is_axisymmetric)
        check_bodies_of_residuals(problem.parts, self.pairs)
        self._space, self._reduction = space, reduction
        self._history_spaces = [function.function_space for function in functions]
        self._make_large_strain_stepping = partial(
            LargeStrainStepping,
            conditions=conditions,
            reduction=reduction,
            max_iterations=max_iterations,
            callback=callback,
            history=functions,
            update=update,
        )
        self._large_strain_stepping = self._make_large_strain_stepping(
            problem, pairs=self.pairs, solver=chosen_solver
        )
        start = make_undeformed_state(self._large_strain_stepping.interface, K.createVecRight())
        values = tuple(function.x.array.copy() for function in functions)
        self.undeformed = replace(start, history=values, smallness=None)

    def _change_stepping(
        self,
        stiffness: PETSc.Mat | None,  # noqa: ARG002
        has_other_friction: bool,
    ) -> None:
        if not has_other_friction:
            return
        self._restart_stepping(self._large_strain_stepping.solver)
        start = make_undeformed_state(
            self._large_strain_stepping.interface, self._K.createVecRight()
        )
        self.undeformed = replace(start, history=self.undeformed.history, smallness=None)

    def _check_load(self, load: Any) -> Any:  # noqa: ANN401
        remedy = (
            "give a function of the fraction (0, 1] of the increment, which sets the constants and "
            "functions that change"
        )
        check_function_or_none("the load of a residual", load, remedy)
        return load

    def _change_solver(self, solver: LinearSolver) -> None:
        # problems made by `with_changes` may still use the tangent of the other solver
        self._residual_problem = self._make_residual_problem()
        self._restart_stepping(solver)

    def _assemble_undeformed_tangent(self) -> PETSc.Mat:
        self._residual_problem.u.x.array[:] = 0.0
        self._residual_problem.system.assemble_tangent()
        return self._residual_problem.system.tangent

    def _restart_stepping(self, solver: LinearSolver) -> None:
        """Replace the stepping by one that has another solver or other friction."""
        self._K = self._assemble_undeformed_tangent()
        self._large_strain_stepping = self._make_large_strain_stepping(
            self._residual_problem, pairs=self.pairs, solver=solver
        )

    def _rebuild_if_stiffness_changed(self) -> None:
        """Do nothing, because the tangent is assembled in each iteration."""

    @property
    def _current_stepping(self) -> SmallStrainStepping | LargeStrainStepping:
        return self._large_strain_stepping

    @property
    def _large_strain_stepping_or_none(self) -> LargeStrainStepping | None:
        return self._large_strain_stepping

    @property
    def _stiffness_or_tangent(self) -> PETSc.Mat:
        return self._large_strain_stepping.last_tangent

    def _make_fingerprint(self) -> ProblemFingerprint:
        column, residual = self._large_strain_stepping.support_markers_and_residual_fingerprint()
        return ProblemFingerprint(self._fingerprint_mesh_supports_and_pairs(column), residual)
