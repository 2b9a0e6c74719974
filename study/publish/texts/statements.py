"""Group, count and format the paper's statements and the study's findings for texts."""

import re
from typing import Any

from markupsafe import Markup

from study.judge.claims import GRADES, PAPER_KINDS
from study.judge.facts import Fact, load_facts
from study.model.vocabulary import ELEMENTS
from study.publish.texts import numbers

# Sections of the paper whose statements are listed with the examples; all others are listed before
EXAMPLE_SECTIONS = ("3", "4", "5", "6", "7.1", "7.2", "7.3", "7.4", "7.5", "7.6")
ROUND_OFF_TOLERANCE = 1e-9  # smaller values and deviations from integers are not shown


def source_names_section(source: str, section: str) -> bool:
    """Return whether the source of a claim names a section.

    Args:
        source: Source such as "Sec. 7.1, Fig. 5"; "Eq. 3" names no section.
        section: Name of the section, such as "7.1" or "V3".
    """
    section = re.escape(section)
    section_pattern = (
        section if r"\." in section else rf"(?:^|(?:§|\b[Ss]ec(?:tions?|\.)?)\s*){section}"
    )
    return re.search(rf"(?<![\w.]){section_pattern}(?!\.?\w)", source) is not None


def place_alternative_readings_after_claim(claims: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return claims in their order, with alternative interpretations directly after a claim.

    Args:
        claims: Judged claims; "reading_of" is the id of the claim of which a claim is an
            alternative interpretation, or None.
    """
    ids = [row["id"] for row in claims]
    primary_rows = [row for row in claims if row["reading_of"] not in ids]
    return [
        listed_row
        for row in primary_rows
        for listed_row in (
            row,
            *(reading for reading in claims if reading["reading_of"] == row["id"]),
        )
    ]


def count_claims_by_grade_and_kind(claims: list[dict[str, Any]]) -> dict[str, int]:
    """Count claims by grade, by kind, and by outcome.

    Args:
        claims: Judged claims.

    Returns:
        Numbers of claims by grade and by kind; "<kind>_holds": those of a kind that hold;
        "not judged"; "differing": claims whose verdict or number differs from the expected one.
    """
    counts_by_name = {grade: sum(row["grade"] == grade for row in claims) for grade in GRADES}
    for kind in (*PAPER_KINDS, "finding", "pin"):
        verdicts = [row["verdict"] for row in claims if row["kind"] == kind]
        counts_by_name |= {kind: len(verdicts), f"{kind}_holds": verdicts.count("holds")}
    n_not_judged = sum(row["verdict"] == "not judged" for row in claims)
    n_differing = sum(row["differs"] for row in claims if row["verdict"] != "not judged")
    return {**counts_by_name, "not judged": n_not_judged, "differing": n_differing}


def group_claims_by_fact(
    claims: list[dict[str, Any]],
) -> list[tuple[Fact | None, list[dict[str, Any]]]]:
    """Group claims by the independent fact on which they rest, in the order of first occurrence.

    Args:
        claims: Judged claims.

    Returns:
        Pairs of a fact and its claims; for a claim without an assigned fact, the fact is None.
    """
    facts = {fact.id: fact for fact in load_facts()}
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in claims:
        groups.setdefault(row["fact"] or row["id"], []).append(row)
    return [(facts.get(name), fact_rows) for name, fact_rows in groups.items()]


def count_statements_and_facts_by_grade(claims: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Count, for each grade, the paper's statements and the independent facts behind them.

    Args:
        claims: Judged claims.

    Returns:
        One entry per grade, and a last entry with the totals. For each kind and for "every" kind,
        an entry contains the numbers of "statements" and of "facts".
    """
    lines = []
    for grade in (*GRADES, None):
        line: dict[str, Any] = {"grade": grade}
        for kind in (*PAPER_KINDS, None):
            matching_rows = [
                row
                for row in claims
                if row["kind"] in ((kind,) if kind else PAPER_KINDS)
                and grade in (None, row["grade"])
            ]
            facts = {row["fact"] or row["id"] for row in matching_rows}
            line[kind or "every"] = {"statements": len(matching_rows), "facts": len(facts)}
        lines.append(line)
    return lines


def first_section_named_by_source(source: str) -> str:
    """Return the first section that the source of a statement names.

    Args:
        source: Source such as "Sec. 7.1, Fig. 5".

    Returns:
        Section such as "7.1"; empty if the source does not begin with a section, e.g. for the
        abstract.
    """
    match = re.match(r"[Ss]ec(?:tion|\.) (\d(?:\.\d)?)", source)
    return match[1] if match else ""


def format_measured(claim: dict[str, Any]) -> Markup:
    """Format the measured number of a claim with its unit.

    Numbers below `ROUND_OFF_TOLERANCE` whose expected value is zero are written as "round-off".
    """
    x, unit = claim["measured"], claim["unit"]
    if x is None:
        return Markup(numbers.DASH)
    if claim["value"] == 0 and abs(x) < ROUND_OFF_TOLERANCE:
        return Markup("round-off")
    return _format_quantity(x, unit)


def format_criterion(claim: dict[str, Any]) -> Markup:
    """Format the criterion of a claim: relation, value, tolerance, unit, as in "= 1 ± 0.01 m"."""
    if claim["relation"] is None:
        return Markup(numbers.DASH)
    relation = {"<=": "≤", ">=": "≥"}.get(claim["relation"], claim["relation"])
    scale, unit = _display_divisor_and_unit(claim["unit"])
    value = numbers.format_short_number(claim["value"] / scale, 5)
    if claim["tol"] > ROUND_OFF_TOLERANCE:
        value += Markup(" ± {}").format(numbers.format_short_number(claim["tol"] / scale, 3))
    return Markup("{} {}{}").format(relation, value, unit)


def _format_quantity(x: float, unit: str) -> Markup:
    scale, unit = _display_divisor_and_unit(unit)
    x /= scale
    is_whole = abs(x - round(x)) < ROUND_OFF_TOLERANCE * max(1.0, abs(x))
    digits = 3 if scale == 1.0 else 5
    return (numbers.format_decimals(x, 0) if is_whole else numbers.format_number(x, digits)) + unit


def _display_divisor_and_unit(unit: str) -> tuple[float, str]:
    """Return the divisor and the unit with which a quantity is displayed; Pa are displayed as MPa.

    Returns:
        Divisor, and displayed unit with a preceding space, or an empty text.
    """
    scale, unit = (1e6, "MPa") if unit == "Pa" else (1.0, unit)
    return scale, f"{numbers.THIN_SPACE}{unit}" if unit else ""


def format_statement(statement: str) -> Markup:
    """Convert the statement of a claim to HTML, with names instead of keys of elements.

    Ids of findings in parentheses are omitted, because the table does not list these findings.
    """
    statement = re.sub(r" \((?:[A-Z]\d*|\d\.?\d?)-[\w-]+\)", "", statement)
    text = re.sub(
        rf"\b({'|'.join(ELEMENTS)})((?:-J|-lumped)?)\b",
        lambda m: (
            ELEMENTS[m[1]].name + {"-J": ", form J", "-lumped": ", lumped mass"}.get(m[2], "")
        ),
        statement,
    )
    escaped_text = str(Markup.escape(text)).replace("L^T", "L<sup>T</sup>").replace(" x ", " × ")
    return Markup(re.sub(r"\b(h|x|p0|mu)\b(?= ?[<&|)])", r"<i>\1</i>", escaped_text))
