"""Functions of test files, on several processes.

`run_on(3, function, *args)` starts `mpirun`, whose processes import the function and call it with
their communicator and the arguments. A start costs a second or two of CPU: let a function do much.
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
LIMIT = 1800  # seconds, to tell hung from slow on the busiest machine
# as long DOLFINx waits for another process that compiles the same form
JIT = dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS
JIT["timeout"] = (LIMIT, *JIT["timeout"][1:])
DISPLACEMENT = 0.1  # of all contact problems that are compared; gaps and slips may all be zero


def run_on(processes, function, *args, limit=LIMIT):
    """What `function(comm, *args)` returned, process by process; fails with what each printed."""
    if shutil.which("mpirun") is None:
        pytest.skip("no mpirun")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "call").write_bytes(pickle.dumps((processes, function, args, limit)))
        command = ["mpirun", "-n", str(processes), sys.executable, "-m", "tests.parallel", name]
        run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
        said = [f"mpirun ended with {run.returncode}:\n{run.stdout}{run.stderr}"]
        said += [f"{path.stem}:\n{path.read_text()}" for path in sorted(folder.glob("*.txt"))]
        results = [folder / f"result {rank}" for rank in range(processes)]
        assert run.returncode == 0 and all(map(Path.exists, results)), "\n".join(said)  # noqa: PT018
        return [pickle.loads(result.read_bytes()) for result in results]


def same_numbers(function, *args, processes=(3,), rel=1e-10):
    """Asserts that `function(comm, *args)` gives the same numbers by name as here, on one process.

    All processes have to return them. Differences are compared with the largest absolute value, of
    names that end in "gap" or "slip" with `DISPLACEMENT`.
    """
    serial = function(MPI.COMM_SELF, *args)
    for count in processes:
        for rank, found in enumerate(run_on(count, function, *args)):
            assert_same(serial, found, rel, f"process {rank} of {count}")


def assert_same(serial, found, rel, where):
    assert found.keys() == serial.keys()
    for name, value in serial.items():
        small = name.endswith((" gap", " slip"))
        scale = DISPLACEMENT if small else np.abs(value).max(initial=0.0)
        difference = np.abs(np.subtract(found[name], value)).max(initial=0.0)
        assert difference <= rel * scale, f"{name}, {where}"


def _called(folder):
    processes, function, args, limit = pickle.loads((folder / "call").read_bytes())
    # another MPI's mpirun starts programs of one process each
    assert MPI.COMM_WORLD.size == processes, f"{MPI.COMM_WORLD.size} in place of {processes}"
    faulthandler.dump_traceback_later(limit, exit=True)  # until this process has ended
    try:
        result = function(MPI.COMM_WORLD, *args)
    except BaseException:  # ends all, which would else wait for this one: at its end, PETSc, too
        traceback.print_exc()
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
    (folder / f"result {MPI.COMM_WORLD.rank}").write_bytes(pickle.dumps(result))


if __name__ == "__main__":
    own = Path(sys.argv[1]) / f"process {MPI.COMM_WORLD.rank}.txt"
    with own.open("w") as output:
        for descriptor in (1, 2):
            os.dup2(output.fileno(), descriptor)
    _called(Path(sys.argv[1]))
