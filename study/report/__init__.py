"""The report: one self-contained HTML page, and a PDF of the same source."""

import base64
import gc
import importlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import numpy as np
from markupsafe import Markup

from study.core.cases import SECTIONS, title
from study.core.store import (
    CorruptResult,
    MissingResult,
    Results,
    Stored,
    StudyError,
    write_whole,
)
from study.judge import claims as judged
from study.report import numbers
from study.vocabulary import ELEMENTS, PLANE_ELEMENTS

HERE = Path(__file__).parent
_GENERAL = re.compile(r"Abstract|Section 8\b")  # the paper's frame, part of no section here


class Rendered(NamedTuple):
    """The page, and what it lacks for want of results or figures, a line for each."""

    html: str
    incomplete: list[str]


def build(results: Results, out: Path) -> list[str]:
    """Write `<out>/report.html` and `<out>/report.pdf` from results, claims and figures.

    The PDF comes first: a page on disk says that the PDF of the same source is there, too, and
    is not laid out again.

    Returns:
        What the report lacks for want of results or figures.
    """
    html, incomplete = render(results)
    page, pdf = Path(out) / "report.html", Path(out) / "report.pdf"
    if pdf.is_file() and page.is_file() and page.read_bytes() == html.encode():
        return incomplete
    write_whole(pdf, _pdf(html))
    write_whole(page, html.encode())
    return incomplete


def render(results: Results, templates: Path = HERE) -> Rendered:
    """Return the page.

    Args:
        results: What to report; its folder has the claims and the figures, too.
        templates: Folder of the templates, with `sections/<id>.html` for each section's text.
    """
    page = _Page(results, templates)
    stored = {section: results.section(section) for section in SECTIONS}
    stored = {section: cases for section, cases in stored.items() if cases}
    sections = [
        {"id": section, "title": title(section), "body": page.body(section)} for section in stored
    ]
    cases = [case for section in stored.values() for case in section]
    values = {
        "claims": page.claims,
        "general": page.general(),
        "exceptions": [
            c
            for c in page.claims
            if c["differs"] or (c["kind"] in judged.PAPER and c["verdict"] != "holds")
        ],
        "grades": judged.GRADES,
        "counts": _counts(page.claims),
        "sections": sections,
        "others": page.others(list(stored)),
        "findings": page.frame("findings"),
        "introduction": page.frame("introduction"),
        "conclusions": page.frame("conclusions"),
        "items": importlib.import_module("study.paper.items").ITEMS,
        **_provenance(cases),
    }
    try:
        html = page.environment.get_template("base.html").render(values)
    except jinja2.UndefinedError as error:  # results or claims that another version wrote
        raise CorruptResult(f"{results.folder}: {error}; run ./run study --force") from error
    return Rendered(html, page.incomplete)


class _Page:
    """What the sections' texts can call, and which figures they have placed."""

    def __init__(self, results: Results, templates: Path) -> None:
        self.results = results
        self.templates = templates
        self.claims = results.claims()
        self.figures = _figures(results)
        self.placed: set[str] = set()
        self.listed: set[str] = set()
        self.incomplete: list[str] = []
        self.environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader([templates, HERE]),
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
            "most": numbers.most,
            "least": numbers.least,
        }
        self.environment.filters |= words
        self.environment.globals |= words | {
            "elements": [(key, ELEMENTS[key].name) for key in PLANE_ELEMENTS],
            "names": {key: element.name for key, element in ELEMENTS.items()},
            "s": results.scalar,
            "parameters": lambda key: results[key].parameters,
            "curves": self.curves,
            "measure": self.measure,
            "figure": self.figure,
            "claims_of": self.claims_of,
            "claims_table": self.claims_table,
        }

    def body(self, section: str) -> Markup:
        """Return a section's text, and after it those of its figures that the text left out."""
        try:
            text = Markup(self.environment.get_template(f"sections/{section}.html").render())
        except jinja2.TemplateNotFound as error:
            if error.name != f"sections/{section}.html":
                raise
            text = Markup()
        except MissingResult as missing:
            self.incomplete.append(f"section {section}: {missing}")
            text = Markup('<p class="note">This section is incomplete: {}.</p>').format(missing)
        except jinja2.TemplateError as error:
            raise StudyError(f"study/report/sections/{section}.html: {error}") from error
        mine = [name for name, entry in self.figures.items() if entry["section"] == section]
        return text + self._rest(mine)

    def frame(self, name: str) -> Markup:
        """Return a text that is about all sections; nothing while some of them are missing."""
        if not (self.templates / "sections" / f"{name}.html").is_file():
            return Markup()
        try:
            return Markup(self.environment.get_template(f"sections/{name}.html").render())
        except MissingResult as missing:
            self.incomplete.append(f"{name}: {missing}")
            return Markup()

    def others(self, sections: list[str]) -> Markup:
        """Return the figures of sections that are not in the report."""
        entries = self.figures.items()
        return self._rest([name for name, entry in entries if entry["section"] not in sections])

    def curves(self, key: str) -> dict[str, np.ndarray]:
        return self.results.curves(key)

    def measure(self, name: str, /, **args: object) -> float:
        """Return what a function of `study.judge.measures` makes of the results."""
        return float(
            getattr(importlib.import_module("study.judge.measures"), name)(self.results, **args)
        )

    def figure(self, name: str) -> Markup:
        """Return a figure with its caption; a remark if it has not been drawn."""
        if name in self.placed:
            raise StudyError(f"the report places figure {name} twice")
        self.placed.add(name)
        if name not in self.figures:
            self.incomplete.append(f"figure {name} has not been drawn")
        return self._part(
            "figure.html", name=name, figure=self.figures.get(name), label=self._label(name)
        )

    def claims_of(self, section: str) -> list[dict[str, Any]]:
        """Return the claims whose source names the section."""
        mine = [claim for claim in self.claims if _names(claim["source"], section)]
        self.listed |= {claim["id"] for claim in mine}
        return mine

    def general(self) -> list[dict[str, Any]]:
        """Return the claims of the paper's frame, and those that no section's text has listed."""
        return [
            claim
            for claim in self.claims
            if claim["kind"] != "pin"
            and (_GENERAL.match(claim["source"]) or claim["id"] not in self.listed)
        ]

    def claims_table(self, rows: list[dict[str, Any]], reasons: bool = True) -> Markup:
        """Return tables of the paper's claims and of findings, with or without their reasons.

        Pins are left out unless they differ.
        """
        paper = _with_readings([row for row in rows if row["kind"] in judged.PAPER])
        findings = [row for row in rows if row["kind"] == "finding"]
        pins = [row for row in rows if row["kind"] == "pin" and row["differs"]]
        titles = ("Statements of the paper", "Findings of this study", "Recorded numbers")
        parts = zip(titles, (paper, findings, pins), strict=True)
        return Markup().join(
            self._part("claims.html", title=title, rows=some, reasons=reasons)
            for title, some in parts
            if some
        )

    def _rest(self, names: list[str]) -> Markup:
        return Markup().join(self.figure(name) for name in names if name not in self.placed)

    def _part(self, template: str, **values: object) -> Markup:
        return Markup(self.environment.get_template(template).render(values))

    def _label(self, name: str) -> str:
        """Return "Figure 5" for fig05, "Figure to Table 2" for tab02; for others S1, S2 …."""
        numbered = re.compile(r"(fig|tab)(?:ure|le)?_?0*(\d+\w*)")
        if match := numbered.fullmatch(name):
            return f"{'Figure' if match[1] == 'fig' else 'Figure to Table'} {match[2]}"
        own = [other for other in self.figures if not numbered.fullmatch(other)]
        return f"Figure S{own.index(name) + 1}" if name in own else name


def _figures(results: Results) -> dict[str, dict[str, Any]]:
    """Return the index of figures by name, each with its drawing as a data URI."""
    folder = results.folder / "figures"
    remedy = "draw them again with ./run study report"
    try:
        entries = json.loads((folder / "index.json").read_bytes())
        for entry in entries:
            svg = (folder / f"{entry['name']}.svg").read_bytes()
            entry["uri"] = f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"
        return {entry["name"]: entry for entry in entries}
    except FileNotFoundError as error:
        raise MissingResult(f"there is no {error.filename}: {remedy}") from None
    except (ValueError, TypeError, KeyError) as error:
        raise CorruptResult(f"{folder / 'index.json'} cannot be used ({error}): {remedy}") from None


def _names(source: str, section: str) -> bool:
    """Tell whether a source like "Sec. 7.1, Table 2" names a section; "Eq. 3" does not name 3."""
    section = re.escape(section)
    alone = section if r"\." in section else rf"(?:^|(?:§|\b[Ss]ec(?:tions?|\.)?)\s*){section}"
    return re.search(rf"(?<![\w.]){alone}(?!\.?\w)", source) is not None


def _with_readings(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return claims in their order, other readings of a claim right after it."""
    ids = [row["id"] for row in rows]
    first = [row for row in rows if row["reading_of"] not in ids]
    return [
        one for row in first for one in (row, *(r for r in rows if r["reading_of"] == row["id"]))
    ]


def _counts(rows: list[dict[str, Any]]) -> dict[str, int]:
    """Return numbers of claims by grade, of findings and pins, and of what is not as expected."""
    counts = {grade: sum(row["grade"] == grade for row in rows) for grade in judged.GRADES}
    for kind in (*judged.PAPER, "finding", "pin"):
        mine = [row["verdict"] for row in rows if row["kind"] == kind]
        counts |= {kind: len(mine), f"{kind}_holds": mine.count("holds")}
    absent = sum(row["verdict"] == "not judged" for row in rows)
    differing = sum(row["differs"] for row in rows if row["verdict"] != "not judged")
    return {**counts, "not judged": absent, "differing": differing}


def _provenance(cases: list[Stored]) -> dict[str, Any]:
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


def _pdf(html: str) -> bytes:
    import weasyprint  # half a second, and its libraries are not needed to read the page's code

    gc.disable()  # among millions of boxes that all stay, a fifth of the time for nothing
    try:
        return weasyprint.HTML(string=html).write_pdf(pdf_variant="pdf/ua-1")
    finally:
        gc.enable()
