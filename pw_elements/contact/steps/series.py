"""Series of solutions: increments of one problem, and a table for many values of a parameter.

The module guarantees that an invalid result stops the series on all processes, and that states and
rows that have been computed are kept even if the series stops.
"""

import csv
import io
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra import Reduction
from pw_elements.arrays import Array
from pw_elements.checks import (
    MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS,
    arguments,
    call_user_function,
    check_same_arguments_on_all_processes,
    check_same_values,
    raise_errors_on_all_processes,
)
from pw_elements.contact.model import ContactFailed, ContactPair, ContactState
from pw_elements.contact.output import ProgressCallback, check_and_convert_path
from pw_elements.contact.steps.checks import (
    RemedyNamesOrCostRatios,
    check_and_list_loads_and_motions,
)
from pw_elements.contact.steps.problem import ContactProblem
from pw_elements.contact.steps.stepping import REMEDIES_FOR_FAILED_ITERATION
from pw_elements.files import check_file_replaceable, replace_file_atomically
from pw_elements.progress import log_on_root, report_activity
from pw_elements.solvers import NotConverged, SingularSystem, SolverOrAuto, collect_garbage

_FAILURE_COLUMN = "failure"


@check_same_arguments_on_all_processes
def solve_contact(
    K: PETSc.Mat,
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    max_iterations: int = 50,
    solver: SolverOrAuto = None,
    callback: ProgressCallback | None = None,
    remedies: RemedyNamesOrCostRatios = REMEDIES_FOR_FAILED_ITERATION,
) -> list[ContactState]:
    """Solve contact at small displacements; return the state at the end of each increment.

    Args:
        K: stiffness (n, n) without supports. It may be unsymmetric.
        loads: total load vector (n,) at the end of each increment. A single vector needs no list.
        reduction: supports (or condensation). It must not eliminate contact nodes, but supports may
            prescribe their tangential displacements.
        pairs: contact pairs. A node may belong to several pairs whose normals differ there, or
            that have an interface law.
        space: trial space of the displacements, or of the hybrid element.
        max_iterations: largest number of linear systems solved in one attempt at an increment.
        solver: solver of the linear systems, as in `solve`.
        callback: function that is called with a `Progress` after each iteration and each increment.
            It may be given on some of the processes only. If it raises an exception, the
            computation ends.
        remedies: methods that are tried if the iteration fails, as in `ContactProblem`.

    Raises:
        TypeError, ValueError: for arguments that do not define a contact problem, loads that are
            not finite, a number of motions other than the number of increments, or
            `max_iterations` below 1.
        DegenerateMesh: for cells that are flat or inverted.
        FreeBody, NoEquilibrium, NotUnique, SolutionNotFound, SurfacePassed: as in
            `ContactProblem.step`. The message gives the number of the increment, counted from 0.
            The attribute `states` contains the states before this increment.
    """
    problem = ContactProblem(K, reduction, pairs, space, solver, max_iterations, callback, remedies)
    load_list, motions_by_increment = check_and_list_loads_and_motions(
        loads, K, problem.pairs, space.mesh.geometry.dim
    )
    states = [problem.undeformed]
    for k, (load, increment_motions) in enumerate(
        zip(load_list, motions_by_increment, strict=True)
    ):
        try:
            with report_activity(space.mesh.comm, f"{k} of {len(load_list)} increments done"):
                states.append(problem.step(states[-1], load, increment_motions))
        except ContactFailed as error:
            error.args = (f"increment {k}: {error}",)
            error.states = states[1:]
            raise
    solved_states = states[1:]
    problem.release()  # frees memory for the next problem
    del problem, states
    collect_garbage(K)
    return solved_states


@check_same_arguments_on_all_processes
def solve_for_values(
    name: str,
    values: npt.ArrayLike,
    solve: Callable[[float], Mapping[str, float]],
    path: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> npt.NDArray[np.void]:
    """Solve a problem for each value of a parameter and return a table of the results; collective.

        def solve_for_friction(mu):
            changed = problem.with_changes(friction=mu)
            pressed = changed.step(changed.undeformed, load, press)
            pushed = changed.step(pressed, load, push)
            return {"force [N]": pushed.pairs[0].force[0]}

        table = solve_for_values("friction", np.linspace(0, 0.6, 50), solve_for_friction, "mu.csv")
        table["friction"], table["force [N]"]  # (50,) each

    A value without a solution (`ContactFailed`, `SingularSystem`, `NotConverged`) gets NaN in all
    results. A warning names the value and the reason, and the series goes on. Any other error ends
    the series; its message names the value.

    Args:
        name: name of the parameter, used for its column and in messages.
        values: (k,), values of the parameter.
        solve: function that solves the problem for one value and returns the results by name, the
            same names for each value. It is called on all processes, and the results must be equal
            on all of them. Start each value from the undeformed state, as friction depends on the
            load path.
        path: path of a file with comma-separated values to which the table is written when the
            series ends, also after an error. The last column gives the reason for which a value
            has no solution. An existing file is replaced only if it is a table of this parameter.
        comm: communicator of the problem.

    Returns:
        Table (k,): a structured array, with one row for each value. Its first field is the
        parameter, and the others are the results.

    Raises:
        TypeError, ValueError: for invalid arguments, or an error in `solve` or its results.
        ContactFailed, SingularSystem, NotConverged: the first of these errors if no value has a
            solution.
        OSError: if the table cannot be written. A file of another kind is found before anything
            is solved.
    """
    arguments.check_communicator(comm)
    with raise_errors_on_all_processes(comm):
        arguments.check_type("the name of the parameter", name, str, "it has to be a text")
        value_list = [float(v) for v in arguments.check_vector(f"the values of {name}", values)]
        if not arguments.is_user_function(solve):
            raise TypeError(
                f"solve is {arguments.describe_value_or_type(solve)}: it has to be a function that "
                "takes a value and returns results by name"
            )
        file_path = None if path is None else check_and_convert_path(path)
        if file_path is not None and comm.rank == 0:
            check_file_replaceable(file_path, partial(_is_table_of_parameter, name))
    rows: list[Array | None] = []
    result_names: list[str] = []
    failures: list[ContactFailed | SingularSystem | NotConverged | None] = []
    try:
        for value in value_list:
            label, start_time = f"{name} = {value:g}", perf_counter()
            done = f"{len(rows)} of {len(value_list)} values of {name} done"
            with report_activity(comm, done):
                row, failure = _solve_for_value(label, value, solve, name, result_names, comm)
            rows.append(row)
            failures.append(failure)
            outcome = f"{perf_counter() - start_time:.2f} s"
            level = logging.INFO
            if failure is not None:
                outcome, level = (
                    f"no solution, {type(failure).__name__}: {failure}",
                    logging.WARNING,
                )
            message = f"{label} ({len(rows)} of {len(value_list)}): {outcome}"
            log_on_root(comm, level, message, ".contact")
    except BaseException:
        # this may be an error of one process only, so that processes must not communicate
        if file_path is not None and result_names and comm.rank == 0:
            _write_table(file_path, name, value_list, result_names, rows, failures)
        raise
    if first_failure := next((f for f in failures if not result_names), None):
        raise first_failure
    with raise_errors_on_all_processes(comm):
        if file_path is not None and comm.rank == 0:
            _write_table(file_path, name, value_list, result_names, rows, failures)
    table = np.full(len(rows), np.nan, dtype=[(field, float) for field in (name, *result_names)])
    for k, (value, row) in enumerate(zip(value_list, rows, strict=True)):
        table[k] = (value, *(np.full(len(result_names), np.nan) if row is None else row))
    return table


def _solve_for_value(
    label: str,
    value: float,
    solve: Callable[[float], Mapping[str, float]],
    parameter_name: str,
    result_names: list[str],
    comm: MPI.Comm,
) -> tuple[Array | None, ContactFailed | SingularSystem | NotConverged | None]:
    """Return the results (r,) of one value, or None and the reason why there is no solution.

    Args:
        label: name and value of the parameter, used in error messages.
        value: value of the parameter.
        solve: user's function, as in `solve_for_values`.
        parameter_name: name of the parameter.
        result_names: names of the results of earlier values. If it is empty, the names are added.
        comm: communicator of the problem.
    """
    results: dict[str, float] = {}
    failure: ContactFailed | SingularSystem | NotConverged | None = None

    def solve_and_keep_failure() -> object:
        nonlocal failure
        try:
            return solve(value)
        except (ContactFailed, SingularSystem, NotConverged) as error:
            failure = error
            return None

    with raise_errors_on_all_processes(comm) as same:
        returned = call_user_function(comm, f"solve, at {label},", solve_and_keep_failure)
        if failure is None:
            results = _check_results(label, returned, parameter_name, result_names)
        same[f"whether there is a solution at {label}"] = failure is None
        same[f"the names of the results at {label}"] = list(results)
    if failure is not None:
        return None, failure
    result_names[:] = list(results)
    row: Array = np.array(list(results.values()), dtype=float)
    check_same_values(comm, {f"the result at {label}": row}, MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS)
    return comm.bcast(row), None


def _check_results(
    label: str, results: object, parameter_name: str, expected_names: list[str]
) -> dict[str, float]:
    """Return the results of one value; raise an error unless they are numbers by name.

    Args:
        label: name and value of the parameter, used in error messages.
        results: return value of the user's function.
        parameter_name: name of the parameter.
        expected_names: names of the results of earlier values; empty for the first value.
    """
    if not isinstance(results, Mapping) or not results:
        raise TypeError(
            f"solve, at {label}, returned {arguments.describe_value_or_type(results)}: it has to "
            'return numbers by name, such as {"force [N]": 2.0}'
        )
    for result_name, number in results.items():
        if not isinstance(result_name, str) or result_name in ("", parameter_name, _FAILURE_COLUMN):
            raise ValueError(
                f"solve, at {label}, named a result {result_name!r}: the name has to be a text "
                f"other than {parameter_name!r} and {_FAILURE_COLUMN!r}"
            )
        if not arguments.is_real_number(number):
            raise TypeError(
                f"solve, at {label}, returned {result_name!r} as "
                f"{arguments.describe_value_or_type(number)}: it has to be a real number"
            )
    if expected_names and list(results) != expected_names:
        raise ValueError(
            f"solve, at {label}, returned the results {list(results)}, but {expected_names} before"
        )
    return {result_name: float(number) for result_name, number in results.items()}


def _write_table(
    path: Path,
    name: str,
    values: list[float],
    result_names: list[str],
    rows: list[Array | None],
    failures: list[ContactFailed | SingularSystem | NotConverged | None],
) -> None:
    """Write the rows that have been computed as comma-separated values, completely or not at all.

    Args:
        path: path of the file.
        name: name of the parameter.
        values: values of the parameter, at least as many as rows.
        result_names: names of the results.
        rows: results of each value, None if there is no solution.
        failures: reason for which a value has no solution, None if it has one.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([name, *result_names, _FAILURE_COLUMN])
    for value, row, failure in zip(values, rows, failures, strict=False):
        numbers = [np.nan] * len(result_names) if row is None else [float(x) for x in row]
        writer.writerow(
            [value, *numbers, "" if failure is None else " ".join(str(failure).split())]
        )
    replace_file_atomically(path, text.getvalue().encode(), partial(_is_table_of_parameter, name))


def _is_table_of_parameter(name: str, path: Path) -> bool:
    """Return whether a file is empty or begins with the columns of a table of a parameter."""
    with path.open(encoding="utf-8", errors="replace", newline="") as stream:
        columns = next(csv.reader([stream.readline()]), [])
    return columns == [] or (columns[0] == name and columns[-1] == _FAILURE_COLUMN)
