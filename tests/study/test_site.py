"""What the site is made of. The pages themselves are opened in a browser by .ci/run."""

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
from study.publish.site import evidence, gallery, reference
from study.publish.site.__main__ import main as site
from study.publish.texts import section_facts
from study.run.cases import SECTIONS
from study.run.store import Results
from tests.study import toystudy

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"
NAMES = [
    f"{module.__name__}.{name}"
    for module in (pw_elements, pw_elements.contact)
    for name in module.__all__
]
# Names that say of themselves all that there is to say
PLAIN = {*reference.CONSTANTS}
RENAMED = {"shape"}
MAIN = """
Spaces Body Material Reduction assemble_matrix assemble_vector boundary_measure prescribe
solve reactions nodal_flux vibration_modes buckling Sibling lumped_mass test_space
as_function draw PetrovGalerkinProblem contact.ContactPair contact.Motion contact.Plane
contact.Sphere contact.DeformableSurface contact.ContactFields contact.solve_contact
contact.solve_impact contact.plot contact.write meshes.from_gmsh
"""


def thing(full):
    module, _, name = full.rpartition(".")
    return getattr(import_module(module), name)


def test_every_public_name_has_a_page():
    pages = {name.rpartition(".")[2] for name in reference.public()}
    assert {name.rpartition(".")[2] for name in NAMES} - PLAIN <= pages
    assert len(reference.public()) == len({*reference.public()})


@pytest.mark.parametrize("full", reference.public())
def test_every_page_says_what_its_thing_and_its_methods_are_and_take(full):
    one = thing(full)
    assert (inspect.getdoc(one) or "").split("\n\n")[0].endswith((".", ":"))
    taking = {full: one} if inspect.isfunction(one) else {}
    for name, member in vars(one).items() if inspect.isclass(one) else ():
        method = member.__func__ if isinstance(member, classmethod) else member
        if inspect.isfunction(method) and not name.startswith("_") and name not in RENAMED:
            taking[name] = method
    for name, function in taking.items():
        text = inspect.getdoc(function)
        taken = {*inspect.signature(function).parameters} - {"self", "cls"}
        assert text, name
        assert all(f"    {one}:" in text or f" {one} (n, " in text for one in taken), name


@pytest.mark.parametrize("full", [f"pw_elements.{name}" for name in MAIN.split()])
def test_main_entries_have_an_example(full):
    used = {name for one in gallery.examples() for name in one.uses}
    code = re.search(r"\n\n    \S", inspect.getdoc(thing(full)) or "")
    assert full in used or code


def test_every_section_has_its_words_and_one_group():
    for section in SECTIONS:
        assert section_facts(section).keys() == {*evidence.PARTS}, section
    listed = [section for members in evidence.GROUPS.values() for section in members]
    assert sorted(listed) == sorted(SECTIONS)


def test_examples_are_in_the_gallery_with_title_and_text():
    every = gallery.examples()
    assert {one.name for one in every} == {*gallery.ORDER}
    for one in every:
        assert one.title.endswith((".", "?")), one.name
        ast.parse((gallery.EXAMPLES / f"{one.name}.py").read_text())


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Results with claims and figures, and a site that has one page besides their data."""
    results = toystudy.reported(tmp_path, monkeypatch)
    monkeypatch.setattr("study.publish.site.write_sources", lambda *_: [])
    monkeypatch.setattr(
        "study.publish.site._sphinx", lambda _, pages: _write(pages / "index.html") or []
    )
    for name in evidence.REPORT:
        _write(results / name)
    return results


def _write(path, text="made"):
    path.write_text(text)


def _site(results, out):
    return site([f"--results={results}", f"--out={out}", "--jobs=1"])


def test_a_site_takes_the_place_of_an_earlier_one_and_of_nothing_else(toy, tmp_path, capsys):
    out = tmp_path / "pages"
    for _ in range(2):
        assert _site(toy, out) == 0
        assert (out / "data" / "1" / "a.json").read_bytes() == (toy / "1" / "a.json").read_bytes()
        assert (out / "data" / "1" / "a.npz").exists()
        assert not (out / "data" / "1" / "b.npz").exists()
    _write(out / "data" / "CNAME", "mine")
    assert _site(toy, out) == 2
    assert "it holds data/CNAME, not written with it" in capsys.readouterr().err
    home = tmp_path / "home"
    home.mkdir()
    _write(home / "index.html", "mine")
    assert _site(toy, home) == 2
    assert f"{home} is there, and does not say that it is a site" in capsys.readouterr().err
    assert (home / "index.html").read_text() == (out / "data" / "CNAME").read_text() == "mine"
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_site_that_fails_leaves_the_earlier_one(toy, tmp_path, monkeypatch):
    out = tmp_path / "pages"
    assert _site(toy, out) == 0
    monkeypatch.setattr("study.publish.site._sphinx", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        _site(toy, out)
    assert (out / "index.html").read_text() == "made"
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_corrupt_results_cost_a_site_their_own_data_and_have_a_status(toy, tmp_path, capsys):
    out = tmp_path / "pages"
    _write(toy / "1" / "a.json", "{")
    assert _site(toy, out) == 3
    said = capsys.readouterr().err
    assert f"site: {toy / '1' / 'a.json'} cannot be used" in said
    assert "run ./run study 1/a\n" in said
    assert [path.name for path in (out / "data" / "1").iterdir()] == ["b.json"]
    for name in ("claims.json", "figures/index.json"):
        _write(toy / name, "[")
        assert _site(toy, out) == 3
        assert f"{toy / name} can" in capsys.readouterr().err
        (toy / name).unlink()
        assert _site(toy, out) == 2
        assert f"site: there is no {toy / name}" in capsys.readouterr().err
        _write(toy / name, "[]")
    assert _site(tmp_path / "nowhere", out) == 2
    assert "there are no results" in capsys.readouterr().err
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.skipif(not (RESULTS / "claims.json").exists(), reason="./run study makes results")
def test_sheets_have_all_that_their_texts_ask_for():
    first = evidence._Sheets(Results(RESULTS), {}, strict=False)
    first.pages([*SECTIONS])
    sheets = evidence._Sheets(Results(RESULTS), first.known, strict=not first.incomplete)
    pages = [*sheets.pages([*SECTIONS]).values()]
    if sheets.incomplete:
        pytest.skip(f"results are incomplete: {sheets.incomplete[0]}")
    assert all("\n## Verdicts\n" in page for page in pages[:-1])
    assert "What the new element changes, by purpose" in sheets.decision()


def test_mathematics_of_statements_is_set():
    assert evidence.typeset("pw-T6: 0.4 <= x, nu = 0 on 8 x 8, K_PW = T K^T") == (
        "new T6: 0.4 ≤ x, ν = 0 on 8 × 8, K<sub>PW</sub> = T K<sup>T</sup>"
    )
    assert evidence.typeset("menu & 2 x") == "menu &amp; 2 x"


def test_sections_that_a_text_names_are_links():
    assert evidence._linked("see sections V1, 7.2 and C; section 8", "C") == (
        'see sections <a href="V1.html">V1</a>, <a href="7.2.html">7.2</a> and C; section 8'
    )
    assert evidence._linked('<a href="x">section V1</a>') == '<a href="x">section V1</a>'


def luminance(colour):
    """Relative luminance, as WCAG 2.1 defines it."""
    parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def contrast(one, other):
    lighter, darker = sorted((luminance(one), luminance(other)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


# Backgrounds of the theme (Furo)
PAPERS = {"light": "#ffffff", "dark": "#131416"}


def test_texts_stand_out_from_what_is_behind_them():
    """At least 4.5, as WCAG asks for; a background of our own needs a colour of our own."""
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)
    found = {}
    for scheme, paper in PAPERS.items():
        for name, colour in theme_option(f"{scheme}_css_variables").items():
            found[scheme, name] = contrast(colour, paper)
    css = (Path(reference.__file__).parent / "static" / "site.css").read_text()
    for selector, body in re.findall(r"([^{}]+)\{([^{}]*)\}", css):
        rules = dict(part.split(":", 1) for part in body.replace(" ", "").split(";") if ":" in part)
        assert float(rules.get("opacity", 1)) == 1, selector
        colours = [rules.get(name, "") for name in ("color", "background")]
        if "img" not in selector and any(colour.startswith("#") for colour in colours):
            assert all(colour.startswith("#") for colour in colours), selector
            found[selector.strip()] = contrast(*colours)
    assert len(found) >= 8
    assert {name: ratio for name, ratio in found.items() if ratio < 4.5} == {}


def theme_option(name):
    """One of the theme's options in Sphinx' settings, which are read as text."""
    tree = ast.parse((Path(reference.__file__).parent / "conf.py").read_text())
    (options,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "html_theme_options"
    )
    return ast.literal_eval(options)[name]


def test_thumbnails_of_the_gallery_are_small(tmp_path):
    """Sixteen of them are less than 1 MB; noise, the worst picture, is four times that."""
    rng = np.random.default_rng(3)
    Image.fromarray(rng.integers(0, 255, (700, 1600, 3), dtype=np.uint8)).save(tmp_path / "a.png")
    gallery._thumbnail(tmp_path / "a.png", tmp_path / "b.png")
    assert 0 < (tmp_path / "b.png").stat().st_size < 2**20 / 4
    with Image.open(tmp_path / "b.png") as small:
        assert max(small.size) == 560
