"""Pins: numbers that are recorded so that a change is noticed, in one generated table.

    ./run python3 -m study.judge.pins            show pins that the stored results contradict
    ./run python3 -m study.judge.pins --update   ... and record what they give instead

A pin compares a measure of stored results with a bound. Of relation "=", the bound is the recorded
number and is updated; a bound of an inequality is a requirement, which no update changes.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from study.run.store import Results, StudyError, write_json

FILE = Path(__file__).with_name("pins.json")

Pin = dict[str, Any]
"""Id, source, statement, measure, args, relation, bound, tolerance, unit; of a statement that is
known to fail also the number that is found instead, and its tolerance."""

_REQUIRED = {"id", "source", "statement", "measure", "args", "relation", "bound", "tolerance"}
_OPTIONAL = {"unit", "found", "found_tolerance"}


def load_pins(path: Path = FILE) -> list[Pin]:
    """Read the table.

    Raises:
        StudyError: if it cannot be read, or a pin lacks a key or has an unknown one.
    """
    try:
        pins: list[Pin] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path} cannot be read: {error}") from None
    for pin in pins:
        if wrong := ({*pin} ^ _REQUIRED) - _OPTIONAL:
            names = ", ".join(sorted(wrong))
            raise StudyError(f"{path}: pin {pin.get('id')} lacks or should not have {names}")
    return pins


def main(arguments: list[str] | None = None) -> int:
    """Show, and with --update record, what differs; the status is 1 if something differs."""
    from study.judge import claims  # which imports this module

    parser = argparse.ArgumentParser(prog="study.judge.pins")
    parser.add_argument("results", nargs="?", type=Path, default=Path("results"))
    parser.add_argument("--update", action="store_true", help="record the numbers found")
    options = parser.parse_args(arguments)
    pins = load_pins()
    verdicts = {
        verdict.claim.id: verdict
        for verdict in claims.judge(claims.claims_of_pins(pins), Results(options.results))
    }
    differing = [verdict for verdict in verdicts.values() if verdict.differs]
    print(claims.table(differing) or "no pin differs\n", end="")
    if options.update:
        write_json(FILE, [_updated(pin, verdicts[pin["id"]].measured) for pin in pins])
    return int(bool(differing))


def _updated(pin: Pin, measured: float | None) -> Pin:
    if measured is None:
        return pin
    if "found" in pin:
        return pin | {"found": measured} if _differs(pin, "found", measured) else pin
    if pin["relation"] == "=" and _differs(pin, "bound", measured):
        return pin | {"bound": measured}
    return pin


def _differs(pin: Pin, name: str, measured: float) -> bool:
    tolerance = pin["found_tolerance"] if name == "found" else pin["tolerance"]
    return bool(abs(measured - pin[name]) > tolerance)


if __name__ == "__main__":
    sys.exit(main())
