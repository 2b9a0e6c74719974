"""The problems of the study's own verification, stated again for the oracle: V1, V4, V5, V8.

Those of the paper are in `tests/paper`; V2, V3, V6 and V7 have known answers of their own.

A section's function runs a case of the study on an element and states it anew: all but the mesh.
All nodal forces along the contact, their sums, displacements, translations and eigenvalues are
compared, relative to the largest of each.

The integrals of triangles that touch the axis with one vertex, where 1/r is no smooth factor, and
of curved ones depend on the rule, and the study's of degree 8 leaves more than 1e-8, up to 5e-5 of
the largest nodal force. There both sides get rules of their own that have converged (`RULES`).
"""

from unittest.mock import patch

import numpy as np
import pytest

from pw_elements.elasticity import body
from study.verification import v1_contact_patch, v4_spence, v5_cattaneo, v8_vibration
from tests.oracle.contact import Pair, solve_increments
from tests.oracle.eigen import eigenvalues_nearest_to
from tests.oracle.problem import (
    NORMAL_DOWN,
    NORMAL_UP,
    STATIC_ELEMENTS,
    StudyComparison,
    all_of,
    any_of,
    assert_agrees_with_these_weights_alone,
    compare_contact_line,
    condense_inner_nodes,
    oracle_body,
    parabola_functions,
    plane_functions,
    rows_on_plane,
    rows_within,
    sorted_nodes,
    symmetric_part,
)

# Degree of the library's rule, points a direction of the oracle's. On quadrilaterals the study's
# own degree 8 is Gauss's 5 points in both; triangles have rules over whole cells with quadratic
# weights, over each sub-cell with piecewise-linear ones
RULES = {"quadrilaterals": (8, 5), "triangles": (50, 24), "sub-triangles": (30, 16)}


def raise_quadrature_degree(element):
    """The library's rule for integrands that are no polynomials, of a higher degree."""
    return patch.object(body, "_RATIONAL_DEGREE", rule(element)[0])


def oracle_gauss_count(element):
    """What the oracle's Gauss rule has in each direction instead."""
    return rule(element)[1]


def rule(element):
    if element in ("galerkin-Q8", "pw-Q9"):
        return RULES["quadrilaterals"]
    return RULES["sub-triangles" if element.startswith("pw") else "triangles"]


def patch_test(element, mesh="distorted", state="plane strain"):
    with raise_quadrature_degree(element):
        result = v1_contact_patch.patch(element, mesh, state)

    def solved(linear):
        count = 3 if (mesh, state) == ("distorted", "plane strain") else oracle_gauss_count(element)
        body = oracle_body(result, element, linear, state, 1000.0, 0.3, n_gauss=count)
        pair = Pair(sorted_nodes(result.curves, rows_on_plane(1, 0.0)), *plane_functions(NORMAL_UP))
        load, held = (
            body.traction_load(rows_on_plane(1, 1.0), (0.0, -3.0)),
            body.component_mask(rows_on_plane(0, 0.0), (0,)),
        )
        return solve_increments(body.stiffness(), [load], held, [pair], body.nodes)[-1]

    return compare_contact_line(result, solved, NORMAL_UP, with_displacement=False)


def spence_punch(element, state="plane strain"):
    mu = np.tan(np.pi / 9)
    result = v4_spence.stick_radius(element, 0.25, mu, 16, far_field=False, state=state)

    def solved(linear):
        body = oracle_body(result, element, linear, state, 1.0, 0.25)
        held = body.component_mask(any_of(rows_on_plane(0, 5.0), rows_on_plane(1, -5.0)), (0, 1))
        held |= body.component_mask(rows_on_plane(0, 0.0), (0,))
        below = sorted_nodes(result.curves, all_of(rows_on_plane(1, 0.0), rows_within(1.0)))
        motions = [((0.0, None), (0.0, -5e-4 * share)) for share in (0.5, 1.0)]
        pair = Pair(below, *plane_functions(NORMAL_DOWN), mu, motions)
        loads = [np.zeros(body.nodes.size)] * 2
        return solve_increments(body.stiffness(), loads, held, [pair], body.nodes)[-1]

    return compare_contact_line(result, solved, NORMAL_DOWN)


def partial_slip(element):
    """Two bodies, node on node; the study has one unknown for both nodes of a pair."""
    result = v5_cattaneo.partial_slip(element, 10, far_field=False)
    force = np.pi / (2 * (1 - 0.3**2)) / 4e4

    def solved(linear):
        body = oracle_body(result, element, linear, "plane strain", 1.0, 0.3)
        outside = any_of(
            rows_on_plane(1, -5.0),
            rows_on_plane(1, 6.0),
            rows_on_plane(0, -5.0),
            rows_on_plane(0, 5.0),
        )
        lower, upper = (
            sorted_nodes(result.curves, all_of(rows_on_plane(1, y), rows_within(1.25)))
            for y in (0.0, 1.0)
        )
        motions = [((0.0, None), (0.0, -force))]
        motions += [((None, None), (s * 0.4 * force, -force)) for s in (0.25, 0.5)]
        pair = Pair(lower, *parabola_functions(0.0, 1e4), 0.4, motions, opposite_nodes=upper)
        loads, held = [np.zeros(body.nodes.size)] * 3, body.component_mask(outside, (0, 1))
        return solve_increments(body.stiffness(), loads, held, [pair], body.nodes)[-1]

    return compare_contact_line(result, solved, NORMAL_DOWN, (1.0, 0.0), with_displacement=False)


def vibrating_rod(element):
    condensed = element == "pw-Q8"
    with raise_quadrature_degree(element):
        result = v8_vibration.rod(element, "transposed" if condensed else "all nodes", (1, 3))

    def ours(linear):
        count = oracle_gauss_count(element)
        body = oracle_body(result, element, linear, "axisymmetric", 1.0, 0.3, n_gauss=count)
        K, M = body.stiffness(), body.mass()
        if element.startswith("pwsym"):
            K, M = symmetric_part(K), symmetric_part(M)
        held = body.component_mask(rows_on_plane(0, 0.0), (0,)) | body.component_mask(
            rows_on_plane(1, 0.0), (1,)
        )
        held |= body.component_mask(rows_on_plane(1, 1.0), (1,))
        if condensed:
            K, M, held = condense_inner_nodes(body, element, held)
        return {"omega2": eigenvalues_nearest_to(K, M, held, 6).real}

    theirs = np.array([result.scalars[f"omega2_{i}"] for i in range(1, 7)])
    return StudyComparison({"omega2": theirs}, ours)


T6 = ("galerkin-T6", "pw-T6")
PROBLEMS = {
    "V1": (patch_test, STATIC_ELEMENTS, {}),
    "V1-curved": (patch_test, T6, {"mesh": "curved"}),
    "V1-round": (patch_test, STATIC_ELEMENTS, {"state": "axisymmetric"}),
    "V4": (spence_punch, ("pw-T6", "pw-Q8"), {}),
    "V4-plane stress": (spence_punch, ("pw-T6",), {"state": "plane stress"}),
    "V5": (partial_slip, ("pw-T6", "pw-Q9"), {}),
    "V8-rod": (vibrating_rod, (*T6, "pwsym-T6", "galerkin-Q8", "pw-Q9", "pw-Q8"), {}),
}
CASES = [(name, element) for name, (_, elements, _) in PROBLEMS.items() for element in elements]


@pytest.mark.parametrize(("name", "element"), CASES)
def test_oracle_finds_the_numbers_of_the_study(name, element):
    """And does not with the other weights, else it could not tell which they are."""
    make, _, parameters = PROBLEMS[name]
    assert_agrees_with_these_weights_alone(make(element, **parameters), element)
