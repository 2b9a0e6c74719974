"""Checks of the user's arguments, made once in each public method.

The module guarantees that increments are solved only with arguments of valid types, sizes and
values, and the iteration need not check them again. It assumes that the checks are called on all
processes.
"""

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from pw_elements.algebra import (
    PetrovGalerkinProblem,
    Reduction,
    check_load,
    check_problem,
    is_finite,
)
from pw_elements.arrays import Array, RealVector
from pw_elements.checks import JoinedSpace, arguments, check_mesh, raise_errors_on_all_processes
from pw_elements.contact.interface import check_piecewise_linear_weight_functions
from pw_elements.contact.model import (
    ClosestPointSurface,
    ContactPair,
    ContactState,
    Coulomb,
    DeformableSurface,
    Friction,
    MatchingNodes,
    Motion,
)
from pw_elements.contact.output import ProgressCallback
from pw_elements.contact.steps.sensitivity import (
    ParametricResidual,
    SensitivityOutput,
    SensitivityParameter,
    constant_vector_or_kind_of_parameter,
)
from pw_elements.contact.steps.stepping import (
    MAX_REMEDY_COST_PER_FIRST_ATTEMPT,
    REMEDIES_FOR_FAILED_ITERATION,
    RemedyName,
)
from pw_elements.elasticity import is_axisymmetric_stiffness
from pw_elements.progress import log_on_root
from pw_elements.solvers import Direct, SolverOrAuto
from pw_elements.spaces import is_hybrid

# Names of remedies, or a mapping from the name of each remedy to its largest cost, relative to the
# cost of the first attempt
RemedyNamesOrCostRatios: TypeAlias = Collection[RemedyName] | Mapping[RemedyName, float]
# Function that returns the translation (dim,) of a surface at a given time
SurfacePathInTime: TypeAlias = Callable[[float], RealVector]
# Friction of a contact pair: a coefficient, a function of positions, or a law
FrictionOfPair: TypeAlias = float | Callable[[Array], Array] | Friction

# Largest difference between positions of identical nodes, relative to the largest coordinate
_MAX_SAME_NODE_DISTANCE_PER_LARGEST_COORDINATE = 1e-9

_NEEDS_RESIDUAL_MESSAGE = (
    "a stiffness K has no known constants and no u: give vectors of weights and of loads, or state "
    "the problem by its residual"
)


def check_contact_arguments(
    K: PETSc.Mat,
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    max_iterations: int,
    solver: SolverOrAuto,
    callback: ProgressCallback | None = None,
) -> tuple[ContactPair, ...]:
    """Check arguments of a contact problem and return its pairs as a tuple.

    Raises:
        TypeError, ValueError: for arguments that do not fit together.
    """
    arguments.check_function_space(space)
    arguments.check_integer("max_iterations", max_iterations, 1)
    with raise_errors_on_all_processes(space.mesh.comm):  # only some processes may have a callback
        check_function_or_none("callback", callback, "it has to be a function")
    pair_list = as_list_of_type(pairs, ContactPair, "a contact pair")
    check_problem({"the stiffness": K}, reductions=(reduction,), space=space, solver=solver)
    if is_axisymmetric_stiffness(K):
        check_pairs_have_no_pivot(pair_list)
    if any(isinstance(pair.surface, DeformableSurface) for pair in pair_list):
        check_piecewise_linear_weight_functions(K, space)
    return tuple(pair_list)


def check_pairs_have_no_pivot(pairs: Sequence[ContactPair]) -> None:
    """Raise ValueError if a pair has a pivot, since no surface rotates in axisymmetry."""
    for k, pair in enumerate(pairs):
        if pair.pivot is not None:
            raise ValueError(
                f"contact pair {k} has a pivot, but in axisymmetry no surface can rotate about a "
                "point of the plane (r, z): leave the pivot out"
            )


def check_impact_and_list_surface_paths(
    paths: SurfacePathInTime | Sequence[SurfacePathInTime | None],
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
) -> list[SurfacePathInTime | None]:
    """Check arguments of explicit dynamics, and return the path of each pair's surface.

    The path of a surface that does not move is None.

    Raises:
        ValueError: for contact of two bodies, a hybrid space, or a number of paths other than the
            number of pairs.
        TypeError: for a path that is not a function.
    """
    if any(isinstance(pair.surface, (MatchingNodes, DeformableSurface)) for pair in pairs):
        raise ValueError("impact of two bodies is not supported: give rigid surfaces")
    if any(pair.interface_law is not None for pair in pairs):
        raise ValueError(
            "impact has unilateral contact with friction only: leave the interface law out"
        )
    if is_hybrid(space):
        raise ValueError(
            "a pressure has no mass: give a space of displacements alone, as of "
            "Spaces.petrov_galerkin(mesh)"
        )
    path_list = as_list_per_pair("paths", paths, len(pairs))
    for k, path in enumerate(path_list):
        check_function_or_none(
            f"the path of contact pair {k}", path, "it has to be a function of time"
        )
    return path_list


def list_remedy_max_cost_ratios(remedies: RemedyNamesOrCostRatios) -> dict[RemedyName, float]:
    """Return the largest cost of each remedy, relative to the cost of the first attempt.

    Raises:
        ValueError: for remedies that are unknown, or costs that are not positive.
    """
    has_names = isinstance(remedies, Collection) and not isinstance(remedies, str)
    if not has_names or any(remedy not in REMEDIES_FOR_FAILED_ITERATION for remedy in remedies):
        raise ValueError(
            f"remedies {remedies!r}: give some of "
            f"{', '.join(map(repr, REMEDIES_FOR_FAILED_ITERATION))}"
        )
    ratios = (
        remedies
        if isinstance(remedies, Mapping)
        else dict.fromkeys(remedies, MAX_REMEDY_COST_PER_FIRST_ATTEMPT)
    )
    return {
        name: arguments.check_positive(f"the multiple of {name}", ratios[name])
        for name in REMEDIES_FOR_FAILED_ITERATION
        if name in ratios
    }


def check_large_strain_surfaces(
    pairs: Sequence[ContactPair], space: fem.FunctionSpace, is_axisymmetric: bool
) -> None:
    """Raise ValueError if the surface of a pair is not supported at large strains.

    The message suggests an alternative.

    Args:
        pairs: contact pairs.
        space: trial space.
        is_axisymmetric: whether the body is known to be axisymmetric.
    """
    if is_axisymmetric:
        check_pairs_have_no_pivot(pairs)
    for k, pair in enumerate(pairs):
        surface, fault = pair.surface, ""
        if getattr(surface, "gradient", True) is None:
            message = f"contact pair {k} has no gradient function: finite differences replace it"
            log_on_root(space.mesh.comm, logging.WARNING, message, ".contact")
        if pair.interference:
            fault = (
                "interference is supported for small displacements only: start with the surface "
                "outside of the body, and move it in"
            )
        elif isinstance(surface, DeformableSurface):
            if surface.coincident:
                fault = "`coincident` sides are supported for small displacements only"
        elif not isinstance(surface, ClosestPointSurface):
            fault = (
                f"deformed bodies cannot touch a {type(surface).__name__}, which knows no closest "
                "points; use Sphere (a circle in the plane), Plane or SignedDistance, such as that "
                "of a punch with rounded edges"
            )
        if fault:
            raise ValueError(f"contact pair {k}: {fault}")


def check_bodies_of_residuals(
    problems: Sequence[PetrovGalerkinProblem], pairs: Sequence[ContactPair]
) -> None:
    """Check the meshes and weight functions of bodies with residuals; collective.

    Args:
        problems: residual and unknown function of each body that has a mesh of its own.
        pairs: contact pairs.

    Raises:
        ValueError: for weight functions that are not piecewise linear if bodies touch each other,
            or for interface laws on several meshes.
        DegenerateMesh: for cells that are flat or inverted.
    """
    for problem in problems:
        if any(isinstance(pair.surface, DeformableSurface) for pair in pairs):
            check_piecewise_linear_weight_functions(
                problem.system.tangent, problem.u.function_space
            )
        check_mesh(problem.u.function_space.mesh)
    if len(problems) > 1 and any(pair.interface_law is not None for pair in pairs):
        raise ValueError(
            "interface laws are supported for bodies in one mesh: leave the interface law out"
        )


def check_solver_of_bodies(solver: SolverOrAuto, n_meshes: int) -> None:
    """Raise ValueError if bodies with a mesh each have a solver other than `Direct()`."""
    if n_meshes > 1 and not (solver is None or isinstance(solver, Direct)):
        raise ValueError("bodies with a mesh each are solved by Direct() only: give no solver")


def check_derivatives_are_known(
    history_spaces: Sequence[fem.FunctionSpace],
    space: fem.FunctionSpace | JoinedSpace,
    pairs: Sequence[ContactPair],
) -> None:
    """Raise ValueError if derivatives of the states of a problem are unknown.

    Args:
        history_spaces: spaces of the history variables.
        space: space of the unknowns.
        pairs: contact pairs.
    """
    if history_spaces:
        raise ValueError(
            "the residual has a history, and the derivatives of `update` are unknown: "
            "sensitivities need a problem without `history`"
        )
    if any(pair.interface_law is not None for pair in pairs):
        raise ValueError(
            "there are no derivatives of states with interface laws: sensitivities need pairs "
            "without one"
        )
    if isinstance(space, JoinedSpace):
        raise ValueError(
            "there are no derivatives of states of bodies with a mesh each: sensitivities need "
            "bodies in one mesh"
        )


def check_state_fits_problem(
    state: ContactState, undeformed_state: ContactState, label: str
) -> None:
    """Raise an error unless a state is finite and has the same contact nodes as the problem.

    Args:
        state: state that the user has passed.
        undeformed_state: undeformed state of the problem.
        label: name of the state, used in error messages.

    Raises:
        TypeError: if the argument is not a state.
        ValueError: for other contact nodes, or forces or displacements that are not finite.
    """
    as_list_of_type([state], ContactState, label)
    has_same_nodes = len(state.pairs) == len(undeformed_state.pairs) and all(
        pair.position.shape == undeformed_pair.position.shape
        and np.abs(pair.position - undeformed_pair.position).max()
        <= _MAX_SAME_NODE_DISTANCE_PER_LARGEST_COORDINATE * np.abs(undeformed_pair.position).max()
        for pair, undeformed_pair in zip(state.pairs, undeformed_state.pairs, strict=True)
    )
    if not has_same_nodes:
        raise ValueError(f"{label} belongs to other contact nodes than this problem's")
    for pair in state.pairs:
        names = ("force_normal", "force_tangential", "displacement", "translation", "rotation")
        if not all(np.isfinite(getattr(pair, name)).all() for name in names):
            raise ValueError(f"{label} has forces or displacements that are not finite")


def as_list_of_type(values: Any, expected_type: type, label: str) -> list:  # noqa: ANN401
    """Return one or several values as a list.

    `label` is the name of the values, used in error messages.

    Raises:
        TypeError: for values that are not of the expected type.
    """
    items = arguments.as_list(values)
    for item in items:
        arguments.check_type(label, item, expected_type, f"it has to be a {expected_type.__name__}")
    return items


def list_pairs_with_friction(
    pairs: Sequence[ContactPair],
    friction: FrictionOfPair | Sequence[FrictionOfPair | None] | None,
    comm: MPI.Comm,
) -> tuple[ContactPair, ...]:
    """Return pairs with other friction, where the friction of a pair is not None; collective.

    Raises:
        ValueError: for a number of values other than the number of pairs, or invalid friction.
    """
    with raise_errors_on_all_processes(comm) as same:
        values = as_list_per_pair(
            "values of friction", () if friction is None else friction, len(pairs)
        )
        changed = tuple(
            pair if value is None else replace(pair, friction=value)
            for pair, value in zip(pairs, values, strict=True)
        )
        same["the friction"] = changed  # its comparison raises deferred errors of the pairs
    return changed


def check_stiffness_of_changed_problem(
    stiffness: PETSc.Mat,
    K: PETSc.Mat,
    reduction: Reduction,
    space: fem.FunctionSpace,
    has_residual: bool,
) -> None:
    """Raise an error unless a problem may get another stiffness.

    Args:
        stiffness: stiffness that the user has passed.
        K: stiffness (n, n) of the problem.
        reduction: reduction of the problem.
        space: space of the problem.
        has_residual: whether the problem is defined by a residual.
    """
    if has_residual:
        raise ValueError(
            "a problem with a residual has no stiffness: change constants of the residual instead, "
            "before the steps"
        )
    check_problem({"the stiffness": stiffness}, reductions=(reduction,), space=space)
    if stiffness.getSizes() != K.getSizes():
        raise ValueError(
            f"the stiffness has the sizes {stiffness.getSizes()}, but the problem's has "
            f"{K.getSizes()}: give a stiffness of the same body"
        )


def as_list_per_pair(label: str, values: Any, n_pairs: int) -> list:  # noqa: ANN401
    """Return a list with one value per pair.

    If there are no values, the list contains None for each pair. `label` is the name of the values,
    used in error messages.

    Raises:
        ValueError: if the number of values differs from the number of pairs.
    """
    items = arguments.as_list(values)
    if len(items or [None] * n_pairs) != n_pairs:
        raise ValueError(f"{len(items)} {label} for {n_pairs} contact pairs")
    return items or [None] * n_pairs


def check_function_or_none(name: str, function: object, remedy: str) -> None:
    """Raise TypeError if an argument is neither a function nor None.

    Args:
        name: name of the argument, used in the error message.
        function: value of the argument.
        remedy: advice to the user, added to the error message.
    """
    if not (function is None or arguments.is_user_function(function)):
        raise TypeError(f"{name} is {arguments.describe_value_or_type(function)}: {remedy}")


def check_start_state(state: ContactState, undeformed: ContactState) -> None:
    """Raise an error unless an increment can start from a state.

    Args:
        state: state that the user has passed.
        undeformed: undeformed state of the problem.
    """
    check_state_fits_problem(state, undeformed, "the state")
    if not state.converged:
        raise ValueError(
            "the state at the start has not converged: continue from the last converged state"
        )


def check_and_list_motions(
    motions: Motion | Sequence[Motion | None] | None,
    pairs: Sequence[ContactPair],
    dim: int,
    is_axisymmetric: bool,
) -> list[Motion | None]:
    """Return the motion of each pair's surface; raise an error if a motion is invalid.

    Args:
        motions: motions that the user has passed; None or an empty list if no surface moves.
        pairs: contact pairs.
        dim: dimension of the mesh.
        is_axisymmetric: whether the body is known to be axisymmetric.
    """
    motion_list = as_list_per_pair("motions", () if motions is None else motions, len(pairs))
    check_motions(motion_list, pairs, dim, is_axisymmetric)
    return motion_list


def check_motions(
    motions: Sequence[Motion | None],
    pairs: Sequence[ContactPair],
    dim: int,
    is_axisymmetric: bool,
) -> None:
    """Raise an error for invalid motions.

    A motion is invalid if it has the wrong type or dimension, if it is a rotation of a surface
    without a pivot, or if it is free radially in axisymmetry.
    """
    for k, (motion, pair) in enumerate(zip(motions, pairs, strict=True)):
        if motion is None:
            continue
        as_list_of_type([motion], Motion, f"a motion of contact pair {k}")
        if len(motion.translation) != dim:
            raise ValueError(f"the motion of contact pair {k} is not {dim}-D")
        if pair.pivot is None and motion.rotation != 0:
            remedy = (
                "in axisymmetry no surface can rotate about a point of the plane (r, z)"
                if is_axisymmetric
                else "give it a pivot"
            )
            raise ValueError(f"contact pair {k} has a rotation without a pivot: {remedy}")
        if is_axisymmetric and motion.translation[0] is None:
            raise ValueError(
                f"the motion of contact pair {k} is free in the radial direction, in which a "
                "surface of revolution cannot move as a whole, since radial forces on it have no "
                "resultant: give 0 as its radial translation, or the prescribed change of its "
                "radius"
            )


def check_and_list_successive_states(
    states: Sequence[ContactState], undeformed: ContactState
) -> list[ContactState]:
    """Return the states at the start and at the end of each step of a problem as a list.

    Args:
        states: states that the user has passed.
        undeformed: undeformed state of the problem.

    Raises:
        TypeError, ValueError: for states of another problem, or fewer than two states.
    """
    state_list = as_list_of_type(states, ContactState, "a state")
    for state in state_list:
        check_state_fits_problem(state, undeformed, "a state")
    if len(state_list) < 2:
        raise ValueError(
            f"{len(state_list)} states: give the states at the start and at the end of each step"
        )
    return state_list


def check_and_list_loads_and_motions(
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    K: PETSc.Mat,
    pairs: Sequence[ContactPair],
    dim: int,
) -> tuple[list[PETSc.Vec], list[list[Motion | None]]]:
    """Return the load of each increment, and the motions of all surfaces in each increment.

    The motion of a pair without `motions` is None in all increments.

    Args:
        loads: total load vector (n,) at the end of each increment, or a single load vector.
        K: stiffness (n, n).
        pairs: contact pairs with the motions of their surfaces.
        dim: dimension of the mesh.

    Raises:
        TypeError, ValueError: if loads or motions are invalid, or if their number differs from the
            number of increments.
    """
    load_list = as_list_of_type(
        [loads] if isinstance(loads, PETSc.Vec) else loads, PETSc.Vec, "a load"
    )
    if not load_list:
        raise ValueError("there is no load increment")
    for k, load in enumerate(load_list):
        check_load(f"the load of increment {k}", load, K)
    motions_by_pair = [
        as_list_of_type(pair.motions, Motion, "a motion") or [None] * len(load_list)
        for pair in pairs
    ]
    for k, pair_motions in enumerate(motions_by_pair):
        if len(pair_motions) != len(load_list):
            raise ValueError(
                f"contact pair {k} has {len(pair_motions)} motions for {len(load_list)} increments"
            )
    motions_by_increment = list(map(list, zip(*motions_by_pair, strict=True)))
    for increment_motions in motions_by_increment:
        check_motions(increment_motions, pairs, dim, is_axisymmetric_stiffness(K))
    return load_list, motions_by_increment


def check_outputs(
    outputs: Sequence[Any], n_pairs: int, space: fem.FunctionSpace, allow_forms: bool
) -> list[SensitivityOutput]:
    """Return the outputs as a list; raise an error if an output is invalid.

    Args:
        outputs: outputs given by the user.
        n_pairs: number of contact pairs.
        space: trial space.
        allow_forms: whether outputs may be UFL functionals, which need a residual.
    """
    for output in outputs:
        match output:
            case ("force" | "translation", pair, axis):
                _check_index_below_count(pair, n_pairs, "contact pairs")
                _check_index_below_count(axis, space.mesh.geometry.dim, "components")
            case ufl.Form() if allow_forms:
                pass
            case ufl.Form():
                raise ValueError(_NEEDS_RESIDUAL_MESSAGE)
            case PETSc.Vec():
                _check_finite_vector_of_space("the output, a vector of weights,", output, space)
            case _:
                raise ValueError(
                    f"the output {output!r} is not valid: give a functional, a vector of weights, "
                    '("force", pair, axis) or ("translation", pair, axis), in a list'
                )
    return list(outputs)


def check_and_list_parameters_with_rates(
    parameters: Sequence[Any],
    n_states: int,
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
    allow_forms: bool,
) -> list[tuple[SensitivityParameter, Array]]:
    """Return parameters with their rates (states, ...); raise an error if a parameter is invalid.

    The rates are derivatives of the data of each state with respect to the parameter.

    Args:
        parameters: parameters given by the user.
        n_states: number of states.
        pairs: contact pairs.
        space: trial space.
        allow_forms: whether parameters may be constants, which need a residual.
    """
    with_rates: list[tuple[SensitivityParameter, Array]] = []
    for parameter in parameters:
        rates: Any = np.ones(n_states)
        shape: tuple[int, ...] = (n_states,)
        if (
            isinstance(constant_vector_or_kind_of_parameter(parameter), fem.Constant)
            and not allow_forms
        ):
            raise ValueError(_NEEDS_RESIDUAL_MESSAGE)
        match parameter:
            case fem.Constant():
                if parameter.value.shape:
                    raise ValueError("a constant with components needs rates: (constant, rates)")
            case (fem.Constant() as constant, rates):
                shape += constant.value.shape
            case (PETSc.Vec() as load, rates):
                _check_finite_vector_of_space("the load that is a parameter", load, space)
            case ("friction", pair):
                law = pairs[_check_index_below_count(pair, len(pairs), "contact pairs")].law
                if not (isinstance(law, Coulomb) and type(law).limit is Coulomb.limit):
                    raise ValueError(f"the law of friction of contact pair {pair} is not Coulomb's")
            case ("motion", pair, rates):
                _check_index_below_count(pair, len(pairs), "contact pairs")
                shape += (space.mesh.geometry.dim,)
            case _:
                raise ValueError(
                    f"the parameter {parameter!r} is not valid: give a constant, "
                    '("friction", pair), ("motion", pair, rates), (constant, rates) or '
                    "(vector, rates), in a list"
                )
        with_rates.append((parameter, arguments.check_real_array("rates", rates, shape)))
    return with_rates


def check_constants_are_used(
    parameters: Sequence[tuple[SensitivityParameter, Array]],
    outputs: Sequence[SensitivityOutput],
    residual: ParametricResidual,
) -> None:
    """Raise ValueError if a parameter is a constant that occurs nowhere in the problem.

    Constants may occur in the residual, in its Dirichlet conditions and in the outputs.

    Args:
        parameters: parameters with their rates.
        outputs: the outputs.
        residual: residual of the body, with its Dirichlet conditions.
    """
    in_outputs = [
        constant
        for output in outputs
        if isinstance(output, ufl.Form)
        for constant in output.constants()
    ]
    for parameter, _ in parameters:
        constant = constant_vector_or_kind_of_parameter(parameter)
        if not isinstance(
            constant, fem.Constant
        ) or residual.has_constant_in_residual_or_conditions(constant):
            continue
        if not any(constant is output_constant for output_constant in in_outputs):
            raise ValueError(
                f"the constant of value {constant.value.tolist()} is no parameter: neither the "
                "residual, nor a Dirichlet condition, nor a functional among the outputs contains "
                "it. Give the fem.Constant with which the forms were made"
            )


def check_loads_fit_problem(loads: Sequence[Any], n_steps: int, is_residual_problem: bool) -> None:
    """Raise TypeError or ValueError unless the loads fit the problem.

    The list may be empty. Otherwise the problem must be defined by a residual, and the list must
    have one load per step.
    """
    remedy = "give a list of functions of the share (0, 1], or nothing"
    arguments.check_type("loads", loads, (list, tuple), remedy)
    if not is_residual_problem and len(loads):
        raise ValueError(
            "`loads` belong to a residual; a problem with a stiffness K needs none, as its loads "
            "follow from states and contact forces: leave `loads` out"
        )
    if len(loads) not in (0, n_steps):
        raise ValueError(f"{len(loads)} loads for {n_steps} steps: give the load of each, or none")
    for k, load in enumerate(loads):
        if not (load is None or arguments.is_user_function(load)):
            raise TypeError(
                f"the load of step {k} is {arguments.describe_value_or_type(load)}: give the "
                "function of the "
                "share (0, 1] of the increment that `step` had, or None"
            )


def _check_finite_vector_of_space(name: str, vector: PETSc.Vec, space: fem.FunctionSpace) -> None:
    """Raise an error unless a vector fits the space and is finite.

    Args:
        name: name of the vector, used in error messages.
        vector: vector (n,) to check.
        space: trial space.
    """
    arguments.check_petsc_vector(name, vector, "the space", space)
    if not is_finite(vector):
        raise ValueError(f"{name} is not finite")


def _check_index_below_count(index: Any, count: int, counted_things: str) -> int:  # noqa: ANN401
    """Return an index if it is an integer from 0 to count - 1; raise an error otherwise."""
    if arguments.check_integer("a number", index, 0) >= count:
        raise ValueError(f"number {index} of {count} {counted_things}: they count from 0")
    return int(index)
