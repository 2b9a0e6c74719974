"""What the elements cost: the record of `study.cost.measure`, as a section."""

import json
from collections.abc import Callable
from typing import Any

from study.core.cases import Case
from study.core.store import Result
from study.cost.measure import RECORD, Row
from study.units import units_of

TITLE = "Cost"

KINDS = {"*seconds": "s", "megabytes": "MB", "*": "1"}


def recorded(
    task: str,
    element: str,
    cells: int,
    method: str,
    processes: int,
    machine: str,  # noqa: ARG001
    measured: dict[str, float],
) -> Result:
    """A row of the record: seconds of CPU time (median), of the task and of the whole process.

    Args:
        task: what has been measured.
        element: its name.
        cells: along the height of the block.
        method: of the linear systems.
        processes: of MPI.
        machine: in words.
        measured: numbers.
    """
    del task, element, cells, method
    scalars = {**measured, "processes": float(processes)}
    return Result(scalars, units_of(scalars, KINDS), {}, dofs=int(measured["dofs"]))


def recorded_of_calculix(
    task: str,
    peer_element: str,
    cells: int,
    method: str,
    processes: int,
    machine: str,
    measured: dict[str, float],
) -> Result:
    """A row of CalculiX, whose elements are none of ours; arguments as before."""
    return recorded(task, peer_element, cells, method, processes, machine, measured)


def _cases() -> list[Case]:
    record: dict[str, Any] = json.loads(RECORD.read_text(encoding="utf-8"))
    cases = []
    for entry in record["rows"]:
        run: Callable[..., Result] = recorded
        row = {**entry["row"], "machine": record["machine"]}
        name = Row(**entry["row"]).name
        if row["method"] == "CalculiX":
            run, row["peer_element"] = recorded_of_calculix, row.pop("element")
        cases.append(Case("K", name, run, {**row, "measured": entry["measured"]}))
    return cases


CASES = _cases()
