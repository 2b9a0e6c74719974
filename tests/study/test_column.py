"""Test meshes, eigenvalues and fitted profiles of the synthetic column of section 7.5."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from dolfinx import fem

from study.judge import measures
from study.paper import s7_5_model, s7_5_profiles
from study.paper.table_1 import fit


@pytest.mark.parametrize("profile", s7_5_profiles.PROFILES.values(), ids=s7_5_profiles.PROFILES)
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_column_mesh_has_the_printed_cell_count_and_the_profiles_area_and_outline(profile, cell):
    mesh = s7_5_profiles.mesh_column(profile, cell)
    assert mesh.topology.index_map(2).size_local == {"quadrilateral": 759, "triangle": 1518}[cell]
    unit_field = fem.Constant(mesh, 1.0)
    area = fem.assemble_scalar(fem.form(unit_field * ufl.dx(domain=mesh)))
    assert area == pytest.approx(np.dot(profile.radii, profile.heights), rel=1e-12)
    # the mesh is conforming: edges that belong to one cell only are as long in total as the outline
    outline = fem.assemble_scalar(fem.form(unit_field * ufl.ds(domain=mesh)))
    radii = np.array([0.0, *profile.radii, 0.0])
    assert outline == pytest.approx(2 * sum(profile.heights) + np.abs(np.diff(radii)).sum())


def test_eigenvalues_of_a_coarse_column_agree_with_an_independent_program():
    # computed with 8-node elements of 12 mm on the profile from which the fit of "first" started
    start_profile = fit.make_profile_from_lengths(fit.STARTS["first"])
    coarse_profile = replace(
        start_profile, ring_divisions=(4, 1, 5, 3), height_divisions=(19, 12, 15, 3)
    )
    independent_eigenvalues = (36398, 1.93064e6, 3.81184e6, 3.97913e6, 5.77631e6, 7.59933e6)
    assert s7_5_model.compute_column_eigenvalues("galerkin-Q8", coarse_profile) == pytest.approx(
        independent_eigenvalues, rel=3e-4
    )


@pytest.mark.parametrize("profile", s7_5_profiles.PROFILES.values(), ids=s7_5_profiles.PROFILES)
def test_column_eigenvalues_deviate_from_table_1_by_less_than_0_3_percent(profile):
    deviations = fit.deviations_from_table_1(profile)
    assert np.abs(deviations).max() < 0.3
    assert np.abs(deviations.mean(axis=0)).max() < 0.1  # each eigenvalue: the fit favours none


@pytest.mark.slow
@pytest.mark.parametrize("name", s7_5_profiles.PROFILES)
def test_stored_profiles_are_those_of_the_fit(name):
    lengths = fit.fit_lengths(fit.STARTS[name])
    stored_profile = s7_5_profiles.PROFILES[name]
    assert lengths == pytest.approx([*stored_profile.radii, *stored_profile.heights], abs=2e-5)


def test_largest_printed_shift_between_elements_is_as_computed_by_hand():
    column_pairs = [["6-node user element", "CAX6"], ["8-node user element", "CAX8"]]
    assert measures.largest_printed_shift(None, column_pairs) == pytest.approx(0.2908, abs=5e-5)
