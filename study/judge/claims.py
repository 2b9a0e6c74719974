"""Statements of the paper and findings of this study, and whether the results confirm them."""

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

from study.judge.checks import RELATIONS, Check, load_checks_of_section_page
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
FOLDER = Path(__file__).parent
PAPER_CLAIMS_FILE = FOLDER / "paper_claims.toml"
SCHEMA_FILE = FOLDER / "claims.schema.json"

EXPECTED_OUTCOMES: dict[str, "Outcome"] = {
    "reproduced": "holds",
    "consistent by construction": "by construction",
    "contradicted": "fails",
    "not explained": "not explained",
    "not testable": "not testable",
}
GRADES = tuple(EXPECTED_OUTCOMES)
PAPER_KINDS = ("paper", "implied")

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
    """Criterion by which a statement is judged: `measured relation value`, within `tol`.

    Attributes:
        measure: Name of the measure, a function of `study.judge.measures`.
        function: The function of that name.
        args: Keyword arguments of the function.
        relation: One of `RELATIONS`.
        value: Value with which the measured number is compared.
        tol: Absolute tolerance in favour of the statement.
        tol_why: Justification of the tolerance.
        pinned: Expected verdict, which tests compare with the actual one; for statements of the
            paper, it follows from their grade.
        why: Explanation of the expected verdict.
        reference: Function that returns the error of the reference, and its keyword arguments. The
            statement is judged only if this error is less than a third of the tolerance.
        tol_set: Whether `value` and `tol` were set "before" or "after" the first value was seen;
            None for findings for which this is not recorded.
        unit: Unit of the measured number, `value` and the tolerances.
        found: Number that the measure is expected to return if the statement is known to fail;
            otherwise None.
        found_tol: Largest accepted deviation of the measured number from `found`.
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
    """A statement of the paper or a finding of this study.

    The attributes from `quote` on are used for statements of the paper only.

    Attributes:
        id: Name of the claim.
        kind: "paper" (stated in the paper), "implied" (read into the paper), "finding" (of this
            study) or "pin" (a number that is only recorded).
        source: Part of the paper or of this study that makes the statement.
        statement: The statement as a sentence.
        judgement: Criterion for the statement; None if it is not testable.
        quote: Quotation from the paper.
        grade: One of `GRADES`.
        grade_why: Reason for the grade.
        reading_of: Name of the claim of which this is another interpretation.
        basis: Reason why the statement must hold, if it is consistent by construction.
        chosen: Constant of the study that was chosen or fitted.
        printed: Whether the value is printed in the paper.
        missing: Data that a test would require.
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
    """Outcome of the comparison of a claim with the stored results.

    Attributes:
        claim: The claim.
        measured: Measured number; None if a result is missing or the claim is not testable.
        verdict: Outcome of the comparison.
        unreadable_reason: Reason why the claim is not judged although its results exist; otherwise
            empty.
    """

    claim: Claim
    measured: float | None
    verdict: Outcome
    unreadable_reason: str = ""

    @property
    def differs(self) -> bool:
        """Whether the verdict or the measured number differs from the expected one."""
        judgement = self.claim.judgement
        return judgement is not None and (
            self.verdict != judgement.pinned or self._number_differs_from_pinned(judgement)
        )

    @property
    def expected_verdict(self) -> str:
        """Expected verdict, followed by the expected number if the statement is known to fail."""
        judgement = self.claim.judgement
        if judgement is None:
            return "not testable"
        if judgement.found is None:
            return judgement.pinned
        return f"{judgement.pinned} with {judgement.found:.6g} ± {judgement.found_tol:.3g}"

    def _number_differs_from_pinned(self, judgement: Judgement) -> bool:
        if judgement.found is None or self.measured is None:
            return False
        return abs(self.measured - judgement.found) > judgement.found_tol


def load_claims() -> list[Claim]:
    """Return the paper's statements, the checks of all pages, and the pins (recorded numbers).

    This imports the pages and therefore the solver.
    """
    claims = read_claims([PAPER_CLAIMS_FILE])
    for section in SECTIONS:
        claims += claims_from_checks(
            load_checks_of_section_page(section), f"This study, section {section}"
        )
    claims += claims_from_pins(load_pins())
    _refuse_repeated_ids(claims)
    return claims


def load_paper_claims() -> list[Claim]:
    """Return the paper's statements without importing any page."""
    return read_claims([PAPER_CLAIMS_FILE])


def read_claims(paths: Sequence[Path], measures: ModuleType | None = None) -> list[Claim]:
    """Read and check the claims in TOML files.

    Args:
        paths: files with tables [[claim]] and [[finding]].
        measures: module that contains the measures; by default `study.judge.measures`.
    """
    measures = measures or import_module("study.judge.measures")
    claims = [
        _build_claim_from_table(kind, table, position, measures)
        for path in paths
        for kind, tables in _load_claim_tables_by_schema(path).items()
        for position, table in enumerate(tables, start=1)
    ]
    _refuse_repeated_ids(claims)
    for claim in claims:
        if claim.reading_of is not None and claim.reading_of not in (
            {other_claim.id for other_claim in claims} - {claim.id}
        ):
            raise StudyError(f"claim {claim.id}: reading_of names no other claim")
    return claims


def claims_from_checks(checks: Sequence[Check], source: str) -> list[Claim]:
    """Return the checks of a page as findings of this study.

    Args:
        checks: Checks of one page.
        source: Part of this study that makes the statements.
    """
    return [
        Claim(
            id=check.id,
            kind="finding",
            source=source,
            statement=check.statement,
            judgement=Judgement(
                measure="its value",
                function=check.measure,
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


def claims_from_pins(pins: Sequence[Pin]) -> list[Claim]:
    """Return the pins (recorded numbers, see `study.judge.pins`) as claims.

    The expected verdict is "fails" for a pin that contains the key "found", i.e. a number that
    contradicts its statement, and "holds" for all others.
    """
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


def _refuse_repeated_ids(claims: Sequence[Claim]) -> None:
    ids = [claim.id for claim in claims]
    for repeated_id in (claim_id for claim_id in ids if ids.count(claim_id) > 1):
        raise StudyError(f"claim {repeated_id}: its id occurs more than once")


def judge_claims(claims: list[Claim], results: Results) -> list[Verdict]:
    """Compare each claim with the stored results, and return the verdicts in the same order."""
    return [_judge_claim(claim, results) for claim in claims]


def write_claims(
    out: Path,
    verdicts: list[Verdict],
    fact_ids_by_claim_id: Mapping[str, str],
    reversing_mutations: Mapping[str, Sequence[str]],
) -> None:
    """Write claims, verdicts, facts and mutations to `<out>/claims.json`.

    Args:
        out: Folder of the results.
        verdicts: Verdicts on all claims.
        fact_ids_by_claim_id: Id of the fact on which each statement of the paper rests, by id of
            the claim.
        reversing_mutations: Names of the mutations that reverse each verdict, by id of the claim;
            see `study.judge.facts`.
    """
    rows = [
        _claim_and_verdict_as_json(verdict)
        | {
            "fact": fact_ids_by_claim_id.get(verdict.claim.id),
            "turned_by": list(reversing_mutations.get(verdict.claim.id, ())),
        }
        for verdict in verdicts
    ]
    write_json(Path(out) / "claims.json", rows)


def format_verdict_table(verdicts: list[Verdict]) -> str:
    """Return a text table with id, measured number, criterion and verdict of each claim."""
    rows = [
        (
            verdict.claim.id,
            "" if verdict.measured is None else f"{verdict.measured:.6g}",
            ""
            if judgement is None
            else f"{judgement.relation} {judgement.value:.6g} ± {judgement.tol:.3g}",
            f"{verdict.verdict}, pinned: {verdict.expected_verdict}",
        )
        for verdict in verdicts
        for judgement in [verdict.claim.judgement]
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, padded_row, widths)).rstrip() for padded_row in rows]
    return "".join(f"{line}\n" for line in lines)


def summarise_verdicts(verdicts: list[Verdict]) -> str:
    """Return a line with the numbers of claims: by grade (paper), by verdict (findings, pins)."""
    paper_verdicts = [verdict for verdict in verdicts if verdict.claim.kind in PAPER_KINDS]
    grades = [verdict.claim.grade for verdict in paper_verdicts]
    counts = [f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades]
    phrases = (
        [f"{len(paper_verdicts)} statements of the paper: {', '.join(counts)}"]
        if paper_verdicts
        else []
    )
    for kind in ("finding", "pin"):
        outcomes = [verdict.verdict for verdict in verdicts if verdict.claim.kind == kind]
        if outcomes:
            phrases.append(
                f"{len(outcomes)} {kind}s: {outcomes.count('holds')} hold, "
                f"{outcomes.count('fails')} fail"
            )
    n_not_judged = sum(verdict.verdict == "not judged" for verdict in verdicts)
    phrases += [f"{n_not_judged} not judged"] if n_not_judged else []
    n_differing = sum(verdict.differs for verdict in verdicts if verdict.verdict != "not judged")
    return "; ".join([*phrases, f"{n_differing} other than pinned"])


def _claim_and_verdict_as_json(verdict: Verdict) -> dict[str, Any]:
    claim, judgement = verdict.claim, verdict.claim.judgement
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
        "relation": judgement and judgement.relation,
        "value": judgement and judgement.value,
        "tol": judgement and judgement.tol,
        "verdict": verdict.verdict,
        "pinned": verdict.expected_verdict,
        "differs": verdict.differs,
        "why": judgement and judgement.why,
        "unit": judgement.unit if judgement else "",
        "tol_why": judgement and judgement.tol_why,
        "tol_set": judgement and judgement.tol_set,
    }


def _load_claim_tables_by_schema(path: Path) -> dict[str, list[dict[str, Any]]]:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path} cannot be read: {error}") from None
    validator = jsonschema.Draft202012Validator(json.loads(SCHEMA_FILE.read_bytes()))
    for schema_error in sorted(validator.iter_errors(content), key=_error_sort_key):
        if len(schema_error.absolute_path) < 2:
            raise StudyError(f"{path} may have nothing but tables [[claim]] and [[finding]]")
        kind, index, *keys = schema_error.absolute_path
        entry = content[kind][index]
        entry_name = (
            entry.get("id", f"number {index + 1}") if isinstance(entry, dict) else index + 1
        )
        raise StudyError(f"{kind} {entry_name}: {_describe_error(schema_error, keys)}")
    return content


def _error_sort_key(error: jsonschema.ValidationError) -> tuple[Any, ...]:
    """Return the key that sorts schema errors by the position of the claim in its file.

    For the same claim, errors about unexpected keys come last, because they may be consequences of
    other errors.
    """
    return (
        [str(path_part).zfill(6) for path_part in list(error.absolute_path)[:2]],
        error.validator == "unevaluatedProperties",
        [str(part) for part in error.absolute_path],
    )


def _describe_error(error: jsonschema.ValidationError, keys: Sequence[Any]) -> str:
    key = ".".join(map(str, keys))
    key_prefix = f"{key}." if key else ""
    if error.validator == "required":
        missing_key = next(name for name in error.validator_value if name not in error.instance)
        return f"{key_prefix}{missing_key} is missing"
    if error.validator in ("unevaluatedProperties", "additionalProperties"):
        (unknown_key, *_) = re.findall(r"'([^']*)'", error.message)
        return f"{key_prefix}{unknown_key} is not a key of it"
    if error.validator == "type":
        type_words = {"string": "text", "object": "table", "array": "list"}
        return f"{key} is no {type_words.get(error.validator_value, error.validator_value)}"
    if error.validator == "enum":
        names = ", ".join(error.validator_value)
        return f"{key} is {error.instance!r}, not one of {names}"
    if error.validator == "not":
        return f"{key} {error.schema['$comment']}"
    if error.validator == "pattern":
        return f"{key} is no text"
    if error.validator == "minimum":
        return f"{key} cannot be {error.instance}"
    return f"{key} cannot be used: {error.message}"


def _build_claim_from_table(
    kind: str, table: dict[str, Any], position: int, measures: ModuleType
) -> Claim:
    """Build a claim from a TOML table.

    This checks conditions that the schema cannot express: all numbers are finite, and the measure
    exists and accepts the arguments.

    Args:
        kind: Name of the array of tables, "claim" or "finding".
        table: Contents of the table.
        position: Position of the table in the array, starting from 1, for error messages.
        measures: Module that contains the measures.
    """
    claim_name = table.get("id", f"number {position}")

    def claim_error(key: str, problem: str) -> StudyError:
        return StudyError(f"{kind} {claim_name}: {key} {problem}")

    for key, number in _iterate_numerical_entries(table):
        if not math.isfinite(number):
            raise claim_error(key, f"cannot be {number}")
    claim_fields = {key: table[key] for key in Claim.__dataclass_fields__ if key in table}
    claim_fields.setdefault("kind", kind)
    if "measure" not in table:
        return Claim(**claim_fields, judgement=None)

    def find_measure_and_arguments(
        reference: dict[str, Any],
    ) -> tuple[Callable[..., float], dict[str, Any]]:
        function, args = getattr(measures, reference["measure"], None), reference.get("args", {})
        module_name = getattr(function, "__module__", "")
        is_measure = inspect.isfunction(function) and f"{module_name}.".startswith(
            f"{measures.__name__}."
        )
        if function is None or not is_measure or reference["measure"].startswith("_"):
            raise claim_error("measure", f"{reference['measure']!r} is not in {measures.__name__}")
        try:
            inspect.signature(function).bind(None, **args)
        except TypeError as error:
            raise claim_error("args", f"do not suit {reference['measure']}: {error}") from None
        return function, args

    judgement_fields = {key: table[key] for key in Judgement.__dataclass_fields__ if key in table}
    judgement_fields |= {key: float(number) for key, number in _iterate_numerical_entries(table)}
    judgement_fields["function"], judgement_fields["args"] = find_measure_and_arguments(table)
    if "grade" in table:
        judgement_fields["pinned"] = EXPECTED_OUTCOMES[table["grade"]]
    if "reference" in table:
        judgement_fields["reference"] = find_measure_and_arguments(table["reference"])
        if table["grade"] == "not testable":
            judgement_fields["pinned"] = NO_REFERENCE
    return Claim(**claim_fields, judgement=Judgement(**judgement_fields))


def _iterate_numerical_entries(table: dict[str, Any]) -> Iterator[tuple[str, float]]:
    for key in ("value", "tol", "found", "found_tol"):
        if key in table:
            yield key, table[key]


def _judge_claim(claim: Claim, results: Results) -> Verdict:
    judgement = claim.judgement
    if judgement is None:
        return Verdict(claim, None, "not testable")
    try:
        measured = float(judgement.function(results, **judgement.args))
        has_reference = _is_reference_error_small_enough(judgement, results)
    except MissingResult:
        return Verdict(claim, None, "not judged")
    except (CorruptResult, MissingScalar) as error:
        return Verdict(claim, None, "not judged", str(error))
    except StudyError:
        raise
    except Exception as error:  # the name of the claim helps most in finding the fault
        error_text = f"{type(error).__name__}: {error}"
        raise StudyError(
            f"claim {claim.id}: {judgement.measure} failed with {error_text}"
        ) from error
    if not math.isfinite(measured):
        raise StudyError(f"claim {claim.id}: {judgement.measure} gave {measured}")
    return Verdict(
        claim,
        measured,
        _outcome_of_measured_number(claim, measured) if has_reference else NO_REFERENCE,
    )


def _is_reference_error_small_enough(judgement: Judgement, results: Results) -> bool:
    """Return whether the error of the reference is less than a third of the tolerance.

    The bound replaces the tolerance if that is zero. Without a reference, the result is True.
    """
    if judgement.reference is None:
        return True
    reference_error, args = judgement.reference
    return bool(reference_error(results, **args) < (judgement.tol or abs(judgement.value)) / 3)


def _outcome_of_measured_number(claim: Claim, measured: float) -> Outcome:
    """Return the outcome for a measured number.

    For statements of the paper, it also depends on the grade.
    """
    judgement = claim.judgement
    assert judgement is not None
    if RELATIONS[judgement.relation](measured, judgement.value, judgement.tol):
        return "by construction" if claim.grade == "consistent by construction" else "holds"
    return "not explained" if claim.grade == "not explained" else "fails"
