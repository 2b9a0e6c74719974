"""Run functions of test files on several MPI processes.

`run_on_processes(3, function, *args)` starts `mpirun`, whose processes import the function and
call it with their communicator and the arguments. Starting takes one or two seconds of CPU time, so
each function should do much work.
"""

import faulthandler
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

from mpi4py import MPI

import dolfinx.jit
import numpy as np
import pytest

PROJECT = Path(__file__).parents[1]
TIME_LIMIT = 1800  # seconds; distinguishes hung from slow processes even on a busy machine
# DOLFINx waits equally long for another process that compiles the same form
JIT_OPTIONS = dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS
JIT_OPTIONS["timeout"] = (TIME_LIMIT, *JIT_OPTIONS["timeout"][1:])
DISPLACEMENT_SCALE = 0.1  # of all contact problems compared; gaps and slips may vanish


def run_on_processes(n_processes, function, *args, limit=TIME_LIMIT):
    """Return the results of `function(comm, *args)` by rank; fail with the output of all ranks."""
    if shutil.which("mpirun") is None:
        pytest.skip("no mpirun")
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        (folder / "call").write_bytes(pickle.dumps((n_processes, function, args, limit)))
        command = [
            "mpirun",
            "-n",
            str(n_processes),
            sys.executable,
            "-m",
            "tests.parallel",
            folder_name,
        ]
        completed = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
        output = [
            f"mpirun ended with {completed.returncode}:\n{completed.stdout}{completed.stderr}"
        ]
        output += [f"{path.stem}:\n{path.read_text()}" for path in sorted(folder.glob("*.txt"))]
        results = [folder / f"result {rank}" for rank in range(n_processes)]
        assert completed.returncode == 0 and all(map(Path.exists, results)), "\n".join(output)  # noqa: PT018
        return [pickle.loads(result.read_bytes()) for result in results]


def assert_same_on_processes(function, *args, process_counts=(3,), rel=1e-10):
    """Assert that `function(comm, *args)` returns the same numbers on several processes as on one.

    The function returns a dictionary of arrays on every process; see `assert_same_values` for the
    tolerance.
    """
    serial_values = function(MPI.COMM_SELF, *args)
    for n_processes in process_counts:
        for rank, parallel_values in enumerate(run_on_processes(n_processes, function, *args)):
            assert_same_values(
                serial_values, parallel_values, rel, f"process {rank} of {n_processes}"
            )


def assert_same_values(serial_values, parallel_values, rel, process_name):
    """Assert that dictionaries of arrays are equal up to a relative difference.

    Differences are relative to the largest absolute value; for names that end in " gap" or " slip",
    relative to `DISPLACEMENT_SCALE`.
    """
    assert parallel_values.keys() == serial_values.keys()
    for name, value in serial_values.items():
        is_displacement = name.endswith((" gap", " slip"))
        scale = DISPLACEMENT_SCALE if is_displacement else np.abs(value).max(initial=0.0)
        difference = np.abs(np.subtract(parallel_values[name], value)).max(initial=0.0)
        assert difference <= rel * scale, f"{name}, {process_name}"


def _execute_call(folder):
    """Call the function pickled in a folder on this process, and store its result there."""
    n_processes, function, args, limit = pickle.loads((folder / "call").read_bytes())
    # mpirun of another MPI starts separate programs with one process each
    assert MPI.COMM_WORLD.size == n_processes, f"{MPI.COMM_WORLD.size} in place of {n_processes}"
    faulthandler.dump_traceback_later(limit, exit=True)  # applies until this process ends
    try:
        result = function(MPI.COMM_WORLD, *args)
    except BaseException:  # abort all processes, which would otherwise wait for this one
        traceback.print_exc()
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
    (folder / f"result {MPI.COMM_WORLD.rank}").write_bytes(pickle.dumps(result))


if __name__ == "__main__":
    output_path = Path(sys.argv[1]) / f"process {MPI.COMM_WORLD.rank}.txt"
    with output_path.open("w") as output:
        for descriptor in (1, 2):
            os.dup2(output.fileno(), descriptor)
    _execute_call(Path(sys.argv[1]))
