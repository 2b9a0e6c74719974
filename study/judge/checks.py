"""Checks of pages, which are statements of this study that are each judged by one number."""

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
    """Statement of this study with the number and the bound by which it is judged.

    See `check` for the meaning of the fields.
    """

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
    """Return a check that states a finding of a page.

    The report and the site print the finding, and a test with the name of the check verifies it.

    Args:
        id: name of the check, which begins with the section, such as "V2-edge".
        statement: the finding, as a sentence.
        measure: function that computes the number from stored results.
        relation: relation between the number and the bound that the finding states.
        bound: value with which the number is compared.
        why: explanation of the finding.
        tolerance: absolute tolerance in favour of the statement.
        tolerance_why: justification of the tolerance.
        tolerance_set: whether bound and tolerance were set before or after the first value was
            seen, if this is known.
        unit: unit of the number, the bound and the tolerance.

    Raises:
        StudyError: if the relation is unknown, the bound or the tolerance is not finite, or the
            tolerance is negative.
    """
    if relation not in RELATIONS:
        raise StudyError(f"check {id}: relation {relation!r} is none of {', '.join(RELATIONS)}")
    if not (math.isfinite(bound) and 0 <= tolerance < math.inf):
        raise StudyError(f"check {id}: bound {bound} and tolerance {tolerance} have to be finite")
    optional_fields = (tolerance, tolerance_why, tolerance_set, unit)
    return Check(id, statement, measure, relation, float(bound), why, *optional_fields)


def load_checks_of_section_page(section: str) -> list[Check]:
    """Import the page module of a section and return the checks that it defines."""
    return list(getattr(import_module(SECTIONS[section]), "CHECKS", ()))
