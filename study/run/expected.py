"""How long cases take, to start the longest first: `python3 -m study.run.expected [results]`.

The command prints the table of the longest ones; it is written to `expected_seconds.json` when
they have changed much. Only the order depends on it.
"""

import json
import sys
from functools import cache
from pathlib import Path

from study.run.store import Results

TABLE = Path(__file__).with_name("expected_seconds.json")
LONG = 1.0  # seconds; shorter cases are not in the table, and fill the gaps in any order


def expected(results: Results) -> dict[str, float]:
    """Return seconds by keys of cases, from an earlier run if there is one, else the table's."""
    return expected_table() | earlier(results)


@cache
def expected_table() -> dict[str, float]:
    """Return the table: seconds by keys of the cases that take longer than `LONG`."""
    table: dict[str, float] = json.loads(TABLE.read_bytes())
    return table


def earlier(results: Results) -> dict[str, float]:
    """Return the seconds of all stored results, outdated ones too."""
    seconds = {}
    for path in results.folder.glob("*/*.json"):
        try:
            value = json.loads(path.read_bytes())["provenance"]["seconds"]
            seconds[f"{path.parent.name}/{path.stem}"] = float(value)
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            pass  # no result, or none that can be read
    return seconds


if __name__ == "__main__":
    found = earlier(Results(sys.argv[1] if len(sys.argv) > 1 else "results"))
    rounded = {key: round(seconds, 1) for key, seconds in found.items()}
    longest = sorted((-seconds, key) for key, seconds in rounded.items() if seconds >= LONG)
    print(json.dumps({key: -seconds for seconds, key in longest}, indent=1))
