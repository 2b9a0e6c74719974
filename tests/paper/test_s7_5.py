"""Test the column of section 7.5 between rigid surfaces (Figs 15 to 23, Table 1).

The paper gives E = 2.1e8, Poisson's ratio 0.3, a friction coefficient of 0.3, a density of 7856, a
descent of 1 mm, 759 8-node elements, and Table 1. Fig. 15, the drawing of the column, is lost. The
comparison with the oracle therefore uses a column whose dimensions the study has fitted to Table 1,
with a coarse mesh.
"""

from unittest.mock import patch

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from study.judge.claims import load_claims
from study.judge.measures.column import eigenvalue_shift
from study.model.discretisation import mesh_nodes_and_cells
from study.paper import s7_5_model, s7_5_profiles
from study.paper.items import TABLE_1
from study.paper.table_1.columns import Shape, Supports, Topology
from study.paper.table_1.ensemble import COARSE_TOPOLOGY, SUPPORTS, page_lengths, read_columns
from study.paper.table_1.family import (
    RECORD_TOLERANCE,
    TREATMENTS,
    UNIT,
    Treatment,
    UserElements,
    condensation,
    read_shifts,
)
from study.paper.table_1.inverse import (
    MIN_COLUMNS,
    MIN_ODDS,
    TreatmentShiftBands,
    compare_row_with_shift_bands,
    printed_shifts_and_rounding,
)
from study.run import records
from study.run.store import Result
from tests.oracle.contact import NodesAndSurface, solve_increments
from tests.oracle.eigen import eigenvalues_nearest_to_shift, guyan_reduction
from tests.oracle.problem import (
    ELEMENT_NAMES_IN_STATICS,
    NORMAL_DOWN,
    NORMAL_UP,
    StudyComparison,
    assert_agrees_with_own_weights_alone,
    combine_markers_by_and,
    condensed_stiffness_mass_and_mask,
    make_oracle_body,
    make_plane_row_marker,
    marked_nodes_sorted_by_x,
    plane_gap_and_normal_functions,
)
from tests.oracle.test_sections import oracle_points_per_direction, patch_library_quadrature_degree

# The first of the study's columns, its radii and heights from the base, in a coarser mesh
RADII, HEIGHTS = (0.04787, 0.11121, 0.14669, 0.04126), (0.23155, 0.14025, 0.18777, 0.03384)
COARSE_PROFILE = s7_5_profiles.ColumnProfile(RADII, HEIGHTS, (2, 1, 2, 1), (4, 3, 3, 2))


def make_oracle_column(result, element, linear_weights):
    """Return the oracle's axisymmetric body with the printed material on the nodes of a result."""
    n_gauss_points = oracle_points_per_direction(element)
    return make_oracle_body(
        result,
        element,
        linear_weights,
        "axisymmetric",
        2.1e8,
        0.3,
        rho=7856.0,
        n_gauss=n_gauss_points,
    )


def make_stepped_column_comparison(element):
    """Return the comparison for contact and vibration of the stepped column in a coarse mesh.

    The column is pressed down by 1 mm on its three supports. It vibrates standing on its base.
    """
    with (
        patch.dict(s7_5_model.PROFILES, coarse=COARSE_PROFILE),
        patch_library_quadrature_degree(element),
    ):
        result = s7_5_model.stepped_column(element, section="coarse")
    face_heights = np.concatenate([[0.0], np.cumsum(HEIGHTS)])
    faces = [
        (0.0, RADII[0], face_heights[0], NORMAL_UP, 0.0),
        (RADII[0], RADII[1], face_heights[1], NORMAL_UP, 1e-4),
        (RADII[1], RADII[2], face_heights[2], NORMAL_UP, 2e-4),
        (0.0, RADII[3], face_heights[4], NORMAL_DOWN, 0.0),
    ]

    def solve_by_oracle(linear_weights):
        body = make_oracle_column(result, element, linear_weights)
        K, on_axis = body.stiffness(), body.component_mask(make_plane_row_marker(0, 0.0), (0,))
        descent = [((0.0, -1e-4 * k), (0.0, 0.0)) for k in range(1, 11)]
        pairs = []
        for inner, outer, z, normal, gap in faces:
            on_face = combine_markers_by_and(
                make_plane_row_marker(1, z),
                lambda x, inner_radius=inner, outer_radius=outer: (
                    (x[:, 0] > inner_radius - 1e-9) & (x[:, 0] < outer_radius + 1e-9)
                ),
            )
            motions = descent if normal is NORMAL_DOWN else ()
            nodes = marked_nodes_sorted_by_x(result.curves, on_face)
            pairs.append(
                NodesAndSurface(
                    nodes, *plane_gap_and_normal_functions(normal, z - gap), 0.3, motions
                )
            )
        loads = [np.zeros(body.nodes.size)] * 10
        state = solve_increments(K, loads, on_axis, pairs, body.nodes)[-1]
        oracle_values = {"displacement": state.displacement}
        for k, (face, force) in enumerate(zip(faces, state.forces, strict=True), 1):
            oracle_values[f"force_n_{k}"], oracle_values[f"force_t_{k}"] = (
                force @ face[3],
                -force[:, 0],
            )
            oracle_values[f"force_normal_{k}"] = oracle_values[f"force_n_{k}"].sum()
        held_components = on_axis | body.component_mask(make_plane_row_marker(1, 0.0), (1,))
        K, M, held_components = condensed_stiffness_mass_and_mask(body, element, held_components)
        oracle_values["omega2"] = eigenvalues_nearest_to_shift(K, M, held_components, 6).real
        return oracle_values

    scalars, curves = result.scalars, result.curves
    study_values = {"omega2": np.array([scalars[f"omega2_{i}"] for i in range(1, 7)])}
    study_values["displacement"] = curves["displacement"]
    for k in range(1, 5):
        study_values |= {
            f"force_{component}_{k}": curves[f"force_{component}_{k}"] for component in "nt"
        }
        study_values[f"force_normal_{k}"] = scalars[f"force_normal_{k}"]
    scales = {f"force_t_{k}": study_values[f"force_n_{k}"].max() for k in range(1, 5)}
    return StudyComparison(study_values, solve_by_oracle, scales)


@pytest.mark.parametrize("element", ELEMENT_NAMES_IN_STATICS)
def test_oracle_agrees_with_the_studys_column_with_own_weights_only(element):
    assert_agrees_with_own_weights_alone(make_stepped_column_comparison(element), element)


# Table 1 as a blind test

FITTED_COLUMNS = list(read_columns().values())
RECORDED_SHIFTS = [row.content for row in records.read_rows(records.TABLE_1_SHIFTS).values()]
NUMBERS_OF_RECOMPUTED_COLUMNS = (0, len(RECORDED_SHIFTS) - 1)
FIRST_COLUMN_MESH_TOPOLOGY = Topology((5, 1, 7, 4), (26, 17, 21, 5), "right")
FAMILY_TREATMENTS_BY_CASE = {
    "pw-T6": ("six", Treatment(0, "new")),
    "pwsym-T6": ("six", Treatment(0, "new", "yes")),
    "pw-T6-lumped": ("six", Treatment(0, "lumped")),
    "pwsym-T6-lumped": ("six", Treatment(0, "lumped", "yes")),
    "pw-T6-mass": ("six", Treatment(0, "standard")),
    "pw-T6-onepoint": ("six", Treatment(1, "new")),
    "pwsym-T6-onepoint": ("six", Treatment(1, "new", "yes")),
    "pw-Q8": ("eight", Treatment(0, "new", "no", "transposed")),
    "pw-Q8-same": ("eight", Treatment(0, "new", "no", "same")),
    "pw-Q8-lumped": ("eight", Treatment(0, "lumped", "no", "transposed")),
    "pw-Q8-same-lumped": ("eight", Treatment(0, "lumped", "no", "same")),
    "pw-Q8-mass": ("eight", Treatment(0, "standard", "no", "transposed")),
    "pwsym-Q8": ("eight", Treatment(0, "new", "yes", "transposed")),
    "pwsym-Q8-same": ("eight", Treatment(0, "new", "yes", "same")),
    "pwsym-Q8-lumped": ("eight", Treatment(0, "lumped", "yes", "transposed")),
}


@pytest.fixture(scope="module")
def family_shifts_of_first_column():
    """Return the eigenvalue shifts that `UserElements` computes for the study's first column."""
    shape = Shape(page_lengths("first"))
    return UserElements(FIRST_COLUMN_MESH_TOPOLOGY).compute_shifts(
        shape, Supports((1,), tangential=False)
    )


@pytest.mark.xdist_group("family_shifts_of_first_column")  # computed by one worker
@pytest.mark.parametrize("case", FAMILY_TREATMENTS_BY_CASE)
def test_shifts_of_page_cases_agree_with_treatments_of_the_family(
    case, family_shifts_of_first_column, results
):
    """Shifts computed for the family of columns agree with those of the cases of section 7.5.

    The cases use another eigenvalue solver and another implementation of condensation, and the
    oracle verifies both.
    """
    name, treatment = FAMILY_TREATMENTS_BY_CASE[case]
    standard_element = {"six": "galerkin-T6", "eight": "galerkin-Q8"}[name]
    page_values = [eigenvalue_shift(results, case, standard_element, mode) for mode in range(1, 7)]
    values = getattr(family_shifts_of_first_column, name)[TREATMENTS[name].index(treatment)]
    assert values == pytest.approx(page_values, abs=1e-7)


def coarse_shifts_and_oracle_matrices():
    """Return shifts and oracle matrices of a coarse column with fillets, supported at both ends.

    The result has the shifts by `UserElements`, the nodes (n, 2), and a dictionary from the
    standard and the new triangle to the oracle's stiffness and mass matrices.
    """
    with patch_library_quadrature_degree("galerkin-T6"):
        elements = UserElements(COARSE_TOPOLOGY)
    shape = Shape(page_lengths("second"), grading=3.0, fillet=0.4)
    shifts = elements.compute_shifts(shape, Supports((1, 4), tangential=True))
    space = elements.triangle.spaces.trial
    curves = mesh_nodes_and_cells(space)
    oracle_matrices = {}
    for element, linear_weights in (("galerkin-T6", False), ("pw-T6", True)):
        body = make_oracle_column(Result({}, {}, curves), element, linear_weights)
        oracle_matrices[element] = body.stiffness(), body.mass()
    return shifts, curves["nodes"], oracle_matrices


def test_shifts_agree_with_dense_eigenvalues_of_oracle_matrices():
    """Shifts agree with those of eigenvalues that LAPACK computes from the oracle's matrices.

    Unlike in the other tests, the column has fillets and is supported at both ends.
    """
    shifts, nodes, matrices = coarse_shifts_and_oracle_matrices()
    height = sum(page_lengths("second")[4:])
    is_held = np.zeros((len(nodes), 2), dtype=bool)
    is_held[np.isclose(nodes[:, 0], 0.0), 0] = True
    is_held[np.isclose(nodes[:, 1], 0.0) | np.isclose(nodes[:, 1], height)] = True
    free = np.flatnonzero(~is_held.ravel())

    def compute_lowest_eigenvalues(K, M):
        """Return the reciprocals of the largest eigenvalues of the dense matrix inv(K) M.

        The QZ algorithm for the pair of matrices takes several times as long.
        """
        K, M = (matrix.toarray()[np.ix_(free, free)] for matrix in (K, M))
        reciprocals = scipy.linalg.eigvals(scipy.linalg.solve(K, M)).real
        return 1 / np.sort(reciprocals)[::-1][:6]

    (K, M), (K_new, M_new) = matrices["galerkin-T6"], matrices["pw-T6"]
    standard = compute_lowest_eigenvalues(K, M)
    assert shifts.standard[0] == pytest.approx(standard, rel=1e-8)
    for treatment, values in (
        (Treatment(0, "standard"), compute_lowest_eigenvalues(K_new, M)),
        (Treatment(0, "standard", "yes"), compute_lowest_eigenvalues((K_new + K_new.T) / 2, M)),
        (Treatment(0, "new"), compute_lowest_eigenvalues(K_new, M_new)),
    ):
        row = shifts.six[TREATMENTS["six"].index(treatment)]
        assert row == pytest.approx(100 * (values / standard - 1), abs=1e-6)


@pytest.mark.parametrize("column_number", NUMBERS_OF_RECOMPUTED_COLUMNS)
def test_recomputed_shifts_agree_with_their_record(column_number):
    supports, topology, shape = FITTED_COLUMNS[column_number]
    shifts = UserElements(topology).compute_shifts(shape, supports)
    for name in TREATMENTS:
        recorded = read_shifts(name)[column_number]
        tolerance = RECORD_TOLERANCE * UNIT
        np.testing.assert_allclose(getattr(shifts, name), recorded, rtol=0, atol=tolerance)
    assert shifts.standard == pytest.approx(
        np.array(RECORDED_SHIFTS[column_number]["standard"]), rel=1e-8
    )


def test_recorded_columns_fit_table_1_to_0_02_percent_with_759_cells():
    for row in RECORDED_SHIFTS:
        printed = np.array([TABLE_1["CAX6"], TABLE_1["CAX8"]])
        assert np.abs(100 * (np.array(row["standard"]) / printed - 1)).max() <= 0.02
    topologies = {topology for _, topology, _ in FITTED_COLUMNS}
    assert all(
        s7_5_profiles.mesh_column(topology.reference, "quadrilateral")
        .topology.index_map(2)
        .size_local
        == 759
        for topology in topologies
    )


def test_condensation_is_guyans_and_transposition_swaps_its_factors():
    random = np.random.default_rng(0)
    K = scipy.sparse.csr_matrix(random.normal(0, 1, (8, 8)) + 8 * np.eye(8))
    inner = np.array([2, 3])
    left, right = condensation(K, inner)
    reduced, _ = guyan_reduction(K, K, np.array([1]))
    np.testing.assert_allclose((left.T @ K @ right).toarray(), reduced, atol=1e-12)
    transposed_left, transposed_right = condensation(K.T.tocsr(), inner)
    np.testing.assert_allclose(left.toarray(), transposed_right.toarray(), atol=1e-12)
    np.testing.assert_allclose(right.toarray(), transposed_left.toarray(), atol=1e-12)


def make_mechanisms_with_bands_about(medians, half_width):
    medians = np.array(medians)
    place = np.zeros((len(medians), 2), dtype=int)
    return TreatmentShiftBands(medians - half_width, medians + half_width, medians, place)


def test_odds_single_out_only_a_mechanism_that_gives_the_printed_shifts():
    printed, rounding = printed_shifts_and_rounding("six")
    scattered_medians = np.random.default_rng(0).normal(0, 0.05, (200, 6))
    row = compare_row_with_shift_bands(
        make_mechanisms_with_bands_about(scattered_medians, 0.002), printed, rounding
    )
    assert row["distance"] > 0
    row = compare_row_with_shift_bands(
        make_mechanisms_with_bands_about([*scattered_medians, printed], 0.002), printed, rounding
    )
    assert row["distance"] == 0
    assert row["odds"] > MIN_ODDS
    assert row["nearest_misfit"] == 0
    assert row["within"] == 1


def test_distance_from_a_band_is_zero_inside_and_the_excess_outside():
    printed, rounding = printed_shifts_and_rounding("six")
    low, high = np.full((1, 6), -np.inf), np.full((1, 6), np.inf)
    high[0, 0] = 0.0  # half of the rows, whatever their scatter; the print lies within
    mechanisms = TreatmentShiftBands(low, high, np.array([printed]), np.zeros((1, 2), dtype=int))
    distances = mechanisms.distances(np.array([printed, -printed]), 0 * rounding)
    assert distances.tolist() == [0.0, pytest.approx(-printed[0])]


def test_table_1_claims_are_explained_only_with_zero_distance_and_sufficient_odds(results):
    """A claim on Table 1 is graded "not explained" unless one mechanism explains its row.

    A mechanism explains the row if all shifts of the row, or those of both rows, lie within its
    bands and its odds are at least 20 to 1.
    """
    grades = {loaded_claim.id: loaded_claim for loaded_claim in load_claims()}
    for row, claim_id in (("six", "75-shift-6-node"), ("eight", "75-shift-8-node")):
        scalars = [
            {name: results.scalar("7.5/blind", f"{key}_{name}") for name in ("odds", "distance")}
            for key in (row, "both")
        ]
        explained = any(s["odds"] >= MIN_ODDS and s["distance"] == 0 for s in scalars)
        assert (grades[claim_id].grade == "not explained") == (not explained)
        chance = results.scalar("7.5/blind", f"{row}_chance")
        assert f"in {100 * chance:.0f} % of draws" in grades[claim_id].grade_why


def test_the_standard_mass_gives_the_signs_of_all_printed_shifts(results):
    for row in TREATMENTS:
        printed, _ = printed_shifts_and_rounding(row)
        medians = [results.scalar("7.5/blind", f"{row}_mass_median_{mode}") for mode in range(1, 7)]
        assert np.array_equal(np.sign(medians), np.sign(printed))


def test_the_page_names_the_nearest_treatments(results):
    """The treatments nearest to the printed shifts are those that the findings of 7.5 describe."""

    def nearest(row, *names):
        return [results.scalar("7.5/blind", f"{row}_nearest_{name}") for name in names]

    assert nearest("six", "mass_1", "symmetrised_1") == [0, 1]  # own mass, symmetrised
    assert nearest("both", "mass_1", "symmetrised_1") == [1, 0]  # standard mass, as derived
    assert nearest("both", "mass_2", "symmetrised_2") == [4, 0]  # that of CAX8
    numbers_of_columns = {
        SUPPORTS[number]: results.scalar("7.5/blind", f"columns_{number}")
        for number in range(len(SUPPORTS))
    }
    assert {supports[:2] for supports, n in numbers_of_columns.items() if n >= MIN_COLUMNS} == {
        ((1,), False),
        ((1,), True),
        ((1, 4), False),
    }
