"""The code of the tutorial runs unchanged; `-m tests.run.test_tutorial` draws its pictures."""

import io
import os
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from pw_elements.contact import OPEN

DOCS_FOLDER = Path(__file__).parents[2] / "docs"
TUTORIAL_PAGE = DOCS_FOLDER / "your-own-problem.md"
ELEMENT_NAMES = ("standard", "piecewise linear")

pytestmark = pytest.mark.xdist_group("tutorial")  # one worker runs the tutorial's program


def extract_python_code(page):
    """Return the Python code blocks of a page, joined to one program."""
    return "\n\n".join(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))


def run_program(code, script_path):
    """Write a program to a file, run it in the folder of the file, and return its variables.

    The result contains the global variables by name, and the program's output as "printed".
    """
    script_path.write_text(code)
    with chdir(script_path.parent), redirect_stdout(io.StringIO()) as printed:
        names = runpy.run_path(str(script_path))
    return names | {"printed": printed.getvalue()}


def run_tutorial(folder, element_size="0.1"):
    """Run the tutorial's script and return its global variables.

    `element_size` is the size of elements in mm.
    """
    code = extract_python_code(TUTORIAL_PAGE)
    assert "\nsize = 0.1 " in code
    code = code.replace("\nsize = 0.1 ", f"\nsize = {element_size} ")
    return run_program(code, folder / "dome.py") | {"folder": folder}


def extract_numbers_without_residuals(text):
    """Return the numbers in the program's output, except residuals at the level of round-off."""
    text = re.sub(r"missed by .*", "", text)
    return [float(word) for word in re.findall(r"-?\d+\.?\d*", text)]


def find_picture_names():
    """Return the file names of the pictures on the tutorial's page."""
    return re.findall(r"!\[[^]]+\]\(([\w.-]+)\)", TUTORIAL_PAGE.read_text())


@pytest.fixture(scope="module")
def tutorial_globals(tmp_path_factory):
    """Run the program of the tutorial, and return its global variables."""
    return run_tutorial(tmp_path_factory.mktemp("dome"))


def test_the_tutorials_form_equals_that_of_the_library(tutorial_globals):
    assert tutorial_globals["difference"] < 1e-14


@pytest.mark.parametrize("method", ELEMENT_NAMES)
def test_forces_equal_the_prescribed_ones_and_are_balanced_by_the_base(tutorial_globals, method):
    F, Q = tutorial_globals["F"], tutorial_globals["Q"]
    contact = tutorial_globals["pushed"][method]
    assert contact.force == pytest.approx([Q, -F], rel=1e-9)
    assert tutorial_globals["pressed"][method].force[1] == pytest.approx(-F, rel=1e-9)
    assert tutorial_globals["worst"] < 1e-9
    if method == "piecewise linear":
        forces = tutorial_globals["outline_force"].x.array.reshape(-1, 2)
        on_base = np.isclose(tutorial_globals["U"].tabulate_dof_coordinates()[:, 1], 0.0)
        assert forces[on_base].sum(axis=0) == pytest.approx([-Q, F], rel=1e-9)
        contact_forces = tutorial_globals["fields"].force.x.array.reshape(-1, 2)
        assert contact_forces[~on_base] == pytest.approx(forces[~on_base], abs=1e-9 * F)


@pytest.mark.parametrize("method", ELEMENT_NAMES)
def test_the_pressure_agrees_with_hertz(tutorial_globals, method):
    contact, a, p0 = (
        tutorial_globals["pressed"][method],
        tutorial_globals["a"],
        tutorial_globals["p0"],
    )
    x = contact.position[:, 0]
    closed = x[contact.status != OPEN]
    assert np.ptp(closed) == pytest.approx(2 * a, abs=tutorial_globals["size"])
    inner = np.abs(x) < 0.8 * a
    error = tutorial_globals["measures"][method][
        "force / own test function [MPa]"
    ] - tutorial_globals["hertz"](x)
    assert np.abs(error[inner]).max() < 0.03 * p0


def test_the_tutorial_writes_its_pictures_and_fields(tutorial_globals):
    assert len(find_picture_names()) == 3
    for name in find_picture_names():
        assert (tutorial_globals["folder"] / name).stat().st_size > 20_000
        assert (DOCS_FOLDER / name).is_file()
    for name in ("dome.bp", "dome-stress.bp"):
        assert any((tutorial_globals["folder"] / name).iterdir())


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
def test_the_tutorial_prints_the_same_numbers_on_two_processes(tmp_path):
    expected = extract_numbers_without_residuals(
        run_tutorial(tmp_path, "0.4")["printed"]
    )  # on a coarser mesh
    command = ["mpirun", "-n", "2", sys.executable, "-m", "mpi4py", "dome.py"]
    environment = os.environ | {"PYTHONPATH": str(DOCS_FOLDER.parent)}
    process = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=1800
    )
    assert process.returncode == 0, process.stderr
    assert len(expected) > 10
    assert extract_numbers_without_residuals(process.stdout) == pytest.approx(expected, rel=1e-6)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        run_tutorial(Path(name))
        for picture in find_picture_names():
            shutil.copy(Path(name) / picture, DOCS_FOLDER)
