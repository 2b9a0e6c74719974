"""What the elements cost: the record of `study.cost.measure`, as a section."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from study.cost.measure import EXACT_DIGITS, FORCING, RECORD, Row
from study.model.units import units_of
from study.run.cases import Case
from study.run.store import Result

SECTION = "K"
TITLE = "Cost"
RECORD_NAME = RECORD.relative_to(Path(__file__).parents[2]).as_posix()

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


def cases(path: Path = RECORD) -> list[Case]:
    """Return a case for each row of a record that `study.cost.measure` has written."""
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    known = {Row(**entry["row"]): entry["measured"] for entry in record["rows"]}
    machines = {Row(**entry["row"]): entry["machine"] for entry in record["rows"]}
    made = []
    for row, measured in known.items():
        run: Callable[..., Result] = recorded
        stated = {**asdict(row), "machine": machines[row]}
        if row.method == "CalculiX":
            run, stated["peer_element"] = recorded_of_calculix, stated.pop("element")
        measured = measured | _over_bare(row, measured, known)
        tracked = path == RECORD or row.method == "CalculiX"
        made.append(
            Case(
                "K",
                row.name,
                run,
                {**stated, "measured": measured},
                record=RECORD_NAME if tracked else "",
            )
        )
    return made


def _over_bare(
    row: Row, measured: dict[str, float], known: dict[Row, dict[str, float]]
) -> dict[str, float]:
    """A whole run of contact over what its parts take by themselves, as `measure` says."""
    alone = replace(row, task="linear", method="Iterative")
    if row.task != "contact" or row.method != "Iterative" or alone not in known:
        return {}
    bare, whole, steps = known[alone], measured["whole_seconds"], measured["iterations"]
    first = -math.log10(FORCING)
    each = (bare["exact_seconds"] - bare["seconds"]) / (EXACT_DIGITS - first)
    solutions = steps * bare["seconds"] + bare["assembly_seconds"]
    parts = solutions + bare["set_up_seconds"] + (measured["digits"] - steps * first) * each
    return {"over_bare": whole / parts, "over_solutions": whole / solutions}


CASES = cases()
