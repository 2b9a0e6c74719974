"""Test orders and sizes of the errors of section C for manufactured solutions on coarse meshes.

Orders of eigenvalues and errors of nearly incompressible bodies are tested in `test_checks`.
"""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.special import j1

from pw_elements._compat import cell_geometry_nodes
from study.benchmarks.c_convergence import eigenvalues
from study.benchmarks.c_convergence.statics import SETTINGS, solve_and_compute_relative_errors
from study.meshes.mesh_families import (
    fit_convergence_order,
    mean_cell_size,
    on_cube,
    on_hollow_ball,
    on_ring,
)


def measure_orders_and_finest_errors(element, setting, *cell_sides):
    errors_by_mesh = [
        solve_and_compute_relative_errors(element, SETTINGS[setting], side) for side in cell_sides
    ]
    h = np.array([errors["h"] for errors in errors_by_mesh])
    error_names = [name for name in errors_by_mesh[0] if name.startswith("error_")]
    return {
        name: fit_convergence_order(h, np.array([row[name] for row in errors_by_mesh]))
        for name in error_names
    }, errors_by_mesh[-1]


@pytest.mark.parametrize(
    ("element", "setting"),
    [
        *[(element, "plane-stress") for element in ("galerkin-T6", "pw-T6", "galerkin-Q8")],
        *[(element, "axisymmetric") for element in ("pw-T6", "pw-Q8")],
        *[(element, "curved-ring") for element in ("galerkin-T6", "pw-T6", "pw-Q9")],
    ],
)
def test_quadratic_plane_elements_have_order_two_in_h1_and_three_in_l2(element, setting):
    orders, finest_errors = measure_orders_and_finest_errors(element, setting, 1 / 4, 1 / 8, 1 / 16)
    assert orders["error_H1"] == pytest.approx(2, abs=0.2)
    assert orders["error_L2"] == pytest.approx(3, abs=0.3)
    assert orders["error_stress"] == pytest.approx(2, abs=0.25)
    assert orders["error_force"] > 1.7
    h1_bound = 1e-2 if setting == "curved-ring" else 1e-3
    assert finest_errors["error_H1"] < h1_bound
    assert finest_errors["error_L2"] < 0.03 * h1_bound
    assert finest_errors["error_force"] < 6 * h1_bound


def test_tetrahedra_have_order_two_in_h1_and_three_in_l2():
    orders, finest_errors = measure_orders_and_finest_errors("pw-T10", "solid", 1 / 2, 1 / 4, 1 / 7)
    assert orders["error_H1"] == pytest.approx(2, abs=0.3)
    assert orders["error_L2"] == pytest.approx(3, abs=0.4)
    assert finest_errors["error_H1"] < 1e-2
    assert finest_errors["error_force"] < 1e-2


def test_all_errors_of_a_linear_field_are_round_off_for_every_plane_element():
    def linear_field(_, x, __):
        return 0.3 * x[0] + x[1], 0.2 * x[1] - x[0]

    linear_setting = replace(SETTINGS["plane-strain"], field=linear_field)
    for element in ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9"):
        errors = solve_and_compute_relative_errors(element, linear_setting, 1 / 4)
        assert max(errors[name] for name in errors if name.startswith("error_")) < 1e-11


def test_gmsh_meshes_are_reproducible_and_follow_curved_outlines():
    first, second = on_ring("pw-T6", 1 / 4), on_ring("pw-T6", 1 / 4)
    assert np.array_equal(first.geometry.x, second.geometry.x)
    assert np.array_equal(cell_geometry_nodes(first), cell_geometry_nodes(second))
    for mesh, expected_volume, tolerance in (
        (first, np.pi / 4 * 3, 1e-5),
        (on_hollow_ball("pw-T10", 0.5), np.pi / 6 * 7, 1e-3),
        (on_cube("pw-T10", 0.5), 1.0, 1e-12),
    ):
        dimension = mesh.topology.dim
        volume = mean_cell_size(mesh) ** dimension * mesh.topology.index_map(dimension).size_global
        assert volume == pytest.approx(expected_volume, rel=tolerance)
    radius = np.hypot(*first.geometry.x[:, :2].T)
    outline_length = fem.assemble_scalar(fem.form(1 * ufl.ds(domain=first)))
    assert outline_length == pytest.approx(1.5 * np.pi + 2, rel=1e-4)
    assert radius.min() == pytest.approx(1, abs=1e-12)


def test_order_is_the_slope_through_the_finest_three_meshes():
    h = np.array([1.0, 0.5, 0.25, 0.125])
    assert fit_convergence_order(h, np.array([100.0, 0.25, 0.0625, 0.015625])) == pytest.approx(2)


def test_exact_eigenvalues_of_square_cube_cylinder_and_ring_match_formulas():
    square = eigenvalues.exact_eigenvalues_of_walled_square()
    cube = eigenvalues.exact_eigenvalues_of_walled_cube()
    cylinder = eigenvalues.exact_eigenvalues_of_walled_cylinder()
    shear = 1 / 2.6
    assert square[0] == pytest.approx(2 * np.pi**2 * shear)
    assert cube[:3] == pytest.approx(2 * np.pi**2 * shear)
    assert cube[3] == pytest.approx(3 * np.pi**2 * shear)
    assert abs(j1(np.sqrt(cylinder[0] / shear - np.pi**2))) < 1e-12
    (breathing,) = eigenvalues.exact_breathing_eigenvalue_of_ring()
    assert breathing == pytest.approx(1 / 1.5**2, rel=0.1)  # of a thin ring: E / (rho R^2)
