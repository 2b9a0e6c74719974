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
    """Return whether a source such as "Sec. 7.1" names a section; "Eq. 3" names no section."""
    section = re.escape(section)
    section_pattern = (
        section if r"\." in section else rf"(?:^|(?:§|\b[Ss]ec(?:tions?|\.)?)\s*){section}"
    )
    return re.search(rf"(?<![\w.]){section_pattern}(?!\.?\w)", source) is not None


def group_readings(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return claims in their order, but with other readings of a claim directly after it."""
    ids = [row["id"] for row in rows]
    primary_rows = [row for row in rows if row["reading_of"] not in ids]
    return [
        listed_row
        for row in primary_rows
        for listed_row in (
            row,
            *(reading for reading in rows if reading["reading_of"] == row["id"]),
        )
    ]


def count_claims(rows: list[dict[str, Any]]) -> dict[str, int]:
    """Return the numbers of claims by grade and by kind, and of unexpected outcomes."""
    counts_by_name = {grade: sum(row["grade"] == grade for row in rows) for grade in GRADES}
    for kind in (*PAPER_KINDS, "finding", "pin"):
        verdicts = [row["verdict"] for row in rows if row["kind"] == kind]
        counts_by_name |= {kind: len(verdicts), f"{kind}_holds": verdicts.count("holds")}
    n_not_judged = sum(row["verdict"] == "not judged" for row in rows)
    n_differing = sum(row["differs"] for row in rows if row["verdict"] != "not judged")
    return {**counts_by_name, "not judged": n_not_judged, "differing": n_differing}


def group_by_fact(rows: list[dict[str, Any]]) -> list[tuple[Fact | None, list[dict[str, Any]]]]:
    """Group statements by the facts on which they rest, in the order of first occurrence."""
    facts = {fact.id: fact for fact in load_facts()}
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(row["fact"] or row["id"], []).append(row)
    return [(facts.get(name), fact_rows) for name, fact_rows in groups.items()]


def count_facts(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return, for each grade, the numbers of statements by kind, and of the underlying facts.

    The last entry contains the totals for all grades.
    """
    lines = []
    for grade in (*GRADES, None):
        line: dict[str, Any] = {"grade": grade}
        for kind in (*PAPER_KINDS, None):
            matching_rows = [
                row
                for row in rows
                if row["kind"] in ((kind,) if kind else PAPER_KINDS)
                and grade in (None, row["grade"])
            ]
            facts = {row["fact"] or row["id"] for row in matching_rows}
            line[kind or "every"] = {"statements": len(matching_rows), "facts": len(facts)}
        lines.append(line)
    return lines


def section_of_source(source: str) -> str:
    """Return the section in which a statement occurs, i.e. the first that its source names.

    The result is "" if the source does not begin with a section, e.g. for the abstract.
    """
    match = re.match(r"[Ss]ec(?:tion|\.) (\d(?:\.\d)?)", source)
    return match[1] if match else ""


def format_measured(row: dict[str, Any]) -> Markup:
    """Format the measured number of a statement with its unit."""
    x, unit = row["measured"], row["unit"]
    if x is None:
        return Markup(numbers.DASH)
    if row["value"] == 0 and abs(x) < ROUND_OFF_TOLERANCE:
        return Markup("round-off")
    return _format_quantity(x, unit)


def format_criterion(row: dict[str, Any]) -> Markup:
    """Format the criterion of a statement, i.e. relation, value and tolerance."""
    if row["relation"] is None:
        return Markup(numbers.DASH)
    relation = {"<=": "≤", ">=": "≥"}.get(row["relation"], row["relation"])
    scale, unit = _scale_and_unit(row["unit"])
    value = numbers.format_short_number(row["value"] / scale, 5)
    if row["tol"] > ROUND_OFF_TOLERANCE:
        value += Markup(" ± {}").format(numbers.format_short_number(row["tol"] / scale, 3))
    return Markup("{} {}{}").format(relation, value, unit)


def _format_quantity(x: float, unit: str) -> Markup:
    scale, unit = _scale_and_unit(unit)
    x /= scale
    is_whole = abs(x - round(x)) < ROUND_OFF_TOLERANCE * max(1.0, abs(x))
    digits = 3 if scale == 1.0 else 5
    return (numbers.format_decimals(x, 0) if is_whole else numbers.format_number(x, digits)) + unit


def _scale_and_unit(unit: str) -> tuple[float, str]:
    """Return the divisor for display, and the displayed unit with a preceding space."""
    scale, unit = (1e6, "MPa") if unit == "Pa" else (1.0, unit)
    return scale, f"{numbers.THIN_SPACE}{unit}" if unit else ""


def format_statement(statement: str) -> Markup:
    """Format a statement with names instead of keys of elements, and with typeset mathematics.

    Ids of findings, which are listed elsewhere, are omitted.
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
