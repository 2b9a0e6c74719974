"""Pins: numbers that are recorded so that a change is noticed, in one generated table.

A pin compares a measure of stored results with a bound. Of relation "=", the bound is the recorded
number, which `study.judge.update_pins` updates; a bound of an inequality is a requirement, which no
update changes.
"""

import json
from pathlib import Path
from typing import Any

from study.run.store import StudyError

PINS_FILE = Path(__file__).with_name("pins.json")

Pin = dict[str, Any]
"""Id, source, statement, measure, args, relation, bound, tolerance, unit; of a statement that is
known to fail also the number that is found instead, and its tolerance."""

_REQUIRED_KEYS = {"id", "source", "statement", "measure", "args", "relation", "bound", "tolerance"}
_OPTIONAL_KEYS = {"unit", "found", "found_tolerance"}


def load_pins(path: Path = PINS_FILE) -> list[Pin]:
    """Read the table.

    Raises:
        StudyError: if it cannot be read, or a pin lacks a key or has an unknown one.
    """
    try:
        pins: list[Pin] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path} cannot be read: {error}") from None
    for pin in pins:
        if wrong_keys := ({*pin} ^ _REQUIRED_KEYS) - _OPTIONAL_KEYS:
            names = ", ".join(sorted(wrong_keys))
            raise StudyError(f"{path}: pin {pin.get('id')} lacks or should not have {names}")
    return pins
