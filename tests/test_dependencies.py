"""Who may import whom: figures -> study -> pw_elements -> DOLFINx, and never back.

The oracle of the tests imports none of them.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from study.core.sources import closure, imported

ROOT = Path(__file__).parents[1]
SOLVER = {
    "dolfinx",
    "basix",
    "ufl",
    "ffcx",
    "petsc4py",
    "slepc4py",
    "mpi4py",
    "gmsh",
    "pw_elements",
}
LIGHT = [
    "study.core.store",
    "study.judge.claims",
    "study.judge.measures",
    "study.report",
    "study.paper.items",
]


def modules(package):
    """Return the full names of all modules in a package's folder."""
    paths = [path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py")]
    return sorted(".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in paths)


def tops(names):
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("pw_elements", {"study", "figures", "tests"}),
        ("study", {"figures", "tests"}),
        ("figures", {"tests"} | SOLVER),
    ],
)
def test_package_imports_nothing_from_above(package, forbidden):
    names = modules(package)
    assert len(names) > 2
    assert {name: tops(imported(name)) & forbidden for name in names} == {
        name: set() for name in names
    }


def test_modules_of_contact_fit_on_a_few_pages():
    lines = {
        path.name: len(path.read_text().splitlines())
        for path in (ROOT / "pw_elements" / "contact").glob("*.py")
    }
    assert len(lines) > 40
    assert {name: n for name, n in lines.items() if n > 300} == {}


def test_oracle_shares_no_code_with_what_it_judges():
    names = modules("tests/oracle")
    assert len(names) > 2
    for name in names:
        others = {other for other in imported(name) if not other.startswith("tests.oracle")}
        assert tops(others) <= {"numpy", "scipy", *sys.stdlib_module_names}, name


def reached(module):
    """Return all modules that a module's import leads to, as far as they are the project's own."""
    found, waiting = set(), [module]
    while waiting:
        for name in closure(waiting.pop()):
            if name not in found:
                found.add(name)
                waiting += [
                    other for other in imported(name) if tops([other]) <= {"study", "figures"}
                ]
    return found


@pytest.mark.parametrize("module", [*LIGHT, *modules("figures")])
def test_what_only_reads_results_reaches_no_solver(module):
    for name in reached(module):
        assert not tops(imported(name)) & SOLVER, name


def test_the_core_of_the_study_knows_no_mechanics():
    core = [name for name in modules("study") if name.startswith("study.core.")]
    assert len(core) > 4
    for name in core:
        own = {other for other in imported(name) if other.startswith(("study.", "pw_elements"))}
        assert all(other.startswith("study.core") for other in own), name


def test_the_judge_asks_results_and_printed_numbers_only():
    for name in modules("study"):
        if name.startswith(("study.judge", "study.report", "study.texts")):
            assert not tops(imported(name)) & SOLVER, name


def test_the_check_above_sees_a_solver_where_there_is_one():
    names = reached("study.paper.s7_1_two_triangles")
    assert any(tops(imported(name)) & SOLVER for name in names)


def test_report_and_figures_leave_the_solver_unloaded():
    code = (
        "import sys, study.report, study.judge.claims, figures, figures.__main__;"
        "from study.core.cases import SECTIONS, title;"
        "[title(section) for section in SECTIONS];"
        "print(sorted(set(sys.argv[1:]) & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, *sorted(SOLVER)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
