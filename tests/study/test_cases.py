"""Test how sections list cases and which changes make a stored result outdated."""

import subprocess
import sys
from dataclasses import replace

import pytest

from study.run import cases, provenance
from study.run.cases import Case, compute_fingerprints, load_section, title
from study.run.store import StudyError
from tests.study.toystudy import install_toy_study


@pytest.fixture
def toy_package_folder(tmp_path, monkeypatch):
    install_toy_study(tmp_path, monkeypatch)
    return tmp_path / "toy"


def compute_fingerprint(case):
    return compute_fingerprints([case])[case.key]


def append_text(path, text="CHANGED = 1\n"):
    path.write_text(path.read_text() + text)


def test_section_has_title_and_cases_and_its_title_needs_no_import(toy_package_folder):
    section = load_section("1")
    assert (section.id, section.title) == ("1", "First toy")
    assert [case.key for case in section.cases] == ["1/a", "1/b"]
    assert section.cases[1].run(**section.cases[1].parameters).scalars["y"] == 5.0
    append_text(toy_package_folder / "one.py", "raise SystemExit\n")
    assert title("1") == "First toy"  # read from the source, which can no longer be imported


@pytest.mark.parametrize(
    ("section", "appended_line", "message"),
    [
        ("9", "", "no section 9, but 1, 2"),
        ("1", "import no_such_package\n", "section 1 cannot be loaded: No module named"),
        ("1", "CASES += CASES[:1]\n", r"unsuitable cases \(names twice, or other sections\): a$"),
        ("1", 'CASES[0] = Case("2", "x", run)\n', "2/x"),
    ],
)
def test_section_that_cannot_be_loaded_raises_a_one_line_error(
    toy_package_folder, section, appended_line, message
):
    append_text(toy_package_folder / "one.py", appended_line)
    with pytest.raises(StudyError, match=message):
        load_section(section)


@pytest.mark.parametrize("name", ["", "a/b", "..", ".hidden", "a b"])
def test_case_name_that_is_no_file_name_is_refused(name):
    with pytest.raises(ValueError, match="name of a case"):
        Case("1", name, print)


def test_fingerprint_is_the_same_in_another_process(toy_package_folder):
    case = load_section("2").cases[0]
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from study.run import cases;"
        "cases.SECTIONS.update({'2': 'toy.two'});"
        "print(*cases.compute_fingerprints(cases.load_section('2').cases).values())"
    )
    command = [sys.executable, "-c", code, str(toy_package_folder.parent)]
    completed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert completed.stdout.strip() == compute_fingerprint(case)


def test_fingerprint_changes_only_with_definitions_that_the_case_uses(toy_package_folder):
    case, path = load_section("1").cases[0], toy_package_folder / "one.py"
    fingerprint_before = compute_fingerprint(case)
    append_text(path, 'TEXT = "Text of the page."\n\n\ndef draw():\n    return TEXT\n')
    assert compute_fingerprint(case) == fingerprint_before
    path.write_text(path.read_text().replace("FACTOR * value", "FACTOR * value * SCALE"))
    append_text(path, "SCALE = 1.0\n")
    with_scale = compute_fingerprint(case)
    assert with_scale != fingerprint_before
    path.write_text(path.read_text().replace("SCALE = 1.0", "SCALE = 2.0"))
    assert compute_fingerprint(case) not in (fingerprint_before, with_scale)


@pytest.mark.parametrize("file_name", ["common.py", "__init__.py"])
def test_fingerprint_changes_with_code_of_used_sources_but_not_with_comments(
    toy_package_folder, file_name
):
    case, path = load_section("1").cases[0], toy_package_folder / file_name
    append_text(path, "class Own:\n    pass\n")
    fingerprint_before = compute_fingerprint(case)
    path.write_text(f'"""About the module."""\n\n# a comment\n{path.read_text()}# another\n')
    assert compute_fingerprint(case) == fingerprint_before
    append_text(path)
    assert compute_fingerprint(case) != fingerprint_before


def test_fingerprint_does_not_change_with_another_section(toy_package_folder):
    case = load_section("1").cases[0]
    fingerprint_before = compute_fingerprint(case)
    append_text(toy_package_folder / "two.py")
    (toy_package_folder / "three.py").write_text("TITLE = 'Third'\n")
    assert compute_fingerprint(case) == fingerprint_before


def test_fingerprint_ignores_comprehension_variables_named_like_parameters(toy_package_folder):
    case = load_section("1").cases[0]
    fingerprint_before = compute_fingerprint(case)
    append_text(toy_package_folder / "one.py", "LABELS = [str(value) for value in (1.0, 2.0)]\n")
    assert compute_fingerprint(case) == fingerprint_before


def test_fingerprint_changes_with_an_indirectly_imported_module(toy_package_folder):
    (toy_package_folder / "deep").mkdir()
    (toy_package_folder / "deep" / "__init__.py").write_text("")
    (toy_package_folder / "deep" / "far.py").write_text("X = 1\n")
    append_text(toy_package_folder / "common.py", "def late():\n    from .deep import far\n")
    case = load_section("1").cases[0]
    fingerprint_before = compute_fingerprint(case)
    append_text(toy_package_folder / "deep" / "far.py")
    assert compute_fingerprint(case) != fingerprint_before


@pytest.mark.usefixtures("toy_package_folder")
def test_fingerprint_depends_on_parameters_name_library_and_versions_not_on_order(
    tmp_path, monkeypatch
):
    names = {path.name for path in cases.list_package_sources("pw_elements")}
    assert {"elements.py", "spaces.py"} <= names
    library = tmp_path / "library.py"
    library.write_text("x = 1\n")
    monkeypatch.setattr(cases, "list_package_sources", lambda _: [library])
    case = load_section("1").cases[0]
    reordered_case = replace(case, parameters=dict(reversed(case.parameters.items())))
    assert compute_fingerprint(reordered_case) == compute_fingerprint(case)
    fingerprints = {compute_fingerprint(case)}
    fingerprints.add(
        compute_fingerprint(replace(case, parameters=case.parameters | {"value": 1.5}))
    )
    fingerprints.add(compute_fingerprint(replace(case, name="c")))
    fingerprints.add(compute_fingerprint(replace(case, implied_parameters={"state": "solid"})))
    append_text(library)
    fingerprints.add(compute_fingerprint(case))
    monkeypatch.setattr(cases, "package_versions", lambda: {"dolfinx": "99"})
    fingerprints.add(compute_fingerprint(case))
    assert len(fingerprints) == 6


def test_stored_parameters_include_defaults_and_implied_ones_in_json_types():
    def run(element, divisions=(20, 10), friction=0.3, smooth=None):
        raise AssertionError(element, divisions, friction, smooth)

    case = Case("1", "a", run, {"element": "pw-T6", "friction": 0}, {"state": "plane stress"})
    assert case.stored_parameters == {
        "problem": "run",
        "element": "pw-T6",
        "divisions": [20, 10],
        "friction": 0,
        "smooth": None,
        "state": "plane stress",
    }


@pytest.mark.parametrize(
    ("commit", "dirty_flag", "commit_and_dirty"),
    [("abc", "1", ("abc", True)), ("abc", "0", ("abc", False)), (None, "1", ("unknown", None))],
)
def test_provenance_has_commit_from_environment_variables_cost_and_versions(
    monkeypatch, tmp_path, commit, dirty_flag, commit_and_dirty
):
    monkeypatch.setenv("PW_ELEMENTS_DIRTY", dirty_flag)
    if commit:
        monkeypatch.setenv("PW_ELEMENTS_COMMIT", commit)
    else:
        monkeypatch.delenv("PW_ELEMENTS_COMMIT", raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
    entries = provenance.create_provenance(1.5, 42, 2, "mark")
    assert (entries["commit"], entries["dirty"]) == commit_and_dirty
    assert (entries["seconds"], entries["dofs"], entries["processes"]) == (1.5, 42, 2)
    assert entries["fingerprint"] == "mark"
    assert entries["time"].endswith("+00:00")
    assert set(entries["versions"]) == {
        "dolfinx",
        "basix",
        "ffcx",
        "ufl",
        "petsc",
        "slepc",
        "numpy",
    }
    assert "absent" not in entries["versions"].values()


def test_fingerprint_changes_with_functions_but_not_texts_of_an_imported_page(toy_package_folder):
    imported_page = toy_package_folder / "lender.py"
    imported_page.write_text('SECTION = "3"\nPROBLEM = "old"\n\n\ndef shared():\n    return 1\n')
    append_text(toy_package_folder / "two.py", "from toy.lender import shared\n")
    path = toy_package_folder / "two.py"
    path.write_text(path.read_text().replace('{"z": 7.0}', '{"z": 7.0 * shared()}'))
    case = load_section("2").cases[0]
    fingerprint_before = compute_fingerprint(case)
    imported_page.write_text(imported_page.read_text().replace("old", "new"))
    assert compute_fingerprint(case) == fingerprint_before
    imported_page.write_text(imported_page.read_text().replace("return 1", "return 2"))
    assert compute_fingerprint(case) != fingerprint_before
