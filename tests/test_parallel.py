import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PROJECT = Path(__file__).parents[1]


def numbers(processes):
    # by mpi4py an exception in one process ends them all, which would else wait for it
    python = [sys.executable, "-m", "mpi4py", "-m"]
    command = ["mpirun", "-n", str(processes), *python, "tests.parallel_numbers"]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
def test_same_numbers_on_one_two_and_three_processes():
    serial = numbers(1)
    assert serial.pop("identity") < 1e-14
    for processes in (2, 3):
        parallel = numbers(processes)
        assert parallel.pop("identity") < 1e-14
        assert parallel.keys() == serial.keys()
        for name, value in serial.items():
            scale = np.abs(value).max()
            assert np.abs(np.subtract(parallel[name], value)).max() < 1e-10 * scale, name
