"""The report: an article of some twenty pages, one self-contained HTML page and a PDF of it."""

import gc
import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jinja2
from markupsafe import Markup

from study.publish.reproducibility import read_citation
from study.publish.texts import (
    TEXTS_FOLDER,
    LinkTarget,
    TextRenderer,
    numbers,
    summarize_provenance,
)
from study.run.cases import SECTIONS
from study.run.store import CorruptResult, MissingResult, MissingScalar, Results, write_atomically

if TYPE_CHECKING:
    import weasyprint

# The parts in their order: text, of a section of the study or of several; chapter or section;
# title. Sections that no part shows are one line of the table of verification, see their pages
PARTS = (
    ("answer", "", ""),
    ("evidence", "chapter", "What was tested, with which result"),
    ("element", "chapter", "The element, and how to read its forces"),
    ("examples", "chapter", "The paper's examples"),
    ("7.1", "section", "Two triangles (the paper's section 7.1)"),
    ("7.2", "section", "Elastic block on a rigid surface (7.2)"),
    ("7.3", "section", "Parabolic rigid punch (7.3)"),
    ("7.4", "section", "Rigid plate on an elastic body (7.4)"),
    ("7.5", "section", "Stepped column (7.5)"),
    ("7.6", "section", "Buckling of a beam (7.6)"),
    ("uncertainty", "section", "Uncertainty of the numbers without an exact value"),
    ("verification", "chapter", "Verification beyond the paper"),
    ("rivals", "chapter", "Another code, other methods, and cost"),
    ("unknown", "chapter", "Unknowns, limits and errata"),
    ("reproducibility", "chapter", "Reproducibility"),
    ("references", "chapter", "References and nomenclature"),
)
NON_BREAKING_SPACE = r"(?<=[\d>]) (?=(?:%|°|mm|MPa|kN|μm)(?![\w/]))"  # where no line may end


class RenderedReport(NamedTuple):
    """The page, and what it lacks for want of results or figures, a line for each."""

    html: str
    missing_content: list[str]


class Part(NamedTuple):
    """A part of the report: its anchor, whether chapter or section, number, title and text."""

    id: str
    kind: str
    number: str
    title: str
    body: Markup


def build_report(results: Results, out: Path) -> list[str]:
    """Write `<out>/report.html` and `<out>/report.pdf` from results, claims and figures.

    The PDF comes first: a page on disk says that the PDF of the same source is there, too, and
    is not laid out again.

    Returns:
        What the report lacks for want of results or figures.
    """
    html, missing_content = render_report(results)
    page_path, pdf_path = Path(out) / "report.html", Path(out) / "report.pdf"
    if pdf_path.is_file() and page_path.is_file() and page_path.read_bytes() == html.encode():
        return missing_content
    write_atomically(pdf_path, lay_out_pages(html).write_pdf(pdf_variant="pdf/ua-1"))
    write_atomically(page_path, html.encode())
    return missing_content


def render_report(results: Results, templates: Path = TEXTS_FOLDER) -> RenderedReport:
    """Return the page.

    Args:
        results: What to report; its folder has the claims and the figures, too.
        templates: Folder of the texts.
    """
    try:
        report_renderer = _ReportRenderer(results, templates)
        report_renderer.render_parts()  # now it is known where figures, tables and sections are
        report_renderer.strict = not report_renderer.missing_content
        parts = report_renderer.render_parts()
        cases = [case for section in SECTIONS for case in results.readable_results(section)]
        provenance_summary = summarize_provenance(cases)
        html = report_renderer.render(
            "base.html",
            parts=parts,
            version=read_citation()["version"],
            commits=sorted(
                {case["commit"][:10] for case in provenance_summary["cases"] if case.get("commit")}
            ),
            versions=list(provenance_summary["versions"].values()),
            date=max(
                (case["time"][:10] for case in provenance_summary["cases"] if case.get("time")),
                default="",
            ),
        )
    except jinja2.UndefinedError as error:  # results or claims that another version wrote
        raise CorruptResult(f"{results.folder}: {error}; run ./run study --force") from error
    return RenderedReport(str(html), report_renderer.missing_content)


class _ReportRenderer(TextRenderer):
    """The parts' texts, with figures, tables and references numbered as they come.

    Args:
        results: What is reported.
        templates: Folder of the texts.
    """

    def __init__(self, results: Results, templates: Path) -> None:
        folders = [templates, Path(__file__).parent]
        super().__init__(results, folders, "chapter.html", {}, strict=False)
        self._part_sections: list[str] = []  # whose texts the part has that is being made
        self.environment.globals["sheet"] = False

    def render_parts(self) -> list[Part]:
        """Return the parts; one that lacks results says so in the place of its text."""
        self.item_numbers, self.missing_content = {}, []
        parts: list[Part] = []
        chapter_count = section_count = 0
        for name, kind, heading in PARTS:
            self._part_sections = []
            body = self._render_body(name)
            if not body.strip():  # there are no results yet of which it could tell
                continue
            chapter_count, section_count = (
                (chapter_count, section_count + 1) if kind == "section" else (chapter_count + 1, 0)
            )
            number = (
                f"{chapter_count - 1}.{section_count}"
                if kind == "section"
                else f"{chapter_count - 1}"
            )
            target = LinkTarget(f"#part-{name}", f"section\N{NO-BREAK SPACE}{number}")
            self.link_targets |= dict.fromkeys(self._part_sections, target)
            parts.append(Part(f"part-{name}", kind, number, heading, body))
        # sections without a part are called by their names, and have a line in a table
        sections_without_part = SECTIONS.keys() - self.link_targets.keys()
        self.link_targets |= {
            section: LinkTarget("#part-verification", section) for section in sections_without_part
        }
        self.link_targets |= self.list_link_targets()
        return parts

    def render_text(self, name: str) -> Markup:
        """Return a text, and keep in which part it is."""
        self._part_sections.append(name)
        return super().render_text(name)

    def _render_body(self, name: str) -> Markup:
        saved_numbers = dict(self.item_numbers)
        try:
            return Markup(re.sub(NON_BREAKING_SPACE, numbers.THIN_SPACE, self.render_text(name)))
        except (MissingResult, CorruptResult, MissingScalar) as error:
            self.item_numbers = saved_numbers  # its figures and tables are not shown
            self.missing_content.append(f"{name}: {error}")
            return Markup('<p class="note">This part is incomplete: {}.</p>').format(error)


def _list_font_faces() -> str:
    """Return the faces of STIX, which Matplotlib brings: narrower than DejaVu, with italics."""
    import matplotlib

    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    font_variants = (
        ("", "normal", "normal"),
        ("Italic", "normal", "italic"),
        ("Bol", "bold", "normal"),
        ("BolIta", "bold", "italic"),
    )
    return "".join(
        f"@font-face {{ font-family: STIX; font-weight: {weight}; font-style: {font_style}; "
        f"src: url('{(folder / f'STIXGeneral{file_suffix}.ttf').as_uri()}'); }}\n"
        for file_suffix, weight, font_style in font_variants
    )


def lay_out_pages(html: str) -> "weasyprint.Document":
    """Return the pages of the PDF, set in STIX."""
    import weasyprint  # half a second, and its libraries are not needed to read the page's code

    html_with_fonts = html.replace("</head>", f"<style>{_list_font_faces()}</style></head>", 1)
    gc.disable()  # among millions of boxes that all stay, a fifth of the time for nothing
    try:
        return weasyprint.HTML(string=html_with_fonts).render(pdf_variant="pdf/ua-1")
    finally:
        gc.enable()
