"""Who may import whom: figures -> study -> pw_elements -> DOLFINx, and never back.

The oracle of the tests imports none of them.
"""

import ast
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

from pw_elements import Direct, Iterative
from pw_elements.contact.iteration import LinearIncrement
from pw_elements.contact.nodes import UndeformedKinematics
from pw_elements.contact.steps import stepping
from study.core.sources import closure, imported, source
from tests.contact.cases import GALERKIN, PW, BlockOnFloor

ROOT = Path(__file__).parents[2]
LIBRARY = ROOT / "pw_elements"
WINGS = [  # of the library, from the lowest to the highest
    "arrays",
    "_compat",
    "files",
    "progress",
    "checks",
    "spaces",
    "solvers",
    "algebra",
    "elasticity",
    "abaqus",
    "meshes",
    "pictures",
    "contact.model",
    "contact.interface",
    "contact.nodes",
    "contact.system",
    "contact.iteration",
    "contact.rescue",
    "contact.output",
    "contact.steps",
]
SOLVER = {"dolfinx", "basix", "ufl", "ffcx", "petsc4py", "slepc4py", "mpi4py", "gmsh"}
SOLVER |= {"pw_elements"}
LIGHT = ["core.store", "core.folder", "judge.claims", "judge.measures", "report", "paper.items"]


def modules(package):
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
    assert [name for name in names if tops(imported(name)) & forbidden] == []


def rooms(folder):
    """Modules and folders in a folder, less its face."""
    return [
        path
        for path in folder.iterdir()
        if (path / "__init__.py").exists() or (path.suffix == ".py" and path.stem != "__init__")
    ]


def test_a_folder_of_the_library_has_at_most_eight_rooms():
    folders = [path.parent for path in LIBRARY.rglob("__init__.py")]
    counts = {folder.relative_to(LIBRARY): len(rooms(folder)) for folder in folders}
    assert counts.pop(Path(".")) <= 13
    assert {folder: n for folder, n in counts.items() if n > 8} == {}
    assert len(counts) > 8


@pytest.mark.parametrize("package", ["pw_elements", "study"])
def test_a_module_is_at_most_700_lines(package):
    paths = list((ROOT / package).rglob("*.py"))
    lines = {path.relative_to(ROOT): len(path.read_text().splitlines()) for path in paths}
    assert lines
    assert {name: n for name, n in lines.items() if n > 700} == {}


def wing(module):
    """The wing of the library that a module belongs to, contact being one of six folders."""
    parts = module.split(".")[1:]
    depth = 2 if parts[:1] == ["contact"] and len(parts) > 1 else 1
    return ".".join(parts[:depth])


def test_docstrings_say_something():
    """None begins with words that lean on what is not there, or has fewer than four."""
    riddles, seen = [], 0
    for path in LIBRARY.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                words = (ast.get_docstring(node) or "").partition("\n\n")[0].split()
                seen += bool(words)
                leans = " ".join(words).startswith(("Of ", "Those ", "What it ", "One's "))
                if words and (leans or len(words) < 4):
                    riddles.append(f"{path.name}, {getattr(node, 'name', 'module')}: {words}")
    assert riddles == []
    assert seen > 400


PUBLIC = ("pw_elements", "pw_elements.contact", "pw_elements.meshes")


def test_the_library_has_at_most_62_public_names():
    names = {name for module in PUBLIC for name in import_module(module).__all__}
    assert 30 < len(names) <= 62


def test_every_public_name_has_a_user():
    """In the study, an example or a guide; the reference's list of names is none."""
    users = [ROOT / "README.md", *(ROOT / "examples").glob("*.py"), *(ROOT / "docs").rglob("*.md")]
    users += [p for p in (ROOT / "study").rglob("*.py") if p.name != "reference.py"]
    words = {word for path in users for word in re.findall(r"\w+", path.read_text())}
    names = {name for module in PUBLIC for name in import_module(module).__all__}
    assert names - words == set()


def library_imports():
    """Module and what it takes from where, of each import of the library by itself."""
    for name in modules("pw_elements"):
        tree = ast.parse(source(name).read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("pw_elements"):
                yield name, node.module, [alias.name for alias in node.names]


def test_wings_import_downwards_and_through_faces_only():
    wrong, seen = [], 0
    for name, module, _ in library_imports():
        here, there = wing(name), wing(module)
        if here == there or name in ("pw_elements", "pw_elements.contact"):
            continue
        seen += 1
        if WINGS.index(there) >= WINGS.index(here):
            wrong.append(f"{name} imports upwards: {module}")
        if module != f"pw_elements.{there}":
            wrong.append(f"{name} passes by the face of {there}: {module}")
    assert wrong == []
    assert seen > 100


def test_nothing_of_the_iteration_imports_checks():
    parts = [f".contact.{part}." for part in ("nodes", "system", "iteration")]
    names = [name for name in modules("pw_elements") if any(part in name for part in parts)]
    assert len(names) > 12
    for name in names:
        assert not {other for other in imported(name) if other.startswith("pw_elements.checks")}


def test_the_iteration_asks_for_no_type():
    """Tangents, equilibria and surfaces answer by themselves."""
    asked = []
    parts = ("nodes", "system", "iteration")
    paths = [path for part in parts for path in (LIBRARY / "contact" / part).glob("*.py")]
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "type"):
                asked.append(ast.unparse(node.args[1] if len(node.args) > 1 else node))
    assert asked == []


@pytest.mark.parametrize("method", [GALERKIN, PW])
@pytest.mark.parametrize(("solver", "most"), [(Direct(), 8), (Iterative(), 11)])
def test_an_iteration_enters_few_modules(monkeypatch, method, solver, most):
    """From the second on, but for the places of surfaces, which are asked once more at the end."""
    entered, solves = set(), []
    solve, linearise = LinearIncrement.solve, UndeformedKinematics.linearise
    solve_increment = stepping.solve_increment

    def watch(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(LIBRARY):
            entered.add(str(path.relative_to(LIBRARY)))

    def watched(*arguments):
        solves.append(1)
        if len(solves) > 1:
            sys.setprofile(watch)
        return solve(*arguments)

    def placed(*arguments):
        sys.setprofile(None)
        return linearise(*arguments)

    def iterated(*arguments, **named):
        solves.clear()
        try:
            return solve_increment(*arguments, **named)
        finally:
            sys.setprofile(None)

    monkeypatch.setattr(LinearIncrement, "solve", watched)
    monkeypatch.setattr(UndeformedKinematics, "linearise", placed)
    monkeypatch.setattr(stepping, "solve_increment", iterated)
    block = BlockOnFloor(8, method)
    states = block.solve_contact(
        block.floor_pair(0.3), block.no_supports, block.pull_loads(10.0, 1), solver=solver
    )
    assert max(state.iterations for state in states) > 1
    assert 0 < len(entered) <= most, sorted(entered)


# Calls that replace or delete: on what they may be, in modules other than `files`
DESTRUCTIVE = {"replace", "rename", "renames", "unlink", "remove", "rmdir", "removedirs", "rmtree"}
DESTRUCTIVE |= {"move", "truncate"}
ALLOWED = {
    "study/core/jit.py": {"source.with_suffix('.c.cached').unlink", "source.unlink"},  # DOLFINx's
    "study/core/supervisor.py": {"shutil.rmtree"},  # its temporary folder
    "study/site/__init__.py": {"shutil.rmtree"},  # within the new site
}
ON_PATHS = {"rename", "unlink", "rmdir", "rmtree", "renames", "removedirs", "truncate"}


def test_one_module_replaces_and_deletes():
    """Of both packages and the figures; `os.replace` and its like, and methods of paths."""
    found = {}
    for path in (p for top in ("pw_elements", "study", "figures") for p in (ROOT / top).rglob("*")):
        if path.suffix != ".py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            name, owner = node.func.attr, ast.unparse(node.func.value)
            if name in ON_PATHS or (name in DESTRUCTIVE and owner in ("os", "shutil")):
                found.setdefault(str(path.relative_to(ROOT)), set()).add(f"{owner}.{name}")
    # the study loads the module without the package, so it may import nothing of it
    assert tops(imported("pw_elements.files")) <= {*sys.stdlib_module_names}
    del found["pw_elements/files.py"]
    assert found == ALLOWED


def test_oracle_shares_no_code_with_what_it_judges():
    solver = {"assembly", "contact", "eigen", "elements", "large", "problem", "search"}
    names = [name for name in modules("tests/oracle") if name.split(".")[-1] in solver]
    assert len(names) == len(solver)
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


@pytest.mark.parametrize("module", [*(f"study.{name}" for name in LIGHT), *modules("figures")])
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
