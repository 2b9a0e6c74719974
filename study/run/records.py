"""Tracked results of costly cases: read instead of computed, renewed and checked on demand.

A case is costly if it takes more than about three CPU seconds; its page marks it by `mark_costly`.
The record has scalars, but no curves.
`study.publish.renew_records` renews and checks it.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

from study.run.store import Result

RECORD = Path(__file__).with_name("records.json")
RECORD_NAME = RECORD.relative_to(Path(__file__).parents[2]).as_posix()

COSTLY_SECONDS = 3.0
"""CPU seconds from which on a case is worth a record."""
SHARED_REFERENCES = ("W",)
"""Sections whose cases share references from fine meshes, which take longer than this. The seconds
of a row are without them if an earlier row of the same run has computed them."""

Row = dict[str, Any]
"""Section, case, parameters, scalars, units other than 1, dofs, and CPU seconds."""


def recorded(measured: dict[str, float], units: dict[str, str], dofs: int) -> Result:
    """Return the result of a row.

    Args:
        measured: its scalars.
        units: those other than 1.
        dofs: its number of unknowns.
    """
    return Result(dict(measured), dict.fromkeys(measured, "1") | units, {}, dofs=dofs)


def read_rows() -> dict[str, Row]:
    """Return the rows of the record by the keys of their cases."""
    return _read(RECORD) if RECORD.is_file() else {}


@cache
def _read(path: Path) -> dict[str, Row]:
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return {f"{row['section']}/{row['case']}": row for row in rows}


def forget_rows() -> None:
    """Read the record again when rows are asked for."""
    _read.cache_clear()


def is_costly(row: Row) -> bool:
    """Return whether a row is worth its place in the record."""
    return row["seconds"] > COSTLY_SECONDS or row["section"] in SHARED_REFERENCES
