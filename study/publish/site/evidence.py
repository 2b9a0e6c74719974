"""Write the website's pages on evidence: sheets of sections, indices, and a list of claims.

A sheet (the page of a section) describes the computation and its reference solution, and shows
figures and a table of quantities with references, errors and tolerances. Texts are read from the
pages of the study and from `study/publish/texts`, numbers from stored results and judged claims.
"""

import html
import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from markupsafe import Markup

from study.judge import claims
from study.judge.facts import RESULT_MUTATIONS, ROW_MUTATIONS
from study.model.vocabulary import ELEMENTS
from study.paper.items import ITEMS, TITLES_WITHOUT_PAGE, Item
from study.publish.site import mathematics, search
from study.publish.texts import (
    PAPER_ITEM_PATTERN,
    LinkTarget,
    TextRenderer,
    read_problem_data_of_section,
    summarize_provenance,
)
from study.publish.texts.numbers import format_short_number
from study.publish.texts.statements import group_claims_by_fact, source_names_section
from study.run.cases import SECTIONS, find_page_source, title
from study.run.store import CorruptResult, MissingResult, MissingScalar, Results, StudyError

SITE_FOLDER = Path(__file__).parent
REPORT_FILES = ("report.html", "report.pdf")
ROOT = SITE_FOLDER.parents[2]
FACT_NAMES = ("geometry", "mesh", "material", "supports", "load", "reference", "uncertainty")
SECTION_GROUPS = {
    "The paper's sections": [
        section for section in SECTIONS if section[0].isdigit() or section == "I"
    ],
    "Verification": [
        s for s in SECTIONS if not s[0].isdigit() and s not in ("I", "P", "Q", "W", "K")
    ],
    "Other methods and codes, and cost": ["Q", "W", "P", "K"],
}


# Comment on the home page that the findings replace
_FINDINGS_MARK = re.compile(r"<!-- findings\b.*?-->", re.DOTALL)

# Sections of the paper whose statements a sheet judges, if they differ from its own section
JUDGED_PAPER_SECTIONS = {"I": ("1",), "3": ("3", "4", "6")}
# Texts of the report that summarise the study, with their headings
SUMMARY_TEXTS = {
    "evidence": "What was tested, and with which result",
    "vocabulary": "Verification, validation and comparison",
    "uncertainty": "Uncertainty of the numbers without an exact value",
    "computations": "How each section was computed",
    "unknown": "What could not be known, and errata of the paper",
}


def write_evidence_pages(results: Results, source_folder: Path) -> list[str]:
    """Write the Markdown pages of the evidence, and copy the figures that they show.

    All pages are rendered twice; the first pass determines the targets of links.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        source_folder: Folder of the sources for Sphinx.

    Returns:
        Messages on missing results and figures.
    """
    pages_folder = source_folder / "evidence"
    pages_folder.mkdir()
    sections = [section for section in SECTIONS if results.cases(section)]
    first_pass = _SitePageRenderer(results, {}, strict=False)
    first_pass.render_section_sheets_and_paper_page(sections)
    sheet_renderer = _SitePageRenderer(
        results, first_pass.link_targets, strict=not first_pass.missing_content
    )
    figures = source_folder / "_static" / "figures"
    figures.mkdir(parents=True)
    for name in sheet_renderer.figures:
        for path in (results.folder / "figures").glob(f"{name}.*svg"):
            shutil.copy(path, figures)
    for name, page in sheet_renderer.render_section_sheets_and_paper_page(sections).items():
        (pages_folder / f"{name}.md").write_text(page, encoding="utf-8")
    (pages_folder / "figures-and-tables.md").write_text(
        sheet_renderer.render_index_of_paper_items(sections), encoding="utf-8"
    )
    (pages_folder / "claims.md").write_text(
        sheet_renderer.render_page_of_all_claims(sections), encoding="utf-8"
    )
    (pages_folder / "facts.md").write_text(
        sheet_renderer.render_page_of_independent_facts(), encoding="utf-8"
    )
    (pages_folder / "index.md").write_text(
        sheet_renderer.render_index_of_sheets(sections), encoding="utf-8"
    )
    home_page = source_folder / "index.md"
    home_text, n_marks = _FINDINGS_MARK.subn(
        lambda _: sheet_renderer.render_findings(), home_page.read_text("utf-8")
    )
    if n_marks != 1:
        raise StudyError(f"docs/index.md has {n_marks} comments <!-- findings ... -->, not one")
    home_page.write_text(home_text, encoding="utf-8")
    which_way_page = source_folder / "which-way.md"
    which_way_page.write_text(
        which_way_page.read_text("utf-8")
        + "\n"
        + sheet_renderer.render_table_of_recommended_methods(),
        encoding="utf-8",
    )
    return sheet_renderer.missing_content


def copy_report_and_result_files(results: Results, pages_folder: Path) -> list[str]:
    """Copy the report and the files of all readable results into the website, which links to them.

    Args:
        results: Stored results.
        pages_folder: Folder of the website's HTML pages.

    Returns:
        Messages on missing or corrupt files.
    """
    missing = []
    for name in REPORT_FILES:
        if not (path := results.folder / name).is_file():
            missing.append(f"there is no {name}: run ./run study")
        elif path.suffix == ".html":
            page = search.insert_site_bar(path.read_text("utf-8"))
            (pages_folder / name).write_text(page, "utf-8")
        else:
            shutil.copy(path, pages_folder)
    for section in SECTIONS:
        folder = pages_folder / "data" / section
        folder.mkdir(parents=True)
        missing += results.error_messages_of_corrupt_results(section).values()
        for result in results.readable_results(section):
            endings = ("json", "npz") if result.curves else ("json",)
            for ending in endings:
                shutil.copy(results.folder / section / f"{result.case}.{ending}", folder)
    return missing


class _SitePageRenderer(TextRenderer):
    """Renderer of the website's pages on sections, claims and facts.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        link_targets: Addresses of figures, tables and sections from a first pass, such that a page
            can refer to items that follow.
        strict: Whether a reference to an unknown target is an error.
    """

    def __init__(self, results: Results, link_targets: dict[str, LinkTarget], strict: bool) -> None:
        section_targets = {
            section: LinkTarget(f"{section}.html", f"section {section}") for section in SECTIONS
        }
        section_targets |= {
            name: LinkTarget("paper.html", label) for name, label in SUMMARY_TEXTS.items()
        }
        super().__init__(
            results, [SITE_FOLDER], "sheet.html", section_targets | link_targets, strict
        )
        self._current_page = ""
        self.environment.globals |= {
            "sheet": True,
            "claims_table": self.render_table_of_sheet_claims,
        }
        filters: dict[str, Callable[..., Markup]] = {
            "typeset": typeset_html,
            "relation": _format_relation_unless_equal,
            "computed": _format_measured_for_tolerance,
        }
        self.environment.filters |= filters

    def render_section_sheets_and_paper_page(self, sections: list[str]) -> dict[str, str]:
        """Render the pages (sheets) of sections and the page on the paper; return them by name."""
        return {section: self.render_section_sheet(section) for section in sections} | {
            "paper": self.render_paper_page()
        }

    def render_section_sheet(self, section: str) -> str:
        """Render the sheet of a section: data of the problem, text, figures and list of results."""
        heading = mathematics.typeset_plain_text_mathematics(title(section), "{{sub}}`{}`")
        opening = [f"# {section}: {heading}", self._render_table_of_problem_data(section)]
        body = self._render_body(section, section)
        return "\n\n".join([*opening, body, self._render_list_of_result_files(section)]) + "\n"

    def render_paper_page(self) -> str:
        """Return the page that summarises the paper and which of its statements hold."""
        self.item_numbers = {}
        parts = [
            f"## {heading}\n\n{self._render_body('paper', name)}"
            for name, heading in SUMMARY_TEXTS.items()
        ]
        references = _wrap_in_raw_html_directive(self.render_template("cited.html"))
        return "\n\n".join(
            ["# The paper, and what of it holds", *parts, f"## References\n\n{references}"]
        )

    def _render_body(self, page: str, name: str) -> str:
        if page == name:
            self.item_numbers = {}
        self._current_page = page
        saved_numbers = dict(self.item_numbers)
        try:
            body = self.render_text(name)
        except (MissingResult, CorruptResult, MissingScalar) as error:
            self.item_numbers = saved_numbers  # the figures and tables of this text are not shown
            self.missing_content.append(f"{name}: {error}")
            body = Markup('<p class="note">This sheet is incomplete: {}.</p>').format(error)
        section_figures = [
            figure_name for figure_name, entry in self.figures.items() if entry["section"] == name
        ]
        body += Markup().join(
            self.render_figure(n) for n in section_figures if f'id="{n}"' not in body
        )
        self.link_targets |= {
            **self.link_targets_of_figures_and_tables(f"{page}.html"),
            **self.link_targets,
        }
        return _convert_html_headings_to_markdown(_link_section_names(body, page))

    def render_link(self, name: str) -> Markup:
        """Return a link to a figure, table or section.

        If the target is on the sheet of another section, the section is named after the link.
        """
        link = super().render_link(name)
        page, fragment, _ = self.link_targets.get(name, LinkTarget("", "")).address.partition(
            ".html#"
        )
        return link + f" of section {page}" if fragment and page != self._current_page else link

    def figure_entry(self, name: str) -> dict[str, Any] | None:
        """Return the index entry of a figure with the addresses of its copied files.

        Returns:
            The entry, or None if the figure has not been drawn.
        """
        if name not in self.figures:
            return None
        folder, entry = "../_static/figures", dict(self.figures[name])
        entry["uri"] = f"{folder}/{name}.svg"
        entry["narrow_uri"] = f"{folder}/{name}.narrow.svg" if "narrow" in entry else None
        return entry

    def render_table_of_sheet_claims(self, section: str) -> Markup:
        """Render the table of quantities of a section, with references, errors and tolerances.

        Numbers that are merely recorded to detect changes ("pins") are omitted unless they have
        changed.
        """
        rows = [
            row
            for paper_section in JUDGED_PAPER_SECTIONS.get(section, (section,))
            for row in self.claims_of_section(paper_section)
        ]
        shown_rows = [row for row in rows if row["kind"] != "pin" or row["differs"]]
        return self.render_template("quantities.html", rows=shown_rows) if shown_rows else Markup()

    def render_page_of_all_claims(self, sections: list[str]) -> str:
        """Return the page that lists all claims and findings."""
        rows = [
            row
            | {
                "sections": [
                    section for section in sections if source_names_section(row["source"], section)
                ]
            }
            for row in self.claims
        ]
        page = self.render_template(
            "all_claims.html",
            rows=rows,
            grades=claims.GRADES,
            verdicts=dict.fromkeys(row["verdict"] for row in rows),
            sections=sections,
        )
        text = (
            "Statements of the paper, each with one grade, and findings of this study, each with "
            "the number it is judged by. Tolerances count in favour of the statement; each entry "
            "says whether its tolerance was set before or after the first value was seen."
        )
        return f"# Claims and findings\n\n{text}\n\n{_wrap_in_raw_html_directive(page)}\n"

    def render_page_of_independent_facts(self) -> str:
        """Render the page on the independent facts that underlie the statements of the paper.

        The page also lists the mutations of results by which dependent statements are detected.
        """
        groups = group_claims_by_fact([row for row in self.claims if row["fact"]])
        mutations = (*RESULT_MUTATIONS, *ROW_MUTATIONS)
        page = self.render_template("all_facts.html", groups=groups, mutations=mutations)
        return f"# Facts\n\n{_convert_html_headings_to_markdown(page)}\n"

    def render_index_of_paper_items(self, sections: list[str]) -> str:
        """Return the index of the paper's figures, tables and equations."""
        parts = ["# The paper's figures and tables"]
        for kind, heading in (
            ("figure", "Figures"),
            ("table", "Tables"),
            ("equation", "Equations"),
        ):
            item_rows = [
                self._row_of_paper_item(item, sections) for item in ITEMS if item.kind == kind
            ]
            parts += [
                f"## {heading}",
                _wrap_in_raw_html_directive(
                    self.render_template("items.html", rows=item_rows, kind=kind)
                ),
            ]
        return "\n\n".join(parts) + "\n"

    def render_index_of_sheets(self, sections: list[str]) -> str:
        """Return the page that lists all sheets."""
        parts = ["# Evidence", (SITE_FOLDER / "evidence.md").read_text("utf-8")]
        for group, members in SECTION_GROUPS.items():
            rows = [
                self._count_verdicts_of_section(section)
                for section in members
                if section in sections
            ]
            parts += [
                f"## {group}",
                _wrap_in_raw_html_directive(self.render_template("sheets.html", rows=rows)),
            ]
        cases = [case for section in sections for case in self.results.readable_results(section)]
        origin = self.render_template("origin.html", **summarize_provenance(cases))
        parts.append(f"## Computed with\n\n{_wrap_in_raw_html_directive(origin)}")
        toctree = "\n".join(["paper", "claims", "facts", "figures-and-tables", *sections])
        parts.append(f"```{{toctree}}\n:hidden:\n\n{toctree}\n```")
        return "\n\n".join(parts) + "\n"

    def render_findings(self) -> str:
        """Render the summary of findings, for a page outside the folder of the evidence."""
        return self._render_body("index", "findings").replace('href="', 'href="evidence/')

    def render_table_of_recommended_methods(self) -> str:
        """Render the table that recommends a method for each type of problem.

        The table is for a page outside the folder of the evidence; links are adapted accordingly.
        """
        self.item_numbers = {}
        return _wrap_in_raw_html_directive(
            str(self.render_text("decision")).replace('href="', 'href="evidence/')
        )

    def _render_table_of_problem_data(self, section: str) -> str:
        facts = read_problem_data_of_section(section)
        if unknown_names := facts.keys() - {*FACT_NAMES}:
            raise StudyError(f"the facts of {section} have {', '.join(sorted(unknown_names))}")
        path = find_page_source(section)
        n_results = len(self.results.readable_results(section))
        rows = [
            (name.capitalize(), typeset_html(facts[name])) for name in FACT_NAMES if name in facts
        ]
        rows += [
            ("Computed in", Markup("<code>{}</code>").format(path.relative_to(ROOT).as_posix())),
            ("Command", Markup("<code>./run study {}</code>").format(section)),
            ("Data", Markup('<a href="#data">{} results</a>').format(n_results)),
        ]
        return _wrap_in_raw_html_directive(self.render_template("facts.html", rows=rows))

    def _render_list_of_result_files(self, section: str) -> str:
        page = self.render_template(
            "data.html", section=section, cases=self.results.readable_results(section)
        )
        return f"## Data\n\n{_wrap_in_raw_html_directive(page)}"

    def _count_verdicts_of_section(self, section: str) -> dict[str, Any]:
        verdicts: dict[str, list[str]] = {"paper": [], "finding": [], "pin": []}
        for row in self.claims_of_section(section):
            kind = "paper" if row["kind"] in claims.PAPER_KINDS else row["kind"]
            verdicts[kind].append(row["verdict"])
        counts = {
            kind: (len(kind_verdicts), kind_verdicts.count("holds"))
            for kind, kind_verdicts in verdicts.items()
        }
        figure_names = [name for name, entry in self.figures.items() if entry["section"] == section]
        alt = self.figures[figure_names[-1]]["alt"] if figure_names else ""
        summary = {"id": section, "title": title(section), **counts}
        return summary | {"figure": figure_names[-1:], "alt": alt}

    def _row_of_paper_item(self, item: Item, sections: list[str]) -> dict[str, Any]:
        figure_name = next(
            (candidate for candidate in self.figures if _figure_shows_paper_item(candidate, item)),
            None,
        )
        return {
            "item": item,
            "section": TITLES_WITHOUT_PAGE.get(item.section) or title(item.section),
            "sheet": item.section if item.section in sections else None,
            "drawn": figure_name,
            "alt": self.figures[figure_name]["alt"] if figure_name else "",
        }


_ELEMENT_KEYS = re.compile(rf"\b(?:{'|'.join(sorted(ELEMENTS, key=len, reverse=True))})\b(?!-)")


def typeset_html(text: str) -> Markup:
    """Convert plain text to HTML, with typeset mathematics.

    Keys of elements, such as "pw-T6", are replaced by their names.
    """
    text_with_names = _ELEMENT_KEYS.sub(
        lambda match: ELEMENTS[match[0]].name, html.escape(text, quote=False)
    )
    return Markup(mathematics.typeset_plain_text_mathematics(text_with_names))


def _format_relation_unless_equal(sign: str) -> Markup:
    """Return the sign of a relation, such as "≤ ", or nothing for equality."""
    return Markup("" if sign == "=" else typeset_html(f"{sign} "))


def _format_measured_for_tolerance(row: dict[str, Any]) -> Markup:
    """Format the measured number of a judged claim.

    If the claim states equality within a tolerance, the digits suffice to see whether it holds.
    """
    value, reference, tol = row["measured"], row["value"], row["tol"]
    if row["relation"] != "=" or None in (value, reference) or not tol:
        return format_short_number(value, 4)
    return format_short_number(value, _digits_needed_for_tolerance(value, tol))


def _digits_needed_for_tolerance(value: float, tol: float) -> int:
    """Return how many significant digits resolve a tenth of a tolerance, between 2 and 8.

    Args:
        value: Number to be shown.
        tol: Absolute tolerance, which is positive.
    """
    if not value:
        return 2
    extra_digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(tol))
    return min(max(2 + extra_digits, 2), 8)


def _figure_shows_paper_item(name: str, item: Item) -> bool:
    """Return whether a figure of the study corresponds to a figure or table of the paper.

    Args:
        name: Name of the figure; "fig07_08" corresponds to Figs 7 and 8.
        item: Figure, table or equation of the paper.
    """
    match = PAPER_ITEM_PATTERN.fullmatch(name)
    if not match or match[1] != item.kind[:3]:
        return False
    return int(match[2]) <= int(item.number) <= int(match[3] or match[2])


_LONGEST_SECTIONS_FIRST = sorted(SECTIONS, key=len, reverse=True)
_SECTION_PATTERN = rf"(?:{'|'.join(map(re.escape, _LONGEST_SECTIONS_FIRST))})"
_SINGLE_SECTION = re.compile(rf"{_SECTION_PATTERN}(?![.\w])")
_SECTION_LIST = re.compile(
    rf"\bsections? {_SECTION_PATTERN}\b(?:(?:, | and | to ){_SECTION_PATTERN}\b)*"
)


def _link_section_names(body: str, own_section: str = "") -> str:
    """Convert names of sections, as in "sections 7.1 and V3", to links.

    Args:
        body: Text in HTML; existing links are left unchanged.
        own_section: Section of the page itself, which is not linked.
    """

    def link_unless_own_section(match: re.Match[str]) -> str:
        return match[0] if match[0] == own_section else f'<a href="{match[0]}.html">{match[0]}</a>'

    def link_names_in_section_list(match: re.Match[str]) -> str:
        word, _, names = match[0].partition(" ")
        return f"{word} {_SINGLE_SECTION.sub(link_unless_own_section, names)}"

    parts = re.split(r"(<a .*?</a>|<[^>]*>)", body, flags=re.DOTALL)
    return "".join(
        part if part.startswith("<") else _SECTION_LIST.sub(link_names_in_section_list, part)
        for part in parts
    )


def _convert_html_headings_to_markdown(body: str) -> str:
    """Convert HTML headings to Markdown, such that Sphinx includes them in contents and search."""
    parts = re.split(r"<h([34])>(.*?)</h\1>", body, flags=re.DOTALL)
    converted_parts = [_wrap_in_raw_html_directive(parts[0])] if parts[0].strip() else []
    for level, heading, text in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
        heading_text = html.unescape(re.sub(r"<[^>]+>", "", heading)).strip()
        converted_parts.append(f"{'#' * (int(level) - 1)} {heading_text}")
        if text.strip():
            converted_parts.append(_wrap_in_raw_html_directive(text))
    return "\n\n".join(converted_parts)


def _wrap_in_raw_html_directive(html_text: str) -> str:
    return f"`````{{raw}} html\n{html_text}\n`````"
