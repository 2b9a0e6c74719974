"""Run functions of test files on several MPI processes.

`run_on(3, function, *args)` starts `mpirun`, whose processes import the function and call it with
their communicator and the arguments. A start costs one or two seconds of CPU time, so a function
should do much work.
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
DISPLACEMENT_SCALE = 0.1  # of all compared contact problems, in which gaps and slips may vanish


def run_on(processes, function, *args, limit=TIME_LIMIT):
    """Return the results of `function(comm, *args)` by rank; fail with the output of all ranks."""
    if shutil.which("mpirun") is None:
        pytest.skip("no mpirun")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "call").write_bytes(pickle.dumps((processes, function, args, limit)))
        command = ["mpirun", "-n", str(processes), sys.executable, "-m", "tests.parallel", name]
        run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
        output = [f"mpirun ended with {run.returncode}:\n{run.stdout}{run.stderr}"]
        output += [f"{path.stem}:\n{path.read_text()}" for path in sorted(folder.glob("*.txt"))]
        results = [folder / f"result {rank}" for rank in range(processes)]
        assert run.returncode == 0 and all(map(Path.exists, results)), "\n".join(output)  # noqa: PT018
        return [pickle.loads(result.read_bytes()) for result in results]


def assert_same_on_processes(function, *args, processes=(3,), rel=1e-10):
    """Assert that `function(comm, *args)` returns the same numbers on several processes as on one.

    The function returns a dictionary of arrays on every process, see `assert_same`.
    """
    serial = function(MPI.COMM_SELF, *args)
    for count in processes:
        for rank, numbers in enumerate(run_on(count, function, *args)):
            assert_same(serial, numbers, rel, f"process {rank} of {count}")


def assert_same(serial, numbers, rel, where):
    """Assert that dictionaries of arrays are equal up to a relative difference.

    Differences are relative to the largest absolute value; for names that end in " gap" or " slip",
    relative to `DISPLACEMENT_SCALE`.
    """
    assert numbers.keys() == serial.keys()
    for name, value in serial.items():
        small = name.endswith((" gap", " slip"))
        scale = DISPLACEMENT_SCALE if small else np.abs(value).max(initial=0.0)
        difference = np.abs(np.subtract(numbers[name], value)).max(initial=0.0)
        assert difference <= rel * scale, f"{name}, {where}"


def _execute_call(folder):
    """Call the pickled function of a folder on this process and store its result."""
    processes, function, args, limit = pickle.loads((folder / "call").read_bytes())
    # mpirun of another MPI starts separate programs with one process each
    assert MPI.COMM_WORLD.size == processes, f"{MPI.COMM_WORLD.size} in place of {processes}"
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
