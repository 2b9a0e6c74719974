"""The study's own numbers, at the accuracy that the report claims for them."""

import numpy as np
import pytest

from study.paper import s3_weight_functions, s7_1_two_triangles, s7_6_buckling
from study.verification import t_identity


@pytest.mark.parametrize(
    "case",
    [case for case in s7_1_two_triangles.CASES if "squares" not in case.parameters],
    ids=lambda case: case.name,
)
def test_reactions_of_two_triangles(case):
    standard = case.parameters["element"].startswith("galerkin")
    share = [1 / 6, 2 / 3, 1 / 6] if standard else [1 / 4, 1 / 2, 1 / 4]
    scalars = case.run(**case.parameters).scalars
    reactions = [scalars[f"reaction_{i}"] for i in range(3)]
    assert np.abs(np.subtract(reactions, share)).max() < 1e-12


def test_sawtooth_of_a_row():
    for element, ratio in (("galerkin-T6", 2.0), ("pw-T6", 1.0)):
        reactions = s7_1_two_triangles.structure(element, squares=4).curves["reaction"]
        assert reactions[1::2] / reactions[2] == pytest.approx(ratio, abs=1e-12)


@pytest.mark.parametrize("form", ["G", "J"])
def test_uniform_load_meets_the_exact_values_at_order_four(form):
    exact = s7_6_buckling.exact().scalars
    for element in ("galerkin-T6", "pw-T6", "galerkin-Q8"):
        errors = []
        for divisions in ((16, 4), (32, 8)):
            beam = s7_6_buckling.beam(element, form, "uniform", divisions, "right", "face", "face")
            errors.append(
                [beam.scalars[f"sigma_cr_{n}"] / exact[f"{form}_{n}"] - 1 for n in (1, 2)]
            )
            assert beam.scalars["imaginary_1"] == beam.scalars["imaginary_2"] == 0
        orders = np.log2(np.divide(*errors))
        assert np.abs(errors[1]).max() < 5e-4
        assert np.all((orders > 3.8) & (orders < 4.2))


def test_both_elements_agree_on_uniform_prestress():
    models = [("uniform", (8, 2), "crossed", "face", "face")] * 2
    pw, galerkin = (
        s7_6_buckling.beam(element, "G", *model).scalars
        for element, model in zip(("pw-T6", "galerkin-T6"), models, strict=True)
    )
    for n in (1, 2):
        name = f"sigma_cr_{n}"
        assert pw[name] == pytest.approx(galerkin[name], rel=1e-8)


def test_reconstructed_mesh_comes_near_table_2():
    # independent computation of the same models: 2.607e9, 9.757e9 and 2.573e9, 9.110e9
    for element, form, values in (
        ("galerkin-T6", "J", (2.607e9, 9.757e9)),
        ("pwsym-T6", "G", (2.573e9, 9.110e9)),
    ):
        model = (
            "point",
            s7_6_buckling.PAPER_DIVISIONS,
            s7_6_buckling.PAPER_PATTERN,
            "centre",
            "centre",
        )
        scalars = s7_6_buckling.beam(element, form, *model).scalars
        for n, value in enumerate(values, start=1):
            assert scalars[f"sigma_cr_{n}"] == pytest.approx(value, rel=3e-4)


def test_weight_functions_and_element_matrices():
    weights = s3_weight_functions.weight_functions().scalars
    assert max(weights.values()) < 1e-14
    matrices = s3_weight_functions.element_matrices().scalars
    assert matrices["eq23_difference"] < 1e-14
    assert matrices["pw_stiffness_unsymmetry"] > 0.01
    assert matrices["pw_mass_row_vertex"] == pytest.approx(1 / 12, abs=1e-14)


@pytest.mark.parametrize("quantity", t_identity.HOLDS)
def test_identity_holds(quantity):
    assert t_identity.difference(quantity).scalars["difference"] < 1e-13


@pytest.mark.parametrize("quantity", t_identity.FAILS)
def test_identity_fails(quantity):
    assert t_identity.difference(quantity).scalars["difference"] > 1e-3


def test_displacements_coincide_in_plane_statics_only():
    assert t_identity.statics_2d().scalars["displacement_difference"] < 1e-11
    assert t_identity.statics_2d().scalars["reaction_difference"] < 1e-11
    assert t_identity.statics_3d().scalars["displacement_difference"] > 1e-4


def test_the_order_of_vertices_moves_forces_of_the_one_cut_tetrahedron_only():
    for element in ("galerkin-T10", "pw-T10"):
        assert max(t_identity.vertex_order(element).scalars.values()) < 1e-12
    assert min(t_identity.vertex_order("onecut-T10").scalars.values()) > 1e-3


@pytest.mark.slow
def test_point_load_has_no_limit():
    stresses = [
        s7_6_buckling.beam("pw-T6", "G", "point", divisions, "crossed", "centre", "centre").scalars
        for divisions in ((40, 16), (80, 32), (160, 64))
    ]
    second = [s["sigma_cr_2"] for s in stresses]
    assert second[1] < 0.6 * second[0]
    assert second[2] < 0.6 * second[1]
