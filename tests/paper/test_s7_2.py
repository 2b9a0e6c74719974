"""Section 7.2: an elastic block pressed on a rigid surface and pulled along it (Figs 6 to 8).

Printed: E = 1000, Poisson's ratio 0.3, friction 0.3, 400 triangles or 200 quadrilaterals, no
friction below the first and the last element. Dimensions and loads are reconstructed.
"""

import numpy as np
import pytest

from tests.oracle.contact import Pair, solve
from tests.oracle.problem import (
    NORMAL_UP,
    STATIC,
    assert_found,
    contact_problem,
    nothing_held,
    on,
    oracle_body,
    plane,
    sorted_nodes,
)


def block(result, element):
    """Pressed by 200, then pulled by 60 in ten steps; smooth below its first and last element."""

    def solved(linear):
        body = oracle_body(result, element, linear, "plane stress", 1000.0, 0.3)
        pressure = body.traction(on(1, 2.0), (0.0, -200.0))
        pull = body.traction(on(0, 4.0), (60.0, 0.0))
        lower = sorted_nodes(result.curves, on(1, 0.0))
        x = body.nodes[lower, 0]
        rough = np.where((x > 0.2 - 1e-9) & (x < 3.8 + 1e-9), 0.3, 0.0)
        loads = [pressure + k / 10 * pull for k in range(11)]
        pair = Pair(lower, *plane(NORMAL_UP), rough)
        return solve(body.stiffness(), loads, nothing_held(body), [pair], body.nodes)[-1]

    return contact_problem(result, solved, NORMAL_UP)


@pytest.mark.parametrize("element", STATIC)
def test_oracle_finds_the_numbers_of_the_study(element, results):
    assert_found(block(results[f"7.2/{element}"], element), element)
