"""Which stored results a measure looks at."""

import re

from study.core.store import MissingResult, Results, Stored

T6 = ("galerkin-T6", "pw-T6")


def of_section(results: Results, section: str) -> list[Stored]:
    """All results of a section; `MissingResult` if there are none."""
    found = results.section(section)
    if not found:
        raise MissingResult(f"there are no results of section {section}: run ./run study {section}")
    return found


def matching(results: Results, section: str, cases: str) -> list[Stored]:
    """Results of cases whose names match a regular expression; `MissingResult` if none does."""
    found = [s for s in of_section(results, section) if re.fullmatch(cases, s.case)]
    if not found:
        raise MissingResult(f"no result of section {section} matches {cases}")
    return found
