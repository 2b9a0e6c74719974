"""Test the contact methods of section Q by comparison with one another and exact solutions."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import ufl

from study.benchmarks.q_rivals.errors import (
    compute_pressure_and_force_errors,
    sample_traction_over_distance,
)
from study.benchmarks.q_rivals.methods import nitsche, penalty
from study.benchmarks.q_rivals.page import METHODS
from study.solutions.hertz_problem import RADIUS, NoSolution, line_contact_problem


@cache
def make_line_contact_problem():
    return line_contact_problem(4, 0.375)


@cache
def solve_with_usual_parameter(method):
    return METHODS[method].solve(make_line_contact_problem(), METHODS[method].usual_parameter)


def test_method_is_one_file_of_at_most_forty_lines():
    for name, method in METHODS.items():
        path = Path(method.module.__file__)
        assert name.replace("-", "_").lower().startswith(path.stem)
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 40, name


def test_line_count_of_method_includes_methods_that_it_imports():
    assert METHODS["snes-vi-t"].n_source_lines > METHODS["snes-vi"].n_source_lines
    assert METHODS["penalty"].n_source_lines == len(Path(penalty.__file__).read_text().splitlines())


@pytest.mark.parametrize("method", METHODS)
def test_pressure_of_each_method_adds_up_to_hertz_force(method):
    mesh = solve_with_usual_parameter(method).u.function_space.mesh
    _, pressure = sample_traction_over_distance(
        replace(make_line_contact_problem(), mesh=mesh), solve_with_usual_parameter(method).pressure
    )
    force = pressure.mean() * make_line_contact_problem().contact_zone_size
    assert force == pytest.approx(make_line_contact_problem().exact.force / 2, rel=0.03)


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"linear", "pw-T6"}))
def test_nodal_forces_of_each_method_add_up_to_hertz_force(method):
    u, test_space = (
        solve_with_usual_parameter(method).u,
        solve_with_usual_parameter(method).test_space,
    )
    nodes = u.function_space.tabulate_dof_coordinates().T
    force = (
        make_line_contact_problem()
        .nodal_forces(u, test_space)[make_line_contact_problem().may_touch(nodes), 1]
        .sum()
    )
    assert force == pytest.approx(make_line_contact_problem().exact.force / 2, rel=0.02)


def test_new_element_has_the_displacements_of_the_standard_one():
    new_displacement, standard_displacement = (
        solve_with_usual_parameter(method).u.x.array for method in ("pw-T6", "snes-vi")
    )
    assert (
        np.abs(new_displacement - standard_displacement).max()
        < 1e-13 * np.abs(standard_displacement).max()
    )


def test_proximal_galerkin_has_the_pressure_of_the_mortar_method():
    mortar_pressure, proximal_pressure = (
        sample_traction_over_distance(
            make_line_contact_problem(), solve_with_usual_parameter(method).pressure
        )[1]
        for method in ("mortar-p1", "proximal-p1")
    )
    assert proximal_pressure == pytest.approx(mortar_pressure, abs=1e-6 * mortar_pressure.max())


def test_symmetric_nitsche_is_accurate_at_its_best_parameter_only():
    def solve_and_measure(parameter):
        return compute_pressure_and_force_errors(
            make_line_contact_problem(), nitsche.solve(make_line_contact_problem(), parameter)
        )[0]

    new_element_errors = compute_pressure_and_force_errors(
        make_line_contact_problem(), solve_with_usual_parameter("pw-T6")
    )[0]
    new_error = new_element_errors["pressure_l2_inner"]
    assert solve_and_measure(10.0)["pressure_l2_inner"] < new_error
    assert solve_and_measure(1.0)["pressure_l2_inner"] > 10 * new_error


def test_errors_of_scaled_exact_pressure_are_the_change_of_scale():
    standard_solution = solve_with_usual_parameter("snes-vi")
    exact_pressure = make_line_contact_problem().exact.peak_pressure * ufl.sqrt(
        ufl.max_value(0, 1 - make_line_contact_problem().distance_from_middle ** 2)
    )
    for factor, error in ((1.1, 0.1), (0.5, 0.5)):
        errors = compute_pressure_and_force_errors(
            make_line_contact_problem(),
            standard_solution._replace(pressure=factor * exact_pressure),
        )[0]
        for name in ("pressure_l2", "pressure_l2_inner", "pressure_l2_edge"):
            assert errors[name] == pytest.approx(error, abs=1e-12)
        assert errors["variation"] == pytest.approx(0.0, abs=1e-12)


def test_gap_is_parabola_height_less_the_approach():
    x = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    exact = make_line_contact_problem().exact
    assert make_line_contact_problem().gap_at(x) == pytest.approx(
        x[:, 0] ** 2 / (2 * RADIUS) - exact.approach
    )
    assert exact.half_width == pytest.approx(1.0)


def test_non_converging_method_raises_the_no_solution_error(monkeypatch):
    monkeypatch.setattr("study.solutions.hertz_problem.MAX_SOLVES", 1)
    with pytest.raises(NoSolution):
        penalty.solve(make_line_contact_problem(), 10.0)
