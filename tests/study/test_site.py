"""Test contents and commands of the site, whose pages `.ci/run` tests in a browser."""

import ast
import inspect
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pw_elements
import pw_elements.contact
from study.judge.claims import load_paper_claims
from study.publish.site import evidence, gallery, reference, search
from study.publish.site.__main__ import main as site
from study.publish.texts import read_problem_data_of_section
from study.run.cases import SECTIONS
from study.run.store import Results
from tests.study import toystudy

ROOT = Path(__file__).parents[2]
RESULTS_FOLDER = ROOT / "results"
PUBLIC_NAMES = [
    f"{module.__name__}.{name}"
    for module in (pw_elements, pw_elements.contact)
    for name in module.__all__
]
# Constants whose names need no explanation
NAMES_WITHOUT_PAGE = {*reference.CONSTANTS_WITHOUT_PAGE}
METHODS_WITHOUT_DOCSTRING_CHECK = {"shape"}
PUBLIC_NAMES_THAT_NEED_AN_EXAMPLE = """
Spaces Body Material Reduction assemble_matrix assemble_vector boundary_measure prescribe
solve reactions nodal_flux vibration_modes buckling Sibling lumped_mass test_space
as_function draw PetrovGalerkinProblem contact.ContactPair contact.Motion contact.Plane
contact.Sphere contact.DeformableSurface contact.ContactFields contact.solve_contact
contact.solve_impact contact.plot contact.write meshes.from_gmsh
"""


def import_object(qualified_name):
    module, _, name = qualified_name.rpartition(".")
    return getattr(import_module(module), name)


def test_reference_lists_every_public_name_once():
    pages = {name.rpartition(".")[2] for name in reference.list_names_with_reference_page()}
    assert {name.rpartition(".")[2] for name in PUBLIC_NAMES} - NAMES_WITHOUT_PAGE <= pages
    assert len(reference.list_names_with_reference_page()) == len(
        {*reference.list_names_with_reference_page()}
    )


@pytest.mark.parametrize("qualified_name", reference.list_names_with_reference_page())
def test_every_public_object_documents_itself_and_the_parameters_of_its_methods(qualified_name):
    public_object = import_object(qualified_name)
    assert (inspect.getdoc(public_object) or "").split("\n\n")[0].endswith((".", ":"))
    functions_by_name = {qualified_name: public_object} if inspect.isfunction(public_object) else {}
    for name, member in vars(public_object).items() if inspect.isclass(public_object) else ():
        method = member.__func__ if isinstance(member, classmethod) else member
        if (
            inspect.isfunction(method)
            and not name.startswith("_")
            and name not in METHODS_WITHOUT_DOCSTRING_CHECK
        ):
            functions_by_name[name] = method
    for name, function in functions_by_name.items():
        docstring = inspect.getdoc(function)
        parameters = {*inspect.signature(function).parameters} - {"self", "cls"}
        assert docstring, name
        assert all(
            f"    {parameter}:" in docstring or f" {parameter} (n, " in docstring
            for parameter in parameters
        ), name


@pytest.mark.parametrize(
    "qualified_name", [f"pw_elements.{name}" for name in PUBLIC_NAMES_THAT_NEED_AN_EXAMPLE.split()]
)
def test_main_public_names_have_an_example(qualified_name):
    names_in_examples = {
        name for example in gallery.load_examples() for name in example.library_names
    }
    code_in_docstring = re.search(
        r"\n\n    \S", inspect.getdoc(import_object(qualified_name)) or ""
    )
    assert qualified_name in names_in_examples or code_in_docstring


def test_every_section_has_facts_and_one_group():
    for section in SECTIONS:
        assert read_problem_data_of_section(section).keys() == {*evidence.FACT_NAMES}, section
    grouped_sections = [
        section for group_sections in evidence.SECTION_GROUPS.values() for section in group_sections
    ]
    assert sorted(grouped_sections) == sorted(SECTIONS)


def test_gallery_lists_all_examples_in_order_with_titles_and_parseable_files():
    examples = gallery.load_examples()
    assert {gallery_example.name for gallery_example in examples} == {*gallery.GALLERY_ORDER}
    for example in examples:
        assert example.title.endswith((".", "?")), example.name
        ast.parse((gallery.EXAMPLES_FOLDER / f"{example.name}.py").read_text())


@pytest.fixture
def toy_results_folder(tmp_path, monkeypatch):
    """Return a folder of toy results; replace Sphinx by a stub that writes a site of one page."""
    results_folder = toystudy.write_toy_results(tmp_path, monkeypatch)
    monkeypatch.setattr("study.publish.site.write_sources", lambda *_: [])
    monkeypatch.setattr(
        "study.publish.site._run_sphinx", lambda _, pages: _write_text(pages / "index.html") or []
    )
    for name in evidence.REPORT_FILES:
        _write_text(results_folder / name)
    return results_folder


def _write_text(path, text="made"):
    path.write_text(text)


def _run_site_command(results_folder, site_folder):
    return site([f"--results={results_folder}", f"--out={site_folder}", "--jobs=1"])


def test_site_replaces_an_earlier_site_and_no_other_folder(toy_results_folder, tmp_path, capsys):
    out = tmp_path / "pages"
    for _ in range(2):
        assert _run_site_command(toy_results_folder, out) == 0
        assert (out / "data" / "1" / "a.json").read_bytes() == (
            toy_results_folder / "1" / "a.json"
        ).read_bytes()
        assert (out / "data" / "1" / "a.npz").exists()
        assert not (out / "data" / "1" / "b.npz").exists()
    _write_text(out / "data" / "CNAME", "mine")
    assert _run_site_command(toy_results_folder, out) == 2
    assert "it holds data/CNAME, not written with it" in capsys.readouterr().err
    foreign_folder = tmp_path / "home"
    foreign_folder.mkdir()
    _write_text(foreign_folder / "index.html", "mine")
    assert _run_site_command(toy_results_folder, foreign_folder) == 2
    assert (
        f"{foreign_folder} is there, and does not say that it is a site" in capsys.readouterr().err
    )
    assert (
        (foreign_folder / "index.html").read_text()
        == (out / "data" / "CNAME").read_text()
        == "mine"
    )
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_failed_site_build_leaves_the_earlier_site(toy_results_folder, tmp_path, monkeypatch):
    out = tmp_path / "pages"
    assert _run_site_command(toy_results_folder, out) == 0
    monkeypatch.setattr("study.publish.site._run_sphinx", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        _run_site_command(toy_results_folder, out)
    assert (out / "index.html").read_text() == "made"
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_corrupt_results_are_left_out_of_the_site_and_give_a_status(
    toy_results_folder, tmp_path, capsys
):
    out = tmp_path / "pages"
    _write_text(toy_results_folder / "1" / "a.json", "{")
    assert _run_site_command(toy_results_folder, out) == 3
    errors = capsys.readouterr().err
    assert f"site: {toy_results_folder / '1' / 'a.json'} cannot be used" in errors
    assert "run ./run study 1/a\n" in errors
    assert [path.name for path in (out / "data" / "1").iterdir()] == ["b.json"]
    for name in ("claims.json", "figures/index.json"):
        _write_text(toy_results_folder / name, "[")
        assert _run_site_command(toy_results_folder, out) == 3
        assert f"{toy_results_folder / name} can" in capsys.readouterr().err
        (toy_results_folder / name).unlink()
        assert _run_site_command(toy_results_folder, out) == 2
        assert f"site: there is no {toy_results_folder / name}" in capsys.readouterr().err
        _write_text(toy_results_folder / name, "[]")
    assert _run_site_command(tmp_path / "nowhere", out) == 2
    assert "there are no results" in capsys.readouterr().err
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.skipif(
    not (RESULTS_FOLDER / "claims.json").exists(), reason="./run study makes results"
)
def test_evidence_pages_render_without_missing_content_and_have_verdicts():
    first_sheets = evidence._SitePageRenderer(Results(RESULTS_FOLDER), {}, strict=False)
    first_sheets.render_section_sheets_and_paper_page([*SECTIONS])
    sheets = evidence._SitePageRenderer(
        Results(RESULTS_FOLDER), first_sheets.link_targets, strict=not first_sheets.missing_content
    )
    pages = [*sheets.render_section_sheets_and_paper_page([*SECTIONS]).values()]
    if sheets.missing_content:
        pytest.skip(f"results are incomplete: {sheets.missing_content[0]}")
    assert all("\n## Verdicts\n" in page for page in pages[:-1])
    assert "What to use, by purpose" in sheets.render_table_of_recommended_methods()
    home_findings = sheets.render_findings()
    n_reproduced = [claim.grade for claim in load_paper_claims()].count("reproduced")
    assert f"{n_reproduced} are reproduced" in home_findings
    links = set(re.findall(r'href="([^"]+)"', home_findings))
    assert {"evidence/claims.html", "evidence/facts.html", "evidence/7.6.html"} <= links
    assert all(link.startswith("evidence/") for link in links)


def test_home_page_has_one_place_for_the_findings():
    home_page = (ROOT / "docs" / "index.md").read_text("utf-8")
    assert len(evidence._FINDINGS_MARK.findall(home_page)) == 1


def test_mathematics_of_statements_is_typeset():
    assert evidence.typeset_html("pw-T6: 0.4 <= x, nu = 0 on 8 x 8, K_PW = T K^T") == (
        "new T6: 0.4 ≤ x, ν = 0 on 8 × 8, K<sub>PW</sub> = T K<sup>T</sup>"
    )
    assert evidence.typeset_html("menu & 2 x") == "menu &amp; 2 x"


def test_sections_that_a_text_names_are_links():
    assert evidence._link_section_names("see sections V1, 7.2 and C; section 8", "C") == (
        'see sections <a href="V1.html">V1</a>, <a href="7.2.html">7.2</a> and C; section 8'
    )
    assert (
        evidence._link_section_names('<a href="x">section V1</a>') == '<a href="x">section V1</a>'
    )


def relative_luminance(colour):
    """Return the relative luminance of a colour "#rrggbb", as defined by WCAG 2.1."""
    parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def contrast_ratio(colour, other_colour):
    lighter, darker = sorted(
        (relative_luminance(colour), relative_luminance(other_colour)), reverse=True
    )
    return (lighter + 0.05) / (darker + 0.05)


# Background colours of the site's theme, Furo
THEME_BACKGROUNDS = {"light": "#ffffff", "dark": "#131416"}


def test_text_colours_have_enough_contrast_to_their_background():
    """All text colours have the contrast ratio to their background, 4.5, that WCAG requires.

    Rules of the style sheet that set a background have to set the text colour too, and vice versa;
    otherwise, the contrast would depend on the theme.
    """
    assert contrast_ratio("#000000", "#ffffff") == pytest.approx(21)
    assert contrast_ratio("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)
    contrast_ratios = {}
    for scheme, background in THEME_BACKGROUNDS.items():
        for name, colour in read_theme_option(f"{scheme}_css_variables").items():
            contrast_ratios[scheme, name] = contrast_ratio(colour, background)
    css = (Path(reference.__file__).parent / "static" / "site.css").read_text()
    for selector, body in re.findall(r"([^{}]+)\{([^{}]*)\}", css):
        rules = dict(part.split(":", 1) for part in body.replace(" ", "").split(";") if ":" in part)
        assert float(rules.get("opacity", 1)) == 1, selector
        colours = [rules.get(name, "") for name in ("color", "background")]
        if "img" not in selector and any(colour.startswith("#") for colour in colours):
            assert all(colour.startswith("#") for colour in colours), selector
            contrast_ratios[selector.strip()] = contrast_ratio(*colours)
    assert len(contrast_ratios) >= 8
    assert {name: ratio for name, ratio in contrast_ratios.items() if ratio < 4.5} == {}


def read_theme_option(name):
    """Return an option of the theme from Sphinx's `conf.py`, which is parsed rather than run."""
    tree = ast.parse((Path(reference.__file__).parent / "conf.py").read_text())
    (options,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "html_theme_options"
    )
    return ast.literal_eval(options)[name]


def test_thumbnails_of_the_gallery_are_small(tmp_path):
    """The thumbnail of noise, the worst case for compression, is smaller than 1/4 MB.

    Thumbnails of the gallery's pictures are about four times smaller, and all sixteen together take
    less than 1 MB.
    """
    rng = np.random.default_rng(3)
    Image.fromarray(rng.integers(0, 255, (700, 1600, 3), dtype=np.uint8)).save(tmp_path / "a.png")
    gallery._save_thumbnail(tmp_path / "a.png", tmp_path / "b.png")
    assert 0 < (tmp_path / "b.png").stat().st_size < 2**20 / 4
    with Image.open(tmp_path / "b.png") as thumbnail:
        assert max(thumbnail.size) == 560


def test_sections_of_the_report_are_read_for_the_search():
    html = (
        "<main><h1>Study</h1><section id='a'><p>Even <b>forces</b></p><style>x</style></section>"
        "<section id='b'><h2>1 <i>Column</i></h2><p>mode</p></section></main>"
    )
    assert search.read_report_sections(html) == {
        "a": ("Study", "Even  forces"),
        "b": ("1 Column", "1  Column mode"),
    }
