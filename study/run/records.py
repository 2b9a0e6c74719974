"""Tracked results of costly cases: read instead of computed, renewed and checked on demand.

A case is costly if it takes more than about three CPU seconds; its page marks it by `mark_costly`.
The record has scalars, but no curves.

    ./run python3 -m study.run.records                  compute all costly cases; write the record
    ./run python3 -m study.run.records V13/cube-pw-16   only these
    ./run python3 -m study.run.records --check          compute all again; compare with the record
"""

import argparse
import json
import sys
import tempfile
from functools import cache
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

from study.run.provenance import versions
from study.run.store import Result, Results, save, write_json

if TYPE_CHECKING:
    from study.run.cases import Case

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


def is_costly(row: Row) -> bool:
    """Return whether a row is worth its place in the record."""
    return row["seconds"] > COSTLY_SECONDS or row["section"] in SHARED_REFERENCES


def main(arguments: list[str] | None = None) -> int:
    """Compute costly cases; write or check the record. The status is 1 if numbers differ."""
    parser = argparse.ArgumentParser(prog="study.run.records")
    parser.add_argument("cases", nargs="*", metavar="case", help="as in V13/cube-pw-16")
    parser.add_argument("--check", action="store_true", help="compare with the record")
    options = parser.parse_args(arguments)
    costly = costly_cases()
    for unknown in (key for key in options.cases if key not in costly):
        parser.error(f"there is no costly case {unknown}, but {', '.join(costly)}")
    rows = dict(read_rows())
    computed: dict[str, Row] = {}
    for key in options.cases or costly:
        computed[key] = _compute(costly[key])
        print(f"{key}: {computed[key]['seconds']} CPU s", file=sys.stderr, flush=True)
        if not options.check:
            _write(rows | computed, list(costly))
    return _compare(rows, computed) if options.check else 0


def costly_cases() -> "dict[str, Case]":
    """Return the costly cases of all sections by their keys."""
    from study.run.cases import SECTIONS, load_section

    cases = [case for section in SECTIONS for case in load_section(section).cases]
    computed = [case.recomputed or case for case in cases]
    return {case.key: case for case in computed if case.costly}


def _compute(case: "Case") -> Row:
    start = process_time()
    result = case.run(**case.parameters)
    return {
        "section": case.section,
        "case": case.name,
        "parameters": case.stored_parameters,
        "scalars": {name: float(f"{value:.12g}") for name, value in result.scalars.items()},
        "units": {name: unit for name, unit in result.units.items() if unit != "1"},
        "dofs": result.dofs,
        "seconds": round(process_time() - start, 1),
    }


def _write(rows: dict[str, Row], keys: list[str]) -> None:
    """Write the record in the order of the keys, without rows of other or of short cases."""
    kept = [rows[key] for key in keys if key in rows and is_costly(rows[key])]
    write_json(RECORD, {"versions": versions(), "rows": kept})
    _read.cache_clear()


def _compare(recorded_rows: dict[str, Row], computed_rows: dict[str, Row]) -> int:
    """Print how the numbers differ; return 1 if they do by more than versions may."""
    from study.run.compare_versions import COUNTS, KINDS, compare, table

    with tempfile.TemporaryDirectory() as folder:
        both = Path(folder, "record"), Path(folder, "now")
        for path, rows in zip(both, (recorded_rows, computed_rows), strict=True):
            for row in (rows[key] for key in computed_rows if key in rows):
                result = recorded(row["scalars"], row["units"], row["dofs"])
                save(path, row["section"], row["case"], result, row["parameters"], {})
        kinds = (COUNTS, *KINDS)  # of which some are of the machine that made the record
        differences, alone = compare(Results(both[0]), Results(both[1]), kinds)
    print(table(differences, alone, kinds))
    return int(bool(alone) or any(difference.too_large for difference in differences))


if __name__ == "__main__":
    sys.exit(main())
