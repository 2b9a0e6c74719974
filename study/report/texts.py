"""Texts with numbers out of stored results: what the report and other pages are written in."""

import importlib
import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
import numpy as np
from markupsafe import Markup

from study.core.store import CorruptResult, MissingResult, Results, Stored, StudyError
from study.judge import claims as judged
from study.report import numbers
from study.vocabulary import ELEMENTS, PLANE_ELEMENTS, WAYS

HERE = Path(__file__).parent
PLAIN = "/;:=,+()!*'"  # what an address may have as it is, and be shorter than by base64

# Single letters in captions that are symbols: not units, "(a)" of a panel or, mostly, the word "a"
_ALONE = r"(?<![A-Za-z0-9.;<])(?!(?<=\()[a-z]\)){}(?![A-Za-z0-9'>])"
_LENGTH = r"(?:(?<=\d )|(?<=/)|(?<=width )|(?<=radius )|(?<=radius\) ))a"
SYMBOL = re.compile(_ALONE.format(rf"([b-dhpqrt-zEFKNP]|[λμνρω]|{_LENGTH})"))
MATRIX = re.compile(_ALONE.format("([LRT])"))


class Texts:
    """Templates, and what they can call: numbers, curves, measures, claims and figures.

    Args:
        results: What is reported; its folder has the claims and the figures, too.
        folders: Where templates are looked for, before this module's own folder.

    Attributes:
        claims: Rows of `claims.json`.
        figures: Entries of the index of figures by name, each with its drawings as data URIs.
    """

    def __init__(self, results: Results, folders: Iterable[Path] = ()) -> None:
        self.results = results
        self.claims = results.claims()
        self.figures = load_figures(results)
        self.environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader([*folders, HERE]),
            undefined=jinja2.StrictUndefined,
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        words: dict[str, Callable[..., Markup]] = {
            "num": numbers.num,
            "short": numbers.short,
            "pct": numbers.pct,
            "fixed": numbers.fixed,
            "count": numbers.count,
            "most": numbers.most,
            "least": numbers.least,
            "italics": italics,
        }
        self.environment.filters |= words
        self.environment.globals |= words | {
            "elements": [(key, ELEMENTS[key].name) for key in PLANE_ELEMENTS],
            "names": {key: one.name for key, one in (ELEMENTS | WAYS).items()},
            "s": results.scalar,
            "has": results.__contains__,
            "parameters": lambda key: results[key].parameters,
            "curves": self.curves,
            "measure": self.measure,
            "claims_of": self.claims_of,
            "figure": self.figure,
        }

    def render(self, template: str, **values: object) -> Markup:
        """Return a template's text."""
        try:
            return Markup(self.environment.get_template(template).render(values))
        except jinja2.TemplateNotFound:
            raise
        except jinja2.TemplateError as error:
            raise StudyError(f"study/report/{template}: {error}") from error

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a case."""
        return self.results.curves(key)

    def measure(self, name: str, /, **args: object) -> float:
        """Return what a function of `study.judge.measures` makes of the results."""
        return float(
            getattr(importlib.import_module("study.judge.measures"), name)(self.results, **args)
        )

    def figure(self, name: str) -> Markup:
        """Return a figure with its caption."""
        return self.render("figure.html", name=name, figure=self.figures.get(name), label="")

    def claims_of(self, section: str) -> list[dict[str, Any]]:
        """Return the claims whose source names the section."""
        return [claim for claim in self.claims if names_section(claim["source"], section)]


def load_figures(results: Results) -> dict[str, dict[str, Any]]:
    """Return the index of figures by name, each with its drawings as data URIs."""
    folder = results.folder / "figures"
    remedy = "draw them again with ./run study report"
    try:
        entries = json.loads((folder / "index.json").read_bytes())
        for entry in entries:
            for key, ending in (("uri", "svg"), ("narrow_uri", "narrow.svg")):
                drawing = (folder / f"{entry['name']}.{ending}").read_text(encoding="utf-8")
                entry[key] = f"data:image/svg+xml,{quote(drawing, safe=PLAIN)}"
        return {entry["name"]: entry for entry in entries}
    except FileNotFoundError as error:
        raise MissingResult(f"there is no {error.filename}: {remedy}") from None
    except (ValueError, TypeError, KeyError) as error:
        raise CorruptResult(f"{folder / 'index.json'} cannot be used ({error}): {remedy}") from None


def italics(text: str) -> Markup:
    """Write a plain text, such as a caption, with its symbols in italics, matrices bold, too."""
    safe = MATRIX.sub(r"<b><i>\1</i></b>", str(Markup.escape(text)))
    return Markup(SYMBOL.sub(r"<i>\1</i>", safe))


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
    found = {grade: sum(row["grade"] == grade for row in rows) for grade in judged.GRADES}
    for kind in (*judged.PAPER, "finding", "pin"):
        mine = [row["verdict"] for row in rows if row["kind"] == kind]
        found |= {kind: len(mine), f"{kind}_holds": mine.count("holds")}
    absent = sum(row["verdict"] == "not judged" for row in rows)
    differing = sum(row["differs"] for row in rows if row["verdict"] != "not judged")
    return {**found, "not judged": absent, "differing": differing}


def provenance(cases: list[Stored]) -> dict[str, Any]:
    """Return the cases, and the distinct sets of versions, to which they refer by letters."""
    sets: list[dict[str, str]] = []
    rows = []
    for case in cases:
        origin = case.provenance
        versions = origin.get("versions", {})
        if versions not in sets:
            sets.append(versions)
        rows.append({"key": case.key, "letter": _letter(sets.index(versions)), **origin})
    return {"cases": rows, "versions": {_letter(i): one for i, one in enumerate(sets)}}


def _letter(index: int) -> str:
    return chr(ord("A") + index)
