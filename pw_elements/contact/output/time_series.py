"""States as a time series of functions on the body, which ParaView opens.

    write("punch.bp", states, body)

The module guarantees that a file is complete or not there at all, and that errors of one process
end all of them.
"""

import errno
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from time import sleep

from mpi4py import MPI

import numpy as np
from dolfinx import fem, io

from pw_elements.checks import arguments, check_same_arguments, collective_errors
from pw_elements.contact.model import ContactState
from pw_elements.contact.output.fields import STATE_REMEDY, ContactFields, trial_space
from pw_elements.contact.output.storage import checked_path
from pw_elements.elasticity import Body
from pw_elements.files import FolderReplacement
from pw_elements.spaces import quadratic_element

_SERIES = "a time series of contact fields"
_VTX_COMPONENTS = 3  # of vectors in a file, whatever the dimension
_OVERHEAD = 100_000  # bytes of a file's description
# Seconds that processes wait for each other after an error of one, and between two looks
_PATIENCE, _PAUSE = 60.0, 0.01
_NO_ALLOCATION = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)


@check_same_arguments
def write(
    path: str | Path,
    states: ContactState | Sequence[ContactState],
    body: Body | fem.FunctionSpace,
    times: Sequence[float] | None = None,
) -> None:
    """Writes all fields of states as a time series for ParaView, completely or not at all.

        states = solve_contact(K, loads, supports, [floor, punch], U)
        write("punch.bp", states, body)

    The file (in fact a folder) is in ADIOS2's VTX format, which keeps quadratic functions and
    curved cells: open it with ParaView's "ADIOS2 VTX Reader". One of this name is replaced when the
    new one is whole, if this function has written all that is in it. A process that is killed
    leaves the old one, and a hidden folder beside it, which the next call there removes.

    Args:
        path: ends in ".bp".
        states: of one problem, or one of them.
        body: see `ContactFields`; without pressures where it is the space.
        times: of the states, increasing; by default their increments' numbers.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a path without this ending, no states, times that do not increase or are not
            one per state, states of another space, and elements without quadratic Lagrange
            functions.
        RuntimeError: if DOLFINx has been built without ADIOS2.
        OSError: if something else is there, which is not replaced, or there is no room.
    """
    path, space = checked_path(path), trial_space(body)
    states = arguments.as_list(states)
    comm = space.mesh.comm
    with collective_errors(comm):
        for state in states:
            arguments.check_type("a state", state, ContactState, STATE_REMEDY)
        increments = [float(s.increment) for s in states]
        given = increments if times is None else list(arguments.check_vector("times", times))
        _check_series(path, states, given, space)
    replacement = FolderReplacement(path, _SERIES, durable=True)
    with collective_errors(comm):
        if comm.rank == 0:
            replacement.start()
    try:
        fields = ContactFields.of(states[0], body)
        needed = _estimated_size(fields, len(states))
        with collective_errors(comm):
            if comm.rank == 0:
                _check_room(replacement.scratch, needed, path)
        folder = comm.bcast(replacement.folder if comm.rank == 0 else None)
        with _ending_together(comm), io.VTXWriter(comm, folder, fields.functions()) as file:
            for time, state in zip(given, states, strict=True):
                fields.fill(state)
                file.write(float(time))
        with collective_errors(comm):
            if comm.rank == 0:
                replacement.commit()
    finally:
        replacement.abandon()


def _estimated_size(fields: ContactFields, n_steps: int) -> int:
    """Return about how many bytes a series takes, on all processes.

    Each step has numbers, places and values of all nodes, and the nodes of all cells.
    """
    space = fields.displacement.function_space
    n_nodes, cells = len(space.tabulate_dof_coordinates()), space.dofmap.list
    block_sizes = [function.function_space.dofmap.bs for function in fields.functions()]
    n_values = sum(_VTX_COMPONENTS if size > 1 else 1 for size in block_sizes)
    own = n_nodes * (1 + _VTX_COMPONENTS + n_values) + cells.size + len(cells)
    return _OVERHEAD + 8 * n_steps * int(space.mesh.comm.allreduce(own))


def _check_room(folder: Path, needed: int, path: Path) -> None:
    """Refuse to begin where there is no room: ADIOS2's processes would wait for the one that fails.

    Args:
        folder: Where a file of that size is made and removed.
        needed: Bytes.
        path: To name in the error.
    """
    try:
        with TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, needed)
    except OSError as error:
        if error.errno in _NO_ALLOCATION:
            return
        words = f"{os.strerror(error.errno or 0)}: it takes about {needed / 1e6:.3g} MB"
        raise OSError(error.errno, words, str(path)) from None


@contextmanager
def _ending_together(comm: MPI.Comm) -> Iterator[None]:
    """Has an error of ADIOS2 on some processes raised on all; ends all if others wait within it."""
    error: Exception | None = None
    try:
        yield
    except Exception as raised:
        error = raised
    request, waited = comm.Ibarrier(), 0.0
    while not request.Test():
        sleep(_PAUSE)
        waited += _PAUSE
        if error is not None and waited > _PATIENCE:
            print(f"writing failed on process {comm.rank} alone: {error}", file=sys.stderr)
            comm.Abort(1)
    with collective_errors(comm):
        if error is not None:
            raise error


def _check_series(
    path: Path, states: Sequence[ContactState], times: Sequence[float], space: fem.FunctionSpace
) -> None:
    if not hasattr(io, "VTXWriter"):
        raise RuntimeError("this DOLFINx was built without ADIOS2, which files for ParaView need")
    if path.suffix != ".bp":
        raise ValueError(f"{path}: the name of a VTX file ends in .bp")
    if not states:
        raise ValueError(f"{path}: there is no state to write")
    if len(times) != len(states) or not np.all(np.diff(times) > 0):
        raise ValueError(f"{path}: {len(states)} states need as many times, each after the last")
    cell, dim = space.mesh.topology.cell_name(), space.mesh.geometry.dim
    if space.ufl_element() != quadratic_element(cell, (dim,)):
        raise ValueError(
            f"{path}: the element {space.ufl_element()} is not Lagrange's of degree 2, which is "
            "what VTX files hold: write an interpolation of each field by io.VTXWriter"
        )
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: its folder does not exist")
