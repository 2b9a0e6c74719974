"""One guard for checks and users' functions: what fails on one process fails on all at once.

Were an error raised on one process only, the others would wait for it for ever in their next
communication. So local work (checks, markers, surfaces, friction, images) is done under the guard,

    with collective(mesh.comm):
        marked = answer(mesh.comm, "the marker", where, x)

and whatever communicates comes before it or after it, never within.
"""

import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass
from hashlib import blake2b
from traceback import format_exception_only
from typing import ParamSpec, TypeVar

from mpi4py import MPI

import numpy as np

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def collective(comm: MPI.Comm) -> Iterator[None]:
    """Has an exception of a block on one process raised on all of them, with the same words.

    The error of the lowest process that has one is raised; its traceback is there, too. Blocks are
    local (they do not communicate) and are not nested.
    """
    own: Exception | None = None
    try:
        yield
    except Exception as raised:
        own = raised
    failed = comm.allreduce(comm.size if own is None else comm.rank, MPI.MIN)
    if failed == comm.size:
        return
    told = comm.bcast(_sent(own), failed)
    if own is not None and comm.rank == failed:
        raise own
    raise told from own


def _sent(error: Exception | None) -> Exception | None:
    """The error as it can be sent: classes within functions, or of more than words, cannot."""
    if error is None:
        return None
    try:
        return pickle.loads(pickle.dumps(type(error)(str(error))))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")


def answer(
    comm: MPI.Comm, whose: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    """Calls a user's function, whose errors become a ValueError; local, for use under the guard."""
    try:
        return function(*args, **kwargs)
    except Exception as error:
        where = f" on process {comm.rank}" if comm.size > 1 else ""
        said = "".join(format_exception_only(error)).strip()
        raise ValueError(f"{whose} failed{where}: {said}") from error


def agree(comm: MPI.Comm, arguments: Mapping[str, object]) -> None:
    """Checks that all processes were given the same arguments, to the last bit; others by type."""
    if comm.size == 1:
        return
    told = comm.allgather([_digest(value) for value in arguments.values()])
    for name, each in zip(arguments, zip(*told, strict=True), strict=True):
        if len(set(each)) > 1:
            other = next(k for k, digest in enumerate(each) if digest != each[0])
            raise ValueError(
                f"{name}: this differs between processes 0 and {other}, but all of them have to "
                "state the same problem"
            )


def _digest(value: object) -> bytes:
    if type(value).__module__.startswith("pw_elements.") and is_dataclass(value):
        content = b"".join(map(_digest, [type(value).__qualname__, *vars(value).values()]))
    elif isinstance(value, str):
        content = value.encode()
    elif isinstance(value, np.ndarray | np.number | int | float) and _real(value):
        numbers = np.asarray(value, dtype=float) + 0.0  # zero has one sign
        content = repr(numbers.shape).encode() + numbers.tobytes()
    elif isinstance(value, np.ndarray):
        content = b"".join(map(_digest, value.tolist()))
    elif isinstance(value, Sequence):
        content = b"".join(map(_digest, value))
    else:
        content = type(value).__qualname__.encode()
    return blake2b(content, digest_size=16).digest()


def _real(value: object) -> bool:
    return np.asarray(value).dtype.kind in "biuf"
