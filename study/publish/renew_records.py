"""Compute costly cases, and write their record or compare with it.

./run python3 -m study.publish.renew_records                  compute all; write the record
./run python3 -m study.publish.renew_records V13/cube-pw-16   only these
./run python3 -m study.publish.renew_records --check          compare all with the record
"""

import argparse
import sys
import tempfile
from pathlib import Path
from time import process_time

from study.run import records
from study.run.cases import SECTIONS, Case, load_section
from study.run.compare_versions import COUNTS, KINDS, compare, table
from study.run.provenance import versions
from study.run.records import Row
from study.run.store import Results, save, write_json


def main(arguments: list[str] | None = None) -> int:
    """Compute costly cases; write or check the record. The status is 1 if numbers differ."""
    parser = argparse.ArgumentParser(prog="study.publish.renew_records")
    parser.add_argument("cases", nargs="*", metavar="case", help="as in V13/cube-pw-16")
    parser.add_argument("--check", action="store_true", help="compare with the record")
    options = parser.parse_args(arguments)
    costly = costly_cases()
    for unknown in (key for key in options.cases if key not in costly):
        parser.error(f"there is no costly case {unknown}, but {', '.join(costly)}")
    rows = dict(records.read_rows())
    computed: dict[str, Row] = {}
    for key in options.cases or costly:
        computed[key] = _compute(costly[key])
        print(f"{key}: {computed[key]['seconds']} CPU s", file=sys.stderr, flush=True)
        if not options.check:
            _write(rows | computed, list(costly))
    return _compare(rows, computed) if options.check else 0


def costly_cases() -> dict[str, Case]:
    """Return the costly cases of all sections by their keys."""
    cases = [case for section in SECTIONS for case in load_section(section).cases]
    computed = [case.recomputed or case for case in cases]
    return {case.key: case for case in computed if case.costly}


def _compute(case: Case) -> Row:
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
    kept = [rows[key] for key in keys if key in rows and records.is_costly(rows[key])]
    write_json(records.RECORD, {"versions": versions(), "rows": kept})
    records.forget_rows()


def _compare(recorded_rows: dict[str, Row], computed_rows: dict[str, Row]) -> int:
    """Print how the numbers differ; return 1 if they do by more than versions may."""
    with tempfile.TemporaryDirectory() as folder:
        both = Path(folder, "record"), Path(folder, "now")
        for path, rows in zip(both, (recorded_rows, computed_rows), strict=True):
            for row in (rows[key] for key in computed_rows if key in rows):
                result = records.recorded(row["scalars"], row["units"], row["dofs"])
                save(path, row["section"], row["case"], result, row["parameters"], {})
        kinds = (COUNTS, *KINDS)  # of which some are of the machine that made the record
        differences, alone = compare(Results(both[0]), Results(both[1]), kinds)
    print(table(differences, alone, kinds))
    return int(bool(alone) or any(difference.too_large for difference in differences))


if __name__ == "__main__":
    sys.exit(main())
