"""Records: results in version control, which are read instead of being computed.

The files in `study/run/recorded` have the same format. Each is a list of rows, which consist of a
header (key, versions of the programs, date, digest of the input and, if time and memory are
measured, the machine) and numbers.

    costly_cases.json      scalars, without curves, of cases that take more than about three CPU
                           seconds, which their pages mark by `mark_costly`
    time_and_memory.json   measurements of section K
    calculix.json          results of CalculiX
    table_1_columns.json   columns fitted to Table 1, see `study.paper.table_1.ensemble`
    table_1_shifts.json    shifts of eigenvalues on these columns, see `study.paper.table_1.family`
    table_2.json           critical stresses of the models of Table 2, see
                           `study.paper.table_2.family`

`./run python3 -m study.publish.renew_records` recomputes the rows and writes or compares them.
"""

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from study.run.provenance import package_versions
from study.run.store import Result, StudyError, write_atomically

FOLDER = Path(__file__).with_name("recorded")
COSTLY_CASES = FOLDER / "costly_cases.json"
TIME_AND_MEMORY = FOLDER / "time_and_memory.json"
CALCULIX = FOLDER / "calculix.json"
TABLE_1_COLUMNS = FOLDER / "table_1_columns.json"
TABLE_1_SHIFTS = FOLDER / "table_1_shifts.json"
TABLE_2 = FOLDER / "table_2.json"

COSTLY_SECONDS = 3.0
"""CPU seconds above which the result of a case is recorded."""
SHARED_REFERENCES = ("W",)
"""Sections whose costly cases are all recorded, because they share reference solutions.

The reference solutions, on fine meshes, take longer than `COSTLY_SECONDS`. The time recorded for a
case excludes them if another case of the same run has computed them before.
"""


@dataclass(frozen=True)
class RecordRow:
    """Recorded result of one computation or measurement.

    Attributes:
        key: Name of the row, which is unique among all records.
        versions: Versions of the programs that computed the numbers, by name of program.
        date: Date of the computation, such as "2026-11-22".
        input_sha256: Digest of the input, see `digest_input`.
        content: Numbers and further entries, which depend on the kind of record.
        machine: Cores, processor and memory; None if the numbers do not depend on them.
    """

    key: str
    versions: dict[str, str]
    date: str
    input_sha256: str
    content: dict[str, Any]
    machine: str | None = None


_HEAD = ("key", "versions", "date", "machine", "input_sha256")


def create_row_with_current_date(
    key: str,
    input_sha256: str,
    content: dict[str, Any],
    versions: dict[str, str] | None = None,
    machine: str | None = None,
) -> RecordRow:
    """Create a row with the current date.

    Args:
        key: Name of the row.
        input_sha256: Digest of the input.
        content: Numbers and further entries.
        versions: Versions of the programs; by default, those of the study's packages.
        machine: Description of the machine, if the numbers depend on it.
    """
    if versions is None:
        versions = dict(package_versions())
    date = datetime.now(UTC).date().isoformat()
    return RecordRow(key, versions, date, input_sha256, content, machine)


def digest_input(parameters: object) -> str:
    """Return the SHA-256 digest of the input of a computation.

    Args:
        parameters: Input file as text, or parameters that are representable in JSON.
    """
    text = parameters if isinstance(parameters, str) else json.dumps(parameters, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def digest_row_without_date(row: RecordRow) -> str:
    """Return the SHA-256 digest of the numbers, versions and input of a row, excluding its date."""
    return digest_input([row.versions, row.input_sha256, row.content])


def digest_files(*paths: Path) -> str:
    """Return the digest of the keys, numbers, versions and inputs of all rows of some records."""
    rows = [row for path in paths for row in read_rows(path).values()]
    return digest_input([[row.key, digest_row_without_date(row)] for row in rows])


def read_rows(path: Path) -> dict[str, RecordRow]:
    """Read the rows of a record, by key; a file that does not exist has no rows.

    Raises:
        StudyError: If the file cannot be parsed, a row is incomplete, or two rows have the same
            key.
    """
    if not path.is_file():
        return {}
    try:
        return dict(_parse_rows(path.read_bytes()))
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{path} is no record ({error!r}): restore it from the history") from None


@cache
def _parse_rows(text: bytes) -> dict[str, RecordRow]:
    rows = {}
    for entry in json.loads(text)["rows"]:
        head = {name: entry[name] for name in _HEAD if name != "machine"}
        content = {name: value for name, value in entry.items() if name not in _HEAD}
        if head["key"] in rows:
            raise ValueError(f"two rows of {head['key']}")
        rows[head["key"]] = RecordRow(**head, content=content, machine=entry.get("machine"))
    return rows


def largest_difference(computed: object, recorded: object) -> float:
    """Return the largest difference of two nested lists of numbers, in which None is a gap.

    The difference is infinite if the gaps differ.
    """
    new, old = (np.array(numbers, dtype=float) for numbers in (computed, recorded))
    if not np.array_equal(np.isnan(new), np.isnan(old)):
        return float("inf")
    return float(np.nanmax(np.abs(new - old)))


def write_rows(path: Path, rows: Iterable[RecordRow]) -> None:
    """Write rows to a file atomically: if the process is killed, the old file is unchanged.

    Lists of numbers are written on one line.
    """
    entries = []
    for row in rows:
        head = {name: getattr(row, name) for name in _HEAD if getattr(row, name) is not None}
        entries.append(head | row.content)
    text = json.dumps({"rows": entries}, indent=1, ensure_ascii=False, allow_nan=False)
    # Strings of JSON contain no line breaks, so that only white space between values is removed
    text = re.sub(r"\[[^][{}]*\]", lambda match: re.sub(r"\n *", "", match[0]), text)
    write_atomically(path, (text + "\n").encode())


def path_relative_to_project(path: Path) -> str:
    """Return the path of a file relative to the project's folder.

    For files outside that folder, it is the given path.
    """
    project = Path(__file__).parents[2]
    return path.relative_to(project).as_posix() if path.is_relative_to(project) else str(path)


# Costly cases


def recorded(measured: dict[str, float], units: dict[str, str], dofs: int) -> Result:
    """Return the recorded result of a costly case.

    Args:
        measured: Scalars by name.
        units: Units by name of scalar; scalars without an entry are dimensionless.
        dofs: Number of unknowns.
    """
    return Result(dict(measured), dict.fromkeys(measured, "1") | units, {}, dofs=dofs)


def takes_long_enough_to_record(row: RecordRow) -> bool:
    """Return whether the result of a costly case is recorded.

    It is if the case took more than `COSTLY_SECONDS` or belongs to `SHARED_REFERENCES`.
    """
    section = row.key.partition("/")[0]
    return row.content["seconds"] > COSTLY_SECONDS or section in SHARED_REFERENCES
