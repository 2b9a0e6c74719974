"""The paper's statements and the study's findings, as texts show them."""

import re
from typing import Any

from markupsafe import Markup

from study.judge.claims import GRADES, PAPER
from study.judge.facts import Fact, load_facts
from study.model.vocabulary import ELEMENTS
from study.publish.texts import numbers

# Sections of the paper whose statements are listed with its examples; the others' come before
HOMES = ("3", "4", "5", "6", "7.1", "7.2", "7.3", "7.4", "7.5", "7.6")
ROUND_OFF = 1e-9  # what a statement's number is away from a whole one without saying so


def names_section(source: str, section: str) -> bool:
    """Tell whether a source like "Sec. 7.1, Table 2" names a section; "Eq. 3" does not name 3."""
    section = re.escape(section)
    alone = section if r"\." in section else rf"(?:^|(?:§|\b[Ss]ec(?:tions?|\.)?)\s*){section}"
    return re.search(rf"(?<![\w.]){alone}(?!\.?\w)", source) is not None


def with_readings(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return claims in their order, other readings of a claim right after it."""
    ids = [row["id"] for row in rows]
    first = [row for row in rows if row["reading_of"] not in ids]
    return [
        one for row in first for one in (row, *(r for r in rows if r["reading_of"] == row["id"]))
    ]


def counts(rows: list[dict[str, Any]]) -> dict[str, int]:
    """Return numbers of claims by grade, of findings and pins, and of what is not as expected."""
    found = {grade: sum(row["grade"] == grade for row in rows) for grade in GRADES}
    for kind in (*PAPER, "finding", "pin"):
        mine = [row["verdict"] for row in rows if row["kind"] == kind]
        found |= {kind: len(mine), f"{kind}_holds": mine.count("holds")}
    absent = sum(row["verdict"] == "not judged" for row in rows)
    differing = sum(row["differs"] for row in rows if row["verdict"] != "not judged")
    return {**found, "not judged": absent, "differing": differing}


def by_fact(rows: list[dict[str, Any]]) -> list[tuple[Fact | None, list[dict[str, Any]]]]:
    """Return statements by the facts that they rest on, each where its first statement was."""
    facts = {fact.id: fact for fact in load_facts()}
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(row["fact"] or row["id"], []).append(row)
    return [(facts.get(name), mine) for name, mine in groups.items()]


def fact_counts(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return by grade how many statements there are, printed and read in, on how many facts.

    The last entry is of all grades.
    """
    found = []
    for grade in (*GRADES, None):
        line: dict[str, Any] = {"grade": grade}
        for kind in (*PAPER, None):
            mine = [
                row
                for row in rows
                if row["kind"] in ((kind,) if kind else PAPER) and grade in (None, row["grade"])
            ]
            facts = {row["fact"] or row["id"] for row in mine}
            line[kind or "every"] = {"statements": len(mine), "facts": len(facts)}
        found.append(line)
    return found


def home(source: str) -> str:
    """Return the section that a statement stands in: the first that its source names.

    Those of the abstract, the introduction and the conclusions stand before all.
    """
    place = re.match(r"[Ss]ec(?:tion|\.) (\d(?:\.\d)?)", source)
    return place[1] if place else ""


def found(row: dict[str, Any]) -> Markup:
    """Write what was measured of a statement, with its unit."""
    x, unit = row["measured"], row["unit"]
    if x is None:
        return Markup(numbers.DASH)
    if row["value"] == 0 and abs(x) < ROUND_OFF:
        return Markup("round-off")
    return _quantity(x, unit)


def wanted(row: dict[str, Any]) -> Markup:
    """Write what a statement asks for: relation, value and tolerance."""
    if row["relation"] is None:
        return Markup(numbers.DASH)
    relation = {"<=": "≤", ">=": "≥"}.get(row["relation"], row["relation"])
    scale, unit = _unit(row["unit"])
    value = numbers.short(row["value"] / scale, 5)
    if row["tol"] > ROUND_OFF:
        value += Markup(" ± {}").format(numbers.short(row["tol"] / scale, 3))
    return Markup("{} {}{}").format(relation, value, unit)


def _quantity(x: float, unit: str) -> Markup:
    scale, unit = _unit(unit)
    x /= scale
    whole = abs(x - round(x)) < ROUND_OFF * max(1.0, abs(x))
    digits = 3 if scale == 1.0 else 5
    return (numbers.fixed(x, 0) if whole else numbers.num(x, digits)) + unit


def _unit(unit: str) -> tuple[float, str]:
    """Return what to divide by, and the unit with the space before it."""
    scale, unit = (1e6, "MPa") if unit == "Pa" else (1.0, unit)
    return scale, f"{numbers.THIN}{unit}" if unit else ""


def in_words(statement: str) -> Markup:
    """Write a statement with names of elements for those of result files, and its mathematics.

    Names of findings, which are listed elsewhere, are left out.
    """
    statement = re.sub(r" \((?:[A-Z]\d*|\d\.?\d?)-[\w-]+\)", "", statement)
    words = re.sub(
        rf"\b({'|'.join(ELEMENTS)})((?:-J|-lumped)?)\b",
        lambda m: (
            ELEMENTS[m[1]].name + {"-J": ", form J", "-lumped": ", lumped mass"}.get(m[2], "")
        ),
        statement,
    )
    safe = str(Markup.escape(words)).replace("L^T", "L<sup>T</sup>").replace(" x ", " × ")
    return Markup(re.sub(r"\b(h|x|p0|mu)\b(?= ?[<&|)])", r"<i>\1</i>", safe))
