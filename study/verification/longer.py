"""The longer series: finer meshes, more elements, rivals and variants.

    ./run python3 -m study.verification.longer             computes all, forty minutes; the record
    ./run python3 -m study.verification.longer V13/cube-pw-16    only these
    ./run python3 -m study.verification.longer --check     all again, against the record

Sections show the record; `./run nightly` checks it.
"""

import argparse
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

from study.engineering import w_engineering
from study.rivals import q_compare, q_friction
from study.run.cases import Case
from study.run.compare_versions import COUNTS, KINDS, compare, table
from study.run.provenance import versions
from study.run.store import Results, save, write_json
from study.verification import (
    c_convergence,
    v2_hertz,
    v4_spence,
    v5_cattaneo,
    v6_greco,
    v8_vibration,
    v10_space,
    v11_two_bodies,
    v12_impact,
    v13_fluxes,
    v14_rubber,
    v15_rubber,
    v16_sliding,
    v17_bodies,
)
from study.verification.recorded import RECORD, recorded, rows

LINEAR = (c_convergence, v8_vibration, v12_impact, v13_fluxes)
CONTACT = (v2_hertz, v4_spence, v5_cattaneo, v6_greco, v10_space, v11_two_bodies)
RUBBER = (v14_rubber, v15_rubber, v16_sliding, v17_bodies)
MODULES = (*LINEAR, *CONTACT, *RUBBER, q_compare, q_friction, w_engineering)
CASES: dict[str, Case] = {case.key: case for module in MODULES for case in module.LONGER}


def main(arguments: list[str] | None = None) -> int:
    """Compute, or compute again and compare; the exit status is 1 if numbers differ."""
    parser = argparse.ArgumentParser(prog="study.verification.longer")
    parser.add_argument("cases", nargs="*", metavar="case", help="as in V13/cube-pw-16")
    parser.add_argument("--check", action="store_true", help="compare with the record")
    given = parser.parse_args(arguments)
    unknown = [key for key in given.cases if key not in CASES]
    if unknown:
        parser.error(f"there is no longer case {unknown[0]}, but {', '.join(CASES)}")
    known = {_key(row): row for row in rows()} if RECORD.is_file() else {}
    found = {}
    for key in given.cases or CASES:
        found[key] = _row(CASES[key])
        print(f"{key}: {found[key]['seconds']} CPU s", file=sys.stderr, flush=True)
        if not given.check:
            _write(known | found)
    return _differ(known, found) if given.check else 0


def _key(row: dict[str, Any]) -> str:
    return f"{row['section']}/{row['case']}"


def _row(case: Case) -> dict[str, Any]:
    """A case computed."""
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


def _write(found: dict[str, dict[str, Any]]) -> None:
    """The record, in the order of the series, without what has been dropped from it."""
    kept = [found[key] for key in CASES if key in found]
    write_json(RECORD, {"versions": versions(), "rows": kept})


def _differ(known: dict[str, dict[str, Any]], found: dict[str, dict[str, Any]]) -> int:
    """Whether numbers differ, by the rules for results of two versions."""
    with tempfile.TemporaryDirectory() as folder:
        both = Path(folder, "record"), Path(folder, "now")
        for path, of in zip(both, (known, found), strict=True):
            for row in (of[key] for key in found if key in of):
                result = recorded(row["scalars"], row["units"], row["dofs"])
                save(path, row["section"], row["case"], result, row["parameters"], {})
        kinds = (COUNTS, *KINDS)  # of which some are of the machine that made the record
        differences, alone = compare(Results(both[0]), Results(both[1]), kinds)
    print(table(differences, alone, kinds))
    return int(bool(alone) or any(difference.too_large for difference in differences))


if __name__ == "__main__":
    sys.exit(main())
