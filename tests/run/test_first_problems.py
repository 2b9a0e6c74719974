"""Three problems as somebody new solves them by the guide: against statics and other numbers."""

import io
import runpy
from contextlib import chdir, redirect_stdout
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import ufl
from dolfinx import fem

from pw_elements import Reduction, as_function, assemble_matrix, assemble_vector, solve
from pw_elements.contact import OPEN

PROGRAMS = Path(__file__).parent / "first_problems"
LINES = 40  # each has fewer


def run(name, folder):
    """Names of a program, run in a folder."""
    try:
        with chdir(folder), redirect_stdout(io.StringIO()):
            return runpy.run_path(str(PROGRAMS / f"{name}.py"))
    finally:
        plt.close("all")


@pytest.mark.parametrize("path", sorted(PROGRAMS.glob("*.py")), ids=lambda path: path.stem)
def test_programs_are_short(path):
    assert len(path.read_text().splitlines()) < LINES


def test_reactions_and_stress_of_a_plate_with_a_hole(tmp_path):
    names = run("hole", tmp_path)
    held, body, a = names["held"], names["body"], names["a"]
    y, force = held.position[:, 1], held.force
    assert np.all(np.diff(y) > 0)  # in order, to be plotted
    assert np.allclose(force.sum(axis=0), [-100 * 40 * 2, 0], atol=1e-6)
    assert abs(y @ force[:, 0]) < 1e-6 * 8000 * 40  # the load is central

    W = fem.functionspace(body.spaces.mesh, ("Discontinuous Lagrange", 1))
    s, w = ufl.TrialFunction(W), ufl.TestFunction(W)
    along = body.stress(as_function(body.spaces.trial, a))[0, 0]
    mass, moments = assemble_matrix(s * w * ufl.dx), assemble_vector(along * w * ufl.dx)
    stress = solve(mass, moments, Reduction.dirichlet(W, []))
    # Howland 1930: 3.14 times the pull in a strip five diameters wide
    assert abs(stress.max()[1] / 100 - 3.14) < 0.06
    assert (tmp_path / "hole.png").exists()


def test_gasket_from_a_file_below_a_cylinder(tmp_path):
    run("gasket_mesh", tmp_path)
    names = run("gasket", tmp_path)
    pressed, pushed = names["states"][3].pairs[0], names["contact"]
    for contact, force in ((pressed, (None, -80)), (pushed, (16, -80))):
        r_n, r_t = contact.force_normal, np.linalg.norm(contact.force_tangential, axis=1)
        assert np.all(r_n > -1e-9)
        assert np.all(r_t < 0.3 * r_n + 1e-9)
        total = contact.force_vector.sum(axis=0)
        assert all(f is None or abs(t - f) < 1e-6 for t, f in zip(total, force, strict=True))
    # Hertz' half width on fibre alone; the steel below stiffens it
    a = np.sqrt(4 * 80 * 25 * (1 - 0.4**2) / (np.pi * 600))
    x = pressed.position[pressed.status != OPEN, 0]
    assert 0.85 * 2 * a < np.ptp(x) < 2 * a
    moved = np.interp(0, pushed.position[:, 0], pushed.displacement[:, 0])
    assert 0 < moved <= pushed.translation[0] + 1e-9  # it drags the fibre along
    assert (tmp_path / "gasket.png").exists()


def test_bracket_that_only_friction_holds(tmp_path):
    names = run("bracket", tmp_path)
    contact = names["state"].pairs[0]
    (x, y, _), force = contact.position.T, contact.force_vector
    assert np.allclose(force.sum(axis=0), [0, 0, 500 + 700], atol=1e-6)
    assert np.isclose(x @ force[:, 2], 500 * 2.5 + 700 * 22.5)
    assert np.isclose(y @ force[:, 2], 1200 * 10)
    friction = np.linalg.norm(contact.force_tangential, axis=1)
    assert np.all(friction < 0.3 * contact.force_normal + 1e-6)
    assert np.ptp(force[:, 2]) > 0  # most below the leg
    assert {"bracket.png", "ground.png"} <= {path.name for path in tmp_path.iterdir()}
