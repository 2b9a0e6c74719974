"""The report: self-contained, accessible, with every number from a file."""

from html.parser import HTMLParser
from pathlib import Path

import pytest
from pypdf import PdfReader

from study import report
from study.core.store import MissingResult, Results, StudyError
from study.report import build, numbers, render
from tests.toystudy import reported

# Debian pairs WeasyPrint with a newer pydyf, which has renamed some methods
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf")

RESULTS = Path(__file__).parents[1] / "results"


@pytest.fixture
def out(tmp_path, monkeypatch):
    return reported(tmp_path, monkeypatch)


@pytest.fixture
def text(tmp_path):
    """A function that writes the text of section 1 and returns the page."""
    folder = tmp_path / "templates"

    def page(fragment, out):
        (folder / "sections").mkdir(parents=True, exist_ok=True)
        (folder / "sections" / "1.html").write_text(fragment)
        return render(Results(out), folder).html

    return page


class Page(HTMLParser):
    def __init__(self, html):
        super().__init__()
        self.tags = []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def row(html, id):
    """The first row of a claim: exceptions stand in the summary, too."""
    one = next(part for part in html.split("<tr") if f"<code>{id}</code>" in part)
    return one.partition("</tr>")[0]


def test_page_needs_nothing_but_itself(out):
    page = Page(render(Results(out)).html)
    assert len(page.all("img")) == 3
    for image in page.all("img"):
        assert image["src"].startswith("data:image/svg+xml;base64,")
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in page.tags}
    sources = [a[key] for tag, a in page.tags for key in ("src", "srcset", "poster") if key in a]
    assert all(source.startswith("data:") for source in sources)
    assert "url(" not in render(Results(out)).html
    assert "@import" not in render(Results(out)).html


def test_page_is_accessible(out):
    page = Page(render(Results(out)).html)
    assert page.all("html") == [{"lang": "en"}]
    viewport = {"name": "viewport", "content": "width=device-width, initial-scale=1"}
    assert viewport in page.all("meta")
    assert [image["alt"] for image in page.all("img")] == [
        'Line "fig05"', 'Line "tab2"', 'Line "orders"',
    ]  # fmt: skip
    assert len(page.all("h1")) == 1
    assert len(page.all("title")) == 1
    assert all("scope" in heading for heading in page.all("th"))
    boxes = [one for one in page.all("div") if one.get("class") == "scroll"]
    assert len(boxes) == len(page.all("table"))


def test_every_internal_link_has_its_one_target(out):
    page = Page(render(Results(out)).html)
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = [link["href"] for link in page.all("a")]
    assert {"#summary", "#sec-1", "#paper", "#provenance"} <= set(links)
    assert all(link[1:] in ids for link in links if link.startswith("#"))


def test_only_sections_with_results_appear(out):
    html = render(Results(out)).html
    assert "First toy" in html
    assert "Second toy" not in html


def test_verdicts_come_first_in_words_and_differing_ones_are_marked(out):
    html = render(Results(out)).html
    assert html.index("Summary of verdicts") < html.index("Contents") < html.index("First toy")
    counts = html.partition('<dl class="counts">')[2].partition("</dl>")[0]
    assert [int(part.partition("<")[0]) for part in counts.split("<dd>")[1:]] == [3, 0, 0, 0, 1, 1]
    assert '"verdict holds">holds<' in row(html, "the-claim")
    assert "pinned: " not in row(html, "the-claim")
    assert '"verdict fails">fails<' in row(html, "wrong")
    assert row(html, "wrong").startswith(' class="differs"')
    assert "pinned: holds" in row(html, "wrong")
    assert '"verdict open">not judged<' in row(html, "open")
    assert ">5<" in row(html, "wrong")
    assert "= 4<" in row(html, "wrong")


def test_items_of_the_paper_and_provenance_are_listed(out):
    html = render(Results(out)).html
    assert "Equation 3" in html
    assert "A &lt; B &amp; so on" in html
    assert "<dt>A</dt><dd>dolfinx 0.9.0, numpy 2.2.4</dd>" in html
    assert "<dt>B</dt><dd>dolfinx 0.10.0, numpy 2.2.4</dd>" in html
    cases = html.partition('id="provenance"')[2].split("<tr>")[2:]
    assert len(cases) == 2
    for cell in (
        ">1/a<",
        ">4290<",
        ">1.24<",
        ">2<",
        ">0123456789+<",
        ">A<",
        ">2026-01-02 03:04:05<",
    ):
        assert cell in cases[0]
    assert ">0123456789<" in cases[1]
    assert ">B<" in cases[1]


def test_text_of_a_section_can_call_for_numbers_figures_and_claims(out, text):
    html = text(
        '<p id="first">{{ num(s("1/a", "y")) }}, {{ pct(0.00314) }}, {{ 0.5 | fixed(2) }}</p>'
        '{{ figure("tab2") }}<p id="last">{{ curves("1/a")["x"][1] }}</p>'
        '{{ claims_table(claims_of("1")) }}',
        out,
    )
    assert "2.550\u202f×\u202f10<sup>9</sup>, 0.31\u202f%, 0.50</p>" in html
    assert '<p id="last">2.0</p>' in html
    order = [html.index(part) for part in ('id="first"', 'id="tab2"', 'id="last"', 'id="fig05"')]
    assert order == sorted(order)
    body = html.partition('id="sec-1"')[2].partition('id="others"')[0]
    assert "<code>the-claim</code>" in body
    assert "<code>wrong</code>" not in body
    assert html.count('id="tab2"') == 1


def test_caption_is_numbered_as_in_the_paper_and_escaped(out):
    html = render(Results(out)).html
    assert "<b>Figure 5</b> Caption of fig05: a &lt; b." in html
    assert "<b>Figure to Table 2</b> Caption of tab2" in html
    assert "<b>Figure S1</b> Caption of orders" in html


def test_figure_of_no_reported_section_is_not_lost(out):
    html = render(Results(out)).html
    assert html.index('id="others"') < html.index('id="orders"') < html.index('id="paper"')


def test_what_is_missing_is_listed(out, tmp_path):
    assert render(Results(out), tmp_path / "templates").incomplete == []
    sections = tmp_path / "templates" / "sections"
    sections.mkdir(parents=True)
    (sections / "1.html").write_text('{{ figure("fig77") }}{{ s("1/never", "y") }}')
    (sections / "findings.html").write_text('{{ s("2/no", "y") }}')
    figure, section, findings = render(Results(out), tmp_path / "templates").incomplete
    assert figure == "figure fig77 has not been drawn"
    assert section.startswith("section 1: ")
    assert findings.startswith("findings: ")


def test_figure_that_was_not_drawn_is_a_remark(out, text):
    html = text('{{ figure("fig77") }}', out)
    assert "Figure 77 is not drawn" in html or "fig77 is not drawn" in html
    assert 'id="fig77"' in html


def test_missing_result_costs_a_section_its_text_only(out, text):
    html = text('<p>{{ s("1/never", "y") }}</p>', out)
    assert "This section is incomplete" in html
    assert "run ./run study 1." in html
    assert 'id="fig05"' in html


@pytest.mark.parametrize(
    ("fragment", "message"),
    [
        ('{{ figure("fig05") }}{{ figure("fig05") }}', "fig05 twice"),
        ("{{ no_such_word }}", r"sections/1\.html: 'no_such_word' is undefined"),
        ("{% if %}", r"sections/1\.html: "),
        ('{{ s("1/a", "z") }}', "no scalar 'z'"),
    ],
)
def test_mistake_in_a_text_is_named(out, text, fragment, message):
    with pytest.raises(StudyError, match=message):
        text(fragment, out)


@pytest.mark.parametrize(
    ("source", "section", "named"),
    [
        ("Sec. 7.1, Eq. 12", "7.1", True),
        ("Table 2, Section 7.6", "7.6", True),
        ("7.1", "7.1", True),
        ("Sections 7.1 and 7.6.", "7.6", True),
        ("Sec. 7.12", "7.1", False),
        ("Sec. 17.1", "7.1", False),
        ("Sec. 7.1.2", "7.1", False),
        ("Sec. 3, Eq. 5", "3", True),
        ("§3", "3", True),
        ("Abstract; section 3", "3", True),
        ("Eq. 3", "3", False),
        ("Table 3, Sec. 7.6", "3", False),
        ("Sec. 3.2", "3", False),
        ("T", "T", True),
        ("Table 2", "T", False),
    ],
)
def test_claims_belong_to_the_section_that_their_source_names(source, section, named):
    assert report._names(source, section) is named


def test_missing_figures_are_named_with_the_remedy(out):
    (out / "figures" / "fig05.svg").unlink()
    with pytest.raises(MissingResult, match=r"fig05\.svg: draw them again with"):
        render(Results(out))


def test_files_are_written_with_pages_bookmarks_and_tags(out):
    build(Results(out), out)
    assert Page((out / "report.html").read_text()).all("html")
    pdf = PdfReader(out / "report.pdf")
    assert len(pdf.pages) >= 1
    assert pdf.metadata.title.startswith("Piecewise-linear weight functions")
    assert pdf.metadata.author == "The pw-elements maintainers"
    titles = [entry.title for entry in flat(pdf.outline)]
    assert "Summary of verdicts" in titles
    assert any("First toy" in title for title in titles)
    assert pdf.trailer["/Root"]["/MarkInfo"]["/Marked"]
    assert "/StructTreeRoot" in pdf.trailer["/Root"]
    assert pdf.trailer["/Root"]["/Lang"] == "en"
    for number, page in enumerate(pdf.pages, start=1):
        assert f"{number} / {len(pdf.pages)}" in page.extract_text()


@pytest.fixture(params=["toy", "study"])
def written(request, tmp_path, monkeypatch):
    """A folder with a report: the toys', and the study's own where it has been computed."""
    if request.param == "study":
        if not (RESULTS / "report.pdf").exists():
            pytest.skip("there is no results/report.pdf: ./run study writes it")
        return RESULTS
    out = reported(tmp_path, monkeypatch)
    build(Results(out), out)
    return out


def test_links_in_the_pdf_lead_where_those_of_the_page_do(written):
    pdf = PdfReader(written / "report.pdf")
    page = Page((written / "report.html").read_text())
    expected = {link["href"][1:] for link in page.all("a") if link["href"].startswith("#")}
    named, internal = pdf.named_destinations, set()
    count = len(pdf.pages)
    for number in {1, (count + 1) // 2, count}:  # of the study's pages not all: text takes long
        assert f"{number} / {count}" in pdf.pages[number - 1].extract_text()
    for sheet in pdf.pages:
        for note in sheet.get("/Annots", ()):
            link = note.get_object()
            target = link.get("/Dest", link.get("/A", {}).get("/D"))
            if target is None:
                assert link["/A"]["/URI"].startswith("https://")
                continue
            internal.add(target)
            assert pdf.get_destination_page_number(named[target]) in range(count)
    assert len(internal) >= 4
    assert internal == expected
    assert all(pdf.get_destination_page_number(entry) >= 0 for entry in flat(pdf.outline))


def flat(outline):
    for entry in outline:
        yield from flat(entry) if isinstance(entry, list) else [entry]


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (numbers.num(2.549732978e9, 5), "2.5497 × 10<sup>9</sup>"),
        (numbers.num(-1.25e-7, 2), "−1.2 × 10<sup>−7</sup>"),
        (numbers.num(0.25), "0.2500"),
        (numbers.most(0.2749), "0.28"),
        (numbers.most(7.47e-4, 1), "8 × 10<sup>−4</sup>"),
        (numbers.most(0.3), "0.30"),
        (numbers.most(-0.2749), "−0.27"),
        (numbers.most(None), "–"),
        (numbers.least(1.9474), "1.94"),
        (numbers.least(2.0), "2.00"),
        (numbers.least(0.0), "0"),
        (numbers.num(2 / 3, 3), "0.667"),
        (numbers.num(0.99996), "1.000"),
        (numbers.num(9999.6), "1.000 × 10<sup>4</sup>"),
        (numbers.num(0.001234), "0.001234"),
        (numbers.num(0.0001234, 2), "1.2 × 10<sup>−4</sup>"),
        (numbers.num(3456.0, 2), "3500"),
        (numbers.num(0.0), "0"),
        (numbers.num(None), "–"),
        (numbers.num(float("nan")), "–"),
        (numbers.short(0.25), "0.25"),
        (numbers.short(4.0), "4"),
        (numbers.short(100.0, 3), "100"),
        (numbers.short(5e5, 3), "5 × 10<sup>5</sup>"),
        (numbers.pct(0.00291), "0.29 %"),
        (numbers.pct(-0.031, 3), "−3.10 %"),
        (numbers.pct(None), "–"),
        (numbers.fixed(-2.345, 1), "−2.3"),
        (numbers.fixed(-0.001, 2), "0.00"),
        (numbers.fixed(None, 2), "–"),
    ],
)
def test_numbers_are_written_for_readers(written, expected):
    assert written.replace("\u202f", " ") == expected
    assert hasattr(written, "__html__")
