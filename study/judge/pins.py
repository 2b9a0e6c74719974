"""Pins: numbers recorded in a generated table, such that tests detect any change.

A pin compares a measure of stored results with a bound. If the relation is "=", the bound is the
recorded number, which `study.judge.update_pins` can update. The bound of an inequality is a
requirement, which is never updated.
"""

import json
from pathlib import Path
from typing import Any

from study.run.store import StudyError

PINS_FILE = Path(__file__).with_name("pins.json")

Pin = dict[str, Any]
"""Pin with the keys id, source, statement, measure, args, relation, bound, tolerance and unit.

A pin whose statement is known to fail also contains the number found instead and its tolerance.
"""

_REQUIRED_KEYS = {"id", "source", "statement", "measure", "args", "relation", "bound", "tolerance"}
_OPTIONAL_KEYS = {"unit", "found", "found_tolerance"}


def load_pins(path: Path = PINS_FILE) -> list[Pin]:
    """Read the recorded numbers with their statements from a JSON file.

    Raises:
        StudyError: if the table cannot be read, or if a pin has missing or unknown keys.
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
