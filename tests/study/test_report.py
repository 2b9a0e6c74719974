"""The report: self-contained, accessible, with every number from a file."""

import json
import re
from pathlib import Path

import pytest
from pypdf import PdfReader

from study.publish import report, texts
from study.publish.report import build, render
from study.publish.texts import numbers, statements
from study.publish.texts.statements import names_section
from study.run.store import MissingResult, Results, StudyError
from tests.study.pages import Page
from tests.study.toystudy import reported

# Debian pairs WeasyPrint with a newer pydyf, which has renamed some methods
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf")

RESULTS = Path(__file__).parents[2] / "results"
TEXTS = Path(texts.__file__).parent


@pytest.fixture
def out(tmp_path, monkeypatch):
    return reported(tmp_path, monkeypatch)


@pytest.fixture
def text(tmp_path):
    """A function that writes the first part's text and returns the page; others say nothing."""
    folder = tmp_path / "templates"

    def page(fragment, out):
        folder.mkdir(exist_ok=True)
        for name, *_ in report.PARTS:
            (folder / f"{name}.html").write_text(fragment if name == "answer" else "")
        return render(Results(out), folder).html

    return page


FIGURES = '{{ figure("fig05") }}{{ figure("tab2") }}{{ figure("orders") }}{{ statements() }}'


def test_page_needs_nothing_but_itself_and_is_accessible(out, text):
    html = text(FIGURES, out)
    page = Page(html)
    sources = [a[key] for tag, a in page.tags for key in ("src", "srcset", "poster") if key in a]
    assert len(sources) == 6
    assert all(source.startswith("data:image/svg+xml,%3Csvg") for source in sources)
    assert not any(" " in source for source in sources)  # a space would end it in srcset
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in page.tags}
    assert "url(" not in html
    assert "@import" not in html
    assert page.all("html") == [{"lang": "en"}]
    viewport = {"name": "viewport", "content": "width=device-width, initial-scale=1"}
    assert viewport in page.all("meta")
    alternatives = [image["alt"] for image in page.all("img")]
    assert alternatives == [f'Line "{name}"' for name in ("fig05", "tab2", "orders")]
    assert len(page.all("h1")) == len(page.all("title")) == 1
    assert all("scope" in heading for heading in page.all("th"))
    boxes = [one for one in page.all("div") if one.get("class") == "scroll"]
    assert len(boxes) == len(page.all("table")) == 1


def check_links(page):
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = [link["href"] for link in page.all("a")]
    assert all(link[1:] in ids for link in links if link.startswith("#"))
    return links


def test_every_internal_link_has_its_one_target(out, text):
    links = check_links(
        Page(text('<p id="ref-guo">{{ cite("guo") }} {{ ref("fig05") }}</p>' + FIGURES, out))
    )
    assert {"#part-answer", "#ref-guo", "#fig05"} == set(links)


def test_figures_tables_and_references_are_numbered_as_they_come(out, text):
    html = text(
        '<p id="first">{{ ref("orders") }}, {{ cite("guo", "paper") }}, {{ cite("paper") }}</p>'
        '{{ figure("fig05") }}{{ figure("orders") }}'
        '{% call table("made", "Caption < here", of="1") %}<tr><td>1</td></tr>{% endcall %}'
        '{% for one in cited() %}<p id="ref-{{ one.key }}">{{ one.text }}</p>{% endfor %}',
        out,
    )
    first = html.partition('id="first">')[2].partition("</p>")[0]
    assert first == (
        '<a href="#orders">Fig.\N{NO-BREAK SPACE}2</a>, [<a href="#ref-guo">1</a>, '
        '<a href="#ref-paper">2</a>], [<a href="#ref-paper">2</a>]'
    )
    assert "<b>Fig. 1 (the paper&#39;s Fig. 5)</b> Caption of fig05: a &lt; <i>b</i>." in html
    assert "<b>Fig. 2</b> Caption of orders" in html
    assert "<b>Table 1 (the paper&#39;s Table 1)</b> Caption &lt; here" in html
    assert html.index('id="ref-guo"') < html.index('id="ref-paper"')


def test_statements_have_grade_anchor_and_numbers(out, text):
    html = text('{{ statements() }}<p id="grades">{{ graded() }}</p>', out)
    rows = {one.split('"')[0]: one for one in html.split('<tr id="claim-')[1:]}
    assert set(rows) == {"the-claim", "wrong", "open"}
    assert ">reproduced<" in rows["the-claim"]
    assert ">= 5\N{NARROW NO-BREAK SPACE}N<" in rows["the-claim"]
    assert ">5\N{NARROW NO-BREAK SPACE}N<" in rows["the-claim"]
    assert 'class="differs"' in rows["wrong"]
    assert 'class="differs"' not in rows["the-claim"]
    assert "not judged" in rows["open"]
    assert '<p id="grades">3 reproduced</p>' in html


@pytest.mark.parametrize(
    ("row", "asked", "found"),
    [
        ({"relation": "=", "value": 0.0, "tol": 1e-12, "measured": 3e-16}, "= 0", "round-off"),
        ({"relation": "=", "value": 4.0, "tol": 1e-12, "measured": 4 - 1e-14}, "= 4", "4"),
        ({"relation": ">", "value": 1.5, "tol": 0.0, "measured": 1.99707}, "> 1.5", "2.00"),
        ({"relation": "<=", "value": 2.0, "tol": 0.5, "measured": 2.25}, "≤ 2 ± 0.5", "2.25"),
        (
            {"relation": "=", "value": 2660e6, "tol": 1e6, "measured": 2660.17e6, "unit": "Pa"},
            "= 2660 ± 1 MPa",
            "2660.2 MPa",
        ),
        ({"relation": None, "value": None, "tol": None, "measured": None}, "–", "–"),
    ],
)
def test_numbers_of_statements_are_written_with_units(row, asked, found):
    row = {"unit": "", **row}
    assert statements.wanted(row).unescape().replace("\u202f", " ") == asked
    assert statements.found(row).replace("\u202f", " ") == found


def test_what_is_missing_is_listed(out, text, tmp_path):
    html = text('{{ figure("fig77") }}{{ s("1/never", "y") }}', out)
    assert "This part is incomplete: " in html
    assert "run ./run study 1/never." in html
    figure, part = render(Results(out), tmp_path / "templates").incomplete
    assert figure == "figure fig77 has not been drawn"
    assert part.startswith("answer: ")
    assert any(line.startswith("7.2: ") for line in render(Results(out)).incomplete)
    for damage, word in (("", "has no scalar"), ("{", "cannot be used")):
        path = out / "1" / "a.json"
        path.write_text(damage or path.read_text())
        assert f"1/a.json {word}" in text('{{ s("1/a", "z") }}', out)
    html = text('{{ figure("fig77") }}', out)
    assert "Fig. 1 (the paper&#39;s Fig. 77) is not drawn" in html
    assert 'id="fig77"' in html
    (out / "figures" / "fig05.svg").unlink()
    with pytest.raises(MissingResult, match=r"fig05\.svg: draw them again with"):
        render(Results(out))


@pytest.mark.parametrize(
    ("fragment", "message"),
    [
        ('{{ figure("fig05") }}{{ figure("fig05") }}', "fig05 twice"),
        ('{{ cite("nobody") }}', "cites nobody"),
        ('{{ ref("nothing") }}', "refers to nothing"),
        ("{{ no_such_word }}", r"answer\.html: 'no_such_word' is undefined"),
        ("{% if %}", r"answer\.html: "),
    ],
)
def test_mistake_in_a_text_is_named(out, text, fragment, message):
    with pytest.raises(StudyError, match=message):
        text(fragment, out)


@pytest.mark.parametrize(
    ("source", "sections", "others", "home"),
    [
        ("Sec. 7.1, Eq. 12", "7.1", "3 7.6", "7.1"),
        ("Table 2, Section 7.6", "7.6", "T", None),
        ("Sections 7.1 and 7.6.", "7.1 7.6", "7", None),
        ("Sec. 7.12", "", "7.1", None),
        ("Sec. 17.1", "", "7.1", None),
        ("Sec. 7.1.2", "", "7.1", None),
        ("Sec. 3, Eq. 5", "3", "5", "3"),
        ("§3", "3", "", None),
        ("Abstract; section 7.1, Fig. 5", "7.1", "5", ""),
        ("Table 3, Sec. 7.6", "7.6", "3", None),
        ("Sec. 3.2", "", "3", None),
        ("T", "T", "", None),
        ("Section 1; section 7.1", "7.1", "", "1"),
        ("Section 7.4 (Jarzebowski, implied)", "7.4", "", "7.4"),
    ],
)
def test_claims_belong_to_sections_that_their_source_names(source, sections, others, home):
    for section in sections.split():
        assert names_section(source, section)
    for section in others.split():
        assert not names_section(source, section)
    assert home is None or statements.home(source) == home


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


def test_pdf_has_bookmarks_tags_and_the_links_of_the_page(written):
    pdf = PdfReader(written / "report.pdf")
    page = Page((written / "report.html").read_text().partition("</nav>")[2])  # it is not printed
    expected = {link["href"][1:] for link in page.all("a") if link["href"].startswith("#")}
    assert pdf.metadata.title.startswith("Piecewise-linear weight functions")
    assert pdf.metadata.author == "The pw-elements maintainers"
    assert any("What it costs" in entry.title for entry in flat(pdf.outline))
    root = pdf.trailer["/Root"]
    assert root["/MarkInfo"]["/Marked"]
    assert "/StructTreeRoot" in root
    assert root["/Lang"] == "en"
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


WRITTEN = """
num 2.549732978e9 5: 2.5497 × 10<sup>9</sup>
num -1.25e-7 2: −1.2 × 10<sup>−7</sup>
num 0.25: 0.2500
num 0.6666667 3: 0.667
num 0.99996: 1.000
num 9999.6: 1.000 × 10<sup>4</sup>
num 0.001234: 0.001234
num 3456 2: 3500
num 0: 0
num nan: –
most 0.2749: 0.28
most 7.47e-4 1: 8 × 10<sup>−4</sup>
most 0.3: 0.30
most -0.2749: −0.27
least 1.9474: 1.94
least 2: 2.00
least 0: 0
short 0.25: 0.25
short 4: 4
short 100 3: 100
short 5e5 3: 5 × 10<sup>5</sup>
pct 0.00291: 0.29 %
pct -0.031 3: −3.10 %
fixed -2.345 1: −2.3
fixed -0.001 2: 0.00
count 2132343: 2 132 343
"""


@pytest.mark.parametrize("line", WRITTEN.strip().splitlines())
def test_numbers_are_written_for_readers(line):
    (name, value, *digits), words = line.split(": ")[0].split(), line.split(": ")[1]
    write, more = getattr(numbers, name), map(int, digits)
    written = write(float(value), *more)
    assert written.replace("\u202f", " ") == words
    assert hasattr(written, "__html__")
    assert write(None, *map(int, digits)) == "–"


# The study's own report


@pytest.fixture(scope="module")
def own():
    """The stored results, and the page that they make."""
    if not (RESULTS / "claims.json").exists() or not (RESULTS / "figures" / "index.json").exists():
        pytest.skip("there are no results: ./run study computes them")
    rendered = render(Results(RESULTS))
    if rendered.incomplete:
        pytest.skip(f"results are incomplete: {rendered.incomplete[0]}")
    return Results(RESULTS), rendered.html


@pytest.fixture(scope="module")
def sheets(own):
    """The pages of the PDF."""
    return report.laid_out(own[1]).pages


def test_report_is_short_and_small_and_no_page_is_a_quarter_blank_but_the_last(own, sheets):
    assert len(sheets) <= 36
    assert len(own[1].encode()) < 5e6
    check_links(Page(own[1]))
    for number, sheet in enumerate(sheets[:-1], start=1):
        page = sheet._page_box
        top = page.content_box_y()
        ends = [
            box.position_y + box.height
            for box in page.descendants()
            if type(box).__name__ in ("LineBox", "BlockReplacedBox", "InlineReplacedBox")
            and top <= box.position_y < top + page.height
        ]
        assert max(ends) - top > 0.75 * page.height, f"page {number}"


def test_all_figures_and_tables_of_the_paper_have_captions(own):
    shown = set()
    labels = re.findall(
        r"<b>Fig\. \d+ \(the paper(?:&#39;|')s Figs?\.? (\d+)(?: and | to )?(\d*)", own[1]
    )
    for first, last in labels:
        shown |= set(range(int(first), int(last or first) + 1))
    assert shown == set(range(1, 26))
    tables = re.findall(r"<b>Table \d+ \(the paper(?:&#39;|')s Table (\d)\)", own[1])
    assert sorted(tables) == ["1", "2"]


def test_captions_name_panels_by_letters_not_by_side(own):
    """On a telephone panels stand below each other."""
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", own[1], re.DOTALL)
    assert len(captions) > 30
    side = r"(?i)\b(left|right|middle|above|upper|lower) ?(panel|:|\))|on the (left|right)\b"
    for caption in captions:
        assert not re.search(side, caption), caption


def test_no_statement_of_the_paper_is_without_a_grade(own):
    results, html = own
    statements = [row for row in results.claims() if row["kind"] in ("paper", "implied")]
    assert len(statements) > 80
    for row in statements:
        line = html.partition(f'<tr id="claim-{row["id"]}"')[2].partition("</tr>")[0]
        shown = row["grade"].removeprefix("consistent ")
        assert f">{shown}</span>" in line, row["id"]


def test_examples_follow_one_template(own):
    for example in ("7.2", "7.3", "7.4", "7.5", "7.6"):
        body = own[1].partition(f'id="part-{example}"')[2].partition("</section>")[0]
        leads = ("Printed.", "Reconstructed.", "<figure", "<table", "Sensitivity.", "Finding.")
        places = [body.find(lead) for lead in leads]
        assert -1 not in places, example
        printed, made, figure, table, *rest = places
        assert [printed, made, min(figure, table)] == sorted([printed, made, min(figure, table)])
        assert [max(figure, table), *rest] == sorted([max(figure, table), *rest])
        assert 'class="statements"' in body[places[-1] :]


def test_first_page_gives_the_numbers_of_the_results(sheets):
    def stored(key, name):
        return json.loads((RESULTS / f"{key}.json").read_text())["scalars"][name]

    words = " ".join(box.text for box in sheets[0]._page_box.descendants() if hasattr(box, "text"))
    page = re.sub(r"\s+", " ", words)
    factors = [stored(f"K/factors-{kind}-T10-11-Direct", "entries") for kind in ("pw", "galerkin")]
    both = ("galerkin", "pw")
    edge = [100 * stored(f"V2/line-{kind}-T6", "error_pressure_own") for kind in both]
    slip = [100 * stored(f"V10/mindlin-{kind}-T10-4", "shear_error_common_rms") for kind in both]
    spheres = [100 * stored(f"V11/spheres-{way}-dual-5", "pressure_l2") for way in ("p2", "pw")]
    steps = [stored(f"V12/bar-3d-{mass}-7", "critical_step_over_h") for mass in ("hrz", "sibling")]
    total = [stored(f"V10/sphere-{kind}-T10-5", "force_error") for kind in both]
    assert edge[1] / edge[0] == pytest.approx(0.5, abs=0.05)  # "about half"
    assert total[1] / total[0] == pytest.approx(2, abs=0.2)  # "about twice as far off"
    for expected in (
        f"gets {stored('7.2/galerkin-T6', 'sawtooth'):.2f} times",
        f"{edge[0]:.2f} % {edge[1]:.2f} %",
        f"{slip[0]:.2f} % {slip[1]:.2f} %",
        f"{spheres[0]:.1f} %",
        f"{spheres[1]:.1f} %",
        f"{steps[0]:.3f};",
        f"{steps[1]:.3f};",
        f"{factors[0] / factors[1]:.1f};",
    ):
        assert expected in page, expected


def test_no_measured_number_is_typed_into_the_first_page():
    text = "".join((TEXTS / f"{name}.md").read_text() for name in ("answer", "decision"))
    markup = r"\{\{.*?\}\}|\{[%#].*?[%#]\}|^\d\. |\^2"  # Jinja, numbers of a list, an exponent
    plain = re.sub(rf"(?m){markup}|10-node|T10|L2", " ", text)
    # parts of a contact, elements over its radius, Poisson's ratio, and the standard element's 1
    typed = ["0.8", "1", "1", "3", "3", "8", "0.8", "0.4999", "1"]
    assert re.findall(r"\d[\d.]*", plain) == typed


def test_every_reference_is_cited(own):
    """Those of sections that are not in the report are cited on their own pages."""
    of_pages = {
        key
        for section in texts.SECTIONS
        for key in texts.read_constants(texts.find_page_source(section)).get("REFERENCES", {})
    }
    cited = {link["id"] for link in Page(own[1]).all("li") if "id" in link}
    assert {f"ref-{key}" for key in texts.REFERENCES.keys() - of_pages} <= cited
    assert cited <= {f"ref-{key}" for key in texts.REFERENCES}
