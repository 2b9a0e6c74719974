"""The paper's checkable statements, and whether the stored results bear them out."""

import inspect
import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from study.core.store import MissingResult, Results, StudyError, write_json

CLAIMS = Path(__file__).with_name("claims.toml")

RELATIONS: dict[str, Callable[[float, float, float], bool]] = {
    "=": lambda measured, value, tol: abs(measured - value) <= tol,
    "<": lambda measured, value, tol: measured < value + tol,
    "<=": lambda measured, value, tol: measured <= value + tol,
    ">": lambda measured, value, tol: measured > value - tol,
    ">=": lambda measured, value, tol: measured >= value - tol,
}
PINNED = ("holds", "fails")

TEXTS = ("id", "source", "statement", "measure", "relation", "tol_why", "pinned", "why")
NUMBERS = ("value", "tol")
FOUND = ("found", "found_tol")
OPTIONAL = ("args", "unit")

Outcome = Literal["holds", "fails", "not judged"]


@dataclass(frozen=True)
class Claim:
    """A statement, and how it is judged: `measured relation value`, within `tol`.

    Attributes:
        id: Its name.
        source: Where the paper says it.
        statement: What it says.
        relation: One of `RELATIONS`.
        value: What the measure is compared with.
        tol: Absolute tolerance, in favour of the claim.
        tol_why: Where the tolerance comes from.
        pinned: The verdict that is expected.
        why: The reason of that verdict.
        measure: Name of a function of `study.judge.measures`.
        function: The function itself.
        args: Its keyword arguments.
        unit: Unit of measure, value and tolerances.
        found: What is measured where the statement fails: a finding, pinned like the verdict.
        found_tol: How far from it still counts as the same.
    """

    id: str
    source: str
    statement: str
    relation: str
    value: float
    tol: float
    tol_why: str
    pinned: str
    why: str
    measure: str
    function: Callable[..., float] = field(repr=False, compare=False)
    args: dict[str, Any] = field(default_factory=dict)
    unit: str = ""
    found: float | None = None
    found_tol: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """A claim with what was measured; None if a result is missing."""

    claim: Claim
    measured: float | None
    verdict: Outcome

    @property
    def differs(self) -> bool:
        """Whether verdict or finding are not the pinned ones."""
        return self.verdict != self.claim.pinned or self._found_another()

    @property
    def expected(self) -> str:
        """The pinned verdict, with the pinned finding where the statement fails."""
        found = self.claim.found
        if found is None:
            return self.claim.pinned
        return f"{self.claim.pinned} with {found:.6g} ± {self.claim.found_tol:.3g}"

    def _found_another(self) -> bool:
        found = self.claim.found
        if found is None or self.measured is None:
            return False
        return abs(self.measured - found) > self.claim.found_tol


def load_claims(path: Path = CLAIMS, measures: ModuleType | None = None) -> list[Claim]:
    """Read and check the claims.

    Args:
        path: The file.
        measures: Module of the measures; `study.judge.measures` if not given.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path} cannot be read: {error}") from None
    tables = content.pop("claim", [])
    if content or not isinstance(tables, list):
        raise StudyError(f"{path} may have nothing but tables [[claim]]")
    if measures is None:
        measures = import_module("study.judge.measures")
    claims = [_claim(table, place, measures) for place, table in enumerate(tables, start=1)]
    ids = [claim.id for claim in claims]
    for twice in (name for name in ids if ids.count(name) > 1):
        raise StudyError(f"claim {twice}: its id occurs more than once")
    return claims


def judge(claims: list[Claim], results: Results) -> list[Verdict]:
    """Compare each claim with the stored results."""
    return [_judged(claim, results) for claim in claims]


def write(out: Path, verdicts: list[Verdict]) -> None:
    """Write `<out>/claims.json`."""
    rows = [
        {
            "id": claim.id,
            "source": claim.source,
            "statement": claim.statement,
            "measured": verdict.measured,
            "relation": claim.relation,
            "value": claim.value,
            "tol": claim.tol,
            "verdict": verdict.verdict,
            "pinned": verdict.expected,
            "differs": verdict.differs,
            "why": claim.why,
            "unit": claim.unit,
            "tol_why": claim.tol_why,
        }
        for verdict in verdicts
        for claim in [verdict.claim]
    ]
    write_json(Path(out) / "claims.json", rows)


def table(verdicts: list[Verdict]) -> str:
    """Return the verdicts as lines of text, one per claim, each ending the line."""
    rows = [
        (
            verdict.claim.id,
            "" if verdict.measured is None else f"{verdict.measured:.6g}",
            f"{verdict.claim.relation} {verdict.claim.value:.6g} ± {verdict.claim.tol:.3g}",
            f"{verdict.verdict}, pinned: {verdict.expected}",
        )
        for verdict in verdicts
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "".join(f"{line}\n" for line in lines)


def summary(verdicts: list[Verdict]) -> str:
    """Return the verdicts' counts in one line."""
    outcomes: list[str] = [verdict.verdict for verdict in verdicts]
    counts = [f"{outcomes.count(name)} {name}" for name in dict.fromkeys((*PINNED, *outcomes))]
    differing = sum(verdict.differs for verdict in verdicts if verdict.verdict != "not judged")
    return f"{len(verdicts)} claims: {', '.join(counts)}; {differing} other than pinned"


def _claim(table: dict[str, Any], place: int, measures: ModuleType) -> Claim:
    name = table.get("id", f"number {place}")

    def wrong(key: str, what: str) -> StudyError:
        return StudyError(f"claim {name}: {key} {what}")

    for key in table:
        if key not in (*TEXTS, *NUMBERS, *FOUND, *OPTIONAL):
            raise wrong(key, "is not a key of claims")
    findings = FOUND if table.get("pinned") == "fails" else ()
    for key in (*TEXTS, *NUMBERS, *findings):
        if key not in table:
            raise wrong(key, "is missing")
    for key in (*TEXTS, "unit"):
        if not isinstance(table.get(key, ""), str) or (key in TEXTS and not table[key].strip()):
            raise wrong(key, "is no text")
    for key in (*NUMBERS, *findings):
        number = table[key]
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise wrong(key, "is no number")
        if not math.isfinite(number) or (key in ("tol", "found_tol") and number < 0):
            raise wrong(key, f"cannot be {number}")
    if table["relation"] not in RELATIONS:
        raise wrong("relation", f"is {table['relation']!r}, not one of {' '.join(RELATIONS)}")
    if table["pinned"] not in PINNED:
        raise wrong("pinned", f"is {table['pinned']!r}, not one of {', '.join(PINNED)}")
    for key in set(FOUND) & set(table) - set(findings):
        raise wrong(key, "belongs to statements that fail")
    if not isinstance(table.get("args", {}), dict):
        raise wrong("args", "is no table")
    function = getattr(measures, table["measure"], None)
    home = getattr(function, "__module__", "")
    own = inspect.isfunction(function) and f"{home}.".startswith(f"{measures.__name__}.")
    if function is None or not own or table["measure"].startswith("_"):
        raise wrong("measure", f"{table['measure']!r} is not in {measures.__name__}")
    try:
        inspect.signature(function).bind(None, **table.get("args", {}))
    except TypeError as error:
        raise wrong("args", f"do not suit {table['measure']}: {error}") from None
    numbers = {key: float(table[key]) for key in (*NUMBERS, *findings)}
    return Claim(**{**table, **numbers}, function=function)


def _judged(claim: Claim, results: Results) -> Verdict:
    try:
        measured = float(claim.function(results, **claim.args))
    except MissingResult:
        return Verdict(claim, None, "not judged")
    except StudyError:
        raise
    except Exception as error:  # measures are short formulas; which claim's it is, is what helps
        what = f"{type(error).__name__}: {error}"
        raise StudyError(f"claim {claim.id}: {claim.measure} failed with {what}") from error
    if not math.isfinite(measured):
        raise StudyError(f"claim {claim.id}: {claim.measure} gave {measured}")
    holds = RELATIONS[claim.relation](measured, claim.value, claim.tol)
    return Verdict(claim, measured, "holds" if holds else "fails")
