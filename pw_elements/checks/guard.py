"""Raise errors on all processes if one process meets an error or has different arguments.

If an error were raised on one process only, or if processes had different arguments, the processes
could wait for each other forever in their next communication. Therefore public functions that
communicate are decorated with `check_same_arguments_on_all_processes`, and users' functions are
called in a block

    with raise_errors_on_all_processes(mesh.comm):
        marked = call_user_function(mesh.comm, "the marker", where, x)

The block itself must not communicate. Errors that occur outside such blocks, or within PETSc, are
raised only on the process on which they occur; `python -m mpi4py` then ends all processes.
"""

import inspect
import pickle
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import is_dataclass
from enum import Enum
from functools import wraps
from hashlib import blake2b
from itertools import zip_longest
from pathlib import Path
from traceback import format_exception_only
from typing import Any, ParamSpec, TypeVar, cast

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from ufl.constantvalue import ConstantValue
from ufl.core.expr import Expr
from ufl.core.multiindex import FixedIndex, MultiIndex
from ufl.corealg.traversal import unique_pre_traversal

from pw_elements.arrays import Array
from pw_elements.checks.joined import JoinedSpace

UserFunctionParameters = ParamSpec("UserFunctionParameters")
UserFunctionResult = TypeVar("UserFunctionResult")
DecoratedFunction = TypeVar("DecoratedFunction", bound=Callable[..., Any])

# Names of arguments and attributes that may differ between processes: local numbers or masks of
# nodes and facets, values at nodes, and arguments that are given on some processes only
_NAMES_OF_PROCESS_LOCAL_ARGUMENTS = {
    "where",
    "nodes",
    "free",
    "history",
    "substates",
    "callback",
    "axes",
    "source",
}
# For each open block: errors raised by nested blocks, each with the number of processes on which it
# was raised
_nested_errors_by_open_block: list[list[tuple[BaseException, int]]] = []
# Attribute in which an object keeps the deferred error of its check
_DEFERRED_ERROR_ATTRIBUTE = "_refusal"
# Largest relative difference of values on two processes that may be due to round-off
MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS = 1e-8
# Largest number of points at which a function is compared: from each process, and in total
_MAX_FUNCTION_SAMPLE_POINTS_PER_PROCESS, _MAX_FUNCTION_SAMPLE_POINTS_IN_TOTAL = 64, 2**15
# Stack of flags, one for each open call: whether arguments have already been compared. The last
# flag is False while a user's function is running
_has_compared_arguments_by_open_call = [False]
# Names of attributes that are searched for a communicator
_ATTRIBUTE_NAMES_SEARCHED_FOR_COMMUNICATOR = (
    "comm mesh function_space space _space u spaces displacement offset"
)


@contextmanager
def raise_errors_on_all_processes(comm: MPI.Comm) -> Iterator[dict[str, object]]:
    """Raise an exception on all processes if the block raises one on any process.

    If several processes raise exceptions, the exception of the lowest rank is used. All processes
    get its message; the process that raised it also keeps its traceback. The block itself must not
    communicate, except in nested blocks of `raise_errors_on_all_processes`.

    Args:
        comm: communicator of the processes that execute the block.

    Yields:
        A mapping to which the block may add named values that have to be equal on all processes, to
        the last bit. If a value differs, a ValueError with its name is raised on all processes.
    """
    shared: dict[str, object] = {}
    own_error: BaseException | None = None
    digest = 0
    known_errors: list[tuple[BaseException, int]] = []
    _nested_errors_by_open_block.append(known_errors)
    try:
        yield shared
        if MPI.COMM_WORLD.size > 1:  # digests raise deferred errors
            digest = int.from_bytes(_compute_digest(shared)[:7])
    except BaseException as caught:
        own_error = caught
    finally:
        _nested_errors_by_open_block.pop()
    if own_error is not None and any(
        own_error is error and n_processes == comm.size for error, n_processes in known_errors
    ):
        raise own_error
    outcomes = np.array([comm.size if own_error is None else comm.rank, digest, -digest])
    comm.Allreduce(MPI.IN_PLACE, outcomes, MPI.MIN)
    failed_rank, min_digest, negated_max_digest = map(int, outcomes)
    if failed_rank < comm.size:
        sent_error = comm.bcast(_make_picklable(own_error), failed_rank)
        if own_error is not None and comm.rank == failed_rank:
            sent_error, own_error = own_error, own_error.__cause__
        raise _record_collective_error(sent_error, comm) from own_error
    if min_digest != -negated_max_digest:
        _raise_for_first_differing_value(comm, shared)


def _record_collective_error(error: BaseException, comm: MPI.Comm) -> BaseException:
    """Record for the enclosing block that all processes of `comm` raise an error; return it."""
    if _nested_errors_by_open_block:
        _nested_errors_by_open_block[-1].append((error, comm.size))
    return error


def _raise_for_first_differing_value(comm: MPI.Comm, values_by_name: Mapping[str, object]) -> None:
    digests_by_rank = comm.allgather(
        [(name, _compute_digest(value)) for name, value in values_by_name.items()]
    )
    for entries in zip_longest(*digests_by_rank, fillvalue=("what is done", b"")):
        if len(set(entries)) > 1:
            other_rank = next(rank for rank, entry in enumerate(entries) if entry != entries[0])
            raise _make_rank_difference_error(entries[0][0], other_rank, comm)


def _make_rank_difference_error(name: str, other_rank: int, comm: MPI.Comm) -> BaseException:
    error = ValueError(
        f"{name}: this differs between processes 0 and {other_rank}, but all of them have to state "
        "the same problem"
    )
    return _record_collective_error(error, comm)


def max_relative_difference(values: Array, reference: Array, min_scale: float = 0.0) -> float:
    """Return max |values - reference| divided by the largest finite |reference|.

    The result is infinite if the shapes differ, or if an entry is infinite or NaN in one of the
    arrays and differs in the other.

    Args:
        values: array of any shape.
        reference: array to compare with, of the same shape.
        min_scale: lower limit of the denominator, such as the round-off of the reference.
    """
    if values.shape != reference.shape:
        return np.inf
    finite = np.isfinite(reference)
    if not np.array_equal(values[~finite], reference[~finite], equal_nan=True):
        return np.inf
    difference = float(np.abs(values[finite] - reference[finite]).max(initial=0.0))
    scale = max(min_scale, float(np.abs(reference[finite]).max(initial=0.0)))
    if not difference <= np.finfo(float).max:
        return np.inf
    return 0.0 if difference == 0.0 else difference / scale if scale else np.inf


def check_same_function(
    comm: MPI.Comm, name: str, function: Callable[[Array], Any], *points: Array
) -> None:
    """Raise ValueError on all processes if a user's function differs between them; collective.

    All processes evaluate the function at the same points, which are samples of the points of all
    processes. A function that raises an error or returns another number of values is not compared,
    because on each process it may be valid only at the points of this process.

    Args:
        comm: communicator of the processes.
        name: name of the function, used in the error message.
        function: function of points (n, dim) that returns n values or rows.
        *points: arrays (n, dim) of points of this process, from which samples are taken.
    """
    if comm.size == 1:
        return
    n_points = max(
        2,
        min(
            _MAX_FUNCTION_SAMPLE_POINTS_PER_PROCESS,
            _MAX_FUNCTION_SAMPLE_POINTS_IN_TOTAL // comm.size,
        ),
    )
    own_points = np.concatenate([evenly_spaced_rows(rows, n_points) for rows in points])
    all_points: Array = np.concatenate(comm.allgather(own_points))
    values: Array = np.empty(0)
    with raise_errors_on_all_processes(comm), np.errstate(all="ignore"), suppress(Exception):
        values = np.asarray(
            call_user_function(comm, name, function, all_points.copy()), dtype=float
        )
    if comm.allreduce(values.shape[:1] == (len(all_points),), MPI.LAND):
        check_same_values(comm, {name: values}, MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS)


def evenly_spaced_rows(rows: Array, max_rows: int) -> Array:
    """Return at most `max_rows` rows of an array, with equal distances between their indices."""
    return rows[np.unique(np.linspace(0, max(0, len(rows) - 1), max_rows).astype(int))[: len(rows)]]


def check_same_values(
    comm: MPI.Comm, arrays: Mapping[str, Array], relative_tolerance: float
) -> None:
    """Raise ValueError on all processes if arrays differ between them; collective.

    Args:
        comm: communicator of the processes.
        arrays: arrays by name, with the same names on all processes; used in error messages.
        relative_tolerance: largest accepted difference, relative to the largest entry of the array.
    """
    if comm.size == 1:
        return
    reference = comm.bcast(dict(arrays))
    differing_names = [
        name
        for name, values in arrays.items()
        if not max_relative_difference(values, reference[name]) <= relative_tolerance
    ]
    for rank, names in enumerate(comm.allgather(differing_names)):
        if names:
            raise _make_rank_difference_error(names[0], rank, comm)


def check_same_arguments_on_all_processes(function: DecoratedFunction) -> DecoratedFunction:
    """Decorate a collective function to compare its arguments between processes at each call.

    If an argument differs, a ValueError that names it is raised on all processes. The arguments of
    decorated functions that are called within the function are not compared again.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def call_checked(*args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        if MPI.COMM_WORLD.size == 1 or _has_compared_arguments_by_open_call[-1]:
            return function(*args, **kwargs)
        with raise_errors_on_all_processes(
            find_largest_communicator(*args, *kwargs.values())
        ) as shared:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            shared["the function that is called"] = function.__qualname__
            for name, value in bound.arguments.items():
                _raise_deferred_error(value)
                parts = vars(value) if name == "self" and is_dataclass(value) else {name: value}
                shared |= {
                    k: part
                    for k, part in parts.items()
                    if k not in _NAMES_OF_PROCESS_LOCAL_ARGUMENTS
                }
        with _temporarily_set_arguments_compared(is_compared=True):
            return function(*args, **kwargs)

    call_checked.compares = True  # type: ignore[attr-defined]
    return cast(DecoratedFunction, call_checked)


def defer_errors_if_parallel(check: Callable[[Any], None]) -> Callable[[Any], None]:
    """Decorate the `__post_init__` of a dataclass to defer its errors in parallel runs.

    Materials, motions and contact pairs are created on each process separately. An error might be
    raised on one process only, and the other processes would wait for it. Instead, the object keeps
    the error, and the first collective function with this object as an argument raises the error on
    all processes.

    Args:
        check: `__post_init__` of a dataclass, which raises TypeError or ValueError.
    """

    @wraps(check)
    def check_or_defer(self: Any) -> None:  # noqa: ANN401
        try:
            check(self)
        except (TypeError, ValueError) as error:
            if MPI.COMM_WORLD.size == 1:
                raise
            object.__setattr__(self, _DEFERRED_ERROR_ATTRIBUTE, error)

    return check_or_defer


def _raise_deferred_error(value: object) -> None:
    """Raise the error that `defer_errors_if_parallel` has stored in an object, if any."""
    error = getattr(value, "__dict__", {}).get(_DEFERRED_ERROR_ATTRIBUTE)
    if error is not None:
        raise error


@contextmanager
def _temporarily_set_arguments_compared(is_compared: bool) -> Iterator[None]:
    _has_compared_arguments_by_open_call.append(is_compared)
    try:
        yield
    finally:
        _has_compared_arguments_by_open_call.pop()


def find_largest_communicator(*objects: object) -> MPI.Comm:
    """Return the largest communicator of the objects, or COMM_WORLD if no object has one.

    A process that passes None instead of a mesh gets COMM_WORLD and can therefore take part in the
    checks of the other processes.
    """
    communicators = [comm for comm in map(_communicator_of, objects) if comm is not None]
    largest = max(communicators, key=lambda comm: comm.size, default=MPI.COMM_WORLD)
    # collective calls on different duplicates of COMM_WORLD would not match
    return MPI.COMM_WORLD if largest.size == MPI.COMM_WORLD.size else largest


def _communicator_of(obj: Any) -> MPI.Comm | None:  # noqa: ANN401
    if isinstance(obj, MPI.Intracomm):
        return obj
    if isinstance(obj, PETSc.Object):
        return obj.comm.tompi4py() if obj.handle else None
    if isinstance(obj, ufl.Form):
        return next(map(_communicator_of, (d.ufl_cargo() for d in obj.ufl_domains())), None)
    if isinstance(obj, list | tuple):
        return next(map(_communicator_of, obj), None)
    if isinstance(obj, type):
        return None
    for name in _ATTRIBUTE_NAMES_SEARCHED_FOR_COMMUNICATOR.split():
        with suppress(Exception):  # errors of users' properties are raised later, on all processes
            if (owner := getattr(obj, name, None)) is not None:
                return _communicator_of(owner)
    return None


def _make_picklable(error: BaseException | None) -> BaseException | None:
    """Return a copy of the error that can be pickled, or else a RuntimeError with its message."""
    if error is None:
        return None
    for args in (error.args, (str(error),)):
        try:
            copy = pickle.loads(pickle.dumps(type(error)(*args)))
        except Exception:
            continue
        if str(copy) == str(error):
            return copy
    return RuntimeError(f"{type(error).__name__}: {error}")


def call_user_function(
    comm: MPI.Comm,
    name: str,
    function: Callable[UserFunctionParameters, UserFunctionResult],
    *args: UserFunctionParameters.args,
    **kwargs: UserFunctionParameters.kwargs,
) -> UserFunctionResult:
    """Call a user's function and return its result; turn any error in it into a ValueError.

    To be called in a block of `raise_errors_on_all_processes`.

    Args:
        comm: communicator of the processes. The error message contains the rank of this process.
        name: name of the function, used in the error message.
        function: the user's function.
        *args: positional arguments of the function.
        **kwargs: keyword arguments of the function.
    """
    try:
        with _temporarily_set_arguments_compared(is_compared=False):
            return function(*args, **kwargs)
    except Exception as error:
        process = f" on process {comm.rank}" if comm.size > 1 else ""
        description = "".join(format_exception_only(error)).strip()
        raise ValueError(f"{name} failed{process}: {description}") from error


def _compute_digest(value: object) -> bytes:
    """Return a digest of a value; equal values have equal digests on all processes.

    For distributed objects (vectors, matrices ...), only data that do not depend on the
    distribution, such as type and global size, enter the digest.
    """
    digest = blake2b(digest_size=16)
    for part in _split_into_digest_parts(value):
        digest.update(part if isinstance(part, bytes) else _compute_digest(part))
    return digest.digest()


def _split_into_digest_parts(value: Any) -> Iterator[object]:  # noqa: ANN401
    """Yield bytes or simpler objects that together identify a value."""
    if isinstance(value, str | Path):
        yield str(value).encode()
    elif isinstance(value, bytes):
        yield value
    elif (
        isinstance(value, np.ndarray | np.generic | int | float)
        and np.asarray(value).dtype.kind in "biuf"
    ):
        numbers = np.asarray(value, dtype=float) + 0.0  # -0.0 becomes 0.0
        yield from (repr(numbers.shape).encode(), numbers.tobytes())
    elif isinstance(value, np.ndarray):
        yield value.tolist()
    elif isinstance(value, Mapping):
        yield from sorted(_compute_digest(pair) for pair in value.items())
    elif isinstance(value, set | frozenset):
        yield from sorted(map(_compute_digest, value))
    elif isinstance(value, Collection) and not isinstance(value, type | Expr):
        yield from map(_compute_digest, value)
    else:
        yield type(value).__qualname__
        yield from _split_object_into_digest_parts(value)


def _split_object_into_digest_parts(value: Any) -> Iterator[object]:  # noqa: ANN401
    """Yield simpler objects that identify an object of DOLFINx, PETSc, UFL or this library."""
    _raise_deferred_error(value)
    if isinstance(value, Enum):
        yield value.name
    elif isinstance(value, fem.Constant):
        yield value.value
    elif isinstance(value, fem.Function):
        yield value.function_space
    elif isinstance(value, JoinedSpace):
        yield from (body.space for body in value.bodies)
    elif isinstance(value, fem.FunctionSpace):
        yield from (value.mesh, repr(value.ufl_element()), value.dofmap.index_map.size_global)
    elif isinstance(value, Mesh):
        cells = value.topology.index_map(value.topology.dim)
        yield from (value.topology.cell_name(), value.geometry.dim, cells.size_global)
        yield value.geometry.index_map().size_global
    elif isinstance(value, fem.DirichletBC):
        yield getattr(value.g, "value", "")
    elif isinstance(value, PETSc.Mat | PETSc.Vec):
        if value.handle and value.getType():
            yield from (np.atleast_2d(value.getSizes())[:, 1], value.getAttr("assembled"))
    elif isinstance(value, fem.Form):
        yield value.module.__name__  # the module's name contains a digest of the compiled form
    elif isinstance(value, ufl.Form):
        for part in value.integrals():
            yield from (part.integral_type(), repr(part.subdomain_id()), part.integrand())
            yield {k: repr(v) for k, v in part.metadata().items()}
    elif isinstance(value, Expr):
        for node in unique_pre_traversal(value):
            yield type(node).__name__
            if isinstance(node, MultiIndex):
                yield [int(k) for k in node if isinstance(k, FixedIndex)]
            elif isinstance(node, ConstantValue):
                yield repr(node)
            elif isinstance(node, ufl.Argument):
                yield node.number()
            elif isinstance(node, fem.Constant | fem.Function):
                yield node
    elif not callable(value):  # identify other objects by attributes of plain types
        is_library_class = is_dataclass(value) and type(value).__module__.startswith("pw_elements.")
        for name, part in getattr(value, "__dict__", {}).items():
            is_compared = is_library_class or isinstance(part, str | int | float | np.generic)
            if (
                is_compared
                and name not in _NAMES_OF_PROCESS_LOCAL_ARGUMENTS
                and not name.startswith("_")
            ):
                yield from (name, part)
