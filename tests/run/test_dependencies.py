"""Rules for the structure of the code, mainly for imports.

Imports follow one direction: figures -> study -> pw_elements -> DOLFINx. The oracle of the tests
imports none of these packages.
"""

import ast
import importlib
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

from pw_elements import Direct, Iterative
from pw_elements.contact.iteration import LinearIncrementEquations
from pw_elements.contact.nodes import SmallStrainKinematics
from pw_elements.contact.steps import stepping
from study.run.sources import collect_imported_sources, find_source_file, list_imported_modules
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, BlockOnFloor

ROOT = Path(__file__).parents[2]
LIBRARY_FOLDER = ROOT / "pw_elements"
# packages and modules of the library
PACKAGES_FROM_LOWEST_TO_HIGHEST = [
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
    "user_element",
    "contact.model",
    "contact.interface",
    "contact.nodes",
    "contact.system",
    "contact.iteration",
    "contact.rescue",
    "contact.output",
    "contact.steps",
    "conduction",
]
SOLVER_PACKAGES = {"dolfinx", "basix", "ufl", "ffcx", "petsc4py", "slepc4py", "mpi4py", "gmsh"}
SOLVER_PACKAGES |= {"pw_elements"}
MODULES_WITHOUT_SOLVER = [
    "study.run.store",
    "study.run.folder",
    "study.judge.claims",
    "study.judge.measures",
    "study.publish.report",
    "study.paper.items",
]


def list_module_names(package):
    """Return the sorted dotted names of all modules of a package."""
    paths = [path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py")]
    return sorted(".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in paths)


def get_top_level_packages(names):
    """Return the set of top-level packages in the given dotted names."""
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("pw_elements", {"study", "figures", "tests"}),
        ("study", {"figures", "tests"}),
        ("figures", {"tests"} | SOLVER_PACKAGES),
    ],
)
def test_a_package_imports_nothing_from_higher_packages(package, forbidden):
    names = list_module_names(package)
    assert len(names) > 2
    assert [
        name for name in names if get_top_level_packages(list_imported_modules(name)) & forbidden
    ] == []


def test_no_string_names_a_module_of_a_higher_package():
    """No string of the library or the study, for example a worker's task, names such a module."""
    module_pattern = re.compile(r"(figures|tests)(\.\w+)+(:\w+)?")
    named = {
        (str(path.relative_to(ROOT)), node.value)
        for package in ("pw_elements", "study")
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if module_pattern.fullmatch(node.value)
    }
    assert named == set()
    assert module_pattern.fullmatch("figures.drawing:update_figure")


def test_strings_that_name_functions_of_modules_can_be_resolved():
    """Worker processes import tasks by strings "module:function", which no other check reads."""
    function_pattern = re.compile(r"((?:study|figures)(?:\.\w+)+):(\w+)")
    named_functions = {
        match.groups()
        for package in ("study", "figures")
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if (match := function_pattern.fullmatch(node.value))
    }
    assert len(named_functions) >= 4
    for module, function in named_functions:
        assert callable(getattr(importlib.import_module(module), function)), (module, function)


def test_imports_in_scripts_of_the_gate_can_be_resolved():
    """Python code within shell scripts is read by no linter and no renaming tool."""
    scripts = [ROOT / "run", *(path for path in (ROOT / ".ci").iterdir() if path.is_file())]
    import_pattern = re.compile(r"from ((?:pw_elements|study|figures|tests)[\w.]*) import (\w+)")
    imports = {pair for path in scripts for pair in import_pattern.findall(path.read_text())}
    assert len(imports) > 2
    for module, name in imports:
        assert hasattr(importlib.import_module(module), name), (module, name)


def list_module_paths(folder):
    """Return the paths of the modules and packages in a folder, except its `__init__`."""
    return [
        path
        for path in folder.iterdir()
        if (path / "__init__.py").exists() or (path.suffix == ".py" and path.stem != "__init__")
    ]


def test_a_folder_of_the_library_has_at_most_eight_modules():
    folders = [path.parent for path in LIBRARY_FOLDER.rglob("__init__.py")]
    counts = {
        folder.relative_to(LIBRARY_FOLDER): len(list_module_paths(folder)) for folder in folders
    }
    assert counts.pop(Path(".")) <= 15
    assert {folder: n for folder, n in counts.items() if n > 8} == {}
    assert len(counts) > 8


@pytest.mark.parametrize("package", ["pw_elements", "study"])
def test_a_module_has_at_most_700_lines(package):
    paths = list((ROOT / package).rglob("*.py"))
    # the pages of the benchmarks and the files beside them have a limit of characters instead
    paths = [path for path in paths if "benchmarks" not in path.parts]
    lines = {path.relative_to(ROOT): len(path.read_text().splitlines()) for path in paths}
    assert lines
    assert {name: n for name, n in lines.items() if n > 700} == {}


def find_library_package(module_name):
    """Return the name in `PACKAGES_FROM_LOWEST_TO_HIGHEST` of the package of a module.

    The name has two levels for modules in `contact`, and otherwise one.
    """
    parts = module_name.split(".")[1:]
    depth = 2 if parts[:1] == ["contact"] and len(parts) > 1 else 1
    return ".".join(parts[:depth])


def test_docstrings_are_not_vague():
    """No docstring begins with a reference to a missing noun or has fewer than four words."""
    vague_docstrings, n_docstrings = [], 0
    for path in LIBRARY_FOLDER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                words = (ast.get_docstring(node) or "").partition("\n\n")[0].split()
                n_docstrings += bool(words)
                starts_vaguely = " ".join(words).startswith(("Of ", "Those ", "What it ", "One's "))
                if words and (starts_vaguely or len(words) < 4):
                    vague_docstrings.append(
                        f"{path.name}, {getattr(node, 'name', 'module')}: {words}"
                    )
    assert vague_docstrings == []
    assert n_docstrings > 400


PUBLIC_MODULES = ("pw_elements", "pw_elements.contact", "pw_elements.meshes")


def test_the_library_has_at_most_64_public_names():
    names = {name for module in PUBLIC_MODULES for name in import_module(module).__all__}
    assert 30 < len(names) <= 64


def test_every_public_name_has_a_user():
    """Every public name is used by the study, an example or a guide.

    The list of names in the reference does not count as a use.
    """
    users = [ROOT / "README.md", *(ROOT / "examples").glob("*.py"), *(ROOT / "docs").rglob("*.md")]
    users += [p for p in (ROOT / "study").rglob("*.py") if p.name != "reference.py"]
    words = {word for path in users for word in re.findall(r"\w+", path.read_text())}
    names = {name for module in PUBLIC_MODULES for name in import_module(module).__all__}
    assert names - words == set()


def iterate_library_imports():
    """For each import within the library, yield its module, the imported module and the names."""
    for name in list_module_names("pw_elements"):
        tree = ast.parse(find_source_file(name).read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("pw_elements"):
                yield name, node.module, [alias.name for alias in node.names]


def test_packages_import_only_downwards_and_through_their_interfaces():
    wrong, n_imports = [], 0
    for name, module, _ in iterate_library_imports():
        package, imported_package = find_library_package(name), find_library_package(module)
        if package == imported_package or name in ("pw_elements", "pw_elements.contact"):
            continue
        n_imports += 1
        if PACKAGES_FROM_LOWEST_TO_HIGHEST.index(
            imported_package
        ) >= PACKAGES_FROM_LOWEST_TO_HIGHEST.index(package):
            wrong.append(f"{name} imports upwards: {module}")
        if module != f"pw_elements.{imported_package}":
            wrong.append(f"{name} bypasses the interface of {imported_package}: {module}")
    assert wrong == []
    assert n_imports > 100


def test_the_iteration_does_not_import_checks():
    parts = [f".contact.{part}." for part in ("nodes", "system", "iteration")]
    names = [
        name for name in list_module_names("pw_elements") if any(part in name for part in parts)
    ]
    assert len(names) > 12
    for name in names:
        assert not {
            imported_name
            for imported_name in list_imported_modules(name)
            if imported_name.startswith("pw_elements.checks")
        }


def test_the_iteration_contains_no_type_tests():
    """The modules of the iteration contain no type tests.

    Tangents, equilibria and surfaces use polymorphism instead.
    """
    type_tests = []
    parts = ("nodes", "system", "iteration")
    paths = [path for part in parts for path in (LIBRARY_FOLDER / "contact" / part).glob("*.py")]
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "type"):
                type_tests.append(ast.unparse(node.args[1] if len(node.args) > 1 else node))
    assert type_tests == []


@pytest.mark.parametrize("method", [GALERKIN, PETROV_GALERKIN])
@pytest.mark.parametrize(("solver", "max_modules"), [(Direct(), 8), (Iterative(), 13)])
def test_an_iteration_enters_few_modules(monkeypatch, method, solver, max_modules):
    """One iteration calls functions of only a few modules.

    Modules are counted from the second iteration on. The final linearisation for free surfaces and
    the reports of progress, which only observe the iteration, do not count.
    """
    entered, solves = set(), []
    solve, linearise = (
        LinearIncrementEquations.solve_linearised_system,
        SmallStrainKinematics.linearise,
    )
    solve_increment = stepping.solve_increment

    def record_module(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(LIBRARY_FOLDER):
            entered.add(str(path.relative_to(LIBRARY_FOLDER)))

    def solve_with_profile(*arguments):
        solves.append(1)
        if len(solves) > 1:
            sys.setprofile(record_module)
        return solve(*arguments)

    def linearise_without_profile(*arguments):
        sys.setprofile(None)
        return linearise(*arguments)

    def solve_increment_without_profile(*arguments, **named):
        solves.clear()
        try:
            return solve_increment(*arguments, **named)
        finally:
            sys.setprofile(None)

    monkeypatch.setattr(LinearIncrementEquations, "solve_linearised_system", solve_with_profile)
    monkeypatch.setattr(SmallStrainKinematics, "linearise", linearise_without_profile)
    monkeypatch.setattr(stepping, "solve_increment", solve_increment_without_profile)
    block = BlockOnFloor(8, method)
    states = block.solve_contact(
        block.floor_pair(0.3),
        block.no_supports,
        block.press_then_pull_loads(10.0, 1),
        solver=solver,
    )
    assert max(state.iterations for state in states) > 1
    entered.discard("contact/output/progress.py")
    assert 0 < len(entered) <= max_modules, "\n".join(sorted(entered))


# Calls that replace or delete files, and their allowed owners in modules other than `files`
DESTRUCTIVE_CALLS = {"replace", "rename", "renames", "unlink", "remove", "rmdir", "removedirs"}
DESTRUCTIVE_CALLS |= {"rmtree", "move", "truncate"}
ALLOWED_DESTRUCTIVE_CALLS = {
    # files that DOLFINx has written
    "study/run/jit.py": {"source.with_suffix('.c.cached').unlink", "source.unlink"},
    "study/run/supervisor.py": {"shutil.rmtree"},  # its temporary folder
    "study/publish/site/__init__.py": {"shutil.rmtree"},  # inside the new site
}
DESTRUCTIVE_PATH_METHODS = {"rename", "unlink", "rmdir", "rmtree", "renames", "removedirs"}
DESTRUCTIVE_PATH_METHODS |= {"truncate"}


def test_only_one_module_replaces_and_deletes_files():
    """Only one module replaces or deletes files, by `os.replace`, similar calls or path methods.

    The library, the study and the figures are searched.
    """
    calls = {}
    for path in (p for top in ("pw_elements", "study", "figures") for p in (ROOT / top).rglob("*")):
        if path.suffix != ".py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            name, owner = node.func.attr, ast.unparse(node.func.value)
            if name in DESTRUCTIVE_PATH_METHODS or (
                name in DESTRUCTIVE_CALLS and owner in ("os", "shutil")
            ):
                calls.setdefault(str(path.relative_to(ROOT)), set()).add(f"{owner}.{name}")
    # the study loads this module without its package, so it may not import from the package
    assert get_top_level_packages(list_imported_modules("pw_elements.files")) <= {
        *sys.stdlib_module_names
    }
    del calls["pw_elements/files.py"]
    assert calls == ALLOWED_DESTRUCTIVE_CALLS


def test_the_oracle_shares_no_code_with_the_library():
    oracle_modules = {"assembly", "contact", "eigen", "elements", "large", "problem", "search"}
    oracle_modules |= {"sliding", "sliding_in_space", "tools"}
    names = [
        name for name in list_module_names("tests/oracle") if name.split(".")[-1] in oracle_modules
    ]
    assert len(names) == len(oracle_modules)
    for name in names:
        other_imports = {
            imported_name
            for imported_name in list_imported_modules(name)
            if not imported_name.startswith("tests.oracle")
        }
        assert get_top_level_packages(other_imports) <= {
            "numpy",
            "scipy",
            *sys.stdlib_module_names,
        }, name


def find_reachable_modules(module):
    """Return all modules of the project that a module imports, directly or indirectly."""
    reachable, waiting = set(), [module]
    while waiting:
        for name in collect_imported_sources(waiting.pop()):
            if name not in reachable:
                reachable.add(name)
                waiting += [
                    imported_name
                    for imported_name in list_imported_modules(name)
                    if get_top_level_packages([imported_name]) <= {"study", "figures"}
                ]
    return reachable


@pytest.mark.parametrize(
    "module",
    sorted({*MODULES_WITHOUT_SOLVER, *list_module_names("figures")} - {"figures.run_study"}),
)
def test_modules_that_only_read_results_import_no_solver(module):
    reachable_modules = find_reachable_modules(module)
    assert module in reachable_modules
    for name in reachable_modules:
        assert not get_top_level_packages(list_imported_modules(name)) & SOLVER_PACKAGES, name


def test_the_core_of_the_study_imports_no_mechanics():
    core = [name for name in list_module_names("study") if name.startswith("study.run.")]
    assert len(core) > 4
    for name in core:
        project_imports = {
            imported_name
            for imported_name in list_imported_modules(name)
            if imported_name.startswith(("study.", "pw_elements"))
        }
        assert all(imported_name.startswith("study.run") for imported_name in project_imports), name


def test_the_judge_imports_no_solver():
    for name in list_module_names("study"):
        if name.startswith(("study.judge", "study.publish.report", "study.publish.texts")):
            assert not get_top_level_packages(list_imported_modules(name)) & SOLVER_PACKAGES, name
