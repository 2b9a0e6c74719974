"""One guard for checks, users' functions and arguments: what is wrong on one process ends all.

Were an error raised on one process only, or were processes given different problems, they would
wait for each other for ever in their next communication. So public functions that communicate are
decorated by `check_same_arguments`, and local work of users' functions is done under the guard,

    with collective_errors(mesh.comm):
        marked = call_user_function(mesh.comm, "the marker", where, x)

with whatever communicates before it or after it, never within. Neither knows of errors elsewhere:
within PETSc, or between two guards, `python -m mpi4py` ends all processes.
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

P = ParamSpec("P")
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])

# Arguments and attributes that differ by nature: parts of a mesh by numbers or masks, values at
# nodes, and what only some processes have
_LOCAL = {"where", "nodes", "free", "history", "substates", "callback", "axes", "source"}
# Of each open block, the errors that blocks within it have raised on how many processes
_open: list[list[tuple[BaseException, int]]] = []
# Attribute of a statement that its check has refused, on one of several processes
_REFUSAL = "_refusal"
# Relative difference of values of two processes that is no round-off of other machines
RANK_DIFFERENCE_TOLERANCE = 1e-8
# Points of each process at which functions are compared on all of them, and the most of all
_COMPARED_POINTS, _ALL_COMPARED_POINTS = 64, 2**15
# Whether what is called now has been compared by a function around it; a user's function has not
_compared = [False]
# Attributes by which things know their processes, directly or by what they belong to
_OWNERS = "comm mesh function_space space _space u spaces displacement offset"


@contextmanager
def collective_errors(comm: MPI.Comm) -> Iterator[dict[str, object]]:
    """Has an exception of a block on one process raised on all of them, with the same words.

    What the block puts into its mapping has to be the same on all processes, to the last bit.

    The error of the lowest process that has one is raised; its traceback is there, too. Blocks are
    local: they do not communicate, but in blocks of their own.
    """
    same: dict[str, object] = {}
    own: BaseException | None = None
    digest = 0
    known: list[tuple[BaseException, int]] = []
    _open.append(known)
    try:
        yield same
        if MPI.COMM_WORLD.size > 1:  # a single process' own statements may have been refused, too
            digest = int.from_bytes(_digest(same)[:7])
    except BaseException as raised:
        own = raised
    finally:
        _open.pop()
    if own is not None and any(own is error and n == comm.size for error, n in known):
        raise own
    ends = np.array([comm.size if own is None else comm.rank, digest, -digest])
    comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
    failed, least, most = map(int, ends)
    if failed < comm.size:
        told = comm.bcast(_sent(own), failed)
        if own is not None and comm.rank == failed:
            told, own = own, own.__cause__
        raise _known(told, comm) from own
    if least != -most:
        _refuse_differing(comm, same)


def _known(error: BaseException, comm: MPI.Comm) -> BaseException:
    if _open:
        _open[-1].append((error, comm.size))
    return error


def _refuse_differing(comm: MPI.Comm, same: Mapping[str, object]) -> None:
    told = comm.allgather([(name, _digest(value)) for name, value in same.items()])
    for each in zip_longest(*told, fillvalue=("what is done", b"")):
        if len(set(each)) > 1:
            other = next(k for k, one in enumerate(each) if one != each[0])
            raise _differing(each[0][0], other, comm)


def _differing(name: str, other: int, comm: MPI.Comm) -> BaseException:
    error = ValueError(
        f"{name}: this differs between processes 0 and {other}, but all of them have to state the "
        "same problem"
    )
    return _known(error, comm)


def relative_difference(values: Array, reference: Array, min_scale: float = 0.0) -> float:
    """Return the largest difference over the largest finite size of the reference.

    It is infinite where shapes differ, or what is infinite or no number.

    Args:
        values: of any shape.
        reference: of the same shape.
        min_scale: a size below which the reference is nothing but round-off.
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
    """Raise ValueError on all processes where a user's function differs between them; collective.

    It is asked at some points of each process on all of them. There is no comparison if it fails
    there, or gives another number of values than points: it may be one of its own process' points.

    Args:
        comm: of the processes.
        name: of the function.
        function: of points as rows (n, dim); the first axis of its answer is theirs.
        points: kinds of points (n, dim) of this process, of each of which some are taken.
    """
    if comm.size == 1:
        return
    count = max(2, min(_COMPARED_POINTS, _ALL_COMPARED_POINTS // comm.size))
    own = np.concatenate([evenly_spaced_rows(rows, count) for rows in points])
    every: Array = np.concatenate(comm.allgather(own))
    values: Array = np.empty(0)
    with collective_errors(comm), np.errstate(all="ignore"), suppress(Exception):
        values = np.asarray(call_user_function(comm, name, function, every.copy()), dtype=float)
    if comm.allreduce(values.shape[:1] == (len(every),), MPI.LAND):
        check_same_values(comm, {name: values}, RANK_DIFFERENCE_TOLERANCE)


def evenly_spaced_rows(rows: Array, max_rows: int) -> Array:
    """Return at most so many rows, evenly spread."""
    return rows[np.unique(np.linspace(0, max(0, len(rows) - 1), max_rows).astype(int))[: len(rows)]]


def check_same_values(comm: MPI.Comm, arrays: Mapping[str, Array], tolerance: float) -> None:
    """Raise ValueError on all processes for numbers that differ between them; collective.

    Args:
        comm: of the processes.
        arrays: by the names of what gave them, the same names on all processes.
        tolerance: of differences, over the largest size of each array.
    """
    if comm.size == 1:
        return
    reference = comm.bcast(dict(arrays))
    unlike = [
        name
        for name, values in arrays.items()
        if not relative_difference(values, reference[name]) <= tolerance
    ]
    for rank, names in enumerate(comm.allgather(unlike)):
        if names:
            raise _differing(names[0], rank, comm)


def check_same_arguments(function: F) -> F:
    """A function that all processes call with the same arguments: they are compared first.

    What it calls in its turn has arguments that follow from these, which are not compared again.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        if MPI.COMM_WORLD.size == 1 or _compared[-1]:
            return function(*args, **kwargs)
        with collective_errors(find_communicator(*args, *kwargs.values())) as same:
            given = signature.bind(*args, **kwargs)
            given.apply_defaults()
            same["the function that is called"] = function.__qualname__
            for name, value in given.arguments.items():
                _raise_refusal(value)
                parts = vars(value) if name == "self" and is_dataclass(value) else {name: value}
                same |= {k: part for k, part in parts.items() if k not in _LOCAL}
        with _comparing(done=True):
            return function(*args, **kwargs)

    called.compares = True  # type: ignore[attr-defined]
    return cast(F, called)


def defer_errors_if_parallel(check: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return the check of a statement whose error all processes raise, if there are several.

    Each process states materials, motions and pairs by itself: an error there would stay on its
    process, for which the others would wait. It is kept, and raised on all of them by the first
    function that takes the statement.

    Args:
        check: `__post_init__` of a dataclass.
    """

    @wraps(check)
    def checked(self: Any) -> None:  # noqa: ANN401
        try:
            check(self)
        except (TypeError, ValueError) as error:
            if MPI.COMM_WORLD.size == 1:
                raise
            object.__setattr__(self, _REFUSAL, error)

    return checked


def _raise_refusal(value: object) -> None:
    """Raise the error that `defer_errors_if_parallel` has kept of a statement, if there is one."""
    refusal = getattr(value, "__dict__", {}).get(_REFUSAL)
    if refusal is not None:
        raise refusal


@contextmanager
def _comparing(done: bool) -> Iterator[None]:
    _compared.append(done)
    try:
        yield
    finally:
        _compared.pop()


def find_communicator(*objects: object) -> MPI.Comm:
    """The communicator of some things: the largest one; all processes if none has one.

    So a process that has nothing in place of a mesh is waited for if the mesh is all processes'.
    """
    found = [comm for comm in map(_communicator, objects) if comm is not None]
    largest = max(found, key=lambda comm: comm.size, default=MPI.COMM_WORLD)
    # duplicates of one communicator would not meet each other
    return MPI.COMM_WORLD if largest.size == MPI.COMM_WORLD.size else largest


def _communicator(thing: Any) -> MPI.Comm | None:  # noqa: ANN401
    if isinstance(thing, MPI.Intracomm):
        return thing
    if isinstance(thing, PETSc.Object):
        return thing.comm.tompi4py() if thing.handle else None
    if isinstance(thing, ufl.Form):
        return next(map(_communicator, (d.ufl_cargo() for d in thing.ufl_domains())), None)
    if isinstance(thing, list | tuple):
        return next(map(_communicator, thing), None)
    if isinstance(thing, type):
        return None
    for name in _OWNERS.split():
        with suppress(Exception):  # of a user's property, which is asked again under the guard
            if (owner := getattr(thing, name, None)) is not None:
                return _communicator(owner)
    return None


def _sent(error: BaseException | None) -> BaseException | None:
    """The error as it can be sent: classes within functions, or of more than words, cannot."""
    if error is None:
        return None
    for args in (error.args, (str(error),)):
        try:
            sent = pickle.loads(pickle.dumps(type(error)(*args)))
        except Exception:
            continue
        if str(sent) == str(error):
            return sent
    return RuntimeError(f"{type(error).__name__}: {error}")


def call_user_function(
    comm: MPI.Comm, name: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    """Calls a user's function, whose errors become a ValueError; local, for use under the guard."""
    try:
        with _comparing(done=False):
            return function(*args, **kwargs)
    except Exception as error:
        where = f" on process {comm.rank}" if comm.size > 1 else ""
        said = "".join(format_exception_only(error)).strip()
        raise ValueError(f"{name} failed{where}: {said}") from error


def _digest(value: object) -> bytes:
    """Digest of what has to be the same: of distributed things kind and size, no local part."""
    digest = blake2b(digest_size=16)
    for part in _parts(value):
        digest.update(part if isinstance(part, bytes) else _digest(part))
    return digest.digest()


def _parts(value: Any) -> Iterator[object]:  # noqa: ANN401
    """Bytes, or simpler things, that tell a value."""
    if isinstance(value, str | Path):
        yield str(value).encode()
    elif isinstance(value, bytes):
        yield value
    elif (
        isinstance(value, np.ndarray | np.generic | int | float)
        and np.asarray(value).dtype.kind in "biuf"
    ):
        numbers = np.asarray(value, dtype=float) + 0.0  # zero has one sign
        yield from (repr(numbers.shape).encode(), numbers.tobytes())
    elif isinstance(value, np.ndarray):
        yield value.tolist()
    elif isinstance(value, Mapping):
        yield from sorted(_digest(pair) for pair in value.items())
    elif isinstance(value, set | frozenset):
        yield from sorted(map(_digest, value))
    elif isinstance(value, Collection) and not isinstance(value, type | Expr):
        yield from map(_digest, value)
    else:
        yield type(value).__qualname__
        yield from _told(value)


def _told(value: Any) -> Iterator[object]:  # noqa: ANN401
    _raise_refusal(value)
    if isinstance(value, Enum):
        yield value.name
    elif isinstance(value, fem.Constant):
        yield value.value
    elif isinstance(value, fem.Function):
        yield value.function_space
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
        yield value.module.__name__  # which has the digest of what was compiled
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
    elif not callable(value):  # a statement of the library or the user: its plain attributes
        own = is_dataclass(value) and type(value).__module__.startswith("pw_elements.")
        for name, part in getattr(value, "__dict__", {}).items():
            plain = own or isinstance(part, str | int | float | np.generic)
            if plain and name not in _LOCAL and not name.startswith("_"):
                yield from (name, part)
