"""Run CalculiX on the study's problems, and read its recorded answers.

`python3 -m study.publish.renew_records 'calculix/*'` runs it on all problems and writes the record;
with `--check` it compares the answers with the record instead. This needs Python, NumPy and `ccx`,
but no DOLFINx.
"""

import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from study.run import records
from study.solutions.calculix.output import Array, CalculixError
from study.solutions.calculix.problems import PROBLEMS

TOLERANCE = 1e-5
"""Largest relative difference from a recorded answer. CalculiX prints seven digits; other
processors and versions may round differently, and iterations then end at slightly other answers."""


@dataclass(frozen=True)
class CalculixAnswer:
    """Numbers that CalculiX has computed.

    Attributes:
        version: Version of CalculiX.
        deck_sha256: Digest of the deck.
        numbers: Arrays by name, as the problem's `read_numbers` returns them.
    """

    version: str
    deck_sha256: str
    numbers: dict[str, Array]


# Recorded answers


def load_answer(case: str) -> CalculixAnswer:
    """Return the recorded answer of a problem."""
    return answer_of_row(_recorded_row(case))


def load_unchanged_answer(case: str, digest: str) -> CalculixAnswer:
    """Return the recorded answer of a problem after checking its digest.

    Raises:
        ValueError: If the recorded answer has another digest.
    """
    if digest != answer_digest(case):
        raise ValueError(f"the record of {case} has changed since the study was started")
    return load_answer(case)


def answer_digest(case: str) -> str:
    """Return the digest of a recorded answer, which marks results of older answers as outdated."""
    return records.digest_answer(_recorded_row(case))


def answer_of_row(row: records.Row) -> CalculixAnswer:
    """Return the answer that a row of the record contains."""
    numbers = {name: np.array(values) for name, values in row.content["numbers"].items()}
    return CalculixAnswer(row.versions["calculix"], row.input_sha256, numbers)


def create_row(case: str, answer: CalculixAnswer) -> records.Row:
    """Return the record's row for an answer computed today; numbers have nine digits."""
    numbers = {
        name: [float(f"{value:.9g}") for value in values] for name, values in answer.numbers.items()
    }
    versions = {"calculix": answer.version}
    return records.create_row(row_key(case), answer.deck_sha256, {"numbers": numbers}, versions)


def row_key(case: str) -> str:
    """Return the key of a problem's row in the record."""
    return f"calculix/{case}"


def _recorded_row(case: str) -> records.Row:
    return records.read_rows(records.CALCULIX)[row_key(case)]


# Runs of CalculiX


def find_calculix() -> str | None:
    """Return the path of CalculiX, or None where it is not installed."""
    return shutil.which("ccx")


def read_version(calculix: str) -> str:
    """Return the version that CalculiX prints."""
    output = subprocess.run([calculix, "-v"], capture_output=True, text=True, check=False).stdout
    match = re.search(r"Version (\S+)", output)
    if match is None:
        raise CalculixError(f"{calculix} -v prints no version, but {output[:100]!r}")
    return match[1]


def compute_answer(case: str, calculix: str) -> CalculixAnswer:
    """Run CalculiX on a problem, with one thread, in a temporary folder.

    Raises:
        CalculixError: If CalculiX fails, or prints other tables than expected.
    """
    problem = PROBLEMS[case]
    deck = problem.deck()
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder, "job")
        job.with_suffix(".inp").write_text(deck)
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        run = subprocess.run(
            [calculix, job.name],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        check_finished(run.returncode, f"{run.stdout}{run.stderr}", case)
        output = job.with_suffix(getattr(problem, "output_suffix", ".dat")).read_text()
    numbers = problem.read_numbers(output)
    return CalculixAnswer(read_version(calculix), records.digest_input(deck), numbers)


def check_finished(status: int, output: str, case: str = "block") -> None:
    """Raise a `CalculixError` if CalculiX has reported an error or has not finished its job."""
    if status or "Job finished" not in output or "*ERROR" in output:
        raise CalculixError(f"{case}: CalculiX failed:\n{output[-1000:]}")


def largest_difference(new: CalculixAnswer, old: CalculixAnswer) -> float:
    """Return the largest difference of two answers, relative to the largest entry of each array.

    It is infinite if names or shapes of the arrays differ.
    """
    new_shapes, old_shapes = (
        {name: values.shape for name, values in answer.numbers.items()} for answer in (new, old)
    )
    if new_shapes != old_shapes:
        return np.inf
    return max(
        float(np.abs(values - old.numbers[name]).max() / np.abs(values).max())
        for name, values in new.numbers.items()
    )
