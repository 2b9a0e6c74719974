"""Expected computing times of the cases, used to start the longest cases first.

`python3 -m study.run.expected [results]` prints a table of the longest cases. Write it to
`expected_seconds.json` if the times have changed considerably. `tests/study/test_checks.py`
computes cases without a current stored result, except for those in the table.
"""

import json
import sys
from functools import cache
from pathlib import Path

from study.run.store import Results

TABLE_FILE = Path(__file__).with_name("expected_seconds.json")
MIN_TABLE_SECONDS = 1.0
"""Shortest time in the table; cases that take less are run last, in any order."""


def expect_seconds_of_cases(results: Results) -> dict[str, float]:
    """Return the expected computing time of each case in seconds, by key.

    It is the time stored with an earlier result, or otherwise that of the table.
    """
    return read_table_of_expected_seconds() | read_seconds_of_stored_results(results)


@cache
def read_table_of_expected_seconds() -> dict[str, float]:
    """Read the table of expected computing times in seconds, by key of the case.

    The table contains only cases that take at least `MIN_TABLE_SECONDS`.
    """
    table: dict[str, float] = json.loads(TABLE_FILE.read_bytes())
    return table


def read_seconds_of_stored_results(results: Results) -> dict[str, float]:
    """Read the computing time of each stored result in seconds, by key, even if outdated."""
    seconds = {}
    for path in results.folder.glob("*/*.json"):
        try:
            value = json.loads(path.read_bytes())["provenance"]["seconds"]
            seconds[f"{path.parent.name}/{path.stem}"] = float(value)
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            pass  # not a result, or unreadable
    return seconds


if __name__ == "__main__":
    stored = read_seconds_of_stored_results(
        Results(sys.argv[1] if len(sys.argv) > 1 else "results")
    )
    rounded = {key: round(seconds, 1) for key, seconds in stored.items()}
    longest = sorted(
        (-seconds, key) for key, seconds in rounded.items() if seconds >= MIN_TABLE_SECONDS
    )
    print(json.dumps({key: -seconds for seconds, key in longest}, indent=1))
