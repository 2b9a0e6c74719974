"""Write the report: an article of about twenty pages as one self-contained HTML page and as PDF."""

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
    """HTML page of the report.

    Attributes:
        html: The page.
        missing_content: One message for each part that is incomplete because results or figures are
            missing.
    """

    html: str
    missing_content: list[str]


class ReportPart(NamedTuple):
    """Chapter or section of the report.

    Attributes:
        id: Anchor of the part in the page.
        kind: "chapter" or "section"; empty for the summary at the beginning.
        number: Number of the chapter or section, such as "3.1".
        title: Heading.
        body: Text in HTML.
    """

    id: str
    kind: str
    number: str
    title: str
    body: Markup


def build_report(results: Results, out: Path) -> list[str]:
    """Write `<out>/report.html` and `<out>/report.pdf` from results, claims and figures.

    The PDF is written before the page. Therefore, if an identical page exists, the PDF is up to
    date and is not laid out again, which takes long.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        out: Path of the folder to which `report.html` and `report.pdf` are written.

    Returns:
        One message for each part that is incomplete because results or figures are missing.
    """
    html, missing_content = render_report_page(results)
    page_path, pdf_path = Path(out) / "report.html", Path(out) / "report.pdf"
    if pdf_path.is_file() and page_path.is_file() and page_path.read_bytes() == html.encode():
        return missing_content
    write_atomically(pdf_path, lay_out_pdf_pages(html).write_pdf(pdf_variant="pdf/ua-1"))
    write_atomically(page_path, html.encode())
    return missing_content


def render_report_page(results: Results, template_folder: Path = TEXTS_FOLDER) -> RenderedReport:
    """Render the HTML page of the report from stored results, claims and figures.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        template_folder: Folder of the texts.

    Raises:
        CorruptResult: If results or claims were written by an incompatible version of the study.
    """
    try:
        report_renderer = _ReportRenderer(results, template_folder)
        report_renderer.render_parts()  # now it is known where figures, tables and sections are
        report_renderer.strict = not report_renderer.missing_content
        parts = report_renderer.render_parts()
        cases = [case for section in SECTIONS for case in results.readable_results(section)]
        provenance_summary = summarize_provenance(cases)
        html = report_renderer.render_template(
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
    """Renderer of the report, which numbers figures, tables and references consecutively.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        templates: Folder of the texts.
    """

    def __init__(self, results: Results, templates: Path) -> None:
        folders = [templates, Path(__file__).parent]
        super().__init__(results, folders, "chapter.html", {}, strict=False)
        self._part_sections: list[str] = []  # whose texts the part has that is being made
        self.environment.globals["sheet"] = False

    def render_parts(self) -> list[ReportPart]:
        """Render all parts of the report; empty parts are omitted.

        A part whose results are missing or corrupt is replaced by a note that says so.
        """
        self.item_numbers, self.missing_content = {}, []
        parts: list[ReportPart] = []
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
            parts.append(ReportPart(f"part-{name}", kind, number, heading, body))
        # sections without a part are called by their names, and have a line in a table
        sections_without_part = SECTIONS.keys() - self.link_targets.keys()
        self.link_targets |= {
            section: LinkTarget("#part-verification", section) for section in sections_without_part
        }
        self.link_targets |= self.link_targets_of_figures_and_tables()
        return parts

    def render_text(self, name: str) -> Markup:
        """Render a text, and note that the current part contains it, for links to its section."""
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


def _format_css_font_faces() -> str:
    """Return CSS font faces for STIX, which is included in Matplotlib.

    STIX is narrower than DejaVu and has italics.
    """
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


def lay_out_pdf_pages(html: str) -> "weasyprint.Document":
    """Lay out the pages of the PDF from the HTML of the report, in the font STIX."""
    import weasyprint  # half a second, and its libraries are not needed to read the page's code

    html_with_fonts = html.replace(
        "</head>", f"<style>{_format_css_font_faces()}</style></head>", 1
    )
    gc.disable()  # among millions of boxes that all stay, a fifth of the time for nothing
    try:
        return weasyprint.HTML(string=html_with_fonts).render(pdf_variant="pdf/ua-1")
    finally:
        gc.enable()
