"""Which stored results a measure looks at."""

import re
from collections.abc import Mapping
from typing import Any

from study.run.store import MissingResult, Results, StoredResult

T6 = ("galerkin-T6", "pw-T6")

_OF_A_RECORD = ("measured", "units", "dofs")  # what a tracked result has besides

# Parameters and their values, see `StoredResult.has`, or a regular expression for the cases' names
Selection = Mapping[str, Any] | str


def of_section(results: Results, section: str) -> list[StoredResult]:
    """All results of a section; `MissingResult` if there are none."""
    found = results.section(section)
    if not found:
        raise MissingResult(f"there are no results of section {section}: run ./run study {section}")
    return found


def matching(results: Results, section: str, cases: Selection) -> list[StoredResult]:
    """Results of the cases with some parameters, or names; `MissingResult` if there are none."""
    found = [s for s in of_section(results, section) if _selects(cases, s)]
    if not found:
        raise MissingResult(f"no result of section {section} matches {cases}")
    return found


def like(results: Results, stored: StoredResult, **others: object) -> StoredResult:
    """The result of the same section whose parameters differ in these alone."""
    same = {name: value for name, value in stored.parameters.items() if name not in _OF_A_RECORD}
    (found,) = matching(results, stored.section, {**same, **others})[:1]
    return found


def _selects(cases: Selection, stored: StoredResult) -> bool:
    if isinstance(cases, str):
        return re.fullmatch(cases, stored.case) is not None
    return stored.has(**cases)
