"""Drafts for journals: they can be read, cite what exists, and agree with the results."""

import datetime
import re
import tomllib
from pathlib import Path

import pytest

import pw_elements
from study.publish.site import copy_guide_without_drafts
from study.publish.texts import REFERENCES

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "publication"
PAPER = (FOLDER / "paper.md").read_text(encoding="utf-8")
BIBLIOGRAPHY = (FOLDER / "paper.bib").read_text(encoding="utf-8")
METADATA = (FOLDER / "metadata.yaml").read_text(encoding="utf-8")
RECIPE = (FOLDER / "recipe.yaml").read_text(encoding="utf-8")
FRONT_MATTER, BODY = PAPER.removeprefix("---\n").split("\n---\n", 1)
BODY_TEXT = " ".join(BODY.split())
PAPER_SECTIONS = [
    *("Summary", "Statement of need", "State of the field", "Software design"),
    *("Research impact statement", "AI usage disclosure", "Acknowledgements", "References"),
]
# what only a person can know
FILLED_BY_A_PERSON = re.compile(
    r"(name|ORCID|email) of the first author|name of the institution(, city, country)?"
    r"|city and country of the institution"
    r"|public URL of (the repository|an archive of the results|the sdist)"
    r"|sha256 of the sdist|account of the maintainer"
    r"|names and versions of the AI tools, and what the authors have reviewed themselves"
    r"|financial support, or that there was none"
)
REQUIRED_ENTRIES = {"author", "title", "year"}
PUBLIC_SOFTWARE_KEYS = {"basix", "ufl"}  # cited by the draft alone


def read_bibliography():
    """Return the entries of the bibliography by keys, each with its fields."""
    entries = re.split(r"^@\w+\{", BIBLIOGRAPHY, flags=re.MULTILINE)[1:]
    return {
        entry.partition(",")[0]: dict(re.findall(r"^  ([\w-]+) = \{(.*)\},?$", entry, re.MULTILINE))
        for entry in entries
    }


def test_front_matter_has_what_the_journal_asks_for():
    yaml = pytest.importorskip("yaml")
    front_matter = yaml.safe_load(FRONT_MATTER)
    assert front_matter.keys() == {
        *("title", "tags", "authors", "affiliations", "date", "bibliography")
    }
    assert (FOLDER / front_matter["bibliography"]).is_file()
    assert re.fullmatch(r"\d{1,2} [A-Z][a-z]+ 20\d\d", front_matter["date"])
    indices = {affiliation["index"] for affiliation in front_matter["affiliations"]}
    assert {author["affiliation"] for author in front_matter["authors"]} <= indices


def test_the_draft_has_the_date_of_the_release():
    (written,) = re.findall(r"^date: (.*)$", FRONT_MATTER, re.MULTILINE)
    citation = (ROOT / "CITATION.cff").read_text()
    (released,) = re.findall(r"^date-released: (\S+)$", citation, re.MULTILINE)
    assert datetime.datetime.strptime(written, "%d %B %Y").date().isoformat() == released


def test_metadata_have_the_entries_of_their_template():
    yaml = pytest.importorskip("yaml")
    metadata = yaml.safe_load(METADATA)
    assert metadata.keys() == {
        *("title", "authors", "affiliations", "keywords", "code", "data", "replication"),
        *("abstract", "bibliography", "type", "domain", "language"),
        *("review", "contributors", "dates", "article", "journal"),
    }
    assert metadata["type"] == "Replication"
    assert metadata["title"].startswith("[Re] ")
    assert metadata["bibliography"] == "paper.bib"
    original_article = {key: value for one in metadata["replication"] for key, value in one.items()}
    assert original_article.keys() == {"cite", "bib", "url", "doi"}
    assert original_article["bib"] in read_bibliography()
    assert 100 < len(metadata["abstract"].split()) < 250


def test_the_conda_recipe_agrees_with_the_metadata_of_the_package():
    yaml = pytest.importorskip("yaml")
    recipe = yaml.safe_load(RECIPE)
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = pyproject["project"]
    context = recipe["context"]
    assert context["name"] == project["name"]
    assert context["version"] == pw_elements.__version__
    assert f">={context['python_min']}" == project["requires-python"]
    assert recipe["package"] == {"name": "${{ name }}", "version": "${{ version }}"}
    assert recipe["about"]["summary"] == project["description"]
    assert recipe["about"]["license"] == project["license"]
    assert [recipe["about"]["license_file"]] == project["license-files"]

    def split_names(lines):
        parts = (re.fullmatch(r"([\w-]+) ?(.*)", line) for line in lines)
        return {part[1]: part[2] for part in parts}

    host = split_names(recipe["requirements"]["host"])
    assert split_names(pyproject["build-system"]["requires"]).items() <= host.items()
    run = split_names(recipe["requirements"]["run"])
    declared = split_names(project["dependencies"])
    assert declared.items() <= run.items()
    assert run["python"] == ">=${{ python_min }}"
    # DOLFINx in the versions that the import accepts, with what the library imports of it
    code = (ROOT / "pw_elements" / "__init__.py").read_text()
    (accepted,) = re.findall(r'split\("\."\)\[:2\] not in \((.*)\):', code)
    minors = [int(minor) for minor in re.findall(r'"0", "(\d+)"', accepted)]
    assert run["fenics-dolfinx"] == "|".join(f">=0.{n},<0.{n + 1}" for n in minors)
    assert run["petsc"] == "* real_*"
    others = {"python", "fenics-dolfinx", "petsc", "mpi4py", "petsc4py", "slepc4py", "c-compiler"}
    assert run.keys() == declared.keys() | others


def test_draft_has_its_sections_and_length():
    assert re.findall(r"^# (.*)$", BODY, re.MULTILINE) == PAPER_SECTIONS
    assert 750 <= len(BODY.split()) <= 1750


def test_citations_and_entries_of_the_bibliography_agree():
    cited_keys = set(re.findall(r"@([\w-]+)", BODY))
    bibliography = read_bibliography()
    assert len(cited_keys) > 10
    assert cited_keys == bibliography.keys()
    for key, fields in bibliography.items():
        assert fields.keys() >= REQUIRED_ENTRIES, key


def test_the_bibliography_agrees_with_the_references_of_the_report():
    bibliography = read_bibliography()
    assert bibliography.keys() - PUBLIC_SOFTWARE_KEYS <= REFERENCES.keys()
    for key in bibliography.keys() & REFERENCES.keys():
        fields, reference = bibliography[key], REFERENCES[key]
        text = " ".join(reference["text"].split()).replace("–", "--").lower()
        title = re.sub(r"[{}]", "", fields["title"]).lower()
        assert title in text, key
        for name in ("year", "volume", "pages"):
            assert fields.get(name, "").lower() in text, (key, name)
        if "doi" in fields:
            assert reference["url"] == f"https://doi.org/{fields['doi']}", key
            assert not reference.get("address"), key  # DOIs that are not confirmed are left out
        elif "url" in fields:
            assert reference["url"] == fields["url"], key


def test_only_names_and_addresses_are_left_to_be_filled():
    for text in (PAPER, METADATA, RECIPE):
        places = re.findall(r"TO BE FILLED: (.*?)['\"]", " ".join(text.split()))
        assert places
        assert len(places) == text.count("TO BE FILLED:")
        assert [place for place in places if not FILLED_BY_A_PERSON.fullmatch(place)] == []
    for text in (PAPER, METADATA, RECIPE, BIBLIOGRAPHY):
        assert not re.search(r"\b(TODO|FIXME|XXX|TBD)\b|\?\?|lorem", text, re.IGNORECASE)


def test_the_site_leaves_the_drafts_out(tmp_path):
    copy_guide_without_drafts(tmp_path / "source")
    assert (tmp_path / "source" / "how-to" / "index.md").is_file()
    assert not (tmp_path / "source" / "publication").exists()


def test_the_draft_gives_computed_numbers(results):
    sawtooth = results.scalar("7.2/galerkin-T6", "sawtooth")
    assert f"gets {sawtooth:.2f} times the force of a corner (section 7.2" in BODY_TEXT
    inner_errors = [
        100 * results.scalar(f"V2/line-{element}-T6", "error_pressure_own_inner")
        for element in ("pw", "galerkin")
    ]
    assert (
        "is {:.3f} % of the peak with the new element and {:.3f} % with the standard one".format(
            *inner_errors
        )
        in BODY_TEXT
    )


def test_the_draft_gives_the_numbers_of_the_sphere(results):
    keys = ["V10/sphere-pw-T10-5", "V10/sphere-galerkin-T10-5"]
    assert results.scalar(keys[0], "weightless_nodes") == 0  # "every contact node has a pressure"
    n_weightless, n_nodes = (
        results.scalar(keys[1], name) for name in ("weightless_nodes", "nodes")
    )
    assert f"Below a sphere, {n_weightless:.0f} of {n_nodes:.0f} contact nodes" in BODY_TEXT
    medians, forces = (
        [100 * results.scalar(key, name) for key in keys]
        for name in ("pressure_error_common_median", "force_error")
    )
    for expected in (
        "its median error is {:.2f} %, against {:.2f} % of the standard element".format(*medians),
        "the total force is {:.3f} % off, against {:.3f} %".format(*forces),
    ):
        assert expected in BODY_TEXT, expected


def test_every_number_of_the_draft_has_a_test():
    text = re.sub(
        r"\(section\w* [\w.]+( of the study)?\)|\[@[^\]]*\]|Tables 1 and 2|10-node", "", BODY_TEXT
    )
    numbers = re.findall(r"\d[\d.]*\d|\d", text)
    assert numbers == [
        *("2.00", "20", "67", "0.8", "0.013", "0.014"),
        *("0.29", "0.33", "0.078", "0.036"),
    ]
