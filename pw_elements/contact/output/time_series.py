"""Files with contact states as a time series of functions on the body, for ParaView.

    write("punch.bp", states, body)

The module guarantees that a file is either complete or not written at all, and that an error on one
process ends the call on all processes.
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

from pw_elements.arrays import RealVector
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.contact.model import ContactState
from pw_elements.contact.output.fields import (
    STATE_ARGUMENT_ADVICE,
    ContactFields,
    displacement_space,
)
from pw_elements.contact.output.storage import check_and_convert_path
from pw_elements.elasticity import Body
from pw_elements.files import FolderReplacement
from pw_elements.spaces import quadratic_element

_FOLDER_CONTENT_DESCRIPTION = "a time series of contact fields"
# Components of vectors in a file, in any dimension
_VECTOR_COMPONENTS_IN_VTX = 3
# Estimated bytes that a file needs for its description
_ESTIMATED_METADATA_SIZE_IN_BYTES = 100_000
# Seconds for which processes wait for each other after an error on one of them, and seconds between
# two tests of whether all have arrived
_MAX_WAIT_AFTER_ERROR_IN_SECONDS, _BARRIER_TEST_INTERVAL_IN_SECONDS = 60.0, 0.01
# Error numbers by which file systems report that they cannot reserve space
_ERRNOS_OF_UNSUPPORTED_ALLOCATION = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)


@check_same_arguments_on_all_processes
def write(
    path: str | Path,
    states: ContactState | Sequence[ContactState],
    body: Body | fem.FunctionSpace,
    times: RealVector | None = None,
) -> None:
    """Write all fields of states as a time series for ParaView, completely or not at all.

        states = solve_contact(K, loads, supports, [floor, punch], U)
        write("punch.bp", states, body)

    The file, in fact a folder, has ADIOS2's VTX format, which keeps quadratic functions and curved
    cells. Open it with ParaView's "ADIOS2 VTX Reader". If a file with this name exists, and was
    written by this function alone, it is replaced once the new file is complete. If a process is
    killed, the old file remains, together with a hidden folder beside it. The next call of this
    function with the same path removes this folder.

    Args:
        path: path of the file, which ends in ".bp".
        states: one state, or several states of one problem.
        body: body of the contact problem; or its trial space, if no pressures are to be written.
        times: increasing times of the states; by default the numbers of their increments.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the path does not end in ".bp", there are no states, times do not increase or
            are not one per state, a state belongs to another space, or the element has no quadratic
            Lagrange functions.
        RuntimeError: if DOLFINx was built without ADIOS2.
        OSError: if the path exists and was not written by this function, or if the disk is full.
    """
    path, space = check_and_convert_path(path), displacement_space(body)
    states = arguments.as_list(states)
    comm = space.mesh.comm
    with raise_errors_on_all_processes(comm):
        for state in states:
            arguments.check_type("a state", state, ContactState, STATE_ARGUMENT_ADVICE)
        increments = [float(state.increment) for state in states]
        times_of_states = (
            increments if times is None else list(arguments.check_vector("times", times))
        )
        _check_series_is_writable(path, states, times_of_states, space)
    replacement = FolderReplacement(path, _FOLDER_CONTENT_DESCRIPTION, durable=True)
    with raise_errors_on_all_processes(comm):
        if comm.rank == 0:
            replacement.start()
    try:
        fields = ContactFields.from_state(states[0], body)
        size = _estimate_file_size_in_bytes(fields, len(states))
        with raise_errors_on_all_processes(comm):
            if comm.rank == 0:
                _check_disk_space(replacement.scratch, size, path)
        folder = comm.bcast(replacement.folder if comm.rank == 0 else None)
        with (
            _raise_or_abort_on_all_processes(comm),
            io.VTXWriter(comm, folder, fields.functions()) as file,
        ):
            for time, state in zip(times_of_states, states, strict=True):
                fields.fill(state)
                file.write(float(time))
        with raise_errors_on_all_processes(comm):
            if comm.rank == 0:
                replacement.commit()
    finally:
        replacement.abandon()


def _estimate_file_size_in_bytes(fields: ContactFields, n_steps: int) -> int:
    """Return the approximate size in bytes of a time series; collective.

    Each step contains the numbers and positions of all nodes, the values at all nodes, and the
    nodes of all cells.

    Args:
        fields: functions to write.
        n_steps: number of time steps.
    """
    space = fields.displacement.function_space
    n_nodes, cells = len(space.tabulate_dof_coordinates()), space.dofmap.list
    block_sizes = [function.function_space.dofmap.bs for function in fields.functions()]
    n_values = sum(_VECTOR_COMPONENTS_IN_VTX if size > 1 else 1 for size in block_sizes)
    n_entries = n_nodes * (1 + _VECTOR_COMPONENTS_IN_VTX + n_values) + cells.size + len(cells)
    return _ESTIMATED_METADATA_SIZE_IN_BYTES + 8 * n_steps * int(
        space.mesh.comm.allreduce(n_entries)
    )


def _check_disk_space(folder: Path, size_in_bytes: int, path: Path) -> None:
    """Raise OSError unless the disk has room for a file of the given size.

    Without this check, ADIOS2 on all other processes would wait for the one that fails to write.

    Args:
        folder: folder in which a temporary file of this size is created.
        size_in_bytes: size in bytes.
        path: path of the file to be written, for the error message.
    """
    try:
        with TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, size_in_bytes)
    except OSError as error:
        if error.errno in _ERRNOS_OF_UNSUPPORTED_ALLOCATION:
            return
        message = f"{os.strerror(error.errno or 0)}: it takes about {size_in_bytes / 1e6:.3g} MB"
        raise OSError(error.errno, message, str(path)) from None


@contextmanager
def _raise_or_abort_on_all_processes(comm: MPI.Comm) -> Iterator[None]:
    """Raise an error that ADIOS2 raises within a `with` block on all processes.

    If only some processes have an error and the others wait for them within ADIOS2, all processes
    are aborted after a waiting time.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as exception:
        error = exception
    request, waiting_time = comm.Ibarrier(), 0.0
    while not request.Test():
        sleep(_BARRIER_TEST_INTERVAL_IN_SECONDS)
        waiting_time += _BARRIER_TEST_INTERVAL_IN_SECONDS
        if error is not None and waiting_time > _MAX_WAIT_AFTER_ERROR_IN_SECONDS:
            print(f"writing failed on process {comm.rank} alone: {error}", file=sys.stderr)
            comm.Abort(1)
    with raise_errors_on_all_processes(comm):
        if error is not None:
            raise error


def _check_series_is_writable(
    path: Path, states: Sequence[ContactState], times: RealVector, space: fem.FunctionSpace
) -> None:
    """Raise an error unless the states can be written to the path with these times and space."""
    if not hasattr(io, "VTXWriter"):
        raise RuntimeError(
            "this DOLFINx was built without ADIOS2, which is needed to write files for ParaView"
        )
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
