"""What fails on one process fails on all of them, with the same words."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import pytest

from pw_elements.collective import agree, answer, collective

PROJECT = Path(__file__).parents[1]

# The error of each scenario in tests/one_process_errs.py; {k} is the last process
SAID = {
    "check_fails": "ArithmeticError: one plus one is three",
    "different_words": "ArithmeticError: process 0",
    "callback_fails": "ValueError: the marker failed on process {k}: KeyError: 'x'",
    "arguments_differ": "ValueError: most differs between processes, between 0 and {k} for one: "
    "all of them have to state the same problem",
}


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("processes", [2, 3])
def test_an_error_on_one_process_ends_all_with_the_same_words(processes):
    command = ["mpirun", "-n", str(processes), sys.executable, "-m", "tests.one_process_errs"]
    quiet = os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1"}
    run = subprocess.run(
        command, cwd=PROJECT, env=quiet, capture_output=True, text=True, timeout=600
    )
    assert run.returncode == 0, run.stderr
    expected = {name: [words.format(k=processes - 1)] * processes for name, words in SAID.items()}
    assert json.loads(run.stdout) == expected


def test_errors_of_users_functions_are_the_cause_of_the_librarys():
    comm = MPI.COMM_SELF
    words = r"^the marker failed: KeyError: 'x'$"
    with pytest.raises(ValueError, match=words) as caught, collective(comm):
        answer(comm, "the marker", {}.__getitem__, "x")
    assert isinstance(caught.value.__cause__, KeyError)


def test_the_same_arguments_agree_whatever_they_are():
    agree(MPI.COMM_SELF, {"anything": object()})
