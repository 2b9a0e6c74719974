"""Render the texts of report and website, which contain numbers from stored results.

The text of a section consists of Markdown constants of the section's page; each constant fills one
block of a layout (see `BLOCK_OF_CONSTANT`). Chapters (Markdown) and layouts (HTML) are files in
this folder.

The report's layout includes the blocks `problem`, `result` and `findings`. The website's layout
also includes `setting`, `method`, `details`, `further` and `limits`.
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
from study.judge.mesh_series import estimate_convergence_of_quantities
from study.model.vocabulary import (
    ELEMENTS,
    OWN_FUNCTION_READING,
    PLANE_ELEMENTS,
    TRIBUTARY_READING,
    TWO_BODY_METHODS,
    UNDEFINED_READING_NOTE,
)
from study.publish.markdown import render_markdown, render_table_head_and_body
from study.publish.reproducibility import summarize_reproducibility
from study.publish.texts import numbers
from study.publish.texts.computations import (
    NON_POLYNOMIAL_DEGREE,
    count_computed_and_recorded_results,
    describe_computation_of_section,
)
from study.publish.texts.statements import (
    EXAMPLE_SECTIONS,
    count_claims_by_grade_and_kind,
    count_statements_and_facts_by_grade,
    first_section_named_by_source,
    format_criterion,
    format_measured,
    format_statement,
    group_claims_by_fact,
    place_alternative_readings_after_claim,
    source_names_section,
)
from study.run.cases import SECTIONS, find_page_source
from study.run.pages import read_literal_constants
from study.run.store import CorruptResult, MissingResult, Results, StoredResult, StudyError

TEXTS_FOLDER = Path(__file__).parent
REFERENCES: dict[str, dict[str, str]] = tomllib.loads(
    (TEXTS_FOLDER / "references.toml").read_text("utf-8")
)
for _section in SECTIONS:  # a page may define additional references
    REFERENCES |= read_literal_constants(find_page_source(_section)).get("REFERENCES", {})
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
"""Block of the layout that each Markdown constant of a page fills."""

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
    """Target of links to a figure, table or section.

    Attributes:
        address: URL, which may be relative or a fragment.
        label: Text of the link, such as "Fig. 3".
    """

    address: str
    label: str


class TextRenderer:
    """Renderer of Jinja templates that can insert numbers, curves, claims, figures and tables.

    Figures, tables and references are numbered in the order in which they occur.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        template_folders: Folders that are searched for templates before the folder of this module.
        layout: Name of the template that arranges the blocks of a section's text.
        link_targets: Addresses of figures, tables and sections from a first pass, such that a text
            can refer to items that follow.
        strict: Whether a reference to an unknown target is an error; otherwise "?" is inserted.

    Attributes:
        claims: Judged claims, read from `claims.json`.
        figures: Entries of the index of figures by name, with drawings as data URIs.
        item_numbers: Numbers of the figures, tables and references on the page, by kind and name.
        missing_content: Messages on missing results and figures.
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
        self.figures = load_index_of_drawn_figures(results)
        self.item_numbers: dict[tuple[str, str], int] = {}
        self.missing_content: list[str] = []
        file_loader = jinja2.FileSystemLoader([*template_folders, TEXTS_FOLDER])
        self.environment = jinja2.Environment(
            loader=jinja2.ChoiceLoader(
                [file_loader, jinja2.FunctionLoader(_load_chapter_or_section_template)]
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
            "statements": self.render_table_of_paper_statements,
            "verification_rows": self.render_rows_of_verification_table,
            "counts": count_claims_by_grade_and_kind(self.claims),
            "fact_counts": count_statements_and_facts_by_grade(self.claims),
            "graded": self.format_grade_counts,
            "graded_all": self.format_all_grade_counts,
            "heads": {
                name: short_facts
                for name in SECTIONS
                if (short_facts := read_short_problem_data_of_section(name))
            },
            "computed": lambda section: describe_computation_of_section(results, section),
            "computed_and_recorded": lambda: count_computed_and_recorded_results(results),
            "reproducibility": cache(lambda: summarize_reproducibility(results)),
            "verification_range": _format_range_of_verification_sections(),
            "has_section": lambda section: bool(results.cases(section)),
            "rational_degree": NON_POLYNOMIAL_DEGREE,
            "uncertainties": lambda: estimate_convergence_of_quantities(results),
        }
        self.environment.filters |= {
            "found": format_measured,
            "wanted": format_criterion,
            "in_words": format_statement,
            "markdown": render_markdown,
        }

    def render_template(self, template: str, **values: object) -> Markup:
        """Render a template.

        Args:
            template: Name of the template.
            values: Variables of the template.

        Raises:
            StudyError: If the template contains an error.
        """
        try:
            return Markup(self.environment.get_template(template).render(values))
        except jinja2.TemplateNotFound:
            raise
        except jinja2.TemplateError as error:
            raise StudyError(f"{template}: {error}") from error

    def render_text(self, name: str) -> Markup:
        """Render a chapter, or those blocks of a section's text that the layout includes.

        Args:
            name: Name of the chapter or section.

        Raises:
            MissingResult: If neither a chapter nor a section with texts has this name.
        """
        try:
            text = self.render_template(f"{name}.html", layout=self.layout, section=name)
        except jinja2.TemplateNotFound as error:
            raise MissingResult(f"there is no text {error}") from None
        return _remove_blank_lines(text)

    def curves(self, key: str) -> dict[str, np.ndarray]:
        """Return the curves of a case."""
        return self.results.curves(key)

    def evaluate_measure(self, name: str, /, **args: object) -> float:
        """Evaluate a function of `study.judge.measures` for the stored results.

        Args:
            name: Name of the function.
            args: Its keyword arguments.
        """
        return float(
            getattr(importlib.import_module("study.judge.measures"), name)(self.results, **args)
        )

    def claims_of_section(self, section: str) -> list[dict[str, Any]]:
        """Return the judged claims whose source in the paper or study names the section."""
        return [claim for claim in self.claims if source_names_section(claim["source"], section)]

    def render_figure(self, name: str) -> Markup:
        """Number a figure and render it with its caption, or a note if it has not been drawn."""
        number = self.assign_next_item_number("figure", name)
        label = f"Fig. {number}{format_citation_of_paper_figure(name)}"
        if name not in self.figures:
            self.missing_content.append(f"figure {name} has not been drawn")
        figure = self.render_template(
            "figure.html", name=name, figure=self.figure_entry(name), label=label
        )
        return _remove_blank_lines(figure)

    def figure_entry(self, name: str) -> dict[str, Any] | None:
        """Return the index entry of a figure, with its address; None if it has not been drawn."""
        return self.figures.get(name)

    def render_table(
        self, name: str, caption: str, caller: Callable[[], str], of: str = "", long: bool = False
    ) -> Markup:
        """Assign a number to a table and render it with its caption, as a call block of Jinja.

        Args:
            name: Name of the table, for links.
            caption: Caption.
            caller: Function that returns the rows in Markdown or HTML, i.e. the content of the call
                block.
            of: Number of the corresponding table of the paper; empty if there is none.
            long: Whether the table may be split across pages.
        """
        source_note = f" (the paper's Table {of})" if of else ""
        label = f"Table {self.assign_next_item_number('table', name)}{source_note}"
        rows = caller()
        table = self.render_template(
            "table.html",
            name=name,
            label=label,
            caption=italicize_symbols(caption),
            rows=render_table_head_and_body(rows) if rows.lstrip().startswith("|") else rows,
            long=long,
        )
        return _remove_blank_lines(table)

    def render_link(self, name: str) -> Markup:
        """Return a link to a figure, table or section, with its number as text.

        Raises:
            StudyError: If the target is unknown and the renderer is strict.
        """
        if (target := self.link_targets.get(name)) is not None:
            return Markup('<a href="{}">{}</a>').format(*target)
        if self.strict:
            raise StudyError(f"a text refers to {name}, which is not there")
        return Markup("?")  # in the first pass, or if results are missing

    def render_citation(self, *names: str) -> Markup:
        """Cite references by their numbers, as in "[1, 3]", with links to the list of references.

        Raises:
            StudyError: If a name is not among `REFERENCES`.
        """
        for name in names:
            if name not in REFERENCES:
                raise StudyError(f"a text cites {name}, which is no reference")
            if ("reference", name) not in self.item_numbers:
                self.assign_next_item_number("reference", name)
        links = [
            Markup('<a href="#ref-{}">{}</a>').format(name, self.item_numbers["reference", name])
            for name in names
        ]
        return Markup("[{}]").format(Markup(", ").join(links))

    def list_cited_references(self) -> list[dict[str, str]]:
        """Return the references cited so far, in the order of their numbers.

        Returns:
            Entries of `REFERENCES` with keys such as "text", "url" and "address", and "key".
        """
        keys = [name for kind, name in self.item_numbers if kind == "reference"]
        return [{"key": key, "url": "", "address": "", **REFERENCES[key]} for key in keys]

    def render_table_of_paper_statements(self, *sections: str) -> Markup:
        """Render a table of the paper's statements, with their verdicts.

        Args:
            sections: Sections of the paper. If none is given, the table contains the statements
                outside `EXAMPLE_SECTIONS`.
        """
        table = self.render_template(
            "statements.html", groups=group_claims_by_fact(self._select_paper_statements(sections))
        )
        return _remove_blank_lines(table)

    def render_rows_of_verification_table(self) -> Markup:
        """Render the rows of the table of verification problems, in Markdown.

        The constant `VERIFICATION` of a page contains rows with the problem, the reference
        solution, the quantity, and its errors with the new and the standard element. For benchmarks
        without this constant, the row contains the title and the reference only.
        """
        rows = []
        for section in SECTIONS:
            page_path = find_page_source(section)
            constants = read_literal_constants(page_path)
            if not self.results.cases(section):
                continue
            if "VERIFICATION" in constants:
                texts = constants["VERIFICATION"].strip().splitlines()
            elif "benchmarks" in page_path.parts:
                facts = read_short_problem_data_of_section(section)
                texts = [f"| {constants['TITLE']} | {facts['reference']} | see its page | | |"]
            else:
                texts = []
            rows += [f"| {section} {text}" for text in texts]
        return Markup(self.environment.from_string("\n".join(rows)).render())

    def format_grade_counts(self, *sections: str) -> Markup:
        """Return a text with the number of the paper's statements of each grade.

        Args:
            sections: Sections of the paper. If none is given, the statements outside
                `EXAMPLE_SECTIONS` are counted.
        """
        return _format_count_of_each_grade(
            [row["grade"] for row in self._select_paper_statements(sections)]
        )

    def format_all_grade_counts(self) -> Markup:
        """Return a text with the number of all statements of the paper of each grade."""
        return _format_count_of_each_grade(
            [row["grade"] for row in self.claims if row["kind"] in PAPER_KINDS]
        )

    def _select_paper_statements(self, sections: tuple[str, ...]) -> list[dict[str, Any]]:
        rows = place_alternative_readings_after_claim(
            [row for row in self.claims if row["kind"] in PAPER_KINDS]
        )
        if not sections:
            return [
                row
                for row in rows
                if first_section_named_by_source(row["source"]) not in EXAMPLE_SECTIONS
            ]
        return [row for row in rows if first_section_named_by_source(row["source"]) in sections]

    def assign_next_item_number(self, kind: str, name: str) -> int:
        """Assign the next number to a figure, table or reference, and return the number.

        Args:
            kind: "figure", "table" or "reference".
            name: Name of the item.

        Raises:
            StudyError: If the item already has a number on this page.
        """
        if (kind, name) in self.item_numbers:
            raise StudyError(f"a page places {kind} {name} twice")
        number = 1 + sum(other_kind == kind for other_kind, _ in self.item_numbers)
        self.item_numbers[kind, name] = number
        return number

    def link_targets_of_figures_and_tables(self, page: str = "") -> dict[str, LinkTarget]:
        """Return the link targets of all figures and tables numbered so far.

        Args:
            page: Address of the page that contains them; empty for the current page.
        """
        labels = {"figure": "Fig.", "table": "Table"}
        return {
            name: LinkTarget(f"{page}#{name}", f"{labels[kind]}\N{NO-BREAK SPACE}{number}")
            for (kind, name), number in self.item_numbers.items()
            if kind in labels
        }


def _load_chapter_or_section_template(name: str) -> str | None:
    """Return the Jinja template of a chapter or section, or None if there is no text of this name.

    Chapters are Markdown files in the folder of this module. The text of a section consists of
    constants of its page.

    Args:
        name: Name of the chapter or section with the extension ".html".
    """
    section = name.removesuffix(".html")
    chapter_path = TEXTS_FOLDER / f"{section}.md"
    if chapter_path.is_file():
        return f"{{% filter markdown %}}{chapter_path.read_text('utf-8')}{{% endfilter %}}"
    if section not in SECTIONS:
        return None
    texts = read_literal_constants(find_page_source(section))
    blocks = [
        f"{{% block {block} %}}{{% filter markdown %}}{texts[constant]}{{% endfilter %}}"
        "{% endblock %}"
        for constant, block in BLOCK_OF_CONSTANT.items()
        if constant in texts
    ]
    if not blocks:
        return None
    return "\n".join(["{% extends layout %}", texts.get("MACROS", ""), *blocks])


def _format_count_of_each_grade(grades: list[str]) -> Markup:
    """Return the number of statements of each grade as text: "24 reproduced, 3 contradicted"."""
    return Markup(", ").join(
        f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades
    )


def _remove_blank_lines(html: Markup) -> Markup:
    """Return HTML without blank lines, which would end an HTML block in Markdown."""
    return Markup("\n").join(line for line in html.splitlines() if line.strip()) + "\n"


def read_problem_data_of_section(section: str) -> dict[str, str]:
    """Read the data of a section's problem, which its page states in the constant `FACTS`.

    Returns:
        Texts by name: "geometry", "mesh", "material", "supports", "load", "reference" and
        "uncertainty", if stated.
    """
    facts: dict[str, str] = read_literal_constants(find_page_source(section)).get("FACTS", {})
    return facts


def read_short_problem_data_of_section(section: str) -> dict[str, str]:
    """Read the problem data of a section, with shorter texts for tables."""
    short_facts: dict[str, str] = read_literal_constants(find_page_source(section)).get(
        "SHORT_FACTS", {}
    )
    return read_problem_data_of_section(section) | short_facts


def load_index_of_drawn_figures(results: Results) -> dict[str, dict[str, Any]]:
    """Read the index of the drawn figures.

    Returns:
        Entries by name of figure, with the drawings as data URIs.

    Raises:
        MissingResult: If the index or a drawing is missing.
        CorruptResult: If the index cannot be read.
    """
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
    """Convert plain text to HTML with symbols in italics and matrices in bold."""
    escaped_text = MATRIX_PATTERN.sub(r"<b><i>\1</i></b>", str(Markup.escape(text)))
    return Markup(SYMBOL_PATTERN.sub(r"<i>\1</i>", escaped_text))


def format_citation_of_paper_figure(name: str) -> str:
    """Return the note that names the paper's figures to which a figure of the study corresponds.

    For "fig07_08", it is " (the paper's Figs 7 and 8)"; for a figure without counterpart, it is
    empty.
    """
    if not (match := PAPER_ITEM_PATTERN.fullmatch(name)):
        return ""
    if match[1] == "tab":
        return f" (to the paper's Table {match[2]})"
    if match[3] is None:
        return f" (the paper's Fig. {match[2]})"
    conjunction = " and " if int(match[3]) == int(match[2]) + 1 else " to "
    return f" (the paper's Figs {match[2]}{conjunction}{match[3]})"


def summarize_provenance(cases: list[StoredResult]) -> dict[str, Any]:
    """Collect the provenance of results and the different sets of package versions among them.

    Returns:
        "cases": provenance of each result, with its key and the letter of its set of versions;
        "versions": package versions of each set, by letter.
    """
    version_sets: list[dict[str, str]] = []
    rows = []
    for case in cases:
        case_provenance = case.provenance
        versions = case_provenance.get("versions", {})
        if versions not in version_sets:
            version_sets.append(versions)
        rows.append(
            {
                "key": case.key,
                "letter": _capital_letter(version_sets.index(versions)),
                **case_provenance,
            }
        )
    return {
        "cases": rows,
        "versions": {_capital_letter(i): version_set for i, version_set in enumerate(version_sets)},
    }


def _format_range_of_verification_sections() -> str:
    """Return the first and last of the sections V1, V2 etc., as "V1 to V21"."""
    sections = [section for section in SECTIONS if section.startswith("V")]
    return " to ".join([*sections[:1], *sections[-1:]])


def _capital_letter(index: int) -> str:
    return chr(ord("A") + index)
