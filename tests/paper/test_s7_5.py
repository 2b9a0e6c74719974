"""Section 7.5: a column of changing cross-section between rigid surfaces (Figs 15 to 23, Table 1).

Printed: E = 2.1e8, Poisson's ratio 0.3, friction 0.3, density 7856, a descent of 1 mm, 759 8-node
elements, and Table 1. The section is lost; the study's own stands in for it, here in a coarse mesh.
"""

from unittest.mock import patch

import numpy as np
import pytest

from study.paper import s7_5_column, s7_5_profiles
from tests.oracle.contact import NodesAndSurface, solve_increments
from tests.oracle.eigen import eigenvalues_nearest_to_shift
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
COARSE_PROFILE = s7_5_profiles.Profile(RADII, HEIGHTS, (2, 1, 2, 1), (4, 3, 3, 2))


def stepped_column_comparison(element):
    """Pressed down by 1 mm on its three supports; its vibration when it stands on its base."""
    with (
        patch.dict(s7_5_column.PROFILES, coarse=COARSE_PROFILE),
        patch_library_quadrature_degree(element),
    ):
        result = s7_5_column.stepped_column(element, section="coarse")
    face_heights = np.concatenate([[0.0], np.cumsum(HEIGHTS)])
    faces = [
        (0.0, RADII[0], face_heights[0], NORMAL_UP, 0.0),
        (RADII[0], RADII[1], face_heights[1], NORMAL_UP, 1e-4),
        (RADII[1], RADII[2], face_heights[2], NORMAL_UP, 2e-4),
        (0.0, RADII[3], face_heights[4], NORMAL_DOWN, 0.0),
    ]
    n_gauss_points = oracle_points_per_direction(element)

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(
            result,
            element,
            linear_weights,
            "axisymmetric",
            2.1e8,
            0.3,
            rho=7856.0,
            n_gauss=n_gauss_points,
        )
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
def test_oracle_finds_the_numbers_of_the_study(element):
    assert_agrees_with_own_weights_alone(stepped_column_comparison(element), element)
