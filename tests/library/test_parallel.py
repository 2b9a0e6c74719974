"""The library's results on one, two and three processes."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PROJECT = Path(__file__).parents[2]


def numbers(module, processes):
    # by mpi4py an exception in one process ends them all, which would else wait for it
    python = [sys.executable, "-m", "mpi4py", "-m"]
    command = ["mpirun", "-n", str(processes), *python, f"tests.{module}"]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=1800)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def size(name, value):
    """What differences of a number are compared with."""
    if name == "identity":  # a relative difference itself
        return 1e-4
    # displacements are of this size in all contact problems, gaps and slips may all be zero
    return 0.1 if name.endswith((" gap", " slip")) else np.abs(value).max()


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("module", ["parallel_numbers", "contact_numbers", "impact_numbers"])
def test_same_numbers_on_one_two_and_three_processes(module):
    serial = numbers(module, 1)
    assert serial.get("identity", 0.0) < 1e-14
    for processes in (2, 3):
        parallel = numbers(module, processes)
        assert parallel.keys() == serial.keys()
        for name, value in serial.items():
            difference = np.abs(np.subtract(parallel[name], value)).max()
            assert difference <= 1e-10 * size(name, value), name
