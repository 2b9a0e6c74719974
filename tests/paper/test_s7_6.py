"""Test the buckling of the simply supported beam of section 7.6 (Figs 24, 25, Table 2, Eq. (27)).

The paper gives E = 2.07e11, Poisson's ratio 0, a thickness of 0.1 m, Euler's critical stresses and
Table 2, but not the mesh. The study uses 5 x 2 crossed squares, and searches a family of models for
those that reproduce Table 2.
"""

import numpy as np
import pytest

from study.judge.claims import load_claims
from study.paper.items import TABLE_2
from study.paper.s7_6_exact import CompressedStrip
from study.paper.table_2.family import (
    MESHES,
    MODE_1_SET_UPS,
    PASCALS_PER_DIGIT,
    RECORD_TOLERANCE,
    SET_UPS,
    TREATMENTS,
    Mesh,
    MeshModels,
    Treatment,
    read_family,
    read_stresses,
)
from study.paper.table_2.inverse import (
    MIN_ODDS,
    Models,
    compare_row_with_models,
    likelihood_shares,
    remove_duplicate_models,
    simulate_nearest_model_distances,
)
from tests.oracle.eigen import eigenvalues_nearest_to_shift
from tests.oracle.problem import (
    StudyComparison,
    assert_agrees_with_own_weights_alone,
    assert_study_agrees_with_oracle,
    combine_markers_by_and,
    make_oracle_body,
    make_plane_row_marker,
    solve_with_zero_supports,
    symmetric_part,
)

ELEMENTS = ("galerkin-T6", "pw-T6", "pwsym-T6", "galerkin-Q8")
IS_UNIFORM_BY_LOAD_SUFFIX = {"": False, "-uniform-8x2": True}


def make_beam_buckling_comparison(result, element, is_uniform):
    """Return the comparison for the critical stresses of modes 1 and 2 of half of the beam.

    Mode 1 is symmetric, mode 2 antisymmetric. The load is uniform if `is_uniform` is true,
    otherwise a force at the supported point A.
    """

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(
            result, element, linear_weights, "plane stress", 2.07e11, 0.0, thickness=0.1
        )
        on_end, on_middle = make_plane_row_marker(0, 0.0), make_plane_row_marker(0, 4.0)
        at_A, at_centre = (
            combine_markers_by_and(on_end, make_plane_row_marker(1, 0.0)),
            combine_markers_by_and(on_middle, make_plane_row_marker(1, 0.0)),
        )
        symmetrised = element.startswith("pwsym")
        K = symmetric_part(body.stiffness()) if symmetrised else body.stiffness()
        critical_stresses = {}
        for mode in (1, 2):
            held_components = body.component_mask(on_end if is_uniform else at_A, (1,))
            if mode == 1:
                held_components |= body.component_mask(on_middle, (0,))
            else:
                held_components |= body.component_mask(at_centre, (0,))
                held_components |= body.component_mask(on_middle if is_uniform else at_centre, (1,))
            if is_uniform:
                f = body.traction_load(on_end, (1.0, 0.0))
                f += body.traction_load(on_middle, (-1.0, 0.0)) * (mode == 2)
            else:
                f = 0.1 * body.component_mask(at_A, (0,)).ravel()
            K_sigma = body.geometric_stiffness(solve_with_zero_supports(K, f, held_components))
            K_sigma = symmetric_part(K_sigma) if symmetrised else K_sigma
            factors = eigenvalues_nearest_to_shift(K, -K_sigma, held_components, 4).real
            critical_stresses[f"sigma_cr_{mode}"] = factors[factors > 0].min()
        return critical_stresses

    return StudyComparison(
        {name: result.scalars[name] for name in ("sigma_cr_1", "sigma_cr_2")}, solve_by_oracle
    )


@pytest.mark.parametrize("load_suffix", IS_UNIFORM_BY_LOAD_SUFFIX)
@pytest.mark.parametrize("element", ELEMENTS)
def test_oracle_agrees_with_the_studys_critical_stresses(element, load_suffix, results):
    comparison = make_beam_buckling_comparison(
        results[f"7.6/{element}{load_suffix}"], element, IS_UNIFORM_BY_LOAD_SUFFIX[load_suffix]
    )
    (assert_study_agrees_with_oracle if load_suffix else assert_agrees_with_own_weights_alone)(
        comparison, element
    )
    if (
        load_suffix and element == "pw-T6"
    ):  # K_PW = T K and likewise K_sigma: both elements have the same critical stresses
        assert_study_agrees_with_oracle(comparison, "galerkin-T6")


def test_eulers_stress_follows_from_eq_27(results):
    """Eq. (27) with I / A = h**2 / 12 gives Euler's stresses of the study and those of Table 2.

    The slenderness L / h = 8 follows from the printed stresses.
    """
    for mode in (1, 2):
        stress = mode**2 * np.pi**2 * 2.07e11 / 12 / 8**2
        assert results.scalar("7.6/exact", f"euler_{mode}") == pytest.approx(stress, rel=1e-12)
        assert stress == pytest.approx(TABLE_2["Euler"][mode - 1], rel=2e-4)


BEAM_STRIP = CompressedStrip(2.07e11, 0.0, 8.0)

# Values that were published or computed independently of this code
REFERENCE_STRESSES_BY_FORM = {
    "G": (2.549732978e9, 9.099805943e9),
    "J": (2.613156933e9, 9.926530181e9),
    "deflection": (2.580580e9, 9.472353e9),
}


@pytest.mark.parametrize("form", REFERENCE_STRESSES_BY_FORM)
def test_critical_stresses_of_the_beam_agree_with_references(form):
    for n, value in enumerate(REFERENCE_STRESSES_BY_FORM[form], start=1):
        assert BEAM_STRIP.exact_critical_stress(n, form) == pytest.approx(value, rel=5e-7)


@pytest.mark.parametrize("nu", [0.0, 0.2, 0.45])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_determinant_and_rayleigh_lamb_have_the_same_root(n, nu):
    strip = CompressedStrip(3.0, nu, 6.0)
    assert strip.exact_critical_stress(n, "G") == pytest.approx(
        strip.critical_stress_by_rayleigh_lamb(n), rel=1e-10
    )


def test_stresses_of_slender_strips_tend_to_eulers():
    for theory in (
        CompressedStrip.engesser_stress,
        CompressedStrip.haringx_stress,
        lambda strip, n: strip.exact_critical_stress(n, "J"),
    ):
        errors = [
            theory(CompressedStrip(1.0, 0.0, slenderness), 1)
            / CompressedStrip(1.0, 0.0, slenderness).euler_stress(1)
            - 1
            for slenderness in (20, 40)
        ]
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
        assert abs(errors[1]) < 3e-3


def test_haringx_and_engesser_have_the_same_shear_stiffness():
    # both solve 1 / s = 1 / euler + c / (kappa G), Engesser with c = 1, Haringx with c = s / euler
    rigidity = 5 / 6 * BEAM_STRIP.shear_modulus
    for n in (1, 2):
        euler = BEAM_STRIP.euler_stress(n)
        assert 1 / BEAM_STRIP.engesser_stress(n) == pytest.approx(
            1 / euler + 1 / rigidity, rel=1e-13
        )
        s = BEAM_STRIP.haringx_stress(n)
        assert s * (1 + s / rigidity) == pytest.approx(euler, rel=1e-12)
    assert np.isclose(BEAM_STRIP.euler_stress(2), 4 * BEAM_STRIP.euler_stress(1))


# Which models of the family reproduce Table 2?

RECOMPUTED_MODELS = [
    # the mesh of the nearest model, with all treatments and some set-ups of each load
    (Mesh("right", 6, 1), (0, 3), (0, 5, 11)),
    (Mesh("crossed", 3, 2), (1,), (3,)),
]


@pytest.mark.parametrize("element", TREATMENTS)
@pytest.mark.parametrize(("mesh", "mode_1_set_ups", "mode_2_set_ups"), RECOMPUTED_MODELS, ids=str)
def test_recomputed_models_agree_with_their_record(mesh, mode_1_set_ups, mode_2_set_ups, element):
    models = MeshModels(mesh)
    for mode, set_ups in (("mode_1", mode_1_set_ups), ("mode_2", mode_2_set_ups)):
        recorded = read_stresses(mesh, element, mode)
        for i in set_ups:
            if mode == "mode_1":
                stresses = models.mode_1(element, *MODE_1_SET_UPS[i])
            else:
                stresses = models.mode_2(element, SET_UPS[i])
            tolerance = RECORD_TOLERANCE * PASCALS_PER_DIGIT
            np.testing.assert_allclose(stresses, recorded[i], rtol=0, atol=tolerance)


FAMILY_MODELS_BY_CASE = {
    "galerkin-T6": ("standard", Treatment("G", "point", 0)),
    "galerkin-T6-J": ("standard", Treatment("J", "point", 0)),
    "pw-T6": ("new", Treatment("G", "point", 3)),
    "pw-T6-J": ("new", Treatment("J", "point", 3)),
    "pwsym-T6": ("new", Treatment("G", "point", 3, "both")),
    "pwsym-T6-static-unsymmetric": ("new", Treatment("G", "point", 3, "eigenvalue")),
}


@pytest.mark.parametrize("case", FAMILY_MODELS_BY_CASE)
def test_cases_of_the_page_agree_with_recorded_models_of_the_family(case, results):
    """Stored critical stresses of section 7.6 agree with recorded models of the same problems.

    The stored cases use another assembly and another eigenvalue solver, and the oracle verifies
    both.
    """
    element, treatment = FAMILY_MODELS_BY_CASE[case]
    stored_result = results[f"7.6/{case}"]
    assert stored_result.parameters["divisions"] == [5, 2]
    (mesh,) = (i for i, mesh in enumerate(MESHES) if mesh == ("crossed", 5, 2))
    (set_up,) = (
        i
        for i, set_up in enumerate(SET_UPS)
        if set_up == ("point", "centre", "centre", "antisymmetric")
    )
    values = read_family().stresses[element]
    for mode in (1, 2):
        value = values[mesh, set_up, TREATMENTS[element].index(treatment), mode - 1]
        assert value == pytest.approx(
            stored_result.scalars[f"sigma_cr_{mode}"], abs=RECORD_TOLERANCE * PASCALS_PER_DIGIT
        )


def test_under_uniform_stress_both_elements_have_equal_critical_stresses():
    """Under uniform stress, the weight functions do not change the critical stresses.

    The exception is a support at a single mid-side node, because the matrix T moves part of the
    node's force to the adjacent corners. Even then, the stresses agree to a relative 3e-6.
    """
    stresses = read_family().stresses
    uniform_set_ups = [i for i, set_up in enumerate(SET_UPS) if set_up.load == "uniform"]
    supports = np.array([(SET_UPS[i].end, SET_UPS[i].middle) for i in uniform_set_ups])
    is_corner = np.array([mesh.ny % 2 == 0 for mesh in MESHES])
    is_unaffected = is_corner[:, None] | (supports == "face").all(axis=1)
    for form in ("G", "J"):
        standard_stresses, new_stresses = (
            stresses[element][
                :, uniform_set_ups, TREATMENTS[element].index(Treatment(form, "point", n))
            ]
            for element, n in (("standard", 0), ("new", 3))
        )
        tolerance = RECORD_TOLERANCE * PASCALS_PER_DIGIT
        np.testing.assert_allclose(
            standard_stresses[is_unaffected], new_stresses[is_unaffected], rtol=0, atol=tolerance
        )
        np.testing.assert_allclose(standard_stresses, new_stresses, rtol=3e-6)


def _make_scattered_models(count, seed=0):
    deviation = np.random.default_rng(seed).normal(0, 3, (count, 2))
    return Models(deviation, np.zeros((count, 3), dtype=int))


def test_chance_is_the_area_near_few_models_times_their_density():
    """The chance is the probability that a random row is within d of one of the models.

    If the squares of side 2 d about the models do not overlap, the chance is nearly the area of a
    square times the sum of the probability density of random rows at the models. In this test,
    there are five models.
    """
    deviation = [[-3.0, 3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, -3.0], [0.0, 0.0]]
    models = Models(np.array(deviation), None)
    chance = simulate_nearest_model_distances(models)
    scatter = np.sqrt(np.diag(chance.covariance))
    np.testing.assert_allclose(scatter, 3.0)
    density = np.exp(-((models.deviation / scatter) ** 2).sum(axis=1) / 2)
    density /= 2 * np.pi * scatter.prod()
    assert chance.fraction_of_random_rows_within(0.3) == pytest.approx(
        0.6**2 * density.sum(), rel=0.15
    )


def test_odds_single_out_only_a_model_that_gives_the_printed_values():
    rounding, uncertainty = np.array([0.002, 0.002]), np.array([0.5, 0.5])
    scattered_models = _make_scattered_models(500)
    row_values, _ = compare_row_with_models(scattered_models, uncertainty, rounding)
    assert row_values["odds"] < MIN_ODDS
    assert row_values["within_rounding"] == 0
    deviation = np.vstack([scattered_models.deviation, [[0.001, -0.001]]])
    models_with_exact_one = Models(deviation, np.zeros((501, 3), dtype=int))
    row_values, _ = compare_row_with_models(models_with_exact_one, uncertainty, rounding)
    assert row_values["odds"] > MIN_ODDS
    assert row_values["within_rounding"] == 1


def test_likelihood_shares_are_normal_densities_that_sum_to_one():
    models = Models(np.array([[0.0, 0.0], [1.0, 0.0], [100.0, 0.0]]), None)
    shares = likelihood_shares(models, np.array([1.0, 1.0]), np.zeros(2))
    assert shares == pytest.approx(np.array([1, np.exp(-0.5), 0]) / (1 + np.exp(-0.5)))


def test_models_with_the_same_values_count_once():
    models = Models(np.array([[1.0, 2.0], [1.0, 2.0], [3.0, 4.0]]), np.arange(9).reshape(3, 3))
    assert remove_duplicate_models(models).place.tolist() == [[0, 1, 2], [6, 7, 8]]


def test_table_2_claims_are_explained_only_with_sufficient_odds(results):
    """Claims on Table 2 are graded "not explained" if the odds of each model are below 20 to 1."""
    claims = [
        loaded_claim
        for loaded_claim in load_claims()
        if loaded_claim.id.startswith("76-table2-") and loaded_claim.grade
    ]
    assert len(claims) == 4
    for claim in claims:
        row = "cps6" if "galerkin" in claim.id else "user"
        odds = [results.scalar("7.6/inverse", f"{odds_row}_all_odds") for odds_row in (row, "both")]
        assert (claim.grade == "not explained") == (max(odds) < MIN_ODDS)
        chance = results.scalar("7.6/inverse", f"{row}_all_chance")
        assert f"in {100 * chance:.0f} % of draws" in claim.grade_why
