"""The structure of the study: a page for each section, few entries, few modules in a folder."""

from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from study.run.cases import SECTIONS, find_page_source
from study.run.pages import find_pages, read_constants
from study.run.sources import list_imported_modules

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "study"
MAX_ENTRIES = 10
MAX_MODULES = 14
MAX_SHARED_MODULES = 8
MAX_PAGE_CHARACTERS = 35_000
MAX_FILES_OF_A_PAGE = 4
METHODS = STUDY / "benchmarks" / "q_rivals" / "methods"
MAX_METHODS = 15  # a file each, whose lines the page counts; each can be copied without the others


def files_of(folder):
    """Return the files of a folder without what Python and editors leave there."""
    return [
        path
        for path in folder.rglob("*")
        if path.is_file()
        and not {part for part in path.relative_to(ROOT).parts if part.startswith((".", "__p"))}
    ]


def test_the_study_has_few_entries_at_its_top():
    entries = {path.relative_to(STUDY).parts[0] for path in files_of(STUDY)}
    assert len(entries) <= MAX_ENTRIES, sorted(entries)


def test_folders_have_few_modules():
    counts = {}
    for path in files_of(STUDY):
        if path.suffix == ".py" and path.name != "__init__.py":
            counts[path.parent] = counts.get(path.parent, 0) + 1
    allowed = dict.fromkeys(counts, MAX_MODULES)
    allowed |= dict.fromkeys((STUDY / "solutions", STUDY / "meshes"), MAX_SHARED_MODULES)
    allowed[STUDY / "benchmarks"] = len(SECTIONS)
    allowed[METHODS] = MAX_METHODS
    assert not {folder: count for folder, count in counts.items() if count > allowed[folder]}


@pytest.mark.parametrize("section", SECTIONS)
def test_a_section_has_a_page_that_can_be_read_in_one_go(section):
    page = find_page_source(section)
    assert len(page.read_text(encoding="utf-8")) <= MAX_PAGE_CHARACTERS
    if page.name == "page.py":
        files = [path for path in files_of(page.parent) if METHODS not in path.parents]
        assert len(files) <= MAX_FILES_OF_A_PAGE
    else:
        assert page.parent in (STUDY / "benchmarks", STUDY / "paper")


@pytest.mark.parametrize("section", SECTIONS)
def test_a_page_says_what_it_is_about(section):
    constants = read_constants(find_page_source(section))
    assert constants["TITLE"]
    assert {"geometry", "reference", "uncertainty"} <= constants["FACTS"].keys()
    assert {"RESULT", "DETAILS", "FINDINGS"} & constants.keys()


def test_files_beside_a_page_are_no_longer_than_pages():
    lengths = {
        path: len(path.read_text(encoding="utf-8"))
        for path in files_of(STUDY / "benchmarks")
        if path.suffix == ".py"
    }
    assert {path: n for path, n in lengths.items() if n > MAX_PAGE_CHARACTERS} == {}


def test_each_section_has_one_page():
    assert list(SECTIONS) == list(find_pages())


def test_no_modules_import_each_other_in_a_circle():
    """Imports within functions count, too."""
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in files_of(STUDY)
        if path.suffix == ".py" and path.name != "__init__.py"
    }
    TopologicalSorter({name: list_imported_modules(name) & modules for name in modules}).prepare()
