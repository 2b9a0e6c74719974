"""Sections of the study, their cases, and when a stored result of a case still holds."""

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
from study.run.provenance import versions
from study.run.sources import code_digest, package_sources, reached_sources, source
from study.run.store import Result, StudyError

SECTIONS = find_pages()
"""Each section's module, with `TITLE: str` and `CASES: list[Case]`; in the order of the report."""


@dataclass(frozen=True)
class Case:
    """One computation with one result.

    Attributes:
        section: The section it belongs to.
        name: Its name there, which is its file name too.
        run: Function of a module (workers import it), called with the parameters.
        parameters: Keyword arguments, of types that JSON has.
        implied: What else is stored as a parameter, because the name or an argument implies it:
            the element of a named quantity, the material of a named setting.
        costly: Whether the case may take more than three CPU seconds; its result is then read from
            the record of `study.run.records`, if it is there.
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
        """All parameters of the result as JSON gives them back.

        They are the `problem`, which is the name of the function that computes it, the arguments
        of that function with its defaults, and what is implied.
        """
        bound = inspect.signature(self.run).bind(**self.parameters)
        bound.apply_defaults()
        every = {"problem": self.run.__name__, **bound.arguments, **self.implied}
        return dict(json.loads(json.dumps(every, allow_nan=False)))


@dataclass(frozen=True)
class Section:
    """A section with its cases."""

    id: str
    title: str
    cases: list[Case]


def mark_costly(cases: Iterable[Case], *patterns: str) -> list[Case]:
    """Return the cases, marked as costly where the name is like one of the patterns.

    Args:
        cases: all cases of a page, or some of them.
        patterns: as in a shell, such as "*-pw-Q8"; without any, all cases are marked.
    """
    return [
        replace(case, costly=True)
        if not patterns or any(fnmatchcase(case.name, pattern) for pattern in patterns)
        else case
        for case in cases
    ]


def load_section(section: str) -> Section:
    """Import a section's page, and with it what it computes with.

    A costly case is read from its record, if this was made with the same parameters.
    """
    name = _module(section)
    try:
        module = import_module(name)
    except ImportError as error:
        raise StudyError(f"section {section} cannot be loaded: {error}") from error
    cases = list(module.CASES)
    names = [case.name for case in cases]
    twice = sorted({name for name in names if names.count(name) > 1})
    strange = [case.key for case in cases if case.section != section]
    if twice or strange:
        raise StudyError(f"{name} has unsuitable cases: {', '.join(twice + strange)}")
    return Section(section, module.TITLE, [_from_record(case) for case in cases])


def _from_record(case: Case) -> Case:
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
    constants = read_constants(page_source(section))
    if "TITLE" not in constants:
        raise StudyError(f"{page_source(section)} has no TITLE")
    return str(constants["TITLE"])


def page_source(section: str) -> Path:
    """Return the source file of a section's page."""
    name = _module(section)
    path = source(name)
    if path is None:
        raise StudyError(f"section {section} has no module {name}")
    return path


def fingerprints(cases: Iterable[Case]) -> dict[str, str]:
    """Return, by keys, digests of all that the cases' results depend on.

    That is their parameters, the library, the code that the function of the case reaches, and the
    packages' versions. Of the function's own module only definitions count that it leads to, by
    their names; so texts, checks and figures on the same page change no result. Of other modules
    all code counts, but neither comments nor layout.
    """
    code = cache(_code)  # sources are read once, now
    digests = {}
    for case in cases:
        stated = [case.key, case.stored_parameters, versions()]
        digest = hashlib.sha256(json.dumps(stated, sort_keys=True).encode())
        digest.update(code(case.run.__module__, case.run.__qualname__.partition(".")[0]))
        digests[case.key] = digest.hexdigest()
    return digests


def _code(module: str, function: str) -> bytes:
    """Return names and digests of the library's sources and of what a function leads to."""
    library = {path.name: code_digest(path) for path in package_sources("pw_elements")}
    reached = reached_sources(module, function, frozenset({__name__}))
    return "".join(f"\n{name} {digest}" for name, digest in (library | reached).items()).encode()


def _module(section: str) -> str:
    if section not in SECTIONS:
        raise StudyError(f"there is no section {section}, but {', '.join(SECTIONS)}")
    return SECTIONS[section]
