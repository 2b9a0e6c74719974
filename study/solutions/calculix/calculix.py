"""Run CalculiX on the study's problems, and read recorded results of earlier runs.

`python3 -m study.publish.renew_records 'calculix/*'` runs CalculiX on all problems and writes the
record; with `--check` it compares the results with the record instead. This requires Python, NumPy,
SciPy and `ccx`, but not DOLFINx.
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
"""Largest accepted relative difference of a new result from the recorded one.

CalculiX prints seven digits; on other processors and versions, iterations may end at slightly
different results because of round-off."""


MISSING = "ccx (CalculiX, Debian's package calculix-ccx) is not installed"
"""Message if CalculiX is required but not installed."""


@dataclass(frozen=True)
class CalculixResult:
    """Result of CalculiX for one problem.

    Attributes:
        version: Version of CalculiX.
        deck_sha256: SHA-256 digest of the input deck.
        numbers: Arrays by name, which the problem's `read_numbers` extracts from the output.
    """

    version: str
    deck_sha256: str
    numbers: dict[str, Array]


# Recorded answers


def load_recorded_result(case: str) -> CalculixResult:
    """Read the recorded CalculiX result of a problem."""
    return result_from_record_row(_read_record_row(case))


def load_recorded_result_if_unchanged(case: str, expected_digest: str) -> CalculixResult:
    """Read the recorded CalculiX result of a problem after checking its digest.

    Args:
        case: Name of the problem in `PROBLEMS`.
        expected_digest: Digest that the recorded result must have.

    Raises:
        ValueError: If the digest of the recorded result differs.
    """
    if expected_digest != digest_recorded_result(case):
        raise ValueError(f"the record of {case} has changed since the study was started")
    return load_recorded_result(case)


def digest_recorded_result(case: str) -> str:
    """Return the digest of a recorded result, by which outdated study results are recognised."""
    return records.digest_row_without_date(_read_record_row(case))


def result_from_record_row(row: records.RecordRow) -> CalculixResult:
    """Return the CalculiX result that a row of the record contains."""
    numbers = {name: np.array(values) for name, values in row.content["numbers"].items()}
    return CalculixResult(row.versions["calculix"], row.input_sha256, numbers)


def make_record_row(case: str, result: CalculixResult) -> records.RecordRow:
    """Create a row of the record, dated today, from a result, with numbers of nine digits."""
    numbers = {
        name: [float(f"{value:.9g}") for value in values] for name, values in result.numbers.items()
    }
    versions = {"calculix": result.version}
    return records.create_row_with_current_date(
        record_row_key(case), result.deck_sha256, {"numbers": numbers}, versions
    )


def record_row_key(case: str) -> str:
    """Return the key "calculix/<case>" of a problem's row in the record."""
    return f"calculix/{case}"


def _read_record_row(case: str) -> records.RecordRow:
    return records.read_rows(records.CALCULIX)[record_row_key(case)]


# Runs of CalculiX


def find_calculix() -> str | None:
    """Return the path of the executable `ccx`, or None if CalculiX is not installed.

    The environment variable `CALCULIX` may name an executable that is not in a folder of `PATH`.
    """
    return shutil.which(os.environ.get("CALCULIX", "ccx"))


def ask_calculix_for_its_version(calculix: str) -> str:
    """Run `ccx -v` and return the version that it prints."""
    output = subprocess.run([calculix, "-v"], capture_output=True, text=True, check=False).stdout
    match = re.search(r"Version (\S+)", output)
    if match is None:
        raise CalculixError(f"{calculix} -v prints no version, but {output[:100]!r}")
    return match[1]


def run_calculix_on_problem(case: str, calculix: str) -> CalculixResult:
    """Run CalculiX on a problem with one thread, in a temporary folder.

    Args:
        case: Name of the problem in `PROBLEMS`.
        calculix: Path of CalculiX.

    Raises:
        CalculixError: If CalculiX fails, or if its output lacks expected tables.
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
        check_calculix_finished(run.returncode, f"{run.stdout}{run.stderr}", case)
        output = job.with_suffix(getattr(problem, "output_suffix", ".dat")).read_text()
    numbers = problem.read_numbers(output)
    return CalculixResult(
        ask_calculix_for_its_version(calculix), records.digest_input(deck), numbers
    )


def check_calculix_finished(exit_status: int, output: str, case: str = "block") -> None:
    """Raise a `CalculixError` if CalculiX reported an error or did not finish its job."""
    if exit_status or "Job finished" not in output or "*ERROR" in output:
        raise CalculixError(f"{case}: CalculiX failed:\n{output[-1000:]}")


def largest_relative_difference(new: CalculixResult, old: CalculixResult) -> float:
    """Return the largest difference of two results, relative to the largest entry of each array.

    The difference is infinite if names or shapes of the arrays differ.
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
