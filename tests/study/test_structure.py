"""Test that each section has one page and that files and folders of the study remain small."""

from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from study.run.cases import SECTIONS, find_page_source
from study.run.pages import find_module_of_each_section, read_literal_constants
from study.run.sources import list_imported_modules

ROOT = Path(__file__).parents[2]
STUDY_FOLDER = ROOT / "study"
MAX_TOP_LEVEL_ENTRIES = 10
MAX_MODULES_PER_FOLDER = 14
MAX_MODULES_PER_SHARED_FOLDER = 8
MAX_PAGE_CHARACTERS = 35_000
MAX_FILES_PER_PAGE_FOLDER = 4
# each method is one self-contained file
METHODS_FOLDER = STUDY_FOLDER / "benchmarks" / "q_rivals" / "methods"


def list_source_files(folder):
    """Return the files of a folder, except hidden files and Python's caches."""
    return [
        path
        for path in folder.rglob("*")
        if path.is_file()
        and not {part for part in path.relative_to(ROOT).parts if part.startswith((".", "__p"))}
    ]


def test_study_folder_has_few_top_level_entries():
    entries = {path.relative_to(STUDY_FOLDER).parts[0] for path in list_source_files(STUDY_FOLDER)}
    assert len(entries) <= MAX_TOP_LEVEL_ENTRIES, sorted(entries)


def test_folders_have_few_modules():
    counts = {}
    for path in list_source_files(STUDY_FOLDER):
        if path.suffix == ".py" and path.name != "__init__.py":
            counts[path.parent] = counts.get(path.parent, 0) + 1
    max_counts = dict.fromkeys(counts, MAX_MODULES_PER_FOLDER)
    max_counts |= dict.fromkeys(
        (STUDY_FOLDER / "solutions", STUDY_FOLDER / "meshes"), MAX_MODULES_PER_SHARED_FOLDER
    )
    max_counts[STUDY_FOLDER / "benchmarks"] = len(SECTIONS)
    assert not {folder: count for folder, count in counts.items() if count > max_counts[folder]}


@pytest.mark.parametrize("section", SECTIONS)
def test_section_page_is_short_and_its_folder_has_few_files(section):
    page = find_page_source(section)
    assert len(page.read_text(encoding="utf-8")) <= MAX_PAGE_CHARACTERS
    if page.name == "page.py":
        files = [
            path for path in list_source_files(page.parent) if METHODS_FOLDER not in path.parents
        ]
        assert len(files) <= MAX_FILES_PER_PAGE_FOLDER
    else:
        assert page.parent in (STUDY_FOLDER / "benchmarks", STUDY_FOLDER / "paper")


@pytest.mark.parametrize("section", SECTIONS)
def test_page_has_title_facts_and_text(section):
    constants = read_literal_constants(find_page_source(section))
    assert constants["TITLE"]
    assert {"geometry", "reference", "uncertainty"} <= constants["FACTS"].keys()
    assert {"RESULT", "DETAILS", "FINDINGS"} & constants.keys()


def test_files_beside_a_page_are_no_longer_than_pages():
    lengths = {
        path: len(path.read_text(encoding="utf-8"))
        for path in list_source_files(STUDY_FOLDER / "benchmarks")
        if path.suffix == ".py"
    }
    assert {path: length for path, length in lengths.items() if length > MAX_PAGE_CHARACTERS} == {}


def test_each_section_has_one_page():
    assert list(SECTIONS) == list(find_module_of_each_section())


def test_modules_have_no_circular_imports():
    """Modules of the study do not import each other in a cycle.

    Imports within functions are included, although Python would tolerate cycles of such imports.
    """
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in list_source_files(STUDY_FOLDER)
        if path.suffix == ".py" and path.name != "__init__.py"
    }
    TopologicalSorter({name: list_imported_modules(name) & modules for name in modules}).prepare()
