"""Section Q: methods against each other, each confirmed by what it does not compute itself."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import ufl

from study.benchmarks.q_rivals.errors import measure_errors, sample_traction
from study.benchmarks.q_rivals.methods import nitsche, penalty
from study.benchmarks.q_rivals.page import METHODS
from study.solutions.hertz_problem import RADIUS, NoSolution, line


@cache
def problem():
    return line(4, 0.375)


@cache
def answer(method):
    return METHODS[method].solve(problem(), METHODS[method].usual_parameter)


def test_method_is_one_file_of_at_most_forty_lines():
    for name, method in METHODS.items():
        path = Path(method.module.__file__)
        assert name.replace("-", "_").lower().startswith(path.stem)
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 40, name


def test_line_count_of_method_includes_methods_that_it_imports():
    assert METHODS["snes-vi-t"].n_lines > METHODS["snes-vi"].n_lines
    assert METHODS["penalty"].n_lines == len(Path(penalty.__file__).read_text().splitlines())


@pytest.mark.parametrize("method", METHODS)
def test_pressures_add_up_to_hertz_force(method):
    mesh = answer(method).u.function_space.mesh
    _, pressure = sample_traction(replace(problem(), mesh=mesh), answer(method).pressure)
    force = pressure.mean() * problem().zone
    assert force == pytest.approx(problem().exact.force / 2, rel=0.03)


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"linear", "pw-T6"}))
def test_equilibrium_nodal_forces_add_up_to_the_same(method):
    u, test_space = answer(method).u, answer(method).test_space
    nodes = u.function_space.tabulate_dof_coordinates().T
    force = problem().forces(u, test_space)[problem().may_touch(nodes), 1].sum()
    assert force == pytest.approx(problem().exact.force / 2, rel=0.02)


def test_the_new_element_has_the_standard_displacements():
    new, standard = (answer(method).u.x.array for method in ("pw-T6", "snes-vi"))
    assert np.abs(new - standard).max() < 1e-13 * np.abs(standard).max()


def test_proximal_galerkin_is_the_mortar_method():
    mortar, proximal = (
        sample_traction(problem(), answer(method).pressure)[1]
        for method in ("mortar-p1", "proximal-p1")
    )
    assert proximal == pytest.approx(mortar, abs=1e-6 * mortar.max())


def test_nitsche_is_useless_at_a_small_parameter_and_better_inside_at_the_right_one():
    def inside(parameter):
        return measure_errors(problem(), nitsche.solve(problem(), parameter))[0]

    new = measure_errors(problem(), answer("pw-T6"))[0]
    assert inside(10.0)["pressure_l2_inner"] < new["pressure_l2_inner"]
    assert inside(1.0)["pressure_l2_inner"] > 10 * new["pressure_l2_inner"]


def test_errors_of_a_known_pressure_are_known():
    """Hertz' pressure and a tenth more: .1 everywhere; half of it: .5."""
    standard = answer("snes-vi")
    exact = problem().exact.peak * ufl.sqrt(ufl.max_value(0, 1 - problem().distance ** 2))
    for factor, error in ((1.1, 0.1), (0.5, 0.5)):
        errors = measure_errors(problem(), standard._replace(pressure=factor * exact))[0]
        for name in ("pressure_l2", "pressure_l2_inner", "pressure_l2_edge"):
            assert errors[name] == pytest.approx(error, abs=1e-12)
        assert errors["variation"] == pytest.approx(0.0, abs=1e-12)


def test_the_gap_is_the_parabola_less_its_depth():
    x = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    exact = problem().exact
    assert problem().gap_at(x) == pytest.approx(x[:, 0] ** 2 / (2 * RADIUS) - exact.approach)
    assert exact.half_width == pytest.approx(1.0)


def test_what_does_not_converge_is_refused(monkeypatch):
    monkeypatch.setattr("study.solutions.hertz_problem.MAX_SOLVES", 1)
    with pytest.raises(NoSolution):
        penalty.solve(problem(), 10.0)
