"""Include the report, which is no page of Sphinx, in the site's search and navigation."""

from html.parser import HTMLParser
from pathlib import Path

from docutils import nodes
from docutils.utils import new_document
from jinja2 import Environment, FileSystemLoader
from sphinx.application import Sphinx

TEMPLATES_FOLDER = Path(__file__).with_name("templates")
_TAGS_WITHOUT_TEXT = {"annotation", "script", "style", "svg"}
_HEADING_TAGS = {"h1", "h2", "h3"}


class _ReportParser(HTMLParser):
    """Parser that collects the heading and the text of each section of the report.

    Attributes:
        headings: Heading of each section with an id, by the id; a section without a heading has the
            title of the report.
        texts: Parts of the text of each section, by the id.
    """

    def __init__(self, html: str) -> None:
        super().__init__()
        self.headings: dict[str, str] = {}
        self.texts: dict[str, list[str]] = {}
        self._title = ""
        self._section_ids: list[str] = []
        self._open_heading = False
        self._n_open_tags_without_text = 0
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "section":
            section_id = dict(attrs).get("id") or self._section_ids[-1]
            self._section_ids.append(section_id)
            self.texts.setdefault(section_id, [])
        self._open_heading |= tag in _HEADING_TAGS
        self._n_open_tags_without_text += tag in _TAGS_WITHOUT_TEXT

    def handle_endtag(self, tag: str) -> None:
        if tag == "section":
            section_id = self._section_ids.pop()
            self.headings.setdefault(section_id, self._title)
        self._open_heading &= tag not in _HEADING_TAGS
        self._n_open_tags_without_text -= tag in _TAGS_WITHOUT_TEXT

    def handle_data(self, data: str) -> None:
        if self._n_open_tags_without_text:
            return
        if not self._section_ids:
            self._title += data if self._open_heading else ""
            return
        self.texts[self._section_ids[-1]].append(data)
        if self._open_heading:
            heading = self.headings.get(self._section_ids[-1], "")
            self.headings[self._section_ids[-1]] = heading + data


def read_report_sections(html: str) -> dict[str, tuple[str, str]]:
    """Return the heading and the text of each section of the report, by the section's id."""
    parser = _ReportParser(html)
    return {
        section_id: (" ".join(parser.headings[section_id].split()), " ".join(texts))
        for section_id, texts in parser.texts.items()
    }


def add_report_to_search_index(app: Sphinx, exception: Exception | None) -> None:
    """Add the sections of the report to the index of the search (handler of `build-finished`).

    A section is a document "report#ID", which the site's scorer converts to an address.

    Args:
        app: Application of Sphinx, whose sources may contain `report.html`.
        exception: Error of the build, after which there is no index.
    """
    report = Path(app.srcdir) / "report.html"
    if exception is not None or not report.is_file():
        return
    indexer = app.builder.indexer
    for section_id, (heading, text) in read_report_sections(report.read_text("utf-8")).items():
        document = new_document("report")
        section = nodes.section("", nodes.title("", heading), nodes.paragraph("", text))
        document += section
        indexer.feed(f"report#{section_id}", "report.html", heading, document)
    with (Path(app.outdir) / "searchindex.js").open("w", encoding="utf-8") as file:
        indexer.dump(file, app.builder.indexer_format)


def insert_site_bar(report_html: str) -> str:
    """Return the report with a bar above it, which has the search box and links to the site."""
    environment = Environment(loader=FileSystemLoader(TEMPLATES_FOLDER), autoescape=True)
    bar = environment.get_template("report_bar.html").render(pathto=lambda page: f"{page}.html")
    return report_html.replace("<body>", f"<body>\n{bar}", 1)
