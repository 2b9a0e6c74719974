"""Texts with numbers out of stored results; layouts make pages of their blocks.

The text of a section stands on its page (see `BLOCKS`), chapters and layouts are files here: texts
in Markdown, layouts in HTML.

The report's layout takes of a section's text the blocks `problem`, `result` and `findings`; the
site's sheet adds `setting`, `method`, `details`, `further` and `limits`.
"""

import importlib
import json
import re
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import jinja2
import numpy as np
from markupsafe import Markup

from study.judge.claims import GRADES, PAPER
from study.model.vocabulary import (
    ELEMENTS,
    OWN_FUNCTION_READING,
    PLANE_ELEMENTS,
    TRIBUTARY_READING,
    TWO_BODY_METHODS,
    UNDEFINED_READING_NOTE,
)
from study.publish.markdown import render_markdown, render_rows
from study.publish.texts import numbers
from study.publish.texts.appendix import RATIONAL_DEGREE, computed, computed_and_recorded
from study.publish.texts.statements import (
    HOMES,
    by_fact,
    counts,
    fact_counts,
    found,
    home,
    in_words,
    names_section,
    wanted,
    with_readings,
)
from study.run.cases import SECTIONS, find_page_source
from study.run.pages import read_constants
from study.run.store import CorruptResult, MissingResult, Results, StoredResult, StudyError

HERE = Path(__file__).parent
REFERENCES: dict[str, dict[str, str]] = tomllib.loads((HERE / "references.toml").read_text("utf-8"))
for _section in SECTIONS:  # a page may bring its own
    REFERENCES |= read_constants(find_page_source(_section)).get("REFERENCES", {})
PLAIN = "/;:=,+()!*'"  # what an address may have as it is, and be shorter than by base64

BLOCKS = {
    "PROBLEM": "problem",
    "THEORY": "setting",
    "METHOD": "method",
    "RESULT": "result",
    "DETAILS": "details",
    "FINDINGS": "findings",
    "FURTHER_FINDINGS": "further",
    "LIMITS": "limits",
}
"""Texts of a page, in Markdown, and the blocks of the layouts that they fill."""

# Single letters in captions that are symbols: not units, "(a)" of a panel or, mostly, the word "a"
_ALONE = r"(?<![A-Za-z0-9.;<])(?!(?<=\()[a-z]\)){}(?![A-Za-z0-9'>])"
_LENGTH = r"(?:(?<=\d )|(?<=/)|(?<=width )|(?<=radius )|(?<=radius\) ))a"
SYMBOL = re.compile(_ALONE.format(rf"([b-dhpqrt-zEFKNP]|[λμνρω]|{_LENGTH})"))
MATRIX = re.compile(_ALONE.format("([LRT])"))
PAPERS = re.compile(r"(fig|tab)0*(\d+)(?:_0*(\d+))?")  # figures of the paper's items


class Place(NamedTuple):
    """Where a figure, a table or a section is: address, and what it is called."""

    address: str
    words: str


class Texts:
    """Texts, and what they can call: numbers, curves, measures, claims, figures and tables.

    Figures, tables and references are numbered as they come.

    Args:
        results: What is reported; its folder has the claims and the figures, too.
        folders: Where templates are looked for, before this module's own folder.
        layout: The template that arranges the blocks of a section's text.
        known: Places of figures, tables and sections, for what is referred to before it comes.
        strict: Whether all that is referred to is known.

    Attributes:
        claims: Rows of `claims.json`.
        figures: Entries of the index of figures by name, each with its drawings as data URIs.
        numbers: Numbers of figures, tables and references on the page, by kind and name.
        incomplete: What is missing, a line for each.
    """

    def __init__(
        self,
        results: Results,
        folders: Iterable[Path],
        layout: str,
        known: dict[str, Place],
        strict: bool,
    ) -> None:
        self.results = results
        self.layout = layout
        self.known = known
        self.strict = strict
        self.claims = results.claims()
        self.figures = load_figures(results)
        self.numbers: dict[tuple[str, str], int] = {}
        self.incomplete: list[str] = []
        files = jinja2.FileSystemLoader([*folders, HERE])
        self.environment = jinja2.Environment(
            loader=jinja2.ChoiceLoader([files, jinja2.FunctionLoader(_markdown_template)]),
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
            "names": {key: one.name for key, one in (ELEMENTS | TWO_BODY_METHODS).items()},
            "own": OWN_FUNCTION_READING,
            "tributary": TRIBUTARY_READING,
            "no_weight": UNDEFINED_READING_NOTE,
            "s": results.scalar,
            "has": results.__contains__,
            "parameters": lambda key: results[key].parameters,
            "curves": self.curves,
            "measure": self.measure,
            "claims_of": self.claims_of,
            "text": self.text,
            "figure": self.figure,
            "table": self.table,
            "ref": self.ref,
            "cite": self.cite,
            "cited": self.cited,
            "statements": self.statements,
            "counts": counts(self.claims),
            "fact_counts": fact_counts(self.claims),
            "graded": self.graded,
            "heads": {one: facts for one in SECTIONS if (facts := short_section_facts(one))},
            "computed": lambda section: computed(results, section),
            "computed_and_recorded": lambda: computed_and_recorded(results),
            "verification_range": _verification_range(),
            "has_section": lambda section: bool(results.cases(section)),
            "rational_degree": RATIONAL_DEGREE,
        }
        self.environment.filters |= {
            "found": found,
            "wanted": wanted,
            "in_words": in_words,
            "markdown": render_markdown,
        }

    def render(self, template: str, **values: object) -> Markup:
        """Return a template's text."""
        try:
            return Markup(self.environment.get_template(template).render(values))
        except jinja2.TemplateNotFound:
            raise
        except jinja2.TemplateError as error:
            raise StudyError(f"{template}: {error}") from error

    def text(self, name: str) -> Markup:
        """Return a text in one piece: of a section, what the layout takes of it.

        Raises:
            MissingResult: if neither a chapter nor a page with texts has this name.
        """
        try:
            text = self.render(f"{name}.html", layout=self.layout, section=name)
        except jinja2.TemplateNotFound as missing:
            raise MissingResult(f"there is no text {missing}") from None
        return _without_blank_lines(text)

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a case."""
        return self.results.curves(key)

    def measure(self, name: str, /, **args: object) -> float:
        """Return what a function of `study.judge.measures` makes of the results."""
        return float(
            getattr(importlib.import_module("study.judge.measures"), name)(self.results, **args)
        )

    def claims_of(self, section: str) -> list[dict[str, Any]]:
        """Return the claims whose source names the section."""
        return [claim for claim in self.claims if names_section(claim["source"], section)]

    def figure(self, name: str) -> Markup:
        """Return a figure with its number and caption; a remark if it has not been drawn."""
        label = f"Fig. {self.number('figure', name)}{of_the_paper(name)}"
        if name not in self.figures:
            self.incomplete.append(f"figure {name} has not been drawn")
        figure = self.render("figure.html", name=name, figure=self.drawing(name), label=label)
        return _without_blank_lines(figure)

    def drawing(self, name: str) -> dict[str, Any] | None:
        """Return a figure's entry with the addresses of its drawings; None if there is none."""
        return self.figures.get(name)

    def table(
        self, name: str, caption: str, caller: Callable[[], str], of: str = "", long: bool = False
    ) -> Markup:
        """Return a table with its number and caption; `caller` gives its rows.

        One `of` a table of the paper says so; a long one may be broken by a page's end.
        """
        paper = f" (the paper's Table {of})" if of else ""
        label = f"Table {self.number('table', name)}{paper}"
        rows = caller()
        table = self.render(
            "table.html",
            name=name,
            label=label,
            caption=italics(caption),
            rows=render_rows(rows) if rows.lstrip().startswith("|") else rows,
            long=long,
        )
        return _without_blank_lines(table)

    def ref(self, name: str) -> Markup:
        """Return a link to a figure, a table or a section, by the number that it has."""
        if (place := self.known.get(name)) is not None:
            return Markup('<a href="{}">{}</a>').format(*place)
        if self.strict:
            raise StudyError(f"a text refers to {name}, which is not there")
        return Markup("?")  # numbers are not known yet, or results are missing

    def cite(self, *names: str) -> Markup:
        """Return numbers of references, as links."""
        for name in names:
            if name not in REFERENCES:
                raise StudyError(f"a text cites {name}, which is no reference")
            if ("reference", name) not in self.numbers:
                self.number("reference", name)
        links = [
            Markup('<a href="#ref-{}">{}</a>').format(name, self.numbers["reference", name])
            for name in names
        ]
        return Markup("[{}]").format(Markup(", ").join(links))

    def cited(self) -> list[dict[str, str]]:
        """Return key, text and address of what is cited, in the order of the numbers."""
        keys = [name for kind, name in self.numbers if kind == "reference"]
        return [{"key": key, "url": "", "address": "", **REFERENCES[key]} for key in keys]

    def statements(self, *homes: str) -> Markup:
        """Return a table of the paper's statements in some sections; without any, of the others."""
        table = self.render("statements.html", groups=by_fact(self._of_paper(homes)))
        return _without_blank_lines(table)

    def graded(self, *homes: str) -> Markup:
        """Return how many statements of some sections have which grade, in words."""
        grades = [row["grade"] for row in self._of_paper(homes)]
        return Markup(", ").join(
            f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades
        )

    def _of_paper(self, homes: tuple[str, ...]) -> list[dict[str, Any]]:
        rows = with_readings([row for row in self.claims if row["kind"] in PAPER])
        if not homes:
            return [row for row in rows if home(row["source"]) not in HOMES]
        return [row for row in rows if home(row["source"]) in homes]

    def number(self, kind: str, name: str) -> int:
        """Return the next number of a figure, a table or a reference, and keep it."""
        if (kind, name) in self.numbers:
            raise StudyError(f"a page places {kind} {name} twice")
        number = 1 + sum(other == kind for other, _ in self.numbers)
        self.numbers[kind, name] = number
        return number

    def places(self, page: str = "") -> dict[str, Place]:
        """Return the places of the figures and tables that have been numbered on a page."""
        words = {"figure": "Fig.", "table": "Table"}
        return {
            name: Place(f"{page}#{name}", f"{words[kind]}\N{NO-BREAK SPACE}{number}")
            for (kind, name), number in self.numbers.items()
            if kind in words
        }


def _markdown_template(name: str) -> str | None:
    """Return the template of a chapter, or of a section by its page; None if there is no text.

    Chapters are files in Markdown beside this module. Texts of a section are constants of its page.
    """
    section = name.removesuffix(".html")
    chapter = HERE / f"{section}.md"
    if chapter.is_file():
        return f"{{% filter markdown %}}{chapter.read_text('utf-8')}{{% endfilter %}}"
    if section not in SECTIONS:
        return None
    texts = read_constants(find_page_source(section))
    blocks = [
        f"{{% block {block} %}}{{% filter markdown %}}{texts[constant]}{{% endfilter %}}"
        "{% endblock %}"
        for constant, block in BLOCKS.items()
        if constant in texts
    ]
    if not blocks:
        return None
    return "\n".join(["{% extends layout %}", texts.get("MACROS", ""), *blocks])


def _without_blank_lines(html: Markup) -> Markup:
    """Return HTML in one piece: a blank line would end it within Markdown."""
    return Markup("\n").join(line for line in html.splitlines() if line.strip()) + "\n"


def section_facts(section: str) -> dict[str, str]:
    """Return geometry, mesh, material and so on of a section, as its page says."""
    facts: dict[str, str] = read_constants(find_page_source(section)).get("FACTS", {})
    return facts


def short_section_facts(section: str) -> dict[str, str]:
    """Return the same in words for which the report's appendix has room."""
    short: dict[str, str] = read_constants(find_page_source(section)).get("SHORT_FACTS", {})
    return section_facts(section) | short


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
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise CorruptResult(f"{folder / 'index.json'} cannot be used ({error}): {remedy}") from None


def italics(text: str) -> Markup:
    """Write a plain text, such as a caption, with its symbols in italics, matrices bold, too."""
    safe = MATRIX.sub(r"<b><i>\1</i></b>", str(Markup.escape(text)))
    return Markup(SYMBOL.sub(r"<i>\1</i>", safe))


def of_the_paper(name: str) -> str:
    """Return " (the paper's Figs 7 and 8)" for fig07_08; nothing for figures of this study."""
    if not (match := PAPERS.fullmatch(name)):
        return ""
    if match[1] == "tab":
        return f" (to the paper's Table {match[2]})"
    if match[3] is None:
        return f" (the paper's Fig. {match[2]})"
    joint = " and " if int(match[3]) == int(match[2]) + 1 else " to "
    return f" (the paper's Figs {match[2]}{joint}{match[3]})"


def provenance(cases: list[StoredResult]) -> dict[str, Any]:
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


def _verification_range() -> str:
    """Return the first and the last of the sections V1, V2 and so on, in words."""
    sections = [section for section in SECTIONS if section.startswith("V")]
    return " to ".join([*sections[:1], *sections[-1:]])


def _letter(index: int) -> str:
    return chr(ord("A") + index)
