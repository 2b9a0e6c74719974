"""Compare the pins with stored results, and update the recorded numbers on request.

./run python3 -m study.judge.update_pins            show pins that the stored results contradict
./run python3 -m study.judge.update_pins --update   ... and record the new numbers
"""

import argparse
import sys
from pathlib import Path

from study.judge import claims
from study.judge.pins import PINS_FILE, Pin, load_pins
from study.run.store import Results, write_json


def main(arguments: list[str] | None = None) -> int:
    """Print the pins that contradict the stored results; with --update, record the new numbers.

    Returns:
        1 if any pin differs, otherwise 0.
    """
    parser = argparse.ArgumentParser(prog="study.judge.update_pins")
    parser.add_argument("results", nargs="?", type=Path, default=Path("results"))
    parser.add_argument("--update", action="store_true", help="record the numbers found")
    parsed_arguments = parser.parse_args(arguments)
    pins = load_pins()
    verdicts = {
        verdict.claim.id: verdict
        for verdict in claims.judge_claims(
            claims.claims_from_pins(pins), Results(parsed_arguments.results)
        )
    }
    differing = [verdict for verdict in verdicts.values() if verdict.differs]
    print(claims.format_verdict_table(differing) or "no pin differs\n", end="")
    if parsed_arguments.update:
        write_json(
            PINS_FILE, [_update_recorded_number(pin, verdicts[pin["id"]].measured) for pin in pins]
        )
    return int(bool(differing))


def _update_recorded_number(pin: Pin, measured: float | None) -> Pin:
    if measured is None:
        return pin
    if "found" in pin:
        return (
            pin | {"found": measured}
            if _differs_from_recorded_number(pin, "found", measured)
            else pin
        )
    if pin["relation"] == "=" and _differs_from_recorded_number(pin, "bound", measured):
        return pin | {"bound": measured}
    return pin


def _differs_from_recorded_number(pin: Pin, name: str, measured: float) -> bool:
    tolerance = pin["found_tolerance"] if name == "found" else pin["tolerance"]
    return bool(abs(measured - pin[name]) > tolerance)


if __name__ == "__main__":
    sys.exit(main())
