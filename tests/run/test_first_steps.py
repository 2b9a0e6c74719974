"""The walk of docs/first-steps.md: its benchmark is added to a copy of the project and holds.

Its program is run by test_guide, all other commands by .ci/documented.py.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "first-steps.md").read_text()
(SECTION,) = re.findall(r"^\./run study (V\d+)$", PAGE, re.MULTILINE)
# the checks judge the results that the first test computes
pytestmark = pytest.mark.xdist_group("first_steps")
COPIED_FOLDERS = ("docs", "figures", "pw_elements", "study", "tests")


@pytest.fixture(scope="module")
def copied_project(tmp_path_factory):
    """Copy the project without its results, and add the benchmark as the page says."""
    project = tmp_path_factory.mktemp("copy") / "pw-elements"
    for name in COPIED_FOLDERS:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, project / name, ignore=ignored)
    for name in ("pyproject.toml", "CITATION.cff"):
        shutil.copy(ROOT / name, project)
    (command,) = re.findall(r"^sed .* > study/benchmarks/\S+$", PAGE, re.MULTILINE)
    subprocess.run(command, shell=True, cwd=project, check=True)
    return project


def run_python(project, *arguments):
    """Run Python in the copied project; return the completed process."""
    environment = os.environ | {"PYTHONPATH": str(project), "PW_ELEMENTS_FOLDER": str(project)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True)


def test_the_added_benchmark_is_computed_judged_and_drawn(copied_project):
    process = run_python(copied_project, "-m", "figures.run_study", SECTION, "--jobs", "1")
    assert process.returncode == 0, process.stderr
    assert f"{SECTION}  Ring on a rigid shaft: 3 computed in" in process.stderr
    assert "1 findings: 1 hold, 0 fail" in process.stdout
    assert any((copied_project / "results" / "figures").glob(f"{SECTION.lower()}_error.*"))


def test_checks_of_the_added_benchmark_are_tests(copied_project):
    options = ("-p", "no:cacheprovider", "tests/study/test_checks.py", "-k", SECTION)
    process = run_python(copied_project, "-m", "pytest", *options)
    assert process.returncode == 0, process.stdout
    assert "1 passed" in process.stdout
