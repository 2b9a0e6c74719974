"""Section Q: methods against each other, each confirmed by what it does not compute itself."""

from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np
import pytest
import ufl

from study.rivals import q_compare
from study.rivals.problem import RADIUS, NoSolution, line


@cache
def problem():
    return line(4, 0.375)


@cache
def answer(method):
    return q_compare._solved(method, problem(), q_compare.METHODS[method].taken)


def test_each_method_is_one_file_of_forty_lines_at_most():
    for name in q_compare.METHODS:
        module = import_module(f"study.rivals.{name.replace('-', '_').lower()}")
        with open(module.__file__, encoding="utf-8") as file:
            assert len(file.readlines()) <= 40, name


@pytest.mark.parametrize("method", q_compare.METHODS)
def test_pressures_add_up_to_hertz_force(method):
    mesh = answer(method).u.function_space.mesh
    _, pressure = q_compare.sampled(replace(problem(), mesh=mesh), answer(method).pressure)
    force = pressure.mean() * problem().zone
    assert force == pytest.approx(problem().known.force / 2, rel=0.03)


@pytest.mark.parametrize("method", sorted(set(q_compare.METHODS) - {"linear", "pw-T6"}))
def test_equilibrium_nodal_forces_add_up_to_the_same(method):
    one = answer(method)
    nodes = one.u.function_space.tabulate_dof_coordinates().T
    force = problem().forces(one.u, one.tested)[problem().touching(nodes), 1].sum()
    assert force == pytest.approx(problem().known.force / 2, rel=0.02)


def test_the_new_element_has_the_standard_displacements():
    new, standard = (answer(method).u.x.array for method in ("pw-T6", "snes-vi"))
    assert np.abs(new - standard).max() < 1e-13 * np.abs(standard).max()


def test_proximal_galerkin_is_the_mortar_method():
    mortar, proximal = (
        q_compare.sampled(problem(), answer(method).pressure)[1]
        for method in ("mortar-p1", "proximal-p1")
    )
    assert proximal == pytest.approx(mortar, abs=1e-6 * mortar.max())


def test_nitsche_is_useless_at_a_small_parameter_and_better_inside_at_the_right_one():
    method = import_module("study.rivals.nitsche_symmetric")

    def inside(parameter):
        return q_compare.measured(problem(), method.solve(problem(), parameter))[0]

    new = q_compare.measured(problem(), answer("pw-T6"))[0]
    assert inside(10.0)["pressure_l2_inner"] < new["pressure_l2_inner"]
    assert inside(1.0)["pressure_l2_inner"] > 10 * new["pressure_l2_inner"]


def test_errors_of_a_known_pressure_are_known():
    """Hertz' pressure and a tenth more: .1 everywhere; half of it: .5."""
    one = answer("snes-vi")
    exact = problem().known.peak * ufl.sqrt(ufl.max_value(0, 1 - problem().distance ** 2))
    for factor, error in ((1.1, 0.1), (0.5, 0.5)):
        found = q_compare.measured(problem(), one._replace(pressure=factor * exact))[0]
        for name in ("pressure_l2", "pressure_l2_inner", "pressure_l2_edge"):
            assert found[name] == pytest.approx(error, abs=1e-12)
        assert found["variation"] == pytest.approx(0.0, abs=1e-12)


def test_the_gap_is_the_parabola_less_its_depth():
    x = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    known = problem().known
    assert problem().gap_at(x) == pytest.approx(x[:, 0] ** 2 / (2 * RADIUS) - known.approach)
    assert known.half_width == pytest.approx(1.0)


def test_what_does_not_converge_is_refused(monkeypatch):
    monkeypatch.setattr("study.rivals.problem.MOST", 1)
    with pytest.raises(NoSolution):
        import_module("study.rivals.penalty").solve(problem(), 10.0)
