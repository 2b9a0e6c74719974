"""Results that take too long for each run of the study: `longer` computes and checks them."""

import json
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from study.run.cases import Case
from study.run.store import Result

RECORD = Path(__file__).with_name("longer.json")
RECORD_NAME = RECORD.relative_to(Path(__file__).parents[2]).as_posix()


def recorded(measured: dict[str, float], units: dict[str, str], dofs: int) -> Result:
    """A case of the record.

    Args:
        measured: its scalars.
        units: those other than 1.
        dofs: its size.
    """
    return Result(dict(measured), dict.fromkeys(measured, "1") | units, {}, dofs=dofs)


def rows() -> list[dict[str, Any]]:
    """All of the record: section, case, parameters, scalars, units, dofs, seconds."""
    found: list[dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))["rows"]
    return found


def parted(cases: Sequence[Case], *patterns: str) -> tuple[list[Case], list[Case]]:
    """Cases without and with a name like one of the patterns, which are as in a shell."""

    def late(case: Case) -> bool:
        return any(fnmatchcase(case.name, like) for like in patterns)

    return [case for case in cases if not late(case)], [case for case in cases if late(case)]


def longer(section: str) -> list[Case]:
    """The recorded cases of a section, with problem and parameters of what has been computed."""
    return [
        Case(
            section,
            row["case"],
            recorded,
            {"measured": row["scalars"], "units": row["units"], "dofs": row["dofs"]},
            row["parameters"],
            record=RECORD_NAME,
        )
        for row in rows()
        if row["section"] == section
    ]
