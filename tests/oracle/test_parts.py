"""The oracle's own parts: its elements against Basix's, its contact against plain arithmetic."""

import numpy as np
import pytest

from pw_elements.spaces import macro_element
from tests.oracle.contact import law_error
from tests.oracle.elements import ELEMENTS, table

CELLS = {"L3": "interval", "T6": "triangle", "Q9": "quadrilateral", "T10": "tetrahedron"}


def places(name, count):
    """Points (q, d) at which the weight functions are tabulated, from the trial functions there."""
    functions = table(name, True, count)
    return functions.shapes @ np.array(ELEMENTS[name].nodes) / 2, functions


@pytest.mark.parametrize("name", CELLS)
def test_weight_functions_are_those_of_the_library(name):
    points, functions = places(name, 2)
    tabulated = macro_element(CELLS[name]).tabulate(1, points)
    np.testing.assert_allclose(functions.weights, tabulated[0], atol=1e-14)
    slopes = np.moveaxis(tabulated[1:], 0, 2)
    np.testing.assert_allclose(functions.weight_slopes, slopes, atol=1e-13)


@pytest.mark.parametrize(
    ("force", "motion"),
    [
        ((-1e-3, 0.0), (0.0, 0.0)),  # pulls
        ((1.0, 0.0), (-1e-3, 0.0)),  # has gone through
        ((1.0, 0.0), (1e-3, 0.0)),  # pushes from afar
        ((1.0, 0.301), (0.0, 0.0)),  # out of the cone
        ((1.0, 0.1), (0.0, -1e-3)),  # slips inside of it
        ((1.0, 0.3), (0.0, 1e-3)),  # slips along the friction
    ],
)
def test_every_line_of_the_law_is_looked_at(force, motion):
    good, none = np.array([[1.0, 0.3], [1.0, 0.1]]), np.array([[0.0, -0.5], [0.0, 0.0]])
    mu = np.full(3, 0.3)
    assert law_error(good, none, mu[:2]) < 1e-15
    assert law_error(np.vstack([good, force]), np.vstack([none, motion]), mu) > 1e-4
