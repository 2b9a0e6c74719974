"""Test that the report is self-contained and accessible and takes its numbers from files."""

import json
import re
from pathlib import Path

import pytest
from pypdf import PdfReader

from study.publish import report, texts
from study.publish.report import build_report, render_report_page
from study.publish.site.evidence import write_evidence_pages
from study.publish.texts import numbers, statements
from study.publish.texts.statements import source_names_section
from study.run.store import MissingResult, Results, StudyError
from tests.study.pages import Page
from tests.study.toystudy import write_toy_results

# Debian pairs WeasyPrint with a newer pydyf, which has renamed some methods
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf"),
    pytest.mark.xdist_group("report"),  # one worker lays out the study's report
]

RESULTS_FOLDER = Path(__file__).parents[2] / "results"
TEXTS_FOLDER = Path(texts.__file__).parent


@pytest.fixture
def toy_results_folder(tmp_path, monkeypatch):
    return write_toy_results(tmp_path, monkeypatch)


@pytest.fixture
def render_fragment(tmp_path):
    """Return a function that renders the report with a fragment as its first part.

    The function takes the fragment and the folder of results, and returns the HTML of the report.
    All other parts of the report are empty.
    """
    folder = tmp_path / "templates"

    def render_page(fragment, toy_results_folder):
        folder.mkdir(exist_ok=True)
        for name, *_ in report.PARTS:
            (folder / f"{name}.html").write_text(fragment if name == "answer" else "")
        return render_report_page(Results(toy_results_folder), folder).html

    return render_page


FIGURES_AND_STATEMENTS_TEMPLATE = (
    '{{ figure("fig05") }}{{ figure("tab2") }}{{ figure("orders") }}{{ statements() }}'
)


def test_report_page_is_self_contained_and_accessible(toy_results_folder, render_fragment):
    html = render_fragment(FIGURES_AND_STATEMENTS_TEMPLATE, toy_results_folder)
    page = Page(html)
    sources = [
        attributes[key]
        for tag, attributes in page.tags
        for key in ("src", "srcset", "poster")
        if key in attributes
    ]
    assert len(sources) == 6
    assert all(source.startswith("data:image/svg+xml,%3Csvg") for source in sources)
    assert not any(" " in source for source in sources)  # a space would end it in srcset
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in page.tags}
    assert "url(" not in html
    assert "@import" not in html
    assert page.tag_attributes("html") == [{"lang": "en"}]
    viewport = {"name": "viewport", "content": "width=device-width, initial-scale=1"}
    assert viewport in page.tag_attributes("meta")
    alternative_texts = [image["alt"] for image in page.tag_attributes("img")]
    assert alternative_texts == [f'Line "{name}"' for name in ("fig05", "tab2", "orders")]
    assert len(page.tag_attributes("h1")) == len(page.tag_attributes("title")) == 1
    assert all("scope" in heading for heading in page.tag_attributes("th"))
    scroll_boxes = [div for div in page.tag_attributes("div") if div.get("class") == "scroll"]
    assert len(scroll_boxes) == len(page.tag_attributes("table")) == 1


def assert_internal_links_have_targets(page):
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = [link["href"] for link in page.tag_attributes("a")]
    assert all(link[1:] in ids for link in links if link.startswith("#"))
    return links


def test_every_internal_link_has_one_target(toy_results_folder, render_fragment):
    links = assert_internal_links_have_targets(
        Page(
            render_fragment(
                '<p id="ref-guo">{{ cite("guo") }} {{ ref("fig05") }}</p>'
                + FIGURES_AND_STATEMENTS_TEMPLATE,
                toy_results_folder,
            )
        )
    )
    assert {"#part-answer", "#ref-guo", "#fig05"} == set(links)


def test_figures_tables_and_references_are_numbered_in_order_of_appearance(
    toy_results_folder, render_fragment
):
    html = render_fragment(
        '<p id="first">{{ ref("orders") }}, {{ cite("guo", "paper") }}, {{ cite("paper") }}</p>'
        '{{ figure("fig05") }}{{ figure("orders") }}'
        '{% call table("made", "Caption < here", of="1") %}<tr><td>1</td></tr>{% endcall %}'
        '{% for one in cited() %}<p id="ref-{{ one.key }}">{{ one.text }}</p>{% endfor %}',
        toy_results_folder,
    )
    first_paragraph = html.partition('id="first">')[2].partition("</p>")[0]
    assert first_paragraph == (
        '<a href="#orders">Fig.\N{NO-BREAK SPACE}2</a>, [<a href="#ref-guo">1</a>, '
        '<a href="#ref-paper">2</a>], [<a href="#ref-paper">2</a>]'
    )
    assert "<b>Fig. 1 (the paper&#39;s Fig. 5)</b> Caption of fig05: a &lt; <i>b</i>." in html
    assert "<b>Fig. 2</b> Caption of orders" in html
    assert "<b>Table 1 (the paper&#39;s Table 1)</b> Caption &lt; here" in html
    assert html.index('id="ref-guo"') < html.index('id="ref-paper"')


def test_statements_have_grade_anchor_and_numbers(toy_results_folder, render_fragment):
    html = render_fragment(
        '{{ statements() }}<p id="grades">{{ graded() }}</p>', toy_results_folder
    )
    rows = {row_html.split('"')[0]: row_html for row_html in html.split('<tr id="claim-')[1:]}
    assert set(rows) == {"the-claim", "wrong", "open"}
    assert ">reproduced<" in rows["the-claim"]
    assert ">= 5\N{NARROW NO-BREAK SPACE}N<" in rows["the-claim"]
    assert ">5\N{NARROW NO-BREAK SPACE}N<" in rows["the-claim"]
    assert 'class="differs"' in rows["wrong"]
    assert 'class="differs"' not in rows["the-claim"]
    assert "not judged" in rows["open"]
    assert '<p id="grades">3 reproduced</p>' in html


@pytest.mark.parametrize(
    ("row", "criterion_text", "measured_text"),
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
def test_numbers_of_statements_are_formatted_with_units(row, criterion_text, measured_text):
    row = {"unit": "", **row}
    assert statements.format_criterion(row).unescape().replace("\u202f", " ") == criterion_text
    assert statements.format_measured(row).replace("\u202f", " ") == measured_text


def test_missing_results_and_figures_are_listed(toy_results_folder, render_fragment, tmp_path):
    html = render_fragment('{{ figure("fig77") }}{{ s("1/never", "y") }}', toy_results_folder)
    assert "This part is incomplete: " in html
    assert "run ./run study 1/never." in html
    figure_message, part_message = render_report_page(
        Results(toy_results_folder), tmp_path / "templates"
    ).missing_content
    assert figure_message == "figure fig77 has not been drawn"
    assert part_message.startswith("answer: ")
    assert any(
        line.startswith("7.2: ")
        for line in render_report_page(Results(toy_results_folder)).missing_content
    )
    for damaged_content, message in (("", "has no scalar"), ("{", "cannot be used")):
        path = toy_results_folder / "1" / "a.json"
        path.write_text(damaged_content or path.read_text())
        assert f"1/a.json {message}" in render_fragment('{{ s("1/a", "z") }}', toy_results_folder)
    html = render_fragment('{{ figure("fig77") }}', toy_results_folder)
    assert "Fig. 1 (the paper&#39;s Fig. 77) is not drawn" in html
    assert 'id="fig77"' in html
    (toy_results_folder / "figures" / "fig05.svg").unlink()
    with pytest.raises(MissingResult, match=r"fig05\.svg: draw them again with"):
        render_report_page(Results(toy_results_folder))


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
def test_error_names_the_mistake_in_a_template(
    toy_results_folder, render_fragment, fragment, message
):
    with pytest.raises(StudyError, match=message):
        render_fragment(fragment, toy_results_folder)


@pytest.mark.parametrize(
    ("source", "sections", "other_sections", "home_section"),
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
def test_claim_belongs_to_the_sections_that_its_source_names(
    source, sections, other_sections, home_section
):
    for section in sections.split():
        assert source_names_section(source, section)
    for section in other_sections.split():
        assert not source_names_section(source, section)
    assert home_section is None or statements.first_section_named_by_source(source) == home_section


@pytest.fixture(params=["toy", "study"])
def report_folder(request, tmp_path, monkeypatch):
    """Return a folder with the report of the toy study or with the stored report of the project.

    Tests of the latter are skipped if `results/report.pdf` does not exist.
    """
    if request.param == "study":
        if not (RESULTS_FOLDER / "report.pdf").exists():
            pytest.skip("there is no results/report.pdf: ./run study writes it")
        return RESULTS_FOLDER
    toy_results_folder = write_toy_results(tmp_path, monkeypatch)
    build_report(Results(toy_results_folder), toy_results_folder)
    return toy_results_folder


def test_pdf_has_bookmarks_tags_and_the_links_of_the_page(report_folder):
    pdf = PdfReader(report_folder / "report.pdf")
    page = Page(
        (report_folder / "report.html").read_text().partition("</nav>")[2]
    )  # it is not printed
    expected_targets = {
        link["href"][1:] for link in page.tag_attributes("a") if link["href"].startswith("#")
    }
    assert pdf.metadata.title.startswith("Piecewise-linear weight functions")
    assert pdf.metadata.author == "The pw-elements maintainers"
    assert any("other methods, and cost" in entry.title for entry in flatten_outline(pdf.outline))
    root = pdf.trailer["/Root"]
    assert root["/MarkInfo"]["/Marked"]
    assert "/StructTreeRoot" in root
    assert root["/Lang"] == "en"
    destinations, internal_targets = pdf.named_destinations, set()
    n_pages = len(pdf.pages)
    for number in {1, (n_pages + 1) // 2, n_pages}:  # of the study's pages not all: text takes long
        assert f"{number} / {n_pages}" in pdf.pages[number - 1].extract_text()
    for pdf_page in pdf.pages:
        for annotation in pdf_page.get("/Annots", ()):
            link = annotation.get_object()
            target = link.get("/Dest", link.get("/A", {}).get("/D"))
            if target is None:
                assert link["/A"]["/URI"].startswith("https://")
                continue
            internal_targets.add(target)
            assert pdf.get_destination_page_number(destinations[target]) in range(n_pages)
    assert len(internal_targets) >= 4
    assert internal_targets == expected_targets
    assert all(
        pdf.get_destination_page_number(entry) >= 0 for entry in flatten_outline(pdf.outline)
    )


def flatten_outline(outline):
    for entry in outline:
        yield from flatten_outline(entry) if isinstance(entry, list) else [entry]


NUMBER_FORMATTING_EXAMPLES = """
format_number 2.549732978e9 5: 2.5497 × 10<sup>9</sup>
format_number -1.25e-7 2: −1.2 × 10<sup>−7</sup>
format_number 0.25: 0.2500
format_number 0.6666667 3: 0.667
format_number 0.99996: 1.000
format_number 9999.6: 1.000 × 10<sup>4</sup>
format_number 0.001234: 0.001234
format_number 3456 2: 3500
format_number 0: 0
format_number nan: –
format_upper_bound 0.2749: 0.28
format_upper_bound 7.47e-4 1: 8 × 10<sup>−4</sup>
format_upper_bound 0.3: 0.30
format_upper_bound -0.2749: −0.27
format_lower_bound 1.9474: 1.94
format_lower_bound 2: 2.00
format_lower_bound 0: 0
format_short_number 0.25: 0.25
format_short_number 4: 4
format_short_number 100 3: 100
format_short_number 5e5 3: 5 × 10<sup>5</sup>
format_percent 0.00291: 0.29 %
format_percent -0.031 3: −3.10 %
format_decimals -2.345 1: −2.3
format_decimals -0.001 2: 0.00
format_count 2132343: 2 132 343
"""


@pytest.mark.parametrize("example_line", NUMBER_FORMATTING_EXAMPLES.strip().splitlines())
def test_number_formatting_functions_give_the_listed_texts(example_line):
    (name, value, *digits), expected_text = (
        example_line.split(": ")[0].split(),
        example_line.split(": ")[1],
    )
    format_number, digit_arguments = getattr(numbers, name), map(int, digits)
    formatted = format_number(float(value), *digit_arguments)
    assert formatted.replace("\u202f", " ") == expected_text
    assert hasattr(formatted, "__html__")
    assert format_number(None, *map(int, digits)) == "–"


# The study's own report


@pytest.fixture(scope="module")
def study_results_and_html():
    """Return the stored results of the project and the HTML of their report."""
    if (
        not (RESULTS_FOLDER / "claims.json").exists()
        or not (RESULTS_FOLDER / "figures" / "index.json").exists()
    ):
        pytest.skip("there are no results: ./run study computes them")
    rendered = render_report_page(Results(RESULTS_FOLDER))
    if rendered.missing_content:
        pytest.skip(f"results are incomplete: {rendered.missing_content[0]}")
    return Results(RESULTS_FOLDER), rendered.html


@pytest.fixture(scope="module")
def pdf_document(study_results_and_html):
    """Return the pages of the PDF, laid out from the HTML, as a document of WeasyPrint."""
    return report.lay_out_pdf_pages(study_results_and_html[1])


def test_report_is_short_and_small_and_no_page_is_a_quarter_blank_but_the_last(
    study_results_and_html, pdf_document
):
    """The report has at most 24 pages before the section on reproducibility and 3 from there on.

    Its HTML is smaller than 5 MB, and every page of the PDF except the last is filled to more than
    three quarters of its height.
    """
    pdf_pages = pdf_document.pages
    n_article_pages = next(
        page_index
        for label, (page_index, *_), *_ in pdf_document.make_bookmark_tree()[0][2]
        if label.endswith("Reproducibility")
    )
    assert 15 < n_article_pages <= 24
    assert len(pdf_pages) <= n_article_pages + 3
    assert len(study_results_and_html[1].encode()) < 5e6
    assert_internal_links_have_targets(Page(study_results_and_html[1]))
    for number, pdf_page in enumerate(pdf_pages[:-1], start=1):
        page_box = pdf_page._page_box
        top = page_box.content_box_y()
        box_ends = [
            box.position_y + box.height
            for box in page_box.descendants()
            if type(box).__name__ in ("LineBox", "BlockReplacedBox", "InlineReplacedBox")
            and top <= box.position_y < top + page_box.height
        ]
        assert max(box_ends) - top > 0.75 * page_box.height, f"page {number}"


def test_all_figures_and_tables_of_the_paper_have_captions(study_results_and_html):
    figure_numbers = set()
    labels = re.findall(
        r"<b>Fig\. \d+ \(the paper(?:&#39;|')s Figs?\.? (\d+)(?: and | to )?(\d*)",
        study_results_and_html[1],
    )
    for first, last in labels:
        figure_numbers |= set(range(int(first), int(last or first) + 1))
    assert figure_numbers == set(range(1, 26))
    table_numbers = re.findall(
        r"<b>Table \d+ \(the paper(?:&#39;|')s Table (\d)\)", study_results_and_html[1]
    )
    assert sorted(table_numbers) == ["1", "2"]


def test_captions_do_not_name_panels_by_their_side(study_results_and_html):
    """No caption names a panel by its side, because a telephone shows panels below each other."""
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", study_results_and_html[1], re.DOTALL)
    assert len(captions) > 25
    side_pattern = (
        r"(?i)\b(left|right|middle|above|upper|lower) ?(panel|:|\))|on the (left|right)\b"
    )
    for caption in captions:
        assert not re.search(side_pattern, caption), caption


def test_claims_page_grades_every_statement_and_report_counts_grades(
    study_results_and_html, tmp_path
):
    """The claims page states the grade of each statement, and the report counts the grades."""
    results, html = study_results_and_html
    (tmp_path / "which-way.md").write_text("")
    (tmp_path / "index.md").write_text("<!-- findings -->")
    write_evidence_pages(results, tmp_path)
    claims_page = (tmp_path / "evidence" / "claims.md").read_text()
    statement_rows = [row for row in results.claims() if row["kind"] in ("paper", "implied")]
    assert len(statement_rows) > 80
    for row in statement_rows:
        article = claims_page.partition(f'<article id="{row["id"]}"')[2]
        article = article.partition("</article>")[0]
        assert f'<span class="grade">{row["grade"]}' in article, row["id"]
    for grade in ("reproduced", "not explained", "contradicted"):
        count = sum(row["grade"] == grade for row in statement_rows)
        assert re.search(
            rf">{grade}</t.>(\s*<td[^>]*>\d+</td>)*?\s*<td[^>]*>{count}</td>\s*</tr>", html
        )


def test_each_benchmark_has_a_row_in_the_table_of_verification(study_results_and_html):
    """Each benchmark has a row in the table of verification unless its `VERIFICATION` is empty.

    Benchmarks with an empty `VERIFICATION` are described in the text of the report instead.
    """
    table = (
        study_results_and_html[1].partition('<table id="verification"')[2].partition("</table>")[0]
    )
    sections_with_rows = set(re.findall(r"<tr>\s*<th[^>]*>(\w[\w.]*)</th>", table))
    benchmarks = {
        section: texts.read_literal_constants(texts.find_page_source(section)).get("VERIFICATION")
        for section in texts.SECTIONS
        if "benchmarks" in texts.find_page_source(section).parts
    }
    assert len(benchmarks) > 20
    assert {name for name, rows in benchmarks.items() if rows != ""} <= sections_with_rows


def test_report_parts_of_examples_have_the_same_order_of_content(study_results_and_html):
    for example in ("7.2", "7.3", "7.4", "7.5", "7.6"):
        section_html = (
            study_results_and_html[1]
            .partition(f'id="part-{example}"')[2]
            .partition("</section>")[0]
        )
        lead_texts = ("Printed.", "Reconstructed.", "<figure", "<table", "Sensitivity.", "Finding.")
        positions = [section_html.find(lead_text) for lead_text in lead_texts]
        assert -1 not in positions, example
        printed, reconstructed, figure, table, *later_positions = positions
        assert [printed, reconstructed, min(figure, table)] == sorted(
            [printed, reconstructed, min(figure, table)]
        )
        assert [max(figure, table), *later_positions] == sorted(
            [max(figure, table), *later_positions]
        )
        assert "Statements of the paper on this section: " in section_html[positions[-1] :]


def test_first_page_gives_the_numbers_of_the_results(pdf_document):
    def read_scalar(key, name):
        return json.loads((RESULTS_FOLDER / f"{key}.json").read_text())["scalars"][name]

    page_words = " ".join(
        box.text for box in pdf_document.pages[0]._page_box.descendants() if hasattr(box, "text")
    )
    page_text = re.sub(r"\s+", " ", page_words)
    n_factor_entries = [
        read_scalar(f"K/factors-{kind}-T10-11-Direct", "entries") for kind in ("pw", "galerkin")
    ]
    element_kinds = ("galerkin", "pw")
    edge_errors = [
        100 * read_scalar(f"V2/line-{kind}-T6", "error_pressure_own") for kind in element_kinds
    ]
    shear_errors = [
        100 * read_scalar(f"V10/mindlin-{kind}-T10-4", "shear_error_common_rms")
        for kind in element_kinds
    ]
    sphere_errors = [
        100 * read_scalar(f"V11/spheres-{method}-dual-5", "pressure_l2") for method in ("p2", "pw")
    ]
    critical_steps = [
        read_scalar(f"V12/bar-3d-{mass}-7", "critical_step_over_h") for mass in ("hrz", "sibling")
    ]
    force_errors = [
        read_scalar(f"V10/sphere-{kind}-T10-5", "force_error") for kind in element_kinds
    ]
    assert edge_errors[1] / edge_errors[0] == pytest.approx(0.5, abs=0.05)  # "about half"
    assert force_errors[1] / force_errors[0] == pytest.approx(
        2, abs=0.2
    )  # "about twice as far off"
    exact_over_euler = read_scalar("7.6/exact", "G_1") / read_scalar("7.6/exact", "euler_1")
    for expected in (
        f"{read_scalar('7.2/galerkin-T6', 'sawtooth'):.2f} (block)",
        f"{100 * (1 - exact_over_euler):.1f} and",
        f"{edge_errors[0]:.2f} % {edge_errors[1]:.2f} %",
        f"{shear_errors[0]:.2f} % {shear_errors[1]:.2f} %",
        f"{sphere_errors[0]:.1f} %",
        f"{sphere_errors[1]:.1f} %",
        f"{critical_steps[0]:.3f};",
        f"{critical_steps[1]:.3f};",
        f"{n_factor_entries[0] / n_factor_entries[1]:.1f};",
    ):
        assert expected in page_text, expected


def test_no_measured_number_is_typed_into_the_first_page():
    text = "".join((TEXTS_FOLDER / f"{name}.md").read_text() for name in ("answer", "decision"))
    markup = r"\{\{.*?\}\}|\{[%#].*?[%#]\}|^\d\. |\^2"  # Jinja, numbers of a list, an exponent
    text_without_markup = re.sub(rf"(?m){markup}|10-node|T10|L2", " ", text)
    # the paper's 0.3 % and its tables; V2; exact ratios of forces; elements of a mesh; modes; odds
    allowed_numbers = ["0.3", "1", "2", "2", "2", "1", "32", "1", "2", "1", "2", "20", "1"]
    # parts of a contact, elements over its radius, Poisson's ratio, and the standard element's 1
    allowed_numbers += ["0.8", "1", "1", "3", "3", "8", "0.8", "0.4999", "1"]
    assert re.findall(r"\d[\d.]*", text_without_markup) == allowed_numbers


def test_every_reference_is_cited(study_results_and_html):
    """Each reference is cited by a text of the report or by the page of a section."""
    page_texts = [texts.find_page_source(section).read_text() for section in texts.SECTIONS]
    chapters = [path.read_text() for path in TEXTS_FOLDER.glob("*.md")]
    calls = re.findall(r"cite\((.*?)\)", "".join(page_texts + chapters))
    assert set(re.findall(r'"(\w+)"', "".join(calls))) == texts.REFERENCES.keys()
    cited_ids = {
        link["id"] for link in Page(study_results_and_html[1]).tag_attributes("li") if "id" in link
    }
    assert {"ref-paper", "ref-celik"} <= cited_ids
    assert cited_ids <= {f"ref-{key}" for key in texts.REFERENCES}
