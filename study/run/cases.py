"""Sections and cases of the study, and fingerprints that show whether a result is outdated."""

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
from study.run.pages import find_pages, read_constants
from study.run.provenance import package_versions
from study.run.sources import digest_code, digest_reached_sources, find_source, list_package_sources
from study.run.store import Result, StudyError

SECTIONS = find_pages()
"""Module of each section, in the order of the report; each module defines `TITLE` and `CASES`."""


@dataclass(frozen=True)
class Case:
    """Computation of one result.

    Attributes:
        section: Name of the section that contains the case.
        name: Name of the case in its section, also used as the name of its file.
        run: Function that computes the result. It must be defined at the top level of a module,
            because worker processes import it.
        parameters: Keyword arguments of `run`, which must be representable in JSON.
        implied: Further parameters to store with the result, such as the element of a named
            quantity or the material of a named setting.
        costly: Whether the case may take more than three CPU seconds. The result of a costly case
            is read from its record if there is one, see `study.run.records`.
        record: Tracked file from which the result is read, relative to the project's folder; empty
            if the result is computed.
        recomputed: Case with the same key that computes the result instead of reading it from the
            record; None if the result is not recorded.
    """

    section: str
    name: str
    run: Callable[..., Result]
    parameters: dict[str, Any] = field(default_factory=dict)
    implied: dict[str, Any] = field(default_factory=dict)
    costly: bool = False
    record: str = ""
    recomputed: "Case | None" = field(default=None, repr=False)

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

        They comprise `problem` (the name of the function that computes the result), the function's
        arguments including defaults, and the implied parameters.
        """
        bound = inspect.signature(self.run).bind(**self.parameters)
        bound.apply_defaults()
        parameters = {"problem": self.run.__name__, **bound.arguments, **self.implied}
        return dict(json.loads(json.dumps(parameters, allow_nan=False)))


@dataclass(frozen=True)
class Section:
    """Section of the study with its title and cases."""

    id: str
    title: str
    cases: list[Case]


def mark_costly(cases: Iterable[Case], *patterns: str) -> list[Case]:
    """Return the cases, with those whose names match one of the patterns marked as costly.

    Args:
        cases: All cases of a page, or some of them.
        patterns: Shell-style patterns such as "*-pw-Q8". If none is given, all cases are marked.
    """
    return [
        replace(case, costly=True)
        if not patterns or any(fnmatchcase(case.name, pattern) for pattern in patterns)
        else case
        for case in cases
    ]


def load_section(section: str) -> Section:
    """Import the page of a section, which also imports the solver, and return the section.

    Costly cases are replaced by their records if these have the same parameters.
    """
    name = _module_name(section)
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
    return Section(section, module.TITLE, [_use_record(case) for case in cases])


def _use_record(case: Case) -> Case:
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
        record=records.name_in_project(records.COSTLY_CASES),
        recomputed=case,
    )


def title(section: str) -> str:
    """Return a section's title without importing its page."""
    constants = read_constants(find_page_source(section))
    if "TITLE" not in constants:
        raise StudyError(f"{find_page_source(section)} has no TITLE")
    return str(constants["TITLE"])


def find_page_source(section: str) -> Path:
    """Return the source file of a section's page."""
    name = _module_name(section)
    path = find_source(name)
    if path is None:
        raise StudyError(f"section {section} has no module {name}")
    return path


def compute_fingerprints(cases: Iterable[Case]) -> dict[str, str]:
    """Return, for the key of each case, a digest of everything that its result depends on.

    The digest covers the parameters, the library, the code that the case's function uses, and the
    versions of the packages. In the function's own module, only the definitions that the function
    uses are included, and therefore changes to texts, checks and figures on the same page do not
    outdate results. Of other modules, all code except comments and layout is included.
    """
    digest_code_once = cache(_digest_code)
    digests = {}
    for case in cases:
        parameters = [case.key, case.stored_parameters, package_versions()]
        digest = hashlib.sha256(json.dumps(parameters, sort_keys=True).encode())
        digest.update(
            digest_code_once(case.run.__module__, case.run.__qualname__.partition(".")[0])
        )
        digests[case.key] = digest.hexdigest()
    return digests


def _digest_code(module: str, function: str) -> bytes:
    """Return names and digests of the library's sources and of the code that a function uses."""
    library = {path.name: digest_code(path) for path in list_package_sources("pw_elements")}
    used = digest_reached_sources(module, function, frozenset({__name__}))
    return "".join(f"\n{name} {digest}" for name, digest in (library | used).items()).encode()


def _module_name(section: str) -> str:
    if section not in SECTIONS:
        raise StudyError(f"there is no section {section}, but {', '.join(SECTIONS)}")
    return SECTIONS[section]
