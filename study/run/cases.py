"""Sections of the study, their cases, and when a stored result of a case still holds."""

import ast
import hashlib
import inspect
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from study.run.provenance import versions
from study.run.sources import closure, code_digest, package_sources, source
from study.run.store import Result, StudyError

SECTIONS = {
    "I": "study.paper.i_introduction",
    "3": "study.paper.s3_weight_functions",
    "5": "study.paper.s5_condensation",
    "7.1": "study.paper.s7_1_two_triangles",
    "7.2": "study.paper.s7_2_block",
    "7.3": "study.paper.s7_3_parabolic_punch",
    "7.4": "study.paper.s7_4_rigid_plate",
    "7.5": "study.paper.s7_5_column",
    "7.6": "study.paper.s7_6_buckling",
    "T": "study.verification.t_identity",
    "C": "study.verification.c_convergence",
    "V1": "study.verification.v1_contact_patch",
    "V2": "study.verification.v2_hertz",
    "V3": "study.verification.v3_flat_punch",
    "V4": "study.verification.v4_spence",
    "V5": "study.verification.v5_cattaneo",
    "V6": "study.verification.v6_greco",
    "V7": "study.verification.v7_wedge",
    "V8": "study.verification.v8_vibration",
    "V9": "study.verification.v9_explicit",
    "V10": "study.verification.v10_space",
    "V11": "study.verification.v11_two_bodies",
    "V12": "study.verification.v12_impact",
    "V13": "study.verification.v13_fluxes",
    "V14": "study.verification.v14_rubber",
    "V15": "study.verification.v15_rubber",
    "V16": "study.verification.v16_sliding",
    "V17": "study.verification.v17_bodies",
    "Q": "study.rivals.q_compare",
    "W": "study.engineering.w_engineering",
    "P": "study.peers.p_compare",
    "K": "study.cost.k_cost",
}
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
        record: Tracked file from which the result is read, relative to the project's folder; empty
            if the result is computed.
        recomputed: Case of the same key that computes a recorded result; None if there is none.
    """

    section: str
    name: str
    run: Callable[..., Result]
    parameters: dict[str, Any] = field(default_factory=dict)
    implied: dict[str, Any] = field(default_factory=dict)
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


def load_section(section: str) -> Section:
    """Import a section's module, and with it what it computes with."""
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
    return Section(section, module.TITLE, cases)


def title(section: str) -> str:
    """Return a section's title without importing its module, which the report must not do."""
    name = _module(section)
    path = source(name)
    if path is None:
        raise StudyError(f"section {section} has no module {name}")
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if any(isinstance(target, ast.Name) and target.id == "TITLE" for target in targets):
            assert isinstance(node, ast.Assign)
            return str(ast.literal_eval(node.value))
    raise StudyError(f"{path} has no TITLE")


def fingerprints(cases: Iterable[Case]) -> dict[str, str]:
    """Return, by keys, digests of all that the cases' results depend on.

    That is their parameters, the library, the modules of the study that their own imports lead to,
    and the packages' versions. Of sources it is the code that counts, neither comments nor layout.
    This module is left out: a section added to its table changes no other.
    """
    code = cache(_code)  # sources are read once, now
    found = {}
    for case in cases:
        stated = [case.key, case.stored_parameters, versions()]
        digest = hashlib.sha256(json.dumps(stated, sort_keys=True).encode())
        digest.update(code(_module(case.section), case.run.__module__))
        found[case.key] = digest.hexdigest()
    return found


def _code(*modules: str) -> bytes:
    """Return names and digests of the library's sources and those that modules lead to."""
    own: dict[str, Path] = {}
    for module in modules:
        own |= closure(module, frozenset({__name__}))
    paths = [*package_sources("pw_elements"), *own.values()]
    return "".join(f"\n{path.name} {code_digest(path)}" for path in paths).encode()


def _module(section: str) -> str:
    if section not in SECTIONS:
        raise StudyError(f"there is no section {section}, but {', '.join(SECTIONS)}")
    return SECTIONS[section]
