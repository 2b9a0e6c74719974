"""Cases, their sections, and what invalidates a stored result."""

import subprocess
import sys
from dataclasses import replace

import pytest

from study.core import cases, provenance
from study.core.cases import Case, fingerprints, load_section, title
from study.core.sources import closure, code_digest, imported
from study.core.store import StudyError
from tests.study.toystudy import install


@pytest.fixture
def toy(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch)
    return tmp_path / "toy"


def fingerprint(case):
    return fingerprints([case])[case.key]


def add(path, text="CHANGED = 1\n"):
    path.write_text(path.read_text() + text)


@pytest.mark.usefixtures("toy")
def test_section_has_its_title_and_cases():
    section = load_section("1")
    assert (section.id, section.title) == ("1", "First toy")
    assert [case.key for case in section.cases] == ["1/a", "1/b"]
    assert section.cases[1].run(**section.cases[1].parameters).scalars["y"] == 5.0


@pytest.mark.usefixtures("toy")
def test_unknown_section_is_answered_with_those_there_are():
    with pytest.raises(StudyError, match="no section 9, but 1, 2"):
        load_section("9")


def test_section_that_cannot_be_imported_is_one_sentence(toy):
    add(toy / "one.py", "import no_such_package\n")
    with pytest.raises(StudyError, match="section 1 cannot be loaded: No module named"):
        load_section("1")


@pytest.mark.parametrize(
    ("line", "message"),
    [("CASES += CASES[:1]\n", "unsuitable cases: a$"), ('CASES[0] = Case("2", "x", run)\n', "2/x")],
)
def test_ambiguous_cases_are_refused(toy, line, message):
    add(toy / "one.py", line)
    with pytest.raises(StudyError, match=message):
        load_section("1")


@pytest.mark.parametrize("name", ["", "a/b", "..", ".hidden", "a b"])
def test_name_that_is_no_file_name_is_refused(name):
    with pytest.raises(ValueError, match="name of a case"):
        Case("1", name, print)


def test_title_is_read_without_importing(toy):
    add(toy / "one.py", "raise SystemExit\n")
    assert title("1") == "First toy"


def test_fingerprint_is_the_same_in_another_process(toy):
    case = load_section("2").cases[0]
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from study.core import cases;"
        "cases.SECTIONS.update({'2': 'toy.two'});"
        "print(*cases.fingerprints(cases.load_section('2').cases).values())"
    )
    command = [sys.executable, "-c", code, str(toy.parent)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == fingerprint(case)


@pytest.mark.parametrize("name", ["one.py", "common.py", "__init__.py"])
def test_change_of_a_source_that_the_section_uses_invalidates(toy, name):
    case = load_section("1").cases[0]
    before = fingerprint(case)
    add(toy / name)
    assert fingerprint(case) != before


SOURCE = '''"""A docstring."""

X = 1  # a comment
"""A text about X."""


def f(a, b="text"):
    """Another docstring."""
    if a:
        """And a text."""
    return {"a": a, "b": b}
'''


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("# a comment", "# another one", True),
        ("A docstring", "Other words", True),
        ('    """Another docstring."""\n', "", True),
        ("A text about X", "Nothing", True),
        ("And a text", "Nothing", True),
        ("\n\n\ndef f(a, b=", "\ndef f(\n    a,\n    b=", True),
        ('{"a": a, "b": b}', '{\n        "a": a,\n        "b": b,\n    }', True),
        ("X = 1", "X = 2", False),
        ('b="text"', 'b="other"', False),
        ('"b": b', '"b": a', False),
        ("if a:", "if b:", False),
    ],
)
def test_code_changes_a_digest_and_comments_do_not(tmp_path, old, new, same):
    assert SOURCE.count(old) == 1
    path, other = tmp_path / "a.py", tmp_path / "b.py"
    path.write_text(SOURCE)
    other.write_text(SOURCE.replace(old, new))
    assert (code_digest(path) == code_digest(other)) is same


@pytest.mark.parametrize("name", ["one.py", "common.py", "__init__.py"])
def test_comment_or_docstring_does_not_invalidate(toy, name):
    case = load_section("1").cases[0]
    before = fingerprint(case)
    path = toy / name
    path.write_text(f'"""About the module."""\n\n# a comment\n{path.read_text()}# another\n')
    assert fingerprint(case) == before


def test_change_of_another_section_does_not_invalidate(toy):
    case = load_section("1").cases[0]
    before = fingerprint(case)
    add(toy / "two.py")
    (toy / "three.py").write_text("TITLE = 'Third'\n")
    assert fingerprint(case) == before


def test_change_behind_two_imports_invalidates(toy):
    (toy / "deep").mkdir()
    (toy / "deep" / "__init__.py").write_text("")
    (toy / "deep" / "far.py").write_text("X = 1\n")
    add(toy / "common.py", "def late():\n    from .deep import far\n")
    case = load_section("1").cases[0]
    before = fingerprint(case)
    add(toy / "deep" / "far.py")
    assert fingerprint(case) != before


@pytest.mark.usefixtures("toy")
def test_parameters_name_library_and_versions_invalidate(tmp_path, monkeypatch):
    library = tmp_path / "library.py"
    library.write_text("x = 1\n")
    monkeypatch.setattr(cases, "package_sources", lambda _: [library])
    case = load_section("1").cases[0]
    marks = {fingerprint(case)}
    marks.add(fingerprint(replace(case, parameters=case.parameters | {"value": 1.5})))
    marks.add(fingerprint(replace(case, name="c")))
    marks.add(fingerprint(replace(case, implied={"state": "solid"})))
    add(library)
    marks.add(fingerprint(case))
    monkeypatch.setattr(cases, "versions", lambda: {"dolfinx": "99"})
    marks.add(fingerprint(case))
    assert len(marks) == 6


def test_library_is_part_of_the_fingerprint():
    names = {path.name for path in cases.package_sources("pw_elements")}
    assert {"elements.py", "spaces.py"} <= names


@pytest.mark.usefixtures("toy")
def test_order_of_parameters_does_not_matter():
    case = load_section("1").cases[1]
    turned = replace(case, parameters=dict(reversed(case.parameters.items())))
    assert fingerprint(turned) == fingerprint(case)


def test_stored_parameters_have_the_defaults_and_the_types_of_json():
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


def test_imports_are_found_in_all_their_forms(toy):
    add(toy / "two.py", "import toy.one as o\nfrom . import common\nfrom .common import FACTOR\n")
    names = imported("toy.two")
    assert {
        "study.core.cases",
        "study.core.cases.Case",
        "toy.one",
        "toy.common",
        "toy.common.FACTOR",
    } <= names
    assert set(closure("toy.two")) == {"toy", "toy.common", "toy.one", "toy.two"}
    assert set(closure("toy.two", frozenset({"toy.one"}))) == {"toy", "toy.common", "toy.two"}


@pytest.mark.parametrize(("flag", "dirty"), [("1", True), ("0", False)])
def test_commit_of_the_entry_script_is_taken_over(monkeypatch, flag, dirty):
    monkeypatch.setenv("PW_ELEMENTS_COMMIT", "abc123")
    monkeypatch.setenv("PW_ELEMENTS_DIRTY", flag)
    origin = provenance.provenance(1.5, 42, 2, "mark")
    assert (origin["commit"], origin["dirty"]) == ("abc123", dirty)
    assert (origin["seconds"], origin["dofs"], origin["processes"]) == (1.5, 42, 2)
    assert origin["fingerprint"] == "mark"
    assert origin["time"].endswith("+00:00")
    assert set(origin["versions"]) == {"dolfinx", "basix", "ffcx", "ufl", "petsc", "slepc", "numpy"}
    assert "absent" not in origin["versions"].values()


def test_without_git_the_commit_is_unknown(monkeypatch, tmp_path):
    monkeypatch.delenv("PW_ELEMENTS_COMMIT", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    origin = provenance.provenance(0.0, 0, 1, "")
    assert (origin["commit"], origin["dirty"]) == ("unknown", None)
