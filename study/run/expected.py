"""Expected computing times of the cases, used to start the longest cases first.

`python3 -m study.run.expected [results]` prints a table of the longest cases. Write it to
`expected_seconds.json` if the times have changed considerably. `tests/study/test_checks.py` reads
the cases in the table from stored results and computes all others.
"""

import json
import sys
from functools import cache
from pathlib import Path

from study.run.store import Results

TABLE_FILE = Path(__file__).with_name("expected_seconds.json")
MIN_TABLE_SECONDS = 1.0
"""Shortest time that the table contains; shorter cases run last, in any order."""


def expected_seconds(results: Results) -> dict[str, float]:
    """Return the expected seconds of each case, from stored results or otherwise from the table."""
    return read_expected_table() | stored_seconds(results)


@cache
def read_expected_table() -> dict[str, float]:
    """Return the expected seconds of the cases that take longer than `MIN_TABLE_SECONDS`."""
    table: dict[str, float] = json.loads(TABLE_FILE.read_bytes())
    return table


def stored_seconds(results: Results) -> dict[str, float]:
    """Return the seconds that each stored result took, including outdated results."""
    seconds = {}
    for path in results.folder.glob("*/*.json"):
        try:
            value = json.loads(path.read_bytes())["provenance"]["seconds"]
            seconds[f"{path.parent.name}/{path.stem}"] = float(value)
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            pass  # not a result, or unreadable
    return seconds


if __name__ == "__main__":
    stored = stored_seconds(Results(sys.argv[1] if len(sys.argv) > 1 else "results"))
    rounded = {key: round(seconds, 1) for key, seconds in stored.items()}
    longest = sorted(
        (-seconds, key) for key, seconds in rounded.items() if seconds >= MIN_TABLE_SECONDS
    )
    print(json.dumps({key: -seconds for seconds, key in longest}, indent=1))
