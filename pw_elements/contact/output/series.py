"""States as a time series that ParaView opens.

write("punch.bp", states, body)
"""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from dolfinx import fem, io

from pw_elements.checks import arguments, collective
from pw_elements.contact.model import ContactState
from pw_elements.contact.output.fields import STATE, ContactFields, trial
from pw_elements.elasticity import Body
from pw_elements.spaces import quadratic_element


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
    curved cells: open it with ParaView's "ADIOS2 VTX Reader". Anything of this name is replaced.

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
        OSError: if something else is there, or the folder cannot be written in.
    """
    path, space = Path(path), trial(body)
    states = [states] if isinstance(states, ContactState) else list(states)
    comm = space.mesh.comm
    with collective(comm):
        for state in states:
            arguments.of_type("a state", state, ContactState, STATE)
        given = [float(s.increment) for s in states] if times is None else list(times)
        _check_series(path, states, given, space)
    fields = ContactFields.of(states[0], body)
    unfinished, old = (path.with_name(f".{comm.bcast(os.getpid())}-{k}-{path.name}") for k in "ab")
    with collective(comm):
        if comm.rank == 0:
            unfinished.mkdir()
    try:
        with io.VTXWriter(comm, unfinished, fields.functions()) as file:
            for time, state in zip(given, states, strict=True):
                fields.fill(state)
                file.write(float(time))
        comm.barrier()
        with collective(comm):
            if comm.rank == 0:
                if path.exists():
                    path.rename(old)
                unfinished.rename(path)
                shutil.rmtree(old, ignore_errors=True)
    finally:
        if comm.rank == 0:
            shutil.rmtree(unfinished, ignore_errors=True)


def _check_series(
    path: Path, states: Sequence[ContactState], times: Sequence[float], space: fem.FunctionSpace
) -> None:
    if not hasattr(io, "VTXWriter"):
        raise RuntimeError("this DOLFINx was built without ADIOS2, which files for ParaView need")
    if path.suffix != ".bp":
        raise ValueError(f"{path}: the name of a VTX file ends in .bp")
    if not states:
        raise ValueError(f"{path}: there is no state to write")
    if len(times) != len(states) or not np.all(np.diff(times) > 0) or not np.isfinite(times).all():
        raise ValueError(f"{path}: {len(states)} states need as many times, each after the last")
    cell, dim = space.mesh.topology.cell_name(), space.mesh.geometry.dim
    if space.ufl_element() != quadratic_element(cell, (dim,)):
        raise ValueError(
            f"{path}: the element {space.ufl_element()} is not Lagrange's of degree 2, which is "
            "what VTX files hold: write an interpolation of each field by io.VTXWriter"
        )
    if path.exists() and not (path / "md.idx").exists():
        raise FileExistsError(f"{path} is there and no VTX file: it is not replaced")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: its folder does not exist")
