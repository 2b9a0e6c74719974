"""Checks of a page: statements of this study, each judged by one number."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

from study.run.cases import SECTIONS
from study.run.store import Results, StudyError

Relation = Literal["=", "<", "<=", ">", ">="]
RELATIONS: dict[str, Callable[[float, float, float], bool]] = {
    "=": lambda measured, bound, tolerance: abs(measured - bound) <= tolerance,
    "<": lambda measured, bound, tolerance: measured < bound + tolerance,
    "<=": lambda measured, bound, tolerance: measured <= bound + tolerance,
    ">": lambda measured, bound, tolerance: measured > bound - tolerance,
    ">=": lambda measured, bound, tolerance: measured >= bound - tolerance,
}


@dataclass(frozen=True)
class Check:
    """A statement of this study and the number that it is judged by; see `check`."""

    id: str
    statement: str
    measure: Callable[[Results], float]
    relation: Relation
    bound: float
    why: str
    tolerance: float = 0.0
    tolerance_why: str = ""
    tolerance_set: Literal["before", "after"] | None = None
    unit: str = ""


def check(
    id: str,
    statement: str,
    measure: Callable[[Results], float],
    relation: Relation,
    bound: float,
    *,
    why: str,
    tolerance: float = 0.0,
    tolerance_why: str = "",
    tolerance_set: Literal["before", "after"] | None = None,
    unit: str = "",
) -> Check:
    """State what a page finds: report and site print it, and a test of this name checks it.

    Args:
        id: name of the check, section first: "V2-edge".
        statement: what is found, as a sentence.
        measure: returns the number from stored results.
        relation: how the number compares with the bound.
        bound: what it is compared with.
        why: explanation of the finding.
        tolerance: absolute, in favour of the statement.
        tolerance_why: where the tolerance comes from.
        tolerance_set: whether bound and tolerance were set before or after the first value was
            seen, if this is known.
        unit: unit of the number, the bound and the tolerance.

    Raises:
        StudyError: if the relation is unknown, or a number is not finite.
    """
    if relation not in RELATIONS:
        raise StudyError(f"check {id}: relation {relation!r} is none of {', '.join(RELATIONS)}")
    if not (math.isfinite(bound) and 0 <= tolerance < math.inf):
        raise StudyError(f"check {id}: bound {bound} and tolerance {tolerance} have to be finite")
    optional_fields = (tolerance, tolerance_why, tolerance_set, unit)
    return Check(id, statement, measure, relation, float(bound), why, *optional_fields)


def load_checks(section: str) -> list[Check]:
    """Import the page of a section and return its checks."""
    return list(getattr(import_module(SECTIONS[section]), "CHECKS", ()))
