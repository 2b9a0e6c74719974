"""Render texts that contain numbers from stored results, and arrange them in layouts.

The text of a section consists of constants of the section's page, see `BLOCK_OF_CONSTANT`. Chapters
(Markdown) and layouts (HTML) are files in this folder.

The report's layout includes the blocks `problem`, `result` and `findings` of a section's text. The
site's sheets also include `setting`, `method`, `details`, `further` and `limits`.
"""

import importlib
import json
import re
import tomllib
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import jinja2
import numpy as np
from markupsafe import Markup

from study.judge.claims import GRADES, PAPER_KINDS
from study.judge.mesh_series import estimate_uncertainties
from study.model.vocabulary import (
    ELEMENTS,
    OWN_FUNCTION_READING,
    PLANE_ELEMENTS,
    TRIBUTARY_READING,
    TWO_BODY_METHODS,
    UNDEFINED_READING_NOTE,
)
from study.publish.markdown import render_markdown, render_table_rows
from study.publish.reproducibility import summarize_reproducibility
from study.publish.texts import numbers
from study.publish.texts.computations import (
    NON_POLYNOMIAL_DEGREE,
    count_computed_and_recorded,
    describe_computation,
)
from study.publish.texts.statements import (
    EXAMPLE_SECTIONS,
    count_claims,
    count_facts,
    format_criterion,
    format_measured,
    format_statement,
    group_by_fact,
    group_readings,
    section_of_source,
    source_names_section,
)
from study.run.cases import SECTIONS, find_page_source
from study.run.pages import read_constants
from study.run.store import CorruptResult, MissingResult, Results, StoredResult, StudyError

TEXTS_FOLDER = Path(__file__).parent
REFERENCES: dict[str, dict[str, str]] = tomllib.loads(
    (TEXTS_FOLDER / "references.toml").read_text("utf-8")
)
for _section in SECTIONS:  # a page may define additional references
    REFERENCES |= read_constants(find_page_source(_section)).get("REFERENCES", {})
URI_SAFE_CHARACTERS = "/;:=,+()!*'"  # need no escape in a URI, which makes it shorter than base64

BLOCK_OF_CONSTANT = {
    "PROBLEM": "problem",
    "THEORY": "setting",
    "METHOD": "method",
    "RESULT": "result",
    "DETAILS": "details",
    "FINDINGS": "findings",
    "FURTHER_FINDINGS": "further",
    "LIMITS": "limits",
}
"""Name of the layout block that each constant of a page (Markdown text) fills."""

# Single letters in captions that are symbols, excluding units, panel labels such as "(a)" and (in
# most cases) the word "a"
_STANDALONE_LETTER = r"(?<![A-Za-z0-9.;<])(?!(?<=\()[a-z]\)){}(?![A-Za-z0-9'>])"
_LENGTH_SYMBOL_A = r"(?:(?<=\d )|(?<=/)|(?<=width )|(?<=radius )|(?<=radius\) ))a"
SYMBOL_PATTERN = re.compile(
    _STANDALONE_LETTER.format(rf"([b-dhpqrt-zEFKNP]|[λμνρω]|{_LENGTH_SYMBOL_A})")
)
MATRIX_PATTERN = re.compile(_STANDALONE_LETTER.format("([LRT])"))
PAPER_ITEM_PATTERN = re.compile(r"(fig|tab)0*(\d+)(?:_0*(\d+))?")  # figures of the paper's items


class LinkTarget(NamedTuple):
    """Address and label of a figure, a table or a section, for links."""

    address: str
    label: str


class TextRenderer:
    """Renderer of texts, which provides them with numbers, curves, claims, figures and tables.

    Figures, tables and references are numbered in the order in which they occur.

    Args:
        results: Results to report, whose folder also contains the claims and figures.
        template_folders: Folders that are searched for templates before the folder of this module.
        layout: Template that arranges the blocks of a section's text.
        link_targets: Targets of links to figures, tables and sections from a first pass, which
            allow forward references.
        strict: Whether a reference to an unknown target is an error.

    Attributes:
        claims: Rows of `claims.json`.
        figures: Entries of the index of figures by name, with drawings as data URIs.
        item_numbers: Numbers of figures, tables and references on the page, by kind and name.
        missing_content: Messages on missing content.
    """

    def __init__(
        self,
        results: Results,
        template_folders: Iterable[Path],
        layout: str,
        link_targets: dict[str, LinkTarget],
        strict: bool,
    ) -> None:
        self.results = results
        self.layout = layout
        self.link_targets = link_targets
        self.strict = strict
        self.claims = results.claims()
        self.figures = load_figures(results)
        self.item_numbers: dict[tuple[str, str], int] = {}
        self.missing_content: list[str] = []
        file_loader = jinja2.FileSystemLoader([*template_folders, TEXTS_FOLDER])
        self.environment = jinja2.Environment(
            loader=jinja2.ChoiceLoader(
                [file_loader, jinja2.FunctionLoader(_load_markdown_template)]
            ),
            undefined=jinja2.StrictUndefined,
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        filters_and_globals: dict[str, Callable[..., Markup]] = {
            "num": numbers.format_number,
            "short": numbers.format_short_number,
            "pct": numbers.format_percent,
            "fixed": numbers.format_decimals,
            "count": numbers.format_count,
            "most": numbers.format_upper_bound,
            "least": numbers.format_lower_bound,
            "italics": italicize_symbols,
        }
        self.environment.filters |= filters_and_globals
        self.environment.globals |= filters_and_globals | {
            "elements": [(key, ELEMENTS[key].name) for key in PLANE_ELEMENTS],
            "names": {key: one.name for key, one in (ELEMENTS | TWO_BODY_METHODS).items()},
            "own": OWN_FUNCTION_READING,
            "tributary": TRIBUTARY_READING,
            "no_weight": UNDEFINED_READING_NOTE,
            "s": results.scalar,
            "has": results.__contains__,
            "parameters": lambda key: results[key].parameters,
            "curves": self.curves,
            "measure": self.evaluate_measure,
            "claims_of": self.claims_of_section,
            "text": self.render_text,
            "figure": self.render_figure,
            "table": self.render_table,
            "ref": self.render_link,
            "cite": self.render_citation,
            "cited": self.list_cited_references,
            "statements": self.render_statements,
            "verification_rows": self.render_verification_rows,
            "counts": count_claims(self.claims),
            "fact_counts": count_facts(self.claims),
            "graded": self.format_grade_counts,
            "graded_all": self.format_all_grade_counts,
            "heads": {
                name: short_facts for name in SECTIONS if (short_facts := short_section_facts(name))
            },
            "computed": lambda section: describe_computation(results, section),
            "computed_and_recorded": lambda: count_computed_and_recorded(results),
            "reproducibility": cache(lambda: summarize_reproducibility(results)),
            "verification_range": _format_range_of_verification_sections(),
            "has_section": lambda section: bool(results.cases(section)),
            "rational_degree": NON_POLYNOMIAL_DEGREE,
            "uncertainties": lambda: estimate_uncertainties(results),
        }
        self.environment.filters |= {
            "found": format_measured,
            "wanted": format_criterion,
            "in_words": format_statement,
            "markdown": render_markdown,
        }

    def render(self, template: str, **values: object) -> Markup:
        """Render a template with the given values."""
        try:
            return Markup(self.environment.get_template(template).render(values))
        except jinja2.TemplateNotFound:
            raise
        except jinja2.TemplateError as error:
            raise StudyError(f"{template}: {error}") from error

    def render_text(self, name: str) -> Markup:
        """Render a chapter, or the blocks of a section's text that the layout includes.

        Raises:
            MissingResult: if there is neither a chapter nor a section with texts of this name.
        """
        try:
            text = self.render(f"{name}.html", layout=self.layout, section=name)
        except jinja2.TemplateNotFound as error:
            raise MissingResult(f"there is no text {error}") from None
        return _remove_blank_lines(text)

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a case."""
        return self.results.curves(key)

    def evaluate_measure(self, name: str, /, **args: object) -> float:
        """Return the value of a measure in `study.judge.measures` for the results."""
        return float(
            getattr(importlib.import_module("study.judge.measures"), name)(self.results, **args)
        )

    def claims_of_section(self, section: str) -> list[dict[str, Any]]:
        """Return the claims whose source names the section."""
        return [claim for claim in self.claims if source_names_section(claim["source"], section)]

    def render_figure(self, name: str) -> Markup:
        """Return a figure with its number and caption, or a note if it has not been drawn."""
        label = f"Fig. {self.assign_number('figure', name)}{paper_citation(name)}"
        if name not in self.figures:
            self.missing_content.append(f"figure {name} has not been drawn")
        figure = self.render("figure.html", name=name, figure=self.figure_entry(name), label=label)
        return _remove_blank_lines(figure)

    def figure_entry(self, name: str) -> dict[str, Any] | None:
        """Return a figure's entry with the addresses of its drawings; None if it is missing."""
        return self.figures.get(name)

    def render_table(
        self, name: str, caption: str, caller: Callable[[], str], of: str = "", long: bool = False
    ) -> Markup:
        """Return a table with its number and caption.

        `caller` returns the rows in Markdown or HTML. `of` is the number of the corresponding table
        of the paper, if any. A `long` table may be split across pages.
        """
        source_note = f" (the paper's Table {of})" if of else ""
        label = f"Table {self.assign_number('table', name)}{source_note}"
        rows = caller()
        table = self.render(
            "table.html",
            name=name,
            label=label,
            caption=italicize_symbols(caption),
            rows=render_table_rows(rows) if rows.lstrip().startswith("|") else rows,
            long=long,
        )
        return _remove_blank_lines(table)

    def render_link(self, name: str) -> Markup:
        """Return a link to a figure, a table or a section, with its number as text."""
        if (target := self.link_targets.get(name)) is not None:
            return Markup('<a href="{}">{}</a>').format(*target)
        if self.strict:
            raise StudyError(f"a text refers to {name}, which is not there")
        return Markup("?")  # in the first pass, or if results are missing

    def render_citation(self, *names: str) -> Markup:
        """Return the numbers of references as links."""
        for name in names:
            if name not in REFERENCES:
                raise StudyError(f"a text cites {name}, which is no reference")
            if ("reference", name) not in self.item_numbers:
                self.assign_number("reference", name)
        links = [
            Markup('<a href="#ref-{}">{}</a>').format(name, self.item_numbers["reference", name])
            for name in names
        ]
        return Markup("[{}]").format(Markup(", ").join(links))

    def list_cited_references(self) -> list[dict[str, str]]:
        """Return the key, text and address of each cited reference, in the order of numbers."""
        keys = [name for kind, name in self.item_numbers if kind == "reference"]
        return [{"key": key, "url": "", "address": "", **REFERENCES[key]} for key in keys]

    def render_statements(self, *sections: str) -> Markup:
        """Return a table of the paper's statements in some sections.

        Without sections, the table contains the statements outside `EXAMPLE_SECTIONS`.
        """
        table = self.render(
            "statements.html", groups=group_by_fact(self._paper_statements(sections))
        )
        return _remove_blank_lines(table)

    def render_verification_rows(self) -> Markup:
        """Return the rows of the verification table.

        The constant `VERIFICATION` of a page contains rows in Markdown with the problem, the
        reference, the quantity, and its errors with the new and the standard element. For
        benchmarks without this constant, a row with the reference is generated.
        """
        rows = []
        for section in SECTIONS:
            page_path = find_page_source(section)
            constants = read_constants(page_path)
            if not self.results.cases(section):
                continue
            if "VERIFICATION" in constants:
                texts = constants["VERIFICATION"].strip().splitlines()
            elif "benchmarks" in page_path.parts:
                facts = short_section_facts(section)
                texts = [f"| {constants['TITLE']} | {facts['reference']} | see its page | | |"]
            else:
                texts = []
            rows += [f"| {section} {text}" for text in texts]
        return Markup(self.environment.from_string("\n".join(rows)).render())

    def format_grade_counts(self, *sections: str) -> Markup:
        """Return a text with the number of statements of each grade in some sections."""
        return _count_grades([row["grade"] for row in self._paper_statements(sections)])

    def format_all_grade_counts(self) -> Markup:
        """Return a text with the number of all statements of the paper of each grade."""
        return _count_grades([row["grade"] for row in self.claims if row["kind"] in PAPER_KINDS])

    def _paper_statements(self, sections: tuple[str, ...]) -> list[dict[str, Any]]:
        rows = group_readings([row for row in self.claims if row["kind"] in PAPER_KINDS])
        if not sections:
            return [row for row in rows if section_of_source(row["source"]) not in EXAMPLE_SECTIONS]
        return [row for row in rows if section_of_source(row["source"]) in sections]

    def assign_number(self, kind: str, name: str) -> int:
        """Assign the next number to a figure, a table or a reference, and return it."""
        if (kind, name) in self.item_numbers:
            raise StudyError(f"a page places {kind} {name} twice")
        number = 1 + sum(other_kind == kind for other_kind, _ in self.item_numbers)
        self.item_numbers[kind, name] = number
        return number

    def list_link_targets(self, page: str = "") -> dict[str, LinkTarget]:
        """Return the link targets of all figures and tables that have been numbered on a page."""
        labels = {"figure": "Fig.", "table": "Table"}
        return {
            name: LinkTarget(f"{page}#{name}", f"{labels[kind]}\N{NO-BREAK SPACE}{number}")
            for (kind, name), number in self.item_numbers.items()
            if kind in labels
        }


def _load_markdown_template(name: str) -> str | None:
    """Return the template of a chapter or section, or None if there is no text of this name.

    Chapters are Markdown files in the folder of this module. Texts of a section are constants of
    its page.
    """
    section = name.removesuffix(".html")
    chapter_path = TEXTS_FOLDER / f"{section}.md"
    if chapter_path.is_file():
        return f"{{% filter markdown %}}{chapter_path.read_text('utf-8')}{{% endfilter %}}"
    if section not in SECTIONS:
        return None
    texts = read_constants(find_page_source(section))
    blocks = [
        f"{{% block {block} %}}{{% filter markdown %}}{texts[constant]}{{% endfilter %}}"
        "{% endblock %}"
        for constant, block in BLOCK_OF_CONSTANT.items()
        if constant in texts
    ]
    if not blocks:
        return None
    return "\n".join(["{% extends layout %}", texts.get("MACROS", ""), *blocks])


def _count_grades(grades: list[str]) -> Markup:
    """Return how many of the grades there are of each kind, as "24 reproduced, 3 contradicted"."""
    return Markup(", ").join(
        f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades
    )


def _remove_blank_lines(html: Markup) -> Markup:
    """Return HTML without blank lines, which would end an HTML block in Markdown."""
    return Markup("\n").join(line for line in html.splitlines() if line.strip()) + "\n"


def section_facts(section: str) -> dict[str, str]:
    """Return the geometry, mesh, material etc. that the page of a section states."""
    facts: dict[str, str] = read_constants(find_page_source(section)).get("FACTS", {})
    return facts


def short_section_facts(section: str) -> dict[str, str]:
    """Return the `section_facts`, abbreviated for tables where the page does so."""
    short_facts: dict[str, str] = read_constants(find_page_source(section)).get("SHORT_FACTS", {})
    return section_facts(section) | short_facts


def load_figures(results: Results) -> dict[str, dict[str, Any]]:
    """Return the entries of the index of figures by name, with drawings as data URIs."""
    folder = results.folder / "figures"
    remedy = "draw them again with ./run study report"
    try:
        entries = json.loads((folder / "index.json").read_bytes())
        for entry in entries:
            for key, suffix in (("uri", "svg"), ("narrow_uri", "narrow.svg")):
                drawing = (folder / f"{entry['name']}.{suffix}").read_text(encoding="utf-8")
                entry[key] = f"data:image/svg+xml,{quote(drawing, safe=URI_SAFE_CHARACTERS)}"
        return {entry["name"]: entry for entry in entries}
    except FileNotFoundError as error:
        raise MissingResult(f"there is no {error.filename}: {remedy}") from None
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise CorruptResult(f"{folder / 'index.json'} cannot be used ({error}): {remedy}") from None


def italicize_symbols(text: str) -> Markup:
    """Set the symbols of a plain text such as a caption in italics, and matrices also in bold."""
    escaped_text = MATRIX_PATTERN.sub(r"<b><i>\1</i></b>", str(Markup.escape(text)))
    return Markup(SYMBOL_PATTERN.sub(r"<i>\1</i>", escaped_text))


def paper_citation(name: str) -> str:
    """Return e.g. " (the paper's Figs 7 and 8)" for fig07_08, or "" for figures of this study."""
    if not (match := PAPER_ITEM_PATTERN.fullmatch(name)):
        return ""
    if match[1] == "tab":
        return f" (to the paper's Table {match[2]})"
    if match[3] is None:
        return f" (the paper's Fig. {match[2]})"
    conjunction = " and " if int(match[3]) == int(match[2]) + 1 else " to "
    return f" (the paper's Figs {match[2]}{conjunction}{match[3]})"


def summarize_provenance(cases: list[StoredResult]) -> dict[str, Any]:
    """Return the provenance of cases, and the distinct sets of versions, labelled by letters."""
    version_sets: list[dict[str, str]] = []
    rows = []
    for case in cases:
        case_provenance = case.provenance
        versions = case_provenance.get("versions", {})
        if versions not in version_sets:
            version_sets.append(versions)
        rows.append(
            {"key": case.key, "letter": _letter(version_sets.index(versions)), **case_provenance}
        )
    return {
        "cases": rows,
        "versions": {_letter(i): version_set for i, version_set in enumerate(version_sets)},
    }


def _format_range_of_verification_sections() -> str:
    """Return a text with the first and last of the sections V1, V2 etc."""
    sections = [section for section in SECTIONS if section.startswith("V")]
    return " to ".join([*sections[:1], *sections[-1:]])


def _letter(index: int) -> str:
    return chr(ord("A") + index)
