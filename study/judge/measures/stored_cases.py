"""Which stored results a measure looks at."""

import re
from collections.abc import Mapping
from typing import Any

from study.core.store import MissingResult, Results, Stored

T6 = ("galerkin-T6", "pw-T6")

# Parameters and their values, see `Stored.has`, or a regular expression for the cases' names
Selection = Mapping[str, Any] | str


def of_section(results: Results, section: str) -> list[Stored]:
    """All results of a section; `MissingResult` if there are none."""
    found = results.section(section)
    if not found:
        raise MissingResult(f"there are no results of section {section}: run ./run study {section}")
    return found


def matching(results: Results, section: str, cases: Selection) -> list[Stored]:
    """Results of the cases with some parameters, or names; `MissingResult` if there are none."""
    found = [s for s in of_section(results, section) if _selects(cases, s)]
    if not found:
        raise MissingResult(f"no result of section {section} matches {cases}")
    return found


def like(results: Results, stored: Stored, **others: object) -> Stored:
    """The result of the same section whose parameters differ in these alone."""
    (found,) = matching(results, stored.section, {**stored.parameters, **others})[:1]
    return found


def _selects(cases: Selection, stored: Stored) -> bool:
    if isinstance(cases, str):
        return re.fullmatch(cases, stored.case) is not None
    return stored.has(**cases)
