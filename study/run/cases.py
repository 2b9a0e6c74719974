"""Define sections and cases of the study, and compute fingerprints that detect outdated results."""

import hashlib
import inspect
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from study.run import records
from study.run.pages import find_module_of_each_section, read_literal_constants
from study.run.provenance import package_versions
from study.run.sources import (
    digest_code_used_by_definition,
    digest_code_without_docstrings,
    find_source_file,
    list_package_sources,
)
from study.run.store import Result, StudyError

SECTIONS = find_module_of_each_section()
"""Module of each section, by name of section in the order of the report.

Each module defines the constants `TITLE` and `CASES`.
"""


@dataclass(frozen=True)
class Case:
    """Definition of one computation of the study, which gives one stored result.

    Attributes:
        section: Name of the section that contains the case.
        name: Name of the case within its section, and of the file of its result.
        run: Function that computes the result. It must be defined at the top level of a module,
            because worker processes import it.
        parameters: Keyword arguments of `run`, which must be representable in JSON.
        implied_parameters: Further parameters that are stored with the result but not passed to
            `run`, such as the element on which a computed quantity depends.
        costly: Whether the case may take more than three CPU seconds. The result of a costly case
            is read from the records in version control if it is there, see `study.run.records`.
        record: File from which the result is read, relative to the project's folder; empty if the
            result is computed.
        computing_case: Case with the same key that computes the result instead of reading it; None
            if this case itself computes its result.
    """

    section: str
    name: str
    run: Callable[..., Result]
    parameters: dict[str, Any] = field(default_factory=dict)
    implied_parameters: dict[str, Any] = field(default_factory=dict)
    costly: bool = False
    record: str = ""
    computing_case: "Case | None" = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"\w[\w.+-]*", self.name):
            raise ValueError(f"{self.name!r} cannot be the name of a case: it names its file")

    @property
    def key(self) -> str:
        """Section and name of the case, such as "7.1/pw-T6"."""
        return f"{self.section}/{self.name}"

    @property
    def stored_parameters(self) -> dict[str, Any]:
        """All parameters that are stored with the result, converted to JSON types.

        They are the name of the function `run` (as "problem"), its arguments including defaults,
        and the implied parameters.
        """
        bound = inspect.signature(self.run).bind(**self.parameters)
        bound.apply_defaults()
        parameters = {"problem": self.run.__name__, **bound.arguments, **self.implied_parameters}
        return dict(json.loads(json.dumps(parameters, allow_nan=False)))


@dataclass(frozen=True)
class Section:
    """Section of the study, which corresponds to one page.

    Attributes:
        id: Name of the section, such as "7.1" or "V3".
        title: Title.
        cases: Cases; recorded ones read their results.
    """

    id: str
    title: str
    cases: list[Case]


def mark_costly(cases: Iterable[Case], *patterns: str) -> list[Case]:
    """Mark cases whose names match a pattern as costly.

    Args:
        cases: All cases of a page, or some of them.
        patterns: Shell-style patterns such as "*-pw-Q8". If none is given, all cases are marked.

    Returns:
        All cases in their order, marked or not.
    """
    return [
        replace(case, costly=True)
        if not patterns or any(fnmatchcase(case.name, pattern) for pattern in patterns)
        else case
        for case in cases
    ]


def load_section(section: str) -> Section:
    """Import the page of a section, which imports the solver, and return the section.

    Costly cases are replaced by cases that read the record, if it has the same parameters.

    Raises:
        StudyError: If the page cannot be imported, if two of its cases have the same name, or if a
            case belongs to another section.
    """
    name = _page_module_name(section)
    try:
        module = import_module(name)
    except ImportError as error:
        raise StudyError(f"section {section} cannot be loaded: {error}") from error
    cases = list(module.CASES)
    names = [case.name for case in cases]
    repeated = sorted({name for name in names if names.count(name) > 1})
    of_other_sections = [case.key for case in cases if case.section != section]
    if unsuitable := repeated + of_other_sections:
        reason = "names twice, or other sections"
        raise StudyError(f"{name} has unsuitable cases ({reason}): {', '.join(unsuitable)}")
    return Section(section, module.TITLE, [_replace_by_record_if_valid(case) for case in cases])


def _replace_by_record_if_valid(case: Case) -> Case:
    row = records.read_rows(records.COSTLY_CASES).get(case.key) if case.costly else None
    if row is None or row.input_sha256 != records.digest_input(case.stored_parameters):
        return case
    content = row.content
    return Case(
        case.section,
        case.name,
        records.recorded,
        {"measured": content["scalars"], "units": content["units"], "dofs": content["dofs"]},
        case.stored_parameters,
        record=records.path_relative_to_project(records.COSTLY_CASES),
        computing_case=case,
    )


def title(section: str) -> str:
    """Read the title of a section from its page, without importing the page.

    Raises:
        StudyError: If the page has no title.
    """
    constants = read_literal_constants(find_page_source(section))
    if "TITLE" not in constants:
        raise StudyError(f"{find_page_source(section)} has no TITLE")
    return str(constants["TITLE"])


def find_page_source(section: str) -> Path:
    """Return the source file of a section's page.

    Raises:
        StudyError: If there is no such section or file.
    """
    name = _page_module_name(section)
    path = find_source_file(name)
    if path is None:
        raise StudyError(f"section {section} has no module {name}")
    return path


def compute_fingerprints(cases: Iterable[Case]) -> dict[str, str]:
    """Compute a digest of everything that the result of each case depends on, by key of the case.

    It covers the parameters, the library, the code that the function of the case uses, and the
    versions of the packages. Of the function's own module, only the definitions that the function
    uses count, so that changes to texts, checks and figures of a page do not make its results
    outdated. Of other modules, all code except comments, docstrings and layout counts.
    """
    digest_code_once = cache(_digest_library_and_used_code)
    digests = {}
    for case in cases:
        parameters = [case.key, case.stored_parameters, package_versions()]
        digest = hashlib.sha256(json.dumps(parameters, sort_keys=True).encode())
        digest.update(
            digest_code_once(case.run.__module__, case.run.__qualname__.partition(".")[0])
        )
        digests[case.key] = digest.hexdigest()
    return digests


def _digest_library_and_used_code(module: str, function: str) -> bytes:
    """Return names and digests of the library's sources and of the code that a function uses.

    Args:
        module: Full name of the function's module.
        function: Name of the function.

    Returns:
        One line per module.
    """
    library = {
        path.name: digest_code_without_docstrings(path)
        for path in list_package_sources("pw_elements")
    }
    used = digest_code_used_by_definition(module, function, frozenset({__name__}))
    return "".join(f"\n{name} {digest}" for name, digest in (library | used).items()).encode()


def _page_module_name(section: str) -> str:
    if section not in SECTIONS:
        raise StudyError(f"there is no section {section}, but {', '.join(SECTIONS)}")
    return SECTIONS[section]
