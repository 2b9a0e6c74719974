"""Test the weight functions of section 3 against the printed Eq. (15) to Eq. (20) (Figs 1, 2)."""

import basix
import numpy as np
import pytest

from pw_elements.spaces.elements import piecewise_linear_sub_cell_element
from tests.oracle.elements import tabulate_at_gauss_points

# The paper numbers the mid-side nodes after the vertices 1 to 3: 4 is between 1 and 2, 5 between 2
# and 3, 6 between 3 and 1. Basix and the oracle number them by the opposite vertex instead
BASIX_NODES_IN_PAPER_ORDER = [0, 1, 2, 5, 3, 4]
LOWER_LEFT_CORNERS_BY_SUB_ELEMENT = {
    1: (0, 0),
    2: (0.5, 0),
    3: (0, 0.5),
    4: None,
}  # the central sub-element A4 is upside down


def evaluate_printed_weights(sub_element, x, y):
    """Return the printed functions w1 to w6, each (n,), at points x, y (n,) of a sub-element.

    The sub-elements have the numbers 1 to 4.
    """
    zero = 0 * x
    return {
        1: (1 - 2 * x - 2 * y, zero, zero, 2 * x, zero, 2 * y),
        2: (zero, 2 * x - 1, zero, 2 - 2 * x - 2 * y, 2 * y, zero),
        3: (zero, zero, 2 * y - 1, zero, 2 * x, 2 - 2 * x - 2 * y),
        4: (zero, zero, zero, 1 - 2 * y, 2 * x + 2 * y - 1, 1 - 2 * x),
    }[sub_element]


def make_random_points_inside(sub_element, count=40):
    random_points = np.random.default_rng(sub_element).dirichlet(np.ones(3), count)[:, :2] / 2
    return (
        0.5 - random_points
        if LOWER_LEFT_CORNERS_BY_SUB_ELEMENT[sub_element] is None
        else random_points + LOWER_LEFT_CORNERS_BY_SUB_ELEMENT[sub_element]
    )


@pytest.mark.parametrize("sub_element", LOWER_LEFT_CORNERS_BY_SUB_ELEMENT)
def test_basix_element_has_the_printed_weight_functions(sub_element):
    points = make_random_points_inside(sub_element)
    tabulated = piecewise_linear_sub_cell_element("triangle").tabulate(0, points)[0][
        :, BASIX_NODES_IN_PAPER_ORDER
    ]
    np.testing.assert_allclose(
        tabulated, np.transpose(evaluate_printed_weights(sub_element, *points.T)), atol=1e-14
    )


@pytest.mark.parametrize("sub_element", LOWER_LEFT_CORNERS_BY_SUB_ELEMENT)
def test_oracle_has_the_printed_weight_functions(sub_element):
    """The oracle's weight functions equal the printed ones at the oracle's own Gauss points.

    The oracle lists the Gauss points sub-element by sub-element.
    """
    functions = tabulate_at_gauss_points("T6", True, 3)
    nodes = np.array([(0, 0), (1, 0), (0, 1), (0.5, 0.5), (0, 0.5), (0.5, 0)])
    points = (functions.shapes @ nodes).reshape(4, -1, 2)[sub_element - 1]
    oracle_weights = functions.weights.reshape(4, -1, 6)[sub_element - 1][
        :, BASIX_NODES_IN_PAPER_ORDER
    ]
    np.testing.assert_allclose(
        oracle_weights, np.transpose(evaluate_printed_weights(sub_element, *points.T)), atol=1e-14
    )


def test_stored_trial_functions_are_basixs_quadratic_ones(results):
    curves = results.curves("3/weights")
    triangle = basix.create_element(basix.ElementFamily.P, basix.CellType.triangle, 2)
    basix_functions = triangle.tabulate(0, curves["grid"])[0][:, BASIX_NODES_IN_PAPER_ORDER, 0]
    np.testing.assert_allclose(curves["shapes"], basix_functions, atol=1e-14)
