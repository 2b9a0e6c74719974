"""The oracle's own parts: its elements against Basix's, its contact against plain arithmetic."""

import basix
import numpy as np
import pytest

from pw_elements.spaces import macro_element
from tests.oracle.assembly import Body
from tests.oracle.contact import Pair, law_error, solve
from tests.oracle.elements import ELEMENTS, gauss, shapes, table

CELLS = {"L3": "interval", "T6": "triangle", "Q9": "quadrilateral", "T10": "tetrahedron"}


def places(name, count):
    """Points (q, d) at which the weight functions are tabulated, from the trial functions there."""
    functions = table(name, True, count)
    return functions.shapes @ np.array(ELEMENTS[name].nodes) / 2, functions


@pytest.mark.parametrize("name", CELLS)
def test_shape_functions_have_basixs_order(name):
    points, _ = gauss(ELEMENTS[name].simplex, len(ELEMENTS[name].nodes[0]), 3)
    theirs = basix.create_element(basix.ElementFamily.P, basix.CellType[CELLS[name]], 2)
    tabulated = theirs.tabulate(1, points)[..., 0]
    values, slopes = shapes(name, points)
    np.testing.assert_allclose(values, tabulated[0], atol=1e-14)
    np.testing.assert_allclose(slopes, np.moveaxis(tabulated[1:], 0, 2), atol=1e-14)


@pytest.mark.parametrize("name", CELLS)
def test_weight_functions_are_those_of_the_library(name):
    points, functions = places(name, 2)
    tabulated = macro_element(CELLS[name]).tabulate(1, points)
    np.testing.assert_allclose(functions.weights, tabulated[0], atol=1e-14)
    slopes = np.moveaxis(tabulated[1:], 0, 2)
    np.testing.assert_allclose(functions.weight_slopes, slopes, atol=1e-13)


def one_square(linear_weights):
    """A unit square of one 9-node quadrilateral, plane stress, E = 1, nu = 0."""
    nodes, cells = np.array(ELEMENTS["Q9"].nodes) / 2, np.arange(9)[None]
    return Body(nodes, cells, "Q9", linear_weights, "plane stress", 1.0, 0.0)


def pressed_and_pulled(mu, pull, linear_weights=True, tie=1.0):
    """State of the square on a plane, under a pressure of 1/2 and a force on the right side."""
    body = one_square(linear_weights)
    lower = np.flatnonzero(body.nodes[:, 1] == 0.0)
    upwards = lambda x: np.tile((0.0, 1.0), (len(x), 1))  # noqa: E731
    pair = Pair(lower, lambda x: x[:, 1], upwards, mu)
    pressure = body.traction(lambda x: x[:, 1] == 1.0, (0.0, -0.5))
    loads = [pressure, pressure + body.traction(lambda x: x[:, 0] == 1.0, (pull, 0.0))]
    held = np.zeros((9, 2), dtype=bool)
    return solve(body.stiffness(), loads, held, [pair], body.nodes, tie)[-1]


@pytest.mark.parametrize(("linear_weights", "shares"), [(True, (1, 2, 1)), (False, (1, 4, 1))])
def test_even_pressure_arrives_as_the_weights_share_it(linear_weights, shares):
    state = pressed_and_pulled(0.0, 0.0, linear_weights)
    (force,) = state.forces
    np.testing.assert_allclose(
        force[np.argsort([0, 2, 1]), 1], 0.5 * np.array(shares) / sum(shares)
    )
    np.testing.assert_allclose(state.displacement[[2, 3, 7], 1], -0.5, rtol=1e-12)


def test_forces_balance_and_do_not_depend_on_the_springs():
    state = pressed_and_pulled(0.6, 0.2)
    np.testing.assert_allclose(state.forces[0].sum(axis=0), (-0.2, 0.5), rtol=1e-12)
    for tie in (0.1, 10.0):
        other = pressed_and_pulled(0.6, 0.2, tie=tie)
        np.testing.assert_allclose(other.forces[0], state.forces[0], atol=1e-11)
        np.testing.assert_allclose(other.displacement, state.displacement, atol=1e-11)


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
