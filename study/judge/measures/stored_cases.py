"""Selection of the stored results that a measure uses."""

import re
from collections.abc import Mapping
from typing import Any

from study.run.store import MissingResult, Results, StoredResult

T6_ELEMENTS = ("galerkin-T6", "pw-T6")

_RECORD_PARAMETERS = ("measured", "units", "dofs")  # added if read from records

# Values of parameters, see `StoredResult.has`, or a regular expression for the names of cases
Selection = Mapping[str, Any] | str


def load_section_results(results: Results, section: str) -> list[StoredResult]:
    """Return all results of a section; raise MissingResult if there are none."""
    stored_results = results.section(section)
    if not stored_results:
        raise MissingResult(f"there are no results of section {section}: run ./run study {section}")
    return stored_results


def select_results(results: Results, section: str, cases: Selection) -> list[StoredResult]:
    """Return the results of matching cases; raise MissingResult if there are none."""
    stored_results = [
        stored
        for stored in load_section_results(results, section)
        if _matches_selection(cases, stored)
    ]
    if not stored_results:
        raise MissingResult(f"no result of section {section} matches {cases}")
    return stored_results


def find_result_with_changed_parameters(
    results: Results, stored: StoredResult, **changed_parameters: object
) -> StoredResult:
    """Return the result of the same section with the same parameters except for the given ones."""
    parameters = {
        name: value for name, value in stored.parameters.items() if name not in _RECORD_PARAMETERS
    }
    (variant,) = select_results(results, stored.section, {**parameters, **changed_parameters})[:1]
    return variant


def _matches_selection(cases: Selection, stored: StoredResult) -> bool:
    if isinstance(cases, str):
        return re.fullmatch(cases, stored.case) is not None
    return stored.has(**cases)
