"""Sections and cases of the study, and fingerprints that tell whether a result is outdated."""

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
"""Names of the sections' modules, which have `TITLE` and `CASES`, in the order of the report."""


@dataclass(frozen=True)
class Case:
    """Computation of one result.

    Attributes:
        section: The section it belongs to.
        name: Its name in the section, and of its file.
        run: Function of a module (worker processes import it), called with the parameters.
        parameters: Keyword arguments, of types that JSON has.
        implied: Further stored parameters, which the name or an argument implies: the element of a
            named quantity, the material of a named setting.
        costly: Whether the case may take more than three CPU seconds; its result is then read from
            the record, see `study.run.records`, if it has one.
        record: Tracked file from which the result is read, relative to the project's folder; empty
            if the result is computed.
        recomputed: Case of the same key that computes a recorded result; None if there is none.
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
        """Section and name, as in "7.1/pw-T6"."""
        return f"{self.section}/{self.name}"

    @property
    def stored_parameters(self) -> dict[str, Any]:
        """All parameters that are stored with the result, with types of JSON.

        They are the `problem`, which is the name of the function that computes the result, its
        arguments with defaults, and the implied parameters.
        """
        bound = inspect.signature(self.run).bind(**self.parameters)
        bound.apply_defaults()
        parameters = {"problem": self.run.__name__, **bound.arguments, **self.implied}
        return dict(json.loads(json.dumps(parameters, allow_nan=False)))


@dataclass(frozen=True)
class Section:
    """Section with its cases."""

    id: str
    title: str
    cases: list[Case]


def mark_costly(cases: Iterable[Case], *patterns: str) -> list[Case]:
    """Return the cases, marked as costly where the name matches one of the patterns.

    Args:
        cases: All cases of a page, or some of them.
        patterns: Patterns as in a shell, such as "*-pw-Q8"; without any, all cases are marked.
    """
    return [
        replace(case, costly=True)
        if not patterns or any(fnmatchcase(case.name, pattern) for pattern in patterns)
        else case
        for case in cases
    ]


def load_section(section: str) -> Section:
    """Import the page of a section, and with it the solver.

    A costly case is read from its record, if this has the same parameters.
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
    """Return, by keys of cases, digests of all that the results depend on.

    That is the parameters, the library, the code that the function of the case uses, and the
    versions of packages. In the module of the function only definitions count that it uses; so
    texts, checks and figures on the same page do not outdate results. Of other modules all code
    counts, but neither comments nor layout.
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
