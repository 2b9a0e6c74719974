"""Statements of the paper and findings of this study, and whether the results bear them out."""

import inspect
import json
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import jsonschema

from study.judge.checks import RELATIONS, Check, load_checks
from study.judge.pins import Pin, load_pins
from study.run.cases import SECTIONS
from study.run.store import (
    CorruptResult,
    MissingResult,
    MissingScalar,
    Results,
    StudyError,
    write_json,
)

NO_REFERENCE: Literal["not judged: no reference"] = "not judged: no reference"
HERE = Path(__file__).parent
FILE = HERE / "paper_claims.toml"
SCHEMA = HERE / "claims.schema.json"

EXPECTED: dict[str, "Outcome"] = {
    "reproduced": "holds",
    "consistent by construction": "by construction",
    "contradicted": "fails",
    "not explained": "not explained",
    "not testable": "not testable",
}
GRADES = tuple(EXPECTED)
PAPER = ("paper", "implied")

Outcome = Literal[
    "holds",
    "by construction",
    "fails",
    "not explained",
    "not judged",
    "not judged: no reference",
    "not testable",
]


@dataclass(frozen=True)
class Judgement:
    """How a statement is judged: `measured relation value`, within `tol`.

    Attributes:
        measure: Name of a function of `study.judge.measures`.
        function: The function itself.
        args: Its keyword arguments.
        relation: One of `RELATIONS`.
        value: What the measure is compared with.
        tol: Absolute tolerance, in favour of the statement.
        tol_why: Where the tolerance comes from.
        pinned: The verdict that is expected; of the paper's statements, what their grade says.
        why: The reason of that verdict.
        reference: Measure of the error of what is compared with, and its arguments: if it is not
            below a third of the tolerance, nothing is judged.
        tol_set: Whether value and tolerance were set "before" or "after" the first value was
            seen; None of findings for which it is not recorded.
        unit: Unit of measure, value and tolerances.
        found: What is measured where the statement fails: pinned like the verdict.
        found_tol: How far from it still counts as the same.
    """

    measure: str
    function: Callable[..., float] = field(repr=False, compare=False)
    args: dict[str, Any]
    relation: str
    value: float
    tol: float
    tol_why: str
    pinned: str
    why: str
    reference: tuple[Callable[..., float], dict[str, Any]] | None = None
    tol_set: str | None = None
    unit: str = ""
    found: float | None = None
    found_tol: float = 0.0


@dataclass(frozen=True)
class Claim:
    """A statement.

    Attributes:
        id: Its name.
        kind: "paper", "implied" (read into the paper), "finding" of this study, or "pin": a number
            that is only recorded.
        source: Where the paper says it.
        statement: What it says.
        judgement: How it is judged; None if it is not testable.
        quote: The paper's words; as all below, of statements of the paper only.
        grade: One of `GRADES`.
        grade_why: Its reason.
        reading_of: The claim of which this is another reading.
        basis: Why it cannot but hold, if it is consistent by construction.
        chosen: The constant of the study that was put in or fitted.
        printed: Whether the value is the paper's own number.
        missing: What a test would need.
    """

    id: str
    kind: str
    source: str
    statement: str
    judgement: Judgement | None
    quote: str | None = None
    grade: str | None = None
    grade_why: str | None = None
    reading_of: str | None = None
    basis: str | None = None
    chosen: str | None = None
    printed: bool = False
    missing: str | None = None


@dataclass(frozen=True)
class Verdict:
    """A claim with what was measured; None if a result is missing or nothing can be measured.

    Attributes:
        claim: The claim.
        measured: Its number.
        verdict: What follows from that.
        unreadable: Why it is not judged, if a result is there that cannot be used.
    """

    claim: Claim
    measured: float | None
    verdict: Outcome
    unreadable: str = ""

    @property
    def differs(self) -> bool:
        """Whether verdict or finding are not the pinned ones."""
        how = self.claim.judgement
        return how is not None and (self.verdict != how.pinned or self._found_another(how))

    @property
    def expected(self) -> str:
        """The pinned verdict, with the pinned finding where the statement fails."""
        how = self.claim.judgement
        if how is None:
            return "not testable"
        if how.found is None:
            return how.pinned
        return f"{how.pinned} with {how.found:.6g} ± {how.found_tol:.3g}"

    def _found_another(self, how: Judgement) -> bool:
        if how.found is None or self.measured is None:
            return False
        return abs(self.measured - how.found) > how.found_tol


def load_claims() -> list[Claim]:
    """Return the paper's statements, the checks of all pages, and the pins.

    The pages are imported, and with them the solver.
    """
    claims = read_claims([FILE])
    for section in SECTIONS:
        claims += claims_of_checks(load_checks(section), f"This study, section {section}")
    claims += claims_of_pins(load_pins())
    _refuse_repeated(claims)
    return claims


def load_paper_claims() -> list[Claim]:
    """Return the paper's statements; no page is imported."""
    return read_claims([FILE])


def read_claims(paths: Sequence[Path], measures: ModuleType | None = None) -> list[Claim]:
    """Read and check the claims of files.

    Args:
        paths: files with tables [[claim]] and [[finding]].
        measures: module of the measures; `study.judge.measures` if not given.
    """
    measures = measures or import_module("study.judge.measures")
    claims = [
        _claim(kind, table, place, measures)
        for path in paths
        for kind, tables in _tables(path).items()
        for place, table in enumerate(tables, start=1)
    ]
    _refuse_repeated(claims)
    for claim in claims:
        if claim.reading_of is not None and claim.reading_of not in (
            {one.id for one in claims} - {claim.id}
        ):
            raise StudyError(f"claim {claim.id}: reading_of names no other claim")
    return claims


def claims_of_checks(checks: Sequence[Check], source: str) -> list[Claim]:
    """Return the checks of a page as findings of this study."""
    return [
        Claim(
            id=check.id,
            kind="finding",
            source=source,
            statement=check.statement,
            judgement=Judgement(
                measure="its value",
                function=check.value,
                args={},
                relation=check.relation,
                value=check.bound,
                tol=check.tolerance,
                tol_why=check.tolerance_why,
                pinned="holds",
                why=check.why,
                tol_set=check.tolerance_set,
                unit=check.unit,
            ),
        )
        for check in checks
    ]


def claims_of_pins(pins: Sequence[Pin]) -> list[Claim]:
    """Return pins as claims; one that names what is found instead of its bound has to fail."""
    measures = import_module("study.judge.measures")
    return [
        Claim(
            id=pin["id"],
            kind="pin",
            source=pin["source"],
            statement=pin["statement"],
            judgement=Judgement(
                measure=pin["measure"],
                function=getattr(measures, pin["measure"]),
                args=pin["args"],
                relation=pin["relation"],
                value=float(pin["bound"]),
                tol=float(pin["tolerance"]),
                tol_why="",
                pinned="fails" if "found" in pin else "holds",
                why="",
                unit=pin.get("unit", ""),
                found=pin.get("found"),
                found_tol=pin.get("found_tolerance", 0.0),
            ),
        )
        for pin in pins
    ]


def _refuse_repeated(claims: Sequence[Claim]) -> None:
    ids = [claim.id for claim in claims]
    for repeated in (name for name in ids if ids.count(name) > 1):
        raise StudyError(f"claim {repeated}: its id occurs more than once")


def judge(claims: list[Claim], results: Results) -> list[Verdict]:
    """Compare each claim with the stored results."""
    return [_judged(claim, results) for claim in claims]


def write(
    out: Path,
    verdicts: list[Verdict],
    facts: Mapping[str, str],
    turned: Mapping[str, Sequence[str]],
) -> None:
    """Write `<out>/claims.json`.

    Args:
        out: Folder of the results.
        verdicts: What was found.
        facts: The fact that each statement of the paper rests on, by its id.
        turned: Names of the mutations that turn it.
    """
    rows = [
        _row(verdict)
        | {"fact": facts.get(verdict.claim.id), "turned_by": list(turned.get(verdict.claim.id, ()))}
        for verdict in verdicts
    ]
    write_json(Path(out) / "claims.json", rows)


def table(verdicts: list[Verdict]) -> str:
    """Return the verdicts as lines of text, one per claim, each ending the line."""
    rows = [
        (
            verdict.claim.id,
            "" if verdict.measured is None else f"{verdict.measured:.6g}",
            "" if how is None else f"{how.relation} {how.value:.6g} ± {how.tol:.3g}",
            f"{verdict.verdict}, pinned: {verdict.expected}",
        )
        for verdict in verdicts
        for how in [verdict.claim.judgement]
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "".join(f"{line}\n" for line in lines)


def summary(verdicts: list[Verdict]) -> str:
    """Return the counts by kind, and by grade or verdict, in one line."""
    paper = [one for one in verdicts if one.claim.kind in PAPER]
    grades = [one.claim.grade for one in paper]
    counts = [f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades]
    parts = [f"{len(paper)} statements of the paper: {', '.join(counts)}"] if paper else []
    for kind in ("finding", "pin"):
        own = [one.verdict for one in verdicts if one.claim.kind == kind]
        if own:
            parts.append(
                f"{len(own)} {kind}s: {own.count('holds')} hold, {own.count('fails')} fail"
            )
    absent = sum(one.verdict == "not judged" for one in verdicts)
    parts += [f"{absent} not judged"] if absent else []
    differing = sum(one.differs for one in verdicts if one.verdict != "not judged")
    return "; ".join([*parts, f"{differing} other than pinned"])


def _row(verdict: Verdict) -> dict[str, Any]:
    claim, how = verdict.claim, verdict.claim.judgement
    return {
        "id": claim.id,
        "kind": claim.kind,
        "source": claim.source,
        "quote": claim.quote,
        "statement": claim.statement,
        "reading_of": claim.reading_of,
        "grade": claim.grade,
        "grade_why": claim.grade_why,
        "basis": claim.basis,
        "missing": claim.missing,
        "measured": verdict.measured,
        "relation": how and how.relation,
        "value": how and how.value,
        "tol": how and how.tol,
        "verdict": verdict.verdict,
        "pinned": verdict.expected,
        "differs": verdict.differs,
        "why": how and how.why,
        "unit": how.unit if how else "",
        "tol_why": how and how.tol_why,
        "tol_set": how and how.tol_set,
    }


def _tables(path: Path) -> dict[str, list[dict[str, Any]]]:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path} cannot be read: {error}") from None
    validator = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_bytes()))
    for mistake in sorted(validator.iter_errors(content), key=_order):
        if len(mistake.absolute_path) < 2:
            raise StudyError(f"{path} may have nothing but tables [[claim]] and [[finding]]")
        kind, place, *keys = mistake.absolute_path
        entry = content[kind][place]
        name = entry.get("id", f"number {place + 1}") if isinstance(entry, dict) else place + 1
        raise StudyError(f"{kind} {name}: {_described(mistake, keys)}")
    return content


def _order(mistake: jsonschema.ValidationError) -> tuple[Any, ...]:
    """By place; of one entry, keys that nothing has asked for last: others' mistakes make them."""
    return (
        [str(part).zfill(6) for part in list(mistake.absolute_path)[:2]],
        mistake.validator == "unevaluatedProperties",
        [str(part) for part in mistake.absolute_path],
    )


def _described(mistake: jsonschema.ValidationError, keys: Sequence[Any]) -> str:
    key = ".".join(map(str, keys))
    within = f"{key}." if key else ""
    if mistake.validator == "required":
        absent = next(name for name in mistake.validator_value if name not in mistake.instance)
        return f"{within}{absent} is missing"
    if mistake.validator in ("unevaluatedProperties", "additionalProperties"):
        (surplus, *_) = re.findall(r"'([^']*)'", mistake.message)
        return f"{within}{surplus} is not a key of it"
    if mistake.validator == "type":
        words = {"string": "text", "object": "table", "array": "list"}
        return f"{key} is no {words.get(mistake.validator_value, mistake.validator_value)}"
    if mistake.validator == "enum":
        names = ", ".join(mistake.validator_value)
        return f"{key} is {mistake.instance!r}, not one of {names}"
    if mistake.validator == "not":
        return f"{key} {mistake.schema['$comment']}"
    if mistake.validator == "pattern":
        return f"{key} is no text"
    if mistake.validator == "minimum":
        return f"{key} cannot be {mistake.instance}"
    return f"{key} cannot be used: {mistake.message}"


def _claim(kind: str, table: dict[str, Any], place: int, measures: ModuleType) -> Claim:
    """What the schema cannot say: numbers are finite, the measure is there and takes its args."""
    name = table.get("id", f"number {place}")

    def wrong(key: str, what: str) -> StudyError:
        return StudyError(f"{kind} {name}: {key} {what}")

    for key, number in _numbers(table):
        if not math.isfinite(number):
            raise wrong(key, f"cannot be {number}")
    rest = {key: table[key] for key in Claim.__dataclass_fields__ if key in table}
    rest.setdefault("kind", kind)
    if "measure" not in table:
        return Claim(**rest, judgement=None)

    def measured(by: dict[str, Any]) -> tuple[Callable[..., float], dict[str, Any]]:
        function, args = getattr(measures, by["measure"], None), by.get("args", {})
        home = getattr(function, "__module__", "")
        own = inspect.isfunction(function) and f"{home}.".startswith(f"{measures.__name__}.")
        if function is None or not own or by["measure"].startswith("_"):
            raise wrong("measure", f"{by['measure']!r} is not in {measures.__name__}")
        try:
            inspect.signature(function).bind(None, **args)
        except TypeError as error:
            raise wrong("args", f"do not suit {by['measure']}: {error}") from None
        return function, args

    how = {key: table[key] for key in Judgement.__dataclass_fields__ if key in table}
    how |= {key: float(number) for key, number in _numbers(table)}
    how["function"], how["args"] = measured(table)
    if "grade" in table:
        how["pinned"] = EXPECTED[table["grade"]]
    if "reference" in table:
        how["reference"] = measured(table["reference"])
        if table["grade"] == "not testable":
            how["pinned"] = NO_REFERENCE
    return Claim(**rest, judgement=Judgement(**how))


def _numbers(table: dict[str, Any]) -> Iterator[tuple[str, float]]:
    for key in ("value", "tol", "found", "found_tol"):
        if key in table:
            yield key, table[key]


def _judged(claim: Claim, results: Results) -> Verdict:
    how = claim.judgement
    if how is None:
        return Verdict(claim, None, "not testable")
    try:
        measured = float(how.function(results, **how.args))
        holds = _is_reference(how, results)
    except MissingResult:
        return Verdict(claim, None, "not judged")
    except (CorruptResult, MissingScalar) as error:
        return Verdict(claim, None, "not judged", str(error))
    except StudyError:
        raise
    except Exception as error:  # measures are short formulas; which claim's it is, is what helps
        what = f"{type(error).__name__}: {error}"
        raise StudyError(f"claim {claim.id}: {how.measure} failed with {what}") from error
    if not math.isfinite(measured):
        raise StudyError(f"claim {claim.id}: {how.measure} gave {measured}")
    return Verdict(claim, measured, _outcome(claim, measured) if holds else NO_REFERENCE)


def _is_reference(how: Judgement, results: Results) -> bool:
    """Tell whether the error of what is compared with is small enough, if it is known."""
    if how.reference is None:
        return True
    error_of, args = how.reference
    return bool(error_of(results, **args) < (how.tol or abs(how.value)) / 3)


def _outcome(claim: Claim, measured: float) -> Outcome:
    """What the number says: statements that cannot fail do not hold, they are constructed."""
    how = claim.judgement
    assert how is not None
    if RELATIONS[how.relation](measured, how.value, how.tol):
        return "by construction" if claim.grade == "consistent by construction" else "holds"
    return "not explained" if claim.grade == "not explained" else "fails"
