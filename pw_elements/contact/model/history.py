"""Functions that belong to a state, such as plastic strains, and their update.

A material with memory is a residual that contains the history variables of the last solved state.
The module guarantees that all new values are evaluated before any function changes, so that the
order of the functions has no influence. It assumes that the expressions are evaluated when the
unknown function is the solution.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from ufl.algorithms import extract_arguments
from ufl.core.expr import Expr

from pw_elements._compat import interpolation_points
from pw_elements.checks import arguments, find_compiler_problem, raise_errors_on_all_processes

# History functions, or a mapping from history functions to expressions of their new values
HistoryVariables: TypeAlias = Sequence[fem.Function] | Mapping[fem.Function, Expr]


def check_and_list_history_functions(
    history: HistoryVariables, update: Callable[[], None] | None, comm: MPI.Comm
) -> list[fem.Function]:
    """Return the functions of a residual's history.

    Args:
        history: functions in the residual that belong to the state, or a mapping from these
            functions to expressions of their new values.
        update: user's function that sets the history functions; None if there is none.
        comm: communicator of the mesh.

    Raises:
        TypeError, ValueError: for functions, expressions or an update that define no history.
    """
    with raise_errors_on_all_processes(comm) as same:
        if not (update is None or arguments.is_user_function(update)):
            described = arguments.describe_value_or_type(update)
            raise TypeError(f"update is {described}: it has to be a function")
        functions = arguments.as_list(history)
        same["the history"] = [getattr(f, "function_space", None) for f in functions]
        for function in functions:
            arguments.check_type(
                "a function of the history", function, fem.Function, "it has to be a Function"
            )
            if not np.isfinite(function.x.array).all():
                raise ValueError("a function of the history has values that are not finite")
        if isinstance(history, Mapping):
            if update is not None:
                raise ValueError(
                    "the history names new values, and there is an update as well: give one of them"
                )
            for number, (function, new_value) in enumerate(history.items()):
                _check_new_value(f"function {number} of the history", function, new_value)
            same["the new values of the history"] = list(history.values())
    return functions


def _check_new_value(name: str, function: fem.Function, new_value: object) -> None:
    """Raise an error if an expression cannot be the new value of a history function."""
    arguments.check_type(f"the new value of {name}", new_value, Expr, "give a UFL expression")
    assert isinstance(new_value, Expr)
    if extract_arguments(new_value):
        raise ValueError(
            f"the new value of {name} has a test or trial function: use the unknown function"
        )
    if new_value.ufl_shape != function.ufl_shape:
        raise ValueError(
            f"the new value of {name} has the shape {new_value.ufl_shape}, and the function has "
            f"{function.ufl_shape}"
        )
    layout = function.function_space.dofmap.dof_layout
    dim = function.function_space.mesh.topology.dim
    if len(layout.entity_dofs(dim, 0)) != layout.num_dofs:
        raise ValueError(
            f"{name} has values that cells share, where expressions of strains jump: create its "
            "space by history_space(spaces)"
        )


def make_update_from_expressions(
    new_values: Mapping[fem.Function, Expr],
) -> Callable[[], None]:
    """Return a function that sets history functions to the values of expressions.

    All expressions are evaluated before any function changes.

    Args:
        new_values: expression of the new values of each function.

    Raises:
        ValueError: if an expression cannot be compiled.
        RuntimeError: if there is no C compiler and the expression is not in DOLFINx's cache.
    """
    try:
        pairs = [
            (function, fem.Expression(value, interpolation_points(function.function_space)))
            for function, value in new_values.items()
        ]
    except Exception as error:
        # only now: expressions in the cache need no compiler
        if problem := find_compiler_problem():
            raise RuntimeError(problem) from None
        raise ValueError(f"a new value of the history cannot be compiled: {error}") from error
    evaluated = [fem.Function(function.function_space) for function, _ in pairs]

    def update() -> None:
        for target, (_, expression) in zip(evaluated, pairs, strict=True):
            target.interpolate(expression)
        for target, (function, _) in zip(evaluated, pairs, strict=True):
            function.x.array[:] = target.x.array

    return update
