"""Test the examples of sections 7.1 to 7.4 against the oracle's solutions (Figs 4 to 14).

The examples are triangles on a base, a block, a parabolic punch and a rigid plate. Each function
`make_..._comparison` compares a stored result with the oracle's solution of the same problem.
"""

import numpy as np
import pytest

from tests.oracle.contact import NodesAndSurface, solve_increments
from tests.oracle.problem import (
    ELEMENT_NAMES_IN_STATICS,
    NORMAL_DOWN,
    NORMAL_UP,
    StudyComparison,
    assert_agrees_with_own_weights_alone,
    combine_markers_by_and,
    combine_markers_by_or,
    make_abs_x_below_row_marker,
    make_contact_line_comparison,
    make_oracle_body,
    make_plane_row_marker,
    marked_nodes_sorted_by_x,
    mask_without_prescribed_displacements,
    parabola_gap_and_normal_functions,
    plane_gap_and_normal_functions,
    solve_with_zero_supports,
)


def make_square_row_comparison(result, element):
    """Return the comparison for a row of squares on a smooth base under unit load (Figs 4 and 5).

    Each square is divided into two triangles. According to the paper, the central reaction is four
    times as large as the others with Galerkin's method; with the new method, all are equal. Fig. 5
    is missing from our copy of the paper.
    """

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(result, element, linear_weights, "plane stress", 1.0, 0.3)
        lower_nodes = marked_nodes_sorted_by_x(result.curves, make_plane_row_marker(1, 0.0))
        held_components = body.component_mask(make_plane_row_marker(1, 0.0), (1,))
        held_components |= body.component_mask(
            combine_markers_by_and(make_plane_row_marker(0, 0.0), make_plane_row_marker(1, 0.0)),
            (0,),
        )
        f = body.traction_load(make_plane_row_marker(1, 1.0), (0.0, -1.0))
        K = body.stiffness()
        residual = (K @ solve_with_zero_supports(K, f, held_components) - f).reshape(-1, 2)
        return {"reaction": residual[lower_nodes, 1], "sum": residual[lower_nodes, 1].sum()}

    study_values = {"reaction": result.curves["reaction"], "sum": result.scalars["sum"]}
    return StudyComparison(study_values, solve_by_oracle)


def make_block_comparison(result, element):
    """Return the comparison for a block pressed by 200, then pulled by 60 in ten steps.

    The paper gives E = 1000, Poisson's ratio 0.3, a friction coefficient of 0.3 except below the
    first and the last element, which slide freely, and 400 triangles or 200 quadrilaterals. The
    dimensions and loads have been reconstructed.
    """

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(result, element, linear_weights, "plane stress", 1000.0, 0.3)
        pressure_load = body.traction_load(make_plane_row_marker(1, 2.0), (0.0, -200.0))
        pull_load = body.traction_load(make_plane_row_marker(0, 4.0), (60.0, 0.0))
        lower_nodes = marked_nodes_sorted_by_x(result.curves, make_plane_row_marker(1, 0.0))
        x = body.nodes[lower_nodes, 0]
        friction = np.where((x > 0.2 - 1e-9) & (x < 3.8 + 1e-9), 0.3, 0.0)
        loads = [pressure_load + k / 10 * pull_load for k in range(11)]
        pair = NodesAndSurface(lower_nodes, *plane_gap_and_normal_functions(NORMAL_UP), friction)
        return solve_increments(
            body.stiffness(), loads, mask_without_prescribed_displacements(body), [pair], body.nodes
        )[-1]

    return make_contact_line_comparison(result, solve_by_oracle, NORMAL_UP)


def make_parabolic_punch_comparison(result, element):
    """Return the comparison for a parabolic punch, pressed in and then pushed sideways.

    Each of these two motions has twenty steps. The paper gives E = 1000, Poisson's ratio 0.25, a
    friction coefficient of 0.6, 76 8-node quadrilaterals, an indentation of 0.25 under a force of
    about 215, and a tangential force of 10 % of the normal force. The dimensions have been
    reconstructed.
    """

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(result, element, linear_weights, "plane stress", 1000.0, 0.25)
        K, held_components = (
            body.stiffness(),
            body.component_mask(make_plane_row_marker(1, 0.0), (0, 1)),
        )
        top_nodes = marked_nodes_sorted_by_x(result.curves, make_plane_row_marker(1, 4.0))
        step_fractions = np.arange(1, 21) / 20
        downward_motions = [
            ((0.0, -0.25 * step_fraction), (0.0, 0.0)) for step_fraction in step_fractions
        ]

        def solve_for_motions(motions):
            pair = NodesAndSurface(
                top_nodes, *parabola_gap_and_normal_functions(4.0, 8.0), 0.6, motions
            )
            return solve_increments(
                K, [np.zeros(body.nodes.size)] * len(motions), held_components, [pair], body.nodes
            )

        force = -solve_for_motions(downward_motions)[-1].forces[0][:, 1].sum()
        sideways_motions = [((None, -0.25), (0.1 * force * s, 0.0)) for s in step_fractions]
        return solve_for_motions(downward_motions + sideways_motions)[-1]

    translation = (result.scalars["translation"], lambda state: state.translations[0, 0])
    return make_contact_line_comparison(
        result, solve_by_oracle, NORMAL_DOWN, translation=translation
    )


def make_rigid_plate_comparison(result, element):
    """Return the comparison for a rigid plate, 2 m wide, pressed by 40 kN in five steps.

    The sides and the base of the body below the plate are fixed. The paper gives these supports,
    E = 1.2e8 kN/m2, Poisson's ratio 0.25, a friction angle of 20 degrees, unit thickness and a
    force of 40 kN. The dimensions have been reconstructed.
    """

    def solve_by_oracle(linear_weights):
        body = make_oracle_body(result, element, linear_weights, "plane stress", 1.2e8, 0.25)
        on_held_sides = combine_markers_by_or(
            make_plane_row_marker(0, -20.0),
            make_plane_row_marker(0, 20.0),
            make_plane_row_marker(1, -10.0),
        )
        contact_nodes = marked_nodes_sorted_by_x(
            result.curves,
            combine_markers_by_and(make_plane_row_marker(1, 0.0), make_abs_x_below_row_marker(1.0)),
        )
        motions = [((0.0, None), (0.0, -40.0 * k / 5)) for k in range(1, 6)]
        pair = NodesAndSurface(
            contact_nodes, *plane_gap_and_normal_functions(NORMAL_DOWN), np.tan(np.pi / 9), motions
        )
        loads, held_components = (
            [np.zeros(body.nodes.size)] * 5,
            body.component_mask(on_held_sides, (0, 1)),
        )
        return solve_increments(body.stiffness(), loads, held_components, [pair], body.nodes)[-1]

    translation = (result.scalars["translation"], lambda state: -state.translations[0, 1])
    return make_contact_line_comparison(
        result, solve_by_oracle, NORMAL_DOWN, translation=translation
    )


COMPARISON_MAKERS_AND_ELEMENTS_BY_KEY = {
    "7.1/{}-row": (make_square_row_comparison, ELEMENT_NAMES_IN_STATICS),
    "7.2/{}": (make_block_comparison, ELEMENT_NAMES_IN_STATICS),
    "7.3/{}": (make_parabolic_punch_comparison, ("pw-T6", "galerkin-Q8")),
    "7.4/{}": (make_rigid_plate_comparison, ELEMENT_NAMES_IN_STATICS),
}


@pytest.mark.parametrize(
    ("key", "element"),
    [
        (key, element)
        for key, (_, elements) in COMPARISON_MAKERS_AND_ELEMENTS_BY_KEY.items()
        for element in elements
    ],
)
def test_oracle_agrees_with_the_studys_contact_with_own_weights_only(key, element, results):
    make_comparison, _ = COMPARISON_MAKERS_AND_ELEMENTS_BY_KEY[key]
    assert_agrees_with_own_weights_alone(
        make_comparison(results[key.format(element)], element), element
    )
