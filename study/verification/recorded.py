"""Results that take too long for each run of the study: `longer` computes and checks them."""

import json
from pathlib import Path
from typing import Any

from study.core.cases import Case
from study.core.store import Result
from study.units import units_of

RECORD = Path(__file__).with_name("longer.json")


def recorded(measured: dict[str, float], dofs: int) -> Result:
    """A case of the record.

    Args:
        measured: its scalars, without units but for CPU time.
        dofs: its size.
    """
    units = units_of(measured, {"cpu_seconds": "s", "*": "1"})
    return Result(dict(measured), units, {}, dofs=dofs)


def rows() -> list[dict[str, Any]]:
    """All of the record: section, case, parameters, scalars, dofs, seconds."""
    found: list[dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))["rows"]
    return found


def longer(section: str) -> list[Case]:
    """The recorded cases of a section, with the parameters of what has been computed."""
    return [
        Case(
            section,
            row["case"],
            recorded,
            {"measured": row["scalars"], "dofs": row["dofs"]},
            {name: value for name, value in row["parameters"].items() if name != "problem"},
        )
        for row in rows()
        if row["section"] == section
    ]
