"""The study's own verification problems V1, V4, V5 and V8, solved independently by the oracle.

The problems of the paper are in `tests/paper`. V2, V3, V6 and V7 have known solutions.

The function for each section runs a case of the study with one element, and defines everything but
the mesh independently for the oracle. All nodal forces along the contact, their sums,
displacements, translations and eigenvalues are compared, each relative to its largest value.

Two kinds of integrals depend on the quadrature rule: those over curved triangles, and those over
triangles that touch the axis with one vertex, where 1/r is not smooth. There, the study's rule of
degree 8 leaves differences above 1e-8, up to 5e-5 of the largest nodal force. In these cases the
library and the oracle use converged rules (`LIBRARY_DEGREES_AND_ORACLE_POINTS`).
"""

from unittest.mock import patch

import numpy as np
import pytest

from pw_elements.elasticity import body
from study.benchmarks import v1_contact_patch, v4_spence, v5_cattaneo
from study.benchmarks.v8_vibration import page as v8_vibration
from tests.oracle.contact import NodesAndSurface, solve_increments
from tests.oracle.eigen import eigenvalues_nearest_to_shift
from tests.oracle.problem import (
    ELEMENT_NAMES_IN_STATICS,
    NORMAL_DOWN,
    NORMAL_UP,
    StudyComparison,
    assert_agrees_with_own_weights_alone,
    combine_markers_by_and,
    combine_markers_by_or,
    condensed_stiffness_mass_and_mask,
    make_abs_x_below_row_marker,
    make_contact_line_comparison,
    make_oracle_body,
    make_plane_row_marker,
    marked_nodes_sorted_by_x,
    parabola_gap_and_normal_functions,
    plane_gap_and_normal_functions,
    symmetric_part,
)

# Degree of the library's rule, and points per direction of the oracle's rule. On quadrilaterals,
# both are the 5-point Gauss rule of the study's degree 8. On triangles, rules are applied to whole
# cells if weights are quadratic, and to each sub-cell if they are piecewise linear
LIBRARY_DEGREES_AND_ORACLE_POINTS = {
    "quadrilaterals": (8, 5),
    "triangles": (50, 24),
    "sub-triangles": (30, 16),
}


def patch_library_quadrature_degree(element):
    """Make the library use a higher quadrature degree for integrands that are not polynomials."""
    return patch.object(
        body, "_NON_POLYNOMIAL_QUADRATURE_DEGREE", library_degree_and_oracle_points(element)[0]
    )


def oracle_points_per_direction(element):
    """Return the number of Gauss points per direction in the oracle's rule for an element."""
    return library_degree_and_oracle_points(element)[1]


def library_degree_and_oracle_points(element):
    if element in ("galerkin-Q8", "pw-Q9"):
        return LIBRARY_DEGREES_AND_ORACLE_POINTS["quadrilaterals"]
    return LIBRARY_DEGREES_AND_ORACLE_POINTS[
        "sub-triangles" if element.startswith("pw") else "triangles"
    ]


def compare_patch_test(element, mesh="distorted", state="plane strain"):
    with patch_library_quadrature_degree(element):
        result = v1_contact_patch.patch(element, mesh, state)

    def solve_by_oracle(linear_weights):
        count = (
            3
            if (mesh, state) == ("distorted", "plane strain")
            else oracle_points_per_direction(element)
        )
        body = make_oracle_body(result, element, linear_weights, state, 1000.0, 0.3, n_gauss=count)
        pair = NodesAndSurface(
            marked_nodes_sorted_by_x(result.curves, make_plane_row_marker(1, 0.0)),
            *plane_gap_and_normal_functions(NORMAL_UP),
        )
        load, prescribed_mask = (
            body.traction_load(make_plane_row_marker(1, 1.0), (0.0, -3.0)),
            body.component_mask(make_plane_row_marker(0, 0.0), (0,)),
        )
        return solve_increments(body.stiffness(), [load], prescribed_mask, [pair], body.nodes)[-1]

    return make_contact_line_comparison(result, solve_by_oracle, NORMAL_UP, with_displacement=False)


def compare_spence_punch(element, state="plane strain"):
    mu = np.tan(np.pi / 9)
    result = v4_spence.stick_radius(element, 0.25, mu, 16, far_field=False, state=state)

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(result, element, linear_weights, state, 1.0, 0.25)
        prescribed_mask = body.component_mask(
            combine_markers_by_or(make_plane_row_marker(0, 5.0), make_plane_row_marker(1, -5.0)),
            (0, 1),
        )
        prescribed_mask |= body.component_mask(make_plane_row_marker(0, 0.0), (0,))
        punch_nodes = marked_nodes_sorted_by_x(
            result.curves,
            combine_markers_by_and(make_plane_row_marker(1, 0.0), make_abs_x_below_row_marker(1.0)),
        )
        motions = [((0.0, None), (0.0, -5e-4 * load_factor)) for load_factor in (0.5, 1.0)]
        pair = NodesAndSurface(
            punch_nodes, *plane_gap_and_normal_functions(NORMAL_DOWN), mu, motions
        )
        loads = [np.zeros(body.nodes.size)] * 2
        return solve_increments(body.stiffness(), loads, prescribed_mask, [pair], body.nodes)[-1]

    return make_contact_line_comparison(result, solve_by_oracle, NORMAL_DOWN)


def compare_partial_slip(element):
    """Compare partial slip of two bodies with matching nodes.

    In the study, the unknown of a lower contact node is its displacement relative to the opposite
    node. The oracle has the displacements of both nodes.
    """
    result = v5_cattaneo.partial_slip(element, 10, far_field=False)
    force = np.pi / (2 * (1 - 0.3**2)) / 4e4

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(result, element, linear_weights, "plane strain", 1.0, 0.3)
        outer_sides = combine_markers_by_or(
            make_plane_row_marker(1, -5.0),
            make_plane_row_marker(1, 6.0),
            make_plane_row_marker(0, -5.0),
            make_plane_row_marker(0, 5.0),
        )
        lower, upper = (
            marked_nodes_sorted_by_x(
                result.curves,
                combine_markers_by_and(
                    make_plane_row_marker(1, y), make_abs_x_below_row_marker(1.25)
                ),
            )
            for y in (0.0, 1.0)
        )
        motions = [((0.0, None), (0.0, -force))]
        motions += [((None, None), (factor * 0.4 * force, -force)) for factor in (0.25, 0.5)]
        pair = NodesAndSurface(
            lower, *parabola_gap_and_normal_functions(0.0, 1e4), 0.4, motions, opposite_nodes=upper
        )
        loads, prescribed_mask = (
            [np.zeros(body.nodes.size)] * 3,
            body.component_mask(outer_sides, (0, 1)),
        )
        return solve_increments(body.stiffness(), loads, prescribed_mask, [pair], body.nodes)[-1]

    return make_contact_line_comparison(
        result, solve_by_oracle, NORMAL_DOWN, (1.0, 0.0), with_displacement=False
    )


def compare_vibrating_rod(element):
    is_condensed = element == "pw-Q8"
    with patch_library_quadrature_degree(element):
        result = v8_vibration.rod(element, "transposed" if is_condensed else "all nodes", (1, 3))

    def compute_oracle_values(linear_weights):
        count = oracle_points_per_direction(element)
        body = make_oracle_body(
            result, element, linear_weights, "axisymmetric", 1.0, 0.3, n_gauss=count
        )
        K, M = body.stiffness(), body.mass()
        if element.startswith("pwsym"):
            K, M = symmetric_part(K), symmetric_part(M)
        prescribed_mask = body.component_mask(
            make_plane_row_marker(0, 0.0), (0,)
        ) | body.component_mask(make_plane_row_marker(1, 0.0), (1,))
        prescribed_mask |= body.component_mask(make_plane_row_marker(1, 1.0), (1,))
        if is_condensed:
            K, M, prescribed_mask = condensed_stiffness_mass_and_mask(
                body, element, prescribed_mask
            )
        return {"omega2": eigenvalues_nearest_to_shift(K, M, prescribed_mask, 6).real}

    study_values = np.array([result.scalars[f"omega2_{i}"] for i in range(1, 7)])
    return StudyComparison({"omega2": study_values}, compute_oracle_values)


T6_ELEMENT_NAMES = ("galerkin-T6", "pw-T6")
COMPARISONS_BY_PROBLEM = {
    "V1": (compare_patch_test, ELEMENT_NAMES_IN_STATICS, {}),
    "V1-curved": (compare_patch_test, T6_ELEMENT_NAMES, {"mesh": "curved"}),
    "V1-round": (compare_patch_test, ELEMENT_NAMES_IN_STATICS, {"state": "axisymmetric"}),
    "V4": (compare_spence_punch, ("pw-T6", "pw-Q8"), {}),
    "V4-plane stress": (compare_spence_punch, ("pw-T6",), {"state": "plane stress"}),
    "V5": (compare_partial_slip, ("pw-T6", "pw-Q9"), {}),
    "V8-rod": (
        compare_vibrating_rod,
        (*T6_ELEMENT_NAMES, "pwsym-T6", "galerkin-Q8", "pw-Q9", "pw-Q8"),
        {},
    ),
}
PROBLEMS_AND_ELEMENTS = [
    (name, element)
    for name, (_, elements, _) in COMPARISONS_BY_PROBLEM.items()
    for element in elements
]


@pytest.mark.parametrize(("name", "element"), PROBLEMS_AND_ELEMENTS)
def test_oracle_agrees_with_the_study_with_the_same_weights_alone(name, element):
    """The oracle agrees with the study if it has the same weights, and only then.

    The second part is tested for pw-T6. It shows that the comparison distinguishes the weights.
    """
    compare, _, parameters = COMPARISONS_BY_PROBLEM[name]
    assert_agrees_with_own_weights_alone(compare(element, **parameters), element)
